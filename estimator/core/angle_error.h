/* What is not known of the reported angle: its variance, and its covariance with the state, from sample to sample.

   The angle is phi = -(theta - theta0) less what forces turned the pattern by, and both are estimates.  In a prediction
   it moves by rate h, in a correction by what that turns theta by, -g K nu with g the gradient of theta by the states
   and by the rate, with which theta is read: so its error e obeys

       e <- e + (error of the rate) h,   s <- F s + w
       e <- e + g K (H s - n),           s <- s - K (H s - n)

   whatever the gain K is, and its covariance follows in Joseph's form beside C (observer.h).  What forces turned the
   pattern by is in it through the constants it was computed with.  From the reference instant on, the angle is counted
   from its value there, which is then exact by definition. */
#ifndef GYRO_ANGLE_ERROR_H
#define GYRO_ANGLE_ERROR_H

#include "layout.h"
#include "pattern.h"

/* memory->gradient <- that of the pattern angle at s, as it was read last; the rate is in it through the velocities.  0
   for a mass at rest, which has no angle, and in open loop, where no correction of the state turns the integrated rate. */
static void note_gradient(const Settings *settings, Memory *memory, const real *s)
{
    if (settings->open_loop == 1)
        return;
    real by[5];
    pattern_gradient(s, settings->stiffness, memory->rotation, memory->rate, by);
    for (whole i = 0; i < 4; i++)
        memory->gradient[i] = by[i];
    if (settings->rate_row >= 0)
        memory->gradient[settings->rate_row] = by[4];
}

/* Whether this is the reference instant. */
static int refer_angle(const Settings *settings, Memory *memory)
{
    if (memory->referred == 1 || memory->time < (double)settings->reference)
        return 0;
    memory->referred = 1;
    return 1;
}

/* The angle's error before the states move; c (n, width) is the covariance of states and constants. */
static void predict_angle(const Settings *settings, Memory *memory, const real *c, whole n, whole width, real h)
{
    whole rate = settings->rate_row;
    real *cross = memory->angle_cross;
    memory->angle_variance += h * (R(2.0) * cross[rate] + h * c[rate * width + rate]);
    for (whole i = 0; i < n; i++)
        cross[i] += h * c[i * width + rate];
}

/* The states' part of the cross-covariance by the flow g (n, 4). */
static void move_angle(Memory *memory, const real *g, whole n)
{
    real *cross = memory->angle_cross;
    real a0 = R(0.0), a1 = R(0.0), a2 = R(0.0), a3 = R(0.0);
    for (whole j = 0; j < n; j++) {
        a0 += g[4 * j] * cross[j];
        a1 += g[4 * j + 1] * cross[j];
        a2 += g[4 * j + 2] * cross[j];
        a3 += g[4 * j + 3] * cross[j];
    }
    cross[0] = a0;
    cross[1] = a1;
    cross[2] = a2;
    cross[3] = a3;
}

/* A correction with gain (n, 2); jacobian (2, n), seen (2, width) what it shows of the covariance before, H C. */
static void correct_angle(Memory *memory, const real *seen, whole n, whole width, const real *jacobian,
                          const real *noise, whole channels, const real *gain)
{
    real *cross = memory->angle_cross;
    real turns[MAX_AXES], seens[MAX_AXES];
    for (whole a = 0; a < channels; a++) { /* one after the other, with what they share in the second */
        real turn = R(0.0), shared = R(0.0);
        for (whole j = 0; j < n; j++) {
            turn -= memory->gradient[j] * gain[2 * j + a];
            shared += jacobian[a * n + j] * cross[j];
        }
        turns[a] = turn;
        seens[a] = shared;
    }
    for (whole a = 0; a < channels; a++) {
        const real *shown = seen + a * width;
        real pushed = R(0.0);
        memory->angle_variance -= R(2.0) * turns[a] * seens[a];
        for (whole b = 0; b < channels; b++) {
            real s = a == b ? noise[a] : R(0.0);
            for (whole j = 0; j < n; j++)
                s += jacobian[b * n + j] * shown[j];
            pushed += s * turns[b];
        }
        memory->angle_variance += pushed * turns[a];
        for (whole i = 0; i < n; i++)
            cross[i] += (pushed - seens[a]) * gain[2 * i + a] - turns[a] * shown[i];
    }
}

/* A direct measurement of entry `row` with gain (n,), c (n, width) as it was before. */
static void recall_angle(Memory *memory, const real *c, whole n, whole width, whole row, const real *gain, real noise)
{
    real *cross = memory->angle_cross;
    real turn = R(0.0);
    for (whole i = 0; i < n; i++)
        turn -= memory->gradient[i] * gain[i];
    real seen = cross[row];
    real pushed = (c[row * width + row] + noise) * turn;
    memory->angle_variance += (pushed - R(2.0) * seen) * turn;
    for (whole i = 0; i < n; i++)
        cross[i] += (pushed - seen) * gain[i] - turn * c[row * width + i];
}

/* A measurement h (n,) taken in by the Kalman gain y/sqrt(S), y = C h/sqrt(S); share: 1/sqrt(S).

   With that gain what `correct_angle` says of the covariance comes down to -(h c) y/sqrt(S), c the covariance before. */
static void turn_angle(Memory *memory, const real *h, const real *y, whole n, real share)
{
    real *cross = memory->angle_cross;
    real turn = R(0.0), seen = R(0.0);
    for (whole j = 0; j < n; j++) {
        turn -= memory->gradient[j] * y[j];
        seen += h[j] * cross[j];
    }
    seen *= share;
    memory->angle_variance += (turn - R(2.0) * seen) * turn;
    for (whole i = 0; i < n; i++)
        cross[i] -= seen * y[i];
}

#endif
