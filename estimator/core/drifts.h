/* How effects enter the flow of two axes: impulses between exact drifts, each a matrix that takes every column along.

   The scheme is the symmetric one of orders (8, 6, 4) of Blanes, Casas, Farres, Laskar, Makazaga & Murua (Appl. Numer.
   Math. 68, 2013). */
#ifndef GYRO_DRIFTS_H
#define GYRO_DRIFTS_H

#include "lanes.h"
#include "layout.h"
#include "model.h"
#include "structs.h"
#include "taylor.h"

#define STAGES 8
#define IMPULSES (STAGES - 1)

static const real DRIFTS[STAGES] = {
    R(0.07113342649822312),  R(0.24115342795664010),  R(0.52141176177281479), R(-0.33369861622767801),
    R(-0.33369861622767801), R(0.52141176177281479), R(0.24115342795664010), R(0.07113342649822312),
};
static const real KICKS[IMPULSES] = {
    R(0.18308368747219722),  R(0.31078285989857487), R(-0.02656461851195880), R(0.06539614228237342),
    R(-0.02656461851195880), R(0.31078285989857487), R(0.18308368747219722),
};
/* Of Gauss's rule of three points, which follow the end of an interval. */
static const real NODES[4] = {R(1.0), R(0.11270166537925831), R(0.5), R(0.88729833462074169)};
static const real WEIGHTS[3] = {R(5.0) / R(18.0), R(8.0) / R(18.0), R(5.0) / R(18.0)};

/* The matrix of a drift, and what it makes of a number p that it takes to `moved`.  In 32 bits it is kept without the ones
   on its diagonal, as what it adds: ones round off what is small beside them, alike at each sample, and that turns the
   pattern. */
#ifdef CORE_FLOAT32
#define DIAGONAL R(0.0)
#define DRIFTED(p, moved) ((p) + (moved))
#else
#define DIAGONAL R(1.0)
#define DRIFTED(p, moved) (moved)
#endif

/* The drift of a stage, by its length. */
static inline whole length_of(whole stage)
{
    return stage < LENGTHS ? stage : STAGES - 1 - stage;
}

/* out (LENGTHS, OF_A_LENGTH) <- how two axes move over each length of a drift, in parts of h: the columns of exp(M t), its
   diagonal as above, and what the drive u (2,) adds; then both for Gauss's points within it, exp(M t) whole.  powers is scratch, for orders up to `order`. */
static inline void drift_matrices(const real *c, const real *u, real h, whole order, real *powers, real *out)
{
    order = taylor_terms(LONGEST, DRIFTS[2] * h, order); /* of the longest */
    gyro_powers(c, h, order, powers);
    for (whole which = 0; which < LENGTHS; which++) {
        for (whole node = 0; node < 4; node++) {
            real length = DRIFTS[which] * NODES[node], share = R(1.0), t = length * h;
            real ones = node == 0 ? DIAGONAL : R(1.0);
            four f0 = scale4(ones, take4(powers)), f1 = scale4(ones, take4(powers + 4)),
                 f2 = scale4(ones, take4(powers + 8)), f3 = scale4(ones, take4(powers + 12));
            four driven = add4(scale4(t * u[0], take4(powers + 4)), scale4(t * u[1], take4(powers + 12)));
            whole last = taylor_terms(node == 0 ? LONGEST : LONGEST_WITHIN, t, order);
            for (whole n = 1; n <= last; n++) {
                const real *power = powers + 16 * n;
                share *= length;
                four q1 = take4(power + 4), q3 = take4(power + 12);
                f0 = add4(f0, scale4(share, take4(power)));
                f1 = add4(f1, scale4(share, q1));
                f2 = add4(f2, scale4(share, take4(power + 8)));
                f3 = add4(f3, scale4(share, q3));
                real since = share * t / (real)(n + 1);
                driven = add4(add4(driven, scale4(since * u[0], q1)), scale4(since * u[1], q3));
            }
            real *to = out + OF_A_LENGTH * which + 20 * node;
            put4(to, f0);
            put4(to + 4, f1);
            put4(to + 8, f2);
            put4(to + 12, f3);
            put4(to + 16, driven);
        }
    }
}

/* The columns of out (4, columns) <- where the drift m of one length, with no drive in it, takes them. */
static inline void drift(const real *m, whole columns, real *out)
{
    real *restrict o0 = out, *restrict o1 = out + columns, *restrict o2 = out + 2 * columns,
         *restrict o3 = out + 3 * columns;
    const real m0 = m[0], m4 = m[1], m8 = m[2], m12 = m[3], m1 = m[4], m5 = m[5], m9 = m[6], m13 = m[7];
    const real m2 = m[8], m6 = m[9], m10 = m[10], m14 = m[11], m3 = m[12], m7 = m[13], m11 = m[14], m15 = m[15];
    for (whole j = 0; j < columns; j++) {
        real p0 = o0[j], p1 = o1[j], p2 = o2[j], p3 = o3[j];
        o0[j] = DRIFTED(p0, m0 * p0 + m1 * p1 + m2 * p2 + m3 * p3);
        o1[j] = DRIFTED(p1, m4 * p0 + m5 * p1 + m6 * p2 + m7 * p3);
        o2[j] = DRIFTED(p2, m8 * p0 + m9 * p1 + m10 * p2 + m11 * p3);
        o3[j] = DRIFTED(p3, m12 * p0 + m13 * p1 + m14 * p2 + m15 * p3);
    }
}

/* entries (4, 8) <- what each state, added to the force of each axis all along the drift m over t, too, does by its end;
   s (4,) the state at its start. */
static inline void drift_entries(const real *m, real t, const real *s, real *entries)
{
    drift(m, 8, entries);
    for (whole point = 0; point < 3; point++) {
        const real *there = m + 20 * (1 + point), *rest = m + 20 * (3 - point); /* as far from the end as from the start */
        four at = add4(scale4(s[0], take4(there)), scale4(s[1], take4(there + 4)));
        at = add4(add4(at, scale4(s[2], take4(there + 8))), scale4(s[3], take4(there + 12)));
        at = scale4(WEIGHTS[point] * t, add4(at, take4(there + 16)));
        for (whole i = 0; i < 4; i++) {
            put4(entries + 8 * i, add4(take4(entries + 8 * i), scale4(rest[4 + i], at)));
            put4(entries + 8 * i + 4, add4(take4(entries + 8 * i + 4), scale4(rest[12 + i], at)));
        }
    }
}

/* The velocities in entries (4, 8) <- what weight times the forces, by_states (2, 4) of the states, leave of them. */
static inline void push_entries(real weight, const real *by_states, real *entries)
{
    const real *x = by_states, *y = by_states + 4;
    for (whole j = 0; j < 8; j++) {
        real o0 = entries[j], o1 = entries[8 + j], o2 = entries[16 + j], o3 = entries[24 + j];
        entries[8 + j] = o1 + weight * (x[0] * o0 + x[1] * o1 + x[2] * o2 + x[3] * o3);
        entries[24 + j] = o3 + weight * (y[0] * o0 + y[1] * o1 + y[2] * o2 + y[3] * o3);
    }
}

#endif
