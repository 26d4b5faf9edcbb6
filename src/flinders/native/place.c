/* A field that varies with the place, past which a hand or an arm turns the sensor. As far as it goes with the attitude no
 * residual shows it: offset and soft iron take it up, the more the fewer directions there are.
 *
 * It is taken for a smooth random function of the direction. Where directions lie about a plane, a ring or a point,
 * so that hardly anything of it is left in residuals, its size is what is known of such fields beforehand, weighed by what residuals say
 * (restricted likelihood; D. A. Harville, JASA 72 (1977) 320). `python -m benchmarks.varying_field` measures what it does.
 */
#include "residuals.h"

enum { SIZE_COUNT = 7, MAX_READINGS = 200 }; /* readings, evenly over the recording, that its scatter is taken over */

#define ANGLE_SIGMA_RAD (FL_PI / 6) /* standard deviation of the angle within which the field is alike */
#define MIN_DIRECTION_VARIANCE ((real)0.06) /* variance of directions along an axis from which they count as spread; uniform ones have 1/3 */

/* Possible standard deviations of the field, as shares of it, and their prior probabilities. */
static const real SHARES[SIZE_COUNT] = {0, (real)0.0005, (real)0.001, (real)0.002, (real)0.004, (real)0.008, (real)0.016};
static const real PRIOR_PROBABILITIES[SIZE_COUNT] = {(real)0.02, (real)0.13, (real)0.2, (real)0.25, (real)0.25, (real)0.1, (real)0.05};

/* How alike it is in two directions. */
real fl_alike(const real a[3], const real b[3])
{
    real cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    cosine = cosine > 1 ? 1 : cosine < -1 ? -1 : cosine;
    const real angle = fl_acos(cosine) / ANGLE_SIGMA_RAD;
    return fl_exp(-angle * angle / 2);
}

/* Smallest variance of the directions along an axis; for readings in one plane, within the plane. */
static real thickness(const fl_residuals *residuals)
{
    real mean[3], axes[9], values[3];
    const real n = (real)residuals->n;
    for (int axis = 0; axis < 3; axis++) {
        mean[axis] = 0;
        for (size_t i = 0; i < residuals->n; i++) mean[axis] += residuals->directions[axis * FL_LOOKED + i] / n;
    }
    for (int k = 0; k < 9; k++) {
        const real *const a = residuals->directions + k / 3 * FL_LOOKED, *const b = residuals->directions + k % 3 * FL_LOOKED;
        axes[k] = 0;
        for (size_t i = 0; i < residuals->n; i++) axes[k] += (a[i] - mean[k / 3]) * (b[i] - mean[k % 3]) / n;
    }
    fl_eigen(axes, 3, values);
    return values[0] > FL_ROUNDING * values[2] ? values[0] : values[1];
}

/* Its expected variance, unit squared, where directions are few; else 0. */
real fl_expected_variation(const fl_residuals *residuals, const fl_surface *surface, const fl_room *room)
{
    real autocovariance[FL_LAGS], ratios[SIZE_COUNT], likelihoods[SIZE_COUNT], most, sum = 0, mean = 0;
    if (thickness(residuals) > MIN_DIRECTION_VARIANCE) return 0;
    const real time = fl_time_of(autocovariance, fl_autocovariance(residuals, autocovariance));
    for (int i = 0; i < SIZE_COUNT; i++) {
        const real size = SHARES[i] * surface->radius;
        ratios[i] = size * size / autocovariance[0];
    }
    fl_likelihoods_of_variation(residuals, surface, time, ratios, SIZE_COUNT, room, likelihoods);
    most = likelihoods[0];
    for (int i = 1; i < SIZE_COUNT; i++) most = likelihoods[i] > most ? likelihoods[i] : most;
    for (int i = 0; i < SIZE_COUNT; i++) {
        const real weight = PRIOR_PROBABILITIES[i] * fl_pow(2, likelihoods[i] - most);
        sum += weight, mean += weight * SHARES[i] * SHARES[i];
    }
    return mean / sum * surface->radius * surface->radius;
}

/* Add the scatter of Σ J s over `used` readings where s varies so, with a variance. */
void fl_scatter_of_variation(const fl_residuals *residuals, real variance, size_t used, real scatter[81])
{
    real directions[MAX_READINGS][3], rows[MAX_READINGS][9];
    const size_t n = residuals->n < MAX_READINGS ? residuals->n : MAX_READINGS;
    const real share = (real)used / (real)n, factor = variance * share * share;
    for (size_t k = 0; k < n; k++) {
        const size_t i = k * residuals->n / n;
        for (size_t axis = 0; axis < 3; axis++) directions[k][axis] = residuals->directions[axis * FL_LOOKED + i];
        for (int column = 0; column < 9; column++) rows[k][column] = residuals->columns[column][i];
    }
    for (size_t k = 0; k < n; k++) {
        real along[9] = {0};
        for (size_t l = 0; l < n; l++) {
            const real likeness = fl_alike(directions[k], directions[l]);
            for (int j = 0; j < 9; j++) along[j] += likeness * rows[l][j];
        }
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) scatter[9 * i + j] += factor * rows[k][i] * along[j];
    }
}
