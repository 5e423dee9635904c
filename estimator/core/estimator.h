/* A filter's own arrays with its scratch: what the entries of the library work on. */
#ifndef GYRO_ESTIMATOR_H
#define GYRO_ESTIMATOR_H

#include "block.h"
#include "layout.h"
#include "structs.h"
#include "trims.h"

/* An observer's own arrays, scaled: live, for those who call with them.

   active, intensity, prior, spread, initial (count,); table (angles, phases, n, axes) the stationary gains; x (total,);
   p and c (n, n) the covariance assumed by the gain and the one that estimates have under it. */
typedef struct {
    whole count;
    whole n;
    whole total;
    whole angles;
    whole phases;
    const Settings *settings;
    Memory *memory;
    Output *rows; /* the newest one */
    const whole *active;
    const real *intensity;
    const real *prior;
    const real *spread;
    real *initial;
    const real *table;
    real *x;
    real *p;
    real *c;
    Trims *trims;
} Arrays;

/* Arrays first: a pointer to it is one to them. */
typedef struct {
    Arrays arrays;
    double sample[4]; /* vx, vy, ux, uy in codes */
    double codes[2];  /* the drive to send */
    Workspace work;
    real wide_p[MAX_ENTRIES * MAX_WIDTH];
    real wide_c[MAX_ENTRIES * MAX_WIDTH];
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

static inline Constants constants_of(const Arrays *arrays)
{
    return (Constants){arrays->intensity, arrays->prior, arrays->spread, arrays->initial};
}

static inline Table table_of(const Arrays *arrays)
{
    return (Table){arrays->angles, arrays->phases, arrays->settings->axes, arrays->table};
}

/* Its covariances are those in arrays, rows of n numbers. */
static inline Estimate estimate_of(const Arrays *arrays)
{
    return (Estimate){arrays->n, arrays->n, arrays->total, arrays->x, arrays->p, arrays->c, arrays->memory};
}

/* A copy of it whose covariances have rows that fill vector registers; `settle` puts those back. */
static inline Estimate widened(Estimator *estimator)
{
    const Arrays *arrays = &estimator->arrays;
    int both = arrays->settings->two_covariances == 1;
    Estimate wide = estimate_of(arrays);
    wide.width = filled_up(wide.n);
    wide.p = estimator->wide_p;
    wide.c = both ? estimator->wide_c : estimator->wide_p;
    widen(arrays->p, wide.n, wide.p, wide.width);
    if (both)
        widen(arrays->c, wide.n, wide.c, wide.width);
    return wide;
}

static inline void settle(Estimator *estimator, const Estimate *wide)
{
    const Arrays *arrays = &estimator->arrays;
    narrow(wide->p, wide->width, arrays->p, wide->n);
    if (arrays->settings->two_covariances == 1)
        narrow(wide->c, wide->width, arrays->c, wide->n);
}

/* States and all constants of what is carried: those of effects that are only watched stand behind. */
static inline whole carried_by(const Settings *settings)
{
    return settings->states + settings->sense_constants + settings->flow_constants;
}

/* Its scratch, made ready when it is first used: every function leaves it fit for the next. */
static inline Workspace *workspace_of(Estimator *estimator)
{
    const Arrays *arrays = &estimator->arrays;
    if (estimator->work.n != arrays->n || estimator->work.total != carried_by(arrays->settings))
        workspace_begin(&estimator->work, arrays->settings, arrays->n, carried_by(arrays->settings));
    return &estimator->work;
}

/* Virtual rotation of the drive that acted before sample m of a record, which shows whether there was one. */
static inline void note_applied(const Settings *settings, Memory *memory, const real *u, whole terms)
{
    int driven = u[0] != R(0.0) || u[terms] != R(0.0);
    memory->virtual_applied = settings->control == 1 && driven ? virtual_rate(settings, memory->time) : R(0.0);
}

/* Run the observer over a record; the number of state rows written. */
static inline whole observe_block(Estimator *estimator, const Block *block)
{
    const Arrays *arrays = &estimator->arrays;
    const Settings *settings = arrays->settings;
    Constants constants = constants_of(arrays);
    Table table = table_of(arrays);
    Estimate estimate = widened(estimator);
    Workspace *work = workspace_of(estimator);
    whole axes = settings->axes, written = 0;
    for (whole m = 0; m < block->n; m++) {
        const real *u = block->u + m * axes * block->terms;
        Sample sample = {block->z + m * axes, u, block->terms, block->h ? block->h[m] : settings->h};
        if (block->truth)
            memcpy(arrays->x, block->truth + m * arrays->total, (size_t)arrays->total * sizeof *arrays->x);
        if (block->temperature)
            arrays->memory->temperature = block->temperature[m];
        if (axes == 2)
            note_applied(settings, arrays->memory, u, block->terms);
        follow_trims(settings, arrays->trims, &estimate, arrays->initial, sample.h);
        advance_filter(settings, arrays->active, arrays->count, &constants, &table, &estimate, &sample, work,
                       block->rows + m);
        if (m % block->every == block->every - 1) {
            read_out(settings, arrays->active, &estimate, block->states + written * arrays->total,
                     block->deviations + written * arrays->total);
            written++;
        }
    }
    settle(estimator, &estimate);
    return written;
}

/* The observer (7)(8): one sample z (axes,), NaN where none was measured, and the drive u (axes,) that acted before it,
   taken in; the newest row filled. */
static inline void observer_step(Estimator *estimator, const real *z, const real *u)
{
    const Arrays *arrays = &estimator->arrays;
    Constants constants = constants_of(arrays);
    Table table = table_of(arrays);
    Estimate estimate = widened(estimator);
    Sample sample = {z, u, 1, arrays->settings->h};
    follow_trims(arrays->settings, arrays->trims, &estimate, arrays->initial, sample.h);
    advance_filter(arrays->settings, arrays->active, arrays->count, &constants, &table, &estimate, &sample,
                   workspace_of(estimator), arrays->rows);
    settle(estimator, &estimate);
}

/* The controller (9): the newest estimate's drive codes (2,), for the interval `latency` samples ahead. */
static inline void controller_step(Estimator *estimator, double *codes)
{
    const Arrays *arrays = &estimator->arrays;
    command(arrays->settings, arrays->memory, arrays->x, workspace_of(estimator), codes);
}

/* A sample of the closed loop taken in: sense codes (NaN: lost) and echoed drive codes; the newest row filled. */
static inline void take_sample(Estimator *estimator, double vx, double vy, double ux, double uy)
{
    const Settings *settings = estimator->arrays.settings;
    real u[2] = {(real)ux * settings->quantum, (real)uy * settings->quantum};
    real z[2] = {(real)vx * settings->sense_scale[0], (real)vy * settings->sense_scale[1]};
    advance_queue(settings, estimator->arrays.memory, u);
    observer_step(estimator, z, u);
}

/* One sample of the closed loop: the same, and codes (2,) to send. */
static inline void estimator_step(Estimator *estimator, double vx, double vy, double ux, double uy, double *codes)
{
    take_sample(estimator, vx, vy, ux, uy);
    controller_step(estimator, codes);
}

#endif
