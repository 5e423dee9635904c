/* Filters that a search for a missing force runs over a record (estimator/missing_force): what they see is linear, as
   the motion at which forces are evaluated is given.  The callers say what each number is. */
#ifndef GYRO_MISSING_FORCE_H
#define GYRO_MISSING_FORCE_H

#include <math.h>

#include "layout.h"

#define MOST_FOLLOWED 5 /* x, v, y, v and the rate */

/* What estimator/missing_force/following.py hands over; s counts the states, m those and, in a plane, the rate. */
typedef struct {
    whole n, axes, s, m;
    const real *transition; /* (s, s) */
    const real *by_rate;    /* (s, s) */
    const real *turning;    /* (n,) */
    const real *added;      /* (n, s) */
    const real *sense;      /* (n, axes) */
    const real *reference;  /* (n, s) */
    const real *seen_noise; /* (axes,) */
    const real *noise;      /* (m, m) */
    const real *start;      /* (m,) */
    const real *spread;     /* (m, m) */
    real *innovation;       /* (n, axes) */
    real *variance;         /* (n, axes, axes) */
    real *gain;             /* (n, m, axes) */
    real *rate;             /* (n,) */
    real *predicted;        /* (n, m, m), scratch as the two below */
    real *states;           /* (n, m) */
    real *transitions;      /* (n, s, m) */
    real rate_variance;
} Force_filter;

/* Rows of the motion in the transition a (s, m) over one sample at a known rate, and what a rate beside it adds. */
static void force_step(
    const real *transition, const real *by_rate, real turning, const real *before, whole s, whole m, real *a)
{
    for (whole i = 0; i < s; i++) {
        for (whole j = 0; j < s; j++)
            a[i * m + j] = transition[i * s + j] + turning * by_rate[i * s + j];
        if (m > s) {
            a[i * m + s] = R(0.0);
            for (whole j = 0; j < s; j++)
                a[i * m + s] += by_rate[i * s + j] * before[j];
        }
    }
}

/* inverse (axes, axes) of a covariance of one channel or two. */
static void invert_small(const real *of, whole axes, real *inverse)
{
    if (axes == 1) {
        inverse[0] = R(1.0) / of[0];
        return;
    }
    real determinant = of[0] * of[3] - of[1] * of[2];
    inverse[0] = of[3] / determinant;
    inverse[1] = -of[1] / determinant;
    inverse[2] = -of[2] / determinant;
    inverse[3] = of[0] / determinant;
}

/* p (m, m) <- a p a' + noise for the full transition a (m, m). */
static void force_propagate(const real *a, const real *noise, whole m, real *p)
{
    real half[MOST_FOLLOWED * MOST_FOLLOWED];
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < m; j++) {
            real total = R(0.0);
            for (whole k = 0; k < m; k++)
                total += a[i * m + k] * p[k * m + j];
            half[i * m + j] = total;
        }
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < m; j++) {
            real total = R(0.0);
            for (whole k = 0; k < m; k++)
                total += half[i * m + k] * a[j * m + k];
            p[i * m + j] = total + noise[i * m + j];
        }
}

/* Predict x and p over the interval that ends at sample k. */
static void force_predict(const Force_filter *f, whole k, real *a, real *x, real *p)
{
    whole s = f->s, m = f->m;
    const real *before = f->reference + (k - 1) * s, *here = f->reference + k * s;
    force_step(f->transition, f->by_rate, f->turning[k], before, s, m, a);
    if (m > s)
        a[s * m + s] = R(1.0);
    for (whole i = 0; i < s * m; i++)
        f->transitions[k * s * m + i] = a[i];
    real moved[MOST_FOLLOWED];
    for (whole i = 0; i < m; i++) {
        moved[i] = R(0.0);
        for (whole j = 0; j < m; j++)
            moved[i] += a[i * m + j] * x[j];
    }
    for (whole i = 0; i < m; i++)
        x[i] = moved[i] + (i < s ? f->added[k * s + i] : R(0.0));
    force_propagate(a, f->noise, m, p);
    if (m > s) { /* Euler: the rate that is known, and the random walk of the rest */
        real change = f->turning[k] - f->turning[k - 1];
        x[1] += here[2] * change;
        x[3] -= here[0] * change;
        const real push[MOST_FOLLOWED] = {R(0.0), here[2], R(0.0), -here[0], R(1.0)};
        for (whole i = 0; i < m; i++)
            for (whole j = 0; j < m; j++)
                p[i * m + j] += f->rate_variance * push[i] * push[j];
    }
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < i; j++) {
            p[i * m + j] = R(0.5) * (p[i * m + j] + p[j * m + i]);
            p[j * m + i] = p[i * m + j];
        }
}

/* Take sample k in; nothing where one of its channels is lost. */
static void force_correct(const Force_filter *f, whole k, real *x, real *p)
{
    whole axes = f->axes, m = f->m;
    real *own = f->variance + k * axes * axes, *gain = f->gain + k * m * axes, *nu = f->innovation + k * axes;
    const real *z = f->sense + k * axes;
    for (whole i = 0; i < axes; i++) {
        for (whole j = 0; j < axes; j++)
            own[i * axes + j] = p[2 * i * m + 2 * j];
        own[i * axes + i] += f->seen_noise[i];
    }
    for (whole i = 0; i < axes; i++)
        if (!isfinite(z[i]))
            return;
    real inverse[4], rows[2 * MOST_FOLLOWED];
    invert_small(own, axes, inverse);
    for (whole i = 0; i < axes; i++)
        nu[i] = z[i] - x[2 * i];
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < axes; j++) {
            real total = R(0.0);
            for (whole b = 0; b < axes; b++)
                total += p[i * m + 2 * b] * inverse[b * axes + j];
            gain[i * axes + j] = total;
        }
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < axes; j++)
            x[i] += gain[i * axes + j] * nu[j];
    for (whole b = 0; b < axes; b++)
        for (whole j = 0; j < m; j++)
            rows[b * m + j] = p[2 * b * m + j];
    for (whole i = 0; i < m; i++)
        for (whole j = 0; j < m; j++) {
            real taken = R(0.0);
            for (whole b = 0; b < axes; b++)
                taken += gain[i * axes + b] * rows[b * m + j];
            p[i * m + j] -= taken;
        }
}

/* rate <- the smoothed one, backwards over what the pass left. */
static void force_smooth_rate(const Force_filter *f)
{
    whole n = f->n, axes = f->axes, s = f->s, m = f->m;
    real adjoint[MOST_FOLLOWED] = {R(0.0)}, back[MOST_FOLLOWED];
    for (whole k = n - 1; k >= 0; k--) {
        for (whole i = 0; i < m; i++)
            back[i] = R(0.0);
        if (k + 1 < n) {
            const real *a = f->transitions + (k + 1) * s * m;
            for (whole i = 0; i < m; i++)
                for (whole j = 0; j < s; j++)
                    back[i] += a[j * m + i] * adjoint[j];
            back[s] += adjoint[s];
        }
        for (whole i = 0; i < m; i++)
            adjoint[i] = back[i];
        const real *nu = f->innovation + k * axes, *gain = f->gain + k * m * axes;
        if (nu[0] != R(0.0) || nu[axes - 1] != R(0.0)) {
            real inverse[4];
            invert_small(f->variance + k * axes * axes, axes, inverse);
            for (whole j = 0; j < axes; j++) {
                real total = R(0.0);
                for (whole b = 0; b < axes; b++)
                    total += inverse[j * axes + b] * nu[b];
                for (whole i = 0; i < m; i++)
                    total -= gain[i * axes + j] * back[i];
                adjoint[2 * j] += total;
            }
        }
        f->rate[k] = f->states[k * m + s];
        for (whole j = 0; j < m; j++)
            f->rate[k] += f->predicted[(k * m + s) * m + j] * adjoint[j];
    }
}

/* Filter the motion and, in a plane, the rate, which is smoothed. */
static void follow_force(const Force_filter *f)
{
    whole n = f->n, s = f->s, m = f->m;
    real x[MOST_FOLLOWED], p[MOST_FOLLOWED * MOST_FOLLOWED], a[MOST_FOLLOWED * MOST_FOLLOWED] = {R(0.0)};
    for (whole i = 0; i < m; i++)
        x[i] = f->start[i];
    for (whole i = 0; i < m * m; i++)
        p[i] = f->spread[i];
    for (whole k = 0; k < n; k++) {
        if (k > 0)
            force_predict(f, k, a, x, p);
        for (whole i = 0; i < m * m; i++)
            f->predicted[k * m * m + i] = p[i];
        for (whole i = 0; i < m; i++)
            f->states[k * m + i] = x[i];
        force_correct(f, k, x, p);
    }
    if (m > s)
        force_smooth_rate(f);
}

/* Forces whose unit coefficients are asked about. */
typedef struct {
    whole columns;
    const real *pushed; /* (n, s, columns) */
    const real *sensed; /* (n, axes, columns) */
    real *scratch;      /* (2 m, columns) */
    real *out;          /* (n, axes, columns), what they make of the innovations */
} Force_columns;

static void force_signatures(const Force_filter *f, const Force_columns *asked)
{
    whole n = f->n, axes = f->axes, s = f->s, m = f->m, columns = asked->columns;
    const real *pushed = asked->pushed, *sensed = asked->sensed;
    real *e = asked->scratch, *moved = e + m * columns, *out = asked->out;
    real a[MOST_FOLLOWED * MOST_FOLLOWED];
    for (whole i = 0; i < m * columns; i++)
        e[i] = R(0.0);
    for (whole k = 0; k < n; k++) {
        if (k > 0) {
            force_step(f->transition, f->by_rate, f->turning[k], f->reference + (k - 1) * s, s, m, a);
            for (whole i = 0; i < s; i++) {
                real *row = moved + i * columns;
                for (whole c = 0; c < columns; c++)
                    row[c] = pushed[(k * s + i) * columns + c];
                for (whole j = 0; j < m; j++)
                    for (whole c = 0; c < columns; c++)
                        row[c] += a[i * m + j] * e[j * columns + c];
            }
            for (whole i = 0; i < s * columns; i++)
                e[i] = moved[i];
        }
        for (whole b = 0; b < axes; b++)
            for (whole c = 0; c < columns; c++)
                out[(k * axes + b) * columns + c] = e[2 * b * columns + c] + sensed[(k * axes + b) * columns + c];
        for (whole i = 0; i < m; i++)
            for (whole b = 0; b < axes; b++) {
                real factor = f->gain[(k * m + i) * axes + b];
                if (factor != R(0.0))
                    for (whole c = 0; c < columns; c++)
                        e[i * columns + c] -= factor * out[(k * axes + b) * columns + c];
            }
    }
}

/* A smoother whose gain has settled, as estimator/missing_force/passes.py hands it over. */
typedef struct {
    whole n, m, s, axes;
    const real *transition; /* (m, m) */
    const real *by_rate;    /* (s, s), its derivative by the rate, of the motion */
    const real *turning;    /* (n,) the rate about which it is not expanded */
    const real *added;      /* (n, s) what is known to push over the interval that ends at each sample */
    const real *sense;      /* (n, axes) */
    const real *seen;       /* (axes, m) */
    const real *gain;       /* (m, axes) */
    const real *start;      /* (m,) the prediction of the first sample */
    const real *weight;     /* (axes, axes) the inverse of the innovation's covariance */
    const real *covariance; /* (m, m) of the prediction */
    real *states;           /* (n, m) predicted, then smoothed */
    real *innovation;       /* (n, axes), 0 where a sample is lost */
    real *scratch;          /* (2 m,) */
} Settled;

static void settled_forward(const Settled *f)
{
    whole n = f->n, m = f->m, s = f->s, axes = f->axes;
    real *x = f->scratch, *y = f->scratch + m;
    for (whole i = 0; i < m; i++)
        x[i] = f->start[i];
    for (whole k = 0; k < n; k++) {
        real *nu = f->innovation + k * axes;
        for (whole i = 0; i < m; i++)
            f->states[k * m + i] = x[i];
        for (whole a = 0; a < axes; a++) {
            real value = f->sense[k * axes + a], left = R(0.0);
            if (isfinite(value)) {
                left = value;
                for (whole i = 0; i < m; i++)
                    left -= f->seen[a * m + i] * x[i];
            }
            nu[a] = left;
        }
        for (whole i = 0; i < m; i++)
            for (whole a = 0; a < axes; a++)
                x[i] += f->gain[i * axes + a] * nu[a];
        if (k + 1 == n)
            break;
        for (whole i = 0; i < m; i++) {
            real total = R(0.0);
            for (whole j = 0; j < m; j++)
                total += f->transition[i * m + j] * x[j];
            y[i] = total;
        }
        for (whole i = 0; i < s; i++) {
            real total = f->added[(k + 1) * s + i];
            for (whole j = 0; j < s; j++)
                total += f->turning[k + 1] * f->by_rate[i * s + j] * x[j];
            y[i] += total;
        }
        for (whole i = 0; i < m; i++)
            x[i] = y[i];
    }
}

/* Turn predicted states into smoothed ones, in place (Bryson and Frazier). */
static void settled_backward(const Settled *f)
{
    whole n = f->n, m = f->m, s = f->s, axes = f->axes;
    real *adjoint = f->scratch, *back = f->scratch + m, known[2] = {R(0.0), R(0.0)};
    for (whole i = 0; i < m; i++)
        adjoint[i] = R(0.0);
    for (whole k = n - 1; k >= 0; k--) {
        const real *nu = f->innovation + k * axes;
        for (whole i = 0; i < m; i++) {
            back[i] = R(0.0);
            for (whole j = 0; k + 1 < n && j < m; j++)
                back[i] += f->transition[j * m + i] * adjoint[j];
            for (whole j = 0; k + 1 < n && i < s && j < s; j++)
                back[i] += f->turning[k + 1] * f->by_rate[j * s + i] * adjoint[j];
        }
        for (whole i = 0; i < m; i++)
            adjoint[i] = back[i];
        if (nu[0] != R(0.0) || nu[axes - 1] != R(0.0)) {
            for (whole a = 0; a < axes; a++) {
                known[a] = R(0.0);
                for (whole b = 0; b < axes; b++)
                    known[a] += f->weight[a * axes + b] * nu[b];
                for (whole j = 0; j < m; j++)
                    known[a] -= f->gain[j * axes + a] * back[j];
            }
            for (whole i = 0; i < m; i++)
                for (whole a = 0; a < axes; a++)
                    adjoint[i] += f->seen[a * m + i] * known[a];
        }
        for (whole i = 0; i < m; i++) {
            real total = R(0.0);
            for (whole j = 0; j < m; j++)
                total += f->covariance[i * m + j] * adjoint[j];
            f->states[k * m + i] += total;
        }
    }
}

#endif
