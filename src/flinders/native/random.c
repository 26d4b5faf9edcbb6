/* Random numbers, those of NumPy's `default_rng(20240607)`: the same readings are drawn on every platform and release.
 *
 * M. E. O'Neill, PCG: a family of simple fast space-efficient statistically good algorithms for random number
 * generation (2014), with a state of 128 bits (XSL RR); D. Lemire, Fast random integer generation in an interval, ACM
 * Trans. Model. Comput. Simul. 29 (2019); R. W. Floyd's draw without replacement, Comm. ACM 30 (1987).
 */
#include "random.h"

/* Begin the sequence. */
fl_random fl_random_begin(void)
{
    const fl_random random = {UINT64_C(0x4FD40AD5AEA0EF1C), UINT64_C(0xC19EC1DA30E8B120), 0, 0, 0};
    return random;
}

/* The next 32 bits: 64 of them serve twice. */
static uint32_t half_bits(fl_random *random)
{
    if (random->has_spare) {
        random->has_spare = 0;
        return random->spare;
    }
    const uint64_t bits = fl_random_bits(random);
    random->spare = (uint32_t)(bits >> 32), random->has_spare = 1;
    return (uint32_t)bits;
}

/* A whole number from 0 to `most`, without bias: larger draws are left out. */
static uint32_t at_most(fl_random *random, uint32_t most)
{
    uint32_t mask = most, value;
    for (int shift = 1; shift < 32; shift *= 2) mask |= mask >> shift;
    do value = half_bits(random) & mask;
    while (value > most);
    return value;
}

/* A whole number from 0 to `most`, which is above 0, as the high half of a product. */
static uint32_t scaled(fl_random *random, uint32_t most)
{
    const uint64_t many = (uint64_t)most + 1;
    const uint32_t least = (uint32_t)((UINT32_MAX - most) % many);
    uint64_t product = half_bits(random) * many;
    while ((uint32_t)product < least) product = half_bits(random) * many;
    return (uint32_t)(product >> 32);
}

/* Exchange two entries of a list. */
static void exchange(uint32_t *list, uint32_t a, uint32_t b)
{
    const uint32_t entry = list[a];
    list[a] = list[b], list[b] = entry;
}

/* 0, 1, ... n - 1 in random order. */
void fl_random_permutation(fl_random *random, uint32_t n, uint32_t *out)
{
    for (uint32_t i = 0; i < n; i++) out[i] = i;
    for (uint32_t i = n; i-- > 1;) exchange(out, i, at_most(random, i));
}

/* Draw what was skipped. */
void fl_random_catch_up(fl_random *random, uint32_t *scratch)
{
    if (random->skipped) fl_random_permutation(random, random->skipped, scratch);
    random->skipped = 0;
}

/* Draw k of n numbers, k < n <= FL_ENOUGH, without replacement and in random order; `out` has room for all n. */
void fl_random_choice(fl_random *random, uint32_t n, uint32_t k, uint32_t *out)
{
    unsigned char taken[FL_ENOUGH / 8 + 1] = {0};
    if (n > 10000 && k > n / 50) { /* the end of a permutation */
        for (uint32_t i = 0; i < n; i++) out[i] = i;
        for (uint32_t i = n; i-- > n - k;) exchange(out, i, scaled(random, i));
        memmove(out, out + (n - k), k * sizeof *out);
        return;
    }
    for (uint32_t i = 0, last = n - k; last < n; i++, last++) {
        const uint32_t drawn = scaled(random, last), value = taken[drawn / 8] >> drawn % 8 & 1 ? last : drawn;
        taken[value / 8] |= (unsigned char)(1 << value % 8);
        out[i] = value;
    }
    for (uint32_t i = k; i-- > 1;) exchange(out, i, scaled(random, i));
}
