/* Whether readings lie in one plane, as those of a level turn do. */
#include "record.h"

enum { TRIMS = 3,       /* rounds in which the readings farthest from their plane are left out */
       MIN_READINGS = 20 }; /* smallest number of readings that determine a plane */

#define TRIM_SHARE ((real)0.03) /* share of the readings that is left out each time */
#define MIN_UPRIGHT_COSINE ((real)0.8660254037844387) /* smallest component of z perpendicular to the plane, 30 degrees: else x and y give no heading */

/* Covariance of readings about their mean, times so many. */
static void scatter(const real *field, size_t n, real mean[3], real products[9])
{
    for (int axis = 0; axis < 3; axis++) mean[axis] = 0;
    for (int i = 0; i < 9; i++) products[i] = 0;
    for (size_t i = 0; i < 3 * n; i++) mean[i % 3] += field[i];
    for (int axis = 0; axis < 3; axis++) mean[axis] /= (real)n;
    for (const real *at = field; at < field + 3 * n; at += 3)
        for (int i = 0; i < 9; i++) products[i] += (at[i / 3] - mean[i / 3]) * (at[i % 3] - mean[i % 3]);
}

/* Leave out the readings farthest from their plane; returns the number that remains. */
static size_t trim(real *field, size_t n, real *across, real *sorted)
{
    real mean[3], axes[9], values[3];
    size_t kept = 0;
    scatter(field, n, mean, axes);
    fl_eigen(axes, 3, values);
    for (size_t i = 0; i < n; i++) {
        real off = 0;
        for (int axis = 0; axis < 3; axis++) off += (field[3 * i + (size_t)axis] - mean[axis]) * axes[3 * axis];
        across[i] = sorted[i] = fl_abs(off);
    }
    const real limit = fl_select(sorted, n, (size_t)((1 - TRIM_SHARE) * (real)(n - 1)));
    for (size_t i = 0; i < n; i++)
        if (across[i] <= limit) memmove(field + 3 * kept++, field + 3 * i, 3 * sizeof *field);
    return kept;
}

/* Covariance of readings, which are moved, without those farthest from their plane. `across` and `sorted` (rows,) are lent. */
static void trimmed(real *field, size_t rows, real *across, real *sorted, real covariance[6])
{
    real mean[3], products[9];
    size_t n = rows;
    for (int i = 0; i < TRIMS && n > 1; i++) n = trim(field, n, across, sorted);
    scatter(field, n, mean, products);
    for (int i = 0; i < 3; i++) covariance[i] = products[4 * i] / (real)(n - 1);
    covariance[3] = products[1] / (real)(n - 1), covariance[4] = products[2] / (real)(n - 1);
    covariance[5] = products[5] / (real)(n - 1);
}

/* Whether readings of a covariance lie in a plane across z. */
int flinders_is_level(const real covariance[6], real noise, real within)
{
    const real *const c = covariance;
    real axes[9] = {c[0], c[3], c[4], c[3], c[1], c[5], c[4], c[5], c[2]}, values[3];
    for (int i = 0; i < 6; i++)
        if (!isfinite(c[i])) return 0;
    fl_eigen(axes, 3, values);
    const real thickness = values[0] > 0 ? fl_sqrt(values[0]) : 0, width = values[2] > 0 ? fl_sqrt(values[2]) : 0;
    const real noisy = within * noise, flat = FL_FLAT * width > noisy ? FL_FLAT * width : noisy;
    return thickness < (FL_FLATTEST * width < flat ? FL_FLATTEST * width : flat) && fl_abs(axes[6]) > MIN_UPRIGHT_COSINE;
}

/* Covariance of the readings within a limit of a surface, without those farthest from their plane: a few outliers always lie
 * on the surface that is found among them, however flat the rest. NaN of fewer than twenty. */
void fl_inlier_covariance(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real limit,
                          const fl_room *room, real covariance[6])
{
    const fl_view all = {view->field, view->rows, NULL, 1};
    size_t near = 0, count = 0, kept = 0;
    for (int i = 0; i < 6; i++) covariance[i] = FL_NOT_A_NUMBER;
    kernels->distances(&all, surface, room->distances);
    for (size_t row = 0; row < view->rows; row++) near += fl_abs(room->distances[row]) <= limit;
    if (near < MIN_READINGS) return;
    const size_t stride = (near + FL_ENOUGH - 1) / FL_ENOUGH;
    for (size_t row = 0; row < view->rows; row++)
        if (fl_abs(room->distances[row]) <= limit && count++ % stride == 0)
            memcpy(room->some + 3 * kept++, view->field + 3 * row, 3 * sizeof *room->some);
    trimmed(room->some, kept, room->distances, room->scratch, covariance);
}
