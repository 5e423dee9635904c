/* The algorithms that nearly every vibrating gyroscope is run with, as a plug-in: [controller] mode.

   force_to_rebalance: the rate is the force that holds the motion on one line. mode_reversal: the same, with drive and
   sense axes exchanged. classic_whole_angle: the motion turns freely, the angle is that of its line. */

#include <stddef.h>
#include <string.h>

#include "phases.h"
#include "reversal.h"
#include "springs.h"

typedef struct {
    loops loops;
    start start;
    reversal exchange;
    spring_fit springs;
    double running_s, angle, imposed, first_theta, rate;
    double zero_s; /* of running_s, where the angle is zero */
    double recent; /* rate, over some time constants of its loop */
    double hold_s, missed2, change2; /* length of the present hold of the rate; of past ones: rad2 that they may have
                                        missed since the zero, and squared changes of the rate */
    int64_t holds;
    double between_sd, across_sd;  /* 1/s, of half of dxx - dyy, and of dxy, which no loop takes off */
    double complex coupling, coupled_s; /* sine and cosine of twice the frame at which the rate was read, 0 where the
                                           exchange takes off what damping adds; its integral since the zero */
    double windows[3], sum, walk2; /* of the quadrature's rate; rad2/s */
    int64_t samples, whole, walks;
    double scored_samples, scored[4]; /* since the zero, sums of: frequency, Hz; amplitude over its set point; squares of
                                         the phase's error and of the motion across over that along */
} classic;

static const char *const option_names[] = {"mode",       "amplitude_Hz",     "phase_Hz",   "rate_Hz", "quadrature_Hz",
                                           "phase_margin_deg", "exchange_s", "search_s",   "ring_up_s", "lock_s",
                                           "null_s",     "probe_loop",       "probe_Hz",   "probe_size", "settle_s",
                                           "damping_sd_per_s"};

unsigned gyro_plugin_version(void)
{
    return GYRO_PLUGIN_VERSION;
}

size_t gyro_plugin_size(void)
{
    return sizeof(classic);
}

int gyro_plugin_option(void *instance, const char *name, double value)
{
    double *given = &((classic *)instance)->loops.given.mode;
    for (size_t k = 0; k < sizeof option_names / sizeof *option_names; k++)
        if (strcmp(name, option_names[k]) == 0) {
            given[k] = value;
            return 1;
        }
    return 0;
}

const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    classic *own = instance;
    loops *in = &own->loops;
    options *given = &in->given;
    const double *d = device->damping_per_s;
    if (device->sense_order != 0.0)
        return "it needs the displacement sensed, not the velocity";
    if (!(given->mode >= (double)FORCE_TO_REBALANCE))
        given->mode = WHOLE_ANGLE;
    if (!(given->phase_margin_deg > 0.0))
        given->phase_margin_deg = 60.0;
    in->device = *device;
    in->step_s = 1.0 / device->sample_rate_Hz;
    in->nominal = in->omega = sqrt(device->stiffness_per_s2[0]);
    in->limit = floor(device->drive_limit_mps2 / device->drive_scale_mps2) * device->drive_scale_mps2;
    in->noise_V2 = device->noise_V * device->noise_V;
    if (!design_all(in))
        return "[controller.loops]: no filter gives these bandwidths with this phase_margin_deg; lower either";
    if (!(given->exchange_s > 0.0))
        given->exchange_s = 4.0 * (turn_duration_s(in) + settling_s(in));
    if (given->exchange_s < 1.5 * (turn_duration_s(in) + settling_s(in)))
        return "[controller.loops] exchange_s: shorter than 1.5 times the turn of the vibration and the settling after it";
    if (given->probe_loop > 0.0)
        in->probe = (loop_probe){.loop = (int64_t)given->probe_loop,
                                 .step_rad = 2.0 * HALF_TURN * given->probe_Hz * in->step_s,
                                 .size = given->probe_size};
    in->coupled = (device->stiffness_per_s2[2] - 0.5 * I * (device->stiffness_per_s2[0] - device->stiffness_per_s2[1])) *
                  device->amplitude_m / (2.0 * in->nominal);
    own->between_sd = sqrt(0.25 * (d[0] - d[1]) * (d[0] - d[1]) + 0.5 * given->damping_sd * given->damping_sd);
    own->across_sd = hypot(d[2], given->damping_sd);
    own->whole = (int64_t)(20.0 / in->rate.gain / in->step_s);
    set_limits(&own->start, in);
    begin_phase(&own->start, SEARCH);
    return NULL;
}

/* Random walk of the angle, from the quadrature loop, which has the noise of the rate's and no rate. */
static void watch_noise(classic *own)
{
    if (own->loops.turning != 0.0) {
        own->samples = 0;
        own->sum = 0.0;
        own->windows[0] = own->windows[1] = (double)NAN;
        return;
    }
    own->sum += own->loops.quadrature_rate;
    if (++own->samples < own->whole)
        return;
    double *w = own->windows, width_s = (double)own->whole * own->loops.step_s;
    w[2] = w[1];
    w[1] = w[0];
    w[0] = own->sum / (double)own->whole;
    own->sum = 0.0;
    own->samples = 0;
    double bend = w[0] - 2.0 * w[1] + w[2];
    if (isfinite(bend) && ++own->walks > 3)
        own->walk2 += (bend * bend / 6.0 * width_s - own->walk2) / (double)(own->walks - 3);
}

/* What a hold of the rate may miss: anything from nothing to the rate's change over it for as long as it lasted, as the
   change may have come at its end or at its beginning; rms over that, a third of the square. */
static void watch_hold(classic *own, double now, bool read)
{
    if (!read) {
        own->hold_s += own->loops.step_s;
    } else if (own->hold_s > 0.0) {
        double change = now - own->recent;
        own->missed2 += change * change * own->hold_s * own->hold_s / 3.0;
        own->change2 += change * change;
        own->holds++;
        own->hold_s = 0.0;
    }
}

/* Rate and angle of this sample, while it runs. */
static void read_out(classic *own, double imposed)
{
    loops *in = &own->loops;
    double gain = in->device.angular_gain;
    if ((int)in->given.mode == WHOLE_ANGLE) {
        double theta = in->frame + creal(in->across) / fmax(creal(in->along), 0.1 * in->device.amplitude_m);
        if (own->running_s == 0.0)
            own->first_theta = theta;
        own->imposed += imposed * in->step_s;
        own->rate = -(in->rate.integral) / gain;
        own->coupling = cexp(2.0 * I * in->frame);
        own->angle = (own->first_theta - theta - own->imposed) / gain;
    } else {
        double bias = own->exchange.bias * cos(2.0 * in->frame);
        double now = (in->force_rate - bias) / gain;
        bool read = (int)in->given.mode != MODE_REVERSAL || own->exchange.settled;
        watch_hold(own, now, read);
        if (read) {
            own->coupling = own->exchange.exchanges < 2 ? cexp(2.0 * I * in->frame) : 0.0;
            own->recent += (now - own->recent) * fmin(0.1 * in->rate.gain * in->step_s, 1.0);
        }
        own->rate = read ? now : own->recent;
        own->angle += own->rate * in->step_s;
        watch_noise(own);
    }
    own->coupled_s += own->coupling * in->step_s;
    own->running_s += in->step_s;
}

/* What damping may add to the rate, or with its integral to the angle: half of dxy cos 2a - (dxx - dyy)/2 sin 2a. */
static double by_damping(const classic *own, double complex coupling)
{
    return 0.5 * hypot(own->between_sd * cimag(coupling), own->across_sd * creal(coupling)) /
           own->loops.device.angular_gain;
}

/* How the loops hold what they are to hold. */
static void watch_loops(classic *own)
{
    const loops *in = &own->loops;
    double a = creal(in->along), across = cabs(in->across) / a;
    own->scored_samples += 1.0;
    own->scored[0] += in->omega / (2.0 * HALF_TURN);
    own->scored[1] += a / in->device.amplitude_m;
    own->scored[2] += in->error_rad * in->error_rad;
    own->scored[3] += across * across;
}

static void tell(const classic *own, gyro_plugin_estimate *estimate)
{
    const loops *in = &own->loops;
    double cosine = cos(in->phase), sine = sin(in->phase), set = in->device.amplitude_m;
    double a = fmax(creal(in->along), 0.1 * set), all = creal(in->along) * creal(in->along);
    for (int axis = 0; axis < 2; axis++) {
        double complex at = in->channels[axis].parts / in->device.sense_gain_V_per_m[axis];
        estimate->state[2 * axis] = creal(at) * cosine + cimag(at) * sine;
        estimate->state[2 * axis + 1] = in->omega * (cimag(at) * cosine - creal(at) * sine);
        estimate->state[GYRO_PLUGIN_PHI_X + axis] = in->channels[axis].offset;
    }
    double sd = sqrt(2.0 * in->share * in->noise_V2) / fabs(in->device.sense_gain_V_per_m[0]) / a;
    double counted_s = own->running_s - own->zero_s;
    double missed2 = own->missed2 + own->change2 / fmax((double)own->holds, 1.0) * own->hold_s * own->hold_s / 3.0;
    double bias = by_damping(own, own->coupling), damped = by_damping(own, own->coupled_s);
    all += creal(in->across) * creal(in->across) + cimag(in->across) * cimag(in->across);
    estimate->state[GYRO_PLUGIN_RATE] = own->rate;
    estimate->deviation[GYRO_PLUGIN_RATE] = hypot(sd * in->rate.gain, bias);
    estimate->angle_rad = own->angle;
    estimate->angle_u_rad = sqrt(sd * sd + own->walk2 * counted_s + missed2 + damped * damped);
    estimate->energy_ratio = all / (set * set);
    estimate->quadrature_ratio = 2.0 * creal(in->along) * cimag(in->across) / fmax(all, 1e-6 * set * set);
    const spring_fit *springs = &own->springs;
    for (int k = 0; k < 3; k++)
        if (springs->weight > 0.0 && isfinite(springs->deviation[k])) {
            estimate->state[GYRO_PLUGIN_KXX + k] = springs->springs[k];
            estimate->deviation[GYRO_PLUGIN_KXX + k] = springs->deviation[k];
        }
    if (own->start.phase < RUN) /* what is left of a motion that is not known yet is not noise */
        for (int axis = 0; axis < 2; axis++)
            estimate->innovation_deviation_V[axis] = fmax(in->device.noise_V, fabs(estimate->innovation_V[axis]));
    if (own->start.why[0] != '\0')
        estimate->angle_rad = (double)NAN;
}

void gyro_plugin_trimmed(void *instance, const gyro_plugin_trims *trims)
{
    classic *own = instance;
    soften(&own->springs, &own->loops, trims);
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    classic *own = instance;
    loops *in = &own->loops;
    sense(in, sample, estimate);
    if ((double)sample->number * in->step_s < in->given.settle_s) {
        own->zero_s = own->running_s;
        own->missed2 = 0.0;
        own->coupled_s = 0.0;
    } else if (own->start.phase == RUN) {
        watch_loops(own);
    }
    if (own->start.phase > SEARCH)
        lock_phase(in, 0.05);
    if (own->start.phase == RUN) {
        in->probe.live = 1;
        if ((int)in->given.mode == WHOLE_ANGLE)
            follow_pattern(in, sample->virtual_rotation_rad_s);
        else if ((int)in->given.mode == MODE_REVERSAL)
            exchange_axes(in, &own->exchange, own->running_s);
        if ((int)in->given.mode != MODE_REVERSAL || own->exchange.settled)
            follow_springs(&own->springs, in);
        read_out(own, sample->virtual_rotation_rad_s);
    }
    tell(own, estimate);
}

/* [controller] virtual_rotation_rad_s as it is to be imposed now. */
static double imposed_now(const classic *own)
{
    const gyro_plugin_device *device = &own->loops.device;
    double turn = device->virtual_reversal_s > 0.0 ? floor(own->running_s / device->virtual_reversal_s + 0.5) : 0.0;
    return turn - 2.0 * floor(0.5 * turn) > 0.5 ? -device->virtual_rotation_rad_s : device->virtual_rotation_rad_s;
}

void gyro_plugin_control(void *instance, const gyro_plugin_estimate *estimate, int drive_on, gyro_plugin_drive *drive)
{
    classic *own = instance;
    loops *in = &own->loops;
    (void)estimate;
    if (!drive_on) { /* it begins again from whatever is left of the motion */
        in->amplitude.integral = in->rate.integral = 0.0;
        in->limited = false;
        if (own->start.phase != SEARCH)
            begin_phase(&own->start, creal(in->along) > 0.1 * in->device.amplitude_m ? RING_UP : SEARCH);
        return;
    }
    bool released = (int)in->given.mode == WHOLE_ANGLE;
    if (own->start.phase < RUN) {
        start_up(&own->start, in, drive);
        if (own->start.phase == RUN && released)
            in->rate.integral = 0.0;
    } else {
        drive_by_loops(in, released, released ? imposed_now(own) : 0.0, drive);
    }
}

const char *gyro_plugin_why(const void *instance)
{
    const classic *own = instance;
    return own->start.why[0] == '\0' ? NULL : own->start.why;
}

int gyro_plugin_figure(const void *instance, int number, gyro_plugin_named *figure)
{
    const classic *own = instance;
    const start *began = &own->start;
    static const char *const held[RUN] = {"frequency_scored_mean", "amplitude_of_set_scored_mean",
                                           "phase_error_scored_rms", "across_over_along_scored_rms"};
    static const char *const units[RUN] = {"Hz", "1", "rad", "1"};
    double complex gain = loop_gain(&own->loops.probe);
    double mean = number >= RUN && number < 2 * RUN ? own->scored[number - RUN] / own->scored_samples : NAN;
    if (number < RUN)
        *figure = (gyro_plugin_named){phase_names[number], "s", began->took_s[number], began->limit_s[number]};
    else if (number < 2 * RUN)
        *figure = (gyro_plugin_named){held[number - RUN], units[number - RUN], number < RUN + 2 ? mean : sqrt(mean), NAN};
    else if (own->loops.probe.loop > 0 && number == 2 * RUN)
        *figure = (gyro_plugin_named){"loop_gain", "1", cabs(gain), NAN};
    else if (own->loops.probe.loop > 0 && number == 2 * RUN + 1)
        *figure = (gyro_plugin_named){"phase_margin", "deg", (carg(-gain)) * 180.0 / HALF_TURN, NAN};
    else
        return 0;
    return 1;
}
