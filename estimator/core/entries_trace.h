/* Entries of what looks at records: scans, free runs, experiments. */
#ifndef GYRO_ENTRIES_TRACE_H
#define GYRO_ENTRIES_TRACE_H

#include "experiment.h"
#include "foresight.h"
#include "likelihood.h"
#include "rotation.h"
#include "scan.h"
#include "series.h"
#include "simulation.h"

/* A board on the host, and rows it is carried over that were not received. */
typedef struct {
    whole first;
    whole rows;
    Board *board;
    const Settings *settings;
    const real *x;
    real *drives;
} Foresight;

/* Bytes of a board's record, which Python lays out as well. */
EXPORTED int64_t gyro_board_size(void)
{
    return (int64_t)sizeof(Board);
}

EXPORTED void gyro_scan_block(Estimator *estimator, const Scan *scan)
{
    scan_block(estimator, scan);
}

EXPORTED void gyro_likelihood_pass(Estimator *estimator, const Scan *scan, const Likelihood *pass)
{
    likelihood_pass(estimator, scan, pass);
}

EXPORTED void gyro_experiment_block(Estimator *estimator, const Experiment *plan)
{
    experiment_block(estimator, plan);
}

EXPORTED void gyro_free_run(Estimator *estimator, const FreeRun *run)
{
    Settings settings = *estimator->observer.settings;
    settings.order = run->order;
    workspace_begin(&estimator->work, &settings, estimator->observer.n, run->total);
    free_run(&settings, run, &estimator->work.flow);
}

/* Carry a board over rows that were received, for a caller in C. */
EXPORTED void estimator_board_follow(void *board, int64_t first, const int32_t *codes, int64_t rows, int64_t columns)
{
    board_follow(board, first, codes, rows, columns);
}

/* Tell a board its next matrix, for a caller in C. */
EXPORTED void estimator_board_tell(void *board, const double *gain, const double *bias, int64_t effective)
{
    board_tell(board, gain, bias, effective);
}

EXPORTED void gyro_board_foresee(const Foresight *asked)
{
    board_foresee(asked->settings, asked->board, asked->x, asked->first, asked->rows, asked->drives);
}

EXPORTED void gyro_turning(const Turning *turning)
{
    follow_turning(turning);
}

EXPORTED void gyro_play(const Series *series)
{
    play_behind(series);
}

#endif
