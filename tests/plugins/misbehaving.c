/* A plug-in that is quiet for 700 samples, and then does what it was compiled to do: WRONG. */

#define _GNU_SOURCE

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#ifndef VERSION_GIVEN
#define VERSION_GIVEN GYRO_PLUGIN_VERSION
#endif

#include "gyro_plugin.h"

#ifndef AFTER
#define AFTER 700
#endif

typedef struct {
    int64_t count;
    gyro_plugin_device device;
} plugin;

enum { NAN_STATE = 1, NAN_DRIVE, INFINITE_ANGLE, BEYOND, BLOCKS, SLEEPS, CRASHES, ABORTS, DIVIDES, EXITS, EXITS_AT_ONCE,
       ALLOCATES, NEGATIVE_DEVIATION, NAN_CONSTANT, WRITES_BEHIND, WRITES_BEFORE, WRITES_BEHIND_ESTIMATE, RECURSES, KILLS };

unsigned gyro_plugin_version(void)
{
    return VERSION_GIVEN;
}

size_t gyro_plugin_size(void)
{
    return sizeof(plugin);
}

#ifndef WITHOUT_INIT
const char *gyro_plugin_init(void *instance, const gyro_plugin_device *device)
{
    ((plugin *)instance)->device = *device;
    return WRONG == -1 ? "it takes no device" : NULL;
}
#endif

static volatile int zero = 0;

static int recurse(volatile char *deeper)
{
    volatile char here[4096];
    here[0] = deeper[0];
    return recurse(here) + here[1];
}

static void misbehave(plugin *own)
{
    volatile unsigned char *bytes = (volatile unsigned char *)own;
    switch (WRONG) {
    case BLOCKS:
        for (;;)
            zero++;
    case SLEEPS:
        usleep(720000);
        break;
    case CRASHES:
        *(volatile int *)(size_t)(16 + zero) = 1;
        break;
    case ABORTS:
        abort();
    case DIVIDES:
        raise(SIGFPE);
        break;
    case EXITS:
        exit(0);
    case EXITS_AT_ONCE:
        _exit(0);
    case ALLOCATES:
        for (;;) {
            char *taken = malloc(1u << 24);
            memset(taken, 1, 1u << 24);
        }
    case WRITES_BEHIND:
        for (size_t i = 0; i < 65536; i++)
            bytes[sizeof *own + i] = 1;
        break;
    case WRITES_BEFORE:
        bytes[-8] = 1;
        break;
    case RECURSES:
        recurse((volatile char *)bytes);
        break;
    case KILLS:
        kill(getpid(), SIGKILL);
        break;
    default:
        break;
    }
}

void gyro_plugin_observe(void *instance, const gyro_plugin_sample *sample, gyro_plugin_estimate *estimate)
{
    plugin *own = instance;
    (void)sample;
    for (int i = 0; i <= GYRO_PLUGIN_RATE; i++)
        estimate->state[i] = i == 0 ? 1e-6 : 0.0;
    estimate->angle_rad = estimate->innovation_V[0] = estimate->innovation_V[1] = 0.0;
    estimate->state[GYRO_PLUGIN_X] += 1e-9 * (double)(own->count % 2);
    if (WRONG == NAN_CONSTANT)
        estimate->state[GYRO_PLUGIN_KXY] = own->count < AFTER ? 0.0 : (double)NAN;
    if (own->count++ < AFTER)
        return;
    misbehave(own);
    if (WRONG == NAN_STATE)
        estimate->state[GYRO_PLUGIN_VX] = (double)NAN;
    if (WRONG == NEGATIVE_DEVIATION)
        estimate->deviation[GYRO_PLUGIN_RATE] = -1e-3;
    if (WRONG == INFINITE_ANGLE)
        estimate->angle_rad = (double)INFINITY;
    if (WRONG == WRITES_BEHIND_ESTIMATE)
        ((volatile unsigned char *)estimate)[sizeof *estimate + 4] = 1;
}

void gyro_plugin_control(void *instance, const gyro_plugin_estimate *estimate, int drive_on, gyro_plugin_drive *drive)
{
    plugin *own = instance;
    (void)estimate;
    (void)drive_on;
    if (own->count <= AFTER)
        return;
    if (WRONG == NAN_DRIVE)
        drive->force_mps2[0] = (double)NAN;
    if (WRONG == BEYOND)
        drive->force_mps2[1] = 1.001 * own->device.drive_limit_mps2;
}
