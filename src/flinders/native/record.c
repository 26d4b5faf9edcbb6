/* One record per recording: the order in which everything is done. */
#include "sums.h"
#include "residuals.h"

enum { FEW_STEPS = 8 }; /* after which outliers are looked for, as they make for many */

/* Of the noise of all readings, that of a majority which a load left alone. Of 1,200 simulated recordings of a minute or
 * of 12 s with slow noise and no load, 14 are below it (tests/truth/test_switched_load.py). */
#define QUIETER ((real)0.75)

/* Fill options with their defaults. */
void flinders_default_options(flinders_options *options)
{
    options->prior = (real)0.3;
    options->dip_deg = 60;
    options->robust = 1;
    options->kernels = 0;
    options->statistics = 1;
    options->bias_correction = 1;
}

/* A status in words. */
const char *flinders_message(int status)
{
    static const char *const MESSAGES[] = {
        "the fit is complete",
        "there are fewer readings than the ten unknowns: record more",
        "a reading is not a finite number: leave it out",
        "the readings are of no size that a magnetometer reads: check their unit",
        "an axis never changes: check the wiring, or turn the sensor through all directions",
        "the readings hardly vary: turn the sensor through all directions",
        "no ellipsoid fits the readings: turn the sensor through all directions, away from iron",
        "the readings leave parameters open: turn the sensor through more directions, or allow a prior",
        "the workspace is too small: ask flinders_workspace_size",
        "an option is out of its range: see flinders.h",
    };
    return status >= 0 && status < (int)(sizeof MESSAGES / sizeof *MESSAGES) ? MESSAGES[status] : "unknown status";
}

/* Bytes of a record. */
size_t flinders_record_size(void) { return sizeof(flinders_record); }

/* Bytes of a number. */
size_t flinders_real_size(void) { return sizeof(real); }

/* Nothing is known yet. */
static void clear_record(flinders_record *record)
{
    real *numbers = record->centre;
    memset(record, 0, sizeof *record);
    for (; numbers < (real *)&record->backward_steps; numbers++) *numbers = FL_NOT_A_NUMBER;
    record->version = FLINDERS_RECORD_VERSION;
    record->dense = FL_NO_RUN;
    record->rejected_beyond = 0;
    for (int i = 0; i < 6; i++) record->first_swap[i] = -1;
}

/* The smallest power of two that is at least a number. */
static real power_of_two_above(real value)
{
    int exponent;
    const real mantissa = fl_frexp(value, &exponent);
    return fl_ldexp(1, exponent - (mantissa == (real)0.5));
}

/* Put a surface into a record. */
static void place(const fl_surface *surface, flinders_record *record)
{
    memcpy(record->centre, surface->centre, sizeof record->centre);
    memcpy(record->shape, surface->shape, sizeof record->shape);
    record->radius = surface->radius;
}

/* What sums alone say: mean, spread and principal variances. */
static void place_sums(const flinders_sums *sums, flinders_record *record)
{
    real covariance[6];
    memcpy(record->sums, sums->sums, sizeof record->sums);
    memcpy(record->sums_origin, sums->origin, sizeof record->sums_origin);
    record->sums_scale = sums->scale;
    fl_sums_mean(sums, record->mean);
    record->spread = fl_sums_spread(sums);
    fl_sums_covariance(sums, covariance);
    fl_sym3_values(covariance, record->principal_variances);
    for (int i = 0; i < 3; i++)
        if (record->principal_variances[i] < 0) record->principal_variances[i] = 0;
}

/* Solve from sums alone. */
int flinders_sums_solve(const flinders_sums *sums, flinders_record *record)
{
    fl_surface surface;
    real noise;
    clear_record(record);
    if (!(sums->sums[0] > 0 && sums->sums[0] < (real)9e18)) return record->status = FLINDERS_TOO_FEW;
    record->rows = (int64_t)sums->sums[0];
    place_sums(sums, record);
    if (!(record->spread > 0)) return record->status = FLINDERS_UNMOVED;
    if (fl_consistent(sums, (real)1e-11, &surface, &noise)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    place(&surface, record);
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

/* What no method can work with. */
static int refused(const flinders_record *record, const flinders_options *options)
{
    real largest = 0, size = 0;
    if (!(options->prior >= 0 && isfinite(options->prior)) || !(fl_abs(options->dip_deg) <= 89))
        return FLINDERS_BAD_OPTION;
    if (record->rows < 10 || (options->statistics && record->distinct < 10)) return FLINDERS_TOO_FEW;
    for (int axis = 0; axis < 3; axis++) {
        const real low = fl_abs(record->lowest[axis]), high = fl_abs(record->highest[axis]);
        largest = low > largest ? low : largest;
        largest = high > largest ? high : largest;
    }
    if (!((real)FL_SMALLEST < largest && largest < (real)FL_LARGEST)) return FLINDERS_OUT_OF_SCALE;
    for (int axis = 0; axis < 3; axis++)
        if (!(record->highest[axis] > record->lowest[axis])) return FLINDERS_STUCK_AXIS;
    for (int axis = 0; axis < 3; axis++) size += record->mean[axis] * record->mean[axis];
    return fl_sqrt(size) > 1000 * record->spread ? FLINDERS_UNMOVED : FLINDERS_OK;
}

/* Sums about a round number near the middle: no digit is lost to an offset, and they still add. */
static void sum_up(const fl_kernels *kernels, const real *field, size_t rows, flinders_record *record)
{
    const fl_view view = {field, rows, NULL, 1};
    flinders_sums sums;
    real largest = 0, origin[3];
    for (int axis = 0; axis < 3; axis++) {
        const real extent = record->highest[axis] / 2 - record->lowest[axis] / 2;
        largest = extent > largest ? extent : largest;
    }
    const real unit = power_of_two_above(largest > FL_TINY ? largest : FL_TINY);
    for (int axis = 0; axis < 3; axis++)
        origin[axis] = unit * fl_floor((record->highest[axis] / 2 + record->lowest[axis] / 2) / unit + (real)0.5);
    flinders_sums_begin(&sums, origin, unit);
    kernels->powers(&view, sums.origin, sums.scale, sums.sums);
    place_sums(&sums, record);
}

/* Put a fit into a record, but for what correlated residuals add to its covariance. */
static void place_fit(const fl_fit *fit, flinders_record *record)
{
    place(&fit->surface, record);
    record->noise = fit->noise;
    record->used = (int64_t)fit->used;
    record->unobserved = fit->unseen;
    record->steps = fit->steps;
    record->prior_influence = fit->held;
    memcpy(record->textbook, fit->covariance, sizeof record->textbook);
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
static void describe(const fl_kernels *kernels, const fl_view *view, const flinders_options *options,
                     fl_fit *fit, const fl_room *room, flinders_record *record)
{
    covariance_of(kernels, view, options, fit, room, record);
    place_fit(fit, record);
    if (options->statistics) fl_residual_statistics(kernels, view, fit, room, record);
    fl_heading_errors(&fit->surface, record, options->dip_deg);
    if (options->statistics && !record->is_white && !record->unobserved && !room->parts)
        fl_drift(kernels, view, &fit->surface, record->dip_deg, room, record);
    if (options->statistics && !record->unobserved) fl_axes(kernels, view, fit, record->dip_deg, room, record);
}

/* Fit all readings from a start, then the majority alone where that is asked for, or residuals ask and there is one. The
 * majority has a start of its own, or NULL for that through a few readings. */
static int fit_from(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                    const fl_surface *start_of_majority, const fl_room *room, fl_fit *fit, flinders_record *record)
{
    fl_fit most;
    const int may_ask = options->robust && view->rows >= 12;
    const int looks_early = may_ask && !start_of_majority;
    int status = fl_polish(kernels, view, options, start, looks_early ? FEW_STEPS : FL_STEPS, room->some, fit);
    int asks = may_ask && status == FLINDERS_OK ? fl_asks_for_robust(kernels, view, &fit->surface, room) : 0;
    if (asks != 1 && looks_early && status == FLINDERS_OK && fit->steps == FEW_STEPS) { /* it goes on from where it stands */
        const fl_surface so_far = fit->surface;
        status = fl_polish(kernels, view, options, &so_far, FL_STEPS - FEW_STEPS, room->some, fit);
        fit->steps += FEW_STEPS;
        asks = status == FLINDERS_OK ? fl_asks_for_robust(kernels, view, &fit->surface, room) : 0;
    }
    if (!asks && options->robust < 2) return status;
    const int found = fl_robust(kernels, view, options, start_of_majority, room, &most, record);
    const int is_proven = found == FLINDERS_OK && !(asks == FL_SUSPECTS && most.noise > QUIETER * fit->noise);
    if (found != FLINDERS_OK || (!is_proven && options->robust < 2)) fl_forget_outliers(view, record);
    if (!is_proven && options->robust < 2) return status;
    *fit = most;
    return found;
}

/* Fit recordings of one sensor as one. */
int flinders_fit_parts(const real *field, const real *time, size_t rows, const int64_t *ends, size_t parts,
                       const flinders_options *options, void *workspace, size_t size, flinders_record *record)
{
    const fl_kernels *kernels = fl_kernels_chosen(options->kernels);
    fl_surface start;
    fl_fit fit;
    fl_room room;
    real noise;
    clear_record(record);
    record->rows = (int64_t)rows;
    if (rows == 0) return record->status = FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return record->status = FLINDERS_NO_WORKSPACE;
    room.ends = ends, room.parts = ends ? parts : 0, room.time = time;
    if (fl_quality(kernels, field, time, rows, options->statistics, &room, record)) return record->status = FLINDERS_NOT_FINITE;
    record->status = refused(record, options);
    if (record->status != FLINDERS_OK && record->status != FLINDERS_UNMOVED) return record->status;
    sum_up(kernels, field, rows, record);
    record->status = refused(record, options);
    if (record->status != FLINDERS_OK) return record->status;
    flinders_sums sums;
    memcpy(sums.sums, record->sums, sizeof sums.sums);
    memcpy(sums.origin, record->sums_origin, sizeof sums.origin);
    sums.scale = record->sums_scale;
    fl_view view = {field, rows, NULL, 1};
    if (options->robust || options->statistics) fl_cloud(kernels, field, rows, &room);
    if (fl_start(&sums, &start, &noise)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    record->status = fit_from(kernels, &view, options, &start, NULL, &room, &fit, record);
    if (record->status == FLINDERS_UNDETERMINED) record->unobserved = fit.unseen;
    if (record->status == FLINDERS_OK) describe(kernels, &view, options, &fit, &room, record);
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
    clear_record(record);
    record->rows = (int64_t)rows;
    if (!(options->prior >= 0 && isfinite(options->prior))) return record->status = FLINDERS_BAD_OPTION;
    if (rows == 0) return record->status = FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return record->status = FLINDERS_NO_WORKSPACE;
    room.ends = ends, room.parts = ends ? parts : 0;
    if (fl_surface_of(centre, shape, &start)) return record->status = FLINDERS_NOT_AN_ELLIPSOID;
    if (options->robust) fl_cloud(kernels, field, rows, &room);
    record->status = fit_from(kernels, &view, options, &start, &start, &room, &fit, record);
    if (record->status == FLINDERS_UNDETERMINED) record->unobserved = fit.unseen;
    if (record->status != FLINDERS_OK) return record->status;
    if (options->bias_correction) covariance_of(kernels, &view, options, &fit, &room, record);
    else memcpy(record->covariance, fit.covariance, sizeof record->covariance);
    place_fit(&fit, record);
    return record->status;
}

/* A steady change about a known ellipsoid. */
int flinders_drift(const real *field, size_t rows, const real centre[3], const real shape[6], real dip_deg,
                   void *workspace, size_t size, flinders_record *record)
{
    fl_room room;
    fl_surface surface;
    const fl_view view = {field, rows, NULL, 1};
    clear_record(record);
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
