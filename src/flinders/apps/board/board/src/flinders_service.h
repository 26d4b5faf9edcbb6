/* flinders_service.h - a calibration that goes on when it is good: it ages, learns, finds that something has moved, and is
 * stored where power may fail at any moment.
 *
 * Add every reading with the board's clock. What is known ages by that clock, and by the time that the board was off. Readings
 * that contradict the calibration make the claim larger at once; what passes is forgotten, and an offset that has moved is
 * learnt anew. How it decides is told in flinders.h (`flinders_online`), and is the same on every computer.
 *
 *     static union { flinders_board board; flinders_service service; } memory; // one after the other
 *     ... until memory.board.answer.verdict is FLINDERS_NOTE
 *     flinders_service_begin(&memory.service, &memory.board, millis());
 *     for (;;) {
 *         if (flinders_service_add(&memory.service, reading, millis()) & FLINDERS_MOVED) print("it has moved");
 *         if (a second has passed) {
 *             flinders_service_answer(&memory.service, millis(), &answer);
 *             print(answer.in_force.heading_worst_deg, answer.good_s);
 *         }
 *     }
 *
 * All that it needs is in `flinders_service`, the workspace included: with FLINDERS_EVIDENCE 96, the default, 3.8 kB in single
 * precision; it takes less than 6 kB of stack. More readings of evidence claim less. A program that never calls these functions
 * is linked without them.
 */
#ifndef FLINDERS_SERVICE_H
#define FLINDERS_SERVICE_H

#include "flinders_board.h"

#ifndef FLINDERS_OFF_S
#define FLINDERS_OFF_S 86400 /* that a board without a clock is taken to have been off */
#endif

typedef struct flinders_service {
    flinders_online online;       /* `is_locked`, `target_deg` and `dip_deg` may be set, and a walk be expected */

    /* What follows is the library's. */
    uint32_t origin_ms;           /* of the board's clock, where times of `online` begin */
    uint32_t sequence;            /* of the record that was stored last; 0: none */
    flinders_real watched, watched_at; /* `online.watched`, when it was counted last */
    flinders_real moved_by, moved_at; /* unit, s */
    flinders_real stored[9], stored_deg, stored_at, stored_moves; /* of the record that was stored last */
    flinders_real workspace[(FLINDERS_ONLINE_WORKSPACE + sizeof(flinders_real) - 1) / sizeof(flinders_real)];
} flinders_service;

typedef struct flinders_service_answer {
    flinders_answer in_force;     /* offset, matrix and field in use, their heading error now, and the verdict on that */
    flinders_real good_s;         /* how long the worst heading error stays within the target if nothing is learnt: 0 where it is
                                     beyond it, infinite beyond ten years */
    flinders_real adopted_s;      /* since when it is in force */
    flinders_real learnt_s;       /* how old the newest evidence is */
    flinders_real moved_s;        /* when the offset has moved last, s ago; NaN: never */
    flinders_real moved_by;       /* how far, unit */
    int32_t is_disturbed;         /* 1: readings contradict it now; something passes, or the offset has moved */
} flinders_service_answer;

/* What is stored. A newer record never takes the place of the newest one: there are two places, by `sequence`. */
typedef struct flinders_stored {
    uint32_t version, sequence;
    uint32_t clock_s;             /* of a clock that goes on while the board is off; 0: there is none */
    int32_t is_level;
    float in_force[9], latest[9]; /* offset and shape, unit */
    float covariance[45];         /* of the latest, its lower triangle row by row, unit² */
    float latest_s, moved_s;      /* ages when it was stored; NaN: never moved */
    float worst_deg;              /* claimed then */
    float target_deg, dip_deg;
    float noise, place, scatter, rates[7], expected_walk, expected_walk_sigma, moves, moves_square, watched, moved[3];
    float height, height_now, height_sigma;
    uint32_t checksum;            /* CRC-32 of all before it */
} flinders_stored;

#ifdef __cplusplus
extern "C" {
#endif

/* Go on with the calibration of a board, whose last solve found one; FLINDERS_UNDETERMINED where it was refused. `service` may
 * be in the memory of `board`. `ms` is the board's clock, here and below: it may start again at 0 after 2^32, and is looked at
 * every three weeks at least. */
int flinders_service_begin(flinders_service *service, const flinders_board *board, uint32_t ms);

/* Begin with what was stored: clear, and restore the record of each place. Restoring returns 1 where it is taken: whole, and
 * newer than what was taken before. `clock_s` is that of `flinders_stored`, now; where one of both is 0 the board was off for
 * FLINDERS_OFF_S. */
void flinders_service_clear(flinders_service *service);
int flinders_service_restore(flinders_service *service, const flinders_stored *record, uint32_t clock_s, uint32_t ms);

/* Add a reading; what happened: bits, FLINDERS_CONTRADICTED, PASSED, MOVED, ADOPTED, CLOCK_BACK. One that is not finite, or has
 * three equal numbers as of a sensor that does not answer, is left out. */
int32_t flinders_service_add(flinders_service *service, const flinders_real reading[3], uint32_t ms);

/* Say that the board's clock stood still for some seconds, as in a deep sleep. */
void flinders_service_slept(flinders_service *service, flinders_real seconds);

/* What is known now. */
void flinders_service_answer_at(const flinders_service *service, uint32_t ms, flinders_service_answer *answer);

/* Whether what is in force is worth a write: at the first time; where it has moved, ten minutes after the last write; else an
 * hour after it, where what would be restored now is expected to be clearly worse, as of what is adopted. */
int flinders_service_wants_storing(flinders_service *service);

/* Make the record to be stored next, and the place, 0 or 1, where it goes. It counts as stored. */
int flinders_service_store(flinders_service *service, uint32_t clock_s, flinders_stored *record);

#ifdef __cplusplus
}
#endif
#endif
