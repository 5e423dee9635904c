/* The loops that vibrating gyroscopes are run with: a phase-locked loop (PLL), amplitude, quadrature and rate, each from
   demodulated signals, in a frame that is turned by `frame` against the axes of the device (Lynch, 1995).

   Along the frame's first axis the mass is driven; across it the rate is felt. Force to rebalance holds the frame still
   and the motion across it at zero by a force; whole angle lets the frame follow the motion; mode reversal turns the
   frame by a quarter and back. */

#ifndef CLASSIC_LOOPS_H
#define CLASSIC_LOOPS_H

#include <stdbool.h>
#include <stdint.h>

#include "demodulator.h"
#include "../../native/gyro_plugin.h"
#include "loop_filter.h"
#include "probe.h"

#define FASTER 5.0 /* bandwidth of the demodulators over that of the fastest loop */

enum { FORCE_TO_REBALANCE = 1, MODE_REVERSAL, WHOLE_ANGLE };
enum { LOOP_AMPLITUDE = 1, LOOP_PHASE, LOOP_RATE, LOOP_QUADRATURE };

/* From [controller.loops], in the order of `option_names`, [loop] settle_s, behind which the angle counts, and how well
   each of the declared dampings is known, 1/s. */
typedef struct {
    double mode, amplitude_Hz, phase_Hz, rate_Hz, quadrature_Hz, phase_margin_deg, exchange_s;
    double search_s, ring_up_s, lock_s, null_s, probe_loop, probe_Hz, probe_size, settle_s, damping_sd;
} options;

typedef struct {
    gyro_plugin_device device;
    options given;
    double step_s, share, nominal, limit; /* demodulator's share of a sample; rad/s; m/s2 */
    loop_filter amplitude, frequency, rate, quadrature;
    loop_probe probe;

    channel channels[2];
    double phase, omega;  /* of the locked oscillator; rad/s */
    double frame, turning; /* rad, rad/s */
    double complex coupled;       /* integral of the quadrature loop in the device's axes, m/s at the set amplitude */
    double complex along, across; /* m, in the frame, against the phase of the motion along it */
    double error_rad;     /* of the phase */
    double noise_V2;      /* mean square of what the demodulators leave */
    double force_rate;    /* rad/s, of the force across that answers the rate */
    double quadrature_rate;
    bool limited;         /* the newest drive is at the limit */
} loops;

/* A loop's plant: the mode's own decay, the demodulators, and the way of the drive. */
static bool design_all(loops *own)
{
    const options *given = &own->given;
    const gyro_plugin_device *device = &own->device;
    double widths[4] = {given->amplitude_Hz, given->phase_Hz, given->rate_Hz, given->quadrature_Hz}, widest = 0.0;
    loop_filter *filters[4] = {&own->amplitude, &own->frequency, &own->rate, &own->quadrature};
    for (int k = 0; k < 4; k++) {
        if (!(widths[k] > 0.0))
            widths[k] = own->nominal / (2.0 * HALF_TURN) / 50.0;
        widths[k] *= 2.0 * HALF_TURN;
        widest = fmax(widest, widths[k]);
    }
    double decay = 0.25 * (device->damping_per_s[0] + device->damping_per_s[1]);
    double low_pass = FASTER * widest, margin = given->phase_margin_deg / 180.0 * HALF_TURN;
    own->share = 1.0 - exp(-low_pass * own->step_s);
    for (int k = 0; k < 4; k++) {
        int by_force = k != 1 && !(k == 2 && (int)given->mode == WHOLE_ANGLE);
        loop_plant plant = {by_force ? decay : 0.0, low_pass, (by_force ? device->latency + 1.0 : 1.0) * own->step_s};
        if (!design(filters[k], widths[k], margin, &plant))
            return false;
    }
    return low_pass < 0.5 * own->nominal;
}

/* One sample into components, frame and phase. */
static void sense(loops *own, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    own->phase = remainder(own->phase + own->omega * own->step_s, 2.0 * HALF_TURN);
    double cosine = cos(own->phase), sine = sin(own->phase);
    /* What the motion is known to turn by: without it the components would lag. */
    double turn = own->turning * own->step_s, unit[2] = {own->device.sense_gain_V_per_m[0], own->device.sense_gain_V_per_m[1]};
    if (turn != 0.0) {
        double complex x = own->channels[0].parts / unit[0], y = own->channels[1].parts / unit[1];
        own->channels[0].parts = unit[0] * (x - turn * y);
        own->channels[1].parts = unit[1] * (y + turn * x);
    }
    double complex at[2];
    for (int axis = 0; axis < 2; axis++) {
        channel *now = &own->channels[axis];
        if (!sample->lost) {
            double left = demodulate(now, sample->sense_V[axis], cosine, sine, own->share);
            estimate->innovation_V[axis] = left;
            own->noise_V2 += 0.5 * (left * left - own->noise_V2) * 0.01 * own->share;
        }
        at[axis] = now->parts / unit[axis];
    }
    own->frame += own->turning * own->step_s;
    double complex first = cos(own->frame) * at[0] + sin(own->frame) * at[1];
    double complex second = cos(own->frame) * at[1] - sin(own->frame) * at[0];
    own->error_rad = cabs(first) > 0.0 ? carg(first) : 0.0;
    own->along = cabs(first);
    own->across = second * cexp(-I * own->error_rad);
}

/* Stiffness along the frame, as the device is declared, 1/s2. */
static double declared_along(const loops *own)
{
    const double *k = own->device.stiffness_per_s2;
    double c = cos(own->frame), s = sin(own->frame);
    return k[0] * c * c + k[1] * s * s + 2.0 * k[2] * c * s;
}

/* Offset, rad/s, of the resonance across the frame from that along it, likewise. */
static double declared_offset(const loops *own)
{
    const double *k = own->device.stiffness_per_s2;
    return 0.5 * (k[0] + k[1] - 2.0 * declared_along(own)) / own->omega;
}

/* Keep the oscillator at the phase of the motion; within `reach` of the nominal frequency. */
static void lock_phase(loops *own, double reach)
{
    double most = reach * own->nominal;
    bool held = fabs(own->frequency.integral) > most;
    double asked = filtered(&own->frequency, -own->error_rad, own->step_s, held);
    asked = probed(&own->probe, LOOP_PHASE, asked, own->nominal);
    own->omega = sqrt(declared_along(own)) + fmax(-2.0 * most, fmin(2.0 * most, asked));
}

/* Let the frame follow the motion, which is known to turn by what is imposed. */
static void follow_pattern(loops *own, double imposed)
{
    double off = creal(own->across) / fmax(creal(own->along), 0.1 * own->device.amplitude_m);
    double asked = filtered(&own->rate, off, own->step_s, false);
    own->turning = probed(&own->probe, LOOP_RATE, asked, own->nominal) - imposed;
}

/* What the quadrature loop asks for, m/s: its integral is of a stiffness that couples the axes of the device, so that it
   stays what it is while the frame turns, and grows with the motion. */
static double null_quadrature(loops *own, double error, bool held)
{
    double complex frame = cexp(2.0 * I * own->frame);
    double more = own->quadrature.gain * own->quadrature.corner * error * own->step_s;
    if (!held || creal(own->coupled * conj(frame)) * more < 0.0)
        own->coupled += more * frame;
    double part = fmin(creal(own->along) / own->device.amplitude_m, 2.0);
    return own->quadrature.gain * error + part * creal(own->coupled * conj(frame));
}

/* Rates of the components, m/s, to forces on the axes at the middle of the interval in which they act. */
static void push(loops *own, double complex along, double complex across, gyro_plugin_drive *drive)
{
    double half = 0.5 * own->omega * own->step_s;
    double ahead = own->phase + own->omega * own->step_s * (own->device.latency + 0.5) - own->error_rad;
    double complex per_rate = -2.0 * I * own->omega * half / sin(half); /* the hold leaves sin(half)/half */
    double complex forces[2] = {per_rate * (cos(own->frame) * along - sin(own->frame) * across),
                                per_rate * (cos(own->frame) * across + sin(own->frame) * along)};
    double largest = fmax(cabs(forces[0]), cabs(forces[1])), part = 1.0;
    if (largest > own->limit)
        part = own->limit / largest;
    own->limited = part < 1.0;
    for (int axis = 0; axis < 2; axis++)
        drive->force_mps2[axis] = part * (creal(forces[axis]) * cos(ahead) + cimag(forces[axis]) * sin(ahead));
}

/* Drive by all loops; `released`: the frame follows the motion, which no force holds. */
static void drive_by_loops(loops *own, bool released, double imposed, gyro_plugin_drive *drive)
{
    double set = own->device.amplitude_m, a = creal(own->along), least = fmax(a, 0.1 * set), ts = own->step_s;
    double most = 0.5 * own->limit / (2.0 * own->omega), unit = own->nominal * set;
    bool held = own->limited;
    double grow = filtered(&own->amplitude, set - a, ts, held || own->amplitude.gain * fabs(set - a) > most);
    grow = fmax(-most, fmin(most, probed(&own->probe, LOOP_AMPLITUDE, grow, unit)));
    double quadrature = null_quadrature(own, -cimag(own->across), held);
    quadrature = probed(&own->probe, LOOP_QUADRATURE, quadrature, unit);
    own->quadrature_rate = quadrature / least;
    double complex real = grow * creal(own->across) / least - imposed * a; /* along the motion: it does not turn it */
    if (!released) {
        double asked = filtered(&own->rate, -creal(own->across), ts, held);
        asked = probed(&own->probe, LOOP_RATE, asked, unit);
        own->force_rate = asked / least;
        real = asked + own->turning * a + I * declared_offset(own) * own->across;
    }
    push(own, grow, real + I * quadrature, drive);
    drive->virtual_rotation_rad_s = released ? imposed : 0.0;
}

#endif
