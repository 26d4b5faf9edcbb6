/* Small matrices: eigenvalues, Cholesky factors, symmetric 3 × 3 matrices, and the k-th smallest of a list. */
#include "internal.h"

enum { MAX_SIZE = FL_WIDEST > 10 ? FL_WIDEST : 10 /* of a quadric */, SWEEPS = 60 };

#define MIN_FACTOR_DIAGONAL ((real)1e-3) /* smallest entry on the diagonal of a factor in which no direction is lost */

/* Bring a symmetric matrix (n, n) to tridiagonal form by Householder reflections; `v` becomes their product. */
static void tridiagonal(real *v, int n, real *d, real *e)
{
    for (int j = 0; j < n; j++) d[j] = v[(n - 1) * n + j];
    for (int i = n - 1; i > 0; i--) {
        real scale = 0, h = 0;
        for (int k = 0; k < i; k++) scale += fl_abs(d[k]);
        if (!(scale > FL_TINY)) {
            e[i] = d[i - 1];
            for (int j = 0; j < i; j++) {
                d[j] = v[(i - 1) * n + j];
                v[i * n + j] = v[j * n + i] = 0;
            }
        } else {
            for (int k = 0; k < i; k++) {
                d[k] /= scale;
                h += d[k] * d[k];
            }
            real f = d[i - 1], g = f > 0 ? -fl_sqrt(h) : fl_sqrt(h);
            e[i] = scale * g;
            h -= f * g;
            d[i - 1] = f - g;
            for (int j = 0; j < i; j++) e[j] = 0;
            for (int j = 0; j < i; j++) {
                f = d[j];
                v[j * n + i] = f;
                g = e[j] + v[j * n + j] * f;
                for (int k = j + 1; k < i; k++) {
                    g += v[k * n + j] * d[k];
                    e[k] += v[k * n + j] * f;
                }
                e[j] = g;
            }
            f = 0;
            for (int j = 0; j < i; j++) {
                e[j] /= h;
                f += e[j] * d[j];
            }
            const real hh = f / (h + h);
            for (int j = 0; j < i; j++) e[j] -= hh * d[j];
            for (int j = 0; j < i; j++) {
                f = d[j], g = e[j];
                for (int k = j; k < i; k++) v[k * n + j] -= f * e[k] + g * d[k];
                d[j] = v[(i - 1) * n + j];
                v[i * n + j] = 0;
            }
        }
        d[i] = h;
    }
    for (int i = 0; i < n - 1; i++) {
        v[(n - 1) * n + i] = v[i * n + i];
        v[i * n + i] = 1;
        const real h = d[i + 1];
        if (h != 0) {
            for (int k = 0; k <= i; k++) d[k] = v[k * n + i + 1] / h;
            for (int j = 0; j <= i; j++) {
                real g = 0;
                for (int k = 0; k <= i; k++) g += v[k * n + i + 1] * v[k * n + j];
                for (int k = 0; k <= i; k++) v[k * n + j] -= g * d[k];
            }
        }
        for (int k = 0; k <= i; k++) v[k * n + i + 1] = 0;
    }
    for (int j = 0; j < n; j++) {
        d[j] = v[(n - 1) * n + j];
        v[(n - 1) * n + j] = 0;
    }
    v[n * n - 1] = 1;
    e[0] = 0;
}

/* √(a² + b²) of numbers whose squares may not be numbers. */
static real hypotenuse(real a, real b)
{
    a = fl_abs(a), b = fl_abs(b);
    const real larger = a > b ? a : b, smaller = a > b ? b : a;
    if (!(larger > 0)) return larger;
    const real ratio = smaller / larger;
    return larger * fl_sqrt(1 + ratio * ratio);
}

/* Exchange rows and columns of a matrix (n, n). */
static void transpose(real *matrix, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            const real entry = matrix[i * n + j];
            matrix[i * n + j] = matrix[j * n + i], matrix[j * n + i] = entry;
        }
}

/* Eigenvalues of a tridiagonal matrix by the QL algorithm with implicit shifts; the rows of `v` are turned along. */
static void diagonalise(real *v, int n, real *d, real *e)
{
    real f = 0, largest = 0;
    const real epsilon = sizeof(real) == sizeof(double) ? (real)DBL_EPSILON : (real)FLT_EPSILON;
    for (int i = 1; i < n; i++) e[i - 1] = e[i];
    e[n - 1] = 0;
    for (int l = 0; l < n; l++) {
        const real here = fl_abs(d[l]) + fl_abs(e[l]);
        largest = here > largest ? here : largest;
        int m = l;
        while (m < n - 1 && fl_abs(e[m]) > epsilon * largest) m++;
        for (int sweep = 0; m > l && sweep < SWEEPS; sweep++) {
            real g = d[l], p = (d[l + 1] - g) / (2 * e[l]), r = hypotenuse(p, 1);
            if (p < 0) r = -r;
            d[l] = e[l] / (p + r);
            d[l + 1] = e[l] * (p + r);
            const real dl1 = d[l + 1], h = g - d[l], el1 = e[l + 1];
            for (int i = l + 2; i < n; i++) d[i] -= h;
            f += h;
            p = d[m];
            real c = 1, c2 = 1, c3 = 1, s = 0, s2 = 0;
            for (int i = m - 1; i >= l; i--) {
                c3 = c2, c2 = c, s2 = s;
                g = c * e[i];
                const real q = c * p;
                r = hypotenuse(p, e[i]);
                e[i + 1] = s * r;
                s = e[i] / r;
                c = p / r;
                p = c * d[i] - s * g;
                d[i + 1] = q + s * (c * g + s * d[i]);
                real *const one = v + i * n, *const next = one + n;
                for (int k = 0; k < n; k++) {
                    const real t = next[k], o = one[k];
                    next[k] = s * o + c * t;
                    one[k] = c * o - s * t;
                }
            }
            p = -s * s2 * c3 * el1 * e[l] / dl1;
            e[l] = s * p;
            d[l] = c * p;
            if (!(fl_abs(e[l]) > epsilon * largest)) break;
        }
        d[l] += f;
        e[l] = 0;
    }
}

/* Ascending eigenvalues of a symmetric matrix (n, n), n ≤ 15, which becomes its eigenvectors in columns. */
void fl_eigen(real *matrix, int n, real *values)
{
    real e[MAX_SIZE];
    for (int i = 0; i < n * n; i++) {
        if (isfinite(matrix[i])) continue;
        for (int k = 0; k < n * n; k++) matrix[k] = k % (n + 1) == 0;
        for (int k = 0; k < n; k++) values[k] = FL_NOT_A_NUMBER;
        return;
    }
    tridiagonal(matrix, n, values, e);
    transpose(matrix, n);
    diagonalise(matrix, n, values, e);
    for (int i = 0; i < n - 1; i++) {
        int least = i;
        for (int j = i + 1; j < n; j++)
            if (values[j] < values[least]) least = j;
        if (least == i) continue;
        const real value = values[i];
        values[i] = values[least], values[least] = value;
        for (int k = 0; k < n; k++) {
            const real entry = matrix[i * n + k];
            matrix[i * n + k] = matrix[least * n + k], matrix[least * n + k] = entry;
        }
    }
    transpose(matrix, n);
}

/* Subtract a multiple of one row from another. */
static inline void subtract(real *restrict row, const real *restrict other, real factor, int n)
{
    for (int k = 0; k < n; k++) row[k] -= factor * other[k];
}

/* Replace the lower triangle of a matrix (n, n) by its Cholesky factor, and the part above the diagonal by the
 * transpose; nonzero if the matrix is not positive definite. */
int fl_cholesky(real *a, int n)
{
    for (int k = 0; k < n; k++) {
        real *const above = a + k * n;
        if (!(above[k] > 0)) return 1;
        above[k] = fl_sqrt(above[k]);
        for (int i = k + 1; i < n; i++) {
            above[i] = a[i * n + k] /= above[k];
            subtract(a + i * n + k + 1, above + k + 1, above[i], i - k);
        }
    }
    return 0;
}

/* Cholesky factor of a matrix with ones on its diagonal; nonzero where it is singular or near to it. */
int fl_cholesky_regular(const real *matrix, int n, real *factor)
{
    memcpy(factor, matrix, (size_t)(n * n) * sizeof(real));
    if (fl_cholesky(factor, n)) return 1;
    for (int i = 0; i < n; i++)
        if (!(factor[i * n + i] > MIN_FACTOR_DIAGONAL)) return 1;
    return 0;
}

/* Solve L x = b in place. */
void fl_forward(const real *factor, int n, real *x)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++) x[i] -= factor[i * n + k] * x[k];
        x[i] /= factor[i * n + i];
    }
}

/* Solve L Lᵀ x = b in place. */
void fl_cholesky_solve(const real *factor, int n, real *x)
{
    fl_forward(factor, n, x);
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++) x[i] -= factor[k * n + i] * x[k];
        x[i] /= factor[i * n + i];
    }
}

/* Inverse of L Lᵀ (n, n), which is symmetric: of each column what is on and below the diagonal. */
void fl_cholesky_inverse(const real *factor, int n, real *inverse)
{
    for (int j = 0; j < n; j++) {
        real x[MAX_SIZE] = {0};
        x[j] = 1;
        for (int i = j; i < n; i++) {
            for (int k = j; k < i; k++) x[i] -= factor[i * n + k] * x[k];
            x[i] /= factor[i * n + i];
        }
        for (int i = n - 1; i >= j; i--) {
            for (int k = i + 1; k < n; k++) x[i] -= factor[k * n + i] * x[k];
            x[i] /= factor[i * n + i];
            inverse[i * n + j] = inverse[j * n + i] = x[i];
        }
    }
}

/* Solve M x = b in place for a positive definite M, which is lost; nonzero if it is none. */
int fl_solve(real *matrix, int n, real *x)
{
    if (fl_cholesky(matrix, n)) return 1;
    fl_cholesky_solve(matrix, n, x);
    return 0;
}

/* (n, k) product of (n, m) and (m, k). */
static inline void multiply(const real *restrict a, const real *restrict b, int n, int m, int k, real *restrict out)
{
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < k; j++) out[i * k + j] = 0;
        for (int l = 0; l < m; l++)
            for (int j = 0; j < k; j++) out[i * k + j] += a[i * m + l] * b[l * k + j];
    }
}

/* The same; with nine columns, as most have, known to the compiler. */
void fl_multiply(const real *a, const real *b, int n, int m, int k, real *out)
{
    if (k == 9) multiply(a, b, n, m, 9, out);
    else multiply(a, b, n, m, k, out);
}

/* Determinant of a symmetric 3 × 3 matrix. */
real fl_sym3_det(const real s[6])
{
    return s[0] * (s[1] * s[2] - s[5] * s[5]) - s[3] * (s[3] * s[2] - s[5] * s[4]) + s[4] * (s[3] * s[5] - s[1] * s[4]);
}

/* Inverse of a symmetric 3 × 3 matrix. */
void fl_sym3_inverse(const real s[6], real inverse[6])
{
    const real det = fl_sym3_det(s);
    inverse[0] = (s[1] * s[2] - s[5] * s[5]) / det;
    inverse[1] = (s[0] * s[2] - s[4] * s[4]) / det;
    inverse[2] = (s[0] * s[1] - s[3] * s[3]) / det;
    inverse[3] = (s[4] * s[5] - s[3] * s[2]) / det;
    inverse[4] = (s[3] * s[5] - s[4] * s[1]) / det;
    inverse[5] = (s[3] * s[4] - s[0] * s[5]) / det;
}

/* Ascending eigenvalues of a symmetric 3 × 3 matrix (O. K. Smith, Comm. ACM 4 (1961) 168). */
void fl_sym3_values(const real s[6], real values[3])
{
    const real mean = (s[0] + s[1] + s[2]) / 3;
    const real x = s[0] - mean, y = s[1] - mean, z = s[2] - mean;
    const real size = fl_sqrt((x * x + y * y + z * z + 2 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5])) / 6);
    const real unit = size > FL_TINY ? size : 1;
    const real rest[6] = {x / unit, y / unit, z / unit, s[3] / unit, s[4] / unit, s[5] / unit};
    const real cosine = fl_sym3_det(rest) / 2, angle = fl_acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine) / 3;
    values[2] = mean + 2 * size * fl_cos(angle);
    values[0] = mean + 2 * size * fl_cos(angle + 2 * FL_PI / 3);
    values[1] = 3 * mean - values[2] - values[0];
}

/* Put those of n numbers that are below a pivot, or not above it, in front; counts them. No branch depends on them. */
static size_t partition(real *values, size_t n, real pivot, int with_equal)
{
    size_t front = 0;
    for (size_t i = 0; i < n; i++) {
        const real value = values[i];
        values[i] = values[front];
        values[front] = value;
        front += (size_t)((value < pivot) | ((value == pivot) & with_equal));
    }
    return front;
}

/* Sort a few numbers. */
static void sort_few(real *values, size_t n)
{
    for (size_t i = 1; i < n; i++) {
        const real value = values[i];
        size_t at = i;
        for (; at > 0 && values[at - 1] > value; at--) values[at] = values[at - 1];
        values[at] = value;
    }
}

/* A number near the one that a share of n numbers lies below: that of 15 of them. */
static real pivot_of(const real *values, size_t n, size_t k)
{
    enum { PIVOT_SAMPLES = 15 };
    real some[PIVOT_SAMPLES];
    for (size_t i = 0; i < PIVOT_SAMPLES; i++) some[i] = values[i * (n - 1) / (PIVOT_SAMPLES - 1)];
    sort_few(some, PIVOT_SAMPLES);
    return some[k * PIVOT_SAMPLES / n];
}

/* The k-th smallest of a list, which is put into another order: none before it is larger. NaN where the list has one that is
 * met. */
real fl_select(real *values, size_t n, size_t k)
{
    enum { SORTED_LENGTH = 24 };
    real *from = values;
    size_t left = n, wanted = k;
    while (left > SORTED_LENGTH) {
        const real pivot = pivot_of(from, left, wanted);
        size_t front = partition(from, left, pivot, 0);
        if (wanted < front) {
            left = front;
            continue;
        }
        if (front == 0) {
            front = partition(from, left, pivot, 1);
            if (wanted < front || front == 0) return pivot;
        }
        from += front, left -= front, wanted -= front;
    }
    sort_few(from, left);
    return values[k];
}
