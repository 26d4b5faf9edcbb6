/* flinders_service.h - online calibration, which continues from a good calibration: its uncertainty grows with time,
 * readings reduce it, a moved offset is detected, and its storage survives a power failure at any moment.
 *
 * Add every reading with the board's clock. The uncertainty grows by that clock, and by the time that the board was off.
 * Readings that contradict the calibration increase the stated error at once; a passing disturbance is discarded, and an
 * offset that has moved is estimated again. flinders.h describes the decisions (`flinders_online`), which are the same on
 * every computer.
 *
 *     static union { flinders_board board; flinders_service service; } memory; // one after the other
 *     ... until memory.board.answer.verdict is FLINDERS_NOTE
 *     flinders_service_begin(&memory.service, &memory.board, millis());
 *     for (;;) {
 *         if (flinders_service_add(&memory.service, reading, millis()) & FLINDERS_MOVED) print("the offset has moved");
 *         if (a second has passed) {
 *             flinders_service_answer(&memory.service, millis(), &answer);
 *             print(answer.in_force.heading_worst_deg, answer.good_s);
 *         }
 *     }
 *
 * `flinders_service` holds all memory, the workspace included: with FLINDERS_EVIDENCE 96, the default, 3.8 kB in single
 * precision; the stack needs less than 6 kB. More readings of evidence give a smaller error. A program that does not call
 * these functions is linked without them.
 */
#ifndef FLINDERS_SERVICE_H
#define FLINDERS_SERVICE_H

#include "flinders_board.h"

#ifndef FLINDERS_OFF_S
#define FLINDERS_OFF_S 86400 /* time off that is assumed for a board without a clock */
#endif

typedef struct flinders_service {
    flinders_online online;       /* `is_locked`, `target_deg`, `dip_deg` and an expected walk may be set */

    /* Internal state of the library. */
    uint32_t origin_ms;           /* time of the board's clock at time 0 of `online` */
    uint32_t sequence;            /* number of the last stored record; 0: none */
    flinders_real watched, watched_at; /* `online.watched` at the last count, and its time */
    flinders_real moved_by, moved_at; /* size and time of the last move of the offset, unit and s */
    flinders_real stored[9], stored_deg, stored_at, stored_moves; /* calibration, error, time and moves of the last record */
    flinders_real workspace[(FLINDERS_ONLINE_WORKSPACE + sizeof(flinders_real) - 1) / sizeof(flinders_real)];
} flinders_service;

typedef struct flinders_service_answer {
    flinders_answer in_force;     /* offset, matrix and field in use, their heading error now, and the verdict on that */
    flinders_real good_s;         /* time for which the worst heading error stays within the target without updates: 0 if it is
                                     beyond the target, infinite beyond ten years */
    flinders_real adopted_s;      /* age of the calibration in force */
    flinders_real learnt_s;       /* age of the newest evidence */
    flinders_real moved_s;        /* time since the last move of the offset; NaN: never */
    flinders_real moved_by;       /* size of that move, unit */
    int32_t is_disturbed;         /* 1: readings contradict the calibration now; iron passes by, or the offset has moved */
} flinders_service_answer;

/* A stored record. There are two places, used in turn by `sequence`, so that the newest record is never overwritten. */
typedef struct flinders_stored {
    uint32_t version, sequence;
    uint32_t clock_s;             /* time of a clock that runs while the board is off; 0: none */
    int32_t is_level;
    float in_force[9], latest[9]; /* offset and shape, unit */
    float covariance[45];         /* covariance of `latest`: lower triangle, row by row, unit² */
    float latest_s, moved_s;      /* ages at the time of storing; NaN: never moved */
    float worst_deg;              /* stated worst heading error at that time */
    float target_deg, dip_deg;
    float noise, place, scatter, rates[7], expected_walk, expected_walk_sigma, moves, moves_square, watched, moved[3];
    float height, height_now, height_sigma;
    uint32_t checksum;            /* CRC-32 of all before it */
} flinders_stored;

#ifdef __cplusplus
extern "C" {
#endif

/* Continue from the calibration of a board after a successful solve; FLINDERS_UNDETERMINED if it was refused. `service` may
 * share the memory of `board`. `ms` is the board's clock, here and below: it may wrap to 0 after 2^32, and has to be passed
 * at least every three weeks. */
int flinders_service_begin(flinders_service *service, const flinders_board *board, uint32_t ms);

/* Begin from storage: clear, and restore the record of each place. Restoring returns 1 for a record that is used, that is,
 * complete and newer than the one used before. `clock_s` is the current value of the clock in `flinders_stored`; if one of
 * both is 0, FLINDERS_OFF_S is assumed as time off. */
void flinders_service_clear(flinders_service *service);
int flinders_service_restore(flinders_service *service, const flinders_stored *record, uint32_t clock_s, uint32_t ms);

/* Add a reading; returns bits of events, FLINDERS_CONTRADICTED, PASSED, MOVED, ADOPTED, CLOCK_BACK. Skips a reading that is
 * not finite, or has three equal numbers as without an answer of the sensor. */
int32_t flinders_service_add(flinders_service *service, const flinders_real reading[3], uint32_t ms);

/* Account for seconds in which the board's clock stood still, as in deep sleep. */
void flinders_service_slept(flinders_service *service, flinders_real seconds);

/* Fill an answer with the current state. */
void flinders_service_answer_at(const flinders_service *service, uint32_t ms, flinders_service_answer *answer);

/* Whether to store the calibration in force: if none is stored; ten minutes after the last write if the offset has moved;
 * else an hour after that write, if the stored calibration would be clearly worse, were it restored now. */
int flinders_service_wants_storing(flinders_service *service);

/* Make the next record to store, and its place, 0 or 1. The record counts as stored. */
int flinders_service_store(flinders_service *service, uint32_t clock_s, flinders_stored *record);

#ifdef __cplusplus
}
#endif
#endif
