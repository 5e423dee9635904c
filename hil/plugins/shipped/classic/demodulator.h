/* In-phase and quadrature components of a sense channel against the phase of the oscillator that is locked to it.

   Multiplied and low-passed, with what is known of both components and of the offset taken off first, so that nothing
   is left at twice the frequency (Widrow et al., Proc. IEEE 63(12), 1975). Seen from the components it is a low-pass of
   one pole. */

#ifndef CLASSIC_DEMODULATOR_H
#define CLASSIC_DEMODULATOR_H

#include <complex.h>
#include <math.h>

/* Of one channel: cosine + i sine, and the offset, V. */
typedef struct {
    double complex parts;
    double offset;
} channel;

/* Take a sample in; returns what it has beside the components, V. */
static double demodulate(channel *now, double volts, double cosine, double sine, double share)
{
    double left = volts - (creal(now->parts) * cosine + cimag(now->parts) * sine + now->offset);
    now->parts += 2.0 * share * left * (cosine + sine * I);
    now->offset += 0.5 * share * left;
    return left;
}

#endif
