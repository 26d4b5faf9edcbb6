/* A smooth distortion that belongs to the direction: what residuals of one place have in common at different times. */
#include "residuals.h"

enum { CELLS = 100, MIN_CELLS = 20, RATIOS = 8 };

#define MIN_DISTORTION_SIGMAS ((real)3)
#define MIN_VARIANCE_RATIO ((real)0.0625) /* ratio of variances, distortion over white noise: smallest; each of the next is four times larger */
#define MIN_GAIN_BITS ((real)15) /* bits of likelihood that a significant distortion gains over white noise */
#define MIN_AGREEMENT_RATIO ((real)0.4) /* smallest ratio of the agreement of different visits to that expected of a likely distortion */
#define MIN_GAIN_RATIO ((real)0.6) /* smallest ratio of the gain to that of slow noise: of 2,160 recordings of noise alone none has more than 0.51 */

/* Cells of the sphere that hold a reading. */
typedef struct {
    int n;
    real counts[CELLS], means[CELLS]; /* of the residuals */
    real middles[CELLS][3];
    real jacobian[CELLS][9];
    int place[CELLS]; /* of a cell among those seen */
    real *kernel;     /* (n, n) covariance of the distortion, of unit size */
    real *matrix;     /* (n, n) to work in */
} sphere;

/* Weight 1 for each residual, and 0 for that of a repeated reading, which has no information on its place. */
static void weigh_once(fl_residuals *residuals, const fl_room *room)
{
    uint64_t *const keys = (uint64_t *)(void *)room->series; /* twice to four times as many as residuals */
    size_t slots = 2;
    while (slots < 2 * residuals->n) slots *= 2;
    memset(keys, 0xFF, slots * sizeof *keys);
    residuals->weights = (real *)(void *)(keys + slots);
    for (size_t i = 0; i < residuals->n; i++) {
        uint64_t key = 0;
        memcpy(&key, residuals->distances + i, sizeof *residuals->distances);
        const size_t slot = fl_slot(keys, slots, key);
        residuals->weights[i] = keys[slot] != key;
        keys[slot] = key;
    }
}

/* Whether a reading is not another one again. */
static int counts_once(const fl_residuals *residuals, size_t i)
{
    return !residuals->weights || residuals->weights[i] > 0;
}

/* Components of directions along an axis; returns the sum of their cubes. */
static real components(const real axis[3], const real *directions, size_t n, real *restrict out)
{
    const real *const x = directions, *const y = x + FL_LOOKED, *const z = y + FL_LOOKED;
    real lanes[FL_LANES] = {0}, sum = 0;
    for (size_t i = 0; i < n; i++) out[i] = axis[0] * x[i] + axis[1] * y[i] + axis[2] * z[i];
    size_t i = 0;
    for (; i + FL_LANES <= n; i += FL_LANES)
        for (int lane = 0; lane < FL_LANES; lane++) lanes[lane] += out[i + lane] * out[i + lane] * out[i + lane];
    for (; i < n; i++) sum += out[i] * out[i] * out[i];
    for (int lane = 0; lane < FL_LANES; lane++) sum += lanes[lane];
    return sum;
}

/* Sort residuals into cells of the sphere that turn with the readings: what is decided does not depend on the sensor's
 * axes. These are the principal axes of the directions, in rows, to the side of their third moments. */
void fl_sort_by_direction(const fl_kernels *kernels, fl_residuals *residuals)
{
    real *const directions = residuals->directions, *const scratch = residuals->scratch;
    real *const columns[3] = {directions, directions + FL_LOOKED, directions + 2 * FL_LOOKED};
    real *const along[3] = {scratch, scratch + residuals->n, scratch + 2 * residuals->n};
    real moments[9], values[3];
    kernels->gram(columns, 0, residuals->n, 3, moments);
    fl_eigen(moments, 3, values);
    for (int k = 0; k < 3; k++) {
        real *const axis = residuals->axes[k];
        for (int i = 0; i < 3; i++) axis[i] = moments[3 * i + k];
        if (!(components(axis, directions, residuals->n, along[k]) < 0)) continue;
        for (int i = 0; i < 3; i++) axis[i] = -axis[i];
        for (size_t i = 0; i < residuals->n; i++) along[k][i] = -along[k][i];
    }
    kernels->cells(along[0], along[1], along[2], residuals->n, residuals->cells);
}

/* Count readings and residuals by direction: the middle of the readings of each cell. */
static void count_cells(const fl_residuals *residuals, sphere *on)
{
    real counts[CELLS] = {0}, sums[CELLS] = {0}, middles[CELLS][3] = {{0}};
    for (size_t i = 0; i < residuals->n; i++) {
        if (!counts_once(residuals, i)) continue;
        const uint32_t cell = residuals->cells[i];
        counts[cell] += 1, sums[cell] += residuals->distances[i];
        for (int axis = 0; axis < 3; axis++) middles[cell][axis] += residuals->directions[axis * FL_LOOKED + i];
    }
    on->n = 0;
    for (int cell = 0; cell < CELLS; cell++) {
        if (!(counts[cell] > 0)) continue;
        const real *m = middles[cell], length = fl_sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
        on->place[cell] = on->n;
        on->counts[on->n] = counts[cell], on->means[on->n] = sums[cell] / counts[cell];
        for (int axis = 0; axis < 3; axis++) on->middles[on->n][axis] = length > 0 ? m[axis] / length : 0;
        on->n++;
    }
}

/* Products of the sums of different visits to each cell, of residuals and of readings. */
static void between_visits(const fl_residuals *residuals, const sphere *on, size_t apart, real *cross, real *pairs)
{
    real sums[CELLS][2] = {{0}}, squares[CELLS][2] = {{0}}, visit[CELLS][2] = {{0}};
    size_t last[CELLS] = {0};
    for (size_t i = 0; i < residuals->n; i++) {
        if (!counts_once(residuals, i)) continue;
        const int cell = on->place[residuals->cells[i]];
        if (visit[cell][1] > 0 && i - last[cell] > apart)
            for (int k = 0; k < 2; k++) {
                sums[cell][k] += visit[cell][k], squares[cell][k] += visit[cell][k] * visit[cell][k];
                visit[cell][k] = 0;
            }
        visit[cell][0] += residuals->distances[i], visit[cell][1] += 1;
        last[cell] = i;
    }
    for (int cell = 0; cell < on->n; cell++) {
        const real *v = visit[cell], whole = sums[cell][0] + v[0], count = sums[cell][1] + v[1];
        cross[cell] = whole * whole - squares[cell][0] - v[0] * v[0];
        pairs[cell] = count * count - squares[cell][1] - v[1] * v[1];
    }
}

/* Middles of the cells, in the sensor's axes. */
static void centres_of_cells(const fl_residuals *residuals, real centres[CELLS][3])
{
    real cells[CELLS][3];
    fl_sphere_centres(cells);
    fl_multiply(cells[0], residuals->axes[0], CELLS, 3, 3, centres[0]);
}

/* Jacobian of each cell, and covariance of a smooth function without the part that an ellipsoid over all directions
 * absorbs. */
static void fill_kernel(const fl_residuals *residuals, const fl_surface *surface, sphere *on)
{
    real centres[CELLS][3], everywhere[CELLS][9], normal[81] = {0}, inverse[81], absorb[CELLS][9], half[CELLS][9];
    real across[CELLS][9], both[81] = {0};
    centres_of_cells(residuals, centres);
    for (int k = 0; k < on->n; k++) fl_jacobian(surface, on->middles[k], on->jacobian[k]);
    for (int c = 0; c < CELLS; c++) {
        fl_jacobian(surface, centres[c], everywhere[c]);
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) normal[9 * i + j] += everywhere[c][i] * everywhere[c][j];
    }
    fl_inverse(normal, 9, inverse);
    fl_multiply(everywhere[0], inverse, CELLS, 9, 9, absorb[0]);
    memset(half, 0, sizeof half);
    memset(across, 0, sizeof across);
    for (int c = 0; c < CELLS; c++)
        for (int d = 0; d < CELLS; d++) {
            const real likeness = fl_alike(centres[c], centres[d]);
            for (int i = 0; i < 9; i++) half[c][i] += likeness * absorb[d][i];
        }
    for (int c = 0; c < CELLS; c++)
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) both[9 * i + j] += absorb[c][i] * half[c][j];
    for (int k = 0; k < on->n; k++)
        for (int c = 0; c < CELLS; c++) {
            const real likeness = fl_alike(on->middles[k], centres[c]);
            for (int i = 0; i < 9; i++) across[k][i] += likeness * absorb[c][i];
        }
    for (int k = 0; k < on->n; k++)
        for (int l = 0; l < on->n; l++) {
            real entry = fl_alike(on->middles[k], on->middles[l]);
            for (int i = 0; i < 9; i++) {
                entry -= on->jacobian[k][i] * across[l][i] + on->jacobian[l][i] * across[k][i];
                for (int j = 0; j < 9; j++) entry += on->jacobian[k][i] * both[9 * i + j] * on->jacobian[l][j];
            }
            on->kernel[k * on->n + l] = entry;
        }
}

/* Pseudo-inverse of a symmetric matrix (9, 9). */
static void pseudo_inverse(const real matrix[81], real out[81])
{
    real vectors[81], values[9];
    memcpy(vectors, matrix, sizeof vectors);
    fl_eigen(vectors, 9, values);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            out[9 * i + j] = 0;
            for (int k = 0; k < 9; k++)
                if (values[k] > (real)1e-10 * values[8])
                    out[9 * i + j] += vectors[9 * i + k] * vectors[9 * j + k] / values[k];
        }
}

/* Variance that a distortion of unit size leaves in the residuals of a fit to these readings, in each cell. */
static void left_over(const sphere *on, real variance[CELLS])
{
    real normal[81] = {0}, inverse[81], taken[CELLS][9], spread[CELLS][9], both[81] = {0};
    for (int k = 0; k < on->n; k++)
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) normal[9 * i + j] += on->counts[k] * on->jacobian[k][i] * on->jacobian[k][j];
    pseudo_inverse(normal, inverse);
    fl_multiply(on->jacobian[0], inverse, on->n, 9, 9, taken[0]);
    for (int k = 0; k < on->n; k++)
        for (int i = 0; i < 9; i++) taken[k][i] *= on->counts[k];
    fl_multiply(on->kernel, taken[0], on->n, on->n, 9, spread[0]);
    for (int k = 0; k < on->n; k++)
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) both[9 * i + j] += taken[k][i] * spread[k][j];
    for (int k = 0; k < on->n; k++) {
        variance[k] = on->kernel[k * on->n + k];
        for (int i = 0; i < 9; i++) {
            variance[k] -= 2 * on->jacobian[k][i] * spread[k][i];
            for (int j = 0; j < 9; j++) variance[k] += on->jacobian[k][i] * both[9 * i + j] * on->jacobian[k][j];
        }
    }
}

/* Take the most probable distortion off the residuals. */
static void take_off(fl_residuals *residuals, const sphere *on, real direction, real noise)
{
    real weights[CELLS], smooth[CELLS];
    const int n = on->n;
    for (int k = 0; k < n; k++) {
        for (int l = 0; l < n; l++) on->matrix[k * n + l] = direction * direction * on->kernel[k * n + l];
        on->matrix[k * n + k] += noise / on->counts[k];
        weights[k] = on->means[k];
    }
    if (fl_solve(on->matrix, n, weights)) return;
    for (int k = 0; k < n; k++) {
        smooth[k] = 0;
        for (int l = 0; l < n; l++) smooth[k] += direction * direction * on->kernel[k * n + l] * weights[l];
    }
    for (size_t i = 0; i < residuals->n; i++) residuals->distances[i] -= smooth[on->place[residuals->cells[i]]];
}

/* Σ d² and number of the residuals with a weight. */
static real square_of(const fl_residuals *residuals, real *count)
{
    real square = 0;
    *count = 0;
    for (size_t i = 0; i < residuals->n; i++)
        if (counts_once(residuals, i)) square += residuals->distances[i] * residuals->distances[i], *count += 1;
    return square;
}

/* Standard deviation of a distortion of this kernel that different visits to a cell agree on; 0 where it is unproven. */
static real agreed(const fl_residuals *residuals, const fl_surface *surface, sphere *on, size_t apart, real noise)
{
    real cross[CELLS], pairs[CELLS], variance[CELLS], found = 0, weight = 0, expected = 0;
    between_visits(residuals, on, apart, cross, pairs);
    for (int k = 0; k < on->n; k++) {
        found += cross[k] / on->counts[k];
        weight += pairs[k] / (on->counts[k] * on->counts[k]);
    }
    if (!(found > MIN_DISTORTION_SIGMAS * noise * fl_sqrt(2 * weight))) return 0;
    fill_kernel(residuals, surface, on);
    left_over(on, variance);
    for (int k = 0; k < on->n; k++) expected += pairs[k] * variance[k] / on->counts[k];
    return expected > 0 ? fl_sqrt(found / expected) : 0;
}

/* Standard deviation of the distortion, 0 where unproven; its scatter of the gradient, and residuals without it.
 *
 * `known`: the deviation, where `fl_likely_distortion` has found one, or 0. */
real fl_distortion(fl_residuals *residuals, const fl_surface *surface, int has_copies, size_t apart, real time,
                   real known, const fl_room *room, real scatter[81])
{
    sphere on;
    real count, all[CELLS] = {0}, counted[CELLS][9], spread[CELLS][9];
    on.kernel = room->matrices, on.matrix = room->matrices + CELLS * CELLS;
    if (has_copies) weigh_once(residuals, room);
    count_cells(residuals, &on);
    const real square = square_of(residuals, &count), noise = square / count * time;
    const real direction = known > 0 ? known : agreed(residuals, surface, &on, apart, noise);
    if (!(direction > 0)) return 0;
    if (known > 0) fill_kernel(residuals, surface, &on);
    for (size_t i = 0; i < residuals->n; i++) all[on.place[residuals->cells[i]]] += 1;
    for (int k = 0; k < on.n; k++)
        for (int i = 0; i < 9; i++) counted[k][i] = all[k] * on.jacobian[k][i];
    fl_multiply(on.kernel, counted[0], on.n, on.n, 9, spread[0]);
    for (int k = 0; k < on.n; k++)
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) scatter[9 * i + j] += direction * direction * counted[k][i] * spread[k][j];
    take_off(residuals, &on, direction, noise);
    return direction;
}

/* Solve L X = B in place for ten columns side by side. */
static void forward(const real *factor, int n, real rows[CELLS][10])
{
    for (int i = 0; i < n; i++) {
        real row[10];
        memcpy(row, rows[i], sizeof row);
        for (int k = 0; k < i; k++)
            for (int column = 0; column < 10; column++) row[column] -= factor[i * n + k] * rows[k][column];
        for (int column = 0; column < 10; column++) rows[i][column] = row[column] / factor[i * n + i];
    }
}

/* Jacobian and mean of the cells, made independent: over the Cholesky factor of their covariance, which ends on the
 * diagonal of the matrix; nonzero if there is none. */
static int whiten(const sphere *on, real ratio, real rows[CELLS][10])
{
    const int n = on->n;
    for (int k = 0; k < n; k++) {
        for (int l = 0; l <= k && ratio > 0; l++) on->matrix[k * n + l] = ratio * on->kernel[k * n + l];
        on->matrix[k * n + k] = (ratio > 0 ? on->matrix[k * n + k] : 0) + 1 / on->counts[k];
        memcpy(rows[k], on->jacobian[k], sizeof on->jacobian[k]);
        rows[k][9] = on->means[k];
    }
    if (ratio > 0) {
        if (fl_cholesky(on->matrix, n)) return 1;
        forward(on->matrix, n, rows);
        return 0;
    }
    for (int k = 0; k < n; k++) {
        real *const root = on->matrix + k * n + k;
        *root = fl_sqrt(*root);
        for (int column = 0; column < 10; column++) rows[k][column] /= *root;
    }
    return 0;
}

/* Restricted likelihood of a distortion beside white noise, its logarithm to the base 2, but for a constant; and the
 * variance of the white noise.
 *
 * `ratio`: of the variances, distortion over white noise; `within`: squares about the means of the cells. */
static real likelihood_of(const sphere *on, real ratio, real within, real freedom, real *variance)
{
    real rows[CELLS][10], products[100] = {0}, log_determinant = 0;
    const int n = on->n;
    *variance = 0;
    if (whiten(on, ratio, rows)) return -FL_HUGE;
    for (int k = 0; k < n; k++)
        for (int i = 0; i < 10; i++)
            for (int j = 0; j < 10; j++) products[10 * i + j] += rows[k][i] * rows[k][j];
    products[99] += within;
    if (fl_cholesky(products, 10)) return -FL_HUGE;
    for (int k = 0; k < n; k++) log_determinant += 2 * fl_log2(on->matrix[k * n + k]);
    for (int i = 0; i < 9; i++) log_determinant += 2 * fl_log2(products[11 * i]);
    *variance = products[99] * products[99] / freedom;
    return -(log_determinant + freedom * fl_log2(*variance)) / 2;
}

/* Bits that a distortion gains over white noise alone at the likeliest of some ratios, and the variance of the white noise
 * there; none where the smallest gains nothing. */
static real gain_of(const sphere *on, real within, real freedom, real *variance)
{
    const real none = likelihood_of(on, 0, within, freedom, variance);
    real most = none, here;
    for (int k = 0; k < RATIOS; k++) {
        const real one = likelihood_of(on, MIN_VARIANCE_RATIO * fl_pow(4, (real)k), within, freedom, &here);
        if (!(one > most)) break;
        most = one, *variance = here;
    }
    return most - none;
}

/* Standard deviation of a distortion that makes all of the means of the cells but white noise; 0 where different visits
 * to a cell agree far less than it says.
 *
 * `found`: of different visits, as `pairs` of readings in each cell give it. */
static real of_means(const fl_residuals *residuals, const fl_surface *surface, sphere *on, const real *pairs, real found,
                     real white)
{
    real variance[CELLS], made = 0, expected = 0, agreeing = 0;
    fill_kernel(residuals, surface, on);
    left_over(on, variance);
    for (int k = 0; k < on->n; k++) {
        made += on->counts[k] * on->means[k] * on->means[k] - white;
        expected += on->counts[k] * variance[k];
        agreeing += pairs[k] * variance[k] / on->counts[k];
    }
    if (!(made > 0 && expected > 0)) return 0;
    return found > MIN_AGREEMENT_RATIO * agreeing * made / expected ? fl_sqrt(made / expected) : 0;
}

/* Standard deviation of a distortion that is about as likely as slow noise, and far likelier than white noise alone;
 * else 0. It needs less than `agreed`, which hardly tells the two apart where few visits are farther apart than the memory
 * that slow noise would have.
 *
 * `slow`: bits of likelihood that slow noise gains over white noise. */
real fl_likely_distortion(fl_residuals *residuals, const fl_surface *surface, int has_copies, size_t apart, real slow,
                          const fl_room *room)
{
    sphere on;
    real count, white, cross[CELLS], pairs[CELLS], found = 0;
    on.kernel = room->matrices, on.matrix = room->matrices + CELLS * CELLS;
    if (has_copies) weigh_once(residuals, room);
    count_cells(residuals, &on);
    between_visits(residuals, &on, apart, cross, pairs);
    for (int k = 0; k < on.n; k++) found += cross[k] / on.counts[k];
    if (on.n < MIN_CELLS || !(found > 0)) return 0; /* no likelihood proves what visits contradict */
    real within = square_of(residuals, &count);
    for (int k = 0; k < on.n; k++) {
        within -= on.counts[k] * on.means[k] * on.means[k];
        fl_jacobian(surface, on.middles[k], on.jacobian[k]);
        for (int l = 0; l <= k; l++) on.kernel[k * on.n + l] = fl_alike(on.middles[k], on.middles[l]);
    }
    const real gain = gain_of(&on, within, count - 9, &white);
    return gain > MIN_GAIN_BITS && gain > MIN_GAIN_RATIO * slow ? of_means(residuals, surface, &on, pairs, found, white) : 0;
}

/* How likely residuals are, to the base 2, where beside white noise they vary smoothly over directions, for variances of that
 * over that of the residuals; all alike where too few directions are seen. `time`: readings for each independent one. */
void fl_likelihoods_of_variation(const fl_residuals *residuals, const fl_surface *surface, real time, const real *ratios,
                                 int count, const fl_room *room, real *likelihoods)
{
    sphere on;
    real readings, variance;
    on.kernel = room->matrices, on.matrix = room->matrices + CELLS * CELLS;
    count_cells(residuals, &on);
    real within = square_of(residuals, &readings) / time;
    for (int k = 0; k < on.n; k++) {
        on.counts[k] /= time;
        within -= on.counts[k] * on.means[k] * on.means[k];
        fl_jacobian(surface, on.middles[k], on.jacobian[k]);
        for (int l = 0; l <= k; l++) on.kernel[k * on.n + l] = fl_alike(on.middles[k], on.middles[l]);
    }
    const real freedom = readings / time - 9;
    for (int i = 0; i < count; i++)
        likelihoods[i] = on.n > 9 && freedom > 9 ? likelihood_of(&on, ratios[i], within, freedom, &variance) : 0;
}

/* Covariance of two residuals of one direction at different times. */
real fl_common_variance(const fl_residuals *residuals)
{
    sphere on;
    real autocovariance[FL_LAGS], cross[CELLS], pairs[CELLS], found = 0, weight = 0;
    count_cells(residuals, &on);
    between_visits(residuals, &on, 3 * (size_t)fl_autocovariance(residuals, autocovariance), cross, pairs);
    for (int k = 0; k < on.n; k++) found += cross[k] / on.counts[k], weight += pairs[k] / on.counts[k];
    return weight > 0 ? found / weight : 0;
}
