/* Four numbers side by side, as a processor's vector registers hold them; without such registers, one after another. */
#ifndef GYRO_LANES_H
#define GYRO_LANES_H

#include "layout.h"

#if defined(__GNUC__) && !defined(CORE_FLOAT32)

typedef real four __attribute__((vector_size(4 * sizeof(real))));

static inline four take4(const real *from)
{
    four lanes;
    memcpy(&lanes, from, sizeof lanes); /* a move, aligned or not */
    return lanes;
}

static inline void put4(real *to, four lanes)
{
    memcpy(to, &lanes, sizeof lanes);
}

static inline four add4(four a, four b)
{
    return a + b;
}

static inline four sub4(four a, four b)
{
    return a - b;
}

static inline four scale4(real factor, four a)
{
    return factor * a;
}

static inline four four_of(real a, real b, real c, real d)
{
    return (four){a, b, c, d};
}

#else

typedef struct {
    real lane[4];
} four;

static inline four take4(const real *from)
{
    return (four){{from[0], from[1], from[2], from[3]}};
}

static inline void put4(real *to, four a)
{
    for (int k = 0; k < 4; k++)
        to[k] = a.lane[k];
}

static inline four add4(four a, four b)
{
    return (four){{a.lane[0] + b.lane[0], a.lane[1] + b.lane[1], a.lane[2] + b.lane[2], a.lane[3] + b.lane[3]}};
}

static inline four sub4(four a, four b)
{
    return (four){{a.lane[0] - b.lane[0], a.lane[1] - b.lane[1], a.lane[2] - b.lane[2], a.lane[3] - b.lane[3]}};
}

static inline four scale4(real factor, four a)
{
    return (four){{factor * a.lane[0], factor * a.lane[1], factor * a.lane[2], factor * a.lane[3]}};
}

static inline four four_of(real a, real b, real c, real d)
{
    return (four){{a, b, c, d}};
}

#endif

/* Four rows of `to`, so far from one another, <- the lanes. */
static inline void put_rows4(real *to, whole stride, four a, four b, four c, four d)
{
    put4(to, a);
    put4(to + stride, b);
    put4(to + 2 * stride, c);
    put4(to + 3 * stride, d);
}

/* to (4, 4) <- the lanes as columns. */
static inline void put_columns4(real *to, four a, four b, four c, four d)
{
    real rows[16];
    put_rows4(rows, 4, a, b, c, d);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            to[4 * i + j] = rows[4 * j + i];
}

#endif
