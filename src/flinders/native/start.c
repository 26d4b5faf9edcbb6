/* A start from sums alone: the consistent ellipsoid, else the algebraic one, else a sphere around the readings.
 *
 * Consistent: A. Kukush, I. Markovsky, S. Van Huffel, Comput. Statist. Data Anal. 47 (2004): the noise variance at
 * which the smallest eigenvalue of the corrected scatter matrix is zero, by Newton steps.
 */
#include "sums.h"

enum { NEWTON_STEPS = 50 };

#define NOISE_TOLERANCE fl_sqrt((real)FL_ROUNDING) /* relative tolerance of the noise variance of a start */

/* Fill a surface; nonzero if its shape is not positive definite. */
int fl_surface_of(const real centre[3], const real shape[6], fl_surface *surface)
{
    memcpy(surface->centre, centre, sizeof surface->centre);
    memcpy(surface->shape, shape, sizeof surface->shape);
    fl_sym3_inverse(shape, surface->inverse);
    const real det = fl_sym3_det(shape);
    surface->radius = fl_cbrt(det);
    return !(shape[0] > 0 && shape[0] * shape[1] - shape[3] * shape[3] > 0 && det > 0 && isfinite(surface->radius));
}

/* Ellipsoid of ten coefficients, of either sign, in coordinates (x - origin)/scale; nonzero if the quadric is none. */
int fl_surface_of_quadric(const real quadric[10], const real origin[3], real scale, fl_surface *surface)
{
    const real sign = quadric[0] + quadric[1] + quadric[2] < 0 ? -1 : 1;
    real vectors[9] = {quadric[0], quadric[3], quadric[4], quadric[3], quadric[1],
                       quadric[5], quadric[4], quadric[5], quadric[2]};
    real values[3], along[3], centre[3], shape[6], level = -sign * quadric[9];
    for (int i = 0; i < 9; i++) vectors[i] *= sign;
    fl_eigen(vectors, 3, values);
    if (!(values[0] > (real)1e-12 * fl_abs(values[2]))) return 1;
    for (int j = 0; j < 3; j++) {
        along[j] = 0;
        for (int i = 0; i < 3; i++) along[j] += vectors[3 * i + j] * sign * quadric[6 + i];
        along[j] /= -2 * values[j];
        level += values[j] * along[j] * along[j];
    }
    if (!(level > 0)) return 1;
    static const unsigned char ROW[6] = {0, 1, 2, 0, 0, 1}, COLUMN[6] = {0, 1, 2, 1, 2, 2};
    for (int entry = 0; entry < 6; entry++) {
        shape[entry] = 0;
        for (int j = 0; j < 3; j++)
            shape[entry] += vectors[3 * ROW[entry] + j] * vectors[3 * COLUMN[entry] + j] * fl_sqrt(level / values[j]);
        shape[entry] *= scale;
    }
    for (int i = 0; i < 3; i++) {
        centre[i] = 0;
        for (int j = 0; j < 3; j++) centre[i] += vectors[3 * i + j] * along[j];
        centre[i] = origin[i] + scale * centre[i];
    }
    return fl_surface_of(centre, shape, surface);
}

/* cᵀ M c. */
static real form(const real matrix[100], const real c[10])
{
    real sum = 0;
    for (int i = 0; i < 10; i++) {
        real row = 0;
        for (int j = 0; j < 10; j++) row += matrix[10 * i + j] * c[j];
        sum += c[i] * row;
    }
    return sum;
}

/* Coefficients c, the last one 1, that minimise cᵀ M c, and the minimum; nonzero if M does not determine the other nine. */
static int least_form(const real matrix[100], real quadric[10], real *least)
{
    real others[81];
    for (int i = 0; i < 9; i++) {
        memcpy(others + 9 * i, matrix + 10 * i, 9 * sizeof(real));
        quadric[i] = -matrix[10 * i + 9];
    }
    if (fl_solve(others, 9, quadric)) return 1;
    quadric[9] = 1;
    *least = matrix[99];
    for (int i = 0; i < 9; i++) *least += matrix[90 + i] * quadric[i];
    return 0;
}

/* Coefficients and noise variance for sums about the mean in units of the spread: the smallest variance at which the
 * minimum of the corrected form is zero, as its smallest eigenvalue is. */
static void adjusted_quadric(const real sums[35], real tolerance, real quadric[10], real *noise_variance)
{
    real plain[100], first[100], second[100], slope[100], heated[35], twice[35], corrected[100], values[10], low = 0;
    fl_heat(sums, heated);
    fl_heat(heated, twice);
    for (int sum = 0; sum < 35; sum++) twice[sum] /= 2;
    fl_unpack(sums, plain);
    fl_unpack(heated, first);
    fl_unpack(twice, second);
    const real cloud[6] = {sums[4], sums[6], sums[9], sums[5], sums[7], sums[8]};
    real thin[3], variance = 0;
    int is_open = 0;
    fl_sym3_values(cloud, thin);
    real high = thin[0] / sums[0];
    for (int step = 0; step < NEWTON_STEPS; step++) {
        real least = 0, fall = 0;
        for (int i = 0; i < 100; i++) {
            corrected[i] = plain[i] + variance * (first[i] + variance * second[i]);
            slope[i] = first[i] + 2 * variance * second[i];
        }
        is_open = least_form(corrected, quadric, &least);
        if (!is_open && least > 0) low = variance;
        else high = variance;
        if (!is_open) fall = form(slope, quadric);
        real proposed = fall < 0 ? variance - least / fall : high;
        if (!(low <= proposed && proposed <= high) || is_open) proposed = (low + high) / 2;
        if (!(fl_abs(proposed - variance) > (real)1e-14 + tolerance * variance)) break;
        variance = proposed;
    }
    if (is_open) {
        fl_eigen(corrected, 10, values);
        for (int i = 0; i < 10; i++) quadric[i] = corrected[10 * i];
    }
    *noise_variance = variance > 0 ? variance : 0;
}

/* Sums about the mean, in units of the spread; nonzero for zero spread. */
static int standardised(const flinders_sums *sums, flinders_sums *local)
{
    real mean[3];
    const real spread = fl_sums_spread(sums);
    if (!(spread > 0) || !isfinite(spread)) return 1;
    fl_sums_mean(sums, mean);
    *local = *sums;
    flinders_sums_move(local, mean, spread);
    return 0;
}

/* Consistent ellipsoid and noise, its variance to a relative tolerance; nonzero if the quadric is open. */
int fl_consistent(const flinders_sums *sums, real tolerance, fl_surface *surface, real *noise)
{
    flinders_sums local;
    real quadric[10], variance;
    if (standardised(sums, &local)) return 1;
    adjusted_quadric(local.sums, tolerance, quadric, &variance);
    *noise = local.scale * fl_sqrt(variance);
    return fl_surface_of_quadric(quadric, local.origin, local.scale, surface);
}

/* Plain least squares with tr Q = 3; nonzero if the quadric is open. */
static int algebraic(const flinders_sums *local, fl_surface *surface)
{
    static const signed char FREE[10][9] = {{1, 1}, {-1, 0}, {0, -1}, {0, 0, 1}, {0, 0, 0, 1}, {0, 0, 0, 0, 1},
        {0, 0, 0, 0, 0, 1}, {0, 0, 0, 0, 0, 0, 1}, {0, 0, 0, 0, 0, 0, 0, 1}, {0, 0, 0, 0, 0, 0, 0, 0, 1}};
    real scatter[100], normal[81], right[9], inverse[81], quadric[10];
    fl_unpack(local->sums, scatter);
    for (int a = 0; a < 9; a++) {
        right[a] = 0;
        for (int b = 0; b < 9; b++) normal[9 * a + b] = 0;
        for (int i = 0; i < 10; i++) {
            right[a] -= FREE[i][a] * (scatter[10 * i] + scatter[10 * i + 1] + scatter[10 * i + 2]);
            for (int b = 0; b < 9; b++)
                for (int j = 0; j < 10; j++) normal[9 * a + b] += FREE[i][a] * scatter[10 * i + j] * FREE[j][b];
        }
    }
    fl_inverse(normal, 9, inverse);
    for (int i = 0; i < 10; i++) {
        quadric[i] = i < 3;
        for (int a = 0; a < 9; a++)
            for (int b = 0; b < 9; b++) quadric[i] += FREE[i][a] * inverse[9 * a + b] * right[b];
    }
    return fl_surface_of_quadric(quadric, local->origin, local->scale, surface);
}

/* Ellipsoid to start from, and the noise, NaN if unknown; nonzero for readings without extent. */
int fl_start(const flinders_sums *sums, fl_surface *surface, real *noise)
{
    flinders_sums local;
    if (!fl_consistent(sums, NOISE_TOLERANCE, surface, noise)) return 0;
    *noise = FL_NOT_A_NUMBER;
    if (standardised(sums, &local)) return 1;
    if (!algebraic(&local, surface)) return 0;
    const real sphere[6] = {local.scale, local.scale, local.scale, 0, 0, 0};
    return fl_surface_of(local.origin, sphere, surface);
}
