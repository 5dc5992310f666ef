/* A linear model as an FMU for co-simulation, FMI 2.0.
 *
 * model.h holds the numbers. Inputs are held over a step. A continuous model (STEP_S of 0) is integrated exactly for
 * them, for steps of any length, by the exponential of its matrices; a sampled one moves on once every STEP_S.
 * Nothing but the standard library is needed.
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

#define SIZE (STATES + INPUTS)
#define ROOM(count) ((count) > 0 ? (count) : 1)
#define TERMS 18
#define SAME 1e-9

enum { OK = 0, ERROR = 3 };

typedef struct {
    double x[ROOM(STATES)], u[ROOM(INPUTS)], held[ROOM(INPUTS)];
    double phase_s, step_s;
    double phi[ROOM(STATES * STATES)], gamma[ROOM(STATES * INPUTS)];
} Model;

static void multiply(const double *left, const double *right, double *product) {
    for (int i = 0; i < SIZE; i++)
        for (int j = 0; j < SIZE; j++) {
            double sum = 0.0;
            for (int k = 0; k < SIZE; k++) sum += left[i * SIZE + k] * right[k * SIZE + j];
            product[i * SIZE + j] = sum;
        }
}

/* exp([A B; 0 0] h) holds the transition of the states and that by held inputs: scaled, a series, squared again. */
static int discretize(Model *model, double step_s) {
    size_t count = ROOM(SIZE * SIZE);
    double *all = calloc(4 * count, sizeof(double));
    if (all == NULL) return ERROR;
    double *scaled = all, *sum = all + count, *term = all + 2 * count, *next = all + 3 * count;
    double largest = 0.0;
    for (int i = 0; i < STATES; i++) {
        double row = 0.0;
        for (int j = 0; j < STATES; j++) scaled[i * SIZE + j] = A[i * STATES + j] * step_s;
        for (int j = 0; j < INPUTS; j++) scaled[i * SIZE + STATES + j] = B[i * INPUTS + j] * step_s;
        for (int j = 0; j < SIZE; j++) row += fabs(scaled[i * SIZE + j]);
        if (row > largest) largest = row;
    }
    int squarings = 0;
    while (largest > 0.5 && squarings < 100) {
        largest *= 0.5;
        squarings++;
    }
    for (size_t i = 0; i < count; i++) scaled[i] = ldexp(scaled[i], -squarings);
    for (int i = 0; i < SIZE; i++) sum[i * SIZE + i] = term[i * SIZE + i] = 1.0;
    for (int order = 1; order <= TERMS; order++) {
        multiply(term, scaled, next);
        for (size_t i = 0; i < count; i++) {
            term[i] = next[i] / order;
            sum[i] += term[i];
        }
    }
    for (int i = 0; i < squarings; i++) {
        multiply(sum, sum, next);
        memcpy(sum, next, count * sizeof(double));
    }
    for (int i = 0; i < STATES; i++) {
        for (int j = 0; j < STATES; j++) model->phi[i * STATES + j] = sum[i * SIZE + j];
        for (int j = 0; j < INPUTS; j++) model->gamma[i * INPUTS + j] = sum[i * SIZE + STATES + j];
    }
    model->step_s = step_s;
    free(all);
    return OK;
}

static void advance(Model *model, const double *phi, const double *gamma, const double *u) {
    double x[ROOM(STATES)];
    for (int i = 0; i < STATES; i++) {
        x[i] = 0.0;
        for (int j = 0; j < STATES; j++) x[i] += phi[i * STATES + j] * model->x[j];
        for (int j = 0; j < INPUTS; j++) x[i] += gamma[i * INPUTS + j] * u[j];
    }
    if (STATES > 0) memcpy(model->x, x, sizeof(x));
}

static double output(const Model *model, int row) {
    double y = 0.0;
    for (int j = 0; j < STATES; j++) y += C[row * STATES + j] * model->x[j];
    for (int j = 0; j < INPUTS; j++) y += D[row * INPUTS + j] * model->u[j];
    return y;
}

EXPORTED const char *NAMED(fmi2GetTypesPlatform)(void) { return "default"; }

EXPORTED const char *NAMED(fmi2GetVersion)(void) { return "2.0"; }

EXPORTED void *NAMED(fmi2Instantiate)(const char *name, int type, const char *guid, const char *resources,
                                      const void *callbacks, int visible, int logging) {
    (void)name, (void)resources, (void)callbacks, (void)visible, (void)logging;
    /* 1 is co-simulation. */
    if (type != 1 || guid == NULL || strcmp(guid, GUID) != 0) return NULL;
    return calloc(1, sizeof(Model));
}

EXPORTED void NAMED(fmi2FreeInstance)(void *c) { free(c); }

EXPORTED int NAMED(fmi2Reset)(void *c) {
    memset(c, 0, sizeof(Model));
    return OK;
}

EXPORTED int NAMED(fmi2SetupExperiment)(void *c, int toleranced, double tolerance, double start, int stops, double stop) {
    (void)c, (void)toleranced, (void)tolerance, (void)start, (void)stops, (void)stop;
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
    if (STEP_S == 0.0) {
        if (step_s != model->step_s && discretize(model, step_s) != OK) return ERROR;
        if (step_s > 0.0) advance(model, model->phi, model->gamma, model->u);
        return OK;
    }
    while (step_s > SAME * STEP_S) {
        if (model->phase_s == 0.0) memcpy(model->held, model->u, sizeof(model->u));
        double part_s = STEP_S - model->phase_s < step_s ? STEP_S - model->phase_s : step_s;
        model->phase_s += part_s;
        step_s -= part_s;
        if (model->phase_s >= STEP_S * (1.0 - SAME)) {
            advance(model, A, B, model->held);
            model->phase_s = 0.0;
        }
    }
    return OK;
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
