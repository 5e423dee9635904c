/* From power-up to main: the vectors, the floating-point unit, the initial values of variables. */
#include <stdint.h>
#include <string.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88u)

extern uint8_t data_begin[], data_end[], bss_begin[], bss_end[], stack_top[];
extern const uint8_t data_source[];
int main(void);
void reset(void);

/* A fault of the program, too: nothing is put out any more, and the host's time-out tells it. */
static void stop(void) {
    for (;;)
        __asm volatile("cpsid i\n wfi");
}

typedef union vector {
    void (*handler)(void);
    const void *stack;
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = stack_top}, {.handler = reset}, {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = stop},    {.handler = stop},  {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = stop},    {.handler = stop},  {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = stop},
};

void reset(void) {
    CPACR |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    memcpy(data_begin, data_source, (size_t)(data_end - data_begin));
    memset(bss_begin, 0, (size_t)(bss_end - bss_begin));
    (void)main();
    stop();
}
