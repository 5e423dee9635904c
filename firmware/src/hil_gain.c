#include "hil_gain.h"

#include <float.h>
#include <string.h>

/* x^32 + x^30 + x^26 + x^25 + 1 */
#define TAPS 0xA3000000u

void hil_gain_start(hil_gain *gain, const hil_register_file *registers) {
    const double *value = registers->value;
    memset(gain, 0, sizeof *gain);
    gain->a[0][0] = (float)value[HIL_REGISTER_FILTER_A11];
    gain->a[0][1] = (float)value[HIL_REGISTER_FILTER_A12];
    gain->a[1][0] = (float)value[HIL_REGISTER_FILTER_A21];
    gain->a[1][1] = (float)value[HIL_REGISTER_FILTER_A22];
    gain->b[0] = (float)value[HIL_REGISTER_FILTER_B1];
    gain->b[1] = (float)value[HIL_REGISTER_FILTER_B2];
    gain->c[0] = (float)value[HIL_REGISTER_FILTER_C1];
    gain->c[1] = (float)value[HIL_REGISTER_FILTER_C2];
    gain->delay = hil_registers_whole(registers, HIL_REGISTER_FILTER_DELAY);
    gain->shift = hil_registers_whole(registers, HIL_REGISTER_DITHER_SEED);
}

void hil_gain_obey(hil_gain *gain, const hil_register_file *registers, uint32_t limit) {
    gain->dither = (float)hil_registers_whole(registers, HIL_REGISTER_DITHER_AMPLITUDE);
    gain->limit = (float)limit;
}

static bool is_finite(float value) {
    return value >= -FLT_MAX && value <= FLT_MAX;
}

static double magnitude(double value) {
    return value < 0.0 ? -value : value;
}

bool hil_gain_stable(const hil_register_file *registers) {
    const double *value = registers->value;
    double a11 = value[HIL_REGISTER_FILTER_A11], a12 = value[HIL_REGISTER_FILTER_A12];
    double a21 = value[HIL_REGISTER_FILTER_A21], a22 = value[HIL_REGISTER_FILTER_A22];
    double trace = a11 + a22, determinant = a11 * a22 - a12 * a21;
    double area = HIL_FILTER_RADIUS * HIL_FILTER_RADIUS;
    /* Jury's criterion for both roots of z^2 - trace z + determinant to lie within the radius. */
    return magnitude(determinant) <= area && magnitude(trace) * HIL_FILTER_RADIUS <= area + determinant;
}

/* Written so that NaN, which compares with nothing, is not. */
static bool is_bounded(float value) {
    return value >= -HIL_GAINS_LIMIT && value <= HIL_GAINS_LIMIT;
}

bool hil_gain_accepts(const hil_drive_gains *matrix) {
    bool good = matrix->matrix_id != 0u;
    for (unsigned k = 0; k < 8u; k++)
        good = good && is_bounded(matrix->gain[k]);
    return good && is_bounded(matrix->bias[0]) && is_bounded(matrix->bias[1]);
}

void hil_gain_put(hil_gain *gain, const hil_drive_gains *matrix, int64_t tick) {
    gain->waiting = *matrix;
    gain->waiting_tick = tick;
    gain->waits = true;
}

uint8_t hil_gain_matrix_id(const hil_gain *gain) {
    return gain->closed ? gain->matrix.matrix_id : 0u;
}

/* The next bit of the dither. */
static bool shifted_out(hil_gain *gain) {
    bool bit = gain->shift & 1u;
    gain->shift >>= 1;
    if (bit)
        gain->shift ^= TAPS;
    return bit;
}

/* The nearest whole number within the limits; 0 for what is none. */
static int32_t code_of(float exact, float limit, bool *limited) {
    if (exact > limit || exact < -limit) {
        *limited = true;
        return (int32_t)(exact > limit ? limit : -limit);
    }
    if (!is_finite(exact))
        return 0;
    int32_t whole = (int32_t)exact; /* towards zero; the rest is exact */
    float rest = exact - (float)whole;
    if (rest >= 0.5f)
        return whole + 1;
    return rest <= -0.5f ? whole - 1 : whole;
}

bool hil_gain_step(hil_gain *gain, int64_t tick, int32_t vx, int32_t vy, int32_t drive[2]) {
    float *now = gain->past[(uint64_t)tick % HIL_HISTORY];
    const float *then = gain->past[(uint64_t)(tick - (int64_t)gain->delay) % HIL_HISTORY];
    bool limited = false;
    if (gain->waits && gain->waiting_tick <= tick) {
        gain->matrix = gain->waiting;
        gain->closed = true;
        gain->waits = false;
    }
    now[0] = (float)vx;
    now[1] = (float)vy;
    for (unsigned axis = 0; axis < 2u; axis++) {
        float *s = gain->s[axis];
        float first = s[0], second = s[1];
        for (unsigned k = 0; k < 2u; k++)
            s[k] = gain->a[k][0] * first + gain->a[k][1] * second + gain->b[k] * now[axis] + gain->c[k] * then[axis];
    }
    for (unsigned axis = 0; axis < 2u; axis++) {
        bool up = shifted_out(gain); /* whether it is used or not */
        drive[axis] = 0;
        if (!gain->closed)
            continue;
        const float *row = gain->matrix.gain + 4u * axis;
        float code = gain->matrix.bias[axis] + (up ? gain->dither : -gain->dither);
        for (unsigned k = 0; k < 4u; k++)
            code += row[k] * gain->s[k / 2u][k % 2u];
        drive[axis] = code_of(code, gain->limit, &limited);
    }
    return limited;
}
