/* Gain mode on the board, per tick (device_emulator/feedback.py has the law). */
#ifndef EMULATOR_FEEDBACK_H
#define EMULATOR_FEEDBACK_H

#include <math.h>

#include "structs.h"

#define TAPS UINT32_C(0xA3000000) /* x³² + x³⁰ + x²⁶ + x²⁵ + 1, primitive: the register takes all its 2³² − 1 values */

/* Drive codes of the interval that ends at `row`, taken from the queue. */
static inline void due(feedback_t *loop, int64_t row, int32_t codes[2])
{
    int32_t *queued = loop->queue[modulo(row, QUEUE)];
    for (int axis = 0; axis < 2; axis++) {
        codes[axis] = queued[axis];
        queued[axis] = 0;
    }
}

/* Compute from the codes just sampled at `tick` the drive it leads to, and queue it. */
static inline void feed_back(feedback_t *loop, int64_t tick, const int32_t codes[2])
{
    double *now = loop->past[modulo(tick, HISTORY)];
    now[0] = codes[0];
    now[1] = codes[1];
    const double *before = loop->past[modulo(tick - loop->delay, HISTORY)];
    for (int axis = 0; axis < 2; axis++) {
        double s0 = loop->s[axis][0], s1 = loop->s[axis][1];
        for (int i = 0; i < 2; i++)
            loop->s[axis][i] = loop->a[i][0] * s0 + loop->a[i][1] * s1 + loop->b[i] * now[axis] + loop->c[i] * before[axis];
    }
    bool over = false;
    for (int axis = 0; axis < 2; axis++) {
        uint32_t bit = loop->shift & 1U;
        loop->shift >>= 1;
        if (bit)
            loop->shift ^= TAPS;
        double code = 0.0;
        if (loop->closed) {
            code = loop->bias[axis] + (double)(bit ? loop->dither : -loop->dither);
            for (int i = 0; i < 4; i++)
                code += loop->gain[axis][i] * loop->s[i / 2][i % 2];
            code = isnan(code) ? 0.0 : rint(code);
        }
        if (fabs(code) > (double)loop->limit) {
            over = true;
            code = within(code, (double)loop->limit);
        }
        loop->queue[modulo(tick + loop->latency + 1, QUEUE)][axis] = (int32_t)code;
    }
    loop->limited += over;
}

#endif
