/* The example board on a processor without an operating system: the library around a resonator, in lockstep on a UART.
 *
 * It closes its own loop in board mode by gyro_estimator.h. An estimator written for other codes is not used, and the
 * host is told that there is none.
 *
 * The host is waited for between ticks, so that nothing here depends on how fast the processor is, or its emulator.
 */
#include <string.h>

#include "estimating.h"
#include "hardware.h"
#include "hil_board.h"
#include "hil_serial.h"
#include "resonator.h"

#define BLOCK_ROWS 256u
#define WIDTH 2u

#ifndef RATE_RAD_S
#define RATE_RAD_S 1.0
#endif
#ifndef LATENCY
#define LATENCY 1
#endif
#ifndef SEED
#define SEED 1u
#endif
#ifndef SENSE_BITS
#define SENSE_BITS 16u
#endif

static hil_board board;
static hil_serial serial;
static resonator mass;
static estimating own;
static uint8_t blocks[HIL_BLOCKS_SIZE(BLOCK_ROWS, WIDTH)];

static size_t room(void *context) {
    (void)context;
    return SIZE_MAX; /* `put` waits */
}

static void put(void *context, const uint8_t *data, size_t size) {
    (void)context;
    uart_write(data, size);
}

static uint64_t now_ns(void *context) {
    (void)context;
    return counter_ns();
}

static bool start(const resonator_device *device) {
    hil_config config;
    memset(&config, 0, sizeof config);
    config.identity = resonator_identity(device, 0xA500, LATENCY);
    config.clocks = 1u << HIL_CLOCK_MODE_LOCKSTEP;
    config.link = &serial.link;
    config.blocks = blocks;
    config.blocks_size = sizeof blocks;
    config.now_ns = now_ns;
    if (estimating_init(&own, &config.identity) == NULL)
        config.estimator = &own.face;
    resonator_init(&mass, device, SEED);
    hil_serial_init(&serial, room, put, NULL);
    return hil_board_init(&board, &config);
}

/* What a board of silicon does in its sample interrupt. */
static void tick(void) {
    int32_t vx, vy;
    hil_drive drive = hil_board_drive(&board);
    if (board.tick >= 0) /* row 0 is the start: nothing came before it */
        resonator_step(&mass, drive.ux, drive.uy);
    int clipped = resonator_sense(&mass, &vx, &vy);
    hil_board_sample(&board, vx, vy, clipped != 0);
    hil_board_poll(&board);
}

int main(void) {
    static resonator_device device;
    uint8_t data[64];
    device = resonator_slow;
    device.rate_rad_s = RATE_RAD_S;
    device.sense_bits = SENSE_BITS;
    uart_init();
    if (!start(&device))
        return 1;
    for (;;) {
        hil_serial_receive(&serial, &board, data, uart_read(data, sizeof data));
        while (hil_board_may_go_on(&board))
            tick();
        hil_board_poll(&board);
    }
}
