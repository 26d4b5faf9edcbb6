/* What the steps of a fit hand to each other, and the memory that they borrow. */
#ifndef FLINDERS_RECORD_H
#define FLINDERS_RECORD_H

#include "internal.h"

#define FL_EMPTY UINT64_MAX /* key of a slot that is free */

enum { FL_SLOTS = 16384, FL_TABLE = 8192, FL_CELLS = 4096,
       FL_ELLIPSOID = 10, FL_ELLIPSE = 6, /* unknowns, the noise among them, ... */
       FL_AXES = 3, FL_AXES_OF_PLANE = 2, /* ... and axes that have to change */
       FL_STRETCHES = 12, FL_STRETCH = FL_LOOKED / FL_STRETCHES };

#ifdef FLINDERS_FLOAT
#define FL_SMALLEST 1e-6 /* fourth powers and their inverses are numbers */
#define FL_LARGEST 1e6
#else
#define FL_SMALLEST 1e-12
#define FL_LARGEST 1e15
#endif

/* The caller's memory, cut up. */
typedef struct {
    real *distances;         /* (rows,) */
    real *scratch;           /* (rows,) */
    real *columns;           /* (FL_COLUMNS, apart) Jacobian and distance of each, and what else may explain it */
    size_t apart;            /* min(rows, FL_LOOKED) and some more */
    uint32_t *order;         /* (2 * min(rows, FL_ENOUGH),) places in random order, and rows of a sample; cells of the sphere */
    size_t *begins;          /* (min(rows, 12 * 1024) + 2,) */
    unsigned char *rejected; /* (rows,) */
    unsigned char *far;      /* (rows,) */
    unsigned char *passed;   /* (rows,) readings that a sample leaves out */
    uint64_t *keys;          /* (FL_SLOTS,) */
    real *cells;             /* (4 * FL_SLOTS,) counts and sums */
    unsigned char *counters; /* (FL_TABLE,) */
    real *directions;        /* (3, FL_LOOKED) of the readings whose Jacobian there is */
    real *some;              /* (3 * min(rows, FL_ENOUGH),) readings that a fit is iterated on */
    real *matrices;          /* (2 * 100 * 100,) covariance of a distortion, cell by cell */
    real *series;            /* (12 * min(rows, FL_LOOKED),) averages of successive residuals */
    const real *time;        /* (rows,) or NULL; not of the workspace */
    const int64_t *ends;     /* (parts,) of the recordings that the readings are; not of the workspace */
    size_t parts;
    real *fitted;            /* (3 * rows,) readings that a fit goes by; NULL: rests are not looked for */
    real *fitted_time;     /* (rows,) */
    int64_t *fitted_ends;  /* (rows,) */
    real *flat;            /* (3 * rows,) readings laid flat */
    size_t slots;            /* of the table of cells that `fl_cloud` has made of all readings */
    real fullest;            /* readings of the cell that has most of them */
    real side;               /* of a cell */
} fl_room;

/* The slot of a key in a table that is never full, free or its own. */
static inline size_t fl_slot(const uint64_t *keys, size_t slots, uint64_t key)
{
    uint64_t mixed = key * UINT64_C(0x9E3779B97F4A7C15);
    size_t slot = (size_t)(mixed >> 40) & (slots - 1);
    while (keys[slot] != FL_EMPTY && keys[slot] != key) slot = (slot + 1) & (slots - 1);
    return slot;
}

/* The distances of the readings whose Jacobian there is, behind nine columns of that. */
static inline real *fl_column_of_distances(const fl_room *room) { return room->columns + 9 * room->apart; }

/* rests.c: a search for rests, which goes through them once. */
typedef struct {
    const real *field;
    size_t rows;
    const int64_t *ends;     /* (parts,) of the recordings that the readings are */
    size_t parts;
    real origin[3];          /* mean of the readings, of a long recording of some of them */
    real far;                /* distance from that which few readings are beyond, unit */
    real still, noisy;       /* most that a rest moves and that its readings scatter, unit */
    real chance;             /* share of the variance of a window that chance may add to it */
    size_t half, windows;    /* readings of half a window, and how many windows there are, half over half */
    unsigned char *is_still; /* (windows,) */
    int are_left_out;        /* a fit leaves them out; else each is one reading of it */
    size_t window, end;      /* where the search goes on */
} fl_rests;

/* Where readings go when each rest becomes one. */
typedef struct {
    real *field;              /* (rows, 3); may be where the readings are */
    const real *time_of_all;  /* (rows,) or NULL */
    real *time;               /* (rows,) or NULL, as that */
    int64_t *ends;            /* (parts,) */
} fl_fitted;

void fl_rests_begin(const real *field, size_t rows, const int64_t *ends, size_t parts, real *scratch,
                    unsigned char *is_still, fl_rests *rests);
void fl_rests_rewind(fl_rests *rests);
int fl_rests_next(fl_rests *rests, size_t *begin, size_t *end);
size_t fl_rests_fitted(fl_rests *rests, const fl_fitted *out);

/* runs.c: readings that are marked, and those of them that are far. */
typedef struct {
    size_t all, far;
} fl_marked;

fl_marked fl_mark_runs(const unsigned char *far, size_t rows, int dense, unsigned char *out);

/* swap.c */
void fl_swaps(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, flinders_record *record);
void fl_confirm_swaps(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                      flinders_record *record);

/* Readings to be fitted. */
typedef struct {
    const fl_kernels *kernels;
    const flinders_options *options;
    fl_view all, view; /* as they came, and those that a fit goes by */
    const real *time;  /* (all.rows,) or NULL */
    const int64_t *ends;
    size_t parts;
    fl_room room;
} fl_task;

/* Covariances of readings: of all, and of those that are no outliers. */
typedef struct {
    real all[6], inliers[6];
} fl_scatter;

/* level.c */
int fl_may_be_turn(const flinders_record *record, const flinders_options *options);
int fl_are_flat(const fl_scatter *readings, real noise, real within);
int fl_fit_turn(fl_task *of, flinders_record *record);
int fl_is_turn(const flinders_record *ellipsoid, const flinders_record *turn, const fl_scatter *readings,
               const flinders_options *options);

/* What a fit knows of the majority that it was made of. */
typedef struct {
    int few;                  /* steps after which outliers are looked for */
    real centre[3], shape[6]; /* of the surface that the distances of outliers were taken from, unit */
    real beyond;              /* distance from which on they are rejected, unit */
    int dense, is_robust;     /* as in a record; so is ... */
    int64_t rejected;
} fl_majority;

/* fit.c: with little memory, and no statistics asked for, a room without `keys` and `some` will do; `scratch` may then be
 * the first half of `order`, and `distances` the second. */
void fl_clear_record(flinders_record *record);
void fl_place(const fl_surface *surface, flinders_record *record);
void fl_place_sums(const flinders_sums *sums, flinders_record *record);
void fl_place_fit(const fl_fit *fit, flinders_record *record);
int fl_fit_majority(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                    const fl_surface *start_of_majority, const fl_room *room, fl_fit *fit, fl_majority *majority);
int fl_fit_from(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
                const fl_surface *start_of_majority, const fl_room *room, fl_fit *fit, flinders_record *record);
int fl_look(const fl_kernels *kernels, fl_view *view, const flinders_options *options, int fewest, int axes, fl_room *room,
            flinders_record *record);
int fl_fit_looked(const fl_kernels *kernels, fl_view *view, const flinders_options *options, fl_room *room, fl_fit *fit,
                  flinders_record *record);
int fl_fit_view(const fl_kernels *kernels, fl_view *view, const flinders_options *options, fl_room *room, fl_fit *fit,
                flinders_record *record);
int fl_room_of(void *workspace, size_t size, size_t rows, fl_room *room);
int fl_quality(const fl_kernels *kernels, const real *field, const real *time, size_t rows, flinders_record *record);
int64_t fl_repeats(const real *field, size_t rows);
int64_t fl_distinct(const real *field, size_t rows, const fl_room *room);
void fl_covariance(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, fl_fit *fit,
                   const fl_room *room, flinders_record *record);
void fl_residual_statistics(const fl_kernels *kernels, const fl_view *all, const fl_view *view, const fl_fit *fit,
                            const fl_room *room, flinders_record *record);
enum { FL_SUSPECTS = 2 };

int fl_asks_for_robust(const fl_kernels *kernels, const fl_view *view, fl_fit *fit, const fl_room *room);
int fl_robust(const fl_kernels *kernels, fl_view *view, const flinders_options *options, const fl_surface *start,
              const fl_room *room, fl_fit *fit, fl_majority *majority);
void fl_drift(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real dip_deg,
              const fl_room *room, flinders_record *record);
void fl_axes(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, real dip_deg, int has_sigma,
             const fl_room *room, flinders_record *record);
void fl_forget_outliers(fl_view *view, fl_majority *majority);
void fl_inlier_covariance(const fl_kernels *kernels, const fl_view *view, const fl_surface *surface, real limit,
                          const fl_room *room, real covariance[6]);
void fl_covariance_of(const fl_kernels *kernels, const fl_view *view, const flinders_options *options, fl_fit *fit,
                      const fl_room *room, flinders_record *record);
int fl_ellipse_start(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, fl_surface *surface);
real fl_cell_side(const real *field, size_t rows);
void fl_cloud(const fl_kernels *kernels, const real *field, size_t rows, fl_room *room);
int fl_cloud_of_any(const fl_kernels *kernels, const real *field, size_t rows, fl_room *room);
size_t fl_slots_for(size_t rows);
real fl_median(real *values, size_t n);
void fl_coverage(const fl_kernels *kernels, const fl_surface *surface, real within, const fl_room *room,
                 flinders_record *record);

#endif
