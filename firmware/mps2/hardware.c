#include "hardware.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u)
#define UART_CONTROL REGISTER(0x40004008u)
#define UART_INTERRUPT REGISTER(0x4000400Cu)
#define UART_DIVISOR REGISTER(0x40004010u)
#define COUNTER REGISTER(0x40028018u)     /* at 25 MHz; wraps every 172 s */
#define HUNDREDTHS REGISTER(0x40028014u)  /* at 100 Hz; wraps every 497 days */
#define NVIC_ENABLE REGISTER(0xE000E100u)
#define NVIC_CLEAR REGISTER(0xE000E280u)

#define TRANSMITTER_FULL 1u
#define RECEIVED 2u
#define ENABLE_BOTH_AND_TELL_RECEIVED 0xBu
#define RECEIVE_INTERRUPT 1u
#define FASTEST 16u
#define TICKS_PER_HUNDREDTH 250000u
#define NS_PER_TICK 40u

void uart_init(void) {
    __asm volatile("cpsid i");
    UART_DIVISOR = FASTEST;
    UART_CONTROL = ENABLE_BOTH_AND_TELL_RECEIVED;
    NVIC_ENABLE = RECEIVE_INTERRUPT;
}

size_t uart_read(uint8_t *data, size_t size) {
    size_t n = 0;
    while (!(UART_STATE & RECEIVED)) {
        __asm volatile("wfi"); /* a masked interrupt wakes it, too */
        UART_INTERRUPT = 2u;
        NVIC_CLEAR = RECEIVE_INTERRUPT;
    }
    while (n < size && (UART_STATE & RECEIVED))
        data[n++] = (uint8_t)UART_DATA;
    return n;
}

void uart_write(const uint8_t *data, size_t size) {
    for (size_t k = 0; k < size; k++) {
        while (UART_STATE & TRANSMITTER_FULL) {
        }
        UART_DATA = data[k];
    }
}

uint64_t counter_ns(void) {
    uint64_t coarse = (uint64_t)HUNDREDTHS * TICKS_PER_HUNDREDTH;
    int32_t ahead = (int32_t)(COUNTER - (uint32_t)coarse); /* of the coarse one, modulo 2^32 */
    return (coarse + (uint64_t)(int64_t)ahead) * NS_PER_TICK;
}
