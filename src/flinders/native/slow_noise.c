/* Slow noise of the vector: white noise beside a disturbance with a memory, and what the two leave of a fit.
 *
 * The disturbance is an Ornstein-Uhlenbeck process, either of the vector in the sensor's axes or of the field's strength
 * (as of a hand that moves through a gradient). As the sensor turns, what residuals of the first kind have in common
 * dies out while the disturbance persists, so that their autocovariance claims too little. A Kalman filter runs the
 * residuals and their Jacobian through a grid of models (ratio of the two noises, memory), and a finer one about the best;
 * its innovations are independent and give generalised least squares, and the restricted likelihood of the model
 * (D. A. Harville, JASA 72 (1977) 320). Estimate and covariance are averages over what is not known of the model.
 */
#include "residuals.h"

enum { COARSE_MEMORIES = 6, FINE_MEMORIES = 5, MODELS = 2 * FL_LANES * FINE_MEMORIES + 1, MIN_READINGS = 12, HALF_LANES = (FL_LANES + 1) / 2,
       MAX_FEW_RATIOS = 2 }; /* likely ratios of the middle memory; the others then mostly have at most four */

#define MIN_RATIO ((real)1e-3) /* ratio of variances, slow over white noise */
#define MAX_RATIO ((real)3e3)
#define FEW_MIN_RATIO ((real)0.5) /* range of this ratio that is assumed for few readings: that of most real recordings */
#define FEW_MAX_RATIO ((real)100)
#define WHITE_PENALTY_BITS ((real)3) /* bits by which white noise of few readings is less likely than either kind, as in real recordings */
#define MAX_MEMORY_SHARE ((real)1.5) /* largest memory, of the recording: longer ones look the same */
#define MAX_MEMORY_RAD ((real)20) /* largest memory, in rad of turning, of a change of the field that depends on the attitude */
#define MIN_PROBABILITY ((real)1e-4) /* smallest share of a model in the total probability */
#define MAX_TRIED_BITS ((real)14) /* bits by which a model may be less likely than the best if its neighbours are tried */
#define MAX_DROP_BITS ((real)20) /* bits by which a memory is less likely than the best if no longer one is better: so in all of 427 series */

/* Times of readings, or their rows if times are not known or go back. */
typedef struct {
    const real *time;
    const unsigned char *left_out;
    size_t row;
} moments;

/* A model of the noise, and its likelihood. */
typedef struct {
    int is_vector;
    real ratio, memory;   /* variance of the disturbance over that of white noise; time */
    real sums[55];        /* of the innovations */
    real likelihood;      /* its logarithm to the base 2, but for a constant */
    real variance;        /* of white noise */
} model;

/* Models in equal steps of the logarithms of ratio and memory: eight ratios for each memory. */
typedef struct {
    real ratio, ratio_step, memory, memory_step; /* the lowest, and the factors from one to the next */
    int memories;
} grid;

/* A model of a grid. */
typedef struct {
    int memory, ratio;
} place;

/* State of a search in a grid on one side: the memory, the most likely of its ratios, and whether it continues. */
typedef struct {
    int memory, ratio, is_open;
} side;

/* Whether the times of the used readings ascend. */
static int ascends(const fl_view *view, const fl_room *room)
{
    real last = -FL_HUGE;
    if (!room->time) return 0;
    for (size_t row = 0; row < view->rows; row++) {
        if (room->passed[row]) continue;
        if (!(room->time[row] >= last)) return 0;
        last = room->time[row];
    }
    return 1;
}

/* Time of the next used reading. */
static real next_moment(moments *at)
{
    while (at->left_out[at->row]) at->row++;
    const size_t row = at->row++;
    return at->time ? at->time[row] : (real)row;
}

/* Whether a reading repeats the one before, as of a sensor that is read faster than it measures. */
static int is_repeated(const fl_residuals *residuals, size_t i)
{
    int is_same = residuals->distances[i] == residuals->distances[i - 1];
    for (int column = 0; column < 9 && is_same; column++)
        is_same = residuals->columns[column][i] == residuals->columns[column][i - 1];
    return is_same;
}

/* Average successive readings, repeated ones once, to at most FL_SERIES means, and one more for each stretch; returns
 * the time that the means span. */
static real averages(const fl_view *view, const fl_residuals *residuals, const fl_room *room, fl_series *series)
{
    const size_t most = (residuals->n + FL_SERIES - 1) / FL_SERIES;
    moments at = {ascends(view, room) ? room->time : NULL, room->passed, 0};
    real last = 0, span = 0;
    series->n = 0;
    series->rows = room->series, series->counts = room->series + 10 * residuals->n;
    series->steps = series->counts + residuals->n;
    for (int stretch = 0; stretch < residuals->stretches; stretch++) {
        const size_t begin = residuals->begins[stretch], end = residuals->begins[stretch + 1];
        for (size_t i = begin; i < end;) {
            real *const row = series->rows + 10 * series->n, count = 0, moment = 0;
            const int is_gap = room->parts && i == begin;
            memset(row, 0, 10 * sizeof(real));
            for (const size_t stop = i + most; i < stop && i < end; i++) {
                const real here = next_moment(&at);
                if (i > begin && is_repeated(residuals, i)) continue;
                for (int column = 0; column < 9; column++) row[column] += residuals->columns[column][i];
                row[9] += residuals->distances[i];
                moment += here, count++;
            }
            if (count == 0) continue;
            for (int column = 0; column < 10; column++) row[column] /= count;
            moment /= count;
            series->counts[series->n] = count;
            series->steps[series->n] = is_gap ? FL_HUGE : series->n ? moment - last : 0;
            span += is_gap ? 0 : series->steps[series->n];
            series->n++;
            last = moment;
        }
    }
    return span;
}

/* Σ w r rᵀ of rows, as by the filter for white noise. */
static void white_sums(const fl_series *series, real sums[55])
{
    memset(sums, 0, 55 * sizeof(real));
    for (size_t i = 0; i < series->n; i++) {
        const real *row = series->rows + 10 * i;
        for (int a = 0, at = 0; a < 10; a++)
            for (int b = a; b < 10; b++) sums[at++] += series->counts[i] * row[a] * row[b];
    }
}

/* Normal equations in sums. */
static real equations(const real sums[55], real matrix[81], real gradient[9])
{
    int at = 0;
    for (int i = 0; i < 9; i++) {
        for (int j = i; j < 9; j++) matrix[9 * i + j] = matrix[9 * j + i] = sums[at++];
        gradient[i] = sums[at++];
    }
    return sums[54];
}

/* Subtract the part of residuals that a step explains, in sums. */
static void take_off(const real step[9], real sums[55])
{
    real matrix[81], gradient[9], square = equations(sums, matrix, gradient);
    for (int i = 0; i < 9; i++) {
        real along = 0;
        for (int j = 0; j < 9; j++) along += matrix[9 * i + j] * step[j];
        square -= step[i] * (2 * gradient[i] - along);
        gradient[i] -= along;
    }
    for (int i = 0, at = 9; i < 9; at += 9 - i, i++) sums[at] = gradient[i];
    sums[54] = square;
}

/* Restricted likelihood and white noise of a model; nonzero if there is none. */
static int judge(model *one, real log_determinant, real freedom)
{
    real matrix[81], gradient[9], scale = 0, rest = equations(one->sums, matrix, gradient);
    for (int i = 0; i < 9; i++) scale = matrix[10 * i] > scale ? matrix[10 * i] : scale;
    for (int i = 0; i < 9; i++) matrix[10 * i] += FL_ROUNDING * 100 * scale; /* an undetermined direction */
    if (fl_cholesky(matrix, 9)) return 1;
    fl_forward(matrix, 9, gradient);
    for (int i = 0; i < 9; i++) {
        rest -= gradient[i] * gradient[i];
        log_determinant += 2 * fl_log2(matrix[10 * i]);
    }
    if (!(rest > 0)) return 1;
    one->variance = rest / freedom;
    one->likelihood = -(log_determinant + freedom * fl_log2(rest)) / 2;
    return 0;
}

/* The share of a matrix of information in directions that are observed. */
static void observed(const fl_support *support, real matrix[81], real gradient[9])
{
    real onto[81], half[81], kept[9];
    if (support->is_whole) return;
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            onto[9 * i + j] = 0;
            for (int k = 0; k < 9; k++)
                if (support->share[k] < FL_UNOBSERVED)
                    onto[9 * i + j] += (1 - support->share[k]) * support->vectors[9 * i + k] * support->vectors[9 * j + k];
            onto[9 * i + j] *= support->scale[i] / support->scale[j];
        }
    fl_multiply(onto, gradient, 9, 9, 1, kept);
    memcpy(gradient, kept, sizeof kept);
    fl_multiply(onto, matrix, 9, 9, 9, half);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            matrix[9 * i + j] = 0;
            for (int k = 0; k < 9; k++) matrix[9 * i + j] += half[9 * i + k] * onto[9 * j + k];
        }
}

/* Step and covariance of one model. */
static void solved(const fl_posterior *at, const real prior_gradient[9], const model *one, real step[9],
                   real covariance[81])
{
    real matrix[81], gradient[9];
    equations(one->sums, matrix, gradient);
    for (int i = 0; i < 81; i++) matrix[i] /= one->variance;
    for (int i = 0; i < 9; i++) gradient[i] /= one->variance;
    observed(&at->support, matrix, gradient);
    for (int i = 0; i < 81; i++) matrix[i] += at->prior_matrix[i];
    for (int i = 0; i < 9; i++) gradient[i] += prior_gradient[i];
    fl_inverse(matrix, 9, covariance);
    fl_multiply(covariance, gradient, 9, 9, 1, step);
}

/* Step that balances the gradient of readings and that of a prior, in observed directions. */
static void step_of_observed(const fl_posterior *at, const real matrix[81], const real gradient[9],
                             const real prior_gradient[9], real step[9])
{
    const fl_support *const support = &at->support;
    memset(step, 0, 9 * sizeof(real));
    for (int k = 0; k < 9; k++) {
        real direction[9], along = 0, curvature = 0;
        if (!(support->share[k] < FL_UNOBSERVED)) continue;
        for (int i = 0; i < 9; i++) direction[i] = support->vectors[9 * i + k] / support->scale[i];
        for (int i = 0; i < 9; i++) {
            along += direction[i] * (gradient[i] + at->variance * prior_gradient[i] / (1 - support->share[k]));
            for (int j = 0; j < 9; j++) curvature += direction[i] * matrix[9 * i + j] * direction[j];
        }
        for (int i = 0; i < 9; i++) step[i] += direction[i] * along / curvature;
    }
}

/* Gradient of the prior where a fit ended, and the step that its correction for curvature was. */
static void end_of_fit(const fl_fit *fit, const real sums[55], real prior_gradient[9], real bent[9])
{
    const fl_posterior *at = &fit->posterior;
    real matrix[81], gradient[9], inverse[81], moved[9], left[9];
    for (int i = 0; i < 3; i++) moved[i] = fit->surface.centre[i] - at->surface.centre[i];
    for (int i = 0; i < 6; i++) moved[3 + i] = fit->surface.shape[i] - at->surface.shape[i];
    fl_multiply(at->prior_matrix, moved, 9, 9, 1, prior_gradient);
    equations(sums, matrix, gradient);
    for (int i = 0; i < 9; i++) {
        prior_gradient[i] = at->prior_gradient[i] - prior_gradient[i];
        left[i] = gradient[i] + at->variance * prior_gradient[i];
    }
    if (fl_support_unseen(&at->support)) {
        step_of_observed(at, matrix, gradient, prior_gradient, bent);
        return;
    }
    fl_inverse(matrix, 9, inverse);
    fl_multiply(inverse, left, 9, 9, 1, bent);
}

/* The likeliest of n models, at least one. */
static const model *best_of(const model *models, int n)
{
    const model *best = models;
    for (int k = 1; k < n; k++) best = models[k].likelihood > best->likelihood ? models + k : best;
    return best;
}

/* Eight models of a grid, four ratios of either of two memories from some on; one that is no model is infinitely
 * unlikely. */
static void models_at(const fl_kernels *kernels, const fl_series *series, int is_vector, const grid *over,
                      const place first[2], const real bent[9], model models[FL_LANES])
{
    real ratio[FL_LANES], log_determinant[FL_LANES], memory[2], sums[55][FL_LANES];
    for (int half = 0; half < 2; half++) memory[half] = over->memory * fl_pow(over->memory_step, (real)first[half].memory);
    for (int lane = 0; lane < FL_LANES; lane++)
        ratio[lane] = over->ratio * fl_pow(over->ratio_step, (real)(first[lane / HALF_LANES].ratio + lane % HALF_LANES));
    kernels->filter(series, is_vector, ratio, memory, log_determinant, sums);
    for (int lane = 0; lane < FL_LANES; lane++) {
        model *const one = models + lane;
        for (int i = 0; i < 55; i++) one->sums[i] = sums[i][lane];
        one->is_vector = is_vector, one->ratio = ratio[lane], one->memory = memory[lane / HALF_LANES];
        take_off(bent, one->sums);
        if (judge(one, log_determinant[lane], (real)series->n - 9) || !isfinite(one->likelihood)) one->likelihood = -FL_HUGE;
    }
}

/* The next two memories to try, each with the ratios about the most likely one of the memory before: one on each
 * side, or two on the side that continues. */
static void look_further(side sides[2], int last, side *of[2], place first[2])
{
    for (int half = 0; half < 2; half++) {
        side *const one = of[half] = sides + (sides[half].is_open ? half : 1 - half);
        const int memory = one->memory + (one == sides ? -1 : 1);
        first[half].memory = one->memory = memory < 0 ? 0 : memory > last ? last : memory;
        first[half].ratio = one->ratio < 1 ? 0 : one->ratio > HALF_LANES ? HALF_LANES : one->ratio - 1;
    }
}

/* The most likely model of a grid. All ratios of one memory are tried, and from there in both directions those about
 * the most likely of the memory before, until they are much less likely than the best. */
static model likeliest(const fl_kernels *kernels, const fl_series *series, int is_vector, const grid *over, int from,
                       const real bent[9])
{
    const int last = over->memories - 1;
    place first[2] = {{from, 0}, {from, HALF_LANES}};
    model models[FL_LANES], best;
    models_at(kernels, series, is_vector, over, first, bent, models);
    const int ratio = (int)(best_of(models, FL_LANES) - models);
    side sides[2] = {{from, ratio, from > 0}, {from, ratio, from < last}}, *of[2];
    best = models[ratio];
    while (sides[0].is_open || sides[1].is_open) {
        look_further(sides, last, of, first);
        models_at(kernels, series, is_vector, over, first, bent, models);
        for (int half = 0; half < 2; half++) {
            const model *const top = best_of(models + half * HALF_LANES, HALF_LANES);
            of[half]->ratio = first[half].ratio + (int)(top - models) - half * HALF_LANES;
            if (top->likelihood > best.likelihood) best = *top;
            if (top->likelihood < best.likelihood - MAX_DROP_BITS || first[half].memory % last == 0) of[half]->is_open = 0;
        }
    }
    return best;
}

/* Append models of one memory to n others, without impossible ones; returns the number of all. */
static int add_models(const model *some, int count, model *models, int n)
{
    for (int k = 0; k < count; k++)
        if (some[k].likelihood > -FL_HUGE) models[n++] = some[k];
    return n;
}

/* Whether models of four ratios, from one on, leave out others of their memory that are not hopeless. */
static int leave_out_some(const model *four, int first, real most)
{
    return (first > 0 && four[0].likelihood > most - MAX_TRIED_BITS) ||
           (first + HALF_LANES < FL_LANES && four[HALF_LANES - 1].likelihood > most - MAX_TRIED_BITS);
}

/* Append the models of a grid to n others, memory by memory from the middle until they are very unlikely; returns
 * the number of all. Of the other memories four ratios are tried first, if few of the middle one are likely. */
static int add_grid(const fl_kernels *kernels, const fl_series *series, int is_vector, const grid *over,
                    const real bent[9], model *models, int n)
{
    const int middle = (over->memories - 1) / 2, last = over->memories - 1;
    place first[2] = {{middle, 0}, {middle, HALF_LANES}};
    model here[FL_LANES], all[FL_LANES];
    models_at(kernels, series, is_vector, over, first, bent, here);
    const int ratio = (int)(best_of(here, FL_LANES) - here);
    side sides[2] = {{middle, ratio, 1}, {middle, ratio, 1}}, *of[2];
    real most = here[ratio].likelihood;
    int hopeful = 0;
    for (int lane = 0; lane < FL_LANES; lane++) hopeful += here[lane].likelihood > most - MAX_TRIED_BITS;
    n = add_models(here, FL_LANES, models, n);
    while (sides[0].is_open || sides[1].is_open) {
        look_further(sides, last, of, first);
        if (hopeful <= MAX_FEW_RATIOS) models_at(kernels, series, is_vector, over, first, bent, here);
        for (int half = 0; half < 2; half++) {
            const model *four = here + half * HALF_LANES;
            int begin = first[half].ratio, count = HALF_LANES;
            if (!of[half]->is_open) continue; /* the other of two of this side has ended it */
            if (hopeful > MAX_FEW_RATIOS || leave_out_some(four, begin, most)) {
                const place whole[2] = {{first[half].memory, 0}, {first[half].memory, HALF_LANES}};
                models_at(kernels, series, is_vector, over, whole, bent, all);
                four = all, begin = 0, count = FL_LANES;
            }
            const model *const top = best_of(four, count);
            n = add_models(four, count, models, n);
            most = top->likelihood > most ? top->likelihood : most;
            of[half]->ratio = begin + (int)(top - four);
            if (top->likelihood < most - MAX_TRIED_BITS || first[half].memory % last == 0) of[half]->is_open = 0;
        }
    }
    return n;
}

/* The grid of all possible models. */
static grid all_of(real span, size_t n)
{
    const real shortest = 2 * span / (real)n;
    const grid all = {MIN_RATIO, fl_pow(MAX_RATIO / MIN_RATIO, 1 / (real)(FL_LANES - 1)), shortest,
                      fl_pow(MAX_MEMORY_SHARE * span / shortest, 1 / (real)(COARSE_MEMORIES - 1)), COARSE_MEMORIES};
    return all;
}

/* Index of the memory of a model in a grid. */
static int memory_of(const grid *all, const model *one)
{
    int k = 0;
    while (k + 1 < all->memories && all->memory * fl_pow(all->memory_step, (real)k + (real)0.5) < one->memory) k++;
    return k;
}

/* A finer grid about one model, by a step to either side, but not beyond the grid: longer memories look the same,
 * and would add noise that the recording cannot show. */
static grid about(const grid *all, const model *best)
{
    const real longest = all->memory * fl_pow(all->memory_step, COARSE_MEMORIES - 1), above = best->memory * all->memory_step;
    const real steps = (above < longest ? above : longest) * all->memory_step / best->memory;
    const grid fine = {best->ratio / all->ratio_step, fl_pow(all->ratio_step, 2 / (real)(FL_LANES - 1)),
                       best->memory / all->memory_step, fl_pow(steps, 1 / (real)(FINE_MEMORIES - 1)), FINE_MEMORIES};
    return fine;
}

/* Models of both kinds for few readings, and white noise as the last one; returns their number. White noise has a
 * small prior probability: few readings often look white although the noise of real recordings lasts. */
static int models_of_few(const fl_kernels *kernels, const fl_series *series, real span, const real bent[9],
                         const model *white, model *models)
{
    const real shortest = 2 * span / (real)series->n;
    const grid all = {FEW_MIN_RATIO, fl_pow(FEW_MAX_RATIO / FEW_MIN_RATIO, 1 / (real)(FL_LANES - 1)), shortest,
                      fl_pow(MAX_MEMORY_SHARE * span / shortest, 1 / (real)(FINE_MEMORIES - 1)), FINE_MEMORIES};
    int n = 0;
    for (int kind = 0; kind < 2; kind++) n = add_grid(kernels, series, kind == 0, &all, bent, models, n);
    for (int k = 0; k < n; k++) models[k].likelihood -= fl_log2((real)(FL_LANES * FINE_MEMORIES));
    models[n] = *white;
    models[n].likelihood -= WHITE_PENALTY_BITS;
    return n + 1;
}

/* Models of both kinds that are likely compared with white noise, which is the last one; returns their number. Each
 * kind has the prior probability of white noise, shared by its models in equal steps of the logarithms. */
static int models_of(const fl_kernels *kernels, const fl_series *series, real span, const real bent[9],
                     const model *white, model *models)
{
    const grid all = all_of(span, series->n);
    const model vector = likeliest(kernels, series, 1, &all, (COARSE_MEMORIES - 1) / 2, bent);
    const model top[2] = {vector, likeliest(kernels, series, 0, &all, memory_of(&all, &vector), bent)};
    real most = white->likelihood;
    int n = 0;
    for (int kind = 0; kind < 2; kind++) most = top[kind].likelihood > most ? top[kind].likelihood : most;
    for (int kind = 0; kind < 2; kind++) {
        if (!(top[kind].likelihood > most - MAX_TRIED_BITS)) continue;
        const grid fine = about(&all, top + kind);
        const real share = fl_log2(fine.ratio_step) * fl_log2(fine.memory_step) /
                           (fl_log2(all.ratio_step) * FL_LANES * fl_log2(all.memory_step) * COARSE_MEMORIES);
        const int first = n;
        n = add_grid(kernels, series, kind == 0, &fine, bent, models, n);
        for (int k = first; k < n; k++) models[k].likelihood += fl_log2(share);
    }
    models[n] = *white;
    return n + 1;
}

/* Turn likelihoods of models into probabilities. */
static void weigh(const model *models, int n, real weights[MODELS])
{
    real best = models[0].likelihood, total = 0;
    for (int k = 1; k < n; k++) best = models[k].likelihood > best ? models[k].likelihood : best;
    for (int k = 0; k < n; k++) total += weights[k] = fl_pow(2, models[k].likelihood - best);
    for (int k = 0; k < n; k++) weights[k] = weights[k] > MIN_PROBABILITY * total ? weights[k] / total : 0;
}

/* Scatter of Σ J s over the readings of a series that noise of a model gives: a matrix and its transpose. */
static void scatter_of(const fl_series *series, const model *one, real scatter[81])
{
    real before[3][9] = {{0}}, half[81] = {0};
    const int components = one->is_vector ? 3 : 1;
    for (size_t k = 0; k < series->n; k++) {
        const real *const row = series->rows + 10 * k, count = series->counts[k];
        const real normal[3] = {one->is_vector ? row[0] : 1, row[1], row[2]};
        const real x = series->steps[k] / one->memory, decay = 1 / (1 + x * (1 + x / 2));
        real square = 0, with[9];
        for (int axis = 0; axis < components; axis++) square += normal[axis] * normal[axis];
        for (int i = 0; i < 9; i++) with[i] = (count + count * count * one->ratio * square) / 2 * row[i];
        for (int axis = 0; axis < components; axis++)
            for (int i = 0; i < 9; i++) {
                before[axis][i] *= decay;
                with[i] += count * one->ratio * normal[axis] * before[axis][i];
                before[axis][i] += count * normal[axis] * row[i];
            }
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) half[9 * i + j] += row[i] * with[j];
    }
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) scatter[9 * i + j] = one->variance * (half[9 * i + j] + half[9 * j + i]);
}

/* Covariance of plain least squares under a model of slow noise. */
static void unweighted(const fl_series *series, const fl_fit *fit, const model *white, const model *one,
                       const real textbook[81], real covariance[81])
{
    real scatter[81], gradient[9] = {0}, half[81];
    scatter_of(series, one, scatter);
    observed(&fit->posterior.support, scatter, gradient);
    for (int i = 0; i < 81; i++)
        scatter[i] = scatter[i] / (white->variance * white->variance) + fit->posterior.prior_matrix[i];
    fl_multiply(textbook, scatter, 9, 9, 9, half);
    fl_multiply(half, textbook, 9, 9, 9, covariance);
}

/* Mean time in which the surface's normal turns by a radian. */
static real radian_of(const fl_series *series, real span)
{
    real turned = 0;
    for (size_t i = 1; i < series->n; i++) {
        const real *const a = series->rows + 10 * (i - 1), *const b = a + 10;
        const real product = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) * (b[0] * b[0] + b[1] * b[1] + b[2] * b[2]);
        const real cosine = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / fl_sqrt(product > FL_TINY ? product : FL_TINY);
        if (series->steps[i] < FL_HUGE) turned += fl_acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine);
    }
    return turned > 0 ? span / turned : FL_HUGE;
}

/* Variance of the residuals from the field's strength at the place: more than white noise, and lasting while the
 * sensor turns by one to about twenty radians; noise that lasts longer occurs in all directions. */
static real variance_of_strength(const fl_residuals *residuals, const model *models, const real weights[MODELS], int n,
                                 real radian)
{
    real square = 0, variance = 0;
    for (size_t i = 0; i < residuals->n; i++) square += residuals->distances[i] * residuals->distances[i] / (real)residuals->n;
    for (int k = 0; k < n; k++)
        if (!models[k].is_vector && models[k].memory >= radian && models[k].memory <= MAX_MEMORY_RAD * radian &&
            square > models[k].variance)
            variance += weights[k] * (square - models[k].variance);
    return variance;
}

/* Find the noise, and average estimate and covariance over its possible models; also gives the covariance of the
 * unmoved fit under the most likely model. Nonzero without slow noise. */
int fl_slow_noise(const fl_kernels *kernels, const fl_view *view, const fl_residuals *residuals, const fl_fit *fit,
                  const fl_room *room, int is_assumed, fl_slow *slow, real step[9], real covariance[81], real without[81])
{
    fl_series series;
    model white = {0, 0, 1, {0}, 0, 0}, *const models = (model *)(void *)room->matrices;
    real prior_gradient[9], bent[9], steps[MODELS][9], each[81], weights[MODELS];
    const real span = averages(view, residuals, room, &series);
    if (series.n < MIN_READINGS || !(span > 0)) return 1;
    white_sums(&series, white.sums);
    end_of_fit(fit, white.sums, prior_gradient, bent);
    take_off(bent, white.sums);
    if (judge(&white, 0, (real)series.n - 9)) return 1;
    const int n = (is_assumed ? models_of_few : models_of)(kernels, &series, span, bent, &white, models);
    int best = 0;
    weigh(models, n, weights);
    memset(step, 0, 9 * sizeof(real));
    memset(covariance, 0, 81 * sizeof(real));
    for (int k = 0; k < n; k++) {
        if (!(weights[k] > 0)) continue;
        solved(&fit->posterior, prior_gradient, models + k, steps[k], each);
        for (int i = 0; i < 9; i++) step[i] += weights[k] * steps[k][i];
        for (int i = 0; i < 81; i++) covariance[i] += weights[k] * each[i];
    }
    for (int k = 0; k < n; k++)
        for (int i = 0; i < 9 && weights[k] > 0; i++)
            for (int j = 0; j < 9; j++)
                covariance[9 * i + j] += weights[k] * (steps[k][i] - step[i]) * (steps[k][j] - step[j]);
    for (int k = 1; k < n; k++) best = weights[k] > weights[best] ? k : best;
    slow->lasts = 0;
    for (int k = 0; k < n; k++) slow->lasts += models[k].memory > span / 3 ? weights[k] : 0;
    slow->strength = variance_of_strength(residuals, models, weights, n, radian_of(&series, span));
    solved(&fit->posterior, prior_gradient, &white, steps[best], each);
    unweighted(&series, fit, &white, models + best, each, without);
    slow->gain = models[best].likelihood - white.likelihood;
    slow->is_vector = models[best].is_vector, slow->ratio = models[best].ratio, slow->memory = models[best].memory / span;
    return 0;
}
