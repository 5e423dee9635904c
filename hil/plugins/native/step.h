/* A sample through a plug-in: called, timed, its memory looked at, and what it says checked before it is used. */

#ifndef PLUGIN_STEP_H
#define PLUGIN_STEP_H

#include "derived.h"
#include "watch.h"

#define LOOK_AT_MEMORY 256 /* calls */
#define HELD_PERIODS 100.0
#define ABSURD 1e9 /* times the scale of the device as declared */
#define FINE_NS 15000000   /* below which the clock has to be fine: the coarse one goes in steps of 4 ms at most */

static bool wrong(plugin_t *plugin, int64_t part, int64_t fault, int64_t entry, double value)
{
    plugin->part = part;
    plugin->fault = fault;
    plugin->entry = entry;
    plugin->value = value;
    if (plugin->failed != NULL)
        *plugin->failed = 1;
    return false;
}

/* The time, as finely as the limit of a call needs it: a coarse clock costs a tenth. */
static int64_t time_ns(const plugin_t *plugin)
{
    return plugin->limit_ns < FINE_NS ? now_ns() : coarse_ns();
}

static void enter(plugin_t *plugin, int64_t part)
{
    part_inside = part;
    entered_ns = time_ns(plugin);
    inside = plugin;
}

/* Whether it came back as it should. */
static bool came_back(plugin_t *plugin, int64_t part)
{
    inside = NULL;
    int64_t taken_ns = time_ns(plugin) - entered_ns;
    if (plugin->raised)
        return wrong(plugin, part, FAULT_RAISED, 0, 0.0);
    for (int i = 0; i < LENT; i++)
        if (!is_whole(&plugin->lent[i]))
            return wrong(plugin, part, FAULT_OVERRUN, i, 0.0);
    if (taken_ns > plugin->limit_ns)
        return wrong(plugin, part, FAULT_LATE, 0, 1e-9 * (double)taken_ns);
    if (plugin->begun_pages > 0 && plugin->number % LOOK_AT_MEMORY == LOOK_AT_MEMORY - 1) {
        int64_t more = pages_taken() - plugin->begun_pages;
        if (more > plugin->most_pages)
            return wrong(plugin, part, FAULT_GROWN, 0, (double)more * (double)sysconf(_SC_PAGESIZE));
    }
    return true;
}

static void blank(const plugin_t *plugin)
{
    gyro_plugin_estimate *estimate = plugin->estimate;
    double *single = &estimate->angle_rad;
    while (single < estimate->state)
        *single++ = (double)NAN;
    for (int64_t i = 0; i < plugin->states; i++)
        estimate->state[i] = estimate->deviation[i] = (double)NAN;
}

/* The sample, in volts and m/s2; `imposed`: the virtual rotation of that drive. */
static void hand_over(plugin_t *plugin, const double sense_V[2], const double applied_mps2[2], const int32_t codes[4],
                      double imposed)
{
    gyro_plugin_sample *sample = plugin->sample;
    sample->virtual_rotation_rad_s = imposed;
    sample->number = plugin->number;
    sample->lost = isnan(sense_V[0]) || isnan(sense_V[1]);
    for (int axis = 0; axis < 2; axis++) {
        sample->sense_V[axis] = sense_V[axis];
        sample->applied_mps2[axis] = applied_mps2[axis];
        sample->sense_codes[axis] = codes[axis];
        sample->applied_codes[axis] = codes[2 + axis];
    }
}

/* A constant that was given, and is NaN now, is the declared one again: which is told. */
static void withdraw(plugin_t *plugin, int64_t entry)
{
    if (plugin->withdrawn == 0)
        plugin->withdrawn_at = plugin->number;
    plugin->withdrawn |= UINT64_C(1) << entry;
}

/* Whether its estimate can be used; then it stands where the record is made from. */
static bool is_estimate(plugin_t *plugin)
{
    static const int64_t needed[] = {GYRO_PLUGIN_X, GYRO_PLUGIN_VX, GYRO_PLUGIN_Y, GYRO_PLUGIN_VY, GYRO_PLUGIN_RATE};
    gyro_plugin_estimate *estimate = plugin->estimate;
    if (!isfinite(estimate->angle_rad))
        return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, ENTRY_ANGLE, estimate->angle_rad);
    if (estimate->angle_u_rad < 0.0 || isinf(estimate->angle_u_rad))
        return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, ENTRY_ANGLE_U, estimate->angle_u_rad);
    for (int k = 0; k < 5; k++)
        if (!isfinite(estimate->state[needed[k]]))
            return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, needed[k], estimate->state[needed[k]]);
    for (int64_t i = 0; i < plugin->states; i++) {
        double value = estimate->state[i], deviation = estimate->deviation[i];
        if (isinf(value))
            return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, i, value);
        if (deviation < 0.0 || isinf(deviation))
            return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, GYRO_PLUGIN_STATES + i, deviation);
        if (isnan(value)) { /* for the controller, too */
            estimate->state[i] = plugin->declared[i];
            deviation = 0.0;
            if ((plugin->given >> i & 1u) != 0 && (plugin->withdrawn >> i & 1u) == 0)
                withdraw(plugin, i);
        } else {
            plugin->given |= UINT64_C(1) << i;
        }
        plugin->state[i] = estimate->state[i];
        plugin->variance[i * (plugin->states + 1)] = deviation * deviation;
    }
    for (int axis = 0; axis < 2; axis++) {
        double deviation = estimate->innovation_deviation_V[axis];
        if (deviation < 0.0 || isinf(deviation))
            return wrong(plugin, PART_OBSERVE, FAULT_NUMBER, ENTRY_INNOVATION_SD_X + axis, deviation);
    }
    return true;
}

/* Whether its motion still follows the samples: a mass that vibrates is nowhere twice, and one that is held for so many
   periods is no estimate. One that says zero has not begun. */
static bool follows(plugin_t *plugin)
{
    held_t *held = &plugin->held;
    bool same = true, moving = false, heard = false;
    for (int i = 0; i < 4; i++) {
        double value = plugin->state[i];
        same = same && value == held->motion[i];
        moving = moving || value != 0.0;
        held->motion[i] = value;
    }
    for (int axis = 0; axis < 2; axis++) {
        heard = heard || (!plugin->sample->lost && plugin->sample->sense_V[axis] != held->sense_V[axis]);
        held->sense_V[axis] = plugin->sample->sense_V[axis];
    }
    held->unchanged = same && moving ? held->unchanged + heard : 0;
    double turn = sqrt(plugin->device.target_stiffness_per_s2) * plugin->step_s * (double)held->unchanged;
    return turn < HELD_PERIODS * 2.0 * HALF_TURN || wrong(plugin, PART_OBSERVE, FAULT_HELD, 0, HELD_PERIODS);
}

/* The bench's own estimate, for a plug-in that controls. */
static void own_estimate(const plugin_t *plugin)
{
    const own_t *own = &plugin->own;
    const double *row = own->row;
    gyro_plugin_estimate *estimate = plugin->estimate;
    for (int64_t i = 0; i < plugin->states; i++) {
        estimate->state[i] = own->x[i] * own->factors[i];
        estimate->deviation[i] = 0.0;
    }
    for (int64_t i = 0; i < own->estimated; i++) {
        double variance = own->variance[i * (own->estimated + 1)];
        int64_t entry = own->entries[i];
        estimate->deviation[entry] = sqrt(variance) * fabs(own->factors[entry]);
    }
    for (int axis = 0; axis < 2; axis++) {
        estimate->innovation_V[axis] = row[ROW_NU + axis] * own->volts[axis];
        estimate->innovation_deviation_V[axis] = sqrt(row[ROW_S + axis]) * fabs(own->volts[axis]);
    }
    estimate->angle_rad = row[ROW_ANGLE];
    estimate->angle_u_rad = sqrt(row[ROW_ANGLE_VARIANCE]);
    estimate->angle_forced_rad = row[ROW_FORCED];
    estimate->angle_pattern_rad = row[ROW_PATTERN];
    estimate->angle_plain_rad = row[ROW_PLAIN];
    estimate->rate_integral_rad = row[ROW_INTEGRAL];
    estimate->energy_ratio = row[ROW_ENERGY];
    estimate->quadrature_ratio = row[ROW_QUADRATURE];
}

/* The trim voltages of this sample, where the observer is told of them and they have changed; false where it went wrong. */
static bool trimmed(plugin_t *plugin)
{
    gyro_plugin_trims *trims = plugin->trims;
    double volts[GYRO_PLUGIN_TRIMS] = {0.0};
    if (trims->count == 0)
        return true;
    plugin->own.trimmed(plugin->own.estimator, volts);
    if (plugin->trimmed == NULL || (plugin->number > 0 && memcmp(volts, trims->volts, sizeof volts) == 0))
        return true;
    memcpy(trims->volts, volts, sizeof volts);
    memset(trims->softened_per_s2, 0, sizeof trims->softened_per_s2);
    for (int64_t k = 0; k < trims->count; k++)
        for (int i = 0; i < 3; i++)
            trims->softened_per_s2[i] += trims->softening_per_s2_per_V2[k][i] * volts[k] * volts[k];
    enter(plugin, PART_OBSERVE);
    plugin->trimmed(plugin->observer, trims);
    return came_back(plugin, PART_OBSERVE);
}

/* One sample taken in; false where it went wrong. */
static bool observed(plugin_t *plugin)
{
    if (plugin->number == 0) {
        memset(&plugin->turned, 0, sizeof plugin->turned);
        memset(&plugin->held, 0, sizeof plugin->held);
        plugin->given = plugin->withdrawn = 0;
    }
    blank(plugin);
    if (!trimmed(plugin))
        return false;
    enter(plugin, PART_OBSERVE);
    plugin->observe(plugin->observer, plugin->sample, plugin->estimate);
    if (!came_back(plugin, PART_OBSERVE) || !is_estimate(plugin))
        return false;
    fill_row(plugin);
    plugin->number++;
    return follows(plugin);
}

/* The drive codes that it asks for; false where they may not be sent. */
static bool controlled(plugin_t *plugin, double codes[2])
{
    gyro_plugin_drive *drive = plugin->drive;
    memset(drive, 0, sizeof *drive);
    enter(plugin, PART_CONTROL);
    plugin->control(plugin->controller, plugin->estimate, plugin->drive_on == 1, drive);
    codes[0] = codes[1] = (double)NAN; /* which may not be sent */
    if (!came_back(plugin, PART_CONTROL))
        return false;
    if (!isfinite(drive->virtual_rotation_rad_s))
        return wrong(plugin, PART_CONTROL, FAULT_NUMBER, ENTRY_VIRTUAL, drive->virtual_rotation_rad_s);
    double asked[2];
    for (int axis = 0; axis < 2; axis++) {
        double force = drive->force_mps2[axis];
        if (!isfinite(force))
            return wrong(plugin, PART_CONTROL, FAULT_NUMBER, ENTRY_DRIVE_X + axis, force);
        asked[axis] = rint(force / plugin->device.drive_scale_mps2);
        if (fabs(asked[axis]) > (double)plugin->code_limit)
            return wrong(plugin, PART_CONTROL, FAULT_BEYOND, ENTRY_DRIVE_X + axis, force);
    }
    for (int axis = 0; axis < 2; axis++)
        codes[axis] = plugin->drive_on == 1 ? asked[axis] : 0.0;
    return true;
}

/* The drive for the interval `latency` samples on, by the part that controls. */
static void drive(plugin_t *plugin, double codes[2])
{
    const own_t *own = &plugin->own;
    double x[GYRO_PLUGIN_STATES];
    if (plugin->control == NULL) {
        for (int64_t i = 0; i < plugin->states; i++) {
            x[i] = plugin->state[i] / own->factors[i];
            if (fabs(x[i]) > ABSURD) { /* of which the law makes no force */
                wrong(plugin, PART_OBSERVE, FAULT_ABSURD, i, plugin->state[i]);
                codes[0] = codes[1] = (double)NAN;
                return;
            }
        }
        own->follow(own->estimator, x);
        own->control(own->estimator, codes);
    } else if (controlled(plugin, codes)) {
        double rotation = plugin->drive_on == 1 ? plugin->drive->virtual_rotation_rad_s : 0.0;
        own->commanded(own->estimator, codes, rotation * own->per_second);
    }
}

#endif
