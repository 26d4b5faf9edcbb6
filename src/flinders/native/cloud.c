/* Cells that readings fall into, and the directions of the sphere that they cover. */
#include "residuals.h"

enum { SAMPLED_READINGS = 512, SECTORS = 100, AXIS_STRIDE = FL_CELLS + FL_LANES /* from one axis to the next */ };

/* Median of a list, which is put into another order. */
real fl_median(real *values, size_t n)
{
    const real upper = fl_select(values, n, n / 2);
    if (n % 2) return upper;
    real lower = values[0];
    for (size_t i = 1; i < n / 2; i++) lower = values[i] > lower ? values[i] : lower;
    return (lower + upper) / 2;
}

/* The power of two nearest to a twelfth of the median distance from the middle of a cloud. */
real fl_cell_side(const real *field, size_t rows)
{
    const size_t stride = rows / SAMPLED_READINGS > 1 ? rows / SAMPLED_READINGS : 1;
    real distances[2 * SAMPLED_READINGS], middle[3] = {0, 0, 0}, largest = 0;
    size_t n = 0;
    for (size_t row = 0; row < rows && n < 2 * SAMPLED_READINGS; row += stride, n++)
        for (int axis = 0; axis < 3; axis++) {
            const real value = fl_abs(field[3 * row + axis]);
            middle[axis] += field[3 * row + axis];
            largest = value > largest ? value : largest;
        }
    const real finest = fl_ldexp(1, -40);
    if (!(finest < largest && largest < (real)FL_LARGEST)) return 1;
    for (int axis = 0; axis < 3; axis++) middle[axis] /= (real)n;
    for (size_t i = 0; i < n; i++) {
        const real *reading = field + 3 * i * stride;
        const real x = reading[0] - middle[0], y = reading[1] - middle[1], z = reading[2] - middle[2];
        distances[i] = fl_sqrt(x * x + y * y + z * z);
    }
    const real radius = fl_median(distances, n), least = finest * largest;
    return fl_ldexp(1, (int)fl_floor(fl_log2((radius > least ? radius : least) / 12) + (real)0.5));
}

/* Slots of a hash table for so many keys. */
size_t fl_slots_for(size_t rows)
{
    size_t slots = 64;
    while (slots < FL_TABLE && slots < 2 * rows) slots *= 2;
    return slots;
}

/* The cell of a key in a table, zeroed where it is new, which is counted. */
static real *cell_of(const fl_room *room, size_t table, size_t slots, uint64_t key, size_t *cells)
{
    const size_t slot = table + fl_slot(room->keys + table, slots, key);
    real *const cell = room->cells + 4 * slot;
    if (room->keys[slot] != FL_EMPTY) return cell;
    room->keys[slot] = key;
    memset(cell, 0, 4 * sizeof *cell);
    *cells += 1;
    return cell;
}

/* Cells of twice the size: their number. */
static size_t coarsen(fl_room *room, size_t slots)
{
    size_t cells = 0;
    memset(room->keys + FL_TABLE, 0xFF, slots * sizeof *room->keys);
    for (size_t slot = 0; slot < slots; slot++) {
        if (room->keys[slot] == FL_EMPTY) continue;
        uint64_t key = 0;
        for (int shift = 42; shift >= 0; shift -= 21) {
            const int64_t index = (int64_t)(room->keys[slot] >> shift & 0x1FFFFF);
            key = key << 21 | (uint64_t)((index + FL_REACH) / 2); /* counted from -FL_REACH, halved and rounded down */
        }
        real *const coarse = cell_of(room, FL_TABLE, slots, key, &cells);
        for (int i = 0; i < 4; i++) coarse[i] += room->cells[4 * slot + (size_t)i];
        room->fullest = coarse[0] > room->fullest ? coarse[0] : room->fullest;
    }
    memcpy(room->keys, room->keys + FL_TABLE, slots * sizeof *room->keys);
    memcpy(room->cells, room->cells + 4 * FL_TABLE, 4 * slots * sizeof *room->cells);
    return cells;
}

/* Sort a block of readings into cells; returns how many of these are new. All are found before any is added to, so that
 * a processor need not wait for one after the other. */
static size_t add_block(fl_room *room, const uint64_t *keys, const real *field, size_t n)
{
    real *cells[FL_BLOCK], fullest = room->fullest;
    size_t added = 0;
    for (size_t i = 0; i < n; i++) cells[i] = cell_of(room, 0, room->slots, keys[i], &added);
    for (size_t i = 0; i < n; i++, field += 3) {
        cells[i][0] += 1;
        fullest = cells[i][0] > fullest ? cells[i][0] : fullest;
        for (int axis = 0; axis < 3; axis++) cells[i][1 + axis] += field[axis];
    }
    room->fullest = fullest;
    return added;
}

/* Sort readings into cells, at most 4096 of them: the table of a room. */
void fl_cloud(const fl_kernels *kernels, const real *field, size_t rows, fl_room *room)
{
    uint64_t keys[FL_BLOCK];
    const size_t slots = room->slots = fl_slots_for(rows);
    size_t cells = 0;
    room->side = fl_cell_side(field, rows), room->fullest = 0;
    memset(room->keys, 0xFF, slots * sizeof *room->keys);
    for (size_t row = 0; row < rows; row += FL_BLOCK) {
        const size_t n = rows - row < FL_BLOCK ? rows - row : FL_BLOCK;
        kernels->keys(field + 3 * row, n, 1, room->side, keys);
        cells += add_block(room, keys, field + 3 * row, n);
        for (; cells > FL_CELLS; room->side *= 2) cells = coarsen(room, slots);
    }
}

/* The same of readings that nobody has looked at; a status. */
int fl_cloud_of_any(const fl_kernels *kernels, const real *field, size_t rows, fl_room *room)
{
    real lowest[3], highest[3];
    if (kernels->ends(field, rows, lowest, highest)) return FLINDERS_NOT_FINITE;
    for (int axis = 0; axis < 3; axis++)
        if (!(-lowest[axis] < (real)FL_LARGEST && highest[axis] < (real)FL_LARGEST)) return FLINDERS_OUT_OF_SCALE;
    fl_cloud(kernels, field, rows, room);
    return FLINDERS_OK;
}

const int fl_bands[6] = {1, 15, 34, 34, 15, 1}, fl_band_starts[6] = {0, 1, 16, 50, 84, 99};
const real fl_band_edges[5] = {(real)0.98, (real)0.68, 0, (real)-0.68, (real)-0.98};

/* cos(2πk/15) and cos(2πk/34) for k = 1, 2, ...: where sectors of a band begin. */
const real fl_sectors_15[7] = {
    (real)0.9135454576426009, (real)0.6691306063588582, (real)0.30901699437494745, (real)-0.10452846326765333,
    (real)-0.4999999999999998, (real)-0.8090169943749473, (real)-0.9781476007338057};
const real fl_sectors_34[17] = {
    (real)0.9829730996839018, (real)0.9324722294043558, (real)0.8502171357296142, (real)0.7390089172206591,
    (real)0.6026346363792564, (real)0.4457383557765383, (real)0.273662990072083, (real)0.09226835946330202,
    (real)-0.09226835946330189, (real)-0.2736629900720829, (real)-0.4457383557765378, (real)-0.6026346363792563,
    (real)-0.7390089172206593, (real)-0.850217135729614, (real)-0.9324722294043557, (real)-0.9829730996839018,
    (real)-1.0};

/* Middles of the cells of the sphere. */
void fl_sphere_centres(real centres[100][3])
{
    for (int band = 0; band < 6; band++) {
        const real step = 2 * FL_PI / fl_bands[band], turn = fl_cos(step), slant = fl_sin(step);
        const real z = band == 0 ? 1 : band == 5 ? -1 : 1 - (real)0.02 * (fl_band_starts[band] + (real)fl_bands[band] / 2);
        const real across = fl_sqrt(1 - z * z);
        real x = across * fl_cos(step / 2), y = across * fl_sin(step / 2);
        for (int cell = fl_band_starts[band]; cell < fl_band_starts[band] + fl_bands[band]; cell++) {
            centres[cell][0] = x, centres[cell][1] = y, centres[cell][2] = z;
            const real next = x * turn - y * slant;
            y = y * turn + x * slant;
            x = next;
        }
    }
}

/* Cells of space: sums of their readings, later the directions of their means, and how many readings each has. */
typedef struct {
    real *x, *y, *z, *readings;
    real *off; /* how far they are from a surface, over its size there */
    size_t n;
} spots;

/* Room for so many cells in a part of memory. */
static spots spots_in(real *memory, size_t apart)
{
    const spots all = {memory, memory + apart, memory + 2 * apart, memory + 3 * apart, memory + 4 * apart, 0};
    return all;
}

/* The cells of a room, with the sums of their readings, behind its table. No branch depends on a slot: which are free is
 * random. */
static spots gather_cells(const fl_room *room)
{
    spots all = spots_in(room->cells + 4 * FL_TABLE, AXIS_STRIDE);
    for (size_t slot = 0; slot < room->slots; slot++) {
        const real *const cell = room->cells + 4 * slot;
        all.x[all.n] = cell[1], all.y[all.n] = cell[2], all.z[all.n] = cell[3];
        all.readings[all.n] = cell[0];
        all.n += room->keys[slot] != FL_EMPTY;
    }
    return all;
}

/* Directions from the centre of a surface to means of readings, in place of sums of so many. */
static void turn_to_directions(const fl_surface *surface, size_t n, real *restrict x, real *restrict y, real *restrict z,
                               const real *restrict counts, real *restrict off)
{
    for (size_t i = 0; i < n; i++) {
        const real each = 1 / counts[i];
        const real local[3] = {x[i] * each - surface->centre[0], y[i] * each - surface->centre[1],
                               z[i] * each - surface->centre[2]};
        real unit[3];
        fl_sym3_apply(surface->inverse, local, unit);
        const real length = fl_sqrt(unit[0] * unit[0] + unit[1] * unit[1] + unit[2] * unit[2]);
        const real shorter = length > 0 ? 1 / length : 0;
        off[i] = fl_abs(length - 1);
        x[i] = unit[0] * shorter, y[i] = unit[1] * shorter, z[i] = unit[2] * shorter;
    }
}

/* Keep the directions of cells within a distance of the surface; all where none is. */
static void keep_near(const fl_surface *surface, real within, spots *all)
{
    size_t n = 0;
    real half[3];
    fl_sym3_values(surface->shape, half);
    for (size_t i = 0; i < all->n; i++) {
        if (!(all->off[i] * half[0] <= within)) continue;
        all->x[n] = all->x[i], all->y[n] = all->y[i], all->z[n] = all->z[i], all->readings[n] = all->readings[i];
        n++;
    }
    all->n = n > 0 ? n : all->n;
}

/* A cell of the sphere: its readings, and the direction that is nearest to its middle, by the cosine between them; -2
 * where there is none. */
typedef struct {
    real middle[3], readings, cosine;
    size_t nearest;
} sector;

/* Sort directions into the cells of the sphere. */
static void fill_sectors(const fl_kernels *kernels, const spots *all, sector sectors[SECTORS])
{
    uint32_t cells[FL_BLOCK];
    real middles[SECTORS][3];
    memset(sectors, 0, SECTORS * sizeof *sectors);
    fl_sphere_centres(middles);
    for (int k = 0; k < SECTORS; k++) memcpy(sectors[k].middle, middles[k], sizeof middles[k]), sectors[k].cosine = -2;
    for (size_t begin = 0; begin < all->n; begin += FL_BLOCK) {
        const size_t m = all->n - begin < FL_BLOCK ? all->n - begin : FL_BLOCK;
        kernels->cells(all->x + begin, all->y + begin, all->z + begin, m, cells);
        for (size_t i = begin; i < begin + m; i++) {
            sector *const in = sectors + cells[i - begin];
            const real cosine = in->middle[0] * all->x[i] + in->middle[1] * all->y[i] + in->middle[2] * all->z[i];
            in->nearest = cosine > in->cosine ? i : in->nearest;
            in->cosine = cosine > in->cosine ? cosine : in->cosine;
            in->readings += all->readings[i];
        }
    }
}

/* The largest gap: the middle of a cell farthest from all directions, and the cosine to the nearest one. Directions that
 * are nearest to the middle of their cell rule most of them out. */
static real largest_gap(const fl_kernels *kernels, const spots *all, const sector sectors[SECTORS], real hole[3])
{
    real central[3][SECTORS];
    size_t count = 0;
    const sector *emptiest = sectors;
    for (const sector *one = sectors; one < sectors + SECTORS; one++) {
        const size_t i = one->nearest;
        if (one->cosine < emptiest->cosine) emptiest = one;
        if (one->cosine == -2) continue;
        central[0][count] = all->x[i], central[1][count] = all->y[i], central[2][count++] = all->z[i];
    }
    real farthest = kernels->nearest(emptiest->middle, all->x, all->y, all->z, all->n) + FL_ROUNDING; /* so that it counts itself */
    for (const sector *one = sectors; one < sectors + SECTORS; one++) {
        if (one->cosine > farthest) continue;
        if (kernels->nearest(one->middle, central[0], central[1], central[2], count) > farthest) continue;
        const real cosine = kernels->nearest(one->middle, all->x, all->y, all->z, all->n);
        if (!(cosine < farthest)) continue;
        farthest = cosine;
        memcpy(hole, one->middle, sizeof one->middle);
    }
    return farthest > 1 ? 1 : farthest;
}

/* Coverage by directions. */
static void cover(const fl_kernels *kernels, const spots *all, flinders_coverage *coverage)
{
    sector sectors[SECTORS];
    real readings = 0, height = 0;
    int seen = 0;
    fill_sectors(kernels, all, sectors);
    for (int k = 0; k < SECTORS; k++) {
        seen += sectors[k].cosine != -2;
        readings += sectors[k].readings, height += sectors[k].readings * sectors[k].middle[2];
        coverage->readings[k] = sectors[k].readings;
    }
    coverage->share = (real)seen / SECTORS;
    coverage->upright = height / (readings > 1 ? readings : 1);
    coverage->hole_deg = fl_acos(largest_gap(kernels, all, sectors, coverage->hole)) * 180 / FL_PI;
}

/* Nothing is known yet. */
static void clear(flinders_coverage *coverage)
{
    memset(coverage, 0, sizeof *coverage);
    coverage->share = coverage->upright = coverage->hole_deg = FL_NOT_A_NUMBER;
    coverage->hole[0] = coverage->hole[1] = coverage->hole[2] = FL_NOT_A_NUMBER;
}

/* Coverage by the cells of a room; those farther than `within` are left out, where it is above zero. */
static void cover_room(const fl_kernels *kernels, const fl_surface *surface, real within, const fl_room *room,
                       flinders_coverage *coverage)
{
    spots all = gather_cells(room);
    turn_to_directions(surface, all.n, all.x, all.y, all.z, all.readings, all.off);
    if (within > 0) keep_near(surface, within + room->side, &all);
    cover(kernels, &all, coverage);
}

/* Share of the sphere that holds a reading, and the largest gap. */
void fl_coverage(const fl_kernels *kernels, const fl_surface *surface, real within, const fl_room *room,
                 flinders_record *record)
{
    flinders_coverage coverage;
    cover_room(kernels, surface, within, room, &coverage);
    record->coverage = coverage.share, record->upright = coverage.upright, record->hole_deg = coverage.hole_deg;
    memcpy(record->hole, coverage.hole, sizeof record->hole);
}

/* Coverage of the sphere by readings. */
int flinders_coverage_of(const real *field, size_t rows, const real centre[3], const real shape[6], real within,
                         void *workspace, size_t size, flinders_coverage *coverage)
{
    const fl_kernels *const kernels = fl_kernels_chosen(0);
    fl_surface surface;
    fl_room room;
    clear(coverage);
    if (fl_surface_of(centre, shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    if (rows == 0) return FLINDERS_OK;
    if (fl_room_of(workspace, size, rows, &room)) return FLINDERS_NO_WORKSPACE;
    const int status = fl_cloud_of_any(kernels, field, rows, &room);
    if (status == FLINDERS_OK) cover_room(kernels, &surface, within, &room, coverage);
    return status;
}

/* Coverage of the sphere by cells of space. */
int flinders_coverage_of_cells(const real *means, const real *readings, size_t cells, real side, const real centre[3],
                               const real shape[6], real within, real *scratch, flinders_coverage *coverage)
{
    fl_surface surface;
    spots all = spots_in(scratch, cells);
    real *const ones = scratch + 5 * cells;
    clear(coverage);
    if (fl_surface_of(centre, shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    for (; all.n < cells; all.n++) {
        const real *const mean = means + 3 * all.n;
        all.x[all.n] = mean[0], all.y[all.n] = mean[1], all.z[all.n] = mean[2];
        all.readings[all.n] = readings[all.n], ones[all.n] = 1;
    }
    turn_to_directions(&surface, all.n, all.x, all.y, all.z, ones, all.off);
    if (within > 0) keep_near(&surface, within + side, &all);
    if (cells > 0) cover(fl_kernels_chosen(0), &all, coverage);
    return FLINDERS_OK;
}

/* Which of the hundred cells of the sphere directions fall into. */
void flinders_cells_of(const real *directions, size_t count, uint32_t *cells)
{
    const fl_kernels *const kernels = fl_kernels_chosen(0);
    real axes[3][FL_BLOCK];
    for (size_t begin = 0; begin < count; begin += FL_BLOCK) {
        const size_t m = count - begin < FL_BLOCK ? count - begin : FL_BLOCK;
        for (size_t i = 0; i < 3 * m; i++) axes[i % 3][i / 3] = directions[3 * begin + i];
        kernels->cells(axes[0], axes[1], axes[2], m, cells + begin);
    }
}

/* The inclination with the sign that the directions of readings show. */
real flinders_facing(const real readings[100], real dip_deg, int32_t *is_open)
{
    real middles[SECTORS][3], all = 0, height = 0;
    int seen = 0;
    fl_sphere_centres(middles);
    for (int k = 0; k < SECTORS; k++)
        seen += readings[k] > 0, all += readings[k], height += readings[k] * middles[k][2];
    return fl_facing(height / (all > 1 ? all : 1), (real)seen / SECTORS, dip_deg, is_open);
}
