/* An observer of the averaged motion: in-phase and quadrature components of both axes against a fixed reference, rate,
   angle, stiffness and damping, from one demodulated block of whole cycles after another, some hundred to a thousand a
   second (Lynch, 1995). A lock-in's streams are taken as they are, in blocks of some rows.

   The components z of x and y obey, averaged, dz/dt = A z + (i/2w) f with A = -D/2 - i (K - w^2)/2w + rate J: an extended
   Kalman filter of twelve states that steps once a block. The angle is one of them, so that what a block says of the
   pattern's direction counts for it. */

#include <complex.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "../../native/gyro_plugin.h"

#define HALF_TURN 3.14159265358979323846
#define MOST 4096    /* samples of a block */
#define BLOCKS_HZ 1000.0
#define RATE_WALK 0.5 /* rad/s per root of a second */
#define STIFFNESS_SD 0.05
#define RATE_SD 2.0 /* rad/s */
#define MEMORY_S 10.0 /* of stiffness and damping */

/* Motion (cosine and sine of x, of y), angle, rate; offsets from the reference and decays, rad/s. */
enum { ANGLE = 4, RATE, KXX, KYY, KXY, HXX, HYY, HXY, ENTRIES };

typedef struct {
    gyro_plugin_device device;
    long samples, at, blocks; /* of a block; in the present one; that were taken in */
    long last; /* sample of a block up to which its drive counts */
    double carrier_Hz; /* of demodulated streams; 0: of samples */
    double omega, step_s, block_s, noise_m2;
    double mean, curve_s2; /* a block's component over its sum; what the motion's second derivative adds to that */
    double complex table[MOST], drive_turn, leak, drive_leak;
    double complex sensed[2], driven[2], slope[2];
    double complex pushes[3][2]; /* means between the middles of blocks, newest first, m/s2 */
    int lost;
    double state[ENTRIES], p[ENTRIES][ENTRIES], imposed, innovation_V[2];
} slow_flow;

unsigned gyro_plugin_version(void)
{
    return GYRO_PLUGIN_VERSION;
}

size_t gyro_plugin_size(void)
{
    return sizeof(slow_flow);
}

int gyro_plugin_option(void *instance, const char *name, double value)
{
    if (strcmp(name, "carrier_Hz") != 0)
        return 0;
    ((slow_flow *)instance)->carrier_Hz = value;
    return 1;
}

/* The tables of a block of samples. */
static void prepare(slow_flow *own)
{
    double half = 0.5 * own->omega * own->step_s;
    for (long k = 0; k < own->samples; k++) {
        double phase = own->omega * own->step_s * (double)k;
        double from_middle = ((double)k - 0.5 * (double)(own->samples - 1)) * own->step_s;
        own->table[k] = cos(phase) + I * sin(phase);
        own->leak += from_middle * own->table[k] * own->table[k] / (double)own->samples;
    }
    own->drive_turn = cexp(-I * half) * sin(half) / half; /* a drive is held, on average half a sample ago */
    for (long k = 0; k < own->samples; k++) {
        long sample = (own->last + 1 + k) % own->samples;
        double from_middle = ((double)k - 0.5 * (double)(own->samples - 1)) * own->step_s;
        own->drive_leak += from_middle * own->table[sample] * own->table[sample] / (double)own->samples;
    }
    own->drive_leak *= cexp(-2.0 * I * half);
}

const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    slow_flow *own = instance;
    double frequency_Hz = sqrt(device->target_stiffness_per_s2) / (2.0 * HALF_TURN), rate_Hz = device->sample_rate_Hz;
    double cycles = ceil(frequency_Hz / BLOCKS_HZ), step_s = 1.0 / rate_Hz;
    if (device->sense_order != 0.0)
        return "it needs the displacement sensed, not the velocity";
    own->device = *device;
    int streams = own->carrier_Hz > 0.0;
    double rows = rint(streams ? fmax(rate_Hz / BLOCKS_HZ, 1.0) : cycles * rate_Hz / frequency_Hz);
    if (rows > MOST || (rows < 4.0 && !streams))
        return "it needs 4 to 4096 samples in a block of some cycles";
    own->samples = (long)rows;
    own->step_s = step_s;
    own->block_s = rows * step_s;
    own->omega = 2.0 * HALF_TURN * (streams ? own->carrier_Hz : cycles / own->block_s);
    own->mean = (streams ? 1.0 : 2.0) / rows;
    own->curve_s2 = (streams ? rows * rows - 1.0 : rows * rows) * step_s * step_s / 24.0;
    own->last = (own->samples - 1) / 2;
    if (!streams)
        prepare(own);
    double gain = fabs(device->sense_gain_V_per_m[0]), decay = 0.25 * (device->damping_per_s[0] + device->damping_per_s[1]);
    own->noise_m2 = own->mean * device->noise_V * device->noise_V / (gain * gain);
    for (int k = 0; k < 3; k++) {
        double square = k < 2 ? own->omega * own->omega : 0.0;
        own->state[KXX + k] = 0.5 * (device->stiffness_per_s2[k] - square) / own->omega;
        own->state[HXX + k] = 0.5 * device->damping_per_s[k];
        own->p[KXX + k][KXX + k] = pow(0.5 * STIFFNESS_SD * own->omega, 2.0);
        own->p[HXX + k][HXX + k] = decay * decay;
    }
    own->p[RATE][RATE] = RATE_SD * RATE_SD;
    return NULL;
}

/* dz/dt at z, under the force's components f; the second derivative, which the average leaves out, to first order:
   -(i/2w) (D/2 - i (K - w^2)/2w - rate J) dz/dt. */
static void flow(const slow_flow *own, const double complex z[2], const double complex f[2], double complex out[2])
{
    const double *s = own->state;
    double complex push = I / (2.0 * own->omega), cross = s[HXY] + I * s[KXY];
    out[0] = -(s[HXX] + I * s[KXX]) * z[0] - (cross - s[RATE]) * z[1] + push * f[0];
    out[1] = -(s[HYY] + I * s[KYY]) * z[1] - (cross + s[RATE]) * z[0] + push * f[1];
    double complex first = out[0], second = out[1];
    cross = s[HXY] - I * s[KXY];
    out[0] -= push * ((s[HXX] - I * s[KXX]) * first + (cross - s[RATE]) * second);
    out[1] -= push * ((s[HYY] - I * s[KYY]) * second + (cross + s[RATE]) * first);
}

/* A force that changes evenly: what it begins with, and how fast it changes. */
typedef struct {
    double complex begins[2], changes[2];
} ramp;

static const ramp no_force;

/* The motion `time_s` on, by a series in the time. */
static void carry(const slow_flow *own, const ramp *force, double time_s, double complex z[2])
{
    double complex term[2] = {z[0], z[1]}, next[2], given[2] = {force->begins[0], force->begins[1]};
    for (int order = 1; order <= 8; order++) {
        flow(own, term, given, next);
        for (int axis = 0; axis < 2; axis++) {
            term[axis] = next[axis] * time_s / (double)order;
            z[axis] += term[axis];
            given[axis] = order == 1 ? force->changes[axis] * time_s : 0.0;
        }
    }
}

/* The mean force since the middle of the last block, which a sum over whole cycles mixes with its own mirror image where
   it changes, as what it begins with and how it changes. */
static ramp force_of(const slow_flow *own)
{
    ramp force;
    double t = own->block_s, later = 0.5 * (double)(own->samples - 1) - (double)own->last;
    if (own->carrier_Hz > 0.0)
        later = 0.0; /* a row that is a middle counts half before it, half behind */
    for (int axis = 0; axis < 2; axis++) {
        double complex change = (3.0 * own->pushes[0][axis] - 4.0 * own->pushes[1][axis] + own->pushes[2][axis]) / (2.0 * t);
        double complex mean = own->pushes[0][axis] - conj(change) * own->drive_leak + change * later * own->step_s;
        force.changes[axis] = change;
        force.begins[axis] = mean - 0.5 * t * change - I / (2.0 * own->omega) * change;
    }
    return force;
}

static void put(double row[4], const double complex z[2])
{
    for (int axis = 0; axis < 2; axis++) {
        row[2 * axis] = creal(z[axis]);
        row[2 * axis + 1] = cimag(z[axis]);
    }
}

/* State and covariance from the middle of the last block to that of this one. */
static void predict(slow_flow *own, const ramp *force)
{
    double columns[ENTRIES][4] = {{0.0}}, *s = own->state, t = own->block_s;
    double complex z[2] = {s[0] + I * s[1], s[2] + I * s[3]}, middle[2] = {z[0], z[1]};
    for (int k = 0; k < 4; k++) {
        double complex unit[2] = {k == 0 ? 1.0 : k == 1 ? I : 0.0, k == 2 ? 1.0 : k == 3 ? I : 0.0};
        carry(own, &no_force, t, unit);
        put(columns[k], unit);
    }
    carry(own, force, 0.5 * t, middle);
    const double complex by[ENTRIES][2] = {[RATE] = {middle[1], -middle[0]},
                                           [KXX] = {-I * middle[0], 0.0},
                                           [KYY] = {0.0, -I * middle[1]},
                                           [KXY] = {-I * middle[1], -I * middle[0]},
                                           [HXX] = {-middle[0], 0.0},
                                           [HYY] = {0.0, -middle[1]},
                                           [HXY] = {-middle[1], -middle[0]}};
    for (int k = RATE; k < ENTRIES; k++) {
        double complex moved[2] = {t * by[k][0], t * by[k][1]};
        carry(own, &no_force, 0.5 * t, moved);
        put(columns[k], moved);
    }
    carry(own, force, t, z);
    put(s, z);
    s[ANGLE] += s[RATE] * t;

    double first[5][ENTRIES]; /* rows of the motion and the angle, times the covariance */
    for (int j = 0; j < ENTRIES; j++) {
        for (int i = 0; i < 4; i++) {
            first[i][j] = 0.0;
            for (int k = 0; k < ENTRIES; k++)
                first[i][j] += columns[k][i] * own->p[k][j];
        }
        first[ANGLE][j] = own->p[ANGLE][j] + t * own->p[RATE][j];
    }
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < ENTRIES; j++) {
            double value = first[i][j];
            if (j < 4) {
                value = 0.0;
                for (int k = 0; k < ENTRIES; k++)
                    value += first[i][k] * columns[k][j];
            } else if (j == ANGLE) {
                value += t * first[i][RATE];
            }
            own->p[i][j] = own->p[j][i] = value;
        }
    own->p[RATE][RATE] += RATE_WALK * RATE_WALK * t;
    for (int k = KXX; k < ENTRIES; k++)
        own->p[k][k] *= 1.0 + 2.0 * t / MEMORY_S;
}

/* What a block showed of one component, m. */
static void correct(slow_flow *own, int entry, double error)
{
    double gain[ENTRIES], row[ENTRIES], variance = own->p[entry][entry] + own->noise_m2;
    for (int k = 0; k < ENTRIES; k++) {
        row[k] = own->p[entry][k];
        gain[k] = row[k] / variance;
        own->state[k] += gain[k] * error;
    }
    for (int i = 0; i < ENTRIES; i++)
        for (int j = 0; j < ENTRIES; j++)
            own->p[i][j] -= gain[i] * row[j];
}

/* A whole block. */
static void take_in(slow_flow *own)
{
    double complex shown[2];
    for (int axis = 0; axis < 2; axis++)
        shown[axis] = own->sensed[axis] * own->mean / own->device.sense_gain_V_per_m[axis];
    if (own->blocks++ == 0) {
        put(own->state, shown);
        for (int k = 0; k < 4; k++)
            own->p[k][k] = own->noise_m2;
        return;
    }
    ramp force = force_of(own);
    predict(own, &force);
    double complex z[2] = {own->state[0] + I * own->state[1], own->state[2] + I * own->state[3]};
    double complex bend[2], ends[2];
    for (int axis = 0; axis < 2; axis++)
        ends[axis] = force.begins[axis] + own->block_s * force.changes[axis];
    flow(own, z, ends, own->slope);
    flow(own, own->slope, force.changes, bend);
    for (int axis = 0; axis < 2 && !own->lost; axis++) { /* a block's mean is not quite its middle */
        shown[axis] -= conj(own->slope[axis]) * own->leak + bend[axis] * own->curve_s2;
        own->innovation_V[axis] = creal(shown[axis] - z[axis]) * own->device.sense_gain_V_per_m[axis];
    }
    for (int entry = 0; entry < 4 && !own->lost; entry++) {
        double complex seen = shown[entry / 2];
        correct(own, entry, (entry % 2 ? cimag(seen) : creal(seen)) - own->state[entry]);
    }
}

/* Of the sample just taken in, whose reference has turned by `turn`. */
static void tell(const slow_flow *own, double complex turn, gyro_plugin_estimate *estimate)
{
    const double *s = own->state, w = own->omega;
    double since = ((double)own->at + 0.5 * (double)(own->samples - 1)) * own->step_s;
    for (int axis = 0; axis < 2; axis++) {
        double complex z = s[2 * axis] + I * s[2 * axis + 1] + own->slope[axis] * since;
        estimate->state[2 * axis] = creal(z * conj(turn));
        estimate->state[2 * axis + 1] = creal((own->slope[axis] - I * w * z) * conj(turn));
    }
    static const int from[6] = {KXX, KYY, KXY, HXX, HYY, HXY};
    for (int k = 0; k < 6; k++) {
        double unit = k < 3 ? 2.0 * w : 2.0, value = unit * s[from[k]] + (k < 2 ? w * w : 0.0);
        estimate->state[GYRO_PLUGIN_KXX + k] = value;
        estimate->deviation[GYRO_PLUGIN_KXX + k] = unit * sqrt(fmax(own->p[from[k]][from[k]], 0.0));
    }
    double turns = 1.0 / own->device.angular_gain;
    estimate->state[GYRO_PLUGIN_RATE] = turns * (s[RATE] - own->imposed);
    estimate->deviation[GYRO_PLUGIN_RATE] = turns * sqrt(fmax(own->p[RATE][RATE], 0.0));
    estimate->angle_rad = turns * (s[ANGLE] + s[RATE] * since);
    estimate->angle_u_rad = turns * sqrt(fmax(own->p[ANGLE][ANGLE], 0.0));
    for (int axis = 0; axis < 2; axis++) {
        estimate->innovation_V[axis] = own->innovation_V[axis];
        estimate->innovation_deviation_V[axis] = sqrt(own->p[2 * axis][2 * axis] + own->noise_m2) *
                                                 fabs(own->device.sense_gain_V_per_m[axis]);
    }
}

/* The drive up to the middle of this block. */
static void close_drive(slow_flow *own)
{
    for (int axis = 0; axis < 2; axis++) {
        own->pushes[2][axis] = own->pushes[1][axis];
        own->pushes[1][axis] = own->pushes[0][axis];
        own->pushes[0][axis] = own->driven[axis] * own->mean * (own->carrier_Hz > 0.0 ? 1.0 : own->drive_turn);
        own->driven[axis] = 0.0;
    }
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    slow_flow *own = instance;
    int streams = own->carrier_Hz > 0.0, halved = streams && own->samples % 2 == 1 && own->at == own->last;
    double complex push[2], turn = streams ? cexp(I * fmod(own->omega * own->step_s * (double)sample->number, 2.0 * HALF_TURN))
                                           : own->table[own->at];
    for (int axis = 0; axis < 2; axis++) {
        push[axis] = streams ? sample->applied_mps2[axis] - I * sample->applied_quadrature_mps2[axis]
                             : sample->applied_mps2[axis] * turn;
        if (!sample->lost)
            own->sensed[axis] += streams ? sample->sense_V[axis] - I * sample->quadrature_V[axis]
                                         : sample->sense_V[axis] * turn;
        own->driven[axis] += push[axis] * (halved ? 0.5 : 1.0);
    }
    own->lost |= sample->lost;
    if (own->at == own->last) {
        close_drive(own);
        for (int axis = 0; axis < 2 && halved; axis++)
            own->driven[axis] = 0.5 * push[axis];
    }
    if (++own->at == own->samples) {
        own->at = 0;
        take_in(own);
        memset(own->sensed, 0, sizeof own->sensed);
        own->lost = 0;
    }
    tell(own, turn, estimate);
}
