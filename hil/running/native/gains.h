/* Gain mode's answer: the matrix that the board closes the loop with, and what became of those before. */

#ifndef TURN_GAINS_H
#define TURN_GAINS_H

#include "answer.h"
#include "matrices.h"

/* Whether a board takes the matrix; else the first number that it does not take. */
static bool gains_may_be_sent(turn_t *turn)
{
    const gains_t *gains = turn->gains;
    for (int k = 0; k < 10; k++) {
        double number = k < 8 ? gains->gain[k] : gains->bias[k - 8];
        if (!(fabs(number) <= (double)HIL_GAINS_LIMIT)) { /* which NaN is not */
            turn->refused[0] = number;
            return false;
        }
    }
    return true;
}

/* Enter the oldest matrix into the ledger, with the first tick computed with it, -1 where none was seen. */
static void close_oldest(turn_t *turn, int64_t applied)
{
    gains_t *gains = turn->gains;
    sent_t *sent = &gains->sent[gains->first];
    sent->row[4] = applied;
    put_timing(turn, sent->row, 5);
    gains->first = (gains->first + 1) % LATER;
    gains->count--;
}

/* The effect of what was sent will not be seen any more. */
EXPORT void turn_leave_open(turn_t *turn)
{
    while (turn->gains->count > 0)
        close_oldest(turn, -1);
}

/* Whether a matrix of that name was sent after the oldest that is in the ledger. */
static bool sent_since(const gains_t *gains, int64_t matrix)
{
    for (int64_t k = 0; k < gains->count; k++)
        if (gains->sent[(gains->first + k) % LATER].matrix == matrix)
            return true;
    return false;
}

/* Close the accounts of the matrices that must have come into force by the end of a block. */
static void account(turn_t *turn, int64_t tick, int64_t last, int64_t matrix)
{
    gains_t *gains = turn->gains;
    while (gains->count > 0 && gains->sent[gains->first].effective <= last) {
        const sent_t *sent = &gains->sent[gains->first];
        int64_t applied = -1;
        if (sent->matrix == matrix) {
            applied = sent->effective > tick ? sent->effective : tick;
            gains->late[gains->late_count++ % RECENT] = tick > sent->effective ? last - sent->effective : 0;
        } else if (gains->count == 1 || !sent_since(gains, matrix)) {
            return; /* late: it is still to come */
        }
        close_oldest(turn, applied);
    }
}

static int64_t latest(const gains_t *gains)
{
    int64_t most = 0;
    for (int k = 0; k < RECENT; k++)
        if (gains->late[k] > most)
            most = gains->late[k];
    return most;
}

/* Solve for the matrix and send it, zeros while the loop is open. */
static int answer_gains(turn_t *turn, int64_t last, int64_t estimated_ns)
{
    gains_t *gains = turn->gains;
    gains->solve(gains->folding, gains->horizon + latest(gains), gains->lead);
    if (!turn->blocks->closed) {
        memset(gains->gain, 0, 8 * sizeof *gains->gain);
        memset(gains->bias, 0, 2 * sizeof *gains->bias);
    }
    if (!gains_may_be_sent(turn)) {
        turn->stop = 1;
        return TURN_BEYOND;
    }
    int64_t name = next_name(gains->matrices), effective = last + gains->lead;
    hil_drive_gains message = {.matrix_id = (uint8_t)name, .effective_tick = (uint32_t)effective};
    for (int k = 0; k < 8; k++)
        message.gain[k] = (float)gains->gain[k];
    for (int k = 0; k < 2; k++)
        message.bias[k] = (float)gains->bias[k];
    uint8_t payload[HIL_DRIVE_GAINS_SIZE];
    hil_pack_drive_gains(&message, payload);
    int why = send_answer(turn, HIL_TYPE_DRIVE_GAINS, payload, sizeof payload);
    if (why != TURN_DONE)
        return why;
    matrices_sent(gains->matrices, effective);
    gains->tell(gains->board, gains->gain, gains->bias, effective);
    if (gains->count == LATER)
        close_oldest(turn, -1);
    gains->sent[(gains->first + gains->count++) % LATER] =
        (sent_t){name, effective, {last, turn->received_ns, estimated_ns, turn->sent_ns, -1}};
    return TURN_DONE;
}

#endif
