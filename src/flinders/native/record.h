/* Shared data of the steps of a fit, and their workspace. */
#ifndef FLINDERS_RECORD_H
#define FLINDERS_RECORD_H

#include "internal.h"

#define FL_EMPTY UINT64_MAX /* key of a free slot */

enum { FL_SLOTS = 16384, FL_TABLE = 8192, FL_CELLS = 4096,
       FL_ELLIPSOID = 10, FL_ELLIPSE = 6, /* number of unknowns, including the noise */
       FL_AXES = 3, FL_AXES_OF_PLANE = 2, /* number of axes that must vary */
       FL_STRETCHES = 12, FL_STRETCH = FL_LOOKED / FL_STRETCHES };

#ifdef FLINDERS_FLOAT
#define FL_SMALLEST 1e-6 /* fourth powers and their inverses neither underflow nor overflow */
#define FL_LARGEST 1e6
#else
#define FL_SMALLEST 1e-12
#define FL_LARGEST 1e15
#endif

/* Arrays in the caller's workspace. */
typedef struct {
    real *distances;         /* (rows,) */
    real *scratch;           /* (rows,) */
    real *columns;           /* (FL_COLUMNS, apart) Jacobian and distance of readings, and further regressors */
    size_t apart;            /* distance between columns: min(rows, FL_LOOKED) and padding */
    uint32_t *order;         /* (2 * min(rows, FL_ENOUGH),) indices in random order, and rows of a sample; cells of the sphere */
    size_t *begins;          /* (min(rows, 12 * 1024) + 2,) */
    unsigned char *rejected; /* (rows,) */
    unsigned char *far;      /* (rows,) */
    unsigned char *passed;   /* (rows,) marks readings outside a sample */
    uint64_t *keys;          /* (FL_SLOTS,) */
    real *cells;             /* (4 * FL_SLOTS,) counts and sums */
    unsigned char *counters; /* (FL_TABLE,) */
    real *directions;        /* (3, FL_LOOKED) of the readings in `columns` */
    real *some;              /* (3 * min(rows, FL_ENOUGH),) readings for the iterations of a fit */
    real *matrices;          /* (2 * 100 * 100,) covariance of a distortion between cells */
    real *series;            /* (12 * min(rows, FL_LOOKED),) averages of successive residuals */
    const real *time;        /* (rows,) or NULL; outside the workspace */
    const int64_t *ends;     /* (parts,) end rows of the recordings; outside the workspace */
    size_t parts;
    real *fitted;            /* (3 * rows,) readings after averaging of rests; NULL: rests are not detected */
    real *fitted_time;     /* (rows,) */
    int64_t *fitted_ends;  /* (rows,) */
    real *flat;            /* (3 * rows,) readings projected into a plane */
    size_t slots;            /* size of the hash table of cells by `fl_cloud` */
    real fullest;            /* largest number of readings in a cell */
    real side;               /* of a cell */
} fl_room;

/* Slot of a key in a hash table that is never full: that with the key, or a free one. */
static inline size_t fl_slot(const uint64_t *keys, size_t slots, uint64_t key)
{
    uint64_t mixed = key * UINT64_C(0x9E3779B97F4A7C15);
    size_t slot = (size_t)(mixed >> 40) & (slots - 1);
    while (keys[slot] != FL_EMPTY && keys[slot] != key) slot = (slot + 1) & (slots - 1);
    return slot;
}

/* Column of distances, after the nine columns of the Jacobian. */
static inline real *fl_column_of_distances(const fl_room *room) { return room->columns + 9 * room->apart; }

/* rests.c: state of a search for rests, in one pass. */
typedef struct {
    const real *field;
    size_t rows;
    const int64_t *ends;     /* (parts,) end rows of the recordings */
    size_t parts;
    real origin[3];          /* mean of the readings, for a long recording of some of them */
    real far;                /* distance from the origin that few readings exceed, unit */
    real still, noisy;       /* largest motion and largest noise in a rest, unit */
    real chance;             /* largest fraction of a window's variance by chance */
    size_t half, windows;    /* number of readings of half a window, and number of windows, which overlap by half */
    unsigned char *is_still; /* (windows,) */
    int are_left_out;        /* 1 if a fit leaves rests out; else it averages each */
    size_t window, end;      /* position of the search */
} fl_rests;

/* Output arrays of the averaging of rests. */
typedef struct {
    real *field;              /* (rows, 3); may be the input array */
    const real *time_of_all;  /* (rows,) or NULL */
    real *time;               /* (rows,), or NULL if `time_of_all` is */
    int64_t *ends;            /* (parts,) */
} fl_fitted;

void fl_rests_begin(const real *field, size_t rows, const int64_t *ends, size_t parts, real *scratch,
                    unsigned char *is_still, fl_rests *rests);
void fl_rests_rewind(fl_rests *rests);
int fl_rests_next(fl_rests *rests, size_t *begin, size_t *end);
size_t fl_rests_fitted(fl_rests *rests, const fl_fitted *out);

/* runs.c: number of marked readings, and of far ones among them. */
typedef struct {
    size_t all, far;
} fl_marked;

fl_marked fl_mark_runs(const unsigned char *far, size_t rows, int dense, unsigned char *out);

/* swap.c */
void fl_swaps(const fl_kernels *kernels, const real *field, size_t rows, const fl_room *room, flinders_record *record);
void fl_confirm_swaps(const fl_kernels *kernels, const fl_view *view, const fl_fit *fit, const fl_room *room,
                      flinders_record *record);

/* A fit to run. */
typedef struct {
    const fl_kernels *kernels;
    const flinders_options *options;
    fl_view all, view; /* readings of the recording, and those after averaging of rests */
    const real *time;  /* (all.rows,) or NULL */
    const int64_t *ends;
    size_t parts;
    fl_room room;
} fl_task;

/* Covariances of all readings, and of inliers. */
typedef struct {
    real all[6], inliers[6];
} fl_scatter;

/* level.c */
int fl_may_be_turn(const flinders_record *record, const flinders_options *options);
int fl_are_flat(const fl_scatter *readings, real noise, real within);
int fl_fit_turn(fl_task *of, flinders_record *record);
int fl_is_turn(const flinders_record *ellipsoid, const flinders_record *turn, const fl_scatter *readings,
               const flinders_options *options);

/* Majority of a robust fit. */
typedef struct {
    int few;                  /* number of steps before outliers are searched */
    real centre[3], shape[6]; /* of the surface from which distances of outliers are measured, unit */
    real beyond;              /* distance above which they are rejected, unit */
    int dense, is_robust;     /* as in a record, and so is `rejected` */
    int64_t rejected;
} fl_majority;

/* fit.c: without statistics, a workspace needs no `keys` and `some`; `scratch` may then be the first half of `order`, and
 * `distances` the second, to save memory. */
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
