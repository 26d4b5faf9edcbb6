/* Random numbers, identical on all platforms. */
#ifndef FLINDERS_RANDOM_H
#define FLINDERS_RANDOM_H

#include "internal.h"

typedef struct {
    uint64_t high, low; /* the state, 128 bits */
    uint32_t spare;     /* unused half of the last 64 bits */
    int has_spare;
    uint32_t skipped;   /* length of a permutation that is drawn only before the next number */
} fl_random;

fl_random fl_random_begin(void);
void fl_random_catch_up(fl_random *random, uint32_t *scratch);
void fl_random_permutation(fl_random *random, uint32_t n, uint32_t *out);
void fl_random_choice(fl_random *random, uint32_t n, uint32_t k, uint32_t *out);

/* High 64 bits of the product of two numbers. */
static inline uint64_t fl_high_product(uint64_t a, uint64_t b)
{
#ifdef __SIZEOF_INT128__
    __extension__ typedef unsigned __int128 wide;
    return (uint64_t)((wide)a * b >> 64);
#else
    const uint64_t a1 = a >> 32, a0 = a & UINT32_MAX, b1 = b >> 32, b0 = b & UINT32_MAX;
    const uint64_t middle = a1 * b0 + (a0 * b0 >> 32), low = (middle & UINT32_MAX) + a0 * b1;
    return a1 * b1 + (middle >> 32) + (low >> 32);
#endif
}

/* The next 64 bits. */
static inline uint64_t fl_random_bits(fl_random *random)
{
    static const uint64_t FACTOR[2] = {UINT64_C(0x2360ED051FC65DA4), UINT64_C(0x4385DF649FCCF645)};
    static const uint64_t INCREMENT[2] = {UINT64_C(0x5405232820D34684), UINT64_C(0x3421BEDE1EA48079)};
    const uint64_t high = random->high, low = random->low;
    const uint64_t product = low * FACTOR[1];
    random->low = product + INCREMENT[1];
    random->high = fl_high_product(low, FACTOR[1]) + high * FACTOR[1] + low * FACTOR[0] + INCREMENT[0] +
                   (random->low < product);
    const uint64_t folded = random->high ^ random->low, turn = random->high >> 58;
    return folded >> turn | folded << (-turn & 63);
}

#endif
