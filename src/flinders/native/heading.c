/* Errors in degrees from the covariance of a calibration: heading of a level vehicle, and direction of the field. */
#include "internal.h"

enum { DIRECTIONS = 400 };

#define MIN_HEIGHT_RATIO ((real)0.55) /* smallest ratio to a level vehicle's mean height of directions that determines the sign of the dip */
#define MIN_LEANING_HEIGHT ((real)0.1) /* smallest mean height of directions of a leaning recording; at least three standard errors of random ones */

/* Coefficients of vᵀδb + vᵀ δS u. */
static void gathered(const real v[3], const real u[3], real row[9])
{
    for (int i = 0; i < 3; i++) row[i] = v[i], row[3 + i] = v[i] * u[i];
    row[6] = v[0] * u[1] + v[1] * u[0];
    row[7] = v[0] * u[2] + v[2] * u[0];
    row[8] = v[1] * u[2] + v[2] * u[1];
}

/* Smallest rotation of +z to `down`; about the x axis if down is -z. */
void fl_upright(const real down[3], real turn[9])
{
    const real length = fl_sqrt(down[0] * down[0] + down[1] * down[1] + down[2] * down[2]);
    const real over = down[2] < 0 ? -1 : 1;
    const real x = down[0] / length, y = over * down[1] / length, z = over * down[2] / length, bend = 1 / (1 + z);
    const real rotation[9] = {1 - bend * x * x, -bend * x * y, x,
                              -over * bend * x * y, over * (1 - bend * y * y), over * y,
                              -over * x, -over * y, over * z};
    memcpy(turn, rotation, sizeof rotation);
}

/* Derivatives (9, FL_HEADINGS) of the heading of a level vehicle by the parameters, without their mean; `turn` rotates +z to
 * the down direction, NULL for +z. Rows are `stride` numbers apart. */
void fl_level_rows_about(const fl_surface *surface, real dip_deg, const real *turn, real *rows, int stride)
{
    const real dip = dip_deg / FL_TO_DEG, flat = fl_cos(dip), height = fl_sin(dip);
    const real step = fl_cos(2 * FL_PI / FL_HEADINGS), slant = fl_sin(2 * FL_PI / FL_HEADINGS);
    real cosine = 1, sine = 0;
    for (int k = 0; k < FL_HEADINGS; k++) {
        real field[3] = {flat * cosine, -flat * sine, height}, across[3] = {sine / flat, cosine / flat, 0};
        real v[3], row[9];
        if (turn) {
            const real level[2][3] = {{field[0], field[1], field[2]}, {across[0], across[1], across[2]}};
            fl_multiply(turn, level[0], 3, 3, 1, field);
            fl_multiply(turn, level[1], 3, 3, 1, across);
        }
        fl_sym3_apply(surface->inverse, across, v);
        gathered(v, field, row);
        for (int i = 0; i < 9; i++) rows[i * stride + k] = row[i];
        const real next = cosine * step - sine * slant;
        sine = sine * step + cosine * slant;
        cosine = next;
    }
    for (int i = 0; i < 9; i++) {
        real *const row = rows + i * stride, mean = 0;
        for (int k = 0; k < FL_HEADINGS; k++) mean += row[k] / FL_HEADINGS;
        for (int k = 0; k < FL_HEADINGS; k++) row[k] -= mean;
    }
}

/* The same with +z down. */
void fl_level_rows(const fl_surface *surface, real dip_deg, real rows[9][FL_HEADINGS])
{
    fl_level_rows_about(surface, dip_deg, NULL, rows[0], FL_HEADINGS);
}

/* Derivatives of the corrected field in a direction u by the parameters: rows of (1 − uuᵀ) S⁻¹. */
void fl_direction_rows(const fl_surface *surface, const real direction[3], real rows[3][9])
{
    for (int axis = 0; axis < 3; axis++) {
        real across[3], v[3];
        for (int i = 0; i < 3; i++) across[i] = (i == axis) - direction[axis] * direction[i];
        fl_sym3_apply(surface->inverse, across, v);
        gathered(v, direction, rows[axis]);
    }
}

/* Heading error of a level vehicle, 1 sigma: rms over all headings, and at the worst; without its mean, which depends on the
 * mounting. */
void fl_level_errors(const fl_surface *surface, const real covariance[81], real dip_deg, real *rms, real *worst)
{
    real rows[9][FL_HEADINGS], variances[FL_HEADINGS] = {0}, part[FL_HEADINGS], sum = 0, largest = 0;
    fl_level_rows(surface, dip_deg, rows);
    for (int i = 0; i < 9; i++) { /* rᵀ C r for all headings */
        for (int k = 0; k < FL_HEADINGS; k++) part[k] = covariance[10 * i] * rows[i][k] / 2;
        for (int j = 0; j < i; j++)
            for (int k = 0; k < FL_HEADINGS; k++) part[k] += covariance[9 * i + j] * rows[j][k];
        for (int k = 0; k < FL_HEADINGS; k++) variances[k] += 2 * rows[i][k] * part[k];
    }
    for (int k = 0; k < FL_HEADINGS; k++) {
        const real variance = variances[k] > 0 ? variances[k] : 0;
        sum += variance;
        largest = variance > largest ? variance : largest;
    }
    *rms = FL_TO_DEG * fl_sqrt(sum / FL_HEADINGS);
    *worst = FL_TO_DEG * fl_sqrt(largest);
}

/* Heading error of a level vehicle by a change of the parameters, at the worst heading, without its mean. */
real fl_level_change(const fl_surface *surface, const real change[9], real dip_deg)
{
    real rows[9][FL_HEADINGS], errors[FL_HEADINGS] = {0}, worst = 0;
    fl_level_rows(surface, dip_deg, rows);
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < FL_HEADINGS; k++) errors[k] += rows[i][k] * change[i];
    for (int k = 0; k < FL_HEADINGS; k++) worst = fl_abs(errors[k]) > worst ? fl_abs(errors[k]) : worst;
    return FL_TO_DEG * worst;
}

/* Covariance (12, 12) of S⁻¹δb and of the columns of S⁻¹δS: δu is their sum with 1 and u for weights. */
static void corrected(const fl_surface *surface, const real covariance[81], real out[144])
{
    static const unsigned char ENTRY[3][3] = {{3, 6, 7}, {6, 4, 8}, {7, 8, 5}};
    real map[108] = {0}, half[108];
    const real full[9] = {surface->inverse[0], surface->inverse[3], surface->inverse[4],
                          surface->inverse[3], surface->inverse[1], surface->inverse[5],
                          surface->inverse[4], surface->inverse[5], surface->inverse[2]};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            map[9 * i + k] = full[3 * i + k];
            for (int j = 0; j < 3; j++) map[9 * (3 + 3 * j + i) + ENTRY[k][j]] += full[3 * i + k];
        }
    fl_multiply(map, covariance, 12, 9, 9, half);
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++) {
            out[12 * i + j] = 0;
            for (int k = 0; k < 9; k++) out[12 * i + j] += half[9 * i + k] * map[9 * j + k];
        }
}

/* Variance of the corrected field across its direction u, from the covariance of `corrected`, rad². */
static inline real variance_across(const real c[144], const real u[3])
{
    const real w[4] = {1, u[0], u[1], u[2]};
    real squares[3][3], variance = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) {
            real entry = 0;
            for (int a = 0; a < 4; a++) {
                const real *row = c + 12 * (3 * a + i) + j;
                entry += w[a] * (w[0] * row[0] + w[1] * row[3] + w[2] * row[6] + w[3] * row[9]);
            }
            squares[i][j] = squares[j][i] = entry;
        }
    for (int i = 0; i < 3; i++) {
        variance += squares[i][i];
        for (int j = 0; j < 3; j++) variance -= u[i] * squares[i][j] * u[j];
    }
    return variance > 0 ? variance : 0;
}

/* Error of the direction of the corrected field, 1 sigma: rms over the sphere, and in the worst of 400 directions. */
void fl_direction_errors(const fl_surface *surface, const real covariance[81], real *rms, real *worst)
{
    real c[144], sum = 0, largest = 0;
    corrected(surface, covariance, c);
    const real step = FL_PI * (1 + fl_sqrt((real)5));
    real cosine = fl_cos(step / 2), sine = fl_sin(step / 2);
    const real turn = fl_cos(step), slant = fl_sin(step);
    for (int k = 0; k < DIRECTIONS; k++) {
        const real z = 1 - 2 * (k + (real)0.5) / DIRECTIONS, flat = fl_sqrt(1 - z * z);
        const real u[3] = {flat * cosine, flat * sine, z}, variance = variance_across(c, u);
        sum += variance;
        largest = variance > largest ? variance : largest;
        const real next = cosine * turn - sine * slant;
        sine = sine * turn + cosine * slant;
        cosine = next;
    }
    *rms = FL_TO_DEG * fl_sqrt(sum / DIRECTIONS);
    *worst = FL_TO_DEG * fl_sqrt(largest);
}

/* Errors of the corrected field in directions (count, 3). */
int flinders_direction_errors(const real shape[6], const real covariance[81], const real *directions, size_t count,
                              real *errors_deg)
{
    const real centre[3] = {0, 0, 0};
    real c[144];
    fl_surface surface;
    const int status = fl_surface_of(centre, shape, &surface) ? FLINDERS_NOT_AN_ELLIPSOID : FLINDERS_OK;
    if (status == FLINDERS_OK) corrected(&surface, covariance, c);
    for (size_t k = 0; k < count; k++)
        errors_deg[k] = status ? FL_NOT_A_NUMBER : FL_TO_DEG * fl_sqrt(variance_across(c, directions + 3 * k));
    return status;
}

/* Dip with its sign by the mean z component of directions. */
static real shown(real upright, real coverage, real dip_deg)
{
    const real cells = fl_floor(100 * coverage + (real)0.5), by_chance = fl_sqrt(3 / (cells > 1 ? cells : 1));
    const real least = by_chance > MIN_LEANING_HEIGHT ? by_chance : MIN_LEANING_HEIGHT;
    const int is_against = (upright * dip_deg < 0) || (dip_deg == 0 && upright < 0);
    return is_against && fl_abs(upright) > least ? -dip_deg : dip_deg;
}

/* The same, and whether directions that lean leave the sign open: a sensor mounted upside down sees the field come from
 * below. */
real fl_facing(real upright, real coverage, real dip_deg, int32_t *is_open)
{
    const real facing = shown(upright, coverage, dip_deg);
    const int leans = facing != dip_deg || shown(upright, coverage, -dip_deg) == dip_deg;
    *is_open = leans && !(fl_abs(upright) >= MIN_HEIGHT_RATIO * fl_abs(fl_sin(dip_deg / FL_TO_DEG)));
    return facing;
}

/* Level errors at the sign of the dip that the readings show; at the worse where they lean and show none. */
void fl_heading_errors(const fl_surface *surface, flinders_record *record, real dip_deg)
{
    real rms = 0, worst = 0;
    int32_t is_open = 0;
    record->dip_deg = dip_deg;
    if (!isnan(record->upright)) {
        const real facing = fl_facing(record->upright, record->coverage, dip_deg, &is_open);
        if (!is_open) record->dip_deg = facing;
    }
    fl_level_errors(surface, record->covariance, record->dip_deg, &record->level_rms_deg, &record->level_worst_deg);
    if (is_open) fl_level_errors(surface, record->covariance, -dip_deg, &rms, &worst);
    if (is_open && worst > record->level_worst_deg)
        record->dip_deg = -dip_deg, record->level_rms_deg = rms, record->level_worst_deg = worst;
}

/* Heading and direction errors of a record. */
int flinders_heading_errors(flinders_record *record, real dip_deg)
{
    fl_surface surface;
    if (!(fl_abs(dip_deg) <= 89)) return FLINDERS_BAD_OPTION;
    if (fl_surface_of(record->centre, record->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    fl_heading_errors(&surface, record, dip_deg);
    fl_direction_errors(&surface, record->covariance, &record->direction_rms_deg, &record->direction_worst_deg);
    return FLINDERS_OK;
}
