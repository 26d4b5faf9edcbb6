/* Shared declarations of the judge. */
#ifndef FLINDERS_JUDGE_H
#define FLINDERS_JUDGE_H

#include "internal.h"

#ifdef FLINDERS_SMALL /* a board has only the findings of a fit */
enum { FL_RULES = FLINDERS_RULES_OF_A_FIT };
#else
enum { FL_RULES = FLINDERS_RULES };
#endif

/* A finding of at least a severity, and its consequences, unless finding `unless` is present. */
typedef struct {
    uint8_t code, severity, unless, count, consequences[20];
} fl_cause;

/* rules.c */
extern const flinders_comparison fl_comparisons[];
extern const flinders_rule fl_rules[FL_RULES];
extern const fl_cause fl_causes[FLINDERS_CAUSES];

/* attitude.c: headings of vehicles; `down` is the down direction of a level vehicle in corrected axes, NULL for z */
const real *fl_down(int plane);
void fl_tilted_error(const fl_surface *surface, const real covariance[81], real dip_deg, real tilt_deg, const real *down,
                     real *rms_deg, real *worst_deg);
void fl_uncorrected_error(const fl_surface *surface, real dip_deg, const real *down, real *rms_deg, real *worst_deg);
real fl_attitude_limit(const fl_surface *surface, const real covariance[81], real dip_deg, real limit_deg, const real *down);

/* bound.c: shared tables of all bounds */
enum { FL_BOUND_HEADINGS = 36 };
typedef struct {
    real directions[4][FL_AMPLITUDES], harmonics[FL_BOUND_HEADINGS][4];
} fl_bound;

void fl_bound_begin(fl_bound *bound);
real fl_heading_bound(const fl_surface *surface, const real covariance[81], real dip_deg, const real *down,
                      fl_bound *shared);

#endif
