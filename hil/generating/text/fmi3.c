/* The estimator as a co-simulation unit of FMI 3.0.1 (fmi-standard.org), one sample a step.
 *
 * At time t it takes the voltages sampled at t and the drive held until t; after the step it puts out the drive to hold
 * from t + GYRO_LATENCY samples on, and its estimates. What no estimator has, directional derivatives for instance,
 * answers with an error.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "gyro_estimator.h"

#define TOKEN "@TOKEN@"
#define STEPS_APART 1e-6 /* of a sample: how exact a step has to be */

#if defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

typedef void *fmi3Instance;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessage)(void *environment, fmi3Status status, fmi3String category, fmi3String message);

/* Value references, as in modelDescription.xml. */
enum { TIME, SENSE_X, SENSE_Y, APPLIED_X, APPLIED_Y, DRIVE_ON, DRIVE_X, DRIVE_Y, ANGLE, ANGLE_DEVIATION, VALID, STATE };
#define DEVIATION (STATE + GYRO_STATES)
#define VARIABLES (DEVIATION + GYRO_STATES)

typedef struct {
    gyro_estimator estimator;
    double value[VARIABLES]; /* by reference; Booleans as 0 and 1 */
    fmi3LogMessage log;
    void *environment;
} Unit;

static fmi3Status refuse(const Unit *unit, const char *message)
{
    if (unit != NULL && unit->log != NULL)
        unit->log(unit->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static void show(Unit *unit)
{
    gyro_estimate found;
    gyro_estimator_read(&unit->estimator, &found);
    unit->value[ANGLE] = found.angle_rad;
    unit->value[ANGLE_DEVIATION] = (double)found.angle_deviation_rad;
    unit->value[VALID] = found.valid ? 1.0 : 0.0;
    for (int i = 0; i < GYRO_STATES; i++) {
        unit->value[STATE + i] = (double)found.state[i];
        unit->value[DEVIATION + i] = (double)found.deviation[i];
    }
}

static void begin(Unit *unit)
{
    gyro_estimator_init(&unit->estimator);
    memset(unit->value, 0, sizeof unit->value);
    show(unit);
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, bool visible,
                                                bool logging, bool events, bool early,
                                                const fmi3ValueReference *required, size_t required_count,
                                                void *environment, fmi3LogMessage log, void *intermediate)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required;
    (void)required_count, (void)intermediate;
    if (token == NULL || strcmp(token, TOKEN) != 0) {
        if (log != NULL)
            log(environment, fmi3Error, "logStatusError", "modelDescription.xml is of another unit: generate it again");
        return NULL;
    }
    Unit *unit = malloc(sizeof *unit);
    if (unit != NULL) {
        unit->log = log;
        unit->environment = environment;
        begin(unit);
    }
    return unit;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    begin(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, bool with_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, bool with_stop, fmi3Float64 stop)
{
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    ((Unit *)instance)->value[TIME] = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 at, fmi3Float64 step, bool no_way_back, bool *event,
                             bool *end, bool *early, fmi3Float64 *last)
{
    Unit *unit = instance;
    double *value = unit->value;
    (void)no_way_back;
    *event = *end = *early = false;
    *last = at;
    if (!(fabs(step * GYRO_SAMPLE_RATE_HZ - 1.0) <= STEPS_APART))
        return refuse(unit, "a step is one sample of 1/@SAMPLE_RATE@ s, no more and no less");
    const gyro_real sense[2] = {(gyro_real)value[SENSE_X], (gyro_real)value[SENSE_Y]};
    const gyro_real applied[2] = {(gyro_real)value[APPLIED_X], (gyro_real)value[APPLIED_Y]};
    gyro_real drive[2];
    estimator_step(&unit->estimator, sense, applied, value[DRIVE_ON] > 0.5, drive, &value[ANGLE]);
    value[DRIVE_X] = (double)drive[0];
    value[DRIVE_Y] = (double)drive[1];
    value[TIME] = *last = at + step;
    show(unit);
    return fmi3OK;
}

static bool is_boolean(fmi3ValueReference reference)
{
    return reference == DRIVE_ON || reference == VALID;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference *references, size_t count,
                                 fmi3Float64 *values, size_t value_count)
{
    const Unit *unit = instance;
    for (size_t i = 0; i < count; i++) {
        if (i >= value_count || references[i] >= VARIABLES || is_boolean(references[i]))
            return refuse(unit, "no such variable of type Float64");
        values[i] = unit->value[references[i]];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference *references, size_t count,
                                 const fmi3Float64 *values, size_t value_count)
{
    Unit *unit = instance;
    for (size_t i = 0; i < count; i++) {
        if (i >= value_count || references[i] < SENSE_X || references[i] > APPLIED_Y)
            return refuse(unit, "no such input of type Float64");
        unit->value[references[i]] = values[i];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference *references, size_t count, bool *values,
                                 size_t value_count)
{
    const Unit *unit = instance;
    for (size_t i = 0; i < count; i++) {
        if (i >= value_count || !is_boolean(references[i]))
            return refuse(unit, "no such variable of type Boolean");
        values[i] = unit->value[references[i]] > 0.5;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference *references, size_t count,
                                 const bool *values, size_t value_count)
{
    Unit *unit = instance;
    for (size_t i = 0; i < count; i++) {
        if (i >= value_count || references[i] != DRIVE_ON)
            return refuse(unit, "no such input of type Boolean");
        unit->value[DRIVE_ON] = values[i] ? 1.0 : 0.0;
    }
    return fmi3OK;
}

/* The whole state is one struct without pointers but to the environment, which stays the instance's own. */
EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, void **state)
{
    if (*state == NULL)
        *state = malloc(sizeof(Unit));
    if (*state == NULL)
        return refuse(instance, "no memory");
    memcpy(*state, instance, sizeof(Unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, void *state)
{
    Unit *unit = instance, *saved = state;
    unit->estimator = saved->estimator;
    memcpy(unit->value, saved->value, sizeof unit->value);
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, void **state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

/* What a unit of one sample a step has nothing to do for, and what it does not have. */
#define NOTHING_TO_DO(name, ...) \
    EXPORT fmi3Status name(__VA_ARGS__) \
    { \
        return fmi3OK; \
    }
#define ABSENT(name) \
    EXPORT fmi3Status name(fmi3Instance instance) \
    { \
        return refuse(instance, #name ": this unit has no such thing"); \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOTHING_TO_DO(fmi3SetDebugLogging, fmi3Instance instance, bool on, size_t count, const fmi3String categories[])
NOTHING_TO_DO(fmi3ExitInitializationMode, fmi3Instance instance)
NOTHING_TO_DO(fmi3EnterStepMode, fmi3Instance instance)
NOTHING_TO_DO(fmi3Terminate, fmi3Instance instance)
NOTHING_TO_DO(fmi3EnterConfigurationMode, fmi3Instance instance)
NOTHING_TO_DO(fmi3ExitConfigurationMode, fmi3Instance instance)

EXPORT fmi3Instance fmi3InstantiateModelExchange(void)
{
    return NULL;
}
EXPORT fmi3Instance fmi3InstantiateScheduledExecution(void)
{
    return NULL;
}
ABSENT(fmi3EnterEventMode)
ABSENT(fmi3UpdateDiscreteStates)
ABSENT(fmi3GetFloat32)
ABSENT(fmi3GetInt8)
ABSENT(fmi3GetUInt8)
ABSENT(fmi3GetInt16)
ABSENT(fmi3GetUInt16)
ABSENT(fmi3GetInt32)
ABSENT(fmi3GetUInt32)
ABSENT(fmi3GetInt64)
ABSENT(fmi3GetUInt64)
ABSENT(fmi3GetString)
ABSENT(fmi3GetBinary)
ABSENT(fmi3GetClock)
ABSENT(fmi3SetFloat32)
ABSENT(fmi3SetInt8)
ABSENT(fmi3SetUInt8)
ABSENT(fmi3SetInt16)
ABSENT(fmi3SetUInt16)
ABSENT(fmi3SetInt32)
ABSENT(fmi3SetUInt32)
ABSENT(fmi3SetInt64)
ABSENT(fmi3SetUInt64)
ABSENT(fmi3SetString)
ABSENT(fmi3SetBinary)
ABSENT(fmi3SetClock)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3SerializedFMUStateSize)
ABSENT(fmi3SerializeFMUState)
ABSENT(fmi3DeserializeFMUState)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction)
ABSENT(fmi3GetShiftDecimal)
ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3SetIntervalDecimal)
ABSENT(fmi3SetIntervalFraction)
ABSENT(fmi3SetShiftDecimal)
ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3CompletedIntegratorStep)
ABSENT(fmi3SetTime)
ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfContinuousStates)
