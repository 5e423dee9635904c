#include "gyro_estimator.h"

#include <math.h>

#define LARGEST 0x7fffff /* no converter has more than 24 bits */

/* The device as it was measured, somewhat off; the rest as examples/c-board.bench.toml has it. Per unit mass, SI. */
static const gyro_real sample_rate = GYRO_SAMPLE_RATE_HZ, latency = GYRO_LATENCY, amplitude = 1e-4, sense_gain = 1000.0;
static const gyro_real kxx = 1.6016e6, kyy = 1.5613e6, kxy = -1.19e4, dxx = 1.5, dyy = 1.3, dxy = 0.05;
static const gyro_real target = 1.5791e6; /* stiffness of the controlled oscillator */

static const gyro_real position_gain = 0.05, offset_gain = 0.002, rate_gain = 0.005;
static const gyro_real energy_hold = 0.1, quadrature_hold = 0.1; /* in units of the target frequency */
static const gyro_real half_turn = 3.14159265358979323846;

unsigned gyro_estimator_version(void) {
    return GYRO_ESTIMATOR_VERSION;
}

size_t gyro_estimator_size(void) {
    return sizeof(gyro_estimator);
}

void gyro_estimator_init(gyro_estimator *e) {
    static const gyro_estimator zero = {{0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, 0.0, 0.0, 0.0, 0.0, 0.0, 0};
    *e = zero;
}

/* Swing freely at the target frequency for so long. */
static void drift(gyro_real x[2], gyro_real v[2], gyro_real seconds) {
    gyro_real w = sqrt(target), c = cos(w * seconds), s = sin(w * seconds);
    for (int k = 0; k < 2; k++) {
        gyro_real before = x[k];
        x[k] = c * before + s * v[k] / w;
        v[k] = c * v[k] - s * w * before;
    }
}

/* What acts beside the target's spring, for so long. */
static void kick(gyro_estimator *e, const gyro_real drive[2], gyro_real seconds) {
    gyro_real x = e->x[0], y = e->x[1], vx = e->v[0], vy = e->v[1];
    e->v[0] += seconds * (drive[0] - (kxx - target) * x - kxy * y - dxx * vx - dxy * vy + 2.0 * e->rate * vy);
    e->v[1] += seconds * (drive[1] - (kyy - target) * y - kxy * x - dyy * vy - dxy * vx - 2.0 * e->rate * vx);
}

static gyro_real within_half_a_turn(gyro_real angle) {
    return angle - half_turn * floor(angle / half_turn + 0.5);
}

/* Size, slenderness and direction of the ellipse; the reported angle runs against the pattern. */
static void see_pattern(gyro_estimator *e) {
    gyro_real x = e->x[0], y = e->x[1], vx = e->v[0], vy = e->v[1], w = sqrt(target);
    gyro_real energy = x * x + y * y + (vx * vx + vy * vy) / target;
    gyro_real pattern = 0.5 * atan2(2.0 * (x * y + vx * vy / target), x * x - y * y + (vx * vx - vy * vy) / target);
    gyro_real turned = e->steps > 0 ? -within_half_a_turn(pattern - e->pattern) : 0.0;
    e->energy = energy / (amplitude * amplitude);
    e->quadrature = energy > 0.0 ? 2.0 * (x * vy - y * vx) / (w * energy) : 0.0;
    e->pattern = pattern;
    e->angle += turned;
    if (e->steps > (unsigned long)(0.1 * sample_rate)) /* before, it is the motion being found */
        e->rate += rate_gain * (turned * sample_rate - e->rate);
}

/* Cancel what is declared, hold the energy, take the quadrature away; for the middle of the interval it will act on. */
static void control(const gyro_estimator *e, gyro_real drive[2]) {
    gyro_real x[2] = {e->x[0], e->x[1]}, v[2] = {e->v[0], e->v[1]}, w = sqrt(target);
    drift(x, v, (latency + 0.5) / sample_rate);
    gyro_real spin = 2.0 * quadrature_hold * w / (amplitude * amplitude) * (x[0] * v[1] - x[1] * v[0]);
    gyro_real pump = -energy_hold * w * fmax(fmin(e->energy - 1.0, 1.0), -1.0);
    drive[0] = (kxx - target) * x[0] + kxy * x[1] + dxx * v[0] + dxy * v[1] + pump * v[0] + spin * x[1];
    drive[1] = (kyy - target) * x[1] + kxy * x[0] + dyy * v[1] + dxy * v[0] + pump * v[1] - spin * x[0];
}

void estimator_step(gyro_estimator *e, const gyro_real sense_V[2], const gyro_real applied_mps2[2], int drive_on,
                    gyro_real drive_mps2[2], double *angle_rad) {
    gyro_real interval = 1.0 / sample_rate;
    kick(e, applied_mps2, 0.5 * interval);
    drift(e->x, e->v, interval);
    kick(e, applied_mps2, 0.5 * interval);
    for (int k = 0; k < 2; k++) {
        gyro_real error = (sense_V[k] - e->phi[k]) / sense_gain - e->x[k];
        e->x[k] += position_gain * error;
        e->phi[k] += offset_gain * sense_gain * error;
    }
    see_pattern(e);
    e->steps++;
    drive_mps2[0] = drive_mps2[1] = 0.0;
    if (drive_on)
        control(e, drive_mps2);
    *angle_rad = e->angle;
}

/* The nearest code; 0 of what is not a number. */
static int32_t code(gyro_real value) {
    gyro_real exact = round(value / GYRO_DRIVE_SCALE_MPS2);
    return exact > LARGEST ? LARGEST : exact < -LARGEST ? -LARGEST : exact == exact ? (int32_t)exact : 0;
}

void estimator_step_codes(gyro_estimator *e, const int32_t sense[2], const int32_t applied[2], int drive_on,
                          int32_t drive[2]) {
    const gyro_real sense_V[2] = {sense[0] * GYRO_SENSE_SCALE_V, sense[1] * GYRO_SENSE_SCALE_V};
    const gyro_real applied_mps2[2] = {applied[0] * GYRO_DRIVE_SCALE_MPS2, applied[1] * GYRO_DRIVE_SCALE_MPS2};
    gyro_real drive_mps2[2];
    double angle;
    estimator_step(e, sense_V, applied_mps2, drive_on, drive_mps2, &angle);
    for (int k = 0; k < 2; k++)
        drive[k] = code(drive_mps2[k]);
}

void gyro_estimator_read(const gyro_estimator *e, gyro_estimate *out) {
    const gyro_real state[GYRO_STATES] = {e->x[0],   e->v[0], e->x[1], e->v[1], e->phi[0], e->phi[1], e->rate,
                                          kxx, kyy, kxy, dxx, dyy, dxy};
    for (int k = 0; k < GYRO_STATES; k++) {
        out->state[k] = state[k];
        out->deviation[k] = k < GYRO_KXX ? 0.0 : -1.0;
    }
    out->angle_rad = e->angle;
    out->angle_deviation_rad = 0.0;
    out->valid = fabs(e->energy - 1.0) < 0.1 && fabs(e->quadrature) < 0.1;
}
