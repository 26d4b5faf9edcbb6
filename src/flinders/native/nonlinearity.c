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

enum { TERMS = 6, WIDTH = 9 + TERMS, HEADINGS = 72, FEWEST_INDEPENDENT = 40 };

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

/* Error of the heading of a level vehicle at the worst heading, without its mean, that a solution tells of. */
static real level_error(const fl_surface *surface, const real solution[WIDTH], real dip_deg)
{
    const real *step = solution, *shape = solution + 3, *terms = solution + 9;
    const real dip = dip_deg / TO_DEG, flat = fl_cos(dip);
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
    return TO_DEG * worst;
}

/* The readings that are looked at, with the derivatives by all fifteen. */
static void gather(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                   fl_residuals *out)
{
    fl_gather_evenly(kernels, view, surface, room, WIDTH, out);
    for (size_t i = 0; i < out->n; i++) {
        real direction[3], added[TERMS], *row = out->rows + (WIDTH + 1) * i;
        for (int axis = 0; axis < 3; axis++) direction[axis] = out->directions[axis * FL_LOOKED + i];
        displacements(surface, direction, added);
        for (int term = 0; term < TERMS; term++) row[9 + term] = row[term % 3] * added[term];
    }
}

/* Whether a solution takes off what residuals of one direction have in common at different times. */
static int explains(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                    const real solution[WIDTH])
{
    fl_residuals left;
    gather(kernels, view, surface, room, &left);
    kernels->cells(left.directions, left.directions + FL_LOOKED, left.directions + 2 * FL_LOOKED, left.n, left.cells);
    const real before = fl_common_variance(&left, surface);
    fl_take_off(&left, solution);
    return fl_common_variance(&left, surface) < (1 - EXPLAINED) * before;
}

/* Look for axes that are not linear; the record stays as it is where nothing can be told of them. */
void fl_nonlinearity(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, real dip_deg,
                     const fl_room *room, flinders_record *record)
{
    const fl_surface *const surface = &fit->surface;
    fl_residuals left;
    real matrix[WIDTH * WIDTH], inverse[WIDTH * WIDTH], covariance[WIDTH * WIDTH], spread[TERMS * TERMS];
    real gradient[WIDTH], solution[WIDTH], square = 0;
    gather(kernels, view, surface, room, &left);
    if (left.n == 0 || !fl_is_noisy(&left, surface)) return;
    fl_whiten(&left, &fit->slow);
    kernels->gram(left.rows, left.distances, left.n, WIDTH, matrix, gradient);
    if (!fl_is_distinct(matrix, WIDTH)) return;
    fl_inverse(matrix, WIDTH, inverse);
    fl_multiply(inverse, gradient, WIDTH, WIDTH, 1, solution);
    fl_take_off(&left, solution);
    const real independent = fl_covariance_of_solution(kernels, &left, matrix, inverse, covariance);
    if (!(independent >= FEWEST_INDEPENDENT)) return;
    if (record->distortion > 0 && !explains(kernels, view, surface, room, solution)) return;
    for (int a = 0; a < TERMS; a++)
        for (int b = 0; b < TERMS; b++) spread[TERMS * a + b] = covariance[WIDTH * (9 + a) + 9 + b];
    const int freedom = fl_chi_square(solution + 9, spread, TERMS, &square);
    record->nonlinear_by_chance = fl_chance_of(square * fl_share_of_distinct(record), (real)freedom, independent);
    record->nonlinear_deg = level_error(surface, solution, dip_deg);
    memcpy(record->nonlinearity, solution + 9, sizeof record->nonlinearity);
}
