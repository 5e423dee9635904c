/* The observer's own model in closed loop with itself: what an experiment's record would look like. */
#ifndef GYRO_EXPERIMENT_H
#define GYRO_EXPERIMENT_H

#include "estimator.h"

#define MOST_LATE 63

/* n samples of the loop: truth moves under the drive that the observer asks for. */
typedef struct {
    whole n;
    Settings *settings;    /* the observer's, whose target changes */
    const real *rates;     /* (n,) rotation rate at each sample */
    const real *stiffness; /* (n,) the controller's target */
    const real *noise;     /* (n, 2) added to what is sensed */
    real *truth;           /* (states + constants,), moved along */
    real *sensed;          /* (n, 2) the record */
    real *drive;           /* (n, 2), acting over the interval that ends at each sample */
    real late;             /* samples by which the drive acts later than that, 0 to MOST_LATE */
} Experiment;

/* The device over a sample, or over a part of one: Euler's term of a rate that jumps, and the flow under u. */
static inline void experiment_device(const Settings *settings, real rate, real h, const real *u,
                                     real (*past)[MAX_AXES][MAX_DEGREE], real *truth, FlowWork *work)
{
    real *s = truth, *constants = truth + settings->states;
    real change = rate - constants[RATE];
    constants[RATE] = rate;
    s[1] += change * s[2];
    s[3] -= change * s[0];
    Interval interval = {R(0.0), h, u, 1};
    flow(settings, &interval, past, constants, s, 1, work);
    for (whole i = 0; i < settings->states; i++)
        s[i] = work->out[i * work->columns];
}

EXPORTED void gyro_experiment_block(Estimator *estimator, const Experiment *plan)
{
    Settings *settings = plan->settings;
    whole states = settings->states;
    const Memory *memory = estimator->observer.memory;
    real acted[MOST_LATE + 2][2] = {{R(0.0), R(0.0)}}; /* newest first */
    double codes[2];
    whole back = (whole)FLOOR(plan->late);
    real part = (plan->late - (real)back) * settings->h; /* of a sample, while the drive before still acts */
    real past[MAX_DELAY + 1][MAX_AXES][MAX_DEGREE];
    workspace_begin(&estimator->work, settings, estimator->observer.n);
    memcpy(past, estimator->observer.memory->past, sizeof past);
    for (whole m = 0; m < plan->n; m++) {
        const real u[2] = {memory->queue[0][0], memory->queue[0][1]};
        real *sensed = plan->sensed + 2 * m, *drive = plan->drive + 2 * m;
        memmove(acted[1], acted[0], (MOST_LATE + 1) * sizeof *acted);
        memcpy(acted[0], u, sizeof u);
        if (part > R(0.0))
            experiment_device(settings, plan->rates[m], part, acted[back + 1], past, plan->truth, &estimator->work.flow);
        experiment_device(settings, plan->rates[m], settings->h - part, acted[back], past, plan->truth,
                          &estimator->work.flow);
        for (whole axis = 0; axis < 2; axis++) {
            whole shown = 2 * axis + settings->sensed[axis];
            sensed[axis] = plan->truth[shown] + plan->truth[states + axis] + plan->noise[2 * m + axis];
            drive[axis] = u[axis];
        }
        settings->stiffness = plan->stiffness[m];
        estimator_step(estimator, sensed[0] / settings->sense_scale[0], sensed[1] / settings->sense_scale[1],
                       u[0] / settings->quantum, u[1] / settings->quantum, codes);
    }
}

#endif
