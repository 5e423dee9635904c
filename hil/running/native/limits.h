/* What may leave for the board: a drive within the limit, a matrix of numbers that a board takes. It is asked for each
   answer, before it is sent. */

#ifndef TURN_LIMITS_H
#define TURN_LIMITS_H

#include <math.h>

#include "structs.h"

static bool drive_may_be_sent(const turn_t *turn, const double codes[2])
{
    double limit = (double)turn->code_limit;
    return fabs(codes[0]) <= limit && fabs(codes[1]) <= limit; /* which NaN is not */
}

/* Whether a board takes the matrix; else the first number that it does not take. */
static bool gains_may_be_sent(turn_t *turn)
{
    const gains_t *gains = turn->gains;
    for (int k = 0; k < 10; k++) {
        double number = k < 8 ? gains->gain[k] : gains->bias[k - 8];
        if (!(fabs(number) <= (double)HIL_GAINS_LIMIT)) { /* which NaN is not */
            turn->refused[0] = number;
            return false;
        }
    }
    return true;
}

#endif
