/* A drive over an interval: a polynomial in the interval's normalised time for each axis, (axes, terms). */
#ifndef GYRO_POLYNOMIAL_H
#define GYRO_POLYNOMIAL_H

#include "layout.h"

static inline real power_of(real base, whole exponent)
{
    real value = R(1.0);
    for (whole k = 0; k < exponent; k++)
        value *= base;
    return value;
}

/* out (axes,) <- the polynomial u (axes, terms) at normalised time `at`. */
static inline void drive_at(const real *u, whole axes, whole terms, real at, real *out)
{
    for (whole axis = 0; axis < axes; axis++) {
        real value = R(0.0);
        for (whole n = terms - 1; n >= 0; n--)
            value = value * at + u[axis * terms + n];
        out[axis] = value;
    }
}

/* out (axes, terms) <- the polynomial u over [start, start + length] of its normalised time, in the normalised time of
   that part. */
static inline void part_of(const real *u, whole axes, whole terms, real start, real length, real *out)
{
    for (whole axis = 0; axis < axes; axis++) {
        for (whole n = 0; n < terms; n++) {
            real binomial = R(1.0), value = R(0.0), scale = power_of(length, n);
            for (whole k = n; k < terms; k++) {
                value += u[axis * terms + k] * binomial * power_of(start, k - n) * scale;
                binomial *= ((real)k + R(1.0)) / ((real)k + R(1.0) - (real)n);
            }
            out[axis * terms + n] = value;
        }
    }
}

#endif
