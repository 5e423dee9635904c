/* A node of a Linux CAN interface (SocketCAN), with a bounded queue in front of it. */
#ifndef CAN_SOCKET_H
#define CAN_SOCKET_H

#include <stdbool.h>
#include <stddef.h>

#include "hil_can.h"

#define CAN_QUEUE 1024u

typedef struct can_socket {
    int descriptor;
    hil_can_frame queue[CAN_QUEUE];
    size_t first;
    size_t queued;
} can_socket;

/* Open an interface, deaf to identifiers other than (match, mask); false with errno set. */
bool can_open(can_socket *c, const char *interface, unsigned match, unsigned mask);

/* Frames that can_put could take now. */
size_t can_free(void *c);

/* Queue a frame; there must be room. */
void can_put(void *c, const hil_can_frame *frame);

/* Hand over to the kernel what it takes. */
void can_flush(can_socket *c);

/* The next frame that has arrived; false if there is none. */
bool can_read(can_socket *c, hil_can_frame *frame);

#endif
