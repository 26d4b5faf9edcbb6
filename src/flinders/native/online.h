/* Shared declarations of the online calibration. */
#ifndef FLINDERS_ONLINE_H
#define FLINDERS_ONLINE_H

#include "judge.h"
#include "residuals.h"

enum { FL_PARAMETERS = 9, FL_EVIDENCE = FLINDERS_EVIDENCE, FL_RATES = 7 };

/* Workspace of fits. */
typedef struct {
    void *at;
    size_t size;
} fl_lent;

extern const real fl_probable_rates[FL_RATES]; /* prior probabilities of the rates of the offset's random walk */

real fl_mean_radius(const real parameters[9]);
real fl_walk_variance(const flinders_online *online);
void fl_condition_on_height(const flinders_online *online, const real parameters[9], real covariance[81]);
void fl_age(const flinders_online *online, const real parameters[9], real seconds, real covariance[81]);
int fl_offset_alone(const flinders_online *online, size_t first, const real start[3], real anywhere,
                    const fl_lent *memory, real offset[3], real covariance[9]);
real fl_chance_of_offsets(const real d[3], const real one[9], const real other[9], real scatter, real *ratio);
void fl_offset_covariance(const flinders_online *online, real time, real out[9]);
void fl_learn(flinders_online *online, const fl_lent *memory);
void fl_keep_open(const real before[81], real same, real covariance[81]);
void fl_expect_walk(flinders_online *online);
void fl_closed(const flinders_online *online, real covariance[81]);
void fl_weigh_rates(flinders_online *online, const real d[3], const real covariance[9], real seconds);
void fl_count_move(flinders_online *online, real square);
real fl_unseen_moves(const flinders_online *online, real seconds);

#endif
