/* A proportional and integral filter, designed from the bandwidth and phase margin of the open loop. */

#ifndef CLASSIC_LOOP_FILTER_H
#define CLASSIC_LOOP_FILTER_H

#include <math.h>
#include <stdbool.h>

#define HALF_TURN 3.14159265358979323846

/* gain (error + corner * integral of the error). */
typedef struct {
    double gain, corner; /* rad/s, both */
    double integral;     /* times gain and corner */
} loop_filter;

/* What stands in the loop beside the filter: 1/(s + pole), the demodulator's low-pass and a delay. */
typedef struct {
    double pole, low_pass; /* rad/s */
    double delay_s;
} loop_plant;

/* The filter by which the loop's gain is 1 at `crossover`, rad/s, with `margin`, rad, of phase left there; whether
   there is one. */
static bool design(loop_filter *filter, double crossover, double margin, const loop_plant *plant)
{
    double lag = atan2(crossover, plant->pole) + atan(crossover / plant->low_pass) + crossover * plant->delay_s;
    double lead = margin + lag - 0.5 * HALF_TURN; /* that the filter's zero has to give */
    if (!(lead > 0.02 && lead < 0.5 * HALF_TURN - 0.02))
        return false;
    filter->corner = crossover / tan(lead);
    filter->gain = hypot(crossover, plant->pole) * hypot(1.0, crossover / plant->low_pass) * sin(lead);
    filter->integral = 0.0;
    return true;
}

/* What the filter asks for. Held: what it drives is at its limit, so that the integral may only shrink. */
static double filtered(loop_filter *filter, double error, double step_s, bool held)
{
    double more = filter->gain * filter->corner * error * step_s;
    if (!held || filter->integral * more < 0.0)
        filter->integral += more;
    return filter->gain * error + filter->integral;
}

#endif
