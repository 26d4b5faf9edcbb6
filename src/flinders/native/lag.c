/* Whether axes are read at different moments: a lag of each axis beside the nine parameters.
 *
 * An axis that is read τ late reads ẋ τ too little while the sensor turns, and leaves
 *
 *     s = J δθ − Σ nₐ ẋₐ τₐ
 *
 * n the normal. A lag that all axes have in common leaves nothing, as the strength of the field does not change: the lags
 * are those about their mean, two contrasts. ẋ is the difference of readings before and after, never of the reading
 * itself, so that noise of the one has nothing in common with that of the other.
 */
#include "residuals.h"

enum { AXES = 3, CONTRASTS = 2, WIDTH = 9 + CONTRASTS, FEWEST_INDEPENDENT = 40 };

#define REACH ((real)0.04)  /* s, from a reading to those that a rate is taken from, where the sensor is as fast */
#define UNLIKELY ((real)1e-3)
#define GAP ((real)3)       /* times as long as usual: there is no rate across it */

static const real contrasts[CONTRASTS][AXES] = {{1, -1, 0}, {1, 1, -2}};

/* How the readings are spaced. */
typedef struct {
    const fl_view *view;
    const fl_room *room;
    size_t reach; /* readings */
    real usual;   /* time that they take, there and back */
} spacing;

static spacing spacing_of(const fl_view *view, const fl_room *room)
{
    spacing found = {view, room, 1, 2};
    if (!room->time) return found;
    const real each = (room->time[view->rows - 1] - room->time[0]) / (real)(view->rows - 1);
    if (!(each > 0)) return found;
    const real apart = REACH / each + (real)0.5;
    if (apart >= 1) found.reach = apart < (real)view->rows ? (size_t)apart : view->rows;
    found.usual = 2 * (real)found.reach * each;
    return found;
}

/* How fast the readings change at a place; 0 where that is not known. */
static int rate_at(const spacing *spaced, size_t place, real rate[AXES])
{
    const fl_view *view = spaced->view;
    memset(rate, 0, AXES * sizeof(real));
    if (place < spaced->reach || place + spaced->reach >= view->rows) return 0;
    const size_t before = place - spaced->reach, behind = place + spaced->reach;
    if (view->rejected && (view->rejected[before] || view->rejected[behind])) return 0;
    const real *time = spaced->room->time, taken = time ? time[behind] - time[before] : spaced->usual;
    if (!(taken > 0) || !(taken < GAP * spaced->usual)) return 0;
    for (int axis = 0; axis < AXES; axis++)
        rate[axis] = (view->field[3 * behind + axis] - view->field[3 * before + axis]) / taken;
    return 1;
}

/* The readings that are looked at, with the derivatives by all eleven. */
static void gather(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                   fl_residuals *out)
{
    fl_gather_evenly(kernels, view, surface, room, WIDTH, out);
    const spacing spaced = spacing_of(view, room);
    for (size_t i = 0; i < out->n; i++) {
        real rate[AXES], *row = out->rows + (WIDTH + 1) * i;
        rate_at(&spaced, out->places[i], rate);
        for (int term = 0; term < CONTRASTS; term++) {
            row[9 + term] = 0;
            for (int axis = 0; axis < AXES; axis++) row[9 + term] -= contrasts[term][axis] * row[axis] * rate[axis];
        }
    }
}

/* Solve for all eleven, and take what they explain off the distances; not where they cannot be told apart. */
static int solve(const fl_kernels *kernels, fl_residuals *left, real matrix[WIDTH * WIDTH], real inverse[WIDTH * WIDTH], real solution[WIDTH])
{
    real gradient[WIDTH];
    kernels->gram(left->rows, left->distances, left->n, WIDTH, matrix, gradient);
    if (!fl_is_distinct(matrix, WIDTH)) return 0;
    fl_inverse(matrix, WIDTH, inverse);
    fl_multiply(inverse, gradient, WIDTH, WIDTH, 1, solution);
    fl_take_off(left, solution);
    return 1;
}

/* How often chance makes as much of the lags of a solution; more than 1 where too few readings are independent. */
static real chance(const fl_kernels *kernels, const fl_residuals *left, const flinders_record *record, const real *matrix, const real *inverse,
                   const real solution[WIDTH])
{
    real covariance[WIDTH * WIDTH], spread[CONTRASTS * CONTRASTS], square;
    const real independent = fl_covariance_of_solution(kernels, left, matrix, inverse, covariance);
    if (!(independent >= FEWEST_INDEPENDENT)) return 2;
    for (int a = 0; a < CONTRASTS; a++)
        for (int b = 0; b < CONTRASTS; b++) spread[CONTRASTS * a + b] = covariance[WIDTH * (9 + a) + 9 + b];
    const int freedom = fl_chi_square(solution + 9, spread, CONTRASTS, &square);
    return fl_chance_of(square * fl_share_of_distinct(record), (real)freedom, independent);
}

/* What lags that are left out move the nine parameters by, from the normal matrix of all eleven. */
static void moved_by(const real *matrix, const real lags[CONTRASTS], real moved[9])
{
    real inner[81], inverse[81], pull[9];
    for (int a = 0; a < 9; a++) {
        pull[a] = 0;
        for (int b = 0; b < 9; b++) inner[9 * a + b] = matrix[WIDTH * a + b];
        for (int k = 0; k < CONTRASTS; k++) pull[a] += matrix[WIDTH * a + 9 + k] * lags[k];
    }
    fl_inverse(inner, 9, inverse);
    fl_multiply(inverse, pull, 9, 9, 1, moved);
}

/* Look for axes that are late; the record stays as it is where nothing can be told of them. Slow noise that the fit has
 * found is partly the lag itself: weighted by it the lags are too small, and what chance makes of them is no smaller
 * than it is. So plain least squares say how large they are, and the weights of the fit by how much they move it. */
void fl_lag(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, real dip_deg, const fl_room *room,
            flinders_record *record)
{
    const fl_surface *const surface = &fit->surface;
    fl_residuals left;
    real matrix[WIDTH * WIDTH], inverse[WIDTH * WIDTH], solution[WIDTH], plain[WIDTH * WIDTH], moved[9], square[81], rms;
    gather(kernels, view, surface, room, &left);
    if (left.n == 0 || !fl_is_noisy(&left, surface)) return;
    fl_whiten(&left, &fit->slow);
    if (!solve(kernels, &left, matrix, inverse, solution)) return;
    const real by_chance = chance(kernels, &left, record, matrix, inverse, solution);
    if (by_chance > 1) return;
    if (by_chance < UNLIKELY && fit->slow.ratio > 0) {
        gather(kernels, view, surface, room, &left);
        if (!solve(kernels, &left, plain, inverse, solution)) return;
    }
    record->lag_by_chance = by_chance;
    for (int axis = 0; axis < AXES; axis++)
        record->axis_lag[axis] = contrasts[0][axis] * solution[9] + contrasts[1][axis] * solution[10];
    moved_by(matrix, solution + 9, moved);
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++) square[9 * a + b] = moved[a] * moved[b];
    fl_level_errors(surface, square, dip_deg, &rms, &record->lag_deg);
}
