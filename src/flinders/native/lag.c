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

enum { AXES = 3, CONTRASTS = FL_LAGS_OF_AXES, WIDTH = CONTRASTS + 9 };

#define RATE_SPAN_S ((real)0.04) /* s between a reading and those from which its rate of change is computed, for a sensor that is fast enough */
#define MAX_P_VALUE ((real)1e-3)
#define MIN_GAP_INTERVALS ((real)3) /* usual intervals in a gap, across which there is no rate */

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
    const real apart = RATE_SPAN_S / each + (real)0.5;
    if (apart >= 1) found.reach = apart < (real)view->rows ? (size_t)apart : view->rows;
    found.usual = 2 * (real)found.reach * each;
    return found;
}

/* Rate of change of the readings at a place; 0 if it is not known. */
static int rate_at(const spacing *spaced, size_t place, real rate[AXES])
{
    const fl_view *view = spaced->view;
    memset(rate, 0, AXES * sizeof(real));
    if (place < spaced->reach || place + spaced->reach >= view->rows) return 0;
    const size_t before = place - spaced->reach, behind = place + spaced->reach;
    if (view->rejected && (view->rejected[before] || view->rejected[behind])) return 0;
    const real *time = spaced->room->time, taken = time ? time[behind] - time[before] : spaced->usual;
    if (!(taken > 0) || !(taken < MIN_GAP_INTERVALS * spaced->usual)) return 0;
    const real each = 1 / taken;
    for (int axis = 0; axis < AXES; axis++)
        rate[axis] = (view->field[3 * behind + axis] - view->field[3 * before + axis]) * each;
    return 1;
}

/* Fill the two columns of lags. Nothing goes from one recording to the next. */
void fl_add_lags(const fl_view *view, const fl_room *room, fl_residuals *all)
{
    const spacing spaced = spacing_of(view, room);
    for (size_t i = 0; i < all->n; i++) {
        real rate[AXES];
        rate_at(&spaced, all->places[i], rate);
        for (int axis = 0; axis < AXES; axis++) rate[axis] *= all->columns[CONTRASTS + axis][i];
        for (int term = 0; term < CONTRASTS; term++) {
            const real *const of = contrasts[term];
            all->columns[term][i] = -(of[0] * rate[0] + of[1] * rate[1] + of[2] * rate[2]);
        }
    }
}

/* What lags that are left out move the nine parameters by, from the normal matrix of all eleven; nonzero if nothing tells. */
static int moved_by(const real *matrix, const real lags[CONTRASTS], real moved[9])
{
    real inner[81];
    for (int a = 0; a < 9; a++) {
        const real *const row = matrix + WIDTH * (CONTRASTS + a);
        moved[a] = 0;
        for (int b = 0; b < 9; b++) inner[9 * a + b] = row[CONTRASTS + b];
        for (int k = 0; k < CONTRASTS; k++) moved[a] += row[k] * lags[k];
    }
    return fl_solve(inner, 9, moved);
}

/* Write what was found of axes that are late into a record, as a distortion where it is not of the axes. Slow noise that
 * the fit has found is partly the lag itself: weighted by it the lags are too small, and what chance makes of them is no
 * smaller than it is. So plain least squares say how large they are, and the weights of the fit by how much they move it. */
void fl_lag(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
            const fl_regression *found, real by_chance, int is_of_axes, real dip_deg, flinders_record *record)
{
    fl_residuals all;
    fl_regression plain;
    const real *lags = found->solution;
    real products[FL_COLUMNS * FL_COLUMNS], moved[9];
    if (by_chance < MAX_P_VALUE && fit->slow.ratio > 0) {
        fl_gather_axes(kernels, view, &fit->surface, room, 0, &all);
        fl_gram(kernels, &all, 0, all.n, products);
        if (!fl_regress(&all, products, 0, WIDTH, &plain)) return;
        lags = plain.solution;
    }
    if (moved_by(found->matrix, lags, moved)) return;
    const real error_deg = fl_level_change(&fit->surface, moved, dip_deg);
    if (!is_of_axes) {
        fl_distort(&fit->surface, error_deg, dip_deg, record);
        return;
    }
    record->lag_by_chance = by_chance;
    record->lag_deg = error_deg;
    for (int axis = 0; axis < AXES; axis++)
        record->axis_lag[axis] = contrasts[0][axis] * lags[0] + contrasts[1][axis] * lags[1];
}
