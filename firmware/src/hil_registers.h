/* The board's registers: defaults and limits from the spec, refusals with a reason. */
#ifndef HIL_REGISTERS_H
#define HIL_REGISTERS_H

#include <stdbool.h>
#include <stdint.h>

#include "hil_spec.h"

/* Values by their place in hil_registers. */
typedef struct hil_register_file {
    double value[HIL_REGISTERS];
    double watchdog_most; /* ceiling of WATCHDOG_TICKS on this board */
} hil_register_file;

void hil_registers_init(hil_register_file *registers, double tick_rate_Hz);

/* Place of a register in the file; HIL_REGISTERS if there is none of that number. */
unsigned hil_registers_find(uint16_t id);

/* Whether a register may be given a value now: 0, or the reason of a NACK. A settled board is IDLE or SAFE. */
uint8_t hil_registers_refuse(const hil_register_file *registers, unsigned place, double value, bool settled);

/* A register as the whole number it holds. */
uint32_t hil_registers_whole(const hil_register_file *registers, unsigned place);

#endif
