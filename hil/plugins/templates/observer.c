/* An observer of one's own: change it, it runs as it is.

       cc -O2 -shared -fPIC -o observer.so observer.c -lm

       [observer]
       plugin = "observer.so"

   It predicts the motion by the drive that acted, corrects it by the sample, and lets what is left change springs and
   rate (Luenberger's observer, made adaptive by the gradient: Ioannou & Sun, Robust Adaptive Control, 1996, chapters 4
   and 5).  The angle of the pattern is Friedland and Hutton's (IEEE Trans. Automatic Control 23(4), 1978), with the turn
   by forces taken off.  Damping is taken as declared. */

#include <math.h>

#include "gyro_plugin.h"

#define HALF_TURN 3.14159265358979323846
#define BANDWIDTH 0.2   /* of the motion, in units of the resonance */
#define ADAPTATION 0.02 /* of springs and rate, likewise; well below the motion's */

/* All that changes from sample to sample. */
typedef struct {
    gyro_plugin_device device;
    double target, omega, step_s;
    double half, hold; /* of the vibration in half a sample, rad; what it leaves of a force */
    double gain;       /* of a displacement, a sample */
    double motion[4];  /* m: x, vx / omega, y, vy / omega */
    double offset[2];  /* V */
    double springs[3]; /* xx, yy, xy */
    double softened[3]; /* of these, by trim electrodes */
    double rate, theta;
    double turned; /* of the pattern, by no force */
} observer;

unsigned gyro_plugin_version(void)
{
    return GYRO_PLUGIN_VERSION;
}

size_t gyro_plugin_size(void)
{
    return sizeof(observer);
}

const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    observer *own = instance;
    if (device->sense_order != 0.0)
        return "it needs the displacement sensed, not the velocity";
    own->device = *device;
    own->target = device->target_stiffness_per_s2;
    own->omega = sqrt(own->target);
    own->step_s = 1.0 / device->sample_rate_Hz;
    own->half = 0.5 * own->omega * own->step_s;
    own->hold = sin(own->half) / own->half;
    own->gain = 2.0 * BANDWIDTH * own->omega * own->step_s;
    for (int k = 0; k < 3; k++)
        own->springs[k] = device->stiffness_per_s2[k];
    return NULL;
}

/* So far on in the free vibration, rad. */
static void vibrate(double *motion, double angle)
{
    double c = cos(angle), s = sin(angle);
    for (int axis = 0; axis < 2; axis++) {
        double *at = motion + 2 * axis, position = at[0], velocity = at[1];
        at[0] = c * position + s * velocity;
        at[1] = c * velocity - s * position;
    }
}

static double pattern_angle(const double *m)
{
    return 0.5 * atan2(2.0 * (m[0] * m[2] + m[1] * m[3]), m[0] * m[0] + m[1] * m[1] - m[2] * m[2] - m[3] * m[3]);
}

static double within_half_turn(double angle)
{
    return angle - HALF_TURN * floor(angle / HALF_TURN + 0.5);
}

/* A sample on: half a sample of free vibration at the target, all that acts beside it, and the other half.  Gives the
   turn of the pattern by forces. */
static double predict(observer *own, const double *applied)
{
    const double *k = own->springs, *d = own->device.damping_per_s;
    double *m = own->motion, w = own->omega;
    vibrate(m, own->half);
    double before = pattern_angle(m);
    double ax = applied[0] * own->hold - (k[0] - own->target) * m[0] - k[2] * m[2] - w * (d[0] * m[1] + d[2] * m[3]);
    double ay = applied[1] * own->hold - (k[1] - own->target) * m[2] - k[2] * m[0] - w * (d[1] * m[3] + d[2] * m[1]);
    m[1] += ax * own->step_s / w;
    m[3] += ay * own->step_s / w;
    double forced = within_half_turn(pattern_angle(m) - before), vx = m[1];
    double coriolis = 2.0 * own->device.angular_gain * own->rate * own->step_s;
    m[1] += coriolis * m[3];
    m[3] -= coriolis * vx;
    vibrate(m, own->half);
    return forced;
}

/* Springs and rate, each by what the displacement owes to it, a quarter of a period behind the force. */
static void adapt(observer *own, const double *off)
{
    const double *m = own->motion;
    double least = 0.01 * own->device.amplitude_m * own->device.amplitude_m, w = own->omega;
    double size = fmax(m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + m[3] * m[3], least);
    double step = 2.0 * ADAPTATION * own->gain * w / size;
    own->springs[0] += step * w * off[0] * m[1];
    own->springs[1] += step * w * off[1] * m[3];
    own->springs[2] += step * w * 0.5 * (off[0] * m[3] + off[1] * m[1]);
    own->rate += step * 0.5 * (off[0] * m[2] - off[1] * m[0]) / own->device.angular_gain;
}

/* Called before gyro_plugin_observe where a trim voltage has changed: the springs follow it. */
void gyro_plugin_trimmed(void *instance, const gyro_plugin_trims *trims)
{
    observer *own = instance;
    for (int k = 0; k < 3; k++) {
        own->springs[k] += own->softened[k] - trims->softened_per_s2[k];
        own->softened[k] = trims->softened_per_s2[k];
    }
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    observer *own = instance;
    int settled = 0.5 * own->gain * (double)sample->number > 5.0; /* whether the motion is known */
    double forced = predict(own, sample->applied_mps2);
    if (!sample->lost) {
        double off[2];
        for (int axis = 0; axis < 2; axis++) {
            double per_m = own->device.sense_gain_V_per_m[axis];
            estimate->innovation_V[axis] = sample->sense_V[axis] - per_m * own->motion[2 * axis] - own->offset[axis];
            off[axis] = estimate->innovation_V[axis] / per_m;
            own->offset[axis] += 0.05 * own->gain * estimate->innovation_V[axis];
        }
        if (settled)
            adapt(own, off);
        own->motion[0] += own->gain * off[0];
        own->motion[2] += own->gain * off[1];
    }
    double theta = pattern_angle(own->motion);
    if (settled)
        own->turned += within_half_turn(theta - own->theta) - forced;
    own->theta = theta;
    for (int axis = 0; axis < 2; axis++) {
        estimate->state[2 * axis] = own->motion[2 * axis];
        estimate->state[2 * axis + 1] = own->omega * own->motion[2 * axis + 1];
        estimate->state[GYRO_PLUGIN_PHI_X + axis] = own->offset[axis];
    }
    for (int k = 0; k < 3; k++)
        estimate->state[GYRO_PLUGIN_KXX + k] = own->springs[k];
    estimate->state[GYRO_PLUGIN_RATE] = own->rate;
    estimate->angle_rad = -own->turned / own->device.angular_gain;
}
