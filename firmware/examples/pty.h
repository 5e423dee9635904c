/* The board's end of a pseudo-terminal, with a bounded queue in front of it. */
#ifndef PTY_H
#define PTY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct pty {
    int master;
    int slave; /* held open until a host has spoken: without one the kernel reports a hang-up */
    char path[64];
    uint8_t queue[262144]; /* a third of a second of 100 kS/s */
    size_t queued;
} pty;

/* Open a pty in raw mode; false with errno set. */
bool pty_open(pty *p);

/* Bytes that pty_write could take now. */
size_t pty_free(void *p);

/* Queue bytes; there must be room. */
void pty_write(void *p, const uint8_t *data, size_t size);

/* Hand over to the kernel what it takes. */
void pty_flush(pty *p);

/* Bytes that have arrived: their number, 0 if there are none, -1 once the host has hung up. */
long pty_read(pty *p, uint8_t *data, size_t size);

/* After a hang-up: make ready for the next host. */
void pty_await(pty *p);

#endif
