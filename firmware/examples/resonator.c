#include "resonator.h"

#include <math.h>
#include <string.h>

#define N 6
#define TERMS 18
#define HALVINGS 10

/* 1 g on springs of 200 Hz. */
const resonator_device resonator_slow = {
    .sample_rate_Hz = 4000.0,
    .stiffness_per_s2 = {1.602e6, 1.561e6, -1.2e4},
    .damping_per_s = {1.5, 1.3, 0.05},
    .start_m = 1e-4,
    .gain_V_per_m = 1000.0,
    .offset_V = {6e-3, -4e-3},
    .noise_V = 1e-4,
    .sense_bits = 16,
    .sense_full_scale_V = 0.25,
    .drive_bits = 16,
    .drive_full_scale_mps2 = 10.0,
};

/* 5 kHz, for gain mode. */
const resonator_device resonator_fast = {
    .sample_rate_Hz = 100e3,
    .stiffness_per_s2 = {9.8730e8, 9.8650e8, 4.0e5},
    .damping_per_s = {3.3, 3.0, 0.1},
    .start_m = 2e-6,
    .gain_V_per_m = 8.9e4,
    .offset_V = {0.012, -0.009},
    .noise_V = 6e-5,
    .sense_bits = 16,
    .sense_full_scale_V = 0.5,
    .drive_bits = 16,
    .drive_full_scale_mps2 = 80.0,
};

typedef double matrix[N][N];

static void multiply(const matrix a, const matrix b, matrix product) {
    matrix sum;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            sum[i][j] = 0.0;
            for (int k = 0; k < N; k++)
                sum[i][j] += a[i][k] * b[k][j];
        }
    memcpy(product, sum, sizeof sum);
}

/* exp(m) by Taylor's series of m / 2^HALVINGS, squared as often. */
static void exponential(matrix m) {
    matrix term, sum;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            m[i][j] = ldexp(m[i][j], -HALVINGS);
            sum[i][j] = term[i][j] = i == j ? 1.0 : 0.0;
        }
    for (int k = 1; k <= TERMS; k++) {
        multiply((const double(*)[N])term, (const double(*)[N])m, term);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                term[i][j] /= k;
                sum[i][j] += term[i][j];
            }
    }
    for (int k = 0; k < HALVINGS; k++)
        multiply((const double(*)[N])sum, (const double(*)[N])sum, sum);
    memcpy(m, sum, sizeof sum);
}

void resonator_retune(resonator *r, const resonator_device *device) {
    const double *k = device->stiffness_per_s2, *d = device->damping_per_s;
    double w = device->rate_rad_s;
    matrix a = {
        {0, 1, 0, 0, 0, 0},
        {w * w - k[0], -d[0], -k[2], 2.0 * w - d[2], 1, 0},
        {0, 0, 0, 1, 0, 0},
        {-k[2], -2.0 * w - d[2], w * w - k[1], -d[1], 0, 1},
    };
    /* Scaled by the natural frequency, or position and velocity would lie four decades apart. */
    double scale[N] = {1.0, 0.0, 1.0, 0.0, 0.0, 0.0};
    double natural = sqrt(k[0]);
    scale[1] = scale[3] = natural;
    scale[4] = scale[5] = natural * natural;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            a[i][j] *= scale[j] / scale[i] / device->sample_rate_Hz;
    exponential(a);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < N; j++)
            r->step[i][j] = a[i][j] * scale[i] / scale[j];
    r->device = device;
}

void resonator_init(resonator *r, const resonator_device *device, uint64_t seed) {
    resonator_retune(r, device);
    r->state[0] = device->start_m;
    r->state[1] = r->state[2] = r->state[3] = 0.0;
    r->noise = seed * 0x9E3779B97F4A7C15u + 1u;
}

hil_identity resonator_identity(const resonator_device *device, uint64_t unique_id, uint16_t latency_ticks) {
    hil_identity told;
    memset(&told, 0, sizeof told);
    told.unique_id = unique_id;
    told.firmware = 0x00010000;
    told.tick_rate_Hz = device->sample_rate_Hz;
    told.axes = 2;
    told.sense_bits = (uint8_t)device->sense_bits;
    told.drive_bits = (uint8_t)device->drive_bits;
    told.sense_scale_V = resonator_sense_scale_V(device);
    told.drive_scale_mps2 = resonator_drive_scale_mps2(device);
    told.latency_ticks = latency_ticks;
    return told;
}

double resonator_sense_scale_V(const resonator_device *device) {
    return ldexp(device->sense_full_scale_V, 1 - (int)device->sense_bits);
}

double resonator_drive_scale_mps2(const resonator_device *device) {
    return ldexp(device->drive_full_scale_mps2, 1 - (int)device->drive_bits);
}

void resonator_step(resonator *r, int32_t ux, int32_t uy) {
    double scale = resonator_drive_scale_mps2(r->device);
    double before[N] = {r->state[0], r->state[1], r->state[2], r->state[3], ux * scale, uy * scale};
    for (int i = 0; i < 4; i++) {
        r->state[i] = 0.0;
        for (int j = 0; j < N; j++)
            r->state[i] += r->step[i][j] * before[j];
    }
}

/* In (0, 1), by Marsaglia's xorshift with a multiplication behind it. */
static double uniform(resonator *r) {
    r->noise ^= r->noise >> 12;
    r->noise ^= r->noise << 25;
    r->noise ^= r->noise >> 27;
    return ((double)(r->noise * 0x2545F4914F6CDD1Du >> 11) + 0.5) * 0x1p-53;
}

static int convert(const resonator_device *device, double volts, int32_t *code) {
    double most = ldexp(1.0, (int)device->sense_bits - 1);
    double exact = round(volts / resonator_sense_scale_V(device));
    int clipped = exact >= most - 1.0 || exact <= -most;
    *code = (int32_t)fmax(-most, fmin(exact, most - 1.0));
    return clipped;
}

int resonator_sense(resonator *r, int32_t *vx, int32_t *vy) {
    const resonator_device *device = r->device;
    /* Two independent normal numbers: Box and Muller. */
    double radius = device->noise_V * sqrt(-2.0 * log(uniform(r))), angle = 2.0 * acos(-1.0) * uniform(r);
    int clipped_x = convert(device, device->gain_V_per_m * r->state[0] + device->offset_V[0] + radius * cos(angle), vx);
    int clipped_y = convert(device, device->gain_V_per_m * r->state[2] + device->offset_V[1] + radius * sin(angle), vy);
    return clipped_x || clipped_y;
}
