/* Taylor series of the linear motion: exact for it, to an order whose remainder is below rounding (taylor.py). */
#ifndef GYRO_TAYLOR_H
#define GYRO_TAYLOR_H

#include "layout.h"
#include "model.h"
#include "structs.h"

/* The order that an interval of that length asks for, by the longest for each, at most so much. */
static inline whole taylor_terms(const real *longest, real t, whole most)
{
    whole order = 2;
    while (order < most && FABS(t) >= longest[order])
        order++;
    return order;
}

/* Advance the columns of out in place by h under the input polynomial u (axes, terms) in normalised time t/h.

   columns is 1 or all of the model's and more, in fours; term is scratch of out's shape, rows of `stride`.  order is what the
   longest interval asks for: over a shorter one the terms beyond its own are rounding. */
static inline void taylor(whole model, const real *c, const real *u, whole terms, real h, whole order, whole columns,
                          real *term, real *out, whole stride)
{
    whole degree = terms - 1;
    whole enough = taylor_terms(LONGEST, h, order - degree) + degree;
    taylor_columns(model, c, u, terms, h, enough, columns, term, out, stride);
}

#endif
