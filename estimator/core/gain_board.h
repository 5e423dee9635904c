/* The law of a board in gain mode, on the host: what it did while nothing was heard of it (estimator/gain_board.py). */
#ifndef GYRO_GAIN_BOARD_H
#define GYRO_GAIN_BOARD_H

#include <math.h>

#include "layout.h"
#include "taylor.h"

#define BOARD_HISTORY 64
#define BOARD_QUEUE (MAX_LATENCY + 2)
#define DITHER_TAPS UINT32_C(0xA3000000)

typedef struct {
    real a[2][2];
    real b[2];
    real c[2];
    whole delay;
    whole latency;
    real limit; /* drive codes */
    real dither;
    whole closed;
    real gain[2][4];
    real bias[2];
    whole waiting; /* 1: the matrix below waits for its tick */
    whole effective;
    real next_gain[2][4];
    real next_bias[2];
    real s[2][2];                /* of each axis */
    real past[BOARD_HISTORY][2]; /* sense codes, by tick */
    uint32_t shift;              /* register of the dither */
    real queue[BOARD_QUEUE][2];  /* drive codes, by the tick at which their interval ends */
} Board;

static whole board_place(whole tick, whole size)
{
    whole place = tick % size;
    return place < 0 ? place + size : place;
}

/* A matrix was sent to it, in force from the tick `effective` on. */
EXPORTED void estimator_board_tell(Board *board, const real *gain, const real *bias, whole effective)
{
    memcpy(board->next_gain, gain, sizeof board->next_gain);
    memcpy(board->next_bias, bias, sizeof board->next_bias);
    board->effective = effective;
    board->waiting = 1;
}

/* The drive code of an axis, from what its filter shows and the next bit of the dither. */
static real board_code(Board *board, int axis)
{
    uint32_t bit = board->shift & 1U;
    board->shift >>= 1;
    if (bit)
        board->shift ^= DITHER_TAPS;
    if (board->closed != 1)
        return R(0.0);
    real code = board->bias[axis] + (bit ? board->dither : -board->dither);
    for (int i = 0; i < 4; i++)
        code += board->gain[axis][i] * board->s[i / 2][i % 2];
    return fmin(fmax(rint(code), -board->limit), board->limit);
}

/* Carry the board over the tick at which the codes vx, vy were sampled. */
static void board_sampled(Board *board, whole tick, real vx, real vy)
{
    if (board->waiting == 1 && board->effective <= tick) {
        for (int axis = 0; axis < 2; axis++) {
            for (int i = 0; i < 4; i++)
                board->gain[axis][i] = board->next_gain[axis][i];
            board->bias[axis] = board->next_bias[axis];
        }
        board->waiting = 0;
        board->closed = 1;
    }
    real *now = board->past[board_place(tick, BOARD_HISTORY)];
    const real *then = board->past[board_place(tick - board->delay, BOARD_HISTORY)];
    now[0] = vx;
    now[1] = vy;
    for (int axis = 0; axis < 2; axis++) {
        real s0 = board->s[axis][0], s1 = board->s[axis][1];
        for (int i = 0; i < 2; i++)
            board->s[axis][i] =
                board->a[i][0] * s0 + board->a[i][1] * s1 + board->b[i] * now[axis] + board->c[i] * then[axis];
    }
    for (int axis = 0; axis < 2; axis++)
        board->queue[board_place(tick + board->latency + 1, BOARD_QUEUE)][axis] = board_code(board, axis);
}

/* Carry the board over rows that were received: codes (rows, columns), of which the first two are those sampled, from
   tick `first` on. */
EXPORTED void estimator_board_follow(Board *board, whole first, const int32_t *codes, whole rows, whole columns)
{
    for (whole row = 0; row < rows; row++)
        board_sampled(board, first + row, (real)codes[row * columns], (real)codes[row * columns + 1]);
}

/* Carry the board over rows that were not, from tick `first` on, by what the model says it sampled.

   x is the state vector at the row before; drives (rows, 2) receives the drive codes over the interval that ends at
   each. */
EXPORTED void gyro_board_foresee(const Settings *settings, Board *board, const real *x, whole first, whole rows,
                                 real *drives)
{
    const real *constants = x + settings->states;
    real motion[4] = {x[0], x[1], x[2], x[3]}, term[4], codes[2];
    for (whole row = 0; row < rows; row++) {
        whole tick = first + row;
        real u[2];
        for (int axis = 0; axis < 2; axis++) {
            drives[2 * row + axis] = board->queue[board_place(tick, BOARD_QUEUE)][axis];
            u[axis] = drives[2 * row + axis] * settings->quantum;
        }
        taylor(settings->model, constants, u, 1, settings->h, settings->order, 1, term, motion, 1);
        for (int axis = 0; axis < 2; axis++)
            codes[axis] = rint((motion[2 * axis + settings->sensed[axis]] + constants[PHI_X + axis]) /
                               settings->sense_scale[axis]);
        board_sampled(board, tick, codes[0], codes[1]);
    }
}

#endif
