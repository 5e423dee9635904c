#include "estimating.h"

#include <math.h>

#if GYRO_ESTIMATOR_VERSION != 2u
#error "estimating.c is for version 2 of gyro_estimator.h: take the firmware and the estimator of one release"
#endif

static void start(void *context) {
    estimating *e = context;
    gyro_estimator_init(&e->own);
}

static hil_drive step(void *context, int64_t tick, int32_t vx, int32_t vy, hil_drive held, bool drive) {
    estimating *e = context;
    const int32_t sense[2] = {vx, vy}, applied[2] = {held.ux, held.uy};
    int32_t codes[2];
    estimator_step_codes(&e->own, sense, applied, drive, codes);
    e->tick = tick;
    return (hil_drive){codes[0], codes[1]};
}

static void read(void *context, hil_estimate *out) {
    const estimating *e = context;
    gyro_estimate found;
    gyro_estimator_read(&e->own, &found);
#define TELL(name, NAME) \
    out->name = (double)found.state[GYRO_##NAME]; \
    if (found.deviation[GYRO_##NAME] >= 0) { \
        out->sd_##name = (float)found.deviation[GYRO_##NAME]; \
        out->estimated = (uint16_t)(out->estimated | HIL_ESTIMATED_ENTRIES_##NAME); \
    }
    TELL(x, X)
    TELL(vx, VX)
    TELL(y, Y)
    TELL(vy, VY)
    TELL(phi_x, PHI_X)
    TELL(phi_y, PHI_Y)
    TELL(rate, RATE)
    TELL(kxx, KXX)
    TELL(kyy, KYY)
    TELL(kxy, KXY)
    TELL(dxx, DXX)
    TELL(dyy, DYY)
    TELL(dxy, DXY)
#undef TELL
    out->angle = (double)found.angle_rad;
    out->sd_angle = (float)found.angle_deviation_rad;
    out->estimated = (uint16_t)(out->estimated | HIL_ESTIMATED_ENTRIES_ANGLE);
    out->flags = found.valid ? HIL_ESTIMATE_FLAGS_VALID : 0u;
    if ((double)e->tick >= e->wrong_from)
        out->rate = e->wrong_rate_rad_s;
}

static bool same(double a, double b) {
    return fabs(a - b) <= 1e-9 * fabs(b);
}

const char *estimating_init(estimating *e, const hil_identity *board) {
    e->face.start = start;
    e->face.step = step;
    e->face.read = read;
    e->face.context = e;
    e->wrong_from = HUGE_VAL;
    gyro_estimator_init(&e->own);
    if (gyro_estimator_version() != GYRO_ESTIMATOR_VERSION || gyro_estimator_size() != sizeof e->own)
        return "version, which is not that of its header";
    if (!same(GYRO_SAMPLE_RATE_HZ, board->tick_rate_Hz))
        return "sampling rate";
    if (GYRO_LATENCY != board->latency_ticks)
        return "latency";
    if (!same(GYRO_SENSE_SCALE_V, board->sense_scale_V))
        return "sense scale";
    if (!same(GYRO_DRIVE_SCALE_MPS2, board->drive_scale_mps2))
        return "drive scale";
    return NULL;
}
