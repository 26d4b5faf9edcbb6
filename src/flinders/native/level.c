/* Level turns: the ellipse of readings in one plane across z, and whether readings are those of such a turn.
 *
 * In a level turn, the field of dip I is u = (cos I cos ψ, −cos I sin ψ, sin I), and readings in x and y are
 *
 *     c + S₂ (cos ψ, −sin ψ),     c = b + sin I (S₁₃, S₂₃),     S₂ = cos I (S₁₁, S₁₂; S₁₂, S₂₂)
 *
 * an ellipse for any iron. It is fitted as the equator of an ellipsoid through the readings projected to one height, and
 * transformed to the dip. Across the plane there is only the prior, and 1 sigma of the offset is the field's strength.
 */
#include "judge.h"
#include "residuals.h"

#define MAX_NEARLY_FLAT_RATIO ((real)3) /* largest ratio of thickness to noise of readings that are nearly in a plane */
#define MIN_CLAIM_RATIO ((real)5) /* smallest ratio of claims at which readings that are not nearly flat count as a level turn */
#define MAX_REJECTED_SHARE ((real)0.2) /* largest share of readings that leave the plane of a turn, if the body was not tilted */
#define MIN_VERTICAL_COSINE ((real)0.8660254037844387) /* smallest component of z along the vertical, 30 degrees; as of an accelerometer beside a site */
#define MIN_TURN_MEAN ((real)0.9) /* smallest mean of the vertical in a turn: a body that was turned over by more than some 25 degrees has less */
#define MIN_LEVEL_MEAN ((real)0.985) /* smallest mean of the vertical in a body that was level: within 10 degrees */
#define MIN_AXIS_SHARE ((real)1e-12) /* smallest semi-axis of a start, over the range of the readings */

/* Copy readings, projected to one height. */
static void lay_flat(const fl_view *view, real height, real *out)
{
    for (size_t row = 0; row < view->rows; row++) {
        out[3 * row] = view->field[3 * row], out[3 * row + 1] = view->field[3 * row + 1];
        out[3 * row + 2] = height;
    }
}

/* Transform an equator to the ellipsoid with this section at a dip, rad. */
static int lift_surface(const fl_surface *flat, real dip, fl_surface *out)
{
    static const int THIRD[3] = {4, 5, 2}; /* column of the shape */
    real centre[3], shape[6];
    for (int i = 0; i < 6; i++) shape[i] = flat->shape[i] / fl_cos(dip);
    for (int i = 0; i < 3; i++) centre[i] = flat->centre[i] - fl_sin(dip) * shape[THIRD[i]];
    return fl_surface_of(centre, shape, out);
}

/* Its covariance; `unclaimed` is 1 sigma of the offset across the plane. */
static void lift_covariance(real covariance[81], real dip, real unclaimed)
{
    static const int THIRD[3] = {7, 8, 5}; /* of the parameters */
    real lift[81] = {0}, half[81];
    for (int i = 0; i < 9; i++) {
        lift[10 * i] = i < 3 ? 1 : 1 / fl_cos(dip);
        covariance[9 * 2 + i] = covariance[9 * i + 2] = 0;
        if (i < 3) lift[9 * i + THIRD[i]] = -fl_sin(dip) / fl_cos(dip);
    }
    fl_multiply(lift, covariance, 9, 9, 9, half);
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            covariance[9 * i + j] = 0;
            for (int k = 0; k < 9; k++) covariance[9 * i + j] += half[9 * i + k] * lift[9 * j + k];
        }
    covariance[20] += unclaimed * unclaimed;
}

/* Transform the record of an ellipse to the dip. */
static int lift(const fl_fit *fit, real dip_deg, fl_surface *surface, flinders_record *record)
{
    const real dip = dip_deg / FL_TO_DEG;
    if (lift_surface(&fit->surface, dip, surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    fl_place(surface, record);
    lift_covariance(record->covariance, dip, surface->radius);
    lift_covariance(record->textbook, dip, surface->radius);
    record->dip_deg = dip_deg;
    fl_tilted_error(surface, record->covariance, dip_deg, 0, NULL, &record->level_rms_deg, &record->level_worst_deg);
    return FLINDERS_OK;
}

/* Whether a start is negligibly small compared with the readings. */
static int is_thin(const fl_surface *start, const flinders_record *record)
{
    real axes[3], range = 0;
    for (int axis = 0; axis < 2; axis++) {
        const real own = record->highest[axis] - record->lowest[axis];
        range = own > range ? own : range;
    }
    fl_sym3_values(start->shape, axes);
    return !(axes[0] > (real)FL_SMALLEST && axes[0] > MIN_AXIS_SHARE * range);
}

/* Fit the ellipse of prepared readings, robustly if residuals have outliers. */
int fl_fit_turn(fl_task *of, flinders_record *record)
{
    flinders_options own = *of->options;
    fl_view flat = {of->room.flat, of->view.rows, NULL, 1};
    fl_surface start, surface;
    fl_fit fit;
    if (own.robust > 1) own.robust = 1;
    lay_flat(&of->view, record->mean[2], of->room.flat);
    fl_cloud(of->kernels, flat.field, flat.rows, &of->room);
    if (fl_ellipse_start(of->kernels, flat.field, flat.rows, &of->room, &start) || is_thin(&start, record))
        return FLINDERS_NOT_AN_ELLIPSOID;
    int status = fl_fit_from(of->kernels, &flat, &own, &start, &start, &of->room, &fit, record);
    if (status != FLINDERS_OK) return status;
    fl_covariance_of(of->kernels, &flat, &own, &fit, &of->room, record);
    fl_place_fit(&fit, record);
    record->plane = 1;
    if (own.statistics) fl_residual_statistics(of->kernels, &of->all, &flat, &fit, &of->room, record);
    status = lift(&fit, own.dip_deg, &surface, record);
    if (status != FLINDERS_OK || !own.statistics) return status;
    fl_cloud(of->kernels, of->view.field, of->view.rows, &of->room);
    fl_coverage(of->kernels, &surface, record->rejected_beyond, &of->room, record);
    return FLINDERS_OK;
}

/* Whether all readings, or the inliers, lie in a plane across z to within a multiple of their noise. */
int fl_are_flat(const fl_scatter *readings, real noise, real within)
{
    return flinders_is_level(readings->all, noise, within) || flinders_is_level(readings->inliers, noise, within);
}

/* Whether readings are of a level turn: their distances from a plane are noise, or the turn's claim is smaller. */
int fl_is_turn(const flinders_record *ellipsoid, const flinders_record *turn, const fl_scatter *readings,
               const flinders_options *options)
{
    if ((real)turn->rejected > MAX_REJECTED_SHARE * (real)turn->fitted) return 0;
    if (fl_are_flat(readings, ellipsoid->noise, FL_FLAT_NOISE)) return 1;
    const int is_nearly = options->level > 1 || ellipsoid->unobserved || fl_are_flat(readings, ellipsoid->noise, MAX_NEARLY_FLAT_RATIO);
    if (!is_nearly && turn->rejected) return 0; /* what leaves the plane are no outliers */
    return (is_nearly ? 1 : MIN_CLAIM_RATIO) * turn->level_worst_deg < ellipsoid->level_worst_deg;
}

/* Whether to check for a level turn: there is a prior across its plane, and each axis varies; a constant one may be
 * defective. */
int fl_may_be_turn(const flinders_record *record, const flinders_options *options)
{
    for (int axis = 0; axis < 3; axis++)
        if (!(record->highest[axis] > record->lowest[axis])) return 0;
    return options->level && options->prior > 0 && !fl_is_informed(options);
}

/* Whether accelerations are of a level turn about z: 0 if the mean of z is not within 30 degrees of the vertical, or the body
 * was turned over, 2 if it was level, 1 if there are none or it was tilted. */
int flinders_levelness(const real *acceleration, size_t rows)
{
    real sum[3] = {0}, count = 0;
    for (const real *a = acceleration; a < acceleration + 3 * rows; a += 3) {
        const real length = fl_sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        if (!(length > 0) || !isfinite(length)) continue;
        for (int axis = 0; axis < 3; axis++) sum[axis] += a[axis] / length;
        count++;
    }
    const real length = fl_sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    if (fl_abs(sum[2]) < MIN_VERTICAL_COSINE * length || length < MIN_TURN_MEAN * count) return 0;
    return count > 0 && length > MIN_LEVEL_MEAN * count ? 2 : 1;
}
