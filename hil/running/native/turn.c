/* The turn of the real-time loop: read, unframe, check, decode, step, judge, answer, and the row into the record.

   It returns to Python for whatever is no sample, and when Python has asked for it (hil/running/loop/force.py). */

#define _GNU_SOURCE /* ppoll */

#include "blocks.h"
#include "force.h"

/* Sizes of the structures, for Python to compare. */
EXPORT void turn_sizes(int64_t sizes[10])
{
    sizes[0] = sizeof(row_t);
    sizes[1] = sizeof(receiver_t);
    sizes[2] = sizeof(said_t);
    sizes[3] = sizeof(echo_t);
    sizes[4] = sizeof(matrices_t);
    sizes[5] = sizeof(gains_t);
    sizes[6] = sizeof(permit_t);
    sizes[7] = sizeof(blocks_t);
    sizes[8] = sizeof(turn_t);
    sizes[9] = sizeof(can_t);
}

/* Answer samples until there is a reason to return: TURN_…. */
EXPORT int turn_run(turn_t *turn)
{
    if (turn->fresh && is_done(turn))
        return TURN_DONE;
    turn->fresh = 0;
    for (;;) {
        /* What a board's own estimator says is judged before the board is let go on. */
        bool heard_first = turn->mode == MODE_BOARD && turn->news;
        int why = heard_first ? TURN_DONE : turn->mode == MODE_FORCE ? take_rows(turn) : take_blocks(turn);
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

/* Take `size` bytes, whole records with `can`; how many of them found room in the batch. */
EXPORT int64_t turn_feed(receiver_t *rx, can_t *can, batch_t *batch, const uint8_t *data, int64_t size)
{
    int64_t taken = 0;
    for (; can != NULL && taken < size && has_room(batch); taken += RECORD_SIZE)
        feed_record(rx, can, batch, data + taken);
    while (taken < size && has_room(batch)) {
        int64_t part = size - taken < READ_SIZE ? size - taken : READ_SIZE;
        memcpy(rx->rest + rx->held, data + taken, (size_t)part);
        feed(rx, batch, (size_t)part);
        taken += part;
    }
    return taken;
}

EXPORT int64_t echo_saw(echo_t *echo, int64_t tick, int32_t ux, int32_t uy, int32_t flags)
{
    int32_t u[2] = {ux, uy};
    return echo_saw_(echo, tick, u, flags);
}
