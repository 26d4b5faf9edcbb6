/* Rests: intervals of constant direction. The readings of a rest have the information of one reading about the surface, as
 * the error by a non-uniform field is common to them. Therefore each rest is replaced by its mean; it is left out if there
 * are many more readings of a turn, as a rest would then only add directions that the turn did not cover.
 *
 * Windows of readings are as short as possible: in windows outside rests, the sensor turns on average by thirty times as
 * much as is allowed in a rest. A window is at rest if the variance of its readings is hardly above that by noise, which is
 * estimated from successive steps.
 */
#include "record.h"

#ifdef FLINDERS_SMALL
enum { HALF_WINDOW = 4 }; /* readings of half a window */
#else
enum { HALF_WINDOW = 2 };
#endif
enum { MIN_FITTED = 12,    /* smallest number of readings of a fit, including rests */
       TURN_PER_REST = 20, /* ratio of readings of a turn to rests from which rests are left out */
       MAX_SAMPLES = 256 };    /* number of readings for an estimate of their distances */

#define FAR_SHARE ((real)0.95)      /* fraction of readings that are not outliers */
#define REST_MOVEMENT ((real)0.005) /* largest motion in a rest, over the distance of far readings from the mean */
#define WINDOW_MOVEMENT ((real)30)  /* ratio of the mean motion of windows outside rests to that */
#define WINDOW_CAP ((real)2)        /* largest contribution of a window to the mean, over that mean */
#define MOVING_SHARE ((real)0.05)   /* smallest fraction of windows outside rests */
#define MIN_SPIKE_RATIO ((real)3) /* smallest ratio of the distance of an outlier from the mean of its neighbours to their distance */
#define REST_SCATTER ((real)0.1)    /* largest noise of a rest, over the distance of far readings */
#define SAGITTA ((real)0.1)         /* distance of a rest's mean from the surface by motion, over the noise of a reading */
#define MOVEMENT_SIGMAS ((real)2)   /* apparent motion of a rest by noise, in standard deviations */
#define MEMBER_SIGMAS ((real)2.5)   /* largest distance of adjacent readings that belong to a rest, in standard deviations */

/* Sums over half a window of readings minus an origin, and of squared successive steps: within it, and from the previous
 * reading. */
typedef struct {
    real sum[3], square, steps, link;
} half;

static real square_of(const real v[3]) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

static real square_apart(const real a[3], const real b[3])
{
    const real apart[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return square_of(apart);
}

/* Distance from the mean that few readings exceed, from a sample; 0 if they are not finite. Sets the mean. */
static real far_distance(const real *field, size_t rows, real *scratch, real mean[3])
{
    const size_t stride = (rows + MAX_SAMPLES - 1) / MAX_SAMPLES;
    size_t n = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (size_t row = 0; row < rows; row += stride, n++)
        for (int axis = 0; axis < 3; axis++) mean[axis] += field[3 * row + axis];
    for (int axis = 0; axis < 3; axis++) mean[axis] /= (real)n;
    if (!isfinite(square_of(mean))) return 0;
    for (size_t i = 0; i < n; i++) scratch[i] = square_apart(field + 3 * i * stride, mean);
    return fl_sqrt(fl_select(scratch, n, (size_t)(FAR_SHARE * (real)(n - 1))));
}

/* Sums over half a window that begins at a reading. */
static half half_of(const fl_rests *rests, size_t begin)
{
    half sums = {{0}, 0, 0, 0};
    for (size_t row = begin; row < begin + rests->half; row++) {
        const real *const here = rests->field + 3 * row;
        const real local[3] = {here[0] - rests->origin[0], here[1] - rests->origin[1], here[2] - rests->origin[2]};
        for (int axis = 0; axis < 3; axis++) sums.sum[axis] += local[axis];
        sums.square += square_of(local);
        if (row > begin) sums.steps += square_apart(here, here - 3);
    }
    if (begin) sums.link = square_apart(rests->field + 3 * begin, rests->field + 3 * begin - 3);
    return sums;
}

/* Sums over two successive halves. */
static half both_of(const half *first, const half *second)
{
    half both = *first;
    for (int axis = 0; axis < 3; axis++) both.sum[axis] += second->sum[axis];
    both.square += second->square;
    both.steps += second->link + second->steps;
    return both;
}

/* Whether a recording ends within some rows. */
static int is_cut(const fl_rests *rests, size_t begin, size_t end)
{
    size_t low = 0, high = rests->parts;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if ((size_t)rests->ends[middle] <= begin) low = middle + 1;
        else high = middle;
    }
    return low < rests->parts && (size_t)rests->ends[low] < end;
}

/* Variance of the n readings of a window, and variance of noise from their steps. */
static void variances(const half *window, size_t n, real *variance, real *noise)
{
    const real rest = window->square - square_of(window->sum) / (real)n;
    *variance = rest > 0 ? rest / (real)(n - 1) : 0;
    *noise = window->steps / (real)(2 * (n - 1));
}

/* Whether a reading is a single outlier that dominates the variance of a window. */
static int has_spike(const fl_rests *rests, size_t begin, size_t end, real variance)
{
    for (size_t row = begin ? begin : 1; row < end && row + 1 < rests->rows; row++) {
        const real *const here = rests->field + 3 * row;
        const real middle[3] = {(here[-3] + here[3]) / 2, (here[-2] + here[4]) / 2, (here[-1] + here[5]) / 2};
        const real off = square_apart(here, middle);
        if (off > variance && off > MIN_SPIKE_RATIO * MIN_SPIKE_RATIO * square_apart(here - 3, here + 3)) return 1;
    }
    return 0;
}

/* Whether a window is at rest, and the variance of its readings. */
static int is_still(const fl_rests *rests, const half *halves, size_t window, real *variance)
{
    const size_t n = 2 * rests->half, begin = window * rests->half;
    const half both = both_of(halves + window, halves + window + 1);
    const real most = rests->still * rests->still;
    real noise;
    variances(&both, n, variance, &noise);
    if (!(*variance < rests->noisy * rests->noisy)) return 0;
    const real bent = SAGITTA * rests->far * fl_sqrt(noise / 3), moved = bent < most ? bent : most;
    const real chance = rests->chance * *variance;
    const real loose = moved + (chance < MOVEMENT_SIGMAS * MOVEMENT_SIGMAS * moved ? chance : MOVEMENT_SIGMAS * MOVEMENT_SIGMAS * moved);
    return *variance - noise <= loose && !is_cut(rests, begin, begin + n);
}

/* Whether any window is at rest. */
static int has_still(const fl_rests *rests, const half *halves)
{
    real variance;
    for (size_t window = 0; window < rests->windows; window++)
        if (is_still(rests, halves, window, &variance)) return 1;
    return 0;
}

/* Mark windows at rest, which overlap by half; returns whether windows are long enough: the mean variance of the others is
 * then much larger. */
static int mark_still(fl_rests *rests, const half *halves)
{
    const size_t n = 2 * rests->half;
    const real moved = WINDOW_MOVEMENT * rests->still, typical = moved * moved, most = WINDOW_CAP * WINDOW_CAP * typical;
    real sum = 0, moving = 0, variance;
    for (size_t window = 0; window < rests->windows; window++) {
        const size_t begin = window * rests->half;
        rests->is_still[window] = (unsigned char)is_still(rests, halves, window, &variance);
        if (rests->is_still[window]) continue;
        if (variance > typical && has_spike(rests, begin, begin + n, variance)) continue;
        sum += variance < most ? variance : most;
        moving++;
    }
    return moving > MOVING_SHARE * (real)rests->windows && sum >= typical * moving;
}

/* Return to the first rest. */
void fl_rests_rewind(fl_rests *rests) { rests->window = rests->end = 0; }

/* Whether there are rests, and whether they are left out; none if too few readings would be left. */
static int count_rests(fl_rests *rests)
{
    size_t begin, end, count = 0, turned = rests->rows;
    for (; fl_rests_next(rests, &begin, &end); count++) turned -= end - begin;
    fl_rests_rewind(rests);
    rests->are_left_out = count > 0 && turned >= TURN_PER_REST * count;
    return count > 0 && turned + (rests->are_left_out ? 0 : count) >= MIN_FITTED;
}

/* Find rests, with memory `scratch` (3 * rows,), on a board (2 * rows,), and `is_still` (rows / 2,). */
void fl_rests_begin(const real *field, size_t rows, const int64_t *ends, size_t parts, real *scratch,
                    unsigned char *is_still, fl_rests *rests)
{
    memset(rests, 0, sizeof *rests);
    rests->field = field, rests->rows = rows, rests->ends = ends, rests->parts = parts, rests->is_still = is_still;
    if (rows < 4 * HALF_WINDOW) return;
    rests->far = far_distance(field, rows, scratch, rests->origin);
    rests->still = REST_MOVEMENT * rests->far, rests->noisy = REST_SCATTER * rests->far;
    half *const halves = (half *)(void *)scratch;
    size_t count = rows / HALF_WINDOW;
    rests->half = HALF_WINDOW;
    for (size_t i = 0; i < count; i++) halves[i] = half_of(rests, i * HALF_WINDOW);
    for (; count >= 4; rests->half *= 2) {
        rests->windows = count - 1, rests->chance = MOVEMENT_SIGMAS * fl_sqrt(1 / (3 * (real)rests->half));
        if (rests->half == HALF_WINDOW && !has_still(rests, halves)) count = 0;
        else if (mark_still(rests, halves)) break;
        for (size_t i = 0; i < count / 2; i++) halves[i] = both_of(halves + 2 * i, halves + 2 * i + 1);
        count /= 2;
    }
    if (count < 4 || !count_rests(rests)) rests->windows = 0;
}

/* Mean of some readings, and their standard deviation about it. */
static void scatter_of(const fl_rests *rests, size_t begin, size_t end, real mean[3], real *scatter)
{
    real square = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (size_t row = begin; row < end; row++)
        for (int axis = 0; axis < 3; axis++) mean[axis] += rests->field[3 * row + axis];
    for (int axis = 0; axis < 3; axis++) mean[axis] /= (real)(end - begin);
    for (size_t row = begin; row < end; row++) square += square_apart(rests->field + 3 * row, mean);
    *scatter = fl_sqrt(square / (real)(end - begin));
}

/* Extend a rest by following windows at rest in the same direction; returns the last. */
static size_t last_window(const fl_rests *rests, size_t window)
{
    real sum[3], mean[3], here[3], scatter, other;
    size_t begin = window * rests->half, n = 2 * rests->half;
    scatter_of(rests, begin, begin + n, mean, &scatter);
    for (int axis = 0; axis < 3; axis++) sum[axis] = mean[axis] * (real)n;
    const real apart = rests->still + MOVEMENT_SIGMAS * scatter / fl_sqrt((real)n);
    for (; window + 1 < rests->windows && rests->is_still[window + 1]; window++) {
        const size_t next = (window + 2) * rests->half;
        scatter_of(rests, next, next + rests->half, here, &other);
        if (square_apart(here, mean) > apart * apart || is_cut(rests, begin, next + rests->half)) break;
        n += rests->half;
        for (int axis = 0; axis < 3; axis++) sum[axis] += here[axis] * (real)rests->half, mean[axis] = sum[axis] / (real)n;
    }
    return window;
}

/* Next rest: its first row, and the row after its last; 0 if there is none. */
int fl_rests_next(fl_rests *rests, size_t *begin, size_t *end)
{
    const size_t free = rests->end;
    real mean[3], scatter;
    while (rests->window < rests->windows &&
           (!rests->is_still[rests->window] || rests->window * rests->half < free)) rests->window++;
    if (rests->window >= rests->windows) return 0;
    *begin = rests->window * rests->half;
    rests->window = last_window(rests, rests->window);
    *end = (rests->window + 2) * rests->half;
    scatter_of(rests, *begin, *end, mean, &scatter);
    const real near = rests->still + MEMBER_SIGMAS * scatter;
    while (*begin > free && !is_cut(rests, *begin - 1, *begin + 1) &&
           square_apart(rests->field + 3 * (*begin - 1), mean) < near * near) *begin -= 1;
    while (*end < rests->rows && !is_cut(rests, *end - 1, *end + 1) &&
           square_apart(rests->field + 3 * *end, mean) < near * near) *end += 1;
    rests->end = *end;
    return 1;
}

/* Copy readings between rows; out and in may overlap if out is before in. */
static void move_rows(const fl_rests *rests, size_t from, size_t to, size_t count, const fl_fitted *out)
{
    memmove(out->field + 3 * to, rests->field + 3 * from, 3 * count * sizeof(real));
    if (out->time) memmove(out->time + to, out->time_of_all + from, count * sizeof(real));
}

/* End rows of recordings, after averaging or removal of the rests before a row. */
static size_t move_ends(const fl_rests *rests, size_t part, size_t row, size_t count, const fl_fitted *out)
{
    for (; part < rests->parts && (size_t)rests->ends[part] <= row; part++)
        out->ends[part] = rests->ends[part] - (int64_t)(row - count);
    return part;
}

/* Write readings with averaged or removed rests to `out`, which may be the input; the time of a mean is the middle of its
 * rest. Returns their number. */
size_t fl_rests_fitted(fl_rests *rests, const fl_fitted *out)
{
    size_t begin, end, last = 0, count = 0, part = 0;
    while (fl_rests_next(rests, &begin, &end)) {
        real mean[3], scatter;
        scatter_of(rests, begin, end, mean, &scatter);
        const real time = out->time ? (out->time_of_all[begin] + out->time_of_all[end - 1]) / 2 : 0;
        move_rows(rests, last, count, begin - last, out);
        count += begin - last;
        part = move_ends(rests, part, begin, count, out);
        last = end;
        if (rests->are_left_out) continue;
        memcpy(out->field + 3 * count, mean, sizeof mean);
        if (out->time) out->time[count] = time;
        count++;
    }
    move_rows(rests, last, count, rests->rows - last, out);
    count += rests->rows - last;
    move_ends(rests, part, rests->rows, count, out);
    return count;
}

/* Rows of the rests of a recording. */
size_t flinders_rests(const real *field, size_t rows, const int64_t *ends, size_t parts, void *workspace, size_t size,
                      int64_t *bounds, int32_t *are_left_out)
{
    fl_room room;
    fl_rests rests;
    size_t count = 0, begin, end;
    if (rows == 0 || fl_room_of(workspace, size, rows, &room)) return 0;
    fl_rests_begin(field, rows, ends, ends ? parts : 0, room.fitted, room.passed, &rests);
    *are_left_out = rests.are_left_out;
    for (; fl_rests_next(&rests, &begin, &end); count++) bounds[2 * count] = (int64_t)begin, bounds[2 * count + 1] = (int64_t)end;
    return count;
}
