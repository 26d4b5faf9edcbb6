/* Refresh of a calibration: soft iron of an earlier one, hard iron from a few seconds of readings.
 *
 * On a vehicle, mostly hard iron changes: a battery, a load, a camera. The shape S has the prior
 *
 *     S ~ N(f S₀, f² C₀ + σ² S₀ S₀ᵀ)
 *
 * with its covariance C₀, the relative uncertainty σ of the field's strength, and the ratio f of both strengths. The
 * offset is free. The fit is that of other recordings, with this distribution as its prior.
 */
#include "judge.h"
#include "residuals.h"

enum { SHAPE = 6, MIN_READINGS = 20 /* readings */ };

#define MIN_TURN_DEG ((real)5) /* noise of a hundredth of the field reaches 2.3° in a thousand readings */
#define STRENGTH_SIGMA ((real)0.01) /* of the strength of the field, at places 100 km apart, ground and buildings at each */
#define SHAPE_SIGMA ((real)0.02)    /* of the radius, for each entry of a shape without a covariance */
#define MIN_SHAPE_SIGMA ((real)1e-4) /* of the radius: smallest uncertainty of a shape, even if a method fixes it */
#define ALLOWED_CHANGE ((real)0.05) /* relative change of soft iron, 1 sigma */
#define MIN_READINGS_SHARE ((real)0.1) /* smallest fraction of information from readings on a direction of the shape */

/* Index in the covariance (9, 9) of two entries of the shape. */
static int place_of(int row, int column) { return 9 * (3 + row) + 3 + column; }

/* Add variances of all entries of a shape; off-diagonal ones occur twice in the matrix. */
static void add_variance(real variance, real covariance[81])
{
    for (int i = 0; i < SHAPE; i++) covariance[place_of(i, i)] += i < 3 ? variance : variance / 2;
}

/* Add a relative change of soft iron, 1 sigma. */
static void add_change(real share, flinders_earlier *earlier)
{
    const real changed = share * fl_cbrt(fl_sym3_det(earlier->parameters + 3));
    add_variance(changed * changed, earlier->covariance);
}

/* Prior from an earlier calibration of a sensor whose hard iron has changed. */
void flinders_earlier_of(const real centre[3], const real shape[6], const real *covariance, real distortion,
                         real strength_ratio, real soft_iron_sigma, flinders_earlier *earlier)
{
    const real ratio = strength_ratio * strength_ratio, radius = fl_cbrt(fl_sym3_det(shape));
    const real finest = (MIN_SHAPE_SIGMA * radius) * (MIN_SHAPE_SIGMA * radius), unstated = (SHAPE_SIGMA * radius) * (SHAPE_SIGMA * radius);
    memset(earlier, 0, sizeof *earlier);
    earlier->distortion = distortion;
    for (int i = 0; i < 3; i++) earlier->parameters[i] = centre[i], earlier->covariance[10 * i] = (real)INFINITY;
    for (int i = 0; i < SHAPE; i++) earlier->parameters[3 + i] = strength_ratio * shape[i];
    for (int i = 0; i < SHAPE; i++) {
        for (int j = 0; j < SHAPE; j++)
            earlier->covariance[place_of(i, j)] = ratio * (covariance ? covariance[place_of(i, j)] : 0) +
                STRENGTH_SIGMA * STRENGTH_SIGMA * earlier->parameters[3 + i] * earlier->parameters[3 + j];
        earlier->covariance[place_of(i, i)] += ratio * (covariance ? finest : finest + unstated);
    }
    add_change(soft_iron_sigma, earlier);
}

/* Allow a change of the soft iron of an earlier calibration. */
void flinders_allow_change(flinders_earlier *earlier) { add_change(ALLOWED_CHANGE, earlier); }

/* Options with this prior; parameters of infinite variance are left out. */
static void inform(const flinders_earlier *earlier, flinders_options *options)
{
    int known[9], n = 0;
    real matrix[81], inverse[81];
    for (int i = 0; i < 9; i++)
        if (earlier->covariance[10 * i] < (real)INFINITY) known[n++] = i;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) matrix[n * i + j] = earlier->covariance[9 * known[i] + known[j]];
    if (n) fl_inverse(matrix, n, inverse);
    options->is_informed = 1;
    memcpy(options->expected, earlier->parameters, sizeof options->expected);
    memset(options->information, 0, sizeof options->information);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) options->information[9 * known[i] + known[j]] = inverse[n * i + j];
}

/* M for T M Tᵀ, of entries of the shape in a matrix (9, 9) of all parameters; T (6, 6). */
static void turned(const real turn[36], const real matrix[81], real out[36])
{
    real entries[36], half[36], transposed[36];
    for (int i = 0; i < 36; i++) entries[i] = matrix[place_of(i / SHAPE, i % SHAPE)], transposed[i] = turn[SHAPE * (i % SHAPE) + i / SHAPE];
    fl_multiply(turn, entries, SHAPE, SHAPE, SHAPE, half);
    fl_multiply(half, transposed, SHAPE, SHAPE, SHAPE, out);
}

/* Directions of the shape in which a prior has unit variance, T (6, 6) in rows, and the fraction of information from
 * readings on each (6,); nonzero for an invalid prior. */
static int directions_of(const real prior[81], const real textbook[81], real turn[36], real shares[SHAPE])
{
    real factor[36], finer[36], left[36];
    for (int i = 0; i < 36; i++) factor[i] = prior[place_of(i / SHAPE, i % SHAPE)];
    if (fl_cholesky(factor, SHAPE)) return 1;
    for (int column = 0; column < SHAPE; column++) {
        real unit[SHAPE] = {0};
        unit[column] = 1;
        fl_forward(factor, SHAPE, unit);
        for (int row = 0; row < SHAPE; row++) finer[SHAPE * row + column] = unit[row];
    }
    turned(finer, textbook, left);
    for (int i = 0; i < 36; i++) left[i] = (real)(i % (SHAPE + 1) == 0) - left[i];
    fl_eigen(left, SHAPE, shares);
    for (int row = 0; row < SHAPE; row++)
        for (int column = 0; column < SHAPE; column++) {
            real sum = 0;
            for (int k = 0; k < SHAPE; k++) sum += left[SHAPE * k + row] * finer[SHAPE * k + column];
            turn[SHAPE * row + column] = sum;
        }
    return 0;
}

/* p-value of a test of the earlier soft iron. The fit, with a prior of inverse covariance Π, changes the shape by d, which has
 * by chance the covariance
 *
 *     var d = (1 − A Π) P (1 − A Π)ᵀ + C − A Π A,        χ² = dᵀ (var d)⁻¹ d
 *
 * with the covariance P of the earlier shape, and those of the fit for independent (A) and for correlated (C) residuals. Only
 * directions with enough information from readings are tested. */
real flinders_soft_iron_p_value(const flinders_earlier *earlier, const real shape[6], const real textbook[81],
                                const real covariance[81])
{
    flinders_earlier freer = *earlier;
    real turn[36], shares[SHAPE], known[36], found[36], apart[SHAPE], moved[SHAPE], spread[36], square;
    int first = 0;
    flinders_allow_change(&freer);
    if (directions_of(freer.covariance, textbook, turn, shares)) return FL_NOT_A_NUMBER;
    turned(turn, earlier->covariance, known);
    turned(turn, covariance, found);
    for (int i = 0; i < SHAPE; i++) apart[i] = shape[i] - earlier->parameters[3 + i];
    fl_multiply(turn, apart, SHAPE, SHAPE, 1, moved);
    while (first < SHAPE && !(shares[first] > MIN_READINGS_SHARE)) first++;
    const int n = SHAPE - first;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const real ours = shares[first + i], theirs = shares[first + j];
            const int at = SHAPE * (first + i) + first + j;
            spread[n * i + j] = ours * theirs * known[at] + found[at] - (i == j ? (1 - ours) * (1 - ours) : 0);
        }
    const int freedom = n ? fl_chi_square(moved + first, spread, n, &square) : 0;
    return freedom ? fl_chance_of(square, (real)freedom, 0) : 1;
}

/* Fit with the prior; the record has FLINDERS_REFRESHED, for its verdict. */
static int fit_with(const flinders_earlier *earlier, const real *field, const real *time, size_t rows,
                    const flinders_options *options, void *workspace, size_t size, flinders_record *record)
{
    flinders_options informed = *options;
    inform(earlier, &informed);
    flinders_fit(field, time, rows, &informed, workspace, size, record);
    record->sources = FLINDERS_REFRESHED;
    record->distortion = earlier->distortion;
    return record->status;
}

/* Error of readings that are insufficient for a refresh. */
static int refused(const real *field, size_t rows, const flinders_earlier *earlier)
{
    if (rows < MIN_READINGS) return FLINDERS_TOO_FEW;
    return flinders_turn_deg(field, rows, earlier->parameters + 3) <= MIN_TURN_DEG ? FLINDERS_UNMOVED : FLINDERS_OK;
}

/* Refresh an earlier calibration. */
int flinders_refresh(const real *field, const real *time, size_t rows, const flinders_options *options,
                     const flinders_earlier *earlier, void *workspace, size_t size, flinders_record *record)
{
    flinders_earlier freer = *earlier;
    fl_clear_record(record);
    record->rows = (int64_t)rows;
    if ((record->status = refused(field, rows, earlier))) return record->status;
    flinders_allow_change(&freer);
    if (fit_with(&freer, field, time, rows, options, workspace, size, record)) return record->status;
    const real chance = flinders_soft_iron_p_value(earlier, record->shape, record->textbook, record->covariance);
    const flinders_rule *const changed = fl_rules + FLINDERS_RULE_SOFT_IRON_CHANGED;
    if (!(chance < fl_comparisons[changed->first].factor))
        fit_with(earlier, field, time, rows, options, workspace, size, record);
    record->soft_iron_p_value = chance;
    return record->status;
}
