/* Steps of a fit: checks of readings, sums and start, likelihood, and a majority if residuals have outliers. */
#include "record.h"
#include "sums.h"

enum { FEW_STEPS = 2, FLAT_STEPS = 8 }; /* steps before a search for outliers, which cause many; for flat readings */
#define MAX_FLAT_VARIANCE_RATIO ((real)0.1) /* largest ratio of the smallest to the largest variance of nearly flat readings */

/* Largest ratio of the noise of a majority without a load to that of all readings. Of 1,200 simulated recordings of a minute
 * or of 12 s with slow noise and no load, 14 are below it (tests/estimators/test_switched_load.py). */
#define MAX_NOISE_RATIO ((real)0.75)

/* Fill options with their defaults. */
void flinders_default_options(flinders_options *options)
{
    options->prior = (real)0.3;
    options->dip_deg = 60;
    options->robust = 1;
    options->kernels = 0;
    options->statistics = 1;
    options->bias_correction = 1;
#ifdef FLINDERS_SMALL
    options->known = NULL;
#else
    options->is_informed = 0;
    memset(options->expected, 0, sizeof options->expected);
    memset(options->information, 0, sizeof options->information);
#endif
    options->rests = 1;
    options->level = 1;
}

/* Message of a status. */
const char *flinders_message(int status)
{
    static const char *const MESSAGES[] = {
        "the fit is complete",
        "there are too few different readings: record more",
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

/* Fill a record with unknown numbers. */
void fl_clear_record(flinders_record *record)
{
    real *numbers = record->centre;
    memset(record, 0, sizeof *record);
    for (; numbers < (real *)&record->backward_steps; numbers++) *numbers = FL_NOT_A_NUMBER;
    record->repetition = 1;
    record->skipped = record->silent = record->is_doubtful = -1;
    record->version = FLINDERS_RECORD_VERSION;
    record->dense = FLINDERS_NO_RUN;
    record->rejected_beyond = 0;
    for (int i = 0; i < 6; i++) record->first_swap[i] = -1;
}

/* Smallest power of two that is not below a number. */
static real power_of_two_above(real value)
{
    int exponent;
    const real mantissa = fl_frexp(value, &exponent);
    return fl_ldexp(1, exponent - (mantissa == (real)0.5));
}

/* The same for callers. */
void flinders_clear_record(flinders_record *record) { fl_clear_record(record); }

/* Write a surface to a record. */
void fl_place(const fl_surface *surface, flinders_record *record)
{
    memcpy(record->centre, surface->centre, sizeof record->centre);
    memcpy(record->shape, surface->shape, sizeof record->shape);
    record->radius = surface->radius;
}

/* Write statistics of the sums: mean, spread and principal variances. */
void fl_place_sums(const flinders_sums *sums, flinders_record *record)
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

/* Error of readings for a method that requires at least `fewest` of them, and variation of the first `axes` axes. */
static int refused(const flinders_record *record, const flinders_options *options, int fewest, int axes)
{
    real largest = 0, size = 0;
    if (!(options->prior >= 0 && isfinite(options->prior)) || !(fl_abs(options->dip_deg) <= 89))
        return FLINDERS_BAD_OPTION;
    if (record->rows < fewest) return FLINDERS_TOO_FEW;
    for (int axis = 0; axis < 3; axis++) {
        const real low = fl_abs(record->lowest[axis]), high = fl_abs(record->highest[axis]);
        largest = low > largest ? low : largest;
        largest = high > largest ? high : largest;
    }
    if (!((real)FL_SMALLEST < largest && largest < (real)FL_LARGEST)) return FLINDERS_OUT_OF_SCALE;
    if (fl_is_informed(options)) return FLINDERS_OK;
    for (int axis = 0; axis < axes; axis++)
        if (!(record->highest[axis] > record->lowest[axis])) return FLINDERS_STUCK_AXIS;
    for (int axis = 0; axis < 3; axis++) size += record->mean[axis] * record->mean[axis];
    return fl_sqrt(size) > 1000 * record->spread ? FLINDERS_UNMOVED : FLINDERS_OK;
}

/* Sums about a rounded number near the mean: without loss of precision by an offset, and additive. */
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
    fl_place_sums(&sums, record);
}

/* Write a fit to a record, without the effect of correlated residuals on its covariance. */
void fl_place_fit(const fl_fit *fit, flinders_record *record)
{
    fl_place(&fit->surface, record);
    record->noise = fit->noise;
    record->used = (int64_t)fit->used;
    record->unobserved = fit->unseen;
    record->steps = fit->steps;
    record->prior_influence = fit->held;
    memcpy(record->textbook, fit->covariance, sizeof record->textbook);
}

/* Fit the majority alone, from its own start or NULL. Nonzero if there is none, or, if a test is required, its noise is not
 * much smaller than that of all readings: then none is rejected. */
static int fit_majority(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                        int asks, const fl_room *room, fl_fit *fit, fl_majority *majority)
{
    const fl_surface of_all = fit->surface;
    const real noise = fit->noise;
#ifdef FLINDERS_SMALL /* no memory for two: the fit to all readings is repeated */
    fl_fit *const most = fit;
#else
    fl_fit other, *const most = &other;
#endif
    const int status = fl_robust(kernels, view, options, start, room, most, majority);
    if (status == FLINDERS_OK && (options->robust == 2 || asks != FL_SUSPECTS || most->noise <= MAX_NOISE_RATIO * noise)) {
        *fit = *most;
        return FLINDERS_OK;
    }
    fl_forget_outliers(view, majority);
    if (most == fit) fl_polish(kernels, view, options, &of_all, FL_STEPS, room->some, fit);
    fit->has_distances = 0;
    return status == FLINDERS_OK ? FLINDERS_NOT_AN_ELLIPSOID : status;
}

/* Fit all readings from a start, then the majority alone if requested, or if residuals have outliers and there is one. The
 * majority has its own start, or NULL for one through a few readings. */
int fl_fit_majority(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                    const fl_surface *start_of_majority, const fl_room *room, fl_fit *fit, fl_majority *majority)
{
    const int may_ask = options->robust && view->rows >= 12;
    const int looks_early = may_ask && !start_of_majority;
    const int few = majority->few;
    int status = fl_polish(kernels, view, options, start, looks_early ? few : FL_STEPS, room->some, fit);
    fit->has_distances = 0;
    int asks = may_ask && status == FLINDERS_OK ? fl_asks_for_robust(kernels, view, fit, room) : 0;
    if (looks_early && status == FLINDERS_OK && fit->steps == few) { /* continues from its last step */
        if (asks == 1 && !fit_majority(kernels, view, options, NULL, asks, room, fit, majority)) return FLINDERS_OK;
        const fl_surface so_far = fit->surface;
        status = fl_polish(kernels, view, options, &so_far, FL_STEPS - few, room->some, fit);
        fit->steps += few;
        fit->has_distances = 0;
        asks = status == FLINDERS_OK ? fl_asks_for_robust(kernels, view, fit, room) : 0;
    }
    if (!asks && options->robust < 2) return status;
    const int found = fit_majority(kernels, view, options, start_of_majority, asks, room, fit, majority);
    return options->robust == 2 ? found : status;
}

/* The same for a record with sums. */
int fl_fit_from(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                const fl_surface *start_of_majority, const fl_room *room, fl_fit *fit, flinders_record *record)
{
    const int few = record->principal_variances[0] > MAX_FLAT_VARIANCE_RATIO * record->principal_variances[2] ? FEW_STEPS : FLAT_STEPS;
    fl_majority majority = {.few = few, .beyond = record->rejected_beyond, .dense = record->dense,
                            .is_robust = record->is_robust, .rejected = record->rejected};
    memcpy(majority.centre, record->majority_centre, sizeof majority.centre);
    memcpy(majority.shape, record->majority_shape, sizeof majority.shape);
    const int status = fl_fit_majority(kernels, view, options, start, start_of_majority, room, fit, &majority);
    memcpy(record->majority_centre, majority.centre, sizeof majority.centre);
    memcpy(record->majority_shape, majority.shape, sizeof majority.shape);
    record->rejected_beyond = majority.beyond, record->dense = majority.dense;
    record->is_robust = majority.is_robust, record->rejected = majority.rejected;
    return status;
}

/* Average each rest: changes the view, and times and ends of the workspace. */
static void leave_rests(fl_view *view, fl_room *room, flinders_record *record)
{
    fl_rests rests;
    size_t begin, end;
    const fl_fitted out = {room->fitted, room->time, room->time ? room->fitted_time : NULL, room->fitted_ends};
    fl_rests_begin(view->field, view->rows, room->ends, room->parts, room->fitted, room->passed, &rests);
    for (; fl_rests_next(&rests, &begin, &end); record->rests++) record->at_rest += (int64_t)(end - begin);
    if (!record->rests) return;
    fl_rests_rewind(&rests);
    view->rows = fl_rests_fitted(&rests, &out);
    view->field = out.field;
    room->time = out.time, room->ends = room->parts ? out.ends : NULL;
    record->fitted = (int64_t)view->rows;
    record->fitted_repeats = fl_repeats(view->field, view->rows);
    record->fitted_distinct = record->distinct ? fl_distinct(view->field, view->rows, room) : 0;
}

/* Start of a fit: about the prior, or else from sums. */
static int start_of(const fl_view *view, const flinders_options *options, const flinders_record *record, fl_surface *start)
{
    flinders_sums sums;
    real noise;
#ifdef FLINDERS_SMALL
    (void)view, (void)options;
#else
    if (options->is_informed) return fl_start_about(view, options->expected, start);
#endif
    fl_sums_of(record, &sums);
    return fl_start(&sums, start, &noise);
}

/* Prepare the readings of a view in the workspace: statistics, averaging of rests, and sums. A method requires at least
 * `fewest` different ones, and variation of the first `axes` axes. */
int fl_look(const fl_kernels *kernels, fl_view *view, const flinders_options *options, int fewest, int axes, fl_room *room,
            flinders_record *record)
{
    fl_clear_record(record);
    record->rows = (int64_t)view->rows;
    if (fl_quality(kernels, view->field, room->time, view->rows, record)) return FLINDERS_NOT_FINITE;
    const int status = refused(record, options, fewest, axes);
    if (status != FLINDERS_OK && status != FLINDERS_UNMOVED) return status;
    if (options->statistics) record->distinct = fl_distinct(view->field, view->rows, room);
    if (options->statistics && record->distinct < fewest) return FLINDERS_TOO_FEW;
    record->fitted = record->rows, record->fitted_repeats = record->repeats, record->fitted_distinct = record->distinct;
    if (options->rests && room->fitted) leave_rests(view, room, record);
    sum_up(kernels, view->field, view->rows, record);
    return refused(record, options, fewest, axes);
}

/* Fit all prepared readings, or those without outliers. */
int fl_fit_looked(const fl_kernels *kernels, fl_view *view, const flinders_options *options, fl_room *room, fl_fit *fit,
                  flinders_record *record)
{
    fl_surface start;
    if (room->keys && (options->robust || options->statistics)) fl_cloud(kernels, view->field, view->rows, room);
    if (start_of(view, options, record, &start)) return FLINDERS_NOT_AN_ELLIPSOID;
    const fl_surface *const of_majority = fl_is_informed(options) ? &start : NULL;
    const int status = fl_fit_from(kernels, view, options, &start, of_majority, room, fit, record);
    if (status == FLINDERS_UNDETERMINED) record->unobserved = fit->unseen;
    if (status == FLINDERS_OK) fl_place_fit(fit, record);
    return status;
}

/* Prepare the readings of a view, then fit an ellipsoid to them. */
int fl_fit_view(const fl_kernels *kernels, fl_view *view, const flinders_options *options, fl_room *room, fl_fit *fit,
                flinders_record *record)
{
    const int status = fl_look(kernels, view, options, FL_ELLIPSOID, FL_AXES, room, record);
    return status == FLINDERS_OK ? fl_fit_looked(kernels, view, options, room, fit, record) : status;
}
