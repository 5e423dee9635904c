/* An observer of one's own: change it, it runs as it is.

       cc -O2 -shared -fPIC -o observer.so observer.c -lm

       [observer]
       plugin = "observer.so"

   It follows both axes by in-phase and quadrature components in the frame of a phase that is locked to the motion, with
   the sense offset beside them (an adaptive notch: Widrow et al., Proc. IEEE 63(12), 1975), and reads the angle of the
   pattern from them (Lynch, Symposium Gyro Technology, 1995).  It knows nothing of stiffness and damping. */

#include <math.h>

#include "gyro_plugin.h"

#define HALF_TURN 3.14159265358979323846
#define BANDWIDTH 0.2 /* of components and phase, in units of the resonance */

/* All that changes from sample to sample. */
typedef struct {
    gyro_plugin_device device;
    double step_s, gain, omega, phase;
    double parts[2][3]; /* of each axis, V: cosine, sine, offset */
    double theta, turn, imposed, rate;
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
    own->step_s = 1.0 / device->sample_rate_Hz;
    own->omega = sqrt(device->target_stiffness_per_s2);
    own->gain = BANDWIDTH * own->omega * own->step_s;
    return NULL;
}

/* Turn the phase to where the motion is largest. */
static void lock(observer *own, const double c[2], const double s[2])
{
    double product = c[0] * s[0] + c[1] * s[1];
    double difference = c[0] * c[0] + c[1] * c[1] - s[0] * s[0] - s[1] * s[1];
    double error = 0.5 * atan2(-2.0 * product, difference);
    own->phase += 0.5 * own->gain * error;
    own->omega += 0.1 * own->gain * own->gain * error / own->step_s;
}

/* Count the pattern's turn, of which the angle is known modulo a half turn. */
static void count_turn(observer *own, const double c[2], const double s[2], const gyro_plugin_sample *sample)
{
    double sum = c[0] * c[1] + s[0] * s[1];
    double theta = 0.5 * atan2(2.0 * sum, c[0] * c[0] + s[0] * s[0] - c[1] * c[1] - s[1] * s[1]);
    double change = theta - own->theta - HALF_TURN * floor((theta - own->theta) / HALF_TURN + 0.5);
    own->theta = theta;
    if ((double)(sample->number + 1) * own->gain < 5.0) /* the components have not settled */
        return;
    own->turn += change;
    own->imposed += sample->virtual_rotation_rad_s * own->step_s;
    own->rate += own->gain * (-change / own->step_s - sample->virtual_rotation_rad_s - own->rate);
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    observer *own = instance;
    double c[2], s[2];
    own->phase += own->omega * own->step_s;
    double cosine = cos(own->phase), sine = sin(own->phase);
    for (int axis = 0; axis < 2; axis++) {
        double *parts = own->parts[axis];
        if (!sample->lost) {
            double error = sample->sense_V[axis] - (parts[0] * cosine + parts[1] * sine + parts[2]);
            estimate->innovation_V[axis] = error;
            parts[0] += 2.0 * own->gain * error * cosine;
            parts[1] += 2.0 * own->gain * error * sine;
            parts[2] += 0.1 * own->gain * error;
        }
        c[axis] = parts[0] / own->device.sense_gain_V_per_m[axis];
        s[axis] = parts[1] / own->device.sense_gain_V_per_m[axis];
        estimate->state[GYRO_PLUGIN_PHI_X + axis] = parts[2];
    }
    lock(own, c, s);
    count_turn(own, c, s, sample);
    for (int axis = 0; axis < 2; axis++) {
        estimate->state[2 * axis] = c[axis] * cosine + s[axis] * sine;
        estimate->state[2 * axis + 1] = own->omega * (s[axis] * cosine - c[axis] * sine);
    }
    estimate->state[GYRO_PLUGIN_RATE] = own->rate / own->device.angular_gain;
    estimate->angle_rad = (-own->turn - own->imposed) / own->device.angular_gain;
}
