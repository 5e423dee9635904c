/* A motion advanced with its sensitivities: exact for the linear part as a Taylor series, effects as impulses in it.

   Order and step are chosen so that the remainder is below rounding (taylor.py): one Runge-Kutta step at 20 samples a
   cycle biases the stiffness by h^4/60 = 1.6e-4. */
#ifndef GYRO_ADVANCE_H
#define GYRO_ADVANCE_H

#include "drifts.h"
#include "kick.h"
#include "layout.h"
#include "model.h"
#include "polynomial.h"
#include "signals.h"
#include "structs.h"
#include "taylor.h"
#include "turnover.h"
#include "ways.h"

#define LONGEST_STEP R(0.45) /* of two axes with drifts as matrices: 14 samples a cycle */

/* `advance_columns` of two axes under a drive that is held, with drifts by matrices that are the same for all columns.

   Each constant of the base model changes the field all along a drift: that integral is Gauss's rule of three points, and
   its error 6e-10 of the sensitivity at 20 samples a cycle, growing with the sixth power of the step. */
static inline void advance_two(const Settings *settings, const Interval *interval, const real *c, FlowWork *work)
{
    whole columns = work->columns;
    real h = interval->h, at = R(0.0), *out = work->out, *other = work->other, *entries = work->entries;
    Push *push = &work->push;
    int ways = settings->slip_count > 0;
    drift_matrices(c, interval->u, h, settings->order, work->powers, work->drifts);
    memset(entries, 0, sizeof work->entries);
    push->drive[0] = interval->u[0];
    push->drive[1] = interval->u[1];
    for (whole stage = 0; stage < STAGES; stage++) {
        const real *m = work->drifts + OF_A_LENGTH * length_of(stage);
        const real s[4] = {out[0], out[columns], out[2 * columns], out[3 * columns]};
        if (ways)
            memcpy(other, out, (size_t)(4 * columns) * sizeof(real));
        drift_entries(m, DRIFTS[stage] * h, s, entries);
        drift(m, columns, out);
        for (whole i = 0; i < 4; i++)
            out[i * columns] += m[16 + i];
        if (ways) { /* what depends on the way depends on the constants, too */
            gyro_add_constants(c, entries, out, columns);
            memset(entries, 0, sizeof work->entries);
            slide(settings, c, DRIFTS[stage] * h, columns, columns, other, out, push->slips);
        }
        at += DRIFTS[stage];
        if (stage < IMPULSES) {
            line_values(settings, settings->carried_signals, interval->time + (double)(at * h), push->signals);
            kick(settings, c, KICKS[stage] * h, columns, columns, other, out, push);
            push_entries(KICKS[stage] * h, push->by_states, entries);
        }
    }
    gyro_add_constants(c, entries, out, columns);
}

/* `taylor` of the columns of work->out.  In 32 bits the state and the first term of its series, which is nearly all that it
   moves by, are added up in 64, and what of the sum 32 do not hold is kept: rounded alike at each turn of the vibration,
   it would turn the pattern by 0.1 mrad in 40 s. */
static inline void move(const Settings *settings, const real *c, const real *u, whole terms, real h, whole columns,
                        FlowWork *work)
{
    real *out = work->out;
    whole stride = work->columns;
#ifdef CORE_FLOAT32
    whole states = settings->states;
    real s[4] = {0};
    double sum[4];
    for (whole i = 0; i < states; i++)
        s[i] = out[i * stride];
#endif
    taylor(settings->model, c, u, terms, h, settings->order, columns, work->term, out, stride);
#ifdef CORE_FLOAT32
    if (columns == 1)
        return;
    first_term(settings->model, c, s, work->rest, u, terms, h, sum);
    for (whole i = 0; i < states; i++) {
        sum[i] = ((double)s[i] + (double)work->rest[i]) + (sum[i] + (double)out[i * stride]);
        out[i * stride] = (real)sum[i];
        work->rest[i] = (real)(sum[i] - (double)out[i * stride]);
    }
#endif
}

/* Advance the columns of work->out over the interval under effects that are smooth in it; columns is 1 or all. */
static inline void advance_columns(const Settings *settings, const Interval *interval, const real *c, whole columns,
                                   FlowWork *work)
{
    whole stride = work->columns, terms = interval->terms, axes = settings->axes;
    real h = interval->h, at = R(0.0), part[MAX_AXES * MAX_TERMS], *out = work->out;
    Push *push = &work->push;
    int held = terms == 1, ways = settings->slip_count > 0;
    if (settings->pushes == 0) {
        move(settings, c, interval->u, terms, h, columns, work);
        return;
    }
    if (columns > 1 && axes == 2 && held && FABS(h) <= LONGEST_STEP) {
        advance_two(settings, interval, c, work);
        return;
    }
    for (whole stage = 0; stage < STAGES; stage++) {
        real length = DRIFTS[stage];
        const real *u = interval->u;
        if (!held) {
            part_of(interval->u, axes, terms, at, length, part);
            u = part;
        }
        if (ways)
            memcpy(work->other, out, (size_t)(settings->states * stride) * sizeof(real));
        move(settings, c, u, terms, length * h, columns, work);
        if (ways)
            slide(settings, c, length * h, columns, stride, work->other, out, push->slips);
        at += length;
        if (stage < IMPULSES) {
            drive_at(interval->u, axes, terms, at, push->drive);
            line_values(settings, settings->carried_signals, interval->time + (double)(at * h), push->signals);
            kick(settings, c, KICKS[stage] * h, columns, stride, work->other, out, push);
        }
    }
}

/* `advance_columns`, in pieces where a velocity passes what friction turns over in: within each, the force is smooth
   beside the piece. */
static inline void advance(const Settings *settings, const Interval *interval, const real *c, whole columns,
                           FlowWork *work)
{
    Cuts cuts;
    cuts.count = 0;
    if (settings->kinked == 1)
        turnovers(settings, interval, c, work, &cuts);
    if (cuts.count == 0) {
        advance_columns(settings, interval, c, columns, work);
        return;
    }
    real at = R(0.0), u[MAX_AXES * MAX_TERMS];
    for (whole piece = 0; piece <= cuts.count; piece++) {
        real until = piece < cuts.count ? cuts.at[piece] : R(1.0);
        if (!(until > at))
            continue;
        part_of(interval->u, settings->axes, interval->terms, at, until - at, u);
        Interval part = {interval->time + (double)(at * interval->h), (until - at) * interval->h, u, interval->terms};
        advance_columns(settings, &part, c, columns, work);
        at = until;
    }
}

/* The columns of work->out <- those of a state s that nothing has moved yet. */
static inline void begin_columns(const Settings *settings, const real *s, whole columns, FlowWork *work)
{
    for (whole i = 0; i < settings->states; i++) {
        real *row = work->out + i * work->columns;
        for (whole j = 0; j < columns; j++)
            row[j] = R(0.0);
        row[0] = s[i];
        if (columns > 1)
            row[1 + i] = R(1.0);
    }
    for (whole k = 0; k < settings->slip_count; k++)
        memset(work->push.slips[k] + 1, 0, (MAX_COLUMNS - 1) * sizeof(real));
}

#endif
