/* Combination of a fit of the magnetometer alone with the known field of a site.
 *
 * A level turn determines two columns of S, and one sum of the third with the offset. With the field
 * u = (cos I cos ψ, -cos I sin ψ, sin I), readings are
 *
 *     x = c + cos I (S₁ cos ψ - S₂ sin ψ),     c = b + sin I S₃
 *
 * for the columns S₁, S₂, S₃ of the shape. A tilt changes the z component of the field from sin I to sin I + ε, and the
 * uncertainty of S₃ has an effect only with ε: the heading error increases with the tilt. Three equations determine S₃ and b:
 *
 *     the dip        b₃ = c₃ - sin I S₃₃, where c₃ is the z component of the turn's centre
 *     the strength   S₁₁ + S₂₂ + S₃₃ = 3 F to within the gain
 *     the mounting   S₃₁, S₃₂ are the slopes of the turn's plane; that they are S₁₃, S₂₃ as well holds as far as the
 *                    sensor's z is the axis that it was turned about: to (S₁₁ + S₃₃) ρ for an angle ρ between them
 *
 * The last one is used if the uncertainty of the mounting is stated. The uncertainty of the dip is that of the site plus that
 * of the vehicle's level attitude, 1 degree or more by an accelerometer: on a slope, the dip relative to the vehicle differs.
 *
 * Readings of a level turn do not show whether z points down or up; the offset differs by 2 sin I S₃ between the two. The
 * offset for z down is used. Unless this direction is known by an accelerometer or a statement, the mean square error for equal
 * probabilities widens the claim by 2 sin² I S₃ S₃ᵀ. This has no effect on a level heading: S⁻¹ S₃ is the third axis.
 *
 * For a fit to readings outside one plane, only the strength is used.
 *
 * Source: first-order propagation of these equations; conditioning a normal distribution as in R. E. Kalman, A new approach
 * to linear filtering and prediction problems (1960), eq. 21-25.
 */
#include "judge.h"
#include "record.h"

enum { PARAMETERS = 9, ROUNDS = 3 };

#define LEVEL_SIGMA_DEG ((real)1) /* 1 sigma of the tilt of a floor, or of a moored boat, that is stated to be level */
#define MIN_UPRIGHT_COSINE ((real)0.8660254037844387) /* smallest component of z along the vertical: an accelerometer beyond 30 degrees has other axes */
#define MAX_HEIGHT_DEVIATIONS ((real)6) /* limit for outliers in height, in median deviations */
#define MIN_TILT_RATIO ((real)10) /* smallest ratio of a significant squared tilt to its variance, exceeded by chance in one of 20,000 */
#define MIN_TURN_SPREAD ((real)0.6) /* 1 - |mean direction|² of half a turn: 1 - (2/π)², rounded */

static real square(real number) { return number * number; }
static real larger(real a, real b) { return a > b ? a : b; }

/* The nine parameters of a record. */
static void parameters_of(const flinders_record *record, real parameters[PARAMETERS])
{
    memcpy(parameters, record->centre, sizeof record->centre);
    memcpy(parameters + 3, record->shape, sizeof record->shape);
}

/* Condition parameters and covariance on a value of a linear function of them, with a sigma. */
static void condition(real parameters[PARAMETERS], real covariance[81], const real row[PARAMETERS], real value, real sigma)
{
    real along[PARAMETERS], gain[PARAMETERS], rest[81], half[81], spread = sigma * sigma;
    for (int i = 0; i < PARAMETERS; i++) {
        along[i] = 0;
        for (int j = 0; j < PARAMETERS; j++) along[i] += row[j] * covariance[PARAMETERS * j + i];
        value -= row[i] * parameters[i];
    }
    for (int i = 0; i < PARAMETERS; i++) spread += row[i] * along[i];
    if (!(spread > 0)) return;
    for (int i = 0; i < PARAMETERS; i++) gain[i] = along[i] / spread, parameters[i] += gain[i] * value;
    for (int i = 0; i < 81; i++) rest[i] = (i % 10 == 0) - gain[i / PARAMETERS] * row[i % PARAMETERS];
    fl_multiply(rest, covariance, PARAMETERS, PARAMETERS, PARAMETERS, half);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++) {
            real sum = sigma * sigma * gain[i] * gain[j];
            for (int k = 0; k < PARAMETERS; k++) sum += half[PARAMETERS * i + k] * rest[PARAMETERS * j + k];
            covariance[PARAMETERS * i + j] = sum;
        }
}

/* Write parameters and covariances to a record; 0, without a change, if they are not an ellipsoid. */
static int put(const real parameters[PARAMETERS], const real covariance[81], const real textbook[81], flinders_record *record)
{
    fl_surface surface;
    if (fl_surface_of(parameters, parameters + 3, &surface)) return 0;
    memcpy(record->centre, surface.centre, sizeof record->centre);
    memcpy(record->shape, surface.shape, sizeof record->shape);
    memcpy(record->covariance, covariance, sizeof record->covariance);
    memcpy(record->textbook, textbook, sizeof record->textbook);
    record->radius = surface.radius;
    return 1;
}

/* ---------------------------------------------------------------------------------------------------------- strength */

/* Difference of strengths, in standard deviations, above which the unit or the gain is wrong: the limit of the finding. */
static real contradicted(void) { return fl_comparisons[fl_rules[FLINDERS_RULE_STRENGTH_DIFFERS].first].factor; }

/* Whether the strength of a site was used in a record. */
int flinders_uses_strength(const flinders_record *record)
{
    return !isnan(record->site_strength) && record->strength_sigmas <= contradicted();
}

/* Condition the mean semi-axis on the strength of the site, unless the readings contradict it. */
static void by_strength(const flinders_site *site, flinders_record *record)
{
    static const real ROW[PARAMETERS] = {0, 0, 0, (real)1 / 3, (real)1 / 3, (real)1 / 3, 0, 0, 0};
    const real sigma = site->gain_sigma * site->strength;
    real parameters[PARAMETERS], unused[PARAMETERS], covariance[81], textbook[81], variance = 0;
    if (!(site->strength > 0 && site->gain_sigma > 0 && isfinite(sigma))) return;
    for (int i = 3; i < 6; i++)
        for (int j = 3; j < 6; j++) variance += record->covariance[PARAMETERS * i + j] / 9;
    record->site_strength = site->strength;
    record->strength_found = (record->shape[0] + record->shape[1] + record->shape[2]) / 3;
    record->strength_sigmas =
        fl_abs(site->strength - record->strength_found) / fl_sqrt(sigma * sigma + larger(variance, 0));
    if (!flinders_uses_strength(record)) return;
    parameters_of(record, parameters), parameters_of(record, unused);
    memcpy(covariance, record->covariance, sizeof covariance), memcpy(textbook, record->textbook, sizeof textbook);
    condition(parameters, covariance, ROW, site->strength, sigma);
    condition(unused, textbook, ROW, site->strength, sigma);
    if (!put(parameters, covariance, textbook, record)) record->site_strength = FL_NOT_A_NUMBER;
}

/* ------------------------------------------------------------------------------------------------- plane of a level turn */

/* Least squares of heights over x and y, minus the covariance of noise, which would bias slopes towards zero. */
static void lay(const real *field, const unsigned char *out, size_t rows, const real centre[2], real noise,
                flinders_heights *heights)
{
    real normal[9] = {0}, values[3], sums[3] = {0}, solution[3] = {0}, count = 0;
    for (size_t row = 0; row < rows; row++) {
        if (out[row]) continue;
        const real at[3] = {1, field[3 * row] - centre[0], field[3 * row + 1] - centre[1]};
        for (int i = 0; i < 9; i++) normal[i] += at[i / 3] * at[i % 3];
        for (int i = 0; i < 3; i++) sums[i] += at[i] * field[3 * row + 2];
        count++;
    }
    normal[4] -= count * noise * noise, normal[8] -= count * noise * noise;
    fl_eigen(normal, 3, values);
    const real least = FL_ROUNDING * larger(fl_abs(values[0]), fl_abs(values[2]));
    for (int i = 0; i < 9; i++) heights->covariance[i] = 0;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 9 && fl_abs(values[k]) > least; i++)
            heights->covariance[i] += normal[3 * (i / 3) + k] * normal[3 * (i % 3) + k] / values[k];
    fl_multiply(heights->covariance, sums, 3, 3, 1, solution);
    heights->height = solution[0], heights->slope[0] = solution[1], heights->slope[1] = solution[2];
}

/* Distances `off` of inliers from the plane: returns their number, and the sum of squares. */
static size_t leave(const real *field, const unsigned char *out, size_t rows, const real centre[2],
                    const flinders_heights *heights, real *off, real *squares)
{
    size_t count = 0;
    *squares = 0;
    for (size_t row = 0; row < rows; row++) {
        const real *const at = field + 3 * row;
        const real expected =
            heights->height + heights->slope[0] * (at[0] - centre[0]) + heights->slope[1] * (at[1] - centre[1]);
        off[row] = fl_abs(at[2] - expected);
        if (!out[row]) *squares += off[row] * off[row], count++;
    }
    return count;
}

/* Fit a plane to inliers, and leave out outliers. */
static void plane_of(const real *field, size_t rows, const real centre[2], real noise, const fl_room *room,
                     flinders_heights *heights)
{
    unsigned char *const out = room->rejected;
    for (int round = 0; round < ROUNDS; round++) {
        real squares;
        size_t kept = 0, astray = 0;
        lay(field, out, rows, centre, noise, heights);
        const size_t count = leave(field, out, rows, centre, heights, room->distances, &squares);
        for (size_t row = 0; row < rows; row++)
            if (!out[row] && !isnan(room->distances[row])) room->scratch[kept++] = room->distances[row];
        const real limit = kept ? MAX_HEIGHT_DEVIATIONS * fl_median(room->scratch, kept) : 0;
        const real variance = squares / (count > 4 ? (real)(count - 3) : 1);
        for (size_t row = 0; row < rows; row++) astray += !out[row] && room->distances[row] > limit;
        if (limit == 0 || astray == 0 || round == ROUNDS - 1) {
            for (int i = 0; i < 9; i++) heights->covariance[i] *= variance;
            return;
        }
        for (size_t row = 0; row < rows; row++) out[row] |= room->distances[row] > limit;
    }
}

/* Fit a plane to readings. */
int flinders_plane_of(const real *field, size_t rows, const real centre[2], real noise, void *workspace, size_t size,
                      flinders_heights *heights)
{
    fl_room room;
    memset(heights, 0, sizeof *heights);
    if (rows == 0) return FLINDERS_TOO_FEW;
    if (fl_room_of(workspace, size, rows, &room)) return FLINDERS_NO_WORKSPACE;
    memset(room.rejected, 0, rows);
    plane_of(field, rows, centre, noise, &room, heights);
    return FLINDERS_OK;
}

/* ------------------------------------------------------------------------------------------------------- ellipse and dip */

/* Ellipse of a level turn: its centre, and the inverse (2, 2) of its shape. */
typedef struct {
    real middle[2], inverse[3]; /* 11, 22, 12 */
} ellipse;

static ellipse ellipse_of(const real centre[3], const real shape[6], real dip)
{
    const real flat = fl_cos(dip), height = fl_sin(dip), det = flat * (shape[0] * shape[1] - shape[3] * shape[3]);
    const ellipse found = {{centre[0] + height * shape[4], centre[1] + height * shape[5]},
                           {shape[1] / det, shape[0] / det, -shape[3] / det}};
    return found;
}

static void apply(const ellipse *it, const real x[2], real out[2])
{
    out[0] = it->inverse[0] * x[0] + it->inverse[2] * x[1];
    out[1] = it->inverse[2] * x[0] + it->inverse[1] * x[1];
}

/* Mark readings that the fit rejected, by their distance from the ellipse. */
static void mark_outliers(const real *field, size_t rows, const ellipse *around, real limit, unsigned char *out)
{
    memset(out, 0, rows);
    for (size_t row = 0; row < rows && limit > 0; row++) {
        const real off[2] = {field[3 * row] - around->middle[0], field[3 * row + 1] - around->middle[1]};
        real local[2], steep[2];
        apply(around, off, local), apply(around, local, steep);
        const real length = larger(fl_sqrt(square(local[0]) + square(local[1])), (real)1e-12);
        const real steepness = larger(fl_sqrt(square(steep[0]) + square(steep[1])) / length, FL_TINY);
        out[row] = !(fl_abs(length - 1) <= limit * steepness);
    }
}

/* Mean ratio of the variances in the plane to those of independent residuals, at least 1. */
static real wider_of(const flinders_record *record)
{
    static const int IN_PLANE[5] = {0, 10, 30, 40, 60};
    real sum = 0;
    int count = 0;
    for (int i = 0; i < 5; i++)
        if (record->textbook[IN_PLANE[i]] > 0)
            sum += record->covariance[IN_PLANE[i]] / record->textbook[IN_PLANE[i]], count++;
    return count && sum > (real)count ? sum / (real)count : 1;
}

/* M C Mᵀ of a map (9, 9), in place. */
static void carry(const real map[81], real covariance[81])
{
    real half[81];
    fl_multiply(map, covariance, PARAMETERS, PARAMETERS, PARAMETERS, half);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++) {
            covariance[PARAMETERS * i + j] = 0;
            for (int k = 0; k < PARAMETERS; k++)
                covariance[PARAMETERS * i + j] += half[PARAMETERS * i + k] * map[PARAMETERS * j + k];
        }
}

/* The map from (b, S) to (c, S) for a height of +sin I, and back for -sin I. */
static void map_of(real height, real map[81])
{
    for (int i = 0; i < 81; i++) map[i] = i % 10 == 0;
    map[7] = map[PARAMETERS + 8] = map[2 * PARAMETERS + 5] = height;
}

/* Known quantities across the plane of a turn. */
typedef struct {
    real dip, doubt; /* rad: the dip, and its standard deviation */
    flinders_heights heights;
    real wider;      /* ratio of variances to those for independent residuals */
    real slopes[2], sigmas[2]; /* S₁₃ and S₂₃ by the mounting, unit; NaN if it is unknown */
} placement;

/* Transform (c, S) and a covariance of (b, S) to (b, S) with b₃ by the dip.
 *
 * The uncertainty of S₁₃ and S₂₃ alone is in the third column, not in the third row, which the slopes determine. As S is
 * symmetric, its part s dsᵀ / S₃₃ in the plane then keeps the heading of a level vehicle by the readings. */
static void place(const placement *by, const real turned[PARAMETERS], real parameters[PARAMETERS], real covariance[81])
{
    real map[81], change[PARAMETERS];
    memcpy(parameters, turned, PARAMETERS * sizeof *parameters);
    map_of(fl_sin(by->dip), map), carry(map, covariance);
    for (int i = 0; i < PARAMETERS; i++) covariance[18 + i] = covariance[PARAMETERS * i + 2] = 0;
    covariance[20] = by->wider * by->heights.covariance[0];
    for (int i = 0; i < 2 && !isnan(by->slopes[i]); i++) {
        real row[PARAMETERS] = {0};
        row[7 + i] = 1;
        condition(parameters, covariance, row, by->slopes[i], by->sigmas[i]);
    }
    const real across[2] = {parameters[7], parameters[8]}, height = parameters[5];
    map_of(-fl_sin(by->dip), map);
    map[34] = across[0] / height, map[44] = across[1] / height;
    map[61] = across[1] / (2 * height), map[62] = across[0] / (2 * height);
    carry(map, covariance);
    parameters[0] -= fl_sin(by->dip) * across[0], parameters[1] -= fl_sin(by->dip) * across[1];
    parameters[2] -= fl_sin(by->dip) * height;
    const real tangent = fl_sin(by->dip) / fl_cos(by->dip), third[3] = {across[0], across[1], height};
    for (int i = 0; i < PARAMETERS; i++) change[i] = i < 3 ? -third[i] / fl_cos(by->dip) : tangent * parameters[i];
    for (int i = 0; i < 81; i++) covariance[i] += square(by->doubt) * change[i / PARAMETERS] * change[i % PARAMETERS];
}

/* Whether z is constant, as for a sensor without a third axis. */
static int is_flat_z(const real *field, size_t rows)
{
    for (size_t row = 1; row < rows; row++)
        if (field[3 * row + 2] != field[2]) return 0;
    return 1;
}

/* S₁₃ and S₂₃ with their uncertainty by the slopes of the plane and the mounting. */
static void by_mounting(real alignment_sigma_deg, const flinders_record *record, placement *by)
{
    const real *const s = record->shape, *const slope = by->heights.slope;
    const real askew = fl_sqrt((real)2) * alignment_sigma_deg / FL_TO_DEG * record->radius;
    by->slopes[0] = isnan(alignment_sigma_deg) ? FL_NOT_A_NUMBER : s[0] * slope[0] + s[3] * slope[1];
    by->slopes[1] = isnan(alignment_sigma_deg) ? FL_NOT_A_NUMBER : s[3] * slope[0] + s[1] * slope[1];
    for (int i = 0; i < 2; i++)
        by->sigmas[i] = fl_sqrt(askew * askew + square(record->radius) * by->wider * by->heights.covariance[4 * i + 4]);
}

/* Set offset and shape across the plane by the dip and the mounting; returns 1 if they are set. `tilt_deg` is the tilt of the
 * axis of turning. */
static int by_dip(const real *field, size_t rows, const flinders_site *site, real tilt_deg, const fl_room *room,
                  flinders_record *record)
{
    placement by = {0};
    real turned[PARAMETERS], parameters[PARAMETERS], unused[PARAMETERS], covariance[81], textbook[81];
    if (!(isfinite(site->inclination_deg) && isfinite(site->inclination_sigma_deg)) || is_flat_z(field, rows)) return 0;
    by.dip = site->inclination_deg / FL_TO_DEG;
    by.doubt = fl_sqrt(square(site->inclination_sigma_deg) + square(LEVEL_SIGMA_DEG) + square(tilt_deg)) / FL_TO_DEG;
    by.wider = wider_of(record);
    const ellipse around = ellipse_of(record->centre, record->shape, by.dip);
    mark_outliers(field, rows, &around, record->rejected_beyond, room->rejected);
    plane_of(field, rows, around.middle, record->noise, room, &by.heights);
    by_mounting(site->alignment_sigma_deg, record, &by);
    parameters_of(record, turned);
    turned[0] = around.middle[0], turned[1] = around.middle[1], turned[2] = by.heights.height;
    memcpy(covariance, record->covariance, sizeof covariance), memcpy(textbook, record->textbook, sizeof textbook);
    place(&by, turned, parameters, covariance), place(&by, turned, unused, textbook);
    return put(parameters, covariance, textbook, record);
}

/* -------------------------------------------------------------------------------------------------------- accelerometer */

/* Add readings to sums of accelerations. A reading at the centre of the ellipse has no direction. */
void flinders_vertical_add(const real *field, const real *acceleration, size_t rows, const flinders_record *record,
                           flinders_vertical *vertical)
{
    const ellipse around = ellipse_of(record->centre, record->shape, record->dip_deg / FL_TO_DEG);
    for (size_t row = 0; row < rows; row++) {
        const real *const a = acceleration + 3 * row;
        const real off[2] = {field[3 * row] - around.middle[0], field[3 * row + 1] - around.middle[1]};
        real u[2];
        if (!(isfinite(a[0]) && isfinite(a[1]) && isfinite(a[2]))) continue;
        apply(&around, off, u);
        const real length = larger(fl_sqrt(u[0] * u[0] + u[1] * u[1]), FL_TINY);
        u[0] /= length, u[1] /= length;
        for (int i = 0; i < 3; i++) vertical->acceleration[i] += a[i];
        vertical->turn[0] += u[0], vertical->turn[1] += u[1];
        vertical->across[0] += a[0] * u[0] + a[1] * u[1], vertical->across[1] += a[1] * u[0] - a[0] * u[1];
        vertical->squares += a[0] * a[0] + a[1] * a[1], vertical->readings++;
    }
}

/* Part of the acceleration in the plane that rotates with the field; 0 if it is not significant.
 *
 * On a slope, the vertical rotates in the body as the field does. A constant part is a bias of the accelerometer, a trim of the
 * vehicle or the mounting, not a slope: least squares of f = a + t u in complex numbers, where t is the effect of a slope.
 * In less than half a turn, a and t cannot be separated, and the root mean square of both is used. */
static real going_round(const flinders_vertical *it)
{
    const real n = it->readings, felt[2] = {it->acceleration[0] / n, it->acceleration[1] / n};
    const real way[2] = {it->turn[0] / n, it->turn[1] / n}, still = felt[0] * felt[0] + felt[1] * felt[1];
    const real spread = 1 - (way[0] * way[0] + way[1] * way[1]), scatter = larger(it->squares / n - still, 0);
    if (!(spread >= MIN_TURN_SPREAD)) return fl_sqrt(still + scatter);
    const real round[2] = {(it->across[0] / n - (felt[0] * way[0] + felt[1] * way[1])) / spread,
                           (it->across[1] / n - (felt[1] * way[0] - felt[0] * way[1])) / spread};
    const real squares = round[0] * round[0] + round[1] * round[1];
    const real by_chance = MIN_TILT_RATIO * larger(scatter - spread * squares, 0) / (n * spread);
    return squares > by_chance ? fl_sqrt(squares) : 0;
}

/* Direction of z by an accelerometer. */
typedef struct {
    int is_known, is_down;
    real tilt_deg; /* angle of the axis of turning to the vertical */
} shown;

static shown shown_by(const flinders_vertical *vertical)
{
    shown z = {0, 0, 0};
    if (!vertical || !(vertical->readings > 0)) return z;
    const real *const a = vertical->acceleration, length = fl_sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    if (!(length / vertical->readings > 0)) return z;
    z.is_known = 1, z.is_down = -a[2] >= length * MIN_UPRIGHT_COSINE; /* an accelerometer at rest measures the upward reaction to gravity */
    if (!z.is_down) return z;
    const real sine = going_round(vertical) * vertical->readings / length;
    z.tilt_deg = sine < 1 ? FL_TO_DEG * fl_atan2(sine, fl_sqrt(1 - sine * sine)) : 90;
    return z;
}

/* -------------------------------------------------------------------------------------------------------------- claims */

/* Widen a covariance for a z axis that may point up or down. */
static void on_either_side(real inclination_deg, const real shape[6], real covariance[81])
{
    const real apart = fl_sqrt((real)2) * fl_sin(inclination_deg / FL_TO_DEG);
    const real third[3] = {apart * shape[4], apart * shape[5], apart * shape[2]};
    for (int i = 0; i < 9; i++) covariance[PARAMETERS * (i / 3) + i % 3] += third[i / 3] * third[i % 3];
}

/* Widen a claim for a turn about an axis that was not vertical. The z component of the field then differs from that of a level
 * vehicle by ε = cos I · tilt, and the error of the offset is ε times that of S₁₃ and S₂₃. */
static void on_a_slope(real tilt_deg, flinders_record *record)
{
    const real epsilon = fl_cos(record->dip_deg / FL_TO_DEG) * tilt_deg / FL_TO_DEG;
    if (!(tilt_deg > 0)) return;
    record->covariance[0] += square(epsilon) * record->covariance[70];
    record->covariance[10] += square(epsilon) * record->covariance[80];
}

/* Add the field of a site to the fit of a level turn. */
static void at_level(const real *field, size_t rows, const flinders_vertical *vertical, const flinders_site *site,
                     const fl_room *room, flinders_record *record)
{
    const shown z = shown_by(vertical);
    const int has_dip = isfinite(site->inclination_deg) && isfinite(site->inclination_sigma_deg);
    if (z.is_known && !z.is_down) {
        record->z_axis = has_dip ? FLINDERS_Z_ELSEWHERE : FLINDERS_Z_DOWN;
        return;
    }
    const int is_placed = by_dip(field, rows, site, z.tilt_deg, room, record);
    by_strength(site, record);
    if (is_placed && !z.is_known && !site->z_down) {
        record->z_axis = FLINDERS_Z_OPEN;
        on_either_side(site->inclination_deg, record->shape, record->covariance);
        on_either_side(site->inclination_deg, record->shape, record->textbook);
    }
    on_a_slope(z.tilt_deg, record);
}

/* Add the field of a site to a fit. */
int flinders_at_site(const real *field, size_t rows, const flinders_vertical *vertical, const flinders_site *site,
                     void *workspace, size_t size, flinders_record *record)
{
    fl_surface surface;
    fl_room room;
    record->z_axis = FLINDERS_Z_DOWN;
    record->site_strength = record->strength_found = record->strength_sigmas = FL_NOT_A_NUMBER;
    if (fl_surface_of(record->centre, record->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    if (!(fl_abs(record->dip_deg) <= 89) || fl_abs(site->inclination_deg) > 89) return FLINDERS_BAD_OPTION;
    if (record->plane > 1) return FLINDERS_OK; /* turned about an axis other than z */
    if (record->plane) {
        if (rows == 0) return FLINDERS_TOO_FEW;
        if (fl_room_of(workspace, size, rows, &room)) return FLINDERS_NO_WORKSPACE;
        at_level(field, rows, vertical, site, &room, record);
    } else
        by_strength(site, record);
    fl_surface_of(record->centre, record->shape, &surface);
    record->level_rms_deg = record->level_worst_deg = FL_NOT_A_NUMBER;
    fl_direction_errors(&surface, record->covariance, &record->direction_rms_deg, &record->direction_worst_deg);
    return FLINDERS_OK;
}

/* Fill a site with unknown numbers. */
void flinders_default_site(flinders_site *site)
{
    memset(site, 0, sizeof *site);
    site->strength = site->gain_sigma = site->inclination_deg = site->inclination_sigma_deg = FL_NOT_A_NUMBER;
    site->alignment_sigma_deg = FL_NOT_A_NUMBER;
}
