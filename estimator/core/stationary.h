/* The Riccati recursion along the nominal orbit, its gains gathered by pattern angle and vibration phase. */
#ifndef GYRO_STATIONARY_H
#define GYRO_STATIONARY_H

#include "estimator.h"
#include "layout.h"
#include "observer.h"
#include "pattern.h"

/* How the orbit is gone along: rotation of its pattern, samples h apart, so many of them to settle, so many that count;
   sums of the gains, total (angles, phases, n, axes), and their number, weight (angles, phases). */
typedef struct {
    whole settle;
    whole samples;
    real *total;
    real *weight;
    double rotation;
    double h;
} Gathering;

/* Motion s = (x, vx, y, vy) at scaled time t of the ideal controlled device: unit amplitude, pattern turned at
   -rotation.

   The solution of x'' + x = 2 W y', y'' + y = -2 W x' that is a straight line in the frame that turns with it. */
static inline void orbit(double t, double rotation, real *s)
{
    double fast = sqrt(1.0 + rotation * rotation);
    double along_it = cos(rotation * t), across_it = -sin(rotation * t);
    double r = cos(fast * t), v = -fast * sin(fast * t);
    s[0] = (real)(along_it * r);
    s[2] = (real)(across_it * r);
    s[1] = (real)(along_it * v + rotation * (double)s[2]);
    s[3] = (real)(across_it * v - rotation * (double)s[0]);
}

/* The force u (2,) that keeps a device with constants c on the orbit: (9) and the virtual rotation. */
static inline void holding_force(const real *c, const real *s, real rotation, real *u)
{
    u[0] = (c[KXX] - R(1.0)) * s[0] + c[KXY] * s[2] + c[DXX] * s[1] + c[DXY] * s[3] + R(2.0) * rotation * s[3];
    u[1] = (c[KYY] - R(1.0)) * s[2] + c[KXY] * s[0] + c[DYY] * s[3] + c[DXY] * s[1] - R(2.0) * rotation * s[1];
}

/* Cell of the table for the motion s, as angle times phases and phase. */
static inline whole cell_of(const real *s, whole angles, whole phases)
{
    real theta, phase;
    phase_and_angle(s, R(1.0), &theta, &phase);
    whole row = (whole)FLOOR((theta + R(0.5) * PI) / PI * (real)angles + R(0.5));
    whole column = (whole)FLOOR((phase + PI) / (R(2.0) * PI) * (real)phases + R(0.5));
    if (row >= angles) {
        row -= angles;
        column += phases / 2;
    }
    return row * phases + column % phases;
}

/* Gather the gains along the course.

   The device has the constants in observer->x and is held on the orbit of the ideal controlled one, whose pattern
   precesses: the error system is the device's own, only its motion is the ideal one.  observer->p goes on; the samples
   to settle only bring it to its periodic state.  observer->x is written over in its states. */
EXPORTED void gyro_gather_gains(Estimator *estimator, const Gathering *course)
{
    const Observer wide = widened(estimator), *observer = &wide;
    Workspace *work = workspace_of(estimator);
    const Settings *settings = observer->settings;
    whole states = settings->states, axes = settings->axes, n = observer->n, width = observer->width, cursor = 0;
    real *x = observer->x, *p = observer->p, *gain = work->gain, h = (real)course->h;
    const real *c = x + states, *prior = observer->prior;
    const real none[MAX_AXES] = {R(0.0)};
    for (whole m = 0; m < course->settle + course->samples; m++) {
        real middle[4], u[2];
        Sample sample = {none, u, 1, h};
        orbit(((double)m + 0.5) * course->h, course->rotation, middle);
        holding_force(c, middle, (real)course->rotation, u);
        orbit((double)m * course->h, course->rotation, x);
        predict_state(observer, &sample, work);
        orbit((double)(m + 1) * course->h, course->rotation, x);
        propagate(p, n, width, work->transition, states, work->rows, settings->fade);
        add_process_noise(observer, p, h, observer->count, work->jump);
        predict_measurement(observer, &sample, work);
        for (whole axis = 0; axis < axes; axis++)
            work->assumed[axis] = work->noise[axis] + settings->ignored[axis];
        project(p, n, width, work->jacobian, axes, work->rows);
        kalman_gain(work->rows, n, width, work->jacobian, work->assumed, axes, work->innovation, gain);
        if (m >= course->settle) {
            whole cell = cell_of(x, observer->angles, observer->phases);
            course->weight[cell] += R(1.0);
            for (whole i = 0; i < n; i++)
                for (whole a = 0; a < axes; a++)
                    course->total[(cell * n + i) * axes + a] += gain[2 * i + a];
        }
        joseph(p, n, width, work->rows, work->jacobian, work->assumed, axes, gain, work->projected);
        if (observer->count == 0)
            continue;
        cursor = (cursor + 1) % observer->count;
        if (prior[cursor] > R(0.0)) {
            whole row = states + cursor;
            real *recalled = work->projected, share = p[row * width + row] + prior[cursor];
            for (whole i = 0; i < width; i++) /* zeros behind the last, as in p */
                recalled[i] = p[row * width + i] / share;
            rank_one(p, n, width, row, recalled, prior[cursor], work->projected + width);
        }
    }
    settle(estimator, observer);
}

#endif
