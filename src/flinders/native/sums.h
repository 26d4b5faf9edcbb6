/* Sums of monomials: their order, and functions of them. */
#ifndef FLINDERS_SUMS_H
#define FLINDERS_SUMS_H

#include "internal.h"

extern const unsigned char FL_EXPONENTS[35][3];
extern const unsigned char FL_PRODUCT[10][10];

void fl_unpack(const real sums[35], real scatter[100]);
void fl_heat(const real sums[35], real out[35]);
void fl_sums_mean(const flinders_sums *sums, real mean[3]);
void fl_sums_covariance(const flinders_sums *sums, real covariance[6]);
real fl_sums_spread(const flinders_sums *sums);

/* The sums of a record. */
static inline void fl_sums_of(const flinders_record *record, flinders_sums *sums)
{
    memcpy(sums->sums, record->sums, sizeof sums->sums);
    memcpy(sums->origin, record->sums_origin, sizeof sums->origin);
    sums->scale = record->sums_scale;
}

#endif
