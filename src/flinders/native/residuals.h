/* Residuals in the order of recording, and their correlation. */
#ifndef FLINDERS_RESIDUALS_H
#define FLINDERS_RESIDUALS_H

#include "record.h"

enum { FL_BLOCKS = 8, FL_SERIES = 2048 };

#ifdef FLINDERS_SMALL
enum { FL_LAGS = 128 }; /* a quarter of the readings */
#else
enum { FL_LAGS = 1000 };
#endif

typedef struct {
    size_t n;
    int stretches, width; /* number of stretches, and of columns of the Jacobian */
    size_t *begins;  /* (stretches + 1,) first index of each stretch of successive readings, and the end */
    real *columns[FL_COLUMNS]; /* (n,) each: the Jacobian, and other terms after or before it */
    real *distances; /* (n,) minus the regression */
    real *weights;   /* (n,) 1, or 0 for a copy of another reading; NULL if there are no copies; set by fl_distortion */
    real *directions; /* (3, FL_LOOKED) */
    real *scratch;    /* (3, n) for fl_sort_by_direction */
    uint32_t *cells; /* (n,) cell of the sphere; set by fl_sort_by_direction */
    real axes[3][3]; /* rows: axes of these cells; set by fl_sort_by_direction */
    uint32_t *places; /* (n,) rows of the readings; set by fl_gather_evenly */
} fl_residuals;

/* Normal matrices and gradients of successive blocks of a recording. */
typedef struct {
    real squares[FL_BLOCKS][81], gradients[FL_BLOCKS][9];
} fl_blocks;

void fl_all_columns(const fl_residuals *residuals, real *columns[FL_COLUMNS]);
void fl_gram(const fl_kernels *kernels, const fl_residuals *residuals, size_t begin, size_t n, real *products);
void fl_normal_equations(const real *products, int columns, int first, int width, real *matrix, real *gradient);
void fl_blocks_of(const fl_kernels *kernels, const fl_residuals *residuals, fl_blocks *blocks);

real fl_lag_one(const fl_residuals *residuals);
real fl_steps_kurtosis(const fl_residuals *residuals);
int fl_autocovariance(const fl_residuals *residuals, real out[FL_LAGS]);
real fl_time_of(const real *autocovariance, int lags);
void fl_scatter_in_time(const fl_kernels *kernels, const fl_residuals *residuals, const real *white,
                        const real *autocovariance, int lags, real *scatter);
real fl_creep(fl_blocks *blocks, const real scatter[81]);
void fl_sort_by_direction(const fl_kernels *kernels, fl_residuals *residuals);
real fl_distortion(fl_residuals *residuals, const fl_surface *surface, int has_copies, size_t apart, real time,
                   real known, const fl_room *room, real scatter[81]);
real fl_likely_distortion(fl_residuals *residuals, const fl_surface *surface, int has_copies, size_t apart, real slow,
                          const fl_room *room);
void fl_likelihoods_of_variation(const fl_residuals *residuals, const fl_surface *surface, real time, const real *ratios,
                                 int count, const fl_room *room, real *likelihoods);
real fl_common_variance(const fl_residuals *residuals);
void fl_raise(real *scatter, const real *white, int n, real share);
int fl_slow_noise(const fl_kernels *kernels, const fl_view *view, const fl_residuals *residuals, const fl_fit *fit,
                  const fl_room *room, int is_assumed, fl_slow *slow, real step[9], real covariance[81], real without[81]);
real fl_alike(const real a[3], const real b[3]);
real fl_expected_variation(const fl_residuals *residuals, const fl_surface *surface, const fl_room *room);
void fl_scatter_of_variation(const fl_residuals *residuals, real variance, size_t used, real scatter[81]);
int fl_principal(const real *matrix, int n, real *values, real *vectors);
real fl_chance_of(real chi_square, real freedom, real others);
int fl_chi_square(const real *change, const real *covariance, int n, real *square);
/* regression.c */
typedef struct {
    fl_residuals left; /* residuals before the solution is subtracted */
    real matrix[FL_WIDEST * FL_WIDEST], gradient[FL_WIDEST], solution[FL_WIDEST];
    real gained[FL_WIDEST]; /* sum of squares that each column explains in addition to the previous ones */
    real square; /* residual sum of squares */
} fl_regression;

void fl_begin_residuals(const fl_room *room, fl_residuals *out);
size_t fl_gather_evenly(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                        int are_there, fl_residuals *out);
void fl_whiten(fl_residuals *residuals, int before, const fl_slow *slow);
int fl_regress(const fl_residuals *all, const real *products, int first, int width, fl_regression *out);
real fl_chance_of_terms(const fl_kernels *kernels, const fl_regression *of, int first, int count, const fl_room *room,
                        const flinders_record *record);
void fl_covariance_of_terms(const fl_kernels *kernels, const fl_regression *of, const fl_room *room,
                            const flinders_record *record, real *covariance);
real fl_covariance_of_solution(const fl_kernels *kernels, const fl_residuals *residuals, const real *matrix,
                               const real *inverse, real *covariance);
int fl_is_noisy(const fl_residuals *residuals, const fl_surface *surface);

#define FL_PROVEN ((real)1e-4) /* p-value below which terms of the axes are significant, as MAX_P_VALUE of systematic.py */

void fl_distort(const fl_surface *surface, real error_deg, real dip_deg, flinders_record *record);
int fl_is_same_throughout(const fl_kernels *kernels, const fl_regression *found, int nine, const fl_room *room,
                          const flinders_record *record);

/* axes.c: columns are two terms for delays of the axes, the Jacobian, six nonlinear terms, and the distance. */
enum { FL_LAGS_OF_AXES = 2, FL_NONLINEAR = 6 };

void fl_gather_axes(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                    int are_there, fl_residuals *out);
void fl_add_lags(const fl_view *view, const fl_room *room, fl_residuals *all);
void fl_nonlinearity(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, const fl_room *room,
                     const fl_regression *found, real by_chance, int is_of_axes, real dip_deg, flinders_record *record);
void fl_nonlinear_sigma(const fl_kernels *kernels, const fl_surface *surface, const fl_room *room,
                        const fl_regression *found, real dip_deg, flinders_record *record);
void fl_lag(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
            const fl_regression *found, real by_chance, int is_of_axes, real dip_deg, flinders_record *record);

void fl_sphere_centres(real centres[100][3]);

#endif
