/* Shared declarations of the engine: numbers, small matrices, selections of readings, and kernels. */
#ifndef FLINDERS_INTERNAL_H
#define FLINDERS_INTERNAL_H

#include <float.h>
#include <math.h>
#include <string.h>

#include "flinders.h"

typedef flinders_real real;

#ifdef FLINDERS_FLOAT
#define fl_sqrt sqrtf
#define fl_abs fabsf
#define fl_sin sinf
#define fl_cos cosf
#define fl_acos acosf
#define fl_atan2 atan2f
#define fl_exp expf
#define fl_log logf
#define fl_log2 log2f
#define fl_pow powf
#define fl_cbrt cbrtf
#define fl_floor floorf
#define fl_erfc erfcf
#define fl_frexp frexpf
#define fl_ldexp ldexpf
#define FL_TINY FLT_MIN
#define FL_HUGE FLT_MAX
#define FL_SHORT 1e-18F /* its square does not underflow */
#define FL_ROUNDING 1e-7F
#define FL_NOT_A_NUMBER nanf("")
#else
#define fl_sqrt sqrt
#define fl_abs fabs
#define fl_sin sin
#define fl_cos cos
#define fl_acos acos
#define fl_atan2 atan2
#define fl_exp exp
#define fl_log log
#define fl_log2 log2
#define fl_pow pow
#define fl_cbrt cbrt
#define fl_floor floor
#define fl_erfc erfc
#define fl_frexp frexp
#define fl_ldexp ldexp
#define FL_TINY DBL_MIN
#define FL_HUGE DBL_MAX
#define FL_SHORT 1e-150
#define FL_ROUNDING 1e-15
#define FL_NOT_A_NUMBER nan("")
#endif

#ifdef FLINDERS_SMALL
#define fl_is_informed(options) ((options)->known != NULL)
#else
#define fl_is_informed(options) ((options)->is_informed)
#endif

#if defined(FLINDERS_SMALL) && defined(__GNUC__)
#define FL_APART __attribute__((noinline)) /* keeps its local variables out of the caller's stack frame */
#else
#define FL_APART
#endif

#define FL_PI ((real)3.14159265358979323846)
#define FL_TO_DEG ((real)180 / FL_PI)
#define FL_UNOBSERVED ((real)1 / 3)  /* largest fraction of information by noise for a direction to be observed */
#define FL_DEPENDENT (100 * FL_ROUNDING) /* relative to the largest eigenvalue: smaller ones are rounding errors */
#define FL_FLAT ((real)0.01)    /* ratio of thickness to width of readings that are always flat */
#define FL_FLATTEST ((real)0.2) /* the same ratio of readings that are never flat */
#define FL_FLAT_NOISE ((real)1.5) /* ratio of thickness to noise below which readings are flat */
#define FL_FINEST ((real)1e-6) /* fraction of the field: smallest resolution of a sensor */

enum { FL_LOOKED = 12 * 1024, FL_COLUMNS = 18, FL_STEPS = 50,
       FL_REACH = 1 << 20, /* number of cells on each side of zero */
       FL_AMPLITUDES = 128 };

#ifdef FLINDERS_SMALL /* for a stack of few kilobytes: up to 512 readings, and only the nine parameters */
enum { FL_BLOCK = 4, FL_LANES = 1, FL_WIDEST = 9, FL_SOME = 512, FL_ENOUGH = 512 };
#else
enum { FL_BLOCK = 64, FL_LANES = 8, FL_WIDEST = 15,
       FL_SOME = 5000,     /* number of readings from a longer recording, for statistics */
       FL_ENOUGH = 20000 }; /* the same for a majority; above it, a fit is iterated on a part */
#endif

/* View of the readings of a recording: every `stride`-th of those that are not rejected. */
typedef struct {
    const real *field;             /* (rows, 3) */
    size_t rows;
    const unsigned char *rejected; /* (rows,), or NULL for none */
    size_t stride;
} fl_view;

/* An ellipsoid with the inverse of its shape; symmetric matrices are 11, 22, 33, 12, 13, 23. */
typedef struct {
    real centre[3];
    real shape[6];
    real inverse[6];
    real radius;
} fl_surface;

/* Averages of successive residuals, in the order of recording. */
typedef struct {
    size_t n;
    real *rows;   /* (n, 10) Jacobian and distance */
    real *counts; /* (n,) number of readings in each */
    real *steps;  /* (n,) time since the previous one; FL_HUGE if they are uncorrelated */
} fl_series;

#ifdef FLINDERS_SMALL
/* Normal prior of the nine parameters, with the function that adds it to a fit, so that a program without an online
 * calibration is linked without that function. */
struct fl_known {
    const real *expected, *information; /* (9,) and (9, 9), as in flinders_options on a host */
    void (*add)(const real expected[9], const real information[81], const fl_surface *surface, real matrix[81],
                real gradient[9], real *cost);
};
#endif

/* Kernels over all readings of a view; each has a baseline and an AVX2 version, with identical results. */
typedef struct {
    size_t (*powers)(const fl_view *view, const real origin[3], real unit, real sums[35]);
    size_t (*products)(const fl_view *view, const fl_surface *surface, int exact, real sums[55]);
    void (*curvature)(const fl_view *view, const fl_surface *surface, real gradient[9]);
    size_t (*spurious)(const fl_view *view, const fl_surface *surface, real sums[45]);
    void (*distances)(const fl_view *view, const fl_surface *surface, real *out);
    int (*has_closer)(const fl_view *view, const fl_surface *surface, real limit, size_t fewest);
    real (*cost)(const fl_view *view, const fl_surface *surface);
    size_t (*columns)(const fl_view *view, const fl_surface *surface, size_t begin, real *const *out, real *directions);
    void (*nonlinear)(const fl_surface *surface, const real *directions, size_t n, real *const *normals, real *const *out);
    void (*take_off)(real *const *columns, size_t n, int width, const real *solution, const real *from, real *to);
    void (*gram)(real *const *columns, size_t begin, size_t n, int count, real *matrix);
    void (*lagged)(real *const *columns, size_t begin, size_t n, int width, const int *lags, const real *weights,
                   int count, real *product);
    real (*nearest)(const real direction[3], const real *x, const real *y, const real *z, size_t n);
    void (*cells)(const real *x, const real *y, const real *z, size_t n, uint32_t *out);
    void (*filter)(const fl_series *series, int is_vector, const real variance[FL_LANES], const real memory[2],
                   real log_determinant[FL_LANES], real sums[55][FL_LANES]);
    void (*deviations)(const real root[16], real (*directions)[FL_AMPLITUDES], real (*harmonics)[4], size_t headings,
                       real out[FL_AMPLITUDES]);
    void (*keys)(const real *field, size_t n, size_t stride, real side, uint64_t *out);
    void (*breaks)(const real *field, size_t n, real *out);
    real (*steps)(const real *field, size_t n, real *out);
    int (*ends)(const real *field, size_t rows, real lowest[3], real highest[3]);
    size_t (*ordinary)(const real *field, size_t rows, const real lowest[3], const real highest[3]);
} fl_kernels;

const fl_kernels *fl_kernels_chosen(int which);
size_t fl_view_count(const fl_view *view);

/* cloud.c: a hundred cells of the sphere, of equal area, and the number of sectors of each band */
extern const int fl_bands[6], fl_band_starts[6];
extern const real fl_band_edges[5], fl_sectors_15[7], fl_sectors_34[17];

/* linear.c */
void fl_eigen(real *matrix, int n, real *values);
int fl_cholesky(real *matrix, int n);
int fl_cholesky_regular(const real *matrix, int n, real *factor);
void fl_forward(const real *factor, int n, real *x);
void fl_cholesky_solve(const real *factor, int n, real *x);
void fl_cholesky_inverse(const real *factor, int n, real *inverse);
int fl_solve(real *matrix, int n, real *x);
void fl_multiply(const real *a, const real *b, int n, int m, int k, real *out);
void fl_sym3_inverse(const real shape[6], real inverse[6]);
real fl_sym3_det(const real shape[6]);
void fl_sym3_values(const real shape[6], real values[3]);
real fl_select(real *values, size_t n, size_t k);

/* Product of a symmetric 3 × 3 matrix with a vector. */
static inline void fl_sym3_apply(const real s[6], const real x[3], real out[3])
{
    out[0] = s[0] * x[0] + s[3] * x[1] + s[4] * x[2];
    out[1] = s[3] * x[0] + s[1] * x[1] + s[5] * x[2];
    out[2] = s[4] * x[0] + s[5] * x[1] + s[2] * x[2];
}

/* start.c */
int fl_surface_of(const real centre[3], const real shape[6], fl_surface *surface);
int fl_surface_of_quadric(const real quadric[10], const real origin[3], real scale, fl_surface *surface);
int fl_consistent(const flinders_sums *sums, real tolerance, fl_surface *surface, real *noise);
int fl_start(const flinders_sums *sums, fl_surface *surface, real *noise);

/* about.c */
int fl_start_about(const fl_view *view, const real expected[9], fl_surface *surface);

/* covariance.c */
typedef struct {
    int n, is_whole; /* is_whole: every direction is observed, and the fields below are not set */
    real scale[FL_WIDEST];
    real values[FL_WIDEST];
    real vectors[FL_WIDEST * FL_WIDEST]; /* eigenvectors in columns */
    real share[FL_WIDEST];
} fl_support;

typedef void (*fl_spurious)(void *context, size_t most, real *matrix);
void fl_support_of(const real *matrix, int n, fl_spurious spurious, void *context, fl_support *support);
int fl_support_unseen(const fl_support *support);
void fl_support_keep(const fl_support *support, real *matrix, real *gradient);
void fl_support_information(const fl_support *support, const real *matrix, real *information);
void fl_inverse(const real *matrix, int n, real *inverse);
void fl_jacobian(const fl_surface *surface, const real direction[3], real row[9]);
void fl_turning(const fl_surface *surface, const real direction[3], real rows[2][9]);

/* heading.c */
real fl_facing(real upright, real coverage, real dip_deg, int32_t *is_open);
void fl_heading_errors(const fl_surface *surface, flinders_record *record, real dip_deg);
enum { FL_HEADINGS = 72 };
void fl_level_rows(const fl_surface *surface, real dip_deg, real rows[9][FL_HEADINGS]);
void fl_level_errors(const fl_surface *surface, const real covariance[81], real dip_deg, real *rms, real *worst);
real fl_level_change(const fl_surface *surface, const real change[9], real dip_deg);
void fl_direction_errors(const fl_surface *surface, const real covariance[81], real *rms, real *worst);

/* likelihood.c */
typedef struct {
    fl_surface surface;
    real matrix[81], gradient[9], cost; /* without the prior, in the unit of readings */
    size_t count;
#ifndef FLINDERS_SMALL
    real prior_matrix[81], prior_gradient[9];
#endif
    real prior_cost;
    real noise, variance;
    fl_support support;
    int has_support, sound;
} fl_posterior;

/* Model of residuals: white noise plus an autocorrelated disturbance. */
typedef struct {
    int is_vector; /* 1 for a disturbance of the vector, 0 of the strength of the field */
    real ratio;    /* variance of the disturbance over that of the noise of a reading; 0: none */
    real memory;   /* correlation time as a fraction of the recording */
    real gain;     /* log2 likelihood ratio to white noise, bits */
    real lasts;    /* probability of a correlation time above a third of the recording */
    real strength; /* variance of residuals by variation of the field strength, unit² */
} fl_slow;

typedef struct {
    fl_surface surface;
    real covariance[81]; /* for independent residuals, without unobserved directions */
    real noise;
    real held;
    size_t used;
    int unseen, steps;
    int has_distances; /* 1 if `distances` of the workspace are those of all readings from the surface */
    real median_distance; /* of absolute distances if there are at most FL_SOME; else 0 */
    int is_doubtful; /* of a robust fit: 1 if some rejected readings may be noise; fl_room.far marks the others */
#ifndef FLINDERS_SMALL
    real others[81]; /* of a robust fit: covariance by the choice of the majority; 0 if that is unique */
    fl_slow slow;
#endif
    fl_posterior posterior;
} fl_fit;

int fl_polish(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, const fl_surface *start,
              int most_steps, real *copy, fl_fit *fit);
void fl_add_known(const real expected[9], const real information[81], const fl_surface *surface, real matrix[81],
                  real gradient[9], real *cost);

/* heading.c, for guidance */
void fl_upright(const real down[3], real turn[9]);
void fl_level_rows_about(const fl_surface *surface, real dip_deg, const real *turn, real *rows, int stride);
void fl_direction_rows(const fl_surface *surface, const real direction[3], real rows[3][9]);

/* guidance.c */
#ifdef FLINDERS_SMALL /* only level headings */
enum { FL_PARTS = 1, FL_WANTED = FL_HEADINGS };
#else
enum { FL_PARTS = 3, FL_WANTED = 100 };
#endif

/* Quantities of a goal: `count` numbers, each with a variance that is the sum over its parts. */
typedef struct {
    int count, parts;
    real rows[FL_PARTS][9][FL_WANTED]; /* derivatives of the parts by the nine parameters, rad/unit */
} fl_wanted;

int fl_wanted_of(const fl_surface *surface, const flinders_goal *goal, const real (*directions)[3], int count,
                 fl_wanted *wanted);
void fl_wanted_variances(const fl_wanted *wanted, const real covariance[81], real variances[FL_WANTED]);
real fl_lever(const real covariance[81], const real jacobian[9], real variance, real lever[9]);
int fl_are_finite(const real *numbers, int count);
real fl_sharp(real variance, real largest);

#define FL_ALIKE ((real)1e-9) /* relative difference below which scores are equal, and the first one is used */

#endif
