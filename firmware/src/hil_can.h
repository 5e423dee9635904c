/* The link for CAN FD: the same messages in CAN frames; SAFE and ARM, and a short STATUS, in classic ones. */
#ifndef HIL_CAN_H
#define HIL_CAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hil_board.h"
#include "hil_link.h"

/* One CAN frame with an 11-bit identifier; `fd`: CAN FD with bit-rate switching. */
typedef struct hil_can_frame {
    uint16_t identifier;
    bool fd;
    uint8_t length;
    uint8_t data[HIL_CAN_MOST];
} hil_can_frame;

typedef struct hil_can {
    hil_link link;
    uint8_t node;
    size_t (*free)(void *context); /* frames that `put` could take now */
    void (*put)(void *context, const hil_can_frame *frame);
    void *context;
    uint32_t malformed; /* frames whose length contradicts their content */
    uint32_t broken;    /* long messages of which a part is missing */
    /* The message whose parts are being joined. */
    bool joining;
    uint8_t type;
    uint16_t seq;
    uint8_t parts;
    size_t size;
    uint8_t payload[HIL_MAX_HOST_PAYLOAD];
} hil_can;

/* A link for one of the HIL_CAN_NODES nodes. Frames must leave in the order they are put. */
void hil_can_init(hil_can *can, uint8_t node, size_t (*free)(void *context),
                  void (*put)(void *context, const hil_can_frame *frame), void *context);

/* Whether a frame is meant for this board: for an acceptance filter, identifier & mask == match. */
uint16_t hil_can_match(const hil_can *can);
uint16_t hil_can_mask(void);

/* Give the board a frame that has arrived; other people's are passed over. */
void hil_can_receive(hil_can *can, hil_board *board, const hil_can_frame *frame);

#endif
