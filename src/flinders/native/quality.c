/* Statistics of a recording before a fit: repeats, saturation, time stamps, distinct readings. */
#include "record.h"

enum { PARTS = 19, COLUMN_PADDING = 24, /* numbers between two columns, which then share no lines of a cache */
       RAIL_COUNT = 8, RAIL_CONTRAST = 3 }; /* as in summary/quality.py */
#define RAIL_SHARE ((real)0.01)
#define RAIL_WIDTH ((real)0.25)

/* Free part of the workspace, rounded up to 64 bytes. */
static size_t taken(size_t used, size_t bytes) { return used + (bytes + 63) / 64 * 64; }

/* Sizes of the parts of the workspace, in the order of fl_room. */
static void sizes_of(size_t rows, size_t sizes[PARTS])
{
    const size_t looked = rows < FL_LOOKED ? rows : FL_LOOKED;
    const size_t some = rows < FL_ENOUGH ? rows : FL_ENOUGH;
    sizes[0] = rows * sizeof(real), sizes[1] = rows * sizeof(real);
    sizes[2] = FL_COLUMNS * (looked + COLUMN_PADDING) * sizeof(real), sizes[3] = 2 * some * sizeof(uint32_t);
    sizes[4] = sizes[5] = sizes[6] = rows;
    sizes[7] = FL_SLOTS * sizeof(uint64_t), sizes[8] = 4 * FL_SLOTS * sizeof(real);
    sizes[9] = (looked + 2) * sizeof(size_t), sizes[10] = FL_TABLE;
    sizes[11] = 3 * FL_LOOKED * sizeof(real), sizes[12] = 2 * 100 * 100 * sizeof(real);
    sizes[13] = 3 * some * sizeof(real), sizes[14] = 12 * looked * sizeof(real);
    sizes[15] = 3 * rows * sizeof(real), sizes[16] = rows * sizeof(real), sizes[17] = rows * sizeof(int64_t);
    sizes[18] = 3 * rows * sizeof(real);
}

/* Size of the workspace for a recording in bytes. */
size_t flinders_workspace_size(size_t rows)
{
    size_t sizes[PARTS], used = 0;
    sizes_of(rows, sizes);
    for (int part = 0; part < PARTS; part++) used = taken(used, sizes[part]);
    return used;
}

/* Divide the workspace into arrays; nonzero if it is too small. */
int fl_room_of(void *workspace, size_t size, size_t rows, fl_room *room)
{
    size_t sizes[PARTS], used = 0;
    unsigned char *parts[PARTS];
    if (!workspace || size < flinders_workspace_size(rows)) return 1;
    sizes_of(rows, sizes);
    for (int part = 0; part < PARTS; part++) {
        parts[part] = (unsigned char *)workspace + used;
        used = taken(used, sizes[part]);
    }
    room->distances = (real *)(void *)parts[0], room->scratch = (real *)(void *)parts[1];
    room->columns = (real *)(void *)parts[2], room->apart = (rows < FL_LOOKED ? rows : FL_LOOKED) + COLUMN_PADDING;
    room->order = (uint32_t *)(void *)parts[3];
    room->rejected = parts[4], room->far = parts[5], room->passed = parts[6];
    room->keys = (uint64_t *)(void *)parts[7], room->cells = (real *)(void *)parts[8];
    room->begins = (size_t *)(void *)parts[9], room->counters = parts[10];
    room->directions = (real *)(void *)parts[11], room->matrices = (real *)(void *)parts[12];
    room->some = (real *)(void *)parts[13], room->series = (real *)(void *)parts[14];
    room->fitted = (real *)(void *)parts[15], room->fitted_time = (real *)(void *)parts[16];
    room->fitted_ends = (int64_t *)(void *)parts[17], room->flat = (real *)(void *)parts[18];
    room->time = NULL, room->ends = NULL, room->parts = 0, room->slots = 0, room->side = room->fullest = 0;
    return 0;
}

/* Mix the bits of a reading. */
static uint64_t hash_of(const real reading[3])
{
    uint64_t hash = 0;
    for (int axis = 0; axis < 3; axis++) {
        const real value = reading[axis] + 0; /* -0 is 0 */
        uint64_t bits = 0;
        memcpy(&bits, &value, sizeof value);
        hash = (hash ^ bits) * UINT64_C(0xBF58476D1CE4E5B9);
        hash ^= hash >> 29;
    }
    hash *= UINT64_C(0x94D049BB133111EB);
    return hash ^ hash >> 32;
}

/* Keep hashes up to a bound in a table; returns their number. */
static size_t thin(const fl_room *room, size_t slots, uint64_t bound)
{
    uint64_t *const spare = room->keys + FL_TABLE;
    real *const counts = room->cells, *const spare_counts = room->cells + FL_TABLE;
    size_t left = 0;
    memset(spare, 0xFF, slots * sizeof *spare);
    for (size_t slot = 0; slot < slots; slot++) {
        if (room->keys[slot] > bound) continue;
        const size_t to = fl_slot(spare, slots, room->keys[slot]);
        spare[to] = room->keys[slot], spare_counts[to] = counts[slot];
        left++;
    }
    memcpy(room->keys, spare, slots * sizeof *spare);
    memcpy(counts, spare_counts, slots * sizeof *counts);
    return left;
}

/* The hashes of n readings that are no larger than a bound; their number. No branch depends on them. */
static size_t small_hashes(const real *field, size_t n, uint64_t bound, uint64_t out[FL_BLOCK])
{
    size_t count = 0;
    for (size_t i = 0; i < n; i++) {
        out[count] = hash_of(field + 3 * i) >> 1;
        count += out[count] <= bound;
    }
    return count;
}

/* Number of distinct readings. Above 4096, an estimate from a sample: the readings with small hashes. */
int64_t fl_distinct(const real *field, size_t rows, const fl_room *room)
{
    const size_t slots = fl_slots_for(rows);
    uint64_t bound = UINT64_MAX >> 1, hashes[FL_BLOCK];
    size_t count = 0;
    real sampled = 0;
    memset(room->keys, 0xFF, slots * sizeof *room->keys);
    for (size_t row = 0; row < rows; row += FL_BLOCK) {
        const size_t n = small_hashes(field + 3 * row, rows - row < FL_BLOCK ? rows - row : FL_BLOCK, bound, hashes);
        for (size_t i = 0; i < n; i++) {
            if (hashes[i] > bound) continue;
            const size_t slot = fl_slot(room->keys, slots, hashes[i]);
            const int is_new = room->keys[slot] != hashes[i];
            room->keys[slot] = hashes[i];
            room->cells[slot] = is_new ? 1 : room->cells[slot] + 1;
            for (count += (size_t)is_new; count > FL_CELLS; count = thin(room, slots, bound)) bound /= 2;
        }
    }
    if (bound == UINT64_MAX >> 1) return (int64_t)count;
    for (size_t slot = 0; slot < slots; slot++)
        if (room->keys[slot] <= bound) sampled += room->cells[slot];
    return (int64_t)((real)rows * (real)count / sampled + (real)0.5);
}

/* Statistics of time stamps; NaN are ignored. */
static void clock_of(const real *time, size_t rows, flinders_record *record)
{
    real last, longest = 0;
    int64_t backward = 0;
    size_t row = 0;
    while (row < rows && isnan(time[row])) row++;
    if (row == rows) return;
    for (record->start = last = time[row]; row < rows; row++) {
        const real step = time[row] - last; /* 0 of the first */
        if (isnan(step)) continue;
        longest = step > longest ? step : longest;
        backward += step < 0;
        last = time[row];
    }
    record->end = last, record->longest_step = longest, record->backward_steps = backward;
}

/* Range of readings at the ends of the axes, and their number. */
typedef struct {
    real low[6][3], high[6][3];
} at_ends;

/* Count a reading that is at an end of an axis. */
static void count_ends(const real reading[3], flinders_record *record, at_ends *there)
{
    for (int end = 0; end < 6; end++) {
        if (reading[end % 3] != (end < 3 ? record->lowest : record->highest)[end % 3]) continue;
        for (int axis = 0; axis < 3; axis++) {
            const int is_first = record->end_counts[end] == 0;
            if (is_first || reading[axis] < there->low[end][axis]) there->low[end][axis] = reading[axis];
            if (is_first || reading[axis] > there->high[end][axis]) there->high[end][axis] = reading[axis];
        }
        record->end_counts[end]++;
    }
}

/* Whether readings share the end of an axis and differ along the others, so that it is a rail or a coarse step. */
static int is_shared(int end, const at_ends *there, const flinders_record *record)
{
    const int64_t count = record->end_counts[end];
    if (count < RAIL_COUNT || !((real)count > RAIL_SHARE * (real)record->rows)) return 0;
    for (int axis = 0; axis < 3; axis++) {
        const real extent = record->highest[axis] - record->lowest[axis];
        const real needed = axis == end % 3 ? 0 : RAIL_WIDTH * extent;
        const real width = axis == end % 3 ? extent : there->high[end][axis] - there->low[end][axis];
        if (!(width > needed)) return 0;
    }
    return 1;
}

/* Hold the readings at the end of an axis against those at its next value: a rail has far more, a coarse step as many. */
static void compare_with_next(const real *field, size_t rows, int end, flinders_record *record)
{
    const int axis = end % 3;
    const real sign = end < 3 ? 1 : -1, value = end < 3 ? record->lowest[axis] : -record->highest[axis];
    real step = FL_HUGE;
    int64_t count = 0;
    for (size_t row = 0; row < rows; row++) {
        const real apart = sign * field[3 * row + axis] - value;
        if (!(apart > 0) || apart > step) continue;
        count = apart < step ? 1 : count + 1;
        step = apart;
    }
    if (record->end_counts[end] > RAIL_CONTRAST * count) record->rails |= 1 << end;
    else record->step = step > record->step ? step : record->step;
}

/* Number of readings that are equal to the previous one. */
int64_t fl_repeats(const real *field, size_t rows)
{
    int64_t count = 0;
    for (size_t row = 1; row < rows; row++) {
        const real *const here = field + 3 * row;
        count += here[0] == here[-3] && here[1] == here[-2] && here[2] == here[-1];
    }
    return count;
}

/* Compute the statistics; nonzero if a reading is not finite. */
int fl_quality(const fl_kernels *kernels, const real *field, const real *time, size_t rows, flinders_record *record)
{
    at_ends there;
    real lowest[3], highest[3];
    int64_t run = 0;
    if (kernels->ends(field, rows, lowest, highest)) return 1;
    memcpy(record->lowest, lowest, sizeof lowest);
    memcpy(record->highest, highest, sizeof highest);
    for (size_t row = 0; row < rows; row++) {
        const real *here = field + 3 * row;
        if (row % 8 == 1) {
            const size_t passed = kernels->ordinary(here, rows - row, lowest, highest);
            run = passed ? 0 : run;
            row += passed, here += 3 * passed;
            if (row == rows) break;
        }
        count_ends(here, record, &there);
        run = row > 0 && here[0] == here[-3] && here[1] == here[-2] && here[2] == here[-1] ? run + 1 : 0;
        record->repeats += run > 0;
        record->longest_repeat = run + 1 > record->longest_repeat ? run + 1 : record->longest_repeat;
    }
    record->step = 0;
    for (int end = 0; end < 6; end++)
        if (is_shared(end, &there, record)) compare_with_next(field, rows, end, record);
    if (time) clock_of(time, rows, record);
    return 0;
}
