/* How to turn a sensor, planned several turns ahead: a beam search over walks of the field's direction, as seen from the
 * body, through 42 waypoints. flinders.heading.path_planning says how. */
#include "residuals.h"

enum { CORNERS = 12, NODES = 42, NEIGHBOURS = 6, STEPS = 6, BEAM = 24, MAX_STEPS_TRIED = BEAM * NEIGHBOURS, SPREAD_DIRECTIONS = 50,
       PLACES_PER_ARC = 4, /* places of an arc at which readings are assumed */
       ENTRIES = 45, MAX_READINGS = 400 };

#define MIN_WAYPOINT_DEG ((real)15) /* smallest and largest angle to the first waypoint */
#define MAX_WAYPOINT_DEG ((real)60)
#define MAX_NEIGHBOUR_DEG ((real)40) /* largest angle between neighbouring waypoints */
#define SHAPE_SIGMA ((real)0.3) /* prior 1 sigma of the shape of a sphere from soft iron, of the radius */
#define MIN_ARC_DEG ((real)60) /* shortest arc that determines its centre */
#define MIN_SPREAD_RATIO ((real)0.12) /* smallest ratio of an axis's spread to the widest at which it determines the centre */
#define MIN_SCATTER_SHARE ((real)0.01) /* smallest scatter about an arc that is assumed, of the radius */

/* The waypoints: corners of an icosahedron and the middles of its edges; of each its neighbours, −1 behind the last. */
typedef struct {
    real nodes[NODES][3];
    signed char neighbours[NODES][NEIGHBOURS];
} graph;

/* A walk from where the field points now, and the covariance of the nine parameters at its end. */
typedef struct {
    real covariance[81];
    int count;
    signed char nodes[STEPS];
} walk;

/* A walk that goes on to one more waypoint. */
typedef struct {
    int from, node;
    real worst, score; /* largest variance of what is wanted, and the mean of fourth powers */
} step;

typedef struct {
    const fl_surface *surface;
    real start[3];
    real variance_deg; /* of the distance, of readings along a degree */
    real most;         /* largest variance before the walk */
    int wanted;
    real weights[ENTRIES][FL_HEADINGS]; /* of the entries of a covariance in each variance that is wanted */
    graph waypoints;
} plan;

static real dot(const real a[3], const real b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Make a vector one of length 1; nonzero if it has no length. */
static int make_unit(real vector[3])
{
    const real length = fl_sqrt(dot(vector, vector));
    if (!(length > 0) || !isfinite(length)) return 1;
    for (int i = 0; i < 3; i++) vector[i] /= length;
    return 0;
}

/* Fill in the waypoints. */
static void lay_out(graph *waypoints)
{
    const real golden = (1 + fl_sqrt((real)5)) / 2, edge = (real)0.4, near = fl_cos(MAX_NEIGHBOUR_DEG / FL_TO_DEG);
    real (*const nodes)[3] = waypoints->nodes;
    int count = 0;
    for (int turn = 0; turn < 3; turn++)
        for (int corner = 0; corner < 4; corner++, count++) {
            nodes[count][turn] = 0;
            nodes[count][(turn + 1) % 3] = corner < 2 ? 1 : -1;
            nodes[count][(turn + 2) % 3] = corner % 2 ? -golden : golden;
            make_unit(nodes[count]);
        }
    for (int one = 0; one < CORNERS; one++)
        for (int other = one + 1; other < CORNERS; other++) {
            if (!(dot(nodes[one], nodes[other]) > edge)) continue;
            for (int i = 0; i < 3; i++) nodes[count][i] = nodes[one][i] + nodes[other][i];
            make_unit(nodes[count++]);
        }
    for (int node = 0; node < NODES; node++) {
        int found = 0;
        for (int other = 0; other < NODES; other++)
            if (other != node && dot(nodes[node], nodes[other]) > near) waypoints->neighbours[node][found++] = (signed char)other;
        while (found < NEIGHBOURS) waypoints->neighbours[node][found++] = -1;
    }
}

/* Angle between unit vectors, rad. */
static real angle_between(const real a[3], const real b[3])
{
    const real cosine = dot(a, b);
    return fl_acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine);
}

/* Lower a covariance by the readings along the great circle from one direction to another. */
static void walk_along(const plan *way, const real from[3], const real to[3], real covariance[81])
{
    const real angle = angle_between(from, to), variance = way->variance_deg * PLACES_PER_ARC / (angle * FL_TO_DEG);
    for (int place = 0; place < PLACES_PER_ARC; place++) {
        const real share = ((real)place + (real)0.5) / PLACES_PER_ARC;
        const real back = fl_sin((1 - share) * angle) / fl_sin(angle), ahead = fl_sin(share * angle) / fl_sin(angle);
        real direction[3], jacobian[9], lever[9];
        for (int i = 0; i < 3; i++) direction[i] = back * from[i] + ahead * to[i];
        fl_jacobian(way->surface, direction, jacobian);
        const real total = fl_lever(covariance, jacobian, variance, lever);
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) covariance[9 * i + j] -= lever[i] * (lever[j] / total);
    }
}

/* Variances of the predictions; returns the largest. */
static real worst_of(const plan *way, const real covariance[81], real variances[FL_HEADINGS])
{
    real worst = 0;
    for (int k = 0; k < way->wanted; k++) variances[k] = 0;
    for (int i = 0, entry = 0; i < 9; i++)
        for (int j = 0; j <= i; j++, entry++)
            for (int k = 0; k < way->wanted; k++) variances[k] += covariance[9 * i + j] * way->weights[entry][k];
    for (int k = 0; k < way->wanted; k++) {
        variances[k] = variances[k] < 0 ? 0 : variances[k];
        worst = variances[k] > worst ? variances[k] : worst;
    }
    return worst;
}

/* Continue a walk to a waypoint; `from` is NULL for the first step. */
static void go(const plan *way, const real now[81], const walk *from, int node, walk *out)
{
    const real *const here = from ? way->waypoints.nodes[from->nodes[from->count - 1]] : way->start;
    if (from) *out = *from;
    else memcpy(out->covariance, now, sizeof out->covariance), out->count = 0;
    walk_along(way, here, way->waypoints.nodes[node], out->covariance);
    out->nodes[out->count++] = (signed char)node;
}

/* Score a walk to one more waypoint. */
static step scored(const plan *way, const real now[81], const walk *walks, int from, int node)
{
    walk there;
    real variances[FL_HEADINGS];
    step ahead = {.from = from, .node = node, .score = 0};
    go(way, now, walks ? walks + from : NULL, node, &there);
    ahead.worst = worst_of(way, there.covariance, variances);
    for (int k = 0; k < way->wanted; k++) ahead.score += fl_sharp(variances[k], way->most);
    return ahead;
}

/* First steps: to each waypoint in reach. */
static int begin(const plan *way, const real now[81], step *steps)
{
    int count = 0;
    for (int node = 0; node < NODES; node++) {
        const real angle = FL_TO_DEG * angle_between(way->waypoints.nodes[node], way->start);
        if (angle > MIN_WAYPOINT_DEG && angle < MAX_WAYPOINT_DEG) steps[count++] = scored(way, now, NULL, 0, node);
    }
    return count;
}

/* Further steps: from the end of each walk to each neighbour, but not straight back. */
static int extend(const plan *way, const walk *walks, int count, step *steps)
{
    int found = 0;
    for (int i = 0; i < count; i++) {
        const walk *const one = walks + i;
        const int here = one->nodes[one->count - 1], before = one->count > 1 ? one->nodes[one->count - 2] : -1;
        for (int slot = 0; slot < NEIGHBOURS; slot++) {
            const int node = way->waypoints.neighbours[here][slot];
            if (node >= 0 && node != before) steps[found++] = scored(way, NULL, walks, i, node);
        }
    }
    return found;
}

/* Index of the step with the smallest number, of about equal ones the first; −1 if all are NaN. */
static int least_of(const step *steps, int count, int is_worst)
{
    int best = -1;
    real least = FL_HUGE;
    for (int i = 0; i < count; i++) {
        const real number = is_worst ? steps[i].worst : steps[i].score;
        if (number < least * (1 - FL_ALIKE)) best = i, least = number;
    }
    return best;
}

/* Take the steps with the smallest scores, at most BEAM; returns how many. */
static int keep(const plan *way, const real now[81], const walk *walks, step *steps, int count, walk *kept)
{
    int found = 0;
    while (found < BEAM) {
        const int best = least_of(steps, count, 0);
        if (best < 0) break;
        go(way, now, walks ? walks + steps[best].from : NULL, steps[best].node, kept + found++);
        steps[best].score = FL_NOT_A_NUMBER;
    }
    return found;
}

/* Put the walk with this step at its end into a route. */
static void place(const plan *way, const walk *walks, const step *last, flinders_route *route)
{
    const int before = walks ? walks[last->from].count : 0;
    for (int i = 0; i <= before; i++) {
        const int node = i < before ? walks[last->from].nodes[i] : last->node;
        memcpy(route->waypoints + 3 * i, way->waypoints.nodes[node], 3 * sizeof(real));
    }
    route->count = before + 1;
    route->worst_deg = FL_TO_DEG * fl_sqrt(way->most), route->after_deg = FL_TO_DEG * fl_sqrt(last->worst);
}

/* Find the path that brings the largest variance below a target soonest, or nearest to it; nonzero if all are NaN. */
static int search(const plan *way, const real now[81], real target, flinders_route *route)
{
    walk beams[2][BEAM], *walks = NULL;
    step steps[MAX_STEPS_TRIED];
    int count = begin(way, now, steps);
    for (int taken = 1;; taken++) {
        const int nearest = least_of(steps, count, 1);
        const int is_reached = nearest >= 0 && steps[nearest].worst <= target;
        const int best = is_reached ? nearest : least_of(steps, count, 0);
        if (best < 0) return FLINDERS_NOT_FINITE;
        if (is_reached || taken == STEPS) {
            place(way, walks, steps + best, route);
            return FLINDERS_OK;
        }
        const int kept = keep(way, now, walks, steps, count, beams[taken % 2]);
        walks = beams[taken % 2];
        count = extend(way, walks, kept, steps);
    }
}

/* Directions spread evenly over the sphere. */
static void spread_evenly(real directions[SPREAD_DIRECTIONS][3])
{
    for (int k = 0; k < SPREAD_DIRECTIONS; k++) {
        const real place = (real)k + (real)0.5, z = 1 - 2 * place / SPREAD_DIRECTIONS, across = fl_sqrt(1 - z * z);
        const real longitude = FL_PI * (1 + fl_sqrt((real)5)) * place;
        directions[k][0] = across * fl_cos(longitude), directions[k][1] = across * fl_sin(longitude), directions[k][2] = z;
    }
}

/* Fill in the weights of a goal; nonzero for an invalid dip or down direction. */
static int weigh(const fl_surface *surface, const flinders_goal *goal, plan *way)
{
    fl_wanted wanted;
    real everywhere[SPREAD_DIRECTIONS][3];
    spread_evenly(everywhere);
    const int status = fl_wanted_of(surface, goal, (const real(*)[3])everywhere, SPREAD_DIRECTIONS, &wanted);
    if (status) return status;
    way->wanted = wanted.count;
    for (int i = 0, entry = 0; i < 9; i++)
        for (int j = 0; j <= i; j++, entry++)
            for (int k = 0; k < wanted.count; k++) {
                real sum = 0;
                for (int part = 0; part < wanted.parts; part++) sum += wanted.rows[part][i][k] * wanted.rows[part][j][k];
                way->weights[entry][k] = i == j ? sum : 2 * sum;
            }
    return FLINDERS_OK;
}

/* Plan a path. */
int flinders_path(const flinders_belief *belief, const flinders_goal *goal, const real at[3], real readings_per_deg,
                  flinders_route *route)
{
    const real target = goal->target_deg / FL_TO_DEG;
    real variances[FL_HEADINGS];
    fl_surface surface;
    plan way = {.surface = &surface};
    route->count = 0, route->worst_deg = route->after_deg = FL_NOT_A_NUMBER;
    for (int i = 0; i < 3 * STEPS; i++) route->waypoints[i] = FL_NOT_A_NUMBER;
    memcpy(way.start, at, sizeof way.start);
    if (fl_surface_of(belief->centre, belief->shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    way.variance_deg = belief->variance / readings_per_deg;
    if (!fl_are_finite(belief->covariance, 81) || !(way.variance_deg >= 0) || make_unit(way.start))
        return FLINDERS_NOT_FINITE;
    const int status = weigh(&surface, goal, &way);
    if (status) return status;
    lay_out(&way.waypoints);
    way.most = worst_of(&way, belief->covariance, variances);
    way.most = way.most > FL_TINY ? way.most : FL_TINY;
    return search(&way, belief->covariance, target * target, route);
}

/* Take up to 400 readings, evenly spaced, relative to their mean and in units of the farthest; returns this unit, 0
 * if all are equal. */
static real thin(const real *field, size_t rows, real local[MAX_READINGS][3], int *count, real mean[3])
{
    const size_t stride = (rows + MAX_READINGS - 1) / MAX_READINGS;
    real scale = 0;
    *count = 0;
    for (int i = 0; i < 3; i++) mean[i] = 0;
    for (size_t row = 0; row < rows; row += stride) memcpy(local[(*count)++], field + 3 * row, 3 * sizeof(real));
    for (int k = 0; k < *count; k++)
        for (int i = 0; i < 3; i++) mean[i] += local[k][i] / (real)*count;
    for (int k = 0; k < *count; k++)
        for (int i = 0; i < 3; i++) {
            local[k][i] -= mean[i];
            scale = fl_abs(local[k][i]) > scale || isnan(local[k][i]) ? fl_abs(local[k][i]) : scale;
        }
    for (int k = 0; k < *count; k++)
        for (int i = 0; i < 3; i++) local[k][i] /= scale > 0 ? scale : 1;
    return scale;
}

/* Centre of the sphere, or circle, through places about their mean, by linear least squares in the space, or plane, in which
 * they are spread (I. Kåsa, IEEE Trans. Instrum. Meas. 25 (1976) 8); returns its radius, 0 where they lie on a line. Along
 * principal axes the equations are each for one number. */
static real centre_of(const real (*places)[3], int count, real centre[3])
{
    real axes[9] = {0}, values[3], square = 0, length = 0;
    int spread = 0;
    for (int k = 0; k < count; k++)
        for (int i = 0; i < 9; i++) axes[i] += places[k][i / 3] * places[k][i % 3] / (real)count;
    fl_eigen(axes, 3, values);
    for (int axis = 0; axis < 3; axis++) spread += values[axis] > MIN_SPREAD_RATIO * MIN_SPREAD_RATIO * values[2];
    for (int i = 0; i < 3; i++) centre[i] = 0;
    if (spread < 2) return 0;
    for (int axis = 3 - spread; axis < 3; axis++) {
        real cube = 0;
        for (int k = 0; k < count; k++) {
            real along[3], squares = 0;
            for (int other = 3 - spread; other < 3; other++) {
                along[other] = axes[other] * places[k][0] + axes[3 + other] * places[k][1] + axes[6 + other] * places[k][2];
                squares += along[other] * along[other];
            }
            cube += along[axis] * squares / (real)count;
        }
        const real middle = cube / (2 * values[axis]);
        for (int i = 0; i < 3; i++) centre[i] += middle * axes[3 * i + axis];
        square += values[axis], length += middle * middle;
    }
    return fl_sqrt(square + length);
}

/* Turn places into directions from a centre; returns the mean square of their distances less a radius. NaN where a place has
 * no direction, or all lie within a short arc. */
static real scatter_about(const real centre[3], real radius, real (*places)[3], int count)
{
    real sum = 0, least = 1;
    for (int k = 0; k < count; k++) {
        for (int i = 0; i < 3; i++) places[k][i] -= centre[i];
        const real off = fl_sqrt(dot(places[k], places[k])) - radius;
        sum += off * off / (real)count;
        if (make_unit(places[k])) return FL_NOT_A_NUMBER;
    }
    for (int k = 0; k < count; k++)
        for (int other = 0; other < k; other++) {
            const real cosine = dot(places[k], places[other]);
            least = cosine < least ? cosine : least;
        }
    return least > fl_cos(MIN_ARC_DEG / FL_TO_DEG) ? FL_NOT_A_NUMBER : sum;
}

/* Put a sphere through readings. */
int flinders_rough(const real *field, size_t rows, flinders_belief *belief)
{
    real places[MAX_READINGS][3], mean[3], centre[3], information[81] = {0};
    int count;
    fl_surface surface;
    const real scale = thin(field, rows, places, &count, mean);
    for (int i = 0; i < 81; i++) belief->covariance[i] = FL_NOT_A_NUMBER;
    belief->variance = FL_NOT_A_NUMBER, belief->readings = (real)rows;
    for (int i = 0; i < 6; i++) belief->centre[i % 3] = belief->shape[i] = FL_NOT_A_NUMBER;
    if (count < 4) return FLINDERS_TOO_FEW;
    if (!isfinite(scale)) return FLINDERS_NOT_FINITE;
    const real radius = scale > 0 ? centre_of((const real(*)[3])places, count, centre) : 0;
    if (!(radius > 0)) return FLINDERS_UNDETERMINED;
    const real scatter = scatter_about(centre, radius, places, count), least = MIN_SCATTER_SHARE * radius * (MIN_SCATTER_SHARE * radius);
    if (isnan(scatter)) return FLINDERS_UNDETERMINED;
    const real variance = scatter > least ? scatter : least, length = scale * radius;
    for (int i = 0; i < 6; i++) belief->shape[i] = i < 3 ? length : 0;
    for (int i = 0; i < 3; i++) belief->centre[i] = mean[i] + scale * centre[i];
    if (fl_surface_of(belief->centre, belief->shape, &surface)) return FLINDERS_OUT_OF_SCALE;
    for (int i = 0; i < 9; i++) information[10 * i] = i < 3 ? 1 : 1 / (SHAPE_SIGMA * SHAPE_SIGMA);
    for (int k = 0; k < count; k++) {
        real jacobian[9];
        fl_jacobian(&surface, places[k], jacobian);
        for (int i = 0; i < 81; i++) information[i] += jacobian[i / 9] * jacobian[i % 9] * (radius * radius / variance);
    }
    fl_inverse(information, 9, belief->covariance);
    for (int i = 0; i < 81; i++) belief->covariance[i] *= length * length;
    belief->variance = variance * scale * scale;
    return FLINDERS_OK;
}
