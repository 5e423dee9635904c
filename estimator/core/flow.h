/* The flow over one step, with its sensitivities, under a drive that acts at once or late. */
#ifndef GYRO_FLOW_H
#define GYRO_FLOW_H

#include "advance.h"
#include "late.h"
#include "layout.h"
#include "structs.h"

/* Advance s over the interval, into work->out.

   Its first column is the new state; with columns > 1 (then all of work's) the others are by s and by the flow and effect
   constants.  past holds the drives of earlier intervals, newest first, for a drive that is late. */
static inline void flow(const Settings *settings, const Interval *interval, real (*past)[MAX_AXES][MAX_DEGREE],
                        const real *c, const real *s, whole columns, FlowWork *work)
{
    begin_columns(settings, s, columns, work);
    if (settings->drive_delay >= 0)
        flow_late(settings, interval, past, c, columns, work);
    else
        advance(settings, interval, c, columns, work);
}

#endif
