/* The vibration pattern: orientation, energy and angular momentum of the ellipse (11), and their corrected form.

   With velocities measured in the rotating board frame, (11) ripples at twice the vibration by W/2w.  Evaluated with
   vx - W y, vy + W x and the stiffness of the frame in which the pattern rests it is exact; W is the estimated rate and
   the virtual rotation. */
#ifndef GYRO_PATTERN_H
#define GYRO_PATTERN_H

#include "layout.h"

typedef struct {
    real twice; /* of the pattern angle */
    real energy;
    real momentum;
} Pattern;

/* Of state s = (x, vx, y, vy) under target stiffness k and total rotation w.

   The real rotation carries its own centrifugal term, the virtual one does not: the stiffness is k + w^2 - rate^2.
   With w = rate = 0 this is formula (11) of the source (Friedland & Hutton 1978). */
static inline Pattern pattern(const real *s, real k, real w, real rate)
{
    real x = s[0], y = s[2];
    real vx = s[1] - w * y, vy = s[3] + w * x;
    real ke = k + w * w - rate * rate;
    Pattern out;
    out.twice = ATAN2(R(2.0) * (ke * x * y + vx * vy), ke * (x * x - y * y) + (vx * vx - vy * vy));
    out.energy = R(0.5) * (ke * (x * x + y * y) + vx * vx + vy * vy);
    out.momentum = x * vy - y * vx;
    return out;
}

/* Pattern angle in [-pi/2, pi/2) and phase in [-pi, pi) of the motion along the pattern's long axis, a cos(phase). */
static inline void phase_and_angle(const real *s, real k, real *theta, real *phase)
{
    *theta = R(0.5) * pattern(s, k, R(0.0), R(0.0)).twice;
    real cosine = COS(*theta), sine = SIN(*theta);
    real position = s[0] * cosine + s[2] * sine;
    real velocity = s[1] * cosine + s[3] * sine;
    *phase = ATAN2(-velocity, position * SQRT(k));
}

/* The angle nearest to `before` among twice/2 + n pi: the ellipse is the same after half a turn. */
static inline double unwrap_half_turns(real twice, double before)
{
    double theta = (double)(R(0.5) * twice);
    return theta + HALF_TURN * floor((before - theta) / HALF_TURN + 0.5);
}

#endif
