/* Record of a recording: sequence of all steps. */
#include "sums.h"
#include "residuals.h"

/* Size of a record in bytes. */
size_t flinders_record_size(void) { return sizeof(flinders_record); }

/* Size of a number in bytes. */
size_t flinders_real_size(void) { return sizeof(real); }

/* Fit from sums alone. */
int flinders_sums_solve(const flinders_sums *sums, flinders_record *record)
{
    fl_surface surface;
    real noise;
    fl_clear_record(record);
    if (!(sums->sums[0] > 0 && sums->sums[0] < (real)9e18)) return record->status = FLINDERS_TOO_FEW;
    record->rows = (int64_t)sums->sums[0];
    fl_place_sums(sums, record);
    if (!(record->spread > 0)) return record->status = FLINDERS_UNMOVED;
    if (fl_consistent(sums, (real)1e-11, &surface, &noise)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    fl_place(&surface, record);
    record->noise = noise;
    return record->status = FLINDERS_OK;
}

/* Sampson distances from the surface of a record. */
int flinders_distances(const real *field, size_t rows, const flinders_record *record, real *out)
{
    fl_surface surface;
    const fl_view view = {field, rows, NULL, 1};
    if (fl_surface_of(record->centre, record->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    fl_kernels_chosen(0)->distances(&view, &surface, out);
    return FLINDERS_OK;
}

/* Covariance of a record. If rejected readings may be noise, it is not smaller than with them. */
void fl_covariance_of(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, fl_fit *fit,
                      const fl_room *room, flinders_record *record)
{
    const fl_view with_doubtful = {view->field, view->rows, room->far, 1};
    fl_fit wider;
    real covariance[81];
    const int is_wider = record->is_robust && fit->is_doubtful &&
        fl_polish(kernels, &with_doubtful, options, &fit->surface, FL_STEPS, room->some, &wider) == FLINDERS_OK;
    if (is_wider) {
        fl_covariance(kernels, &with_doubtful, options, &wider, room, record);
        memcpy(covariance, record->covariance, sizeof covariance);
    }
    fl_covariance(kernels, view, options, fit, room, record);
    if (is_wider) fl_raise(record->covariance, covariance, 9, 0);
}

/* Results after the fit of an ellipsoid: covariance, errors of heading and direction, statistics. */
static void describe(const fl_task *of, const fl_view *view, fl_fit *fit, flinders_record *record)
{
    const fl_room *const room = &of->room;
    const int statistics = of->options->statistics;
    fl_covariance_of(of->kernels, view, of->options, fit, room, record);
    fl_place_fit(fit, record);
    for (int i = 0; i < 81 && record->is_robust; i++) { /* it comes of no noise, white or not */
        record->covariance[i] += fit->others[i];
        record->textbook[i] += fit->others[i];
    }
    if (statistics) fl_residual_statistics(of->kernels, &of->all, view, fit, room, record);
    if (statistics) fl_coverage(of->kernels, &fit->surface, record->rejected_beyond, room, record);
    fl_heading_errors(&fit->surface, record, of->options->dip_deg);
    const int is_alone = !record->unobserved && !fl_is_informed(of->options); /* what is known beforehand hides what changes */
    if (statistics && !record->is_white && is_alone && !room->parts)
        fl_drift(of->kernels, view, &fit->surface, record->dip_deg, room, record);
    if (statistics && is_alone) fl_axes(of->kernels, view, fit, record->dip_deg, statistics > 1, room, record);
}

/* Fit an ellipsoid to prepared readings, or the ellipse of a level turn if they are one. */
static int fit_either(fl_task *of, flinders_record *record)
{
    const int may_be = fl_may_be_turn(record, of->options);
    flinders_record turn = *record;
    fl_view view = of->view;
    flinders_sums sums;
    fl_scatter scatter;
    fl_fit fit;
    fl_sums_of(record, &sums);
    fl_sums_covariance(&sums, scatter.all);
    if (may_be && flinders_is_level(scatter.all, 0, FL_FLAT_NOISE)) return fl_fit_turn(of, record);
    const int status = fl_fit_looked(of->kernels, &view, of->options, &of->room, &fit, record);
    if (status != FLINDERS_OK) return status;
    describe(of, &view, &fit, record);
    memcpy(scatter.inliers, scatter.all, sizeof scatter.inliers);
    if (record->rejected > 0) {
        fl_inlier_covariance(of->kernels, &view, &fit.surface, record->rejected_beyond, &of->room, scatter.inliers);
        record->hides_plane = flinders_is_level(scatter.inliers, FL_HUGE, 1);
    }
    if (!may_be || !fl_are_flat(&scatter, FL_HUGE, 1)) return FLINDERS_OK;
    if (fl_fit_turn(of, &turn) == FLINDERS_OK && fl_is_turn(record, &turn, &scatter, of->options)) *record = turn;
    return FLINDERS_OK;
}

/* Set readings and workspace; returns a status. */
static int take(fl_task *of, void *workspace, size_t size, flinders_record *record)
{
    fl_clear_record(record);
    record->rows = (int64_t)of->all.rows;
    of->kernels = fl_kernels_chosen(of->options->kernels);
    if (of->all.rows == 0) return FLINDERS_TOO_FEW;
    return fl_room_of(workspace, size, of->all.rows, &of->room) ? FLINDERS_NO_WORKSPACE : FLINDERS_OK;
}

/* Prepare readings for a method with a minimum of different readings, and of axes that vary. */
static int look(fl_task *of, int fewest, int axes, flinders_record *record)
{
    of->view = of->all;
    of->room.time = of->time, of->room.ends = of->ends, of->room.parts = of->ends ? of->parts : 0;
    return fl_look(of->kernels, &of->view, of->options, fewest, axes, &of->room, record);
}

/* Fit a level turn to readings that are too few for an ellipsoid. */
static int fit_few(fl_task *of, flinders_record *record)
{
    flinders_record turn;
    flinders_sums sums;
    real covariance[6];
    if (look(of, FL_ELLIPSE, FL_AXES, &turn) != FLINDERS_OK) return FLINDERS_TOO_FEW;
    fl_sums_of(&turn, &sums);
    fl_sums_covariance(&sums, covariance);
    if (!fl_may_be_turn(&turn, of->options) || !flinders_is_level(covariance, 0, FL_FLAT_NOISE)) return FLINDERS_TOO_FEW;
    const int status = fl_fit_turn(of, &turn);
    if (status == FLINDERS_OK) *record = turn;
    return status;
}

/* Fit several recordings of one sensor together. */
int flinders_fit_parts(const real *field, const real *time, size_t rows, const int64_t *ends, size_t parts,
                       const flinders_options *options, void *workspace, size_t size, flinders_record *record)
{
    fl_task of = {.options = options, .all = {field, rows, NULL, 1}, .time = time, .ends = ends, .parts = parts};
    int status = take(&of, workspace, size, record);
    if (status != FLINDERS_OK) return record->status = status;
    status = look(&of, FL_ELLIPSOID, FL_AXES, record);
    if (status == FLINDERS_OK) status = fit_either(&of, record);
    else if (status == FLINDERS_TOO_FEW) status = fit_few(&of, record);
    return record->status = status;
}

/* Fit the ellipse of a level turn. */
int flinders_fit_level(const real *field, const real *time, size_t rows, const int64_t *ends, size_t parts,
                       const flinders_options *options, void *workspace, size_t size, flinders_record *record)
{
    fl_task of = {.options = options, .all = {field, rows, NULL, 1}, .time = time, .ends = ends, .parts = parts};
    int status = take(&of, workspace, size, record);
    if (status == FLINDERS_OK && !(options->prior > 0)) status = FLINDERS_BAD_OPTION;
    if (status == FLINDERS_OK) status = look(&of, FL_ELLIPSE, FL_AXES_OF_PLANE, record);
    if (status == FLINDERS_OK) status = fl_fit_turn(&of, record);
    return record->status = status;
}

/* Fit one recording. */
int flinders_fit(const real *field, const real *time, size_t rows, const flinders_options *options, void *workspace,
                 size_t size, flinders_record *record)
{
    return flinders_fit_parts(field, time, rows, NULL, 0, options, workspace, size, record);
}

/* Fit from a known start. */
int flinders_polish(const real *field, size_t rows, const int64_t *ends, size_t parts, const real centre[3],
                    const real shape[6], const flinders_options *options, void *workspace, size_t size,
                    flinders_record *record)
{
    fl_room room;
    fl_fit fit;
    fl_surface start;
    const fl_kernels *kernels = fl_kernels_chosen(options->kernels);
    fl_view view = {field, rows, NULL, 1};
    fl_clear_record(record);
    record->rows = record->fitted = (int64_t)rows;
    if (!(options->prior >= 0 && isfinite(options->prior))) return record->status = FLINDERS_BAD_OPTION;
    if (rows == 0) return record->status = FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return record->status = FLINDERS_NO_WORKSPACE;
    room.ends = ends, room.parts = ends ? parts : 0;
    if (fl_surface_of(centre, shape, &start)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    if (options->robust) fl_cloud(kernels, field, rows, &room);
    record->status = fl_fit_from(kernels, &view, options, &start, &start, &room, &fit, record);
    if (record->status == FLINDERS_UNDETERMINED) record->unobserved = fit.unseen;
    if (record->status != FLINDERS_OK) return record->status;
    if (options->bias_correction) fl_covariance_of(kernels, &view, options, &fit, &room, record);
    else memcpy(record->covariance, fit.covariance, sizeof record->covariance);
    fl_place_fit(&fit, record);
    return record->status;
}

/* Linear drift about a known ellipsoid. */
int flinders_drift(const real *field, size_t rows, const real centre[3], const real shape[6], real dip_deg,
                   void *workspace, size_t size, flinders_record *record)
{
    fl_room room;
    fl_surface surface;
    const fl_view view = {field, rows, NULL, 1};
    fl_clear_record(record);
    record->rows = (int64_t)rows;
    if (!(fl_abs(dip_deg) <= 89)) return record->status = FLINDERS_BAD_OPTION;
    if (rows == 0) return record->status = FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return record->status = FLINDERS_NO_WORKSPACE;
    if (fl_surface_of(centre, shape, &surface)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    fl_drift(fl_kernels_chosen(0), &view, &surface, dip_deg, &room, record);
    return record->status;
}

/* Fit many recordings. */
int flinders_fit_many(const real *field, const real *time, const int64_t *offsets, size_t recordings,
                      const flinders_options *options, void *workspace, size_t size, flinders_record *records)
{
    int worst = FLINDERS_OK;
    for (size_t i = 0; i < recordings; i++) {
        const size_t begin = (size_t)offsets[i], rows = (size_t)(offsets[i + 1] - offsets[i]);
        const int status = flinders_fit(field + 3 * begin, time ? time + begin : NULL, rows, options, workspace, size,
                                        records + i);
        worst = status > worst ? status : worst;
    }
    return worst;
}
