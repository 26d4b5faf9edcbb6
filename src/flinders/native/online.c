/* A calibration that keeps itself while its sensor is used.
 *
 * The nine parameters are normally distributed. Between readings the offset walks, by w √t, so that the claim grows; w has
 * one of seven values, each as probable as the steps from one block of evidence to the next make it. Evidence is the means of
 * readings in one direction, kept in the order of time. A block of it is fitted with what was known before as its prior, by
 * the fit of every recording, with slow noise of the vector and of the strength; the field's strength is another one in each
 * block, as places differ. A place bends the field the same way as long as one stays, so that a hundred blocks say no more
 * than a few: SAME of what a block leaves open stays.
 *
 * Each group of readings is first compared with what is known, by the offset that it shows alone. Where they contradict each
 * other, the difference joins the claim at once. Groups that agree with what was known again show that something passed, and
 * their evidence is dropped; groups that agree with each other show that the offset has moved.
 */
#include "judge.h"
#include "residuals.h"

#ifndef FLINDERS_SMALL

enum { PARAMETERS = 9, KEPT = 768, FEWEST = 48, STEP = 32, GROUP = 16, LARGE_GROUP = 64, RATES = 7, IN_A_ROW = 2, MOST_GROUPS = 24 };

#define TURNED ((real)0.06)        /* rad from which on a direction is another one */
#define MOST_TOGETHER_S ((real)2)  /* that readings of one direction are averaged over */
#define GAP_S ((real)120)          /* without readings, or turning, after which a block has ended */
#define BLOCK_S ((real)1200)       /* that a block lasts at most */
#define HOUR_S ((real)3600)
#define GROUP_TURN_DEG ((real)25)  /* from the mean of a group, that it is compared from */
#define AS_FAR ((real)2)           /* times as far as a moved offset is seen to have moved, it may have where nothing is seen */
#define ANYWHERE ((real)0.3)       /* of the radius: where an offset may be that nothing is known of */
#define PLACE ((real)0.02)         /* of the field's strength, from place to place, beforehand */
#define LEAST_PLACE ((real)0.003)  /* of it, that places differ at the least */
#define SAME ((real)0.2)           /* of the variance of a block, that is the place's */
#define SHAPE_WALK ((real)2e-4)    /* of the radius, by which an entry of the shape walks in an hour */
#define CONTRADICTS ((real)1e-6)   /* how often chance may make a group that contradicts what is known */
#define AGREES ((real)0.01)        /* how often chance makes a group that is said to agree again no better */
#define LARGE ((real)0.004)        /* of the radius: smaller contradictions are none */
#define LASTS_S ((real)30)         /* that an offset has to stay where it is to have moved */
#define BETTER ((real)0.8)         /* of the claim in force, from which on another calibration is adopted */
#define LEARNT ((real)3)           /* targets that a first calibration claims at most */
#define SCATTER ((real)4)         /* of groups beforehand, in variance */
#define MOST_SCATTER ((real)9)
#define PASSED ((real)1.5)        /* times as large it is thought where something has passed: such is usual here */
#define GROUPS ((real)16)         /* that it is an average over */
#define FAR ((real)4)             /* times it, that one group counts at most */
#define LEVEL_S ((real)60)        /* that the first calibration of a level vehicle takes at least */
#define HELD ((real)1e-4)          /* of the radius, of what readings say nothing of */
#define REMEMBERED ((real)0.9)     /* of what blocks said of the walk, from one to the next */
#define DAY_S ((real)86400)
#define UNSEEN_S ((real)60)        /* without readings, in which the offset may move and nobody sees it */
#define MOVES_BEFORE ((real)0.5)   /* moves a day that are thought of beforehand, ... */
#define MOVES_DAY ((real)1)        /* ... as if counted for so many days, ... */
#define MOVED ((real)0.1)          /* ... of the radius, root mean square */
#define EITHER ((real)0.3)         /* how probable it is that what contradicts has come to stay: the bound of 95 % holds in both cases */
#define BACK ((real)0.3)           /* how probable it is that what has moved moves back */
#define BACK_S ((real)900)         /* in which it becomes e times less probable that what has moved moves back */
#define JUMP ((real)8)             /* times the usual step from one reading to the next, that an offset moves by */
#define AT_ONCE_S ((real)1)        /* in which it moves */
#define CALM ((real)0.3)           /* of a jump, that the readings before and after it differ by at most */
#define STEPS ((real)64)           /* that their mean square is an average over */
#define FAR_ALONE ((real)6)        /* times as far as places differ, that the strength in one reading is off */
#define NEAR_AGAIN ((real)3)       /* the same of one that is not */
#define HEELED ((real)2.5)         /* times the scatter of the height, that readings of a level vehicle are within */
#define LEAN ((real)0.5)           /* of how far a level vehicle tilts, that follows its heading, as heel does, and looks like an offset */
#define TINY_SHARE ((real)1e-12)

/* Rates of the offset's walk, of the radius per root hour, and how probable each is beforehand. */
static const real RATE[RATES] = {(real)0.0003, (real)0.0006, (real)0.0012, (real)0.0025, (real)0.005, (real)0.01, (real)0.02};
static const real PROBABLE[RATES] = {(real)0.05, (real)0.1, (real)0.2, (real)0.25, (real)0.2, (real)0.15, (real)0.05};

/* Memory that is lent to fits. */
typedef struct {
    void *at;
    size_t size;
} lent;

/* Bytes of the record. */
size_t flinders_online_size(void) { return sizeof(flinders_online); }

/* Mean radius of a shape. */
static real radius_of(const real parameters[9]) { return (parameters[3] + parameters[4] + parameters[5]) / 3; }

/* Variance by which the offset walks in an hour, a fraction of the radius squared. */
static real walk_of(const flinders_online *online)
{
    real sum = 0;
    for (int k = 0; k < RATES; k++) sum += online->rates[k] * RATE[k] * RATE[k];
    return sum;
}

/* Whether the readings of a level vehicle say nothing of a parameter. */
static int is_across(int parameter) { return parameter == 2 || parameter == 5 || parameter > 6; }

/* Of a level vehicle, hold what its readings say nothing of. */
static void hold(const flinders_online *online, const real parameters[9], real covariance[81])
{
    const real held = HELD * radius_of(parameters);
    if (!online->is_level) return;
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++)
            if (is_across(i) || is_across(j)) covariance[9 * i + j] = i == j ? held * held : 0;
}

/* Of a level vehicle, let what is known be what its ellipse leaves open, given all that lies across it. */
static void condition(const flinders_online *online, const real parameters[9], real covariance[81])
{
    const int across[4] = {2, 5, 7, 8};
    real inner[16], inverse[16];
    if (!online->is_level) return;
    for (int k = 0; k < 16; k++) inner[k] = covariance[9 * across[k / 4] + across[k % 4]];
    fl_inverse(inner, 4, inverse);
    real left[81];
    memcpy(left, covariance, sizeof left);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++)
            for (int k = 0; k < 16; k++)
                left[9 * i + j] -= covariance[9 * i + across[k / 4]] * inverse[k] * covariance[9 * across[k % 4] + j];
    memcpy(covariance, left, sizeof left);
    hold(online, parameters, covariance);
}

/* Let time pass over a covariance. */
static void age(const flinders_online *online, const real parameters[9], real seconds, real covariance[81])
{
    const real radius = radius_of(parameters), hours = seconds > 0 ? seconds / HOUR_S : 0;
    const real offset = walk_of(online) * radius * radius * hours, shape = SHAPE_WALK * SHAPE_WALK * radius * radius * hours;
    for (int i = 0; i < PARAMETERS; i++) covariance[10 * i] += i < 3 ? offset : i < 6 ? shape : shape / 2;
    hold(online, parameters, covariance);
}

/* Let the field have another strength. */
static void allow_strength(const flinders_online *online, const real parameters[9], real share, real covariance[81])
{
    for (int i = 3; i < PARAMETERS; i++)
        for (int j = 3; j < PARAMETERS; j++) covariance[9 * i + j] += share * share * parameters[i] * parameters[j];
    hold(online, parameters, covariance);
}

/* Let the offset be anywhere within a distance, 1 sigma. */
static void allow_offset(const flinders_online *online, const real parameters[9], real anywhere, real covariance[81])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < PARAMETERS; j++) covariance[9 * i + j] = covariance[9 * j + i] = i == j ? anywhere * anywhere : 0;
    hold(online, parameters, covariance);
}

/* Let readings say less by a factor in variance: with the prior Π and what they say, J = P⁻¹ − Π, the covariance is
 * P' = (Π + J/f)⁻¹, and the step from the prior's mean P' P⁻¹ / f of what it was. */
static void weaken(const flinders_options *prior, real factor, flinders_record *record)
{
    real inverse[81], information[81], covariance[81], step[9], force[9], moved[9];
    fl_inverse(record->covariance, PARAMETERS, inverse);
    for (int i = 0; i < 81; i++)
        information[i] = prior->information[i] + (inverse[i] - prior->information[i]) / factor;
    fl_inverse(information, PARAMETERS, covariance);
    for (int i = 0; i < PARAMETERS; i++)
        step[i] = (i < 3 ? record->centre[i] : record->shape[i - 3]) - prior->expected[i];
    fl_multiply(inverse, step, PARAMETERS, PARAMETERS, 1, force);
    fl_multiply(covariance, force, PARAMETERS, PARAMETERS, 1, moved);
    for (int i = 0; i < PARAMETERS; i++)
        *(i < 3 ? record->centre + i : record->shape + i - 3) = prior->expected[i] + moved[i] / factor;
    memcpy(record->covariance, covariance, sizeof covariance);
}

/* Fit evidence from one reading on with what is known, where groups scatter so much more than they claim. Noise is no smaller than it was when the sensor was calibrated. */
static int fit(const flinders_online *online, size_t first, const real expected[9], const real covariance[81],
               real scatter, const lent *memory, flinders_record *record)
{
    flinders_options options;
    flinders_default_options(&options);
    options.dip_deg = online->dip_deg;
    options.statistics = options.rests = options.level = 0;
    options.is_informed = 1;
    memcpy(options.expected, expected, sizeof options.expected);
    fl_inverse(covariance, PARAMETERS, options.information);
    if (flinders_fit(online->field + 3 * first, online->time + first, (size_t)online->kept - first, &options, memory->at,
                     memory->size, record)) return record->status;
    const real times = online->noise / record->noise, few = flinders_widening_by_few((real)record->used - PARAMETERS);
    const real factor = scatter * few * (times > 1 ? times * times : 1);
    if (factor > 1) weaken(&options, factor, record);
    return FLINDERS_OK;
}

/* Offset that evidence shows alone from one reading on, with the shape as it is known, and its covariance (3, 3); it is
 * somewhere about a start. */
static int offset_alone(const flinders_online *online, size_t first, const real start[3], real anywhere,
                        const lent *memory, real offset[3], real covariance[9])
{
    flinders_record record;
    real expected[9], free[81];
    memcpy(expected, online->latest, sizeof expected);
    memcpy(expected, start, 3 * sizeof *start);
    memcpy(free, online->latest_covariance, sizeof free);
    allow_strength(online, expected, online->place, free);
    allow_offset(online, expected, anywhere, free);
    if (fit(online, first, expected, free, 1, memory, &record)) return 1;
    for (int i = 0; i < 3; i++) offset[i] = record.centre[i];
    for (int i = 0; i < 9; i++) covariance[i] = record.covariance[9 * (i / 3) + i % 3];
    return 0;
}

/* How often chance makes a difference d of a covariance that is a sum of two, and of groups that scatter so much more. */
static real chance_of(const real d[3], const real one[9], const real other[9], real scatter, real *ratio)
{
    real sum[9], square;
    for (int i = 0; i < 9; i++) sum[i] = one[i] + other[i];
    const int freedom = fl_chi_square(d, sum, 3, &square);
    if (ratio) *ratio = freedom ? square / (real)freedom : 0;
    return freedom ? fl_chance_of(square / scatter, (real)freedom, 0) : 1;
}

/* Covariance (3, 3) of the offset, as it is known latest, at a time. */
static void offset_covariance(const flinders_online *online, real time, real out[9])
{
    real aged[81];
    memcpy(aged, online->latest_covariance, sizeof aged);
    age(online, online->latest, time - online->latest_at, aged);
    for (int i = 0; i < 9; i++) out[i] = aged[9 * (i / 3) + i % 3];
}

/* What is known latest is what evidence makes of what was known before. */
static void learn(flinders_online *online, const lent *memory)
{
    flinders_record record;
    real prior[81], free[81];
    const real last = online->time[online->kept - 1];
    memcpy(prior, online->known_covariance, sizeof prior);
    age(online, online->known, last - online->known_at, prior);
    memcpy(free, prior, sizeof free);
    allow_strength(online, online->known, online->place, free);
    if (fit(online, 0, online->known, free, online->scatter, memory, &record)) return;
    memcpy(online->latest, record.centre, sizeof record.centre);
    memcpy(online->latest + 3, record.shape, sizeof record.shape);
    memcpy(online->latest_covariance, record.covariance, sizeof record.covariance);
    online->latest_at = last;
}

/* Drop evidence before one reading. */
static void drop_before(flinders_online *online, int first)
{
    const size_t left = (size_t)(online->kept - first);
    memmove(online->field, online->field + 3 * first, 3 * left * sizeof(real));
    memmove(online->time, online->time + first, left * sizeof(real));
    online->kept -= first;
    online->tested = online->tested > first ? online->tested - first : 0;
    online->doubtful = online->doubtful < 0 ? -1 : online->doubtful > first ? online->doubtful - first : 0;
}

/* Keep the share of what a block leaves open that is the place's: of a direction in which the covariance is e times what
 * it was before, the block alone leaves e / (1 − e). */
static void keep_open(const real before[81], real covariance[81])
{
    real values[PARAMETERS], vectors[81], turned[81], half[81], shares[PARAMETERS];
    const int k = fl_principal(before, PARAMETERS, values, vectors);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < k; j++) vectors[k * i + j] /= fl_sqrt(values[j]);
    fl_multiply(covariance, vectors, PARAMETERS, PARAMETERS, k, half);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < k; j++) {
            turned[k * i + j] = 0;
            for (int l = 0; l < PARAMETERS; l++) turned[k * i + j] += vectors[k * l + i] * half[k * l + j];
        }
    fl_eigen(turned, k, shares);
    fl_multiply(before, vectors, PARAMETERS, PARAMETERS, k, half);
    fl_multiply(half, turned, PARAMETERS, k, k, vectors); /* in columns: covariance = Σ share v vᵀ */
    for (int l = 0; l < k; l++) {
        const real left = shares[l] < 1 - TINY_SHARE ? SAME * shares[l] / (1 - shares[l]) : 1;
        const real least = left < 1 ? left : 1, more = least > shares[l] ? least - shares[l] : 0;
        for (int i = 0; i < PARAMETERS; i++)
            for (int j = 0; j < PARAMETERS; j++) covariance[9 * i + j] += more * vectors[k * i + l] * vectors[k * j + l];
    }
}

/* What a block says of the rate at which the offset walks. */
static void weigh_rates(flinders_online *online, const real d[3], const real covariance[9], real hours)
{
    const real radius = radius_of(online->known);
    real sum = 0, densities[RATES], best = -FL_HUGE;
    for (int k = 0; k < RATES; k++) {
        real factor[9], x[3];
        memcpy(factor, covariance, sizeof factor), memcpy(x, d, sizeof x);
        for (int i = 0; i < 3; i++) factor[4 * i] += RATE[k] * RATE[k] * radius * radius * hours;
        if (fl_cholesky(factor, 3)) return;
        fl_forward(factor, 3, x);
        densities[k] = -(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) / 2 - fl_log(factor[0] * factor[4] * factor[8]);
        best = densities[k] > best ? densities[k] : best;
    }
    for (int k = 0; k < RATES; k++)
        sum += online->rates[k] = fl_pow(online->rates[k] / PROBABLE[k], REMEMBERED) * PROBABLE[k] * fl_exp(densities[k] - best);
    for (int k = 0; k < RATES; k++) online->rates[k] /= sum;
}

/* End a block: what is known latest is what is known, and its evidence is gone. */
static void close_block(flinders_online *online, const lent *memory)
{
    real prior[81], offset[3], covariance[9], d[3];
    const real seconds = online->latest_at - online->known_at;
    if (!online->kept || !(online->latest_at > online->known_at)) {
        drop_before(online, online->kept);
        return;
    }
    if (!offset_alone(online, 0, online->known, ANYWHERE * radius_of(online->known), memory, offset, covariance)) {
        for (int i = 0; i < 3; i++) d[i] = offset[i] - online->known[i];
        for (int i = 0; i < 9; i++) covariance[i] += online->known_covariance[9 * (i / 3) + i % 3];
        weigh_rates(online, d, covariance, seconds / HOUR_S);
    }
    memcpy(prior, online->known_covariance, sizeof prior);
    age(online, online->known, seconds, prior);
    memcpy(online->known, online->latest, sizeof online->known);
    keep_open(prior, online->latest_covariance);
    memcpy(online->known_covariance, online->latest_covariance, sizeof online->known_covariance);
    online->known_at = online->latest_at;
    drop_before(online, online->kept);
}

/* Put what is known latest in force. */
void flinders_online_adopt(flinders_online *online)
{
    if (online->state == FLINDERS_LEARNING) return;
    memcpy(online->replaced, online->in_force, sizeof online->replaced);
    memcpy(online->in_force, online->latest, sizeof online->in_force);
    online->adopted_at = online->now;
}

/* Put what was in force before in force again. */
void flinders_online_take_back(flinders_online *online)
{
    real current[9];
    if (isnan(online->replaced[3])) return;
    memcpy(current, online->in_force, sizeof current);
    memcpy(online->in_force, online->replaced, sizeof online->in_force);
    memcpy(online->replaced, current, sizeof online->replaced);
    online->adopted_at = online->now;
}

/* Adopt what is known latest where that is clearly better than what is in force. */
static int32_t adopt_better(flinders_online *online)
{
    flinders_online_claim claim;
    if (online->is_locked || online->state != FLINDERS_UNDISTURBED) return 0;
    if (flinders_online_claim_at(online, online->now, &claim)) return 0;
    if (!(claim.latest_deg < BETTER * claim.worst_deg)) return 0;
    flinders_online_adopt(online);
    return FLINDERS_ADOPTED;
}

/* Nothing contradicts what is known. */
static void clear_doubt(flinders_online *online)
{
    online->doubtful = -1;
    online->agreeing = online->alike = online->is_lone = online->groups = 0;
    for (int i = 0; i < 3; i++) online->apart[i] = 0;
    memset(online->apart_covariance, 0, sizeof online->apart_covariance);
}

/* The offset has moved, by so much squared. */
static void count_move(flinders_online *online, real square)
{
    online->moves += 1, online->moves_square += square;
}

/* Variance of the offset along an axis by moves that nobody has seen, while nothing was read for some time. */
static real unseen_moves(const flinders_online *online, real seconds)
{
    const real radius = radius_of(online->latest), days = (MOVES_DAY * DAY_S + online->watched) / DAY_S;
    const real rate = (MOVES_DAY * MOVES_BEFORE + online->moves) / days;
    const real square = (MOVED * MOVED * radius * radius + online->moves_square) / (1 + online->moves);
    return seconds > UNSEEN_S ? rate * seconds / DAY_S * square / 3 : 0;
}

/* The offset is another one: that which doubtful evidence shows, with the shape as it was. */
static int32_t move(flinders_online *online, const real offset[3], const real covariance[9])
{
    for (int i = 0; i < 3; i++) online->moved[i] = online->apart[i];
    online->moved_at = online->now;
    memcpy(online->latest, offset, 3 * sizeof *offset);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < PARAMETERS; j++)
            online->latest_covariance[9 * i + j] = online->latest_covariance[9 * j + i] = j < 3 ? covariance[3 * i + j] : 0;
    count_move(online, online->apart[0] * online->apart[0] + online->apart[1] * online->apart[1] +
                           online->apart[2] * online->apart[2]);
    online->latest_at = online->known_at = online->time[online->kept - 1];
    memcpy(online->known, online->latest, sizeof online->known);
    memcpy(online->known_covariance, online->latest_covariance, sizeof online->known_covariance);
    clear_doubt(online);
    drop_before(online, online->kept);
    online->state = FLINDERS_UNDISTURBED;
    return FLINDERS_MOVED | adopt_better(online);
}

/* By how much the offset that evidence shows from one reading on is another one, and the covariance of that. Where the
 * evidence tells nothing of it, it has moved about as far as where it does. */
static void part(flinders_online *online, int first, const lent *memory, real offset[3], real covariance[9])
{
    real d[3];
    for (int i = 0; i < 3; i++) d[i] = offset[i] - online->latest[i];
    const real size = fl_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    offset_alone(online, (size_t)first, online->latest, AS_FAR * size, memory, offset, covariance);
    for (int i = 0; i < 3; i++) online->apart[i] = offset[i] - online->latest[i];
    memcpy(online->apart_covariance, covariance, 9 * sizeof *covariance);
}

/* Whether it is known by how much the offset has moved, in all directions. */
static int is_determined(const flinders_online *online)
{
    real size = 0, unknown = 0;
    for (int i = 0; i < 3; i++) size += online->apart[i] * online->apart[i], unknown += online->apart_covariance[4 * i];
    return unknown * online->scatter < size / 2;
}

/* By how much the field's strength differs in readings from one on: their mean length; and the mean of their directions. */
static real length_off(const flinders_online *online, int first, real direction[3])
{
    fl_surface surface;
    real sum = 0;
    for (int axis = 0; axis < 3; axis++) direction[axis] = 0;
    if (fl_surface_of(online->latest, online->latest + 3, &surface)) return 0;
    for (int row = first; row < online->kept; row++) {
        real off[3], u[3];
        for (int axis = 0; axis < 3; axis++) off[axis] = online->field[3 * row + axis] - surface.centre[axis];
        fl_sym3_apply(surface.inverse, off, u);
        const real length = fl_sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        for (int axis = 0; axis < 3; axis++) direction[axis] += u[axis] / length / (real)(online->kept - first);
        sum += length - 1;
    }
    return sum / (real)(online->kept - first);
}

/* Look at the newest reading alone, as of a body that lies still: where its length is far off, something passes or the offset
 * has moved, and where the next one's is not, it has passed. */
static int32_t look_at_one(flinders_online *online, int is_still)
{
    real u[3];
    const real radius = radius_of(online->latest), off = length_off(online, online->kept - 1, u), size = fl_abs(off);
    const real usual = fl_sqrt(online->place * online->place + online->noise * online->noise / (radius * radius));
    if (!is_still) return 0;
    if (online->is_lone && size < NEAR_AGAIN * usual) {
        clear_doubt(online);
        drop_before(online, online->kept);
        online->state = FLINDERS_UNDISTURBED;
        return FLINDERS_PASSED;
    }
    if (online->state != FLINDERS_UNDISTURBED || !(size > FAR_ALONE * usual && size > 2 * LARGE)) return 0;
    online->state = FLINDERS_DISTURBED, online->is_lone = 1, online->doubtful = online->kept - 1;
    for (int i = 0; i < 3; i++) online->apart[i] = off * radius * u[i];
    for (int i = 0; i < 3; i++) online->apart_covariance[4 * i] = off * off * radius * radius;
    return FLINDERS_CONTRADICTED;
}

/* Let an average over groups follow one of them. */
static void follow(real *average, real square, real least)
{
    const real most = FAR * *average;
    *average += ((square < most ? square : most) - *average) / GROUPS;
    *average = *average > least ? *average : least;
}

/* After many groups that neither agree with what is known nor with each other, what they contradict is as uncertain as they
 * make it, and they are learnt from. */
static int32_t give_in(flinders_online *online)
{
    if (++online->groups < MOST_GROUPS) return 0;
    for (int i = 0; i < 9; i++) {
        const int at = 9 * (i / 3) + i % 3;
        const real unknown = online->apart[i / 3] * online->apart[i % 3] + online->apart_covariance[i];
        online->known_covariance[at] += unknown, online->latest_covariance[at] += unknown;
    }
    clear_doubt(online);
    drop_before(online, online->kept);
    online->scatter = online->scatter * PASSED < MOST_SCATTER ? online->scatter * PASSED : MOST_SCATTER;
    online->state = FLINDERS_UNDISTURBED;
    return FLINDERS_PASSED;
}

/* Readings from one on agree with what is known, or contradict it. */
static int32_t doubt(flinders_online *online, int first, const lent *memory)
{
    real offset[3], covariance[9], known[9], d[3], other[3];
    const real now = online->time[online->kept - 1], radius = radius_of(online->latest);
    if (offset_alone(online, (size_t)first, online->latest, ANYWHERE * radius, memory, offset, covariance)) return 0;
    offset_covariance(online, now, known);
    for (int i = 0; i < 3; i++) d[i] = offset[i] - online->latest[i];
    real ratio;
    const real chance = chance_of(d, covariance, known, online->scatter, &ratio), size = fl_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    if (size > 2 * ANYWHERE * radius) return 0; /* a short arc lies on more circles than one */
    if (online->state == FLINDERS_UNDISTURBED) {
        if (!(chance < CONTRADICTS && size > LARGE * radius)) {
            real variance = online->place * online->place;
            real u[3];
            const real off = length_off(online, first, u);
            follow(&online->scatter, ratio, 1);
            follow(&variance, off * off, LEAST_PLACE * LEAST_PLACE);
            online->place = fl_sqrt(variance);
            return 0;
        }
        online->state = FLINDERS_DISTURBED, online->doubtful = first;
        part(online, first, memory, offset, covariance);
        return FLINDERS_CONTRADICTED;
    }
    for (int i = 0; i < 3; i++) other[i] = d[i] - online->apart[i];
    online->is_lone = 0;
    const int is_told = chance_of(online->apart, online->apart_covariance, known, online->scatter, NULL) < AGREES;
    const int agrees = chance > AGREES, is_alike = chance_of(other, covariance, online->apart_covariance, online->scatter, NULL) > AGREES;
    if (is_told && agrees && is_alike) return give_in(online); /* it tells nothing */
    online->agreeing = agrees ? online->agreeing + 1 : 0, online->alike = is_alike ? online->alike + 1 : 0;
    if (agrees) follow(&online->scatter, ratio, 1);
    if (online->agreeing == IN_A_ROW) {
        online->scatter = online->scatter * PASSED < MOST_SCATTER ? online->scatter * PASSED : MOST_SCATTER;
        clear_doubt(online);
        drop_before(online, online->kept); /* what passed, and the evidence of this block with it */
        online->state = FLINDERS_UNDISTURBED;
        return FLINDERS_PASSED;
    }
    if (agrees) return give_in(online);
    if (!is_alike) online->doubtful = first; /* what there was before is another offset again */
    part(online, online->doubtful, memory, offset, covariance);
    if (online->alike < IN_A_ROW || now - online->time[online->doubtful] < LASTS_S || !is_determined(online))
        return give_in(online);
    return move(online, offset, covariance);
}

/* Compare the readings that were not compared yet, where they are enough, and learn of them. */
static int32_t look(flinders_online *online, const lent *memory)
{
    const int first = online->tested, count = online->kept - first;
    if (count < GROUP) return 0;
    const int is_turned = flinders_turn_deg(online->field + 3 * first, (size_t)count, online->latest + 3) > GROUP_TURN_DEG;
    if (count < LARGE_GROUP && !is_turned) return 0;
    if (online->is_level && !is_turned) { /* straight on: heel and slope look like an offset */
        online->kept = first;
        return 0;
    }
    const int32_t events = doubt(online, first, memory);
    online->tested = online->kept;
    if (online->state != FLINDERS_UNDISTURBED || !online->kept) return events;
    learn(online, memory);
    return events | adopt_better(online);
}

/* How far readings scatter along z. */
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
    if (online->kept < 2 * LARGE_GROUP) return 0;
    for (int row = 0; row < online->kept; row++)
        for (int axis = 0; axis < 3; axis++) {
            const real x = online->field[3 * row + axis];
            lowest[axis] = row && lowest[axis] < x ? lowest[axis] : x;
            highest[axis] = row && highest[axis] > x ? highest[axis] : x;
        }
    for (int axis = 0; axis < 3; axis++)
        extent = highest[axis] - lowest[axis] > extent ? highest[axis] - lowest[axis] : extent;
    const real shape[6] = {extent / 2, extent / 2, extent / 2, 0, 0, 0};
    return !(flinders_turn_deg(online->field + 3 * (online->kept - LARGE_GROUP), LARGE_GROUP, shape) > GROUP_TURN_DEG);
}

/* Find a first calibration. */
static int32_t begin_to_know(flinders_online *online, const lent *memory)
{
    flinders_options options;
    flinders_record record;
    flinders_request request;
    flinders_judgement judgement;
    if (online->kept < FEWEST || online->kept % STEP) return 0;
    if (is_straight(online)) {
        online->kept -= LARGE_GROUP;
        return 0;
    }
    flinders_default_options(&options);
    flinders_default_request(&request);
    options.dip_deg = online->dip_deg, options.rests = 0;
    request.target_deg = online->target_deg;
    if (flinders_fit(online->field, online->time, (size_t)online->kept, &options, memory->at, memory->size, &record) ||
        flinders_judge(&record, &request, &judgement)) return 0;
    if (judgement.verdict >= FLINDERS_REFUSES || !(judgement.worst_deg < LEARNT * online->target_deg)) return 0;
    real parameters[9];
    if (record.plane && online->time[online->kept - 1] - online->time[0] < LEVEL_S) return 0;
    online->is_level = record.plane != 0, online->height = record.mean[2];
    online->height_sigma = height_sigma_of(online, record.mean[2]);
    memcpy(parameters, record.centre, sizeof record.centre);
    memcpy(parameters + 3, record.shape, sizeof record.shape);
    flinders_online_know(online, parameters, judgement.covariance, record.noise, online->time[online->kept - 1]);
    return FLINDERS_LEARNT | FLINDERS_ADOPTED;
}

/* Angle between the directions of two readings, by what is known. */
static real turned_by(const flinders_online *online, const real a[3], const real b[3])
{
    real d[3], square = 0;
    real radius = online->state == FLINDERS_LEARNING ? 0 : radius_of(online->latest);
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

/* Whether a level vehicle is not level now, as a boat that heels: its readings are not at the height of the others. */
static int is_heeled(const flinders_online *online)
{
    const real off = fl_abs(online->sum[2] / (real)online->averaged - online->height);
    return off > HEELED * online->height_sigma && off > 2 * LARGE * radius_of(online->latest);
}

/* Put the mean of the readings of one direction into the evidence. */
static int32_t keep(flinders_online *online, int is_still, const lent *memory)
{
    if (!online->averaged) return 0;
    if (online->is_level && is_heeled(online)) {
        forget_direction(online);
        return 0;
    }
    if (online->kept == KEPT) {
        if (online->state == FLINDERS_UNDISTURBED) close_block(online, memory);
        else drop_before(online, KEPT / 2);
    }
    for (int axis = 0; axis < 3; axis++) online->field[3 * online->kept + axis] = online->sum[axis] / (real)online->averaged;
    if (online->is_level) online->field[3 * online->kept + 2] = online->height; /* laid flat */
    online->time[online->kept++] = online->sum_time / (real)online->averaged;
    forget_direction(online);
    if (online->state == FLINDERS_LEARNING) return begin_to_know(online, memory);
    const int32_t events = look_at_one(online, is_still);
    return events ? events : look(online, memory);
}

/* End what has lasted for too long, or has ended. */
static void end_block(flinders_online *online, real time, const lent *memory)
{
    if (!online->kept || online->state != FLINDERS_UNDISTURBED) return;
    if (time - online->time[online->kept - 1] > GAP_S || time - online->time[0] > BLOCK_S) close_block(online, memory);
}

/* Move the offset where it has moved at once: of the four newest readings the first two are alike, and the last two are, much
 * more than the two halves. Nothing passes so fast, and nobody turns; what moves back is seen again. */
static int32_t jump(flinders_online *online, const real x[3], real time, const lent *memory)
{
    real *const at = online->newest_at, steps[3] = {0}, d[3];
    memmove(online->newest, online->newest + 3, 9 * sizeof(real)), memmove(at, at + 1, 3 * sizeof(real));
    memcpy(online->newest + 9, x, 3 * sizeof *x), at[3] = time;
    if (!(at[3] - at[0] < AT_ONCE_S)) return 0;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++) {
            const real step = online->newest[3 * k + 3 + axis] - online->newest[3 * k + axis];
            steps[k] += step * step;
        }
    const real usual = online->step, least = LARGE * radius_of(online->latest);
    online->step += ((steps[0] < FAR * usual ? steps[0] : FAR * usual) - usual) / STEPS;
    if (!(online->step > 0)) online->step = steps[0];
    if (online->state == FLINDERS_LEARNING || !(steps[1] > JUMP * JUMP * usual && steps[1] > 4 * least * least) ||
        !(steps[0] < CALM * CALM * steps[1] && steps[2] < CALM * CALM * steps[1])) return 0;
    for (int axis = 0; axis < 3; axis++)
        d[axis] = (online->newest[6 + axis] + online->newest[9 + axis] - online->newest[axis] - online->newest[3 + axis]) / 2;
    if (online->kept && online->state == FLINDERS_UNDISTURBED) close_block(online, memory);
    for (int i = 0; i < 3; i++) {
        online->latest[i] += d[i], online->known[i] += d[i];
        for (int j = 0; j < 3; j++) {
            const real unknown = (i == j ? usual + CALM * CALM * CALM * steps[1] : 0);
            online->latest_covariance[9 * i + j] += unknown, online->known_covariance[9 * i + j] += unknown;
        }
    }
    count_move(online, steps[1]);
    clear_doubt(online);
    drop_before(online, online->kept);
    online->state = FLINDERS_UNDISTURBED;
    forget_direction(online);
    return FLINDERS_MOVED | adopt_better(online);
}

/* Add one reading. */
static int32_t add(flinders_online *online, const real x[3], real time, const lent *memory)
{
    int32_t events = 0;
    if (time < online->now) return FLINDERS_CLOCK_BACK;
    const int is_first = !(online->last_at <= time);
    const int is_turned = is_first || turned_by(online, x, online->last) > TURNED;
    if (is_turned || time - online->last_at > MOST_TOGETHER_S) {
        if (online->averaged > 0) events = keep(online, !is_turned, memory);
        end_block(online, time, memory);
    }
    if (online->now > -FL_HUGE && online->state != FLINDERS_LEARNING) {
        const real seconds = time - online->now, unseen = unseen_moves(online, seconds);
        for (int i = 0; i < 3; i++) online->known_covariance[10 * i] += unseen, online->latest_covariance[10 * i] += unseen;
        online->watched += seconds;
    }
    online->now = time;
    events |= jump(online, x, time, memory);
    if (is_turned) {
        memcpy(online->last, x, 3 * sizeof *x);
        online->last_at = time;
    } else if (time - online->last_at > MOST_TOGETHER_S) return events; /* it stands still: this direction is there */
    for (int axis = 0; axis < 3; axis++) online->sum[axis] += x[axis];
    online->sum_time += time, online->averaged++;
    return events;
}

/* Begin without any calibration. */
void flinders_online_begin(flinders_online *online)
{
    memset(online, 0, sizeof *online);
    online->version = FLINDERS_RECORD_VERSION;
    online->target_deg = 1, online->dip_deg = 60;
    online->now = -FL_HUGE, online->last_at = FL_NOT_A_NUMBER;
    online->known_at = online->latest_at = online->adopted_at = online->noise = online->moved_at = FL_NOT_A_NUMBER;
    for (int k = 0; k < 4; k++) online->newest_at[k] = FL_NOT_A_NUMBER;
    for (int i = 0; i < PARAMETERS; i++)
        online->known[i] = online->latest[i] = online->in_force[i] = online->replaced[i] = FL_NOT_A_NUMBER;
    memcpy(online->rates, PROBABLE, sizeof online->rates);
    online->scatter = SCATTER, online->place = PLACE;
    clear_doubt(online);
}

/* Put a calibration in force. */
int flinders_online_know(flinders_online *online, const real parameters[9], const real covariance[81], real noise, real time)
{
    fl_surface surface;
    if (fl_surface_of(parameters, parameters + 3, &surface)) return FLINDERS_NOT_AN_ELLIPSOID;
    memcpy(online->known, parameters, sizeof online->known);
    memcpy(online->known_covariance, covariance, sizeof online->known_covariance);
    memcpy(online->latest, parameters, sizeof online->latest);
    condition(online, parameters, online->known_covariance);
    memcpy(online->latest_covariance, online->known_covariance, sizeof online->latest_covariance);
    memcpy(online->in_force, parameters, sizeof online->in_force);
    online->known_at = online->latest_at = online->adopted_at = time;
    online->noise = noise, online->state = FLINDERS_UNDISTURBED;
    clear_doubt(online);
    drop_before(online, online->kept);
    return FLINDERS_OK;
}

/* Add readings. */
size_t flinders_online_add(flinders_online *online, const real *field, const real *time, size_t rows, void *workspace,
                           size_t size, int32_t *events)
{
    const lent memory = {workspace, size};
    *events = 0;
    for (size_t row = 0; row < rows; row++) {
        const real *const x = field + 3 * row;
        if (!(isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]) && isfinite(time[row]))) continue;
        *events = add(online, x, time[row], &memory);
        if (*events) return row + 1;
    }
    return rows;
}

/* What is claimed at a time. */
int flinders_online_claim_at(const flinders_online *online, real time, flinders_online_claim *claim)
{
    fl_surface surface;
    fl_bound shared;
    real rms;
    claim->rms_deg = claim->worst_deg = claim->bound_deg = claim->latest_deg = claim->age_s = claim->walk = FL_NOT_A_NUMBER;
    for (int i = 0; i < 81; i++) claim->covariance[i] = FL_NOT_A_NUMBER;
    if (online->state == FLINDERS_LEARNING || fl_surface_of(online->in_force, online->in_force + 3, &surface))
        return FLINDERS_UNDETERMINED;
    real *const covariance = claim->covariance;
    const real unseen = unseen_moves(online, time - online->now);
    const real back = online->moved_at <= time ? BACK * fl_exp(-(time - online->moved_at) / BACK_S) : 0;
    memcpy(covariance, online->latest_covariance, sizeof claim->covariance);
    age(online, online->latest, time - online->latest_at, covariance);
    const real lean = online->is_level ? LEAN * online->height_sigma * fl_abs(fl_sin(online->dip_deg / FL_TO_DEG) / fl_cos(online->dip_deg / FL_TO_DEG)) : 0;
    for (int i = 0; i < 3; i++) covariance[10 * i] += unseen + (i < 2 ? lean * lean : 0);
    for (int i = 0; i < 9; i++)
        covariance[9 * (i / 3) + i % 3] += EITHER * online->apart[i / 3] * online->apart[i % 3] + online->apart_covariance[i] +
                                           back * online->moved[i / 3] * online->moved[i % 3];
    fl_level_errors(&surface, covariance, online->dip_deg, &rms, &claim->latest_deg);
    for (int i = 0; i < PARAMETERS; i++)
        for (int j = 0; j < PARAMETERS; j++)
            covariance[9 * i + j] += (online->in_force[i] - online->latest[i]) * (online->in_force[j] - online->latest[j]);
    fl_level_errors(&surface, covariance, online->dip_deg, &claim->rms_deg, &claim->worst_deg);
    fl_bound_begin(&shared);
    claim->bound_deg = fl_heading_bound(&surface, covariance, online->dip_deg, NULL, &shared);
    claim->age_s = time - online->latest_at;
    claim->walk = fl_sqrt(walk_of(online)) * radius_of(online->latest);
    return FLINDERS_OK;
}
#endif
