/* Runs of readings that do not belong to the rest.
 *
 * What passes by fades in and out, and its field crosses zero along the surface's normal: readings between outliers and
 * shortly before and after them are no better. Single outliers, of a bus that drops bits, say nothing of their neighbours.
 * So a run is where more of eleven readings are far than chance would put there.
 */
#include "record.h"

enum {
    WINDOW = FLINDERS_WINDOW,
    MARGIN = FLINDERS_MARGIN,
    MIN_RUN_READINGS = 3,   /* smallest number of far readings in a window that make a run */
    ROUNDS = 3,   /* rounds in which readings in runs and others are distinguished */
    MAX_RUN_GAP = 5 /* largest distance in rows of outliers in one run: 0.1 s at 50 Hz */
};

#define MAX_RANDOM_RUNS ((real)1e-3) /* largest mean number of runs in a recording that random outliers make */

/* How many readings of the window about one are far. */
static int far_about(const unsigned char *far, size_t rows, size_t i)
{
    const size_t begin = i > WINDOW / 2 ? i - WINDOW / 2 : 0, end = i + WINDOW / 2 + 1 < rows ? i + WINDOW / 2 + 1 : rows;
    int inside = 0;
    for (size_t row = begin; row < end; row++) inside += far[row];
    return inside;
}

/* Mark readings in a run of far ones and within a margin of it, and count them; far readings on their own are not
 * marked. */
fl_marked fl_mark_runs(const unsigned char *far, size_t rows, int dense, unsigned char *out)
{
    fl_marked count = {0, 0};
    size_t done = 0;
    const unsigned char *next = far;
    memset(out, 0, rows);
    if (dense > WINDOW) return count;
    for (; next < far + rows && (next = memchr(next, 1, (size_t)(far + rows - next))); next++) {
        const size_t i = (size_t)(next - far);
        if (far_about(far, rows, i) < dense) continue;
        const size_t begin = i > MARGIN ? i - MARGIN : 0, end = i + MARGIN + 1 < rows ? i + MARGIN + 1 : rows;
        for (size_t row = begin > done ? begin : done; row < end; row++) out[row] = 1, count.all++, count.far += far[row];
        done = end;
    }
    return count;
}

/* Smallest number of far readings in a window that chance hardly ever gives, for a share of far readings. */
static int dense_enough(real share, size_t rows)
{
    real chances[WINDOW + 1], choose = 1, tail = 0;
    int least = FLINDERS_NO_RUN;
    for (int far = 0; far <= WINDOW; far++) {
        chances[far] = choose;
        for (int i = 0; i < far; i++) chances[far] *= share;
        for (int i = far; i < WINDOW; i++) chances[far] *= 1 - share;
        choose = choose * (real)(WINDOW - far) / (real)(far + 1);
    }
    for (int far = WINDOW; far >= MIN_RUN_READINGS; far--) {
        tail += chances[far];
        if ((real)rows * tail < MAX_RANDOM_RUNS) least = far;
    }
    return least;
}

/* The smallest number for readings some of which are far; certain runs are removed before the rest is counted. */
int flinders_dense(const unsigned char *far, size_t n, size_t rows, unsigned char *scratch)
{
    size_t all_far = 0;
    int dense = FLINDERS_NO_RUN;
    for (size_t i = 0; i < n; i++) all_far += far[i];
    for (int look = 0; look < ROUNDS; look++) {
        const fl_marked runs = fl_mark_runs(far, n, dense, scratch);
        dense = n > runs.all ? dense_enough((real)(all_far - runs.far) / (real)(n - runs.all), rows) : FLINDERS_NO_RUN;
    }
    return dense;
}

/* Mark the readings that a fit leaves out. */
void flinders_left_out(const unsigned char *far, size_t rows, int32_t dense, unsigned char *out)
{
    fl_mark_runs(far, rows, dense, out);
    for (size_t row = 0; row < rows; row++) out[row] |= far[row];
}

/* List the runs of readings that a fit leaves out. */
size_t flinders_list_outliers(const real *distances, const unsigned char *out, size_t rows, const int64_t *first,
                              const int64_t *last, const real *start, const real *end, flinders_outlier *runs,
                              size_t count)
{
    int64_t before = count > 0 && rows > 0 ? runs[count - 1].last - first[0] : 0; /* the last one that was left out */
    for (size_t i = 0; i < rows; i++) {
        const real distance = fl_abs(distances[i]);
        if (!out[i]) continue;
        if (count == 0 || ((int64_t)i - before > MAX_RUN_GAP && count < FLINDERS_OUTLIERS)) {
            const flinders_outlier none = {first[i], 0, 0, 0, start ? start[i] : FL_NOT_A_NUMBER, FL_NOT_A_NUMBER, 0};
            runs[count++] = none;
        }
        flinders_outlier *const run = runs + count - 1;
        run->last = last[i], run->rows += last[i] - first[i] + 1, run->fitted++;
        run->end = end ? end[i] : FL_NOT_A_NUMBER;
        run->farthest = distance > run->farthest ? distance : run->farthest;
        before = (int64_t)i;
    }
    return count;
}
