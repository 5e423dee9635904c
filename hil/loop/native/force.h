/* Force mode: every sample is answered with a drive.

   The order of work in a sample: observe and control, judge, answer; and only then whatever hangs off the loop, so that
   nothing but what protects the board stands between a sample and its answer. */

#ifndef TURN_FORCE_H
#define TURN_FORCE_H

#include "echo.h"
#include "link.h"
#include "track.h"

#define RESIDUAL_SAMPLES 200.0 /* over which the residual is averaged: hil.loop.skeleton has it too */

/* Stop the run when the residual leaves its bounds: its mean square over the last samples, in units of the noise, of
   which they are such a share of those it is averaged over. */
static void judge(turn_t *turn, double residual, double share, int64_t since)
{
    turn->residual += (residual - turn->residual) * share;
    bool inside = turn->residual <= turn->residual_limit; /* which NaN is not */
    if (since >= turn->guarded && !inside) {
        turn->residual_safe++;
        turn->stop = 1;
    }
}

/* Mean square of the newest innovation in units of the noise. */
static double newest_residual(const turn_t *turn)
{
    double x = turn->newest[0] / turn->noise[0], y = turn->newest[1] / turn->noise[1];
    return 0.5 * (x * x + y * y);
}

/* The newest command was not sent: the board will hold the one before it. */
static void withdraw(turn_t *turn)
{
    if (turn->latency > 0)
        memcpy(turn->queue + 3 * turn->latency, turn->queue + 3 * (turn->latency - 1), 3 * sizeof *turn->queue);
}

static bool may_be_sent(const turn_t *turn, const double codes[2])
{
    double limit = (double)turn->code_limit;
    return fabs(codes[0]) <= limit && fabs(codes[1]) <= limit; /* which NaN is not */
}

static void note_silence(turn_t *turn)
{
    int64_t silent_ns = turn->sent_ns - turn->answered_ns;
    if (silent_ns > turn->suspicious_ns && silent_ns > turn->silence_ns)
        turn->silence_ns = silent_ns;
    turn->answered_ns = turn->sent_ns;
}

/* Send the codes, and note what hangs off that. */
static int answer(turn_t *turn, int64_t tick, const double codes[2], int64_t estimated_ns)
{
    int32_t ux = (int32_t)codes[0], uy = (int32_t)codes[1];
    int done = send_drive(turn, ux, uy, tick + turn->latency);
    if (done != CAME)
        return done == CLOSED ? TURN_CLOSED : TURN_FAILED;
    turn->drives++;
    put_timing(turn, tick, estimated_ns);
    echo_sent_(turn->echo, ux, uy, tick + turn->latency);
    note_silence(turn);
    return TURN_DONE;
}

static void count_flags(turn_t *turn, const row_t *row)
{
    if (row->flags & HIL_SENSE_FLAGS_HELD) {
        turn->held++;
        turn->held_run = row->tick == turn->held_next ? turn->held_run + 1 : 1;
        turn->held_next = row->tick + 1;
        if (turn->held_run > turn->held_longest)
            turn->held_longest = turn->held_run;
    }
    turn->clipped += (row->flags & HIL_SENSE_FLAGS_CLIPPED) != 0;
    turn->saturated += (row->flags & HIL_SENSE_FLAGS_SATURATED) != 0;
}

/* Everything that hangs off a sample once it is answered. */
static int keep(turn_t *turn, const row_t *row)
{
    int64_t since = row->tick - turn->first;
    int why = TURN_DONE;
    turn->samples++;
    count_flags(turn, row);
    put_capture(turn, row);
    if (row->tick > turn->stale && echo_saw_(turn->echo, row->tick, row->codes + 2, row->flags) != ODD_NOTHING)
        return TURN_ODD;
    put_innovation(turn, row->tick);
    if (since % turn->estimate_every == turn->estimate_every - 1) {
        keep_estimate(turn, row->tick);
        if (since % turn->covariance_every == turn->covariance_every - 1)
            keep_covariance(turn, row->tick);
        if (turn->estimate_count == turn->estimate_room || turn->covariance_count == turn->covariance_room)
            why = TURN_FULL;
    }
    if (turn->look_after != INT64_MAX) {
        turn->seen[turn->seen_count++] = *row;
        if (turn->seen_count == turn->look_after && why == TURN_DONE)
            why = TURN_LOOK;
    }
    memcpy(turn->shown, row->codes + 2, sizeof turn->shown);
    turn->next = row->tick + 1;
    turn->row_at++;
    return turn->failed ? TURN_FAILED : why;
}

/* One sample, answered if its tick is not before `oldest`. */
static int take(turn_t *turn, const row_t *row, int64_t oldest)
{
    int64_t since = row->tick - turn->first;
    double codes[2];
    if (turn->next != NONE && row->tick != turn->next)
        return TURN_GAP;
    if (since >= turn->due)
        return TURN_DUE;
    turn->step(turn->context, row->codes[0], row->codes[1], row->codes[2], row->codes[3], codes);
    int64_t estimated_ns = now_ns();
    if (turn->failed)
        return TURN_FAILED;
    judge(turn, newest_residual(turn), 1.0 / RESIDUAL_SAMPLES, since);
    if (row->tick < oldest || turn->residual_safe) {
        withdraw(turn);
    } else if (!may_be_sent(turn, codes)) {
        memcpy(turn->refused, codes, sizeof codes);
        turn->stop = 1;
        return TURN_BEYOND;
    } else {
        int why = answer(turn, row->tick, codes, estimated_ns);
        if (why != TURN_DONE)
            return why;
    }
    return keep(turn, row);
}

/* The rows at hand. */
static int take_rows(turn_t *turn)
{
    batch_t *batch = &turn->batch;
    while (turn->row_at < batch->row_count) {
        int64_t newest = batch->rows[batch->row_count - 1].tick;
        /* What came with newer rows is answered where that can still act in time; in lockstep no tick passes. */
        int64_t before = turn->lockstep || turn->latency < 1 ? 0 : turn->latency - 1;
        const row_t *row = &batch->rows[turn->row_at];
        if (turn->first == NONE)
            turn->first = row->tick;
        int why = take(turn, row, newest - before);
        if (why != TURN_DONE)
            return why;
    }
    return TURN_DONE;
}

/* Wait for rows and messages. */
static int hear(turn_t *turn)
{
    int64_t listened_ns = now_ns(), end_ns = listened_ns + turn->slice_ns, left_ns = turn->slice_ns;
    turn->batch.row_count = turn->row_at = 0;
    for (;;) {
        switch (receive(turn, left_ns)) {
        case WOKEN:
            return TURN_WOKEN;
        case CLOSED:
            return TURN_CLOSED;
        case RAISED:
            return TURN_FAILED;
        }
        if (turn->batch.said_size > 0)
            turn->news = 1;
        if (turn->batch.row_count > 0) {
            turn->turns++;
            turn->behind += turn->received_ns - listened_ns < turn->at_once_ns;
            return TURN_DONE;
        }
        left_ns = end_ns - now_ns(); /* a part of a frame is neither a sample nor silence */
        if (turn->news || turn->link.kind >= LINK_BYTES || left_ns <= 0) {
            turn->news = 0;
            return TURN_QUIET;
        }
    }
}

/* Whether nothing more is to be read for now. */
static bool is_done(const turn_t *turn)
{
    return turn->stop || (turn->first != NONE && turn->next - turn->first >= turn->goal);
}

static int force(turn_t *turn)
{
    if (turn->fresh && is_done(turn))
        return TURN_DONE;
    turn->fresh = 0;
    for (;;) {
        int why = take_rows(turn);
        if (why != TURN_DONE)
            return why;
        if (turn->news) {
            turn->news = 0;
            return TURN_NEWS;
        }
        if (is_done(turn))
            return TURN_DONE;
        why = hear(turn);
        if (why != TURN_DONE)
            return why;
    }
}

#endif
