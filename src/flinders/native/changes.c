/* How residuals are distributed, and how far the path jumps. */
#include "record.h"

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
    fl_swaps(kernels, all->field, all->rows, room, record);
    if (record->is_robust && !record->plane) fl_confirm_swaps(kernels, all, fit, room, record);
    jump(kernels, all->field, all->rows, room, record);
}
