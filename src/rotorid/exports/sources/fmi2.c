/* The functions of FMI 2.0 for co-simulation, around a model.
 *
 * model.h holds its numbers, dynamics.h its equations: the type Model with its inputs u, and the functions start, output
 * and step. Nothing but the standard library is needed.
 */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Tools that link sources into one program want the name of the model before every function. */
#if defined(FMI2_FUNCTION_PREFIX)
#define JOINED(a, b) a##b
#define EXPANDED(a, b) JOINED(a, b)
#define NAMED(name) EXPANDED(FMI2_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif

#define ROOM(count) ((count) > 0 ? (count) : 1)

enum { OK = 0, ERROR = 3 };

#include "dynamics.h"

EXPORTED const char *NAMED(fmi2GetTypesPlatform)(void) { return "default"; }

EXPORTED const char *NAMED(fmi2GetVersion)(void) { return "2.0"; }

EXPORTED void *NAMED(fmi2Instantiate)(const char *name, int type, const char *guid, const char *resources,
                                      const void *callbacks, int visible, int logging) {
    (void)name, (void)resources, (void)callbacks, (void)visible, (void)logging;
    /* 1 is co-simulation. */
    if (type != 1 || guid == NULL || strcmp(guid, GUID) != 0) return NULL;
    Model *model = malloc(sizeof(Model));
    if (model != NULL) start(model);
    return model;
}

EXPORTED void NAMED(fmi2FreeInstance)(void *c) { free(c); }

EXPORTED int NAMED(fmi2Reset)(void *c) {
    start(c);
    return OK;
}

EXPORTED int NAMED(fmi2SetupExperiment)(void *c, int bounded, double tolerance, double from, int ends, double to) {
    (void)c, (void)bounded, (void)tolerance, (void)from, (void)ends, (void)to;
    return OK;
}

EXPORTED int NAMED(fmi2EnterInitializationMode)(void *c) { return c == NULL ? ERROR : OK; }

EXPORTED int NAMED(fmi2ExitInitializationMode)(void *c) { return c == NULL ? ERROR : OK; }

EXPORTED int NAMED(fmi2Terminate)(void *c) { return c == NULL ? ERROR : OK; }

EXPORTED int NAMED(fmi2SetDebugLogging)(void *c, int on, size_t count, const char *const *categories) {
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

/* Inputs are the first variables, outputs the next. */

EXPORTED int NAMED(fmi2SetReal)(void *c, const unsigned *which, size_t count, const double *values) {
    Model *model = c;
    for (size_t i = 0; i < count; i++) {
        if (which[i] >= INPUTS) return ERROR;
        model->u[which[i]] = values[i];
    }
    return OK;
}

EXPORTED int NAMED(fmi2GetReal)(void *c, const unsigned *which, size_t count, double *values) {
    const Model *model = c;
    for (size_t i = 0; i < count; i++) {
        if (which[i] >= INPUTS + OUTPUTS) return ERROR;
        values[i] = which[i] < INPUTS ? model->u[which[i]] : output(model, (int)which[i] - INPUTS);
    }
    return OK;
}

EXPORTED int NAMED(fmi2DoStep)(void *c, double now, double step_s, int final) {
    Model *model = c;
    (void)now, (void)final;
    if (!(step_s >= 0.0)) return ERROR;
    return step(model, step_s);
}

EXPORTED int NAMED(fmi2GetFMUstate)(void *c, void **state) {
    if (*state == NULL) *state = malloc(sizeof(Model));
    if (*state == NULL) return ERROR;
    memcpy(*state, c, sizeof(Model));
    return OK;
}

EXPORTED int NAMED(fmi2SetFMUstate)(void *c, void *state) {
    memcpy(c, state, sizeof(Model));
    return OK;
}

EXPORTED int NAMED(fmi2FreeFMUstate)(void *c, void **state) {
    (void)c;
    free(*state);
    *state = NULL;
    return OK;
}

/* What this model has not: it answers so. */

#define NONE(name, ...)                      \
    EXPORTED int NAMED(name)(__VA_ARGS__) {  \
        return ERROR;                        \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

NONE(fmi2GetInteger, void *c, const unsigned *which, size_t count, int *values)
NONE(fmi2GetBoolean, void *c, const unsigned *which, size_t count, int *values)
NONE(fmi2GetString, void *c, const unsigned *which, size_t count, const char **values)
NONE(fmi2SetInteger, void *c, const unsigned *which, size_t count, const int *values)
NONE(fmi2SetBoolean, void *c, const unsigned *which, size_t count, const int *values)
NONE(fmi2SetString, void *c, const unsigned *which, size_t count, const char *const *values)
NONE(fmi2SerializedFMUstateSize, void *c, void *state, size_t *size)
NONE(fmi2SerializeFMUstate, void *c, void *state, char *bytes, size_t size)
NONE(fmi2DeSerializeFMUstate, void *c, const char *bytes, size_t size, void **state)
NONE(fmi2GetDirectionalDerivative, void *c, const unsigned *of, size_t ofs, const unsigned *by, size_t bys,
     const double *along, double *derivative)
NONE(fmi2SetRealInputDerivatives, void *c, const unsigned *which, size_t count, const int *order, const double *values)
NONE(fmi2GetRealOutputDerivatives, void *c, const unsigned *which, size_t count, const int *order, double *values)
NONE(fmi2CancelStep, void *c)
NONE(fmi2GetStatus, void *c, int kind, int *value)
NONE(fmi2GetRealStatus, void *c, int kind, double *value)
NONE(fmi2GetIntegerStatus, void *c, int kind, int *value)
NONE(fmi2GetBooleanStatus, void *c, int kind, int *value)
NONE(fmi2GetStringStatus, void *c, int kind, const char **value)
