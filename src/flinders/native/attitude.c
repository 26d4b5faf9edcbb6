/* Headings of vehicles that are level, tilted or upside down, from the covariance of a calibration.
 *
 * In a level vehicle, the field is u(ψ) = (cos I cos ψ, −cos I sin ψ, sin I), z down. Corrected readings err by
 * δu = −S⁻¹(δb + δS u), and its heading by δψ = −(sin ψ δu₁ + cos ψ δu₂)/cos I. A constant part depends on the mounting,
 * which a magnetometer does not observe, and is removed. For a tilted vehicle with a known tilt T, the field is Tᵀu, and
 * readings are rotated back.
 */
#include "judge.h"

enum { AZIMUTHS = 24, TILT_STEPS = 36, BISECTIONS = 9 };

#define INTERPOLATION_FACTOR ((real)1.1) /* largest ratio of an error between evaluated directions to that at these directions */

/* Vectors of a turn, one heading a column: across the field in the horizontal plane, over its level part; and the field. */
typedef struct {
    real across[3][FL_HEADINGS], field[3][FL_HEADINGS];
} turn_fields;

/* Rotation of +z to the down direction of a level vehicle; NULL for z. */
static void upright(const real *down, real turn[9])
{
    static const real Z[3] = {0, 0, 1};
    fl_upright(down ? down : Z, turn);
}

/* Down direction of a sensor that turns in a plane; NULL for z. */
const real *fl_down(int plane)
{
    static const real DOWN[2][3] = {{1, 0, 0}, {0, 1, 0}};
    return plane == 2 ? DOWN[0] : plane == 3 ? DOWN[1] : NULL;
}

/* Heading k of n. */
static real heading_of(int k, int n) { return 2 * FL_PI * (real)k / (real)n; }

/* The vectors of a full turn. */
static void turn_of(real dip_deg, const real *down, turn_fields *out)
{
    const real flat = fl_cos(dip_deg / FL_TO_DEG), height = fl_sin(dip_deg / FL_TO_DEG);
    real turn[9];
    upright(down, turn);
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real cosine = fl_cos(heading_of(k, FL_HEADINGS)), sine = fl_sin(heading_of(k, FL_HEADINGS));
        for (int i = 0; i < 3; i++) {
            const real *const row = turn + 3 * i;
            out->across[i][k] = (row[0] * sine + row[1] * cosine) / flat;
            out->field[i][k] = row[0] * flat * cosine - row[1] * flat * sine + row[2] * height;
        }
    }
}

/* Derivatives (9, FL_HEADINGS) of the heading by the parameters, for the vectors of a turn. */
static void rows_of(const fl_surface *surface, const turn_fields *at, real rows[9][FL_HEADINGS])
{
    const real *const s = surface->inverse;
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real x = at->across[0][k], y = at->across[1][k], z = at->across[2][k];
        const real u = at->field[0][k], v = at->field[1][k], w = at->field[2][k];
        const real a = s[0] * x + s[3] * y + s[4] * z, b = s[3] * x + s[1] * y + s[5] * z, c = s[4] * x + s[5] * y + s[2] * z;
        rows[0][k] = a, rows[1][k] = b, rows[2][k] = c;
        rows[3][k] = a * u, rows[4][k] = b * v, rows[5][k] = c * w;
        rows[6][k] = a * v + b * u, rows[7][k] = a * w + c * u, rows[8][k] = b * w + c * v;
    }
}

/* Their means over a turn. */
static void means_of(real rows[9][FL_HEADINGS], real means[9])
{
    for (int i = 0; i < 9; i++) {
        means[i] = 0;
        for (int k = 0; k < FL_HEADINGS; k++) means[i] += rows[i][k];
        means[i] /= FL_HEADINGS;
    }
}

/* Variances of headings along rows less their constant part. */
static void variances_of(real rows[9][FL_HEADINGS], const real means[9], const real covariance[81], real variances[FL_HEADINGS])
{
    real part[FL_HEADINGS];
    for (int k = 0; k < FL_HEADINGS; k++) variances[k] = 0;
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < FL_HEADINGS; k++) rows[i][k] -= means[i];
    for (int i = 0; i < 9; i++) {
        for (int k = 0; k < FL_HEADINGS; k++) part[k] = covariance[10 * i] * rows[i][k] / 2;
        for (int j = 0; j < i; j++)
            for (int k = 0; k < FL_HEADINGS; k++) part[k] += covariance[9 * i + j] * rows[j][k];
        for (int k = 0; k < FL_HEADINGS; k++) variances[k] += 2 * rows[i][k] * part[k];
    }
    for (int k = 0; k < FL_HEADINGS; k++) variances[k] = variances[k] > 0 ? variances[k] : 0;
}

/* Turn vectors by an angle about a horizontal axis at an azimuth. */
static void tilt(const turn_fields *level, const real turn[9], real azimuth, real angle, turn_fields *out)
{
    const real along[3] = {fl_cos(azimuth), fl_sin(azimuth), 0}, cosine = fl_cos(angle), sine = fl_sin(angle);
    real axis[3], matrix[9];
    fl_multiply(turn, along, 3, 3, 1, axis);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) matrix[3 * i + j] = (1 - cosine) * axis[i] * axis[j] + (i == j ? cosine : 0);
    matrix[1] += sine * axis[2], matrix[3] -= sine * axis[2]; /* transposed: from the axes of the level vehicle */
    matrix[2] -= sine * axis[1], matrix[6] += sine * axis[1];
    matrix[5] += sine * axis[0], matrix[7] -= sine * axis[0];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < FL_HEADINGS; k++) {
            const real *const row = matrix + 3 * i;
            out->across[i][k] = row[0] * level->across[0][k] + row[1] * level->across[1][k] + row[2] * level->across[2][k];
            out->field[i][k] = row[0] * level->field[0][k] + row[1] * level->field[1][k] + row[2] * level->field[2][k];
        }
}

/* Heading error of a vehicle with a known tilt, or of a level one. */
void fl_tilted_error(const fl_surface *surface, const real covariance[81], real dip_deg, real tilt_deg, const real *down,
                     real *rms_deg, real *worst_deg)
{
    turn_fields level, tilted;
    real rows[9][FL_HEADINGS], variances[FL_HEADINGS], means[9], turn[9], sum = 0, largest = 0;
    const int azimuths = tilt_deg == 0 ? 1 : AZIMUTHS;
    upright(down, turn);
    turn_of(dip_deg, down, &level);
    rows_of(surface, &level, rows);
    means_of(rows, means);
    for (int i = 0; i < azimuths; i++) {
        tilt(&level, turn, heading_of(i, AZIMUTHS), tilt_deg / FL_TO_DEG, &tilted);
        rows_of(surface, tilt_deg == 0 ? &level : &tilted, rows);
        variances_of(rows, means, covariance, variances);
        for (int k = 0; k < FL_HEADINGS; k++)
            sum += variances[k], largest = variances[k] > largest ? variances[k] : largest;
    }
    *rms_deg = FL_TO_DEG * fl_sqrt(sum / (real)(azimuths * FL_HEADINGS));
    *worst_deg = FL_TO_DEG * fl_sqrt(largest);
}

/* Heading error of a level vehicle with uncorrected readings b + S u, rad, without its mean. */
static void deviations_of(const fl_surface *surface, real dip_deg, const real *down, real deviations[FL_HEADINGS])
{
    turn_fields at;
    real turn[9], cosines[FL_HEADINGS], sines[FL_HEADINGS], cosine = 0, sine = 0;
    upright(down, turn);
    turn_of(dip_deg, down, &at);
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real field[3] = {at.field[0][k], at.field[1][k], at.field[2][k]};
        real reading[3], own[2];
        fl_sym3_apply(surface->shape, field, reading);
        for (int i = 0; i < 3; i++) reading[i] += surface->centre[i];
        for (int i = 0; i < 2; i++) own[i] = turn[i] * reading[0] + turn[3 + i] * reading[1] + turn[6 + i] * reading[2];
        const real off = fl_atan2(-own[1], own[0]) - heading_of(k, FL_HEADINGS);
        cosine += cosines[k] = fl_cos(off), sine += sines[k] = fl_sin(off);
    }
    const real length = fl_sqrt(cosine * cosine + sine * sine), x = length > 0 ? cosine / length : 1;
    const real y = length > 0 ? sine / length : 0;
    for (int k = 0; k < FL_HEADINGS; k++)
        deviations[k] = fl_atan2(sines[k] * x - cosines[k] * y, cosines[k] * x + sines[k] * y);
}

/* Heading error of a level vehicle without a calibration. */
void fl_uncorrected_error(const fl_surface *surface, real dip_deg, const real *down, real *rms_deg, real *worst_deg)
{
    real deviations[FL_HEADINGS], sum = 0, worst = 0;
    deviations_of(surface, dip_deg, down, deviations);
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real off = fl_abs(deviations[k]);
        sum += off * off, worst = off > worst ? off : worst;
    }
    *rms_deg = FL_TO_DEG * fl_sqrt(sum / FL_HEADINGS);
    *worst_deg = FL_TO_DEG * worst;
}

/* Upper bound of the heading error at any tilt: for any direction of the field, an error across it changes the heading by at
 * most its size over cos I, plus the part that is removed for the mounting. */
static real worst_anywhere(const fl_surface *surface, const real covariance[81], real dip_deg, const real *down)
{
    turn_fields level;
    real rows[9][FL_HEADINGS], means[9], rms, worst, mounting = 0;
    turn_of(dip_deg, down, &level);
    rows_of(surface, &level, rows);
    means_of(rows, means);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) mounting += means[i] * covariance[9 * i + j] * means[j];
    fl_direction_errors(surface, covariance, &rms, &worst);
    return INTERPOLATION_FACTOR * worst / fl_cos(dip_deg / FL_TO_DEG) + FL_TO_DEG * fl_sqrt(mounting > 0 ? mounting : 0);
}

/* Whether the worst heading error at a tilt is within a limit. */
static int is_within(const fl_surface *surface, const real covariance[81], real dip_deg, real limit_deg, real tilt_deg,
                     const real *down)
{
    real rms, worst;
    fl_tilted_error(surface, covariance, dip_deg, tilt_deg, down, &rms, &worst);
    return worst <= limit_deg;
}

/* Largest tilt with a heading error within a limit. */
real fl_attitude_limit(const fl_surface *surface, const real covariance[81], real dip_deg, real limit_deg, const real *down)
{
    const real step = (real)180 / TILT_STEPS;
    int beyond = 0;
    if (worst_anywhere(surface, covariance, dip_deg, down) <= limit_deg) return 180;
    while (beyond <= TILT_STEPS && is_within(surface, covariance, dip_deg, limit_deg, step * (real)beyond, down)) beyond++;
    if (beyond == 0 || beyond > TILT_STEPS) return beyond ? 180 : 0;
    real inside = step * (real)(beyond - 1), outside = step * (real)beyond;
    for (int i = 0; i < BISECTIONS; i++) {
        const real middle = (inside + outside) / 2;
        if (is_within(surface, covariance, dip_deg, limit_deg, middle, down)) inside = middle;
        else outside = middle;
    }
    return inside;
}

/* Whether the dip allows headings, and the shape is valid; the offset is only relevant for uncorrected readings. */
static int surface_of(const real *centre, const real shape[6], real dip_deg, fl_surface *surface)
{
    const real none[3] = {0, 0, 0};
    if (!(fl_abs(dip_deg) <= 89)) return FLINDERS_BAD_OPTION;
    return fl_surface_of(centre ? centre : none, shape, surface) ? FLINDERS_NOT_AN_ELLIPSOID : FLINDERS_OK;
}

/* Heading error at a tilt. */
int flinders_tilted_error(const real shape[6], const real covariance[81], real dip_deg, real tilt_deg, const real *down,
                          real *rms_deg, real *worst_deg)
{
    fl_surface surface;
    const int status = surface_of(NULL, shape, dip_deg, &surface);
    if (status == FLINDERS_OK) fl_tilted_error(&surface, covariance, dip_deg, tilt_deg, down, rms_deg, worst_deg);
    return status;
}

/* Heading error without a calibration. */
int flinders_uncorrected_error(const real centre[3], const real shape[6], real dip_deg, const real *down, real *rms_deg,
                               real *worst_deg)
{
    fl_surface surface;
    const int status = surface_of(centre, shape, dip_deg, &surface);
    if (status == FLINDERS_OK) fl_uncorrected_error(&surface, dip_deg, down, rms_deg, worst_deg);
    return status;
}

/* Largest tilt with an error within a limit. */
int flinders_attitude_limit(const real shape[6], const real covariance[81], real dip_deg, real limit_deg,
                            const real *down, real *tilt_deg)
{
    fl_surface surface;
    const int status = surface_of(NULL, shape, dip_deg, &surface);
    if (status == FLINDERS_OK) *tilt_deg = fl_attitude_limit(&surface, covariance, dip_deg, limit_deg, down);
    return status;
}

/* A level turn, before and after. */
int flinders_level_turn(const real centre[3], const real shape[6], const real covariance[81], real dip_deg, const real *down,
                        real *headings_deg, real *deviations_deg, real *sigmas_deg)
{
    fl_surface surface;
    turn_fields level;
    real rows[9][FL_HEADINGS], means[9];
    const int status = surface_of(centre, shape, dip_deg, &surface);
    if (status != FLINDERS_OK) return status;
    turn_of(dip_deg, down, &level);
    rows_of(&surface, &level, rows);
    means_of(rows, means);
    variances_of(rows, means, covariance, sigmas_deg);
    deviations_of(&surface, dip_deg, down, deviations_deg);
    for (int k = 0; k < FL_HEADINGS; k++) {
        headings_deg[k] = FL_TO_DEG * heading_of(k, FL_HEADINGS);
        deviations_deg[k] *= FL_TO_DEG, sigmas_deg[k] = FL_TO_DEG * fl_sqrt(sigmas_deg[k]);
    }
    return status;
}

/* Heading errors at the worst attitude for each direction of the field: the vehicle's vertical is at an angle of 90° − I to the
 * field, in any direction around it, so the variance is the largest eigenvalue of the covariance across the direction, over
 * cos² I. */
int flinders_attitude_errors(const real shape[6], const real covariance[81], real dip_deg, const real *directions,
                             size_t count, real *errors_deg)
{
    fl_surface surface;
    const int status = surface_of(NULL, shape, dip_deg, &surface);
    for (size_t k = 0; k < count; k++) {
        static const unsigned char ENTRY[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
        real rows[3][9], half[27], across[6], values[3];
        errors_deg[k] = FL_NOT_A_NUMBER;
        if (status != FLINDERS_OK) continue;
        fl_direction_rows(&surface, directions + 3 * k, rows);
        fl_multiply(rows[0], covariance, 3, 9, 9, half);
        for (int i = 0; i < 6; i++) {
            const real *const one = half + 9 * ENTRY[i][0], *const other = rows[ENTRY[i][1]];
            across[i] = 0;
            for (int j = 0; j < 9; j++) across[i] += one[j] * other[j];
        }
        fl_sym3_values(across, values);
        errors_deg[k] = FL_TO_DEG * fl_sqrt(values[2] > 0 ? values[2] : 0) / fl_cos(dip_deg / FL_TO_DEG);
    }
    return status;
}

/* Standard deviations of the entries of W = F S⁻¹, or of a rotation of that, to first order: δW = (δF/F) W − W δS S⁻¹, with δF = F tr(S⁻¹ δS)/3 where
 * F is the radius that results, and 0 where it is known. */
int flinders_matrix_sigmas(const real matrix[9], const real shape[6], const real covariance[81], int32_t is_known,
                           real sigmas[9])
{
    static const unsigned char ENTRY[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
    static const unsigned char PLACE[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};
    fl_surface surface;
    real jacobian[9][6];
    const int status = surface_of(NULL, shape, 0, &surface);
    if (status != FLINDERS_OK) return status;
    for (int entry = 0; entry < 6; entry++) {
        const int i = ENTRY[entry][0], j = ENTRY[entry][1];
        const real scale = is_known ? 0 : surface.inverse[entry] * (i == j ? 1 : 2) / 3;
        for (int row = 0; row < 3; row++)
            for (int column = 0; column < 3; column++) {
                const real *const s = surface.inverse;
                const real bent = matrix[3 * row + i] * s[PLACE[3 * j + column]] +
                                  (i == j ? 0 : matrix[3 * row + j] * s[PLACE[3 * i + column]]);
                jacobian[3 * row + column][entry] = scale * matrix[3 * row + column] - bent;
            }
    }
    for (int k = 0; k < 9; k++) {
        real variance = 0;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < 6; j++) variance += jacobian[k][i] * covariance[9 * (3 + i) + 3 + j] * jacobian[k][j];
        sigmas[k] = fl_sqrt(variance > 0 ? variance : 0);
    }
    return status;
}
