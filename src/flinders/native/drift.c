/* Whether the offset crept, or the field grew, while a recording was made: thirteen parameters by least squares.
 *
 * Residuals s = J δθ + t (n · ḃ + n · S u ġ) for −½ ≤ t ≤ ½ over the recording, compared with the scatter that the rest, as
 * it is correlated, gives ḃ and ġ by chance. What only noise tells apart is left out: flinders.diagnostics.systematic.
 */
#include "residuals.h"

enum { PARAMETERS = 13, MIN_INDEPENDENT = 20, CHANGES = 4 };

#define MIN_OBSERVED_SHARE ((real)0.1) /* smallest part of a change in the observed directions at which the change is known */

/* Context for the spurious information. */
typedef struct {
    const fl_surface *surface;
    const fl_residuals *residuals;
} scattered;

/* Behind nine derivatives those by a change of the offset, along x, y and z, and by one of the field's strength. */
static void with_change(const fl_surface *surface, real time, real row[PARAMETERS])
{
    real growth = 0;
    for (int i = 0; i < 6; i++) growth += row[3 + i] * surface->shape[i];
    for (int axis = 0; axis < 3; axis++) row[9 + axis] = time * row[axis];
    row[12] = time * growth;
}

/* Time of the i-th of the readings, from -½ to ½. */
static real time_of(const fl_residuals *residuals, size_t i)
{
    return residuals->n > 1 ? (real)i / (real)(residuals->n - 1) - (real)0.5 : 0;
}

/* Spurious information for a noise variance of 1, from some of the readings. */
static void spurious(void *context, size_t most, real *matrix)
{
    const scattered *from = context;
    const fl_residuals *residuals = from->residuals;
    const size_t every = residuals->n / most > 1 ? residuals->n / most : 1;
    const real share = (real)residuals->n / (real)((residuals->n + every - 1) / every);
    real turned[2][9], row[PARAMETERS];
    memset(matrix, 0, PARAMETERS * PARAMETERS * sizeof(real));
    for (size_t i = 0; i < residuals->n; i += every) {
        real direction[3];
        for (int axis = 0; axis < 3; axis++) direction[axis] = residuals->directions[axis * FL_LOOKED + i];
        fl_turning(from->surface, direction, turned);
        for (int t = 0; t < 2; t++) {
            memcpy(row, turned[t], sizeof turned[t]);
            with_change(from->surface, time_of(residuals, i), row);
            for (int a = 0; a < PARAMETERS; a++)
                for (int b = 0; b <= a; b++) matrix[PARAMETERS * a + b] += row[a] * row[b];
        }
    }
    for (int a = 0; a < PARAMETERS; a++)
        for (int b = 0; b <= a; b++) matrix[PARAMETERS * b + a] = matrix[PARAMETERS * a + b] *= share;
}

/* Inverse of the information (13, 13) over the directions that are observed. */
static void inverse_of(const fl_support *support, const real *information, real *inverse)
{
    if (support->is_whole) {
        fl_inverse(information, PARAMETERS, inverse);
        return;
    }
    for (int a = 0; a < PARAMETERS; a++)
        for (int b = 0; b < PARAMETERS; b++) {
            real sum = 0;
            for (int k = 0; k < PARAMETERS; k++)
                if (support->share[k] < FL_UNOBSERVED)
                    sum += support->vectors[PARAMETERS * a + k] * support->vectors[PARAMETERS * b + k] / support->values[k];
            inverse[PARAMETERS * a + b] = sum / (support->scale[a] * support->scale[b]);
        }
}

/* Projection (4, 4) of changes on the observed directions; zero if none is left. */
static int observed_changes(const fl_support *support, real onto[CHANGES * CHANGES])
{
    real part[CHANGES * CHANGES] = {0}, squares[CHANGES];
    int taken = 0;
    for (int a = 0; a < CHANGES; a++)
        for (int b = 0; b < CHANGES; b++) {
            onto[CHANGES * a + b] = a == b;
            for (int k = 0; k < PARAMETERS && !support->is_whole; k++)
                if (!(support->share[k] < FL_UNOBSERVED))
                    part[CHANGES * a + b] += support->vectors[PARAMETERS * (9 + a) + k] * support->vectors[PARAMETERS * (9 + b) + k];
        }
    fl_eigen(part, CHANGES, squares);
    for (int k = 0; k < CHANGES; k++) {
        if (!(squares[k] > MIN_OBSERVED_SHARE * MIN_OBSERVED_SHARE)) continue;
        taken++;
        for (int a = 0; a < CHANGES; a++)
            for (int b = 0; b < CHANGES; b++) onto[CHANGES * a + b] -= part[CHANGES * a + k] * part[CHANGES * b + k];
    }
    for (int a = 0; a < CHANGES; a++) /* from its scale to that of the parameters */
        for (int b = 0; b < CHANGES; b++) onto[CHANGES * a + b] *= support->scale[9 + b] / support->scale[9 + a];
    return CHANGES - taken;
}

/* Change (4,) from a solution (13,), and its covariance from that of all parameters. */
static void project(const real onto[CHANGES * CHANGES], const real solution[PARAMETERS], const real *covariance,
                    real change[CHANGES], real spread[CHANGES * CHANGES])
{
    real half[CHANGES * CHANGES], corner[CHANGES * CHANGES];
    fl_multiply(onto, solution + 9, CHANGES, CHANGES, 1, change);
    for (int a = 0; a < CHANGES; a++)
        for (int b = 0; b < CHANGES; b++) corner[CHANGES * a + b] = covariance[PARAMETERS * (9 + a) + 9 + b];
    fl_multiply(onto, corner, CHANGES, CHANGES, CHANGES, half);
    for (int a = 0; a < CHANGES; a++)
        for (int b = 0; b < CHANGES; b++) {
            spread[CHANGES * a + b] = 0;
            for (int k = 0; k < CHANGES; k++) spread[CHANGES * a + b] += half[CHANGES * a + k] * onto[CHANGES * b + k];
        }
}

/* Find a steady change; the record is unchanged if none can be determined. */
void fl_drift(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real dip_deg,
              const fl_room *room, flinders_record *record)
{
    fl_residuals left;
    fl_support support;
    real matrix[PARAMETERS * PARAMETERS], information[PARAMETERS * PARAMETERS], inverse[PARAMETERS * PARAMETERS];
    real covariance[PARAMETERS * PARAMETERS], products[(PARAMETERS + 1) * (PARAMETERS + 1)];
    real gradient[PARAMETERS], solution[PARAMETERS], onto[CHANGES * CHANGES], change[CHANGES], spread[CHANGES * CHANGES];
    real square = 0, moved[9] = {0};
    fl_gather_evenly(kernels, view, surface, room, 0, &left);
    left.width = PARAMETERS;
    if (left.n == 0) return;
    for (size_t i = 0; i < left.n; i++) {
        real row[PARAMETERS];
        for (int k = 0; k < 9; k++) row[k] = left.columns[k][i];
        with_change(surface, time_of(&left, i), row);
        for (int k = 9; k < PARAMETERS; k++) left.columns[k][i] = row[k];
        square += left.distances[i] * left.distances[i];
    }
    const real least = FL_FINEST * surface->radius, mean = square / (real)left.n;
    const real variance = mean > least * least ? mean : least * least;
    scattered context = {surface, &left};
    fl_gram(kernels, &left, 0, left.n, products);
    fl_normal_equations(products, PARAMETERS + 1, 0, PARAMETERS, matrix, gradient);
    for (int i = 0; i < PARAMETERS * PARAMETERS; i++) information[i] = matrix[i] / variance;
    fl_support_of(information, PARAMETERS, spurious, &context, &support);
    if (!observed_changes(&support, onto)) return;
    inverse_of(&support, information, inverse);
    for (int i = 0; i < PARAMETERS * PARAMETERS; i++) inverse[i] /= variance;
    fl_multiply(inverse, gradient, PARAMETERS, PARAMETERS, 1, solution);
    kernels->take_off(left.columns, left.n, PARAMETERS, solution, left.distances, left.distances);
    const real independent = fl_covariance_of_solution(kernels, &left, matrix, inverse, covariance);
    if (!(independent >= MIN_INDEPENDENT)) return;
    project(onto, solution, covariance, change, spread);
    const int freedom = fl_chi_square(change, spread, CHANGES, &square);
    record->drift_by_chance = fl_chance_of(square, (real)freedom, independent);
    record->drift_strength = change[3];
    memcpy(record->drift_offset, change, sizeof record->drift_offset);
    memcpy(moved, change, sizeof record->drift_offset);
    record->drift_deg = fl_level_change(surface, moved, dip_deg);
}
