/* Runs a continuous calibration over steps, on this machine or on a Cortex-M in QEMU.
 *
 * It reads `steps.bin`: the contents of the two places in the EEPROM, and steps. It writes `answers.bin`, the results after each
 * step except readings without an event, and `cost.bin`, the cost and the final contents of the EEPROM. With STORED defined it
 * has no calibrator, and begins with the calibration in the EEPROM.
 */
#include "flinders_service.h"
#include "machine.h"

enum { READING = 0, BEGIN = 1, POWER = 2, SLEEP = 3, ASK_NOW = 4 };

typedef struct {
    int32_t what;
    uint32_t ms, clock_s; /* of the board, and of a clock that goes on without power; a sleep is `clock_s` long */
    flinders_real field[3];
} step;

typedef struct {
    int32_t what;
    uint32_t ms;
    int32_t events, stores;
    flinders_service_answer answer;
} row;

static struct {
    int32_t state, stack, per_reading, most; /* bytes, bytes, instructions for a reading, and for the worst one */
    flinders_stored eeprom[2];
} cost __attribute__((section(".eeprom"))); /* not of the RAM */

#ifdef STORED
static struct { flinders_service service; } memory;
#else
static union {
    flinders_board board;
    flinders_service service;
} memory;
#endif
static step next;
static row out;

/* Store the calibration in force. */
__attribute__((noinline)) static void store(void)
{
    flinders_stored record;
    const int place = flinders_service_store(&memory.service, next.clock_s, &record);
    cost.eeprom[place] = record;
    out.stores++;
}

/* Add a reading to the calibrator until its calibration is good, then to the service. */
static void take_reading(int is_on)
{
#ifndef STORED
    if (!is_on) flinders_board_add(&memory.board, next.field);
#endif
    if (!is_on) return;
    out.events = flinders_service_add(&memory.service, next.field, next.ms);
    if (flinders_service_wants_storing(&memory.service)) store();
}

/* Restore the stored calibration. */
static void restore(void)
{
    flinders_service_clear(&memory.service);
    for (int place = 0; place < 2; place++)
        flinders_service_restore(&memory.service, &cost.eeprom[place], next.clock_s, next.ms);
}

int main(void)
{
    const __typeof__(open_file("", 0)) steps = open_file("steps.bin", 0), answers = open_file("answers.bin", 1);
    int64_t instructions = 0, added = 0;
    int is_on = 0;
#ifndef STORED
    flinders_board_begin(&memory.board);
#endif
    read_file(steps, cost.eeprom, sizeof cost.eeprom);
    while (read_file(steps, &next, sizeof next) == sizeof next) {
        out.events = 0;
        start_counting();
        if (next.what == READING) take_reading(is_on);
#ifndef STORED
        if (next.what == BEGIN) is_on = !flinders_board_solve(&memory.board) && !flinders_service_begin(&memory.service, &memory.board, next.ms);
#endif
        if (next.what == POWER) restore(), is_on = 1;
        if (next.what == SLEEP) flinders_service_slept(&memory.service, (flinders_real)next.clock_s);
        if (next.what == READING && is_on) {
            const int32_t taken = counted();
            instructions += taken, added++;
            cost.most = taken > cost.most ? taken : cost.most;
        }
        if (!is_on || (next.what == READING && !out.events)) continue;
        out.what = next.what, out.ms = next.ms;
        flinders_service_answer_at(&memory.service, next.ms, &out.answer);
        add_to_file(answers, &out, sizeof out);
    }
    cost.per_reading = (int32_t)(instructions / (added ? added : 1));
    cost.state = sizeof memory.service, cost.stack = stack_used();
    close_file(answers);
    const __typeof__(answers) costs = open_file("cost.bin", 1);
    add_to_file(costs, &cost, sizeof cost);
    close_file(costs);
    return 0;
}
