/* Between the board's library and an estimator as gyro_estimator.h declares one: what closes the loop in board mode. */
#ifndef ESTIMATING_H
#define ESTIMATING_H

#include "gyro_estimator.h"
#include "hil_board.h"

typedef struct estimating {
    hil_estimator face; /* for hil_config */
    gyro_estimator own;
    /* For tests of a host: from this tick on the rate reads so. */
    double wrong_from;
    double wrong_rate_rad_s;
    int64_t tick;
} estimating;

/* NULL, or what of the estimator does not fit: the interface that this program was built for, or the codes, the sampling
 * rate or the latency of the board, of which the estimator's numbers are made. */
const char *estimating_init(estimating *e, const hil_identity *board);

#endif
