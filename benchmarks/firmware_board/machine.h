/* Services of the machine for the harnesses: files, a count of instructions and the used stack, on this machine or on a
 * Cortex-M in QEMU. */
#ifndef FIRMWARE_MACHINE_H
#define FIRMWARE_MACHINE_H

#include <stdint.h>
#include <string.h>

int main(void);

#ifdef __arm__
enum { OPEN = 1, CLOSE = 2, WRITE = 5, READ = 6, EXIT = 0x20, EXITED = 0x20026, PER_TICK = 40 };

#define MARK 0xA5A5A5A5

#define SYSTICK ((volatile uint32_t *)0xE000E010) /* 25 MHz of virtual time: forty instructions with -icount shift=0 */

extern uint32_t stack_bottom[], stack_marked[], stack_top[];

/* Call a service of the debugger (QEMU) in place of an operating system. */
static int ask(int what, const void *arguments)
{
    register int r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static inline int open_file(const char *name, int is_writing)
{
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)name, is_writing ? 5 : 1, (uint32_t)strlen(name)};
    return ask(OPEN, arguments);
}

static inline size_t read_file(int file, void *bytes, size_t n)
{
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, (uint32_t)n};
    return n - (size_t)ask(READ, arguments);
}

static inline void add_to_file(int file, const void *bytes, size_t n)
{
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)bytes, (uint32_t)n};
    ask(WRITE, arguments);
}

static inline void close_file(int file)
{
    const uint32_t arguments[1] = {(uint32_t)file};
    ask(CLOSE, arguments);
}

static inline void start_counting(void) { SYSTICK[1] = 0xFFFFFF, SYSTICK[2] = 0, SYSTICK[0] = 5; }

static inline int32_t counted(void) { return (int32_t)((0xFFFFFF - SYSTICK[2]) & 0xFFFFFF) * PER_TICK; }

/* Largest number of bytes of the stack in use since `start` marked it. */
static inline int32_t stack_used(void)
{
    const uint32_t *word = stack_bottom;
    while (*word == MARK) word++;
    return (int32_t)((const char *)stack_top - (const char *)word);
}
#else
#include <stdio.h>

static inline FILE *open_file(const char *name, int is_writing) { return fopen(name, is_writing ? "wb" : "rb"); }

static inline size_t read_file(FILE *file, void *bytes, size_t n) { return fread(bytes, 1, n, file); }

static inline void add_to_file(FILE *file, const void *bytes, size_t n) { fwrite(bytes, 1, n, file); }

static inline void close_file(FILE *file) { fclose(file); }

static inline void start_counting(void) {}

static inline int32_t counted(void) { return -1; }

static inline int32_t stack_used(void) { return -1; }
#endif

#ifdef __arm__
extern uint32_t bss_begin[], bss_end[];

void start(void);
void start(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88 |= 0xF << 20; /* enable the floating-point unit */
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
#endif
