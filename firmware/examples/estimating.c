#include "estimating.h"

#include <math.h>

#define LARGEST 0x7fffff /* no converter has more than 24 bits */

static void start(void *context) {
    estimating *e = context;
    gyro_estimator_init(&e->own);
}

/* The nearest code; 0 of what is not a number. */
static int32_t code(double value, double scale) {
    double exact = round(value / scale);
    return exact > LARGEST ? LARGEST : exact < -LARGEST ? -LARGEST : exact == exact ? (int32_t)exact : 0;
}

static hil_drive step(void *context, int64_t tick, int32_t vx, int32_t vy, hil_drive held, bool drive) {
    estimating *e = context;
    const gyro_real sense_V[2] = {(gyro_real)(vx * e->sense_scale_V), (gyro_real)(vy * e->sense_scale_V)};
    const gyro_real applied[2] = {(gyro_real)(held.ux * e->drive_scale_mps2), (gyro_real)(held.uy * e->drive_scale_mps2)};
    gyro_real asked[2], angle;
    estimator_step(&e->own, sense_V, applied, drive, asked, &angle);
    e->tick = tick;
    hil_drive codes = {code((double)asked[0], e->drive_scale_mps2), code((double)asked[1], e->drive_scale_mps2)};
    return codes;
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

bool estimating_init(estimating *e, double sense_scale_V, double drive_scale_mps2) {
    e->face.start = start;
    e->face.step = step;
    e->face.read = read;
    e->face.context = e;
    e->sense_scale_V = sense_scale_V;
    e->drive_scale_mps2 = drive_scale_mps2;
    e->wrong_from = HUGE_VAL;
    gyro_estimator_init(&e->own);
    return gyro_estimator_version() == GYRO_ESTIMATOR_VERSION && gyro_estimator_size() == sizeof e->own;
}
