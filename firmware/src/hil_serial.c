#include "hil_serial.h"

size_t hil_serial_size(size_t payload_size) {
    size_t body = HIL_MIN_BODY + payload_size;
    return 1u + body + body / 254u + 1u + 1u;
}

static bool send(hil_link *link, const hil_frame *frame) {
    hil_serial *serial = (hil_serial *)link; /* its first member */
    if (serial->free(serial->context) < hil_serial_size(frame->size))
        return false;
    hil_frame_write(frame, serial->write, serial->context);
    return true;
}

static uint16_t numbers(const hil_link *link, uint32_t rows, unsigned width) {
    (void)link;
    (void)rows;
    (void)width;
    return 1u;
}

static uint32_t bad(const hil_link *link) {
    return hil_reader_bad(&((const hil_serial *)link)->reader);
}

void hil_serial_init(hil_serial *serial, size_t (*free)(void *context), hil_write write, void *context) {
    serial->link.send = send;
    serial->link.numbers = numbers;
    serial->link.bad = bad;
    hil_reader_init(&serial->reader, serial->body, sizeof serial->body);
    serial->free = free;
    serial->write = write;
    serial->context = context;
}

void hil_serial_receive(hil_serial *serial, hil_board *board, const uint8_t *data, size_t size) {
    hil_frame frame;
    for (size_t k = 0; k < size; k++)
        if (hil_reader_take(&serial->reader, data[k], &frame))
            hil_board_frame(board, &frame);
}
