/* A multirotor as a rigid body with rotors: numbers are in model.h.
 *
 * Forward, right, down; north, east, down. With the lagged output x of each rotor, its thrust c0 + c1 x + c2 x^2, and the
 * force and moment per newton of it in WRENCH:
 *
 *     m dV/dt = m g + R (W_F F + D_F (V_b, w)),   J dw/dt = W_M F + D_M (V_b, w) - w x J w,   T dx/dt = u - x
 *
 * in steps of STEP_S by Runge and Kutta, outputs held over a step and late by DELAY_STEPS of them and
 * a share of one, DELAY_SHARE: the mean of two held outputs. There is no ground.
 */

#define MOTION 13
#define SIZE (MOTION + ROTORS)
#define SAME 1e-9

/* None where it is zero: the rotors follow at once. */
static const double LAG = LAG_S;

/* Position, velocity, quaternion (w, x, y, z; body to earth), rates, lagged outputs. */
typedef struct {
    double x[SIZE], u[INPUTS], late[DELAY_STEPS + 2][ROTORS];
    double phase_s;
    int next;
} Model;

static void turned(const double *q, double R[3][3]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0][0] = 1.0 - 2.0 * (y * y + z * z), R[0][1] = 2.0 * (x * y - w * z), R[0][2] = 2.0 * (x * z + w * y);
    R[1][0] = 2.0 * (x * y + w * z), R[1][1] = 1.0 - 2.0 * (x * x + z * z), R[1][2] = 2.0 * (y * z - w * x);
    R[2][0] = 2.0 * (x * z - w * y), R[2][1] = 2.0 * (y * z + w * x), R[2][2] = 1.0 - 2.0 * (x * x + y * y);
}

/* Force and moment in body axes, without gravity. */
static void pushed(const double *x, const double *outputs, const double *wind, double wrench[6]) {
    double R[3][3], motion[6];
    turned(x + 6, R);
    for (int i = 0; i < 3; i++) {
        motion[i] = 0.0;
        for (int j = 0; j < 3; j++) motion[i] += R[j][i] * (x[3 + j] - wind[j]);
        motion[3 + i] = x[10 + i];
    }
    for (int i = 0; i < 6; i++) {
        wrench[i] = 0.0;
        for (int j = 0; j < 6; j++) wrench[i] += AIR[i * 6 + j] * motion[j];
    }
    for (int k = 0; k < ROTORS; k++) {
        double share = LAG > 0.0 ? x[MOTION + k] : outputs[k];
        double thrust = THRUST[0] + share * (THRUST[1] + share * THRUST[2]);
        for (int i = 0; i < 6; i++) wrench[i] += WRENCH[i * ROTORS + k] * thrust;
    }
}

static void derivative(const double *x, const double *outputs, const double *wind, double *out) {
    double R[3][3], wrench[6], spin[3], moment[3];
    const double *q = x + 6, *rate = x + 10;
    turned(q, R);
    pushed(x, outputs, wind, wrench);
    for (int i = 0; i < 3; i++) {
        out[i] = x[3 + i];
        out[3 + i] = i == 2 ? GRAVITY : 0.0;
        for (int j = 0; j < 3; j++) out[3 + i] += R[i][j] * wrench[j] / MASS;
        spin[i] = 0.0;
        for (int j = 0; j < 3; j++) spin[i] += INERTIA[i * 3 + j] * rate[j];
    }
    out[6] = 0.5 * (-q[1] * rate[0] - q[2] * rate[1] - q[3] * rate[2]);
    out[7] = 0.5 * (q[0] * rate[0] + q[2] * rate[2] - q[3] * rate[1]);
    out[8] = 0.5 * (q[0] * rate[1] - q[1] * rate[2] + q[3] * rate[0]);
    out[9] = 0.5 * (q[0] * rate[2] + q[1] * rate[1] - q[2] * rate[0]);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        moment[i] = wrench[3 + i] - (rate[j] * spin[k] - rate[k] * spin[j]);
    }
    for (int i = 0; i < 3; i++) {
        out[10 + i] = 0.0;
        for (int j = 0; j < 3; j++) out[10 + i] += INVERSE_INERTIA[i * 3 + j] * moment[j];
    }
    for (int k = 0; k < ROTORS; k++) out[MOTION + k] = LAG > 0.0 ? (outputs[k] - x[MOTION + k]) / LAG : 0.0;
}

static void advance(Model *model) {
    double slopes[4][SIZE], middle[SIZE], outputs[ROTORS], norm = 0.0;
    const double *older = model->late[model->next], *newer = model->late[(model->next + 1) % (DELAY_STEPS + 2)];
    const double *wind = model->u + ROTORS;
    for (int k = 0; k < ROTORS; k++) {
        double asked = model->u[k] < 0.0 ? 0.0 : model->u[k] > 1.0 ? 1.0 : model->u[k];
        model->late[(model->next + DELAY_STEPS + 1) % (DELAY_STEPS + 2)][k] = asked;
    }
    for (int k = 0; k < ROTORS; k++) outputs[k] = newer[k] + DELAY_SHARE * (older[k] - newer[k]);
    memcpy(middle, model->x, sizeof(middle));
    for (int stage = 0; stage < 4; stage++) {
        double ahead = stage == 2 ? STEP_S : 0.5 * STEP_S;
        derivative(middle, outputs, wind, slopes[stage]);
        for (int i = 0; i < SIZE; i++) middle[i] = model->x[i] + ahead * slopes[stage][i];
    }
    for (int i = 0; i < SIZE; i++)
        model->x[i] += STEP_S / 6.0 * (slopes[0][i] + 2.0 * (slopes[1][i] + slopes[2][i]) + slopes[3][i]);
    for (int i = 6; i < 10; i++) norm += model->x[i] * model->x[i];
    for (int i = 6; i < 10; i++) model->x[i] /= sqrt(norm);
    for (int k = 0; k < ROTORS && !(LAG > 0.0); k++) model->x[MOTION + k] = outputs[k];
    model->next = (model->next + 1) % (DELAY_STEPS + 2);
}

static void start(Model *model) {
    memset(model, 0, sizeof(Model));
    model->x[6] = 1.0;
    for (int k = 0; k < ROTORS; k++) {
        model->x[MOTION + k] = model->u[k] = HOVER[k];
        for (int i = 0; i <= DELAY_STEPS + 1; i++) model->late[i][k] = HOVER[k];
    }
}

/* Position, velocity over ground in earth and in body axes, rates, Euler angles, specific force. */
static double output(const Model *model, int row) {
    const double *x = model->x, *wind = model->u + ROTORS;
    double R[3][3], wrench[6];
    int i = row % 3;
    turned(x + 6, R);
    switch (row / 3) {
    case 0:
    case 1:
        return x[row];
    case 2:
        return R[0][i] * x[3] + R[1][i] * x[4] + R[2][i] * x[5];
    case 3:
        return x[10 + i];
    case 4:
        return i == 0 ? atan2(R[2][1], R[2][2]) : i == 1 ? -asin(fmax(-1.0, fmin(1.0, R[2][0]))) : atan2(R[1][0], R[0][0]);
    default:
        pushed(x, x + MOTION, wind, wrench);
        return wrench[i] / MASS;
    }
}

static int step(Model *model, double step_s) {
    while (step_s > SAME * STEP_S) {
        double part_s = STEP_S - model->phase_s < step_s ? STEP_S - model->phase_s : step_s;
        model->phase_s += part_s;
        step_s -= part_s;
        if (model->phase_s >= STEP_S * (1.0 - SAME)) {
            advance(model);
            model->phase_s = 0.0;
        }
    }
    return OK;
}
