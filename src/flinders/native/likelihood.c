/* Maximum likelihood: Gauss-Newton on the Sampson distance, corrected for the curvature of the surface.
 *
 * P. D. Sampson, CGIP 18 (1982); the same minimum as flinders.estimators.likelihood, which says why each step is taken.
 */
#include "internal.h"

enum { HALVINGS = 30, PASSES = 3, AXIS_LANES = 12 /* of three axes */ };

#define MAX_NEAR_STEP_SIGMAS ((real)3) /* largest step, in standard deviations, that is near the end */
#define MAX_STEP_SHARE ((real)0.3) /* largest step, of the radius */
#define MIN_STEP_SHARE ((real)1e-10) /* of the radius: shorter steps are not taken */
#define MIN_LAST_STEP_SHARE ((real)1e-5) /* of the radius: after a shorter step there is at most one more */
#define MIN_GAIN_SHARE ((real)1e-3) /* relative gain in χ²: a step that gains less is the last, */
#define MAX_OMITTED_SIGMAS ((real)0.02) /* if its terms of second order are at most so many standard deviations */
#define MAX_COST_INCREASE ((real)0.01) /* largest increase of χ² by a step */
#define MIN_AXIS_RATIO ((real)1e-4) /* smallest ratio of the shortest to the longest semi-axis */
#define PLAUSIBLE_SPREADS ((real)10) /* 1 sigma of centre and size, in spreads of the readings */
#define MIN_PRIOR_SHARE ((real)1e-3) /* smallest upper bound of the prior's share at which the share is computed */

/* What every step looks at. */
typedef struct {
    const fl_kernels *kernels;
    const flinders_options *options;
    fl_view some;    /* readings that the fit is iterated on */
    size_t count;    /* how many these are */
    real middle[3];  /* their mean */
    real spread;     /* root mean square distance from it */
} problem;

/* Whether a surface is closed, and not flatter than any sensor makes it. */
static int is_closed(const fl_surface *surface)
{
    real axes[3];
    fl_sym3_values(surface->shape, axes);
    return axes[0] > MIN_AXIS_RATIO * axes[2];
}

/* Move a surface by a step; nonzero if it is no longer closed. */
static int moved(const fl_surface *surface, const real step[9], fl_surface *out)
{
    real centre[3], shape[6];
    for (int i = 0; i < 3; i++) centre[i] = surface->centre[i] + step[i];
    for (int i = 0; i < 6; i++) shape[i] = surface->shape[i] + step[3 + i];
    return fl_surface_of(centre, shape, out) || !is_closed(out);
}

/* Add residuals r with Jacobian rows to normal equations. */
static void add_row(const real row[9], real residual, real matrix[81], real gradient[9], real *cost)
{
    for (int i = 0; i < 9; i++) {
        gradient[i] += row[i] * residual;
        for (int j = 0; j < 9; j++) matrix[9 * i + j] += row[i] * row[j];
    }
    *cost += residual * residual;
}

/* The shape is close to a sphere: |dev(S)/R|² / (2 spread²). */
static void add_prior(const fl_surface *surface, real spread, real matrix[81], real gradient[9], real *cost)
{
    const real trace = surface->shape[0] + surface->shape[1] + surface->shape[2];
    const real scale = fl_sqrt((real)2) * spread * trace / 3;
    for (int entry = 0; entry < 6; entry++) {
        real row[9] = {0};
        const real factor = entry < 3 ? 1 : fl_sqrt((real)2);
        const real residual = factor * (surface->shape[entry] - (entry < 3 ? trace / 3 : 0)) / scale;
        for (int i = 0; i < 3; i++)
            row[3 + i] = residual / trace - (entry < 3 ? ((i == entry) - (real)1 / 3) / scale : 0);
        if (entry >= 3) row[3 + entry] = -factor / scale;
        add_row(row, residual, matrix, gradient, cost);
    }
}

/* Centre and size stay within ten spreads of the readings: it matters only where no reading speaks. */
static void add_sense(const problem *task, const fl_surface *surface, real matrix[81], real gradient[9], real *cost)
{
    const real width = PLAUSIBLE_SPREADS * task->spread;
    for (int i = 0; i < 3; i++) {
        real row[9] = {0};
        row[i] = -1 / width;
        add_row(row, (surface->centre[i] - task->middle[i]) / width, matrix, gradient, cost);
    }
    real row[9] = {0};
    const real size = (surface->shape[0] + surface->shape[1] + surface->shape[2]) / 3;
    for (int i = 3; i < 6; i++) row[i] = -1 / (3 * width);
    add_row(row, (size - task->spread) / width, matrix, gradient, cost);
}

/* The parameters are normally distributed. */
void fl_add_known(const real expected[9], const real information[81], const fl_surface *surface, real matrix[81],
                  real gradient[9], real *cost)
{
    real left[9], pull[9];
    for (int i = 0; i < 3; i++) left[i] = expected[i] - surface->centre[i];
    for (int i = 0; i < 6; i++) left[3 + i] = expected[3 + i] - surface->shape[i];
    fl_multiply(information, left, 9, 9, 1, pull);
    for (int i = 0; i < 9; i++) gradient[i] += pull[i], *cost += pull[i] * left[i];
    for (int i = 0; i < 81; i++) matrix[i] += information[i];
}

/* Whether a prior limits undetermined parameters. */
static int is_held(const flinders_options *options) { return fl_is_informed(options) || options->prior > 0; }

/* Add the prior, if there is one. */
static void add_belief(const problem *task, const fl_surface *surface, real matrix[81], real gradient[9], real *cost)
{
    const flinders_options *const options = task->options;
    if (!is_held(options)) return;
#ifdef FLINDERS_SMALL
    if (options->known)
        options->known->add(options->known->expected, options->known->information, surface, matrix, gradient, cost);
#else
    if (options->is_informed) fl_add_known(options->expected, options->information, surface, matrix, gradient, cost);
#endif
    else add_prior(surface, options->prior, matrix, gradient, cost);
    add_sense(task, surface, matrix, gradient, cost);
}

/* χ² of readings and prior at a surface, in a variance. */
FL_APART static real cost_at(const problem *task, const fl_surface *surface, real variance)
{
    real matrix[81] = {0}, gradient[9] = {0}, believed = 0;
    add_belief(task, surface, matrix, gradient, &believed);
    return task->kernels->cost(&task->some, surface) / variance + believed;
}

#ifdef FLINDERS_SMALL /* no room for it */
/* Keep the cost of the prior at a surface. */
FL_APART static void keep_prior(const problem *task, fl_posterior *at)
{
    real matrix[81] = {0}, gradient[9] = {0};
    at->prior_cost = 0;
    add_belief(task, &at->surface, matrix, gradient, &at->prior_cost);
}

/* Add the prior to normal equations. */
static void add_kept_prior(const problem *task, const fl_posterior *at, real matrix[81], real gradient[9])
{
    real cost = 0;
    add_belief(task, &at->surface, matrix, gradient, &cost);
}
#else
/* Keep the prior at a surface. */
static void keep_prior(const problem *task, fl_posterior *at)
{
    memset(at->prior_matrix, 0, sizeof at->prior_matrix);
    memset(at->prior_gradient, 0, sizeof at->prior_gradient);
    at->prior_cost = 0;
    add_belief(task, &at->surface, at->prior_matrix, at->prior_gradient, &at->prior_cost);
}

/* Add the prior to normal equations. */
static void add_kept_prior(const problem *task, const fl_posterior *at, real matrix[81], real gradient[9])
{
    (void)task;
    for (int i = 0; i < 81; i++) matrix[i] += at->prior_matrix[i];
    for (int i = 0; i < 9; i++) gradient[i] += at->prior_gradient[i];
}
#endif

/* Linearize the likelihood and the prior at a surface. */
FL_APART static void linearize(const problem *task, const fl_view *view, const fl_surface *surface, int sound, fl_posterior *at)
{
    real sums[55];
    at->surface = *surface;
    at->count = task->kernels->products(view, surface, !task->options->bias_correction, sums);
    for (int a = 0, sum = 0; a < 10; a++)
        for (int b = a; b < 10; b++, sum++) {
            if (b < 9) at->matrix[9 * a + b] = at->matrix[9 * b + a] = sums[sum];
            else if (a < 9) at->gradient[a] = sums[sum];
            else at->cost = sums[sum];
        }
    keep_prior(task, at);
    const real freedom = at->count > 10 ? (real)at->count - 9 : 1;
    at->noise = fl_sqrt((at->cost > 0 ? at->cost : 0) / freedom);
    const real least = FL_FINEST * surface->radius;
    at->variance = at->noise > least ? at->noise * at->noise : least * least;
    at->has_support = 0;
    at->sound = sound;
}

typedef struct {
    const problem *task;
    const fl_posterior *at;
} scattered;

/* Spurious information for a noise variance of 1, from some of the readings. */
static void spurious(void *context, size_t most, real *matrix)
{
    const scattered *from = context;
    fl_view some = from->task->some;
    real sums[45];
    some.stride *= from->task->count / most > 1 ? from->task->count / most : 1;
    const size_t points = from->task->kernels->spurious(&some, &from->at->surface, sums);
    const real share = (real)from->at->count / (real)(points ? points : 1);
    for (int i = 0, sum = 0; i < 9; i++)
        for (int j = 0; j <= i; j++, sum++) matrix[9 * j + i] = matrix[9 * i + j] = sums[sum] * share;
}

/* Directions that the readings determine, computed once. */
FL_APART static const fl_support *support_at(const problem *task, fl_posterior *at)
{
    if (!at->has_support) {
        real weighed[81];
        scattered context = {task, at};
        for (int i = 0; i < 81; i++) weighed[i] = at->matrix[i] / at->variance;
        fl_support_of(weighed, 9, spurious, &context, &at->support);
        at->has_support = 1;
    }
    return &at->support;
}

/* Solve normal equations; nonzero where they leave a direction open. */
FL_APART static int solve_scaled(const real matrix[81], const real gradient[9], real step[9])
{
    real scale[9], scaled[81], largest = 0;
    for (int i = 0; i < 9; i++) largest = matrix[10 * i] > largest ? matrix[10 * i] : largest;
    const real least = FL_ROUNDING * largest > FL_TINY ? FL_ROUNDING * largest : FL_TINY;
    for (int i = 0; i < 9; i++) scale[i] = fl_sqrt(matrix[10 * i] > least ? matrix[10 * i] : least);
    for (int i = 0; i < 9; i++) {
        step[i] = gradient[i] / scale[i];
        for (int j = 0; j < 9; j++) scaled[9 * i + j] = matrix[9 * i + j] / (scale[i] * scale[j]);
    }
    if (fl_solve(scaled, 9, step)) return 1;
    for (int i = 0; i < 9; i++) step[i] /= scale[i];
    return 0;
}

/* Solve the equations of readings and prior, with `less` subtracted from the gradient of the readings. */
FL_APART static void solve_with(const problem *task, const fl_posterior *at, const fl_support *support, const real *less,
                                real step[9])
{
    real matrix[81], gradient[9];
    for (int i = 0; i < 81; i++) matrix[i] = at->matrix[i] / at->variance;
    for (int i = 0; i < 9; i++) gradient[i] = at->gradient[i] / at->variance - (less ? less[i] : 0);
    if (support) fl_support_keep(support, matrix, gradient);
    add_kept_prior(task, at, matrix, gradient);
    if (!solve_scaled(matrix, gradient, step)) return;
    fl_inverse(matrix, 9, matrix);
    fl_multiply(matrix, gradient, 9, 9, 1, step);
}

/* The same in the directions that readings observe. */
static void solve(const problem *task, fl_posterior *at, const real *less, real step[9])
{
    solve_with(task, at, at->sound ? NULL : support_at(task, at), less, step);
}

/* Take the longest of a step, its half, its quarter ... that does not increase the cost; zero if there is none. If
 * the step before had to be halved, the cost is computed before the equations; also if `tried` is `now`, to save
 * memory. */
static int improve(const problem *task, fl_posterior *now, int *was_halved, real step[9], fl_posterior *tried)
{
    const int sound = now->sound || support_at(task, now)->is_whole;
    const int unseen = fl_support_unseen(support_at(task, now));
    const real variance = now->variance, most = now->cost / variance + now->prior_cost + MAX_COST_INCREASE;
    const int is_first = !*was_halved && tried != now;
    fl_surface surface;
    for (int halving = 0; halving < HALVINGS; halving++) {
        const int is_closed_there = !moved(&now->surface, step, &surface);
        const int is_any = !sound && unseen; /* their cost is noise */
        if (is_closed_there && (is_any || (halving == 0 && is_first) || cost_at(task, &surface, variance) <= most)) {
            linearize(task, &task->some, &surface, sound, tried);
            *was_halved = halving > 0;
            if (is_any || tried == now || tried->cost / variance + tried->prior_cost <= most) return 1;
        }
        for (int i = 0; i < 9; i++) step[i] /= 2;
    }
    return 0;
}

/* Whether a step as short as this may be the last: its gain is small, and its terms of second order are small
 * compared with the smallest standard deviation. */
static int is_last(const problem *task, fl_posterior *now, const real step[9], real largest)
{
    const real least = now->noise / fl_sqrt((real)now->count);
    real gain = 0;
    if (!(largest > MIN_LAST_STEP_SHARE)) return 1;
    if (!(largest * (largest * now->surface.radius + now->noise) <= MAX_OMITTED_SIGMAS * least)) return 0;
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) gain += step[i] * now->matrix[9 * i + j] * step[j];
    return gain <= MIN_GAIN_SHARE * now->cost && support_at(task, now)->is_whole;
}

/* Iterate until steps vanish or none makes the fit better; counts the steps. The corrected equation is solved by one more
 * step anyway. */
FL_APART static int settle(const problem *task, int most_steps, fl_posterior *now)
{
#ifdef FLINDERS_SMALL
    fl_posterior *const tried = now;
#else
    fl_posterior other, *const tried = &other;
#endif
    real step[9];
    int steps = 0, was_halved = 0;
    for (; steps < most_steps; steps++) {
        real largest = 0;
        solve(task, now, NULL, step);
        for (int i = 0; i < 9; i++) largest = fl_abs(step[i]) > largest ? fl_abs(step[i]) : largest;
        largest /= now->surface.radius;
        if (!isfinite(largest) || (task->options->bias_correction ? is_last(task, now, step, largest) : !(largest > MIN_STEP_SHARE))) break;
        for (int i = 0; i < 9 && largest > MAX_STEP_SHARE; i++) step[i] *= MAX_STEP_SHARE / largest;
        if (!improve(task, now, &was_halved, step, tried)) break;
        *now = *tried;
    }
    return steps;
}

/* Covariance for independent residuals, without directions that are not observed. */
FL_APART static void covariance_with(const problem *task, const fl_posterior *at, const fl_support *support,
                                     real covariance[81])
{
    real information[81], weighed[81], gradient[9] = {0};
    for (int i = 0; i < 81; i++) information[i] = weighed[i] = at->matrix[i] / at->variance;
    if (task->options->bias_correction) fl_support_information(support, weighed, information);
    else fl_support_keep(support, information, gradient);
    add_kept_prior(task, at, information, gradient);
    fl_inverse(information, 9, covariance);
}

/* The same of the directions that readings observe. */
static void covariance_at(const problem *task, fl_posterior *at, real covariance[81])
{
    covariance_with(task, at, support_at(task, at), covariance);
}

/* Whether the terms of second order of a step are small compared with the uncertainty. */
static int is_small(const real step[9], const real covariance[81], real radius)
{
    for (int i = 0; i < 9; i++)
        if (!(step[i] * step[i] / radius <= (real)0.05 * fl_sqrt(covariance[10 * i]))) return 0;
    return 1;
}

/* Whether a step is within the uncertainty, so that residuals before it are those after it. */
static int is_near(const real step[9], const real covariance[81], real radius)
{
    for (int i = 0; i < 9; i++)
        if (!(step[i] * step[i] <= MAX_NEAR_STEP_SIGMAS * MAX_NEAR_STEP_SIGMAS * covariance[10 * i])) return 0;
    return is_small(step, covariance, radius);
}

/* Largest share of the prior in the information on any combination of parameters; a known shape does not count as
 * prior. */
FL_APART static real prior_share(const problem *task, const fl_surface *surface, const real covariance[81])
{
    real prior[81] = {0}, gradient[9] = {0}, cost = 0, vectors[81], values[9], half[81], product[81], shares[9];
    real at_most = 0;
    if (fl_is_informed(task->options) || !(task->options->prior > 0)) return 0;
    add_prior(surface, task->options->prior, prior, gradient, &cost);
    for (int i = 0; i < 81; i++) at_most += covariance[i] * prior[i];
    if (!(at_most >= MIN_PRIOR_SHARE)) return at_most;
    memcpy(vectors, covariance, sizeof vectors);
    fl_eigen(vectors, 9, values);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) half[9 * i + j] = vectors[9 * i + j] * fl_sqrt(values[j] > 0 ? values[j] : 0);
    fl_multiply(prior, half, 9, 9, 9, product);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            vectors[9 * i + j] = 0;
            for (int k = 0; k < 9; k++) vectors[9 * i + j] += half[9 * k + i] * product[9 * k + j];
        }
    fl_eigen(vectors, 9, shares);
    return shares[8] < 0 ? 0 : shares[8] > 1 ? 1 : shares[8];
}

/* Copy readings of a view one behind the other, where they are not so already and there is room for a copy. */
static fl_view compact(const fl_view *view, real *copy)
{
    fl_view some = {copy, 0, NULL, 1};
    size_t free = 0;
    if (!copy || (!view->rejected && view->stride == 1)) return *view;
    for (size_t row = 0; row < view->rows; row += view->rejected ? 1 : view->stride) {
        if (view->rejected && (view->rejected[row] || free++ % view->stride)) continue;
        memcpy(copy + 3 * some.rows++, view->field + 3 * row, 3 * sizeof(real));
    }
    return some;
}

/* Add readings less a point, and their squares, to sums of four readings side by side. */
static void add_about(const fl_view *view, const real point[3], real sums[AXIS_LANES], real squares[AXIS_LANES])
{
    real about[AXIS_LANES];
    size_t row = 0;
    for (int lane = 0; lane < AXIS_LANES; lane++) about[lane] = point[lane % 3];
    for (; !view->rejected && row + AXIS_LANES / 3 <= view->rows; row += AXIS_LANES / 3)
        for (int lane = 0; lane < AXIS_LANES; lane++) {
            const real off = view->field[3 * row + lane] - about[lane];
            sums[lane] += off, squares[lane] += off * off;
        }
    for (size_t lane = 0; row < view->rows; row++) {
        if (view->rejected && view->rejected[row]) continue;
        for (int axis = 0; axis < 3; axis++, lane = (lane + 1) % AXIS_LANES) {
            const real off = view->field[3 * row + axis] - point[axis];
            sums[lane] += off, squares[lane] += off * off;
        }
    }
}

/* Prepare the part of the readings on which the fit is iterated; returns whether it is not all of them. */
static int prepare(const fl_kernels *kernels, const fl_view *view, const flinders_options *options,
                   const fl_surface *start, real *copy, problem *task, int *is_part)
{
    fl_view some = {view->field, view->rows, view->rejected, 1};
    const size_t free = fl_view_count(&some);
    const size_t stride = free > FL_ENOUGH ? (free + FL_SOME - 1) / FL_SOME : 1;
    real sums[AXIS_LANES] = {0}, squares[AXIS_LANES] = {0};
    memset(task, 0, sizeof *task);
    some.stride = stride;
    *is_part = stride > 1;
    task->kernels = kernels, task->options = options, task->some = compact(&some, copy);
    task->count = fl_view_count(&task->some);
    if (!task->count) return 1;
    add_about(&task->some, start->centre, sums, squares);
    for (int axis = 0; axis < 3; axis++) {
        real sum = 0, square = 0;
        for (int lane = axis; lane < AXIS_LANES; lane += 3) sum += sums[lane], square += squares[lane];
        const real mean = sum / (real)task->count, variance = square / (real)task->count - mean * mean;
        task->spread += variance > 0 ? variance : 0;
        task->middle[axis] = start->centre[axis] + mean;
    }
    task->spread = fl_sqrt(task->spread);
    return !(task->spread > 0);
}

/* The last step, corrected for curvature where that is asked for, as much of it as leaves the surface closed; nonzero
 * if hardly any does. */
static int last_step(const problem *task, fl_posterior *now, real step[9], fl_surface *surface)
{
    real bent[9];
    const int is_corrected = task->options->bias_correction;
    if (is_corrected) task->kernels->curvature(&task->some, &now->surface, bent);
    for (int i = 0; i < 9 && is_corrected; i++)
        bent[i] *= (real)now->count / (real)task->count; /* times the noise variance, over the variance of the weights */
    solve(task, now, is_corrected ? bent : NULL, step);
    for (int halving = 0; halving < HALVINGS; halving++) {
        if (!moved(&now->surface, step, surface)) return 0;
        for (int i = 0; i < 9; i++) step[i] /= 2;
    }
    return 1;
}

/* A last step by all readings of a view, from where others left the surface, and its covariance; nonzero if there is
 * none. */
static int step_by_all(const problem *task, const fl_view *all, fl_fit *fit, real step[9], fl_surface *surface)
{
    linearize(task, all, surface, 0, &fit->posterior);
    if (last_step(task, &fit->posterior, step, surface)) return 1;
    covariance_at(task, &fit->posterior, fit->covariance);
    return 0;
}

/* Fit the readings of a view from a start; `fit` is filled where FLINDERS_OK is returned. Many readings mostly make a start
 * so good that one step is enough; else a part of them is iterated on first. */
int fl_polish(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, const fl_surface *start,
              int most_steps, real *copy, fl_fit *fit)
{
    problem task;
    fl_surface surface = *start;
    fl_posterior *now = &fit->posterior;
    const fl_view every = {view->field, view->rows, view->rejected, 1};
    real step[9];
    int is_long;
    if (prepare(kernels, view, options, start, copy, &task, &is_long)) return FLINDERS_NOT_AN_ELLIPSOID;
    fit->steps = 0;
    if (!is_long || step_by_all(&task, &every, fit, step, &surface) || !is_near(step, fit->covariance, surface.radius)) {
        linearize(&task, &task.some, start, 0, now);
        fit->steps = settle(&task, most_steps, now);
        surface = now->surface;
        for (int pass = 0; pass < (is_long ? PASSES : 1); pass++) {
            if (is_long) linearize(&task, &every, &surface, 0, now);
            if (last_step(&task, now, step, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
            covariance_at(&task, now, fit->covariance);
            if (is_small(step, fit->covariance, surface.radius)) break;
        }
    }
    fit->surface = surface;
    fit->noise = now->noise;
    fit->used = now->count;
    fit->unseen = fl_is_informed(options) ? 0 : fl_support_unseen(support_at(&task, now));
    fit->held = prior_share(&task, &now->surface, fit->covariance);
    for (int i = 0; i < 3; i++)
        if (!isfinite(surface.centre[i])) return FLINDERS_NOT_AN_ELLIPSOID;
    return fit->unseen && !(options->prior > 0) ? FLINDERS_UNDETERMINED : FLINDERS_OK;
}
