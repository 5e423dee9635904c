/* A filter's own arrays with its scratch: what the entries of the library work on. */
#ifndef GYRO_ESTIMATOR_H
#define GYRO_ESTIMATOR_H

#include "block.h"
#include "layout.h"
#include "structs.h"
#include "trims.h"

/* An observer as Python has it, its covariances (n, n), with scratch; a pointer to it is one to that. */
typedef struct {
    Observer observer;
    real unused[5]; /* what follows begins at a line of the cache: a load across two takes longer */
    real wide_p[MAX_ENTRIES * MAX_WIDTH];
    real wide_c[MAX_ENTRIES * MAX_WIDTH];
    Workspace work;
} Estimator;

/* A record to go through: z (n, axes), u (n, axes, terms) the drive over the interval that ends at each sample, h (n,),
   temperature (n,) or none; without h all intervals are the settings' own.  Out of it: rows (n,), and of every `every`-th sample the state vector and its deviations
   (written, total).  With truth (n, total), the state vector is replaced by it before each step, so that p follows the
   posterior Cramer-Rao recursion along the true trajectory. */
typedef struct {
    whole n;
    whole terms;
    whole every;
    const real *z;
    const real *u;
    const real *h;
    const real *temperature;
    const real *truth;
    Output *rows;
    real *states;
    real *deviations;
} Block;

/* A copy of it whose covariances have rows that fill vector registers; `settle` puts those back. */
static inline Observer widened(Estimator *estimator)
{
    Observer wide = estimator->observer;
    int both = wide.settings->two_covariances == 1;
    wide.width = filled_up(wide.n);
    widen(wide.p, wide.n, estimator->wide_p, wide.width);
    if (both)
        widen(wide.c, wide.n, estimator->wide_c, wide.width);
    wide.p = estimator->wide_p;
    wide.c = both ? estimator->wide_c : wide.p;
    return wide;
}

static inline void settle(Estimator *estimator, const Observer *wide)
{
    narrow(wide->p, wide->width, estimator->observer.p, wide->n);
    if (wide->c != wide->p)
        narrow(wide->c, wide->width, estimator->observer.c, wide->n);
}

/* Its scratch, made ready when it is first used: every function leaves it fit for the next. */
static inline Workspace *workspace_of(Estimator *estimator)
{
    const Observer *observer = &estimator->observer;
    if (estimator->work.n != observer->n || estimator->work.total != carried_by(observer->settings))
        workspace_begin(&estimator->work, observer->settings, observer->n);
    return &estimator->work;
}

/* Virtual rotation of the drive that acted before sample m of a record, which shows whether there was one. */
static inline void note_applied(const Settings *settings, Memory *memory, const real *u, whole terms)
{
    int driven = u[0] != R(0.0) || u[terms] != R(0.0);
    memory->virtual_applied = settings->control == 1 && driven ? virtual_rate(settings, memory->time) : R(0.0);
}

/* Run the observer over a record; the number of state rows written. */
EXPORTED int64_t gyro_observe_block(Estimator *estimator, const Block *block)
{
    const Observer observer = widened(estimator);
    const Settings *settings = observer.settings;
    Workspace *work = workspace_of(estimator);
    whole axes = settings->axes, total = observer.total, written = 0;
    for (whole m = 0; m < block->n; m++) {
        const real *u = block->u + m * axes * block->terms;
        Sample sample = {block->z + m * axes, u, block->terms, block->h ? block->h[m] : settings->h};
        if (block->truth)
            memcpy(observer.x, block->truth + m * total, (size_t)total * sizeof *observer.x);
        if (block->temperature)
            observer.memory->temperature = block->temperature[m];
        if (axes == 2)
            note_applied(settings, observer.memory, u, block->terms);
        follow_trims(&observer, sample.h);
        advance_filter(&observer, &sample, work, block->rows + m);
        if (m % block->every == block->every - 1) {
            read_out(&observer, block->states + written * total, block->deviations + written * total);
            written++;
        }
    }
    settle(estimator, &observer);
    return written;
}

/* The observer (7)(8): one sample z (axes,), NaN where none was measured, and the drive u (axes,) that acted before it,
   taken in; the newest row filled. */
static inline void observer_step(Estimator *estimator, const real *z, const real *u)
{
    const Observer observer = widened(estimator);
    Sample sample = {z, u, 1, observer.settings->h};
    follow_trims(&observer, sample.h);
    advance_filter(&observer, &sample, workspace_of(estimator), observer.rows);
    settle(estimator, &observer);
}

/* The controller (9): the newest estimate's drive codes (2,), for the interval `latency` samples ahead. */
static inline void controller_step(Estimator *estimator, double *codes)
{
    const Observer *observer = &estimator->observer;
    command(observer->settings, observer->memory, observer->x, workspace_of(estimator), codes);
}

/* A sample of the closed loop taken in: sense codes (NaN: lost) and echoed drive codes; the newest row filled. */
static inline void take_sample(Estimator *estimator, double vx, double vy, double ux, double uy)
{
    const Settings *settings = estimator->observer.settings;
    real u[2] = {(real)ux * settings->quantum, (real)uy * settings->quantum};
    real z[2] = {(real)vx * settings->sense_scale[0], (real)vy * settings->sense_scale[1]};
    advance_queue(settings, estimator->observer.memory, u);
    observer_step(estimator, z, u);
}

/* One sample of the closed loop: the same, and codes (2,) to send. */
static inline void estimator_step(Estimator *estimator, double vx, double vy, double ux, double uy, double *codes)
{
    take_sample(estimator, vx, vy, ux, uy);
    controller_step(estimator, codes);
}

#endif
