/* Where an interval is cut: where friction turns over, where a mass turns, where it catches what follows it with play. */
#ifndef GYRO_TURNOVER_H
#define GYRO_TURNOVER_H

#include "layout.h"
#include "polynomial.h"
#include "signals.h"
#include "structs.h"
#include "taylor.h"
#include "ways.h"

#define MOST_CUTS 24

/* In v0: beyond, tanh is level to 0.5 %; between two of them seven impulses give its integral to 1e-4. */
static const real TURNOVER[3] = {R(-3.0), R(0.0), R(3.0)};

/* In the interval's normalised time, in order. */
typedef struct {
    whole count;
    real at[MOST_CUTS];
} Cuts;

/* A cubic between two ends with their slopes. */
typedef struct {
    real before;
    real slope_before;
    real after;
    real slope_after;
} Cubic;

/* Its value at t in [0, 1]. */
static inline real along(const Cubic *cubic, real t)
{
    real left = R(1.0) - t;
    return cubic->before * (R(1.0) + R(2.0) * t) * (left * left) + cubic->slope_before * t * (left * left) +
           cubic->after * t * t * (R(3.0) - R(2.0) * t) + cubic->slope_after * t * t * (t - R(1.0));
}

/* Where between low and high it has come so far from a value, up for a sign of 1 and down for -1, by halvings. */
static inline real passing(const Cubic *cubic, real from, real sign, real far, real low, real high, int halvings)
{
    for (int k = 0; k < halvings; k++) {
        real middle = R(0.5) * (low + high);
        if (sign * (along(cubic, middle) - from) < far)
            low = middle;
        else
            high = middle;
    }
    return R(0.5) * (low + high);
}

/* Where in [0, 1] it is zero; its ends differ in sign.  Where exactly the interval is cut hardly matters. */
static inline real zero_of(const Cubic *cubic)
{
    return passing(cubic, R(0.0), cubic->before > R(0.0) ? R(-1.0) : R(1.0), R(0.0), R(0.0), R(1.0), 20);
}

/* Put a cut among the others, no more than fit. */
static inline void insert_sorted(Cuts *cuts, real value)
{
    if (cuts->count == MOST_CUTS)
        return;
    whole place = cuts->count;
    for (; place > 0 && cuts->at[place - 1] > value; place--)
        cuts->at[place] = cuts->at[place - 1];
    cuts->at[place] = value;
    cuts->count++;
}

/* Add to cuts where the mass, s from what follows it with play, catches it, on either side of its turn (1 without one);
   the cubic is its displacement. */
static inline void catches(real s, real width, const Cubic *cubic, real turn, Cuts *cuts)
{
    real at = R(0.0), x = cubic->before;
    for (int piece = 0; piece < 2; piece++) {
        real until = piece == 0 ? turn : R(1.0);
        if (!(until > at))
            continue;
        real there = along(cubic, until), sign = there > x ? R(1.0) : R(-1.0), left = width - sign * s;
        if (left > (R(1.0) - CAUGHT) * width && sign * (there - x) > left)
            insert_sorted(cuts, passing(cubic, x, sign, left, at, until, 40));
        real moved = sign * s + sign * (there - x);
        s = sign * (moved < width ? moved : width);
        at = until;
        x = there;
    }
}

/* The motion without effects over an interval: its states at both ends, and time derivatives there. */
typedef struct {
    real begin[4];
    real end[4];
    real slopes[2][4];
    int sloped;
} Swing;

/* Its slopes, once. */
static inline void find_slopes(const Settings *settings, const Interval *interval, const real *c, Swing *swing)
{
    real drive[MAX_AXES];
    if (swing->sloped)
        return;
    for (int place = 0; place < 2; place++) {
        drive_at(interval->u, settings->axes, interval->terms, (real)place, drive);
        field_columns(settings->model, c, place == 0 ? swing->begin : swing->end, drive, swing->slopes[place], 1, 1);
    }
    swing->sloped = 1;
}

/* The velocity of a row less a speed, as a cubic over the interval. */
static inline Cubic velocity_of(const Swing *swing, whole row, real speed, real h)
{
    return (Cubic){swing->begin[row] - speed, swing->slopes[0][row] * h, swing->end[row] - speed,
                   swing->slopes[1][row] * h};
}

/* Cuts where a signal that depends on the way has the mass turn or catch. */
static inline void cut_ways(const Settings *settings, const Interval *interval, const real *c, const Push *push,
                            Swing *swing, Cuts *cuts)
{
    real h = interval->h;
    for (whole k = 0; k < settings->slip_count; k++) {
        whole row = 2 * settings->slips[k][1] + 1;
        real at = R(1.0);
        if (swing->begin[row] * swing->end[row] < R(0.0)) {
            find_slopes(settings, interval, c, swing);
            Cubic velocity = velocity_of(swing, row, R(0.0), h);
            at = zero_of(&velocity);
            insert_sorted(cuts, at);
        }
        if (settings->slips[k][3] == STOP && h > R(0.0)) {
            Cubic way = {swing->begin[row - 1], swing->begin[row] * h, swing->end[row - 1], swing->end[row] * h};
            catches(push->slips[k][0], c[settings->slips[k][2]], &way, at, cuts);
        }
    }
}

/* Cuts where in the interval the motion in the first column of work->out enters, crosses and leaves what friction turns
   over in, and turns where a force depends on the way.

   Of the motion without effects: it is where to cut, and not what acts. */
static inline void turnovers(const Settings *settings, const Interval *interval, const real *c, FlowWork *work,
                             Cuts *cuts)
{
    Swing swing;
    swing.sloped = 0;
    for (whole i = 0; i < settings->states; i++)
        swing.begin[i] = swing.end[i] = work->out[i * work->columns];
    taylor(settings->model, c, interval->u, interval->terms, interval->h, settings->order, 1, work->term, swing.end, 1);
    whole carried = settings->candidate_count > 0 ? settings->effects[settings->effect_count][2] : settings->signal_count;
    for (whole i = 0; i < carried; i++) {
        if (!turns_over(settings, i))
            continue;
        whole row = 2 * settings->signals[i][1] + 1;
        for (int level = 0; level < 3; level++) {
            real speed = TURNOVER[level] * settings->signal_parameters[i][0];
            if ((swing.begin[row] - speed) * (swing.end[row] - speed) >= R(0.0))
                continue;
            find_slopes(settings, interval, c, &swing);
            Cubic velocity = velocity_of(&swing, row, speed, interval->h);
            insert_sorted(cuts, zero_of(&velocity));
        }
    }
    cut_ways(settings, interval, c, &work->push, &swing, cuts);
}

#endif
