/* Whether a sensor was turned at all.
 *
 * Any fit to readings around one point follows their noise. Readings on a surface, a ring or an arc leave their mean
 * empty: in units of their principal standard deviations none comes close to it. Noise, a slow drift and a wobble fill it.
 * The angle of such readings is seen from the centre of the sphere that they belong to, the strength of the field away.
 */
#include "record.h"

enum {
    MIN_READINGS = 20, /* fewer readings do not distinguish a cloud from a surface */
    MAX_AXIS_VALUES = 8,  /* values of an axis and ... */
    MIN_PLACE_READINGS = 4,   /* ... and readings of each place of a sensor at rest that flickers by counts */
    SWEEPS = 3   /* of least squares whose columns are orthogonal but for rounding */
};

#define MAX_CLOUD_WIDTH ((real)0.06) /* largest width over level of a cloud: uniform over a cap, 7 degrees on either side */
#define MAX_TAIL_WIDTHS ((real)4) /* largest distance of a place from the mean, in widths; beyond it is an outlier, or a turn */
#define MAX_BALL_WIDTH ((real)0.2) /* largest width over level of a ball; noise of a fifth of the field is refused in any case */
#define MAX_BALL_TAIL_WIDTHS ((real)6) /* largest distance of a place of a ball from the mean, in widths */
#define MIN_BALL_THICKNESS ((real)0.5) /* smallest ratio of thickness to width of a ball */
#define MAX_INLIER_REACH ((real)0.15) /* farthest place over level, 9 degrees, that is no outlier */
#define MAX_POINT_REACH ((real)0.06) /* farthest place over level, below which no turn in the earth's field fits, whatever its shape */
#define MAX_MIDDLE_SQUARE ((real)0.25) /* largest squared distance from the mean, in deviations, of the middle, for each axis */
#define MIN_MIDDLE_SHARE ((real)0.03) /* smallest share of places in a filled middle: 0.14 of a normal cloud, 0.06 of a flat one, 0 of a surface */
#define MIN_AXIS_THICKNESS ((real)0.05) /* smallest ratio of thickness to width of an axis that counts: a cap of 10 degrees on either side */
#define MAX_CURVE_SCATTER ((real)0.2) /* largest scatter of the distances from the centre of a curve over its radius ... */
#define MAX_CURVE_NOISE_RATIO ((real)0.85) /* ... and over the thickness of the places */
#define MIN_RADIUS_SHARE ((real)0.04) /* smallest radius of a curve over the mean reading; it limits the offset */
#define MIN_VARIATION ((real)1e-9) /* variation, over the largest reading, below which readings are constant */

/* Places from their mean along their principal axes, the thinnest first. */
typedef struct {
    const real *places; /* (n, 3) */
    size_t n;
    real deviations[3]; /* ascending */
    real reach;         /* distance of the farthest place */
} cluster;

/* The size of readings, between the weakest and the strongest field. */
static real level_of(real size, real weakest, real strongest)
{
    const real level = size > weakest ? size : weakest;
    return level < strongest ? level : strongest;
}

/* Different values of an axis, but for rounding. */
static int values_of(const real *means, size_t n, int axis)
{
    real ordered[MAX_AXIS_VALUES * MAX_AXIS_VALUES * MAX_AXIS_VALUES], largest = 0;
    int values = 1;
    for (size_t i = 0; i < n; i++) {
        const real value = means[3 * i + (size_t)axis];
        size_t at = i;
        for (; at > 0 && ordered[at - 1] > value; at--) ordered[at] = ordered[at - 1];
        ordered[at] = value;
        largest = fl_abs(value) > largest ? fl_abs(value) : largest;
    }
    for (size_t i = 1; i < n; i++) values += ordered[i] - ordered[i - 1] > MIN_VARIATION * largest;
    return values;
}

/* Whether readings take a few values only on each axis, and each place many times. */
static int is_coarse(const real *means, size_t n, real readings)
{
    if (n > MAX_AXIS_VALUES * MAX_AXIS_VALUES * MAX_AXIS_VALUES || readings < MIN_PLACE_READINGS * (real)n) return 0;
    for (int axis = 0; axis < 3; axis++)
        if (values_of(means, n, axis) > MAX_AXIS_VALUES) return 0;
    return 1;
}

/* Turn places into principal axes about their mean; returns the size of the mean. */
static real turn_to_axes(real *places, size_t n, cluster *out)
{
    real mean[3] = {0, 0, 0}, products[9] = {0}, values[3], reach = 0;
    for (size_t i = 0; i < 3 * n; i++) mean[i % 3] += places[i] / (real)n;
    for (size_t i = 0; i < 3 * n; i++) places[i] -= mean[i % 3];
    for (const real *place = places; place < places + 3 * n; place += 3) {
        const real square = place[0] * place[0] + place[1] * place[1] + place[2] * place[2];
        reach = square > reach ? square : reach;
        for (int i = 0; i < 9; i++) products[i] += place[i / 3] * place[i % 3] / (real)n;
    }
    fl_eigen(products, 3, values);
    for (real *place = places; place < places + 3 * n; place += 3) {
        const real x = place[0], y = place[1], z = place[2];
        for (int k = 0; k < 3; k++) place[k] = x * products[k] + y * products[3 + k] + z * products[6 + k];
    }
    for (int k = 0; k < 3; k++) out->deviations[k] = values[k] > 0 ? fl_sqrt(values[k]) : 0;
    out->places = places, out->n = n, out->reach = fl_sqrt(reach);
    return fl_sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
}

/* Whether a cluster is small beside the distance of its centre, and no place far off the others. */
static int is_narrow(const cluster *all, real level)
{
    const real width = all->deviations[2];
    const int is_ball = all->deviations[0] > MIN_BALL_THICKNESS * width;
    const real tails = (is_ball ? MAX_BALL_TAIL_WIDTHS : MAX_TAIL_WIDTHS) * width, near = MAX_INLIER_REACH * level;
    return width < (is_ball ? MAX_BALL_WIDTH : MAX_CLOUD_WIDTH) * level && all->reach < (tails > near ? tails : near);
}

/* Whether some places are near the mean, along the axes in which the cluster is not thin. */
static int is_filled(const cluster *all)
{
    size_t close = 0;
    int thick = 0;
    for (int k = 0; k < 3; k++) thick += all->deviations[k] > MIN_AXIS_THICKNESS * all->deviations[2];
    for (size_t i = 0; i < all->n; i++) {
        real square = 0;
        for (int k = 3 - thick; k < 3; k++) {
            const real apart = all->places[3 * i + (size_t)k] / all->deviations[k];
            square += apart * apart;
        }
        close += square < MAX_MIDDLE_SQUARE * (real)thick;
    }
    return (real)close / (real)all->n > MIN_MIDDLE_SHARE;
}

/* Column k of the equations of a sphere for a place, in units of a scale; the last one is 1. */
static real column_of(const real *place, int k, real scale) { return k < 3 ? 2 * place[k] / scale : 1; }

/* Centre, and rest r² - |c|², of the sphere through places by linear least squares, in the axes from `first` on: one after
 * the other, since principal axes are orthogonal. Axes without any width get no part of the centre. */
static void solve_sphere(const cluster *all, int first, real scale, real solution[4])
{
    const real rounding = (sizeof(real) == sizeof(double) ? (real)DBL_EPSILON : (real)FLT_EPSILON) * (real)all->n;
    real largest = 0;
    memset(solution, 0, 4 * sizeof *solution);
    for (int step = 0; step < 4 * SWEEPS; step++) {
        const int k = 3 - step % 4;
        real square = 0, product = 0;
        for (size_t i = 0; i < all->n && k >= first; i++) {
            const real *const place = all->places + 3 * i, own = column_of(place, k, scale);
            real left = -solution[3];
            for (int j = first; j < 3; j++) left += place[j] / scale * (place[j] / scale - 2 * solution[j]);
            square += own * own, product += own * left;
        }
        largest = square > largest ? square : largest;
        if (square > rounding * rounding * largest) solution[k] += product / square;
    }
}

/* Radius of the sphere through places in the axes from `first` on: 0 a sphere, 1 a circle. FL_HUGE where they do not lie
 * closer to it than to a plane. */
static real radius_in(const cluster *all, int first)
{
    real scale = 0, solution[4], mean = 0, scatter = 0, square;
    for (size_t i = 0; i < 3 * all->n; i++) {
        const real size = fl_abs(all->places[i]);
        if ((int)(i % 3) >= first && size > scale) scale = size;
    }
    if (!(scale > 0)) return FL_HUGE;
    solve_sphere(all, first, scale, solution);
    square = solution[3];
    for (int k = first; k < 3; k++) square += solution[k] * solution[k];
    const real radius = scale * fl_sqrt(square > 0 ? square : 0);
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < all->n; i++) {
            real length = 0;
            for (int k = first; k < 3; k++) {
                const real apart = all->places[3 * i + (size_t)k] - scale * solution[k];
                length += apart * apart;
            }
            length = fl_sqrt(length);
            if (pass == 0) mean += length / (real)all->n;
            else scatter += (length - mean) * (length - mean) / (real)all->n;
        }
    const real noise = fl_sqrt(scatter);
    return noise < MAX_CURVE_SCATTER * radius && noise < MAX_CURVE_NOISE_RATIO * all->deviations[first] ? radius : FL_HUGE;
}

/* The angle, in degrees, of places that a sensor at rest was at; NaN of those of a turn. */
static real angle_of(real *means, size_t n, real readings, real weakest, real strongest)
{
    cluster all;
    real largest = 0;
    for (size_t i = 0; i < 3 * n; i++) largest = fl_abs(means[i]) > largest ? fl_abs(means[i]) : largest;
    if (readings < MIN_READINGS || !((real)FL_SMALLEST < largest && largest < (real)FL_LARGEST)) return FL_NOT_A_NUMBER;
    const int is_flickering = is_coarse(means, n, readings);
    const real size = turn_to_axes(means, n, &all);
    if (!(all.reach > MIN_VARIATION * size && size > 0)) return FL_NOT_A_NUMBER;
    real level = level_of(size, weakest, strongest);
    const int is_point = weakest > 0 && size >= weakest && all.reach < MAX_POINT_REACH * level;
    if (!is_point && !is_narrow(&all, level)) return FL_NOT_A_NUMBER; /* and to a lower level it is wider still */
    if (!is_point && !is_flickering) {
        const real sphere = radius_in(&all, 0), circle = radius_in(&all, 1), radius = sphere < circle ? sphere : circle;
        if (radius > MIN_RADIUS_SHARE * size && radius < level) level = radius;
    }
    if (!is_point && !(is_narrow(&all, level) && (is_flickering || is_filled(&all)))) return FL_NOT_A_NUMBER;
    return fl_atan2(all.reach, level) * 180 / FL_PI;
}

/* Whether a sensor was hardly turned, by the means of its readings in each cell. */
int flinders_unmoved_cells(real *means, size_t cells, real readings, real weakest, real strongest, real *angle_deg)
{
    *angle_deg = FL_NOT_A_NUMBER;
    for (size_t i = 0; i < 3 * cells; i++)
        if (!isfinite(means[i])) return FLINDERS_NOT_FINITE;
    if (cells > 0) *angle_deg = angle_of(means, cells, readings, weakest, strongest);
    return FLINDERS_OK;
}

/* Whether a sensor was hardly turned, by its readings. */
int flinders_unmoved(const real *field, size_t rows, real weakest, real strongest, void *workspace, size_t size,
                     real *angle_deg)
{
    size_t n = 0;
    fl_room room;
    *angle_deg = FL_NOT_A_NUMBER;
    if (rows == 0) return FLINDERS_OK;
    if (fl_room_of(workspace, size, rows, &room)) return FLINDERS_NO_WORKSPACE;
    const int status = fl_cloud_of_any(fl_kernels_chosen(0), field, rows, &room);
    if (status != FLINDERS_OK) return status;
    real *const means = room.cells + 4 * FL_TABLE;
    for (size_t slot = 0; slot < room.slots; slot++) {
        const real *const cell = room.cells + 4 * slot;
        if (room.keys[slot] == FL_EMPTY) continue;
        for (int axis = 0; axis < 3; axis++) means[3 * n + (size_t)axis] = cell[1 + axis] / cell[0];
        n++;
    }
    return flinders_unmoved_cells(means, n, (real)rows, weakest, strongest, angle_deg);
}

/* Whether records show a turn out of one plane by themselves. */
void flinders_turned(const flinders_record *records, size_t count, real weakest, real strongest, unsigned char *turned)
{
    for (size_t i = 0; i < count; i++) {
        const real *const mean = records[i].mean, *const variances = records[i].principal_variances;
        const real size = fl_sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
        const real narrow = MAX_BALL_WIDTH * level_of(size, weakest, strongest);
        turned[i] = variances[2] > narrow * narrow && variances[0] > FL_FLATTEST * FL_FLATTEST * variances[2] &&
            records[i].rails == 0;
    }
}
