/* Which kernels run: those of the baseline, or those for AVX2 where the processor has it. */
#include "internal.h"

extern const fl_kernels fl_kernels_baseline;
#ifdef FL_WITH_AVX2
#include <cpuid.h>

extern const fl_kernels fl_kernels_avx2;

static int has_avx2;

/* Ask processor and system for AVX2 and FMA, once, at load: where the system is a guest, asking takes microseconds.
 * Not by __builtin_cpu_supports, which says no wherever zig compiled it. */
__attribute__((constructor)) static void ask_processor(void)
{
    const unsigned saved = 6; /* the system saves both halves of the wide registers */
    unsigned a, b, c, d, enabled;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE) || !(c & bit_FMA)) return;
    __asm__ volatile("xgetbv" : "=a"(enabled), "=d"(d) : "c"(0));
    if ((enabled & saved) != saved || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return;
    has_avx2 = (b & bit_AVX2) != 0;
}
#endif

/* 1 for the baseline, 2 for AVX2. */
int flinders_kernels(int32_t wanted)
{
#ifdef FL_WITH_AVX2
    if (wanted != 1 && has_avx2) return 2;
#else
    (void)wanted;
#endif
    return 1;
}

/* The kernels themselves. */
const fl_kernels *fl_kernels_chosen(int which)
{
#ifdef FL_WITH_AVX2
    if (flinders_kernels(which) == 2) return &fl_kernels_avx2;
#else
    (void)which;
#endif
    return &fl_kernels_baseline;
}

/* How many readings a view has. */
size_t fl_view_count(const fl_view *view)
{
    size_t free = view->rows;
    if (view->rejected)
        for (size_t i = 0; i < view->rows; i++) free -= view->rejected[i] != 0;
    return (free + view->stride - 1) / view->stride;
}
