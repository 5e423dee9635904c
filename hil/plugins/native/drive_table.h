/* A table of drives in the place of a plug-in: row after row, whatever comes, within a limit of the sense voltages. */

#ifndef PLUGIN_DRIVE_TABLE_H
#define PLUGIN_DRIVE_TABLE_H

#include "structs.h"

/* `pieces` numbers the parts of the table: one in which a voltage exceeds its limit is not driven to its end. */
typedef struct {
    const double *forces;  /* (rows, 2), m/s2 */
    const int32_t *pieces; /* (rows) */
    int64_t rows;
    double limit_V[2];
    int64_t at;
    int64_t ended; /* number of the piece that is not driven on; -1 for none */
} drive_table_t;

EXPORT void drive_table_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    drive_table_t *table = instance;
    estimate->angle_rad = 0.0;
    for (int entry = GYRO_PLUGIN_X; entry <= GYRO_PLUGIN_RATE; entry++)
        estimate->state[entry] = 0.0;
    for (int axis = 0; axis < 2; axis++)
        if (table->at < table->rows && fabs(sample->sense_V[axis]) > table->limit_V[axis])
            table->ended = table->pieces[table->at];
}

EXPORT void drive_table_control(void *instance, const gyro_plugin_estimate *estimate, int drive_on, gyro_plugin_drive *drive)
{
    drive_table_t *table = instance;
    (void)estimate;
    drive->force_mps2[0] = drive->force_mps2[1] = drive->virtual_rotation_rad_s = 0.0;
    if (!drive_on || table->at >= table->rows)
        return;
    if (table->pieces[table->at] != table->ended)
        memcpy(drive->force_mps2, table->forces + 2 * table->at, sizeof drive->force_mps2);
    table->at++;
}

#endif
