/* What a sense channel shows where it does not show the displacement: the velocity, or the acceleration.

   The sense chain, its offset and its effects, take q and q' where they took x and x': x' and x'' of a velocity, x'' and
   what the linear part makes of its derivative of an acceleration.  x'' is what the whole model says, effects included. */
#ifndef GYRO_SENSING_H
#define GYRO_SENSING_H

#include "kick.h"
#include "layout.h"
#include "model.h"
#include "structs.h"

enum { DISPLACEMENT, VELOCITY, ACCELERATION };

/* What the sense chain takes for displacement and velocity, q (states,), and its derivatives q_by (states, MAX_ENTRIES)
   by states and constants. */
typedef struct {
    real q[4];
    real q_by[4 * MAX_ENTRIES];
} Motion;

/* Whether a channel shows something else than the displacement. */
static inline int senses_otherwise(const Settings *settings)
{
    return settings->sensed[0] + settings->sensed[1] > 0;
}

/* slope (states,) of state s, effects included, and its derivatives slope_by (states, MAX_ENTRIES); linear (states,
   states) those by the states of the model without effects. */
static inline void whole_field(const Settings *settings, const real *c, const real *s, Push *push, real *linear,
                               real *slope, real *slope_by)
{
    whole states = settings->states, flowing = settings->flow_constants, columns = 1 + states + flowing;
    whole first = states + settings->sense_constants;
    real a[4 * MAX_COLUMNS], b[4 * MAX_COLUMNS];
    memset(a, 0, sizeof a);
    memset(b, 0, sizeof b);
    memset(slope_by, 0, 4 * MAX_ENTRIES * sizeof(real));
    for (whole i = 0; i < states; i++) {
        a[i * columns] = s[i];
        a[i * columns + 1 + i] = R(1.0);
    }
    field_columns(settings->model, c, a, push->drive, b, columns, columns);
    effect_forces(settings, c, s, push);
    for (whole i = 0; i < states; i++) {
        slope[i] = b[i * columns];
        for (whole j = 0; j < states; j++)
            linear[i * states + j] = slope_by[i * MAX_ENTRIES + j] = b[i * columns + 1 + j];
        for (whole k = 0; k < flowing; k++)
            slope_by[i * MAX_ENTRIES + first + k] = b[i * columns + 1 + states + k];
    }
    for (whole axis = 0; axis < settings->axes; axis++) {
        real *of_axis = slope_by + (2 * axis + 1) * MAX_ENTRIES;
        slope[2 * axis + 1] += push->force[axis];
        for (whole j = 0; j < states; j++)
            of_axis[j] += push->by_states[axis * states + j];
        for (whole k = 0; k < settings->sense_constants + flowing; k++)
            of_axis[states + k] += push->by_constants[axis * push->constants + k];
    }
}

/* Row of the motion <- what the linear part makes of the slope, and its derivatives: with the constants it moves as the
   field there, without a drive. */
static inline void linear_slope(const Settings *settings, const real *c, const real *linear, const real *slope,
                                const real *slope_by, whole row, Motion *motion)
{
    static const real no_drive[MAX_AXES] = {R(0.0), R(0.0)};
    whole states = settings->states, flowing = settings->flow_constants, columns = 1 + states + flowing;
    whole first = states + settings->sense_constants;
    real a[4 * MAX_COLUMNS], b[4 * MAX_COLUMNS], *by = motion->q_by + row * MAX_ENTRIES;
    memset(a, 0, sizeof a);
    memset(b, 0, sizeof b);
    memset(by, 0, MAX_ENTRIES * sizeof(real));
    motion->q[row] = R(0.0);
    for (whole i = 0; i < states; i++) {
        real share = linear[row * states + i];
        a[i * columns] = slope[i];
        motion->q[row] += share * slope[i];
        for (whole j = 0; j < first + flowing; j++)
            by[j] += share * slope_by[i * MAX_ENTRIES + j];
    }
    field_columns(settings->model, c, a, no_drive, b, columns, columns);
    for (whole k = 0; k < flowing; k++)
        by[first + k] += b[row * columns + 1 + states + k];
}

/* Row of the motion <- another state, or the slope of one. */
static inline void take_row(Motion *motion, whole row, real value, const real *by)
{
    motion->q[row] = value;
    memcpy(motion->q_by + row * MAX_ENTRIES, by, MAX_ENTRIES * sizeof(real));
}

/* The motion that the sense chain takes at state s; drive and signals as they stand in push, whose forces are written
   over. */
static inline void sensed_motion(const Settings *settings, const real *c, const real *s, Push *push, Motion *motion)
{
    whole states = settings->states;
    real linear[16], slope[4], slope_by[4 * MAX_ENTRIES], unit[MAX_ENTRIES];
    whole_field(settings, c, s, push, linear, slope, slope_by);
    memset(motion->q_by, 0, sizeof motion->q_by);
    for (whole i = 0; i < states; i++) {
        motion->q[i] = s[i];
        motion->q_by[i * MAX_ENTRIES + i] = R(1.0);
    }
    for (whole axis = 0; axis < settings->axes; axis++) {
        whole row = 2 * axis;
        const real *slope_there = slope_by + (row + 1) * MAX_ENTRIES;
        if (settings->sensed[axis] == VELOCITY) {
            memset(unit, 0, sizeof unit);
            unit[row + 1] = R(1.0);
            take_row(motion, row, s[row + 1], unit);
            take_row(motion, row + 1, slope[row + 1], slope_there);
        } else if (settings->sensed[axis] == ACCELERATION) {
            take_row(motion, row, slope[row + 1], slope_there);
            linear_slope(settings, c, linear, slope, slope_by, row + 1, motion);
        }
    }
}

/* What the sense chain makes of the motion q, effects included: predicted (axes,) and its derivatives full (2, total) by q
   and by the constants. */
static inline void sense_chain(const Settings *settings, const real *c, const real *q, Push *push, whole total,
                               real *predicted, real *full)
{
    whole states = settings->states;
    for (whole i = 0; i < 2 * total; i++)
        full[i] = R(0.0);
    sense(settings->model, c, q, predicted, full, total);
    for (whole e = 0; e < settings->effect_count; e++)
        effect_sense(settings->effects[e][0], settings->model, c, q, push->drive, push->signals,
                     settings->effects[e][1], settings->effects[e][2], predicted, full, total, full + states, total);
}

/* Measurement predicted (axes,) at state s and its derivatives full (2, total) by states and constants, effects included;
   drive and signals as they stand in push, whose forces are written over. */
static inline void sensed_at(const Settings *settings, const real *c, const real *s, Push *push, whole total,
                             real *predicted, real *full)
{
    whole states = settings->states, entries = states + settings->sense_constants + settings->flow_constants;
    if (!senses_otherwise(settings)) {
        sense_chain(settings, c, s, push, total, predicted, full);
        return;
    }
    Motion motion;
    sensed_motion(settings, c, s, push, &motion);
    sense_chain(settings, c, motion.q, push, total, predicted, full);
    for (whole axis = 0; axis < settings->axes; axis++) {
        real *of_axis = full + axis * total, by_q[4];
        memcpy(by_q, of_axis, (size_t)states * sizeof(real));
        for (whole j = 0; j < entries; j++) {
            real value = j >= states ? of_axis[j] : R(0.0);
            for (whole i = 0; i < states; i++)
                value += by_q[i] * motion.q_by[i * MAX_ENTRIES + j];
            of_axis[j] = value;
        }
    }
}

#endif
