/* Frames on a byte stream, 00 | COBS(header, payload, CRC-32C) | 00, as hil/wire/framing.py has them. */

#ifndef TURN_FRAME_H
#define TURN_FRAME_H

#include "structs.h"

#define CRC_POLYNOMIAL 0x82F63B78u /* CRC-32C, reflected */
#define CRC_RESIDUE 0x48674BC7u    /* of any message followed by its own CRC-32C */

static uint32_t crc_of[8][256]; /* eight bytes at a time */

__attribute__((constructor)) static void fill_crc_tables(void)
{
    for (uint32_t byte = 0; byte < 256u; byte++) {
        uint32_t crc = byte;
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (crc & 1u ? CRC_POLYNOMIAL : 0u);
        crc_of[0][byte] = crc;
    }
    for (int k = 1; k < 8; k++)
        for (int byte = 0; byte < 256; byte++)
            crc_of[k][byte] = (crc_of[k - 1][byte] >> 8) ^ crc_of[0][crc_of[k - 1][byte] & 0xFFu];
}

static uint32_t crc32c(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (; size >= 8u; data += 8, size -= 8u) {
        uint32_t low = crc ^ ((uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 |
                              (uint32_t)data[3] << 24);
        crc = crc_of[7][low & 0xFFu] ^ crc_of[6][low >> 8 & 0xFFu] ^ crc_of[5][low >> 16 & 0xFFu] ^
              crc_of[4][low >> 24] ^ crc_of[3][data[4]] ^ crc_of[2][data[5]] ^ crc_of[1][data[6]] ^
              crc_of[0][data[7]];
    }
    while (size-- > 0u)
        crc = (crc >> 8) ^ crc_of[0][(crc ^ *data++) & 0xFFu];
    return ~crc;
}

/* Take the zeros back into `size` bytes without any, in place; how many bytes that makes, −1 if it is no COBS. */
static int64_t unstuff(uint8_t *data, size_t size)
{
    size_t from = 0, to = 0;
    while (from < size) {
        size_t length = data[from++];
        if (from + length - 1u > size)
            return -1;
        memmove(data + to, data + from, length - 1u);
        to += length - 1u;
        from += length - 1u;
        if (length < 0xFFu && from < size)
            data[to++] = 0;
    }
    return (int64_t)to;
}

/* `body` with checksum, stuffed and delimited; how many bytes that makes. `out` has room for a body of 253 bytes. */
static size_t seal(const uint8_t *body, size_t size, uint8_t out[HIL_MAX_HOST_PAYLOAD + HIL_MIN_BODY + 4u])
{
    uint8_t *to = out, *code;
    uint32_t crc = crc32c(body, size);
    *to++ = 0;
    code = to++;
    for (size_t k = 0; k < size + HIL_CRC_SIZE; k++) {
        uint8_t byte = k < size ? body[k] : (uint8_t)(crc >> (8u * (k - size)));
        if (byte != 0) {
            *to++ = byte;
        } else {
            *code = (uint8_t)(to - code);
            code = to++;
        }
    }
    *code = (uint8_t)(to - code);
    *to++ = 0;
    return (size_t)(to - out);
}

static void put_little(uint8_t *to, uint32_t value, unsigned size)
{
    for (unsigned k = 0; k < size; k++)
        to[k] = (uint8_t)(value >> (8u * k));
}

static uint32_t little(const uint8_t *from, unsigned size)
{
    uint32_t value = 0;
    for (unsigned k = 0; k < size; k++)
        value |= (uint32_t)from[k] << (8u * k);
    return value;
}

#endif
