/* Whether the axes answer the field along a line and all at once: terms of their faults beside the nine parameters.
 *
 * Least squares, weighted by the slow noise that the fit has found; what chance makes of the terms of a fault follows from
 * the scatter of the residuals, as they are still correlated. nonlinearity.c and lag.c say what the terms are.
 */
#include "residuals.h"

enum { TERMS = FL_LAGS_OF_AXES + 9 + FL_NONLINEAR };

/* Readings that are used, evenly spaced, with the derivatives by all terms and their distances; those of the fit may
 * be in the room already. */
void fl_gather_axes(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                    int are_there, fl_residuals *out)
{
    real *jacobian[9];
    fl_gather_evenly(kernels, view, surface, room, are_there, out);
    memcpy(jacobian, out->columns, sizeof jacobian);
    memcpy(out->columns, out->columns + 9, FL_LAGS_OF_AXES * sizeof *jacobian);
    memcpy(out->columns + FL_LAGS_OF_AXES, jacobian, sizeof jacobian);
    out->width = TERMS;
    fl_add_lags(view, room, out);
    kernels->nonlinear(surface, out->directions, out->n, out->columns + FL_LAGS_OF_AXES, out->columns + FL_LAGS_OF_AXES + 9);
}

/* Whether a room has the columns of all readings in order, as the covariance of white residuals has left them. */
static int has_columns(const fl_view *view, const fl_room *room, const flinders_record *record)
{
    return record->is_white && !record->is_robust && !room->parts && view->rows <= FL_SOME;
}

/* Find faults of the axes, and the uncertainty of the nonlinear terms; the record is unchanged if neither can be
 * determined. */
void fl_axes(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, real dip_deg, int has_sigma,
             const fl_room *room, flinders_record *record)
{
    fl_residuals all;
    fl_regression nonlinear, lag;
    real products[FL_COLUMNS * FL_COLUMNS], bent_by_chance = 2, late_by_chance = 2;
    fl_gather_axes(kernels, view, &fit->surface, room, has_columns(view, room, record), &all);
    if (all.n == 0 || !fl_is_noisy(&all, &fit->surface)) return;
    fl_whiten(&all, FL_LAGS_OF_AXES, &fit->slow);
    fl_gram(kernels, &all, 0, all.n, products);
    if (fl_regress(&all, products, FL_LAGS_OF_AXES, 9 + FL_NONLINEAR, &nonlinear))
        bent_by_chance = fl_chance_of_terms(kernels, &nonlinear, 9, FL_NONLINEAR, room, record);
    if (!room->parts && fl_regress(&all, products, 0, FL_LAGS_OF_AXES + 9, &lag))
        late_by_chance = fl_chance_of_terms(kernels, &lag, 0, FL_LAGS_OF_AXES, room, record);
    const int is_bent = bent_by_chance >= FL_PROVEN || fl_is_same_throughout(kernels, &nonlinear, 0, room, record);
    const int is_late = late_by_chance >= FL_PROVEN ||
        fl_is_same_throughout(kernels, &lag, FL_LAGS_OF_AXES, room, record);
    if (bent_by_chance <= 1 && has_sigma) fl_nonlinear_sigma(kernels, &fit->surface, room, &nonlinear, dip_deg, record);
    if (bent_by_chance <= 1)
        fl_nonlinearity(kernels, view, &fit->surface, room, &nonlinear, bent_by_chance, is_bent, dip_deg, record);
    if (late_by_chance <= 1) fl_lag(kernels, view, fit, room, &lag, late_by_chance, is_late, dip_deg, record);
}
