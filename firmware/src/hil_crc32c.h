/* CRC-32C (Castagnoli): reflected, initial value and final XOR all ones; 0xE3069283 for "123456789". */
#ifndef HIL_CRC32C_H
#define HIL_CRC32C_H

#include <stdint.h>

#define HIL_CRC32C_START 0xFFFFFFFFu

/* What the register holds after any message followed by its own checksum, little-endian. */
#define HIL_CRC32C_RESIDUE 0xB798B438u

/* The register after one more byte; the checksum is the complement of the register. */
uint32_t hil_crc32c_byte(uint32_t crc, uint8_t byte);

#endif
