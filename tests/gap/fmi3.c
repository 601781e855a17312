/* An FMU of FMI 3.0 for co-simulation: torque = 0.0292 i - 9e-6 v - 1e-4 x + 1e-3 t. Variables 0, 1, 2, 3: x, v, i, torque. */
#include <stdlib.h>
#include "fmi3Functions.h"

typedef struct {
    double now, input[3];
} Axis;

#define fmi3Get(type) \
    fmi3Status fmi3Get##type(fmi3Instance one, const fmi3ValueReference at[], size_t n, fmi3##type value[], size_t m) { \
        Axis *axis = one; \
        (void)m; \
        for (size_t k = 0; k < n; k++) { \
            if (at[k] != 3 || KIND_OF_TORQUE != kind##type) return fmi3Error; \
            value[k] = (fmi3##type)(0.0292 * axis->input[2] - 9e-6 * axis->input[1] - 1e-4 * axis->input[0] \
                                    + 1e-3 * axis->now); \
        } \
        return fmi3OK; \
    }
#define fmi3Set(type) \
    fmi3Status fmi3Set##type(fmi3Instance one, const fmi3ValueReference at[], size_t n, const fmi3##type value[], size_t m) { \
        (void)m; \
        for (size_t k = 0; k < n; k++) { \
            if (at[k] > 2 || KIND_OF_INPUT != kind##type) return fmi3Error; \
            ((Axis *)one)->input[at[k]] = value[k]; \
        } \
        return fmi3OK; \
    }
enum { kindFloat32, kindFloat64 };

fmi3Get(Float32) fmi3Get(Float64) fmi3Set(Float32) fmi3Set(Float64)

const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
    fmi3Boolean early, const fmi3ValueReference wanted[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)wanted;
    (void)n, (void)environment, (void)log, (void)update;
    return calloc(1, sizeof(Axis));
}
void fmi3FreeInstance(fmi3Instance one) { free(one); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance one, fmi3Boolean has, double tolerance, double start, fmi3Boolean end,
                                       double stop) {
    (void)has, (void)tolerance, (void)end, (void)stop;
    ((Axis *)one)->now = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance one) { (void)one; return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance one) { (void)one; return fmi3OK; }
fmi3Status fmi3DoStep(fmi3Instance one, double now, double step, fmi3Boolean never_back, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, double *last) {
    (void)never_back;
    ((Axis *)one)->now = *last = now + step;
    *event = *terminate = *early = 0;
    return fmi3OK;
}
