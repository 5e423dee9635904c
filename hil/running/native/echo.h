/* Whether the drives that SENSE shows in force mode are the ones that were sent: hil/running/loop/force.py tells it in words. */

#ifndef TURN_ECHO_H
#define TURN_ECHO_H

#include "structs.h"

/* The board was armed again: nothing is due until it runs. */
EXPORT void echo_forget(echo_t *echo)
{
    echo->due = echo->last = NONE;
    echo->odd = ODD_NOTHING;
}

EXPORT void echo_sent(echo_t *echo, int32_t ux, int32_t uy, int64_t effective_tick)
{
    echo->sent[effective_tick & (SENT - 1)] = (drive_t){effective_tick, {ux, uy}};
}

static int32_t within(int32_t code, int64_t limit)
{
    return code > limit ? (int32_t)limit : code < -limit ? (int32_t)-limit : code;
}

/* Whether the first drive is the second one, limited further. */
static bool less(const int32_t u[2], const int32_t meant[2])
{
    for (int axis = 0; axis < 2; axis++)
        if (llabs(u[axis]) > llabs(meant[axis]) || (int64_t)u[axis] * meant[axis] < 0)
            return false;
    return true;
}

/* The next row; what is wrong with the one before it. A board that stops by itself shows zero force before STATUS says
   why: so a row that disagrees is held against it only once another one follows. */
static int64_t echo_saw_(echo_t *echo, int64_t tick, const int32_t u[2], int32_t flags)
{
    if (echo->odd != ODD_NOTHING)
        return echo->odd;
    int64_t begin = tick - 1, last = echo->last;
    int32_t before[2] = {echo->shown[0], echo->shown[1]};
    echo->last = tick;
    memcpy(echo->shown, u, sizeof echo->shown);
    const drive_t *meant = &echo->sent[begin & (SENT - 1)];
    bool sent = meant->tick == begin, limited = (flags & HIL_SENSE_FLAGS_SATURATED) != 0;
    if (sent && u[0] == within(meant->u[0], echo->limit) && u[1] == within(meant->u[1], echo->limit)) {
        if (echo->due == NONE && (u[0] != 0 || u[1] != 0))
            echo->due = begin;
        return ODD_NOTHING;
    }
    if (echo->due == NONE || begin < echo->due)
        return ODD_NOTHING;
    const int32_t *shouldbe = meant->u;
    if (flags & HIL_SENSE_FLAGS_HELD) {
        if (last != begin || (before[0] == u[0] && before[1] == u[1]) || (limited && less(u, before)))
            return ODD_NOTHING;
        echo->odd = ODD_HELD;
        shouldbe = before;
    } else if (!sent) {
        echo->odd = ODD_UNSENT;
    } else if (limited && less(u, meant->u)) {
        return ODD_NOTHING;
    } else {
        echo->odd = ODD_OTHER;
    }
    echo->odd_tick = tick;
    memcpy(echo->odd_shown, u, sizeof echo->odd_shown);
    memcpy(echo->odd_meant, shouldbe, sizeof echo->odd_meant);
    return ODD_NOTHING;
}

#endif
