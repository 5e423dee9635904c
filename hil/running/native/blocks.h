/* Gain mode and board mode: the board computes the drive, samples come in blocks.

   The order of work: observe the block, judge each of its samples, answer it if it is the newest of those at hand; then
   what hangs off the loop. */

#ifndef TURN_BLOCKS_H
#define TURN_BLOCKS_H

#include "gains.h"

/* Whether rows show a drive that no board may show which keeps to what it was told. */
static bool drives_unbidden(permit_t *permit, const row_t *rows, int64_t count)
{
    int64_t most = 0;
    for (int64_t k = 0; k < count; k++)
        for (int column = 2; column < 4; column++)
            if (llabs(rows[k].codes[column]) > most)
                most = llabs(rows[k].codes[column]);
    permit->odd = most > permit->limit ? PERMIT_BEYOND : most > 0 && !permit->permitted ? PERMIT_DRIVES : PERMIT_FINE;
    permit->odd_tick = rows[0].tick;
    permit->odd_drive = most;
    return permit->odd != PERMIT_FINE;
}

/* Permit the board to go on, and to drive once the loop may be closed. */
static int answer_permit(turn_t *turn)
{
    uint8_t drive = (uint8_t)turn->blocks->closed;
    int why = send_answer(turn, HIL_TYPE_DRIVE_BOARD, &drive, HIL_DRIVE_BOARD_SIZE);
    if (why == TURN_DONE)
        turn->permit->permitted = drive;
    return why;
}

/* Whether a block says what no board says. Rows from before the board was armed again tell of what it has forgotten. */
static bool is_odd(turn_t *turn, const row_t *rows, int64_t count, int64_t last)
{
    if (rows->tick <= turn->stale)
        return false;
    if (turn->mode == MODE_BOARD)
        return drives_unbidden(turn->permit, rows, count);
    return matrices_named(turn->gains->matrices, rows->matrix, rows->tick, last) != MATRIX_FINE;
}

/* Have the observer take the samples, and keep the estimates that are to be recorded: a link that cuts blocks into
   shorter ones changes nothing of which those are. */
static int observe(turn_t *turn, const row_t *rows, int64_t count)
{
    blocks_t *blocks = turn->blocks;
    for (int64_t k = 0; k < count; k++)
        for (int column = 0; column < 4; column++) {
            double *to = column < 2 ? blocks->z : blocks->u;
            to[2 * k + column % 2] = rows[k].codes[column] * blocks->code[column] / blocks->unit[column];
        }
    for (int64_t at = 0, part; at < count; at += part) {
        int64_t due = blocks->every - blocks->since;
        part = count - at < due ? count - at : due;
        blocks->observe(turn->context, part, blocks->z + 2 * at, blocks->u + 2 * at,
                        blocks->outputs + at * turn->outputs);
        if (turn->failed)
            return TURN_FAILED;
        turn->newest = blocks->outputs + (at + part - 1) * turn->outputs;
        blocks->since = (blocks->since + part) % blocks->every;
        if (blocks->since == 0)
            keep_estimate(turn, rows[at + part - 1].tick);
    }
    return TURN_DONE;
}

/* Judge its samples in their order, until one stops the run. */
static void judge_block(turn_t *turn, const row_t *rows, int64_t count)
{
    for (int64_t k = 0; k < count && !turn->residual_safe; k++) {
        turn->newest = turn->blocks->outputs + k * turn->outputs;
        judge(turn, rows[k].tick - turn->first);
    }
}

static int32_t magnitude(int32_t code)
{
    return code < 0 ? -code : code; /* of 24 bits */
}

/* The block's flags, at the rows they are about. */
static int32_t flags_of(turn_t *turn, const row_t *row)
{
    const blocks_t *blocks = turn->blocks;
    if (row->flags == 0)
        return 0;
    bool clipped = magnitude(row->codes[0]) >= blocks->clip || magnitude(row->codes[1]) >= blocks->clip;
    bool saturated = magnitude(row->codes[2]) >= blocks->saturation || magnitude(row->codes[3]) >= blocks->saturation;
    turn->clipped += clipped;
    turn->saturated += saturated;
    return (clipped ? HIL_SENSE_FLAGS_CLIPPED : 0) | (saturated ? HIL_SENSE_FLAGS_SATURATED : 0);
}

/* Everything that hangs off a block once it is answered. */
static void keep_block(turn_t *turn, const row_t *rows, int64_t count)
{
    blocks_t *blocks = turn->blocks;
    for (int64_t k = 0; k < count; k++) {
        row_t row = rows[k];
        row.flags = flags_of(turn, &row);
        turn->newest = blocks->outputs + k * turn->outputs;
        put_capture(turn, &row);
        put_innovation(turn, row.tick);
    }
    if (blocks->count % blocks->covariance_every == blocks->covariance_every - 1)
        keep_covariance(turn, rows[count - 1].tick);
    blocks->count++;
    turn->samples += count;
}

static int answer_block(turn_t *turn, int64_t last, int64_t estimated_ns)
{
    return turn->mode == MODE_BOARD ? answer_permit(turn) : answer_gains(turn, last, estimated_ns);
}

/* Whether there may be no room for what hangs off another block. */
static bool is_full(const turn_t *turn)
{
    const matrices_t *matrices = turn->gains == NULL ? NULL : turn->gains->matrices;
    return turn->estimate_room - turn->estimate_count < (int64_t)MOST_ROWS ||
           turn->covariance_count == turn->covariance_room || (matrices != NULL && matrices->count == matrices->room);
}

/* One SENSE, of which `count` rows are at hand, all of them; answered if it is the newest. */
static int take_block(turn_t *turn, const row_t *rows, int64_t count, bool newest)
{
    blocks_t *blocks = turn->blocks;
    int64_t tick = rows->tick, last = tick + count - 1;
    if (turn->next != NONE && tick != turn->next)
        return TURN_GAP;
    if (tick - turn->first >= turn->due)
        return TURN_DUE;
    if (is_odd(turn, rows, count, last))
        return TURN_ODD;
    if (observe(turn, rows, count) != TURN_DONE)
        return TURN_FAILED;
    if (turn->mode == MODE_GAIN && tick > turn->stale) /* else from before it began anew */
        turn->gains->follow(turn->gains->board, tick, rows->codes, count, sizeof *rows / sizeof *rows->codes);
    judge_block(turn, rows, count);
    int64_t estimated_ns = now_ns();
    if (blocks->began == NONE)
        blocks->began = tick;
    /* On CAN a block comes in several messages, and a board in lockstep goes on by one for every answer. */
    bool whole = !turn->lockstep || (last + 1 - blocks->began) % blocks->rows == 0;
    if (newest && whole && !turn->residual_safe) {
        int why = answer_block(turn, last, estimated_ns);
        if (why != TURN_DONE)
            return why;
    }
    keep_block(turn, rows, count);
    if (turn->mode == MODE_GAIN)
        account(turn, tick, last, rows->matrix);
    turn->next = last + 1;
    turn->row_at += count;
    bool looked = look_at(turn, rows, count);
    if (turn->failed)
        return TURN_FAILED;
    return is_full(turn) ? TURN_FULL : looked ? TURN_LOOK : TURN_DONE;
}

/* The blocks at hand. */
static int take_blocks(turn_t *turn)
{
    batch_t *batch = &turn->batch;
    while (turn->row_at < batch->row_count) {
        const row_t *rows = &batch->rows[turn->row_at];
        if (turn->first == NONE)
            turn->first = rows->tick;
        int why = take_block(turn, rows, rows->left, turn->row_at + rows->left == batch->row_count);
        if (why != TURN_DONE)
            return why;
    }
    return TURN_DONE;
}

#endif
