/* Runs the board's calibrator over a recording, on this machine or on a Cortex-M in QEMU, and counts instructions there.
 *
 * It reads `readings.bin`: dip, target, whether the unit is microtesla, and x, y, z of each reading. It solves after every
 * 250 readings and at the end, and writes `answer.bin`: the result, the readings of its fit, and the cost.
 */
#include "flinders_board.h"
#include "machine.h"

typedef struct {
    flinders_answer answer;
    int32_t count, state;
    flinders_real field[3 * FLINDERS_BOARD_READINGS];
    int32_t per_reading, per_solve, stack; /* instructions, instructions, bytes; -1 on this machine */
} outcome;

static flinders_board board;
static outcome result;
static flinders_real readings[3 * 250];

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
    const __typeof__(file) answer = open_file("answer.bin", 1);
    add_to_file(answer, &result, sizeof result);
    close_file(answer);
    return 0;
}
