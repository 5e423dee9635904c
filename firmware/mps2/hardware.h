/* The board's first UART and its counter. Interrupts stay masked: the processor sleeps until a byte is there. */
#ifndef HARDWARE_H
#define HARDWARE_H

#include <stddef.h>
#include <stdint.h>

void uart_init(void);

/* Bytes that have arrived, at most size; sleeps until there is one. */
size_t uart_read(uint8_t *data, size_t size);

/* Waits while the transmitter is busy. */
void uart_write(const uint8_t *data, size_t size);

/* Since power-up. */
uint64_t counter_ns(void);

#endif
