/* Online calibration on a board: its clock, its answers, and its storage. */
#include "answer.h"
#include "flinders_service.h"
#include "online.h"

enum { VERSION = 1, PERIOD_S = 4096, PERIOD_MS = PERIOD_S * 1000, MOVED_AGAIN_S = 600, BETTER_AGAIN_S = 3600 };

#define MAX_ERROR_RATIO ((real)0.8) /* largest ratio of heading errors, in force to stored, that is worth a write */

/* Seconds of the board's clock since the origin; negative after a step back. */
static real seconds_at(const flinders_service *service, uint32_t ms)
{
    return (real)(int32_t)(ms - service->origin_ms) / 1000;
}

/* Update the observed time, in few steps, since sums of milliseconds lose digits. */
static void count_watched(flinders_service *service)
{
    flinders_online *const online = &service->online;
    if (online->now > service->watched_at) online->watched = service->watched + (online->now - service->watched_at);
    service->watched = online->watched, service->watched_at = online->now;
}

/* Move the origin of times. */
static void shift(flinders_service *service, real seconds)
{
    count_watched(service);
    flinders_online_shift(&service->online, seconds);
    service->watched_at -= seconds, service->moved_at -= seconds, service->stored_at -= seconds;
}

/* Time of a reading, s. The origin moves with it, so that single precision resolves milliseconds. */
static real time_of(flinders_service *service, uint32_t ms)
{
    const int32_t since = (int32_t)(ms - service->origin_ms), periods = since > 0 ? since / PERIOD_MS : 0;
    if (periods) shift(service, (real)periods * PERIOD_S);
    service->origin_ms += (uint32_t)periods * PERIOD_MS;
    return seconds_at(service, ms);
}

/* Reset. */
void flinders_service_clear(flinders_service *service)
{
    memset(service, 0, sizeof *service);
    flinders_online_begin(&service->online);
    service->moved_at = service->moved_by = service->stored[0] = FL_NOT_A_NUMBER;
}

/* Continue from the calibration of a board. */
int flinders_service_begin(flinders_service *service, const flinders_board *board, uint32_t ms)
{
    real parameters[9], covariance[81];
    const real dip = board->dip_deg, target = board->target_deg, noise = board->answer.noise;
    if (board->answer.status != FLINDERS_OK || board->answer.verdict >= FLINDERS_REFUSES) return FLINDERS_UNDETERMINED;
    memcpy(parameters, board->centre, sizeof board->centre);
    fl_sym3_inverse(board->inverse, parameters + 3);
    for (int i = 0, k = 0; i < 9; i++)
        for (int j = 0; j <= i; j++) covariance[9 * i + j] = covariance[9 * j + i] = board->work[k++];
    flinders_service_clear(service);
    service->origin_ms = ms;
    service->online.dip_deg = dip, service->online.target_deg = target;
    service->online.now = 0;
    return flinders_online_know(&service->online, parameters, covariance, noise, 0);
}

/* Whether a sensor has answered. */
static int is_reading(const real x[3])
{
    return isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]) && !(x[0] == x[1] && x[1] == x[2]);
}

/* Add a reading. */
int32_t flinders_service_add(flinders_service *service, const real reading[3], uint32_t ms)
{
    int32_t events;
    if (!is_reading(reading)) return 0;
    const real time = time_of(service, ms), before = service->online.moves_square;
    flinders_online_add(&service->online, reading, &time, 1, service->workspace, sizeof service->workspace, &events);
    if (events & FLINDERS_MOVED)
        service->moved_at = service->online.now, service->moved_by = fl_sqrt(service->online.moves_square - before);
    return events;
}

/* Account for time by another clock. */
void flinders_service_slept(flinders_service *service, real seconds)
{
    if (seconds > 0) shift(service, seconds);
}

/* Fill an answer at a time of the board's clock. */
void flinders_service_answer_at(const flinders_service *service, uint32_t ms, flinders_service_answer *answer)
{
    const flinders_online *const online = &service->online;
    const real time = seconds_at(service, ms);
    real quantities[FLINDERS_QUANTITIES];
    fl_surface surface;
    flinders_online_claim claim;
    memset(answer, 0, sizeof *answer);
    answer->moved_s = time - service->moved_at, answer->moved_by = service->moved_by;
    answer->adopted_s = time - online->adopted_at, answer->learnt_s = time - online->latest_at;
    answer->is_disturbed = online->state == FLINDERS_DISTURBED;
    flinders_answer *const calibration = &answer->in_force;
    calibration->verdict = FLINDERS_REFUSES;
    calibration->status = flinders_online_claim_at(online, time, &claim);
    calibration->heading_rms_deg = claim.rms_deg, calibration->heading_worst_deg = claim.worst_deg;
    if (calibration->status != FLINDERS_OK) return;
    fl_surface_of(online->in_force, online->in_force + 3, &surface);
    fl_answer_of(&surface, online->noise, calibration);
    for (int i = 0; i < FLINDERS_QUANTITIES; i++) quantities[i] = FL_NOT_A_NUMBER;
    quantities[FLINDERS_Q_TARGET_DEG] = online->target_deg;
    quantities[FLINDERS_Q_WORST_DEG] = isnan(claim.worst_deg) ? (real)INFINITY : claim.worst_deg;
    const int severity = flinders_severity(FLINDERS_RULE_HEADING_ERROR, quantities);
    calibration->findings[FLINDERS_RULE_HEADING_ERROR] = (uint8_t)severity;
    calibration->is_checked[FLINDERS_RULE_HEADING_ERROR] = 1;
    calibration->verdict = severity > FLINDERS_NOTE ? severity : FLINDERS_NOTE;
    const real left = flinders_online_good_s(online) - (time - online->now);
    answer->good_s = left > 0 ? left : 0;
}

/* Worst heading error of the stored calibration, if restored now. */
static real restored_deg(const flinders_service *service)
{
    const flinders_online *const online = &service->online;
    const real seconds = online->now - service->stored_at, unseen = fl_unseen_moves(online, seconds);
    real covariance[81] = {0}, rms, worst;
    fl_surface surface;
    if (fl_surface_of(online->in_force, online->in_force + 3, &surface)) return (real)INFINITY;
    fl_age(online, online->latest, seconds, covariance);
    for (int i = 0; i < 3; i++) covariance[10 * i] += unseen;
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++)
            covariance[9 * i + j] += (online->in_force[i] - service->stored[i]) * (online->in_force[j] - service->stored[j]);
    fl_level_errors(&surface, covariance, online->dip_deg, &rms, &worst);
    return fl_sqrt(worst * worst + service->stored_deg * service->stored_deg);
}

/* Whether to store the calibration in force. */
int flinders_service_wants_storing(flinders_service *service)
{
    const flinders_online *const online = &service->online;
    const real seconds = online->now - service->stored_at;
    flinders_online_claim claim;
    if (online->state != FLINDERS_UNDISTURBED || flinders_online_claim_at(online, online->now, &claim)) return 0;
    if (isnan(service->stored[0])) return isfinite(claim.worst_deg);
    if (!(online->adopted_at > service->stored_at)) return 0;
    if (online->moves > service->stored_moves) return seconds >= MOVED_AGAIN_S && isfinite(claim.worst_deg);
    return seconds >= BETTER_AGAIN_S && claim.worst_deg < MAX_ERROR_RATIO * restored_deg(service);
}

/* CRC-32 (IEEE 802.3). */
static uint32_t checksum_of(const flinders_stored *record)
{
    const unsigned char *const bytes = (const unsigned char *)record;
    uint32_t crc = 0xFFFFFFFF;
    for (size_t i = 0; i < offsetof(flinders_stored, checksum); i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0xEDB88320 : crc >> 1;
    }
    return ~crc;
}

/* Note the stored values and their time. */
static void remember(flinders_service *service, real at, real worst_deg)
{
    memcpy(service->stored, service->online.in_force, sizeof service->stored);
    service->stored_at = at, service->stored_deg = worst_deg, service->stored_moves = service->online.moves;
}

/* Make the record to be stored next. */
int flinders_service_store(flinders_service *service, uint32_t clock_s, flinders_stored *record)
{
    const flinders_online *const online = &service->online;
    flinders_online_claim claim;
    count_watched(service);
    flinders_online_claim_at(online, online->now, &claim);
    remember(service, online->now, claim.worst_deg);
    memset(record, 0, sizeof *record);
    record->version = VERSION, record->sequence = ++service->sequence, record->clock_s = clock_s;
    record->worst_deg = (float)claim.worst_deg;
    fl_closed(online, claim.covariance);
    for (int i = 0, k = 0; i < 9; i++) {
        record->in_force[i] = (float)online->in_force[i], record->latest[i] = (float)online->latest[i];
        for (int j = 0; j <= i; j++) record->covariance[k++] = (float)claim.covariance[9 * i + j];
    }
    record->latest_s = (float)(online->now - online->latest_at), record->moved_s = (float)(online->now - online->moved_at);
    record->target_deg = (float)online->target_deg, record->dip_deg = (float)online->dip_deg;
    record->noise = (float)online->noise, record->place = (float)online->place, record->scatter = (float)online->scatter;
    for (int k = 0; k < FL_RATES; k++) record->rates[k] = (float)online->rates[k];
    record->expected_walk = (float)online->expected_walk;
    record->expected_walk_sigma = (float)online->expected_walk_sigma;
    record->moves = (float)online->moves, record->moves_square = (float)online->moves_square;
    record->watched = (float)online->watched;
    for (int i = 0; i < 3; i++) record->moved[i] = (float)online->moved[i];
    record->is_level = online->is_level, record->height = (float)online->height;
    record->height_now = (float)online->height_now, record->height_sigma = (float)online->height_sigma;
    record->checksum = checksum_of(record);
    return (int)(record->sequence & 1);
}

/* Restore the state from the numbers of a record. */
static int take(flinders_service *service, const flinders_stored *record, real off)
{
    flinders_online *const online = &service->online;
    real parameters[9], covariance[81];
    for (int i = 0, k = 0; i < 9; i++) {
        parameters[i] = record->latest[i];
        for (int j = 0; j <= i; j++) covariance[9 * i + j] = covariance[9 * j + i] = record->covariance[k++];
    }
    if (flinders_online_know(online, parameters, covariance, record->noise, -off - (real)record->latest_s)) return 1;
    for (int i = 0; i < 9; i++) online->in_force[i] = record->in_force[i];
    online->now = -off, online->moved_at = -off - (real)record->moved_s;
    online->target_deg = record->target_deg, online->dip_deg = record->dip_deg;
    online->place = record->place, online->scatter = record->scatter;
    flinders_online_expect_walk(online, record->expected_walk, record->expected_walk_sigma); /* if known */
    for (int k = 0; k < FL_RATES; k++) online->rates[k] = record->rates[k];
    online->moves = record->moves, online->moves_square = record->moves_square, online->watched = record->watched;
    for (int i = 0; i < 3; i++) online->moved[i] = record->moved[i];
    online->is_level = record->is_level, online->height = record->height;
    online->height_now = record->height_now, online->height_sigma = record->height_sigma;
    return 0;
}

/* Begin from a record if it is complete and newer than the one before. */
int flinders_service_restore(flinders_service *service, const flinders_stored *record, uint32_t clock_s, uint32_t ms)
{
    if (record->version != VERSION || record->checksum != checksum_of(record)) return 0;
    if (service->sequence && (int32_t)(record->sequence - service->sequence) <= 0) return 0;
    const int has_clock = clock_s && record->clock_s && clock_s >= record->clock_s;
    const real off = (real)(has_clock ? clock_s - record->clock_s : FLINDERS_OFF_S);
    flinders_service_clear(service);
    if (take(service, record, off)) return 0;
    service->origin_ms = ms, service->sequence = record->sequence;
    service->watched = service->online.watched, service->watched_at = service->online.now;
    service->moved_at = service->online.moved_at;
    const real *const moved = service->online.moved;
    service->moved_by = fl_sqrt(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]);
    remember(service, -off, record->worst_deg);
    return 1;
}
