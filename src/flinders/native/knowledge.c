/* What a calibration that keeps itself knows: nine parameters, normally distributed, which time makes less certain and
 * evidence more.
 *
 * Between readings the offset walks, by w √t, so that the claim grows; w has one of seven values, each as probable as the steps
 * from one block of evidence to the next make it. While nothing is read, the offset may also move at once, as often as it did.
 * A block is fitted with what was known before as its prior, by the fit of every recording, with slow noise of the vector and
 * of the strength; the field's strength is another one in each block, as places differ. A place bends the field the same way
 * as long as one stays, so that a hundred blocks say no more than a few.
 */
#include "online.h"

#define HOUR_S ((real)3600)
#define SHAPE_WALK_SIGMA ((real)2e-4) /* 1 sigma of an entry of the shape by its random walk of one hour, of the radius */
#define FIXED_SIGMA ((real)1e-4) /* 1 sigma of parameters that readings do not determine, of the radius */
#define MEMORY_EXPONENT ((real)0.9) /* share of the evidence on the walk that is kept from one block to the next */
#define DAY_S ((real)86400)
#define MAX_WATCHED_GAP_S ((real)60) /* longest gap without readings in which a move of the offset would be noticed */
#define PRIOR_MOVES_PER_DAY ((real)0.5) /* prior rate of moves */
#define PRIOR_MOVES_DAYS ((real)1) /* weight of that rate, in days */
#define PRIOR_MOVE_SIZE ((real)0.1) /* prior rms size of a move, of the radius */
#define MIN_FREE_SHARE ((real)1e-12)
#define RATE_SPACING_SIGMA ((real)0.2) /* 1 sigma of a rate's logarithm from the spacing of the seven rates */
#define RATE_FREEDOM ((real)3)     /* of Student's distribution of a rate that is known: it may be quite another one */

/* Rates of the offset's random walk, of the radius per root hour, and their prior probabilities. */
static const real RATE[FL_RATES] = {(real)0.0003, (real)0.0006, (real)0.0012, (real)0.0025, (real)0.005, (real)0.01, (real)0.02};
const real fl_probable_rates[FL_RATES] = {(real)0.05, (real)0.1, (real)0.2, (real)0.25, (real)0.2, (real)0.15, (real)0.05};

/* Mean radius of a shape. */
real fl_mean_radius(const real parameters[9]) { return (parameters[3] + parameters[4] + parameters[5]) / 3; }

/* Variance by which the offset walks in an hour, a fraction of the radius squared. */
real fl_walk_variance(const flinders_online *online)
{
    real sum = 0;
    for (int k = 0; k < FL_RATES; k++) sum += online->rates[k] * RATE[k] * RATE[k];
    return sum;
}

/* Whether the readings of a level vehicle do not determine a parameter. */
static int is_across(int parameter) { return parameter == 2 || parameter == 5 || parameter > 6; }

/* Fix the parameters that the readings of a level vehicle do not determine. */
static void hold(const flinders_online *online, const real parameters[9], real covariance[81])
{
    const real held = FIXED_SIGMA * fl_mean_radius(parameters);
    if (!online->is_level) return;
    for (int i = 0; i < FL_PARAMETERS; i++)
        for (int j = 0; j < FL_PARAMETERS; j++)
            if (is_across(i) || is_across(j)) covariance[9 * i + j] = i == j ? held * held : 0;
}

/* Of a level vehicle, let what is known be what its ellipse leaves open, given all that lies across it. */
void fl_condition_on_height(const flinders_online *online, const real parameters[9], real covariance[81])
{
    const int across[4] = {2, 5, 7, 8};
    real inner[16], inverse[16];
    if (!online->is_level) return;
    for (int k = 0; k < 16; k++) inner[k] = covariance[9 * across[k / 4] + across[k % 4]];
    fl_inverse(inner, 4, inverse);
    real left[81];
    memcpy(left, covariance, sizeof left);
    for (int i = 0; i < FL_PARAMETERS; i++)
        for (int j = 0; j < FL_PARAMETERS; j++)
            for (int k = 0; k < 16; k++)
                left[9 * i + j] -= covariance[9 * i + across[k / 4]] * inverse[k] * covariance[9 * across[k % 4] + j];
    memcpy(covariance, left, sizeof left);
    hold(online, parameters, covariance);
}

/* Let time pass over a covariance. */
void fl_age(const flinders_online *online, const real parameters[9], real seconds, real covariance[81])
{
    const real radius = fl_mean_radius(parameters), hours = seconds > 0 ? seconds / HOUR_S : 0;
    const real offset = fl_walk_variance(online) * radius * radius * hours, shape = SHAPE_WALK_SIGMA * SHAPE_WALK_SIGMA * radius * radius * hours;
    for (int i = 0; i < FL_PARAMETERS; i++) covariance[10 * i] += i < 3 ? offset : i < 6 ? shape : shape / 2;
    hold(online, parameters, covariance);
}

/* Let the field have another strength. */
static void allow_strength(const flinders_online *online, const real parameters[9], real share, real covariance[81])
{
    for (int i = 3; i < FL_PARAMETERS; i++)
        for (int j = 3; j < FL_PARAMETERS; j++) covariance[9 * i + j] += share * share * parameters[i] * parameters[j];
    hold(online, parameters, covariance);
}

/* Let the offset be anywhere within a distance, 1 sigma. */
static void allow_offset(const flinders_online *online, const real parameters[9], real anywhere, real covariance[81])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < FL_PARAMETERS; j++) covariance[9 * i + j] = covariance[9 * j + i] = i == j ? anywhere * anywhere : 0;
    hold(online, parameters, covariance);
}

/* Update the parameters by evidence. */
typedef struct {
    real parameters[9], covariance[81];
    real noise, used;      /* unit, readings */
    real information[81];  /* of what was known before */
} found;

/* Reduce the information of readings by a factor in variance: with the prior Π and the information of readings J =
 * P⁻¹ − Π, the covariance is P' = (Π + J/f)⁻¹, and the step from the prior's mean is P' P⁻¹ / f times the step
 * before. */
FL_APART static void weaken(const real expected[9], real factor, found *out)
{
    real inverse[81], covariance[81], step[9], force[9], moved[9];
    fl_inverse(out->covariance, FL_PARAMETERS, inverse);
    for (int i = 0; i < 81; i++) covariance[i] = out->information[i] + (inverse[i] - out->information[i]) / factor;
    fl_inverse(covariance, FL_PARAMETERS, covariance);
    for (int i = 0; i < FL_PARAMETERS; i++) step[i] = out->parameters[i] - expected[i];
    fl_multiply(inverse, step, FL_PARAMETERS, FL_PARAMETERS, 1, force);
    fl_multiply(covariance, force, FL_PARAMETERS, FL_PARAMETERS, 1, moved);
    for (int i = 0; i < FL_PARAMETERS; i++) out->parameters[i] = expected[i] + moved[i] / factor;
    memcpy(out->covariance, covariance, sizeof covariance);
}

#ifdef FLINDERS_SMALL
/* Fit evidence as a board fits: its noise is taken for independent, and what it scatters beyond that is learnt of groups. */
FL_APART static int fit_evidence(const fl_view *evidence, real dip_deg, const real expected[9], const fl_lent *memory, found *out)
{
    const struct fl_known known = {expected, out->information, fl_add_known};
    const fl_kernels *const kernels = fl_kernels_chosen(0);
    fl_view view = *evidence;
    fl_majority majority = {0};
    flinders_options options;
    fl_surface start;
    fl_fit fit;
    real *const work = memory->at;
    unsigned char *const flags = (unsigned char *)(work + 2 * view.rows);
    const fl_room room = {.order = memory->at, .scratch = work, .distances = work + view.rows, .rejected = flags,
                          .far = flags + view.rows, .passed = flags + 2 * view.rows};
    if (memory->size < view.rows * (2 * sizeof(real) + 3)) return FLINDERS_NO_WORKSPACE;
    flinders_default_options(&options);
    options.statistics = 0, options.dip_deg = dip_deg, options.known = &known;
    if (fl_start_about(&view, expected, &start)) return FLINDERS_NOT_AN_ELLIPSOID;
    const int status = fl_fit_majority(kernels, &view, &options, &start, &start, &room, &fit, &majority);
    if (status != FLINDERS_OK) return status;
    memcpy(out->covariance, fit.covariance, sizeof out->covariance);
    memcpy(out->parameters, fit.surface.centre, sizeof fit.surface.centre);
    memcpy(out->parameters + 3, fit.surface.shape, sizeof fit.surface.shape);
    out->noise = fit.noise, out->used = (real)fit.used;
    return FLINDERS_OK;
}
#else
/* Fit evidence with everything that is known of residuals. */
static int fit_evidence(const fl_view *evidence, const real *time, real dip_deg, const real expected[9], const fl_lent *memory,
                        found *out)
{
    flinders_options options;
    flinders_record record;
    flinders_default_options(&options);
    options.dip_deg = dip_deg;
    options.statistics = options.rests = options.level = 0;
    options.is_informed = 1;
    memcpy(options.expected, expected, sizeof options.expected);
    memcpy(options.information, out->information, sizeof options.information);
    if (flinders_fit(evidence->field, time, evidence->rows, &options, memory->at, memory->size, &record)) return record.status;
    memcpy(out->parameters, record.centre, sizeof record.centre);
    memcpy(out->parameters + 3, record.shape, sizeof record.shape);
    memcpy(out->covariance, record.covariance, sizeof out->covariance);
    out->noise = record.noise, out->used = (real)record.used;
    return FLINDERS_OK;
}
#endif

/* Fit evidence from a reading on, with the calibration as prior; the scatter of groups multiplies their claimed
 * variance. Noise is at least that at the time of the calibration. The covariance may be stored in place of its
 * inverse. */
static int fit(const flinders_online *online, size_t first, const real expected[9], const real covariance[81],
               real scatter, const fl_lent *memory, found *out)
{
    const fl_view evidence = {online->field + 3 * first, (size_t)online->kept - first, NULL, 1};
    fl_inverse(covariance, FL_PARAMETERS, out->information);
#ifdef FLINDERS_SMALL
    const int status = fit_evidence(&evidence, online->dip_deg, expected, memory, out);
#else
    const int status = fit_evidence(&evidence, online->time + first, online->dip_deg, expected, memory, out);
#endif
    if (status != FLINDERS_OK) return status;
    const real times = online->noise / out->noise, few = flinders_widening_by_few(out->used - FL_PARAMETERS);
    const real factor = scatter * few * (times > 1 ? times * times : 1);
    if (factor > 1) weaken(expected, factor, out);
    return FLINDERS_OK;
}

/* Offset that evidence shows alone from one reading on, with the shape as it is known, and its covariance (3, 3); it is
 * somewhere about a start. */
FL_APART int fl_offset_alone(const flinders_online *online, size_t first, const real start[3], real anywhere,
                             const fl_lent *memory, real offset[3], real covariance[9])
{
    found alone;
    real expected[9], *const free = alone.information;
    memcpy(expected, online->latest, sizeof expected);
    memcpy(expected, start, 3 * sizeof *start);
    memcpy(free, online->latest_covariance, sizeof alone.information);
    allow_strength(online, expected, online->place, free);
    allow_offset(online, expected, anywhere, free);
    if (fit(online, first, expected, free, 1, memory, &alone)) return 1;
    for (int i = 0; i < 3; i++) offset[i] = alone.parameters[i];
    for (int i = 0; i < 9; i++) covariance[i] = alone.covariance[9 * (i / 3) + i % 3];
    return 0;
}

/* p-value of a difference d whose covariance is a sum of two, with the scatter of groups. */
real fl_chance_of_offsets(const real d[3], const real one[9], const real other[9], real scatter, real *ratio)
{
    real sum[9], square;
    for (int i = 0; i < 9; i++) sum[i] = one[i] + other[i];
    const int freedom = fl_chi_square(d, sum, 3, &square);
    if (ratio) *ratio = freedom ? square / (real)freedom : 0;
    return freedom ? fl_chance_of(square / scatter, (real)freedom, 0) : 1;
}

/* Covariance (3, 3) of the offset, as it is known latest, at a time. */
void fl_offset_covariance(const flinders_online *online, real time, real out[9])
{
    real aged[81];
    memcpy(aged, online->latest_covariance, sizeof aged);
    fl_age(online, online->latest, time - online->latest_at, aged);
    for (int i = 0; i < 9; i++) out[i] = aged[9 * (i / 3) + i % 3];
}

/* What is known latest is what evidence makes of what was known before. */
FL_APART void fl_learn(flinders_online *online, const fl_lent *memory)
{
    fl_surface surface;
    found latest;
    real *const free = latest.information;
    const real last = online->time[online->kept - 1];
    memcpy(free, online->known_covariance, sizeof latest.information);
    fl_age(online, online->known, last - online->known_at, free);
    allow_strength(online, online->known, online->place, free);
    if (fit(online, 0, online->known, free, online->scatter > 1 ? online->scatter : 1, memory, &latest)) return;
    if (fl_surface_of(latest.parameters, latest.parameters + 3, &surface)) return;
    memcpy(online->latest, latest.parameters, sizeof online->latest);
    memcpy(online->latest_covariance, latest.covariance, sizeof online->latest_covariance);
    online->latest_at = last;
}

/* Keep the share of a block's variance that depends on the place: in a direction in which the covariance is e times
 * that before, the block alone has e / (1 − e). */
void fl_keep_open(const real before[81], real same, real covariance[81])
{
    real values[FL_PARAMETERS], vectors[81], turned[81], half[81], shares[FL_PARAMETERS];
    const int k = fl_principal(before, FL_PARAMETERS, values, vectors);
    for (int i = 0; i < FL_PARAMETERS; i++)
        for (int j = 0; j < k; j++) vectors[k * i + j] /= fl_sqrt(values[j]);
    fl_multiply(covariance, vectors, FL_PARAMETERS, FL_PARAMETERS, k, half);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) {
            turned[k * i + j] = 0;
            for (int l = 0; l < FL_PARAMETERS; l++) turned[k * i + j] += vectors[k * l + i] * half[k * l + j];
        }
    fl_eigen(turned, k, shares);
    fl_multiply(before, vectors, FL_PARAMETERS, FL_PARAMETERS, k, half);
    fl_multiply(half, turned, FL_PARAMETERS, k, k, vectors); /* in columns: covariance = Σ share v vᵀ */
    for (int l = 0; l < k; l++) {
        const real left = shares[l] < 1 - MIN_FREE_SHARE ? same * shares[l] / (1 - shares[l]) : 1;
        const real least = left < 1 ? left : 1, more = least > shares[l] ? least - shares[l] : 0;
        for (int i = 0; i < FL_PARAMETERS; i++)
            for (int j = 0; j < FL_PARAMETERS; j++) covariance[9 * i + j] += more * vectors[k * i + l] * vectors[k * j + l];
    }
}

/* Begin with the rate that is known of the unit, if one is: its logarithm has Student's distribution. */
void fl_expect_walk(flinders_online *online)
{
    const real radius = fl_mean_radius(online->latest);
    const real variance = online->expected_walk_sigma * online->expected_walk_sigma + RATE_SPACING_SIGMA * RATE_SPACING_SIGMA;
    real probable[FL_RATES], sum = 0;
    if (!(online->expected_walk > 0 && radius > 0)) return;
    for (int k = 0; k < FL_RATES; k++) {
        const real off = fl_log(RATE[k] * radius / online->expected_walk), share = 1 + off * off / variance / RATE_FREEDOM;
        sum += probable[k] = 1 / (share * share); /* to the power of (RATE_FREEDOM + 1) / 2 */
    }
    if (!(sum > FL_TINY)) return;
    for (int k = 0; k < FL_RATES; k++) online->rates[k] = online->probable_rates[k] = probable[k] / sum;
}

/* What a block says of the rate at which the offset walks. */
void fl_weigh_rates(flinders_online *online, const real d[3], const real covariance[9], real seconds)
{
    const real radius = fl_mean_radius(online->known);
    real sum = 0, densities[FL_RATES], best = -FL_HUGE;
    for (int k = 0; k < FL_RATES; k++) {
        real factor[9], x[3];
        memcpy(factor, covariance, sizeof factor), memcpy(x, d, sizeof x);
        for (int i = 0; i < 3; i++) factor[4 * i] += RATE[k] * RATE[k] * radius * radius * seconds / HOUR_S;
        if (fl_cholesky(factor, 3)) return;
        fl_forward(factor, 3, x);
        densities[k] = -(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) / 2 - fl_log(factor[0] * factor[4] * factor[8]);
        best = densities[k] > best ? densities[k] : best;
    }
    for (int k = 0; k < FL_RATES; k++)
        sum += online->rates[k] = fl_pow(online->rates[k] / online->probable_rates[k], MEMORY_EXPONENT) * online->probable_rates[k] * fl_exp(densities[k] - best);
    for (int k = 0; k < FL_RATES; k++) online->rates[k] /= sum;
}

/* Record a move of the offset, by its square. */
void fl_count_move(flinders_online *online, real square)
{
    online->moves += 1, online->moves_square += square;
}

/* Variance of the offset along an axis from moves that were not observed during a time without readings. */
real fl_unseen_moves(const flinders_online *online, real seconds)
{
    const real radius = fl_mean_radius(online->latest), days = (PRIOR_MOVES_DAYS * DAY_S + online->watched) / DAY_S;
    const real rate = (PRIOR_MOVES_DAYS * PRIOR_MOVES_PER_DAY + online->moves) / days;
    const real square = (PRIOR_MOVE_SIZE * PRIOR_MOVE_SIZE * radius * radius + online->moves_square) / (1 + online->moves);
    return seconds > MAX_WATCHED_GAP_S ? rate * seconds / DAY_S * square / 3 : 0;
}
