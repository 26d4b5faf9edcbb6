/* Judgement of a fit: quantities of its record, rules of the catalogue of findings, causes and consequences, and the
 * assumptions of a verdict. */
#include "judge.h"

enum { NO_SEVERITY = FLINDERS_NOTHING };

#define MIN_EARTH_FIELD_UT ((real)22) /* microtesla */
#define MAX_EARTH_FIELD_UT ((real)67) /* microtesla */
#define MIN_READINGS ((real)15) /* claims of 15 readings at rest are as wrong as true ones (`benchmarks.claims`) */
#define MIN_CORRELATED_READINGS ((real)20) /* the number of equivalent independent readings is only known roughly */
#define DRIFT_TARGET_SHARE ((real)0.5) /* largest drift over the target, if halves of the recording differ by more than they claim */
#define MIN_DIFFERENCE_SIGMAS ((real)3) /* smallest significant difference of halves or recordings, in standard deviations */
#define MIN_CHANGE_TARGET_SHARE ((real)0.25) /* smallest change that matters, over the target */
#define MAX_ALTERNATION ((real)-0.25) /* correlation of a residual with the next that neither noise nor slow changes have */
#define MAX_UNSTEADY_TARGET_SHARE ((real)1.25) /* largest momentary heading error from an unsteady field, over the target: from noise, */
#define MAX_SWITCHING_TARGET_SHARE ((real)0.8) /* and from loads that are switched */
#define MIN_SWITCHING_KURTOSIS ((real)7) /* of 1,200 recordings with slow noise none has it; switched loads have 7 to 34 */
#define MAX_STRENGTH_DIFFERENCE ((real)0.03) /* largest relative difference of readings from the known strength of the place */
#define MIN_DURATION_S ((real)10) /* shortest recording that shows more than one state of the body */
#define MAX_P_VALUE ((real)1e-4) /* largest p-value of proven nonlinear or late axes */
#define MIN_COST_RATIO ((real)0.5) /* smallest ratio of the heading errors of two faults of axes at which the likelier one is the cause of the other */
#define MIN_SWAP_CORRELATION ((real)0.05) /* smallest correlation of a residual with the next if axes were swapped */

static real larger(real a, real b) { return a > b ? a : b; }
static real smaller(real a, real b) { return a < b ? a : b; }
static real or_zero(real number) { return isnan(number) ? 0 : number; }

/* A number if a condition is true, else absent. */
static real where(int applies, real number) { return applies ? number : FL_NOT_A_NUMBER; }

/* Value of a quantity that was checked and is absent: beyond no limit, but not unknown. */
static real absent(void) { return -(real)INFINITY; }

/* A count, which is negative if unknown. */
static real count_of(int64_t count) { return where(count >= 0, (real)count); }

/* A fault of axes that is proven. */
static int is_proven(real deg, real by_chance) { return by_chance < MAX_P_VALUE && !isnan(deg); }

/* Strength of the level field, unit. */
static real level_of(const flinders_record *record) { return record->radius * fl_cos(record->dip_deg / FL_TO_DEG); }

/* Direction-dependent error; for a ring of directions, the fit absorbs nearly all of it. */
static real distortion_of(const flinders_record *record) { return record->plane ? 0 : or_zero(record->distortion); }

/* Heading error that depends on the direction: the distortion along the field, taken as large across it; or a proven
 * fault of axes, and the rest after linearization. */
static real structure_of(const flinders_record *record)
{
    real whole = larger(FL_TO_DEG * distortion_of(record) / level_of(record), 0);
    if (is_proven(record->nonlinear_deg, record->nonlinear_by_chance)) whole = larger(whole, record->nonlinear_deg);
    if (is_proven(record->lag_deg, record->lag_by_chance)) whole = larger(whole, record->lag_deg);
    return fl_sqrt(whole * whole + or_zero(record->linearized_deg) * or_zero(record->linearized_deg));
}

/* A covariance with direction-dependent errors. */
void flinders_with_structure(const real shape[6], const real covariance[81], real structure_deg, real dip_deg, real out[81])
{
    const real sigma = structure_deg / FL_TO_DEG * fl_cos(dip_deg / FL_TO_DEG);
    const real s[9] = {shape[0], shape[3], shape[4], shape[3], shape[1], shape[5], shape[4], shape[5], shape[2]};
    memcpy(out, covariance, 81 * sizeof *out);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) out[9 * i + j] += sigma * sigma * s[3 * i + k] * s[3 * k + j];
}

/* Expected heading errors, and the covariance for them at any dip and attitude. */
static void expect(const flinders_record *record, flinders_judgement *out)
{
    const real structure = structure_of(record);
    out->structure_deg = structure;
    out->rms_deg = fl_sqrt(record->level_rms_deg * record->level_rms_deg + structure * structure);
    out->worst_deg = fl_sqrt(record->level_worst_deg * record->level_worst_deg + structure * structure);
    flinders_with_structure(record->shape, record->covariance, structure, record->dip_deg, out->covariance);
}

/* Directions that the readings do not determine, if they are not reported elsewhere: for a level turn once; for an
 * attitude, which gives three equations per reading, by the covariance and the share of the prior. */
static int is_determined(const flinders_record *record)
{
#ifdef FLINDERS_SMALL /* a board has neither */
    (void)record;
    return 0;
#else
    return record->plane || record->sources & (FLINDERS_REFRESHED | FLINDERS_AIDED_BY_ATTITUDE);
#endif
}

/* Coverage by readings, and extrapolation of the surface. */
static void of_shape(const flinders_record *record, real *q)
{
    real axes[3], extent = 0;
    const int is_known = record->plane || record->sources & (FLINDERS_REFRESHED | FLINDERS_AIDED);
    const real width = fl_sqrt(record->principal_variances[2]);
    const real flat = smaller(larger(FL_FLAT_NOISE * record->noise, FL_FLAT * width), FL_FLATTEST * width);
    for (int axis = 0; axis < 3; axis++) extent = larger(extent, record->highest[axis] - record->lowest[axis]);
    fl_sym3_values(record->shape, axes);
    q[FLINDERS_Q_FLATNESS] = where(!is_known && width > 0, fl_sqrt(larger(record->principal_variances[0], 0)) / width);
    q[FLINDERS_Q_BREADTH] = where(width > 0, fl_sqrt(larger(record->principal_variances[1], 0)) / width);
    q[FLINDERS_Q_FLATNESS_LIMIT] = where(width > 0, flat / width);
    q[FLINDERS_Q_INFLATION] = where(extent > 0 && !is_determined(record), 2 * axes[2] / extent);
    q[FLINDERS_Q_AXIS_RATIO] = axes[2] / axes[0];
}

/* Heading errors by the covariance; an unknown error is above any target. */
static void of_accuracy(const flinders_record *record, const flinders_request *request, const flinders_judgement *out, real *q)
{
    q[FLINDERS_Q_TARGET_DEG] = request->target_deg;
    q[FLINDERS_Q_WORST_DEG] = isnan(out->worst_deg) ? (real)INFINITY : out->worst_deg;
    q[FLINDERS_Q_ALIGNMENT_DEG] = where(request->rotation == 2, record->alignment_deg);
    q[FLINDERS_Q_BIAS_DEG] = record->bias_deg;
    q[FLINDERS_Q_UNCORRECTED_DEG] = where(record->is_shrunk != 0, absent());
    q[FLINDERS_Q_IS_PLANAR] = record->plane != 0;
}

#ifndef FLINDERS_SMALL
/* Improvement of readings that were corrected before, and tilt limit of a level turn. */
static void of_attitude(const fl_surface *surface, const flinders_record *record, const flinders_request *request,
                        const flinders_judgement *out, real *q)
{
    const real *const down = fl_down(record->plane);
    real rms, tilted;
    if (record->is_shrunk > 0)
        fl_uncorrected_error(surface, record->dip_deg, down, &rms, q + FLINDERS_Q_UNCORRECTED_DEG);
    if (!record->plane) return;
    fl_tilted_error(surface, out->covariance, record->dip_deg, 1, down, &rms, &tilted);
    q[FLINDERS_Q_PER_DEGREE_OF_TILT] = fl_sqrt(larger(tilted * tilted - out->worst_deg * out->worst_deg, 0));
    q[FLINDERS_Q_ATTITUDE_LIMIT_DEG] =
        fl_attitude_limit(surface, out->covariance, record->dip_deg, request->target_deg, down);
}
#endif

/* Amount of data; the limits of a level turn are reported once. */
static void of_evidence(const flinders_record *record, real *q)
{
    const real all = (real)record->used, per_reading = record->correlation_time * record->excess_variance;
    real independent = all;
    if (!isnan(per_reading)) {
        independent = smaller(all, (real)record->fitted / record->repetition / per_reading);
        independent = smaller(independent, (real)record->fitted_distinct);
    }
    q[FLINDERS_Q_SAMPLES] = where(all > 0, all);
    q[FLINDERS_Q_HOLE_DEG] = where(!is_determined(record), record->hole_deg);
    q[FLINDERS_Q_COVERED] = record->coverage;
    q[FLINDERS_Q_UNOBSERVED] = record->plane ? 0 : (real)record->unobserved;
    q[FLINDERS_Q_PRIOR_SHARE] = where(!record->plane && !record->unobserved, record->prior_influence);
    q[FLINDERS_Q_INDEPENDENT] = where(all > 0, independent);
    q[FLINDERS_Q_INDEPENDENT_NEEDED] = independent < all ? MIN_CORRELATED_READINGS : MIN_READINGS;
    q[FLINDERS_Q_INDEPENDENT_SHARE] = independent / larger(all, 1);
    q[FLINDERS_Q_NOISE_SHARE] = record->noise / record->radius;
    q[FLINDERS_Q_OUTLIER_SHARE] = (real)record->rejected / larger((real)record->fitted, 1);
    q[FLINDERS_Q_FARTHEST] = where(record->rejected > 0, record->farthest);
}

#ifndef FLINDERS_SMALL /* a board keeps some readings, and no statistics of their residuals */
/* Correlation of residuals of successive distinct readings, and alternation. */
static void of_residuals(const flinders_record *record, const flinders_request *request, real *q)
{
    const real next = record->lag_one, level = level_of(record);
    const real repeated = (real)record->fitted_repeats / larger((real)record->fitted, 1);
    const real unlike = larger(next - repeated, 0) / (1 - repeated);
    const real off = fl_sqrt(larger(-3 * next, 0)) * record->noise; /* a residual shows its part along the normal */
    if (isnan(next)) return;
    q[FLINDERS_Q_NOISE_LASTS] = or_zero(record->noise_lasts);
    q[FLINDERS_Q_UNLIKE_CORRELATION] = unlike;
    q[FLINDERS_Q_UNSTEADY_DEG] = FL_TO_DEG * record->noise * fl_sqrt(unlike) / level;
    q[FLINDERS_Q_UNSTEADY_LIMIT_DEG] =
        request->target_deg * (record->steps_kurtosis > MIN_SWITCHING_KURTOSIS ? MAX_SWITCHING_TARGET_SHARE : MAX_UNSTEADY_TARGET_SHARE);
    q[FLINDERS_Q_NEXT_CORRELATION] = next;
    q[FLINDERS_Q_ALTERNATING_LIMIT] = smaller(MAX_ALTERNATION, -4 / fl_sqrt(larger((real)record->used, 1)));
    q[FLINDERS_Q_ALTERNATING_DEG] = FL_TO_DEG * fl_atan2(off, level);
}

/* Which faults of axes are named: the other one is left out where the likelier one costs half as much or more. */
static void named_faults(const flinders_record *record, int *bent, int *late)
{
    *bent = is_proven(record->nonlinear_deg, record->nonlinear_by_chance);
    *late = is_proven(record->lag_deg, record->lag_by_chance);
    if (!*bent || !*late) return;
    if (record->lag_by_chance < record->nonlinear_by_chance) *bent = record->lag_deg < MIN_COST_RATIO * record->nonlinear_deg;
    else *late = record->nonlinear_deg < MIN_COST_RATIO * record->lag_deg;
}

/* The largest terms of an axis, a fraction of the field. */
static real bent_share(const flinders_record *record)
{
    real most = 0;
    for (int axis = 0; axis < 3; axis++)
        most = larger(most, fl_abs(record->nonlinearity[axis]) + fl_abs(record->nonlinearity[3 + axis]));
    return most;
}

/* Direction-dependent errors: nonlinear or late axes if proven, else of unknown cause. */
static void of_structure(const flinders_record *record, const flinders_judgement *out, real *q)
{
    int bent, late;
    named_faults(record, &bent, &late);
    q[FLINDERS_Q_STRUCTURE_DEG] = out->structure_deg;
    q[FLINDERS_Q_STRUCTURE_SHARE] = isnan(record->distortion) ? record->distortion
                                    : bent ? absent() : distortion_of(record) / record->radius;
    q[FLINDERS_Q_NONLINEAR_DEG] = isnan(record->nonlinear_deg) || bent ? record->nonlinear_deg : absent();
    q[FLINDERS_Q_NONLINEAR_SHARE] = where(bent, bent_share(record));
    q[FLINDERS_Q_LAG_DEG] = isnan(record->lag_deg) || late ? record->lag_deg : absent();
    q[FLINDERS_Q_LINEARIZED_DEG] = record->linearized_deg;
    q[FLINDERS_Q_LINEARIZED_SHARE] = record->linearized_share;
}

/* Changes within a recording, between recordings, and with other recorded quantities. */
static void of_changes(const flinders_record *record, const flinders_request *request, real *q)
{
    const real *const moved = record->drift_offset;
    const real apart = larger(MIN_CHANGE_TARGET_SHARE * request->target_deg, MIN_DIFFERENCE_SIGMAS * record->apart_sigma_deg);
    q[FLINDERS_Q_DRIFT_DEG] = record->drift_deg;
    q[FLINDERS_Q_DRIFT_ALLOWED_DEG] = request->target_deg * (or_zero(record->halves_apart) < MIN_DIFFERENCE_SIGMAS ? 1 : DRIFT_TARGET_SHARE);
    q[FLINDERS_Q_DRIFT_BY_CHANCE] = record->drift_by_chance;
    q[FLINDERS_Q_DRIFT] = fl_sqrt(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]);
    q[FLINDERS_Q_SWAP_GAIN] = record->swap_gain;
    q[FLINDERS_Q_UNMODELLED_DEG] = record->unmodelled_deg;
    q[FLINDERS_Q_ATTITUDE_DEPENDENT_DEG] = record->attitude_dependent_deg;
    q[FLINDERS_Q_TILT_ERROR_DEG] = record->tilt_error_deg;
    q[FLINDERS_Q_APART_DEG] = record->apart_deg;
    q[FLINDERS_Q_APART_BY_CHANCE] = record->apart_by_chance;
    q[FLINDERS_Q_APART_BEYOND_CLAIM_DEG] =
        where(!isnan(record->apart_deg), record->apart_deg > apart ? record->apart_deg : 0);
    q[FLINDERS_Q_SOFT_IRON_P_VALUE] = record->soft_iron_p_value;
    q[FLINDERS_Q_POSES_BY_CHANCE] = record->poses_by_chance;
}

/* Results of further checks. */
static int asks_of(const flinders_record *record, const flinders_request *request)
{
    int swaps = 0;
    for (int i = 0; i < 6; i++) swaps |= record->swaps[i] > 0;
    const flinders_rule *const changed = fl_rules + FLINDERS_RULE_FIELD_CHANGED;
    const real by_chance = fl_comparisons[changed->first + changed->grades].factor;
    const int is_change = record->drift_by_chance < by_chance && record->drift_deg > MIN_CHANGE_TARGET_SHARE * request->target_deg &&
                          record->drift_deg <= request->target_deg;
    const int may_be_swapped = !record->is_white && (record->unobserved || record->lag_one >= MIN_SWAP_CORRELATION);
    return (is_change ? FLINDERS_ASKS_HALVES : 0) |
           (swaps && (record->is_robust || may_be_swapped) ? FLINDERS_ASKS_SWAP : 0);
}
#endif

#ifndef FLINDERS_SMALL
/* Difference of the strength by readings from that of the site, if known. */
static void of_site(const flinders_record *record, real *q)
{
    q[FLINDERS_Q_STRENGTH_SIGMAS] = where(!isnan(record->site_strength), record->strength_sigmas);
    q[FLINDERS_Q_STRENGTH_FOUND] = record->strength_found;
    q[FLINDERS_Q_SITE_STRENGTH] = record->site_strength;
}
#endif

/* Quantities of the calibration alone. */
static void of_calibration(const flinders_record *record, const flinders_request *request, real *q)
{
    const real radius = record->radius, nearest = smaller(larger(radius, MIN_EARTH_FIELD_UT), MAX_EARTH_FIELD_UT);
    const int is_relative = !request->is_strength_known;
    q[FLINDERS_Q_RADIUS] = radius;
    q[FLINDERS_Q_NEAREST_EARTH] = nearest;
    q[FLINDERS_Q_WEAKEST] = MIN_EARTH_FIELD_UT, q[FLINDERS_Q_STRONGEST] = MAX_EARTH_FIELD_UT;
    q[FLINDERS_Q_TIMES_OUTSIDE_EARTH] =
        where(request->is_microtesla && is_relative, larger(radius / nearest, nearest / radius));
    q[FLINDERS_Q_HANDEDNESS] = request->is_mirrored ? -1 : 1;
    q[FLINDERS_Q_FIELD_STRENGTH] = isnan(request->field_strength) ? radius : request->field_strength;
    q[FLINDERS_Q_IS_IN_COUNTS] = !request->is_microtesla;
    q[FLINDERS_Q_IS_RELATIVE] = (real)is_relative;
    q[FLINDERS_Q_IS_UNALIGNED] = request->rotation == 0;
    q[FLINDERS_Q_NOTHING] = 0;
}

/* Quantities of the recording. */
static void of_recording(const flinders_record *record, real *q)
{
    const real rows = larger((real)record->rows, 1), seconds = record->end - record->start;
    const int is_timed = !isnan(record->start);
    int64_t at_rail = record->rails < 0 ? -1 : 0;
    for (int end = 0; end < 6; end++)
        if (record->rails > 0 && record->rails >> end & 1 && record->end_counts[end] > at_rail)
            at_rail = record->end_counts[end];
    q[FLINDERS_Q_ROWS] = (real)record->rows;
    q[FLINDERS_Q_DISTINCT] = (real)record->distinct;
    q[FLINDERS_Q_RAIL_SHARE] = count_of(at_rail) / rows;
    q[FLINDERS_Q_REPEATED_SHARE] = where(record->distinct > 0, 1 - (real)record->distinct / rows);
    q[FLINDERS_Q_AT_REST_SHARE] = count_of(record->at_rest) / rows;
    q[FLINDERS_Q_STEP] = record->step;
    q[FLINDERS_Q_PATH_CORRELATION] = where(!is_timed, record->path_correlation);
    q[FLINDERS_Q_BACKWARD_STEPS] = where(is_timed, (real)record->backward_steps);
    q[FLINDERS_Q_LONGEST_STEP_S] = where(is_timed, record->longest_step);
    q[FLINDERS_Q_USUAL_STEP_S] = where(is_timed, seconds / larger((real)record->rows - 1, 1));
    q[FLINDERS_Q_SKIPPED] = count_of(record->skipped);
    q[FLINDERS_Q_SILENT] = count_of(record->silent);
    q[FLINDERS_Q_IS_DOUBTFUL] = count_of(record->is_doubtful);
}

/* Limit of a comparison. */
static real limit_of(const flinders_comparison *it, const real *q)
{
    return it->factor * (it->of < FLINDERS_QUANTITIES ? q[it->of] : 1);
}

/* Whether a comparison is true. */
static int holds(const flinders_comparison *it, const real *q)
{
    const real number = q[it->quantity], limit = limit_of(it, q);
    return it->comparison == '<' ? number < limit : it->comparison == '>' ? number > limit : number >= limit;
}

/* Apply a rule: the severity is that of the last comparison that is true. */
static uint8_t severity_of(const flinders_rule *rule, const real *q)
{
    const flinders_comparison *const grades = fl_comparisons + rule->first, *const needs = grades + rule->grades;
    uint8_t severity = NO_SEVERITY;
    for (int i = 0; i < rule->grades && holds(grades + i, q); i++) severity = grades[i].severity;
    for (int i = 0; i < rule->needs; i++)
        if (!holds(needs + i, q)) return NO_SEVERITY;
    return severity;
}

/* A rule of the catalogue. */
const flinders_rule *flinders_rule_of(int rule) { return rule >= 0 && rule < FL_RULES ? fl_rules + rule : NULL; }

/* Whether a rule can be applied. */
int flinders_is_checked(int rule, const real *quantities)
{
    const flinders_rule *const it = flinders_rule_of(rule);
    if (!it) return 0;
    for (int i = 0; i < it->grades + it->needs; i++) {
        const flinders_comparison *const comparison = fl_comparisons + it->first + i;
        if (isnan(quantities[comparison->quantity]) || isnan(limit_of(comparison, quantities))) return 0;
    }
    return 1;
}

/* Apply a rule of the catalogue. */
int flinders_severity(int rule, const real *quantities)
{
    return rule >= 0 && rule < FL_RULES ? severity_of(fl_rules + rule, quantities) : NO_SEVERITY;
}

/* Apply the rules of a fit. Consequences of an undetermined surface are not findings. */
static void apply(flinders_judgement *out)
{
    const int own = FLINDERS_RULES_OF_A_FIT - FLINDERS_RULES_OF_A_RECORDING;
    const uint8_t flat = severity_of(fl_rules + FLINDERS_RULE_ONE_PLANE, out->quantities);
    for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++) {
        const int is_supported = !flat || i == FLINDERS_RULE_ONE_PLANE || i >= own;
        out->severities[i] = is_supported ? severity_of(fl_rules + i, out->quantities) : NO_SEVERITY;
    }
}

/* Findings that follow from a cause that is there: marks them, and shows the cause as severe as the worst of them. */
static void follow(const fl_cause *cause, const uint8_t *is_first, flinders_judgement *out)
{
    uint8_t worst = out->severities[cause->code];
    for (int i = 0; i < cause->count; i++) {
        const uint8_t code = cause->consequences[i];
        if (!out->shown[code] || is_first[code]) continue;
        worst = out->severities[code] > worst ? out->severities[code] : worst;
        out->shown[code] = NO_SEVERITY, out->causes[code] = (uint8_t)(cause->code + 1);
    }
    out->shown[cause->code] = worst;
}

/* Select the findings to show: by severity, then causes in their order. */
void flinders_causes(flinders_judgement *out)
{
    uint8_t first[FLINDERS_CAUSES], is_first[FLINDERS_RULES_OF_A_FIT] = {0};
    int causes = 0, place = 0;
    out->verdict = NO_SEVERITY;
    memset(out->causes, 0, sizeof out->causes);
    memcpy(out->shown, out->severities, sizeof out->shown);
    for (int i = 0; i < FLINDERS_CAUSES; i++) {
        const fl_cause *const cause = fl_causes + i;
        const int is_excused = cause->unless < FLINDERS_RULES_OF_A_FIT && out->severities[cause->unless];
        if (!out->shown[cause->code] || is_first[cause->code] || out->severities[cause->code] < cause->severity || is_excused)
            continue;
        is_first[cause->code] = 1, first[causes++] = cause->code, out->causes[cause->code] = (uint8_t)(cause->code + 1);
        follow(cause, is_first, out);
    }
    for (uint8_t severity = FLINDERS_REFUSES; severity > NO_SEVERITY; severity--) {
        for (int i = 0; i < causes; i++)
            if (out->shown[first[i]] == severity) out->order[place++] = first[i];
        for (uint8_t i = 0; i < FLINDERS_RULES_OF_A_FIT; i++)
            if (out->shown[i] == severity && !is_first[i]) out->order[place++] = i;
    }
    for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++)
        if (out->severities[i] > out->verdict) out->verdict = out->severities[i];
    while (place < FLINDERS_RULES_OF_A_FIT) out->order[place++] = FLINDERS_RULES;
}

/* What a verdict rests on and nothing here shows. A field that depends on the attitude, of iron at the place or of a current,
 * hides in the calibration itself. A second recording that agrees, the accelerometer's dip, and a known strength of the field
 * that the readings have speak for a place without iron; currents that are compensated speak for themselves. A few seconds show
 * one state of a body, whose display, currents or holder change the offset in use. */
static int conditions_of(const flinders_record *record, const flinders_request *request, const flinders_judgement *out)
{
    const int agrees = !isnan(record->apart_deg) && !out->severities[FLINDERS_RULE_RECORDINGS_DIFFER];
    const real times = record->radius / request->field_strength;
    const int is_absolute = request->is_microtesla && request->is_strength_known;
    const int matches = is_absolute && fl_abs(times - 1) < MAX_STRENGTH_DIFFERENCE;
    const int is_uniform = agrees || matches || record->sources & FLINDERS_AIDED_BY_FIELD;
#ifdef FLINDERS_SMALL /* of a board there are no times */
    const int is_short = 0;
#else
    const int is_short = record->end - record->start < MIN_DURATION_S && !agrees;
#endif
    const int is_constant = is_short || record->sources & FLINDERS_COMPENSATED;
    if (out->verdict >= FLINDERS_REFUSES) return 0;
    return (record->sources & FLINDERS_REFRESHED ? FLINDERS_IF_SAME_SOFT_IRON : 0) |
           (is_short ? FLINDERS_IF_UNCHANGED_BODY : 0) | (is_uniform ? 0 : FLINDERS_IF_UNIFORM_FIELD) |
           (is_constant ? 0 : FLINDERS_IF_CONSTANT_IRON);
}

/* Fill a judgement with unknown values. */
static void clear(flinders_judgement *out)
{
    memset(out, 0, sizeof *out);
    for (int i = 0; i < FLINDERS_QUANTITIES_OF_A_FIT; i++) out->quantities[i] = FL_NOT_A_NUMBER;
    for (int i = 0; i < 81; i++) out->covariance[i] = FL_NOT_A_NUMBER;
    out->rms_deg = out->worst_deg = out->bound_deg = out->structure_deg = FL_NOT_A_NUMBER;
    memset(out->order, FLINDERS_RULES, sizeof out->order);
    out->verdict = FLINDERS_REFUSES;
}

/* Judge a fit; `shared` has shared tables of bounds, NULL on a board. */
static int judge(flinders_record *record, const flinders_request *request, fl_bound *shared, flinders_judgement *out)
{
    fl_surface surface;
    clear(out);
    if (!(request->target_deg > 0) || !(fl_abs(record->dip_deg) <= 89)) return FLINDERS_BAD_OPTION;
    if (fl_surface_of(record->centre, record->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    flinders_claim(record, request);
    fl_surface_of(record->centre, record->shape, &surface);
    expect(record, out);
    of_shape(record, out->quantities);
    of_accuracy(record, request, out, out->quantities);
#ifdef FLINDERS_SMALL
    (void)shared;
#else
    out->bound_deg = fl_heading_bound(&surface, out->covariance, record->dip_deg, fl_down(record->plane), shared);
    of_attitude(&surface, record, request, out, out->quantities);
    of_residuals(record, request, out->quantities);
    of_structure(record, out, out->quantities);
    of_changes(record, request, out->quantities);
    of_site(record, out->quantities);
    out->asks = asks_of(record, request);
#endif
    of_evidence(record, out->quantities);
    of_calibration(record, request, out->quantities);
    of_recording(record, out->quantities);
    apply(out);
    flinders_causes(out);
    out->conditions = conditions_of(record, request, out);
    return FLINDERS_OK;
}

#ifdef FLINDERS_SMALL
/* Judge a fit. */
int flinders_judge(flinders_record *record, const flinders_request *request, flinders_judgement *out)
{
    return judge(record, request, NULL, out);
}
#else
/* Judge a fit. */
int flinders_judge(flinders_record *record, const flinders_request *request, flinders_judgement *out)
{
    fl_bound shared;
    fl_bound_begin(&shared);
    return judge(record, request, &shared, out);
}

/* Judge many fits. */
void flinders_judge_many(flinders_record *records, size_t count, const flinders_request *request,
                         flinders_judgement *judgements)
{
    fl_bound shared;
    fl_bound_begin(&shared);
    for (size_t i = 0; i < count; i++) {
        if (records[i].status == FLINDERS_OK) judge(records + i, request, &shared, judgements + i);
        else clear(judgements + i);
    }
}
#endif

/* Fill a request with its defaults. */
void flinders_default_request(flinders_request *request)
{
    memset(request, 0, sizeof *request);
    request->target_deg = 1, request->field_strength = FL_NOT_A_NUMBER;
    request->is_microtesla = request->shrinks = 1, request->parameters = 9;
}

/* Size of a judgement in bytes. */
size_t flinders_judgement_size(void) { return sizeof(flinders_judgement); }
