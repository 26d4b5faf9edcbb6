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

#define TO_DEG ((real)180 / FL_PI)
#define EXPLAINED ((real)0.75)   /* of what residuals of one direction have in common: else it is of another kind */

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

/* Errors of the headings of a level vehicle, without their mean, that a solution tells of, in radians. */
static void level_errors(const fl_surface *surface, const real solution[WIDTH], real dip_deg, real errors[HEADINGS])
{
    const real *step = solution, *shape = solution + 3, *terms = solution + 9;
    const real dip = dip_deg / TO_DEG, flat = fl_cos(dip);
    const real turn = fl_cos(2 * FL_PI / HEADINGS), slant = fl_sin(2 * FL_PI / HEADINGS), height = fl_sin(dip);
    real cosine = 1, sine = 0, mean = 0;
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
    for (int k = 0; k < HEADINGS; k++) errors[k] -= mean;
}

/* The largest of them, in degrees. */
static real level_error(const fl_surface *surface, const real solution[WIDTH], real dip_deg)
{
    real errors[HEADINGS], worst = 0;
    level_errors(surface, solution, dip_deg, errors);
    for (int k = 0; k < HEADINGS; k++) worst = fl_abs(errors[k]) > worst ? fl_abs(errors[k]) : worst;
    return TO_DEG * worst;
}

/* Write into a record what is not known of the terms, and of the nine parameters along with them, as with L Lᵀ = cov(terms)
 * each column of L and the step of the nine that goes with it. */
void fl_nonlinear_sigma(const fl_kernels *kernels, const fl_surface *surface, const fl_room *room,
                        const fl_regression *found, real dip_deg, flinders_record *record)
{
    real covariance[WIDTH * WIDTH], factor[TERMS * TERMS], squares[HEADINGS] = {0}, worst = 0;
    fl_covariance_of_terms(kernels, found, room, record, covariance);
    for (int a = 0; a < TERMS; a++)
        memcpy(factor + TERMS * a, covariance + WIDTH * (9 + a) + 9, TERMS * sizeof(real));
    if (fl_cholesky(factor, TERMS)) return;
    for (int k = 0; k < TERMS; k++) {
        real solution[WIDTH] = {0}, weights[TERMS], errors[HEADINGS];
        for (int a = 0; a < TERMS; a++) weights[a] = solution[9 + a] = a < k ? 0 : factor[TERMS * a + k];
        fl_cholesky_solve(factor, TERMS, weights);
        for (int i = 0; i < 9; i++)
            for (int a = 0; a < TERMS; a++) solution[i] += covariance[WIDTH * i + 9 + a] * weights[a];
        level_errors(surface, solution, dip_deg, errors);
        for (int h = 0; h < HEADINGS; h++) squares[h] += errors[h] * errors[h];
    }
    for (int h = 0; h < HEADINGS; h++) worst = squares[h] > worst ? squares[h] : worst;
    record->nonlinear_sigma_deg = TO_DEG * fl_sqrt(worst);
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
    return fl_common_variance(&left) < (1 - EXPLAINED) * before;
}

/* Write what was found of axes that are not linear into a record, unless a distortion is of another kind. */
void fl_nonlinearity(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                     const fl_regression *found, real by_chance, real dip_deg, flinders_record *record)
{
    if (record->distortion > 0 && !explains(kernels, view, surface, room, found->solution)) return;
    record->nonlinear_by_chance = by_chance;
    record->nonlinear_deg = level_error(surface, found->solution, dip_deg);
    memcpy(record->nonlinearity, found->solution + 9, sizeof record->nonlinearity);
}
