/* Information of the readings on the parameters, its spurious part from noise, and the covariance. */
#include "internal.h"

/* Numbers of readings from which spurious information is averaged. */
#ifdef FLINDERS_SMALL
enum { FEW_READINGS = 75, MANY_READINGS = 75 };
#else
enum { FEW_READINGS = 200, MANY_READINGS = 2000 };
#endif

#define MIN_SOUND_EIGENVALUE ((real)0.1) /* smallest scaled eigenvalue at which all directions count as observable without a test */
#define MIN_SPURIOUS_SHARE ((real)0.005) /* share of spurious information above which it is computed from more readings */

/* Coefficients of vᵀδb + vᵀ δS u. */
static void gathered(const real v[3], const real u[3], real row[9])
{
    for (int i = 0; i < 3; i++) {
        row[i] = v[i];
        row[3 + i] = v[i] * u[i];
    }
    row[6] = v[0] * u[1] + v[1] * u[0];
    row[7] = v[0] * u[2] + v[2] * u[0];
    row[8] = v[1] * u[2] + v[2] * u[1];
}

/* Normal of the surface at a direction, and |S⁻¹u|. */
static real normal_at(const fl_surface *surface, const real direction[3], real normal[3])
{
    fl_sym3_apply(surface->inverse, direction, normal);
    real steepness = fl_sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    steepness = steepness > FL_SHORT ? steepness : FL_SHORT;
    for (int i = 0; i < 3; i++) normal[i] /= steepness;
    return steepness;
}

/* How far each parameter moves the surface at a direction. */
void fl_jacobian(const fl_surface *surface, const real direction[3], real row[9])
{
    real normal[3];
    normal_at(surface, direction, normal);
    gathered(normal, direction, row);
}

/* Derivatives of the Jacobian along two tangents of the surface at a direction. */
void fl_turning(const fl_surface *surface, const real direction[3], real rows[2][9])
{
    real normal[3], tangent[2][3], along[3], turned[3], bent[3], other[9];
    const real steepness = normal_at(surface, direction, normal);
    int least = 0;
    for (int i = 1; i < 3; i++)
        if (fl_abs(normal[i]) < fl_abs(normal[least])) least = i;
    const real axis[3] = {least == 0, least == 1, least == 2};
    real length = 0;
    for (int i = 0; i < 3; i++) {
        tangent[0][i] = normal[(i + 1) % 3] * axis[(i + 2) % 3] - normal[(i + 2) % 3] * axis[(i + 1) % 3];
        length += tangent[0][i] * tangent[0][i];
    }
    length = length > 0 ? fl_sqrt(length) : 1;
    for (int i = 0; i < 3; i++) tangent[0][i] /= length;
    for (int i = 0; i < 3; i++)
        tangent[1][i] = normal[(i + 1) % 3] * tangent[0][(i + 2) % 3] - normal[(i + 2) % 3] * tangent[0][(i + 1) % 3];
    for (int t = 0; t < 2; t++) {
        fl_sym3_apply(surface->inverse, tangent[t], along);
        fl_sym3_apply(surface->inverse, along, turned);
        const real across = normal[0] * turned[0] + normal[1] * turned[1] + normal[2] * turned[2];
        for (int i = 0; i < 3; i++) bent[i] = (turned[i] - normal[i] * across) / steepness;
        gathered(bent, direction, rows[t]);
        gathered(normal, along, other);
        for (int i = 3; i < 9; i++) rows[t][i] += other[i];
    }
}

/* What share of the information about each direction noise alone adds; returns the largest. */
static real shares_of(const real *matrix, int n, real nothing, const real *noise, fl_support *support)
{
    const real floor = FL_ROUNDING * support->values[n - 1] > FL_TINY ? FL_ROUNDING * support->values[n - 1] : FL_TINY;
    real most = 0;
    for (int k = 0; k < n; k++) {
        real sum = 0, share = 1;
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                const int mute = !(matrix[i * n + i] > nothing) || !(matrix[j * n + j] > nothing);
                if (!mute)
                    sum += support->vectors[i * n + k] * support->vectors[j * n + k] * noise[i * n + j] /
                           (support->scale[i] * support->scale[j]);
            }
        if (support->values[k] > floor && isfinite(sum)) {
            share = sum / support->values[k];
            share = share < 0 ? 0 : share > 1 ? 1 : share;
        }
        support->share[k] = share;
        most = share > most ? share : most;
    }
    return most;
}

/* Directions of parameter space for the matrix scaled to a diagonal of ones. A few readings suffice if there is
 * hardly any spurious information. */
void fl_support_of(const real *matrix, int n, fl_spurious spurious, void *context, fl_support *support)
{
    real largest = 0, noise[FL_WIDEST * FL_WIDEST];
    for (int i = 0; i < n; i++) largest = matrix[i * n + i] > largest ? matrix[i * n + i] : largest;
    const real nothing = FL_ROUNDING * largest > FL_TINY ? FL_ROUNDING * largest : FL_TINY;
    support->n = n;
    for (int i = 0; i < n; i++)
        support->scale[i] = fl_sqrt(matrix[i * n + i] > nothing ? matrix[i * n + i] : nothing);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const int mute = !(matrix[i * n + i] > nothing) || !(matrix[j * n + j] > nothing);
            support->vectors[i * n + j] = mute ? 0 : matrix[i * n + j] / (support->scale[i] * support->scale[j]);
        }
    memcpy(noise, support->vectors, sizeof noise);
    for (int i = 0; i < n; i++) noise[i * n + i] -= MIN_SOUND_EIGENVALUE;
    support->is_whole = !fl_cholesky(noise, n);
    if (support->is_whole) return;
    fl_eigen(support->vectors, n, support->values);
    spurious(context, FEW_READINGS, noise);
    if (!(shares_of(matrix, n, nothing, noise, support) > MIN_SPURIOUS_SHARE) || FEW_READINGS == MANY_READINGS) return;
    spurious(context, MANY_READINGS, noise);
    shares_of(matrix, n, nothing, noise, support);
}

/* Number of directions that the readings do not determine. */
int fl_support_unseen(const fl_support *support)
{
    int unseen = 0;
    if (support->is_whole) return 0;
    for (int k = 0; k < support->n; k++) unseen += !(support->share[k] < FL_UNOBSERVED);
    return unseen;
}

/* Take the directions that are not observed out of a matrix and its gradient. */
void fl_support_keep(const fl_support *support, real *matrix, real *gradient)
{
    const int n = support->n;
    real along[FL_WIDEST];
    if (!fl_support_unseen(support)) return;
    for (int k = 0; k < n; k++) {
        along[k] = 0;
        for (int i = 0; i < n; i++) along[k] += support->vectors[i * n + k] * gradient[i] / support->scale[i];
    }
    for (int i = 0; i < n; i++) {
        gradient[i] = 0;
        for (int k = 0; k < n; k++)
            if (support->share[k] < FL_UNOBSERVED) gradient[i] += support->scale[i] * support->vectors[i * n + k] * along[k];
        for (int j = 0; j < n; j++) {
            real sum = 0;
            for (int k = 0; k < n; k++)
                if (support->share[k] < FL_UNOBSERVED)
                    sum += support->vectors[i * n + k] * support->values[k] * support->vectors[j * n + k];
            matrix[i * n + j] = sum * support->scale[i] * support->scale[j];
        }
    }
}

/* What remains of the information after the share of the noise; its inverse is a covariance. */
void fl_support_information(const fl_support *support, const real *matrix, real *information)
{
    const int n = support->n;
    if (support->is_whole) {
        memcpy(information, matrix, (size_t)(n * n) * sizeof(real));
        return;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            real sum = 0;
            for (int k = 0; k < n; k++) {
                const real rest = 1 - support->share[k];
                if (support->share[k] < FL_UNOBSERVED)
                    sum += support->vectors[i * n + k] * support->values[k] * rest * rest * support->vectors[j * n + k];
            }
            information[i * n + j] = sum * support->scale[i] * support->scale[j];
        }
}

/* Inverse of a symmetric matrix without the directions that rounding leaves open; both may be the same. */
void fl_inverse(const real *matrix, int n, real *inverse)
{
    real scale[FL_WIDEST], vectors[FL_WIDEST * FL_WIDEST] = {0}, values[FL_WIDEST];
    real largest = 0;
    for (int i = 0; i < n; i++) largest = matrix[i * n + i] > largest ? matrix[i * n + i] : largest;
    const real least = FL_ROUNDING * largest > FL_TINY ? FL_ROUNDING * largest : FL_TINY;
    for (int i = 0; i < n; i++) scale[i] = fl_sqrt(matrix[i * n + i] > least ? matrix[i * n + i] : least);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) vectors[i * n + j] = matrix[i * n + j] / (scale[i] * scale[j]);
    if (!fl_cholesky_regular(vectors, n, inverse)) {
        fl_cholesky_inverse(inverse, n, vectors);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) inverse[i * n + j] = vectors[i * n + j] / (scale[i] * scale[j]);
        return;
    }
    fl_eigen(vectors, n, values);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            real sum = 0;
            for (int k = 0; k < n; k++)
                if (values[k] > FL_ROUNDING * values[n - 1])
                    sum += vectors[i * n + k] * vectors[j * n + k] / values[k];
            inverse[i * n + j] = sum / (scale[i] * scale[j]);
        }
}
