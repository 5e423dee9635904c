/* The control law (9) and what it needs to work through a sampled, delayed drive.

   The force computed from sample m acts over the interval that begins at m + latency.  The state is predicted exactly
   through the drives already queued, then half a sample ahead with the *target* flow (target stiffness, estimated and
   virtual rotation), because a held force acts on average in the middle of its interval; and all of it is divided by
   what the hold leaves of a sinusoid. */
#ifndef GYRO_CONTROLLER_H
#define GYRO_CONTROLLER_H

#include "flow.h"
#include "layout.h"
#include "observer.h"
#include "pattern.h"
#include "signals.h"
#include "structs.h"
#include "taylor.h"

#define INVERSIONS 5

/* value, no less than low and no more than high; NaN stays NaN. */
static inline real within(real value, real low, real high)
{
    real most = low > value ? low : value;
    return high < most ? high : most;
}

/* Next value of a two-level pseudo-random force, +- amplitude (xorshift64). */
static inline real dither_force(Memory *memory, real amplitude)
{
    uint64_t state = memory->dither;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    memory->dither = state;
    return state & (UINT64_C(1) << 32) ? amplitude : -amplitude;
}

/* Virtual rotation asked for in the interval that begins at `time`.

   With reversals it begins halfway between two of them, so that the pattern goes as far to one side as to the other. */
static inline real virtual_rate(const Settings *settings, double time)
{
    real rate = settings->virtual_rate;
    if (settings->reversal > R(0.0)) {
        /* Half a sample on: which side of a reversal a sample is on must not hang on the rounding of a sum. */
        double turn = floor((time + 0.5 * (double)settings->h) / (double)settings->reversal + 0.5);
        if (turn - 2.0 * floor(0.5 * turn) > 0.5)
            return -rate;
    }
    return rate;
}

/* Virtual rotation of the drive computed from the newest sample, which acts `latency` samples on. */
static inline real acting(const Settings *settings, const Memory *memory)
{
    return virtual_rate(settings, memory->time + (double)((real)settings->latency * settings->h));
}

/* Damping along the velocity, and force across the position, per unit of either, for state s at rotation w, neither
   acting faster than `fastest`. */
static inline void holds(const Settings *settings, const Memory *memory, const real *s, real rate, real w,
                         real fastest, real *hold, real *square)
{
    real k = settings->stiffness;
    real root = SQRT(k);
    Pattern now = pattern(s, k, w, rate);
    real swing = R(1.0) + settings->modulation * (real)sin((double)settings->modulation_rate * memory->time);
    real target = settings->energy * (swing * swing);
    /* Amplitude: damping along the velocity, never more than twice the gain however large the error (start from
       rest). */
    real error = within((target - now.energy) / settings->energy, R(-2.0), R(2.0));
    real along_it = settings->energy_gain * root;
    *hold = (fastest < along_it ? fastest : along_it) * error;
    /* Quadrature: a force across the position turns the ellipse back into a line without precession to first order. */
    real least = R(1e-3) * target;
    real ratio = within(root * now.momentum / (least > now.energy ? least : now.energy), R(-1.0), R(1.0));
    real across_it = settings->quadrature_gain * root;
    *square = -(fastest < across_it ? fastest : across_it) * root * ratio;
}

/* out (2,) <- (9) plus energy hold, quadrature hold and virtual rotation, for state s and constants c.

   (9) prints positions where its damping terms need velocities; implemented with velocities. */
static inline void control_law(const Settings *settings, const Memory *memory, const real *s, const real *c, real *out)
{
    real x = s[0], vx = s[1], y = s[2], vy = s[3];
    real k = settings->stiffness;
    real rotation = acting(settings, memory);
    real w = c[RATE] + rotation;
    real hold, square;
    holds(settings, memory, s, c[RATE], w, (real)INFINITY, &hold, &square);
    out[0] = c[DXX] * vx + c[DXY] * vy + c[KXX] * x + c[KXY] * y - k * x + hold * (vx - w * y) - square * y +
             R(2.0) * rotation * vy;
    out[1] = c[DXY] * vx + c[DYY] * vy + c[KXY] * x + c[KYY] * y - k * y + hold * (vy + w * x) + square * x -
             R(2.0) * rotation * vx;
}

/* Change the force so that with the effects' own it is what it was: what depends on the state is cancelled, what
   depends on the drive (its gain, its misalignment) inverted by iteration, which converges as the gain error's powers,
   on a drive that acts the wrong way round as those of what it is beside -1. */
static inline void undo_effects(const Settings *settings, const real *c, const real *s, Push *push, real *force)
{
    const real sides[2] = {R(1.0), R(-1.0)};
    real wanted[2] = {force[0], force[1]};
    real slope[2] = {R(0.0), R(0.0)}; /* of what acts on an axis by its drive, times two */
    for (int i = 0; i < 2; i++) {
        push->drive[0] = sides[i];
        push->drive[1] = sides[i];
        effect_forces(settings, c, s, push);
        for (int axis = 0; axis < 2; axis++)
            slope[axis] += R(1.0) + sides[i] * push->force[axis];
    }
    for (int round = 0; round < INVERSIONS; round++) {
        push->drive[0] = force[0];
        push->drive[1] = force[1];
        effect_forces(settings, c, s, push);
        for (int axis = 0; axis < 2; axis++) {
            if (slope[axis] < R(0.0))
                force[axis] += force[axis] + push->force[axis] - wanted[axis];
            else
                force[axis] = wanted[axis] - push->force[axis];
        }
    }
}

/* Force (2,) wanted from a drive that begins to be held where the state is s, and acts `ahead` later on average; c
   (all constants), of which as many as the model has are the target's. */
static inline void steer(const Settings *settings, const Memory *memory, const real *s, const real *c, real ahead,
                         FlowWork *work, real *force)
{
    static const real no_drive[2] = {R(0.0), R(0.0)};
    real target[BASE_CONSTANTS], there[4];
    for (int i = 0; i < BASE_CONSTANTS; i++)
        target[i] = c[i];
    target[RATE] = c[RATE] + acting(settings, memory);
    target[KXX] = settings->stiffness;
    target[KYY] = settings->stiffness;
    target[KXY] = R(0.0);
    target[DXX] = R(0.0);
    target[DYY] = R(0.0);
    target[DXY] = R(0.0);
    for (int i = 0; i < 4; i++)
        there[i] = s[i];
    taylor(settings->model, target, no_drive, 1, ahead, settings->order, 1, work->term, there, 1);
    control_law(settings, memory, there, c, force);
    if (settings->pushes > 0)
        undo_effects(settings, c, there, &work->push, force);
}

/* Force (2,) that the newest estimate asks for, through the drives that are queued; a drive that is late by more than
   was declared is asked for that much earlier. */
static inline void wanted_force(const Settings *settings, const Memory *memory, const real *x, Workspace *work,
                                real *force)
{
    FlowWork *moved = &work->flow;
    whole latency = settings->latency, columns = moved->columns;
    const real *c = x + settings->states;
    real s[4] = {x[0], x[1], x[2], x[3]};
    real h = settings->h;
    int late = settings->drive_delay >= 0;
    real past[MAX_DELAY + 1][MAX_AXES][MAX_DEGREE];
    if (late)
        memcpy(past, memory->past, sizeof past);
    signal_values(settings, memory, memory->time, moved->push.signals);
    for (whole j = 0; j < latency; j++) {
        real u[2] = {memory->queue[j][0], memory->queue[j][1]};
        Interval interval = {memory->time + (double)((real)j * h), h, u, 1};
        flow(settings, &interval, past, c, s, 1, moved);
        for (int i = 0; i < 4; i++)
            s[i] = moved->out[i * columns];
        if (late)
            shift_drives(past, u, 2, 1);
    }
    line_values(settings, settings->carried_signals, memory->time + (double)(((real)latency + R(0.5)) * h), moved->push.signals);
    if (!late) {
        steer(settings, memory, s, c, R(0.5) * h, moved, force);
        return;
    }
    for (int axis = 0; axis < 2; axis++) {
        real of_axis[2];
        steer(settings, memory, s, c, R(0.5) * h + c[settings->drive_delay + axis], moved, of_axis);
        force[axis] = of_axis[axis];
    }
}

/* Drive codes out (2,) for the interval `latency` samples ahead, and their place in the queue.

   x is the state vector after the update with the newest sample.  The queue holds what was commanded for the intervals
   that begin at this sample and later. */
static inline void command(const Settings *settings, Memory *memory, const real *x, Workspace *work, double *out)
{
    real force[2] = {R(0.0), R(0.0)}, rotation = R(0.0);
    whole latency = settings->latency;
    if (settings->control == 1) {
        wanted_force(settings, memory, x, work, force);
        rotation = acting(settings, memory);
    }
    for (int axis = 0; axis < 2; axis++) {
        real value = force[axis] / settings->hold;
        if (settings->control == 1 && settings->dither > R(0.0))
            value += dither_force(memory, settings->dither);
        if (!isfinite(value))
            value = R(0.0);
        value = within(value, -settings->force_limit, settings->force_limit);
        real code = RINT(value / settings->quantum);
        out[axis] = (double)code;
        memory->queue[latency][axis] = code * settings->quantum;
    }
    memory->queue[latency][2] = rotation;
}

/* Drop the command whose interval has ended and note which virtual rotation the board really applied.

   u (2,) is the echoed drive.  A zero echo where something was commanded is a board in SAFE; anything else that differs
   is a drive held over a late answer, whose virtual rotation stays what it was. */
static inline void advance_queue(const Settings *settings, Memory *memory, const real *u)
{
    real near = R(0.5) * settings->quantum;
    if (FABS(u[0] - memory->queue[0][0]) < near && FABS(u[1] - memory->queue[0][1]) < near)
        memory->virtual_applied = memory->queue[0][2];
    else if (u[0] == R(0.0) && u[1] == R(0.0))
        memory->virtual_applied = R(0.0);
    for (whole j = 0; j < settings->latency; j++)
        for (int i = 0; i < 3; i++)
            memory->queue[j][i] = memory->queue[j + 1][i];
}

#endif
