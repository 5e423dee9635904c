/* The signals that effects depend on beside state and drive, advanced from sample to sample. */
#ifndef GYRO_SIGNALS_H
#define GYRO_SIGNALS_H

#include "layout.h"

/* Numbers of estimator.effects.declaration.Source. */
enum source {
    PARAMETER = 0,
    COSINE = 1,
    SINE = 2,
    TEMPERATURE = 3,
    INTEGRAL = 4,
    RESONATOR = 5,
    DIRECTION = 6,
    DECAY = 7,
    LAG = 8,
    WANE = 9,
    TIME = 10,
    SLIP = 11,
    STOP = 12
};

#define SHARE_TERMS 25

/* A phase as sine and cosine take it: single precision would lose it after some turns. */
static inline real turned(double phase)
{
#ifdef CORE_FLOAT32
    return (real)fmod(phase, 2.0 * 3.14159265358979323846);
#else
    return phase;
#endif
}

/* Write those of the first `count` signals that are functions of time into w (signals,). */
static inline void line_values(const Settings *settings, whole count, double time, real *w)
{
    for (whole i = 0; i < count; i++) {
        const real *parameters = settings->signal_parameters[i];
        switch (settings->signals[i][0]) {
        case COSINE:
            w[i] = COS(turned((double)parameters[0] * time));
            break;
        case SINE:
            w[i] = SIN(turned((double)parameters[0] * time));
            break;
        case DECAY:
            w[i] = EXP((real)((double)-parameters[settings->signals[i][1]] * time));
            break;
        case TIME:
            w[i] = (real)time;
            break;
        default:
            break;
        }
    }
}

/* Whether a signal is the direction in which an axis of the device moves. */
static inline int turns_over(const Settings *settings, whole i)
{
    return settings->signals[i][0] == DIRECTION && settings->signals[i][1] < settings->axes;
}

/* Write the directions of motion of state s, smooth through rest, of the first `count` signals into w (2 MAX_SIGNALS,), and into its second half
   their derivatives by the velocity. */
static inline void directions(const Settings *settings, whole count, const real *s, real *w)
{
    for (whole i = 0; i < count; i++) {
        if (!turns_over(settings, i))
            continue;
        real rest = settings->signal_parameters[i][0];
        w[i] = TANH(s[2 * settings->signals[i][1] + 1] / rest);
        w[MAX_SIGNALS + i] = (R(1.0) - w[i] * w[i]) / rest;
    }
}

/* Write all signals as they stand in memory, and those of `time`, into w (signals,). */
static inline void signal_values(const Settings *settings, const Memory *memory, double time, real *w)
{
    for (whole i = 0; i < settings->signal_count; i++) {
        whole source = settings->signals[i][0];
        if (source == PARAMETER)
            w[i] = settings->signal_parameters[i][0];
        else if (source == TEMPERATURE)
            w[i] = memory->temperature;
        else
            w[i] = memory->signals[i][0];
    }
    line_values(settings, settings->signal_count, time, w);
}

/* What a first-order lag makes of the drive u (terms,) of an axis over one interval, exactly; share: its time constant
   over the interval.

   Behind the lag, a polynomial is itself less its derivatives in turn, times the time constant; what the start departs
   from that decays. */
static inline real lagged(real value, const real *u, whole terms, real share)
{
    real first = R(0.0), last = R(0.0), at_first = R(1.0), at_last = R(1.0);
    if (!(share > R(0.0))) { /* none, or a lead, which has no such answer */
        for (whole n = 0; n < terms; n++)
            last += u[n];
        return last;
    }
    for (whole n = 0; n < terms; n++) {
        if (n > 0) {
            at_first *= -share * (real)n;
            at_last = R(1.0) - share * (real)n * at_last;
        }
        first += u[n] * at_first;
        last += u[n] * at_last;
    }
    return last + (value - first) * EXP(R(-1.0) / share);
}

/* The integral q of q' = u - rate q, of the drive u (terms,) of an axis, over an interval, exactly.

   The integral of s^n e^(-z(1-s)) over 0..1 is the sum of (-z)^k n!/(n + k + 1)!, and (1 - n times that of one degree
   less)/z. */
static inline real leaking(real value, const real *u, whole terms, real rate, real h)
{
    real z = rate * h, total = R(0.0);
    real share = z > R(0.0) ? -EXPM1(-z) / z : R(1.0);
    for (whole n = 0; n < terms; n++) {
        if (z > R(2.0)) {
            share = n == 0 ? share : (R(1.0) - (real)n * share) / z;
        } else {
            real term = R(1.0) / ((real)n + R(1.0));
            share = term;
            for (int k = 0; k < SHARE_TERMS; k++) {
                term *= -z / ((real)n + (real)k + R(2.0));
                share += term;
                if (FABS(term) < R(1e-17))
                    break;
            }
        }
        total += u[n] * share;
    }
    return value * EXP(-z) + h * total;
}

/* A resonator's displacement and velocity, signal (2,), over an interval under a force that is held: the mean of u. */
static inline void ring(const real *parameters, const real *u, whole terms, real h, real *signal)
{
    real mean = R(0.0);
    for (whole n = 0; n < terms; n++)
        mean += u[n] / ((real)n + R(1.0));
    real omega = parameters[0], decay = parameters[1] * omega;
    real ringing = SQRT(omega * omega - decay * decay);
    real rest = mean / (omega * omega);
    real p = signal[0] - rest, v = signal[1];
    real cosine = COS(ringing * h), sine = SIN(ringing * h) / ringing, fade = EXP(-decay * h);
    signal[0] = rest + fade * (p * cosine + (v + decay * p) * sine);
    signal[1] = fade * (v * cosine - (decay * v + omega * omega * p) * sine);
}

/* Carry the signals' recursions in memory over an interval h under the drive u (axes, terms); c: the constants.
   memory->time is that of its beginning. */
static inline void advance_signals(const Settings *settings, Memory *memory, const real *c, const real *u, whole terms,
                                   real h)
{
    for (whole i = 0; i < settings->signal_count; i++) {
        whole axis = settings->signals[i][1];
        const real *parameters = settings->signal_parameters[i];
        real *signal = memory->signals[i];
        if (axis >= settings->axes)
            continue;
        const real *of_axis = u + axis * terms;
        switch (settings->signals[i][0]) {
        case INTEGRAL:
            signal[0] = leaking(signal[0], of_axis, terms, parameters[0], h);
            break;
        case LAG:
            signal[0] = lagged(signal[0], of_axis, terms, c[settings->signals[i][2]] / h);
            break;
        case WANE: {
            real lag = c[settings->signals[i][2]];
            signal[0] = lag > R(0.0) ? EXP((real)(-(memory->time + (double)h) / (double)lag)) : R(0.0);
            break;
        }
        case RESONATOR:
            ring(parameters, of_axis, terms, h, signal);
            break;
        default:
            break;
        }
    }
}

#endif
