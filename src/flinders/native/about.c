/* Fit of the centre of a surface of known shape, and the angle by which readings turn about their mean. */
#include "internal.h"

enum { STEPS = 12 };

#define MAX_DISTANCE_RATIO ((real)0.7) /* largest ratio of the other centre's distance to this one's at which the other is used */
#define RIDGE_INFORMATION ((real)1e-4) /* information per reading, in squared radii, that is added so that undetermined parameters stay */

/* Unit vector of reading i of a view from the centre of a surface; of unit length if the surface is right. */
static void seen_from(const fl_view *view, const fl_surface *surface, size_t row, real u[3])
{
    real off[3];
    for (int axis = 0; axis < 3; axis++) off[axis] = view->field[3 * row + axis] - surface->centre[axis];
    fl_sym3_apply(surface->inverse, off, u);
}

/* Move the centre of a surface by a step in units of its shape; nonzero if it is none then. */
static int moved_by(const real step[3], fl_surface *surface)
{
    real moved[3];
    fl_sym3_apply(surface->shape, step, moved);
    for (int axis = 0; axis < 3; axis++) surface->centre[axis] += moved[axis];
    return !(isfinite(surface->centre[0]) && isfinite(surface->centre[1]) && isfinite(surface->centre[2]));
}

/* Put the centre of a surface where readings lie on one of its shape and any size: of u = S⁻¹(x − b) the new one, d, and a
 * constant k solve |u|² = 2 uᵀd + k. However far it was moved, but for noise where the readings lie in a plane. */
static int put_anywhere(const fl_view *view, fl_surface *surface)
{
    real matrix[16] = {0}, sums[4] = {0};
    for (size_t row = 0; row < view->rows; row++) {
        real u[4];
        seen_from(view, surface, row, u);
        const real square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
        for (int axis = 0; axis < 3; axis++) u[axis] *= 2;
        u[3] = 1;
        for (int i = 0; i < 4; i++) {
            sums[i] += u[i] * square;
            for (int j = 0; j < 4; j++) matrix[4 * i + j] += u[i] * u[j];
        }
    }
    for (int i = 0; i < 3; i++) matrix[5 * i] += RIDGE_INFORMATION * (real)view->rows;
    return fl_solve(matrix, 4, sums) || moved_by(sums, surface);
}

/* Move the centre of a surface to where readings lie closest to it, in radii; those that lie far from it beside the others
 * count little. Returns how far they lie. */
static real put_near(const fl_view *view, fl_surface *surface)
{
    real scale = FL_HUGE;
    for (int step = 0; step < STEPS; step++) {
        real matrix[9] = {0}, sums[3] = {0}, weights = 0, far = 0;
        for (size_t row = 0; row < view->rows; row++) {
            real u[3];
            seen_from(view, surface, row, u);
            const real length = fl_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), off = length - 1;
            const real weight = 1 / (1 + off / scale * (off / scale));
            for (int i = 0; i < 3 && length > 0; i++) {
                sums[i] += weight * off * u[i] / length;
                for (int j = 0; j < 3; j++) matrix[3 * i + j] += weight * u[i] * u[j] / (length * length);
            }
            weights += weight, far += weight * fl_abs(off);
        }
        for (int i = 0; i < 3; i++) matrix[4 * i] += RIDGE_INFORMATION * (real)view->rows;
        if (!(weights > 0) || fl_solve(matrix, 3, sums) || moved_by(sums, surface)) return FL_HUGE;
        scale = 2 * far / weights > FL_FINEST ? 2 * far / weights : FL_FINEST;
    }
    return scale;
}

/* A surface of the shape that is expected, through readings: from the centre that is expected, or from anywhere else where
 * that leads clearly closer. */
int fl_start_about(const fl_view *view, const real expected[9], fl_surface *surface)
{
    fl_surface other;
    if (fl_surface_of(expected, expected + 3, surface)) return 1;
    other = *surface;
    const real near = put_near(view, surface), far = put_anywhere(view, &other) ? FL_HUGE : put_near(view, &other);
    if (far < MAX_DISTANCE_RATIO * near) *surface = other;
    return !(near < FL_HUGE || far < FL_HUGE);
}

/* Largest angle of readings from their mean. */
real flinders_turn_deg(const real *field, size_t rows, const real shape[6])
{
    real mean[3] = {0}, most = 0;
    fl_surface surface;
    const fl_view view = {field, rows, NULL, 1};
    if (!rows || fl_surface_of(mean, shape, &surface)) return FL_NOT_A_NUMBER;
    for (size_t row = 0; row < rows; row++)
        for (int axis = 0; axis < 3; axis++) mean[axis] += field[3 * row + axis] / (real)rows;
    memcpy(surface.centre, mean, sizeof mean);
    for (size_t row = 0; row < rows; row++) {
        real u[3];
        seen_from(&view, &surface, row, u);
        const real square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
        if (!(square <= most)) most = square;
    }
    return FL_TO_DEG * fl_sqrt(most);
}
