/* Every function of the flow by its own name, for tests (flow_pieces.py): the headers, less what keeps functions inside. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#pragma GCC visibility push(protected) /* not default: libc, too, has an `advance` */
#define static
#define inline
#include "flow.h"
#include "sensing.h"

int64_t flow_work_size(void);
int64_t flow_work_size(void)
{
    return (int64_t)sizeof(FlowWork);
}
