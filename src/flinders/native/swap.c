/* Whether an axis changed its sign, or two were exchanged, while a recording was made.
 *
 * A driver that is restarted, a cable with a bad wire or a firmware that changes the mounting it assumes does this. The
 * field at the sensor goes on as smoothly as before: readings on both sides of the moment fit together after, and only
 * after, the change is undone. Such a moment is a candidate. It is one where the readings with all candidates undone lie
 * clearly closer to an ellipsoid than they do as recorded: a gap in the recording does not pass, nor does a field that is
 * not the same everywhere.
 */
#include "record.h"

enum {
    MIN_READINGS = 50,       /* fewer readings do not show how smooth they are */
    MAX_COMPARED_READINGS = 20000, /* readings by which noises are compared, to 0.5 %; MIN_NOISE_GAIN is 10 % */
    NO_SWAP = -1
};

#define MIN_BREAK_RATIO ((real)3) /* smallest ratio of a break to the largest among three readings on either side */
#define MAX_MENDED_RATIO ((real)2) /* largest ratio of the break that remains if a swap is undone to the largest among three readings on either side */
#define MAX_REJECTED_SHARE ((real)0.05) /* largest share of outliers with which swapped axes are searched */
#define MAX_UNDONE_DISTANCE_RATIO ((real)3) /* largest ratio of the rms distance of all readings from the surface, if a swap is undone, to the noise of the majority */
#define MIN_NOISE_GAIN ((real)1.1) /* smallest factor by which readings are closer to an ellipsoid; the noise of 500 readings changes by up to 9 % */
#define MAX_STATED_GAIN ((real)1000) /* largest stated factor, also if readings as recorded lie on no ellipsoid */
#define MIN_LOG_GAIN ((real)10) /* smallest gain in log-likelihood, n ln gain, of n independent readings */

/* Where each axis comes from: x, y or z negated or x and y, y and z, z and x exchanged. */
static const unsigned char FROM[6][3] = {{0, 1, 2}, {0, 1, 2}, {0, 1, 2}, {1, 0, 2}, {0, 2, 1}, {2, 1, 0}};

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
    if (!(breaks[i] > MIN_BREAK_RATIO * breaks[i - 2])) return -1; /* as of most */
    for (size_t j = 2; j <= 4; j++) {
        usual = breaks[i - j] > usual ? breaks[i - j] : usual;
        usual = breaks[i + j] > usual ? breaks[i + j] : usual;
    }
    return breaks[i] > MIN_BREAK_RATIO * usual ? usual : -1;
}

/* The change that has most moments. */
static int most_frequent(const int64_t moments[6])
{
    int swap = 0;
    for (int other = 1; other < 6; other++) swap = moments[other] > moments[swap] ? other : swap;
    return swap;
}

/* A reading with its axes changed. */
static void take(const real *reading, int swap, real out[3])
{
    for (int axis = 0; axis < 3; axis++)
        out[axis] = (swap == axis ? -1 : 1) * reading[swap == NO_SWAP ? axis : FROM[swap][axis]];
}

/* Count the moments at which axes changed sign or place: breaks of the path that such a change mends. `first` gets the row
 * behind the first of each; `breaks` (rows,) is lent. */
static void count_moments(const fl_kernels *kernels, const real *field, size_t rows, real *breaks, int64_t moments[6],
                          int64_t first[6])
{
    if (rows < MIN_READINGS) return;
    kernels->breaks(field, rows - 3, breaks);
    for (size_t i = 4; i + 7 < rows; i++) {
        const real usual = usual_beside(breaks, i);
        for (int swap = 0; swap < 6 && usual >= 0; swap++) {
            if (!mends(field, i, swap, MAX_MENDED_RATIO * usual)) continue;
            if (moments[swap]++ == 0) first[swap] = (int64_t)i + 2;
        }
    }
}

/* Moments at which axes changed, for a record. */
void fl_swaps(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, flinders_record *record)
{
    count_moments(kernels, field, rows, room->scratch, record->swaps, record->first_swap);
}

/* Forget moments that outliers made: once the most frequent change is undone, all readings are near the surface of the
 * majority, or there was none. Where many readings are outliers, changed axes may have made them. */
void fl_confirm_swaps(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                      flinders_record *record)
{
    const size_t stride = (view->rows + FL_LOOKED - 1) / FL_LOOKED;
    real squares[2][2] = {{0}}; /* of readings as they are and with axes changed, by how often they had changed */
    const int swap = most_frequent(record->swaps);
    int is_behind = 0;
    size_t n = 0;
    if (record->swaps[swap] == 0 || !((real)record->rejected < MAX_REJECTED_SHARE * (real)record->fitted)) return;
    for (int is_changed = 0; is_changed < 2; is_changed++) {
        for (n = 0; n * stride < view->rows; n++)
            take(view->field + 3 * n * stride, is_changed ? swap : NO_SWAP, room->columns + 3 * n);
        const fl_view some = {room->columns, n, NULL, 1};
        kernels->distances(&some, &fit->surface, room->distances);
        is_behind = 0;
        for (size_t row = 0; row < view->rows; row++) {
            if (row >= 6 && row + 5 < view->rows) { /* the break behind the last but one */
                const real usual = usual_beside(room->scratch, row - 2);
                is_behind ^= usual >= 0 && mends(view->field, row - 2, swap, MAX_MENDED_RATIO * usual);
            }
            if (row % stride == 0) squares[is_changed][is_behind] += room->distances[row / stride] * room->distances[row / stride];
        }
    }
    const real one = squares[0][0] + squares[1][1], other = squares[0][1] + squares[1][0];
    if ((one < other ? one : other) <= MAX_UNDONE_DISTANCE_RATIO * MAX_UNDONE_DISTANCE_RATIO * fit->noise * fit->noise * (real)n) return;
    memset(record->swaps, 0, sizeof record->swaps);
    for (int i = 0; i < 6; i++) record->first_swap[i] = -1;
}

/* The rows behind the moments of one change, from the breaks of the path. */
static void list_moments(const real *field, size_t rows, const real *breaks, int swap, int64_t *out)
{
    for (size_t i = 4; i + 7 < rows; i++) {
        const real usual = usual_beside(breaks, i);
        if (usual >= 0 && mends(field, i, swap, MAX_MENDED_RATIO * usual)) *out++ = (int64_t)i + 2;
    }
}

/* Fit every so manieth reading, with a change undone behind each first, third ... moment; its status. `some` has the
 * readings, and room for a fit of them behind. */
static int fit_undone(const real *field, size_t rows, size_t stride, int swap, const int64_t *moments, size_t count,
                      real *some, unsigned char *workspace, flinders_record *record)
{
    flinders_options options;
    size_t n = 0, passed = 0;
    flinders_default_options(&options);
    options.robust = options.statistics = options.level = 0;
    for (size_t row = 0; row < rows; row += stride, n++) {
        while (passed < count && (size_t)moments[passed] <= row) passed++;
        take(field + 3 * row, passed % 2 ? swap : NO_SWAP, some + 3 * n);
    }
    return flinders_fit(some, NULL, n, &options, workspace, flinders_workspace_size(n), record);
}

/* Bytes of the readings that noises are compared by, and how many of the rows these are. */
static size_t bytes_of_some(size_t rows, size_t *stride, size_t *n)
{
    *stride = (rows + MAX_COMPARED_READINGS - 1) / MAX_COMPARED_READINGS > 1 ? (rows + MAX_COMPARED_READINGS - 1) / MAX_COMPARED_READINGS : 1;
    *n = (rows + *stride - 1) / *stride;
    return (3 * *n * sizeof(real) + 63) / 64 * 64;
}

/* Bytes of workspace that a search needs: some readings, and behind them the breaks of the path, and later a fit. */
size_t flinders_swap_workspace_size(size_t rows)
{
    size_t stride, n;
    const size_t some = bytes_of_some(rows, &stride, &n), fit = flinders_workspace_size(n);
    return some + (fit > rows * sizeof(real) ? fit : rows * sizeof(real));
}

/* Look for the moments at which axes changed. */
int flinders_axis_swap(const real *field, size_t rows, real noise, real noise_limit, void *workspace, size_t size,
                       int64_t *moments, flinders_axis_change *found)
{
    size_t stride, n;
    const size_t some = bytes_of_some(rows, &stride, &n);
    const fl_kernels *const kernels = fl_kernels_chosen(0);
    unsigned char *const behind = (unsigned char *)workspace + some;
    real *const breaks = (real *)(void *)behind;
    int64_t counts[6] = {0}, first[6];
    flinders_record undone, recorded;
    found->swap = NO_SWAP, found->moments = 0, found->gain = FL_NOT_A_NUMBER;
    if (!workspace || size < flinders_swap_workspace_size(rows)) return FLINDERS_NO_WORKSPACE;
    count_moments(kernels, field, rows, breaks, counts, first);
    const int swap = most_frequent(counts);
    const size_t count = (size_t)counts[swap];
    if (count == 0) return FLINDERS_OK;
    list_moments(field, rows, breaks, swap, moments);
    if (fit_undone(field, rows, stride, swap, moments, count, workspace, behind, &undone)) return FLINDERS_OK;
    if (!(undone.noise <= MIN_NOISE_GAIN * noise && undone.noise <= noise_limit * undone.radius)) return FLINDERS_OK;
    const int status = fit_undone(field, rows, stride, swap, moments, 0, workspace, behind, &recorded);
    const real least = undone.noise > FL_TINY ? undone.noise : FL_TINY;
    const real gain = status == FLINDERS_OK && recorded.noise < MAX_STATED_GAIN * least ? recorded.noise / least : MAX_STATED_GAIN;
    const real alike = isnan(undone.correlation_time) ? 1 : undone.correlation_time * undone.excess_variance;
    if (!(gain > MIN_NOISE_GAIN) || (real)n / alike * fl_log(gain) < MIN_LOG_GAIN) return FLINDERS_OK;
    found->swap = swap, found->moments = (int64_t)count, found->gain = gain;
    return FLINDERS_OK;
}
