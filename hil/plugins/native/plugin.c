/* Plug-ins in the place of the core's step: what the turn calls for each sample (hil/running/native/force.h). */

#define _GNU_SOURCE

#include "step.h"

#define LINE 64 /* bytes of a line of the cache: an instance's vectors lie in one each */
#define EXPORT __attribute__((visibility("default")))

#include "drive_table.h"

/* Sizes of the structures, for Python to compare. */
EXPORT void plugin_sizes(int64_t sizes[7])
{
    sizes[0] = sizeof(gyro_plugin_device);
    sizes[1] = sizeof(gyro_plugin_sample);
    sizes[2] = sizeof(gyro_plugin_estimate);
    sizes[3] = sizeof(gyro_plugin_drive);
    sizes[4] = sizeof(gyro_plugin_trims);
    sizes[5] = sizeof(plugin_t);
    sizes[6] = sizeof(watch_t);
}

EXPORT int64_t plugin_watch(const watch_t *asked)
{
    return watch(asked);
}

/* Whether there is memory for all that is handed over; `sizes` of both instances. */
EXPORT int64_t plugin_lend(plugin_t *plugin, const int64_t sizes[2])
{
    const int64_t all[LENT] = {sizes[0], sizes[1], sizeof *plugin->sample, sizeof *plugin->estimate,
                               sizeof *plugin->drive, sizeof *plugin->trims};
    for (int i = 0; i < LENT; i++) {
        plugin->lent[i] = lend(all[i], i < 2 ? LINE : 16);
        if (plugin->lent[i].pages == NULL)
            return 0;
    }
    plugin->sample = (void *)plugin->lent[2].at;
    plugin->estimate = (void *)plugin->lent[3].at;
    plugin->drive = (void *)plugin->lent[4].at;
    plugin->trims = (void *)plugin->lent[5].at;
    return 1;
}

EXPORT void plugin_give_back(plugin_t *plugin)
{
    for (int i = 0; i < LENT; i++)
        give_back(&plugin->lent[i]);
}

/* What an instance says to the device: NULL, or why it cannot take it. */
EXPORT const char *plugin_init(plugin_t *plugin, const char *(*init)(void *, const gyro_plugin_device *),
                               int64_t instance, int64_t part)
{
    gyro_plugin_device device = plugin->device;
    enter(plugin, part);
    const char *why = init(plugin->lent[instance].at, &device);
    return came_back(plugin, part) ? why : NULL;
}

EXPORT void plugin_remember(plugin_t *plugin)
{
    plugin->begun_pages = pages_taken();
}

/* One sample of the closed loop, as the core's: sense codes (NaN: lost) and echoed drive codes -> codes to send. */
EXPORT void plugin_step(void *context, double vx, double vy, double ux, double uy, double codes[2])
{
    plugin_t *plugin = context;
    const gyro_plugin_device *device = &plugin->device;
    codes[0] = codes[1] = (double)NAN; /* which may not be sent */
    if (plugin->observe == NULL) {
        plugin->own.observe(plugin->own.estimator, vx, vy, ux, uy);
        own_estimate(plugin);
        plugin->number++;
    } else {
        double scale = device->sense_scale_V, force = device->drive_scale_mps2;
        int32_t sense_x = isnan(vx) ? 0 : (int32_t)vx, sense_y = isnan(vy) ? 0 : (int32_t)vy;
        double imposed = plugin->own.passed(plugin->own.estimator, ux, uy) / plugin->own.per_second;
        hand_over(plugin, (double[2]){vx * scale, vy * scale}, (double[2]){ux * force, uy * force},
                  (int32_t[4]){sense_x, sense_y, (int32_t)ux, (int32_t)uy}, imposed);
        if (!observed(plugin))
            return;
    }
    drive(plugin, codes);
}

static int32_t code_of(double value)
{
    return fabs(value) < 2147483647.0 ? (int32_t)rint(value) : 0; /* which NaN is not */
}

/* The virtual rotation that the bench file declares, of a record in which none is told. */
static double declared_rotation(const plugin_t *plugin, const double applied[2])
{
    const gyro_plugin_device *device = &plugin->device;
    double rate = applied[0] != 0.0 || applied[1] != 0.0 ? device->virtual_rotation_rad_s : 0.0;
    if (device->virtual_reversal_s <= 0.0)
        return rate;
    double turn = floor(((double)plugin->number + 0.5) * plugin->step_s / device->virtual_reversal_s + 0.5);
    return turn - 2.0 * floor(0.5 * turn) > 0.5 ? -rate : rate;
}

/* n samples of a record, sense (n, width) in V and drive (n, width) in m/s2, through the observer alone -> rows
   (n, ROW_SIZE), and of every `every`-th state and deviation (n / every, states); how many were taken in. width: x and
   y, of demodulated streams both in phase, then both in quadrature. */
EXPORT int64_t plugin_observe(plugin_t *plugin, int64_t n, int64_t width, int64_t every, const double *sense,
                              const double *applied, double *rows, double *states, double *deviations)
{
    const gyro_plugin_device *device = &plugin->device;
    for (int64_t m = 0; m < n; m++, sense += width, applied += width) {
        int32_t codes[4];
        for (int axis = 0; axis < 2; axis++) {
            codes[axis] = code_of(sense[axis] / device->sense_scale_V);
            codes[2 + axis] = code_of(applied[axis] / device->drive_scale_mps2);
            if (width == 4) {
                plugin->sample->quadrature_V[axis] = sense[2 + axis];
                plugin->sample->applied_quadrature_mps2[axis] = applied[2 + axis];
            }
        }
        hand_over(plugin, sense, applied, codes, declared_rotation(plugin, applied));
        if (!observed(plugin))
            return m;
        memcpy(rows + ROW_SIZE * m, plugin->row, ROW_SIZE * sizeof *rows);
        if (m % every != every - 1)
            continue;
        int64_t at = m / every * plugin->states;
        for (int64_t i = 0; i < plugin->states; i++) {
            states[at + i] = plugin->state[i];
            deviations[at + i] = sqrt(plugin->variance[i * (plugin->states + 1)]);
        }
    }
    return n;
}
