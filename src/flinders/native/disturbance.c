/* Whether readings follow a disturbance that was recorded beside them: an offset per unit of it, beside the nine
 * parameters, by least squares. Terms that the others explain are left out, as those across a level turn. */
#include "residuals.h"

enum { AXES = 3, WIDTH = 9 + AXES, COLUMNS = WIDTH + 1 };

#define MIN_DISTINCT_SHARE (100000 * FL_ROUNDING) /* smallest share of the square of a term that the other terms do not explain */

/* The readings that are not farther from the surface than a limit. */
static fl_view inliers_of(const fl_kernels *kernels, const real *field, size_t rows, const fl_surface *surface, real limit,
                          const fl_room *room)
{
    fl_view view = {field, rows, NULL, 1};
    if (limit >= FL_HUGE) return view;
    kernels->distances(&view, surface, room->distances);
    for (size_t row = 0; row < rows; row++) room->rejected[row] = !(fl_abs(room->distances[row]) <= limit);
    view.rejected = room->rejected;
    return view;
}

/* Drop the readings whose disturbance is not known, and put it less its mean between derivatives and distances of the
 * others. */
static void join(const real *values, fl_residuals *some, flinders_disturbance *found)
{
    real *const known = some->columns[WIDTH], sum = 0, lowest = FL_HUGE, highest = -FL_HUGE;
    size_t kept = 0;
    for (size_t i = 0; i < some->n; i++) {
        const real value = values[some->places[i]];
        if (!(fl_abs(value) < FL_HUGE)) continue;
        for (int k = 0; k < 9; k++) some->columns[k][kept] = some->columns[k][i];
        some->distances[kept] = some->distances[i];
        known[kept++] = value;
        sum += value;
        lowest = value < lowest ? value : lowest, highest = value > highest ? value : highest;
    }
    some->n = kept, some->width = WIDTH;
    if (kept == 0) return;
    const real mean = sum / (real)kept;
    for (int axis = 0; axis < AXES; axis++)
        for (size_t i = 0; i < kept; i++) some->columns[9 + axis][i] = (known[i] - mean) * some->columns[axis][i];
    found->used = (int64_t)kept, found->range = highest - lowest;
    found->farthest = highest - mean > mean - lowest ? highest - mean : mean - lowest;
}

/* Normal equations with the square of the distances in the corner, terms scaled to length one. */
static void equations(const fl_kernels *kernels, const fl_residuals *some, real scale[COLUMNS], real all[COLUMNS][COLUMNS])
{
    fl_gram(kernels, some, 0, some->n, all[0]);
    scale[WIDTH] = 1;
    for (int a = 0; a < WIDTH; a++) scale[a] = all[a][a] > FL_TINY ? fl_sqrt(all[a][a]) : 1;
    for (int a = 0; a < COLUMNS; a++)
        for (int b = 0; b < COLUMNS; b++) all[a][b] /= scale[a] * scale[b];
}

/* Cholesky factor below the diagonal, column by column, a column of zeros for a term that is not distinct; the last row
 * becomes what each further term explains, its square root, and the corner what is left. */
static void factorise(real all[COLUMNS][COLUMNS])
{
    for (int k = 0; k < WIDTH; k++) {
        const real root = all[k][k] > MIN_DISTINCT_SHARE ? fl_sqrt(all[k][k]) : 0;
        for (int i = k; i < COLUMNS; i++) all[i][k] = root > 0 ? all[i][k] / root : 0;
        for (int i = k + 1; i < COLUMNS; i++)
            for (int j = k + 1; j <= i; j++) all[i][j] -= all[i][k] * all[j][k];
    }
}

/* Regress the distances of readings, no farther than `limit` from a surface, on a disturbance and the nine parameters. */
int flinders_regress(const real *field, const real *values, size_t rows, const real centre[3], const real shape[6],
                     real limit, void *workspace, size_t size, flinders_disturbance *found)
{
    const fl_kernels *const kernels = fl_kernels_chosen(0);
    fl_room room;
    fl_surface surface;
    fl_residuals some;
    real scale[COLUMNS], all[COLUMNS][COLUMNS], solution[WIDTH];
    memset(found, 0, sizeof *found);
    if (rows == 0) return FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return FLINDERS_NO_WORKSPACE;
    if (fl_surface_of(centre, shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    const fl_view view = inliers_of(kernels, field, rows, &surface, limit, &room);
    found->stride = (int64_t)fl_gather_evenly(kernels, &view, &surface, &room, 0, &some);
    join(values, &some, found);
    if (found->used == 0) return FLINDERS_TOO_FEW;
    equations(kernels, &some, scale, all);
    factorise(all);
    found->left = all[WIDTH][WIDTH] > 0 ? all[WIDTH][WIDTH] : 0;
    for (int k = WIDTH - 1; k >= 0; k--) {
        solution[k] = all[WIDTH][k];
        for (int i = k + 1; i < WIDTH; i++) solution[k] -= all[i][k] * solution[i];
        solution[k] = all[k][k] > 0 ? solution[k] / all[k][k] : 0;
    }
    for (int axis = 0; axis < AXES; axis++) {
        found->explained += all[WIDTH][9 + axis] * all[WIDTH][9 + axis];
        found->per_unit[axis] = solution[9 + axis] / scale[9 + axis];
    }
    return FLINDERS_OK;
}
