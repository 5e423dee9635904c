/* Mode reversal: drive and sense axes exchanged on a schedule, and the bias from what the exchange changes.

   What a damping that couples the axes, or a quadrature seen through a wrong phase, adds to the rate has the opposite
   sign a quarter of a turn on. */

#ifndef CLASSIC_REVERSAL_H
#define CLASSIC_REVERSAL_H

#include "loops.h"

typedef struct {
    double begun_s, duration_s; /* of the present stay; of the turn before it */
    int64_t exchanges;
    double sum, bias;
    int64_t samples;
    double means[3]; /* of the rate, newest first */
    bool settled;    /* the rate is read, and not held over an exchange */
} reversal;

/* Until the slowest of the loops has forgotten an exchange. */
static double settling_s(const loops *own)
{
    return 12.0 / fmin(own->rate.corner, fmin(own->quadrature.corner, own->frequency.corner));
}

/* A turn that takes a quarter of the drive's limit at most, and is slow beside the loops. */
static double turn_duration_s(const loops *own)
{
    double most = 0.25 * own->limit / (2.0 * own->omega * own->device.amplitude_m);
    return fmax(HALF_TURN / most, settling_s(own));
}

/* The bias as seen from the newest stay: the mean of one axis less that of the other, drifts of the rate taken off. */
static void settle_bias(reversal *exchange)
{
    double *m = exchange->means, side = exchange->exchanges % 2 ? -1.0 : 1.0;
    m[2] = m[1];
    m[1] = m[0];
    m[0] = exchange->sum / (double)exchange->samples;
    if (exchange->exchanges >= 2)
        exchange->bias = 0.25 * side * (m[0] - 2.0 * m[1] + m[2]);
    else if (exchange->exchanges == 1)
        exchange->bias = 0.5 * side * (m[0] - m[1]);
}

/* Turn the frame as the schedule has it at `time_s` of running. */
static void exchange_axes(loops *own, reversal *exchange, double time_s)
{
    double since = time_s - exchange->begun_s, whole = exchange->duration_s;
    if (since >= own->given.exchange_s) {
        if (exchange->samples > 0)
            settle_bias(exchange);
        exchange->begun_s = time_s;
        exchange->duration_s = whole = turn_duration_s(own);
        exchange->exchanges++;
        exchange->sum = 0.0;
        exchange->samples = 0;
        since = 0.0;
    }
    double part = whole > 0.0 ? fmin((since + own->step_s) / whole, 1.0) : 1.0;
    double turned = part - sin(2.0 * HALF_TURN * part) / (2.0 * HALF_TURN);
    double place = exchange->exchanges % 2 ? turned : exchange->exchanges ? 1.0 - turned : 0.0;
    own->turning = (0.5 * HALF_TURN * place - own->frame) / own->step_s;
    exchange->settled = exchange->exchanges == 0 || since > whole + settling_s(own);
    if (exchange->settled) {
        exchange->sum += own->force_rate;
        exchange->samples++;
    }
}

#endif
