#include "hil_blake2s.h"

#include <stdbool.h>
#include <string.h>

#define BLOCK 64u
#define ROUNDS 10u

static const uint32_t start[8] = {0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au,
                                  0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u};

static const uint8_t order[ROUNDS][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4}, {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13}, {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11}, {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5}, {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0},
};

static uint32_t turned(uint32_t word, unsigned right) {
    return word >> right | word << (32u - right);
}

static void mix(uint32_t *v, unsigned a, unsigned b, unsigned c, unsigned d, uint32_t x, uint32_t y) {
    v[a] = v[a] + v[b] + x;
    v[d] = turned(v[d] ^ v[a], 16);
    v[c] = v[c] + v[d];
    v[b] = turned(v[b] ^ v[c], 12);
    v[a] = v[a] + v[b] + y;
    v[d] = turned(v[d] ^ v[a], 8);
    v[c] = v[c] + v[d];
    v[b] = turned(v[b] ^ v[c], 7);
}

/* `total` counts the bytes up to the end of this block, the key's included. */
static void compress(uint32_t *chain, const uint8_t *block, uint64_t total, bool last) {
    uint32_t m[16], v[16];
    for (unsigned k = 0; k < 16u; k++)
        m[k] = block[4u * k] | (uint32_t)block[4u * k + 1u] << 8 | (uint32_t)block[4u * k + 2u] << 16 |
               (uint32_t)block[4u * k + 3u] << 24;
    for (unsigned k = 0; k < 8u; k++) {
        v[k] = chain[k];
        v[k + 8u] = start[k];
    }
    v[12] ^= (uint32_t)total;
    v[13] ^= (uint32_t)(total >> 32);
    if (last)
        v[14] = ~v[14];
    for (unsigned round = 0; round < ROUNDS; round++) {
        const uint8_t *s = order[round];
        mix(v, 0, 4, 8, 12, m[s[0]], m[s[1]]);
        mix(v, 1, 5, 9, 13, m[s[2]], m[s[3]]);
        mix(v, 2, 6, 10, 14, m[s[4]], m[s[5]]);
        mix(v, 3, 7, 11, 15, m[s[6]], m[s[7]]);
        mix(v, 0, 5, 10, 15, m[s[8]], m[s[9]]);
        mix(v, 1, 6, 11, 12, m[s[10]], m[s[11]]);
        mix(v, 2, 7, 8, 13, m[s[12]], m[s[13]]);
        mix(v, 3, 4, 9, 14, m[s[14]], m[s[15]]);
    }
    for (unsigned k = 0; k < 8u; k++)
        chain[k] ^= v[k] ^ v[k + 8u];
}

/* The chain before the first block. */
static void begin(uint32_t *chain, size_t key_size, size_t size) {
    memcpy(chain, start, sizeof start);
    chain[0] ^= 0x01010000u ^ (uint32_t)key_size << 8 ^ (uint32_t)size;
}

void hil_blake2s_init(hil_blake2s *hash, const uint8_t *key, size_t key_size, size_t size) {
    uint8_t block[BLOCK] = {0};
    hash->key_size = (uint8_t)key_size;
    hash->size = (uint8_t)size;
    begin(hash->chain, key_size, size);
    if (key_size == 0u)
        return;
    memcpy(hash->key, key, key_size);
    memcpy(block, key, key_size);
    compress(hash->chain, block, BLOCK, false);
}

void hil_blake2s_of(const hil_blake2s *hash, const uint8_t *data, size_t data_size, uint8_t *out) {
    uint32_t chain[8];
    uint8_t block[BLOCK] = {0};
    uint64_t total = hash->key_size > 0u ? BLOCK : 0u;
    memcpy(chain, hash->chain, sizeof chain);
    if (data_size == 0u && hash->key_size > 0u) { /* the key's block is the last one, too */
        begin(chain, hash->key_size, hash->size);
        memcpy(block, hash->key, hash->key_size);
    } else {
        for (; data_size > BLOCK; data_size -= BLOCK, data += BLOCK)
            compress(chain, data, total += BLOCK, false);
        total += data_size;
        if (data_size > 0u)
            memcpy(block, data, data_size);
    }
    compress(chain, block, total, true);
    for (size_t k = 0; k < hash->size; k++)
        out[k] = (uint8_t)(chain[k / 4u] >> (8u * (k % 4u)));
}
