/* The link for anything that carries bytes: UART, USB CDC, a pty. */
#ifndef HIL_SERIAL_H
#define HIL_SERIAL_H

#include "hil_board.h"
#include "hil_frame.h"
#include "hil_link.h"

#define HIL_SERIAL_ROOM (HIL_MIN_BODY + HIL_MAX_HOST_PAYLOAD)

typedef struct hil_serial {
    hil_link link;
    hil_reader reader;
    uint8_t body[HIL_SERIAL_ROOM];
    size_t (*free)(void *context); /* bytes that `write` could take now */
    hil_write write;
    void *context;
} hil_serial;

/* Room a frame needs on the wire, delimiters included. */
size_t hil_serial_size(size_t payload_size);

void hil_serial_init(hil_serial *serial, size_t (*free)(void *context), hil_write write, void *context);

/* Give the board what has arrived. */
void hil_serial_receive(hil_serial *serial, hil_board *board, const uint8_t *data, size_t size);

#endif
