/* Runs the board's calibrator over a recording, on this machine or on a Cortex-M in QEMU, and counts instructions there.
 *
 * It reads `readings.bin`: dip, target, whether the unit is microtesla, and x, y, z of each reading. It solves after every
 * 250 readings and at the end, and writes `answer.bin`: the answer, the readings that it was fitted to, and the cost.
 */
#include <string.h>

#include "flinders_board.h"

typedef struct {
    flinders_answer answer;
    int32_t count, state;
    flinders_real field[3 * FLINDERS_BOARD_READINGS];
    int32_t per_reading, per_solve, stack; /* instructions, instructions, bytes; -1 on this machine */
} outcome;

static flinders_board board;
static outcome result;
static flinders_real readings[3 * 250];

#ifdef __arm__
enum { OPEN = 1, CLOSE = 2, WRITE = 5, READ = 6, EXIT = 0x20, EXITED = 0x20026, PER_TICK = 40 };

#define MARK 0xA5A5A5A5

#define SYSTICK ((volatile uint32_t *)0xE000E010) /* 25 MHz of virtual time: forty instructions with -icount shift=0 */

extern uint32_t stack_bottom[], stack_marked[], stack_top[];

/* Ask the debugger, QEMU, for what an operating system does. */
static int ask(int what, const void *arguments)
{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static int open_file(const char *name, int is_writing)
{
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)name, is_writing ? 5 : 1, (uint32_t)strlen(name)};
    return ask(OPEN, arguments);
}

static size_t read_file(int file, void *bytes, size_t n)
{
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, (uint32_t)n};
    return n - (size_t)ask(READ, arguments);
}

static void write_file(int file, const void *bytes, size_t n)
{
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, (uint32_t)n};
    ask(WRITE, arguments);
    ask(CLOSE, arguments);
}

static void start_counting(void) { SYSTICK[1] = 0xFFFFFF, SYSTICK[2] = 0, SYSTICK[0] = 5; }

static int32_t counted(void) { return (int32_t)((0xFFFFFF - SYSTICK[2]) & 0xFFFFFF) * PER_TICK; }

/* Bytes of the stack that were ever written since `start` marked it. */
static int32_t stack_used(void)
{
    const uint32_t *word = stack_bottom;
    while (*word == MARK) word++;
    return (int32_t)((const char *)stack_top - (const char *)word);
}
#else
#include <stdio.h>

static FILE *open_file(const char *name, int is_writing) { return fopen(name, is_writing ? "wb" : "rb"); }

static size_t read_file(FILE *file, void *bytes, size_t n) { return fread(bytes, 1, n, file); }

static void write_file(FILE *file, const void *bytes, size_t n)
{
    fwrite(bytes, 1, n, file);
    fclose(file);
}

static void start_counting(void) {}

static int32_t counted(void) { return -1; }

static int32_t stack_used(void) { return -1; }
#endif

int main(void)
{
    const __typeof__(open_file("", 0)) file = open_file("readings.bin", 0);
    int64_t instructions = 0, added = 0;
    size_t n;
    flinders_board_begin(&board);
    read_file(file, readings, 3 * sizeof *readings);
    board.dip_deg = readings[0], board.target_deg = readings[1], board.is_microtesla = readings[2] != 0;
    while ((n = read_file(file, readings, sizeof readings) / (3 * sizeof *readings)) > 0) {
        start_counting();
        for (size_t i = 0; i < n; i++) flinders_board_add(&board, readings + 3 * i);
        instructions += counted(), added += (int64_t)n;
        if (n == 250) flinders_board_solve(&board);
    }
    start_counting();
    flinders_board_solve(&board);
    result.per_solve = counted();
    result.per_reading = (int32_t)(instructions / (added ? added : 1));
    result.stack = stack_used();
    result.answer = board.answer, result.count = board.count, result.state = sizeof board;
    memcpy(result.field, board.field, sizeof result.field);
    write_file(open_file("answer.bin", 1), &result, sizeof result);
    return 0;
}

#ifdef __arm__
extern uint32_t bss_begin[], bss_end[];

void start(void);
void start(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* the floating-point unit may be used */
    __asm__ volatile("dsb\n isb");
#endif
    for (uint32_t *word = stack_bottom; word < stack_marked; word++) *word = MARK;
    memset(bss_begin, 0, (size_t)((char *)bss_end - (char *)bss_begin));
    main();
    const uint32_t arguments[2] = {EXITED, 0};
    ask(EXIT, arguments);
}

static const struct {
    uint32_t *stack;
    void (*reset)(void);
} VECTORS __attribute__((section(".vectors"), used)) = {stack_top, start};
#endif
