/* What follows from a plug-in's state, where it does not say it itself: the core's row, in SI.

   Pattern and turns as estimator/core/pattern.h and angle.h have them. */

#ifndef PLUGIN_DERIVED_H
#define PLUGIN_DERIVED_H

#include "structs.h"

/* The row's entries: OUTPUT of estimator/core/layout.py. */
enum { ROW_NU = 0, ROW_S = 2, ROW_ANGLE = 4, ROW_ANGLE_VARIANCE, ROW_FORCED, ROW_PATTERN, ROW_PLAIN, ROW_INTEGRAL,
       ROW_ENERGY, ROW_QUADRATURE, ROW_SIZE };

#define HALF_TURN 3.14159265358979323846

static double or_else(double given, double derived)
{
    return isnan(given) ? derived : given;
}

static double nearest(double theta, double before)
{
    return theta + HALF_TURN * floor((before - theta) / HALF_TURN + 0.5);
}

/* Direction of the ellipse, its energy and momentum, at total rotation w of which `rate` is real. */
static double pattern_of(const double *s, double k, double w, double rate, double *energy, double *momentum)
{
    double x = s[0], y = s[2], vx = s[1] - w * y, vy = s[3] + w * x, ke = k + w * w - rate * rate;
    *energy = 0.5 * (ke * (x * x + y * y) + vx * vx + vy * vy);
    *momentum = x * vy - y * vx;
    return 0.5 * atan2(2.0 * (ke * x * y + vx * vy), ke * (x * x - y * y) + (vx * vx - vy * vy));
}

/* What the sample shows beside the state: the residual after it was taken in. */
static double residual(const plugin_t *plugin, int axis)
{
    const gyro_plugin_device *device = &plugin->device;
    double shown = plugin->state[2 * axis + (device->sense_order == 1.0)];
    return plugin->sample->sense_V[axis] - device->sense_gain_V_per_m[axis] * shown -
           plugin->state[GYRO_PLUGIN_PHI_X + axis];
}

/* What the pattern shows, where the plug-in does not say it. */
static void work_out(plugin_t *plugin)
{
    const gyro_plugin_device *device = &plugin->device;
    gyro_plugin_estimate *said = plugin->estimate;
    turned_t *turned = &plugin->turned;
    double k = device->target_stiffness_per_s2, rate = plugin->state[GYRO_PLUGIN_RATE];
    double imposed = plugin->sample->virtual_rotation_rad_s;
    double energy, momentum, other, unused;
    double theta = pattern_of(plugin->state, k, rate + imposed, rate, &energy, &momentum);
    double plain = pattern_of(plugin->state, k, 0.0, 0.0, &other, &unused);
    if (turned->started == 0) {
        *turned = (turned_t){.started = 1, .theta = theta, .theta_zero = theta};
        turned->plain = turned->plain_zero = nearest(plain, theta);
    } else {
        turned->theta = nearest(theta, turned->theta);
        turned->plain = nearest(plain, turned->plain);
        turned->virtual_turn += imposed * plugin->step_s;
        turned->rate_integral += rate * plugin->step_s;
    }
    double turns = 1.0 / device->angular_gain, set = 0.5 * k * device->amplitude_m * device->amplitude_m;
    double angle = turns * (turned->theta_zero - turned->theta - turned->virtual_turn);
    said->angle_pattern_rad = or_else(said->angle_pattern_rad, angle);
    angle = turns * (turned->plain_zero - turned->plain - turned->virtual_turn);
    said->angle_plain_rad = or_else(said->angle_plain_rad, angle);
    said->rate_integral_rad = or_else(said->rate_integral_rad, turns * turned->rate_integral);
    said->energy_ratio = or_else(said->energy_ratio, energy / set);
    said->quadrature_ratio = or_else(said->quadrature_ratio, energy > 0.0 ? sqrt(k) * momentum / energy : 0.0);
}

static bool lacks_some(const gyro_plugin_estimate *said)
{
    return isnan(said->angle_pattern_rad) || isnan(said->angle_plain_rad) || isnan(said->rate_integral_rad) ||
           isnan(said->energy_ratio) || isnan(said->quadrature_ratio);
}

static void fill_row(plugin_t *plugin)
{
    const gyro_plugin_estimate *said = plugin->estimate;
    double *row = plugin->row;
    if (lacks_some(said))
        work_out(plugin);
    for (int axis = 0; axis < 2; axis++) {
        double deviation = or_else(said->innovation_deviation_V[axis], plugin->device.noise_V);
        row[ROW_NU + axis] = or_else(said->innovation_V[axis], residual(plugin, axis));
        row[ROW_S + axis] = deviation * deviation;
        if (plugin->sample->lost && isnan(row[ROW_NU + axis]))
            row[ROW_NU + axis] = 0.0; /* nothing was measured, as the core has it */
    }
    row[ROW_ANGLE] = said->angle_rad;
    row[ROW_ANGLE_VARIANCE] = said->angle_u_rad * said->angle_u_rad;
    row[ROW_FORCED] = or_else(said->angle_forced_rad, 0.0);
    row[ROW_PATTERN] = said->angle_pattern_rad;
    row[ROW_PLAIN] = said->angle_plain_rad;
    row[ROW_INTEGRAL] = said->rate_integral_rad;
    row[ROW_ENERGY] = said->energy_ratio;
    row[ROW_QUADRATURE] = said->quadrature_ratio;
}

#endif
