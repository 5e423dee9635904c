/* Which matrix a SENSE of gain mode may name: hil/running/loop/gain.py tells it in words.

   The k-th matrix since the start, from 0, is called k % 255 + 1. */

#ifndef TURN_MATRICES_H
#define TURN_MATRICES_H

#include "structs.h"

#define NAMES 255 /* 1 to 255, given again and again */

static int64_t next_name(const matrices_t *matrices)
{
    return matrices->count % NAMES + 1;
}

/* The next one has left; there is room for it. */
EXPORT void matrices_sent(matrices_t *matrices, int64_t effective_tick)
{
    matrices->effective[matrices->count++] = effective_tick;
}

/* The board was armed again: it has forgotten what was sent before. */
EXPORT void matrices_forget(matrices_t *matrices)
{
    matrices->armed = matrices->count;
    matrices->in_force = NONE;
    matrices->odd = MATRIX_FINE;
}

/* SENSE with rows from tick `first` to `last` names a matrix; what is wrong with one a block before. The block in which
   a board stops by itself names none, and STATUS may come after it: so what cannot be is held against the board only
   with the next block. */
EXPORT int64_t matrices_named(matrices_t *matrices, int64_t name, int64_t first, int64_t last)
{
    if (matrices->odd != MATRIX_FINE)
        return last >= matrices->odd_tick + matrices->block ? matrices->odd : MATRIX_FINE;
    int64_t begin = matrices->in_force == NONE ? matrices->armed : matrices->in_force;
    int64_t k = begin + ((name - 1 - begin) % NAMES + NAMES) % NAMES;
    int64_t end = last > first + matrices->block - 1 ? last : first + matrices->block - 1;
    if (name == 0) {
        if (matrices->in_force == NONE)
            return MATRIX_FINE;
        matrices->odd = MATRIX_NONE;
    } else if (k >= matrices->count) {
        matrices->odd = MATRIX_UNSENT;
    } else if (matrices->effective[k] > end) {
        matrices->odd = MATRIX_EARLY;
        matrices->odd_effective = matrices->effective[k];
    } else {
        matrices->in_force = k;
        return MATRIX_FINE;
    }
    matrices->odd_tick = last;
    matrices->odd_name = name;
    matrices->odd_begin = begin;
    matrices->odd_count = matrices->count;
    return MATRIX_FINE;
}

#endif
