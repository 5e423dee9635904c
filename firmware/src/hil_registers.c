#include "hil_registers.h"

void hil_registers_init(hil_register_file *registers, double tick_rate_Hz) {
    const hil_register *watchdog = &hil_registers[HIL_REGISTER_WATCHDOG_TICKS];
    double most = HIL_WATCHDOG_S * tick_rate_Hz;
    for (unsigned k = 0; k < HIL_REGISTERS; k++)
        registers->value[k] = hil_registers[k].initial;
    /* Whole ticks within the register's own limits. */
    most = most < watchdog->maximum ? (double)(uint32_t)most : watchdog->maximum;
    registers->watchdog_most = most > watchdog->minimum ? most : watchdog->minimum;
    if (registers->value[HIL_REGISTER_WATCHDOG_TICKS] > registers->watchdog_most)
        registers->value[HIL_REGISTER_WATCHDOG_TICKS] = registers->watchdog_most;
}

unsigned hil_registers_find(uint16_t id) {
    unsigned place = 0;
    while (place < HIL_REGISTERS && hil_registers[place].id != id)
        place++;
    return place;
}

uint8_t hil_registers_refuse(const hil_register_file *registers, unsigned place, double value, bool settled) {
    if (place >= HIL_REGISTERS)
        return HIL_NACK_REASON_UNKNOWN_REGISTER;
    const hil_register *declared = &hil_registers[place];
    if (!declared->writable)
        return HIL_NACK_REASON_READ_ONLY;
    /* Written so that NaN, which compares with nothing, is refused. All limits fit 32 bits. */
    if (!(value >= declared->minimum && value <= declared->maximum))
        return HIL_NACK_REASON_OUT_OF_RANGE;
    if (!declared->real && (value < (double)(int64_t)value || value > (double)(int64_t)value))
        return HIL_NACK_REASON_OUT_OF_RANGE;
    if (place == HIL_REGISTER_WATCHDOG_TICKS && value > registers->watchdog_most)
        return HIL_NACK_REASON_OUT_OF_RANGE;
    if (!settled && !declared->live)
        return HIL_NACK_REASON_BAD_STATE;
    return 0;
}

uint32_t hil_registers_whole(const hil_register_file *registers, unsigned place) {
    return (uint32_t)registers->value[place];
}
