/* Least squares of residuals on terms that stand beside the nine parameters, and how likely chance is to make as much. */
#include "residuals.h"

enum { MIN_INDEPENDENT = 40 };

static const real STRENGTH[3] = {1, 0, 0}; /* instead of a normal, where the disturbance has one component */

#define MIN_DISTINCT_EIGENVALUE ((real)1e-5) /* smallest eigenvalue of a correlation matrix at which terms are distinguished */

/* Rows of the readings of a view. */
static void places_of(const fl_view *view, uint32_t *out)
{
    size_t passed = 0, count = 0;
    for (size_t row = 0; row < view->rows; row += view->rejected ? 1 : view->stride)
        if (!view->rejected || (!view->rejected[row] && passed++ % view->stride == 0)) out[count++] = (uint32_t)row;
}

/* Residuals of no reading yet, with the columns of a room: nine of the Jacobian, and those of further terms behind it. */
void fl_begin_residuals(const fl_room *room, fl_residuals *out)
{
    enum { JACOBIAN = 9 };
    memset(out, 0, sizeof *out);
    out->width = JACOBIAN;
    out->distances = fl_column_of_distances(room);
    for (size_t k = 0; k + 1 < FL_COLUMNS; k++) out->columns[k] = room->columns + (k < JACOBIAN ? k : k + 1) * room->apart;
    out->directions = room->directions, out->scratch = room->series, out->begins = room->begins, out->cells = room->order;
}

/* Leave out the readings right in the centre, which have no direction. */
static void leave_out_centre(fl_residuals *residuals)
{
    real *const x = residuals->directions, *const y = x + FL_LOOKED, *const z = y + FL_LOOKED;
    size_t n = 0;
    for (size_t i = 0; i < residuals->n; i++) {
        if (x[i] == 0 && y[i] == 0 && z[i] == 0) continue;
        if (n < i) {
            x[n] = x[i], y[n] = y[i], z[n] = z[i];
            residuals->places[n] = residuals->places[i], residuals->distances[n] = residuals->distances[i];
            for (int k = 0; k < residuals->width; k++) residuals->columns[k][n] = residuals->columns[k][i];
        }
        n++;
    }
    residuals->n = n;
}

/* Readings that are used, evenly spaced, with nine derivatives each and the distance, which may be in the room
 * already; none if they are too few. Returns their spacing. */
size_t fl_gather_evenly(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                        int are_there, fl_residuals *out)
{
    enum { MIN_READINGS = 100 };
    const fl_view all = {view->field, view->rows, view->rejected, 1};
    fl_view some = all;
    real *columns[FL_COLUMNS];
    some.stride = (fl_view_count(&all) + FL_SOME - 1) / FL_SOME;
    const size_t count = some.stride ? fl_view_count(&some) : 0;
    fl_begin_residuals(room, out);
    out->stretches = 1;
    out->places = room->order + (view->rows < FL_ENOUGH ? view->rows : FL_ENOUGH);
    if (count < MIN_READINGS) return some.stride;
    fl_all_columns(out, columns);
    out->n = are_there ? count : kernels->columns(&some, surface, 0, columns, out->directions);
    places_of(&some, out->places);
    leave_out_centre(out);
    out->begins[0] = 0, out->begins[1] = out->n;
    return some.stride;
}

/* Decorrelate columns and distances under slow noise: the innovations of a Kalman filter, over their standard
 * deviations. The Jacobian is after other columns. A repeated reading has no information. */
void fl_whiten(fl_residuals *residuals, int before, const fl_slow *slow)
{
    const int count = residuals->width + 1;
    real *columns[FL_COLUMNS], state[3][FL_COLUMNS] = {{0}}, last[FL_COLUMNS] = {0}, white[FL_COLUMNS];
    real p[6] = {slow->ratio, slow->ratio, slow->ratio, 0, 0, 0};
    size_t kept = 0, waited = 0;
    if (!(slow->ratio > 0)) return;
    fl_all_columns(residuals, columns);
    for (size_t i = 0; i < residuals->n; i++) {
        real h[3], gain[3], predicted[6];
        int is_new = i == 0 || columns[count - 1][i] != last[count - 1];
        waited++;
        for (int k = before; k < before + 9 && !is_new; k++) is_new = columns[k][i] != last[k];
        if (!is_new) continue;
        for (int k = 0; k < count; k++) last[k] = columns[k][i];
        const real *const normal = slow->is_vector ? last + before : STRENGTH;
        const real x = (real)waited / ((real)residuals->n * slow->memory), decay = 1 / (1 + x * (1 + x / 2));
        const real square = decay * decay, fresh = slow->ratio * (1 - square);
        for (int k = 0; k < 6; k++) predicted[k] = p[k] * square + (k < 3 ? fresh : 0);
        fl_sym3_apply(predicted, normal, h);
        const real total = normal[0] * h[0] + normal[1] * h[1] + normal[2] * h[2] + 1, finer = 1 / fl_sqrt(total);
        for (int a = 0; a < 3; a++) gain[a] = h[a] / total, p[a] = predicted[a] - h[a] * gain[a];
        p[3] = predicted[3] - h[0] * gain[1], p[4] = predicted[4] - h[0] * gain[2], p[5] = predicted[5] - h[1] * gain[2];
        const real nx = normal[0] * decay, ny = normal[1] * decay, nz = normal[2] * decay;
        for (int k = 0; k < FL_COLUMNS; k++) { /* as many as there may be: so they vectorise */
            const real innovation = last[k] - (nx * state[0][k] + ny * state[1][k] + nz * state[2][k]);
            for (int a = 0; a < 3; a++) state[a][k] = state[a][k] * decay + gain[a] * innovation;
            white[k] = innovation * finer;
        }
        for (int k = 0; k < count; k++) columns[k][kept] = white[k];
        kept++;
        waited = 0;
    }
    residuals->n = residuals->begins[1] = kept;
}

/* Covariance of a solution for correlated residuals, from Σ JJᵀ and its inverse. Returns the number of independent
 * residuals, minus the terms. */
real fl_covariance_of_solution(const fl_kernels *kernels, const fl_residuals *residuals, const real *matrix,
                               const real *inverse, real *covariance)
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

/* Whether the terms of a matrix (n, n) can be distinguished. */
static int is_distinct(const real *matrix, int n)
{
    real scaled[FL_WIDEST * FL_WIDEST];
    for (int a = 0; a < n; a++)
        for (int b = 0; b < n; b++) {
            const real unit = matrix[(n + 1) * a] * matrix[(n + 1) * b];
            if (!(unit > FL_TINY)) return 0;
            scaled[n * a + b] = matrix[n * a + b] / fl_sqrt(unit) - (a == b ? MIN_DISTINCT_EIGENVALUE : 0);
        }
    return !fl_cholesky(scaled, n);
}

/* Explain residuals by some columns of their rows, from the products of all columns; 0 if the terms cannot be
 * distinguished. */
int fl_regress(const fl_residuals *all, const real *products, int first, int width, fl_regression *out)
{
    real factor[FL_WIDEST * FL_WIDEST];
    fl_residuals *const left = &out->left;
    *left = *all;
    left->width = width;
    memcpy(left->columns, all->columns + first, (size_t)width * sizeof *left->columns);
    fl_normal_equations(products, all->width + 1, first, width, out->matrix, out->gradient);
    if (!is_distinct(out->matrix, width)) return 0;
    memcpy(factor, out->matrix, (size_t)(width * width) * sizeof(real));
    if (fl_cholesky(factor, width)) return 0;
    memcpy(out->gained, out->gradient, sizeof out->gained);
    fl_forward(factor, width, out->gained);
    memcpy(out->solution, out->gradient, sizeof out->solution);
    fl_cholesky_solve(factor, width, out->solution);
    out->square = products[(all->width + 2) * all->width];
    for (int i = 0; i < width; i++) {
        out->gained[i] *= out->gained[i];
        out->square -= out->solution[i] * out->gradient[i];
    }
    return 1;
}

/* Share of the readings that are not repeated, by which squares of sums are weighted. */
static real share_of_distinct(const flinders_record *record)
{
    const real share = (real)record->fitted_distinct / (real)record->fitted;
    return share < 1 ? share : 1;
}

/* Σ gᵀM⁻¹g over some of the columns of normal equations (n, n): the part of the squared residuals that these
 * explain. */
static real explained(const fl_regression *of, int first, int count)
{
    const int n = of->left.width;
    real factor[FL_WIDEST * FL_WIDEST], along[FL_WIDEST], sum = 0;
    for (int a = 0; a < count; a++) {
        memcpy(factor + count * a, of->matrix + n * (first + a) + first, (size_t)count * sizeof(real));
        along[a] = of->gradient[first + a];
    }
    if (fl_cholesky(factor, count)) return 0;
    fl_forward(factor, count, along);
    for (int a = 0; a < count; a++) sum += along[a] * along[a];
    return sum;
}

/* Square of some terms in units of their covariance, for independent residuals. */
static real square_of_terms(const fl_regression *of, int first, int count)
{
    const int n = of->left.width;
    real more = first ? 0 : -explained(of, count, n - count);
    for (int i = first; i < n; i++) more += of->gained[i];
    return more > 0 && of->square > 0 ? more * (real)of->left.n / of->square : 0;
}

/* Covariance of all terms for correlated residuals; returns the number of independent ones, minus the terms. */
static real correlated_covariance(const fl_kernels *kernels, const fl_regression *of, const fl_room *room,
                                  real *covariance)
{
    fl_residuals left = of->left;
    real inverse[FL_WIDEST * FL_WIDEST];
    fl_inverse(of->matrix, left.width, inverse);
    left.distances = room->distances;
    kernels->take_off(left.columns, left.n, left.width, of->solution, of->left.distances, left.distances);
    return fl_covariance_of_solution(kernels, &left, of->matrix, inverse, covariance);
}

/* Covariance (n, n) of all terms, residuals as they are correlated. */
void fl_covariance_of_terms(const fl_kernels *kernels, const fl_regression *of, const fl_room *room,
                            const flinders_record *record, real *covariance)
{
    const int n = of->left.width;
    real each = 1 / share_of_distinct(record);
    if (!record->is_white) correlated_covariance(kernels, of, room, covariance);
    else fl_inverse(of->matrix, n, covariance), each *= of->square / ((real)of->left.n - (real)n);
    for (int i = 0; i < n * n; i++) covariance[i] *= each;
}

/* The same for residuals that are correlated, and how many directions it has; returns how many residuals are independent,
 * beyond those that all terms take. */
static real correlated_square(const fl_kernels *kernels, const fl_regression *of, int first, int count,
                              const fl_room *room, real *square, real *freedom)
{
    const int n = of->left.width;
    real covariance[FL_WIDEST * FL_WIDEST], spread[FL_WIDEST * FL_WIDEST];
    const real independent = correlated_covariance(kernels, of, room, covariance);
    for (int a = 0; a < count; a++)
        for (int b = 0; b < count; b++) spread[count * a + b] = covariance[n * (first + a) + first + b];
    *freedom = (real)fl_chi_square(of->solution + first, spread, count, square);
    return independent;
}

/* How often chance makes as much of the first or last terms of a solution; more than 1 where too few residuals are
 * independent. */
real fl_chance_of_terms(const fl_kernels *kernels, const fl_regression *of, int first, int count, const fl_room *room,
                        const flinders_record *record)
{
    real square, freedom = (real)count, independent = (real)of->left.n - (real)of->left.width;
    if (record->is_white) square = square_of_terms(of, first, count);
    else independent = correlated_square(kernels, of, first, count, room, &square, &freedom);
    if (!(independent >= MIN_INDEPENDENT)) return 2;
    return fl_chance_of(square * share_of_distinct(record), freedom, independent);
}
