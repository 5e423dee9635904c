/* The library: its entries take structures by address (library.py), whose sizes the loader compares. */
#include "experiment.h"
#include "gain_board.h"
#include "gain_matrix.h"
#include "likelihood.h"
#include "rotation.h"
#include "series.h"
#include "simulation.h"
#include "stationary.h"

/* Bytes of what Python lays out as well (layout.py): a row of settings, memory, output, trims and a board; and of an
   estimator. */
EXPORTED void gyro_sizes(int64_t sizes[6])
{
    sizes[0] = (int64_t)sizeof(Settings);
    sizes[1] = (int64_t)sizeof(Memory);
    sizes[2] = (int64_t)sizeof(Output);
    sizes[3] = (int64_t)sizeof(Trims);
    sizes[4] = (int64_t)sizeof(Board);
    sizes[5] = (int64_t)sizeof(Estimator);
}

/* One sample of the closed loop: sense codes (NaN: lost) and echoed drive codes -> codes to send. */
EXPORTED void estimator_tick(Estimator *estimator, double vx, double vy, double ux, double uy, double codes[2])
{
    estimator_step(estimator, vx, vy, ux, uy, codes);
}

/* The parts of it, for a caller in C that has another observer or controller in the place of one: the observer alone; a
   drive that has acted, and the virtual rotation in it, scaled; a sample's time, with x (total,), scaled, the estimate of
   another observer, or NULL; the controller alone; what another controller commands, with the virtual rotation in it. */
EXPORTED void estimator_observe(Estimator *estimator, double vx, double vy, double ux, double uy)
{
    take_sample(estimator, vx, vy, ux, uy);
}

EXPORTED double estimator_passed(Estimator *estimator, double ux, double uy)
{
    const Observer *observer = &estimator->observer;
    const real u[2] = {ux * observer->settings->quantum, uy * observer->settings->quantum};
    advance_queue(observer->settings, observer->memory, u);
    return observer->memory->virtual_applied;
}

EXPORTED void estimator_follow(Estimator *estimator, const double *x)
{
    const Observer *observer = &estimator->observer;
    observer->memory->time += observer->settings->h;
    if (x != NULL)
        memcpy(observer->x, x, (size_t)observer->total * sizeof *x);
}

/* The trim electrodes a sample on, for an observer that is not this one: V in its middle (trims->count,). */
EXPORTED void estimator_trimmed(Estimator *estimator, double *volts)
{
    const Observer *observer = &estimator->observer;
    for (whole k = 0; k < observer->trims->count; k++)
        volts[k] = follow_electrode(observer->trims, k, observer->settings->h);
}

EXPORTED void estimator_control(Estimator *estimator, double codes[2])
{
    controller_step(estimator, codes);
}

EXPORTED void estimator_commanded(Estimator *estimator, const double codes[2], double virtual_rate)
{
    const Observer *observer = &estimator->observer;
    real *queued = observer->memory->queue[observer->settings->latency];
    queued[0] = codes[0] * observer->settings->quantum;
    queued[1] = codes[1] * observer->settings->quantum;
    queued[2] = virtual_rate;
}

/* Samples z (n, axes) with the drive u (n, axes) that acted before each, scaled, at the settings' own intervals -> rows
   (n,), for a caller in C. */
EXPORTED void estimator_samples(Estimator *estimator, int64_t n, const double *z, const double *u, Output *rows)
{
    const Block block = {.n = n, .terms = 1, .every = n + 1, .z = z, .u = u, .rows = rows};
    gyro_observe_block(estimator, &block);
}
