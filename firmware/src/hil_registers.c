#include "hil_registers.h"

void hil_registers_init(hil_register_file *registers) {
    for (unsigned k = 0; k < HIL_REGISTERS; k++)
        registers->value[k] = hil_registers[k].initial;
}

unsigned hil_registers_find(uint16_t id) {
    unsigned place = 0;
    while (place < HIL_REGISTERS && hil_registers[place].id != id)
        place++;
    return place;
}

uint8_t hil_registers_refuse(unsigned place, double value, bool settled) {
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
    if (!settled && !declared->live)
        return HIL_NACK_REASON_BAD_STATE;
    return 0;
}

uint32_t hil_registers_whole(const hil_register_file *registers, unsigned place) {
    return (uint32_t)registers->value[place];
}
