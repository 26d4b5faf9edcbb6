/* Sums over readings, in blocks of 64 with eight independent lanes: they vectorise without -ffast-math.
 *
 * The order of every addition is written down here, and the compiler may not fuse a product with a sum
 * (-ffp-contract=off), so the digits are the same on every platform. This file is compiled once for the
 * baseline of the processor and, on x86-64, once more for AVX2 (FL_VARIANT names the functions).
 */
#include "internal.h"

#ifndef FL_VARIANT
#define FL_VARIANT baseline
#endif
#define FL_JOIN_(a, b) a##_##b
#define FL_JOIN(a, b) FL_JOIN_(a, b)

typedef struct {
    size_t row, seen;
} cursor;

/* Copy the next readings of a view axis by axis, and repeat the first of them up to a full block; count them. */
static size_t gather(const fl_view *view, cursor *at, real block[3][FL_BLOCK])
{
    size_t m = 0;
    if (!view->rejected) {
        const size_t left = at->row < view->rows ? (view->rows - at->row + view->stride - 1) / view->stride : 0;
        const real *field = view->field + 3 * at->row;
        m = left < FL_BLOCK ? left : FL_BLOCK;
        if (view->stride == 1)
            for (size_t i = 0; i < m; i++)
                block[0][i] = field[3 * i], block[1][i] = field[3 * i + 1], block[2][i] = field[3 * i + 2];
        else
            for (size_t i = 0; i < m; i++, field += 3 * view->stride)
                block[0][i] = field[0], block[1][i] = field[1], block[2][i] = field[2];
        at->row += m * view->stride;
    } else {
        for (; at->row < view->rows && m < FL_BLOCK; at->row++) {
            if (view->rejected[at->row]) continue;
            if (view->stride > 1 && at->seen++ % view->stride) continue;
            for (int axis = 0; axis < 3; axis++) block[axis][m] = view->field[3 * at->row + axis];
            m++;
        }
    }
    for (size_t i = m; m && i < FL_BLOCK; i++)
        for (int axis = 0; axis < 3; axis++) block[axis][i] = block[axis][0];
    return m;
}

/* Add the products of two rows of a block, lane by lane. */
static inline void add_product(const real *restrict a, const real *restrict b, real *restrict lanes)
{
    real sum[FL_LANES];
    for (int lane = 0; lane < FL_LANES; lane++) sum[lane] = a[lane] * b[lane];
    for (int i = FL_LANES; i < FL_BLOCK; i += FL_LANES)
        for (int lane = 0; lane < FL_LANES; lane++) sum[lane] += a[i + lane] * b[i + lane];
    for (int lane = 0; lane < FL_LANES; lane++) lanes[lane] += sum[lane];
}

/* Add up lanes in a fixed order: the halves, and the halves of their sums. */
static inline real total(const real lanes[FL_LANES])
{
#ifdef FLINDERS_SMALL
    return lanes[0];
#else
    return ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]));
#endif
}

/* Take the rows behind the m-th reading of a block out of all sums. */
static void clear_rest(real *rows, int n, size_t m)
{
    for (int row = 0; row < n; row++)
        for (size_t i = m; i < FL_BLOCK; i++) rows[row * FL_BLOCK + i] = 0;
}

/* Which two rows of 1, x, y, z, xx, yy, zz, xy, xz, yz make each of the 35 sums. */
static const unsigned char POWER[35][2] = {
    {0, 0}, {0, 1}, {0, 2}, {0, 3}, {0, 4}, {0, 7}, {0, 5}, {0, 8}, {0, 9}, {0, 6}, {1, 4}, {1, 7},
    {1, 5}, {2, 5}, {1, 8}, {1, 9}, {2, 9}, {1, 6}, {2, 6}, {3, 6}, {4, 4}, {4, 7}, {4, 5}, {5, 7},
    {5, 5}, {4, 8}, {4, 9}, {5, 8}, {5, 9}, {4, 6}, {6, 7}, {5, 6}, {6, 8}, {6, 9}, {6, 6}};

/* Sums of xⁱyʲzᵏ of (x − origin)/unit up to degree four, in the order of `flinders_sums`; returns the readings. */
static size_t powers(const fl_view *view, const real origin[3], real unit, real sums[35])
{
    real lanes[35][FL_LANES] = {{0}}, rows[10][FL_BLOCK], block[3][FL_BLOCK];
    const real finer = 1 / unit;
    size_t count = 0, m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        for (int i = 0; i < FL_BLOCK; i++) {
            const real x = (block[0][i] - origin[0]) * finer, y = (block[1][i] - origin[1]) * finer,
                       z = (block[2][i] - origin[2]) * finer;
            rows[0][i] = 1, rows[1][i] = x, rows[2][i] = y, rows[3][i] = z;
            rows[4][i] = x * x, rows[5][i] = y * y, rows[6][i] = z * z;
            rows[7][i] = x * y, rows[8][i] = x * z, rows[9][i] = y * z;
        }
        if (m < FL_BLOCK) clear_rest(rows[0], 10, m);
        for (int sum = 0; sum < 35; sum++) add_product(rows[POWER[sum][0]], rows[POWER[sum][1]], lanes[sum]);
        count += m;
    }
    for (int sum = 0; sum < 35; sum++) sums[sum] = total(lanes[sum]);
    return count;
}

/* The Jacobian at the foot point on the surface, Sampson distance, and the direction of the foot point, of one block. */
static void linearized(const real block[3][FL_BLOCK], const fl_surface *surface, real rows[13][FL_BLOCK])
{
    const real xx = surface->inverse[0], yy = surface->inverse[1], zz = surface->inverse[2];
    const real xy = surface->inverse[3], xz = surface->inverse[4], yz = surface->inverse[5];
    const real bx = surface->centre[0], by = surface->centre[1], bz = surface->centre[2];
    for (int i = 0; i < FL_BLOCK; i++) {
        const real dx = block[0][i] - bx, dy = block[1][i] - by, dz = block[2][i] - bz;
        const real px = xx * dx + xy * dy + xz * dz, py = xy * dx + yy * dy + yz * dz, pz = xz * dx + yz * dy + zz * dz;
        const real qx = xx * px + xy * py + xz * pz, qy = xy * px + yy * py + yz * pz, qz = xz * px + yz * py + zz * pz;
        const real length = fl_sqrt(px * px + py * py + pz * pz), square = qx * qx + qy * qy + qz * qz;
        const real move = (length - 1) * length / (square > FL_TINY ? square : FL_TINY); /* to the foot point, along q */
        const real fx = px - (xx * qx + xy * qy + xz * qz) * move, fy = py - (xy * qx + yy * qy + yz * qz) * move,
                   fz = pz - (xz * qx + yz * qy + zz * qz) * move;
        const real gx = xx * fx + xy * fy + xz * fz, gy = xy * fx + yy * fy + yz * fz, gz = xz * fx + yz * fy + zz * fz;
        const real at_foot = fl_sqrt(fx * fx + fy * fy + fz * fz), steep = fl_sqrt(gx * gx + gy * gy + gz * gz);
        const real product = at_foot * steep, both = 1 / (product > FL_TINY ? product : FL_TINY);
        const real nx = gx * (both * at_foot), ny = gy * (both * at_foot), nz = gz * (both * at_foot);
        const real vx = fx * (both * steep), vy = fy * (both * steep), vz = fz * (both * steep);
        rows[0][i] = nx, rows[1][i] = ny, rows[2][i] = nz;
        rows[3][i] = nx * vx, rows[4][i] = ny * vy, rows[5][i] = nz * vz;
        rows[6][i] = nx * vy + ny * vx, rows[7][i] = nx * vz + nz * vx, rows[8][i] = ny * vz + nz * vy;
        rows[9][i] = move * fl_sqrt(square);
        rows[10][i] = vx, rows[11][i] = vy, rows[12][i] = vz;
    }
}

/* Sampson distance and minus its own gradient at the reading itself, of one block. */
static void differentiated(const real block[3][FL_BLOCK], const fl_surface *surface, real rows[13][FL_BLOCK])
{
    const real xx = surface->inverse[0], yy = surface->inverse[1], zz = surface->inverse[2];
    const real xy = surface->inverse[3], xz = surface->inverse[4], yz = surface->inverse[5];
    const real bx = surface->centre[0], by = surface->centre[1], bz = surface->centre[2];
    for (int i = 0; i < FL_BLOCK; i++) {
        const real dx = block[0][i] - bx, dy = block[1][i] - by, dz = block[2][i] - bz;
        const real px = xx * dx + xy * dy + xz * dz, py = xy * dx + yy * dy + yz * dz, pz = xz * dx + yz * dy + zz * dz;
        real length = fl_sqrt(px * px + py * py + pz * pz);
        length = length > FL_SHORT ? length : FL_SHORT;
        const real ux = px / length, uy = py / length, uz = pz / length;
        real nx = xx * ux + xy * uy + xz * uz, ny = xy * ux + yy * uy + yz * uz, nz = xz * ux + yz * uy + zz * uz;
        real steepness = fl_sqrt(nx * nx + ny * ny + nz * nz);
        steepness = steepness > FL_SHORT ? steepness : FL_SHORT;
        nx /= steepness, ny /= steepness, nz /= steepness;
        const real s = (length - 1) / steepness;
        const real kx = xx * nx + xy * ny + xz * nz, ky = xy * nx + yy * ny + yz * nz, kz = xz * nx + yz * ny + zz * nz;
        const real along = ux * kx + uy * ky + uz * kz;
        const real ax = kx - ux * along, ay = ky - uy * along, az = kz - uz * along;
        const real tx = (xx * ax + xy * ay + xz * az) / steepness, ty = (xy * ax + yy * ay + yz * az) / steepness,
                   tz = (xz * ax + yz * ay + zz * az) / steepness;
        const real wx = nx * length - s * tx, wy = ny * length - s * ty, wz = nz * length - s * tz;
        rows[0][i] = nx - tx * (s / length), rows[1][i] = ny - ty * (s / length), rows[2][i] = nz - tz * (s / length);
        rows[3][i] = wx * ux - s * kx * nx, rows[4][i] = wy * uy - s * ky * ny, rows[5][i] = wz * uz - s * kz * nz;
        rows[6][i] = wx * uy + wy * ux - s * (kx * ny + ky * nx);
        rows[7][i] = wx * uz + wz * ux - s * (kx * nz + kz * nx);
        rows[8][i] = wy * uz + wz * uy - s * (ky * nz + kz * ny);
        rows[9][i] = s;
    }
}

/* Add the products of all pairs of ten rows of a block. */
static void add_products(const real rows[10][FL_BLOCK], real lanes[55][FL_LANES])
{
    for (int a = 0, sum = 0; a < 10; a++)
        for (int b = a; b < 10; b++) add_product(rows[a], rows[b], lanes[sum++]);
}

/* Upper triangle of Σ (J, s)(J, s)ᵀ, row by row, J at the foot points or exact; returns the readings. */
static size_t products(const fl_view *view, const fl_surface *surface, int exact, real sums[55])
{
    real lanes[55][FL_LANES] = {{0}}, rows[13][FL_BLOCK], block[3][FL_BLOCK];
    size_t count = 0, m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        (exact ? differentiated : linearized)((const real(*)[FL_BLOCK])block, surface, rows);
        if (m < FL_BLOCK) clear_rest(rows[0], 10, m);
        add_products((const real(*)[FL_BLOCK])rows, lanes);
        count += m;
    }
    for (int sum = 0; sum < 55; sum++) sums[sum] = total(lanes[sum]);
    return count;
}

/* Σ J ½∇²s on the surface at each reading, the mean gradient from noise over σ². */
static void curvature(const fl_view *view, const fl_surface *surface, real gradient[9])
{
    const real xx = surface->inverse[0], yy = surface->inverse[1], zz = surface->inverse[2];
    const real xy = surface->inverse[3], xz = surface->inverse[4], yz = surface->inverse[5];
    const real trace = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz);
    real lanes[9][FL_LANES] = {{0}}, rows[10][FL_BLOCK], block[3][FL_BLOCK];
    size_t m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        for (int i = 0; i < FL_BLOCK; i++) {
            const real dx = block[0][i] - surface->centre[0], dy = block[1][i] - surface->centre[1],
                       dz = block[2][i] - surface->centre[2];
            real ux = xx * dx + xy * dy + xz * dz, uy = xy * dx + yy * dy + yz * dz, uz = xz * dx + yz * dy + zz * dz;
            real length = fl_sqrt(ux * ux + uy * uy + uz * uz);
            length = length > FL_SHORT ? length : FL_SHORT;
            const real per_length = 1 / length;
            ux *= per_length, uy *= per_length, uz *= per_length;
            const real nx = xx * ux + xy * uy + xz * uz, ny = xy * ux + yy * uy + yz * uz,
                       nz = xz * ux + yz * uy + zz * uz;
            const real kx = xx * nx + xy * ny + xz * nz, ky = xy * nx + yy * ny + yz * nz,
                       kz = xz * nx + yz * ny + zz * nz;
            real k1 = nx * nx + ny * ny + nz * nz;
            k1 = k1 > FL_SHORT ? k1 : FL_SHORT;
            const real k2 = kx * kx + ky * ky + kz * kz;
            const real factor = ((trace - k1) - 2 * (k2 - k1 * k1) / k1) / (2 * k1);
            rows[0][i] = nx, rows[1][i] = ny, rows[2][i] = nz;
            rows[3][i] = nx * ux, rows[4][i] = ny * uy, rows[5][i] = nz * uz;
            rows[6][i] = nx * uy + ny * ux, rows[7][i] = nx * uz + nz * ux, rows[8][i] = ny * uz + nz * uy;
            rows[9][i] = factor;
        }
        if (m < FL_BLOCK) clear_rest(rows[0], 10, m);
        for (int row = 0; row < 9; row++) add_product(rows[row], rows[9], lanes[row]);
    }
    for (int row = 0; row < 9; row++) gradient[row] = total(lanes[row]);
}

/* Derivatives of the Jacobian along a tangent t of the surface, of one reading: Jacobian of A A t less its part along the
 * normal, times the flatness 1/|A u|, and of the normal with A t instead of u. */
static inline void turned(const real a[6], const real n[3], const real u[3], real flatness, const real t[3],
                          real rows[9][FL_BLOCK], int i)
{
    const real wx = a[0] * t[0] + a[3] * t[1] + a[4] * t[2], wy = a[3] * t[0] + a[1] * t[1] + a[5] * t[2],
               wz = a[4] * t[0] + a[5] * t[1] + a[2] * t[2];
    real vx = a[0] * wx + a[3] * wy + a[4] * wz, vy = a[3] * wx + a[1] * wy + a[5] * wz,
         vz = a[4] * wx + a[5] * wy + a[2] * wz;
    const real along = n[0] * vx + n[1] * vy + n[2] * vz;
    vx = (vx - n[0] * along) * flatness, vy = (vy - n[1] * along) * flatness, vz = (vz - n[2] * along) * flatness;
    rows[0][i] = vx, rows[1][i] = vy, rows[2][i] = vz;
    rows[3][i] = vx * u[0] + n[0] * wx, rows[4][i] = vy * u[1] + n[1] * wy, rows[5][i] = vz * u[2] + n[2] * wz;
    rows[6][i] = vx * u[1] + vy * u[0] + n[0] * wy + n[1] * wx;
    rows[7][i] = vx * u[2] + vz * u[0] + n[0] * wz + n[2] * wx;
    rows[8][i] = vy * u[2] + vz * u[1] + n[1] * wz + n[2] * wy;
}

/* Lower triangle of the spurious part of Σ J Jᵀ for a noise variance of 1; returns the number of readings. Tangents
 * as in T. Duff et al., JCGT 6 (2017). */
static size_t spurious(const fl_view *view, const fl_surface *surface, real sums[45])
{
    const real *const a = surface->inverse;
    real lanes[45][FL_LANES] = {{0}}, rows[2][9][FL_BLOCK], block[3][FL_BLOCK];
    size_t count = 0, m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        for (int i = 0; i < FL_BLOCK; i++) {
            const real dx = block[0][i] - surface->centre[0], dy = block[1][i] - surface->centre[1],
                       dz = block[2][i] - surface->centre[2];
            const real px = a[0] * dx + a[3] * dy + a[4] * dz, py = a[3] * dx + a[1] * dy + a[5] * dz,
                       pz = a[4] * dx + a[5] * dy + a[2] * dz;
            const real size = fl_sqrt(px * px + py * py + pz * pz), per_length = 1 / (size > FL_SHORT ? size : FL_SHORT);
            const real u[3] = {px * per_length, py * per_length, pz * per_length};
            const real qx = a[0] * u[0] + a[3] * u[1] + a[4] * u[2], qy = a[3] * u[0] + a[1] * u[1] + a[5] * u[2],
                       qz = a[4] * u[0] + a[5] * u[1] + a[2] * u[2];
            const real steep = fl_sqrt(qx * qx + qy * qy + qz * qz), flatness = 1 / (steep > FL_SHORT ? steep : FL_SHORT);
            const real n[3] = {qx * flatness, qy * flatness, qz * flatness};
            const real side = n[2] < 0 ? -1 : 1, over = -1 / (side + n[2]), both = n[0] * n[1] * over;
            const real is_off = size > FL_SHORT ? 1 : 0; /* not right in the centre */
            const real first[3] = {is_off * (1 + side * n[0] * n[0] * over), is_off * side * both, -is_off * side * n[0]};
            const real second[3] = {is_off * both, is_off * (side + n[1] * n[1] * over), -is_off * n[1]};
            turned(a, n, u, flatness, first, rows[0], i);
            turned(a, n, u, flatness, second, rows[1], i);
        }
        if (m < FL_BLOCK) clear_rest(rows[0][0], 18, m);
        for (int t = 0; t < 2; t++)
            for (int i = 0, sum = 0; i < 9; i++)
                for (int j = 0; j <= i; j++) add_product(rows[t][i], rows[t][j], lanes[sum++]);
        count += m;
    }
    for (int sum = 0; sum < 45; sum++) sums[sum] = total(lanes[sum]);
    return count;
}

/* Sampson distances of one block, outside positive, in the unit of the readings. */
static inline void sampson(const real block[3][FL_BLOCK], const fl_surface *surface, real s[FL_BLOCK])
{
    const real xx = surface->inverse[0], yy = surface->inverse[1], zz = surface->inverse[2];
    const real xy = surface->inverse[3], xz = surface->inverse[4], yz = surface->inverse[5];
    const real bx = surface->centre[0], by = surface->centre[1], bz = surface->centre[2];
    for (int i = 0; i < FL_BLOCK; i++) {
        const real dx = block[0][i] - bx, dy = block[1][i] - by, dz = block[2][i] - bz;
        const real px = xx * dx + xy * dy + xz * dz, py = xy * dx + yy * dy + yz * dz, pz = xz * dx + yz * dy + zz * dz;
        real length = fl_sqrt(px * px + py * py + pz * pz);
        length = length > FL_SHORT ? length : FL_SHORT;
        const real nx = xx * px + xy * py + xz * pz, ny = xy * px + yy * py + yz * pz, nz = xz * px + yz * py + zz * pz;
        const real steepness = fl_sqrt(nx * nx + ny * ny + nz * nz), least = FL_SHORT * length;
        s[i] = (length - 1) * length / (steepness > least ? steepness : least);
    }
}

/* (N,) Sampson distances. */
static void distances(const fl_view *view, const fl_surface *surface, real *out)
{
    real block[3][FL_BLOCK], s[FL_BLOCK];
    size_t m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        sampson((const real(*)[FL_BLOCK])block, surface, s);
        memcpy(out, s, m * sizeof(real));
        out += m;
    }
}

/* Whether at least `fewest` readings are closer to the surface than a limit; stops where too few are left. */
static int has_closer(const fl_view *view, const fl_surface *surface, real limit, size_t fewest)
{
    real block[3][FL_BLOCK], s[FL_BLOCK];
    size_t m, left = fl_view_count(view), close = 0;
    cursor at = {0, 0};
    while (close + left >= fewest && (m = gather(view, &at, block)) > 0) {
        sampson((const real(*)[FL_BLOCK])block, surface, s);
        for (size_t i = 0; i < m; i++) close += fl_abs(s[i]) < limit;
        left -= m;
    }
    return close >= fewest;
}

/* Sum of their squares. */
static real cost(const fl_view *view, const fl_surface *surface)
{
    real block[3][FL_BLOCK], s[FL_BLOCK], lanes[FL_LANES] = {0};
    size_t m;
    cursor at = {0, 0};
    while ((m = gather(view, &at, block)) > 0) {
        sampson((const real(*)[FL_BLOCK])block, surface, s);
        for (size_t i = m; i < FL_BLOCK; i++) s[i] = 0;
        add_product(s, s, lanes);
    }
    return total(lanes);
}

/* Jacobian and distance of each reading, from a place of their columns on, and its direction into (3, FL_LOOKED), at the
 * foot points: at a reading itself, on a surface that is no sphere, all would follow the noise that is in its distance.
 * Returns the readings. */
static size_t columns(const fl_view *view, const fl_surface *surface, size_t begin, real *const *out, real *directions)
{
    real block[3][FL_BLOCK], rows[13][FL_BLOCK];
    size_t m, end = begin;
    cursor at = {0, 0};
    for (; (m = gather(view, &at, block)) > 0; end += m) {
        linearized((const real(*)[FL_BLOCK])block, surface, rows);
        for (int row = 0; row < 10; row++) memcpy(out[row] + end, rows[row], m * sizeof(real));
        for (int axis = 0; axis < 3; axis++)
            memcpy(directions + axis * FL_LOOKED + end, rows[10 + axis], m * sizeof(real));
    }
    return end - begin;
}

/* What the square and the cube of each axis' distance from the centre, over the radius, add to the distance from the
 * surface: six columns, at directions (3, FL_LOOKED) with normals in three columns. */
static void nonlinear(const fl_surface *surface, const real *directions, size_t n, real *const *normals, real *const *out)
{
    static const unsigned char ENTRY[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};
    const real *const x = directions, *const y = directions + FL_LOOKED, *const z = directions + 2 * FL_LOOKED;
    const real per_radius = 1 / surface->radius;
    for (int axis = 0; axis < 3; axis++) {
        const unsigned char *entry = ENTRY[axis];
        const real sx = surface->shape[entry[0]], sy = surface->shape[entry[1]], sz = surface->shape[entry[2]];
        const real *const normal = normals[axis];
        real *restrict const square = out[axis], *restrict const cube = out[3 + axis];
        for (size_t i = 0; i < n; i++) {
            const real local = sx * x[i] + sy * y[i] + sz * z[i], t = local * per_radius, squared = local * t;
            square[i] = normal[i] * squared, cube[i] = normal[i] * (squared * t);
        }
    }
}

/* Take what columns explain off distances. */
static void take_off(real *const *columns_of, size_t n, int width, const real *solution, const real *from, real *to)
{
    for (size_t begin = 0; begin < n; begin += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        real explained[FL_BLOCK] = {0};
        for (int a = 0; a < width; a++)
            for (size_t i = 0; i < m; i++) explained[i] += columns_of[a][begin + i] * solution[a];
        for (size_t i = 0; i < m; i++) to[begin + i] = from[begin + i] - explained[i];
    }
}

/* Products of n columns, a symmetric matrix, over readings from a row on. */
static void gram(real *const *columns_of, size_t begin, size_t n, int count, real *matrix)
{
    real lanes[FL_COLUMNS * (FL_COLUMNS + 1) / 2][FL_LANES], rest[FL_COLUMNS][FL_BLOCK];
    const real *of[FL_COLUMNS];
    memset(lanes, 0, (size_t)(count * (count + 1) / 2) * sizeof *lanes);
    for (size_t done = 0; done < n; done += FL_BLOCK) {
        const size_t m = n - done < FL_BLOCK ? n - done : FL_BLOCK;
        for (int a = 0; a < count; a++) {
            of[a] = m < FL_BLOCK ? rest[a] : columns_of[a] + begin + done;
            if (m < FL_BLOCK) memcpy(rest[a], columns_of[a] + begin + done, m * sizeof(real));
        }
        if (m < FL_BLOCK) clear_rest(rest[0], count, m);
        for (int a = 0, pair = 0; a < count; a++)
            for (int b = a; b < count; b++, pair++) add_product(of[a], of[b], lanes[pair]);
    }
    for (int a = 0, pair = 0; a < count; a++)
        for (int b = a; b < count; b++, pair++) matrix[count * a + b] = matrix[count * b + a] = total(lanes[pair]);
}

/* Add w c(i + lag) of a column over lags to up to a block of sums, the column so many readings from its end. */
static void add_ahead(const real *column, size_t left, const int *lags, const real *weights, int count,
                      real *restrict sums)
{
    int k = 0;
    for (; k + 4 <= count && (size_t)lags[k + 3] + FL_BLOCK <= left; k += 4) {
        const real *const a = column + lags[k], *const b = column + lags[k + 1], *const c = column + lags[k + 2],
                   *const d = column + lags[k + 3];
        const real of_a = weights[k], of_b = weights[k + 1], of_c = weights[k + 2], of_d = weights[k + 3];
        for (int i = 0; i < FL_BLOCK; i++) sums[i] = sums[i] + of_a * a[i] + of_b * b[i] + of_c * c[i] + of_d * d[i];
    }
    for (; k < count && (size_t)lags[k] < left; k++) {
        const real *const later = column + lags[k], weight = weights[k];
        const size_t rest = left - (size_t)lags[k], most = rest < FL_BLOCK ? rest : FL_BLOCK;
        for (size_t i = 0; i < most; i++) sums[i] += weight * later[i];
    }
}

/* Add Σ J(i) Aᵀ over the columns of n consecutive readings from a place on, A the sum of w J(i + lag) over lags, which
 * ascend, with their weights w. */
static void lagged(real *const *columns_of, size_t begin, size_t n, int width, const int *lags, const real *weights,
                   int count, real *product)
{
    real here[FL_WIDEST][FL_BLOCK], ahead[FL_WIDEST][FL_BLOCK];
    for (size_t done = 0; done < n; done += FL_BLOCK) {
        const size_t left = n - done, m = left < FL_BLOCK ? left : FL_BLOCK;
        memset(here, 0, sizeof here);
        memset(ahead, 0, sizeof ahead);
        for (int a = 0; a < width; a++) {
            const real *const column = columns_of[a] + begin + done;
            memcpy(here[a], column, m * sizeof(real));
            add_ahead(column, left, lags, weights, count, ahead[a]);
        }
        for (int a = 0; a < width; a++)
            for (int b = 0; b < width; b++) {
                real lanes[FL_LANES] = {0};
                add_product(here[a], ahead[b], lanes);
                product[width * a + b] += total(lanes);
            }
    }
}

/* Largest cosine between a direction and others. */
static real nearest(const real direction[3], const real *x, const real *y, const real *z, size_t n)
{
    const real u = direction[0], v = direction[1], w = direction[2];
    real cosines[FL_BLOCK], best[FL_LANES], most = -1;
    for (int lane = 0; lane < FL_LANES; lane++) best[lane] = -1;
    for (size_t begin = 0; begin < n; begin += FL_BLOCK, x += FL_BLOCK, y += FL_BLOCK, z += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        for (size_t i = 0; i < m; i++) cosines[i] = u * x[i] + v * y[i] + w * z[i];
        for (size_t i = m; i < FL_BLOCK; i++) cosines[i] = -1;
        for (int i = 0; i < FL_BLOCK; i += FL_LANES)
            for (int lane = 0; lane < FL_LANES; lane++)
                best[lane] = cosines[i + lane] > best[lane] ? cosines[i + lane] : best[lane];
    }
    for (int lane = 0; lane < FL_LANES; lane++) most = best[lane] > most ? best[lane] : most;
    return most;
}

/* How many borders between the sectors of half a band directions at so large x of a radius are to the left of. */
static inline void pass_sectors(const real *begins, int n, const real *restrict x, const real *restrict radius,
                                real *restrict passed)
{
    for (int i = 0; i < FL_BLOCK; i++) {
        real count = 0;
        for (int k = 0; k < n; k++) count += x[i] < radius[i] * begins[k] ? 1 : 0;
        passed[i] = count;
    }
}

/* Which of a hundred equal cells of the sphere directions fall into. Where y >= 0 a direction on a border is beyond it:
 * there x and radius are turned round, and borders counted that are still to come. */
static void cells(const real *x, const real *y, const real *z, size_t n, uint32_t *out)
{
    real block[3][FL_BLOCK] = {{0}}, radius[FL_BLOCK], of_15[FL_BLOCK], of_34[FL_BLOCK], bands[FL_BLOCK];
    for (size_t begin = 0; begin < n; begin += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        memcpy(block[0], x + begin, m * sizeof(real));
        memcpy(block[1], y + begin, m * sizeof(real));
        memcpy(block[2], z + begin, m * sizeof(real));
        for (int i = 0; i < FL_BLOCK; i++) {
            const real side = block[1][i] >= 0 ? -1 : 1;
            radius[i] = side * fl_sqrt(block[0][i] * block[0][i] + block[1][i] * block[1][i]);
            block[0][i] *= side;
            bands[i] = 0;
            for (int edge = 0; edge < 5; edge++) bands[i] += fl_band_edges[edge] > block[2][i] ? 1 : 0;
        }
        pass_sectors(fl_sectors_15, 7, block[0], radius, of_15);
        pass_sectors(fl_sectors_34, 17, block[0], radius, of_34);
        for (size_t i = 0; i < m; i++) {
            const int band = (int)bands[i], sectors = fl_bands[band];
            const int passed = (int)(sectors == 34 ? of_34[i] : of_15[i]);
            const int sector = (block[1][i] >= 0 ? sectors / 2 : sectors - 1) - passed;
            out[begin + i] = (uint32_t)(fl_band_starts[band] + (sectors > 1 && radius[i] != 0 ? sector : 0));
        }
    }
}

/* Eight models of noise side by side: variance and state of the disturbance, and the innovations of a few rows. Inner
 * loops go over the models and no further, else compilers shuffle numbers. */
enum { BATCH_ROWS = 6, FACTORS = sizeof(real) == sizeof(double) ? 5 * BATCH_ROWS : BATCH_ROWS, /* of a product that stays a number */
       HALF_LANES = (FL_LANES + 1) / 2 };
typedef real lanes[FL_LANES];
typedef struct {
    lanes variance, decay, p[6]; /* p of xx, yy, zz, xy, xz, yz */
    lanes gain[3], product;
} filters;

/* How much of a disturbance is left after a time: half of the models have one memory, half another. */
static inline void let_decay(filters *at, real time, const real memory[2])
{
    for (int half = 0; half * HALF_LANES < FL_LANES; half++) {
        const real x = time / memory[half], decay = 1 / (1 + x * (1 + x / 2)); /* exp(-x), a little above it */
        for (int lane = 0; lane < HALF_LANES; lane++) at->decay[half * HALF_LANES + lane] = decay;
    }
}

/* Covariance of a disturbance of three components, seen along a normal, and the gain that follows. */
static inline void weigh_vector(filters *at, const real normal[3], real count, real *restrict weight)
{
    const real white = 1 / count, nx = normal[0], ny = normal[1], nz = normal[2];
    for (int lane = 0; lane < FL_LANES; lane++) {
        const real square = at->decay[lane] * at->decay[lane], added = at->variance[lane] * (1 - square);
        const real xx = at->p[0][lane] * square + added, yy = at->p[1][lane] * square + added,
                   zz = at->p[2][lane] * square + added;
        const real xy = at->p[3][lane] * square, xz = at->p[4][lane] * square, yz = at->p[5][lane] * square;
        const real hx = xx * nx + xy * ny + xz * nz, hy = xy * nx + yy * ny + yz * nz, hz = xz * nx + yz * ny + zz * nz;
        const real all = nx * hx + ny * hy + nz * hz + white;
        weight[lane] = 1 / all;
        const real gx = hx * weight[lane], gy = hy * weight[lane], gz = hz * weight[lane];
        at->gain[0][lane] = gx, at->gain[1][lane] = gy, at->gain[2][lane] = gz;
        at->product[lane] *= all * count;
        at->p[0][lane] = xx - hx * gx, at->p[1][lane] = yy - hy * gy, at->p[2][lane] = zz - hz * gz;
        at->p[3][lane] = xy - hx * gy, at->p[4][lane] = xz - hx * gz, at->p[5][lane] = yz - hy * gz;
    }
}

/* The same of a disturbance of one component. */
static inline void weigh_strength(filters *at, real count, real *restrict weight)
{
    const real white = 1 / count;
    for (int lane = 0; lane < FL_LANES; lane++) {
        const real square = at->decay[lane] * at->decay[lane];
        const real variance = at->p[0][lane] * square + at->variance[lane] * (1 - square);
        const real all = variance + white, gain = variance * (weight[lane] = 1 / all);
        at->gain[0][lane] = gain, at->product[lane] *= all * count;
        at->p[0][lane] = variance - variance * gain;
    }
}

/* The innovation of one column of a row, and what it moves the state by. */
static inline void follow_vector(real value, const real normal[3], const filters *at, lanes *restrict state,
                                 real *restrict innovation)
{
    const real nx = normal[0], ny = normal[1], nz = normal[2];
    real *restrict const along_x = state[0], *restrict const along_y = state[1], *restrict const along_z = state[2];
    for (int lane = 0; lane < FL_LANES; lane++) {
        const real decay = at->decay[lane];
        const real x = along_x[lane] * decay, y = along_y[lane] * decay, z = along_z[lane] * decay;
        const real error = value - (nx * x + ny * y + nz * z);
        innovation[lane] = error;
        along_x[lane] = x + at->gain[0][lane] * error;
        along_y[lane] = y + at->gain[1][lane] * error;
        along_z[lane] = z + at->gain[2][lane] * error;
    }
}

/* The same of a disturbance of one component. */
static inline void follow_strength(real value, const filters *at, real *restrict state, real *restrict innovation)
{
    for (int lane = 0; lane < FL_LANES; lane++) {
        const real before = state[lane] * at->decay[lane], error = value - before;
        innovation[lane] = error;
        state[lane] = before + at->gain[0][lane] * error;
    }
}

/* Add the products of the innovations of one column of a few rows with those of some others. */
static inline void add_column(lanes *weighed, lanes (*others)[BATCH_ROWS], int count, size_t rows, lanes *restrict sums)
{
    for (int b = 0; b < count; b++)
        for (size_t row = 0; row < rows; row++)
            for (int lane = 0; lane < FL_LANES; lane++) sums[b][lane] += weighed[row][lane] * others[b][row][lane];
}

/* Add the products of all pairs of innovations of a few rows over their variances. */
static inline void add_rows_of(lanes (*innovation)[BATCH_ROWS], lanes *weight, size_t rows, lanes *restrict sums)
{
    for (int a = 0; a < 10; sums += 10 - a, a++) {
        lanes weighed[BATCH_ROWS];
        for (size_t row = 0; row < rows; row++)
            for (int lane = 0; lane < FL_LANES; lane++)
                weighed[row][lane] = innovation[a][row][lane] * weight[row][lane];
        add_column(weighed, innovation + a, 10 - a, rows, sums);
    }
}

/* The same; with as many rows as most have, known to the compiler. */
static void add_innovations(lanes (*innovation)[BATCH_ROWS], lanes *weight, size_t rows, lanes *sums)
{
    if (rows == BATCH_ROWS) add_rows_of(innovation, weight, BATCH_ROWS, sums);
    else add_rows_of(innovation, weight, rows, sums);
}

/* Kalman filter of models of noise: white noise of variance 1 a reading, and a disturbance of eight variances and two
 * memories with three components along the normals of the surface, or with one. Gives Σ r rᵀ of the innovations of Jacobian
 * and distance over their variances, and the logarithm of these to the base 2, over those of white noise alone. */
static void filter(const fl_series *series, int is_vector, const real variance[FL_LANES], const real memory[2],
                   real log_determinant[FL_LANES], real sums[55][FL_LANES])
{
    filters at;
    lanes state[10][3] = {{{0}}}, weight[BATCH_ROWS], innovation[10][BATCH_ROWS];
    memset(&at, 0, sizeof at);
    memset(sums, 0, 55 * FL_LANES * sizeof(real));
    for (int lane = 0; lane < FL_LANES; lane++) {
        at.variance[lane] = at.p[0][lane] = at.p[1][lane] = at.p[2][lane] = variance[lane];
        log_determinant[lane] = 0, at.product[lane] = 1;
    }
    for (size_t k = 0; k < series->n; k++) {
        const real *const row = series->rows + 10 * k;
        const size_t of = k % BATCH_ROWS;
        let_decay(&at, series->steps[k], memory);
        if (is_vector) {
            weigh_vector(&at, row, series->counts[k], weight[of]);
            for (int i = 0; i < 10; i++) follow_vector(row[i], row, &at, state[i], innovation[i][of]);
        } else {
            weigh_strength(&at, series->counts[k], weight[of]);
            for (int i = 0; i < 10; i++) follow_strength(row[i], &at, state[i][0], innovation[i][of]);
        }
        if (of + 1 < BATCH_ROWS && k + 1 < series->n) continue;
        add_innovations(innovation, weight, of + 1, sums);
        if ((k + 1) % FACTORS && k + 1 < series->n) continue;
        for (int lane = 0; lane < FL_LANES; lane++)
            log_determinant[lane] += fl_log2(at.product[lane]), at.product[lane] = 1;
    }
}

/* The largest deviations over half a turn and the other half, whose first two harmonics have the other sign, of what a root
 * makes of each of 128 directions. */
static void deviations(const real root[16], real (*directions)[FL_AMPLITUDES], real (*harmonics)[4], size_t headings,
                       real out[FL_AMPLITUDES])
{
    real made[4][FL_AMPLITUDES];
    for (int row = 0; row < 4; row++)
        for (int i = 0; i < FL_AMPLITUDES; i++)
            made[row][i] = root[4 * row] * directions[0][i] + root[4 * row + 1] * directions[1][i] +
                           root[4 * row + 2] * directions[2][i] + root[4 * row + 3] * directions[3][i];
    for (int i = 0; i < FL_AMPLITUDES; i++) out[i] = 0;
    for (size_t k = 0; k < headings; k++)
        for (int i = 0; i < FL_AMPLITUDES; i++) {
            const real once = harmonics[k][0] * made[0][i] + harmonics[k][1] * made[1][i];
            const real twice = harmonics[k][2] * made[2][i] + harmonics[k][3] * made[3][i];
            const real size = fl_abs(once) + fl_abs(twice);
            out[i] = size > out[i] ? size : out[i];
        }
}

/* Keys of the cells that every so manieth reading falls into: three 21-bit indices. */
static void keys(const real *field, size_t n, size_t stride, real side, uint64_t *out)
{
    const real finer = 1 / side, largest = 2 * (real)FL_REACH - 1; /* exact: a power of two */
    int32_t index[3 * FL_BLOCK];
    real places[3 * FL_BLOCK];
    for (size_t begin = 0; begin < n; begin += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        const real *from = field + 3 * stride * begin;
        if (stride == 1) memcpy(places, from, 3 * m * sizeof(real));
        else
            for (size_t i = 0; i < m; i++) memcpy(places + 3 * i, from + 3 * stride * i, 3 * sizeof(real));
        for (size_t i = 0; i < 3 * m; i++) {
            real place = places[i] * finer + FL_REACH;
            place = place > 0 ? place : 0;
            place = place < largest ? place : largest;
            index[i] = (int32_t)place;
        }
        for (size_t i = 0; i < m; i++)
            out[begin + i] = (uint64_t)index[3 * i] << 42 | (uint64_t)index[3 * i + 1] << 21 | (uint64_t)index[3 * i + 2];
    }
}

/* Deviation of the path from a straight line after each of n readings, by two readings before and two after. */
static void breaks(const real *field, size_t n, real *out)
{
    real apart[3 * FL_BLOCK];
    for (size_t begin = 0; begin < n; begin += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        const real *at = field + 3 * begin;
        for (size_t i = 0; i < 3 * m; i++)
            apart[i] = fl_abs(((real)1.5 * at[i + 6] - (real)0.5 * at[i + 9]) - ((real)1.5 * at[i + 3] - (real)0.5 * at[i]));
        for (size_t i = 0; i < m; i++) {
            const real two = apart[3 * i] > apart[3 * i + 1] ? apart[3 * i] : apart[3 * i + 1];
            out[begin + i] = two > apart[3 * i + 2] ? two : apart[3 * i + 2];
        }
    }
}

/* Squares of the n steps from each reading to the next; returns the largest. */
static real steps(const real *field, size_t n, real *out)
{
    real parts[3 * FL_BLOCK], most[FL_LANES] = {0}, largest = 0;
    for (size_t begin = 0; begin < n; begin += FL_BLOCK) {
        const size_t m = n - begin < FL_BLOCK ? n - begin : FL_BLOCK;
        const real *at = field + 3 * begin;
        for (size_t i = 0; i < 3 * m; i++) parts[i] = (at[i + 3] - at[i]) * (at[i + 3] - at[i]);
        for (size_t i = 3 * m; i < 3 * FL_BLOCK; i++) parts[i] = 0;
        for (int i = 0; i < FL_BLOCK; i += FL_LANES)
            for (int lane = 0; lane < FL_LANES; lane++) {
                const real *part = parts + 3 * (i + lane), square = part[0] + part[1] + part[2];
                most[lane] = square > most[lane] ? square : most[lane];
                parts[i + lane] = square; /* which lies in front of what is still to be read */
            }
        memcpy(out + begin, parts, m * sizeof(real));
    }
    for (int lane = 0; lane < FL_LANES; lane++) largest = most[lane] > largest ? most[lane] : largest;
    return largest;
}

enum { EIGHT_READINGS = 24 }; /* numbers of eight readings */

/* Smallest and largest reading of each axis; nonzero if one is not finite. */
static int ends(const real *field, size_t rows, real lowest[3], real highest[3])
{
    real low[EIGHT_READINGS], high[EIGHT_READINGS], nothing[EIGHT_READINGS] = {0}; /* times zero, what is not finite is not a number */
    size_t i = 0;
    int is_broken = 0;
    for (int lane = 0; lane < EIGHT_READINGS; lane++) low[lane] = high[lane] = field[lane % 3];
    for (; i + EIGHT_READINGS <= 3 * rows; i += EIGHT_READINGS)
        for (int lane = 0; lane < EIGHT_READINGS; lane++) {
            const real value = field[i + lane];
            low[lane] = value < low[lane] ? value : low[lane];
            high[lane] = value > high[lane] ? value : high[lane];
            nothing[lane] += value * 0;
        }
    for (int lane = 0; i < 3 * rows; i++, lane++) {
        low[lane] = field[i] < low[lane] ? field[i] : low[lane];
        high[lane] = field[i] > high[lane] ? field[i] : high[lane];
        nothing[lane] += field[i] * 0;
    }
    for (int lane = 0; lane < EIGHT_READINGS; lane++) {
        const int axis = lane % 3;
        if (lane < 3 || low[lane] < lowest[axis]) lowest[axis] = low[lane];
        if (lane < 3 || high[lane] > highest[axis]) highest[axis] = high[lane];
        is_broken |= nothing[lane] != 0;
    }
    return is_broken;
}

/* How many readings, eight by eight, are at no end of an axis and have no value of the one before them. */
static size_t ordinary(const real *field, size_t rows, const real lowest[3], const real highest[3])
{
    real low[EIGHT_READINGS], high[EIGHT_READINGS];
    size_t row = 0, eights = 1;
    for (int lane = 0; lane < EIGHT_READINGS; lane++) low[lane] = lowest[lane % 3], high[lane] = highest[lane % 3];
    while (row + 8 <= rows && eights > 0) {
        real products_of[EIGHT_READINGS], least = 1; /* a product is zero where one of its factors is */
        while (row + 8 * eights > rows) eights /= 2;
        for (int lane = 0; lane < EIGHT_READINGS; lane++) products_of[lane] = 1;
        for (size_t eight = 0; eight < eights; eight++) {
            const real *at = field + 3 * (row + 8 * eight), *before = at - 3;
            for (int lane = 0; lane < EIGHT_READINGS; lane++) {
                const real off = fl_abs((at[lane] - low[lane]) * (high[lane] - at[lane]) * (at[lane] - before[lane]));
                products_of[lane] = off < products_of[lane] ? off : products_of[lane];
            }
        }
        for (int lane = 0; lane < EIGHT_READINGS; lane++) least = products_of[lane] < least ? products_of[lane] : least;
        if (least > 0) row += 8 * eights, eights *= eights < 8 ? 2 : 1;
        else eights /= 2; /* where among them? */
    }
    return row;
}

extern const fl_kernels FL_JOIN(fl_kernels, FL_VARIANT);
const fl_kernels FL_JOIN(fl_kernels, FL_VARIANT) = {
    powers, products, curvature, spurious, distances, has_closer, cost, columns, nonlinear, take_off, gram, lagged, nearest, cells,
    filter, deviations, keys, breaks, steps, ends, ordinary};
