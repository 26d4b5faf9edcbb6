/* Whether the offset crept, or the field grew, while a recording was made: thirteen parameters by least squares.
 *
 * Residuals s = J δθ + t (n · ḃ + n · S u ġ) for −½ ≤ t ≤ ½ over the recording, compared with the scatter that the rest, as
 * it is correlated, gives ḃ and ġ by chance. What only noise tells apart is left out: flinders.diagnostics.drift.
 */
#include "residuals.h"

enum { PARAMETERS = 13, STRIDE = 14, MOST = 5000, FEWEST = 100, FEWEST_INDEPENDENT = 20, CHANGES = 4 };

#define LEAST_SHARE ((real)0.1) /* part of a change in an unobserved direction, from which on it is not told */

/* What is needed to say what noise alone adds to the information. */
typedef struct {
    const fl_surface *surface;
    const fl_residuals *residuals;
} scattered;

/* When a reading was taken, from -0.5 to 0.5. */
static real when(size_t row, size_t n) { return (real)row / (real)(n - 1) - (real)0.5; }

/* Behind nine derivatives those by a change of the offset, along x, y and z, and by one of the field's strength. */
static void with_change(const fl_surface *surface, real time, real row[PARAMETERS])
{
    real growth = 0;
    for (int i = 0; i < 6; i++) growth += row[3 + i] * surface->shape[i];
    for (int axis = 0; axis < 3; axis++) row[9 + axis] = time * row[axis];
    row[12] = time * growth;
}

/* What noise alone adds to the information, for each unit of its variance. */
static void spurious(void *context, real *matrix)
{
    const scattered *from = context;
    const fl_residuals *residuals = from->residuals;
    real turned[2][9], row[PARAMETERS];
    memset(matrix, 0, PARAMETERS * PARAMETERS * sizeof(real));
    for (size_t i = 0; i < residuals->n; i++) {
        real direction[3];
        for (int axis = 0; axis < 3; axis++) direction[axis] = residuals->directions[axis * FL_LOOKED + i];
        fl_turning(from->surface, direction, turned);
        for (int t = 0; t < 2; t++) {
            memcpy(row, turned[t], sizeof turned[t]);
            with_change(from->surface, residuals->rows[STRIDE * i + PARAMETERS], row);
            for (int a = 0; a < PARAMETERS; a++)
                for (int b = 0; b <= a; b++) matrix[PARAMETERS * a + b] += row[a] * row[b];
        }
    }
    for (int a = 0; a < PARAMETERS; a++)
        for (int b = 0; b < a; b++) matrix[PARAMETERS * b + a] = matrix[PARAMETERS * a + b];
}

/* The readings that are looked at, with thirteen derivatives each and, behind these, the time. */
static void gather_rows(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                        fl_residuals *out)
{
    const fl_view all = {view->field, view->rows, view->rejected, 1};
    fl_view some = all;
    some.stride = (fl_view_count(&all) + MOST - 1) / MOST;
    const size_t count = some.stride ? fl_view_count(&some) : 0;
    out->n = 0, out->stretches = 1, out->width = PARAMETERS;
    out->rows = room->rows, out->distances = room->distances, out->directions = room->directions;
    out->begins = room->begins, out->cells = room->order;
    if (count < FEWEST) return;
    kernels->rows(&some, surface, out->rows, out->directions);
    for (size_t i = count; i-- > 0;) memmove(out->rows + STRIDE * i, out->rows + 10 * i, 10 * sizeof(real));
    for (size_t i = 0; i < count; i++) {
        real direction[3], *row = out->rows + STRIDE * out->n;
        for (int axis = 0; axis < 3; axis++) direction[axis] = out->directions[axis * FL_LOOKED + i];
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0) continue; /* right in the centre */
        memmove(row, out->rows + STRIDE * i, 10 * sizeof(real));
        for (int axis = 0; axis < 3; axis++) out->directions[axis * FL_LOOKED + out->n] = direction[axis];
        out->distances[out->n++] = row[9];
        row[PARAMETERS] = when(i, count);
        with_change(surface, row[PARAMETERS], row);
    }
    out->begins[0] = 0, out->begins[1] = out->n;
}

/* Σ JJᵀ and Σ J s. */
static void add_up(const fl_residuals *residuals, real matrix[PARAMETERS * PARAMETERS], real gradient[PARAMETERS])
{
    memset(matrix, 0, PARAMETERS * PARAMETERS * sizeof(real));
    memset(gradient, 0, PARAMETERS * sizeof(real));
    for (size_t i = 0; i < residuals->n; i++) {
        const real *row = residuals->rows + STRIDE * i;
        for (int a = 0; a < PARAMETERS; a++) {
            gradient[a] += row[a] * residuals->distances[i];
            for (int b = 0; b < PARAMETERS; b++) matrix[PARAMETERS * a + b] += row[a] * row[b];
        }
    }
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

/* Projection (4, 4) of changes on those that no unobserved direction takes part in; zero if none is left. */
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
        if (!(squares[k] > LEAST_SHARE * LEAST_SHARE)) continue;
        taken++;
        for (int a = 0; a < CHANGES; a++)
            for (int b = 0; b < CHANGES; b++) onto[CHANGES * a + b] -= part[CHANGES * a + k] * part[CHANGES * b + k];
    }
    for (int a = 0; a < CHANGES; a++) /* from its scale to that of the parameters */
        for (int b = 0; b < CHANGES; b++) onto[CHANGES * a + b] *= support->scale[9 + b] / support->scale[9 + a];
    return CHANGES - taken;
}

/* Square of a change in units of its covariance, over what that leaves free; counts these directions. */
static int chi_square_of(const real change[CHANGES], const real covariance[CHANGES * CHANGES], real *square)
{
    real scale[CHANGES], vectors[CHANGES * CHANGES], values[CHANGES];
    int freedom = 0;
    *square = 0;
    for (int i = 0; i < CHANGES; i++) scale[i] = covariance[5 * i] > 0 ? fl_sqrt(covariance[5 * i]) : 0;
    for (int i = 0; i < CHANGES * CHANGES; i++) {
        const real unit = (scale[i / CHANGES] > 0 ? scale[i / CHANGES] : 1) * (scale[i % CHANGES] > 0 ? scale[i % CHANGES] : 1);
        vectors[i] = covariance[i] / unit;
    }
    fl_eigen(vectors, CHANGES, values);
    for (int k = 0; k < CHANGES; k++) {
        real along = 0;
        if (!(values[k] > FL_DEPENDENT * values[CHANGES - 1])) continue;
        for (int i = 0; i < CHANGES; i++) along += scale[i] > 0 ? vectors[CHANGES * i + k] * change[i] / scale[i] : 0;
        *square += along * along / values[k];
        freedom++;
    }
    return freedom;
}

/* Take what thirteen parameters explain off the distances. */
static void take_off(fl_residuals *residuals, const real solution[PARAMETERS])
{
    for (size_t i = 0; i < residuals->n; i++)
        for (int a = 0; a < PARAMETERS; a++) residuals->distances[i] -= residuals->rows[STRIDE * i + a] * solution[a];
}

/* A change of four from a solution of thirteen, and its covariance from that of all. */
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

/* Look for a steady change; the record stays as it is where nothing can be told of one. */
void fl_drift(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real dip_deg,
              const fl_room *room, flinders_record *record)
{
    fl_residuals left;
    fl_support support;
    real matrix[PARAMETERS * PARAMETERS], information[PARAMETERS * PARAMETERS], inverse[PARAMETERS * PARAMETERS];
    real scatter[PARAMETERS * PARAMETERS], covariance[PARAMETERS * PARAMETERS], autocovariance[FL_LAGS];
    real gradient[PARAMETERS], solution[PARAMETERS], onto[CHANGES * CHANGES], change[CHANGES], spread[CHANGES * CHANGES];
    real square = 0, rms, moved[81] = {0};
    gather_rows(kernels, view, surface, room, &left);
    if (left.n < FEWEST) return;
    for (size_t i = 0; i < left.n; i++) square += left.distances[i] * left.distances[i];
    const real least = FL_FINEST * surface->radius, mean = square / (real)left.n;
    const real variance = mean > least * least ? mean : least * least;
    scattered context = {surface, &left};
    add_up(&left, matrix, gradient);
    for (int i = 0; i < PARAMETERS * PARAMETERS; i++) information[i] = matrix[i] / variance;
    fl_support_of(information, PARAMETERS, spurious, &context, &support);
    if (!observed_changes(&support, onto)) return;
    inverse_of(&support, information, inverse);
    for (int i = 0; i < PARAMETERS * PARAMETERS; i++) inverse[i] /= variance;
    fl_multiply(inverse, gradient, PARAMETERS, PARAMETERS, 1, solution);
    take_off(&left, solution);
    const int lags = fl_autocovariance(&left, autocovariance);
    const real independent = (real)left.n / fl_time_of(autocovariance, lags) - PARAMETERS;
    if (!(independent >= FEWEST_INDEPENDENT)) return;
    for (int i = 0; i < PARAMETERS * PARAMETERS; i++) matrix[i] *= autocovariance[0];
    fl_scatter_in_time(&left, matrix, autocovariance, lags, scatter);
    fl_multiply(inverse, scatter, PARAMETERS, PARAMETERS, PARAMETERS, matrix);
    fl_multiply(matrix, inverse, PARAMETERS, PARAMETERS, PARAMETERS, covariance);
    project(onto, solution, covariance, change, spread);
    const int freedom = chi_square_of(change, spread, &square);
    record->drift_by_chance = fl_chance_of(square, (real)freedom, independent);
    record->drift_strength = change[3];
    memcpy(record->drift_offset, change, sizeof record->drift_offset);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) moved[9 * a + b] = change[a] * change[b];
    fl_level_errors(surface, moved, dip_deg, &rms, &record->drift_deg);
}
