/* The rate profile and the temperature at a time (device_emulator/rate.py, device_emulator/temperature.py). */
#ifndef EMULATOR_RATE_H
#define EMULATOR_RATE_H

#include <math.h>

#include "structs.h"

typedef struct {
    double rate_rad_s, slope_rad_s2;
} turn_t;

static inline turn_t rate_at(const piece_t *piece, double t_s)
{
    double tau = t_s - piece->start_s;
    turn_t turn = {piece->rate_rad_s + piece->slope_rad_s2 * tau, piece->slope_rad_s2};
    if (piece->amplitude_rad_s != 0.0) {
        double phase = piece->frequency_rad_s * tau + piece->phase_rad;
        turn.rate_rad_s += piece->amplitude_rad_s * sin(phase);
        turn.slope_rad_s2 += piece->amplitude_rad_s * piece->frequency_rad_s * cos(phase);
    }
    return turn;
}

/* ∫Ω dt in rad from t = 0 to t_s, which lies in `piece`. */
static inline double angle_at(const piece_t *piece, double t_s)
{
    double tau = t_s - piece->start_s;
    double angle = piece->angle_rad + (piece->rate_rad_s + 0.5 * piece->slope_rad_s2 * tau) * tau;
    if (piece->amplitude_rad_s != 0.0) {
        double phase = piece->frequency_rad_s * tau + piece->phase_rad;
        angle += piece->amplitude_rad_s / piece->frequency_rad_s * (cos(piece->phase_rad) - cos(phase));
    }
    return angle;
}

/* Kelvin above the temperature of the start. */
static inline double warmer(const temperature_t *profile, double t_s)
{
    if (profile->warm_up_K == 0.0 && profile->swing_K == 0.0)
        return 0.0;
    double warm = -profile->warm_up_K * expm1(-t_s / profile->time_constant_s);
    return warm + profile->swing_K * sin(profile->frequency_rad_s * t_s);
}

#endif
