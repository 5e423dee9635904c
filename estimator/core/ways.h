/* Signals that depend on the way that the mass came: what slips against it, and what it takes along with play. */
#ifndef GYRO_WAYS_H
#define GYRO_WAYS_H

#include "layout.h"
#include "signals.h"
#include "structs.h"

#define CAUGHT (R(1.0) - INSTANT) /* of the half-width: what is as far from the foot as that moves it along */

/* A signal after a way, and its derivatives by itself before, by the way and by the reach. */
typedef struct {
    real value;
    real by_value;
    real by_way;
    real by_reach;
} Way;

/* A slip z, counted along the motion, after a way along it (back where that is negative).

   Against the motion it moves as the mass does, along it by 1 - z/reach of that: exactly, whatever the speed was. */
static inline Way slid(real z, real way, real reach)
{
    if (way >= R(0.0)) {
        if (z + way <= R(0.0))
            return (Way){z + way, R(1.0), R(1.0), R(0.0)};
        real straight = -z > R(0.0) ? -z : R(0.0);
        z += straight;
        way -= straight;
    } else if (z <= R(0.0)) {
        return (Way){z + way, R(1.0), R(1.0), R(0.0)};
    } else if (z < reach) {
        real left = (reach - z) / reach, back = reach * LOG(left);
        if (way < back)
            return (Way){way - back, R(1.0) / left, R(1.0), -(LOG(left) + (R(1.0) - left) / left)};
    }
    real fade = EXP(-way / reach), rest = (reach - z) * fade;
    return (Way){reach - rest, fade, rest / reach, R(1.0) - fade - rest * way / (reach * reach)};
}

/* How far the mass is from what follows it with play, s counted along the motion, after a way along it.

   What is caught stays so as long as the mass moves on, and did before: an interval is cut where it is caught and where
   the mass turns, so that a way back within a piece does not let it go. */
static inline Way caught(real s, real way, real width)
{
    if (s >= CAUGHT * width)
        return (Way){width, R(0.0), R(0.0), R(1.0)};
    s += way;
    if (s >= width)
        return (Way){width, R(0.0), R(0.0), R(1.0)};
    if (s <= -width)
        return (Way){-width, R(0.0), R(0.0), R(-1.0)};
    return (Way){s, R(1.0), R(1.0), R(0.0)};
}

/* Signals that depend on the way, and their sensitivities, at the first state s: what slips begins at 0, what is followed
   with play as if it had come from 0. */
static inline void begin_ways(const Settings *settings, const real *c, const real *s, whole columns, Push *push)
{
    for (whole k = 0; k < settings->slip_count; k++) {
        real *slip = push->slips[k];
        whole axis = settings->slips[k][1], constant = settings->slips[k][2];
        real width = c[constant], x = s[2 * axis];
        memset(slip, 0, sizeof push->slips[k]);
        if (settings->slips[k][3] != STOP || !(width > R(0.0)))
            continue;
        real least = x > -width ? x : -width;
        slip[0] = least < width ? least : width;
        if (columns > 1 && FABS(x) < width)
            slip[1 + 2 * axis] = R(1.0);
        else if (columns > 1)
            slip[1 + settings->states + constant - settings->sense_constants] = x > R(0.0) ? R(1.0) : R(-1.0);
    }
}

/* Carry one of them over a part of an interval, in which the mass goes `way`, forth where `forth` is positive; share of
   the interval, and the motion of its row in the columns before and after. */
static inline void carry_way(const Settings *settings, whole k, real reach, real forth, real way, real share,
                             const real *before, const real *after, whole columns, real *slip)
{
    real sign = forth > R(0.0) ? R(1.0) : R(-1.0);
    Way found = settings->slips[k][3] == STOP ? caught(sign * slip[0], sign * way, reach)
                                              : slid(sign * slip[0], sign * way, reach);
    slip[0] = sign * found.value;
    for (whole j = 1; j < columns; j++)
        slip[j] = found.by_value * slip[j] + found.by_way * (share * (after[j] - before[j]));
    if (columns > 1)
        slip[1 + settings->states + settings->slips[k][2] - settings->sense_constants] += sign * found.by_reach;
}

/* Carry the signals that depend on the way, and their sensitivities, from the motion in the columns of before to that in
   out, rows of `stride`, h later; where the mass turns in between, to there first. */
static inline void slide(const Settings *settings, const real *c, real h, whole columns, whole stride,
                         const real *before, const real *out, real (*slips)[MAX_COLUMNS])
{
    for (whole k = 0; k < settings->slip_count; k++) {
        whole row = 2 * settings->slips[k][1];
        real reach = c[settings->slips[k][2]];
        const real *from = before + row * stride, *to = out + row * stride;
        if (!(reach > R(0.0))) {
            memset(slips[k], 0, sizeof slips[k]);
            continue;
        }
        real first = from[stride], last = to[stride];
        if (first * last < R(0.0)) {
            real turn = first / (first - last);
            real there = from[0] + R(0.5) * first * turn * h;
            carry_way(settings, k, reach, first, there - from[0], turn, from, to, columns, slips[k]);
            carry_way(settings, k, reach, last, to[0] - there, R(1.0) - turn, from, to, columns, slips[k]);
        } else {
            carry_way(settings, k, reach, first + last, to[0] - from[0], R(1.0), from, to, columns, slips[k]);
        }
    }
}

#endif
