/* The observer's run over a block of samples with the signatures of effects it does not carry.

   The signature of a coefficient is what the innovations would gain if it were 1: a small change of force or measurement
   moves prediction and correction alike, dx- = F dx + G, dnu = -(H dx- + e), dx+ = dx- + L dnu (Willsky & Jones, IEEE
   Trans. Automatic Control 21(1), 1976, for jumps).  What the filter's own states and constants can take up is projected
   out by the filter itself.  The sums N = S dnu S^-1 dnu' and b = S dnu S^-1 nu are the normal equations of all
   coefficients at once.

   The reported angle is followed the same way: from one sample to the next it moves by the rate, and by what the
   correction turns the pattern (angle.h); the derivative of both along dx is what a coefficient would move it by. */
#ifndef GYRO_SCAN_H
#define GYRO_SCAN_H

#include "estimator.h"

#define SCAN_NODES 3

/* Gauss and Legendre on [0, 1], three nodes: exact to degree 5. */
static const real SCAN_NODE[SCAN_NODES] = {R(0.11270166537925831), R(0.5), R(0.88729833462074169)};
static const real SCAN_WEIGHT[SCAN_NODES] = {R(0.27777777777777778), R(0.44444444444444444), R(0.27777777777777778)};

/* n samples, and what is followed of `count` coefficients that the filter does not carry.

   The first `known` of them are constants of the flow that the filter takes as known, by their index among all constants,
   or what moves by its start alone, at an index below zero: then the sums are score and information of a likelihood in
   which they are parameters.  The others are coefficients of effects that are zero, the last among the constants.

   delta: sensitivity of the filter's estimates to them, carried on; turned: that of the pattern angle of two axes, carried
   on where it is given.  equations receive, where they are given, the innovations' sensitivities, behind them the
   innovation, all over its deviation, and where there is room its logarithm; columns beyond are left alone. */
typedef struct {
    whole n;
    whole terms;             /* of the drive's polynomial in each interval */
    whole count;             /* coefficients */
    whole known;             /* constants of the flow among them */
    whole width;             /* numbers in a row of equations */
    const whole *constants;  /* (known,) */
    const real *z;           /* (n, axes) measured */
    const real *u;           /* (n, axes, terms) drive over the interval that ends at each sample */
    const real *h;           /* (n,) its length */
    const real *temperature; /* (n,), where it is measured */
    real *delta;             /* (states + active constants, count) */
    real *equations;         /* (axes n, width) */
    real *turned;            /* (count,) */
    real *scratch;           /* (2 constants + 6 count,) */
} Scan;

/* A scan while a block is gone through. */
typedef struct {
    whole count;
    whole known;         /* the first of them, constants of the flow */
    whole watched;       /* the others */
    const whole *index;  /* (known,) of each among the constants */
    whole constants;     /* all of them, the watched coefficients last */
    whole origin;        /* index of the first watched coefficient among them */
    whole rate_row;      /* the rate's in delta, -1 for none */
    whole rows;          /* of delta */
    real *delta;         /* (rows, count) */
    real *turned;        /* (count,) */
    real *by_constants;  /* (2, constants), scratch */
    real *signature;     /* (2, count), the innovations' sensitivities */
    real *product;       /* (states, count), scratch */
    real length;         /* of the interval that the responses are of */
    real response[SCAN_NODES + 1][4][2]; /* what a unit impulse on each axis at the nodes, and at the start, leaves */
} Following;

/* to (count,) += w from (count,). */
static inline void add_scaled(real *restrict to, const real *restrict from, real w, whole count)
{
    for (whole k = 0; k < count; k++)
        to[k] += w * from[k];
}

/* to (count,) += a from + b other. */
static inline void add_both(real *restrict to, const real *restrict from, real a, const real *restrict other, real b,
                            whole count)
{
    for (whole k = 0; k < count; k++)
        to[k] += a * from[k] + b * other[k];
}

/* Four rows of `to`, so long each, += by w (4,) from one of `from` (count,). */
static inline void add_to_four(real *restrict to, whole stride, const real *restrict from, const real *w, whole count)
{
    real *restrict t0 = to, *restrict t1 = to + stride, *restrict t2 = to + 2 * stride, *restrict t3 = to + 3 * stride;
    real w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];
    for (whole k = 0; k < count; k++) {
        real p = from[k];
        t0[k] += w0 * p;
        t1[k] += w1 * p;
        t2[k] += w2 * p;
        t3[k] += w3 * p;
    }
}

static inline void clear(real *numbers, whole count)
{
    for (whole k = 0; k < count; k++)
        numbers[k] = R(0.0);
}

/* The response of the states at the end of an interval h to unit impulses in it. */
static inline void responses(const Settings *settings, const real *c, real h, FlowWork *flow, Following *follow)
{
    whole states = settings->states, columns = flow->columns;
    const real rest[MAX_AXES] = {R(0.0), R(0.0)};
    for (int node = 0; node <= SCAN_NODES; node++) {
        real left = node < SCAN_NODES ? R(1.0) - SCAN_NODE[node] : R(1.0);
        for (whole axis = 0; axis < settings->axes; axis++) {
            for (whole i = 0; i < states; i++)
                flow->out[i * columns] = R(0.0);
            flow->out[(2 * axis + 1) * columns] = R(1.0);
            taylor(settings->model, c, rest, 1, left * h, settings->order, 1, flow->term, flow->out, columns);
            for (whole i = 0; i < states; i++)
                follow->response[node][i][axis] = flow->out[i * columns];
        }
    }
}

/* What a late drive pushes more than one in time: less its slope all along the interval. */
static inline void add_slope(const Settings *settings, const real *u, whole terms, real at, real h, Following *follow)
{
    for (whole axis = 0; axis < settings->axes; axis++) {
        real slope = R(0.0);
        for (whole n = terms - 1; n > 0; n--)
            slope = slope * at + (real)n * u[axis * terms + n];
        follow->by_constants[axis * follow->constants + settings->watched_drive_delay + axis] -= slope / h;
    }
}

/* ... and the jump at its beginning. */
static inline void add_jump(const Settings *settings, const Memory *memory, const real *u, whole terms,
                            const Following *follow)
{
    for (whole axis = 0; axis < settings->axes; axis++) {
        real ended = R(0.0);
        for (whole n = 0; n < terms && n < MAX_DEGREE; n++)
            ended += memory->past[1][axis][n];
        whole k = follow->known + settings->watched_drive_delay + axis - follow->origin;
        for (whole i = 0; i < settings->states; i++)
            follow->delta[i * follow->count + k] +=
                follow->response[SCAN_NODES][i][axis] * (ended - u[axis * terms]);
    }
}

/* Add to the states' rows of delta what the watched forces push over the interval that has ended; before: the states at
   its beginning; c: the constants; memory's time is that of its end. */
static inline void add_forced(const Settings *settings, const Memory *memory, const real *before, const real *c,
                              const Sample *sample, const Following *follow, Workspace *work)
{
    whole states = settings->states, axes = settings->axes, terms = sample->terms, columns = work->flow.columns;
    const real *u = sample->u;
    real h = sample->h, *out = work->flow.out, at = R(0.0), part[MAX_AXES * MAX_DEGREE], state[4];
    Push *push = &work->flow.push;
    Following *mutable = (Following *)follow;
    for (whole i = 0; i < states; i++)
        out[i * columns] = before[i];
    for (int node = 0; node < SCAN_NODES; node++) {
        real length = SCAN_NODE[node] - at;
        part_of(u, axes, terms, at, length, part);
        taylor(settings->model, c, part, terms, length * h, settings->order, 1, work->flow.term, out, columns);
        at = SCAN_NODE[node];
        for (whole i = 0; i < states; i++)
            state[i] = out[i * columns];
        drive_at(u, axes, terms, at, push->drive);
        line_values(settings, settings->signal_count, memory->time + (at - R(1.0)) * h, push->signals);
        directions(settings, settings->signal_count, state, push->signals);
        clear(follow->by_constants, 2 * follow->constants);
        for (whole e = settings->effect_count; e < settings->effect_count + settings->candidate_count; e++)
            effect_force(settings->effects[e][0], settings->model, c, state, push->drive, push->signals,
                         settings->effects[e][1], settings->effects[e][2], push->force, push->by_states, states,
                         follow->by_constants, follow->constants);
        if (settings->watched_drive_delay >= 0)
            add_slope(settings, u, terms, at, h, mutable);
        for (whole axis = 0; axis < axes; axis++) {
            const real *pushed = follow->by_constants + axis * follow->constants + follow->origin;
            real w[4], *to = follow->delta + follow->known;
            for (whole i = 0; i < states; i++)
                w[i] = SCAN_WEIGHT[node] * h * follow->response[node][i][axis];
            if (states == 4)
                add_to_four(to, follow->count, pushed, w, follow->watched);
            else
                for (whole i = 0; i < states; i++)
                    add_scaled(to + i * follow->count, pushed, w[i], follow->watched);
        }
    }
    if (settings->watched_drive_delay >= 0)
        add_jump(settings, memory, u, terms, mutable);
}

/* signature <- less what the watched effects add to the measurement at the interval's end; x: states and constants. */
static inline void watch_sensed(const Settings *settings, const real *x, const real *u, whole terms,
                                const Following *follow, Workspace *work)
{
    whole states = settings->states;
    const real *c = x + states, *s = x;
    Push *push = &work->flow.push;
    Motion motion;
    drive_at(u, settings->axes, terms, R(1.0), push->drive);
    if (senses_otherwise(settings)) {
        sensed_motion(settings, c, s, push, &motion);
        s = motion.q;
    }
    clear(follow->by_constants, 2 * follow->constants);
    for (whole e = settings->effect_count; e < settings->effect_count + settings->candidate_count; e++)
        effect_sense(settings->effects[e][0], settings->model, c, s, push->drive, push->signals,
                     settings->effects[e][1], settings->effects[e][2], push->force, push->by_states, states,
                     follow->by_constants, follow->constants);
    for (whole axis = 0; settings->watched_sense_delay >= 0 && axis < settings->axes; axis++)
        follow->by_constants[axis * follow->constants + settings->watched_sense_delay + axis] -= s[2 * axis + 1];
    for (whole axis = 0; axis < settings->axes; axis++)
        for (whole k = 0; k < follow->watched; k++)
            follow->signature[axis * follow->count + follow->known + k] =
                -follow->by_constants[axis * follow->constants + follow->origin + k];
}

/* Add to the states' rows of delta what the flow has by the constants that are known. */
static inline void add_known(const Settings *settings, const Following *follow, const FlowWork *flow)
{
    for (whole k = 0; k < follow->known; k++) {
        if (follow->index[k] < 0)
            continue;
        whole column = 1 + settings->states + follow->index[k] - settings->sense_constants;
        for (whole i = 0; i < settings->states; i++)
            follow->delta[i * follow->count + k] += flow->out[i * flow->columns + column];
    }
}

/* signature <- less what the measurement has by the constants that are known, from its jacobian by all constants. */
static inline void know_sensed(const Settings *settings, const Following *follow, const Workspace *work)
{
    for (whole axis = 0; axis < settings->axes; axis++)
        for (whole k = 0; k < follow->known; k++) {
            whole entry = axis * work->total + settings->states + follow->index[k];
            follow->signature[axis * follow->count + k] = follow->index[k] < 0 ? R(0.0) : -work->full[entry];
        }
}

/* First rows of delta <- g' delta; g (rows of delta, states). */
static inline void multiply_rows(const real *g, whole states, const Following *follow)
{
    whole count = follow->count;
    real *product = follow->product;
    clear(product, states * count);
    for (whole j = 0; j < follow->rows; j++) {
        const real *w = g + j * states, *from = follow->delta + j * count;
        int moves = 0;
        for (whole i = 0; i < states; i++)
            moves |= w[i] != R(0.0);
        if (!moves) /* the sense offsets move nothing */
            continue;
        if (states == 4)
            add_to_four(product, count, from, w, count);
        else
            for (whole i = 0; i < states; i++)
                add_scaled(product + i * count, from, w[i], count);
    }
    for (whole k = 0; k < states * count; k++)
        follow->delta[k] = product[k];
}

/* turned += sign times what the pattern angle moves by along delta, at the states s and the rotation w. */
static inline void add_turn(const Settings *settings, const real *s, real w, real rate, real sign,
                            const Following *follow)
{
    real gradient[5];
    pattern_gradient(s, settings->stiffness, w, rate, gradient);
    for (whole i = 0; i < 4; i++)
        add_scaled(follow->turned, follow->delta + i * follow->count, sign * gradient[i], follow->count);
    if (follow->rate_row >= 0)
        add_scaled(follow->turned, follow->delta + follow->rate_row * follow->count, sign * gradient[4], follow->count);
}

/* delta after a measurement of constant `row` with this gain against an initial value that no coefficient moves. */
static inline void pull(whole row, const real *gain, const Following *follow)
{
    real *moved = follow->product; /* a copy: the row itself changes */
    for (whole k = 0; k < follow->count; k++)
        moved[k] = follow->delta[row * follow->count + k];
    for (whole j = 0; j < follow->rows; j++)
        if (gain[j] != R(0.0))
            add_scaled(follow->delta + j * follow->count, moved, -gain[j], follow->count);
}

/* `remember_prior` of the observer, the sensitivities pulled along; the cursor has moved on already. */
static inline void recall(const Observer *observer, real *scratch, const Following *follow)
{
    for (whole turn = 0; turn <= observer->count; turn++) {
        whole index;
        real noise = forgotten(observer, turn, &index);
        if (noise > R(0.0)) {
            recall_initial(observer, index, noise, scratch);
            pull(observer->settings->states + index, scratch, follow);
        }
    }
}

/* signature <- what the innovations gain, nothing where a channel is lost; returns how many are not. */
static inline int show(const Settings *settings, const Sample *sample, const Workspace *work, const Following *follow)
{
    int usable = 0;
    for (whole axis = 0; axis < settings->axes; axis++) {
        real *seen = follow->signature + axis * follow->count;
        if (!isfinite(sample->z[axis])) {
            clear(seen, follow->count);
            continue;
        }
        usable++;
        for (whole j = 0; j < follow->rows; j++) {
            real w = work->jacobian[axis * follow->rows + j];
            if (w != R(0.0))
                add_scaled(seen, follow->delta + j * follow->count, -w, follow->count);
        }
    }
    return usable;
}

/* A sample's rows of the equations, whitened: over the deviations of the innovations, the second less what the first
   says of it.  Behind the innovation, where there is room, the logarithm of the deviation. */
static inline void write_equations(const Settings *settings, const Scan *scan, real *equations, const Workspace *work,
                                   const Following *follow)
{
    whole count = scan->count;
    real *first = NULL;
    for (whole axis = 0; axis < settings->axes; axis++) {
        real weight = R(1.0) / work->deviation[axis];
        real *row = equations + axis * scan->width;
        for (whole k = 0; k < count; k++)
            row[k] = weight * follow->signature[axis * count + k];
        row[count] = weight * work->innovation[axis];
        if (first != NULL && work->shared != R(0.0))
            add_scaled(row, first, -work->shared / work->deviation[axis], count + 1);
        if (count + 1 < scan->width)
            row[count + 1] = LOG(work->deviation[axis]);
        first = row;
    }
}

static inline Following following(const Observer *observer, const Scan *scan)
{
    const Settings *settings = observer->settings;
    whole states = settings->states, count = scan->count, constants = observer->total - states;
    whole watched = count - scan->known;
    real *scratch = scan->scratch;
    Following follow = {.count = count, .constants = constants, .origin = constants - watched, .rate_row = -1};
    follow.length = R(-1.0);
    follow.known = scan->known;
    follow.watched = watched;
    follow.index = scan->constants;
    follow.rows = states + observer->count;
    follow.delta = scan->delta;
    follow.turned = scan->turned;
    follow.by_constants = scratch;
    follow.signature = scratch + 2 * constants;
    follow.product = follow.signature + 2 * count;
    for (whole i = 0; settings->axes == 2 && i < observer->count; i++)
        if (observer->active[i] == RATE)
            follow.rate_row = states + i;
    return follow;
}

/* Sample m: observe it as `gyro_observe_block` does, and follow what is watched; equations (axes, width), where there are any,
   receive its rows. */
static inline void scan_sample(const Observer *observer, const Scan *scan, whole m, real *equations, Workspace *work,
                               Following *follow)
{
    const Settings *settings = observer->settings;
    Memory *memory = observer->memory;
    whole states = settings->states, axes = settings->axes, count = scan->count;
    const real nothing[MAX_ENTRIES] = {R(0.0)}; /* what is forgotten is given back below, the sensitivities alike */
    Observer forgetful = *observer;
    forgetful.prior = forgetful.spread = nothing;
    const Sample sample = {scan->z + m * axes, scan->u + m * axes * scan->terms, scan->terms, scan->h[m]};
    real *x = observer->x, before[4], foreseen[4];
    int turning = axes == 2 && memory->started == 1 && scan->turned != NULL;
    real rate = memory->rate;
    if (scan->temperature)
        memory->temperature = scan->temperature[m];
    if (follow->watched > 0 && sample.h != follow->length)
        responses(settings, x + states, follow->length = sample.h, &work->flow, follow);
    if (axes == 2)
        note_applied(settings, memory, sample.u, sample.terms);
    for (whole i = 0; i < states; i++)
        before[i] = x[i];
    predict(observer, &sample, work);
    multiply_rows(work->transition, states, follow);
    add_known(settings, follow, &work->flow);
    if (axes == 2)
        note_forced_rotation(settings, memory, x, sample.h);
    for (whole i = 0; i < states; i++)
        foreseen[i] = x[i];
    if (follow->watched > 0) { /* of what is foreseen: what this sample corrects would tell of its own innovation */
        signal_values(settings, memory, memory->time + (double)sample.h, work->flow.push.signals);
        watch_sensed(settings, x, sample.u, sample.terms, follow, work);
    }
    correct(&forgetful, &sample, work);
    end_sample(observer, &sample, work, observer->rows);
    know_sensed(settings, follow, work);
    if (follow->watched > 0)
        add_forced(settings, memory, before, x + states, &sample, follow, work);
    int usable = show(settings, &sample, work, follow);
    if (turning && follow->rate_row >= 0)
        add_scaled(follow->turned, follow->delta + follow->rate_row * count, sample.h, count);
    if (turning && settings->open_loop == 0) /* else the angle is the integrated rate */
        add_turn(settings, foreseen, rate + memory->virtual_applied, rate, R(1.0), follow);
    if (usable > 0) {
        for (whole j = 0; j < follow->rows; j++) {
            const real *gain = work->gain + 2 * j, *seen = follow->signature;
            if (axes == 2)
                add_both(follow->delta + j * count, seen, gain[0], seen + count, gain[1], count);
            else
                add_scaled(follow->delta + j * count, seen, gain[0], count);
        }
        if (equations)
            write_equations(settings, scan, equations, work, follow);
        if (settings->fade > R(1.0) && runs_riccati(settings, memory))
            recall(observer, work->projected, follow);
    }
    if (axes == 2)
        read_angle(settings, memory, x, sample.h, observer->rows);
    if (turning && settings->open_loop == 0)
        add_turn(settings, x, memory->rotation, memory->rate, R(-1.0), follow);
}

/* An observer made ready for a scan, and what follows it. */
static inline Observer begin_scan(Estimator *estimator, const Scan *scan, Following *follow)
{
    Observer observer = widened(estimator);
    *follow = following(&observer, scan);
    workspace_begin(&estimator->work, observer.settings, observer.n);
    return observer;
}

/* Observe n samples, and follow what is watched. */
EXPORTED void gyro_scan_block(Estimator *estimator, const Scan *scan)
{
    Following follow;
    const Observer observer = begin_scan(estimator, scan, &follow);
    for (whole m = 0; m < scan->n; m++) {
        real *rows = scan->equations ? scan->equations + observer.settings->axes * m * scan->width : NULL;
        scan_sample(&observer, scan, m, rows, &estimator->work, &follow);
    }
    settle(estimator, &observer);
}

#endif
