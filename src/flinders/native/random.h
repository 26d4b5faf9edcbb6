/* Random numbers, the same everywhere. */
#ifndef FLINDERS_RANDOM_H
#define FLINDERS_RANDOM_H

#include "internal.h"

typedef struct {
    uint64_t high, low; /* the state, 128 bits */
    uint32_t spare;     /* half of the last 64 bits, where only the other was asked for */
    int has_spare;
} fl_random;

fl_random fl_random_begin(void);
uint64_t fl_random_bits(fl_random *random);
void fl_random_permutation(fl_random *random, uint32_t n, uint32_t *out);
void fl_random_choice(fl_random *random, uint32_t n, uint32_t k, uint32_t *out);

#endif
