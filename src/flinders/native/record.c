/* One record per recording: the order in which everything is done. */
#include "sums.h"
#include "residuals.h"

/* Bytes of a record. */
size_t flinders_record_size(void) { return sizeof(flinders_record); }

/* Bytes of a number. */
size_t flinders_real_size(void) { return sizeof(real); }

/* Solve from sums alone. */
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

/* The covariance of a record. Rejected readings that may be noise do not sharpen it: it is no smaller than with them. */
static void covariance_of(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, fl_fit *fit,
                          const fl_room *room, flinders_record *record)
{
    const fl_view with_doubtful = {view->field, view->rows, room->far, 1};
    fl_fit wider;
    real covariance[81];
    const int is_wider = record->is_robust && fit->is_doubtful &&
        fl_polish(kernels, &with_doubtful, options, &fit->surface, FL_STEPS, room->some, &wider) == FLINDERS_OK;
    if (is_wider) {
        fl_covariance(kernels, &with_doubtful, &wider, room, record);
        memcpy(covariance, record->covariance, sizeof covariance);
    }
    fl_covariance(kernels, view, fit, room, record);
    if (is_wider) fl_raise(record->covariance, covariance, 9, 0);
}

/* Everything that is known after the fit: covariance, errors of heading and direction, statistics. */
static void describe(const fl_kernels *kernels, const fl_view *all, const fl_view *view, const flinders_options *options,
                     fl_fit *fit, const fl_room *room, flinders_record *record)
{
    covariance_of(kernels, view, options, fit, room, record);
    fl_place_fit(fit, record);
    for (int i = 0; i < 81 && record->is_robust; i++) { /* it comes of no noise, white or not */
        record->covariance[i] += fit->others[i];
        record->textbook[i] += fit->others[i];
    }
    if (options->statistics) fl_residual_statistics(kernels, all, view, fit, room, record);
    fl_heading_errors(&fit->surface, record, options->dip_deg);
    const int is_alone = !record->unobserved && !fl_is_informed(options); /* what is known beforehand hides what changes */
    if (options->statistics && !record->is_white && is_alone && !room->parts)
        fl_drift(kernels, view, &fit->surface, record->dip_deg, room, record);
    if (options->statistics && is_alone)
        fl_axes(kernels, view, fit, record->dip_deg, options->statistics > 1, room, record);
    if (options->statistics && record->rejected > 0)
        record->hides_plane = fl_hides_plane(kernels, view, &fit->surface, record->rejected_beyond, room);
}

/* Fit recordings of one sensor as one. */
int flinders_fit_parts(const real *field, const real *time, size_t rows, const int64_t *ends, size_t parts,
                       const flinders_options *options, void *workspace, size_t size, flinders_record *record)
{
    const fl_kernels *kernels = fl_kernels_chosen(options->kernels);
    const fl_view all = {field, rows, NULL, 1};
    fl_view view = all;
    fl_fit fit;
    fl_room room;
    fl_clear_record(record);
    record->rows = (int64_t)rows;
    if (rows == 0) return record->status = FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return record->status = FLINDERS_NO_WORKSPACE;
    room.ends = ends, room.parts = ends ? parts : 0, room.time = time;
    record->status = fl_fit_view(kernels, &view, options, &room, &fit, record);
    if (record->status == FLINDERS_OK) describe(kernels, &all, &view, options, &fit, &room, record);
    return record->status;
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
    if (options->bias_correction) covariance_of(kernels, &view, options, &fit, &room, record);
    else memcpy(record->covariance, fit.covariance, sizeof record->covariance);
    fl_place_fit(&fit, record);
    return record->status;
}

/* A steady change about a known ellipsoid. */
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

/* Fit many recordings, one after the other. */
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
