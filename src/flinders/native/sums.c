/* Sums of monomials of readings up to degree four, which are additive, and can be moved to another origin. */
#include "sums.h"

const unsigned char FL_EXPONENTS[35][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {2, 0, 0}, {1, 1,
    0}, {0, 2, 0}, {1, 0, 1}, {0, 1, 1}, {0, 0, 2}, {3, 0, 0}, {2, 1, 0}, {1, 2, 0}, {0, 3, 0}, {2, 0, 1}, {1,
    1, 1}, {0, 2, 1}, {1, 0, 2}, {0, 1, 2}, {0, 0, 3}, {4, 0, 0}, {3, 1, 0}, {2, 2, 0}, {1, 3, 0}, {0, 4, 0},
    {3, 0, 1}, {2, 1, 1}, {1, 2, 1}, {0, 3, 1}, {2, 0, 2}, {1, 1, 2}, {0, 2, 2}, {1, 0, 3}, {0, 1, 3}, {0, 0,
    4}};
const unsigned char FL_PRODUCT[10][10] = {{20, 22, 29, 21, 25, 26, 10, 11, 14, 4}, {22, 24, 31, 23, 27, 28, 12,
    13, 16, 6}, {29, 31, 34, 30, 32, 33, 17, 18, 19, 9}, {21, 23, 30, 22, 26, 27, 11, 12, 15, 5}, {25, 27, 32, 26,
    29, 30, 14, 15, 17, 7}, {26, 28, 33, 27, 30, 31, 15, 16, 18, 8}, {10, 12, 17, 11, 14, 15, 4, 5, 7, 1}, {11, 13,
    18, 12, 15, 16, 5, 6, 8, 2}, {14, 16, 19, 15, 17, 18, 7, 8, 9, 3}, {4, 6, 9, 5, 7, 8, 1, 2, 3, 0}};

/* Index of the sum with these exponents: the 35 sums are sorted by degree, exponent of z, and exponent of y. */
static int index_of(int i, int j, int k)
{
    const int degree = i + j + k;
    return degree * (degree + 1) * (degree + 2) / 6 + k * (degree + 1) - k * (k - 1) / 2 + j;
}

/* Scatter matrix (10, 10) of the monomials xx, yy, zz, 2xy, 2xz, 2yz, x, y, z, 1. */
void fl_unpack(const real sums[35], real scatter[100])
{
    for (int i = 0; i < 10; i++)
        for (int j = 0; j < 10; j++) {
            const int twice = (i >= 3 && i < 6 ? 2 : 1) * (j >= 3 && j < 6 ? 2 : 1);
            scatter[10 * i + j] = twice * sums[FL_PRODUCT[i][j]];
        }
}

/* -½ ∇² on the monomials: correction of each sum per unit of noise variance. */
void fl_heat(const real sums[35], real out[35])
{
    for (int sum = 0; sum < 35; sum++) {
        const int p[3] = {FL_EXPONENTS[sum][0], FL_EXPONENTS[sum][1], FL_EXPONENTS[sum][2]};
        out[sum] = 0;
        for (int axis = 0; axis < 3; axis++)
            if (p[axis] >= 2)
                out[sum] -= (real)0.5 * p[axis] * (p[axis] - 1) *
                            sums[index_of(p[0] - 2 * (axis == 0), p[1] - 2 * (axis == 1), p[2] - 2 * (axis == 2))];
    }
}

/* Begin sums. */
void flinders_sums_begin(flinders_sums *sums, const real origin[3], real scale)
{
    memset(sums, 0, sizeof *sums);
    if (origin) memcpy(sums->origin, origin, sizeof sums->origin);
    sums->scale = scale;
}

/* Add readings. */
int flinders_sums_add(flinders_sums *sums, const real *field, size_t rows)
{
    real more[35];
    const fl_view view = {field, rows, NULL, 1};
    for (size_t i = 0; i < 3 * rows; i++)
        if (!isfinite(field[i])) return FLINDERS_NOT_FINITE;
    fl_kernels_chosen(0)->powers(&view, sums->origin, sums->scale, more);
    for (int sum = 0; sum < 35; sum++) sums->sums[sum] += more[sum];
    return FLINDERS_OK;
}

/* (x - shift)^n of one axis as sums of powers: binomial coefficients times powers of the shift. */
static void binomials(real shift, real ratio, real out[5][5])
{
    static const real CHOOSE[5][5] = {{1}, {1, 1}, {1, 2, 1}, {1, 3, 3, 1}, {1, 4, 6, 4, 1}};
    for (int n = 0; n < 5; n++)
        for (int k = 0; k <= n; k++) {
            real power = CHOOSE[n][k];
            for (int i = 0; i < n - k; i++) power *= -shift;
            for (int i = 0; i < n; i++) power *= ratio;
            out[n][k] = power;
        }
}

/* Move sums to another origin and scale. */
void flinders_sums_move(flinders_sums *sums, const real origin[3], real scale)
{
    real moved[35], factor[3][5][5];
    for (int axis = 0; axis < 3; axis++)
        binomials((origin[axis] - sums->origin[axis]) / sums->scale, sums->scale / scale, factor[axis]);
    for (int sum = 0; sum < 35; sum++) {
        moved[sum] = 0;
        for (int i = 0; i <= FL_EXPONENTS[sum][0]; i++)
            for (int j = 0; j <= FL_EXPONENTS[sum][1]; j++)
                for (int k = 0; k <= FL_EXPONENTS[sum][2]; k++)
                    moved[sum] += factor[0][FL_EXPONENTS[sum][0]][i] * factor[1][FL_EXPONENTS[sum][1]][j] *
                                  factor[2][FL_EXPONENTS[sum][2]][k] * sums->sums[index_of(i, j, k)];
    }
    memcpy(sums->sums, moved, sizeof moved);
    memcpy(sums->origin, origin, sizeof sums->origin);
    sums->scale = scale;
}

/* Add other sums after moving them to the same origin and scale. */
void flinders_sums_merge(flinders_sums *sums, const flinders_sums *other)
{
    flinders_sums moved = *other;
    if (!(sums->sums[0] != 0)) {
        *sums = *other;
        return;
    }
    flinders_sums_move(&moved, sums->origin, sums->scale);
    for (int sum = 0; sum < 35; sum++) sums->sums[sum] += moved.sums[sum];
}

/* Mean of the readings, unit. */
void fl_sums_mean(const flinders_sums *sums, real mean[3])
{
    for (int axis = 0; axis < 3; axis++)
        mean[axis] = sums->origin[axis] + sums->sums[1 + axis] / sums->sums[0] * sums->scale;
}

/* Covariance of the readings about their mean, unit². */
void fl_sums_covariance(const flinders_sums *sums, real covariance[6])
{
    static const unsigned char SECOND[6] = {4, 6, 9, 5, 7, 8}, FIRST[6][2] = {{1, 1}, {2, 2}, {3, 3}, {1, 2}, {1, 3}, {2, 3}};
    const real count = sums->sums[0], square = sums->scale * sums->scale;
    for (int entry = 0; entry < 6; entry++)
        covariance[entry] = square * (sums->sums[SECOND[entry]] -
                                      sums->sums[FIRST[entry][0]] * sums->sums[FIRST[entry][1]] / count) / count;
}

/* Root mean square distance from the mean, unit. */
real fl_sums_spread(const flinders_sums *sums)
{
    real covariance[6];
    fl_sums_covariance(sums, covariance);
    const real trace = covariance[0] + covariance[1] + covariance[2];
    return trace > 0 ? fl_sqrt(trace) : 0;
}
