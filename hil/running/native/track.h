/* A row into the record: into the ring in shared memory (hil/running/recording/ring.py), or to where Python takes it over. */

#ifndef TURN_TRACK_H
#define TURN_TRACK_H

#include "structs.h"

/* Where the next row of a track goes, NULL where it is dropped; `published` is to follow. */
static uint8_t *slot(turn_t *turn, int64_t number)
{
    track_t *track = &turn->tracks[number];
    if (track->written != NULL && track->head - track->tail >= track->capacity)
        track->tail = __atomic_load_n(track->read, __ATOMIC_ACQUIRE);
    if (track->head - track->tail >= track->capacity) {
        int64_t room = track->written == NULL || track->waits ? turn->room(number) : 0;
        if (room < 0)
            turn->failed = 1;
        if (room <= 0) {
            if (track->dropped != NULL)
                ++*track->dropped;
            return NULL;
        }
    }
    return track->rows + track->head % track->capacity * track->row_size;
}

static void published(turn_t *turn, int64_t number)
{
    track_t *track = &turn->tracks[number];
    track->head++;
    if (track->written != NULL)
        __atomic_store_n(track->written, track->head, __ATOMIC_RELEASE);
}

/* tick, codes, flags of a sample: `board_layout` of hil/records/capture.py. */
static void put_capture(turn_t *turn, const row_t *row)
{
    uint8_t *to = slot(turn, TRACK_CAPTURE);
    if (to == NULL)
        return;
    memcpy(to, &row->tick, 8);
    memcpy(to + 8, row->codes, 16);
    to[24] = (uint8_t)row->flags;
    published(turn, TRACK_CAPTURE);
}

/* `timing_layout`, or `ledger_layout`, of hil/records/timing.py. */
static void put_timing(turn_t *turn, const int64_t *row, size_t columns)
{
    uint8_t *to = slot(turn, TRACK_TIMING);
    if (to == NULL)
        return;
    memcpy(to, row, columns * sizeof *row);
    published(turn, TRACK_TIMING);
}

/* Standard deviation; NaN of what is no variance, as an observer that diverged may have it. */
static double root(double variance)
{
    return variance >= 0.0 ? sqrt(variance) : (double)NAN;
}

/* `innovation_layout` of hil/records/estimates.py. */
static void put_innovation(turn_t *turn, int64_t tick)
{
    const double *nu = turn->newest, *s = turn->newest + 2;
    uint8_t *to = slot(turn, TRACK_INNOVATION);
    if (to == NULL)
        return;
    float row[4];
    for (int axis = 0; axis < 2; axis++) {
        row[axis] = (float)(nu[axis] * turn->volts[axis]);
        row[2 + axis] = (float)(root(s[axis]) * fabs(turn->volts[axis]));
    }
    memcpy(to, &tick, 8);
    memcpy(to + 8, row, sizeof row);
    published(turn, TRACK_INNOVATION);
}

/* What the observer has of the newest sample, for Python to record. */
static void keep_estimate(turn_t *turn, int64_t tick)
{
    int64_t states = turn->states, n = turn->estimated;
    double *to = turn->estimates + turn->estimate_count++ * (1 + states + n + turn->outputs);
    *to++ = (double)tick;
    memcpy(to, turn->state, (size_t)states * sizeof *to);
    to += states;
    for (int64_t k = 0; k < n; k++)
        *to++ = turn->covariance[k * (n + 1)];
    memcpy(to, turn->newest, (size_t)turn->outputs * sizeof *to);
}

/* The same of the whole covariance. */
static void keep_covariance(turn_t *turn, int64_t tick)
{
    size_t size = (size_t)(turn->estimated * turn->estimated);
    double *to = turn->covariances + turn->covariance_count++ * (int64_t)(1 + size);
    *to++ = (double)tick;
    memcpy(to, turn->covariance, size * sizeof *to);
}

#endif
