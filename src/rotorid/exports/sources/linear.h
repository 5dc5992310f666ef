/* A linear model: numbers are in model.h.
 *
 * Inputs are held over a step. A continuous model (STEP_S of 0) is integrated exactly for them, for steps of any length,
 * by the exponential of its matrices; a sampled one moves on once every STEP_S.
 */

#define SIZE (STATES + INPUTS)
#define TERMS 18
#define SAME 1e-9

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

static void start(Model *model) { memset(model, 0, sizeof(Model)); }

static int step(Model *model, double step_s) {
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
