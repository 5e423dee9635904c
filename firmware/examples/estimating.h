/* Between the board's codes and an estimator in SI (gyro_estimator.h): what closes the loop in board mode. */
#ifndef ESTIMATING_H
#define ESTIMATING_H

#include "gyro_estimator.h"
#include "hil_board.h"

typedef struct estimating {
    hil_estimator face; /* for hil_config */
    gyro_estimator own;
    double sense_scale_V;
    double drive_scale_mps2;
    /* For tests of a host: from this tick on the rate reads so. */
    double wrong_from;
    double wrong_rate_rad_s;
    int64_t tick;
} estimating;

/* False where the estimator was built for another interface than this program. */
bool estimating_init(estimating *e, double sense_scale_V, double drive_scale_mps2);

#endif
