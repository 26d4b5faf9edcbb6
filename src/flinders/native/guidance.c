/* Which way to turn next: where readings would lower the worst error fastest. flinders.heading.guidance says how. */
#include "residuals.h"

enum { CELLS = 100 };

#define MAX_KNOWN_ERROR_DEG ((real)90) /* error above which nothing is known of some direction */
#define MAX_USEFUL_RATIO ((real)0.999) /* largest ratio of the largest error after a batch to that before, if the batch helps */
#define BATCH_SHARE ((real)0.01)  /* readings of a batch over those so far, as in each of a hundred cells if all are equal */
#define MIN_FREE_VARIANCE_RATIO ((real)1e-12) /* ratio to the largest variance below which a method fixes a parameter */
#define MAX_DIP_DEG 89
#define EFFORT_DEG ((real)2) /* larger distance from the direction that is accepted to avoid one angle to estimate by eye */

/* What points down in each attitude, as squares with their signs, up to a factor, and the angles to judge by eye. */
static const signed char VEHICLE_POSES[FLINDERS_VEHICLE_POSES][4] = {
    {1, 0, 0, 0}, {-1, 0, 0, 0},
    {0, 0, 1, 0}, {0, 1, 1, 1}, {0, 1, 0, 0}, {0, 1, -1, 1}, {0, 0, -1, 0}, {0, -1, -1, 1}, {0, -1, 0, 0}, {0, -1, 1, 1},
    {1, 0, 3, 1}, {2, 3, 3, 2}, {1, 3, 0, 1}, {2, 3, -3, 2}, {1, 0, -3, 1}, {2, -3, -3, 2}, {1, -3, 0, 1}, {2, -3, 3, 2},
    {3, 0, 1, 1}, {6, 1, 1, 2}, {3, 1, 0, 1}, {6, 1, -1, 2}, {3, 0, -1, 1}, {6, -1, -1, 2}, {3, -1, 0, 1}, {6, -1, 1, 2},
    {-1, 0, 3, 1}, {-2, 3, 3, 2}, {-1, 3, 0, 1}, {-2, 3, -3, 2},
    {-1, 0, -3, 1}, {-2, -3, -3, 2}, {-1, -3, 0, 1}, {-2, -3, 3, 2},
    {-3, 0, 1, 1}, {-6, 1, 1, 2}, {-3, 1, 0, 1}, {-6, 1, -1, 2},
    {-3, 0, -1, 1}, {-6, -1, -1, 2}, {-3, -1, 0, 1}, {-6, -1, 1, 2},
};
static const signed char SENSOR_POSES[FLINDERS_SENSOR_POSES][4] = {
    {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {-1, 0, 0, 0}, {0, -1, 0, 0}, {0, 0, -1, 0},
    {1, 1, 0, 1}, {3, 1, 0, 1}, {1, 3, 0, 1}, {1, 0, 1, 1}, {3, 0, 1, 1}, {1, 0, 3, 1},
    {1, -1, 0, 1}, {3, -1, 0, 1}, {1, -3, 0, 1}, {1, 0, -1, 1}, {3, 0, -1, 1}, {1, 0, -3, 1},
    {0, 1, 1, 1}, {0, 3, 1, 1}, {0, 1, 3, 1}, {-1, 1, 0, 1}, {-1, 3, 0, 1}, {-3, 1, 0, 1},
    {0, 1, -1, 1}, {0, 3, -1, 1}, {0, 1, -3, 1}, {-1, 0, 1, 1}, {-1, 0, 3, 1}, {-3, 0, 1, 1},
    {0, -1, 1, 1}, {0, -1, 3, 1}, {0, -3, 1, 1}, {-1, -1, 0, 1}, {-3, -1, 0, 1}, {-1, -3, 0, 1},
    {-1, 0, -1, 1}, {-3, 0, -1, 1}, {-1, 0, -3, 1}, {0, -1, -1, 1}, {0, -3, -1, 1}, {0, -1, -3, 1},
    {1, 1, 1, 2}, {1, 1, -1, 2}, {1, -1, 1, 2}, {1, -1, -1, 2}, {-1, 1, 1, 2}, {-1, 1, -1, 2}, {-1, -1, 1, 2},
    {-1, -1, -1, 2},
};

/* Whether all numbers are finite. */
int fl_are_finite(const real *numbers, int count)
{
    for (int i = 0; i < count; i++)
        if (!isfinite(numbers[i])) return 0;
    return 1;
}

/* Fill a goal with its defaults. */
void flinders_default_goal(flinders_goal *goal)
{
    const flinders_goal defaults = {.dip_deg = 60, .down = {0, 0, 1}, .target_deg = 1};
    *goal = defaults;
}

/* Variance of a reading with which the counted readings give the claimed covariance: the median eigenvalue of M P, M
 * = Σ jjᵀ, without fixed parameters. For independent readings all eigenvalues are the variance of the noise. */
static real reading_variance(const fl_surface *surface, const real covariance[81], real noise, const real counts[CELLS])
{
    real vectors[81], values[9], gram[81] = {0}, centres[CELLS][3], root[9];
    int free = 0;
    memcpy(vectors, covariance, sizeof vectors);
    fl_eigen(vectors, 9, values);
    for (int k = 0; k < 9; k++) free += values[k] > MIN_FREE_VARIANCE_RATIO * values[8];
    fl_sphere_centres(centres);
    for (int cell = 0; cell < CELLS && free; cell++) {
        real jacobian[9];
        fl_jacobian(surface, centres[cell], jacobian);
        for (int k = 0; k < free; k++) {
            const int column = 9 - free + k;
            root[k] = 0;
            for (int i = 0; i < 9; i++) root[k] += jacobian[i] * vectors[9 * i + column];
            root[k] *= fl_sqrt(values[column]);
        }
        for (int i = 0; i < free; i++)
            for (int j = 0; j < free; j++) gram[free * i + j] += counts[cell] * root[i] * root[j];
    }
    if (free) fl_eigen(gram, free, values);
    const real median = free ? (values[(free - 1) / 2] + values[free / 2]) / 2 : 0;
    return median > noise * noise ? median : noise * noise;
}

/* Take the claim of a fit. */
void flinders_believe(const real centre[3], const real shape[6], const real covariance[81], real noise,
                      const real counts[CELLS], flinders_belief *belief)
{
    fl_surface surface;
    const int is_surface = !fl_surface_of(centre, shape, &surface);
    memcpy(belief->centre, centre, sizeof belief->centre);
    memcpy(belief->shape, shape, sizeof belief->shape);
    memcpy(belief->covariance, covariance, sizeof belief->covariance);
    belief->variance = is_surface ? reading_variance(&surface, covariance, noise, counts) : FL_NOT_A_NUMBER;
    belief->readings = 0;
    for (int cell = 0; cell < CELLS; cell++) belief->readings += counts[cell];
}

/* Fill in the predictions of a goal: the heading of a level vehicle, or the field in some directions. Nonzero for an
 * invalid dip or down direction. */
int fl_wanted_of(const fl_surface *surface, const flinders_goal *goal, const real (*directions)[3], int count,
                 fl_wanted *wanted)
{
    real turn[9], rows[3][9];
    if (goal->is_attitude) {
        if (FL_PARTS < 3) return FLINDERS_BAD_OPTION;
        wanted->count = count, wanted->parts = FL_PARTS;
        for (int k = 0; k < count; k++) {
            fl_direction_rows(surface, directions[k], rows);
            for (int part = 0; part < FL_PARTS; part++)
                for (int i = 0; i < 9; i++) wanted->rows[part][i][k] = rows[part][i];
        }
        return FLINDERS_OK;
    }
    const real square = goal->down[0] * goal->down[0] + goal->down[1] * goal->down[1] + goal->down[2] * goal->down[2];
    if (!(fl_abs(goal->dip_deg) <= MAX_DIP_DEG) || !(square > 0) || !isfinite(square)) return FLINDERS_BAD_OPTION;
    fl_upright(goal->down, turn);
    fl_level_rows_about(surface, goal->dip_deg, turn, wanted->rows[0][0], FL_WANTED);
    wanted->count = FL_HEADINGS, wanted->parts = 1;
    return FLINDERS_OK;
}

/* Variances of the predictions. */
void fl_wanted_variances(const fl_wanted *wanted, const real covariance[81], real variances[FL_WANTED])
{
    real half[FL_WANTED];
    for (int k = 0; k < wanted->count; k++) variances[k] = 0;
    for (int part = 0; part < wanted->parts; part++)
        for (int i = 0; i < 9; i++) { /* rᵀ C r of all side by side */
            const real (*const rows)[FL_WANTED] = wanted->rows[part];
            for (int k = 0; k < wanted->count; k++) half[k] = covariance[10 * i] * rows[i][k] / 2;
            for (int j = 0; j < i; j++)
                for (int k = 0; k < wanted->count; k++) half[k] += covariance[9 * i + j] * rows[j][k];
            for (int k = 0; k < wanted->count; k++) variances[k] += 2 * rows[i][k] * half[k];
        }
    for (int k = 0; k < wanted->count; k++) variances[k] = variances[k] > 0 ? variances[k] : 0;
}

/* C j, by which a reading with the Jacobian j lowers a covariance C to C − C j jᵀ C / (v + jᵀ C j), whose denominator is
 * returned; v is the reading's variance. */
real fl_lever(const real covariance[81], const real jacobian[9], real variance, real lever[9])
{
    fl_multiply(covariance, jacobian, 9, 9, 1, lever);
    for (int i = 0; i < 9; i++) variance += jacobian[i] * lever[i];
    return variance > FL_TINY ? variance : FL_TINY;
}

/* Fourth power of a variance over the largest: its mean is nearly blind to all but the largest ones. */
real fl_sharp(real variance, real largest)
{
    const real square = variance / largest * (variance / largest);
    return square * square;
}

#ifndef FLINDERS_SMALL
/* Where readings are least foreseen. */
static void least_foreseen(const fl_surface *surface, const real covariance[81], real direction[3])
{
    real centres[CELLS][3], jacobian[9], lever[9], most = 0;
    fl_sphere_centres(centres);
    for (int cell = 0; cell < CELLS; cell++) {
        fl_jacobian(surface, centres[cell], jacobian);
        const real variance = fl_lever(covariance, jacobian, 0, lever);
        if (variance > most) most = variance, memcpy(direction, centres[cell], sizeof centres[cell]);
    }
}
#endif

/* Compare batches of readings in each cell, of this variance, and fill in the best; where no single one lowers the largest
 * error, that where readings are least foreseen. */
static void choose(const fl_surface *surface, const real covariance[81], const fl_wanted *wanted, real variance,
                   flinders_advice *advice)
{
    real before[FL_WANTED], gained[FL_WANTED], along[FL_WANTED], centres[CELLS][3], most = FL_TINY, least = FL_HUGE;
    fl_sphere_centres(centres);
    fl_wanted_variances(wanted, covariance, before);
    for (int k = 0; k < wanted->count; k++) most = before[k] > most ? before[k] : most;
    for (int cell = 0; cell < CELLS; cell++) {
        real jacobian[9], lever[9], sum = 0, largest = 0;
        fl_jacobian(surface, centres[cell], jacobian);
        const real total = fl_lever(covariance, jacobian, variance, lever);
        for (int k = 0; k < wanted->count; k++) gained[k] = 0;
        for (int part = 0; part < wanted->parts; part++) {
            for (int k = 0; k < wanted->count; k++) along[k] = 0;
            for (int i = 0; i < 9; i++)
                for (int k = 0; k < wanted->count; k++) along[k] += wanted->rows[part][i][k] * lever[i];
            for (int k = 0; k < wanted->count; k++) gained[k] += along[k] * along[k];
        }
        for (int k = 0; k < wanted->count; k++) {
            const real after = before[k] - gained[k] / total, left = after < 0 ? 0 : after;
            sum += fl_sharp(left, most);
            largest = left > largest ? left : largest;
        }
        if (!(sum < least * (1 - FL_ALIKE))) continue;
        least = sum;
        memcpy(advice->direction, centres[cell], sizeof advice->direction);
        advice->after_deg = FL_TO_DEG * fl_sqrt(largest);
        advice->worst_deg = most > FL_TINY ? FL_TO_DEG * fl_sqrt(most) : 0;
    }
#ifndef FLINDERS_SMALL /* a board has no room for what is that far from a calibration */
    if (advice->worst_deg > MAX_KNOWN_ERROR_DEG && advice->after_deg > MAX_USEFUL_RATIO * advice->worst_deg)
        least_foreseen(surface, covariance, advice->direction);
#endif
}

/* Advise a direction. */
int flinders_guidance(const flinders_belief *belief, const flinders_goal *goal, real batch, flinders_advice *advice)
{
    fl_surface surface;
    fl_wanted wanted;
    real centres[CELLS][3];
    advice->worst_deg = advice->after_deg = FL_NOT_A_NUMBER;
    for (int i = 0; i < 3; i++) advice->direction[i] = FL_NOT_A_NUMBER;
    if (fl_surface_of(belief->centre, belief->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    if (!fl_are_finite(belief->covariance, 81) || !isfinite(belief->variance)) return FLINDERS_NOT_FINITE;
    if (goal->is_attitude) fl_sphere_centres(centres);
    const int status = fl_wanted_of(&surface, goal, (const real(*)[3])centres, CELLS, &wanted);
    if (status) return status;
    const real share = BATCH_SHARE * belief->readings, taken = batch > 0 ? batch : share > 1 ? share : 1;
    choose(&surface, belief->covariance, &wanted, belief->variance / taken, advice);
    return isnan(advice->after_deg) ? FLINDERS_NOT_FINITE : FLINDERS_OK;
}

/* What points down in an attitude. */
int flinders_pose(int32_t frame, int32_t pose, real down[3])
{
    const int is_sensor = frame == FLINDERS_SENSOR, count = is_sensor ? FLINDERS_SENSOR_POSES : FLINDERS_VEHICLE_POSES;
    if (pose < 0 || pose >= count || (frame != FLINDERS_VEHICLE && !is_sensor)) return -1;
    const signed char *const squares = is_sensor ? SENSOR_POSES[pose] : VEHICLE_POSES[pose];
    real sum = 0;
    for (int i = 0; i < 3; i++) sum += fl_abs((real)squares[i]);
    for (int i = 0; i < 3; i++) {
        const real part = fl_sqrt(fl_abs((real)squares[i]) / sum);
        down[i] = squares[i] < 0 ? -part : part;
    }
    return squares[3];
}

/* Find an attitude whose vertical makes the angle of 90° less the dip with a direction, or nearly so. */
int32_t flinders_pose_towards(int32_t frame, const flinders_goal *goal, const real direction[3])
{
    const real alike = (real)(sizeof(real) == sizeof(double) ? 1e-6 : 1e-3);
    real wanted[3], down[3], turn[9], least = FL_HUGE;
    int32_t best = 0;
    fl_upright(goal->down, turn);
    if (frame == FLINDERS_VEHICLE) fl_multiply(direction, turn, 1, 3, 3, wanted);
    else memcpy(wanted, direction, sizeof wanted);
    for (int32_t pose = 0;; pose++) {
        const int effort = flinders_pose(frame, pose, down);
        if (effort < 0) return best;
        const real cosine = down[0] * wanted[0] + down[1] * wanted[1] + down[2] * wanted[2];
        const real angle = FL_TO_DEG * fl_acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine);
        const real cost = fl_abs(angle - (90 - goal->dip_deg)) + EFFORT_DEG * (real)effort;
        if (cost < least - alike) least = cost, best = pose;
    }
}
