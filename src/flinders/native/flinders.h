/* flinders.h - calibration of three-axis magnetometers: a small library in C99, without allocation and without state.
 *
 * A reading x in a field of constant strength lies on the ellipsoid b + S u, with a unit vector u. The library estimates
 * the offset b and the symmetric shape S by maximum likelihood, with their covariance, and fills one flat record per
 * recording with all input of a verdict. S⁻¹(x − b) is the corrected direction.
 *
 * Units. Readings may come in any unit (microtesla, counts); "unit" below means that unit. Angles are in degrees if
 * the name ends in _deg, times in seconds. Symmetric 3 × 3 matrices are six numbers: 11, 22, 33, 12, 13, 23. The nine
 * parameters of a fit are b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃.
 *
 * Errors. A function returns a status, FLINDERS_OK or an error, for any input. After an error, unknown numbers of the
 * record are NaN.
 *
 * Memory. The caller allocates a workspace of `flinders_workspace_size(rows)` bytes, aligned as by malloc, for recordings
 * of at most `rows` rows. The library is thread-safe if each thread has its own workspace.
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

#include "flinders_rules.h" /* generated from the catalogue of findings: quantities, findings, conditions */

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

/* Status that a function returns. */
enum {
    FLINDERS_OK = 0,
    FLINDERS_TOO_FEW = 1,         /* fewer different readings than the ten unknowns, or than a refresh requires */
    FLINDERS_NOT_FINITE = 2,      /* a reading is NaN or infinite */
    FLINDERS_OUT_OF_SCALE = 3,    /* the largest reading is outside 1e-12 to 1e15 */
    FLINDERS_STUCK_AXIS = 4,      /* an axis is constant */
    FLINDERS_UNMOVED = 5,         /* readings vary by less than a thousandth of their mean */
    FLINDERS_NOT_AN_ELLIPSOID = 6, /* the best surface is not closed */
    FLINDERS_UNDETERMINED = 7,    /* readings do not determine all parameters, and there is no prior */
    FLINDERS_NO_WORKSPACE = 8,    /* the workspace is too small */
    FLINDERS_BAD_OPTION = 9       /* an option is outside its range */
};

/* Runs of outliers. */
enum {
    FLINDERS_WINDOW = 11,  /* readings of a window in which outliers are counted: 0.2 s at 50 Hz */
    FLINDERS_NO_RUN = 12,  /* threshold above the size of a window: runs are not detected */
    FLINDERS_MARGIN = 25,  /* readings before and after a run that are left out: 0.5 s at 50 Hz, for a magnet that moves away */
    FLINDERS_OUTLIERS = 1000 /* most runs of a recording that are listed; further ones are merged into the last */
};

/* Options of a fit, with defaults in parentheses; initialise with `flinders_default_options`. */
typedef struct flinders_options {
    flinders_real prior;   /* prior 1 sigma of the shape's deviation from a sphere, a fraction; 0: no prior (0.3) */
    flinders_real dip_deg; /* inclination of the field, for heading errors, -89 to 89 (60); its sign is changed
                              if the readings indicate that the sensor is upside down */
    int32_t robust;        /* reject outliers: 0 never, 1 if residuals have outliers, 2 always (1) */
    int32_t kernels;       /* 0 the fastest on this processor, 1 the baseline, 2 AVX2 (0) */
    int32_t statistics;    /* 1: coverage, tails, jumps, swaps, distinct readings; 2: also the uncertainty of nonlinear
                              terms, included in the covariance; 0: the fit alone (1) */
    int32_t rests;         /* 1: readings at rest are replaced by their mean, or left out if there is a long turn; 0: all
                              readings are used (1) */
    int32_t level;         /* 1: fit an ellipse to readings in one plane across z (a level turn of a car or a boat) if there is
                              a prior; record.plane is then 1; 0: always an ellipsoid (1) */
    int32_t bias_correction; /* 1: subtract the bias by noise on a curved surface; 0: the minimum of Σ s² itself (1) */
#ifndef FLINDERS_SMALL
    int32_t is_informed;     /* 1: normal prior of the nine parameters instead of `prior` (0) */
    flinders_real expected[9]; /* mean of that prior, unit */
    flinders_real information[81]; /* its inverse covariance, 1 / unit²; 0 for unknown parameters */
#else
    const struct fl_known *known; /* normal prior, for internal use (NULL) */
#endif
} flinders_options;

/* Sums of monomials of readings about an origin: sufficient statistics of an ellipsoid fit, which are additive. */
typedef struct flinders_sums {
    flinders_real sums[35];  /* of xⁱyʲzᵏ: 1, x, y, z, x², xy, y², xz, yz, z², ... of (reading - origin)/scale */
    flinders_real origin[3]; /* unit */
    flinders_real scale;     /* unit; a power of two avoids rounding errors */
} flinders_sums;

/* Result of a fit to one recording: a row of a table. Unknown numbers are NaN. */
typedef struct flinders_record {
    int32_t version;    /* FLINDERS_RECORD_VERSION */
    int32_t status;     /* status that the call returned */
    int32_t is_robust;  /* 1 if outliers were searched and rejected */
    int32_t unobserved; /* number of combinations of parameters that are not observed, 0 to 9 */
    int32_t steps;      /* Gauss-Newton steps */
    int32_t is_white;   /* 1 if residuals are independent */
    int32_t lags;       /* number of significant autocovariances, including lag 0 */
    int32_t hides_plane; /* 1 if readings without outliers may lie in one plane across z, as those of a level turn */
    int32_t dense;      /* threshold of outliers in a window of eleven readings; 12: runs were not detected */
    int64_t rows;       /* number of readings in the recording */
    int64_t rests;      /* number of intervals of constant direction */
    int64_t at_rest;    /* readings of the recording in these intervals */
    int64_t fitted;     /* readings after averaging of rests, see `rests` of the options */
    int64_t fitted_repeats; /* those of `fitted` that are equal to the previous one */
    int64_t fitted_distinct; /* number of distinct values in `fitted` */
    int64_t used;       /* readings in the fit */
    int64_t rejected;   /* readings of `fitted` that were left out as outliers */
    int64_t repeats;    /* readings that are equal to the previous one */
    int64_t longest_repeat; /* length of the longest run of equal readings */
    int64_t distinct;   /* number of distinct readings; an estimate from a sample above 4096 */
    int64_t end_counts[6]; /* number of readings at the minimum of x, y, z and at the maximum of x, y, z */
    int64_t rails;      /* saturated ends of the range: bit i for entry i of `end_counts` */
    int64_t swaps[6];   /* number of times that x, y or z changed sign, or x and y, y and z, z and x were exchanged */
    int64_t first_swap[6]; /* first row after the first of each change; -1: none */
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real radius;         /* geometric mean of the semi-axes, unit */
    flinders_real noise;          /* standard deviation of the distances from the surface, unit */
    flinders_real covariance[81]; /* of the nine parameters, for correlated residuals and the choice of the majority, unit² */
    flinders_real textbook[81];   /* the same for independent residuals, unit² */
    flinders_real prior_influence;    /* largest fraction of information from the prior, over combinations of parameters */
    flinders_real rejected_beyond; /* threshold of the distance from the surface, unit; 0 if no reading was rejected */
    flinders_real majority_centre[3]; /* of the surface from which distances of outliers are measured, unit */
    flinders_real majority_shape[6];  /* of the same surface, unit */
    flinders_real dip_deg;        /* inclination for heading errors, with its sign by the readings */
    flinders_real level_rms_deg;  /* heading error of a level vehicle, 1 sigma, rms over all headings */
    flinders_real level_worst_deg; /* at the worst heading */
    flinders_real direction_rms_deg; /* error of the direction of the field, 1 sigma, rms over the sphere */
    flinders_real direction_worst_deg; /* in the worst direction */
    flinders_real mean[3];        /* of the readings, unit */
    flinders_real spread;         /* root mean square distance from their mean, unit */
    flinders_real principal_variances[3]; /* along the principal axes, ascending, unit² */
    flinders_real lowest[3];      /* smallest reading of each axis, unit */
    flinders_real highest[3];     /* largest reading of each axis, unit */
    flinders_real step;           /* resolution of an axis with coarse steps, between its last two values, unit; 0: none */
    flinders_real coverage;       /* fraction of a hundred equal cells of the sphere that contain readings */
    flinders_real upright;        /* mean z component of the directions, -1 to 1 */
    flinders_real hole_deg;       /* angle from the centre of the largest gap to the nearest direction */
    flinders_real hole[3];        /* centre of that gap, a unit vector in corrected axes */
    flinders_real median_distance; /* of the readings, or of 5,000 of them, from the surface, unit */
    flinders_real farthest;       /* largest distance from the surface, unit */
    flinders_real kurtosis;       /* of the distances; 3 for normal noise */
    flinders_real lag_one;        /* autocorrelation of the distances at lag one */
    flinders_real correlation_time; /* number of readings that are equivalent to one independent reading */
    flinders_real distortion;     /* standard deviation of distances that depend on the direction, not on time, unit */
    flinders_real excess_variance; /* ratio of the variance between blocks to its expectation */
    flinders_real noise_lasts;    /* probability of a correlation time of slow noise above a third of the recording; NaN: none */
    flinders_real steps_kurtosis; /* of steps between means of successive distances; 3 for normal noise; NaN: unknown */
    flinders_real drift_offset[3]; /* change of the offset from the first reading to the last, unit; NaN: unknown */
    flinders_real drift_strength; /* change of the field strength, as a fraction */
    flinders_real drift_deg;      /* heading error of a level vehicle by that change of the offset, at the worst heading */
    flinders_real drift_by_chance; /* p-value of the change */
    flinders_real nonlinearity[6]; /* quadratic terms of x, y, z, then cubic terms, in (reading - centre) / radius, as a
                                      fraction of the radius; NaN: unknown */
    flinders_real nonlinear_deg;  /* heading error of a level vehicle by these terms, at the worst heading */
    flinders_real nonlinear_by_chance; /* p-value of these terms */
    flinders_real nonlinear_sigma_deg; /* heading error at any attitude by their uncertainty that `covariance` does not
                                          include, 1 sigma; if statistics are 2 */
    flinders_real axis_lag[3];    /* delay of x, y, z minus the mean delay, s, or in readings without times; NaN:
                                     unknown */
    flinders_real lag_deg;        /* heading error of a level vehicle at rest by these delays, at the worst heading */
    flinders_real lag_by_chance;  /* p-value of the delays */
    flinders_real largest_jump;   /* largest step between successive readings, over the median of 5,000 nonzero steps */
    flinders_real path_correlation; /* autocorrelation of 5,000 readings at lag one: 1 for a slow turn, 0 for random order */
    flinders_real sums[35];       /* sums of monomials about `sums_origin`, see flinders_sums */
    flinders_real sums_origin[3]; /* unit */
    flinders_real sums_scale;     /* unit */
    flinders_real start;          /* first time, s; NaN without times */
    flinders_real end;            /* last time, s */
    flinders_real longest_step;   /* largest difference of successive times, s */

    /* Numbers that a fit leaves NaN or 0; the caller sets those that are known before the record is judged. */
    flinders_real halves_apart;   /* difference of fits to the halves of the recording, over its claimed uncertainty */
    flinders_real swap_gain;      /* factor by which undoing swaps of axes reduces the noise */
    flinders_real unmodelled_deg; /* heading error of a level vehicle by a recorded disturbance without model */
    flinders_real attitude_dependent_deg; /* heading error of a level vehicle by attitude-dependent disturbances */
    flinders_real tilt_error_deg; /* heading error by the tilt error of an accelerometer */
    flinders_real apart_deg;      /* difference between recordings of the sensor */
    flinders_real apart_sigma_deg; /* claimed uncertainty of that difference, 1 sigma */
    flinders_real apart_by_chance; /* p-value of that difference */
    flinders_real bias_deg;       /* heading error of a level vehicle by the bias of the method, rms */
    flinders_real alignment_deg;  /* heading error of a level vehicle by the mounting that an aiding sensor determined */
    flinders_real linearized_deg; /* heading error by the uncertainty of linearized axes, 1 sigma */
    flinders_real linearized_share; /* largest error of linearized axes, as a fraction of the field */
    flinders_real soft_iron_p_value; /* p-value of the test of readings against earlier soft iron */
    flinders_real poses_by_chance; /* p-value of the test of poses at known headings */
    flinders_real site_strength;  /* strength of the field at the site, unit; NaN: not used or unknown */
    flinders_real strength_found; /* mean semi-axis by the readings alone, unit */
    flinders_real strength_sigmas; /* difference of the two, in its standard deviations; the site's strength was used if no
                                      rule forbids it */

    int64_t backward_steps;       /* number of backward steps of the clock */
    int64_t skipped;              /* rows that could not be parsed; -1: unknown */
    int64_t silent;               /* rows without a reading of the sensor */
    int32_t is_doubtful;          /* 1 if columns without names have the length of gravity */
    int32_t plane;                /* of the level turn that the fit assumes: 1 xy, 2 yz, 3 zx; 0: none */
    int32_t sources;              /* other sources of the fit: bits FLINDERS_AIDED ... */
    int32_t is_claimed;           /* 1 after `flinders_claim` has widened the covariance */
    int32_t is_shrunk;            /* 1 if `flinders_claim` detected corrected readings, and shrunk the fit; -1 if it
                                     detected none; 0 before */
    int32_t z_axis;               /* direction of z in a level turn: FLINDERS_Z_DOWN ... */
    flinders_real repetition;     /* readings per distinct reading, as far as residuals do not account for it */
} flinders_record;

/* Sources of a fit in addition to the readings of one magnetometer: bits of `sources`. */
enum {
    FLINDERS_AIDED = 1,           /* other sensors, with which readings in one plane determine a surface */
    FLINDERS_AIDED_BY_FIELD = 2,  /* sensors whose claims are wrong in a non-uniform field */
    FLINDERS_COMPENSATED = 4,     /* recorded disturbances, of which the offset is a function */
    FLINDERS_REFRESHED = 8,       /* an earlier calibration, whose soft iron is kept */
    FLINDERS_AIDED_BY_ATTITUDE = 16 /* an attitude, which gives three equations per reading */
};

/* Direction of z in a level vehicle, for a level turn. */
enum {
    FLINDERS_Z_DOWN = 0,      /* down, or irrelevant */
    FLINDERS_Z_ELSEWHERE = 1, /* not down by an accelerometer: the dip of the site is not used */
    FLINDERS_Z_OPEN = 2       /* down or up, unknown: the dip of the site is used */
};

/* Known field of a site, and mounting of the sensor; initialise with `flinders_default_site` (NaN and 0). A number without
 * its uncertainty is not used. */
typedef struct flinders_site {
    flinders_real strength;              /* of the field, unit */
    flinders_real gain_sigma;            /* uncertainty of the sensor's mean gain, a fraction, 1 sigma */
    flinders_real inclination_deg;       /* of the field, positive if it points below the horizon */
    flinders_real inclination_sigma_deg; /* 1 sigma */
    flinders_real alignment_sigma_deg;   /* angle of z to the vertical in a level vehicle, 1 sigma */
    int32_t z_down;                      /* 1: z is stated to point down in a level vehicle */
} flinders_site;

/* Sums over readings of a level turn and their accelerations, initially zero; additive. */
typedef struct flinders_vertical {
    flinders_real readings;        /* number of readings with an acceleration */
    flinders_real acceleration[3]; /* their sum, m/s² or any other unit */
    flinders_real turn[2];         /* sum of the directions in the ellipse, unit vectors u */
    flinders_real across[2];       /* sum of (a_x + i a_y) times the conjugate of u_x + i u_y, real and imaginary part */
    flinders_real squares;         /* sum of a_x² + a_y² */
} flinders_vertical;

/* Plane of the readings of a level turn: z = height + slope · (x, y), with x and y from a centre. */
typedef struct flinders_heights {
    flinders_real height;        /* at the centre, unit */
    flinders_real slope[2];
    flinders_real covariance[9]; /* of height and slope */
} flinders_heights;

/* Prior of a sensor from an earlier calibration; computed by `flinders_earlier_of`. */
typedef struct flinders_earlier {
    flinders_real parameters[9];  /* expected offset and shape, unit */
    flinders_real covariance[81]; /* of these, unit²; infinite variance for an unknown parameter */
    flinders_real distortion;     /* of its record, a property of the sensor, unit */
} flinders_earlier;

/* A calibration for a comparison of two. */
typedef struct flinders_calibrated {
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real covariance[81]; /* claimed, of the nine parameters, unit²; zeros for an exact calibration */
    flinders_real strength;       /* of the field, unit; 0 if unknown, which excludes the scale from the comparison */
} flinders_calibrated;

/* Difference of two calibrations of one sensor. Unknown numbers are NaN. */
typedef struct flinders_difference {
    flinders_real rms_deg;        /* rms difference in heading over a level turn, without its mean */
    flinders_real worst_deg;      /* at the worst heading */
    flinders_real chi_square;     /* of offset and shape, with the sum of both covariances */
    flinders_real p_value;        /* of that chi-square */
    int32_t freedom;              /* degrees of freedom; 0 for two exact calibrations */
    flinders_real sigma_deg;      /* of the difference in heading, at the worst heading; 0 for two exact calibrations */
    flinders_real bound_deg;      /* bound of the error of that difference at all headings, with a probability of 95 % */
} flinders_difference;

/* Result of a check: whether the difference from another calibration is within a target. */
enum { FLINDERS_HOLDS = 0, FLINDERS_FAILS = 1, FLINDERS_CANNOT_TELL = 2 };

/* p-value below which a difference is significant. */
#define FLINDERS_CHANCE 0.01

/* One-sided 95 % quantile of the normal distribution, in standard deviations. */
#define FLINDERS_ONE_SIDED 1.645

/* Regression of the distances of readings from a surface on a recorded disturbance. */
typedef struct flinders_disturbance {
    int64_t used;               /* readings in the regression; 0 if too few */
    int64_t stride;             /* stride by which these are selected from the inliers */
    flinders_real range;        /* range of the disturbance, in its unit */
    flinders_real farthest;     /* largest distance of its values from their mean, in its unit */
    flinders_real explained;    /* sum of squares that it explains in addition to the nine parameters, unit² */
    flinders_real left;         /* residual sum of squares, unit² */
    flinders_real per_unit[3];  /* change of the offset per unit of the disturbance */
} flinders_disturbance;

/* Estimate of a sensor before its next reading; computed by `flinders_believe` and `flinders_rough`. */
typedef struct flinders_belief {
    flinders_real centre[3];      /* offset b, unit */
    flinders_real shape[6];       /* S, unit */
    flinders_real covariance[81]; /* of the nine parameters, unit²; singular if a method fixes some of them */
    flinders_real variance;       /* of the distance of a further reading from the surface, unit² */
    flinders_real readings;       /* number of readings so far */
} flinders_belief;

/* Purpose of further readings; initialise with `flinders_default_goal`. On a board (FLINDERS_SMALL) only headings. */
typedef struct flinders_goal {
    int32_t is_attitude;      /* 0 the heading of a level vehicle, 1 the direction of the field at any attitude (0) */
    flinders_real dip_deg;    /* inclination of the field, -89 to 89; not used for attitudes (60) */
    flinders_real down[3];    /* down direction of a level vehicle, in corrected sensor axes (0, 0, 1) */
    flinders_real target_deg; /* largest acceptable error, 1 sigma (1) */
} flinders_goal;

/* Direction of the most informative next readings. Unknown numbers are NaN. */
typedef struct flinders_advice {
    flinders_real direction[3]; /* advised direction of the field: a unit vector in corrected axes, the centre of a cell */
    flinders_real worst_deg;    /* error of the goal, 1 sigma: at the worst heading, or in the worst direction */
    flinders_real after_deg;    /* predicted error after a batch of readings in that direction */
} flinders_advice;

/* Advised path of the field in the axes of the body. Unknown numbers are NaN. */
typedef struct flinders_route {
    int32_t count;               /* number of waypoints, 0 to 6 */
    flinders_real waypoints[18]; /* (count, 3) unit vectors in corrected axes, connected by great circles */
    flinders_real worst_deg;     /* error of the goal, 1 sigma */
    flinders_real after_deg;     /* predicted error at the end of the path */
} flinders_route;

/* Number of readings in the evidence of an online calibration; on a board 80 to 512, of 27 bytes each in single precision,
 * including the workspace. */
#ifndef FLINDERS_SMALL
#define FLINDERS_EVIDENCE 768
#elif !defined(FLINDERS_EVIDENCE)
#define FLINDERS_EVIDENCE 96
#elif FLINDERS_EVIDENCE < 80 || FLINDERS_EVIDENCE > 512
#error "FLINDERS_EVIDENCE: 80 to 512"
#endif

/* State of an online calibration. */
enum {
    FLINDERS_LEARNING = 0,  /* no calibration yet */
    FLINDERS_UNDISTURBED = 1, /* readings agree with the calibration */
    FLINDERS_DISTURBED = 2  /* readings disagree: a temporary disturbance, or a changed offset */
};

/* Events of an online calibration: bits. */
enum {
    FLINDERS_LEARNT = 1,     /* the first calibration */
    FLINDERS_CONTRADICTED = 2, /* readings no longer agree with the calibration */
    FLINDERS_PASSED = 4,     /* readings agree again */
    FLINDERS_MOVED = 8,      /* readings disagree, but agree with each other: the offset has changed */
    FLINDERS_ADOPTED = 16,   /* a new calibration is in use */
    FLINDERS_CLOCK_BACK = 32 /* a time before the last one, whose reading is ignored */
};

/* State of an online calibration, which is updated while its sensor is used, in one record that may be saved and restored.
 * Times are in seconds, of any origin. Unknown numbers are NaN. */
typedef struct flinders_online {
    int32_t version;              /* FLINDERS_ONLINE_VERSION */
    int32_t state;                /* FLINDERS_LEARNING ... */
    int32_t is_locked;            /* 1: calibrations are not adopted automatically */
    int32_t is_level;             /* 1: all readings are of a level vehicle, so only their ellipse is known */
    int32_t kept;                 /* number of readings in the evidence */
    int32_t tested;               /* number of these that were compared with the calibration */
    int32_t doubtful;             /* index of the first one that contradicts it; -1: none */
    int32_t agreeing;             /* successive groups of readings that agree with the previous calibration */
    int32_t alike;                /* successive groups that agree with each other, but not with that calibration */
    int32_t suspects;             /* successive groups that are improbable by chance */
    int32_t groups;               /* number of groups since the first contradiction */
    int32_t is_lone;              /* 1: a single reading contradicts the calibration */
    int32_t averaged;             /* number of readings in the mean of the present direction */
    flinders_real target_deg;     /* largest acceptable heading error */
    flinders_real dip_deg;        /* inclination of the field, for heading errors */
    flinders_real began;          /* time of the first reading */
    flinders_real now;            /* time of the newest reading */
    flinders_real known[9];       /* offset and shape, without the evidence, unit */
    flinders_real known_covariance[81];
    flinders_real known_at;       /* time of `known` */
    flinders_real latest[9];      /* offset and shape, with the evidence, unit */
    flinders_real latest_covariance[81];
    flinders_real latest_at;
    flinders_real in_force[9];    /* offset and shape in use, unit */
    flinders_real adopted_at;     /* time since which they are in use */
    flinders_real replaced[9];    /* offset and shape in use before; NaN: none */
    flinders_real apart[3];       /* possible change of the offset, unit */
    flinders_real apart_covariance[9];
    flinders_real disturbed_at;   /* time of the first contradiction */
    flinders_real moved[3];       /* last change of the offset, which may be reversed, unit */
    flinders_real moved_at;       /* time of that change */
    flinders_real noise;          /* standard deviation of readings about the ellipsoid, unit */
    flinders_real place;          /* variation of the field strength between groups, 1 sigma, a fraction */
    flinders_real scatter;        /* ratio of the variance of groups that agree with the calibration to the claimed one */
    flinders_real suspect_ratio;  /* the same ratio for the newest suspect group */
    flinders_real height;         /* mean z of a level vehicle's readings at its calibration, unit */
    flinders_real height_now;     /* present mean z, unit */
    flinders_real height_sigma;   /* their standard deviation, unit */
    flinders_real moves;          /* number of changes of the offset */
    flinders_real moves_square;   /* sum of the squares of these changes, unit² */
    flinders_real watched;        /* duration of the observation, s */
    flinders_real rates[7];       /* probability of each rate of the offset's random walk */
    flinders_real probable_rates[7]; /* prior probability of each rate, to which `rates` decays */
    flinders_real expected_walk;  /* prior rate of the random walk for this sensor, unit per root hour; NaN: unknown */
    flinders_real expected_walk_sigma; /* 1 sigma of its natural logarithm */
    flinders_real sum[3];         /* of the readings in the present direction */
    flinders_real sum_time;       /* sum of their times */
    flinders_real last[3];        /* first of these readings */
    flinders_real last_at;
    flinders_real newest[12];     /* (4, 3) newest readings, unit */
    flinders_real newest_at[4];   /* times of the newest readings */
    flinders_real step;           /* mean square step between successive readings, unit² */
    flinders_real field[3 * FLINDERS_EVIDENCE]; /* evidence, unit: means of readings in one direction */
    flinders_real time[FLINDERS_EVIDENCE];
} flinders_online;

/* Claim of an online calibration at a time. NaN if none is in use. */
typedef struct flinders_online_claim {
    flinders_real rms_deg;        /* heading error of a level vehicle with the calibration in use, 1 sigma, rms over headings */
    flinders_real worst_deg;      /* at the worst heading */
    flinders_real bound_deg;      /* bound of the error at all headings, with a probability of 95 %; not on a board */
    flinders_real latest_deg;     /* worst heading error with the latest calibration */
    flinders_real age_s;          /* age of the latest calibration */
    flinders_real walk;           /* rate of the offset's random walk, unit per root hour */
    flinders_real covariance[81]; /* of the calibration in use, unit² */
} flinders_online_claim;

/* Axes of an attitude: those of a vehicle (forward, right, down), or of the sensor. */
enum { FLINDERS_VEHICLE = 0, FLINDERS_SENSOR = 1, FLINDERS_VEHICLE_POSES = 42, FLINDERS_SENSOR_POSES = 50 };

/* Options of a judgement; initialise with `flinders_default_request`. */
typedef struct flinders_request {
    flinders_real target_deg;     /* worst heading error that is good enough (1) */
    flinders_real field_strength; /* length of corrected readings, unit; NaN: the radius (NaN) */
    int32_t is_strength_known;    /* 1: that is the strength of the field; 0: a convention (0) */
    int32_t is_microtesla;        /* 1: the unit is the microtesla; 0: counts (1) */
    int32_t is_mirrored;          /* 1: the mapping of axes is a reflection (0) */
    int32_t rotation;             /* of the calibration: 0 none, as a magnetometer alone gives; 1 measured; 2 found by an
                                     aiding sensor (0) */
    int32_t parameters;           /* number of free parameters; 0: the covariance is already widened for few readings (9) */
    int32_t shrinks;              /* 1: detect readings that were corrected before (1) */
} flinders_request;

/* Severity of a finding, and its verdict: good, good with a note, limited, refused. */
enum { FLINDERS_NOTHING, FLINDERS_NOTE, FLINDERS_LIMITS, FLINDERS_REFUSES };

/* A comparison of a quantity with a number, or with a multiple of a quantity; FLINDERS_QUANTITIES for no quantity. */
typedef struct flinders_comparison {
    flinders_real factor;
    uint8_t of, quantity;
    uint8_t severity; /* if it is true */
    char comparison;  /* <, > or g: at least */
} flinders_comparison;

/* A finding: comparisons with limits in order of severity, then further necessary comparisons, and at the end the
 * quantity and the limit in its message. */
typedef struct flinders_rule {
    const char *code, *action; /* its code in the catalogue of findings, and the recommended action */
    uint16_t first;            /* index of its first comparison */
    uint8_t grades, needs;
} flinders_rule;

/* Judgement of a fit. Unknown numbers are NaN. */
typedef struct flinders_judgement {
    int32_t verdict;    /* the most severe of `severities`: NOTHING and NOTE are good, LIMITS limited, REFUSES refused */
    int32_t conditions; /* assumptions of a verdict other than refused: FLINDERS_IF_UNIFORM_FIELD ... */
    int32_t asks;       /* further checks to run: FLINDERS_ASKS_HALVES ... */
    uint8_t severities[FLINDERS_RULES_OF_A_FIT]; /* of each finding, or FLINDERS_NOTHING */
    uint8_t causes[FLINDERS_RULES_OF_A_FIT];     /* 1 + index of its cause, or of itself for a cause; 0: neither */
    uint8_t shown[FLINDERS_RULES_OF_A_FIT];      /* severities of findings without a cause, raised to those of their
                                                    consequences */
    uint8_t order[FLINDERS_RULES_OF_A_FIT];      /* these findings by importance; then FLINDERS_RULES */
    flinders_real quantities[FLINDERS_QUANTITIES_OF_A_FIT]; /* input of rules: NaN if unknown, -infinity if it was checked
                                                               and is absent */
    flinders_real rms_deg;        /* heading error of a level vehicle, 1 sigma, rms over all headings */
    flinders_real worst_deg;      /* at the worst heading; NaN if unknown */
    flinders_real bound_deg;      /* bound of the error at all headings, with a probability of 95 % */
    flinders_real structure_deg;  /* part of the heading error that depends on the direction */
    flinders_real covariance[81]; /* claimed, with that part: source of all stated errors of heading and direction */
} flinders_judgement;

/* Further checks that a judgement requests: bits of `asks`. */
enum {
    FLINDERS_ASKS_HALVES = 1,   /* compare the halves of the recording: `halves_apart` */
    FLINDERS_ASKS_SWAP = 2      /* check for swapped axes: `swap_gain` */
};

/* A run of readings that a fit leaves out. */
typedef struct flinders_outlier {
    int64_t first;   /* row of the first one */
    int64_t last;    /* row of the last one */
    int64_t rows;    /* number of readings that were left out */
    int64_t fitted;  /* the same after averaging of rests */
    flinders_real start;    /* time of the first one, s; NaN without times */
    flinders_real end;      /* time of the last one, s */
    flinders_real farthest; /* largest distance from the surface, unit */
} flinders_outlier;

/* Axes that changed sign or were exchanged during a recording. */
typedef struct flinders_axis_change {
    int32_t swap;       /* 0, 1, 2: x, y or z changed sign; 3, 4, 5: x and y, y and z, z and x were exchanged; -1: none */
    int64_t moments;    /* number of changes */
    flinders_real gain; /* factor by which undoing it reduces distances from an ellipsoid, at most 1000 */
} flinders_axis_change;

/* Counts of readings in a hundred cells of the sphere, of equal area: a cap about z, bands of 15, 34, 34 and 15, a cap. */
typedef struct flinders_coverage {
    flinders_real readings[100]; /* number of readings in each cell */
    flinders_real share;    /* fraction of cells that contain readings */
    flinders_real upright;  /* mean z component of the directions, -1 to 1 */
    flinders_real hole_deg; /* angle from the centre of the largest gap to the nearest direction */
    flinders_real hole[3];  /* centre of that gap, a unit vector in corrected axes */
} flinders_coverage;

#ifdef __cplusplus
extern "C" {
#endif

/* Fill options with their defaults, in parentheses above. */
FLINDERS_API void flinders_default_options(flinders_options *options);

/* Message of a status. */
FLINDERS_API const char *flinders_message(int status);

/* Size of a record and of a number (8 or 4) in bytes, for callers that are compiled separately. */
FLINDERS_API size_t flinders_record_size(void);
FLINDERS_API size_t flinders_real_size(void);

/* Kernels that an option selects on this processor: 1 the baseline, 2 AVX2. */
FLINDERS_API int flinders_kernels(int32_t wanted);

/* Size of the workspace for a recording of `rows` rows, in bytes. */
FLINDERS_API size_t flinders_workspace_size(size_t rows);

/* Fit one recording: field (rows, 3), time (rows,) in s or NULL. */
FLINDERS_API int flinders_fit(const flinders_real *field, const flinders_real *time, size_t rows,
                              const flinders_options *options, void *workspace, size_t size, flinders_record *record);

/* Fit several recordings of one sensor together. Their rows are concatenated; `ends` (parts,) are the end rows. Statistics
 * of successive readings do not cross from one recording to the next. */
FLINDERS_API int flinders_fit_parts(const flinders_real *field, const flinders_real *time, size_t rows,
                                    const int64_t *ends, size_t parts, const flinders_options *options,
                                    void *workspace, size_t size, flinders_record *record);

/* Fit the ellipse of a level turn in x and y. Offset and shape are those of the ellipsoid with this ellipse in a field of
 * inclination `dip_deg`, z down; across the plane, the shape has its prior, and 1 sigma of the offset is the field's
 * strength. The record has `plane` 1, and its majority is at the height majority_centre[2]. Parameters are those of
 * flinders_fit_parts, which calls this function for a level turn; a prior, six different readings, and variation in x and y
 * are required. Outliers are rejected if residuals have outliers, or never. */
FLINDERS_API int flinders_fit_level(const flinders_real *field, const flinders_real *time, size_t rows,
                                    const int64_t *ends, size_t parts, const flinders_options *options,
                                    void *workspace, size_t size, flinders_record *record);

/* Estimate a linear drift during one recording, with a known ellipsoid: fills `drift_...` of a record, NaN for too few
 * readings. At most 5,000 readings are used, at a constant stride. */
FLINDERS_API int flinders_drift(const flinders_real *field, size_t rows, const flinders_real centre[3],
                                const flinders_real shape[6], flinders_real dip_deg, void *workspace, size_t size,
                                flinders_record *record);

/* Whether accelerations (rows, 3), NaN if missing, are of a level turn about z, for `level` of the options: 0 if the mean of z
 * is more than 30 degrees from the vertical, or the tilt about that mean is above 25 degrees; 2 if that tilt is below about
 * 10 degrees; else 1 (root mean squares). */
FLINDERS_API int flinders_levelness(const flinders_real *acceleration, size_t rows);

/* Regress the distances of readings from a known ellipsoid on a disturbance: values (rows,), NaN if unknown. Distances above
 * `limit` are left out, and at most 5,000 readings are used, at a constant stride. */
FLINDERS_API int flinders_regress(const flinders_real *field, const flinders_real *values, size_t rows,
                                  const flinders_real centre[3], const flinders_real shape[6], flinders_real limit,
                                  void *workspace, size_t size, flinders_disturbance *found);

/* Fit many recordings: recording i is rows offsets[i] to offsets[i + 1]. Returns the largest status. */
FLINDERS_API int flinders_fit_many(const flinders_real *field, const flinders_real *time, const int64_t *offsets,
                                   size_t recordings, const flinders_options *options, void *workspace, size_t size,
                                   flinders_record *records);

/* Fit from a known start: `centre` and `shape`, which is also the start of a robust fit. `ends` and `parts` as for
 * flinders_fit_parts, or NULL and 0. Statistics of the recording are not computed. */
FLINDERS_API int flinders_polish(const flinders_real *field, size_t rows, const int64_t *ends, size_t parts,
                                 const flinders_real centre[3], const flinders_real shape[6],
                                 const flinders_options *options, void *workspace, size_t size,
                                 flinders_record *record);

/* Prior from an earlier calibration of a sensor whose hard iron has changed: its offset is only a start; its shape has its
 * covariance, or an uncertainty of 2 % of the radius for NULL. The field is `strength_ratio` times as strong as then, to 1 %,
 * and the fraction by which soft iron may have changed is `soft_iron_sigma`, 1 sigma. */
FLINDERS_API void flinders_earlier_of(const flinders_real centre[3], const flinders_real shape[6],
                                      const flinders_real *covariance, flinders_real distortion,
                                      flinders_real strength_ratio, flinders_real soft_iron_sigma,
                                      flinders_earlier *earlier);

/* Allow a change of soft iron by 5 %, 1 sigma, if readings contradict that of the earlier calibration. */
FLINDERS_API void flinders_allow_change(flinders_earlier *earlier);

/* p-value of a test of a fit against the soft iron of an earlier calibration: from the shape of a fit with
 * `flinders_allow_change`, and its covariances (9, 9) for independent and for correlated residuals. */
FLINDERS_API flinders_real flinders_soft_iron_p_value(const flinders_earlier *earlier, const flinders_real shape[6],
                                                      const flinders_real textbook[81],
                                                      const flinders_real covariance[81]);

/* Refresh an earlier calibration: estimate the offset with the earlier shape, or with a changed shape if readings contradict
 * the earlier one. A few seconds of small turns are enough. FLINDERS_TOO_FEW for less than 20 readings, FLINDERS_UNMOVED for
 * turns of at most 5°. */
FLINDERS_API int flinders_refresh(const flinders_real *field, const flinders_real *time, size_t rows,
                                  const flinders_options *options, const flinders_earlier *earlier, void *workspace,
                                  size_t size, flinders_record *record);

/* Compare two calibrations of one sensor, with a significance test: each corrects the readings that the other predicts for a
 * level turn of a vehicle. */
FLINDERS_API int flinders_compare(const flinders_calibrated *first, const flinders_calibrated *second,
                                  flinders_real dip_deg, flinders_difference *difference);

/* Whether a difference in heading of `flinders_difference` is within a target. FLINDERS_HOLDS: difference plus bound are within
 * it. FLINDERS_FAILS: the difference is above the target by more than FLINDERS_ONE_SIDED sigma, and its p-value is below
 * FLINDERS_CHANCE. FLINDERS_CANNOT_TELL: neither, or a number is NaN. Two exact calibrations have no uncertainty. */
FLINDERS_API int flinders_holds(flinders_real worst_deg, flinders_real sigma_deg, flinders_real bound_deg,
                                 flinders_real p_value, flinders_real target_deg);

/* Size of the record of an online calibration in bytes. Its workspace is that of FLINDERS_EVIDENCE readings, on a board
 * FLINDERS_ONLINE_WORKSPACE bytes. */
FLINDERS_API size_t flinders_online_size(void);
#define FLINDERS_ONLINE_WORKSPACE (FLINDERS_EVIDENCE * (2 * sizeof(flinders_real) + 3))

/* Begin without a calibration. On a board, a calibration must be given: a first one is not learnt there. */
FLINDERS_API void flinders_online_begin(flinders_online *online);

/* Use a calibration that was valid at a time: offset and shape (9,) and their covariance (9, 9). FLINDERS_BAD_OPTION for an
 * invalid covariance or time. */
FLINDERS_API int flinders_online_know(flinders_online *online, const flinders_real parameters[9],
                                      const flinders_real covariance[81], flinders_real noise, flinders_real time);

/* Set the prior rate of the offset's random walk for this sensor: unit per root hour, and 1 sigma of its natural logarithm.
 * FLINDERS_BAD_OPTION unless both are positive. */
FLINDERS_API int flinders_online_expect_walk(flinders_online *online, flinders_real walk, flinders_real log_sigma);

/* Add readings: field (rows, 3), time (rows,) in s. Stops after a reading with an event, bits of `events`; returns the number
 * of readings that were added. */
FLINDERS_API size_t flinders_online_add(flinders_online *online, const flinders_real *field, const flinders_real *time,
                                        size_t rows, void *workspace, size_t size, int32_t *events);

/* Claim at a time, now or later; FLINDERS_UNDETERMINED if no calibration is in use. */
FLINDERS_API int flinders_online_claim_at(const flinders_online *online, flinders_real time, flinders_online_claim *claim);

/* Time in s after the newest reading for which the worst heading error is within the target without further readings: infinite
 * above ten years, NaN if the error is above the target now. */
FLINDERS_API flinders_real flinders_online_good_s(const flinders_online *online);

/* Move the origin of times by `seconds`: single precision resolves milliseconds only within hours. */
FLINDERS_API void flinders_online_shift(flinders_online *online, flinders_real seconds);

/* Use the latest calibration, or the previous one. */
FLINDERS_API void flinders_online_adopt(flinders_online *online);
FLINDERS_API void flinders_online_take_back(flinders_online *online);

/* Largest angle between readings (rows, 3) and their mean, degrees, with a known shape. */
FLINDERS_API flinders_real flinders_turn_deg(const flinders_real *field, size_t rows, const flinders_real shape[6]);

/* Rests of a recording, `ends` and `parts` as for flinders_fit_parts: bounds (rests, 2) gets the first row of each and the row
 * after its last, and has a size of rows / 2 numbers; `are_left_out` is 1 if a fit leaves them out, and 0 if it averages each.
 * Returns the number of rests; 0 if too few readings would be left for a fit. */
FLINDERS_API size_t flinders_rests(const flinders_real *field, size_t rows, const int64_t *ends, size_t parts,
                                   void *workspace, size_t size, int64_t *bounds, int32_t *are_left_out);

/* Begin sums about an origin (NULL: zero), in units of `scale`. */
FLINDERS_API void flinders_sums_begin(flinders_sums *sums, const flinders_real origin[3], flinders_real scale);

/* Add readings (rows, 3). */
FLINDERS_API int flinders_sums_add(flinders_sums *sums, const flinders_real *field, size_t rows);

/* Move sums to another origin and scale; the loss of precision is as the fourth power of the shift. */
FLINDERS_API void flinders_sums_move(flinders_sums *sums, const flinders_real origin[3], flinders_real scale);

/* Add other sums, of any origin and scale. */
FLINDERS_API void flinders_sums_merge(flinders_sums *sums, const flinders_sums *other);

/* Consistent ellipsoid and noise from the sums: fills centre, shape, radius, noise, mean and spread. */
FLINDERS_API int flinders_sums_solve(const flinders_sums *sums, flinders_record *record);

/* Sampson distances (rows,) of readings from the surface of a record, outside positive, unit. */
FLINDERS_API int flinders_distances(const flinders_real *field, size_t rows, const flinders_record *record,
                                    flinders_real *out);

/* Heading error of a level vehicle, and error of the direction, from shape and covariance. */
FLINDERS_API int flinders_heading_errors(flinders_record *record, flinders_real dip_deg);

/* Errors (count,) of the corrected field in directions (count, 3), degrees, 1 sigma; NaN if the shape is invalid. */
FLINDERS_API int flinders_direction_errors(const flinders_real shape[6], const flinders_real covariance[81],
                                           const flinders_real *directions, size_t count, flinders_real *errors_deg);

/* Fill a goal with its defaults, in parentheses above. */
FLINDERS_API void flinders_default_goal(flinders_goal *goal);

/* Start from the result of a fit: its surface, covariance and noise, and counts (100,) of its readings in each cell of the
 * sphere: a cap, bands of 15, 34, 34 and 15 from +z to -z, a cap. The variance of a reading is such that these readings have
 * this covariance, so further readings have less weight if residuals are correlated. */
FLINDERS_API void flinders_believe(const flinders_real centre[3], const flinders_real shape[6],
                                   const flinders_real covariance[81], flinders_real noise,
                                   const flinders_real counts[100], flinders_belief *belief);

/* Fit a sphere to readings (rows, 3) that are too few for a fit, with a prior of typical hard and soft iron;
 * FLINDERS_TOO_FEW or FLINDERS_UNDETERMINED if they do not determine its centre. */
FLINDERS_API int flinders_rough(const flinders_real *field, size_t rows, flinders_belief *belief);

/* Direction of readings that would reduce the worst error most. `batch`: number of readings there; 0: a hundredth of the
 * number so far. */
FLINDERS_API int flinders_guidance(const flinders_belief *belief, const flinders_goal *goal, flinders_real batch,
                                   flinders_advice *advice);

/* Shortest path that reduces the worst error to the target, or the best one of six steps of about 35°, from the present
 * direction of the field (3,), a vector of any length in corrected axes. */
FLINDERS_API int flinders_path(const flinders_belief *belief, const flinders_goal *goal, const flinders_real at[3],
                               flinders_real readings_per_deg, flinders_route *route);

/* Down direction in an attitude of a frame: a unit vector in its axes. Returns the number of angles to estimate by eye; -1 for
 * an unknown attitude. */
FLINDERS_API int flinders_pose(int32_t frame, int32_t pose, flinders_real down[3]);

/* The simplest attitude in which one full turn of the body brings the field near an advised direction. */
FLINDERS_API int32_t flinders_pose_towards(int32_t frame, const flinders_goal *goal, const flinders_real direction[3]);

/* Size of a judgement in bytes, for callers that are compiled separately. */
FLINDERS_API size_t flinders_judgement_size(void);

/* Fill a site with unknown numbers. */
FLINDERS_API void flinders_default_site(flinders_site *site);

/* Add readings (rows, 3) of a level turn and their accelerations (rows, 3), NaN if missing; `record` is that of the turn's
 * fit. */
FLINDERS_API void flinders_vertical_add(const flinders_real *field, const flinders_real *acceleration, size_t rows,
                                        const flinders_record *record, flinders_vertical *vertical);

/* Fit a plane to readings (rows, 3) with a noise, about a centre in x and y; outliers in height are left out. */
FLINDERS_API int flinders_plane_of(const flinders_real *field, size_t rows, const flinders_real centre[2],
                                   flinders_real noise, void *workspace, size_t size, flinders_heights *heights);

/* Add the known field of a site to a fit, before its record is claimed: changes centre, shape, radius and covariances, fills
 * `site_strength`, `strength_found`, `strength_sigmas` and `z_axis`. Errors of a level heading become NaN until the record is
 * judged. `field` (rows, 3) are the readings in the fit, `vertical` sums of accelerations or NULL; both are used only for a
 * level turn. If the strength was used, it must be that of the judgement's request (`flinders_request`). */
FLINDERS_API int flinders_at_site(const flinders_real *field, size_t rows, const flinders_vertical *vertical,
                                  const flinders_site *site, void *workspace, size_t size, flinders_record *record);

/* Whether the strength of a site was used in a record, 1 or 0. */
FLINDERS_API int flinders_uses_strength(const flinders_record *record);

/* Fill a request with its defaults, in parentheses above. */
FLINDERS_API void flinders_default_request(flinders_request *request);

/* Fill a record with unknown numbers. */
FLINDERS_API void flinders_clear_record(flinders_record *record);

/* Widen the covariance of a record, once, for errors outside the model of its method: repeated readings, and noise that is
 * estimated from few readings. Its level errors are scaled accordingly; those that are NaN are computed from the covariance, at
 * `dip_deg`, which becomes negative if the readings indicate that the sensor is upside down.
 *
 * For readings that were corrected before, by a driver or an earlier calibration, with odds of at least 999 to 1, centre,
 * shape, covariance and errors become those of a fit that is shrunk towards no correction. */
FLINDERS_API void flinders_claim(flinders_record *record, const flinders_request *request);

/* Factor that widens a covariance whose noise is estimated from few residuals, for `freedom`: the number of different readings
 * minus that of parameters. */
FLINDERS_API flinders_real flinders_widening_by_few(flinders_real freedom);

/* Judge a fit: claim its record, and apply the rules of the catalogue of findings to it. Unknown numbers of the record, NaN
 * or 0, make no finding.
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

/* Judge many records with the same request; those with another status than FLINDERS_OK are refused. */
FLINDERS_API void flinders_judge_many(flinders_record *records, size_t count, const flinders_request *request,
                                      flinders_judgement *judgements);

/* A finding of the catalogue; those from FLINDERS_RULES_OF_A_FIT on are for disturbances and other sensors. */
FLINDERS_API const flinders_rule *flinders_rule_of(int rule);

/* Severity of a finding for quantities (FLINDERS_QUANTITIES,), by its rule alone. */
FLINDERS_API int flinders_severity(int rule, const flinders_real *quantities);

/* Whether a finding was checked: 1 if none of the quantities (FLINDERS_QUANTITIES,) in its rule is NaN. For findings of a fit,
 * the quantities of its judgement are enough; the same is true for `flinders_severity`. */
FLINDERS_API int flinders_is_checked(int rule, const flinders_real *quantities);

/* Select the findings to show: fills causes, shown, order and verdict of a judgement from its severities. */
FLINDERS_API void flinders_causes(flinders_judgement *judgement);

/* Heading error of a vehicle at a known tilt, 1 sigma: rms over all headings and directions of the tilt, and at the worst of
 * these. `down` is the down direction of a level vehicle in corrected axes, NULL for z. */
FLINDERS_API int flinders_tilted_error(const flinders_real shape[6], const flinders_real covariance[81],
                                       flinders_real dip_deg, flinders_real tilt_deg, const flinders_real *down,
                                       flinders_real *rms_deg, flinders_real *worst_deg);

/* Heading error of a level vehicle with uncorrected readings. */
FLINDERS_API int flinders_uncorrected_error(const flinders_real centre[3], const flinders_real shape[6],
                                            flinders_real dip_deg, const flinders_real *down, flinders_real *rms_deg,
                                            flinders_real *worst_deg);

/* Largest tilt with a worst heading error within a limit, degrees: 0 if that of a level vehicle is above the limit, 180 if all
 * are within it. */
FLINDERS_API int flinders_attitude_limit(const flinders_real shape[6], const flinders_real covariance[81],
                                         flinders_real dip_deg, flinders_real limit_deg, const flinders_real *down,
                                         flinders_real *tilt_deg);

/* A level turn in steps of 5°: headings, the heading errors of uncorrected readings without their mean, and the heading error
 * of the calibration, 1 sigma, each (72,), degrees. */
FLINDERS_API int flinders_level_turn(const flinders_real centre[3], const flinders_real shape[6],
                                     const flinders_real covariance[81], flinders_real dip_deg,
                                     const flinders_real *down, flinders_real *headings_deg,
                                     flinders_real *deviations_deg, flinders_real *sigmas_deg);

/* Heading errors (count,) of a vehicle at the worst attitude for each direction of the corrected field (count, 3), degrees,
 * 1 sigma. */
FLINDERS_API int flinders_attitude_errors(const flinders_real shape[6], const flinders_real covariance[81],
                                          flinders_real dip_deg, const flinders_real *directions, size_t count,
                                          flinders_real *errors_deg);

/* Standard deviations (9,) of the entries of the matrix F S⁻¹ that corrects readings, by rows; F is the field strength if
 * `is_known`, otherwise the radius. */
FLINDERS_API int flinders_matrix_sigmas(const flinders_real matrix[9], const flinders_real shape[6],
                                        const flinders_real covariance[81], int32_t is_known, flinders_real sigmas[9]);

/* Add direction-dependent errors to the covariance of offset and shape, with a heading error `structure_deg` of a level
 * vehicle: an uncertain offset σ² S Sᵀ, which moves the corrected field by σ in every direction. */
FLINDERS_API void flinders_with_structure(const flinders_real shape[6], const flinders_real covariance[81],
                                          flinders_real structure_deg, flinders_real dip_deg, flinders_real out[81]);

/* Bound of the heading error of a level vehicle at all headings, with a probability of 95 %, degrees. */
FLINDERS_API int flinders_heading_bound(const flinders_real shape[6], const flinders_real covariance[81],
                                        flinders_real dip_deg, const flinders_real *down, flinders_real *bound_deg);

/* Whether a sensor was hardly turned, so that its readings (rows, 3) determine no surface. `angle_deg` is the largest angle
 * between readings, from the centre of their sphere, or NaN if the sensor was turned, or for fewer than 20 readings. The
 * strength of the field is between `weakest` and `strongest`, unit; 0 and infinity if unknown. */
FLINDERS_API int flinders_unmoved(const flinders_real *field, size_t rows, flinders_real weakest, flinders_real strongest,
                                  void *workspace, size_t size, flinders_real *angle_deg);

/* The same from cells of space: means (cells, 3) of the readings in each, which are overwritten, and the total number of
 * readings. */
FLINDERS_API int flinders_unmoved_cells(flinders_real *means, size_t cells, flinders_real readings, flinders_real weakest,
                                        flinders_real strongest, flinders_real *angle_deg);

/* Whether each record (count,) proves that the sensor was turned out of one plane, without saturation: 1 or 0 in turned
 * (count,). For 0, check the readings with `flinders_unmoved`; strengths are as for that function. */
FLINDERS_API void flinders_turned(const flinders_record *records, size_t count, flinders_real weakest,
                                  flinders_real strongest, unsigned char *turned);

/* Threshold of outliers in a window of eleven readings for a run: far (n,) is 1 or 0 for n readings of a recording of `rows`
 * rows. The false alarm rate is one in a thousand recordings; `scratch` (n,) is memory for the computation. */
FLINDERS_API int flinders_dense(const unsigned char *far, size_t n, size_t rows, unsigned char *scratch);

/* Which readings a fit leaves out, 1 or 0 in out (rows,): far ones, those in a run (`dense` far ones in a window of eleven),
 * and those within FLINDERS_MARGIN of a run. */
FLINDERS_API void flinders_left_out(const unsigned char *far, size_t rows, int32_t dense, unsigned char *out);

/* List the runs of readings that a fit leaves out, after the `count` runs already listed: a run contains at most five other
 * readings. Arguments are, for each reading, its distance from the surface, whether it is left out, its first and last row in
 * the recording (one row unless it is a rest), and the times of these rows, or NULL. `runs` has a size of
 * FLINDERS_OUTLIERS; returns the number of runs. */
FLINDERS_API size_t flinders_list_outliers(const flinders_real *distances, const unsigned char *out, size_t rows,
                                           const int64_t *first, const int64_t *last, const flinders_real *start,
                                           const flinders_real *end, flinders_outlier *runs, size_t count);

/* Size of the workspace for a search for changed axes, in bytes. */
FLINDERS_API size_t flinders_swap_workspace_size(size_t rows);

/* Find times at which axes changed sign or were exchanged: `moments`, of a size of `rows` numbers, gets the row after each.
 * A change is accepted if the noise after undoing it is at most 1.1 times `noise`, unit (infinity if unknown), and at most a
 * fraction `noise_limit` of the radius. */
FLINDERS_API int flinders_axis_swap(const flinders_real *field, size_t rows, flinders_real noise,
                                    flinders_real noise_limit, void *workspace, size_t size, int64_t *moments,
                                    flinders_axis_change *found);

/* Coverage of the sphere by readings (rows, 3), as in the record of a fit: cells of space are projected from the centre of an
 * ellipsoid. Cells at a distance from it above `within` plus their own size are left out as outliers; none if it is 0. */
FLINDERS_API int flinders_coverage_of(const flinders_real *field, size_t rows, const flinders_real centre[3],
                                      const flinders_real shape[6], flinders_real within, void *workspace, size_t size,
                                      flinders_coverage *coverage);

/* The same from cells of space of size `side`: means (cells, 3) and numbers (cells,) of the readings in each. `scratch` has a
 * size of 6 * cells numbers. */
FLINDERS_API int flinders_coverage_of_cells(const flinders_real *means, const flinders_real *readings, size_t cells,
                                            flinders_real side, const flinders_real centre[3],
                                            const flinders_real shape[6], flinders_real within, flinders_real *scratch,
                                            flinders_coverage *coverage);

/* Index of the cell of the sphere, out of a hundred, for each unit vector (count, 3). */
FLINDERS_API void flinders_cells_of(const flinders_real *directions, size_t count, uint32_t *cells);

/* An inclination with its sign by the number of readings in each cell of the sphere: with a sensor that is mounted upside down,
 * the field comes from below. `is_open` is 1 if both signs are possible, as the readings do not fit a level vehicle. */
FLINDERS_API flinders_real flinders_facing(const flinders_real readings[100], flinders_real dip_deg, int32_t *is_open);

/* Whether readings with a covariance lie in a plane across z, 1 or 0: to less than `within` times their noise, unit. */
FLINDERS_API int flinders_is_level(const flinders_real covariance[6], flinders_real noise, flinders_real within);

#ifdef __cplusplus
}
#endif
#endif
