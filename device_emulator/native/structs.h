/* What Python and C share: NumPy's records of the same fields, aligned (device_emulator/{plant,drive,sense,rate,…}.py).
   device_sizes() lets the loader compare them. */
#ifndef EMULATOR_STRUCTS_H
#define EMULATOR_STRUCTS_H

#include <stdbool.h>
#include <stdint.h>

#include "kinds.h" /* enum effect_kind, written when this is compiled */

enum {
    MAX_COEFFICIENTS = 6,
    MAX_INNER = 12,
    STATES = 4 + MAX_INNER, /* x, ẋ, y, ẏ, and what the effects have of their own */
    MAX_FLICKER_POLES = 12,
    MAX_SENSE_FAULTS = 16,
    MAX_TRIMS = 8,
    RECENT = 32,  /* intervals of drive that a delay can reach back over */
    HISTORY = 64, /* codes that the board's filter can reach back over */
    QUEUE = 66,   /* drives computed by the board and not yet acting */
    NODES = 6     /* of the polynomial that reads the delayed trajectory */
};

typedef struct {
    int64_t kind, at; /* enum effect_kind; the first of its own states */
    double c[MAX_COEFFICIENTS];
} effect_t;

typedef struct {
    const effect_t *first;
    int64_t count;
} effects_t;

typedef struct {
    double warm_up_K, time_constant_s, swing_K, frequency_rad_s;
} temperature_t;

typedef struct {
    int64_t poles;
    double rms[MAX_FLICKER_POLES], keep[MAX_FLICKER_POLES], add[MAX_FLICKER_POLES];
} flicker_t;

typedef struct {
    double start_s, angle_rad, rate_rad_s, slope_rad_s2, amplitude_rad_s, frequency_rad_s, phase_rad;
} piece_t;

typedef struct {
    int64_t count;
    double softening[MAX_TRIMS][3], settling_s[MAX_TRIMS];
} trim_t;

typedef struct {
    double ts_s;
    int64_t substeps, states;
    double kxx, kyy, kxy, dxx, dyy, dxy;
    double noise_xx, noise_yx, noise_yy; /* Cholesky factor of the force noise over one sub-step */
    temperature_t temperature;
    flicker_t flicker; /* of the device's own rotation */
    trim_t trim;
} plant_t;

typedef struct {
    double lsb_mps2;
    int64_t delay_samples[2];
    double delay_rest_s[2];
    double ts_s;
    double slew_mps3[2];
    flicker_t flicker;
} drive_t;

typedef struct {
    double recent[RECENT][2], start[RECENT][2], slope[RECENT][2], reach_s[RECENT][2];
    double flicker[2][MAX_FLICKER_POLES], flickering[2];
} drive_state_t;

typedef struct {
    double gain_V_per_m[2], mismatch_V[2], opamp_V[2], opamp_gain[2], leak_per_s[2], drift_V_per_s[2];
    double random_walk_V, noise_V;
    int64_t flicker_poles;
    double flicker_V[MAX_FLICKER_POLES], flicker_keep[MAX_FLICKER_POLES], flicker_add[MAX_FLICKER_POLES];
    double lsb_V;
    int64_t code_max, tracked, current[2];
    double high_pass[2][5], low_pass[2][5], delay_substeps[2];
    int64_t curve; /* which map acts on the displacement: enum curve_kind */
    double bend[2], tempco_per_K[2], shot_V2[2];
    int64_t faults;
    int64_t fault_axis[MAX_SENSE_FAULTS], fault_first[MAX_SENSE_FAULTS], fault_last[MAX_SENSE_FAULTS];
    int64_t fault_limit[MAX_SENSE_FAULTS];
} sense_t;

typedef struct {
    double seen[2][2], leaked[2], smooth[2];
    int64_t newest;
    double random_walk[2], flicker[2][MAX_FLICKER_POLES];
    int64_t shown[2];
} sense_state_t;

typedef struct {
    plant_t plant;
    drive_t drive;
    sense_t sense;
} constants_t;

typedef struct {
    int64_t tick, piece, page; /* `page`: first tick of the page whose noise is drawn */
    double motion[STATES];
    int64_t seed;
    drive_state_t drive;
    sense_state_t sense;
    double flicker[MAX_FLICKER_POLES], drift_rad_s; /* of the bias */
    double trim_V[MAX_TRIMS], trim_target_V[MAX_TRIMS];
} state_t;

typedef struct {
    double a[2][2], b[2], c[2];
    int64_t delay, latency, limit, dither, closed;
    double gain[2][4], bias[2], s[2][2], past[HISTORY][2];
    uint32_t shift;
    int32_t queue[QUEUE][2];
    int64_t limited;
} feedback_t;

static inline int64_t modulo(int64_t a, int64_t n) /* of the sign of n, as row numbers before the first need it */
{
    int64_t rest = a % n;
    return rest < 0 ? rest + n : rest;
}

/* The next value of 1/f noise from as many standard normals as it has poles; `first` puts each somewhere in its range. */
static inline double flickered(const flicker_t *noise, double *state, const double *normals, bool first)
{
    double sum = 0.0;
    for (int64_t pole = 0; pole < noise->poles; pole++) {
        state[pole] = first ? noise->rms[pole] * normals[pole]
                            : noise->keep[pole] * state[pole] + noise->add[pole] * normals[pole];
        sum += state[pole];
    }
    return sum;
}

static inline double within(double value, double limit)
{
    return value < -limit ? -limit : value > limit ? limit : value;
}

#endif
