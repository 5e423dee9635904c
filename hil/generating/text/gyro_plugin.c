/* The estimator beside this file as a plug-in of the bench: [observer] plugin, [controller] plugin.
 *
 * Written by `hil generate`; `make plugin` compiles it into gyro_estimator.so.
 */
#include "gyro_estimator.c"

#include "gyro_plugin.h"

typedef struct {
    gyro_estimator estimator;
    int observes; /* it is the observer, too */
} plugin;

unsigned gyro_plugin_version(void)
{
    return GYRO_PLUGIN_VERSION;
}

size_t gyro_plugin_size(void)
{
    return sizeof(plugin);
}

static int differs(double value, double other)
{
    return fabs(value - other) > 1e-9 * fabs(other);
}

const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    if (differs(device->sample_rate_Hz, GYRO_SAMPLE_RATE_HZ))
        return "it was generated for another sample rate; run `hil generate` on this bench file";
    if (differs(device->latency, GYRO_LATENCY))
        return "it was generated for another latency; run `hil generate --latency`, or --link to this board";
    if (differs(device->sense_scale_V, GYRO_SENSE_SCALE_V) || differs(device->drive_scale_mps2, GYRO_DRIVE_SCALE_MPS2))
        return "it was generated for other codes; run `hil generate --link` to this board";
    if (differs(device->drive_limit_mps2, GYRO_DRIVE_LIMIT_MPS2))
        return "it was generated for another limit of the drive; run `hil generate` on this bench file";
    gyro_estimator_init(&((plugin *)instance)->estimator);
    return NULL;
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *said)
{
    gyro_estimator *estimator = &((plugin *)instance)->estimator;
    const Output *row = &estimator->row;
    gyro_estimate estimate;
    real z[2], u[2];
    ((plugin *)instance)->observes = 1;
    for (int i = 0; i < 2; i++) {
        z[i] = sample->lost ? (real)NAN : (real)sample->sense_codes[i] * settings.sense_scale[i];
        u[i] = (real)sample->applied_codes[i] * settings.quantum;
    }
    observe(estimator, z, u);
    gyro_estimator_read(estimator, &estimate);
    for (int i = 0; i < GYRO_STATES; i++) {
        said->state[i] = (double)estimate.state[i];
        said->deviation[i] = estimate.deviation[i] > R(0.0) ? (double)estimate.deviation[i] : 0.0;
    }
    for (int i = 0; i < 2; i++) {
        said->innovation_V[i] = (double)estimate.innovation_V[i];
        said->innovation_deviation_V[i] = (double)estimate.innovation_deviation_V[i];
    }
    said->angle_rad = estimate.angle_rad;
    said->angle_u_rad = (double)estimate.angle_deviation_rad;
    said->energy_ratio = (double)estimate.energy_ratio;
    said->quadrature_ratio = (double)estimate.quadrature_ratio;
    said->angle_forced_rad = row->angle_forced;
    said->angle_pattern_rad = row->angle_pattern;
    said->angle_plain_rad = row->angle_plain;
    said->rate_integral_rad = row->angle_rate_integral;
}

/* Another's estimate, where this one only controls. */
static void take_over(gyro_estimator *estimator, const gyro_plugin_estimate *said)
{
    real applied[2] = {estimator->memory.queue[0][0], estimator->memory.queue[0][1]};
    advance_queue(&settings, &estimator->memory, applied);
    estimator->memory.time += (double)settings.h;
    for (int i = 0; i < GYRO_STATES; i++)
        if (!isnan(said->state[i]))
            estimator->x[i] = (real)said->state[i] / unit[i];
}

void gyro_plugin_control(void *instance, const gyro_plugin_estimate *said, int drive_on, gyro_plugin_drive *asked)
{
    gyro_estimator *estimator = &((plugin *)instance)->estimator;
    double codes[2];
    if (!((plugin *)instance)->observes)
        take_over(estimator, said);
    drive(estimator, drive_on, codes);
    for (int i = 0; i < 2; i++)
        asked->force_mps2[i] = codes[i] * GYRO_DRIVE_SCALE_MPS2;
    asked->virtual_rotation_rad_s = (double)(estimator->memory.queue[settings.latency][2] * unit[GYRO_RATE]);
}
