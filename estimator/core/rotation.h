/* The covariance of 13 states and of the rotation since an instant, one more state (estimator/rotation.py). */
#ifndef GYRO_ROTATION_H
#define GYRO_ROTATION_H

#include <math.h>

#include "layout.h"

#define TURNED 14 /* 13 states and the rotation, the last */

typedef struct {
    whole n;
    whole reference;         /* row from which on the deviation counts */
    const real *steps;       /* (n, 4, 11): x, v, y, v after a step by themselves and by rate, stiffness, damping */
    const real *rate;        /* (n,) before the step */
    const real *x;           /* (n, 13) at which the random walk of the rate acts */
    const uint8_t *seen;     /* (n, 2) */
    const real *innovation;  /* (n, 2) */
    real (*p)[TURNED];       /* (14, 14), carried on */
    const real (*q)[TURNED]; /* (14, 14) noise of a step */
    const real *noise;       /* (2,) of a sample */
    real *rotation;          /* (n,) */
    real *deviation;         /* (n,) */
    real *states;            /* (n, 13) deviations */
    real rate_intensity;
    real h;
} Turning;

/* p <- F p F' + q; only rows of the motion and the last of F (14, 14) differ from those of unity. */
static void turning_propagate(const Turning *f, const real *step)
{
    static const int moved[5] = {0, 1, 2, 3, 13};
    real rows[5][TURNED] = {{R(0.0)}}, half[5][TURNED];
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 4; j++)
            rows[i][j] = step[11 * i + j];
        for (int j = 0; j < 7; j++)
            rows[i][6 + j] = step[11 * i + 4 + j];
    }
    rows[4][13] = R(1.0);
    rows[4][6] = f->h;
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < TURNED; j++) {
            real total = R(0.0);
            for (int k = 0; k < TURNED; k++)
                total += rows[i][k] * f->p[k][j];
            half[i][j] = total;
        }
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < TURNED; j++) {
            f->p[moved[i]][j] = half[i][j];
            f->p[j][moved[i]] = half[i][j];
        }
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < 5; j++) {
            real total = R(0.0);
            for (int k = 0; k < TURNED; k++)
                total += half[i][k] * rows[j][k];
            f->p[moved[i]][moved[j]] = total;
        }
    for (int i = 0; i < TURNED; i++)
        for (int j = 0; j < TURNED; j++)
            f->p[i][j] += f->q[i][j];
}

/* Take one sample in, one channel after the other; returns what it corrects the rotation by. */
static real turning_correct(const Turning *f, whole m)
{
    real correction[TURNED] = {R(0.0)}, towards[TURNED];
    for (int axis = 0; axis < 2; axis++) {
        if (!f->seen[2 * m + axis])
            continue;
        int position = 2 * axis, offset = 4 + axis;
        for (int i = 0; i < TURNED; i++)
            towards[i] = f->p[i][position] + f->p[i][offset];
        real variance = towards[position] + towards[offset] + f->noise[axis];
        real left = (f->innovation[2 * m + axis] - correction[position] - correction[offset]) / variance;
        for (int i = 0; i < TURNED; i++) {
            correction[i] += towards[i] * left;
            for (int j = 0; j < TURNED; j++)
                f->p[i][j] -= towards[i] * towards[j] / variance;
        }
    }
    return correction[13];
}

/* The Riccati recursion over n samples. */
EXPORTED void gyro_turning(const Turning *f)
{
    /* What a unit jump of the rate does: Euler's acceleration, and the rotation from the middle of the step on. */
    real jump[TURNED] = {R(0.0)}, total = R(0.0);
    jump[6] = R(1.0);
    jump[13] = R(0.5) * f->h;
    for (whole m = 0; m < f->n; m++) {
        jump[1] = f->x[13 * m + 2];
        jump[3] = -f->x[13 * m];
        total += f->h * f->rate[m];
        turning_propagate(f, f->steps + 44 * m);
        for (int i = 0; i < TURNED; i++)
            for (int j = 0; j < TURNED; j++)
                f->p[i][j] += f->rate_intensity * f->h * jump[i] * jump[j];
        total += turning_correct(f, m);
        for (int i = 0; m == f->reference && i < TURNED; i++)
            f->p[13][i] = f->p[i][13] = R(0.0);
        f->rotation[m] = total;
        f->deviation[m] = sqrt(fmax(f->p[13][13], R(0.0)));
        for (int i = 0; i < 13; i++)
            f->states[13 * m + i] = sqrt(fmax(f->p[i][i], R(0.0)));
    }
}

#endif
