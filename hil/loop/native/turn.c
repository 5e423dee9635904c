/* The turn of the real-time loop: read, unframe, check, decode, step, judge, answer, and the row into the record.

   It returns to Python for whatever is no sample, and when Python has asked for it (hil/loop/force.py). */

#define _GNU_SOURCE /* ppoll */

#include "force.h"

#define EXPORT __attribute__((visibility("default")))

/* Sizes of the structures, for Python to compare. */
EXPORT void turn_sizes(int64_t sizes[5])
{
    sizes[0] = sizeof(row_t);
    sizes[1] = sizeof(receiver_t);
    sizes[2] = sizeof(said_t);
    sizes[3] = sizeof(echo_t);
    sizes[4] = sizeof(turn_t);
}

/* Answer samples until there is a reason to return: TURN_…. */
EXPORT int turn_force(turn_t *turn)
{
    return force(turn);
}

/* Judge a block of samples of another mode: as within a turn. */
EXPORT void turn_judge(turn_t *turn, double residual, double share, int64_t since)
{
    judge(turn, residual, share, since);
}

/* Take `size` bytes; how many of them found room in the batch. */
EXPORT int64_t turn_feed(receiver_t *rx, batch_t *batch, const uint8_t *data, int64_t size)
{
    int64_t taken = 0;
    while (taken < size && has_room(batch)) {
        int64_t part = size - taken < READ_SIZE ? size - taken : READ_SIZE;
        memcpy(rx->rest + rx->held, data + taken, (size_t)part);
        feed(rx, batch, (size_t)part);
        taken += part;
    }
    return taken;
}

EXPORT void echo_forget(echo_t *echo)
{
    echo_forget_(echo);
}

EXPORT void echo_sent(echo_t *echo, int32_t ux, int32_t uy, int64_t effective_tick)
{
    echo_sent_(echo, ux, uy, effective_tick);
}

EXPORT int64_t echo_saw(echo_t *echo, int64_t tick, int32_t ux, int32_t uy, int32_t flags)
{
    int32_t u[2] = {ux, uy};
    return echo_saw_(echo, tick, u, flags);
}
