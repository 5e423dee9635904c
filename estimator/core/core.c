/* The library: its entries take structures by address (library.py), whose sizes the loader compares. */
#include "estimator.h"
#include "gain_matrix.h"
#include "stationary.h"

#include <stddef.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* What a gain matrix is solved with, and into: x (total,); a board's filter a (2, 2), b and c (2,) with its delay; turns
   (2, 4) which way round its channels are; gain (2, 4), bias (2,); motion (4, 4) what the filter makes of a motion. */
typedef struct {
    whole total;
    whole delay;
    const Settings *settings;
    const Memory *memory;
    const real *x;
    const real *a;
    const real *b;
    const real *c;
    const real *turns;
    real *gain;
    real *bias;
    real *motion;
} Folding;

#define UNCHANGED R(0.25) /* of a hold's work may be done with one matrix: it is measured before and replaced after */

/* Bytes of an estimator; where in it the sample stands, and the codes. */
EXPORTED void gyro_estimator_places(int64_t places[3])
{
    places[0] = (int64_t)sizeof(Estimator);
    places[1] = (int64_t)offsetof(Estimator, sample);
    places[2] = (int64_t)offsetof(Estimator, codes);
}

/* Bytes of a row of settings, memory, output and trims, which Python lays out as well (layout.py). */
EXPORTED void gyro_row_sizes(int64_t sizes[4])
{
    sizes[0] = (int64_t)sizeof(Settings);
    sizes[1] = (int64_t)sizeof(Memory);
    sizes[2] = (int64_t)sizeof(Output);
    sizes[3] = (int64_t)sizeof(Trims);
}

/* One sample of the closed loop, for a caller in C: sense codes (NaN: lost) and echoed drive codes -> codes to send. */
EXPORTED void estimator_tick(void *estimator, double vx, double vy, double ux, double uy, double codes[2])
{
    estimator_step(estimator, vx, vy, ux, uy, codes);
}

/* The parts of it, for a caller in C that has another observer or controller in the place of one: the observer alone; a
   drive that has acted, and the virtual rotation in it, scaled; a sample's time, with x (total,), scaled, the estimate of
   another observer, or NULL; the controller alone; what another controller commands, with the virtual rotation in it. */
EXPORTED void estimator_observe(void *estimator, double vx, double vy, double ux, double uy)
{
    take_sample(estimator, vx, vy, ux, uy);
}

EXPORTED double estimator_passed(void *estimator, double ux, double uy)
{
    const Observer *observer = &((Estimator *)estimator)->observer;
    const real u[2] = {ux * observer->settings->quantum, uy * observer->settings->quantum};
    advance_queue(observer->settings, observer->memory, u);
    return observer->memory->virtual_applied;
}

EXPORTED void estimator_follow(void *estimator, const double *x)
{
    const Observer *observer = &((Estimator *)estimator)->observer;
    observer->memory->time += observer->settings->h;
    if (x != NULL)
        memcpy(observer->x, x, (size_t)observer->total * sizeof *x);
}

/* The trim electrodes a sample on, for an observer that is not this one: V in its middle (trims->count,). */
EXPORTED void estimator_trimmed(void *estimator, double *volts)
{
    const Observer *observer = &((Estimator *)estimator)->observer;
    for (whole k = 0; k < observer->trims->count; k++)
        volts[k] = follow_electrode(observer->trims, k, observer->settings->h);
}

EXPORTED void estimator_control(void *estimator, double codes[2])
{
    controller_step(estimator, codes);
}

EXPORTED void estimator_commanded(void *estimator, const double codes[2], double virtual_rate)
{
    const Observer *observer = &((Estimator *)estimator)->observer;
    real *queued = observer->memory->queue[observer->settings->latency];
    queued[0] = codes[0] * observer->settings->quantum;
    queued[1] = codes[1] * observer->settings->quantum;
    queued[2] = virtual_rate;
}

/* The same by what stands in the estimator: one argument costs a caller in Python least. */
EXPORTED void gyro_tick(Estimator *estimator)
{
    const double *sample = estimator->sample;
    estimator_step(estimator, sample[0], sample[1], sample[2], sample[3], estimator->codes);
}

/* Samples z (n, axes) with the drive u (n, axes) that acted before each, scaled, at the settings' own intervals -> rows
   (n,), for a caller in C. */
EXPORTED void estimator_samples(void *estimator, int64_t n, const double *z, const double *u, void *rows)
{
    Block block = {.n = n, .terms = 1, .every = n + 1, .z = z, .u = u, .rows = rows};
    observe_block(estimator, &block);
}

EXPORTED int64_t gyro_observe_block(Estimator *estimator, const Block *block)
{
    return observe_block(estimator, block);
}

static BoardFilter board_of(const Folding *asked)
{
    BoardFilter board;
    memcpy(board.a, asked->a, sizeof board.a);
    memcpy(board.b, asked->b, sizeof board.b);
    memcpy(board.c, asked->c, sizeof board.c);
    board.delay = asked->delay;
    return board;
}

/* G and b for the newest estimate, zeros where that is not finite: for `horizon` samples from the estimate to the end of
   what they will be used for, in force `ahead` samples from it on. */
EXPORTED void estimator_gains(const void *folding, int64_t horizon, int64_t ahead)
{
    const Folding *asked = folding;
    const Settings *settings = asked->settings;
    BoardFilter board = board_of(asked);
    memset(asked->gain, 0, 8 * sizeof *asked->gain);
    memset(asked->bias, 0, 2 * sizeof *asked->bias);
    for (whole i = 0; i < asked->total; i++)
        if (!isfinite(asked->x[i]))
            return;
    gain_matrix(settings, asked->memory, asked->x, &board, asked->turns, UNCHANGED / ((real)horizon * settings->h),
                (real)ahead * settings->h, asked->gain, asked->bias);
}

/* What a board's filter makes of the motion of an ideal oscillator at rest. */
EXPORTED void gyro_filtered_swing(const Folding *asked)
{
    BoardFilter board = board_of(asked);
    real swing[16] = {R(0.0)}, e[16];
    swing[1] = swing[11] = R(1.0);
    swing[4] = swing[14] = R(-1.0);
    exponential(swing, asked->settings->h, asked->settings->order, e);
    filtered_motion(asked->settings, e, &board, asked->motion);
}

EXPORTED void gyro_gather_gains(Estimator *estimator, const Gathering *gathering)
{
    const Observer observer = widened(estimator);
    gather_gains(&observer, gathering, workspace_of(estimator));
    settle(estimator, &observer);
}

#include "entries_trace.h"
