/* A block of samples in, a block of estimates out; and one sample in, one drive out. */
#ifndef GYRO_BLOCK_H
#define GYRO_BLOCK_H

#include "angle.h"
#include "angle_error.h"
#include "controller.h"
#include "layout.h"
#include "observer.h"
#include "structs.h"

/* Behind the correction: time goes on, and the output row has the innovation. */
static inline void end_sample(const Observer *observer, const Sample *sample, const Workspace *work, Output *row)
{
    const Settings *settings = observer->settings;
    observer->memory->time += (double)sample->h;
    remember_drive(settings, observer->memory, sample->u, sample->terms);
    for (whole axis = 0; axis < settings->axes; axis++) {
        row->nu[axis] = work->innovation[axis];
        row->s[axis] = work->variance[axis];
    }
}

/* One sample: predict with the drive that acted, note how it turned the pattern, correct with what was measured, fill
   the output row. */
static inline void advance_filter(const Observer *observer, const Sample *sample, Workspace *work, Output *row)
{
    const Settings *settings = observer->settings;
    Memory *memory = observer->memory;
    real *x = observer->x, h = sample->h;
    predict(observer, sample, work);
    if (settings->axes == 2) {
        note_forced_rotation(settings, memory, x, h);
        note_gradient(settings, memory, x);
    }
    correct(observer, sample, work);
    end_sample(observer, sample, work, row);
    if (settings->axes == 2) {
        read_angle(settings, memory, x, h, row);
        if (refer_angle(settings, memory)) {
            memory->angle_variance = R(0.0);
            for (whole i = 0; i < MAX_ENTRIES; i++)
                memory->angle_cross[i] = R(0.0);
        }
        row->angle_variance = memory->angle_variance / (settings->angular_gain * settings->angular_gain);
    }
}

/* wide (n, width) <- p (n, n), its rows filled up by zeros. */
static inline void widen(const real *p, whole n, real *wide, whole width)
{
    for (whole i = 0; i < n; i++) {
        for (whole j = 0; j < n; j++)
            wide[i * width + j] = p[i * n + j];
        for (whole j = n; j < width; j++)
            wide[i * width + j] = R(0.0);
    }
}

/* p (n, n) <- a widened one. */
static inline void narrow(const real *wide, whole width, real *p, whole n)
{
    for (whole i = 0; i < n; i++)
        for (whole j = 0; j < n; j++)
            p[i * n + j] = wide[i * width + j];
}

/* State vector and its standard deviations, 0 for what is not estimated, into rows of all states and constants. */
static inline void read_out(const Observer *observer, real *state, real *deviation)
{
    for (whole i = 0; i < observer->total; i++) {
        state[i] = observer->x[i];
        deviation[i] = R(0.0);
    }
    for (whole i = 0; i < observer->n; i++)
        deviation[entry_of(observer->settings, observer->active, i)] = SQRT(observer->c[i * observer->width + i]);
}

#endif
