/* Effects that were not there when the core was compiled: their number is the address of their function, which is
   compiled by itself (estimator/custom). */
#ifndef GYRO_OWN_H
#define GYRO_OWN_H

#include "layout.h"

#define LEAST_ADDRESS 4096 /* no address is below it, and no number of the catalogue beyond */

enum { OWN_FORCE, OWN_SENSE };

/* Adds what the effect does to force or sense: c constants, s states, u drive, w signals, first the index of its first
   coefficient among the constants, signal that of its first signal; what to add to: values, derivatives by states and by
   constants, rows of so many numbers. */
typedef void OwnEffect(whole what, const real *c, const real *s, const real *u, real *w, whole first, whole signal,
                       real *value, real *by_states, whole states_row, real *by_constants, whole constants_row);

static inline int is_own(whole effect)
{
    return effect >= LEAST_ADDRESS;
}

static inline OwnEffect *own_effect(whole address)
{
    intptr_t number = (intptr_t)address;
    OwnEffect *function;
    memcpy(&function, &number, sizeof function); /* the cast that ISO C leaves out */
    return function;
}

#endif
