/* A whole record run freely: the flow from sample to sample with no correction, and what every unknown does to it. */
#ifndef GYRO_SIMULATION_H
#define GYRO_SIMULATION_H

#include "estimator.h"
#include "flow.h"
#include "sensing.h"
#include "signals.h"

/* From x = [state at the first sample, constants] under u over the steps h.

   Each step is taken in `parts` equal parts: the flow's impulses are exact in the limit of many.  The columns of the flow
   are carried from step to step as they are: they begin as the derivatives by the first state. */
typedef struct {
    whole n;
    whole terms;       /* of the drive's polynomial in each step */
    whole parts;
    whole sensitive;   /* 1: the sensitivity is wanted */
    whole order;       /* of the Taylor flow */
    whole total;       /* states and constants */
    const real *x;     /* (total,) */
    const real *u;     /* (n, axes, terms) */
    const real *h;     /* (n,) */
    real *sensed;      /* (n, axes) */
    real *sensitivity; /* (n, axes, total), the derivative by x */
    real *full;        /* (2, total), scratch */
    real time;         /* of the first sample */
} FreeRun;

/* Derivatives (total,) by x of what an axis senses, from those by the state there and by the constants. */
static inline void chain(const Settings *settings, const real *full, whole total, const FlowWork *work, real *out)
{
    whole states = settings->states, columns = work->columns;
    for (whole j = 0; j < total; j++) {
        real value = j >= states ? full[j] : R(0.0);
        whole column = j < states ? 1 + j : 1 + j - settings->sense_constants;
        if (j < states || j >= states + settings->sense_constants)
            for (whole k = 0; k < states; k++)
                value += full[k] * work->out[k * columns + column];
        out[j] = value;
    }
}

/* Over step m, in its parts. */
static inline void free_step(const Settings *settings, const FreeRun *run, whole m, real *time, FlowWork *work)
{
    whole axes = settings->axes, columns = run->sensitive ? work->columns : 1;
    const real *u = run->u + m * axes * run->terms;
    real piece[MAX_AXES * MAX_DEGREE], h = run->h[m] / (real)run->parts;
    for (whole part = 0; part < run->parts; part++) {
        part_of(u, axes, run->terms, (real)part / (real)run->parts, R(1.0) / (real)run->parts, piece);
        Interval interval = {*time, h, run->parts == 1 ? u : piece, run->terms};
        advance(settings, &interval, run->x + settings->states, columns, work);
        *time += h;
    }
}

EXPORTED void gyro_free_run(Estimator *estimator, const FreeRun *run)
{
    Settings of_its_order = *estimator->observer.settings;
    of_its_order.order = run->order;
    workspace_begin(&estimator->work, &of_its_order, estimator->observer.n);
    const Settings *settings = &of_its_order;
    FlowWork *work = &estimator->work.flow;
    whole states = settings->states, axes = settings->axes, total = run->total, columns = work->columns;
    const real *c = run->x + states;
    Push *push = &work->push;
    real s[4], predicted[MAX_AXES], time = run->time;
    for (whole i = 0; i < settings->signal_count; i++)
        push->signals[i] = settings->signal_parameters[i][0]; /* what is no constant is written over as it moves */
    for (whole i = 0; i < states; i++) {
        s[i] = run->x[i];
        work->out[i * columns] = s[i];
        if (run->sensitive)
            work->out[i * columns + 1 + i] = R(1.0);
    }
    begin_ways(settings, c, s, run->sensitive ? columns : 1, push);
    for (whole m = 0; m < run->n; m++) {
        if (m > 0)
            free_step(settings, run, m, &time, work);
        for (whole i = 0; i < states; i++)
            s[i] = work->out[i * columns];
        drive_at(run->u + m * axes * run->terms, axes, run->terms, R(1.0), push->drive);
        line_values(settings, settings->signal_count, time, push->signals);
        sensed_at(settings, c, s, push, total, predicted, run->full);
        for (whole axis = 0; axis < axes; axis++) {
            run->sensed[m * axes + axis] = predicted[axis];
            if (run->sensitive)
                chain(settings, run->full + axis * total, total, work, run->sensitivity + (m * axes + axis) * total);
        }
    }
}

#endif
