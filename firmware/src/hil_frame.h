/* Frames on a byte stream: 00 | COBS(type u8, seq u16, tick u32, payload, crc32c u32) | 00.
 *
 * Nothing here needs memory of its own beyond half a kilobyte of stack: the writer stuffs as it goes, and the reader
 * unstuffs and checks byte by byte, keeping as much of a frame as the caller gave it room for.
 */
#ifndef HIL_FRAME_H
#define HIL_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hil_spec.h"

#define HIL_HEADER_SIZE 7u
#define HIL_CRC_SIZE 4u
#define HIL_MIN_BODY (HIL_HEADER_SIZE + HIL_CRC_SIZE)
#define HIL_MAX_BODY (HIL_MIN_BODY + HIL_MAX_PAYLOAD)
/* Longest run of bytes between two delimiters that can still be a frame. */
#define HIL_MAX_ENCODED (HIL_MAX_BODY + HIL_MAX_BODY / 254u + 1u)

typedef struct hil_frame {
    uint8_t type;
    bool sequenced; /* false: stands outside the sequence, which exists on CAN only; seq and tick mean nothing */
    uint16_t seq;
    uint32_t tick;
    const uint8_t *payload;
    size_t size; /* of the payload as it was sent; a reader with less room holds only its beginning */
} hil_frame;

/* Takes bytes for the wire: all of them, before it returns. */
typedef void (*hil_write)(void *context, const uint8_t *data, size_t size);

/* Write a frame, in pieces of at most 512 bytes; one of up to 256 bytes is one piece. */
void hil_frame_write(const hil_frame *frame, hil_write write, void *context);

typedef struct hil_reader {
    /* Counters, for diagnosis; they stop at 2^32 - 1. */
    uint32_t frames;
    uint32_t cobs_errors; /* runs between delimiters that are not COBS */
    uint32_t too_short;   /* runs that decode to less than a header and a checksum */
    uint32_t crc_errors;  /* runs whose checksum is wrong */
    uint32_t oversize;    /* runs longer than any frame */
    /* The frame in work. */
    uint8_t *body;
    size_t room;
    size_t body_size;
    size_t run_size;
    uint32_t crc;
    uint8_t code;
    uint8_t left;
} hil_reader;

/* A reader that keeps `room` bytes of a frame: HIL_MIN_BODY + HIL_MAX_HOST_PAYLOAD is enough for a board,
 * HIL_MAX_BODY for everything. Counters start at zero. */
void hil_reader_init(hil_reader *reader, uint8_t *body, size_t room);

/* Take one byte. True if it completed an intact frame, which stays where it is until the next byte comes. */
bool hil_reader_take(hil_reader *reader, uint8_t byte, hil_frame *frame);

/* Runs dropped for any reason. */
uint32_t hil_reader_bad(const hil_reader *reader);

/* One more, but no further than 2^32 - 1. */
void hil_count(uint32_t *counter, uint32_t more);

#endif
