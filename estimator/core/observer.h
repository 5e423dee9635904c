/* The discrete observer (7)(8) of TW I384198 B1: X[m+1] = f(X[m]) + B U[m] + L[m] (Z[m] - H X[m]).

   The gain L comes from an extended Kalman filter, from one with fading memory (Bar-Shalom, Li & Kirubarajan, 2001), or
   from a table derived once from the dynamics.  Beside the filter's covariance P runs the covariance C that the
   estimates really have under that gain, C <- (I - LH)(F C F' + Q)(I - LH)' + L R L': with fading memory P is about
   twice C, with a tabulated gain there is no P at all.  Intervals are reported from C; for the plain EKF the two are one
   and only P is carried.

   Covariances have rows of `width` numbers, of which the first n count; beyond them are zeros, which they stay. */
#ifndef GYRO_OBSERVER_H
#define GYRO_OBSERVER_H

#include "angle_error.h"
#include "flow.h"
#include "lanes.h"
#include "layout.h"
#include "model.h"
#include "pattern.h"
#include "sensing.h"
#include "signals.h"
#include "structs.h"

/* The smoothed NIS is 1 +- 0.16 when the covariance is right: 3 is never reached by chance. */
#define LARGE_NIS R(3.0)
#define ATTENTION R(0.05)
#define FASTEST R(0.1)

/* p <- F p F' of two axes: T = g' p, of which the constants' part is the states' new one, and their square T g. */
static inline void propagate_two(real *p, whole n, whole width, const real *g, real *scratch)
{
    real *mirror = scratch + 4 * width; /* T, column by column */
    for (whole j = 0; j < width; j += 8) { /* eight columns by each of g; an odd four is done twice */
        whole l = j + 4 < width ? j + 4 : j;
        four a = take4(p + j), t0 = scale4(g[0], a), t1 = scale4(g[1], a), t2 = scale4(g[2], a), t3 = scale4(g[3], a);
        four b = take4(p + l), v0 = scale4(g[0], b), v1 = scale4(g[1], b), v2 = scale4(g[2], b), v3 = scale4(g[3], b);
        for (whole k = 1; k < n; k++) {
            const real *q = g + 4 * k;
            a = take4(p + k * width + j);
            b = take4(p + k * width + l);
            t0 = add4(t0, scale4(q[0], a));
            v0 = add4(v0, scale4(q[0], b));
            t1 = add4(t1, scale4(q[1], a));
            v1 = add4(v1, scale4(q[1], b));
            t2 = add4(t2, scale4(q[2], a));
            v2 = add4(v2, scale4(q[2], b));
            t3 = add4(t3, scale4(q[3], a));
            v3 = add4(v3, scale4(q[3], b));
        }
        put_rows4(scratch + j, width, t0, t1, t2, t3);
        put_rows4(scratch + l, width, v0, v1, v2, v3);
        put_columns4(mirror + 4 * j, t0, t1, t2, t3);
        put_columns4(mirror + 4 * l, v0, v1, v2, v3);
    }
    four q = take4(g);
    four t0 = scale4(mirror[0], q), t1 = scale4(mirror[1], q), t2 = scale4(mirror[2], q), t3 = scale4(mirror[3], q);
    for (whole k = 1; k < n; k++) {
        const real *column = mirror + 4 * k;
        q = take4(g + 4 * k);
        t0 = add4(t0, scale4(column[0], q));
        t1 = add4(t1, scale4(column[1], q));
        t2 = add4(t2, scale4(column[2], q));
        t3 = add4(t3, scale4(column[3], q));
    }
    put_rows4(p, width, t0, t1, t2, t3);
    for (whole i = 0; i < 4; i++) {
        for (whole j = i + 1; j < 4; j++)
            p[j * width + i] = p[i * width + j];
        for (whole j = 4; j < width; j += 4)
            put4(p + i * width + j, take4(scratch + i * width + j));
    }
    for (whole j = 4; j < n; j++)
        put4(p + j * width, take4(mirror + 4 * j));
}

/* p (n, width) <- factor F p F' with F = [g'; 0 I]: only the rows of the states change; g (n, states), scratch
   (2 states, width). */
static inline void propagate(real *p, whole n, whole width, const real *g, whole states, real *scratch, real factor)
{
    if (states == 4) {
        propagate_two(p, n, width, g, scratch);
    } else {
        for (whole i = 0; i < states; i++) {
            real *t = scratch + i * width;
            for (whole j = 0; j < n; j++)
                t[j] = R(0.0);
            for (whole k = 0; k < n; k++) {
                real w = g[k * states + i];
                if (w != R(0.0)) /* the sense offsets move nothing */
                    for (whole j = 0; j < n; j++)
                        t[j] += w * p[k * width + j];
            }
        }
        for (whole i = 0; i < states; i++) {
            const real *t = scratch + i * width;
            for (whole j = i; j < states; j++) {
                real total = R(0.0);
                for (whole k = 0; k < n; k++)
                    total += t[k] * g[k * states + j];
                p[i * width + j] = total;
                p[j * width + i] = total;
            }
            for (whole j = states; j < n; j++) {
                p[i * width + j] = t[j];
                p[j * width + i] = t[j];
            }
        }
    }
    if (factor != R(1.0))
        for (whole i = 0; i < n * width; i += 4)
            put4(p + i, scale4(factor, take4(p + i)));
}

/* Force noise on the velocities, random walks on the first `count` constants; the rate's moves the velocities, too (Euler's term). */
static inline void add_process_noise(const Observer *observer, real *p, real h, whole count, real *jumped)
{
    const Settings *settings = observer->settings;
    const whole *active = observer->active;
    const real *intensity = observer->intensity, *s = observer->x;
    whole states = settings->states, width = observer->width;
    for (whole axis = 0; axis < settings->axes; axis++) {
        real q = settings->force_noise[axis];
        whole i = 2 * axis;
        p[i * width + i] += q * h * h * h / R(3.0);
        p[i * width + i + 1] += q * h * h / R(2.0);
        p[(i + 1) * width + i] += q * h * h / R(2.0);
        p[(i + 1) * width + i + 1] += q * h;
    }
    for (whole k = 0; k < count; k++) {
        real q = intensity[k] * h;
        if (q == R(0.0))
            continue;
        whole row = states + k;
        p[row * width + row] += q;
        jump(settings->model, s, active[k], jumped);
        for (whole i = 0; i < states; i++) {
            if (jumped[i] == R(0.0))
                continue;
            p[row * width + i] += q * jumped[i];
            p[i * width + row] += q * jumped[i];
            for (whole j = 0; j < states; j++)
                p[i * width + j] += q * (jumped[i] * jumped[j]); /* in this order: the same in both triangles */
        }
    }
}

/* seen (2, width) <- H p for the channels of jacobian (2, n). */
static inline void project(const real *p, whole n, whole width, const real *jacobian, whole channels, real *seen)
{
    for (whole a = 0; a < channels; a++) {
        real *of_a = seen + a * width;
        for (whole i = 0; i < width; i++)
            of_a[i] = R(0.0);
        for (whole j = 0; j < n; j++) {
            real w = jacobian[a * n + j];
            if (w != R(0.0)) /* few are not */
                for (whole i = 0; i < width; i += 4)
                    put4(of_a + i, add4(take4(of_a + i), scale4(w, take4(p + j * width + i))));
        }
    }
}

/* gain (n, 2) <- p H' inv(S) with S = H p H' + R for one or two channels; returns nu' inv(S) nu per channel, expected
   1; seen (2, width) is H p. */
static inline real kalman_gain(const real *seen, whole n, whole width, const real *jacobian, const real *noise,
                               whole channels, const real *nu, real *gain)
{
    const real *seen0 = seen, *seen1 = seen + width;
    real s00 = noise[0];
    for (whole j = 0; j < n; j++)
        s00 += jacobian[j] * seen0[j];
    if (channels == 1) {
        for (whole i = 0; i < n; i++)
            gain[2 * i] = seen0[i] / s00;
        return nu[0] * nu[0] / s00;
    }
    real s11 = noise[1], s01 = R(0.0);
    for (whole j = 0; j < n; j++) {
        s01 += jacobian[j] * seen1[j];
        s11 += jacobian[n + j] * seen1[j];
    }
    real determinant = s00 * s11 - s01 * s01;
    for (whole i = 0; i < n; i++) {
        gain[2 * i] = (seen0[i] * s11 - seen1[i] * s01) / determinant;
        gain[2 * i + 1] = (seen1[i] * s00 - seen0[i] * s01) / determinant;
    }
    return R(0.5) * (nu[0] * nu[0] * s11 - R(2.0) * nu[0] * nu[1] * s01 + nu[1] * nu[1] * s00) / determinant;
}

/* p <- p - p H' inv(S) H p with S = H p H' + R for two channels whose noise is independent, and gain <- p H' inv(S) of
   p as it was; variance <- the diagonal of S; returns nu' inv(S) nu per channel, expected 1.  H, R and nu stand in work.

   One channel after the other, each with y = p h/sqrt(S): what is taken off, y y', is symmetric to the last bit.  The
   angle's uncertainty follows. */
static inline real measure_two(real *p, whole n, whole width, Memory *memory, Workspace *work)
{
    const real *jacobian = work->jacobian, *noise = work->noise, *nu = work->innovation;
    real *gain = work->gain, *seen0 = work->projected, *seen1 = work->projected + width;
    project(p, n, width, jacobian, 2, work->projected);
    real s00 = noise[0], s01 = R(0.0), s11 = noise[1];
    for (whole j = 0; j < n; j++) {
        s00 += jacobian[j] * seen0[j];
        s01 += jacobian[n + j] * seen0[j];
        s11 += jacobian[n + j] * seen1[j];
    }
    work->variance[0] = s00;
    work->variance[1] = s11;
    real first = R(1.0) / SQRT(s00);
    real shared = first * s01; /* y of the first channel by h of the second */
    real rest = s11 - shared * shared;
    real second = R(1.0) / SQRT(rest);
    work->shared = shared;
    work->deviation[0] = SQRT(s00);
    work->deviation[1] = SQRT(rest);
    for (whole i = 0; i < width; i++) {
        real y = first * seen0[i];
        seen0[i] = y;
        seen1[i] = second * (seen1[i] - shared * y);
    }
    for (whole i = 0; i < n; i++) {
        gain[2 * i + 1] = second * seen1[i];
        gain[2 * i] = first * seen0[i] - first * shared * gain[2 * i + 1];
    }
    turn_angle(memory, jacobian, seen0, n, first);
    turn_angle(memory, jacobian + n, seen1, n, second);
    for (whole j = 0; j < width; j += 4) {
        const four y0 = take4(seen0 + j), y1 = take4(seen1 + j);
        for (whole i = 0; i < n; i++) {
            real *at = p + i * width + j;
            put4(at, sub4(sub4(take4(at), scale4(seen0[i], y0)), scale4(seen1[i], y1)));
        }
    }
    real white = first * nu[0];
    real other = second * (nu[1] - shared * white);
    return R(0.5) * (white * white + other * other);
}

/* Factor on the predicted covariance: the chosen memory, shorter while the innovations deny the covariance.

   An innovation that stays several times larger than predicted means a change or a wrong start; forgetting faster until
   prediction and innovation agree is what lets the observer catch it (adaptive fading, Xia, Rao, Ying & Shen,
   Automatica 30(8), 1994). */
static inline real fading_factor(const Settings *settings, const Memory *memory)
{
    real fade = settings->fade;
    if (fade > R(1.0) && memory->nis > LARGE_NIS) {
        real haste = R(0.01) * (memory->nis - LARGE_NIS);
        fade *= R(1.0) + (FASTEST < haste ? FASTEST : haste);
    }
    return fade;
}

/* p <- p - k w' - w k', both triangles: that costs less than one triangle and its mirror, and rounds alike in both.  Four
   columns at a time, so that what they are made of stays in registers. */
static inline void subtract_products(real *p, whole n, whole width, const real *k, const real *w)
{
    for (whole j = 0; j < width; j += 4) {
        const four ws = take4(w + j), ks = take4(k + j);
        for (whole i = 0; i < n; i++) {
            real *at = p + i * width + j;
            put4(at, sub4(take4(at), add4(scale4(k[i], ws), scale4(w[i], ks))));
        }
    }
}

/* p <- (I - KH) p (I - KH)' + K R K', symmetric to the last bit and positive for any gain (n, 2); seen (2, width)
   is H p, scratch (4, width).

   With S = H p H' + R and W = p H' - K S / 2 it is p - K W' - W K'. */
static inline void joseph(real *p, whole n, whole width, const real *seen, const real *jacobian, const real *noise,
                          whole channels, const real *gain, real *scratch)
{
    real *w0 = scratch, *w1 = scratch + width, *k0 = scratch + 2 * width, *k1 = scratch + 3 * width;
    memcpy(scratch, seen, (size_t)(channels * width) * sizeof *seen);
    for (whole i = 0; i < width; i++) { /* zeros behind the last, as in p */
        k0[i] = i < n ? gain[2 * i] : R(0.0);
        k1[i] = i < n && channels == 2 ? gain[2 * i + 1] : R(0.0);
    }
    real s00 = noise[0];
    for (whole j = 0; j < n; j++)
        s00 += jacobian[j] * w0[j];
    if (channels == 1) {
        for (whole i = 0; i < n; i++)
            w0[i] -= R(0.5) * s00 * k0[i];
        subtract_products(p, n, width, k0, w0);
        return;
    }
    real s11 = noise[1], s01 = R(0.0);
    for (whole j = 0; j < n; j++) {
        s01 += jacobian[j] * w1[j];
        s11 += jacobian[n + j] * w1[j];
    }
    for (whole i = 0; i < n; i++) {
        w0[i] -= R(0.5) * (s00 * k0[i] + s01 * k1[i]);
        w1[i] -= R(0.5) * (s01 * k0[i] + s11 * k1[i]);
    }
    for (whole j = 0; j < width; j += 4) { /* as subtract_products twice, in one pass over p */
        const four w0s = take4(w0 + j), k0s = take4(k0 + j), w1s = take4(w1 + j), k1s = take4(k1 + j);
        for (whole i = 0; i < n; i++) {
            real *at = p + i * width + j;
            four first = add4(scale4(k0[i], w0s), scale4(w0[i], k0s));
            four second = add4(scale4(k1[i], w1s), scale4(w1[i], k1s));
            put4(at, sub4(sub4(take4(at), first), second));
        }
    }
}

/* Joseph update of p for a direct measurement of entry `row` with variance `noise` and any gain (n,); scratch (n,). */
static inline void rank_one(real *p, whole n, whole width, whole row, const real *gain, real noise, real *scratch)
{
    real half = R(0.5) * (p[row * width + row] + noise);
    for (whole i = 0; i < width; i++)
        scratch[i] = p[row * width + i] - half * gain[i];
    subtract_products(p, n, width, gain, scratch);
}

/* Entry of the whole state vector behind entry i of a covariance. */
static inline whole entry_of(const Settings *settings, const whole *active, whole i)
{
    return i < settings->states ? i : settings->states + active[i - settings->states];
}

/* Add to an entry of the state.  What 32 bits round off of it is kept for the next time (Kahan, Comm. ACM 8(1), 1965). */
static inline void add_to(const Observer *observer, whole entry, real change)
{
    real *to = observer->x + entry;
#ifdef CORE_FLOAT32
    real *rest = observer->memory->rest + entry;
    real all = change + *rest, sum = *to + all;
    *rest = all - (sum - *to);
    *to = sum;
#else
    *to += change;
#endif
}

/* Measure one constant against its initial value, with variance `noise`; scratch (2 or more, width). */
static inline void recall_initial(const Observer *observer, whole index, real noise, real *scratch)
{
    const Settings *settings = observer->settings;
    const whole *active = observer->active;
    real *p = observer->p, *c = observer->c, *gain = scratch;
    whole n = observer->n, width = observer->width, row = settings->states + index;
    real share = R(1.0) / (p[row * width + row] + noise);
    real pull = observer->initial[index] - observer->x[settings->states + active[index]];
    for (whole i = 0; i < width; i++) /* zeros behind the last, as in p */
        gain[i] = p[row * width + i] * share;
    for (whole i = 0; i < n; i++)
        add_to(observer, entry_of(settings, active, i), gain[i] * pull);
    if (settings->axes == 2)
        recall_angle(observer->memory, c, n, width, row, gain, noise);
    rank_one(p, n, width, row, gain, noise, scratch + width);
    if (c != p)
        rank_one(c, n, width, row, gain, noise, scratch + width);
}

/* Noise with which a constant is measured against its initial value, 0 for not at all: on the first turn the one that is
   visited next, then each whose variance has passed its initial one. */
static inline real forgotten(const Observer *observer, whole turn, whole *index)
{
    *index = turn == 0 ? observer->memory->cursor : turn - 1;
    if (turn == 0)
        return observer->prior[*index]; /* 0 where it is known exactly from the start: nothing is forgotten of it */
    real spread = observer->spread[*index];
    real variance = observer->p[(observer->settings->states + *index) * (observer->width + 1)];
    return spread > R(0.0) && variance > spread ? variance * spread / (variance - spread) : R(0.0);
}

/* Give back what fading memory forgot of the initial values.

   Fading memory forgets in every direction but learns only in excited ones.  One constant after the other is measured
   against its initial value with just the information that was forgotten (prior, its variance): P stays bounded by about
   the initial spread and an unexcited constant returns to that value instead of drifting (stabilised forgetting, Kulhavy
   & Zarrop, Int. J. Control 58(4), 1993; one direction at a time as in Gunnarsson, CDC 1996).  A constant whose variance
   has passed its initial one (a large memory->nis had the filter forget in haste) is brought back to it at once. */
static inline void remember_prior(const Observer *observer, real *scratch)
{
    observer->memory->cursor = (observer->memory->cursor + 1) % observer->count;
    for (whole turn = 0; turn <= observer->count; turn++) {
        whole index;
        real noise = forgotten(observer, turn, &index);
        if (noise > R(0.0))
            recall_initial(observer, index, noise, scratch);
    }
}

/* Stationary gain (n, 2) at the pattern angle and vibration phase of the states, bilinear in the table.

   The pattern angle is known modulo pi; the angle and pi with the phase and pi is the same motion, which is what the
   wrap uses. */
static inline void tabulated_gain(const Observer *observer, real *gain)
{
    whole angles = observer->angles, phases = observer->phases, channels = observer->settings->axes, n = observer->n;
    real theta, phase;
    phase_and_angle(observer->x, R(1.0), &theta, &phase);
    real u = (theta + R(0.5) * PI) / PI * (real)angles;
    real v = (phase + PI) / (R(2.0) * PI) * (real)phases;
    for (whole i = 0; i < 2 * n; i++)
        gain[i] = R(0.0);
    if (!isfinite(u) || !isfinite(v)) /* of a filter that has diverged: no cell is near */
        return;
    whole i0 = (whole)FLOOR(u), j0 = (whole)FLOOR(v);
    real fu = u - (real)i0, fv = v - (real)j0;
    for (whole di = 0; di < 2; di++) {
        whole row = i0 + di, shift = 0;
        if (row >= angles) {
            row -= angles;
            shift = phases / 2;
        }
        real wu = di == 1 ? fu : R(1.0) - fu;
        for (whole dj = 0; dj < 2; dj++) {
            whole column = (j0 + dj + shift) % phases;
            real w = wu * (dj == 1 ? fv : R(1.0) - fv);
            const real *cell = observer->table + (row * phases + column) * n * channels;
            for (whole i = 0; i < n; i++)
                for (whole a = 0; a < channels; a++)
                    gain[2 * i + a] += w * cell[i * channels + a];
        }
    }
}

/* Whether the gain comes from the covariance recursion: always, but for a table that has taken over. */
static inline int runs_riccati(const Settings *settings, const Memory *memory)
{
    return !(settings->stationary == 1 && memory->time >= (double)settings->takeover);
}

/* Move x over one interval and leave in work the Jacobian rows of the states over [states, active constants]. */
static inline void predict_state(const Observer *observer, const Sample *sample, Workspace *work)
{
    const Settings *settings = observer->settings;
    Memory *memory = observer->memory;
    whole states = settings->states, columns = work->flow.columns;
    real *out = work->flow.out, *g = work->transition, *x = observer->x;
    real(*slips)[MAX_COLUMNS] = work->flow.push.slips;
    Interval interval = {memory->time, sample->h, sample->u, sample->terms};
    signal_values(settings, memory, memory->time, work->flow.push.signals);
    for (whole k = 0; k < settings->slip_count; k++)
        slips[k][0] = memory->signals[settings->slips[k][0]][0];
    if (memory->time == 0.0 && settings->slip_count > 0)
        begin_ways(settings, x + states, x, 1, &work->flow.push);
#ifdef CORE_FLOAT32
    memcpy(work->flow.rest, memory->rest, sizeof memory->rest);
#endif
    flow(settings, &interval, memory->past, x + states, x, columns, &work->flow);
#ifdef CORE_FLOAT32
    memcpy(memory->rest, work->flow.rest, sizeof memory->rest);
#endif
    for (whole k = 0; k < settings->slip_count; k++)
        memory->signals[settings->slips[k][0]][0] = slips[k][0];
    for (whole i = 0; i < states; i++) {
        const real *row = out + i * columns;
        x[i] = row[0];
        for (whole j = 0; j < states; j++)
            g[j * states + i] = row[1 + j];
        for (whole k = 0; k < observer->count; k++) {
            whole offset = observer->active[k] - settings->sense_constants;
            g[(states + k) * states + i] = offset >= 0 ? row[1 + states + offset] : R(0.0);
        }
    }
}

/* Add to predicted measurement and Jacobian in work what it is late by. */
static inline void sense_late(const Observer *observer, const Sample *sample, Workspace *work)
{
    const Settings *settings = observer->settings;
    Memory *memory = observer->memory;
    whole states = settings->states, total = work->total;
    real *out = work->flow.out, *full = work->full, *predicted = work->predicted;
    const real *x = observer->x, *c = x + states;
    for (whole axis = 0; axis < settings->axes; axis++) {
        whole row = 2 * axis, columns = work->flow.columns;
        Interval interval = {memory->time + (double)sample->h, sample->h, sample->u, sample->terms};
        sensed_before(settings, &interval, memory->past, c, x, axis, &work->flow);
        real *of_axis = full + axis * total;
        predicted[axis] += out[row * columns] - x[row];
        of_axis[row] -= R(1.0);
        for (whole j = 0; j < states + settings->flow_constants; j++)
            of_axis[j < states ? j : j + settings->sense_constants] += out[row * columns + 1 + j];
        of_axis[states + settings->sense_delay + axis] -= out[(row + 1) * columns];
    }
}

/* Innovation (0 where z is NaN), measurement Jacobian over [states, active constants] and noise into work; false if z
   is all NaN. */
static inline int predict_measurement(const Observer *observer, const Sample *sample, Workspace *work)
{
    const Settings *settings = observer->settings;
    const real *x = observer->x;
    whole states = settings->states, total = work->total, n = observer->n;
    real *full = work->full, *predicted = work->predicted;
    Push *push = &work->flow.push;
    drive_at(sample->u, settings->axes, sample->terms, R(1.0), push->drive);
    signal_values(settings, observer->memory, observer->memory->time + (double)sample->h, push->signals);
    sensed_at(settings, x + states, x, push, total, predicted, full);
    if (settings->sense_delay >= 0)
        sense_late(observer, sample, work);
    int measured = 0;
    for (whole channel = 0; channel < settings->axes; channel++) {
        int usable = isfinite(sample->z[channel]) != 0;
        const real *of_channel = full + channel * total;
        real *jacobian = work->jacobian + channel * n;
        measured = measured || usable;
        work->innovation[channel] = usable ? sample->z[channel] - predicted[channel] : R(0.0);
        work->noise[channel] = settings->noise[channel];
        for (whole j = 0; j < states; j++)
            jacobian[j] = usable ? of_channel[j] : R(0.0);
        for (whole k = 0; k < observer->count; k++)
            jacobian[states + k] = usable ? of_channel[states + observer->active[k]] : R(0.0);
    }
    return measured;
}

/* Advance state and covariances over the sample's interval with the drive that acted. */
static inline void predict(const Observer *observer, const Sample *sample, Workspace *work)
{
    const Settings *settings = observer->settings;
    real *p = observer->p, *c = observer->c, *g = work->transition, h = sample->h;
    Memory *memory = observer->memory;
    whole n = observer->n, width = observer->width, states = settings->states;
    predict_state(observer, sample, work);
    if (settings->signal_count > 0)
        advance_signals(settings, memory, observer->x + states, sample->u, sample->terms, h);
    if (settings->axes == 2) {
        predict_angle(settings, memory, c, n, width, h);
        move_angle(memory, g, n);
    }
    if (c != p) {
        propagate(c, n, width, g, states, work->rows, R(1.0));
        add_process_noise(observer, c, h, settings->resting == 1 ? 0 : observer->count, work->jump);
    }
    if (runs_riccati(settings, memory)) {
        propagate(p, n, width, g, states, work->rows, fading_factor(settings, memory));
        add_process_noise(observer, p, h, observer->count, work->jump);
    }
}

/* The state, all constants in it, plus gain (n, 2) times the innovation. */
static inline void add_correction(const Observer *observer, const real *gain, const real *nu)
{
    const Settings *settings = observer->settings;
    for (whole i = 0; i < observer->n; i++) {
        real correction = R(0.0);
        for (whole channel = 0; channel < settings->axes; channel++)
            correction += gain[2 * i + channel] * nu[channel];
        add_to(observer, entry_of(settings, observer->active, i), correction);
    }
}

/* Variances of what is measured, of seen (2, width) = H C with the actual covariance, into work. */
static inline void predict_variance(const real *seen, whole n, whole width, whole channels, Workspace *work)
{
    for (whole channel = 0; channel < channels; channel++) {
        real variance = work->noise[channel];
        for (whole i = 0; i < n; i++)
            variance += work->jacobian[channel * n + i] * seen[channel * width + i];
        work->variance[channel] = variance;
        work->deviation[channel] = SQRT(variance);
    }
    work->shared = R(0.0);
}

/* Update state and covariances with the sample (NaN: no measurement); work receives innovation and its variance. */
static inline void correct(const Observer *observer, const Sample *sample, Workspace *work)
{
    const Settings *settings = observer->settings;
    real *p = observer->p, *c = observer->c;
    Memory *memory = observer->memory;
    const real *nu = work->innovation;
    real *jacobian = work->jacobian, *gain = work->gain, *noise = work->noise, *assumed = work->assumed;
    whole channels = settings->axes, n = observer->n, width = observer->width;
    int measured = predict_measurement(observer, sample, work);
    int riccati = runs_riccati(settings, memory);
    for (whole channel = 0; channel < channels; channel++)
        assumed[channel] = noise[channel] + settings->ignored[channel];
    if (measured && riccati && channels == 2 && c == p) {
        real nis = measure_two(p, n, width, memory, work);
        memory->nis += (nis - memory->nis) * ATTENTION;
        add_correction(observer, gain, nu);
    } else {
        real *seen_actual = work->rows, *seen = seen_actual; /* H C, and H P */
        project(c, n, width, jacobian, channels, seen_actual);
        predict_variance(seen_actual, n, width, channels, work);
        if (!measured)
            return;
        if (riccati && c != p) {
            seen = seen_actual + 2 * width;
            project(p, n, width, jacobian, channels, seen);
        }
        if (riccati) {
            real nis = kalman_gain(seen, n, width, jacobian, assumed, channels, nu, gain);
            memory->nis += (nis - memory->nis) * ATTENTION;
        } else {
            tabulated_gain(observer, gain);
            for (whole channel = 0; channel < channels; channel++)
                if (!isfinite(sample->z[channel]))
                    for (whole i = 0; i < n; i++)
                        gain[2 * i + channel] = R(0.0);
        }
        add_correction(observer, gain, nu);
        if (channels == 2)
            correct_angle(memory, seen_actual, n, width, jacobian, noise, channels, gain);
        if (c != p)
            joseph(c, n, width, seen_actual, jacobian, noise, channels, gain, work->projected);
        if (riccati)
            joseph(p, n, width, seen, jacobian, assumed, channels, gain, work->projected);
    }
    if (riccati && settings->fade > R(1.0) && observer->count > 0)
        remember_prior(observer, work->projected);
}

/* past (intervals, axes, terms), newest first, gets u (axes, terms) in front and loses its oldest. */
static inline void shift_drives(real (*past)[MAX_AXES][MAX_DEGREE], const real *u, whole axes, whole terms)
{
    for (whole j = MAX_DELAY; j > 0; j--)
        memcpy(past[j], past[j - 1], sizeof past[j]);
    memset(past[0], 0, sizeof past[0]);
    for (whole axis = 0; axis < axes; axis++)
        for (whole n = 0; n < terms && n < MAX_DEGREE; n++)
            past[0][axis][n] = u[axis * terms + n];
}

/* Keep the drive of the interval that has ended, for a path that is late. */
static inline void remember_drive(const Settings *settings, Memory *memory, const real *u, whole terms)
{
    if (settings->drive_delay >= 0 || settings->sense_delay >= 0 || settings->watched_drive_delay >= 0)
        shift_drives(memory->past, u, settings->axes, terms);
}

#endif
