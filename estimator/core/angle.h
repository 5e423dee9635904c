/* The rotation angle from sample to sample: what the pattern shows, less what forces turned it by. */
#ifndef GYRO_ANGLE_H
#define GYRO_ANGLE_H

#include "layout.h"
#include "pattern.h"

/* Add to memory->forced what the model says the forces, rather than the rotation of the board, turned the pattern by.

   x is the prediction from the last estimate through the drive that really acted.  In an ideal oscillator it would have
   turned by -rate h; the rest is virtual rotation, dither, holds, rounding, a drive held over a late answer.  It is read
   in the frame of that drive: where the virtual rotation reverses, the same motion is another ellipse at once. */
static void note_forced_rotation(const Settings *settings, Memory *memory, const real *x, real h)
{
    if (memory->started == 1) {
        Pattern now = pattern(x, settings->stiffness, memory->rate + memory->virtual_applied, memory->rate);
        memory->forced += unwrap_half_turns(now.twice, memory->theta) - memory->theta + (double)(memory->rate * h);
    }
}

/* Angle, energy and quadrature of the estimate at the end of h into an output row; unwraps and counts turns.  All
   rotations go out as the board's: divided by the angular gain.

   The pattern lags the board: its angle less what forces turned it by is minus the board's.  Taking off the virtual
   rotation alone, as an ideal control would allow, is kept as angle_pattern. */
static void read_angle(const Settings *settings, Memory *memory, const real *x, real h, Output *row)
{
    real rate = x[settings->states + RATE];
    memory->rate_integral += (double)(rate * h);
    memory->virtual_integral += (double)(memory->virtual_applied * h);
    real w = rate + memory->virtual_applied;
    Pattern now = pattern(x, settings->stiffness, w, rate);
    real plain = pattern(x, settings->stiffness, R(0.0), R(0.0)).twice;
    if (memory->started == 0) {
        memory->started = 1;
        memory->theta = (double)(R(0.5) * now.twice);
        memory->theta_zero = memory->theta;
        memory->theta_plain = unwrap_half_turns(plain, memory->theta);
        memory->theta_plain_zero = memory->theta_plain;
        memory->virtual_integral = 0.0;
        memory->rate_integral = 0.0;
    } else {
        memory->theta = unwrap_half_turns(now.twice, memory->theta);
        memory->theta_plain = unwrap_half_turns(plain, memory->theta_plain);
    }
    memory->rotation = w;
    memory->rate = rate;
    double turns = 1.0 / (double)settings->angular_gain;
    row->angle = turns * (memory->theta_zero - memory->theta + memory->forced);
    if (settings->open_loop == 1)
        row->angle = turns * memory->rate_integral;
    row->angle_forced = -turns * memory->forced;
    row->angle_pattern = turns * (memory->theta_zero - memory->theta - memory->virtual_integral);
    row->angle_plain = turns * (memory->theta_plain_zero - memory->theta_plain - memory->virtual_integral);
    row->angle_rate_integral = turns * memory->rate_integral;
    row->energy_ratio = now.energy / settings->energy;
    row->quadrature_ratio = now.energy > R(0.0) ? SQRT(settings->stiffness) * now.momentum / now.energy : R(0.0);
}

#endif
