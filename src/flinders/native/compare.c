/* Difference of two calibrations of one sensor, its significance, and whether it is within a target: `flinders.comparison`
 * for one pair.
 *
 * Readings of one sensor are longer in a stronger field, which is not a property of the sensor. Therefore both ellipsoids
 * are scaled to one size; if that is their radius, their common scale is removed from both covariances.
 */
#include "judge.h"
#include "residuals.h"

/* A calibration that is scaled to the size of another. */
typedef struct {
    fl_surface surface;
    real covariance[81];
} sized;

/* Scale a calibration from one size to another; nonzero if it has no surface. */
static int bring(const flinders_calibrated *from, real factor, sized *out)
{
    real shape[6];
    for (int i = 0; i < 6; i++) shape[i] = factor * from->shape[i];
    for (int i = 0; i < 81; i++)
        out->covariance[i] = from->covariance[i] * (i / 9 < 3 ? 1 : factor) * (i % 9 < 3 ? 1 : factor);
    return fl_surface_of(from->centre, shape, &out->surface);
}

/* Remove the common scale of shapes about their mean R from a covariance: S/s, s = tr(R⁻¹S)/3, changes by
 * δS − S tr(R⁻¹δS)/3. */
static void take_scale_out(const fl_surface *middle, real covariance[81])
{
    real onto[81] = {0}, transposed[81], half[81];
    for (int i = 0; i < 9; i++) onto[10 * i] = 1;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++)
            onto[9 * (3 + i) + 3 + j] -= middle->shape[i] * middle->inverse[j] * (j < 3 ? 1 : 2) / 3;
    for (int i = 0; i < 81; i++) transposed[9 * (i % 9) + i / 9] = onto[i];
    fl_multiply(onto, covariance, 9, 9, 9, half);
    fl_multiply(half, transposed, 9, 9, 9, covariance);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < i; j++)
            covariance[9 * i + j] = covariance[9 * j + i] = (covariance[9 * i + j] + covariance[9 * j + i]) / 2;
}

/* Add squares of differences in heading over a level turn, without their mean, if one calibration corrects readings of the
 * other; returns the largest difference. */
static real turned(const fl_surface *from, const fl_surface *to, real dip_deg, real *squares)
{
    const real level = fl_cos(dip_deg / FL_TO_DEG), down = fl_sin(dip_deg / FL_TO_DEG);
    real turns[FL_HEADINGS], x = 0, y = 0, worst = 0;
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real heading = 2 * FL_PI * (real)k / FL_HEADINGS;
        const real field[3] = {level * fl_cos(heading), -level * fl_sin(heading), down};
        real reading[3], seen[3];
        fl_sym3_apply(from->shape, field, reading);
        for (int axis = 0; axis < 3; axis++) reading[axis] += from->centre[axis] - to->centre[axis];
        fl_sym3_apply(to->inverse, reading, seen);
        turns[k] = fl_atan2(-seen[1], seen[0]) - heading;
        x += fl_cos(turns[k]), y += fl_sin(turns[k]);
    }
    const real mean = fl_atan2(y, x);
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real off = FL_TO_DEG * fl_atan2(fl_sin(turns[k] - mean), fl_cos(turns[k] - mean));
        *squares += off * off;
        worst = fl_abs(off) > worst ? fl_abs(off) : worst;
    }
    return worst;
}

/* Compare offsets and shapes with the sum of their covariances, from which sigma and bound of the heading are computed. */
static void by_chance(const sized *first, const sized *second, const fl_surface *middle, real dip_deg, flinders_difference *out)
{
    real apart[9], sum[81], rms_deg;
    fl_bound shared;
    for (int i = 0; i < 3; i++) apart[i] = second->surface.centre[i] - first->surface.centre[i];
    for (int i = 0; i < 6; i++) apart[3 + i] = second->surface.shape[i] - first->surface.shape[i];
    for (int i = 0; i < 81; i++) sum[i] = first->covariance[i] + second->covariance[i];
    out->freedom = fl_chi_square(apart, sum, 9, &out->chi_square);
    out->p_value = fl_chance_of(out->chi_square, (real)out->freedom, 0);
    fl_bound_begin(&shared);
    fl_tilted_error(middle, sum, dip_deg, 0, NULL, &rms_deg, &out->sigma_deg);
    out->bound_deg = out->freedom ? fl_heading_bound(middle, sum, dip_deg, NULL, &shared) : 0;
}

/* Compare two calibrations of one sensor. */
int flinders_compare(const flinders_calibrated *first, const flinders_calibrated *second, real dip_deg,
                     flinders_difference *out)
{
    const real nothing = FL_NOT_A_NUMBER;
    const int is_known = first->strength > 0 && second->strength > 0;
    sized one, other;
    fl_surface middle;
    real shape[6], squares = 0;
    const flinders_difference unknown = {nothing, nothing, nothing, nothing, 0, nothing, nothing};
    *out = unknown;
    if (!(fl_abs(dip_deg) <= 89)) return FLINDERS_BAD_OPTION;
    if (bring(first, 1, &one) || bring(second, 1, &other)) return FLINDERS_NOT_AN_ELLIPSOID;
    const real ours = is_known ? first->strength : one.surface.radius, theirs = is_known ? second->strength : other.surface.radius;
    const real common = fl_sqrt(ours) * fl_sqrt(theirs);
    if (bring(first, common / ours, &one) || bring(second, common / theirs, &other)) return FLINDERS_NOT_AN_ELLIPSOID;
    for (int i = 0; i < 6; i++) shape[i] = (one.surface.shape[i] + other.surface.shape[i]) / 2;
    if (fl_surface_of(one.surface.centre, shape, &middle)) return FLINDERS_NOT_AN_ELLIPSOID;
    if (!is_known) take_scale_out(&middle, one.covariance), take_scale_out(&middle, other.covariance);
    const real forth = turned(&one.surface, &other.surface, dip_deg, &squares);
    const real back = turned(&other.surface, &one.surface, dip_deg, &squares);
    out->worst_deg = forth > back ? forth : back;
    out->rms_deg = fl_sqrt(squares / (2 * FL_HEADINGS));
    by_chance(&one, &other, &middle, dip_deg, out);
    return FLINDERS_OK;
}

/* Whether a difference in heading is within a target. */
int flinders_holds(real worst_deg, real sigma_deg, real bound_deg, real p_value, real target_deg)
{
    const int is_beyond = worst_deg - (real)FLINDERS_ONE_SIDED * sigma_deg > target_deg;
    const int is_by_chance = sigma_deg > 0 && !(p_value < (real)FLINDERS_CHANCE);
    if (worst_deg + bound_deg <= target_deg) return FLINDERS_HOLDS;
    return is_beyond && !is_by_chance ? FLINDERS_FAILS : FLINDERS_CANNOT_TELL;
}
