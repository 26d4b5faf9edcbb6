/* What a recording says of itself before any fit: repeats, ends of the axes, time stamps, distinct readings. */
#include "record.h"

enum { PARTS = 16 };

/* The part of the workspace behind what was taken, rounded up to 64 bytes. */
static size_t taken(size_t used, size_t bytes) { return used + (bytes + 63) / 64 * 64; }

/* Sizes of the parts of the workspace, in the order of fl_room. */
static void sizes_of(size_t rows, size_t sizes[PARTS])
{
    const size_t looked = rows < FL_LOOKED ? rows : FL_LOOKED;
    const size_t some = rows < FL_ENOUGH ? rows : FL_ENOUGH;
    sizes[0] = rows * sizeof(real), sizes[1] = rows * sizeof(real);
    sizes[2] = FL_COLUMNS * looked * sizeof(real), sizes[3] = 2 * some * sizeof(uint32_t);
    sizes[4] = sizes[5] = sizes[6] = rows;
    sizes[7] = FL_SLOTS * sizeof(uint64_t), sizes[8] = 4 * FL_SLOTS * sizeof(real), sizes[9] = FL_REGISTERS;
    sizes[10] = (looked + 2) * sizeof(size_t), sizes[11] = FL_TABLE;
    sizes[12] = 3 * FL_LOOKED * sizeof(real), sizes[13] = 2 * 100 * 100 * sizeof(real);
    sizes[14] = 3 * some * sizeof(real), sizes[15] = 12 * looked * sizeof(real);
}

/* Bytes of workspace that a recording needs. */
size_t flinders_workspace_size(size_t rows)
{
    size_t sizes[PARTS], used = 0;
    sizes_of(rows, sizes);
    for (int part = 0; part < PARTS; part++) used = taken(used, sizes[part]);
    return used;
}

/* Cut the workspace up; nonzero if it is too small. */
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
    room->rows = (real *)(void *)parts[2], room->order = (uint32_t *)(void *)parts[3];
    room->rejected = parts[4], room->far = parts[5], room->passed = parts[6];
    room->keys = (uint64_t *)(void *)parts[7], room->cells = (real *)(void *)parts[8], room->registers = parts[9];
    room->begins = (size_t *)(void *)parts[10], room->counters = parts[11];
    room->directions = (real *)(void *)parts[12], room->matrices = (real *)(void *)parts[13];
    room->some = (real *)(void *)parts[14], room->series = (real *)(void *)parts[15];
    room->time = NULL, room->ends = NULL, room->parts = 0, room->slots = 0, room->side = 0;
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

/* Different readings: counted up to 4096, estimated beyond (Flajolet and others, HyperLogLog, 2007). */
static int64_t distinct(const real *field, size_t rows, const fl_room *room)
{
    const size_t slots = fl_slots_for(rows);
    size_t count = 0;
    memset(room->registers, 0, FL_REGISTERS);
    memset(room->keys, 0xFF, slots * sizeof *room->keys);
    for (size_t row = 0; row < rows; row++) {
        const uint64_t hash = hash_of(field + 3 * row);
        if (count <= FL_CELLS) {
            const size_t slot = fl_slot(room->keys, slots, hash >> 1);
            count += room->keys[slot] != hash >> 1;
            room->keys[slot] = hash >> 1;
        }
        const unsigned char zeros = (unsigned char)(1 + __builtin_ctzll(hash >> 12 | UINT64_C(1) << 51));
        unsigned char *at = room->registers + (hash & (FL_REGISTERS - 1));
        *at = zeros > *at ? zeros : *at;
    }
    if (count <= FL_CELLS) return (int64_t)count;
    real sum = 0, m = FL_REGISTERS;
    int empty = 0;
    for (int i = 0; i < FL_REGISTERS; i++) {
        sum += fl_ldexp(1, -(int)room->registers[i]);
        empty += room->registers[i] == 0;
    }
    const real estimate = (real)0.7213 / (1 + (real)1.079 / m) * m * m / sum;
    if (estimate <= (real)2.5 * m && empty) return (int64_t)(m * fl_log2(m / (real)empty) * (real)0.6931471805599453);
    return (int64_t)estimate;
}

/* What time stamps say; those that are NaN are passed over. */
static void clock_of(const real *time, size_t rows, flinders_record *record)
{
    real last = FL_NOT_A_NUMBER;
    for (size_t row = 0; row < rows; row++) {
        if (isnan(time[row])) continue;
        if (isnan(record->start)) {
            record->start = time[row];
            record->longest_step = 0;
        } else {
            const real step = time[row] - last;
            record->longest_step = step > record->longest_step ? step : record->longest_step;
            record->backward_steps += step < 0;
        }
        record->end = last = time[row];
    }
}

/* How readings at the ends of the axes range, and how many there are. */
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

/* Look at all readings; nonzero if one is not finite. */
int fl_quality(const fl_kernels *kernels, const real *field, const real *time, size_t rows, int all, const fl_room *room,
               flinders_record *record)
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
    for (int end = 0; end < 6; end++)
        for (int axis = 0; axis < 3; axis++)
            record->end_extent[3 * end + axis] = there.high[end][axis] - there.low[end][axis];
    if (time) clock_of(time, rows, record);
    if (all) record->distinct = distinct(field, rows, room);
    return 0;
}
