/* Calibrator with a few kilobytes of memory: stores readings spread over the sphere, and fits them with the engine. */
#include "answer.h"

enum { READINGS = FLINDERS_BOARD_READINGS, CELLS = 100, FEWEST = 12 };

#define MAX_FREEDOM ((real)1.3) /* largest factor for the part of correlated residuals that the parameters absorb */
#define RECOUNT_SHARE ((real)0.1)       /* move of the centre, as a share of the extent, after which cells are counted again */

/* Reset to no readings. */
void flinders_board_begin(flinders_board *board)
{
    memset(board, 0, sizeof *board);
    board->dip_deg = 60, board->target_deg = 1, board->is_microtesla = 1;
    board->answer.status = FLINDERS_TOO_FEW, board->answer.verdict = FLINDERS_REFUSES;
    board->random = 1;
}

/* A random number below a bound (G. Marsaglia, Xorshift RNGs, J. Stat. Softw. 8 (2003)). */
static uint32_t random_below(flinders_board *board, uint32_t bound)
{
    board->random ^= board->random << 13;
    board->random ^= board->random >> 17;
    board->random ^= board->random << 5;
    return (uint32_t)((uint64_t)board->random * bound >> 32);
}

/* Direction of a reading from the centre. */
static void direction_of(const flinders_board *board, const real reading[3], real direction[3])
{
    real local[3];
    for (int axis = 0; axis < 3; axis++) local[axis] = reading[axis] - board->centre[axis];
    fl_sym3_apply(board->inverse, local, direction);
    const real length = fl_sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++) direction[axis] /= length > FL_SHORT ? length : FL_SHORT;
}

/* Cells of the sphere of up to a block of readings. */
static void cells_of(const flinders_board *board, const real *readings, int n, uint8_t *out)
{
    real direction[3], axes[3][FL_BLOCK];
    uint32_t cells[FL_BLOCK];
    for (int i = 0; i < n; i++) {
        direction_of(board, readings + 3 * i, direction);
        for (int axis = 0; axis < 3; axis++) axes[axis][i] = direction[axis];
    }
    fl_kernels_chosen(1)->cells(axes[0], axes[1], axes[2], (size_t)n, cells);
    for (int i = 0; i < n; i++) out[i] = (uint8_t)cells[i];
}

/* Count the readings of each cell again about the present centre. Readings that are not stored are divided among the cells
 * in proportion to the stored ones. */
static void count_cells(flinders_board *board)
{
    const int count = board->count;
    memset(board->stored, 0, sizeof board->stored);
    for (int i = 0; i < count; i += FL_BLOCK)
        cells_of(board, board->field + 3 * i, count - i < FL_BLOCK ? count - i : FL_BLOCK, board->cells + i);
    for (int i = 0; i < count; i++) board->stored[board->cells[i]]++;
    for (int cell = 0; cell < CELLS; cell++)
        board->seen[cell] = (uint32_t)((uint64_t)board->stored[cell] * board->readings / board->count);
}

/* Widen the extent of the readings by one. Before the first fit, the middle of the extent is the centre of directions. */
static void widen(flinders_board *board, const real reading[3])
{
    int has_moved = board->readings == 1;
    for (int axis = 0; axis < 3; axis++) {
        real *const low = board->lowest + axis, *const high = board->highest + axis;
        if (board->readings == 1 || reading[axis] < *low) *low = reading[axis];
        if (board->readings == 1 || reading[axis] > *high) *high = reading[axis];
        has_moved |= fl_abs((*low + *high) / 2 - board->centre[axis]) > RECOUNT_SHARE * (*high - *low);
    }
    if (board->answer.status == FLINDERS_OK || !has_moved) return;
    for (int axis = 0; axis < 3; axis++) board->centre[axis] = (board->lowest[axis] + board->highest[axis]) / 2;
    for (int entry = 0; entry < 6; entry++) board->inverse[entry] = entry < 3;
    if (board->count) count_cells(board);
}

/* Remove the stored reading number `which` of a cell; later readings move up and keep their order. */
static void leave_out(flinders_board *board, uint8_t cell, uint32_t which)
{
    int row = 0;
    for (;; row++)
        if (board->cells[row] == cell && which-- == 0) break;
    board->count--, board->stored[cell]--;
    for (int i = row; i < board->count; i++) board->cells[i] = board->cells[i + 1];
    for (int i = 3 * row; i < 3 * board->count; i++) board->field[i] = board->field[i + 3];
}

/* Make room for a reading of a cell by removing one of the fullest cell. If that is the same cell, each of its readings has
 * the same chance to stay (J. S. Vitter, Random sampling with a reservoir, ACM TOMS 11 (1985)). Returns 1 if the reading is
 * not to be stored. */
static int make_room(flinders_board *board, uint8_t cell)
{
    uint8_t fullest = cell;
    if (board->count < READINGS) return 0;
    for (int other = 0; other < CELLS; other++)
        if (board->stored[other] > board->stored[fullest]) fullest = (uint8_t)other;
    const uint32_t which = random_below(board, fullest == cell ? board->seen[cell] : board->stored[fullest]);
    if (which >= board->stored[fullest]) return 1;
    leave_out(board, fullest, which);
    return 0;
}

/* Add a reading. */
int flinders_board_add(flinders_board *board, const real reading[3])
{
    uint8_t cell;
    const real *const last = board->field + 3 * (board->count ? board->count - 1 : 0);
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(reading[axis])) return FLINDERS_NOT_FINITE;
    if (reading[0] == reading[1] && reading[1] == reading[2]) return FLINDERS_OK;
    if (board->count && !memcmp(last, reading, 3 * sizeof(real))) return FLINDERS_OK;
    board->readings++;
    widen(board, reading);
    cells_of(board, reading, 1, &cell);
    board->seen[cell]++;
    if (make_room(board, cell)) return FLINDERS_OK;
    memcpy(board->field + 3 * board->count, reading, 3 * sizeof(real));
    board->cells[board->count++] = cell;
    board->stored[cell]++;
    return FLINDERS_OK;
}

/* Share of the cells that hold a reading. */
real flinders_board_seen(const flinders_board *board)
{
    int count = 0;
    for (int cell = 0; cell < CELLS; cell++) count += board->seen[cell] > 0;
    return (real)count / CELLS;
}

/* Radius of the largest gap between the directions of readings that are not rejected, degrees. */
FL_APART static real hole_deg(const flinders_board *board, const real centres[CELLS][3], const unsigned char *rejected)
{
    real nearest[CELLS], farthest = 1, direction[3];
    for (int cell = 0; cell < CELLS; cell++) nearest[cell] = -1;
    for (int i = 0; i < board->count; i++) {
        if (rejected && rejected[i]) continue;
        direction_of(board, board->field + 3 * i, direction);
        for (int cell = 0; cell < CELLS; cell++) {
            const real *const c = centres[cell];
            const real cosine = c[0] * direction[0] + c[1] * direction[1] + c[2] * direction[2];
            nearest[cell] = cosine > nearest[cell] ? cosine : nearest[cell];
        }
    }
    for (int cell = 0; cell < CELLS; cell++) farthest = nearest[cell] < farthest ? nearest[cell] : farthest;
    return fl_acos(farthest) * FL_TO_DEG;
}

/* Mean height (z) of the directions, -1 to 1. */
static real upright_of(const flinders_board *board, const real centres[CELLS][3])
{
    real sum = 0;
    for (int cell = 0; cell < CELLS; cell++) sum += (real)board->seen[cell] * centres[cell][2] / (real)board->readings;
    return sum;
}

/* Number of readings with the information of one independent reading, from the autocovariance of the residuals. */
FL_APART static real correlation_time(flinders_board *board, const fl_view *view, const fl_surface *surface)
{
    real autocovariance[FL_LAGS];
    size_t begins[2] = {0, fl_view_count(view)};
    fl_residuals residuals = {.n = begins[1], .stretches = 1, .begins = begins, .distances = board->work};
    fl_kernels_chosen(1)->distances(view, surface, board->work);
    return fl_time_of(autocovariance, fl_autocovariance(&residuals, autocovariance));
}

/* Factor on a covariance for residuals with a correlation time, in readings. It also restores the part of correlated residuals
 * that the nine parameters absorb. */
static real widening(real used, real time)
{
    const real independent = used / time, fewer = independent / (independent - 9 > 1 ? independent - 9 : 1);
    return time > 1 ? time * (fewer < MAX_FREEDOM ? fewer : MAX_FREEDOM) : 1;
}

/* Goal of the advice: the heading of a level vehicle. */
static flinders_goal goal_of(const flinders_board *board, real dip_deg)
{
    flinders_goal goal;
    flinders_default_goal(&goal);
    goal.dip_deg = dip_deg, goal.target_deg = board->target_deg;
    return goal;
}

/* Store the direction of the most useful next readings in the answer. Their weight is reduced as for correlated readings. */
FL_APART static void advise(flinders_board *board, const flinders_record *record, real variance)
{
    const flinders_goal goal = goal_of(board, record->dip_deg);
    flinders_belief belief = {.variance = variance, .readings = (real)record->used};
    flinders_advice advice;
    memcpy(belief.shape, record->shape, sizeof belief.shape);
    memcpy(belief.covariance, record->covariance, sizeof belief.covariance);
    if (flinders_guidance(&belief, &goal, 0, &advice)) return;
    memcpy(board->answer.turn, advice.direction, sizeof board->answer.turn);
    board->answer.after_deg = advice.after_deg;
}

/* Put a calibration into an answer. */
void fl_answer_of(const fl_surface *surface, real noise, flinders_answer *answer)
{
    static const unsigned char ENTRY[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};
    memcpy(answer->offset, surface->centre, sizeof answer->offset);
    for (int i = 0; i < 9; i++) answer->matrix[i] = surface->inverse[ENTRY[i]] * surface->radius;
    answer->field = surface->radius, answer->noise = noise;
}

/* Put the calibration of a record into the answer. */
static void place(flinders_board *board, const flinders_record *record, const fl_surface *surface)
{
    fl_answer_of(surface, record->noise, &board->answer);
    memcpy(board->centre, surface->centre, sizeof board->centre);
    memcpy(board->inverse, surface->inverse, sizeof board->inverse);
}

/* Widen the covariance of a record for correlated residuals, and fill in fields that the engine leaves without its
 * statistics; quantities unknown on a board are marked as unknown. */
FL_APART static void complete(flinders_board *board, const fl_view *view, const fl_surface *surface, const real centres[CELLS][3],
                    flinders_record *record)
{
    const real time = correlation_time(board, view, surface), wider = widening((real)record->used, time);
    for (int i = 0; i < 81; i++) record->covariance[i] = wider * record->textbook[i];
    record->correlation_time = time, record->excess_variance = 1;
    record->fitted_distinct = record->fitted; /* repeated readings are not stored */
    record->at_rest = record->rails = -1;
    record->step = FL_NOT_A_NUMBER;
    record->coverage = flinders_board_seen(board);
    record->upright = upright_of(board, centres);
    record->hole_deg = hole_deg(board, centres, view->rejected);
    record->dip_deg = board->dip_deg;
}

/* Compute the verdict of a fit. */
FL_APART static void judge(flinders_board *board, flinders_record *record)
{
    flinders_answer *const answer = &board->answer;
    flinders_request request;
    flinders_judgement judgement;
    flinders_default_request(&request);
    request.target_deg = board->target_deg, request.is_microtesla = board->is_microtesla, request.shrinks = 0;
    answer->status = flinders_judge(record, &request, &judgement);
    if (answer->status != FLINDERS_OK) return;
    answer->heading_rms_deg = judgement.rms_deg, answer->heading_worst_deg = judgement.worst_deg;
    answer->verdict = judgement.verdict > FLINDERS_NOTE ? judgement.verdict : FLINDERS_NOTE;
    memcpy(answer->findings, judgement.severities, sizeof answer->findings);
    for (int i = 0, k = 0; i < 9; i++) /* for online calibration, see flinders_service_begin */
        for (int j = 0; j <= i; j++) board->work[k++] = judgement.covariance[9 * i + j];
    for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++)
        answer->is_checked[i] = (uint8_t)flinders_is_checked(i, judgement.quantities);
}

/* Widen the covariance of a fit, and compute its verdict; returns the variance of a further reading. */
FL_APART static real describe(flinders_board *board, const fl_view *view, const fl_surface *surface, flinders_record *record)
{
    real centres[CELLS][3];
    place(board, record, surface);
    count_cells(board);
    fl_sphere_centres(centres);
    complete(board, view, surface, (const real(*)[3])centres, record);
    judge(board, record);
    return record->noise * record->noise * record->covariance[0] / record->textbook[0];
}

/* Replace each rest by its mean. No reading is left out, since means of earlier rests look like readings of a turn. */
static void leave_rests(flinders_board *board)
{
    const fl_fitted in_place = {board->field, NULL, NULL, NULL};
    fl_rests rests;
    fl_rests_begin(board->field, board->count, NULL, 0, board->work, board->flags[0], &rests);
    rests.are_left_out = 0;
    const uint16_t left = (uint16_t)fl_rests_fitted(&rests, &in_place);
    if (left == board->count) return;
    board->count = left;
    count_cells(board);
}

/* Fit the readings and compute the verdict. */
int flinders_board_solve(flinders_board *board)
{
    leave_rests(board);
    fl_view view = {board->field, board->count, NULL, 1};
    fl_room room = {.order = (uint32_t *)(void *)board->work, .scratch = board->work, .distances = board->work + READINGS,
                    .rejected = board->flags[0], .far = board->flags[1], .passed = board->flags[2]};
    flinders_options options;
    flinders_record record;
    fl_fit fit;
    flinders_default_options(&options);
    options.statistics = 0, options.kernels = 1, options.dip_deg = board->dip_deg;
    board->answer.verdict = FLINDERS_REFUSES;
    board->answer.heading_rms_deg = board->answer.heading_worst_deg = FL_NOT_A_NUMBER;
    memset(board->answer.findings, 0, sizeof board->answer.findings);
    memset(board->answer.is_checked, 0, sizeof board->answer.is_checked);
    board->answer.status = board->count < FEWEST ? FLINDERS_TOO_FEW
                           : fl_fit_view(fl_kernels_chosen(1), &view, &options, &room, &fit, &record);
    if (board->answer.status == FLINDERS_OK) advise(board, &record, describe(board, &view, &fit.surface, &record));
    return board->answer.status;
}

/* Simplest attitude with the field near the advised direction. */
const char *flinders_board_turn(const flinders_board *board)
{
    const flinders_goal goal = goal_of(board, board->dip_deg);
    return flinders_poses[flinders_pose_towards(FLINDERS_SENSOR, &goal, board->answer.turn)];
}

/* Correct a reading. */
void flinders_board_apply(const flinders_answer *answer, const real reading[3], real corrected[3])
{
    real local[3];
    for (int axis = 0; axis < 3; axis++) local[axis] = reading[axis] - answer->offset[axis];
    fl_multiply(answer->matrix, local, 3, 3, 1, corrected);
}
