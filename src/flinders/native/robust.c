/* Readings that do not belong: a start that they cannot bend, and their rejection.
 *
 * P. J. Rousseeuw, "Least median of squares regression", J. Am. Stat. Assoc. 79 (1984); flinders.estimators.robust says
 * why each number is what it is.
 */
#include "random.h"
#include "record.h"

enum { SUBSET_READINGS = 12, ELLIPSE_SUBSET_READINGS = 7, FEW_DRAWS = 24, ROUNDS = 12, MAX_CELL_READINGS = 4,
       MIN_INLIERS = 12, MIN_JUDGED_READINGS = 40, OTHER_DRAWS = 8 };

#ifdef FLINDERS_SMALL
enum { DRAWS = 64, SCORED_READINGS = 100, FEW_SCORED_READINGS = 100 };
#else
enum { DRAWS = 256, SCORED_READINGS = 600, FEW_SCORED_READINGS = 150 };
#endif

#define TO_SIGMA ((real)1.4826)
#define MAX_INLIER_SIGMAS ((real)4)
#define MIN_CERTAIN_LIMITS ((real)2.5) /* distance of a certain outlier in limits, which is ten standard deviations */
#define MAX_LIMIT_CHANGE ((real)1e-4)
#define MIN_CURVED_VARIANCE_RATIO ((real)1e-6) /* variance across over that along, of an arc of two degrees: less is a line */
#define MIN_LASTING_CORRELATION ((real)0.5) /* smallest correlation of a residual with the next if noise lasts */
#define MAX_SUBSET_SIGMA_RATIO ((real)0.95) /* ratio to the standard deviation of all residuals of the best of many subsets below which outliers are searched */

/* Keep only a few readings of each cell in a sample; returns its size. Without a table of cells all are kept. */
static size_t spread_out(const fl_kernels *kernels, const real *field, size_t rows, size_t most, fl_random *random,
                         const fl_room *room)
{
    uint64_t keys[FL_BLOCK];
    uint32_t *const slots = room->order + (rows < FL_ENOUGH ? rows : FL_ENOUGH);
    const size_t stride = (rows + most - 1) / most > 1 ? (rows + most - 1) / most : 1;
    const size_t n = (rows + stride - 1) / stride;
    const int are_all = stride == 1 && !(room->fullest > MAX_CELL_READINGS);
    size_t taken = 0;
    memset(room->passed, !are_all && room->slots > 0, rows);
    random->skipped = are_all && room->slots > 0 ? (uint32_t)n : 0;
    if (are_all || !room->slots) return rows;
    memset(room->counters, 0, room->slots);
    for (size_t i = 0; i < n; i++) {
        const size_t within = i % FL_BLOCK;
        if (within == 0)
            kernels->keys(field + 3 * stride * i, n - i < FL_BLOCK ? n - i : FL_BLOCK, stride, room->side, keys);
        slots[i] = (uint32_t)fl_slot(room->keys, room->slots, keys[within]);
    }
    fl_random_permutation(random, (uint32_t)n, room->order);
    for (size_t i = 0; i < n; i++) {
        const size_t row = room->order[i] * stride;
        unsigned char *count = room->counters + slots[room->order[i]];
        if (*count >= MAX_CELL_READINGS) continue;
        *count += 1;
        room->passed[row] = 0;
        taken++;
    }
    return taken;
}

/* Standard deviation of n distances, from the median of their sizes; nine parameters were fitted to them. */
static real sigma_of(real median, size_t n)
{
    const real freedom = (real)(n > 10 ? n - 9 : 1) / (real)n;
    return TO_SIGMA * median / fl_sqrt(freedom);
}

/* The same from n absolute distances, which are put into another order. */
static real typical(real *distances, size_t n) { return sigma_of(fl_median(distances, n), n); }

/* Absolute distances of a view, into the room; returns their number. */
static size_t absolute(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real *out)
{
    const size_t n = fl_view_count(view);
    kernels->distances(view, surface, out);
    for (size_t i = 0; i < n; i++) out[i] = fl_abs(out[i]);
    return n;
}

/* Unknowns of a quadric with tr Q = 3, or of a conic with tr Q = 2 through readings laid flat, and their coefficients at a
 * reading x, whose square the others have to add up to. */
static int coefficients_at(const real x[3], int is_flat, real row[9])
{
#ifndef FLINDERS_SMALL /* a board fits no level turn */
    if (is_flat) {
        const real flat[5] = {x[0] * x[0] - x[1] * x[1], 2 * x[0] * x[1], x[0], x[1], 1};
        memcpy(row, flat, sizeof flat);
        return 5;
    }
#endif
    const real full[9] = {x[0] * x[0] - x[2] * x[2], x[1] * x[1] - x[2] * x[2], 2 * x[0] * x[1], 2 * x[0] * x[2],
                          2 * x[1] * x[2], x[0], x[1], x[2], 1};
    (void)is_flat;
    memcpy(row, full, sizeof full);
    return 9;
}

/* Quadric through points in the least-squares sense, pulled a little towards the sphere; through points laid flat one whose
 * equator is their conic. */
FL_APART static int quadric_of(const real *points, const uint32_t *chosen, int count, int is_flat, real quadric[10])
{
    real normal[81] = {0}, right[9] = {0}, row[9], trace = 0;
    int n = 0;
    for (int k = 0; k < count; k++) {
        const real *const x = points + 3 * chosen[k];
        n = coefficients_at(x, is_flat, row);
        for (int i = 0; i < n; i++) {
            right[i] -= row[i] * (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
            for (int j = 0; j <= i; j++) normal[n * i + j] += row[i] * row[j];
        }
    }
    for (int i = 0; i < n; i++) trace += normal[(n + 1) * i] += i < (is_flat ? 2 : 5) ? (real)1e-3 : (real)1e-9;
    for (int i = 0; i < n; i++) normal[(n + 1) * i] += FL_ROUNDING * trace;
    if (fl_solve(normal, n, right)) return 1;
    if (is_flat) {
        const real of_equator[10] = {1 + right[0], 1 - right[0], 1, right[1], 0, 0, right[2], right[3], 0, right[4]};
        memcpy(quadric, of_equator, sizeof of_equator);
        return 0;
    }
    quadric[0] = 1 + right[0], quadric[1] = 1 + right[1], quadric[2] = 1 - right[0] - right[1];
    memcpy(quadric + 3, right + 2, 7 * sizeof(real));
    return 0;
}

/* The readings of a view, or `most` of them at random, relative to their median and in units of their median
 * distance; counts them, 0 if all are equal. */
FL_APART static size_t standardised(const fl_view *view, size_t n, size_t most, fl_random *random, const fl_room *room,
                           real *local, real middle[3], real *scale)
{
    const size_t chosen = n < most ? n : most;
    uint32_t *const places = room->order, *const rows = places + n;
    real column[SCORED_READINGS];
    for (size_t row = 0, place = 0; row < view->rows; row++)
        if (!view->rejected[row]) places[place] = (uint32_t)place, rows[place++] = (uint32_t)row;
    if (n > most) fl_random_choice(random, (uint32_t)n, (uint32_t)most, places);
    for (size_t i = 0; i < chosen; i++) memcpy(local + 3 * i, view->field + 3 * (size_t)rows[places[i]], 3 * sizeof(real));
    for (int axis = 0; axis < 3; axis++) {
        for (size_t i = 0; i < chosen; i++) column[i] = local[3 * i + axis];
        middle[axis] = fl_median(column, chosen);
    }
    for (size_t i = 0; i < chosen; i++) {
        column[i] = 0;
        for (int axis = 0; axis < 3; axis++) {
            local[3 * i + axis] -= middle[axis];
            column[i] += local[3 * i + axis] * local[3 * i + axis];
        }
        column[i] = fl_sqrt(column[i]);
    }
    *scale = fl_median(column, chosen);
    if (!(*scale > 0)) return 0;
    for (size_t i = 0; i < 3 * chosen; i++) local[i] /= *scale;
    return chosen;
}

/* Choose some of n at random, at most twelve: those of the smallest of n random numbers. */
FL_APART static void draw_points(fl_random *random, size_t n, uint32_t count, uint32_t chosen[SUBSET_READINGS])
{
    uint64_t smallest[SUBSET_READINGS + 1];
    uint32_t places[SUBSET_READINGS + 1];
    for (uint32_t i = 0; i < n; i++) {
        const uint64_t number = fl_random_bits(random) >> 11;
        uint32_t at = i < count ? i : count;
        if (i >= count && number >= smallest[count - 1]) continue;
        for (; at > 0 && smallest[at - 1] > number; at--) smallest[at] = smallest[at - 1], places[at] = places[at - 1];
        smallest[at] = number, places[at] = i;
    }
    memcpy(chosen, places, count * sizeof *chosen);
}

/* A circle about readings laid flat, of a short arc; nonzero where they are on a line. */
static int circle_about(const real *points, size_t n, const real middle[3], real radius, fl_surface *surface)
{
    const real shape[6] = {radius, radius, radius, 0, 0, 0};
    real mean[2] = {0, 0}, xx = 0, yy = 0, xy = 0;
    for (size_t i = 0; i < n; i++) mean[0] += points[3 * i] / (real)n, mean[1] += points[3 * i + 1] / (real)n;
    for (size_t i = 0; i < n; i++) {
        const real x = points[3 * i] - mean[0], y = points[3 * i + 1] - mean[1];
        xx += x * x, yy += y * y, xy += x * y;
    }
    const real half = (xx + yy) / 2, apart = fl_sqrt((xx - yy) * (xx - yy) / 4 + xy * xy);
    return half - apart <= MIN_CURVED_VARIANCE_RATIO * (half + apart) || fl_surface_of(middle, shape, surface);
}

/* Least median of squares: the best of many ellipsoids through twelve readings each, or of ellipses through seven of
 * readings laid flat; nonzero if there is none. */
static int subset_start(const fl_kernels *kernels, const fl_view *view, size_t n, int is_flat, fl_random *random, int draws,
                        size_t scored, const fl_room *room, fl_surface *surface)
{
    static const real ORIGIN[3] = {0, 0, 0};
#ifdef FLINDERS_SMALL
    real *const distances = room->scratch; /* which nobody needs here */
#else
    real distances[SCORED_READINGS];
#endif
    real local[3 * SCORED_READINGS], middle[3], scale, best = FL_HUGE, quadric[10], axes[3];
    uint32_t order[SUBSET_READINGS];
    fl_surface tried, winner;
    if (!is_flat && n < SUBSET_READINGS) return 1;
    fl_random_catch_up(random, room->order);
    const size_t chosen = standardised(view, n, scored, random, room, local, middle, &scale);
    const fl_view points = {local, chosen, NULL, 1};
    const int count = !is_flat ? SUBSET_READINGS : chosen < ELLIPSE_SUBSET_READINGS ? (int)chosen : ELLIPSE_SUBSET_READINGS;
    if (!chosen) return 1;
    for (int draw = 0; draw < draws; draw++) {
        draw_points(random, chosen, (uint32_t)count, order);
        if (quadric_of(local, order, count, is_flat, quadric) || fl_surface_of_quadric(quadric, ORIGIN, 1, &tried)) continue;
        fl_sym3_values(tried.shape, axes);
        if (!(axes[2] < 5 * axes[0])) continue;
        if (!kernels->has_closer(&points, &tried, best, is_flat ? (chosen + 1) / 2 : chosen / 2 + 1)) continue;
        absolute(kernels, &points, &tried, distances);
        const real median = is_flat ? fl_median(distances, chosen) : fl_select(distances, chosen, chosen / 2);
        if (is_flat && !(median < best)) continue;
        best = median;
        winner = tried;
    }
    if (!(best < FL_HUGE)) return is_flat ? circle_about(local, chosen, middle, scale, surface) : 1;
    for (int i = 0; i < 3; i++) winner.centre[i] = middle[i] + scale * winner.centre[i];
    for (int i = 0; i < 6; i++) winner.shape[i] *= scale;
    if (is_flat) winner.shape[2] = (winner.shape[0] + winner.shape[1]) / 2;
    return fl_surface_of(winner.centre, winner.shape, surface);
}

/* Correlation of the residual of each reading with the next. */
static real lag_one(const real *distances, size_t n)
{
    real square = 0, product = 0;
    for (size_t i = 0; i < n; i++) {
        square += distances[i] * distances[i];
        if (i > 0) product += distances[i] * distances[i - 1];
    }
    return product / (square > FL_TINY ? square : FL_TINY);
}

/* Whether a majority has clearly smaller residuals than a fit to all readings, as under a disturbance that switches. */
static int suspects_a_load(const fl_kernels *kernels, const fl_view *spread, size_t n, real sigma, const fl_room *room)
{
    fl_random random = fl_random_begin();
    fl_surface other;
    if (subset_start(kernels, spread, n, 0, &random, DRAWS, SCORED_READINGS, room, &other)) return 0;
    absolute(kernels, spread, &other, room->scratch);
    return typical(room->scratch, n) < MAX_SUBSET_SIGMA_RATIO * sigma ? FL_SUSPECTS : 0;
}

/* Absolute distances of the readings that are not left out of a sample, from those of all. */
static void sampled(const fl_room *room, size_t rows, real *out)
{
    size_t n = 0;
    for (size_t row = 0; row < rows; row++)
        if (!room->passed[row]) out[n++] = fl_abs(room->distances[row]);
}

/* The largest of distances, and the means of their squares and fourth powers. */
static void tails_of(const real *distances, size_t n, real *farthest, real *square, real *fourth)
{
    *farthest = *square = *fourth = 0;
    for (size_t i = 0; i < n; i++) {
        const real s = distances[i] * distances[i];
        *farthest = distances[i] > *farthest ? distances[i] : *farthest;
        *square += s;
        *fourth += s * s;
    }
    *square /= (real)n, *fourth /= (real)n;
}

/* Whether the residuals of a fit to all readings require a robust one; FL_SUSPECTS if that must be clearly better. */
int fl_asks_for_robust(const fl_kernels *kernels, const fl_view *view, fl_fit *fit, const fl_room *room)
{
    fl_random random = fl_random_begin();
    const size_t n = spread_out(kernels, view->field, view->rows, FL_SOME, &random, room);
    const fl_view spread = {view->field, view->rows, room->passed, 1};
    real farthest, square, fourth;
    kernels->distances(view, &fit->surface, room->distances);
    fit->has_distances = 1;
    const int lasts = lag_one(room->distances, view->rows) > MIN_LASTING_CORRELATION;
    sampled(room, view->rows, room->scratch);
    tails_of(room->scratch, n, &farthest, &square, &fourth);
    const real median = fl_median(room->scratch, n), sigma = sigma_of(median, n), error = fl_sqrt(24 / (real)n);
    fit->median_distance = n == view->rows ? median : 0;
    if (n < MIN_JUDGED_READINGS) return farthest > 20 * sigma;
    const real heavy = ((real)1.2 + 3 / fl_sqrt((real)n)) * sigma;
    if (square > heavy * heavy || farthest > (real)6.5 * sigma) return 1;
    const real kurtosis = fourth / (square * square > FL_TINY ? square * square : FL_TINY);
    const real peaked = 3 + 8 * error;
    if (kurtosis > (peaked > (real)4.5 ? peaked : (real)4.5)) return 1;
    const real quiet = (real)0.05 * fit->surface.radius;
    fl_surface other;
    if (fl_abs(kurtosis - 3) >= 2 * error || square >= quiet * quiet) {
        if (subset_start(kernels, &spread, n, 0, &random, FEW_DRAWS, FEW_SCORED_READINGS, room, &other)) return 0;
        absolute(kernels, &spread, &other, room->scratch);
        if (typical(room->scratch, n) < (real)0.75 * sigma) return 1;
    }
    return lasts ? suspects_a_load(kernels, &spread, n, sigma, room) : 0;
}

/* Which of n readings are farther than a limit. */
static void mark_far(const fl_room *room, size_t n, real limit)
{
    for (size_t i = 0; i < n; i++) room->far[i] = room->distances[i] > limit;
}

/* Whether the steps of a fit ended at a minimum that all readings support. */
static int is_at_minimum(const fl_fit *fit)
{
    return fit->used && fit->posterior.support.is_whole && fit->steps < FL_STEPS;
}

/* Reject the far readings, those of runs of them, and all but a part of the rest; counts how many change. */
static size_t reject(const fl_view *all, int dense, const fl_room *room)
{
    unsigned char *const in_run = (unsigned char *)room->scratch;
    size_t changes = 0;
    for (size_t begin = 0, part = 0; begin < all->rows; part++) {
        const size_t end = part < room->parts ? (size_t)room->ends[part] : all->rows;
        fl_mark_runs(room->far + begin, end - begin, dense, in_run + begin);
        begin = end;
    }
    for (size_t i = 0; i < all->rows; i++) {
        const unsigned char is_out = in_run[i] | room->far[i] | (all->stride > 1 && i % all->stride != 0);
        changes += room->rejected[i] != is_out;
        room->rejected[i] = is_out;
    }
    return changes;
}

/* Fit all readings (stride 1) or a part of them, but for those that are marked as far and runs of these. The fit stands
 * where it was made of the same readings. */
static int fit_near(const fl_kernels *kernels, const fl_view *all, const flinders_options *options, int dense,
                    const fl_room *room, fl_fit *fit)
{
    const int is_settled = is_at_minimum(fit);
    const fl_surface start = is_settled ? fit->posterior.surface : fit->surface; /* which curvature corrected */
    const fl_view near = {all->field, all->rows, room->rejected, 1};
    if (!reject(all, dense, room) && is_settled) return FLINDERS_OK;
    if (fl_view_count(&near) < MIN_INLIERS) return FLINDERS_NOT_AN_ELLIPSOID;
    return fl_polish(kernels, &near, options, &start, FL_STEPS, room->some, fit);
}

/* Mark the rejected readings that are outliers beyond doubt: single ones, and runs that reach far. Noise with a memory comes
 * in runs, and near steel it comes and goes: of such runs 82 to 91 % reach no farther than 2.5 limits, of passing magnets
 * 2 % (154, 95 and 61 runs: python -m benchmarks.claims --tables doubt). Needs the distances from the surface of the
 * majority. Tells whether others are left. */
static int certain_runs(const fl_room *room, size_t rows, real limit, unsigned char *certain)
{
    int others = 0;
    for (size_t begin = 0; begin < rows; begin++) {
        size_t end = begin;
        real farthest = 0;
        for (; end < rows && room->rejected[end]; end++)
            farthest = room->distances[end] > farthest ? room->distances[end] : farthest;
        const int is_certain = end == begin + 1 || farthest > MIN_CERTAIN_LIMITS * limit;
        memset(certain + begin, is_certain, end - begin);
        others |= end > begin && !is_certain;
        if (end < rows) certain[end] = 0;
        begin = end;
    }
    return others;
}

/* What a robust fit is made of: all readings, those of them that it is iterated on, and a sample with few of each cell. */
typedef struct {
    fl_view every, part, spread;
    size_t sampled;
} samples;

/* Fit the majority about a surface: reject far readings and fit the others, until the limit of rejection settles. */
static int fit_about(const fl_kernels *kernels, const samples *of, const flinders_options *options,
                     const fl_surface *start, const fl_room *room, fl_fit *fit, fl_majority *majority)
{
    const size_t rows = of->every.rows;
    real limit = 0;
    int dense = FLINDERS_NO_RUN;
    memset(fit, 0, sizeof *fit);
    fit->surface = *start;
    for (int round = 0; round < ROUNDS; round++) {
        const real before = limit, least = FL_FINEST * fit->surface.radius;
        absolute(kernels, &of->every, &fit->surface, room->distances);
        sampled(room, rows, room->scratch);
        const real sigma = typical(room->scratch, of->sampled);
        limit = MAX_INLIER_SIGMAS * (sigma > least ? sigma : least);
        mark_far(room, rows, limit);
        dense = of->part.stride == 1 ? flinders_dense(room->far, rows, rows, (unsigned char *)room->scratch) : FLINDERS_NO_RUN;
        const int status = fit_near(kernels, &of->part, options, dense, room, fit);
        if (status != FLINDERS_OK) return status;
        if (fl_abs(limit - before) <= MAX_LIMIT_CHANGE * limit) break;
    }
    const size_t looked = absolute(kernels, &of->part, &fit->surface, room->distances);
    mark_far(room, looked, limit);
    dense = flinders_dense(room->far, looked, rows, (unsigned char *)room->scratch);
    if (of->part.stride > 1) absolute(kernels, &of->every, &fit->surface, room->distances), mark_far(room, rows, limit);
    memcpy(majority->centre, fit->surface.centre, sizeof majority->centre);
    memcpy(majority->shape, fit->surface.shape, sizeof majority->shape);
    majority->dense = dense;
    majority->beyond = limit;
    return fit_near(kernels, &of->every, options, dense, room, fit);
}

#ifndef FLINDERS_SMALL /* a board has no room for another fit beside one, and claims nothing of it */
/* Whether the rejected runs have more information on some combination of parameters than the inliers. */
static int outweigh(const fl_kernels *kernels, const fl_view *every, const flinders_options *options, const fl_fit *fit,
                    int dense, const fl_room *room)
{
    unsigned char *const in_run = (unsigned char *)room->scratch;
    const fl_view runs = {every->field, every->rows, room->far, 1};
    real sums[55], difference[81];
    if (fit->unseen || !fl_mark_runs(room->far, every->rows, dense, in_run).all) return 0;
    for (size_t i = 0; i < every->rows; i++) room->far[i] = !in_run[i];
    kernels->products(&runs, &fit->posterior.surface, !options->bias_correction, sums);
    for (int i = 0, at = 0; i < 9; i++, at++)
        for (int j = i; j < 9; j++, at++)
            difference[9 * i + j] = difference[9 * j + i] = fit->posterior.matrix[9 * i + j] - sums[at];
    return fl_cholesky(difference, 9);
}

/* Scatter of other majorities, which other draws of subsets lead to, about the fit from a start, whose readings the room
 * then holds again. */
static void scatter_of_others(const fl_kernels *kernels, const samples *of, const flinders_options *options,
                              const fl_surface *first, fl_random *random, const fl_room *room, fl_fit *fit,
                              fl_majority *majority)
{
    fl_surface start;
    fl_fit other;
    real apart[9];
    for (int draw = 0; draw < OTHER_DRAWS; draw++) {
        if (subset_start(kernels, &of->spread, of->sampled, 0, random, DRAWS, SCORED_READINGS, room, &start)) continue;
        if (fit_about(kernels, of, options, &start, room, &other, majority) != FLINDERS_OK) continue;
        for (int i = 0; i < 3; i++) apart[i] = other.surface.centre[i] - fit->surface.centre[i];
        for (int i = 0; i < 6; i++) apart[3 + i] = other.surface.shape[i] - fit->surface.shape[i];
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) fit->others[9 * i + j] += apart[i] * apart[j] / OTHER_DRAWS;
    }
    fit_about(kernels, of, options, first, room, &other, majority);
}
#endif

/* The robust fit from a start, or NULL for that through a few readings; the view then leaves out what was rejected. Where
 * that outweighs what is left, draws of other subsets show whether the majority is one by chance. */
int fl_robust(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
              const fl_room *room, fl_fit *fit, fl_majority *majority)
{
    fl_random random = fl_random_begin();
    const size_t rows = view->rows, n = spread_out(kernels, view->field, rows, FL_ENOUGH, &random, room);
    const samples of = {{view->field, rows, NULL, 1},
                        {view->field, rows, NULL, (rows + FL_ENOUGH - 1) / FL_ENOUGH},
                        {view->field, rows, room->passed, 1},
                        n};
    fl_surface first;
    if (n < MIN_INLIERS) return FLINDERS_NOT_AN_ELLIPSOID;
    if (start) first = *start;
    else if (subset_start(kernels, &of.spread, n, 0, &random, DRAWS, SCORED_READINGS, room, &first)) return FLINDERS_NOT_AN_ELLIPSOID;
    const int status = fit_about(kernels, &of, options, &first, room, fit, majority);
    if (status != FLINDERS_OK) return status;
#ifndef FLINDERS_SMALL
    if (!start && outweigh(kernels, &of.every, options, fit, majority->dense, room))
        scatter_of_others(kernels, &of, options, &first, &random, room, fit, majority);
#endif
    view->rejected = room->rejected;
    majority->is_robust = 1;
    for (size_t i = 0; i < rows; i++) majority->rejected += room->rejected[i];
    fit->is_doubtful = certain_runs(room, rows, majority->beyond, room->far);
    return FLINDERS_OK;
}

#ifndef FLINDERS_SMALL
/* An ellipse to begin with through readings (rows, 3) laid flat, whose cells are in the table of a room; nonzero where half
 * of them are in one place, or all on a line. */
int fl_ellipse_start(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, fl_surface *surface)
{
    fl_random random = fl_random_begin();
    const size_t n = spread_out(kernels, field, rows, FL_ENOUGH, &random, room);
    const fl_view spread = {field, rows, room->passed, 1};
    return subset_start(kernels, &spread, n, 1, &random, DRAWS, SCORED_READINGS, room, surface);
}
#endif

/* All readings are inliers of the fit. */
void fl_forget_outliers(fl_view *view, fl_majority *majority)
{
    view->rejected = NULL;
    majority->is_robust = 0;
    majority->rejected = 0;
    majority->beyond = 0;
    majority->dense = FLINDERS_NO_RUN;
}
