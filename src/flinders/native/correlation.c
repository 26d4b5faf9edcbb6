/* The covariance of a fit whose residuals are correlated, in time and in direction: `fl_covariance`.
 *
 * The scatter of Σ J s over residuals s is Σᵢⱼ JᵢJⱼᵀ (C(i − j) + D(uᵢ, uⱼ)): C their autocovariance up to where it sinks
 * into its noise, D a smooth distortion that belongs to the direction. Blocks of the recording that scatter more than
 * that allows enlarge it. flinders.estimators.covariance gives reasons and sources.
 */
#include "residuals.h"

enum { MIN_NOISE_READINGS = 12,           /* smallest number of readings for a model of slow noise */
       MIN_AUTOCOVARIANCE_READINGS = 50,  /* and for autocovariances */
       MIN_DURATION_READINGS = 100 };     /* and to show whether white noise lasts */

#define MAX_FREEDOM_FACTOR ((real)1.3)
#define MAX_HIDDEN_VARIANCE_RATIO ((real)3) /* largest ratio of variances: part of slow noise that the fit absorbs over the part in the residuals */
#define MIN_SLOW_GAIN_BITS ((real)15) /* bits of likelihood that slow noise gains over white noise, if it is significant */
#define MAX_NOISE_SHARE ((real)0.08) /* largest noise, of the field, at which a step that assumes small residuals is made */

/* Take stretches of `length` readings of one recording without outliers; the next begins `every` readings later. */
static void gather_all(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, size_t every,
                       size_t length, const fl_room *room, fl_residuals *out)
{
    real *columns[FL_COLUMNS];
    fl_all_columns(out, columns);
    memset(room->passed, 1, view->rows);
    for (size_t begin = 0; begin < view->rows; begin += every) {
        const size_t left = view->rows - begin;
        const fl_view some = {view->field + 3 * begin, left < length ? left : length, NULL, 1};
        memset(room->passed + begin, 0, some.rows);
        out->begins[out->stretches++] = out->n;
        out->n += kernels->columns(&some, surface, out->n, columns, out->directions);
    }
}

/* The same of those readings that are used of one recording or more. */
static void gather_used(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, size_t every,
                        size_t length, const fl_room *room, fl_residuals *out)
{
    const int is_whole = every == length;
    real *columns[FL_COLUMNS];
    size_t free = 0, part = 0;
    int is_begun = 0;
    for (size_t row = 0; row < view->rows; row++) {
        for (; part < room->parts && row >= (size_t)room->ends[part]; part++) is_begun = 0;
        const int is_left_out = view->rejected && view->rejected[row];
        const size_t within = is_left_out ? 0 : free;
        if (!is_left_out) free = free + 1 < every ? free + 1 : 0; /* counted within a stretch and the gap behind it */
        const int begins = within == 0 || (is_whole && !is_begun); /* a long one's next stretch waits for its place */
        room->passed[row] = (unsigned char)(is_left_out || within >= length || !(begins || is_begun));
        if (room->passed[row]) continue;
        if (begins) out->begins[out->stretches++] = out->n;
        is_begun = 1;
        out->n++;
    }
    const fl_view some = {view->field, view->rows, room->passed, 1};
    fl_all_columns(out, columns);
    kernels->columns(&some, surface, 0, columns, out->directions);
}

/* Readings that are used, with their Jacobian; all readings if they are few. */
static void gather_stretches(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                             fl_residuals *out)
{
    const size_t used = fit->used, all = FL_LOOKED;
    const size_t every = used <= all ? used : (used + FL_STRETCHES - 1) / FL_STRETCHES;
    const size_t length = used <= all ? used : FL_STRETCH;
    fl_begin_residuals(room, out);
    if (!view->rejected && !room->parts) gather_all(kernels, view, &fit->surface, every, length, room, out);
    else gather_used(kernels, view, &fit->surface, every, length, room, out);
    out->begins[out->stretches] = out->n;
    fl_sort_by_direction(kernels, out);
}

/* Σ d². */
static real square_of(const fl_residuals *residuals)
{
    real sum = 0;
    for (size_t i = 0; i < residuals->n; i++) sum += residuals->distances[i] * residuals->distances[i];
    return sum;
}

/* Whether some readings are others again. */
static int has_copies(const flinders_record *record)
{
    return record->fitted_distinct > 0 && record->fitted_distinct < record->fitted;
}

/* Scatter of Σ J s over all readings, and what was found of it; `known` as for `fl_distortion`. */
static void scatter_of(const fl_kernels *kernels, fl_residuals *residuals, const fl_fit *fit, real known,
                       const fl_room *room, real scatter[81], flinders_record *record)
{
    fl_blocks blocks;
    real autocovariance[FL_LAGS], white[81], in_time[81];
    const real share = (real)fit->used / (real)residuals->n, n = (real)residuals->n;
    memset(scatter, 0, 81 * sizeof(real));
    record->correlation_time = record->excess_variance = 1;
    record->lag_one = record->distortion = 0;
    record->lags = record->is_white = 1;
    if (fl_sqrt(square_of(residuals) / n) < FL_FINEST * fit->surface.radius) return;
    int lags = fl_autocovariance(residuals, autocovariance);
    record->correlation_time = fl_time_of(autocovariance, lags);
    record->distortion = fl_distortion(residuals, &fit->surface, has_copies(record), 3 * (size_t)lags,
                                       record->correlation_time, known, room, scatter);
    if (record->distortion > 0) {
        for (int i = 0; i < 81; i++) scatter[i] *= share * share;
        lags = fl_autocovariance(residuals, autocovariance);
    }
    record->lag_one = fl_lag_one(residuals);
    record->lags = lags;
    const real independent = n * share / record->correlation_time;
    real freedom = independent / (independent - 9 > 1 ? independent - 9 : 1);
    freedom = freedom < MAX_FREEDOM_FACTOR ? freedom : MAX_FREEDOM_FACTOR;
    fl_blocks_of(kernels, residuals, &blocks);
    for (int i = 0; i < 81; i++) {
        white[i] = 0;
        for (int block = 0; block < FL_BLOCKS; block++) white[i] += blocks.squares[block][i] * autocovariance[0];
    }
    fl_scatter_in_time(kernels, residuals, white, autocovariance, lags, in_time);
    for (int i = 0; i < 81; i++) in_time[i] *= freedom;
    record->excess_variance = 1 + share * (fl_creep(&blocks, in_time) - 1);
    for (int i = 0; i < 81; i++) scatter[i] += share * record->excess_variance * in_time[i];
    record->is_white = record->correlation_time == 1 && record->distortion == 0 && record->excess_variance == 1;
}

/* The part of a scatter of the gradient that lies in directions that are observed. */
static void project(const fl_support *support, real scatter[81])
{
    real onto[81], half[81];
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            onto[9 * i + j] = 0;
            for (int k = 0; k < 9; k++)
                if (support->share[k] < FL_UNOBSERVED)
                    onto[9 * i + j] += support->vectors[9 * i + k] * support->vectors[9 * j + k];
            onto[9 * i + j] *= support->scale[i] / support->scale[j];
        }
    fl_multiply(onto, scatter, 9, 9, 9, half);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            scatter[9 * i + j] = 0;
            for (int k = 0; k < 9; k++) scatter[9 * i + j] += half[9 * i + k] * onto[9 * j + k];
        }
}

/* What a scatter of the gradient and the prior make of the covariance. */
static void scattered(const fl_fit *fit, real scatter[81], real covariance[81])
{
    const fl_posterior *at = &fit->posterior;
    real half[81];
    if (!at->support.is_whole) project(&at->support, scatter);
    for (int i = 0; i < 81; i++) scatter[i] = scatter[i] / (at->variance * at->variance) + at->prior_matrix[i];
    fl_multiply(fit->covariance, scatter, 9, 9, 9, half);
    fl_multiply(half, fit->covariance, 9, 9, 9, covariance);
}

/* Move a fit by the step of generalised least squares, where that leaves a surface. */
static void move(fl_fit *fit, const real step[9])
{
    fl_surface surface;
    real centre[3], shape[6];
    for (int i = 0; i < 3; i++) centre[i] = fit->surface.centre[i] + step[i];
    for (int i = 0; i < 6; i++) shape[i] = fit->surface.shape[i] + step[3 + i];
    if (!fl_surface_of(centre, shape, &surface)) fit->surface = surface, fit->has_distances = 0;
}

/* Whether residuals are so large that a step which takes them for small leads nowhere. */
static int are_large(const fl_fit *fit)
{
    const real largest = MAX_NOISE_SHARE * (fit->surface.shape[0] + fit->surface.shape[1] + fit->surface.shape[2]) / 3;
    return fit->posterior.variance > largest * largest;
}

/* Whether slow noise is searched and found, with the model of the fit and the rest of the covariance. For a level
 * turn only noise of the strength is used, as on a road; noise of the vector is swaying, which a turn averages out. */
static int is_slow_noise(const fl_kernels *kernels, const fl_view *view, const fl_residuals *residuals, fl_fit *fit,
                         const fl_room *room, int is_assumed, real step[9], real weighed[81], real explained[81])
{
    if (fit->unseen && is_assumed) return 0;
    const int is_none = fl_slow_noise(kernels, view, residuals, fit, room, is_assumed, &fit->slow, step, weighed, explained);
    if (!is_none && !(fit->unseen && fit->slow.is_vector)) return 1;
    memset(&fit->slow, 0, sizeof fit->slow);
    return 0;
}

/* Estimate and covariance for few readings: averages over possible durations of the noise, which these readings do
 * not determine. */
static void assume_slow_noise(const fl_kernels *kernels, const fl_view *view, const fl_residuals *residuals, fl_fit *fit,
                              const fl_room *room, flinders_record *record)
{
    real step[9], weighed[81], explained[81];
    const int is_slow = is_slow_noise(kernels, view, residuals, fit, room, 1, step, weighed, explained);
    memset(&fit->slow, 0, sizeof fit->slow); /* it is assumed, not found */
    if (!is_slow) return;
    fl_raise(weighed, record->covariance, 9, 0);
    memcpy(record->covariance, weighed, sizeof weighed);
    if (!are_large(fit)) move(fit, step);
}

/* Add correlated residuals to the covariance of a record. If there is slow noise, the fit is moved to its most
 * likely estimate, unless residuals are large; scatter that slow noise does not explain is added. A
 * direction-dependent distortion that is about as likely is claimed as well. */
static void add_correlation(const fl_kernels *kernels, const fl_view *view, fl_residuals *residuals, fl_fit *fit,
                            const fl_room *room, flinders_record *record)
{
    real scatter[81], step[9], weighed[81], explained[81];
    if (fit->used >= MIN_AUTOCOVARIANCE_READINGS) scatter_of(kernels, residuals, fit, 0, room, scatter, record);
    if (fit->used < MIN_AUTOCOVARIANCE_READINGS || (record->is_white && fit->used < MIN_DURATION_READINGS)) {
        assume_slow_noise(kernels, view, residuals, fit, room, record);
        return;
    }
    if (record->is_white) return;
    record->steps_kurtosis = fl_steps_kurtosis(residuals);
    int is_slow = is_slow_noise(kernels, view, residuals, fit, room, 0, step, weighed, explained);
    real known = 0;
    if (is_slow && record->distortion == 0)
        known = fl_likely_distortion(residuals, &fit->surface, has_copies(record), 3 * (size_t)record->lags,
                                     fit->slow.gain, room);
    if (known > 0) {
        gather_stretches(kernels, view, fit, room, residuals);
        scatter_of(kernels, residuals, fit, known, room, scatter, record);
        is_slow = is_slow_noise(kernels, view, residuals, fit, room, 0, step, weighed, explained);
    }
    scattered(fit, scatter, record->covariance);
    if (!is_slow) return;
    record->noise_lasts = fit->slow.lasts;
    fl_raise(record->covariance, explained, 9, 0);
    if (are_large(fit)) return;
    for (int i = 0; i < 81; i++) record->covariance[i] += weighed[i] - explained[i];
    move(fit, step);
}

/* Add the variation of the field with the place to the covariance of a record. It depends on the attitude, so that
 * offset and soft iron absorb it if readings come from few directions, or if there is a disturbance of the strength. */
static void add_variation(const fl_residuals *residuals, const fl_fit *fit, real expected, flinders_record *record)
{
    const real found = fit->unseen || fit->slow.gain < MIN_SLOW_GAIN_BITS ? 0 : fit->slow.strength, hidden = MAX_HIDDEN_VARIANCE_RATIO * expected;
    const real variance = hidden > found ? hidden : found;
    real scatter[81] = {0}, half[81], added[81];
    if (!(variance > 0)) return;
    fl_scatter_of_variation(residuals, variance, fit->used, scatter);
    if (!fit->posterior.support.is_whole) project(&fit->posterior.support, scatter);
    fl_multiply(fit->covariance, scatter, 9, 9, 9, half);
    fl_multiply(half, fit->covariance, 9, 9, 9, added);
    for (int i = 0; i < 81; i++)
        record->covariance[i] += added[i] / (fit->posterior.variance * fit->posterior.variance);
}

/* The covariance of a record: of the fit, with what correlated residuals and a field that varies with the place add to it. */
void fl_covariance(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, fl_fit *fit,
                   const fl_room *room, flinders_record *record)
{
    fl_residuals residuals;
    memcpy(record->covariance, fit->covariance, sizeof record->covariance);
    memset(&fit->slow, 0, sizeof fit->slow);
    record->noise_lasts = FL_NOT_A_NUMBER;
    if (fit->used < MIN_NOISE_READINGS) return;
    gather_stretches(kernels, view, fit, room, &residuals);
    const real expected = fl_is_informed(options) ? 0 : fl_expected_variation(&residuals, &fit->surface, room);
    add_correlation(kernels, view, &residuals, fit, room, record);
    add_variation(&residuals, fit, expected, record);
}
