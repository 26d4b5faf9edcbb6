/* Online calibration: processing of each reading.
 *
 * Evidence is a series of means of readings in one direction. The offset from each group of readings is first compared with the
 * calibration. If they disagree, the difference is added to the claim at once. If later groups agree with the calibration, the
 * disturbance was temporary, and the evidence is discarded; if they agree with each other, the offset has changed. A jump of the
 * offset between two readings is followed at once, and for a body at rest the length of its reading is tested. Benchmark:
 * `python -m benchmarks.service`.
 */
#include "online.h"

enum { MIN_BLOCK_READINGS = 48, READINGS_PER_STEP = 32, GROUP_READINGS = 16, LARGE_GROUP_READINGS = 64, MIN_AGREEING_GROUPS = 2, MAX_CONTRADICTING_GROUPS = 24, MAX_SUSPECT_GROUPS = 3,
       HALVINGS = 40, MIN_COMPARED_READINGS = 8 };

#define MIN_TURN_RAD ((real)0.06)        /* rad: smallest angle between different directions */
#define MAX_AVERAGE_S ((real)2)  /* s: longest average of readings in one direction */
#define GAP_S ((real)120)          /* s without readings or turns that end a block */
#define BLOCK_S ((real)1200)       /* s: longest block */
#define MIN_DENSITY_RATIO ((real)1.37)        /* ratio of reading rates from which only the denser part is thinned */
#define MIN_FULL_BLOCK_S ((real)120)         /* s: shortest block on a board, whose evidence has few readings */
#define GROUP_TURN_DEG ((real)25)  /* smallest turn from its mean of a group that is compared */
#define CHANGE_SIGMA_RATIO ((real)2)           /* ratio of 1 sigma of the change in unobserved directions to the observed change */
#define OPEN_OFFSET_SIGMA ((real)0.3)       /* of the radius: 1 sigma of an unknown offset */
#define PRIOR_PLACE_SIGMA ((real)0.02)         /* prior variation of the field's strength between places, 1 sigma, a fraction */
#define MIN_PLACE_SIGMA ((real)0.003)  /* smallest value of that variation */
#define MAX_CONTRADICTION_P ((real)1e-6)   /* p-value below which a group contradicts the calibration */
#define MIN_AGREEMENT_P ((real)0.01)        /* p-value above which a group agrees */
#define MIN_CONTRADICTION_SHARE ((real)0.004)        /* of the radius: smallest contradiction */
#define MIN_AGREEMENT_S ((real)30)         /* s for which groups must agree on another offset before it is accepted */
#define MAX_ADOPTED_CLAIM_RATIO ((real)0.8)         /* ratio to the claim in use below which a calibration is adopted */
#define MAX_FIRST_CLAIM_RATIO ((real)3)           /* largest claim of a first calibration, over the target */
#define PRIOR_SCATTER ((real)4)          /* prior ratio of the variance of groups to the claimed one */
#define MAX_SCATTER ((real)9)
#define MIN_SCATTER ((real)0.2)  /* below 1, as autocorrelated noise is assumed for few readings */
#define PASSED_SCATTER_FACTOR ((real)1.5)         /* factor for the scatter after a temporary disturbance */
#define AVERAGED_GROUPS ((real)16)          /* number of groups in the average of the scatter */
#define MAX_GROUP_WEIGHT ((real)4)              /* largest weight of one group, over the average */
#define LEVEL_S ((real)60)         /* s: shortest recording for a first calibration of a level vehicle */
#define MAX_CONTRADICTION_S ((real)600)   /* s after which contradicting readings are used in any case */
#define MAX_SUSPECT_P ((real)1e-3)       /* p-value of each of three successive groups that are a contradiction together */
#define PLACE_VARIANCE_SHARE ((real)0.4)           /* fraction of a block's variance that depends on the place, and is not averaged out */
#define TURN_VARIANCE_SHARE ((real)0.3)      /* the same fraction for a turn of a level vehicle, which returns to the place */
#define CHANGE_PROBABILITY ((real)0.3)         /* probability of a permanent change after a contradiction; the 95 % bound includes both cases */
#define REVERSAL_PROBABILITY ((real)0.3)           /* initial probability that a change is reversed */
#define REVERSAL_TIME_S ((real)900)         /* s: time constant of the decay of that probability */
#define MIN_JUMP_RATIO ((real)6)             /* smallest jump, over the usual step between readings */
#define MAX_JUMP_SPAN_S ((real)1)        /* s: longest duration of the four newest readings for a test for a jump */
#define MAX_INTERVAL_RATIO ((real)2)          /* largest interval at a jump, over the neighbouring intervals */
#define MAX_CALM_RATIO ((real)0.3)           /* largest difference of two readings before or after a jump, over the jump */
#define AVERAGED_STEPS ((real)64)           /* number of steps in the average of their mean square */
#define MIN_DISTURBED_SIGMAS ((real)6)        /* error of the strength in one reading that is disturbed, in standard deviations */
#define MAX_UNDISTURBED_SIGMAS ((real)3)       /* the same for one that is undisturbed again */
#define MAX_HEIGHT_SIGMAS ((real)2.5)         /* largest deviation of z of a level vehicle, in standard deviations */
#define AVERAGED_HEIGHTS ((real)128)        /* number of readings in the average of this height */
#define MAX_PREDICTION_S ((real)(10 * 365.25 * 86400)) /* s: longest prediction of a claim */
#define HEADING_TILT_SHARE ((real)0.8)           /* fraction of a level vehicle's tilt that depends on heading, like an offset */

/* Size of the record in bytes. */
size_t flinders_online_size(void) { return sizeof(flinders_online); }

/* Discard evidence before a reading. */
static void drop_before(flinders_online *online, int first)
{
    const size_t left = (size_t)(online->kept - first);
    memmove(online->field, online->field + 3 * first, 3 * left * sizeof(real));
    memmove(online->time, online->time + first, left * sizeof(real));
    online->kept -= first;
    online->tested = online->tested > first ? online->tested - first : 0;
    online->doubtful = online->doubtful < 0 ? -1 : online->doubtful > first ? online->doubtful - first : 0;
}

#ifdef FLINDERS_SMALL
/* Discard every second reading of those that were compared, or of their newer half if that is denser in time, so that few
 * readings cover a long time. */
static void thin(flinders_online *online)
{
    const real *const time = online->time;
    const int compared = online->tested, half = compared / 2, count = online->kept;
    const real older = (time[half] - time[0]) / (real)half, newer = (time[compared - 1] - time[half]) / (real)(compared - 1 - half);
    const int from = older > MIN_DENSITY_RATIO * newer ? half : 0;
    online->kept = from;
    for (int row = from; row < count; row++) {
        if (row < compared && (row - from) % 2) continue;
        memmove(online->field + 3 * online->kept, online->field + 3 * row, 3 * sizeof(real));
        online->time[online->kept++] = time[row];
    }
    online->tested = from + (compared - from + 1) / 2;
    if (online->doubtful >= compared) online->doubtful -= compared - online->tested;
    else if (online->doubtful > from) online->doubtful = from + (online->doubtful - from + 1) / 2;
}
#endif

/* Knowledge after the end of a block. */
FL_APART void fl_closed(const flinders_online *online, real covariance[81])
{
    real prior[81];
    memcpy(prior, online->known_covariance, sizeof prior);
    memcpy(covariance, online->latest_covariance, sizeof prior);
    fl_age(online, online->known, online->latest_at - online->known_at, prior);
    if (online->latest_at > online->known_at) fl_keep_open(prior, PLACE_VARIANCE_SHARE, covariance);
}

/* End a block: keep its latest calibration, and discard its evidence. */
FL_APART static void close_block(flinders_online *online, const fl_lent *memory)
{
    real offset[3], covariance[9], d[3];
    const real seconds = online->latest_at - online->known_at;
    if (!online->kept || !(online->latest_at > online->known_at)) {
        drop_before(online, online->kept);
        return;
    }
    if (!fl_offset_alone(online, 0, online->known, OPEN_OFFSET_SIGMA * fl_mean_radius(online->known), memory, offset, covariance)) {
        for (int i = 0; i < 3; i++) d[i] = offset[i] - online->known[i];
        for (int i = 0; i < 9; i++) covariance[i] += online->known_covariance[9 * (i / 3) + i % 3];
        fl_weigh_rates(online, d, covariance, seconds);
    }
    fl_closed(online, online->known_covariance);
    memcpy(online->known, online->latest, sizeof online->known);
    memcpy(online->latest_covariance, online->known_covariance, sizeof online->known_covariance);
    online->known_at = online->latest_at;
    drop_before(online, online->kept);
}

/* Use the latest calibration. */
void flinders_online_adopt(flinders_online *online)
{
    if (online->state == FLINDERS_LEARNING) return;
    memcpy(online->replaced, online->in_force, sizeof online->replaced);
    memcpy(online->in_force, online->latest, sizeof online->in_force);
    online->adopted_at = online->now;
}

/* Use the previous calibration again. */
void flinders_online_take_back(flinders_online *online)
{
    real current[9];
    if (isnan(online->replaced[3])) return;
    memcpy(current, online->in_force, sizeof current);
    memcpy(online->in_force, online->replaced, sizeof online->in_force);
    memcpy(online->replaced, current, sizeof online->replaced);
    online->adopted_at = online->now;
}

/* Adopt the latest calibration if it is clearly better than that in use. */
static int32_t adopt_better(flinders_online *online)
{
    flinders_online_claim claim;
    if (online->is_locked || online->state != FLINDERS_UNDISTURBED) return 0;
    if (flinders_online_claim_at(online, online->now, &claim)) return 0;
    if (!(claim.latest_deg < MAX_ADOPTED_CLAIM_RATIO * claim.worst_deg)) return 0;
    flinders_online_adopt(online);
    return FLINDERS_ADOPTED;
}

/* Reset contradictions. */
static void clear_doubt(flinders_online *online)
{
    online->doubtful = -1;
    online->agreeing = online->alike = online->is_lone = online->groups = online->suspects = 0;
    for (int i = 0; i < 3; i++) online->apart[i] = 0;
    memset(online->apart_covariance, 0, sizeof online->apart_covariance);
}

/* Accept a changed offset: that from contradicting evidence, with the same shape. */
static int32_t move(flinders_online *online, const real offset[3], const real covariance[9])
{
    for (int i = 0; i < 3; i++) online->moved[i] = online->apart[i];
    online->moved_at = online->now;
    memcpy(online->latest, offset, 3 * sizeof *offset);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < FL_PARAMETERS; j++)
            online->latest_covariance[9 * i + j] = online->latest_covariance[9 * j + i] = j < 3 ? covariance[3 * i + j] : 0;
    fl_count_move(online, online->apart[0] * online->apart[0] + online->apart[1] * online->apart[1] +
                           online->apart[2] * online->apart[2]);
    online->latest_at = online->known_at = online->time[online->kept - 1];
    memcpy(online->known, online->latest, sizeof online->known);
    memcpy(online->known_covariance, online->latest_covariance, sizeof online->known_covariance);
    clear_doubt(online);
    drop_before(online, online->kept);
    online->state = FLINDERS_UNDISTURBED;
    return FLINDERS_MOVED | adopt_better(online);
}

/* Change of the offset by evidence from a reading on, and its covariance. In unobserved directions, 1 sigma is about the change
 * in the others. */
static void part(flinders_online *online, int first, const fl_lent *memory, real offset[3], real covariance[9])
{
    real d[3];
    for (int i = 0; i < 3; i++) d[i] = offset[i] - online->latest[i];
    const real size = fl_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    fl_offset_alone(online, (size_t)first, online->latest, CHANGE_SIGMA_RATIO * size, memory, offset, covariance);
    for (int i = 0; i < 3; i++) online->apart[i] = offset[i] - online->latest[i];
    memcpy(online->apart_covariance, covariance, 9 * sizeof *covariance);
}

/* Whether the change of the offset is observed in all directions. */
static int is_determined(const flinders_online *online)
{
    real size = 0, unknown = 0;
    for (int i = 0; i < 3; i++) size += online->apart[i] * online->apart[i], unknown += online->apart_covariance[4 * i];
    return unknown * online->scatter < size / 2;
}

/* A reading of the evidence, corrected by a surface; returns its length, 1 in the field that it was calibrated in. */
static real corrected(const flinders_online *online, const fl_surface *surface, int row, real u[3])
{
    real off[3];
    for (int axis = 0; axis < 3; axis++) off[axis] = online->field[3 * row + axis] - surface->centre[axis];
    fl_sym3_apply(surface->inverse, off, u);
    return fl_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
}

/* Difference of the field's strength in readings from one on: their mean length; and the mean of their directions. */
static real length_off(const flinders_online *online, int first, real direction[3])
{
    fl_surface surface;
    real sum = 0;
    for (int axis = 0; axis < 3; axis++) direction[axis] = 0;
    if (fl_surface_of(online->latest, online->latest + 3, &surface)) return 0;
    for (int row = first; row < online->kept; row++) {
        real u[3];
        const real length = corrected(online, &surface, row, u);
        for (int axis = 0; axis < 3; axis++) direction[axis] += u[axis] / length / (real)(online->kept - first);
        sum += length - 1;
    }
    return sum / (real)(online->kept - first);
}

/* Variance of the lengths of readings from one on, corrected with an offset. */
static real length_variance(const flinders_online *online, int first, const real offset[3])
{
    fl_surface surface;
    real mean = 0, square = 0;
    const real n = (real)(online->kept - first);
    if (fl_surface_of(offset, online->latest + 3, &surface)) return 0;
    for (int row = first; row < online->kept; row++) {
        real u[3];
        const real off = corrected(online, &surface, row, u) - 1;
        mean += off / n, square += off * off / n;
    }
    return square - mean * mean;
}

/* p-value of the lengths of readings from one on, with another offset over the known one. A short arc lies on two
 * spheres: if it also lies on the known one, the other is no evidence. */
static real chance_of_lengths(const flinders_online *online, int first, const real offset[3], real scatter)
{
    const real noise = online->noise / fl_mean_radius(online->latest), about = length_variance(online, first, offset);
    const real usual = noise * noise + online->place * online->place, left = about > usual ? about : usual;
    const real gain = (real)(online->kept - first) * (length_variance(online, first, online->latest) - about) / left;
    return gain > 0 ? fl_chance_of(gain / scatter, 3, 0) : 1;
}

/* Test the newest reading alone, for a body that lies still: if its length is far off, there is a disturbance or the
 * offset has moved; if that of the next is not, the disturbance has passed. */
static int32_t look_at_one(flinders_online *online, int is_still)
{
    real u[3];
    const real radius = fl_mean_radius(online->latest), off = length_off(online, online->kept - 1, u), size = fl_abs(off);
    const real usual = fl_sqrt(online->place * online->place + online->noise * online->noise / (radius * radius));
    if (!is_still) return 0;
    if (online->is_lone && size < MAX_UNDISTURBED_SIGMAS * usual) {
        clear_doubt(online);
        drop_before(online, online->kept);
        online->state = FLINDERS_UNDISTURBED;
        return FLINDERS_PASSED;
    }
    if (online->state != FLINDERS_UNDISTURBED || !(size > MIN_DISTURBED_SIGMAS * usual && size > 2 * MIN_CONTRADICTION_SHARE)) return 0;
    online->state = FLINDERS_DISTURBED, online->disturbed_at = online->now, online->is_lone = 1, online->doubtful = online->kept - 1;
    for (int i = 0; i < 3; i++) online->apart[i] = off * radius * u[i];
    for (int i = 0; i < 3; i++) online->apart_covariance[4 * i] = off * off * radius * radius;
    return FLINDERS_CONTRADICTED;
}

/* Update an average over groups. */
static void follow(real *average, real square, real least)
{
    const real most = MAX_GROUP_WEIGHT * *average;
    *average += ((square < most ? square : most) - *average) / AVERAGED_GROUPS;
    *average = *average > least ? *average : least;
}

/* End a temporary disturbance: discard its evidence, and that of its block. */
static int32_t pass(flinders_online *online)
{
    online->scatter = online->scatter * PASSED_SCATTER_FACTOR < MAX_SCATTER ? online->scatter * PASSED_SCATTER_FACTOR : MAX_SCATTER;
    clear_doubt(online);
    drop_before(online, online->kept);
    online->state = FLINDERS_UNDISTURBED;
    return FLINDERS_PASSED;
}

/* After many groups that agree neither with the calibration nor with each other, widen the contradicted parameters
 * by the differences, and use the groups. */
static int32_t give_in(flinders_online *online)
{
    if (++online->groups < MAX_CONTRADICTING_GROUPS || online->now - online->disturbed_at < MAX_CONTRADICTION_S) return 0;
    for (int i = 0; i < 9; i++) {
        const int at = 9 * (i / 3) + i % 3;
        const real unknown = online->apart[i / 3] * online->apart[i % 3] + online->apart_covariance[i];
        online->known_covariance[at] += unknown, online->latest_covariance[at] += unknown;
    }
    return pass(online);
}

/* Use a group of a level vehicle: the offset that it shows alone, at its own place. Readings between turns are not
 * used, as the field varies along the way. */
static void learn_of_turn(flinders_online *online, const real d[3], const real alone[9])
{
    const real scatter = online->scatter > 1 ? online->scatter : 1, now = online->time[online->kept - 1];
    real *const known = online->latest_covariance;
    real sum[4], inverse[4], gain[4], before[4];
    fl_weigh_rates(online, d, alone, now - online->known_at);
    fl_age(online, online->latest, now - online->latest_at, known);
    for (int i = 0; i < 4; i++) before[i] = known[9 * (i / 2) + i % 2], sum[i] = before[i] + scatter * alone[3 * (i / 2) + i % 2];
    const real det = sum[0] * sum[3] - sum[1] * sum[2];
    inverse[0] = sum[3] / det, inverse[3] = sum[0] / det, inverse[1] = -sum[1] / det, inverse[2] = -sum[2] / det;
    fl_multiply(before, inverse, 2, 2, 2, gain);
    for (int i = 0; i < 2; i++) {
        online->latest[i] += gain[2 * i] * d[0] + gain[2 * i + 1] * d[1];
        for (int j = 0; j < 2; j++) {
            const real less = gain[2 * i] * before[j] + gain[2 * i + 1] * before[2 + j];
            known[9 * i + j] = before[2 * i + j] - less + TURN_VARIANCE_SHARE * gain[3 * i] * scatter * (i == j ? alone[4 * i] : 0);
        }
    }
    online->latest_at = online->known_at = now;
    memcpy(online->known, online->latest, sizeof online->known);
    memcpy(online->known_covariance, known, sizeof online->known_covariance);
}

/* Update the statistics with a group. An improbable group is included only if the next one is not improbable. */
static void get_used_to(flinders_online *online, int first, real ratio)
{
    real u[3], variance = online->place * online->place;
    const real off = length_off(online, first, u);
    if (online->suspects) {
        online->suspect_ratio = ratio;
        return;
    }
    if (online->suspect_ratio > 0) follow(&online->scatter, online->suspect_ratio, MIN_SCATTER);
    online->suspect_ratio = 0;
    follow(&online->scatter, ratio, MIN_SCATTER);
    follow(&variance, off * off, MIN_PLACE_SIGMA * MIN_PLACE_SIGMA);
    online->place = fl_sqrt(variance);
}

/* Offset from a group of readings alone, and its difference from the calibration. */
typedef struct {
    int first;                     /* of its readings */
    real offset[3], covariance[9]; /* of these alone */
    real d[3], size;               /* from what is known */
    real known[9];                 /* covariance of that */
    real ratio;                    /* of the square of d over what both claim, for each axis */
    real chance;                   /* how often chance makes as much, of groups that scatter as they do */
} shown;

/* Process a group without a contradiction before: it is one, or updates the statistics. */
static int32_t compare_undisturbed(flinders_online *online, shown *group, const fl_lent *memory)
{
    const int is_large = group->size > MIN_CONTRADICTION_SHARE * fl_mean_radius(online->latest);
    online->suspects = group->chance < MAX_SUSPECT_P && is_large ? online->suspects + 1 : 0;
    if (!(group->chance < MAX_CONTRADICTION_P && is_large) && online->suspects < MAX_SUSPECT_GROUPS) {
        get_used_to(online, group->first, group->ratio);
        if (online->is_level) learn_of_turn(online, group->d, group->covariance);
        return 0;
    }
    online->state = FLINDERS_DISTURBED, online->disturbed_at = online->now, online->doubtful = group->first;
    part(online, group->first, memory, group->offset, group->covariance);
    return FLINDERS_CONTRADICTED;
}

/* Process a group after a contradiction: it agrees with the calibration, with the previous groups, or with neither. */
static int32_t compare_disturbed(flinders_online *online, shown *group, const fl_lent *memory)
{
    const real scatter = online->scatter > 1 ? online->scatter : 1;
    real other[3];
    for (int i = 0; i < 3; i++) other[i] = group->d[i] - online->apart[i];
    const int is_told = fl_chance_of_offsets(online->apart, online->apart_covariance, group->known, scatter, NULL) < MIN_AGREEMENT_P;
    const int agrees = fl_chance_of_offsets(group->d, group->covariance, group->known, scatter, NULL) > MIN_AGREEMENT_P &&
                       chance_of_lengths(online, group->first, group->offset, scatter) > MIN_AGREEMENT_P;
    const int is_alike = fl_chance_of_offsets(other, group->covariance, online->apart_covariance, scatter, NULL) > MIN_AGREEMENT_P;
    online->is_lone = 0;
    if (is_told && agrees && is_alike) return give_in(online); /* it tells nothing */
    const int is_restarted = !is_alike && !online->alike; /* what there was before is another offset again */
    online->agreeing = agrees ? online->agreeing + 1 : 0, online->alike = is_alike ? online->alike + 1 : 0;
    if (agrees) follow(&online->scatter, group->ratio, MIN_SCATTER);
    if (online->agreeing == MIN_AGREEING_GROUPS) return pass(online);
    if (agrees) return give_in(online);
    if (is_restarted) online->doubtful = group->first;
    part(online, online->doubtful, memory, group->offset, group->covariance);
    const int has_lasted = online->time[online->kept - 1] - online->time[online->doubtful] >= MIN_AGREEMENT_S;
    if (online->alike < MIN_AGREEING_GROUPS || !has_lasted || !is_determined(online)) return give_in(online);
    return move(online, group->offset, group->covariance);
}

/* Compare readings from one on with the calibration. */
static int32_t compare(flinders_online *online, int first, const fl_lent *memory)
{
    const real anywhere = OPEN_OFFSET_SIGMA * fl_mean_radius(online->latest);
    shown group = {.first = first};
    if (fl_offset_alone(online, (size_t)first, online->latest, anywhere, memory, group.offset, group.covariance)) return 0;
    fl_offset_covariance(online, online->time[online->kept - 1], group.known);
    for (int i = 0; i < 3; i++) group.d[i] = group.offset[i] - online->latest[i];
    group.size = fl_sqrt(group.d[0] * group.d[0] + group.d[1] * group.d[1] + group.d[2] * group.d[2]);
    group.chance = fl_chance_of_offsets(group.d, group.covariance, group.known, online->scatter, &group.ratio);
    if (group.size > 2 * anywhere) return 0; /* a short arc lies on more circles than one */
    if (group.chance < MAX_SUSPECT_P) {
        const real by_lengths = chance_of_lengths(online, first, group.offset, online->scatter > 1 ? online->scatter : 1);
        if (by_lengths > MAX_SUSPECT_P) return 0;
        group.chance = by_lengths > group.chance ? by_lengths : group.chance;
    }
    return online->state == FLINDERS_UNDISTURBED ? compare_undisturbed(online, &group, memory)
                                                 : compare_disturbed(online, &group, memory);
}

/* Compare the readings that were not compared yet, where they are enough, and learn of them. */
static int32_t look(flinders_online *online, const fl_lent *memory)
{
    const int first = online->tested, count = online->kept - first;
    if (count < GROUP_READINGS) return 0;
    const int is_turned = flinders_turn_deg(online->field + 3 * first, (size_t)count, online->latest + 3) > GROUP_TURN_DEG;
    if (count < LARGE_GROUP_READINGS && !is_turned) return 0;
    if (online->is_level && !is_turned) { /* straight on: heel and slope look like an offset */
        online->kept = first;
        return 0;
    }
    const int32_t events = compare(online, first, memory);
    online->tested = online->kept;
    if (online->state == FLINDERS_UNDISTURBED && online->is_level) drop_before(online, online->kept);
    else if (online->state == FLINDERS_UNDISTURBED && online->kept) fl_learn(online, memory);
    return events | adopt_better(online);
}

#ifndef FLINDERS_SMALL /* a board is given its first calibration */
/* Standard deviation of readings along z. */
static real height_sigma_of(const flinders_online *online, real mean)
{
    real sum = 0;
    for (int row = 0; row < online->kept; row++)
        sum += (online->field[3 * row + 2] - mean) * (online->field[3 * row + 2] - mean) / (real)online->kept;
    return fl_sqrt(sum);
}

/* Whether the newest readings were made straight on: they lie close together beside all that there are. */
static int is_straight(const flinders_online *online)
{
    real lowest[3], highest[3], extent = 0;
    if (online->kept < 2 * LARGE_GROUP_READINGS) return 0;
    for (int row = 0; row < online->kept; row++)
        for (int axis = 0; axis < 3; axis++) {
            const real x = online->field[3 * row + axis];
            lowest[axis] = row && lowest[axis] < x ? lowest[axis] : x;
            highest[axis] = row && highest[axis] > x ? highest[axis] : x;
        }
    for (int axis = 0; axis < 3; axis++)
        extent = highest[axis] - lowest[axis] > extent ? highest[axis] - lowest[axis] : extent;
    const real shape[6] = {extent / 2, extent / 2, extent / 2, 0, 0, 0};
    return !(flinders_turn_deg(online->field + 3 * (online->kept - LARGE_GROUP_READINGS), LARGE_GROUP_READINGS, shape) > GROUP_TURN_DEG);
}

/* Compute a first calibration. */
static int32_t begin_to_know(flinders_online *online, const fl_lent *memory)
{
    flinders_options options;
    flinders_record record;
    flinders_request request;
    flinders_judgement judgement;
    if (online->kept < MIN_BLOCK_READINGS || online->kept % READINGS_PER_STEP) return 0;
    if (is_straight(online)) {
        online->kept -= LARGE_GROUP_READINGS;
        return 0;
    }
    flinders_default_options(&options);
    flinders_default_request(&request);
    options.dip_deg = online->dip_deg, options.rests = 0;
    request.target_deg = online->target_deg;
    if (flinders_fit(online->field, online->time, (size_t)online->kept, &options, memory->at, memory->size, &record) ||
        flinders_judge(&record, &request, &judgement)) return 0;
    if (judgement.verdict >= FLINDERS_REFUSES || !(judgement.worst_deg < MAX_FIRST_CLAIM_RATIO * online->target_deg)) return 0;
    real parameters[9];
    if (record.plane && online->now - online->began < LEVEL_S) return 0;
    online->is_level = record.plane != 0, online->height = online->height_now = record.mean[2];
    online->height_sigma = height_sigma_of(online, record.mean[2]);
    memcpy(parameters, record.centre, sizeof record.centre);
    memcpy(parameters + 3, record.shape, sizeof record.shape);
    flinders_online_know(online, parameters, judgement.covariance, record.noise, online->time[online->kept - 1]);
    return FLINDERS_LEARNT | FLINDERS_ADOPTED;
}
#endif

/* Angle between the directions of two readings, by the calibration. */
static real turned_by(const flinders_online *online, const real a[3], const real b[3])
{
    real d[3], square = 0;
    real radius = online->state == FLINDERS_LEARNING ? 0 : fl_mean_radius(online->latest);
    for (int axis = 0; axis < 3; axis++) d[axis] = a[axis] - b[axis], square += d[axis] * d[axis];
    if (!(radius > 0)) radius = fl_sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    return fl_sqrt(square) / (radius > FL_TINY ? radius : FL_TINY);
}

/* Begin with the readings of another direction. */
static void forget_direction(flinders_online *online)
{
    for (int axis = 0; axis < 3; axis++) online->sum[axis] = 0;
    online->sum_time = 0, online->averaged = 0;
}

/* Whether a level vehicle is tilted now, as a boat that heels: z of its readings differs from the mean, which moves with the
 * offset. */
static int is_heeled(flinders_online *online)
{
    const real usual = MAX_HEIGHT_SIGMAS * online->height_sigma, least = 2 * MIN_CONTRADICTION_SHARE * fl_mean_radius(online->latest);
    const real off = online->sum[2] / (real)online->averaged - online->height_now, most = usual > least ? usual : least;
    online->height_now += (off > most ? most : off < -most ? -most : off) / AVERAGED_HEIGHTS;
    return fl_abs(off) > most;
}

/* Add the mean of the readings in one direction to the evidence. */
static int32_t keep(flinders_online *online, int is_still, const fl_lent *memory)
{
    if (!online->averaged) return 0;
    if (online->is_level && is_heeled(online)) {
        forget_direction(online);
        return 0;
    }
    if (online->kept == FL_EVIDENCE) {
#ifdef FLINDERS_SMALL
        const int is_long = online->time[FL_EVIDENCE - 1] - online->time[0] > MIN_FULL_BLOCK_S && online->state == FLINDERS_UNDISTURBED;
        if (online->tested > MIN_COMPARED_READINGS && !is_long) thin(online);
        else
#endif
        if (online->state == FLINDERS_UNDISTURBED) close_block(online, memory);
        else drop_before(online, FL_EVIDENCE / 2);
    }
    for (int axis = 0; axis < 3; axis++) online->field[3 * online->kept + axis] = online->sum[axis] / (real)online->averaged;
    if (online->is_level) online->field[3 * online->kept + 2] = online->height; /* laid flat */
    online->time[online->kept++] = online->sum_time / (real)online->averaged;
    forget_direction(online);
    if (online->state == FLINDERS_LEARNING)
#ifdef FLINDERS_SMALL
        return 0;
#else
        return begin_to_know(online, memory);
#endif
    const int32_t events = look_at_one(online, is_still);
    return events ? events : look(online, memory);
}

/* End blocks that are complete or too long. */
static void end_block(flinders_online *online, real time, const fl_lent *memory)
{
    if (!online->kept || online->state != FLINDERS_UNDISTURBED) return;
    if (time - online->time[online->kept - 1] > GAP_S || time - online->time[0] > BLOCK_S) close_block(online, memory);
}

/* Move the offset if it jumped: of the four newest readings the first two are alike, and the last two are, much more
 * than both halves. No disturbance passes and nobody turns so fast; a jump back is detected again. */
static int32_t jump(flinders_online *online, const real x[3], real time, const fl_lent *memory)
{
    real *const at = online->newest_at, steps[3] = {0}, d[3];
    memmove(online->newest, online->newest + 3, 9 * sizeof(real)), memmove(at, at + 1, 3 * sizeof(real));
    memcpy(online->newest + 9, x, 3 * sizeof *x), at[3] = time;
    const real before = at[1] - at[0], after = at[3] - at[2];
    if (!(at[3] - at[0] < MAX_JUMP_SPAN_S) || at[2] - at[1] > MAX_INTERVAL_RATIO * (before > after ? before : after)) return 0;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++) {
            const real step = online->newest[3 * k + 3 + axis] - online->newest[3 * k + axis];
            steps[k] += step * step;
        }
    const real usual = online->step, least = MIN_CONTRADICTION_SHARE * fl_mean_radius(online->latest);
    online->step += ((steps[0] < MAX_GROUP_WEIGHT * usual ? steps[0] : MAX_GROUP_WEIGHT * usual) - usual) / AVERAGED_STEPS;
    if (!(online->step > 0)) online->step = steps[0];
    if (online->state == FLINDERS_LEARNING || !(steps[1] > MIN_JUMP_RATIO * MIN_JUMP_RATIO * usual && steps[1] > 4 * least * least) ||
        !(steps[0] < MAX_CALM_RATIO * MAX_CALM_RATIO * steps[1] && steps[2] < MAX_CALM_RATIO * MAX_CALM_RATIO * steps[1])) return 0;
    for (int axis = 0; axis < 3; axis++)
        d[axis] = (online->newest[6 + axis] + online->newest[9 + axis] - online->newest[axis] - online->newest[3 + axis]) / 2;
    if (online->kept && online->state == FLINDERS_UNDISTURBED) close_block(online, memory);
    for (int i = 0; i < 3; i++) {
        online->latest[i] += d[i], online->known[i] += d[i];
        if (i == 2) online->height += d[i], online->height_now += d[i];
        for (int j = 0; j < 3; j++) {
            const real unknown = (i == j ? usual + MAX_CALM_RATIO * MAX_CALM_RATIO * MAX_CALM_RATIO * steps[1] : 0);
            online->latest_covariance[9 * i + j] += unknown, online->known_covariance[9 * i + j] += unknown;
        }
    }
    fl_count_move(online, steps[1]);
    clear_doubt(online);
    drop_before(online, online->kept);
    online->state = FLINDERS_UNDISTURBED;
    forget_direction(online);
    return FLINDERS_MOVED | adopt_better(online);
}

/* Add one reading. */
static int32_t add(flinders_online *online, const real x[3], real time, const fl_lent *memory)
{
    int32_t events = 0;
    if (time < online->now) {
        for (int k = 0; k < 4; k++) online->newest_at[k] = FL_NOT_A_NUMBER; /* what is left out is no jump */
        return FLINDERS_CLOCK_BACK;
    }
    const int is_first = !(online->last_at <= time);
    const int is_turned = is_first || turned_by(online, x, online->last) > MIN_TURN_RAD;
    if (is_turned || time - online->last_at > MAX_AVERAGE_S) {
        if (online->averaged > 0) events = keep(online, !is_turned, memory);
        end_block(online, time, memory);
    }
    if (online->now > -FL_HUGE && online->state != FLINDERS_LEARNING) {
        const real seconds = time - online->now, unseen = fl_unseen_moves(online, seconds);
        for (int i = 0; i < 3; i++) online->known_covariance[10 * i] += unseen, online->latest_covariance[10 * i] += unseen;
        online->watched += seconds;
    }
    if (isnan(online->began)) online->began = time;
    online->now = time;
    events |= jump(online, x, time, memory);
    if (is_turned) {
        memcpy(online->last, x, 3 * sizeof *x);
        online->last_at = time;
    } else if (time - online->last_at > MAX_AVERAGE_S) return events; /* it stands still: this direction is there */
    for (int axis = 0; axis < 3; axis++) online->sum[axis] += x[axis];
    online->sum_time += time, online->averaged++;
    return events;
}

/* Begin without a calibration. */
void flinders_online_begin(flinders_online *online)
{
    memset(online, 0, sizeof *online);
    online->version = FLINDERS_ONLINE_VERSION;
    online->target_deg = 1, online->dip_deg = 60;
    online->now = -FL_HUGE, online->last_at = FL_NOT_A_NUMBER;
    online->began = online->known_at = online->latest_at = online->adopted_at = online->noise = online->moved_at = online->disturbed_at = FL_NOT_A_NUMBER;
    for (int k = 0; k < 4; k++) online->newest_at[k] = FL_NOT_A_NUMBER;
    for (int i = 0; i < FL_PARAMETERS; i++)
        online->known[i] = online->latest[i] = online->in_force[i] = online->replaced[i] = FL_NOT_A_NUMBER;
    memcpy(online->rates, fl_probable_rates, sizeof online->rates);
    memcpy(online->probable_rates, fl_probable_rates, sizeof online->probable_rates);
    online->expected_walk = online->expected_walk_sigma = FL_NOT_A_NUMBER;
    online->scatter = PRIOR_SCATTER, online->place = PRIOR_PLACE_SIGMA;
    clear_doubt(online);
}

/* Use a calibration. */
int flinders_online_know(flinders_online *online, const real parameters[9], const real covariance[81], real noise, real time)
{
    fl_surface surface;
    if (fl_surface_of(parameters, parameters + 3, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    for (int i = 0; i < 81; i++)
        if (!isfinite(covariance[i]) || (i % 10 == 0 && covariance[i] < 0)) return FLINDERS_BAD_OPTION;
    if (!isfinite(time)) return FLINDERS_BAD_OPTION;
    memcpy(online->known, parameters, sizeof online->known);
    memcpy(online->known_covariance, covariance, sizeof online->known_covariance);
    memcpy(online->latest, parameters, sizeof online->latest);
    fl_condition_on_height(online, parameters, online->known_covariance);
    memcpy(online->latest_covariance, online->known_covariance, sizeof online->latest_covariance);
    memcpy(online->in_force, parameters, sizeof online->in_force);
    online->known_at = online->latest_at = online->adopted_at = time;
    online->noise = noise, online->state = FLINDERS_UNDISTURBED;
    fl_expect_walk(online);
    clear_doubt(online);
    drop_before(online, online->kept);
    return FLINDERS_OK;
}

/* Set the prior rate of the offset's random walk. */
int flinders_online_expect_walk(flinders_online *online, real walk, real log_sigma)
{
    if (!(walk > 0 && isfinite(walk) && log_sigma > 0 && isfinite(log_sigma))) return FLINDERS_BAD_OPTION;
    online->expected_walk = walk, online->expected_walk_sigma = log_sigma;
    if (online->state != FLINDERS_LEARNING) fl_expect_walk(online);
    return FLINDERS_OK;
}

/* Add readings. */
size_t flinders_online_add(flinders_online *online, const real *field, const real *time, size_t rows, void *workspace,
                           size_t size, int32_t *events)
{
    const fl_lent memory = {workspace, size};
    *events = 0;
    for (size_t row = 0; row < rows; row++) {
        const real *const x = field + 3 * row;
        if (!(isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]) && isfinite(time[row]))) continue;
        *events = add(online, x, time[row], &memory);
        if (*events) return row + 1;
    }
    return rows;
}

/* Claim at a time. */
int flinders_online_claim_at(const flinders_online *online, real time, flinders_online_claim *claim)
{
    fl_surface surface;
    real rms;
    claim->rms_deg = claim->worst_deg = claim->bound_deg = claim->latest_deg = claim->age_s = claim->walk = FL_NOT_A_NUMBER;
    for (int i = 0; i < 81; i++) claim->covariance[i] = FL_NOT_A_NUMBER;
    if (online->state == FLINDERS_LEARNING || fl_surface_of(online->in_force, online->in_force + 3, &surface))
        return FLINDERS_UNDETERMINED;
    real *const covariance = claim->covariance;
    const real unseen = fl_unseen_moves(online, time - online->now);
    const real back = online->moved_at <= time ? REVERSAL_PROBABILITY * fl_exp(-(time - online->moved_at) / REVERSAL_TIME_S) : 0;
    memcpy(covariance, online->latest_covariance, sizeof claim->covariance);
    fl_age(online, online->latest, time - online->latest_at, covariance);
    const real lean = online->is_level ? HEADING_TILT_SHARE * online->height_sigma * fl_abs(fl_sin(online->dip_deg / FL_TO_DEG) / fl_cos(online->dip_deg / FL_TO_DEG)) : 0;
    for (int i = 0; i < 3; i++) covariance[10 * i] += unseen + (i < 2 ? lean * lean : 0);
    for (int i = 0; i < 9; i++)
        covariance[9 * (i / 3) + i % 3] += CHANGE_PROBABILITY * online->apart[i / 3] * online->apart[i % 3] + online->apart_covariance[i] +
                                           back * online->moved[i / 3] * online->moved[i % 3];
    fl_level_errors(&surface, covariance, online->dip_deg, &rms, &claim->latest_deg);
    for (int i = 0; i < FL_PARAMETERS; i++)
        for (int j = 0; j < FL_PARAMETERS; j++)
            covariance[9 * i + j] += (online->in_force[i] - online->latest[i]) * (online->in_force[j] - online->latest[j]);
    fl_level_errors(&surface, covariance, online->dip_deg, &claim->rms_deg, &claim->worst_deg);
#ifndef FLINDERS_SMALL
    fl_bound shared;
    fl_bound_begin(&shared);
    claim->bound_deg = fl_heading_bound(&surface, covariance, online->dip_deg, NULL, &shared);
#endif
    claim->age_s = time - online->latest_at;
    claim->walk = fl_sqrt(fl_walk_variance(online)) * fl_mean_radius(online->latest);
    return FLINDERS_OK;
}

/* Time for which the claim stays within the target. */
real flinders_online_good_s(const flinders_online *online)
{
    flinders_online_claim claim;
    real low = 0, high = MAX_PREDICTION_S;
    if (!(online->now > -FL_HUGE) || flinders_online_claim_at(online, online->now, &claim)) return FL_NOT_A_NUMBER;
    if (!(claim.worst_deg <= online->target_deg)) return FL_NOT_A_NUMBER;
    flinders_online_claim_at(online, online->now + high, &claim);
    if (claim.worst_deg <= online->target_deg) return (real)INFINITY;
    for (int halving = 0; halving < HALVINGS && high - low > 1; halving++) {
        const real middle = (low + high) / 2;
        flinders_online_claim_at(online, online->now + middle, &claim);
        *(claim.worst_deg <= online->target_deg ? &low : &high) = middle;
    }
    return low;
}

/* Move the origin of times. */
void flinders_online_shift(flinders_online *online, real seconds)
{
    real *const times[] = {&online->began, &online->now, &online->known_at, &online->latest_at, &online->adopted_at,
                           &online->disturbed_at, &online->moved_at, &online->last_at};
    for (size_t i = 0; i < sizeof times / sizeof *times; i++) *times[i] -= seconds;
    for (int k = 0; k < 4; k++) online->newest_at[k] -= seconds;
    for (int row = 0; row < online->kept; row++) online->time[row] -= seconds;
    online->sum_time -= (real)online->averaged * seconds;
}
