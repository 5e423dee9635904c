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

/* out (5,) <- derivatives of the pattern angle by x, vx, y, vy and by the rate, of which the rotation w is a part.

   Zero where there is no pattern. */
static inline void pattern_gradient(const real *s, real k, real w, real rate, real *out)
{
    real x = s[0], y = s[2];
    real vx = s[1] - w * y, vy = s[3] + w * x;
    real ke = k + w * w - rate * rate;
    real sine = R(2.0) * (ke * x * y + vx * vy);
    real cosine = ke * (x * x - y * y) + vx * vx - vy * vy;
    real size = sine * sine + cosine * cosine;
    real share = size > R(0.0) ? R(1.0) / size : R(0.0);
    real by_vx = share * (cosine * vy - sine * vx);
    real by_vy = share * (cosine * vx + sine * vy);
    real by_ke = share * (cosine * x * y - R(0.5) * sine * (x * x - y * y));
    out[0] = share * ke * (cosine * y - sine * x) + by_vy * w;
    out[1] = by_vx;
    out[2] = share * ke * (cosine * x + sine * y) - by_vx * w;
    out[3] = by_vy;
    out[4] = by_vy * x - by_vx * y + R(2.0) * (w - rate) * by_ke;
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
