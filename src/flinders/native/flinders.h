/* flinders.h - calibrates three-axis magnetometers: one small library in C99, without allocation and without state.
 *
 * A reading x of a magnetometer that meets a field of constant strength lies on the ellipsoid b + S u, with a unit
 * vector u. The library finds the offset b and the symmetric shape S by maximum likelihood, says how sure it is, and
 * fills one flat record per recording with everything that a verdict needs. S⁻¹(x − b) is the corrected direction.
 *
 * Units. Readings may come in any unit (microtesla, counts); "unit" below means that unit. Angles are in degrees where
 * the name ends in _deg, times in seconds. Symmetric 3 × 3 matrices are six numbers: 11, 22, 33, 12, 13, 23. The nine
 * parameters of a fit are b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃.
 *
 * Errors. Every function returns a status, FLINDERS_OK or what was wrong; whatever the numbers are, it returns. The
 * record then holds NaN where nothing is known.
 *
 * Memory. The caller lends a workspace of `flinders_workspace_size(rows)` bytes, aligned as malloc's; a recording of
 * any number of rows up to those may use it. Several threads may call at once, each with a workspace of its own.
 *
 * Example (it is compiled and run by tests/agreement/test_native.py):
 *
 *     flinders_options options;
 *     flinders_record record;
 *     flinders_default_options(&options);
 *     int status = flinders_fit(field, NULL, rows, &options, workspace, size, &record);
 *     if (status == FLINDERS_OK)
 *         printf("offset %.1f %.1f %.1f\n", record.centre[0], record.centre[1], record.centre[2]);
 *     else
 *         puts(flinders_message(status));
 */
#ifndef FLINDERS_H
#define FLINDERS_H

#include <stddef.h>
#include <stdint.h>

#include "flinders_rules.h" /* made from the library's catalogue of findings: names of quantities, findings, conditions */

#if defined(_WIN32)
#define FLINDERS_API __declspec(dllexport)
#elif defined(__GNUC__)
#define FLINDERS_API __attribute__((visibility("default")))
#else
#define FLINDERS_API
#endif

#ifdef FLINDERS_FLOAT
typedef float flinders_real; /* for processors without double precision: about five digits of a calibration */
#else
typedef double flinders_real;
#endif

#define FLINDERS_RECORD_VERSION 1
#define FLINDERS_ONLINE_VERSION 2

/* What a function returns. */
enum {
    FLINDERS_OK = 0,
    FLINDERS_TOO_FEW = 1,         /* fewer different readings than the ten unknowns, or than a refresh needs */
    FLINDERS_NOT_FINITE = 2,      /* a reading is NaN or infinite */
    FLINDERS_OUT_OF_SCALE = 3,    /* the largest reading is no number that a magnetometer reads (1e-12 to 1e15) */
    FLINDERS_STUCK_AXIS = 4,      /* an axis never changes */
    FLINDERS_UNMOVED = 5,         /* readings vary by less than a thousandth of their mean */
    FLINDERS_NOT_AN_ELLIPSOID = 6, /* no closed surface fits */
    FLINDERS_UNDETERMINED = 7,    /* readings leave parameters open, and there is no prior */
    FLINDERS_NO_WORKSPACE = 8,    /* the workspace is too small */
    FLINDERS_BAD_OPTION = 9       /* an option is no number that it can be */
};

/* Runs of outliers. */
enum {
    FLINDERS_WINDOW = 11,  /* readings in a row that are looked at together: 0.2 s at 50 Hz */
    FLINDERS_NO_RUN = 12,  /* far readings of a window, more than it holds: no run is looked for */
    FLINDERS_MARGIN = 25,  /* readings before and after a run that go with it: 0.5 s at 50 Hz, in which a magnet fades away */
    FLINDERS_OUTLIERS = 1000 /* runs of a recording that are listed; those beyond count with the last */
};

/* What to do; `flinders_default_options` fills it. */
typedef struct flinders_options {
    flinders_real prior;   /* departure of the shape from a sphere that is likely, a fraction; 0: no prior (0.3) */
    flinders_real dip_deg; /* inclination of the field, for the heading errors, -89 to 89 (60); its sign may be the
                              other one for a sensor that the readings show upside down */
    int32_t robust;        /* reject outliers: 0 never, 1 where residuals ask for it, 2 always (1) */
    int32_t kernels;       /* 0 the best of this processor, 1 the baseline, 2 AVX2 (0) */
    int32_t statistics;    /* 1: coverage, tails, jumps, swaps, distinct readings; 2: also what is not known of terms of the
                              axes, and a covariance with it; 0: the fit alone (1) */
    int32_t rests;         /* 1: what is read while the direction stands still is one reading, its mean, or none beside a long
                              turn; 0: each reading counts (1) */
    int32_t level;         /* 1: readings in one plane across z, as of a car or a boat that turns level, get the ellipse of that
                              turn (record.plane is 1) where there is a prior; 0: always an ellipsoid (1) */
    int32_t bias_correction; /* 1: subtract what noise causes on a curved surface; 0: the minimum of Σ s² itself (1) */
#ifndef FLINDERS_SMALL
    int32_t is_informed;     /* 1: the nine parameters are normally distributed beforehand, and `prior` does not count (0) */
    flinders_real expected[9]; /* mean of that distribution, unit ... */
    flinders_real information[81]; /* ... and the inverse of its covariance, 1 / unit²; zeros where nothing is known */
#else
    const struct fl_known *known; /* the same for the library itself (NULL) */
#endif
} flinders_options;

/* Sums of powers of readings, about an origin: all that an ellipsoid needs. They add. */
typedef struct flinders_sums {
    flinders_real sums[35];  /* of xⁱyʲzᵏ: 1, x, y, z, x², xy, y², xz, yz, z², ... of (reading - origin)/scale */
    flinders_real origin[3]; /* unit */
    flinders_real scale;     /* unit; a power of two where digits are to be kept */
} flinders_sums;

/* Everything that is known of one recording after a fit: a row of a table. NaN where nothing is known. */
typedef struct flinders_record {
    int32_t version;    /* FLINDERS_RECORD_VERSION */
    int32_t status;     /* what the call returned */
    int32_t is_robust;  /* 1 if outliers were looked for and rejected */
    int32_t unobserved; /* combinations of parameters that readings say nothing of, 0 to 9 */
    int32_t steps;      /* Gauss-Newton steps */
    int32_t is_white;   /* 1 if residuals are independent */
    int32_t lags;       /* autocovariances above their noise, that of lag 0 included */
    int32_t hides_plane; /* 1 if readings may lie in one plane across z, as those of a level turn, but for outliers */
    int32_t dense;      /* far readings of eleven that make a run; 12: no run was looked for */
    int64_t rows;       /* readings given */
    int64_t rests;      /* intervals in which the direction stands still */
    int64_t at_rest;    /* readings given of these */
    int64_t fitted;     /* readings that the fit goes by: a rest is one, or none beside a long turn; of them ... */
    int64_t fitted_repeats; /* ... those equal to the one before, and ... */
    int64_t fitted_distinct; /* ... different ones */
    int64_t used;       /* readings of the fit */
    int64_t rejected;   /* readings left out as outliers, as those that the fit goes by */
    int64_t repeats;    /* readings equal to the one before */
    int64_t longest_repeat; /* most equal readings in a row */
    int64_t distinct;   /* different readings; beyond 4096 of them from a sample of those */
    int64_t end_counts[6]; /* readings at the lowest x, y, z and at the highest x, y, z */
    int64_t rails;      /* ends at which the sensor was at its limit: bit i for end i of `end_counts` */
    int64_t swaps[6];   /* moments at which x, y or z changed sign, or x and y, y and z, z and x were exchanged */
    int64_t first_swap[6]; /* the first row behind the first of each; -1: none */
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real radius;         /* geometric mean of the semi-axes, unit */
    flinders_real noise;          /* standard deviation of the distances from the surface, unit */
    flinders_real covariance[81]; /* of the nine parameters: residuals as they are correlated, other majorities, unit² */
    flinders_real textbook[81];   /* the same for independent residuals, unit² */
    flinders_real prior_influence;    /* largest share of the prior in what is known of any combination of parameters */
    flinders_real rejected_beyond; /* distance from the surface, unit; 0 if none was rejected */
    flinders_real majority_centre[3]; /* of the surface that the distances of outliers were taken from, unit */
    flinders_real majority_shape[6];  /* of the same, unit */
    flinders_real dip_deg;        /* inclination of the heading errors, with the sign that the readings show */
    flinders_real level_rms_deg;  /* heading error of a level vehicle, 1 sigma, over all headings */
    flinders_real level_worst_deg; /* at the worst heading */
    flinders_real direction_rms_deg; /* error of the direction of the field, 1 sigma, over the sphere */
    flinders_real direction_worst_deg; /* in the worst direction */
    flinders_real mean[3];        /* of the readings, unit */
    flinders_real spread;         /* root mean square distance from their mean, unit */
    flinders_real principal_variances[3]; /* along the principal axes, ascending, unit² */
    flinders_real lowest[3];      /* smallest reading of each axis, unit */
    flinders_real highest[3];     /* largest reading of each axis, unit */
    flinders_real step;           /* between the last two values of an axis that is read in coarse steps, unit; 0: none is */
    flinders_real coverage;       /* share of a hundred equal cells of the sphere that hold a reading */
    flinders_real upright;        /* mean height of the directions, -1 to 1 */
    flinders_real hole_deg;       /* angle from the middle of the largest gap to the nearest direction */
    flinders_real hole[3];        /* middle of that gap, a unit vector in corrected axes */
    flinders_real median_distance; /* of the readings from the surface, or of 5,000 spread over them, unit */
    flinders_real farthest;       /* largest distance from the surface, unit */
    flinders_real kurtosis;       /* of the distances; 3 for normal noise */
    flinders_real lag_one;        /* correlation of one distance with the next */
    flinders_real correlation_time; /* readings that say as much as one independent one */
    flinders_real distortion;     /* standard deviation of what belongs to the direction, not to the moment, unit */
    flinders_real excess_variance; /* factor by which blocks scatter more than that allows, in variance */
    flinders_real noise_lasts;    /* probability that slow noise lasts longer than a third of the recording; NaN: none */
    flinders_real steps_kurtosis; /* of steps between means of successive distances; 3 for normal noise; NaN: not told */
    flinders_real drift_offset[3]; /* change of the offset from the first reading to the last, unit; NaN: nothing is known */
    flinders_real drift_strength; /* change of the field, a fraction of it */
    flinders_real drift_deg;      /* what that change of the offset does to a level heading, at the worst one */
    flinders_real drift_by_chance; /* how often chance alone makes as much */
    flinders_real nonlinearity[6]; /* of x, y, z in the square and in the cube of the distance from the centre over the
                                      radius, a fraction of the radius; NaN: nothing is known */
    flinders_real nonlinear_deg;  /* what they do to a level heading, at the worst one */
    flinders_real nonlinear_by_chance; /* how often chance alone makes as much */
    flinders_real nonlinear_sigma_deg; /* what is not known of them, beside what is in `covariance` then, does to a
                                          heading at any attitude, 1 sigma; where statistics were 2 */
    flinders_real axis_lag[3];    /* of x, y, z about their mean, s, or readings where there are no times; NaN: nothing
                                     is known */
    flinders_real lag_deg;        /* what they do to a level heading of a vehicle at rest, at the worst one */
    flinders_real lag_by_chance;  /* how often chance alone makes as much */
    flinders_real largest_jump;   /* largest step from one reading to the next, over the median of 5,000 that are one */
    flinders_real path_correlation; /* of one reading with the next, of 5,000: 1 of a slow turn, 0 without any order */
    flinders_real sums[35];       /* sums of powers about `sums_origin`, see flinders_sums */
    flinders_real sums_origin[3]; /* unit */
    flinders_real sums_scale;     /* unit */
    flinders_real start;          /* first time, s; NaN without times */
    flinders_real end;            /* last time, s */
    flinders_real longest_step;   /* between two times, s */

    /* What a fit leaves NaN, or 0, and whoever finds it out fills in before the record is judged. */
    flinders_real halves_apart;   /* how far the halves of the recording are apart, over what both claim */
    flinders_real swap_gain;      /* factor by which undoing swaps of axes lowers the noise */
    flinders_real unmodelled_deg; /* what a recorded disturbance that is not modelled makes of a level heading */
    flinders_real attitude_dependent_deg; /* what follows the attitude by an accelerometer makes of it */
    flinders_real tilt_error_deg; /* what the tilt by an accelerometer adds to a heading */
    flinders_real apart_deg;      /* how far several recordings of the sensor are apart, ... */
    flinders_real apart_sigma_deg; /* ... what they claim of it, 1 sigma, ... */
    flinders_real apart_by_chance; /* ... and how often chance alone makes as much */
    flinders_real bias_deg;       /* what the bias of the method makes of a level heading, rms */
    flinders_real alignment_deg;  /* what a mounting that an aiding sensor has found leaves open of a level heading */
    flinders_real linearized_deg; /* what is not known of axes that are linearized makes of a heading, 1 sigma */
    flinders_real linearized_share; /* what the worst of them reads too much, a fraction of the field */
    flinders_real soft_iron_p_value; /* how often chance alone makes readings contradict earlier soft iron as much */
    flinders_real poses_by_chance; /* the same of poses at known headings */
    flinders_real site_strength;  /* strength of the field at the site, unit; NaN: it does not count, or none is known */
    flinders_real strength_found; /* mean semi-axis as the readings alone show it, unit, and ... */
    flinders_real strength_sigmas; /* ... how far the two are apart, over what is not known of both; the site's was used where
                                      no rule speaks against it */

    int64_t backward_steps;       /* steps of the clock that go back */
    int64_t skipped;              /* rows that could not be read; -1: not known, ... */
    int64_t silent;               /* ... rows at which the sensor did not answer, ... */
    int32_t is_doubtful;          /* ... and whether columns without names have the length of gravity */
    int32_t plane;                /* of a level turn that the fit rests on: 1 xy, 2 yz, 3 zx; 0: it rests on none */
    int32_t sources;              /* what helped beside the magnetometer: FLINDERS_AIDED ... */
    int32_t is_claimed;           /* 1 once `flinders_claim` has widened the covariance */
    int32_t is_shrunk;            /* 1 if `flinders_claim` found readings that were corrected before, and shrunk the fit; -1
                                     if it looked and found none */
    int32_t z_axis;               /* of a level turn: FLINDERS_Z_DOWN ... */
    flinders_real repetition;     /* readings for each one that no other repeats, as far as residuals do not show it */
} flinders_record;

/* What helped a fit beside the readings of one magnetometer: bits of `sources`. */
enum {
    FLINDERS_AIDED = 1,           /* other sensors: readings in one plane tell a surface then */
    FLINDERS_AIDED_BY_FIELD = 2,  /* sensors to which the field of a place with iron looks bent */
    FLINDERS_COMPENSATED = 4,     /* recorded disturbances, which the offset follows */
    FLINDERS_REFRESHED = 8,       /* an earlier calibration, whose soft iron it has */
    FLINDERS_AIDED_BY_ATTITUDE = 16 /* an attitude: three equations a reading, whatever directions others cover */
};

/* Where z points in a level vehicle that made a level turn. */
enum {
    FLINDERS_Z_DOWN = 0,      /* down, or nothing rests on it */
    FLINDERS_Z_ELSEWHERE = 1, /* elsewhere, as an accelerometer shows: the dip of the site was left out */
    FLINDERS_Z_OPEN = 2       /* down or up: the dip of the site was used, and nothing shows which */
};

/* The field of a place as far as it is known, and how the sensor is mounted; `flinders_default_site` fills it with NaN and 0.
 * A number without its uncertainty does not count. */
typedef struct flinders_site {
    flinders_real strength;              /* of the field, unit */
    flinders_real gain_sigma;            /* what the mean gain of the sensor may be off by, a fraction, 1 sigma */
    flinders_real inclination_deg;       /* of the field, positive where it points below the horizon */
    flinders_real inclination_sigma_deg; /* 1 sigma */
    flinders_real alignment_sigma_deg;   /* how well z is known to be vertical in a level vehicle, 1 sigma */
    int32_t z_down;                      /* 1: somebody says that z points down in a level vehicle */
} flinders_site;

/* Sums over readings of a level turn and what an accelerometer measured with them, all zero at first: they add. */
typedef struct flinders_vertical {
    flinders_real readings;        /* with an acceleration */
    flinders_real acceleration[3]; /* their sum, m/s² or any other unit */
    flinders_real turn[2];         /* sum of the directions in the ellipse, unit vectors u */
    flinders_real across[2];       /* sum of (a_x + i a_y) times the conjugate of u_x + i u_y, real and imaginary part */
    flinders_real squares;         /* sum of a_x² + a_y² */
} flinders_vertical;

/* The plane that readings of a level turn lie in: z = height + slope · (x, y) from a centre. */
typedef struct flinders_heights {
    flinders_real height;        /* at the centre, unit */
    flinders_real slope[2];
    flinders_real covariance[9]; /* of both, the height first */
} flinders_heights;

/* What is known of a sensor by an earlier calibration; `flinders_earlier_of` fills it. */
typedef struct flinders_earlier {
    flinders_real parameters[9];  /* offset and shape as they are expected, unit */
    flinders_real covariance[81]; /* of these, unit²; a parameter of infinite variance is not known */
    flinders_real distortion;     /* of its record: it belongs to the sensor, unit */
} flinders_earlier;

/* A calibration of a sensor that is compared with another. */
typedef struct flinders_calibrated {
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real covariance[81]; /* claimed, of the nine parameters, unit²; zeros of one that is exact */
    flinders_real strength;       /* of the field, unit; 0 where it is not known: the scale is not compared then */
} flinders_calibrated;

/* How far two calibrations of one sensor are apart. NaN where nothing is known. */
typedef struct flinders_difference {
    flinders_real rms_deg;        /* difference in heading over a level turn, the mean removed */
    flinders_real worst_deg;      /* at the worst heading */
    flinders_real chi_square;     /* of offset and shape, against the sum of both covariances ... */
    flinders_real p_value;        /* ... how often chance alone makes as much ... */
    int32_t freedom;              /* ... and its degrees of freedom; 0 of two that are exact */
    flinders_real sigma_deg;      /* of the difference in heading at the worst heading, by the same sum; 0 of two that are exact */
    flinders_real bound_deg;      /* what that difference errs by at most, at all headings, with a probability of 95 % */
} flinders_difference;

/* Whether a calibration holds: whether its difference from another is within a target. */
enum { FLINDERS_HOLDS = 0, FLINDERS_FAILS = 1, FLINDERS_CANNOT_TELL = 2 };

/* A difference that chance makes less often than this is more than chance explains. */
#define FLINDERS_CHANCE 0.01

/* Standard deviations that a normal error exceeds, on one side, with a probability of 5 %. */
#define FLINDERS_ONE_SIDED 1.645

/* What a disturbance that was recorded beside the readings explains of their distances from a surface. */
typedef struct flinders_disturbance {
    int64_t used;               /* readings that were looked at; 0 where they are too few */
    int64_t stride;             /* every how many-th of the inliers these are */
    flinders_real range;        /* of the disturbance, in its unit */
    flinders_real farthest;     /* of its values from their mean, in its unit */
    flinders_real explained;    /* sum of squares that it explains beside the nine parameters, unit² */
    flinders_real left;         /* sum of squares that nothing explains, unit² */
    flinders_real per_unit[3];  /* by how much it moves the offset for each unit of it */
} flinders_disturbance;

/* What is known of a sensor before its next reading; `flinders_believe` and `flinders_rough` fill it. */
typedef struct flinders_belief {
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real covariance[81]; /* of the nine parameters, unit²; may be singular, where a method holds some of them */
    flinders_real variance;       /* of the distance of a further reading from the surface, unit² */
    flinders_real readings;       /* so far */
} flinders_belief;

/* What further readings are for; `flinders_default_goal` fills it. On a board (FLINDERS_SMALL) headings alone. */
typedef struct flinders_goal {
    int32_t is_attitude;      /* 0 the heading of a level vehicle, 1 the direction of the field at any attitude (0) */
    flinders_real dip_deg;    /* inclination of the field, -89 to 89; not looked at for attitudes (60) */
    flinders_real down[3];    /* which way is down when the vehicle is level, in corrected sensor axes (0, 0, 1) */
    flinders_real target_deg; /* worst error that is good enough, 1 sigma (1) */
} flinders_goal;

/* Where the next readings would tell most. NaN where nothing is known. */
typedef struct flinders_advice {
    flinders_real direction[3]; /* where the field should point: a unit vector in corrected axes, the middle of a cell */
    flinders_real worst_deg;    /* the error that matters, 1 sigma: at the worst heading, or in the worst direction */
    flinders_real after_deg;    /* the same after a batch of readings there */
} flinders_advice;

/* The path that the field should take, as seen from the body. NaN where nothing is known. */
typedef struct flinders_route {
    int32_t count;               /* waypoints, 0 to 6 */
    flinders_real waypoints[18]; /* (count, 3) unit vectors in corrected axes, on great circles one after the other */
    flinders_real worst_deg;     /* the error that matters, 1 sigma */
    flinders_real after_deg;     /* the same at the end of the path */
} flinders_route;

/* Readings of the evidence of a calibration that keeps itself; on a board 80 to 512, of 27 bytes each in single precision, those
 * of its workspace included. */
#ifndef FLINDERS_SMALL
#define FLINDERS_EVIDENCE 768
#elif !defined(FLINDERS_EVIDENCE)
#define FLINDERS_EVIDENCE 96
#elif FLINDERS_EVIDENCE < 80 || FLINDERS_EVIDENCE > 512
#error "FLINDERS_EVIDENCE: 80 to 512"
#endif

/* What a calibration that keeps itself does now. */
enum {
    FLINDERS_LEARNING = 0,  /* nothing is known yet */
    FLINDERS_UNDISTURBED = 1, /* what is read agrees with what is known */
    FLINDERS_DISTURBED = 2  /* it does not: something passes, or the offset has moved */
};

/* What happened: bits. */
enum {
    FLINDERS_LEARNT = 1,     /* a first calibration */
    FLINDERS_CONTRADICTED = 2, /* readings no longer agree with what is known */
    FLINDERS_PASSED = 4,     /* they agree again */
    FLINDERS_MOVED = 8,      /* they do not, and agree with each other: the offset is another one */
    FLINDERS_ADOPTED = 16,   /* another calibration is in force */
    FLINDERS_CLOCK_BACK = 32 /* a time before the last one: its reading is left out */
};

/* A calibration that keeps itself while its sensor is used: everything that is known of it, in one record that may be saved,
 * and goes on in another process. Times are in seconds, of any origin. NaN where nothing is known. */
typedef struct flinders_online {
    int32_t version;              /* FLINDERS_ONLINE_VERSION */
    int32_t state;                /* FLINDERS_LEARNING ... */
    int32_t is_locked;            /* 1: nothing is adopted by itself */
    int32_t is_level;             /* 1: all readings are of a level vehicle, and their ellipse alone is known */
    int32_t kept;                 /* readings of the evidence */
    int32_t tested;               /* of these that were compared with what is known */
    int32_t doubtful;             /* first of those that contradict it, -1: none does */
    int32_t agreeing;             /* groups of readings in a row that agree with what was known before */
    int32_t alike;                /* groups in a row that agree with those before them, and not with that */
    int32_t suspects;             /* groups in a row that chance hardly ever makes */
    int32_t groups;               /* since something contradicts it */
    int32_t is_lone;              /* 1: one reading alone contradicts what is known */
    int32_t averaged;             /* readings in the mean of those of one direction */
    flinders_real target_deg;     /* worst heading error that is good enough */
    flinders_real dip_deg;        /* inclination of the field, for heading errors */
    flinders_real began;          /* time of the first reading, ... */
    flinders_real now;            /* ... and of the newest one */
    flinders_real known[9];       /* offset and shape, without the evidence, unit ... */
    flinders_real known_covariance[81];
    flinders_real known_at;       /* ... at this time */
    flinders_real latest[9];      /* the same with the evidence */
    flinders_real latest_covariance[81];
    flinders_real latest_at;
    flinders_real in_force[9];    /* what is in use ... */
    flinders_real adopted_at;     /* ... since */
    flinders_real replaced[9];    /* what was in use before; NaN: nothing */
    flinders_real apart[3];       /* by how much the offset may have moved, unit */
    flinders_real apart_covariance[9];
    flinders_real disturbed_at;   /* since when something contradicts it */
    flinders_real moved[3];       /* by how much it has moved last, and may move back, unit ... */
    flinders_real moved_at;       /* ... and when */
    flinders_real noise;          /* of readings about the ellipsoid, unit */
    flinders_real place;          /* by which the strength of the field differs from group to group, 1 sigma, a fraction */
    flinders_real scatter;        /* of groups of readings that agree with what is known, over what they claim, in variance */
    flinders_real suspect_ratio;  /* of the newest of these */
    flinders_real height;         /* of a level vehicle's readings along z when it was calibrated, unit, ... */
    flinders_real height_now;     /* ... as far as that has moved since, ... */
    flinders_real height_sigma;   /* ... and how far they scatter, 1 sigma */
    flinders_real moves;          /* how often the offset has moved, ... */
    flinders_real moves_square;   /* ... the sum of the squares, unit², ... */
    flinders_real watched;        /* ... and in how many seconds */
    flinders_real rates[7];       /* probability of each rate at which the offset may walk, ... */
    flinders_real probable_rates[7]; /* ... and beforehand, which that falls back to */
    flinders_real expected_walk;  /* rate that is known of the unit beforehand, unit per root hour; NaN: none is */
    flinders_real expected_walk_sigma; /* 1 sigma of its natural logarithm */
    flinders_real sum[3];         /* of the readings of one direction, and ... */
    flinders_real sum_time;       /* ... of their times */
    flinders_real last[3];        /* the first of them */
    flinders_real last_at;
    flinders_real newest[12];     /* (4, 3) newest readings, unit, ... */
    flinders_real newest_at[4];   /* ... and their times */
    flinders_real step;           /* from one reading to the next, unit, mean square */
    flinders_real field[3 * FLINDERS_EVIDENCE]; /* evidence, unit: means of readings in one direction */
    flinders_real time[FLINDERS_EVIDENCE];
} flinders_online;

/* What a calibration that keeps itself claims at a time. NaN where nothing is in force. */
typedef struct flinders_online_claim {
    flinders_real rms_deg;        /* heading error of a level vehicle with what is in force, 1 sigma, over all headings */
    flinders_real worst_deg;      /* at the worst heading */
    flinders_real bound_deg;      /* that it stays within at all headings with a probability of 95 %; not on a board */
    flinders_real latest_deg;     /* worst heading error with what is known latest */
    flinders_real age_s;          /* how old that is */
    flinders_real walk;           /* at which the offset walks, unit per root hour */
    flinders_real covariance[81]; /* of what is in force, unit² */
} flinders_online_claim;

/* Axes that an attitude is named in: of a vehicle (forward, right, down when it is level), or of the sensor. */
enum { FLINDERS_VEHICLE = 0, FLINDERS_SENSOR = 1, FLINDERS_VEHICLE_POSES = 42, FLINDERS_SENSOR_POSES = 50 };

/* What a judgement is asked; `flinders_default_request` fills it. */
typedef struct flinders_request {
    flinders_real target_deg;     /* worst heading error that is good enough (1) */
    flinders_real field_strength; /* length of corrected readings, unit; NaN: the radius (NaN) */
    int32_t is_strength_known;    /* 1: that is the strength of the field; 0: a convention (0) */
    int32_t is_microtesla;        /* 1: the unit is the microtesla; 0: counts (1) */
    int32_t is_mirrored;          /* 1: axes were mapped to a mirror image (0) */
    int32_t rotation;             /* of the calibration: 0 none, as a magnetometer alone gives; 1 measured; 2 found by an
                                     aiding sensor (0) */
    int32_t parameters;           /* that the method finds; 0: its covariance allows for few readings already (9) */
    int32_t shrinks;              /* 1: look for readings that were corrected before (1) */
} flinders_request;

/* How severe a finding is, and the verdict that it makes: good or good with a note, limited, refused. */
enum { FLINDERS_NOTHING, FLINDERS_NOTE, FLINDERS_LIMITS, FLINDERS_REFUSES };

/* A comparison of a quantity with a number, or with so many times a quantity; FLINDERS_QUANTITIES stands for none. */
typedef struct flinders_comparison {
    flinders_real factor;
    uint8_t of, quantity;
    uint8_t severity; /* where it holds */
    char comparison;  /* <, > or g: at least */
} flinders_comparison;

/* A finding: comparisons with limits, the least severe first, those that have to hold as well, and at the end the
 * quantity and the limit that it states. */
typedef struct flinders_rule {
    const char *code, *action; /* its name in the catalogue of findings, and what to do */
    uint16_t first;            /* of its comparisons */
    uint8_t grades, needs;
} flinders_rule;

/* What a fit is worth. NaN where nothing is known. */
typedef struct flinders_judgement {
    int32_t verdict;    /* the most severe of `severities`: NOTHING and NOTE are good, LIMITS limited, REFUSES refused */
    int32_t conditions; /* what a verdict rests on that is no refusal: FLINDERS_IF_UNIFORM_FIELD ... */
    int32_t asks;       /* what else could be found out: FLINDERS_ASKS_HALVES ... */
    uint8_t severities[FLINDERS_RULES_OF_A_FIT]; /* of each finding, or FLINDERS_NOTHING */
    uint8_t causes[FLINDERS_RULES_OF_A_FIT];     /* 1 + the number of its cause, for a cause its own; 0: neither */
    uint8_t shown[FLINDERS_RULES_OF_A_FIT];      /* severities of those that follow from no other, raised to that of what
                                                    follows from them */
    uint8_t order[FLINDERS_RULES_OF_A_FIT];      /* these, most important first; then FLINDERS_RULES */
    flinders_real quantities[FLINDERS_QUANTITIES_OF_A_FIT]; /* what rules compare: NaN where it is not known, -infinity where
                                                               it was looked for and is not there */
    flinders_real rms_deg;        /* heading error of a level vehicle, 1 sigma, over all headings */
    flinders_real worst_deg;      /* at the worst heading; NaN where it is not known */
    flinders_real bound_deg;      /* that it stays within at all headings with a probability of 95 % */
    flinders_real structure_deg;  /* part of the heading error that belongs to the direction */
    flinders_real covariance[81]; /* claimed, with that part: every stated error of heading and direction follows of it */
} flinders_judgement;

/* What a judgement would have looked at more closely: bits of `asks`. */
enum {
    FLINDERS_ASKS_HALVES = 1,   /* whether the halves of the recording agree, as something changed: `halves_apart` */
    FLINDERS_ASKS_SWAP = 2      /* whether axes were swapped: `swap_gain` */
};

/* A run of readings that a fit leaves out. */
typedef struct flinders_outlier {
    int64_t first;   /* row of the first one */
    int64_t last;    /* row of the last one */
    int64_t rows;    /* readings left out from there to there ... */
    int64_t fitted;  /* ... as those that a fit goes by: a rest is one, or none */
    flinders_real start;    /* time of the first one, s; NaN without times */
    flinders_real end;      /* time of the last one, s */
    flinders_real farthest; /* largest distance from the surface, unit */
} flinders_outlier;

/* Axes that changed their sign or place while a recording was made. */
typedef struct flinders_axis_change {
    int32_t swap;       /* 0, 1, 2: x, y or z changed sign; 3, 4, 5: x and y, y and z, z and x were exchanged; -1: none */
    int64_t moments;    /* how often */
    flinders_real gain; /* times that all readings lie closer to an ellipsoid once it is undone, at most 1000 */
} flinders_axis_change;

/* Directions of readings in a hundred cells of the sphere, equal in area: a cap about z, bands of 15, 34, 34 and 15, a cap. */
typedef struct flinders_coverage {
    flinders_real readings[100]; /* in each cell */
    flinders_real share;    /* of the cells that hold one */
    flinders_real upright;  /* mean height of the directions, -1 to 1 */
    flinders_real hole_deg; /* angle from the middle of the largest gap to the nearest direction */
    flinders_real hole[3];  /* middle of that gap, a unit vector in corrected axes */
} flinders_coverage;

#ifdef __cplusplus
extern "C" {
#endif

/* Fill options with their defaults, in parentheses above. */
FLINDERS_API void flinders_default_options(flinders_options *options);

/* A status in words. */
FLINDERS_API const char *flinders_message(int status);

/* Bytes of a record of this library, and of a number of it (8 or 4): for callers that were compiled apart. */
FLINDERS_API size_t flinders_record_size(void);
FLINDERS_API size_t flinders_real_size(void);

/* Kernels that an option selects on this processor: 1 the baseline, 2 AVX2. */
FLINDERS_API int flinders_kernels(int32_t wanted);

/* Bytes of workspace that a recording of so many rows needs. */
FLINDERS_API size_t flinders_workspace_size(size_t rows);

/* Fit one recording: field (rows, 3), time (rows,) in s or NULL. */
FLINDERS_API int flinders_fit(const flinders_real *field, const flinders_real *time, size_t rows,
                              const flinders_options *options, void *workspace, size_t size, flinders_record *record);

/* Fit several recordings of one sensor as one. They stand one behind the other; `ends` (parts,) are their ends. Nothing
 * that follows the order of readings goes from one to the next. */
FLINDERS_API int flinders_fit_parts(const flinders_real *field, const flinders_real *time, size_t rows,
                                    const int64_t *ends, size_t parts, const flinders_options *options,
                                    void *workspace, size_t size, flinders_record *record);

/* Fit the ellipse of a level turn: x and y alone, all at one height. Offset and shape are those of the ellipsoid that has this
 * ellipse where the field dips by `dip_deg`, z down; across the plane there is the prior alone, and the offset is known to
 * the strength of the field. A record of it has `plane` 1, and its majority is that of readings at majority_centre[2].
 * Parameters are as of flinders_fit_parts, which calls this by itself where readings are a level turn; needs a prior, six
 * different readings, and x and y that change. Outliers are rejected where residuals ask for it, or never. */
FLINDERS_API int flinders_fit_level(const flinders_real *field, const flinders_real *time, size_t rows,
                                    const int64_t *ends, size_t parts, const flinders_options *options,
                                    void *workspace, size_t size, flinders_record *record);

/* A steady change while one recording was made, about a known ellipsoid: fills `drift_...` of a record, NaN where
 * readings are too few to tell. Of more than 5,000 every second, third ... is looked at. */
FLINDERS_API int flinders_drift(const flinders_real *field, size_t rows, const flinders_real centre[3],
                                const flinders_real shape[6], flinders_real dip_deg, void *workspace, size_t size,
                                flinders_record *record);

/* What accelerations (rows, 3), NaN where they are missing, show of a level turn about z, for `level` of the options: 0 where
 * z was not within 30 degrees of the vertical on average or the body tilted by more than 25 degrees about that, 2 where it
 * stayed within some 10, else 1 (root mean squares). */
FLINDERS_API int flinders_levelness(const flinders_real *acceleration, size_t rows);

/* Regress the distances of readings from a known ellipsoid on a disturbance: values (rows,), NaN where it is not known.
 * Readings farther off than `limit` are left out, and of more than 5,000 every second, third ... is looked at. */
FLINDERS_API int flinders_regress(const flinders_real *field, const flinders_real *values, size_t rows,
                                  const flinders_real centre[3], const flinders_real shape[6], flinders_real limit,
                                  void *workspace, size_t size, flinders_disturbance *found);

/* Fit many: readings of recording i are rows offsets[i] to offsets[i + 1]; the worst status is returned. */
FLINDERS_API int flinders_fit_many(const flinders_real *field, const flinders_real *time, const int64_t *offsets,
                                   size_t recordings, const flinders_options *options, void *workspace, size_t size,
                                   flinders_record *records);

/* Fit from a known start: `centre` and `shape`. `ends` and `parts` as of flinders_fit_parts, or
 * NULL and 0. A robust fit begins there, too. Statistics of the recording are not looked for. */
FLINDERS_API int flinders_polish(const flinders_real *field, size_t rows, const int64_t *ends, size_t parts,
                                 const flinders_real centre[3], const flinders_real shape[6],
                                 const flinders_options *options, void *workspace, size_t size,
                                 flinders_record *record);

/* What an earlier calibration tells of a sensor whose hard iron has changed: its offset is a start, and nothing is known of
 * it; its shape is known as well as its covariance says, NULL for 2 % of the radius. The field is `strength_ratio` times as
 * strong as then, to 1 %, and the soft iron may have changed by a share, 1 sigma. */
FLINDERS_API void flinders_earlier_of(const flinders_real centre[3], const flinders_real shape[6],
                                      const flinders_real *covariance, flinders_real distortion,
                                      flinders_real strength_ratio, flinders_real soft_iron_sigma,
                                      flinders_earlier *earlier);

/* Let the soft iron of an earlier calibration have changed by 5 %, 1 sigma, as where readings show that it has. */
FLINDERS_API void flinders_allow_change(flinders_earlier *earlier);

/* How often chance alone makes a fit contradict the soft iron of an earlier calibration as much: of the shape that a fit with
 * `flinders_allow_change` has found, and its covariances (9, 9) for independent residuals, and as they are. */
FLINDERS_API flinders_real flinders_soft_iron_p_value(const flinders_earlier *earlier, const flinders_real shape[6],
                                                      const flinders_real textbook[81],
                                                      const flinders_real covariance[81]);

/* Renew an earlier calibration: find the offset with the shape as it was, or with one that has changed where the readings
 * contradict that. Seconds of a wobble are enough. FLINDERS_TOO_FEW for less than 20 readings, FLINDERS_UNMOVED for those
 * that do not turn by more than 5°. */
FLINDERS_API int flinders_refresh(const flinders_real *field, const flinders_real *time, size_t rows,
                                  const flinders_options *options, const flinders_earlier *earlier, void *workspace,
                                  size_t size, flinders_record *record);

/* How far two calibrations of one sensor are apart, and whether chance explains it: each corrects the readings that the other
 * expects of a level vehicle that turns. */
FLINDERS_API int flinders_compare(const flinders_calibrated *first, const flinders_calibrated *second,
                                  flinders_real dip_deg, flinders_difference *difference);

/* Whether a difference in heading is within a target, as `flinders_difference` has it. FLINDERS_HOLDS: together with its bound.
 * FLINDERS_FAILS: it is beyond the target by more than FLINDERS_ONE_SIDED sigma, and by FLINDERS_CHANCE more than chance
 * explains. FLINDERS_CANNOT_TELL: neither, as where a number is NaN. Of two that are exact nothing is left to chance. */
FLINDERS_API int flinders_holds(flinders_real worst_deg, flinders_real sigma_deg, flinders_real bound_deg,
                                 flinders_real p_value, flinders_real target_deg);

/* Bytes of the record of a calibration that keeps itself. Its workspace is that of FLINDERS_EVIDENCE readings, on a board
 * FLINDERS_ONLINE_WORKSPACE bytes. */
FLINDERS_API size_t flinders_online_size(void);
#define FLINDERS_ONLINE_WORKSPACE (FLINDERS_EVIDENCE * (2 * sizeof(flinders_real) + 3))

/* Begin without any calibration. On a board one has to be put in force: none is learnt from nothing. */
FLINDERS_API void flinders_online_begin(flinders_online *online);

/* Put a calibration in force that was known at a time: offset and shape (9,) and their covariance (9, 9). FLINDERS_BAD_OPTION for
 * a covariance or a time that is none. */
FLINDERS_API int flinders_online_know(flinders_online *online, const flinders_real parameters[9],
                                      const flinders_real covariance[81], flinders_real noise, flinders_real time);

/* The rate at which the offset walks is known of this unit: unit per root hour, and 1 sigma of its natural logarithm.
 * FLINDERS_BAD_OPTION where either is not positive. */
FLINDERS_API int flinders_online_expect_walk(flinders_online *online, flinders_real walk, flinders_real log_sigma);

/* Add readings: field (rows, 3), time (rows,) in s. Stops behind a reading by which something happened, bits of `events`;
 * returns how many were added. */
FLINDERS_API size_t flinders_online_add(flinders_online *online, const flinders_real *field, const flinders_real *time,
                                        size_t rows, void *workspace, size_t size, int32_t *events);

/* What is claimed at a time, now or later; FLINDERS_UNDETERMINED where nothing is in force. */
FLINDERS_API int flinders_online_claim_at(const flinders_online *online, flinders_real time, flinders_online_claim *claim);

/* Seconds from the newest reading on for which the worst heading error is within the target if nothing is learnt: infinite
 * beyond ten years, NaN where it is not within it now. */
FLINDERS_API flinders_real flinders_online_good_s(const flinders_online *online);

/* Count times from an origin that is later by so many seconds: single precision tells milliseconds within hours alone. */
FLINDERS_API void flinders_online_shift(flinders_online *online, flinders_real seconds);

/* Put what is known latest in force, or what was before. */
FLINDERS_API void flinders_online_adopt(flinders_online *online);
FLINDERS_API void flinders_online_take_back(flinders_online *online);

/* Largest angle of readings (rows, 3) from their mean, degrees, by a shape that is known. */
FLINDERS_API flinders_real flinders_turn_deg(const flinders_real *field, size_t rows, const flinders_real shape[6]);

/* The rests of a recording, `ends` and `parts` as of flinders_fit_parts: bounds (rests, 2) has the first row of each and
 * the one behind its last, and room for rows / 2 numbers; `are_left_out` is 1 where a fit leaves them out, and 0 where each
 * is one reading. Returns how many there are; none where too few readings would be left for a fit. */
FLINDERS_API size_t flinders_rests(const flinders_real *field, size_t rows, const int64_t *ends, size_t parts,
                                   void *workspace, size_t size, int64_t *bounds, int32_t *are_left_out);

/* Begin sums about an origin (NULL: zero), in units of `scale`. */
FLINDERS_API void flinders_sums_begin(flinders_sums *sums, const flinders_real origin[3], flinders_real scale);

/* Add readings (rows, 3). */
FLINDERS_API int flinders_sums_add(flinders_sums *sums, const flinders_real *field, size_t rows);

/* Move sums to another origin and scale; digits go as the fourth power of the shift. */
FLINDERS_API void flinders_sums_move(flinders_sums *sums, const flinders_real origin[3], flinders_real scale);

/* Add other sums, whatever their origin and scale. */
FLINDERS_API void flinders_sums_merge(flinders_sums *sums, const flinders_sums *other);

/* Solve now, from sums alone: consistent ellipsoid and noise; fills centre, shape, radius, noise, mean and spread. */
FLINDERS_API int flinders_sums_solve(const flinders_sums *sums, flinders_record *record);

/* Sampson distances (rows,) of readings from the surface of a record, outside positive, unit. */
FLINDERS_API int flinders_distances(const flinders_real *field, size_t rows, const flinders_record *record,
                                    flinders_real *out);

/* Heading error of a level vehicle, and error of the direction, which a fit leaves open, from shape and covariance. */
FLINDERS_API int flinders_heading_errors(flinders_record *record, flinders_real dip_deg);

/* Errors (count,) of the corrected field where it points along directions (count, 3), degrees, 1 sigma; NaN where the shape
 * is none. */
FLINDERS_API int flinders_direction_errors(const flinders_real shape[6], const flinders_real covariance[81],
                                           const flinders_real *directions, size_t count, flinders_real *errors_deg);

/* Fill a goal with its defaults, in parentheses above. */
FLINDERS_API void flinders_default_goal(flinders_goal *goal);

/* Take what a fit claims: its surface, covariance and noise, and counts (100,) of its readings in each cell of the sphere: a
 * cap, bands of 15, 34, 34 and 15 from +z to -z, a cap. The variance of a reading is that with which these readings give
 * this covariance, so that residuals that are correlated make a further reading worth less. */
FLINDERS_API void flinders_believe(const flinders_real centre[3], const flinders_real shape[6],
                                   const flinders_real covariance[81], flinders_real noise,
                                   const flinders_real counts[100], flinders_belief *belief);

/* Put a sphere through readings (rows, 3) that no fit can do anything with yet, with what hard and soft iron commonly do
 * where nothing was seen; FLINDERS_TOO_FEW or FLINDERS_UNDETERMINED where they do not tell where its centre is. */
FLINDERS_API int flinders_rough(const flinders_real *field, size_t rows, flinders_belief *belief);

/* Find the direction whose readings would reduce the worst error most. `batch`: readings that will be taken there; 0: a
 * hundredth of those so far. */
FLINDERS_API int flinders_guidance(const flinders_belief *belief, const flinders_goal *goal, flinders_real batch,
                                   flinders_advice *advice);

/* Find the path that brings the worst error below the target soonest, or as low as it gets in six steps of some 35°, from
 * where the field points now (3,), a vector of any length in corrected axes. */
FLINDERS_API int flinders_path(const flinders_belief *belief, const flinders_goal *goal, const flinders_real at[3],
                               flinders_real readings_per_deg, flinders_route *route);

/* What points down in an attitude of a frame: a unit vector in its axes. Returns how many angles have to be judged by eye;
 * -1 where there is no such attitude. */
FLINDERS_API int flinders_pose(int32_t frame, int32_t pose, flinders_real down[3]);

/* The simplest attitude in which a body that is turned once around meets the field near an advised direction. */
FLINDERS_API int32_t flinders_pose_towards(int32_t frame, const flinders_goal *goal, const flinders_real direction[3]);
/* Bytes of a judgement, for callers that were compiled apart. */
FLINDERS_API size_t flinders_judgement_size(void);

/* A site of which nothing is known. */
FLINDERS_API void flinders_default_site(flinders_site *site);

/* Add readings (rows, 3) of a level turn with their accelerations (rows, 3), NaN where there is none; `record` is that of its
 * fit. */
FLINDERS_API void flinders_vertical_add(const flinders_real *field, const flinders_real *acceleration, size_t rows,
                                        const flinders_record *record, flinders_vertical *vertical);

/* Lay a plane through readings (rows, 3) with a noise, about a centre in x and y; of readings whose height is astray without
 * these. */
FLINDERS_API int flinders_plane_of(const flinders_real *field, size_t rows, const flinders_real centre[2],
                                   flinders_real noise, void *workspace, size_t size, flinders_heights *heights);

/* Let the field of a site count in a fit, before its record is claimed: changes centre, shape, radius and covariances, fills
 * `site_strength` and what belongs to it, and `z_axis`. Errors of a level heading become NaN, and the judge completes them.
 * `field` (rows, 3) are the readings that the fit goes by, `vertical` what an accelerometer shows or NULL; both are looked at
 * for a level turn alone. A judgement is asked with this strength where it was used (`flinders_request`). */
FLINDERS_API int flinders_at_site(const flinders_real *field, size_t rows, const flinders_vertical *vertical,
                                  const flinders_site *site, void *workspace, size_t size, flinders_record *record);

/* Whether a record rests on the strength of a site, 1 or 0. */
FLINDERS_API int flinders_uses_strength(const flinders_record *record);

/* Fill a request with its defaults, in parentheses above. */
FLINDERS_API void flinders_default_request(flinders_request *request);

/* A record in which nothing is known yet. */
FLINDERS_API void flinders_clear_record(flinders_record *record);

/* Widen the covariance of a record, once, by what its method does not know of: readings that repeat others, and noise that
 * is known from few readings. Its level errors follow; where they are NaN they follow of the covariance, at `dip_deg`, which
 * becomes negative where the readings show a sensor that is upside down.
 *
 * Of readings that were corrected before, by a driver or an earlier calibration, centre, shape, covariance and errors become
 * those of a fit that is shrunk towards leaving the readings as they are, where that is 999 times as likely as not. */
FLINDERS_API void flinders_claim(flinders_record *record, const flinders_request *request);

/* Factor by which few readings widen a covariance, whose noise is known from few residuals: from the number of different
 * readings beyond the parameters. */
FLINDERS_API flinders_real flinders_widening_by_few(flinders_real freedom);

/* Judge a fit: claim its record, and compare what it says with the rules of the catalogue of findings. What the record
 * lacks is NaN or 0, and makes no finding.
 *
 * Example (it is compiled and run by tests/agreement/test_native.py), after `flinders_fit`:
 *
 *     flinders_request request;
 *     flinders_judgement judgement;
 *     flinders_default_request(&request);
 *     if (flinders_judge(&record, &request, &judgement) == FLINDERS_OK)
 *         printf("%.2f degrees, verdict %d\n", judgement.worst_deg, judgement.verdict);
 *     for (int i = 0; i < FLINDERS_RULES_OF_A_FIT && judgement.order[i] < FLINDERS_RULES; i++)
 *         puts(flinders_rule_of(judgement.order[i])->action);
 */
FLINDERS_API int flinders_judge(flinders_record *record, const flinders_request *request, flinders_judgement *judgement);

/* Judge many, by the same request; those whose status is not FLINDERS_OK are refused. */
FLINDERS_API void flinders_judge_many(flinders_record *records, size_t count, const flinders_request *request,
                                      flinders_judgement *judgements);

/* A finding of the catalogue; those beyond FLINDERS_RULES_OF_A_FIT are of disturbances and other sensors. */
FLINDERS_API const flinders_rule *flinders_rule_of(int rule);

/* How severe a finding is for quantities (FLINDERS_QUANTITIES,): its rule alone. */
FLINDERS_API int flinders_severity(int rule, const flinders_real *quantities);

/* Whether a finding was looked for: 1 where none of the quantities (FLINDERS_QUANTITIES,) that its rule compares is NaN. For
 * findings of a fit those of its judgement are enough; so they are for `flinders_severity`. */
FLINDERS_API int flinders_is_checked(int rule, const flinders_real *quantities);

/* What is shown of findings: fills causes, shown, order and verdict of a judgement from its severities. */
FLINDERS_API void flinders_causes(flinders_judgement *judgement);

/* Heading error of a vehicle, 1 sigma, that knows how far it is rolled or pitched: over all headings and directions of the
 * tilt, and at the worst. `down` is a vector in corrected axes that points down when the vehicle is level, NULL for z. */
FLINDERS_API int flinders_tilted_error(const flinders_real shape[6], const flinders_real covariance[81],
                                       flinders_real dip_deg, flinders_real tilt_deg, const flinders_real *down,
                                       flinders_real *rms_deg, flinders_real *worst_deg);

/* Heading error of a level vehicle whose readings are used as they come. */
FLINDERS_API int flinders_uncorrected_error(const flinders_real centre[3], const flinders_real shape[6],
                                            flinders_real dip_deg, const flinders_real *down, flinders_real *rms_deg,
                                            flinders_real *worst_deg);

/* Tilt up to which the worst heading error is within a limit, degrees: 0 where it is not even level, 180 at all. */
FLINDERS_API int flinders_attitude_limit(const flinders_real shape[6], const flinders_real covariance[81],
                                         flinders_real dip_deg, flinders_real limit_deg, const flinders_real *down,
                                         flinders_real *tilt_deg);

/* A level turn in steps of 5°: headings, what readings that are used as they come are off by, their mean removed, and the
 * heading error of the calibration, 1 sigma, at each (72,), degrees. */
FLINDERS_API int flinders_level_turn(const flinders_real centre[3], const flinders_real shape[6],
                                     const flinders_real covariance[81], flinders_real dip_deg,
                                     const flinders_real *down, flinders_real *headings_deg,
                                     flinders_real *deviations_deg, flinders_real *sigmas_deg);

/* Heading errors (count,) of a vehicle at the worst attitude that brings the corrected field along directions (count, 3),
 * degrees, 1 sigma. */
FLINDERS_API int flinders_attitude_errors(const flinders_real shape[6], const flinders_real covariance[81],
                                          flinders_real dip_deg, const flinders_real *directions, size_t count,
                                          flinders_real *errors_deg);

/* Standard deviations (9,) of the entries of the matrix F S⁻¹ that corrects readings, row by row; the field strength F is
 * known, or else the radius. */
FLINDERS_API int flinders_matrix_sigmas(const flinders_real matrix[9], const flinders_real shape[6],
                                        const flinders_real covariance[81], int32_t is_known, flinders_real sigmas[9]);

/* Covariance of offset and shape with what belongs to the direction, and makes `structure_deg` of a level heading: an
 * uncertain offset σ² S Sᵀ, which moves the corrected field by σ in every direction. */
FLINDERS_API void flinders_with_structure(const flinders_real shape[6], const flinders_real covariance[81],
                                          flinders_real structure_deg, flinders_real dip_deg, flinders_real out[81]);

/* Bound that a level heading stays within at all headings with a probability of 95 %, degrees. */
FLINDERS_API int flinders_heading_bound(const flinders_real shape[6], const flinders_real covariance[81],
                                        flinders_real dip_deg, const flinders_real *down, flinders_real *bound_deg);

/* Whether a sensor was hardly turned: all readings (rows, 3) lie around one point, and show no surface. `angle_deg` is that
 * within which they lie, seen from the centre of their sphere, or NaN: the sensor was turned, or they are fewer than 20. The
 * strength of the field is between `weakest` and `strongest`, unit; 0 and infinity where nothing is known of it. */
FLINDERS_API int flinders_unmoved(const flinders_real *field, size_t rows, flinders_real weakest, flinders_real strongest,
                                  void *workspace, size_t size, flinders_real *angle_deg);

/* The same by cells of space: means (cells, 3) of the readings of each, which are lost, and how many readings there are in
 * all. */
FLINDERS_API int flinders_unmoved_cells(flinders_real *means, size_t cells, flinders_real readings, flinders_real weakest,
                                        flinders_real strongest, flinders_real *angle_deg);

/* Whether each record (count,) shows by itself that the sensor was turned out of one plane, and was at no end of its range:
 * 1 or 0 in turned (count,). Where it is 0, readings have to be asked: `flinders_unmoved`. Strengths are as of that. */
FLINDERS_API void flinders_turned(const flinders_record *records, size_t count, flinders_real weakest,
                                  flinders_real strongest, unsigned char *turned);

/* Fewest far readings of eleven that make a run, given which of some readings are far: far (n,) is 1 or 0, of a recording
 * of so many `rows`. Chance makes one in a thousand recordings; `scratch` (n,) is lent. */
FLINDERS_API int flinders_dense(const unsigned char *far, size_t n, size_t rows, unsigned char *scratch);

/* Which readings a fit leaves out, 1 or 0 in out (rows,): those that are far, in a run of `dense` far ones of eleven, or
 * within FLINDERS_MARGIN of it. */
FLINDERS_API void flinders_left_out(const unsigned char *far, size_t rows, int32_t dense, unsigned char *out);

/* List the runs of readings that a fit leaves out, behind the `count` that are there: no more than five others lie within
 * one. Of each reading there are its distance from the surface, whether it is left out, its first and last row among those
 * that were read (one row unless it is a rest), and the times of these, NULL without any. `runs` has room for
 * FLINDERS_OUTLIERS; returns how many there are now. */
FLINDERS_API size_t flinders_list_outliers(const flinders_real *distances, const unsigned char *out, size_t rows,
                                           const int64_t *first, const int64_t *last, const flinders_real *start,
                                           const flinders_real *end, flinders_outlier *runs, size_t count);

/* Bytes of workspace that a search for changed axes needs. */
FLINDERS_API size_t flinders_swap_workspace_size(size_t rows);

/* Look for moments at which axes changed their sign or place: `moments`, with room for `rows` numbers, gets the row behind
 * each. A change counts where readings with it undone scatter by at most 1.1 times `noise`, unit (infinity where it is not
 * known), and by at most a share `noise_limit` of the radius. */
FLINDERS_API int flinders_axis_swap(const flinders_real *field, size_t rows, flinders_real noise,
                                    flinders_real noise_limit, void *workspace, size_t size, int64_t *moments,
                                    flinders_axis_change *found);

/* Coverage of the sphere by readings (rows, 3), as a fit states it: cells of space are projected onto it from the centre of an
 * ellipsoid. Those farther from it than `within`, and their own size, hold outliers and are left out; 0: none is. */
FLINDERS_API int flinders_coverage_of(const flinders_real *field, size_t rows, const flinders_real centre[3],
                                      const flinders_real shape[6], flinders_real within, void *workspace, size_t size,
                                      flinders_coverage *coverage);

/* The same by cells of space of a `side`: means (cells, 3) of the readings of each, and how many there are (cells,).
 * `scratch` has room for 6 * cells numbers. */
FLINDERS_API int flinders_coverage_of_cells(const flinders_real *means, const flinders_real *readings, size_t cells,
                                            flinders_real side, const flinders_real centre[3],
                                            const flinders_real shape[6], flinders_real within, flinders_real *scratch,
                                            flinders_coverage *coverage);

/* Which of the hundred cells of the sphere unit vectors (count, 3) fall into. */
FLINDERS_API void flinders_cells_of(const flinders_real *directions, size_t count, uint32_t *cells);

/* An inclination with the sign that readings in each cell of the sphere show: a sensor mounted upside down sees the field come
 * from below. `is_open` is 1 where they lean, yet not as a level vehicle's do, so that both signs are possible. */
FLINDERS_API flinders_real flinders_facing(const flinders_real readings[100], flinders_real dip_deg, int32_t *is_open);

/* Whether readings of a covariance lie in a plane across z, 1 or 0: by less than `within` times their noise, unit. */
FLINDERS_API int flinders_is_level(const flinders_real covariance[6], flinders_real noise, flinders_real within);

#ifdef __cplusplus
}
#endif
#endif
