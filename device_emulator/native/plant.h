/* The proof mass over one step: Runge-Kutta of order 6 (Butcher 1964, seven stages); the equations and what decides the
   number of steps stand in device_emulator/plant.py. */
#ifndef EMULATOR_PLANT_H
#define EMULATOR_PLANT_H

#include <string.h>

#include "force.h"

enum { STAGES = 7 };

/* The drive at the start of a step, its slopes, a force on the mass alone and a rate that is none, held. */
typedef struct {
    double u[2], slope[2], noise[2], drift_rad_s;
} push_t;

static const double NODE[STAGES] = {0, 1.0 / 3, 2.0 / 3, 1.0 / 3, 1.0 / 2, 1.0 / 2, 1};
static const double COEFFICIENT[STAGES][STAGES - 1] = {
    {0},
    {1.0 / 3},
    {0, 2.0 / 3},
    {1.0 / 12, 1.0 / 3, -1.0 / 12},
    {-1.0 / 16, 9.0 / 8, -3.0 / 16, -3.0 / 8},
    {0, 9.0 / 8, -3.0 / 8, -3.0 / 4, 1.0 / 2},
    {9.0 / 44, -9.0 / 11, 63.0 / 44, 18.0 / 11, 0, -16.0 / 11},
};
static const double WEIGHT[STAGES] = {11.0 / 120, 0, 27.0 / 40, 27.0 / 40, -4.0 / 15, -4.0 / 15, 11.0 / 120};

/* Acceleration a of the noiseless mass under the force u, without hidden effects. */
static inline void accelerate(const plant_t *plant, turn_t turn, const double u[2], const double *s, double a[2])
{
    double centrifugal = turn.rate_rad_s * turn.rate_rad_s;
    a[0] = u[0] + 2.0 * turn.rate_rad_s * s[3] + centrifugal * s[0] + turn.slope_rad_s2 * s[2];
    a[1] = u[1] - 2.0 * turn.rate_rad_s * s[1] + centrifugal * s[2] - turn.slope_rad_s2 * s[0];
    a[0] -= plant->dxx * s[1] + plant->dxy * s[3] + plant->kxx * s[0] + plant->kxy * s[2];
    a[1] -= plant->dxy * s[1] + plant->dyy * s[3] + plant->kxy * s[0] + plant->kyy * s[2];
}

/* Carry the first n entries of `motion` from t_s over h seconds, back when h < 0. Inlined for each n that a caller
   knows, so that the compiler unrolls it. */
__attribute__((always_inline)) static inline void step_of(const plant_t *plant, effects_t effects,
                                                          const piece_t *piece, double t_s, double h,
                                                          const push_t *push, int n, double *motion)
{
    double stage[STAGES][STATES], s[STATES];
    for (int i = 0; i < STAGES; i++) {
        memcpy(s, motion, sizeof s);
        for (int j = 0; j < i; j++) {
            double weight = h * COEFFICIENT[i][j];
            if (weight != 0.0)
                for (int k = 0; k < n; k++)
                    s[k] += weight * stage[j][k];
        }
        double since = NODE[i] * h, a[2];
        double u[2] = {push->u[0] + since * push->slope[0], push->u[1] + since * push->slope[1]};
        turn_t turn = rate_at(piece, t_s + since);
        turn.rate_rad_s += push->drift_rad_s;
        accelerate(plant, turn, u, s, a);
        stage[i][0] = s[1];
        stage[i][1] = a[0];
        stage[i][2] = s[3];
        stage[i][3] = a[1];
        if (effects.count > 0)
            add_effects(plant, effects, t_s + since, warmer(&plant->temperature, t_s + since), turn, u[0], u[1], s,
                        stage[i]);
        stage[i][1] += push->noise[0];
        stage[i][3] += push->noise[1];
    }
    for (int i = 0; i < STAGES; i++) {
        double weight = h * WEIGHT[i];
        if (weight != 0.0)
            for (int k = 0; k < n; k++)
                motion[k] += weight * stage[i][k];
    }
}

static void step(const plant_t *plant, effects_t effects, const piece_t *piece, double t_s, double h,
                 const push_t *push, int n, double *motion)
{
    if (n == 4)
        step_of(plant, effects, piece, t_s, h, push, 4, motion);
    else
        step_of(plant, effects, piece, t_s, h, push, n, motion);
}

/* `step` for a mass without hidden effects. */
static void step_alone(const plant_t *plant, const piece_t *piece, double t_s, double h, const push_t *push,
                       double *motion)
{
    step_of(plant, (effects_t){NULL, 0}, piece, t_s, h, push, 4, motion);
}

/* Where friction turns over: in v0, how near to rest that is; parts while the velocity moves by v0; and no more than
   that, for a v0 of next to nothing. */
#define TURNOVER 6.0
#define PARTS_PER_REST 2.0
#define MOST_PARTS 256.0

/* Into how many equal parts a step has to be cut for dry friction that turns over in it; 1 where none does. */
static inline int64_t parts(const plant_t *plant, effects_t effects, const piece_t *piece, double t_s, double h,
                            const push_t *push, const double *motion)
{
    double most = 1.0;
    for (int64_t n = 0; n < effects.count; n++) {
        const effect_t *effect = &effects.first[n];
        bool radial = effect->kind == DRY_FRICTION_RADIAL;
        if (!radial && effect->kind != DRY_FRICTION && effect->kind != DRY_FRICTION_ASYMMETRIC &&
            effect->kind != STRIBECK_FRICTION)
            continue;
        double rest = effect->c[radial ? 1 : 2], near = TURNOVER * rest, a[2];
        accelerate(plant, rate_at(piece, t_s), push->u, motion, a);
        double halfway[2] = {motion[1] + 0.5 * a[0] * h, motion[3] + 0.5 * a[1] * h};
        if (radial) {
            double moved_by = h * hypot(a[0], a[1]);
            if (hypot(halfway[0], halfway[1]) < 0.5 * moved_by + near)
                most = fmax(most, PARTS_PER_REST * moved_by / rest);
            continue;
        }
        for (int axis = 0; axis < 2; axis++) {
            double moved_by = fabs(a[axis] * h);
            if (effect->c[axis] != 0.0 && fabs(halfway[axis]) < 0.5 * moved_by + near)
                most = fmax(most, PARTS_PER_REST * moved_by / rest);
        }
    }
    return (int64_t)ceil(fmin(most, MOST_PARTS));
}

#endif
