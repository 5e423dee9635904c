/* Trim electrodes: known voltages that soften the stiffness by their square. */
#ifndef GYRO_TRIMS_H
#define GYRO_TRIMS_H

#include "structs.h"

/* Voltage h after now. */
static inline real electrode_after(const Trims *trims, whole k, real h)
{
    real rest = trims->settling[k] > R(0.0) ? EXP(-h / trims->settling[k]) : R(0.0);
    return trims->target[k] + (trims->volts[k] - trims->target[k]) * rest;
}

/* The same, which advances by it; the voltage in its middle, whose square is kept. */
static inline real follow_electrode(Trims *trims, whole k, real h)
{
    real middle = electrode_after(trims, k, R(0.5) * h);
    trims->volts[k] = electrode_after(trims, k, h);
    trims->squared[k] = middle * middle;
    return middle;
}

/* Before an interval of length h is predicted: the stiffness becomes what the voltage in its middle makes of it, with
   the initial value (k,) that forgetting draws it to, and less certain by the coefficient's own uncertainty. */
static inline void follow_trims(const Observer *observer, real h)
{
    const Settings *settings = observer->settings;
    Trims *trims = observer->trims;
    for (whole k = 0; k < trims->count; k++) {
        real before = trims->squared[k];
        follow_electrode(trims, k, h);
        real now = trims->squared[k];
        if (now == before)
            continue;
        for (whole i = 0; i < 3; i++) {
            real softer = trims->softening[k][i] * (now - before);
            observer->x[settings->states + KXX + i] -= softer;
            if (trims->rows[i] < 0)
                continue;
            observer->initial[trims->rows[i] - settings->states] -= softer;
            whole at = trims->rows[i] * (observer->width + 1);
            real more = trims->variance[k][i] * FABS(now * now - before * before);
            observer->p[at] += more;
            if (observer->c != observer->p)
                observer->c[at] += more;
        }
    }
}

#endif
