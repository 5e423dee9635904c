/* What the board asks of a link: take whole frames, and say how many it could not read.
 *
 * hil_serial is one for UART, USB and ptys, hil_can one for CAN FD. A link of your own begins with this struct and is handed to
 * hil_board_init; frames that arrive go to hil_board_frame.
 */
#ifndef HIL_LINK_H
#define HIL_LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "hil_frame.h"

typedef struct hil_link hil_link;

struct hil_link {
    /* Queue a frame. False if there is no room for all of it: then none of it may be sent. */
    bool (*send)(hil_link *link, const hil_frame *frame);
    /* Sequence numbers that a SENSE of so many rows takes; every other frame takes one. */
    uint16_t (*numbers)(const hil_link *link, uint32_t rows, unsigned width);
    /* Frames dropped as unreadable since power-up. */
    uint32_t (*bad)(const hil_link *link);
};

#endif
