/* The impulses of effects: sum of their forces with all derivatives, and what an impulse does to the columns of a flow. */
#ifndef GYRO_KICK_H
#define GYRO_KICK_H

#include "lanes.h"
#include "layout.h"
#include "model.h"
#include "signals.h"
#include "structs.h"

/* Sum of the effects' forces at state s, drive and signals in push, and its derivatives, into push. */
static inline void effect_forces(const Settings *settings, const real *c, const real *s, Push *push)
{
    whole states = settings->states;
    if (settings->kinked == 1)
        directions(settings, settings->carried_signals, s, push->signals);
    for (whole k = 0; k < settings->slip_count; k++) {
        push->signals[settings->slips[k][0]] = push->slips[k][0];
        push->signals[MAX_SIGNALS + settings->slips[k][0]] = R(0.0);
    }
    memset(push->force, 0, sizeof push->force);
    memset(push->by_states, 0, sizeof push->by_states);
    memset(push->by_constants, 0, (size_t)(settings->axes * push->constants) * sizeof(real));
    for (whole e = 0; e < settings->effect_count; e++)
        effect_force(settings->effects[e][0], settings->model, c, s, push->drive, push->signals,
                     settings->effects[e][1], settings->effects[e][2], push->force, push->by_states, states,
                     push->by_constants, push->constants);
}

/* Whether the effects' forces, by their derivatives, depend on a velocity. */
static inline int by_velocity(const Settings *settings, const real *by_states)
{
    int depends = 0;
    for (whole axis = 0; axis < settings->axes; axis++)
        for (whole other = 0; other < settings->axes; other++)
            depends |= by_states[axis * settings->states + 2 * other + 1] != R(0.0);
    return depends;
}

/* Derivatives of the force on an axis that an impulse begins with, by the flow's columns but the first: into kept. */
static inline void keep(const Settings *settings, const Push *push, whole axis, whole columns, real *kept)
{
    whole states = settings->states;
    const real *by_constants = push->by_constants + axis * push->constants + settings->sense_constants;
    for (whole j = 0; j < states; j++)
        kept[j] = push->by_states[axis * states + j];
    for (whole j = states; j < columns - 1; j++)
        kept[j] = by_constants[j - states];
}

/* Add to the derivatives in push, which are those in the middle of an impulse, half df/dv times those at its start, kept
   (axes, columns). */
static inline void join(const Settings *settings, real half, whole columns, const real *restrict kept, Push *push)
{
    whole states = settings->states;
    const real *other = kept + (settings->axes - 1) * columns;
    for (whole axis = 0; axis < settings->axes; axis++) {
        real *by_states = push->by_states + axis * states;
        real *by_constants = push->by_constants + axis * push->constants + settings->sense_constants;
        real slope = half * by_states[1], cross = states == 4 ? half * by_states[3] : R(0.0);
        for (whole j = 0; j < states; j++)
            by_states[j] += slope * kept[j] + cross * other[j];
        for (whole j = states; j < columns - 1; j++)
            by_constants[j - states] += slope * kept[j] + cross * other[j];
    }
}

/* Add to the sensitivities of the velocities in out what weight times the forces make of those of the signals that depend
   on the way; moves: whether the forces depend on the velocity, and were taken from the middle of the impulse. */
static inline void push_slips(const Settings *settings, real weight, int moves, whole columns, real *out,
                              const Push *push)
{
    for (whole k = 0; k < settings->slip_count; k++) {
        whole axis = settings->slips[k][1], row = 2 * axis + 1;
        real share = weight * push->signals[MAX_SIGNALS + settings->slips[k][0]];
        if (moves)
            share *= R(1.0) + R(0.5) * weight * push->by_states[axis * settings->states + row];
        for (whole j = 1; j < columns; j++)
            out[row * columns + j] += share * push->slips[k][j];
    }
}

/* The velocities of two axes in out (4, columns) <- what weight times the forces in push leave of them. */
static inline void push_two(const Settings *settings, real weight, whole columns, real *out, const Push *push)
{
    real *restrict o0 = out, *restrict o1 = out + columns, *restrict o2 = out + 2 * columns,
         *restrict o3 = out + 3 * columns;
    const real *x = push->by_states, *y = push->by_states + 4;
    const real *of_x = push->by_constants + settings->sense_constants, *of_y = of_x + push->constants;
    real vx = o1[0] + weight * push->force[0], vy = o3[0] + weight * push->force[1];
    real x0 = weight * x[0], x1 = weight * x[1], x2 = weight * x[2], x3 = weight * x[3];
    real y0 = weight * y[0], y1 = weight * y[1], y2 = weight * y[2], y3 = weight * y[3];
    for (whole j = 0; j < columns; j++) {
        real p0 = o0[j], p1 = o1[j], p2 = o2[j], p3 = o3[j];
        o1[j] = p1 + x0 * p0 + x1 * p1 + x2 * p2 + x3 * p3;
        o3[j] = p3 + y0 * p0 + y1 * p1 + y2 * p2 + y3 * p3;
    }
    for (whole j = 5; j < columns; j++) { /* before, there are only the state and its own derivatives */
        o1[j] += weight * of_x[j - 5];
        o3[j] += weight * of_y[j - 5];
    }
    o1[0] = vx;
    o3[0] = vy;
}

/* The same of a single axis. */
static inline void push_one(const Settings *settings, real weight, whole columns, real *out, const Push *push)
{
    const real *of_x = push->by_constants + settings->sense_constants;
    real *x = out, *v = out + columns;
    for (whole j = 1; j < columns; j++) {
        real pushed = push->by_states[0] * x[j] + push->by_states[1] * v[j];
        if (j > 2)
            pushed += of_x[j - 3];
        v[j] += weight * pushed;
    }
    v[0] += weight * push->force[0];
}

/* Give the velocities in the columns of out the impulse weight times the effects' forces, sensitivities alike; kept, of
   out's shape (states, stride), is scratch.  columns is 1 or stride.

   A force that depends on the velocity changes during the impulse: it is taken from its middle.  There the velocities are
   v + weight f/2, so that with f' = df/dv the derivatives of the whole are those in the middle, and weight f'/2 times
   those at the start. */
static inline void kick(const Settings *settings, const real *c, real weight, whole columns, whole stride, real *kept,
                        real *out, Push *push)
{
    whole states = settings->states, axes = settings->axes;
    real s[4] = {R(0.0)}, half = R(0.5) * weight;
    for (whole i = 0; i < states; i++)
        s[i] = out[i * stride];
    effect_forces(settings, c, s, push);
    int moves = by_velocity(settings, push->by_states);
    if (moves) {
        for (whole axis = 0; axis < axes; axis++) {
            if (columns > 1)
                keep(settings, push, axis, columns, kept + axis * columns);
            s[2 * axis + 1] += half * push->force[axis];
        }
        effect_forces(settings, c, s, push);
        if (columns > 1)
            join(settings, half, columns, kept, push);
    }
    if (columns > 1 && settings->slip_count > 0)
        push_slips(settings, weight, moves, columns, out, push);
    if (columns == 1)
        for (whole axis = 0; axis < axes; axis++)
            out[(2 * axis + 1) * stride] += weight * push->force[axis];
    else if (states == 4)
        push_two(settings, weight, columns, out, push);
    else
        push_one(settings, weight, columns, out, push);
}

#endif
