/* What hidden effects do to the mass and its suspension, and how their own states move.
   Their equations stand in device_emulator/effects/force.py. */
#ifndef EMULATOR_FORCE_H
#define EMULATOR_FORCE_H

#include "rate.h"
#include "sense.h"

#define PI (0.5 * TWO_PI)

/* The package along one axis: its acceleration; s, ds: displacement, velocity and bristle.
   Friction after Canudas de Wit, Olsson, Åström & Lischinsky, IEEE Trans. Autom. Control 40(3), 1995. Bristles bend
   over Fc/s; slip that covers more than that in one sub-step is beyond the integrator. */
static inline double support(const double *c, double reaction, const double *s, double *ds)
{
    double ratio = c[0], frequency = c[1], at_rest = c[2], coulomb = c[3], stribeck = c[4], bristle = c[5];
    double v = s[1], z = s[2];
    double slip = v / stribeck;
    double g = coulomb + (at_rest - coulomb) * exp(-slip * slip);
    double dz = v - bristle * fabs(v) * z / g;
    double w = 2.0 * PI * frequency;
    double a = ratio * reaction - w * w * s[0] - bristle * z - sqrt(bristle) * dz;
    ds[0] = v;
    ds[1] = a;
    ds[2] = dz;
    return a;
}

/* Add to ds, the derivative of s = [x, ẋ, y, ẏ, …], what the effects add, and enter that of their own states;
   ux, uy reach the mass. */
static inline void add_effects(const plant_t *plant, effects_t effects, double t_s, double warmer_K, turn_t turn,
                               double ux, double uy, const double *s, double *ds)
{
    double x = s[0], vx = s[1], y = s[2], vy = s[3];
    double ax = 0.0, ay = 0.0;
    for (int64_t n = 0; n < effects.count; n++) {
        const double *c = effects.first[n].c;
        int64_t at = effects.first[n].at;
        double r2 = x * x + y * y;
        switch (effects.first[n].kind) {
        case CUBIC_STIFFNESS:
            ax -= c[0] * x * x * x;
            ay -= c[1] * y * y * y;
            break;
        case CUBIC_ISOTROPIC:
            ax -= c[0] * r2 * x;
            ay -= c[0] * r2 * y;
            break;
        case QUINTIC_STIFFNESS:
            ax -= c[0] * x * x * x * x * x;
            ay -= c[1] * y * y * y * y * y;
            break;
        case QUINTIC_ISOTROPIC:
            ax -= c[0] * r2 * r2 * x;
            ay -= c[0] * r2 * r2 * y;
            break;
        case QUADRATIC_STIFFNESS:
            ax -= c[0] * x * x;
            ay -= c[1] * y * y;
            break;
        case NONLINEAR_DAMPING:
            ax -= c[0] * x * x * vx;
            ay -= c[1] * y * y * vy;
            break;
        case DRY_FRICTION:
        case DRY_FRICTION_ASYMMETRIC: {
            double tx = tanh(vx / c[2]), ty = tanh(vy / c[2]);
            ax -= c[0] * (tx + c[3] * tx * tx);
            ay -= c[1] * (ty + c[4] * ty * ty);
            break;
        }
        case STRIBECK_FRICTION: {
            double slip_x = vx / c[3], slip_y = vy / c[3];
            ax -= c[0] * tanh(vx / c[2]) * exp(-slip_x * slip_x);
            ay -= c[1] * tanh(vy / c[2]) * exp(-slip_y * slip_y);
            break;
        }
        case DRAG:
            ax -= c[0] * fabs(vx) * vx;
            ay -= c[1] * fabs(vy) * vy;
            break;
        case CUBIC_DAMPING:
            ax -= c[0] * vx * vx * vx;
            ay -= c[1] * vy * vy * vy;
            break;
        case DAMPING_ASYMMETRIC:
            ax -= c[0] * fabs(vx);
            ay -= c[1] * fabs(vy);
            break;
        case NONLINEAR_DAMPING_RADIAL:
            ax -= c[0] * r2 * vx;
            ay -= c[0] * r2 * vy;
            break;
        case DRAG_RADIAL: {
            double loss = c[0] * sqrt(vx * vx + vy * vy);
            ax -= loss * vx;
            ay -= loss * vy;
            break;
        }
        case CUBIC_DAMPING_RADIAL: {
            double speed = sqrt(vx * vx + vy * vy);
            double loss = c[0] * speed * speed;
            ax -= loss * vx;
            ay -= loss * vy;
            break;
        }
        case DRY_FRICTION_RADIAL: {
            double loss = c[0] / hypot(sqrt(vx * vx + vy * vy), c[1]);
            ax -= loss * vx;
            ay -= loss * vy;
            break;
        }
        case CONSTANT_FORCE:
            ax += c[0];
            ay += c[1];
            break;
        case BASE_VIBRATION: {
            double phase = 2.0 * PI * c[2] * t_s;
            ax += c[0] * sin(phase + c[3]);
            ay += c[1] * sin(phase + c[4]);
            break;
        }
        case NONRECIPROCAL_STIFFNESS:
            ax -= c[0] * y;
            ay += c[0] * x;
            break;
        case ANGULAR_GAIN:
            ax += c[0] * (2.0 * turn.rate_rad_s * vy + turn.slope_rad_s2 * y);
            ay -= c[0] * (2.0 * turn.rate_rad_s * vx + turn.slope_rad_s2 * x);
            break;
        case TEMPERATURE_STIFFNESS:
        case PARAMETRIC_STIFFNESS: {
            double more = effects.first[n].kind == TEMPERATURE_STIFFNESS
                              ? c[0] * warmer_K
                              : c[0] * sin(2.0 * PI * c[1] * t_s + c[2]);
            ax -= more * (plant->kxx * x + plant->kxy * y);
            ay -= more * (plant->kxy * x + plant->kyy * y);
            break;
        }
        case TEMPERATURE_DAMPING:
            ax -= c[0] * warmer_K * (plant->dxx * vx + plant->dxy * vy);
            ay -= c[0] * warmer_K * (plant->dxy * vx + plant->dyy * vy);
            break;
        case BACKLASH:
            ax -= c[0] * (x - within(x, c[2]));
            ay -= c[1] * (y - within(y, c[2]));
            break;
        case HYSTERETIC_STIFFNESS:
            ax -= c[0] * s[at];
            ay -= c[1] * s[at + 1];
            ds[at] = vx - (fabs(vx) * s[at] + vx * fabs(s[at])) / (2.0 * c[2]);
            ds[at + 1] = vy - (fabs(vy) * s[at + 1] + vy * fabs(s[at + 1])) / (2.0 * c[2]);
            break;
        case PLAY:
            ax -= c[0] * (x - s[at]);
            ay -= c[1] * (y - s[at + 2]);
            ds[at] = s[at + 1] != 0.0 ? vx : 0.0;
            ds[at + 1] = 0.0;
            ds[at + 2] = s[at + 3] != 0.0 ? vy : 0.0;
            ds[at + 3] = 0.0;
            break;
        case STICK_SLIP_SUPPORT: {
            double rx = plant->kxx * x + plant->kxy * y + plant->dxx * vx + plant->dxy * vy - ux;
            double ry = plant->kxy * x + plant->kyy * y + plant->dxy * vx + plant->dyy * vy - uy;
            ax -= support(c, rx, s + at, ds + at);
            ay -= support(c, ry, s + at + 3, ds + at + 3);
            break;
        }
        case NONLINEAR_COUPLING:
            ax -= 3.0 * c[0] * x * x * y;
            ay -= c[0] * x * x * x;
            break;
        case UNEQUAL_MASSES: {
            /* ÿ (1 + m) = the force on y, so that what is added is what the heavier mass leaves of it. */
            double pushed = uy - plant->kxy * x - plant->kyy * y - plant->dxy * vx - plant->dyy * vy;
            pushed -= 2.0 * turn.rate_rad_s * vx + turn.slope_rad_s2 * x;
            ay += pushed * (1.0 / (1.0 + c[0]) - 1.0);
            break;
        }
        case PARASITIC_MODE: {
            double w = 2.0 * PI * c[0];
            ds[at] = s[at + 1];
            ds[at + 1] = c[2] * ux - 2.0 * c[1] * w * s[at + 1] - w * w * s[at];
            ds[at + 2] = s[at + 3];
            ds[at + 3] = c[3] * uy - 2.0 * c[1] * w * s[at + 3] - w * w * s[at + 2];
            break;
        }
        case FREE_MODE:
            for (int axis = 0; axis < 2; axis++) {
                int64_t own = at + 2 * axis;
                ds[own] = s[own + 1];
                ds[own + 1] = -c[1] * s[own + 1] - (c[0] * c[0] + 0.25 * c[1] * c[1]) * s[own];
            }
            break;
        case TELEGRAPH_OFFSET:
            ds[at] = 0.0;
            ds[at + 1] = 0.0;
            break;
        default: /* acts elsewhere */
            break;
        }
    }
    ds[1] += ax;
    ds[3] += ay;
}

/* What y is accelerated by a force per unit mass of x: 1 where both axes move one mass. */
static inline double lightness(effects_t effects)
{
    double share = 1.0;
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == UNEQUAL_MASSES)
            share /= 1.0 + effects.first[n].c[0];
    return share;
}

/* How strongly the mass feels the rate: 1 and what the effects add. */
static inline double coriolis(effects_t effects)
{
    double gain = 1.0;
    for (int64_t n = 0; n < effects.count; n++)
        if (effects.first[n].kind == ANGULAR_GAIN)
            gain += effects.first[n].c[0];
    return gain;
}

#endif
