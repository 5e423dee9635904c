/* Series that remember where another one was: slips, ramps, play, and the path between two levels. */
#ifndef GYRO_SERIES_H
#define GYRO_SERIES_H

#include <math.h>

#include "layout.h"

/* A series and what is made of it; what `size` and `count` are, each function says. */
typedef struct {
    whole n;
    whole count;
    const real *given;  /* (n,) */
    const real *shares; /* (count,) */
    real *out;          /* (n,) or (n, count) */
    real size;
} Series;

static real sign_of(real value)
{
    return value > R(0.0) ? R(1.0) : value < R(0.0) ? R(-1.0) : value;
}

static real clipped(real value, real low, real high)
{
    return fmin(fmax(value, low), high);
}

/* A spring that slips along the series: all at once at its reach, `size` (Prandtl), or, with count 1, more and more
   towards it and, unloaded, not at all (Bouc and Wen, exponent 1). */
static void slip_along(const Series *of)
{
    real z = R(0.0), reach = of->size;
    for (whole k = 1; k < of->n; k++) {
        real moved = of->given[k] - of->given[k - 1];
        if (of->count == 0) {
            z = clipped(z + moved, -reach, reach);
        } else if (moved * z < R(0.0)) {
            real rest = moved + z;
            z = rest * moved <= R(0.0) ? rest : sign_of(rest) * reach * (R(1.0) - exp(-fabs(rest) / reach));
        } else if (moved != R(0.0)) {
            z = sign_of(moved) * (reach - (reach - fabs(z)) * exp(-fabs(moved) / reach));
        }
        of->out[k] = z;
    }
}

/* What a drive that changes by no more than `size` in an interval is behind the one that is asked, at shares of each
   interval: it ramps towards it from where it was, and stays. */
static void ramp_behind(const Series *of)
{
    real reached = of->n > 0 ? of->given[0] : R(0.0);
    for (whole k = 0; k < of->n; k++) {
        real far = of->given[k] - reached, sign = sign_of(far);
        for (whole j = 0; j < of->count; j++)
            of->out[k * of->count + j] = sign * (fmin(fabs(far), of->size * of->shares[j]) - fabs(far));
        reached += sign * fmin(fabs(far), of->size);
    }
}

/* The play operator: follows the series at a distance of at most `size` (backlash). */
static void play_behind(const Series *of)
{
    real at = of->n > 0 ? of->given[0] : R(0.0);
    for (whole k = 0; k < of->n; k++)
        of->out[k] = at = clipped(at, of->given[k] - of->size, of->given[k] + of->size);
}

/* Two levels, and a series that is on one or the other. */
typedef struct {
    whole n;
    const real *values;
    const uint8_t *there; /* (n,) */
    int8_t (*came)[2];    /* (n, 2), scratch */
    whole *path;          /* (n,), 0 and 1 */
    real low;
    real high;
    real variance;
    real often; /* the probability of a change from one sample to the next */
} Levels;

/* The likeliest path through the values that are there (Viterbi). */
static void likeliest_path(const Levels *of)
{
    real stay = log(R(1.0) - of->often), change = log(of->often), a = R(0.0), b = R(0.0);
    for (whole k = 0; k < of->n; k++) {
        of->came[k][0] = of->came[k][1] = 0;
        if (k > 0) {
            real to_a = a + stay, to_b = b + stay;
            if (b + change > to_a) {
                to_a = b + change;
                of->came[k][0] = 1;
            }
            if (a + change > to_b)
                to_b = a + change;
            else
                of->came[k][1] = 1;
            a = to_a;
            b = to_b;
        }
        if (of->there[k]) {
            real under = of->values[k] - of->low, over = of->values[k] - of->high;
            a -= under * under / (R(2.0) * of->variance);
            b -= over * over / (R(2.0) * of->variance);
        }
    }
    of->path[of->n - 1] = b > a;
    for (whole k = of->n - 1; k > 0; k--)
        of->path[k - 1] = of->came[k][of->path[k]];
}

#endif
