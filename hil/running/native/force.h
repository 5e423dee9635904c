/* Force mode: every sample is answered with a drive.

   The order of work in a sample: observe and control, judge, answer; and only then whatever hangs off the loop, so that
   nothing but what protects the board stands between a sample and its answer. */

#ifndef TURN_FORCE_H
#define TURN_FORCE_H

#include "answer.h"
#include "echo.h"

/* Whether a drive may leave for the board; asked for each answer, before it is sent. */
static bool drive_may_be_sent(const turn_t *turn, const double codes[2])
{
    double limit = (double)turn->code_limit;
    return fabs(codes[0]) <= limit && fabs(codes[1]) <= limit; /* which NaN is not */
}

/* The newest command was not sent: the board will hold the one before it. */
static void withdraw(turn_t *turn)
{
    if (turn->latency > 0)
        memcpy(turn->queue + 3 * turn->latency, turn->queue + 3 * (turn->latency - 1), 3 * sizeof *turn->queue);
}

/* Send the codes, and note what hangs off that. */
static int answer(turn_t *turn, int64_t tick, const double codes[2], int64_t estimated_ns)
{
    hil_drive_force drive = {(int32_t)codes[0], (int32_t)codes[1], (uint32_t)(tick + turn->latency)};
    uint8_t payload[HIL_DRIVE_FORCE_SIZE];
    hil_pack_drive_force(&drive, payload);
    int why = send_answer(turn, HIL_TYPE_DRIVE_FORCE, payload, sizeof payload);
    if (why != TURN_DONE)
        return why;
    put_timing(turn, (const int64_t[4]){tick, turn->received_ns, estimated_ns, turn->sent_ns}, 4);
    echo_sent(turn->echo, drive.ux, drive.uy, tick + turn->latency);
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
    if (look_at(turn, row, 1) && why == TURN_DONE)
        why = TURN_LOOK;
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
    judge(turn, since);
    if (row->tick < oldest || turn->residual_safe) {
        withdraw(turn);
    } else if (!drive_may_be_sent(turn, codes)) {
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

#endif
