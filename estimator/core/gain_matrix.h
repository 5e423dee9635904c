/* The control law as one matrix on a board's filtered signals, exact for the motion it aims at.

   The motion X = (x, vx, y, vy) aimed at is linear, X' = M X: an isotropic oscillator that turns, with the holds'
   damping of the moment.  In it everything that the board does is linear in X[m] too.  Its filter gives s[m] = S X[m]
   with

       S E = A S + (b + c inv(E)^D) v E,     E = exp(M h), v the row that picks an axis' code out of X

   and a drive F X[m], held over the interval that begins L samples later, keeps the sampled positions on that motion
   when

       N E = Ad N + Bd F inv(E)^L            the rows of N that belong to positions being those of X itself

   with the exact flow Ad, Bd of the estimated gyro.  Both are linear equations; G = F inv(S).  So filter, delay and hold
   are exact at the frequencies of that motion, and nothing is approximated but by the estimates themselves. */
#ifndef GYRO_GAIN_MATRIX_H
#define GYRO_GAIN_MATRIX_H

#include "controller.h"
#include "layout.h"
#include "taylor.h"

/* What a gain matrix is solved with, and into: x (total,); a board's filter, s[m] = a s[m-1] + b v[m] + c v[m - delay] for
   each axis; turns (2, 4): -1 where the drive of a row and the channel of a column are turned round to one another; gain
   (2, 4), bias (2,); motion (4, 4) what the filter makes of a motion. */
typedef struct {
    whole total;
    whole delay;
    const Settings *settings;
    const Memory *memory;
    const real *x;
    real a[4];
    real b[2];
    real c[2];
    const real *turns;
    real *gain;
    real *bias;
    real *motion;
} Folding;

#define UNCHANGED R(0.25) /* of a hold's work may be done with one matrix: it is measured before and replaced after */

/* out (rows, columns) <- p (rows, inner) q (inner, columns); out is none of them. */
static inline void multiply(const real *p, const real *q, int rows, int inner, int columns, real *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            real total = R(0.0);
            for (int k = 0; k < inner; k++)
                total += p[i * inner + k] * q[k * columns + j];
            out[i * columns + j] = total;
        }
}

/* y (n, columns) <- inv(a) y by elimination with partial pivoting; a (n, n) is written over. */
static inline void solve(real *a, real *y, int n, int columns)
{
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (FABS(a[i * n + k]) > FABS(a[pivot * n + k]))
                pivot = i;
        for (int j = 0; pivot != k && j < n; j++) {
            real kept = a[k * n + j];
            a[k * n + j] = a[pivot * n + j];
            a[pivot * n + j] = kept;
        }
        for (int j = 0; pivot != k && j < columns; j++) {
            real kept = y[k * columns + j];
            y[k * columns + j] = y[pivot * columns + j];
            y[pivot * columns + j] = kept;
        }
        for (int i = k + 1; i < n; i++) {
            real share = a[i * n + k] / a[k * n + k];
            for (int j = k + 1; j < n; j++)
                a[i * n + j] -= share * a[k * n + j];
            for (int j = 0; j < columns; j++)
                y[i * columns + j] -= share * y[k * columns + j];
        }
    }
    for (int k = n - 1; k >= 0; k--)
        for (int j = 0; j < columns; j++) {
            real left = y[k * columns + j];
            for (int i = k + 1; i < n; i++)
                left -= a[k * n + i] * y[i * columns + j];
            y[k * columns + j] = left / a[k * n + k];
        }
}

/* out (n, n) <- the unit matrix. */
static inline void unit(real *out, int n)
{
    for (int i = 0; i < n * n; i++)
        out[i] = i % (n + 1) == 0 ? R(1.0) : R(0.0);
}

/* m (4, 4) for the state vector x, `ahead` of it in time; no hold acts faster than `fastest`. */
static inline void target_motion(const Settings *settings, const Memory *memory, const real *x, real fastest,
                                 real ahead, real *m)
{
    real rate = x[settings->states + RATE];
    real w = rate + virtual_rate(settings, memory->time + (double)ahead);
    real hold, square;
    holds(settings, memory, x, rate, w, fastest, &hold, &square);
    real k = settings->stiffness - rate * rate;
    for (int i = 0; i < 16; i++)
        m[i] = R(0.0);
    m[1] = R(1.0);
    m[11] = R(1.0);
    m[4] = -k;
    m[5] = hold;
    m[6] = -square - hold * w;
    m[7] = R(2.0) * w;
    m[12] = square + hold * w;
    m[13] = R(-2.0) * w;
    m[14] = -k;
    m[15] = hold;
}

/* out (4, 4) <- exp(m h) as a Taylor series of a short step. */
static inline void exponential(const real *m, real h, whole order, real *out)
{
    real term[16], next[16];
    unit(out, 4);
    unit(term, 4);
    for (whole n = 0; n < order; n++) {
        multiply(term, m, 4, 4, 4, next);
        for (int i = 0; i < 16; i++) {
            term[i] = next[i] * (h / ((real)n + R(1.0)));
            out[i] += term[i];
        }
    }
}

/* out (4, 4) <- the n-th power of e, n >= 0. */
static inline void power(const real *e, whole n, real *out)
{
    real next[16];
    unit(out, 4);
    for (whole i = 0; i < n; i++) {
        multiply(out, e, 4, 4, 4, next);
        memcpy(out, next, sizeof next);
    }
}

/* y (2, 4) with p y e + q y = r, for 2 by 2 p and q. */
static inline void sylvester(const real *p, const real *e, const real *q, const real *r, real *y)
{
    real a[64] = {R(0.0)};
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 2; k++) {
                a[8 * (4 * i + j) + 4 * k + j] += q[2 * i + k];
                for (int n = 0; n < 4; n++)
                    a[8 * (4 * i + j) + 4 * k + n] += p[2 * i + k] * e[4 * n + j];
            }
    memcpy(y, r, 8 * sizeof *y);
    solve(a, y, 8, 1);
}

/* out (4, 6) <- [Ad, Bd] of the gyro with constants c over one sample. */
static inline void exact_flow(const Settings *settings, const real *c, real *out)
{
    for (int j = 0; j < 6; j++) {
        real column[4] = {R(0.0)}, term[4], u[2] = {R(0.0), R(0.0)};
        if (j < 4)
            column[j] = R(1.0);
        else
            u[j - 4] = R(1.0);
        taylor(settings->model, c, u, 1, settings->h, settings->order, 1, term, column, 1);
        for (int i = 0; i < 4; i++)
            out[6 * i + j] = column[i];
    }
}

/* force (2, 4) <- the drive that keeps the sampled motion of the gyro with constants c on X[m+1] = e X[m]. */
static inline void force_of_motion(const Settings *settings, const real *c, const real *e, real *force)
{
    real moved[24], app[4], apv[4], avp[4], avv[4], bp[4], bv[4], pivots[4];
    real places[8] = {R(0.0)}, bare[8], reach[4], of_bare[8], of_reach[4], shifted[8], right[8], drive[8], late[16];
    exact_flow(settings, c, moved);
    for (int i = 0; i < 2; i++) {
        places[4 * i + 2 * i] = R(1.0);
        for (int j = 0; j < 2; j++) {
            app[2 * i + j] = moved[6 * (2 * i) + 2 * j];
            apv[2 * i + j] = moved[6 * (2 * i) + 2 * j + 1];
            avp[2 * i + j] = moved[6 * (2 * i + 1) + 2 * j];
            avv[2 * i + j] = moved[6 * (2 * i + 1) + 2 * j + 1];
            bp[2 * i + j] = moved[6 * (2 * i) + 4 + j];
            bv[2 * i + j] = moved[6 * (2 * i + 1) + 4 + j];
        }
    }
    /* The rows of positions give the velocities, V = bare - reach F', with F' = F inv(E)^L; those of velocities then
       give F'. */
    multiply(app, places, 2, 2, 4, bare);
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 4; j++)
            bare[4 * i + j] = e[4 * (2 * i) + j] - bare[4 * i + j];
    memcpy(pivots, apv, sizeof pivots);
    solve(pivots, bare, 2, 4);
    memcpy(pivots, apv, sizeof pivots);
    memcpy(reach, bp, sizeof reach);
    solve(pivots, reach, 2, 2);
    multiply(avv, reach, 2, 2, 2, of_reach);
    multiply(avv, bare, 2, 2, 4, of_bare);
    multiply(avp, places, 2, 2, 4, right);
    multiply(bare, e, 2, 4, 4, shifted);
    for (int i = 0; i < 8; i++)
        right[i] = right[i] - shifted[i] + of_bare[i];
    for (int i = 0; i < 4; i++) {
        of_reach[i] -= bv[i];
        reach[i] = -reach[i];
    }
    sylvester(reach, e, of_reach, right, drive);
    power(e, settings->latency, late);
    multiply(drive, late, 2, 4, 4, force);
}

/* s (4, 4) <- what the board's filter makes of the motion X[m+1] = e X[m], in sense codes. */
static inline void filtered_motion(const Folding *board, const real *e, real *s)
{
    const Settings *settings = board->settings;
    real back[16], inverse[16], before[16], less[4], one[4];
    memcpy(back, e, sizeof back);
    unit(inverse, 4);
    solve(back, inverse, 4, 4);
    power(inverse, board->delay, before);
    unit(one, 2);
    for (int i = 0; i < 4; i++)
        less[i] = -board->a[i];
    for (int axis = 0; axis < 2; axis++) {
        real row[4] = {R(0.0)}, was[4], heard[8], now[8];
        row[2 * axis + settings->sensed[axis]] = R(1.0) / settings->sense_scale[axis]; /* displacement, or velocity */
        multiply(row, before, 1, 4, 4, was);
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 4; j++)
                heard[4 * i + j] = board->b[i] * row[j] + board->c[i] * was[j];
        multiply(heard, e, 2, 4, 4, now);
        sylvester(one, e, less, now, s + 8 * axis);
    }
}

/* Gain and bias in drive codes for the newest estimate, zeros where that is not finite: for `horizon` samples from the
   estimate to the end of what they will be used for, in force `later` samples from it on.  An offset is added to what a
   channel shows, whichever way round that is. */
EXPORTED void estimator_gains(const Folding *board, int64_t horizon, int64_t later)
{
    const Settings *settings = board->settings;
    real fastest = UNCHANGED / ((real)horizon * settings->h), ahead = (real)later * settings->h;
    real *gain = board->gain, *bias = board->bias;
    const real *x = board->x, *turns = board->turns;
    real m[16], e[16], force[8], signals[16], turned[16], columns[8], still[2], rest[4];
    const real *c = x + settings->states;
    memset(gain, 0, 8 * sizeof *gain);
    memset(bias, 0, 2 * sizeof *bias);
    for (whole i = 0; i < board->total; i++)
        if (!isfinite(x[i]))
            return;
    target_motion(settings, board->memory, x, fastest, ahead, m);
    exponential(m, settings->h, settings->order, e);
    force_of_motion(settings, c, e, force);
    filtered_motion(board, e, signals);
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++)
            turned[4 * i + j] = signals[4 * j + i];
        columns[2 * i] = force[i];
        columns[2 * i + 1] = force[4 + i];
    }
    solve(turned, columns, 4, 2);
    for (int i = 0; i < 4; i++) {
        gain[i] = columns[2 * i] / settings->quantum * turns[i];
        gain[4 + i] = columns[2 * i + 1] / settings->quantum * turns[4 + i];
    }
    for (int i = 0; i < 2; i++) {
        still[i] = board->b[i] + board->c[i];
        for (int j = 0; j < 2; j++)
            rest[2 * i + j] = (i == j ? R(1.0) : R(0.0)) - board->a[2 * i + j];
    }
    solve(rest, still, 2, 1); /* what the filter makes of a constant code */
    for (int i = 0; i < 2; i++) {
        bias[i] = R(0.0);
        for (int axis = 0; axis < 2; axis++) {
            real offset = c[axis] / settings->sense_scale[axis];
            bias[i] -= (gain[4 * i + 2 * axis] * still[0] + gain[4 * i + 2 * axis + 1] * still[1]) * offset;
        }
    }
}

/* What a board's filter makes of the motion of an ideal oscillator at rest. */
EXPORTED void gyro_filtered_swing(const Folding *board)
{
    real swing[16] = {R(0.0)}, e[16];
    swing[1] = swing[11] = R(1.0);
    swing[4] = swing[14] = R(-1.0);
    exponential(swing, board->settings->h, board->settings->order, e);
    filtered_motion(board, e, board->motion);
}

#endif
