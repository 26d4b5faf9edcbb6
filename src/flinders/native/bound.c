/* The bound that the heading error of a level turn stays within at all headings with a probability of 95 %.
 *
 * Heading errors of a turn are four independent normal numbers z, made by a root of the covariance of its deviation. With
 * z = r θ, r its length and θ its direction, the largest error is r m(θ), m = max over headings, and the probability that it
 * is within u is the mean over θ of F(u / m(θ)), F(x) = 1 − (1 + x²/2) exp(−x²/2) the distribution of r (I. Deák, Numer. Math.
 * 35 (1980) 369; A. Genz and F. Bretz, Computation of Multivariate Normal and t Probabilities, Springer (2009), sect. 4.1).
 */
#include "judge.h"

enum { STEPS = 3, TURN = 8 };

#define EXCESS_PROBABILITY ((real)0.05) /* probability that an error exceeds its bound */
#define MIN_BOUND_SIGMAS ((real)1.9599) /* ratio of the bound to the worst 1 sigma: smallest, for one heading alone */
#define MAX_BOUND_SIGMAS ((real)3.0803) /* largest, for the length of four independent normal numbers */
#define START_BOUND_SIGMAS ((real)2.4) /* start of the iteration */
#define NEGLIGIBLE_RATIO ((real)0.1) /* ratio to the worst 1 sigma below which a direction exceeds the bound with a probability below 1e-80 */

/* Even directions in four dimensions, up to their sign: a super-Fibonacci spiral (M. Alexa, CVPR 2022). */
static void even_directions(real directions[4][FL_AMPLITUDES])
{
    for (int i = 0; i < FL_AMPLITUDES; i++) {
        const real place = (i + (real)0.5) / FL_AMPLITUDES, turns = 2 * FL_PI * (i + (real)0.5);
        const real first = turns / fl_sqrt((real)2), second = turns / (real)1.533751168755204288118041;
        const real inner = fl_sqrt(place), outer = fl_sqrt(1 - place);
        directions[0][i] = inner * fl_sin(first), directions[1][i] = inner * fl_cos(first);
        directions[2][i] = outer * fl_sin(second), directions[3][i] = outer * fl_cos(second);
    }
}

/* Bound of the largest error, from the largest errors of numbers of length 1 in even directions, both over the worst 1
 * sigma, by Newton's method: the logarithm of the probability outside is nearly linear in the square of the bound. */
static real quantile(const real largest[FL_AMPLITUDES])
{
    real square = START_BOUND_SIGMAS * START_BOUND_SIGMAS, inverse[FL_AMPLITUDES];
    for (int i = 0; i < FL_AMPLITUDES; i++) {
        const real size = largest[i] > NEGLIGIBLE_RATIO ? largest[i] : NEGLIGIBLE_RATIO;
        inverse[i] = (real)0.5 / (size * size);
    }
    for (int step = 0; step < STEPS; step++) {
        real outside = 0, slope = 0;
        for (int i = 0; i < FL_AMPLITUDES; i++) {
            const real half = square * inverse[i], tail = fl_exp(-half);
            outside += tail + half * tail, slope += half * half * tail;
        }
        square *= 1 + outside * fl_log(outside / FL_AMPLITUDES / EXCESS_PROBABILITY) / slope;
        square = square < MIN_BOUND_SIGMAS * MIN_BOUND_SIGMAS ? MIN_BOUND_SIGMAS * MIN_BOUND_SIGMAS : square;
        square = square > MAX_BOUND_SIGMAS * MAX_BOUND_SIGMAS ? MAX_BOUND_SIGMAS * MAX_BOUND_SIGMAS : square;
    }
    return fl_sqrt(square);
}

/* What all bounds have in common. */
void fl_bound_begin(fl_bound *bound)
{
    even_directions(bound->directions);
    for (int k = 0; k < FL_BOUND_HEADINGS; k++) {
        const real heading = 2 * FL_PI * k / FL_BOUND_HEADINGS;
        bound->harmonics[k][0] = fl_sin(heading), bound->harmonics[k][1] = fl_cos(heading);
        bound->harmonics[k][2] = fl_sin(2 * heading), bound->harmonics[k][3] = fl_cos(2 * heading);
    }
}

/* The bound, from a root (4, 4) of the covariance of B, C, D and E. */
static real bound_of(const real root[16], fl_bound *bound)
{
    real errors[FL_BOUND_HEADINGS][4], largest[FL_AMPLITUDES], worst = 0;
    fl_multiply(bound->harmonics[0], root, FL_BOUND_HEADINGS, 4, 4, errors[0]);
    for (int k = 0; k < FL_BOUND_HEADINGS; k++) {
        const real *e = errors[k], square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3];
        worst = square > worst ? square : worst;
    }
    worst = fl_sqrt(worst);
    fl_kernels_chosen(0)->deviations(root, bound->directions, bound->harmonics, FL_BOUND_HEADINGS / 2, largest);
    for (int i = 0; i < FL_AMPLITUDES; i++) largest[i] /= worst > FL_TINY ? worst : FL_TINY;
    return worst * quantile(largest);
}

/* Bound of the heading error: that of the deviation B sin ζ + C cos ζ + D sin 2ζ + E cos 2ζ, each coefficient of which is
 * twice the mean of its product with the heading's error. Eight headings determine it. */
real fl_heading_bound(const fl_surface *surface, const real covariance[81], real dip_deg, const real *down,
                      fl_bound *shared)
{
    static const real Z[3] = {0, 0, 1};
    const real flat = fl_cos(dip_deg / FL_TO_DEG), height = fl_sin(dip_deg / FL_TO_DEG);
    real turn[9], jacobian[36] = {0}, half[36], deviation[16], root[16], values[4];
    fl_upright(down ? down : Z, turn);
    for (int k = 0; k < TURN; k++) {
        const real angle = 2 * FL_PI * (real)k / TURN, cosine = fl_cos(angle), sine = fl_sin(angle);
        const real harmonics[4] = {sine, cosine, fl_sin(2 * angle), fl_cos(2 * angle)};
        const real across[3] = {sine / flat, cosine / flat, 0}, field[3] = {flat * cosine, -flat * sine, height};
        real turned[3], meets[3], v[3];
        fl_multiply(turn, across, 3, 3, 1, turned);
        fl_multiply(turn, field, 3, 3, 1, meets);
        fl_sym3_apply(surface->inverse, turned, v);
        const real row[9] = {v[0], v[1], v[2], v[0] * meets[0], v[1] * meets[1], v[2] * meets[2],
                             v[0] * meets[1] + v[1] * meets[0], v[0] * meets[2] + v[2] * meets[0],
                             v[1] * meets[2] + v[2] * meets[1]};
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < 9; j++) jacobian[9 * i + j] += FL_TO_DEG * (real)2 / TURN * harmonics[i] * row[j];
    }
    fl_multiply(jacobian, covariance, 4, 9, 9, half);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            deviation[4 * i + j] = 0;
            for (int k = 0; k < 9; k++) deviation[4 * i + j] += half[9 * i + k] * jacobian[9 * j + k];
        }
    for (int i = 0; i < 16; i++)
        if (!isfinite(deviation[i])) return FL_NOT_A_NUMBER;
    fl_eigen(deviation, 4, values);
    for (int i = 0; i < 4; i++) /* the symmetric root, which is one whatever the signs of eigenvectors */
        for (int j = 0; j < 4; j++) {
            root[4 * i + j] = 0;
            for (int k = 0; k < 4; k++)
                root[4 * i + j] += deviation[4 * i + k] * fl_sqrt(values[k] > 0 ? values[k] : 0) * deviation[4 * j + k];
        }
    return bound_of(root, shared);
}

/* Bound of a level heading. */
int flinders_heading_bound(const real shape[6], const real covariance[81], real dip_deg, const real *down, real *bound_deg)
{
    const real none[3] = {0, 0, 0};
    fl_surface surface;
    fl_bound shared;
    if (!(fl_abs(dip_deg) <= 89)) return FLINDERS_BAD_OPTION;
    if (fl_surface_of(none, shape, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    fl_bound_begin(&shared);
    *bound_deg = fl_heading_bound(&surface, covariance, dip_deg, down, &shared);
    return FLINDERS_OK;
}
