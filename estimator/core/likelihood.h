/* The likelihood of a record under a filter, with its score and information, by part of the record: one pass.

   Rows of the equations (scan.h) are multiplied out while they are in the cache, and never stand in memory together. */
#ifndef GYRO_LIKELIHOOD_H
#define GYRO_LIKELIHOOD_H

#include "gram.h"
#include "scan.h"

/* A record in parts: the samples begin to end of a scan are gone through by one call; the next goes on there.

   Columns of a row: the scan's sensitivities, the innovation, then one for each model that is `shifted`: by how much its
   own innovation is larger, over the shift.  gram receives their products of each part, blocks below the diagonal not
   filled; logs the sum of the logarithms of the deviations, counted how many innovations count: of what was measured,
   from sample `skip` on.  The scan's width is a multiple of GRAM_BLOCK. */
typedef struct {
    whole begin;
    whole end;
    whole skip;
    whole shifted;
    whole parts;
    const whole *bounds; /* (parts + 1,) */
    const real *others;  /* (shifted, axes n) innovations of the shifted models, whitened */
    const real *shifts;  /* (shifted,) */
    real *innovation;    /* (n, axes) */
    real *variance;      /* (n, axes) */
    real *white;         /* (axes n,) innovations, whitened */
    real *gram;          /* (parts, width, width) */
    real *logs;          /* (parts,) */
    whole *counted;      /* (parts,) */
    real *panel;         /* (GRAM_PANEL + axes, width) */
} Likelihood;

/* Take in the rows of sample m, from `rows` on; returns how many count. */
static inline whole take_rows(const Scan *scan, const Likelihood *pass, whole axes, whole m, whole part, real *rows)
{
    whole count = scan->count, kept = 0;
    if (m < pass->skip)
        return 0;
    for (whole axis = 0; axis < axes; axis++) {
        if (!isfinite(scan->z[m * axes + axis]))
            continue;
        const real *from = rows + axis * scan->width;
        real *row = rows + kept * scan->width, log = from[count + 1], own = from[count];
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

EXPORTED void gyro_likelihood_pass(Estimator *estimator, const Scan *scan, const Likelihood *pass)
{
    Following follow;
    const Observer observer = begin_scan(estimator, scan, &follow);
    whole axes = observer.settings->axes, width = scan->width, part = 0, filled = 0;
    while (pass->begin >= pass->bounds[part + 1])
        part++;
    for (whole m = pass->begin; m < pass->end; m++) {
        real *rows = pass->panel + filled * width;
        scan_sample(&observer, scan, m, rows, &estimator->work, &follow);
        for (whole axis = 0; axis < axes; axis++) {
            pass->innovation[m * axes + axis] = observer.rows->nu[axis];
            pass->variance[m * axes + axis] = observer.rows->s[axis];
        }
        filled += take_rows(scan, pass, axes, m, part, rows);
        int ends = m + 1 == pass->bounds[part + 1];
        if (ends || m + 1 == pass->end || filled >= GRAM_PANEL) {
            add_gram(pass->panel, filled, width, pass->gram + part * width * width);
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
