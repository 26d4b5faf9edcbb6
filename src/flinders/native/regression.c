/* Least squares of residuals on terms that stand beside the nine parameters, and how likely chance is to make as much. */
#include "residuals.h"

#define DISTINCT ((real)1e-5) /* smallest eigenvalue of a correlation matrix in which terms are told apart */

/* Rows of the readings of a view. */
static void places_of(const fl_view *view, uint32_t *out)
{
    size_t passed = 0, count = 0;
    for (size_t row = 0; row < view->rows; row += view->rejected ? 1 : view->stride)
        if (!view->rejected || (!view->rejected[row] && passed++ % view->stride == 0)) out[count++] = (uint32_t)row;
}

/* The readings that are looked at, evenly spaced, with nine derivatives each and room for further terms behind these;
 * none where they are too few. */
void fl_gather_evenly(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                      int width, fl_residuals *out)
{
    enum { MOST = 5000, FEWEST = 100 };
    const fl_view all = {view->field, view->rows, view->rejected, 1};
    const size_t stride = (size_t)width + 1;
    fl_view some = all;
    some.stride = (fl_view_count(&all) + MOST - 1) / MOST;
    const size_t count = some.stride ? fl_view_count(&some) : 0;
    out->n = 0, out->stretches = 1, out->width = width;
    out->rows = room->rows, out->distances = room->distances, out->directions = room->directions;
    out->begins = room->begins, out->cells = room->order;
    out->places = room->order + (view->rows < FL_ENOUGH ? view->rows : FL_ENOUGH);
    if (count < FEWEST) return;
    kernels->rows(&some, surface, (size_t)width, out->rows, out->directions);
    places_of(&some, out->places);
    for (size_t i = 0; i < count; i++) {
        real direction[3], *row = out->rows + stride * out->n;
        for (int axis = 0; axis < 3; axis++) direction[axis] = out->directions[axis * FL_LOOKED + i];
        if (direction[0] == 0 && direction[1] == 0 && direction[2] == 0) continue; /* right in the centre */
        if (out->n < i) memcpy(row, out->rows + stride * i, 10 * sizeof(real));
        for (int axis = 0; axis < 3; axis++) out->directions[axis * FL_LOOKED + out->n] = direction[axis];
        out->places[out->n] = out->places[i];
        out->distances[out->n++] = row[9];
        row[width] = (real)i / (real)(count - 1) - (real)0.5;
    }
    out->begins[0] = 0, out->begins[1] = out->n;
}

/* Make rows and distances independent that slow noise correlates: the innovations of a Kalman filter, over their standard
 * deviations. A reading that is the one before again says nothing. */
void fl_whiten(fl_residuals *residuals, const fl_slow *slow)
{
    const int columns = residuals->width + 1;
    real state[3][FL_WIDEST + 1] = {{0}}, p[6] = {slow->ratio, slow->ratio, slow->ratio, 0, 0, 0}, last[FL_WIDEST + 1] = {0};
    size_t kept = 0, waited = 0;
    if (!(slow->ratio > 0)) return;
    for (size_t i = 0; i < residuals->n; i++) {
        real *const row = residuals->rows + (size_t)columns * i, *const out = residuals->rows + (size_t)columns * kept;
        real h[3], gain[3], predicted[6];
        row[columns - 1] = residuals->distances[i];
        waited++;
        if (i > 0 && !memcmp(row, last, (size_t)columns * sizeof(real))) continue;
        memcpy(last, row, (size_t)columns * sizeof(real));
        const real x = (real)waited / ((real)residuals->n * slow->memory), decay = 1 / (1 + x * (1 + x / 2));
        const real normal[3] = {slow->is_vector ? row[0] : 1, slow->is_vector ? row[1] : 0, slow->is_vector ? row[2] : 0};
        for (int k = 0; k < 6; k++) predicted[k] = p[k] * decay * decay + (k < 3 ? slow->ratio * (1 - decay * decay) : 0);
        fl_sym3_apply(predicted, normal, h);
        const real total = normal[0] * h[0] + normal[1] * h[1] + normal[2] * h[2] + 1, root = fl_sqrt(total);
        for (int a = 0; a < 3; a++) gain[a] = h[a] / total, p[a] = predicted[a] - h[a] * gain[a];
        p[3] = predicted[3] - h[0] * gain[1], p[4] = predicted[4] - h[0] * gain[2], p[5] = predicted[5] - h[1] * gain[2];
        for (int k = 0; k < columns; k++) {
            real innovation = row[k];
            for (int a = 0; a < 3; a++) state[a][k] *= decay, innovation -= normal[a] * state[a][k];
            for (int a = 0; a < 3; a++) state[a][k] += gain[a] * innovation;
            out[k] = innovation / root;
        }
        residuals->distances[kept++] = out[columns - 1];
        waited = 0;
    }
    residuals->n = residuals->begins[1] = kept;
}

/* Take what the terms explain off the distances. */
void fl_take_off(fl_residuals *residuals, const real *solution)
{
    const int n = residuals->width;
    for (size_t i = 0; i < residuals->n; i++) {
        const real *row = residuals->rows + (size_t)(n + 1) * i;
        real lanes[4] = {0};
        int a = 0;
        for (; a + 4 <= n; a += 4)
            for (int lane = 0; lane < 4; lane++) lanes[lane] += row[a + lane] * solution[a + lane];
        for (int lane = 0; a < n; a++, lane++) lanes[lane] += row[a] * solution[a];
        residuals->distances[i] -= (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
    }
}

/* Covariance of a solution, its residuals as they are correlated, from Σ JJᵀ and its inverse. Returns how many of the
 * residuals are independent, beyond those that the terms take. */
real fl_covariance_of_solution(const fl_kernels *kernels, const fl_residuals *residuals, const real *matrix, const real *inverse, real *covariance)
{
    const int n = residuals->width;
    real autocovariance[FL_LAGS], white[FL_WIDEST * FL_WIDEST], scatter[FL_WIDEST * FL_WIDEST], half[FL_WIDEST * FL_WIDEST];
    const int lags = fl_autocovariance(residuals, autocovariance);
    for (int i = 0; i < n * n; i++) covariance[i] = inverse[i] * autocovariance[0];
    if (lags < 2) return (real)residuals->n - (real)n;
    for (int i = 0; i < n * n; i++) white[i] = matrix[i] * autocovariance[0];
    fl_scatter_in_time(kernels, residuals, white, autocovariance, lags, scatter);
    fl_multiply(inverse, scatter, n, n, n, half);
    fl_multiply(half, inverse, n, n, n, covariance);
    return (real)residuals->n / fl_time_of(autocovariance, lags) - (real)n;
}

/* Whether residuals are more than rounding. */
int fl_is_noisy(const fl_residuals *residuals, const fl_surface *surface)
{
    const real least = FL_FINEST * surface->radius;
    real square = 0;
    for (size_t i = 0; i < residuals->n; i++) square += residuals->distances[i] * residuals->distances[i];
    return square > least * least * (real)residuals->n;
}

/* Whether a matrix (n, n) tells its terms apart. */
int fl_is_distinct(const real *matrix, int n)
{
    real scaled[FL_WIDEST * FL_WIDEST];
    for (int a = 0; a < n; a++)
        for (int b = 0; b < n; b++) {
            const real unit = matrix[(n + 1) * a] * matrix[(n + 1) * b];
            if (!(unit > FL_TINY)) return 0;
            scaled[n * a + b] = matrix[n * a + b] / fl_sqrt(unit) - (a == b ? DISTINCT : 0);
        }
    return !fl_cholesky(scaled, n);
}

/* Share of the readings that are not another one again: so much is a square of their sum worth. */
real fl_share_of_distinct(const flinders_record *record)
{
    const real share = (real)record->distinct / (real)record->rows;
    return share < 1 ? share : 1;
}

/* Square of a change (n,) in units of its covariance (n, n), over what that leaves free; counts these directions. */
int fl_chi_square(const real *change, const real *covariance, int n, real *square)
{
    real scale[FL_WIDEST], vectors[FL_WIDEST * FL_WIDEST], values[FL_WIDEST];
    int freedom = 0;
    *square = 0;
    for (int i = 0; i < n; i++) scale[i] = covariance[(n + 1) * i] > 0 ? fl_sqrt(covariance[(n + 1) * i]) : 0;
    for (int i = 0; i < n * n; i++)
        vectors[i] = covariance[i] / ((scale[i / n] > 0 ? scale[i / n] : 1) * (scale[i % n] > 0 ? scale[i % n] : 1));
    fl_eigen(vectors, n, values);
    for (int k = 0; k < n; k++) {
        real along = 0;
        if (!(values[k] > FL_DEPENDENT * values[n - 1])) continue;
        for (int i = 0; i < n; i++) along += scale[i] > 0 ? vectors[n * i + k] * change[i] / scale[i] : 0;
        *square += along * along / values[k];
        freedom++;
    }
    return freedom;
}
