/* Rests: intervals in which the direction stands still. However often it is read there, a place tells of the surface what
 * one reading tells, with what the field differs by between places. So each rest becomes one reading, its mean; and it is
 * left out where readings of a turn are so many more that it would only speak of directions which they did not see.
 *
 * Windows of readings are as short as the recording lets them be: so long that in those that are no rest the sensor turns
 * by thirty times as much, on average, as it may in a rest. A window is still where its readings scatter hardly more than
 * steps from one to the next explain, which are all noise there.
 */
#include "record.h"

#ifdef FLINDERS_SMALL
enum { SHORTEST = 4 }; /* readings of half a window */
#else
enum { SHORTEST = 2 };
#endif
enum { FEWEST_LEFT = 12, /* readings, those of rests included, that a fit needs */
       MANY = 20,        /* times as many readings of a turn as rests: these are left out */
       LOOKED_AT = 256 }; /* readings, to see how far they are apart */

#define FAR_SHARE ((real)0.95) /* of the readings: the others may be outliers */
#define STILL ((real)0.005)    /* movement of a rest, over the distance from the mean to the far readings */
#define TYPICAL ((real)30)     /* movement of an average window that is not still over that */
#define LARGEST ((real)2)      /* what a window counts for at most, over the average */
#define MOVING ((real)0.05)    /* share of windows that are not still, at least */
#define SPIKE ((real)3)        /* distance of an outlier from the middle of its neighbours, over that between these */
#define NOISY ((real)0.1)      /* scatter of a rest at most, over the same distance */
#define SAGITTA ((real)0.1)    /* how far movement takes the mean of a rest off the surface, over the noise of a reading */
#define LOOSE ((real)2)        /* standard deviations by which noise may make a rest move */
#define NEAR ((real)2.5)       /* standard deviations up to which readings next to a rest are of it */

/* Sums over half a window of readings less an origin, and of squared steps from one to the next: among them, and from the
 * reading before. */
typedef struct {
    real sum[3], square, steps, link;
} half;

static real square_of(const real v[3]) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; }

static real square_apart(const real a[3], const real b[3])
{
    const real apart[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return square_of(apart);
}

/* Distance from the mean that few readings are beyond, by some of them. Fills in the mean. */
static real far_distance(const real *field, size_t rows, real *scratch, real mean[3])
{
    const size_t stride = (rows + LOOKED_AT - 1) / LOOKED_AT;
    size_t n = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (size_t row = 0; row < rows; row += stride, n++)
        for (int axis = 0; axis < 3; axis++) mean[axis] += field[3 * row + axis];
    for (int axis = 0; axis < 3; axis++) mean[axis] /= (real)n;
    for (size_t i = 0; i < n; i++) scratch[i] = square_apart(field + 3 * i * stride, mean);
    return fl_sqrt(fl_select(scratch, n, (size_t)(FAR_SHARE * (real)(n - 1))));
}

/* Sums over half a window from a reading on. */
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

/* Sums over both of two halves that follow each other. */
static half both_of(const half *first, const half *second)
{
    half both = *first;
    for (int axis = 0; axis < 3; axis++) both.sum[axis] += second->sum[axis];
    both.square += second->square;
    both.steps += second->link + second->steps;
    return both;
}

/* Whether one of several recordings ends within some rows. */
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

/* Variance of the n readings of a window, and that of noise which explains their steps. */
static void variances(const half *window, size_t n, real *variance, real *noise)
{
    const real rest = window->square - square_of(window->sum) / (real)n;
    *variance = rest > 0 ? rest / (real)(n - 1) : 0;
    *noise = window->steps / (real)(2 * (n - 1));
}

/* Whether a reading is an outlier by itself, that makes the variance of a window. */
static int has_spike(const fl_rests *rests, size_t begin, size_t end, real variance)
{
    for (size_t row = begin ? begin : 1; row < end && row + 1 < rests->rows; row++) {
        const real *const here = rests->field + 3 * row;
        const real middle[3] = {(here[-3] + here[3]) / 2, (here[-2] + here[4]) / 2, (here[-1] + here[5]) / 2};
        const real off = square_apart(here, middle);
        if (off > variance && off > SPIKE * SPIKE * square_apart(here - 3, here + 3)) return 1;
    }
    return 0;
}

/* Whether a window is still, and the variance of its readings. */
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
    const real loose = moved + (chance < LOOSE * LOOSE * moved ? chance : LOOSE * LOOSE * moved);
    return *variance - noise <= loose && !is_cut(rests, begin, begin + n);
}

/* Whether any window is still. */
static int has_still(const fl_rests *rests, const half *halves)
{
    real variance;
    for (size_t window = 0; window < rests->windows; window++)
        if (is_still(rests, halves, window, &variance)) return 1;
    return 0;
}

/* Mark the still ones of windows, each half a window behind the other; whether they are long enough: the others then
 * scatter by far more than those on average. */
static int mark_still(fl_rests *rests, const half *halves)
{
    const size_t n = 2 * rests->half;
    const real moved = TYPICAL * rests->still, typical = moved * moved, most = LARGEST * LARGEST * typical;
    real sum = 0, moving = 0, variance;
    for (size_t window = 0; window < rests->windows; window++) {
        const size_t begin = window * rests->half;
        rests->is_still[window] = (unsigned char)is_still(rests, halves, window, &variance);
        if (rests->is_still[window]) continue;
        if (variance > typical && has_spike(rests, begin, begin + n, variance)) continue;
        sum += variance < most ? variance : most;
        moving++;
    }
    return moving > MOVING * (real)rests->windows && sum >= typical * moving;
}

/* Begin anew. */
static void rewind_to_first(fl_rests *rests) { rests->window = rests->end = 0; }

/* Whether there are rests, and what becomes of them; none where too few readings would be left. */
static int count_rests(fl_rests *rests)
{
    size_t begin, end, count = 0, turned = rests->rows;
    for (; fl_rests_next(rests, &begin, &end); count++) turned -= end - begin;
    rewind_to_first(rests);
    rests->are_left_out = turned >= MANY * count;
    return count > 0 && turned + (rests->are_left_out ? 0 : count) >= FEWEST_LEFT;
}

/* Look for rests: `scratch` (3 * rows,), on a board (2 * rows,), and `is_still` (rows / 2,) are lent. */
void fl_rests_begin(const real *field, size_t rows, const int64_t *ends, size_t parts, real *scratch,
                    unsigned char *is_still, fl_rests *rests)
{
    memset(rests, 0, sizeof *rests);
    rests->field = field, rests->rows = rows, rests->ends = ends, rests->parts = parts, rests->is_still = is_still;
    if (rows < 4 * SHORTEST) return;
    rests->far = far_distance(field, rows, scratch, rests->origin);
    rests->still = STILL * rests->far, rests->noisy = NOISY * rests->far;
    half *const halves = (half *)(void *)scratch;
    size_t count = rows / SHORTEST;
    rests->half = SHORTEST;
    for (size_t i = 0; i < count; i++) halves[i] = half_of(rests, i * SHORTEST);
    for (; count >= 4; rests->half *= 2) {
        rests->windows = count - 1, rests->chance = LOOSE * fl_sqrt(1 / (3 * (real)rests->half));
        if (rests->half == SHORTEST && !has_still(rests, halves)) count = 0;
        else if (mark_still(rests, halves)) break;
        for (size_t i = 0; i < count / 2; i++) halves[i] = both_of(halves + 2 * i, halves + 2 * i + 1);
        count /= 2;
    }
    if (count < 4 || !count_rests(rests)) rests->windows = 0;
}

/* The mean of some readings, and their scatter about it. */
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

/* Lengthen a rest by the windows behind it that are still and at the same place; returns the last. */
static size_t last_window(const fl_rests *rests, size_t window)
{
    real sum[3], mean[3], here[3], scatter, other;
    size_t begin = window * rests->half, n = 2 * rests->half;
    scatter_of(rests, begin, begin + n, mean, &scatter);
    for (int axis = 0; axis < 3; axis++) sum[axis] = mean[axis] * (real)n;
    const real apart = rests->still + LOOSE * scatter / fl_sqrt((real)n);
    for (; window + 1 < rests->windows && rests->is_still[window + 1]; window++) {
        const size_t next = (window + 2) * rests->half;
        scatter_of(rests, next, next + rests->half, here, &other);
        if (square_apart(here, mean) > apart * apart || is_cut(rests, begin, next + rests->half)) break;
        n += rests->half;
        for (int axis = 0; axis < 3; axis++) sum[axis] += here[axis] * (real)rests->half, mean[axis] = sum[axis] / (real)n;
    }
    return window;
}

/* The next rest, its first row and the one behind its last; 0 where there is no other. */
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
    const real near = rests->still + NEAR * scatter;
    while (*begin > free && !is_cut(rests, *begin - 1, *begin + 1) &&
           square_apart(rests->field + 3 * (*begin - 1), mean) < near * near) *begin -= 1;
    while (*end < rests->rows && !is_cut(rests, *end - 1, *end + 1) &&
           square_apart(rests->field + 3 * *end, mean) < near * near) *end += 1;
    rests->end = *end;
    return 1;
}

/* Copy readings from one row to another; out and in may overlap, out before in. */
static void move_rows(const fl_rests *rests, size_t from, size_t to, size_t count, const fl_fitted *out)
{
    memmove(out->field + 3 * to, rests->field + 3 * from, 3 * count * sizeof(real));
    if (out->time) memmove(out->time + to, out->time_of_all + from, count * sizeof(real));
}

/* Ends of recordings, once the rests up to a row are one reading each or none. */
static size_t move_ends(const fl_rests *rests, size_t part, size_t row, size_t count, const fl_fitted *out)
{
    for (; part < rests->parts && (size_t)rests->ends[part] <= row; part++)
        out->ends[part] = rests->ends[part] - (int64_t)(row - count);
    return part;
}

/* Put the readings that a fit goes by into `out`, which may be where they are: a rest is its mean, in the middle of its
 * time, or left out. Returns how many there are. */
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

/* Where the rests of a recording are. */
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
