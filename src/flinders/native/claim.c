/* Claim of a fit: its covariance, widened for repeated readings, which add no information, and for few readings, whose noise
 * is estimated from few residuals. A fit to readings that were corrected before is shrunk towards no correction.
 *
 * Departures d of such a fit, its offset and the deviator of its shape over the mean semi-axis, have a covariance P, and are
 * normal with P + Q where Q is
 *
 *     corrected     offset 0.5, 1 or 2 %, shape 2, 5 or 10 % (gains are often left as they were), all nine alike
 *     uncorrected   offset 30 %, shape 10 %: less than most sensors have, which speaks against the former
 *
 * Where the marginal likelihood of d makes the first 99.9 % probable (R. E. Kass, A. E. Raftery, J. Am. Stat. Assoc. 90
 * (1995) 773), also where P is that of independent residuals, as a wide one decides nothing, the fit becomes its posterior mean, the average of Q (P + Q)⁻¹ d over the nine, and claims the posterior
 * covariance (C. N. Morris, J. Am. Stat. Assoc. 78 (1983) 47). Readings from all directions have a P so small that nothing
 * is shrunk. `python -m benchmarks.windows` measures what it does to parts of recordings.
 */
#include "judge.h"

enum { PARAMETERS = 9, OF_ELLIPSE = 5 };

/* Variance of Student's t, ν/(ν − 2), for ν degrees of freedom. Below three it does not exist, and the factor increases by four
 * for each missing reading. */
real flinders_widening_by_few(real freedom)
{
    return freedom >= 3 ? freedom / (freedom - 2) : 3 * fl_pow(4, 3 - (freedom > 0 ? freedom : 0));
}

/* Factor that widens a covariance for repeated and few readings. Its noise was estimated from the residuals of all rows minus
 * the parameters, but only distinct ones are independent. 1 if the number of rows is unknown. */
static real widening(real rows, real repetition, int parameters)
{
    if (!(rows > 0)) return 1;
    const real freedom = rows / repetition - (real)parameters;
    return (freedom >= 1 ? (rows - (real)parameters) / freedom : repetition) * flinders_widening_by_few(freedom);
}

/* Number of free parameters: at most five for an ellipse. */
static int parameters_of(const flinders_record *record, const flinders_request *request)
{
#ifdef FLINDERS_SMALL /* no level turns on a board */
    (void)record;
#else
    if (record->plane && request->parameters > OF_ELLIPSE) return OF_ELLIPSE;
#endif
    return request->parameters;
}

/* Mean ratio of variances to those for independent residuals; 1 if these are unknown. */
static real variance_inflation(const flinders_record *record)
{
    real sum = 0;
    int count = 0;
    for (int i = 0; i < 81; i += PARAMETERS + 1)
        if (record->textbook[i] > 0) sum += record->covariance[i] / record->textbook[i], count++;
    return count ? sum / (real)count : 1;
}

/* Number of readings per distinct one, as far as the covariance does not account for it. */
static real repetition_of(const flinders_record *record)
{
    const real distinct = record->fitted_distinct > 1 ? (real)record->fitted_distinct : 1;
    const real known = variance_inflation(record), share = (real)record->fitted / distinct / (known > FL_TINY ? known : FL_TINY);
    return share > 1 ? share : 1;
}

#ifndef FLINDERS_SMALL
enum { DEPARTURES = 8, WIDTHS = 3, PRIORS = WIDTHS * WIDTHS };

#define UNCORRECTED_OFFSET_SIGMA ((real)0.3) /* prior 1 sigma of the offset of readings without a correction, of the radius */
#define UNCORRECTED_SHAPE_SIGMA ((real)0.1) /* prior 1 sigma of the shape of readings without a correction, of the radius */
#define MIN_CORRECTED_PROBABILITY ((real)0.999) /* smallest probability that readings were corrected before */
#define MAX_OFFSET_SIGMAS ((real)6) /* largest offset of readings that were corrected before, in standard deviations */
#define MAX_TOTAL_SIGMA ((real)100) /* root of the summed variances, over the field, from which rounding decides */

static const real OFFSETS[WIDTHS] = {(real)0.005, (real)0.01, (real)0.02}, SHAPES[WIDTHS] = {(real)0.02, (real)0.05, (real)0.1};

/* Departures of an estimate, and their covariance without the negative variances that rounding leaves. */
typedef struct {
    real size; /* mean semi-axis, unit */
    real departures[DEPARTURES], covariance[DEPARTURES * DEPARTURES];
} departure;

/* A basis (9, 8) of departures: the offset, and an orthonormal one of symmetric matrices without trace. */
static void basis_of(real basis[PARAMETERS * DEPARTURES])
{
    const real half = fl_sqrt((real)0.5), sixth = fl_sqrt((real)1 / 6);
    const real shape[6][2] = {{half, sixth}, {-half, sixth}, {0, -2 * sixth}, {0, 0}, {0, 0}, {0, 0}};
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < DEPARTURES; j++) basis[DEPARTURES * i + j] = i < 3 ? i == j : i == j + 1 && j > 4 ? half : 0;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 2; j++) basis[DEPARTURES * (3 + i) + 3 + j] = shape[i][j];
}

/* M C Mᵀ of a covariance (m, m) and a map (n, m). */
static void carry(const real *map, const real *covariance, int n, int m, real *out)
{
    real half[81];
    fl_multiply(map, covariance, n, m, m, half);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            real sum = 0;
            for (int k = 0; k < m; k++) sum += half[m * i + k] * map[m * j + k];
            out[n * i + j] = sum;
        }
}

/* Whether an estimate is so accurate, and its offset so small, that the other departures must be tested. */
static int is_near(const flinders_record *record, real size)
{
    real sum = 0;
    for (int i = 0; i < 81; i += PARAMETERS + 1) sum += record->covariance[i];
    if (!(sum < MAX_TOTAL_SIGMA * MAX_TOTAL_SIGMA * size * size)) return 0;
    for (int axis = 0; axis < 3; axis++) {
        const real wide = OFFSETS[WIDTHS - 1] * size;
        if (!(fl_abs(record->centre[axis]) < MAX_OFFSET_SIGMAS * fl_sqrt(record->covariance[10 * axis] + wide * wide))) return 0;
    }
    return 1;
}

/* The departures of an estimate of a covariance. */
static void departure_of(const flinders_record *record, const real covariance[81], const real basis[72], real size,
                         departure *out)
{
    real map[72], values[DEPARTURES], vectors[64], parameters[PARAMETERS];
    memcpy(parameters, record->centre, sizeof record->centre);
    memcpy(parameters + 3, record->shape, sizeof record->shape);
    for (int i = 0; i < DEPARTURES; i++) /* an off-diagonal entry occurs twice in the matrix */
        for (int j = 0; j < PARAMETERS; j++) map[PARAMETERS * i + j] = basis[DEPARTURES * j + i] * (j < 6 ? 1 : 2) / size;
    out->size = size;
    fl_multiply(map, parameters, DEPARTURES, PARAMETERS, 1, out->departures);
    carry(map, covariance, DEPARTURES, PARAMETERS, vectors);
    fl_eigen(vectors, DEPARTURES, values);
    for (int i = 0; i < DEPARTURES; i++)
        for (int j = 0; j <= i; j++) {
            real sum = 0;
            for (int k = 0; k < DEPARTURES; k++)
                sum += vectors[DEPARTURES * i + k] * (values[k] > 0 ? values[k] : 0) * vectors[DEPARTURES * j + k];
            out->covariance[DEPARTURES * i + j] = out->covariance[DEPARTURES * j + i] = sum;
        }
}

/* Variance of departure i under a prior: of a correction, or behind those of none. */
static real prior_variance(int prior, int i)
{
    const real width = prior == PRIORS ? (i < 3 ? UNCORRECTED_OFFSET_SIGMA : UNCORRECTED_SHAPE_SIGMA)
                                       : i < 3 ? OFFSETS[prior / WIDTHS] : SHAPES[prior % WIDTHS];
    return width * width;
}

/* Cholesky factor of P + Q; nonzero if it does not exist. */
static int factor_of(const departure *d, int prior, real factor[64])
{
    memcpy(factor, d->covariance, sizeof d->covariance);
    for (int i = 0; i < DEPARTURES; i++) factor[(DEPARTURES + 1) * i] += prior_variance(prior, i);
    return fl_cholesky(factor, DEPARTURES);
}

/* Logarithm of the density of departures under a prior, up to a constant. */
static int log_density(const departure *d, int prior, real *density)
{
    real factor[64], x[DEPARTURES];
    if (factor_of(d, prior, factor)) return 1;
    memcpy(x, d->departures, sizeof x);
    fl_forward(factor, DEPARTURES, x);
    *density = 0;
    for (int i = 0; i < DEPARTURES; i++) *density -= x[i] * x[i] / 2 + fl_log(factor[(DEPARTURES + 1) * i]);
    return 0;
}

/* Weights of the priors of a correction; 0 if these are not probable. */
static int weigh(const departure *d, real weights[PRIORS])
{
    real without, sum = 0;
    if (log_density(d, PRIORS, &without)) return 0;
    for (int prior = 0; prior < PRIORS; prior++) {
        if (log_density(d, prior, weights + prior)) return 0;
        sum += weights[prior] = fl_exp(weights[prior] - without);
    }
    for (int prior = 0; prior < PRIORS; prior++) weights[prior] /= sum;
    return sum / PRIORS > MIN_CORRECTED_PROBABILITY / (1 - MIN_CORRECTED_PROBABILITY);
}

/* Mean and covariance of departures under one prior: Q (P + Q)⁻¹ d and Q (P + Q)⁻¹ P. */
static void posterior_of(const departure *d, int prior, real mean[DEPARTURES], real within[64])
{
    real factor[64], column[DEPARTURES];
    factor_of(d, prior, factor);
    for (int j = 0; j <= DEPARTURES; j++) {
        for (int i = 0; i < DEPARTURES; i++) column[i] = j < DEPARTURES ? d->covariance[DEPARTURES * i + j] : d->departures[i];
        fl_cholesky_solve(factor, DEPARTURES, column);
        for (int i = 0; i < DEPARTURES; i++) {
            const real entry = prior_variance(prior, i) * column[i];
            if (j < DEPARTURES) within[DEPARTURES * i + j] = entry;
            else mean[i] = entry;
        }
    }
}

/* Mean and covariance of departures, averaged over priors. */
static void posterior(const departure *d, const real weights[PRIORS], real mean[DEPARTURES], real covariance[64])
{
    real means[PRIORS][DEPARTURES], sum[64] = {0}, within[64];
    memset(mean, 0, DEPARTURES * sizeof *mean);
    for (int prior = 0; prior < PRIORS; prior++) {
        posterior_of(d, prior, means[prior], within);
        for (int i = 0; i < DEPARTURES; i++) mean[i] += weights[prior] * means[prior][i];
        for (int i = 0; i < 64; i++) sum[i] += weights[prior] * within[i];
    }
    for (int i = 0; i < DEPARTURES; i++)
        for (int j = 0; j < DEPARTURES; j++) {
            real entry = (sum[DEPARTURES * i + j] + sum[DEPARTURES * j + i]) / 2;
            for (int prior = 0; prior < PRIORS; prior++)
                entry += weights[prior] * (means[prior][i] - mean[i]) * (means[prior][j] - mean[j]);
            covariance[DEPARTURES * i + j] = entry;
        }
}

/* Write departures to a record as an ellipsoid; the uncertainty of its size is unchanged. */
static void restore(const departure *d, const real basis[72], const real mean[DEPARTURES], const real covariance[64],
                    flinders_record *record)
{
    real parameters[PARAMETERS], widths[81], own = 0;
    for (int i = 3; i < 6; i++)
        for (int j = 3; j < 6; j++) own += record->covariance[PARAMETERS * i + j] / 9;
    fl_multiply(basis, mean, PARAMETERS, DEPARTURES, 1, parameters);
    for (int i = 0; i < PARAMETERS; i++) parameters[i] = d->size * (parameters[i] + (i > 2 && i < 6 ? 1 : 0));
    carry(basis, covariance, PARAMETERS, DEPARTURES, widths);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++)
            record->covariance[PARAMETERS * i + j] = d->size * d->size * widths[PARAMETERS * i + j] +
                                                     parameters[i] * parameters[j] * own / (d->size * d->size);
    memcpy(record->centre, parameters, sizeof record->centre);
    memcpy(record->shape, parameters + 3, sizeof record->shape);
    for (int i = 0; i < 81; i++) record->textbook[i] = FL_NOT_A_NUMBER;
}

/* Shrink a fit to readings that were corrected before towards no correction. */
static void shrink(flinders_record *record)
{
    const real size = (record->shape[0] + record->shape[1] + record->shape[2]) / 3;
    real basis[72], weights[PRIORS], mean[DEPARTURES], covariance[64];
    departure d;
    fl_surface surface;
    flinders_record shrunk = *record;
    record->is_shrunk = -1;
    if (!(size > 0) || !is_near(record, size)) return;
    basis_of(basis);
    departure_of(record, record->covariance, basis, size, &d);
    if (!weigh(&d, weights)) {
        departure independent;
        departure_of(record, record->textbook, basis, size, &independent);
        if (!weigh(&independent, weights)) return;
    }
    posterior(&d, weights, mean, covariance);
    restore(&d, basis, mean, covariance, &shrunk);
    if (fl_surface_of(shrunk.centre, shrunk.shape, &surface)) return;
    shrunk.is_shrunk = 1, shrunk.radius = surface.radius;
    shrunk.level_rms_deg = shrunk.level_worst_deg = FL_NOT_A_NUMBER;
    *record = shrunk;
}
#endif

/* Level errors of a record that has none. */
static void complete(const fl_surface *surface, flinders_record *record)
{
#ifndef FLINDERS_SMALL /* no level turns and no shrinking on a board */
    const real *const down = fl_down(record->plane);
    if (record->plane || record->is_shrunk > 0)
        fl_tilted_error(surface, record->covariance, record->dip_deg, 0, down, &record->level_rms_deg, &record->level_worst_deg);
    else
#endif
        fl_heading_errors(surface, record, record->dip_deg);
}

/* Whether the shape has a prior from an earlier calibration: such a fit is not shrunk further, and its noise is estimated with
 * nine degrees of freedom less, which allows for few readings. */
static int is_refreshed(const flinders_record *record)
{
#ifdef FLINDERS_SMALL
    (void)record;
    return 0;
#else
    return (record->sources & FLINDERS_REFRESHED) != 0;
#endif
}

/* Widen the covariance of a record, and complete its level errors. */
void flinders_claim(flinders_record *record, const flinders_request *request)
{
    fl_surface surface;
    if (!record->is_claimed) {
        record->is_claimed = 1, record->repetition = repetition_of(record);
        const real factor = request->parameters > 0 && !is_refreshed(record)
            ? widening((real)record->fitted, record->repetition, parameters_of(record, request)) : record->repetition;
        for (int i = 0; i < 81; i++) record->covariance[i] *= factor;
        record->level_rms_deg *= fl_sqrt(factor), record->level_worst_deg *= fl_sqrt(factor);
    }
#ifndef FLINDERS_SMALL
    if (request->shrinks && !record->plane && record->is_shrunk <= 0 && !is_refreshed(record)) shrink(record);
#endif
    if (isnan(record->level_worst_deg) && fl_abs(record->dip_deg) <= 89 &&
        !fl_surface_of(record->centre, record->shape, &surface)) complete(&surface, record);
}
