/* Autocovariance of residuals, the scatter that it gives the gradient, and blocks that scatter more than it allows. */
#include "residuals.h"

enum { MAX_LAGS_TAKEN = 20, MAX_MEANS = 1200, MIN_MEAN_READINGS = 5, MIN_STEPS = 30 };

#define MIN_PAIR_SHARE ((real)0.75)
#define MIN_CORRELATION_ERRORS ((real)2)
#define MAX_P_VALUE ((real)0.02)
#define MIN_WIDTH_SHARE ((real)0.25) /* smallest ratio of a direction's widening to the mean of all */

/* Σ d(i) d(i + lag) within stretches. */
static real lagged(const fl_residuals *residuals, size_t lag)
{
    real lanes[FL_LANES] = {0}, sum = 0;
    for (int stretch = 0; stretch < residuals->stretches; stretch++) {
        const size_t begin = residuals->begins[stretch], end = residuals->begins[stretch + 1];
        if (end - begin <= lag) continue;
        const real *a = residuals->distances + begin, *b = a + lag;
        const size_t n = end - begin - lag;
        size_t i = 0;
        for (; i + FL_LANES <= n; i += FL_LANES)
            for (int lane = 0; lane < FL_LANES; lane++) lanes[lane] += a[i + lane] * b[i + lane];
        for (; i < n; i++) sum += a[i] * b[i];
    }
    for (int lane = 0; lane < FL_LANES; lane++) sum += lanes[lane];
    return sum;
}

/* Correlation of a residual with the next. */
real fl_lag_one(const fl_residuals *residuals)
{
    const real square = lagged(residuals, 0);
    return lagged(residuals, 1) / (square > FL_TINY ? square : FL_TINY);
}

/* Mean of successive distances. */
static real mean_of(const real *distances, size_t n)
{
    real sum = 0;
    for (size_t i = 0; i < n; i++) sum += distances[i];
    return sum / (real)n;
}

/* Kurtosis of the steps between means of successive residuals: 3 for normal noise of any duration, and more for
 * disturbances that switch. Not a number for few steps. */
real fl_steps_kurtosis(const fl_residuals *residuals)
{
    const size_t share = (residuals->n + MAX_MEANS - 1) / MAX_MEANS, length = share > MIN_MEAN_READINGS ? share : MIN_MEAN_READINGS;
    real square = 0, fourth = 0, count = 0;
    for (int stretch = 0; stretch < residuals->stretches; stretch++) {
        const size_t begin = residuals->begins[stretch], end = residuals->begins[stretch + 1];
        for (size_t i = begin; i + 2 * length <= end; i += length) {
            const real *at = residuals->distances + i;
            const real step = mean_of(at + length, length) - mean_of(at, length);
            square += step * step;
            fourth += step * step * step * step;
            count++;
        }
    }
    return count >= MIN_STEPS && square > 0 ? count * fourth / (square * square) : FL_NOT_A_NUMBER;
}

/* How many lags leave enough readings a partner in their stretch. */
static size_t longest_lag(const fl_residuals *residuals)
{
    size_t lag = 0;
    for (; lag < FL_LAGS; lag++) {
        size_t partners = 0;
        for (int stretch = 0; stretch < residuals->stretches; stretch++) {
            const size_t length = residuals->begins[stretch + 1] - residuals->begins[stretch];
            partners += length > lag + 1 ? length - lag - 1 : 0;
        }
        if (!((real)partners >= MIN_PAIR_SHARE * (real)residuals->n)) break;
    }
    return lag;
}

/* C(0), C(1), ... up to where it sinks into its noise; C(0) alone where residuals are white. Counts them. */
int fl_autocovariance(const fl_residuals *residuals, real out[FL_LAGS])
{
    const real n = (real)residuals->n, zero = lagged(residuals, 0), least = MIN_CORRELATION_ERRORS / fl_sqrt(n);
    size_t lag = 1;
    out[0] = zero / n;
    if (fl_abs(lagged(residuals, 1)) < least * (zero > FL_TINY ? zero : FL_TINY)) return 1;
    const size_t most = longest_lag(residuals);
    if (most < 2) return 1;
    for (; lag < most; lag++) {
        const real sum = lagged(residuals, lag);
        if (sum < least * zero) break;
        out[lag] = sum / n;
    }
    return (int)lag;
}

/* Readings that say as much as one independent reading. */
real fl_time_of(const real *autocovariance, int lags)
{
    real sum = 0;
    for (int lag = 1; lag < lags; lag++) sum += autocovariance[lag];
    return 1 + 2 * sum / (autocovariance[0] > FL_TINY ? autocovariance[0] : FL_TINY);
}

/* Lags at which products are taken, and their weights: linear between them. Counts them. */
static int quadrature(const real *autocovariance, int count, int lags[MAX_LAGS_TAKEN], real weights[MAX_LAGS_TAKEN])
{
    const int last = count - 1;
    int n = 0;
    for (int i = 0; i < MAX_LAGS_TAKEN; i++) {
        const int lag = i == 0 ? 1 : (int)fl_floor(fl_pow((real)last, (real)i / (MAX_LAGS_TAKEN - 1)) + (real)0.5);
        if (n == 0 || lag > lags[n - 1]) lags[n] = lag, weights[n++] = 0;
    }
    for (int k = 1, at = 0; k <= last; k++) {
        while (at + 1 < n && lags[at + 1] <= k) at++;
        const real along = at + 1 < n ? (real)(k - lags[at]) / (real)(lags[at + 1] - lags[at]) : 0;
        weights[at] += (1 - along) * autocovariance[k];
        if (at + 1 < n) weights[at + 1] += along * autocovariance[k];
    }
    return n;
}

/* Add Σ w(lag) · (Σ J(i) J(i + lag)ᵀ + its transpose). */
static void add_lagged(const fl_kernels *kernels, const fl_residuals *residuals, const int *lags, const real *weights,
                       int count, real *total)
{
    const int n = residuals->width;
    real product[FL_WIDEST * FL_WIDEST] = {0};
    for (int stretch = 0; stretch < residuals->stretches; stretch++) {
        const size_t begin = residuals->begins[stretch], length = residuals->begins[stretch + 1] - begin;
        kernels->lagged(residuals->columns, begin, length, n, lags, weights, count, product);
    }
    for (int a = 0; a < n; a++)
        for (int b = 0; b < n; b++) total[n * a + b] += product[n * a + b] + product[n * b + a];
}

/* The columns, and behind them the distances. */
void fl_all_columns(const fl_residuals *residuals, real *columns[FL_COLUMNS])
{
    memcpy(columns, residuals->columns, (size_t)residuals->width * sizeof *columns);
    columns[residuals->width] = residuals->distances;
}

/* Products of all columns and the distances, over n readings from a place on. */
void fl_gram(const fl_kernels *kernels, const fl_residuals *residuals, size_t begin, size_t n, real *products)
{
    real *columns[FL_COLUMNS];
    fl_all_columns(residuals, columns);
    kernels->gram(columns, begin, n, residuals->width + 1, products);
}

/* Normal equations of some columns, from products of all, the last of which is the distance. */
void fl_normal_equations(const real *products, int columns, int first, int width, real *matrix, real *gradient)
{
    for (int a = 0; a < width; a++) {
        const real *const row = products + columns * (first + a);
        memcpy(matrix + width * a, row + first, (size_t)width * sizeof(real));
        gradient[a] = row[columns - 1];
    }
}

/* Σ JJᵀ and Σ J s of eight blocks. */
void fl_blocks_of(const fl_kernels *kernels, const fl_residuals *residuals, fl_blocks *blocks)
{
    const size_t each = residuals->n / FL_BLOCKS, longer = residuals->n % FL_BLOCKS;
    real products[100];
    size_t begin = 0;
    for (int block = 0; block < FL_BLOCKS; block++) {
        const size_t n = each + ((size_t)block < longer);
        fl_gram(kernels, residuals, begin, n, products);
        fl_normal_equations(products, 10, 0, 9, blocks->squares[block], blocks->gradients[block]);
        begin += n;
    }
}

/* k values and (n, k) vectors with VᵀMV = diag(values), over the directions that rounding leaves of M; returns k. */
int fl_principal(const real *matrix, int n, real *values, real *vectors)
{
    real scale[FL_WIDEST], all[FL_WIDEST * FL_WIDEST], everything[FL_WIDEST], largest = 0;
    int kept = 0;
    for (int i = 0; i < n; i++) largest = matrix[(n + 1) * i] > largest ? matrix[(n + 1) * i] : largest;
    for (int i = 0; i < n; i++)
        scale[i] = matrix[(n + 1) * i] > FL_ROUNDING * largest ? fl_sqrt(matrix[(n + 1) * i]) : 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            all[n * i + j] = scale[i] > 0 && scale[j] > 0 ? matrix[n * i + j] / (scale[i] * scale[j]) : 0;
    fl_eigen(all, n, everything);
    for (int k = 0; k < n; k++) kept += everything[k] > FL_DEPENDENT * everything[n - 1];
    for (int k = n - kept, at = 0; k < n; k++, at++) {
        values[at] = everything[k];
        for (int i = 0; i < n; i++) vectors[kept * i + at] = all[n * i + k] / (scale[i] > 0 ? scale[i] : 1);
    }
    return kept;
}

/* Aᵀ M A for A (n, k). */
static void congruent(const real *a, const real *matrix, int n, int k, real *out)
{
    real half[FL_WIDEST * FL_WIDEST];
    fl_multiply(matrix, a, n, n, k, half);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) {
            out[k * i + j] = 0;
            for (int l = 0; l < n; l++) out[k * i + j] += a[k * l + i] * half[k * l + j];
        }
}

/* Raise a matrix (n, n), positive semidefinite, to another wherever it is below that, and to a share of what it is over
 * that on average. */
void fl_raise(real *scatter, const real *white, int n, real share)
{
    real values[FL_WIDEST], inflation[FL_WIDEST], mean = 0, inverse[FL_WIDEST * FL_WIDEST];
    real turned[FL_WIDEST * FL_WIDEST], half[FL_WIDEST * FL_WIDEST], spread[FL_WIDEST * FL_WIDEST];
    const int k = fl_principal(white, n, values, inverse);
    if (!k) return;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < k; j++) inverse[k * i + j] /= fl_sqrt(values[j]);
    congruent(inverse, scatter, n, k, turned);
    fl_eigen(turned, k, inflation);
    for (int j = 0; j < k; j++) mean += inflation[j] / (real)k;
    const real least = mean * share > 1 ? mean * share : 1;
    fl_multiply(inverse, turned, n, k, k, half);
    fl_multiply(white, half, n, n, k, spread);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            scatter[n * i + j] = 0;
            for (int l = 0; l < k; l++)
                scatter[n * i + j] += spread[k * i + l] * spread[k * j + l] * (inflation[l] > least ? inflation[l] : least);
        }
}

/* Σᵢⱼ JᵢJⱼᵀ C(i − j), the products of Jacobians interpolated between a few lags; `white` is that of C(0) alone. */
void fl_scatter_in_time(const fl_kernels *kernels, const fl_residuals *residuals, const real *white,
                        const real *autocovariance, int lags, real *scatter)
{
    real weights[MAX_LAGS_TAKEN];
    int taken[MAX_LAGS_TAKEN];
    memcpy(scatter, white, (size_t)(residuals->width * residuals->width) * sizeof(real));
    if (lags < 2) return;
    add_lagged(kernels, residuals, taken, weights, quadrature(autocovariance, lags, taken, weights), scatter);
    fl_raise(scatter, white, residuals->width, MIN_WIDTH_SHARE);
}

/* Square of a change (n,) in units of its covariance (n, n), over what that leaves free; counts these directions. */
int fl_chi_square(const real *change, const real *covariance, int n, real *square)
{
    real scale[FL_WIDEST], vectors[FL_WIDEST * FL_WIDEST], values[FL_WIDEST];
    int freedom = 0;
    *square = 0;
    for (int i = 0; i < n; i++) scale[i] = covariance[(n + 1) * i] > 0 ? fl_sqrt(covariance[(n + 1) * i]) : 0;
    for (int i = 0; i < n * n; i++)
        vectors[i] = covariance[i] / ((scale[i / n] > 0 ? scale[i / n] : 1) * (scale[i % n] > 0 ? scale[i % n] : 1));
    fl_eigen(vectors, n, values);
    for (int k = 0; k < n; k++) {
        real along = 0;
        if (!(values[k] > FL_DEPENDENT * values[n - 1])) continue;
        for (int i = 0; i < n; i++) along += scale[i] > 0 ? vectors[n * i + k] * change[i] / scale[i] : 0;
        *square += along * along / values[k];
        freedom++;
    }
    return freedom;
}

/* How often chance alone makes chi-square as large (E. B. Wilson, M. M. Hilferty, PNAS 17 (1931) 684), where `others` are
 * the degrees of freedom of its unit, or none of a known one (E. Paulson, Ann. Math. Stat. 13 (1942) 233). */
real fl_chance_of(real chi_square, real freedom, real others)
{
    if (!(freedom > 0) || !(chi_square > 0)) return 1;
    if (!isfinite(chi_square)) return 0;
    const real ours = 2 / (9 * freedom), theirs = others > 0 ? 2 / (9 * others) : 0, root = fl_cbrt(chi_square / freedom);
    const real normal = ((1 - theirs) * root - (1 - ours)) / fl_sqrt(theirs * root * root + ours);
    return fl_erfc(normal / (real)1.4142135623730951) / 2;
}

/* Significant ratio of the scatter of blocks to the expected one; else 1. */
static real excess(int blocks, int k, real gradients[FL_BLOCKS][9], real shares[FL_BLOCKS][81])
{
    real taken = 0, found = 0;
    for (int block = 0; block < blocks; block++)
        for (int i = 0; i < k; i++) {
            found += gradients[block][i] * gradients[block][i];
            for (int j = 0; j < k; j++) taken += shares[block][k * i + j] * shares[block][k * j + i];
        }
    const real expected = (real)k - taken;
    if (!(expected > 0)) return 1;
    const real freedom = fl_floor(expected * expected / taken + (real)0.5);
    return fl_chance_of(found * expected / taken, freedom, 0) < MAX_P_VALUE && found > expected ? found / expected : 1;
}

/* Take gradients of blocks to a basis in which a scatter is the unit matrix, and normal matrices to the directions that
 * it has; returns how many these are. */
static int whiten(fl_blocks *blocks, const real scatter[81])
{
    real values[9], vectors[81], scale[9], scaled[81], factor[81], square[81], gradient[9], largest = 0;
    for (int i = 0; i < 9; i++) largest = scatter[10 * i] > largest ? scatter[10 * i] : largest;
    for (int i = 0; i < 9; i++) scale[i] = scatter[10 * i] > FL_ROUNDING * largest ? fl_sqrt(scatter[10 * i]) : 0;
    for (int i = 0; i < 81; i++) {
        const real unit = scale[i / 9] * scale[i % 9];
        scaled[i] = unit > 0 ? scatter[i] / unit : 0;
    }
    if (!fl_cholesky_regular(scaled, 9, factor)) { /* shares of all directions are the same in every basis */
        for (int block = 0; block < FL_BLOCKS; block++) {
            for (int i = 0; i < 9; i++) blocks->gradients[block][i] /= scale[i];
            fl_forward(factor, 9, blocks->gradients[block]);
        }
        return 9;
    }
    const int k = fl_principal(scatter, 9, values, vectors);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < k; j++) vectors[k * i + j] /= fl_sqrt(values[j]);
    for (int block = 0; block < FL_BLOCKS; block++) {
        memcpy(gradient, blocks->gradients[block], sizeof gradient);
        fl_multiply(gradient, vectors, 1, 9, k, blocks->gradients[block]);
        congruent(vectors, blocks->squares[block], 9, k, square);
        memcpy(blocks->squares[block], square, sizeof square);
    }
    return k;
}

/* Factor by which blocks of the recording scatter more than a scatter of the whole allows; at least 1. The blocks end
 * as shares of their sum. */
real fl_creep(fl_blocks *blocks, const real scatter[81])
{
    real sum[81] = {0}, inverse[81], square[81], largest = 1;
    const int k = whiten(blocks, scatter);
    for (int block = 0; block < FL_BLOCKS; block++)
        for (int i = 0; i < k * k; i++) sum[i] += blocks->squares[block][i];
    fl_inverse(sum, k, inverse);
    for (int block = 0; block < FL_BLOCKS; block++) {
        memcpy(square, blocks->squares[block], sizeof square);
        fl_multiply(inverse, square, k, k, k, blocks->squares[block]);
    }
    for (int count = FL_BLOCKS; count >= 4 && k > 0; count /= 2) {
        const real found = excess(count, k, blocks->gradients, blocks->squares);
        largest = found > largest ? found : largest;
        for (int block = 0; block < count / 2; block++) {
            for (int i = 0; i < k; i++)
                blocks->gradients[block][i] = blocks->gradients[2 * block][i] + blocks->gradients[2 * block + 1][i];
            for (int i = 0; i < k * k; i++)
                blocks->squares[block][i] = blocks->squares[2 * block][i] + blocks->squares[2 * block + 1][i];
        }
    }
    return largest;
}
