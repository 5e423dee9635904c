/* The start from rest: search, ring-up, lock, null, run, each with a limit and a figure. */

#ifndef CLASSIC_PHASES_H
#define CLASSIC_PHASES_H

#include <stdio.h>

#include "loops.h"

#define KICK_CYCLES 50.0  /* of which the spectrum reaches +-1 % */
#define KICK_AMPLITUDE 0.3 /* of the nominal, that it is to leave at most */
#define STRIDE_CYCLES 10.0
#define STRIDES 8
#define LOCKED_RAD 0.01
#define NULLED 0.01 /* of the amplitude */

enum { SEARCH, RING_UP, LOCK, NULLING, RUN, PHASES };

static const char *const phase_names[PHASES] = {"search", "ring_up", "lock", "null", "run"};

typedef struct {
    int64_t phase, samples, stride; /* since the phase, or the newest kick, began; strides listened to */
    double took_s[PHASES], limit_s[PHASES];
    double figure[PHASES]; /* Hz, of the amplitude, rad, of the amplitude */
    double spent_s;
    double mean;           /* of what the phase waits for */
    double complex before, sum;
    char why[160];
} start;

static void begin_phase(start *now, int64_t phase)
{
    now->phase = phase;
    now->samples = now->stride = 0;
    now->spent_s = 0.0;
    now->mean = 1.0;
    now->sum = 0.0;
}

/* Limits where none is given: some times what a device as declared needs. */
static void set_limits(start *now, const loops *own)
{
    const options *given = &own->given;
    double cycle_s = 2.0 * HALF_TURN / own->nominal, slowest = fmin(own->rate.gain, own->quadrature.gain);
    double growth = 4.0 * own->nominal * own->device.amplitude_m / own->limit;
    const double usual[RUN] = {1000.0 * cycle_s, 5.0 * growth + 60.0 / own->amplitude.gain,
                               100.0 / own->frequency.gain, 200.0 / slowest};
    const double asked[RUN] = {given->search_s, given->ring_up_s, given->lock_s, given->null_s};
    for (int k = 0; k < RUN; k++)
        now->limit_s[k] = asked[k] > 0.0 ? asked[k] : usual[k];
}

/* A kick at the declared frequency, then the frequency at which the mass rings; whether that is known. */
static bool searched(start *now, loops *own, gyro_plugin_drive *drive)
{
    double rate = 0.5 * own->limit / (2.0 * own->omega), cycle_s = 2.0 * HALF_TURN / own->nominal;
    double kick_s = fmin(KICK_AMPLITUDE * own->device.amplitude_m / rate, KICK_CYCLES * cycle_s);
    double time_s = (double)now->samples++ * own->step_s - kick_s;
    if (time_s < 0.0) {
        own->error_rad = 0.0;
        push(own, rate, 0.0, drive);
        return false;
    }
    double listen_s = time_s - FASTER / (own->share / own->step_s) - 2.0 * cycle_s;
    if (listen_s < (double)now->stride * STRIDE_CYCLES * cycle_s)
        return false;
    double complex here = own->channels[0].parts;
    if (now->stride++ > 0)
        now->sum += here * conj(now->before);
    now->before = here;
    if (now->stride <= STRIDES)
        return false;
    double noise = 2.0 * own->share * own->device.noise_V * own->device.noise_V;
    if (cabs(now->sum) < 25.0 * STRIDES * noise) { /* it did not ring: once more */
        now->samples = now->stride = 0;
        now->sum = 0.0;
        return false;
    }
    own->frequency.integral = -carg(now->sum) / (STRIDE_CYCLES * cycle_s);
    double complex turned = cexp(-I * carg(here));
    own->phase -= carg(here);
    own->channels[0].parts *= turned;
    own->channels[1].parts *= turned;
    own->omega = own->nominal + own->frequency.integral;
    now->figure[SEARCH] = own->omega / (2.0 * HALF_TURN);
    return true;
}

/* Whether the mean of `value` over `time_s` is below `least`; and no shorter. */
static bool settled(start *now, double value, double least, double time_s, double step_s)
{
    now->mean += (value - now->mean) * fmin(3.0 * step_s / time_s, 1.0);
    return now->spent_s > time_s && now->mean < least;
}

/* One sample of the start: the drive, and the next phase where this one has what it waits for. */
static void start_up(start *now, loops *own, gyro_plugin_drive *drive)
{
    double set = own->device.amplitude_m, a = creal(own->along), ts = own->step_s;
    double quiet = 3.0 * sqrt(2.0 * own->share) * own->device.noise_V / fabs(own->device.sense_gain_V_per_m[0]) / set;
    int64_t phase = now->phase;
    bool done = false;
    now->spent_s += ts;
    now->took_s[phase] += ts;
    if (phase == SEARCH)
        done = searched(now, own, drive);
    else
        drive_by_loops(own, false, 0.0, drive);
    if (phase == RING_UP) {
        now->figure[phase] = a / set;
        done = a > 0.95 * set;
    } else if (phase == LOCK) {
        done = settled(now, fabs(own->error_rad) + fmax(fabs(a / set - 1.0) - 0.02, 0.0), fmax(LOCKED_RAD, quiet),
                       10.0 / own->frequency.gain, ts);
        now->figure[phase] = fabs(own->error_rad);
    } else if (phase == NULLING) {
        done = settled(now, cabs(own->across) / set, fmax(NULLED, quiet),
                       10.0 / fmin(own->rate.gain, own->quadrature.gain), ts);
        now->figure[phase] = cabs(own->across) / set;
    }
    if (done) {
        begin_phase(now, phase + 1);
    } else if (now->spent_s > now->limit_s[phase]) {
        static const char *const reached[RUN] = {"no resonance within 1 %% of %.6g Hz rings",
                                                 "the amplitude reached %.3g of its set point",
                                                 "the phase is off by %.3g rad",
                                                 "motion across the drive is %.3g of the amplitude"};
        char words[96];
        snprintf(words, sizeof words, reached[phase],
                 phase == SEARCH ? own->nominal / (2.0 * HALF_TURN) : now->figure[phase]);
        snprintf(now->why, sizeof now->why, "%s took longer than its limit of %.3g s: %s", phase_names[phase],
                 now->limit_s[phase], words);
    }
}

#endif
