/* Paths that are late: a drive that acts behind its time, a sense channel that shows an earlier motion. */
#ifndef GYRO_LATE_H
#define GYRO_LATE_H

#include "advance.h"
#include "layout.h"
#include "model.h"
#include "polynomial.h"
#include "structs.h"
#include "taylor.h"

#define LONGEST_DELAY (R(1.0) * MAX_DELAY - R(1.0)) /* intervals */

/* The drive u of one axis (terms,) of the interval so many before this one, 0 this one. */
static inline const real *drive_before(const real *u, real (*past)[MAX_AXES][MAX_DEGREE], whole back, whole axis,
                                       whole terms)
{
    return back == 0 ? u + axis * terms : past[back - 1][axis];
}

/* out (terms,) <- drive of one axis, late by `delay` intervals, over [start, start + length] of this interval, in the
   normalised time of that part; the part must not reach over a boundary of the recorded intervals. */
static inline void late_polynomial(const Interval *interval, real (*past)[MAX_AXES][MAX_DEGREE], whole axis, real delay,
                                   real start, real length, real *out)
{
    real begin = start - delay;
    whole back = 0;
    if (begin < R(0.0)) {
        back = (whole)CEIL(-begin - ROUNDING);
        if (back > MAX_DELAY + 1)
            back = MAX_DELAY + 1;
    }
    part_of(drive_before(interval->u, past, back, axis, interval->terms), 1, interval->terms, begin + (real)back, length,
            out);
}

/* Delay of an axis in intervals, within what is kept; of a number that is none, the longest. */
static inline real late_by(real delay, real h)
{
    real share = delay / h;
    real most = share < LONGEST_DELAY ? share : LONGEST_DELAY;
    return most > R(0.0) ? most : R(0.0);
}

static inline real sum_of(const real *u, whole terms)
{
    real total = R(0.0);
    for (whole n = 0; n < terms; n++)
        total += u[n];
    return total;
}

/* What a drive's delay of one axis, a shift of the input, does: its column, and a delay below zero by its derivative at
   zero.  forced (states,) is what this drive alone has moved; ends: the late drive just before this interval and at its
   end. */
static inline void add_delay(const Settings *settings, const real *c, whole axis, const real *forced, const real *ends,
                             whole columns, FlowWork *work)
{
    static const real no_drive[MAX_AXES] = {R(0.0), R(0.0)};
    whole states = settings->states, stride = work->columns, row = 2 * axis + 1;
    real *out = work->out, slope[4], delay = c[settings->drive_delay + axis];
    real early = delay < R(0.0) ? delay : R(0.0);
    if (columns > 1) {
        whole column = 1 + states + settings->drive_delay + axis - settings->sense_constants;
        field_columns(settings->model, c, forced, no_drive, slope, 1, 1);
        for (whole i = 0; i < states; i++)
            out[i * stride + column] += out[i * stride + 1 + row] * ends[0] - slope[i];
        out[row * stride + column] -= ends[1];
        for (whole i = 0; i < states; i++)
            out[i * stride] += early * out[i * stride + column];
    } else if (early < R(0.0)) {
        out[row * stride] += early * (ends[0] - ends[1]);
    }
}

/* `advance` under a drive that is late by the constants at settings->drive_delay, sensitivities to them included.

   A shift of the input u(t - T) moves what it forces by -(B u(h - T) - F B u(-T) + M x_forced), F the flow over h: the
   integral of -F B u' by parts, jumps and all. */
static inline void flow_late(const Settings *settings, const Interval *interval, real (*past)[MAX_AXES][MAX_DEGREE],
                             const real *c, whole columns, FlowWork *work)
{
    whole axes = settings->axes, terms = interval->terms;
    real h = interval->h, forced[MAX_AXES][4] = {{R(0.0)}}, part[MAX_AXES * MAX_TERMS], alone[MAX_AXES * MAX_TERMS];
    real delays[2] = {R(0.0), R(0.0)}, shares[2], cuts[4] = {R(0.0), R(0.0), R(0.0), R(1.0)};
    for (whole axis = 0; axis < 2; axis++) {
        delays[axis] = axis < axes ? late_by(c[settings->drive_delay + axis], h) : delays[0];
        shares[axis] = delays[axis] - FLOOR(delays[axis]);
    }
    cuts[1] = shares[0] < shares[1] ? shares[0] : shares[1];
    cuts[2] = shares[0] > shares[1] ? shares[0] : shares[1];
    for (whole piece = 0; piece < 3; piece++) {
        real start = cuts[piece], length = cuts[piece + 1] - start;
        if (length <= R(0.0))
            continue;
        for (whole axis = 0; axis < axes; axis++)
            late_polynomial(interval, past, axis, delays[axis], start, length, part + axis * terms);
        Interval late = {interval->time + (double)(start * h), length * h, part, terms};
        advance(settings, &late, c, columns, work);
        for (whole axis = 0; columns > 1 && axis < axes; axis++) {
            for (whole i = 0; i < axes * terms; i++)
                alone[i] = i / terms == axis ? part[i] : R(0.0);
            taylor(settings->model, c, alone, terms, length * h, settings->order, 1, work->term, forced[axis], 1);
        }
    }
    real ends[MAX_AXES][2];
    for (whole axis = 0; axis < axes; axis++) {
        late_polynomial(interval, past, axis, delays[axis], R(1.0) - INSTANT, INSTANT, part);
        ends[axis][1] = sum_of(part, terms);
        late_polynomial(interval, past, axis, delays[axis] + R(1.0), R(1.0) - INSTANT, INSTANT, part);
        ends[axis][0] = sum_of(part, terms);
    }
    for (whole axis = 0; axis < axes; axis++)
        add_delay(settings, c, axis, forced[axis], ends[axis], columns, work);
}

/* Columns work->out of the state at the delay of one sense axis (constants at settings->sense_delay) before state s, which
   is that of interval->time.

   The interval's drive is that of the one that ends at s; its force is taken as it was recorded, late or not. */
static inline void sensed_before(const Settings *settings, const Interval *interval, real (*past)[MAX_AXES][MAX_DEGREE],
                                 const real *c, const real *s, whole axis, FlowWork *work)
{
    whole axes = settings->axes, terms = interval->terms, back = 0;
    real h = interval->h, kept[MAX_SLIPS], reversed[MAX_AXES * MAX_TERMS];
    double time = interval->time;
    begin_columns(settings, s, work->columns, work);
    for (whole k = 0; k < settings->slip_count; k++)
        kept[k] = work->push.slips[k][0];
    real share = c[settings->sense_delay + axis] / h;
    real left = share < LONGEST_DELAY ? share : LONGEST_DELAY;
    if (!isfinite(left))
        left = R(0.0);
    do {
        real length = left > R(1.0) ? R(1.0) : left;
        for (whole i = 0; i < axes; i++)
            part_of(drive_before(interval->u, past, back, i, terms), 1, terms, R(1.0), -length, reversed + i * terms);
        Interval earlier = {time, -length * h, reversed, terms};
        advance(settings, &earlier, c, work->columns, work);
        time -= (double)(length * h);
        left -= length;
        back++;
    } while (left > R(0.0));
    for (whole k = 0; k < settings->slip_count; k++)
        work->push.slips[k][0] = kept[k];
}

#endif
