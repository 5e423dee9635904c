/* A controller of one's own: change it, it runs as it is.

       cc -O2 -shared -fPIC -o controller.so controller.c -lm

       [controller]
       plugin = "controller.so"

   It makes the mass an isotropic oscillator by the constants that it is given, holds the energy, and turns the vibration
   into a line. */

#include <math.h>

#include "gyro_plugin.h"

#define GAIN 0.1 /* of both holds, in units of the frequency */

typedef struct {
    gyro_plugin_device device;
    double k, omega, energy;
    double cosine, sine; /* from the estimate to the middle of the interval that its force acts in */
} controller;

unsigned gyro_plugin_version(void)
{
    return GYRO_PLUGIN_VERSION;
}

size_t gyro_plugin_size(void)
{
    return sizeof(controller);
}

const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    controller *own = instance;
    own->device = *device;
    own->k = device->target_stiffness_per_s2;
    own->omega = sqrt(own->k);
    own->energy = 0.5 * own->k * device->amplitude_m * device->amplitude_m;
    own->cosine = cos((device->latency + 0.5) * own->omega / device->sample_rate_Hz);
    own->sine = sin((device->latency + 0.5) * own->omega / device->sample_rate_Hz);
    return NULL;
}

/* No more than `limit`: beyond the drive's the run would end. */
static double within(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

void gyro_plugin_control(void *instance, const gyro_plugin_estimate *estimate, int drive_on, gyro_plugin_drive *drive)
{
    const controller *own = instance;
    const double *state = estimate->state, k = own->k, w = own->omega;
    double now[4], limit = own->device.drive_limit_mps2;
    (void)drive_on; /* whether the drive will be applied */
    for (int axis = 0; axis < 2; axis++) {
        double position = state[2 * axis], velocity = state[2 * axis + 1];
        now[2 * axis] = position * own->cosine + velocity / w * own->sine;
        now[2 * axis + 1] = velocity * own->cosine - position * w * own->sine;
    }
    double x = now[0], vx = now[1], y = now[2], vy = now[3];
    double kxx = state[GYRO_PLUGIN_KXX], kyy = state[GYRO_PLUGIN_KYY], kxy = state[GYRO_PLUGIN_KXY];
    double dxx = state[GYRO_PLUGIN_DXX], dyy = state[GYRO_PLUGIN_DYY], dxy = state[GYRO_PLUGIN_DXY];
    double energy = 0.5 * (k * (x * x + y * y) + vx * vx + vy * vy);
    double along = GAIN * w * within(1.0 - energy / own->energy, 1.0);
    double across = GAIN * k * within(w * (x * vy - y * vx) / fmax(energy, 1e-3 * own->energy), 1.0);
    double turning = 2.0 * own->device.virtual_rotation_rad_s;
    drive->force_mps2[0] =
        within(dxx * vx + dxy * vy + (kxx - k) * x + kxy * y + along * vx + across * y + turning * vy, limit);
    drive->force_mps2[1] =
        within(dxy * vx + dyy * vy + kxy * x + (kyy - k) * y + along * vy - across * x - turning * vx, limit);
    drive->virtual_rotation_rad_s = own->device.virtual_rotation_rad_s;
}
