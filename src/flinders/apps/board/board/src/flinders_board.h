/* flinders_board.h - calibrates a magnetometer on the board that reads it, with the engine of flinders.h.
 *
 * Add every reading, solve about once a second, and use the answer: the covered share of the sphere, the expected heading
 * error, the findings, the attitude for the next readings, and the offset and matrix so far.
 *
 *     static flinders_board board;
 *     flinders_board_begin(&board);
 *     for (;;) {
 *         flinders_board_add(&board, reading);
 *         if (a second has passed && flinders_board_solve(&board) == FLINDERS_OK)
 *             print(board.answer.heading_worst_deg, flinders_board_turn(&board));
 *     }
 *
 * `flinders_board_apply` corrects a reading. Readings may be in any unit; with `is_microtesla` 0 their length is not
 * compared with the strength of the earth's field.
 *
 * The board stores at most FLINDERS_BOARD_READINGS readings, in order of arrival, spread over directions: a new one
 * replaces one of the fullest cell of the sphere, and readings at rest are replaced by their mean. The fit is that of the
 * library. Its heading error allows for correlated residuals and for few readings. The verdict is that of the library,
 * without rules that need the order or the number of all readings: see `answer.is_checked`.
 */
#ifndef FLINDERS_BOARD_H
#define FLINDERS_BOARD_H

#include "flinders.h"

#ifndef FLINDERS_BOARD_READINGS
#define FLINDERS_BOARD_READINGS 300 /* 40 to 512; 24 bytes each in single precision */
#endif

extern const char *const flinders_poses[FLINDERS_SENSOR_POSES]; /* attitudes of the sensor in words, for use after "hold it" */

typedef struct flinders_answer {
    int32_t status;                     /* FLINDERS_OK, or the reason for no fit, see `flinders_message` */
    int32_t verdict;                    /* the worst of `findings`; FLINDERS_REFUSES without a fit */
    uint8_t findings[FLINDERS_RULES_OF_A_FIT]; /* severity of each finding; `flinders_rule_of` has code and remedy */
    uint8_t is_checked[FLINDERS_RULES_OF_A_FIT]; /* 1 if the board checks the rule */
    flinders_real offset[3];            /* in the unit of the readings */
    flinders_real matrix[9];            /* row by row, determinant 1: corrected = matrix (reading - offset) */
    flinders_real field;                /* length of corrected readings, unit */
    flinders_real noise;                /* standard deviation of the distances from the ellipsoid, unit */
    flinders_real heading_rms_deg;      /* error of a level heading, 1 sigma, over all headings; NaN without a fit */
    flinders_real heading_worst_deg;    /* the same error at the worst heading, 1 sigma */
    flinders_real turn[3];              /* wanted next direction of the field, a unit vector in corrected axes */
    flinders_real after_deg;            /* expected worst heading error after some readings in that direction */
} flinders_answer;

typedef struct flinders_board {
    flinders_real dip_deg;      /* inclination of the field, degrees, -89 to 89 (60) */
    flinders_real target_deg;   /* target of the heading error, degrees (1) */
    int32_t is_microtesla;      /* 1 if readings are in microtesla (1) */
    flinders_answer answer;     /* of the last `flinders_board_solve`; offset, matrix and field of the last successful fit */

    /* Internal state of the library. */
    uint32_t readings;          /* number of readings added, without repeats */
    uint32_t random;
    flinders_real centre[3], inverse[6]; /* centre and inverse shape of the surface by which readings are assigned to cells */
    flinders_real lowest[3], highest[3];
    uint16_t count;             /* number of readings stored */
    uint16_t stored[100];       /* number of readings stored, for each cell */
    uint32_t seen[100];         /* number of readings added, for each cell */
    uint8_t cells[FLINDERS_BOARD_READINGS];
    unsigned char flags[3][FLINDERS_BOARD_READINGS];
    flinders_real field[3 * FLINDERS_BOARD_READINGS];
    flinders_real work[2 * FLINDERS_BOARD_READINGS];
} flinders_board;

#ifdef __cplusplus
extern "C" {
#endif

/* Reset to no readings, with the defaults in parentheses above. */
void flinders_board_begin(flinders_board *board);

/* Add a reading; FLINDERS_NOT_FINITE for an invalid one. Skips a repeated reading, and one of three equal numbers such as
 * 0, 0, 0 or −1, −1, −1, which a bus returns without an answer of the sensor. */
int flinders_board_add(flinders_board *board, const flinders_real reading[3]);

/* Covered share of the sphere, 0 to 1: share of a hundred equal cells with a reading. */
flinders_real flinders_board_seen(const flinders_board *board);

/* Fit the stored readings, and fill `answer`; returns its status. */
int flinders_board_solve(flinders_board *board);

/* Next attitude of the sensor, for use after "hold it": "with its +x side down"; turn it once about the vertical. */
const char *flinders_board_turn(const flinders_board *board);

/* Correct a reading by an answer; both arrays may be the same. */
void flinders_board_apply(const flinders_answer *answer, const flinders_real reading[3], flinders_real corrected[3]);

/* MotionCal's packet of 68 bytes, sent by `flinders send --serial`; a board may store it in EEPROM. */
enum { FLINDERS_PACKET = 68 };

/* Add a byte of a stream to the packet; returns 1 if the packet is complete and its checksum is right. */
int flinders_packet_add(unsigned char packet[FLINDERS_PACKET], unsigned char byte);

/* Write and read offset, matrix and field of an answer. For bytes that are not a packet, reading returns 1 and does not
 * change the answer. */
void flinders_packet_write(const flinders_answer *answer, unsigned char packet[FLINDERS_PACKET]);
int flinders_packet_read(const unsigned char packet[FLINDERS_PACKET], flinders_answer *answer);

#ifdef __cplusplus
}
#endif
#endif
