/* BLAKE2s (RFC 7693), keyed or not, in one call. No allocation; about 200 bytes of stack. */
#ifndef HIL_BLAKE2S_H
#define HIL_BLAKE2S_H

#include <stddef.h>
#include <stdint.h>

#define HIL_BLAKE2S_MOST 32u /* bytes of a key, and of a hash */

/* A key that is ready for use: its block is behind it, so that a short message costs one compression. */
typedef struct hil_blake2s {
    uint32_t chain[8];
    uint8_t key[HIL_BLAKE2S_MOST];
    uint8_t key_size;
    uint8_t size;
} hil_blake2s;

/* A key of 0 to 32 bytes, for hashes of 1 to 32 bytes. */
void hil_blake2s_init(hil_blake2s *hash, const uint8_t *key, size_t key_size, size_t size);

/* The hash of a message, `size` bytes of it. */
void hil_blake2s_of(const hil_blake2s *hash, const uint8_t *data, size_t data_size, uint8_t *out);

#endif
