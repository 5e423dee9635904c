#include "hil_crc32c.h"

/* Remainders of the sixteen half-bytes: 64 bytes of table, two look-ups a byte. */
static const uint32_t remainder_of[16] = {
    0x00000000u, 0x105EC76Fu, 0x20BD8EDEu, 0x30E349B1u, 0x417B1DBCu, 0x5125DAD3u, 0x61C69362u, 0x7198540Du,
    0x82F63B78u, 0x92A8FC17u, 0xA24BB5A6u, 0xB21572C9u, 0xC38D26C4u, 0xD3D3E1ABu, 0xE330A81Au, 0xF36E6F75u,
};

uint32_t hil_crc32c_byte(uint32_t crc, uint8_t byte) {
    crc ^= byte;
    crc = (crc >> 4) ^ remainder_of[crc & 0xFu];
    return (crc >> 4) ^ remainder_of[crc & 0xFu];
}
