/* Whether terms of the axes are the same throughout a recording, as those of a sensor are.
 *
 * A field that varies from place to place makes terms, too, but others in each half, along few independent residuals. So
 * both halves have to tell of the same terms, and these to predict parts of the recording that were held back.
 */
#include "residuals.h"

enum { ELLIPSOID_COLUMNS = 9, PARTS = 8, MIN_CLOSER_PARTS = 6, PRODUCTS = (FL_WIDEST + 1) * (FL_WIDEST + 1) };

#define MIN_SQUARE_RATIO ((real)1 / 3) /* smallest ratio of the square of the terms to that of the difference of two halves: if by chance, */
#define MIN_PROVEN_SQUARE_RATIO ((real)1) /* and if the difference is significant */
#define MAX_P_VALUE ((real)0.01)
#define MIN_INDEPENDENT ((real)25) /* smallest number of independent residuals */
#define MAX_NOISE_SHARE ((real)0.05) /* largest noise, of the field, of a recording that is not limited for it */

/* The square that is left of readings that were held back, by so many columns from the first on, from the products of
 * these and of all; infinite where the others do not tell the terms. */
static real held_back(const real *all, const real *these, int columns, int first, int width)
{
    real others[PRODUCTS], matrix[FL_WIDEST * FL_WIDEST], solution[FL_WIDEST], square = these[columns * columns - 1];
    for (int i = 0; i < columns * columns; i++) others[i] = all[i] - these[i];
    fl_normal_equations(others, columns, first, width, matrix, solution);
    if (fl_cholesky(matrix, width)) return FL_HUGE;
    fl_cholesky_solve(matrix, width, solution);
    for (int a = 0; a < width; a++) {
        const real *const row = these + columns * (first + a);
        real along = -2 * row[columns - 1];
        for (int b = 0; b < width; b++) along += solution[b] * row[first + b];
        square += solution[a] * along;
    }
    return square;
}

/* Whether most parts of a recording, and all together, lie closer to what the others tell with the terms than by the nine
 * columns of an ellipsoid alone. */
static int predict(const fl_kernels *kernels, const fl_residuals *all, int nine)
{
    const int columns = all->width + 1;
    real parts[PARTS][PRODUCTS], sum[PRODUCTS] = {0}, gain = 0;
    int closer = 0;
    for (size_t part = 0; part < PARTS; part++) {
        const size_t begin = all->n * part / PARTS, end = all->n * (part + 1) / PARTS;
        fl_gram(kernels, all, begin, end - begin, parts[part]);
        for (int i = 0; i < columns * columns; i++) sum[i] += parts[part][i];
    }
    for (int part = 0; part < PARTS; part++) {
        const real without = held_back(sum, parts[part], columns, nine, ELLIPSOID_COLUMNS);
        const real taken = without - held_back(sum, parts[part], columns, 0, all->width);
        gain += taken;
        closer += taken > 0;
    }
    return gain > 0 && closer >= MIN_CLOSER_PARTS;
}

/* The terms from a place on that a part of the readings tells by itself, and their covariance; 0 where it tells none. */
static int told_by(const fl_kernels *kernels, const fl_residuals *all, size_t begin, size_t n, int place,
                   const fl_room *room, const flinders_record *record, real *terms, real *covariance)
{
    const int width = all->width, count = width - ELLIPSOID_COLUMNS;
    size_t ends[2] = {0, n};
    real products[PRODUCTS], of_all[FL_WIDEST * FL_WIDEST];
    fl_residuals part = *all;
    fl_regression found;
    part.n = n, part.begins = ends, part.distances += begin;
    for (int k = 0; k < width; k++) part.columns[k] += begin;
    fl_gram(kernels, &part, 0, n, products);
    if (!fl_regress(&part, products, 0, width, &found)) return 0;
    fl_covariance_of_terms(kernels, &found, room, record, of_all);
    memcpy(terms, found.solution + place, (size_t)count * sizeof(real));
    for (int a = 0; a < count; a++)
        memcpy(covariance + count * a, of_all + width * (place + a) + place, (size_t)count * sizeof(real));
    return 1;
}

/* Whether both halves of a recording tell of the same terms: they are apart by chance, or by less than the terms. */
static int are_alike(const fl_kernels *kernels, const fl_regression *found, int place, const fl_room *room,
                     const flinders_record *record)
{
    const fl_residuals *const all = &found->left;
    const int count = all->width - ELLIPSOID_COLUMNS;
    const size_t half = all->n / 2;
    real one[FL_WIDEST], other[FL_WIDEST], both[FL_WIDEST * FL_WIDEST], of_other[FL_WIDEST * FL_WIDEST], apart, size;
    if (!told_by(kernels, all, 0, half, place, room, record, one, both)) return 0;
    if (!told_by(kernels, all, half, all->n - half, place, room, record, other, of_other)) return 0;
    for (int i = 0; i < count * count; i++) both[i] += of_other[i];
    for (int i = 0; i < count; i++) one[i] -= other[i];
    const int freedom = fl_chi_square(one, both, count, &apart);
    fl_chi_square(found->solution + place, both, count, &size);
    const real by_chance = fl_chance_of(apart, (real)freedom, (real)(all->n - 2 * (size_t)all->width));
    return size > (by_chance > MAX_P_VALUE ? MIN_SQUARE_RATIO : MIN_PROVEN_SQUARE_RATIO) * apart;
}

/* Count what makes an error of a level heading at the worst one as a distortion that errs as much. */
void fl_distort(const fl_surface *surface, real error_deg, real dip_deg, flinders_record *record)
{
    const real to_rad = FL_PI / 180, distortion = error_deg * to_rad * surface->radius * fl_cos(dip_deg * to_rad);
    record->distortion = distortion > record->distortion ? distortion : record->distortion;
}

/* Whether the terms of a regression beside the nine columns of an ellipsoid, from the one of this number on, are those of
 * axes, and not of a field that was not the same everywhere. */
int fl_is_same_throughout(const fl_kernels *kernels, const fl_regression *found, int nine, const fl_room *room,
                          const flinders_record *record)
{
    if (!(record->noise <= MAX_NOISE_SHARE * record->radius)) return 0;
    if (!((real)record->used >= MIN_INDEPENDENT * record->correlation_time)) return 0;
    return predict(kernels, &found->left, nine) && are_alike(kernels, found, nine ? 0 : ELLIPSOID_COLUMNS, room, record);
}
