/* What changes while a recording is made: jumps, axes that change sign or place; and how residuals are distributed. */
#include "record.h"

enum { FEWEST = 50 };

#define BROKEN ((real)3) /* times the largest break among three readings on either side that a break has to be */
#define LIKE ((real)2)   /* times the same that readings may be apart once it is undone */
#define FEW ((real)0.05) /* share of outliers beside which changed axes would make more, or bend no surface */
#define OFF ((real)3)    /* times the noise of a majority that all readings may be off its surface once it is undone */

/* Where each axis comes from: x, y or z negated or x and y, y and z, z and x exchanged. */
static const unsigned char FROM[6][3] = {{0, 1, 2}, {0, 1, 2}, {0, 1, 2}, {1, 0, 2}, {0, 2, 1}, {2, 1, 0}};

/* Size and tails of the residuals. */
static void distribution(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                         flinders_record *record)
{
    const size_t n = fit->used, stride = (n + FL_SOME - 1) / FL_SOME;
    size_t looked = 0;
    real squares[FL_LANES] = {0}, fourths[FL_LANES] = {0}, most[FL_LANES] = {0}, square = 0, fourth = 0, farthest = 0;
    if (!fit->has_distances) kernels->distances(view, &fit->surface, room->distances);
    for (size_t i = 0; i < n; i += FL_LANES) {
        real eight[FL_LANES] = {0};
        memcpy(eight, room->distances + i, (n - i < FL_LANES ? n - i : FL_LANES) * sizeof(real));
        for (int lane = 0; lane < FL_LANES; lane++) {
            const real distance = fl_abs(eight[lane]), s = distance * distance;
            most[lane] = distance > most[lane] ? distance : most[lane];
            squares[lane] += s, fourths[lane] += s * s;
        }
    }
    for (int lane = 0; lane < FL_LANES; lane++) {
        farthest = most[lane] > farthest ? most[lane] : farthest;
        square += squares[lane], fourth += fourths[lane];
    }
    const int has_median = fit->has_distances && fit->median_distance > 0;
    for (size_t i = 0; i < n && !has_median; i += stride) room->scratch[looked++] = fl_abs(room->distances[i]);
    record->median_distance = has_median ? fit->median_distance : fl_median(room->scratch, looked);
    record->farthest = farthest;
    record->kurtosis = square > 0 ? fourth * (real)n / (square * square) : FL_NOT_A_NUMBER;
}

/* Whether a change of axes mends the break behind i. */
static int mends(const real *field, size_t i, int swap, real limit)
{
    const real *at = field + 3 * i;
    for (int axis = 0; axis < 3; axis++) {
        const int from = FROM[swap][axis];
        const real sign = swap == axis ? -1 : 1;
        const real onward = sign * ((real)1.5 * at[6 + from] - (real)0.5 * at[9 + from]);
        if (!(fl_abs(onward - ((real)1.5 * at[3 + axis] - (real)0.5 * at[axis])) <= limit)) return 0;
    }
    return 1;
}

/* How large breaks next to i are, where that behind i is far larger; else 0. */
static real usual_beside(const real *breaks, size_t i)
{
    real usual = 0;
    if (!(breaks[i] > BROKEN * breaks[i - 2])) return -1; /* as of most */
    for (size_t j = 2; j <= 4; j++) {
        usual = breaks[i - j] > usual ? breaks[i - j] : usual;
        usual = breaks[i + j] > usual ? breaks[i + j] : usual;
    }
    return breaks[i] > BROKEN * usual ? usual : -1;
}

/* Moments at which axes changed sign or place: breaks of the path that such a change mends. */
static void swaps(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, flinders_record *record)
{
    if (rows < FEWEST) return;
    real *breaks = room->scratch;
    kernels->breaks(field, rows - 3, breaks);
    for (size_t i = 4; i + 7 < rows; i++) {
        const real usual = usual_beside(breaks, i);
        for (int swap = 0; swap < 6 && usual >= 0; swap++) {
            if (!mends(field, i, swap, LIKE * usual)) continue;
            if (record->swaps[swap]++ == 0) record->first_swap[swap] = (int64_t)i + 2;
        }
    }
}

/* Forget moments that outliers made: once the most frequent change is undone, all readings are near the surface of the
 * majority, or there was none. Where many readings are outliers, changed axes may have made them. */
static void confirm_swaps(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                          flinders_record *record)
{
    const size_t stride = (view->rows + FL_LOOKED - 1) / FL_LOOKED;
    real squares[2][2] = {{0}}; /* of readings as they are and with axes changed, by how often they had changed */
    int swap = 0, is_behind = 0;
    size_t n = 0;
    for (int other = 1; other < 6; other++) swap = record->swaps[other] > record->swaps[swap] ? other : swap;
    if (record->swaps[swap] == 0 || !((real)record->rejected < FEW * (real)record->fitted)) return;
    for (int is_changed = 0; is_changed < 2; is_changed++) {
        for (n = 0; n * stride < view->rows; n++)
            for (int axis = 0; axis < 3; axis++) {
                const int from = is_changed ? FROM[swap][axis] : axis;
                const real sign = is_changed && swap == axis ? -1 : 1;
                room->columns[3 * n + axis] = sign * view->field[3 * n * stride + from];
            }
        const fl_view some = {room->columns, n, NULL, 1};
        kernels->distances(&some, &fit->surface, room->distances);
        is_behind = 0;
        for (size_t row = 0; row < view->rows; row++) {
            if (row >= 6 && row + 5 < view->rows) { /* the break behind the last but one */
                const real usual = usual_beside(room->scratch, row - 2);
                is_behind ^= usual >= 0 && mends(view->field, row - 2, swap, LIKE * usual);
            }
            if (row % stride == 0) squares[is_changed][is_behind] += room->distances[row / stride] * room->distances[row / stride];
        }
    }
    const real one = squares[0][0] + squares[1][1], other = squares[0][1] + squares[1][0];
    if ((one < other ? one : other) <= OFF * OFF * fit->noise * fit->noise * (real)n) return;
    memset(record->swaps, 0, sizeof record->swaps);
    for (int i = 0; i < 6; i++) record->first_swap[i] = -1;
}

/* Steps from one reading to the next: the largest over the median that is one, and how alike neighbours are. */
static void jump(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, flinders_record *record)
{
    const size_t stride = (rows + FL_SOME - 1) / FL_SOME;
    size_t n = 0, looked = 0;
    real sum = 0;
    const real largest = kernels->steps(field, rows - 1, room->distances + 1);
    for (size_t i = stride; i < rows; i += stride, looked++) {
        if (room->distances[i] > 0) room->scratch[n++] = room->distances[i];
        sum += room->distances[i];
    }
    if (n == 0) return;
    record->path_correlation = 1 - sum / ((real)looked * 2 * record->spread * record->spread);
    const real median = fl_median(room->scratch, n);
    record->largest_jump = fl_sqrt(largest) / fl_sqrt(median);
}

/* Statistics of the residuals of a view, and of the path through all readings. */
void fl_residual_statistics(const fl_kernels *kernels, const fl_view *all, const fl_view *view, const fl_fit *fit,
                            const fl_room *room, flinders_record *record)
{
    distribution(kernels, view, fit, room, record);
    swaps(kernels, all->field, all->rows, room, record);
    if (record->is_robust) confirm_swaps(kernels, all, fit, room, record);
    jump(kernels, all->field, all->rows, room, record);
    fl_coverage(kernels, &fit->surface, record->rejected_beyond, room, record);
}
