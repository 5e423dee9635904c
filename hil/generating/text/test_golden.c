/* What was generated, held against what the bench computed: prints its figures; exit code 0 where they agree.
 *
 * Runs on a host, and on a target whose library has printf. GOLDEN_COUNTER, a function of yours that returns a counter
 * of instructions or cycles as uint32_t, has it print what a step takes.
 */
#include <math.h>
#include <stdio.h>

#include "golden.h"
#include "gyro_estimator.h"

#if GYRO_ESTIMATOR_VERSION != GOLDEN_VERSION
#error "golden.h is of another version than gyro_estimator.h: generate both again"
#endif

#ifdef GOLDEN_COUNTER
uint32_t GOLDEN_COUNTER(void);
#endif

static gyro_estimator estimator;
static long different, most;
static double codes; /* by which the drive differs in all */

static void step(int m)
{
    int32_t drive[2];
    estimator_step_codes(&estimator, golden_sense[m], golden_applied[m], m >= GOLDEN_QUIET, drive);
    for (int i = 0; i < 2; i++) {
        double apart = fabs((double)drive[i] - golden_drive[m][i]);
        if (m == GOLDEN_SAMPLES) /* far outside the range: the limit, of whichever sign */
            apart = fabs(fabs((double)drive[i]) - fabs((double)golden_drive[m][i]));
        most = apart > (double)most ? (long)apart : most;
        different += apart > 0.0;
        codes += apart;
    }
}

int main(void)
{
    gyro_estimate found;
    double angle = 0.0, begun_at = 0.0, state = 0.0;
    if (gyro_estimator_version() != GYRO_ESTIMATOR_VERSION || gyro_estimator_size() != sizeof estimator) {
        printf("FAIL: the library is of another version than gyro_estimator.h\n");
        return 1;
    }
    gyro_estimator_init(&estimator);
#ifdef GOLDEN_COUNTER
    uint32_t begun = GOLDEN_COUNTER();
#endif
    for (int m = 0; m < GOLDEN_SAMPLES; m++) {
        step(m);
        if (m <= GOLDEN_SETTLED)
            begun_at = estimator.row.angle - golden_angle[m];
        double off = fabs(estimator.row.angle - golden_angle[m] - begun_at);
        angle = off > angle || off != off ? off : angle;
    }
#ifdef GOLDEN_COUNTER
    printf("counted per step: %lu\n", (unsigned long)((GOLDEN_COUNTER() - begun) / GOLDEN_SAMPLES));
#endif
    gyro_estimator_read(&estimator, &found);
    for (int i = 0; i < GYRO_STATES; i++)
        if (golden_deviation[i] > 0.0) {
            double off = fabs((double)found.state[i] - golden_state[i]) / golden_deviation[i];
            state = off > state || off != off ? off : state;
        }
    step(GOLDEN_SAMPLES);
    printf("samples: %d\ndrive codes that differ: %ld, by %ld at most, by %.0f in all; %d allowed\n", GOLDEN_SAMPLES, different, most, codes, GOLDEN_CODES);
    printf("angle since sample %d: %.3g rad apart at most\nstate: %.3g of a deviation apart at most\n", GOLDEN_SETTLED, angle, state);
    printf("bytes of the struct: %lu\n", (unsigned long)sizeof estimator);
    int good = codes <= GOLDEN_CODES && angle <= GOLDEN_ANGLE_RAD && state <= GOLDEN_STATE;
    printf("%s\n", good ? "PASS" : "FAIL");
    return !good;
}
