/* Series that remember where another one was. */
#ifndef GYRO_SERIES_H
#define GYRO_SERIES_H

#include <math.h>

#include "layout.h"

/* A series (n,), what is made of it (n,), and at what distance. */
typedef struct {
    whole n;
    const real *given;
    real *out;
    real size;
} Series;

/* The play operator: follows the series at a distance of at most `size` (backlash). */
EXPORTED void gyro_play(const Series *of)
{
    real at = of->n > 0 ? of->given[0] : R(0.0);
    for (whole k = 0; k < of->n; k++)
        of->out[k] = at = fmin(fmax(at, of->given[k] - of->size), of->given[k] + of->size);
}

#endif
