/* Elements whose foot the mass takes along with play: steps that end where it catches its foot and where it leaves it.

   Between two such events the foot rests or goes with the mass, and the integrator is of its full order. The events
   themselves are found by bisection over the length of the step, to rounding.
   States of an element: foot and hold of x, foot and hold of y; hold is 1 or -1 while the mass takes the foot along in
   that direction, else 0. */
#ifndef EMULATOR_PLAY_H
#define EMULATOR_PLAY_H

#include "plant.h"

enum {
    HALVED = 60,
    MOST_EVENTS = 64 /* in one step; what is left of it is taken in one */
};
#define BEYOND (1.0 + 1e-12) /* of the half-width: rounding is no event */

/* Whether there is an element with play among the effects. */
static inline bool has_play(effects_t effects)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == PLAY)
            return true;
    return false;
}

/* The feet where a mass leaves them that came from 0 to where it is. */
static inline void put_feet(effects_t effects, double *motion)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == PLAY)
            for (int axis = 0; axis < 2; axis++) {
                double x = motion[2 * axis], width = effects.first[n].c[2];
                double *foot = motion + effects.first[n].at + 2 * axis;
                foot[0] = fmax(x - width, fmin(x + width, 0.0));
                foot[1] = 0.0;
            }
}

/* Whether a foot that rests is further away than its half-width, or a mass turns that takes its foot along. */
static inline bool passed(effects_t effects, const double *motion)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == PLAY)
            for (int axis = 0; axis < 2; axis++) {
                const double *foot = motion + effects.first[n].at + 2 * axis;
                if (foot[1] != 0.0 && foot[1] * motion[2 * axis + 1] < 0.0)
                    return true;
                if (foot[1] == 0.0 && fabs(motion[2 * axis] - foot[0]) > BEYOND * effects.first[n].c[2])
                    return true;
            }
    return false;
}

/* Catch and leave feet as the motion says; one that is caught, or was, is exactly the half-width away. */
static inline void change(effects_t effects, double *motion)
{
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == PLAY)
            for (int axis = 0; axis < 2; axis++) {
                double width = effects.first[n].c[2], x = motion[2 * axis], v = motion[2 * axis + 1];
                double *foot = motion + effects.first[n].at + 2 * axis;
                if (foot[1] != 0.0) {
                    foot[0] = x - foot[1] * width;
                    if (foot[1] * v < 0.0)
                        foot[1] = 0.0;
                } else if (fabs(x - foot[0]) > BEYOND * width) {
                    foot[1] = x > foot[0] ? 1.0 : -1.0;
                    foot[0] = x - foot[1] * width;
                }
            }
}

/* `step`, in pieces that end where a mass catches or leaves a foot. */
static inline void step_with_play(const plant_t *plant, effects_t effects, const piece_t *piece, double t_s, double h,
                                  const push_t *push, int n, double *motion)
{
    push_t own = *push;
    double begin[STATES], since = 0.0;
    for (int event = 0; event < MOST_EVENTS; event++) {
        memcpy(begin, motion, sizeof begin);
        step(plant, effects, piece, t_s + since, h - since, &own, n, motion);
        if (!passed(effects, motion))
            return;
        double low = 0.0, high = h - since;
        for (int halving = 0; halving < HALVED; halving++) {
            double middle = 0.5 * (low + high);
            memcpy(motion, begin, sizeof begin);
            step(plant, effects, piece, t_s + since, middle, &own, n, motion);
            if (passed(effects, motion))
                high = middle;
            else
                low = middle;
        }
        memcpy(motion, begin, sizeof begin);
        step(plant, effects, piece, t_s + since, high, &own, n, motion);
        change(effects, motion);
        own.u[0] += high * own.slope[0];
        own.u[1] += high * own.slope[1];
        since += high;
        if (!(since < h))
            return;
    }
    step(plant, effects, piece, t_s + since, h - since, &own, n, motion);
}

#endif
