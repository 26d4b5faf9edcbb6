/* Whether axes answer the field along a curve: quadratic and cubic terms of each axis beside the nine parameters.
 *
 * An axis that reads r q (t/r)² + r c (t/r)³ too much at t, its linear reading from the centre, leaves
 *
 *     s = J δθ + Σ nₐ r (qₐ (tₐ/r)² + cₐ (tₐ/r)³)
 *
 * n the normal and r the radius. Fifteen terms by least squares, weighted by the slow noise that the fit has found; what
 * chance makes of six of them follows from the scatter of the residuals, as they are still correlated.
 */
#include "residuals.h"

enum { TERMS = FL_NONLINEAR, WIDTH = 9 + TERMS, HEADINGS = 72 };

#define MIN_EXPLAINED_SHARE ((real)0.75) /* smallest share of the common residuals of one direction that the terms explain */

/* What terms of 1 make of an axis at a direction: six displacements, of x, y, z by the square and by the cube. */
static void displacements(const fl_surface *surface, const real direction[3], real out[TERMS])
{
    const real per_radius = 1 / surface->radius;
    real local[3];
    fl_sym3_apply(surface->shape, direction, local);
    for (int axis = 0; axis < 3; axis++) {
        const real part = local[axis] * per_radius;
        out[axis] = local[axis] * part;
        out[3 + axis] = out[axis] * part;
    }
}

/* Heading error of a level vehicle, at the worst heading and without its mean, from a solution. */
static real level_error(const fl_surface *surface, const real solution[WIDTH], real dip_deg)
{
    const real *step = solution, *shape = solution + 3, *terms = solution + 9;
    const real dip = dip_deg / FL_TO_DEG, flat = fl_cos(dip);
    const real turn = fl_cos(2 * FL_PI / HEADINGS), slant = fl_sin(2 * FL_PI / HEADINGS), height = fl_sin(dip);
    real errors[HEADINGS], cosine = 1, sine = 0, mean = 0, worst = 0;
    for (int k = 0; k < HEADINGS; k++) {
        const real field[3] = {flat * cosine, -flat * sine, height}, across[3] = {sine / flat, cosine / flat, 0};
        real added[TERMS], moved[3], corrected[3];
        displacements(surface, field, added);
        fl_sym3_apply(shape, field, moved);
        for (int axis = 0; axis < 3; axis++)
            moved[axis] += step[axis] + terms[axis] * added[axis] + terms[3 + axis] * added[3 + axis];
        fl_sym3_apply(surface->inverse, moved, corrected);
        errors[k] = 0;
        for (int axis = 0; axis < 3; axis++) errors[k] += across[axis] * corrected[axis];
        mean += errors[k] / HEADINGS;
        const real next = cosine * turn - sine * slant;
        sine = sine * turn + cosine * slant;
        cosine = next;
    }
    for (int k = 0; k < HEADINGS; k++) {
        const real error = fl_abs(errors[k] - mean);
        worst = error > worst ? error : worst;
    }
    return FL_TO_DEG * worst;
}

/* What terms do to offset and shape in the mean over all directions: (u²) e and (u³) e are 1/3 e and 3/5 u e but for
 * harmonics of higher degree. */
static void images(const fl_surface *surface, real out[9][TERMS])
{
    memset(out, 0, 9 * sizeof *out);
    for (int axis = 0; axis < 3; axis++) {
        const real reach = surface->shape[axis] / surface->radius;
        out[axis][axis] = surface->radius * reach * reach / 3;
        out[3 + axis][3 + axis] = surface->radius * reach * reach * reach * 3 / 5;
    }
}

/* The largest error of the direction of the field that steps leave, in radians: each of the terms, and of offset and
 * shape. */
static real across(const fl_surface *surface, real steps[TERMS][WIDTH])
{
    real centres[100][3], worst = 0;
    fl_sphere_centres(centres);
    for (int cell = 0; cell < 100; cell++) {
        const real *const u = centres[cell];
        real added[TERMS], scatter[9] = {0}, values[3];
        displacements(surface, u, added);
        for (int k = 0; k < TERMS; k++) {
            real moved[3], error[3];
            fl_sym3_apply(steps[k] + 3, u, moved);
            for (int axis = 0; axis < 3; axis++)
                moved[axis] += steps[k][axis] + steps[k][9 + axis] * added[axis] + steps[k][12 + axis] * added[3 + axis];
            fl_sym3_apply(surface->inverse, moved, error);
            const real along = error[0] * u[0] + error[1] * u[1] + error[2] * u[2];
            for (int i = 0; i < 3; i++) error[i] -= along * u[i];
            for (int i = 0; i < 9; i++) scatter[i] += error[i / 3] * error[i % 3];
        }
        fl_eigen(scatter, 3, values);
        worst = values[2] > worst ? values[2] : worst;
    }
    return fl_sqrt(worst);
}

/* Add the uncertainty of the terms to a record. Their mean effect on offset and shape over all directions is in the
 * covariance; the rest is an error of the direction. */
void fl_nonlinear_sigma(const fl_kernels *kernels, const fl_surface *surface, const fl_room *room,
                        const fl_regression *found, real dip_deg, flinders_record *record)
{
    real covariance[WIDTH * WIDTH], factor[TERMS * TERMS], mean[9][TERMS], left[TERMS][WIDTH] = {{0}};
    fl_covariance_of_terms(kernels, found, room, record, covariance);
    for (int a = 0; a < TERMS; a++)
        memcpy(factor + TERMS * a, covariance + WIDTH * (9 + a) + 9, TERMS * sizeof(real));
    if (fl_cholesky(factor, TERMS)) return;
    images(surface, mean);
    for (int k = 0; k < TERMS; k++) {
        real column[TERMS], weights[TERMS], step[9] = {0};
        for (int a = 0; a < TERMS; a++) weights[a] = column[a] = a < k ? 0 : factor[TERMS * a + k];
        fl_cholesky_solve(factor, TERMS, weights);
        for (int i = 0; i < 9; i++)
            for (int a = 0; a < TERMS; a++) {
                step[i] += covariance[WIDTH * i + 9 + a] * weights[a] + mean[i][a] * column[a];
                left[k][i] -= mean[i][a] * column[a];
            }
        memcpy(left[k] + 9, column, sizeof column);
        for (int i = 0; i < 81; i++) record->covariance[i] += step[i / 9] * step[i % 9];
    }
    record->nonlinear_sigma_deg = FL_TO_DEG * across(surface, left) / fl_cos(dip_deg / FL_TO_DEG);
    fl_heading_errors(surface, record, dip_deg);
}

/* Whether a solution takes off what residuals of one direction have in common at different times. */
static int explains(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                    const real solution[WIDTH])
{
    fl_residuals left;
    fl_gather_axes(kernels, view, surface, room, 0, &left);
    fl_sort_by_direction(kernels, &left);
    const real before = fl_common_variance(&left);
    kernels->take_off(left.columns + FL_LAGS_OF_AXES, left.n, WIDTH, solution, left.distances, left.distances);
    return fl_common_variance(&left) < (1 - MIN_EXPLAINED_SHARE) * before;
}

/* Write what was found of axes that are not linear into a record, unless a distortion is of another kind. What is neither
 * chance nor the same throughout is a distortion that errs as much. */
void fl_nonlinearity(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                     const fl_regression *found, real by_chance, int is_of_axes, real dip_deg, flinders_record *record)
{
    const real error_deg = level_error(surface, found->solution, dip_deg);
    if (record->distortion > 0 && !explains(kernels, view, surface, room, found->solution)) return;
    if (!is_of_axes) {
        fl_distort(surface, error_deg, dip_deg, record);
        return;
    }
    record->nonlinear_by_chance = by_chance;
    record->nonlinear_deg = error_deg;
    memcpy(record->nonlinearity, found->solution + 9, sizeof record->nonlinearity);
}
