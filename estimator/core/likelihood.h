/* The likelihood of a record under a filter, with its score and information, by part of the record: one pass.

   Rows of the equations (scan.h) are multiplied out while they are in the cache, and never stand in memory together. */
#ifndef GYRO_LIKELIHOOD_H
#define GYRO_LIKELIHOOD_H

#include "gram.h"
#include "scan.h"

/* A record of n samples in parts, of which the samples begin to end are gone through by one call; the next goes on there.

   Columns of a row: `count` sensitivities as in a scan, the innovation, then one for each model that is `shifted`: by how
   much its own innovation is larger, over the shift.  gram receives their products of each part, blocks below the diagonal
   not filled; logs the sum of the logarithms of the deviations, counted how many innovations count: of what was measured,
   from sample `skip` on. */
typedef struct {
    whole begin;
    whole end;
    whole skip;
    whole terms;
    whole warm;
    whole count;
    whole known;
    whole shifted;
    whole width;           /* of a row, a multiple of GRAM_BLOCK */
    whole parts;
    const whole *bounds;   /* (parts + 1,) */
    const whole *constants; /* (known,) */
    const real *z;         /* (n, axes), u, h and temperature as in a scan */
    const real *u;
    const real *h;
    const real *temperature;
    const real *others;    /* (shifted, axes n) innovations of the shifted models, whitened */
    const real *shifts;    /* (shifted,) */
    real *delta;           /* (states + active constants, count), carried on */
    real *innovation;      /* (n, axes) */
    real *variance;        /* (n, axes) */
    real *white;           /* (axes n,) innovations, whitened */
    real *gram;            /* (parts, width, width) */
    real *logs;            /* (parts,) */
    whole *counted;        /* (parts,) */
    real *panel;           /* (GRAM_PANEL + axes, width) */
    real *scratch;         /* scan_scratch numbers */
} Likelihood;

/* Take in the rows of sample m, from `rows` on; returns how many count. */
static inline whole take_rows(const Likelihood *pass, const Settings *settings, whole m, whole part, real *rows)
{
    whole axes = settings->axes, count = pass->count, kept = 0;
    if (m < pass->skip)
        return 0;
    for (whole axis = 0; axis < axes; axis++) {
        if (!isfinite(pass->z[m * axes + axis]))
            continue;
        const real *from = rows + axis * pass->width;
        real *row = rows + kept * pass->width, log = from[count + 1], own = from[count];
        if (kept != axis)
            memcpy(row, from, (size_t)(count + 1) * sizeof(real));
        row[count + 1] = R(0.0);
        for (whole k = 0; k < pass->shifted; k++)
            row[count + 1 + k] =
                (pass->others[k * axes * pass->bounds[pass->parts] + m * axes + axis] - own) / pass->shifts[k];
        pass->counted[part]++;
        pass->white[m * axes + axis] = own;
        pass->logs[part] += log;
        kept++;
    }
    return kept;
}

static inline void likelihood_pass(Estimator *estimator, const Likelihood *pass)
{
    const Observer observer = widened(estimator);
    const Settings *settings = observer.settings;
    Workspace *work = &estimator->work;
    whole axes = settings->axes, part = 0, filled = 0;
    Scan scan = {.terms = pass->terms, .count = pass->count, .known = pass->known, .weighed = 1, .width = pass->width};
    scan.level = INFINITY;
    scan.constants = pass->constants;
    scan.z = pass->z;
    scan.u = pass->u;
    scan.h = pass->h;
    scan.warm = pass->warm;
    scan.temperature = pass->temperature;
    scan.delta = pass->delta;
    scan.scratch = pass->scratch;
    Following follow = following(&observer, &scan);
    workspace_begin(work, settings, observer.n, observer.total - follow.watched);
    while (pass->begin >= pass->bounds[part + 1])
        part++;
    for (whole m = pass->begin; m < pass->end; m++) {
        Output *row = observer.rows;
        scan_sample(&observer, &scan, m, row, pass->panel + filled * pass->width, work, &follow);
        for (whole axis = 0; axis < axes; axis++) {
            pass->innovation[m * axes + axis] = row->nu[axis];
            pass->variance[m * axes + axis] = row->s[axis];
        }
        filled += take_rows(pass, settings, m, part, pass->panel + filled * pass->width);
        int ends = m + 1 == pass->bounds[part + 1];
        if (ends || m + 1 == pass->end || filled >= GRAM_PANEL) {
            add_gram(pass->panel, filled, pass->width, pass->gram + part * pass->width * pass->width);
            filled = 0;
        }
        if (ends) {
            follow.length = R(-1.0); /* the rate has changed, and with it the responses */
            part++;
        }
    }
    settle(estimator, &observer);
}

#endif
