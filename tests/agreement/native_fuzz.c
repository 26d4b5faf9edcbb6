/* Calls the engine with wild numbers, each array in memory that ends where the array ends: fuzz CALLS [SEED]. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "flinders.h"

#define REQUIRE(condition) \
    if (!(condition)) \
    fprintf(stderr, "line %d: not so: %s\n", __LINE__, #condition), exit(1)

static uint64_t state;

/* A number from 0 to below 1. */
static double uniform(void)
{
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(state >> 11) / 9007199254740992.0;
}

/* A whole number from 0 to below a limit. */
static size_t below(size_t limit) { return (size_t)(uniform() * (double)limit); }

/* Any number at all: one at an edge, or 32 or 64 bits by chance. */
static flinders_real anything(void)
{
    static const double EDGES[] = {0, -0.0, 1, -1, 1e-30, 1e-12, 1e15, -1e30, FLT_MIN, FLT_MAX, -FLT_MAX, FLT_EPSILON,
                                   1e-45, 9.3e18, -9.3e18, DBL_EPSILON};
    flinders_real number;
    if (uniform() < 0.1) return (flinders_real)(uniform() < 0.5 ? NAN : uniform() < 0.5 ? INFINITY : -INFINITY);
    if (uniform() < 0.5) return (flinders_real)EDGES[below(sizeof EDGES / sizeof *EDGES)];
    for (size_t i = 0; i < sizeof number; i++) ((unsigned char *)&number)[i] = (unsigned char)below(256);
    return number;
}

/* Numbers, each of them anything. */
static void fill_with_anything(flinders_real *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) numbers[i] = anything();
}

/* Readings around an ellipsoid, some of them spoilt. */
static void fill(flinders_real *field, size_t rows)
{
    const double scale = uniform() < 0.6 ? 50 : pow(10, 40 * uniform() - 20), noise = pow(10, 3 * uniform() - 3);
    const double height = uniform() < 0.5 ? 2 : 2 * uniform(), offset = 4 * uniform() - 2;
    const double level = uniform() < 0.3 ? uniform() : 2; /* of a level turn, or 2 */
    for (size_t row = 0; row < rows; row++) {
        const double z = level < 2 ? level : 1 - height * uniform(), turn = 6.283185307179586 * uniform(), flat = sqrt(1 - z * z);
        field[3 * row] = (flinders_real)(scale * (flat * cos(turn) + noise * (uniform() - 0.5) + offset));
        field[3 * row + 1] = (flinders_real)(scale * (1.1 * flat * sin(turn) + noise * (uniform() - 0.5)));
        field[3 * row + 2] = (flinders_real)(scale * (0.9 * z + noise * (uniform() - 0.5)));
    }
    const double kind = uniform();
    if (kind < 0.15) field[below(3 * rows)] = anything();
    else if (kind < 0.2)
        for (size_t row = 1; row < rows; row++) memcpy(field + 3 * row, field, 3 * sizeof *field);
    else if (kind < 0.25)
        for (size_t row = 0; row < rows; row++) field[3 * row + 1] = 3;
    else if (kind < 0.4)
        for (size_t row = 0; row < rows / 5; row++) field[3 * row] += (flinders_real)(scale * uniform());
    else if (kind < 0.45)
        for (size_t i = 0; i < 3 * rows; i++) field[i] = (flinders_real)(scale * floor(field[i] / scale * 4));
    else if (kind < 0.5) fill_with_anything(field, 3 * rows);
    else if (kind < 0.55 && rows > 2) memcpy(field + 3 * (rows / 2), field, 3 * (rows / 2) * sizeof *field);
}

/* Memory that has to be had. */
static void *need(size_t size)
{
    void *memory = malloc(size ? size : 1);
    if (!memory) exit(2);
    return memory;
}

/* Options as they come, or at their edges. */
static flinders_options some_options(void)
{
    flinders_options options;
    flinders_default_options(&options);
    options.robust = uniform() < 0.1 ? 2 : (int32_t)below(2);
    options.kernels = (int32_t)below(3);
    if (uniform() < 0.2) options.prior = 0;
    if (uniform() < 0.05) options.prior = anything();
    if (uniform() < 0.05) options.dip_deg = anything();
    if (uniform() < 0.2) options.statistics = 0;
    options.is_informed = uniform() < 0.05;
    for (int i = 0; i < 9; i++) options.expected[i] = i < 3 ? 0 : (flinders_real)(i < 6 ? 50 : uniform());
    for (int i = 0; i < 9; i++) options.information[10 * i] = (flinders_real)(i < 3 ? 0 : uniform());
    if (uniform() < 0.02) fill_with_anything(options.information, 81);
    if (uniform() < 0.02) fill_with_anything(options.expected, 9);
    if (uniform() < 0.2) options.level = 0;
    if (uniform() < 0.02) options.robust = options.kernels = options.statistics = INT32_MIN + (int32_t)below(9);
    return options;
}

/* Ask whether readings are those of a sensor that was turned; `records` are of readings like these. */
static void ask_for_turns(const flinders_real *field, size_t rows, const flinders_record *records, size_t count)
{
    const size_t size = flinders_workspace_size(rows);
    const flinders_real weakest = uniform() < 0.5 ? 0 : uniform() < 0.8 ? 22 : anything();
    const flinders_real strongest = uniform() < 0.5 ? INFINITY : uniform() < 0.8 ? 67 : anything();
    flinders_real angle, *means = need(3 * rows * sizeof *means);
    unsigned char *turned = need(count);
    void *workspace = need(size);
    memcpy(means, field, 3 * rows * sizeof *means);
    flinders_turned(records, count, weakest, strongest, turned);
    for (size_t i = 0; i < count; i++) REQUIRE(turned[i] <= 1);
    REQUIRE(flinders_unmoved(field, rows, weakest, strongest, workspace, size, &angle) <= 9);
    REQUIRE(isnan(angle) || fabs((double)angle) <= 180);
    REQUIRE(flinders_unmoved_cells(means, rows, uniform() < 0.9 ? (flinders_real)rows : anything(), weakest, strongest,
                                   &angle) <= 9);
    REQUIRE(isnan(angle) || fabs((double)angle) <= 180);
    free(means), free(turned), free(workspace);
}

/* Ask whether readings of a covariance of any kind lie in a plane. */
static void ask_for_a_plane(void)
{
    flinders_real covariance[6];
    for (int i = 0; i < 6; i++) covariance[i] = uniform() < 0.7 ? (flinders_real)uniform() : anything();
    const int is_level = flinders_is_level(covariance, uniform() < 0.5 ? INFINITY : anything(), anything());
    REQUIRE(is_level == 0 || is_level == 1);
}

/* Fit the ellipse of a level turn, of readings that may be none. */
static void fit_level(const flinders_real *field, const flinders_real *time, size_t rows, const flinders_options *options)
{
    const size_t size = flinders_workspace_size(rows);
    const int64_t ends[2] = {(int64_t)below(rows + 1), (int64_t)rows};
    const int are_two = uniform() < 0.2;
    void *workspace = need(size);
    flinders_record record;
    const int status = flinders_fit_level(field, time, rows, are_two ? ends : NULL, are_two ? 2 : 0, options, workspace, size,
                                          &record);
    REQUIRE(status >= 0 && status <= 9 && status == record.status);
    REQUIRE(status || (record.plane == 1 && isfinite(record.centre[2]) && record.radius > 0));
    REQUIRE(rows == 0 || flinders_fit_level(field, time, rows, NULL, 0, options, workspace, size - 1, &record) != FLINDERS_OK);
    free(workspace);
}

/* Ask which directions readings cover, by themselves and by cells of space. */
static void cover(const flinders_real *field, size_t rows, const flinders_record *record)
{
    const size_t size = flinders_workspace_size(rows);
    const flinders_real within = uniform() < 0.5 ? record->rejected_beyond : anything();
    flinders_real *means = need(3 * rows * sizeof *means), *readings = need(rows * sizeof *readings);
    flinders_real *scratch = need(6 * rows * sizeof *scratch), sum = 0;
    uint32_t *cells = need(rows * sizeof *cells);
    void *workspace = need(size);
    flinders_coverage coverage;
    int32_t is_open = 2;
    if (uniform() < 0.5) memcpy(means, field, 3 * rows * sizeof *means);
    else fill_with_anything(means, 3 * rows);
    for (size_t i = 0; i < rows; i++) readings[i] = uniform() < 0.9 ? 1 : anything();
    flinders_cells_of(means, rows, cells);
    for (size_t i = 0; i < rows; i++) REQUIRE(cells[i] < 100);
    flinders_coverage_of_cells(means, readings, rows, anything(), record->centre, record->shape, within, scratch, &coverage);
    REQUIRE(isnan(coverage.share) || (coverage.share > 0 && coverage.share <= 1));
    flinders_facing(coverage.readings, uniform() < 0.5 ? 60 : anything(), &is_open);
    REQUIRE(is_open == 0 || is_open == 1);
    const int status = flinders_coverage_of(field, rows, record->centre, record->shape, within, workspace, size, &coverage);
    REQUIRE(status >= 0 && status <= 9);
    for (int i = 0; i < 100; i++) sum += coverage.readings[i];
    REQUIRE(isnan(coverage.share) ? sum == 0 : sum > 0 && sum <= (flinders_real)rows);
    free(means), free(readings), free(scratch), free(cells), free(workspace);
}

/* Look for axes that changed, among readings some of which have them changed. */
static void look_for_swaps(const flinders_real *field, size_t rows)
{
    const size_t size = flinders_swap_workspace_size(rows), behind = below(rows + 1);
    const flinders_real noise = uniform() < 0.5 ? INFINITY : anything(), limit = uniform() < 0.5 ? 1 : anything();
    flinders_real *changed = need(3 * rows * sizeof *changed);
    int64_t *moments = need(rows * sizeof *moments);
    void *workspace = need(size);
    flinders_axis_change found;
    memcpy(changed, field, 3 * rows * sizeof *changed);
    for (size_t i = 3 * behind; i < 3 * rows; i += 3) changed[i] = -changed[i];
    REQUIRE(flinders_axis_swap(changed, rows, noise, limit, workspace, size, moments, &found) == FLINDERS_OK);
    REQUIRE(found.swap >= -1 && found.swap < 6 && (found.swap >= 0) == (found.moments > 0));
    REQUIRE(found.swap < 0 || (found.gain > 1 && found.gain <= 1000));
    for (int64_t i = 0; i < found.moments; i++) REQUIRE(moments[i] > (i ? moments[i - 1] : 0) && moments[i] < (int64_t)rows);
    REQUIRE(flinders_axis_swap(changed, rows, noise, limit, workspace, size - 1, moments, &found) == FLINDERS_NO_WORKSPACE);
    free(changed), free(moments), free(workspace);
}

/* A number that a site may have, or anything. */
static flinders_real some_number(double likely)
{
    return uniform() < 0.2 ? (flinders_real)NAN : uniform() < 0.1 ? anything() : (flinders_real)(likely * uniform());
}

/* Let the field of some site count in a fit, as that of a level turn or of readings from all directions. */
static void place(const flinders_real *field, size_t rows, const flinders_record *fitted)
{
    const size_t size = flinders_workspace_size(rows);
    flinders_real *felt = need(3 * rows * sizeof *felt), centre[2] = {fitted->centre[0], fitted->centre[1]};
    void *workspace = need(size);
    flinders_record record = *fitted;
    flinders_vertical vertical = {0};
    flinders_heights heights;
    flinders_site site;
    if (uniform() < 0.5) fill_with_anything(felt, 3 * rows);
    else
        for (size_t i = 0; i < 3 * rows; i++) felt[i] = (flinders_real)(uniform() + (i % 3 == 2 ? -9.8 : 0));
    record.plane = (int32_t)below(5) - 1;
    if (uniform() < 0.1) fill_with_anything(record.textbook, 81);
    if (uniform() < 0.1) record.rejected_beyond = anything();
    flinders_default_site(&site);
    site.strength = some_number(100), site.gain_sigma = some_number(0.1), site.inclination_deg = some_number(89);
    site.inclination_sigma_deg = some_number(2), site.alignment_sigma_deg = some_number(5), site.z_down = (int32_t)below(2);
    flinders_vertical_add(field, felt, rows, &record, &vertical);
    int status = flinders_at_site(field, rows, uniform() < 0.3 ? NULL : &vertical, &site, workspace, size, &record);
    REQUIRE(status >= 0 && status <= 9 && record.z_axis >= 0 && record.z_axis <= 2);
    REQUIRE(status || record.radius > 0);
    const int is_used = flinders_uses_strength(&record);
    REQUIRE(is_used == 0 || (is_used == 1 && record.site_strength == site.strength));
    status = flinders_plane_of(field, rows, centre, uniform() < 0.8 ? fitted->noise : anything(), workspace, size, &heights);
    REQUIRE(status >= 0 && status <= 9);
    free(felt), free(workspace);
}

/* List outliers among distances of any kind, in two parts, the second of which goes on where the first ends. */
static void list_outliers(size_t rows)
{
    const size_t half = below(rows + 1);
    unsigned char *far = need(rows), *out = need(rows), *scratch = need(rows);
    flinders_real *distances = need(rows * sizeof *distances);
    int64_t *first = need(rows * sizeof *first), *last = need(rows * sizeof *last), left = 0;
    flinders_outlier *runs = need(FLINDERS_OUTLIERS * sizeof *runs);
    const double share = uniform() * uniform();
    fill_with_anything(distances, rows);
    for (size_t i = 0; i < rows; i++) far[i] = uniform() < share;
    for (size_t i = 0; i < rows; i++) {
        first[i] = i > 0 ? last[i - 1] + 1 : 0;
        last[i] = first[i] + (uniform() < 0.1 ? (int64_t)below(20) : 0);
    }
    const int dense = flinders_dense(far, rows, uniform() < 0.9 ? rows : (size_t)(uniform() * 1e18), scratch);
    REQUIRE(dense >= 3 && dense <= FLINDERS_NO_RUN);
    flinders_left_out(far, rows, uniform() < 0.9 ? dense : (int32_t)below(100) - 50, out);
    for (size_t i = 0; i < rows; i++) {
        REQUIRE(out[i] <= 1 && out[i] >= far[i]);
        left += out[i];
    }
    size_t count = flinders_list_outliers(distances, out, half, first, last, distances, distances, runs, 0);
    count = flinders_list_outliers(distances + half, out + half, rows - half, first + half, last + half, NULL, NULL, runs,
                                   count);
    for (size_t i = 0; i < count; i++) {
        REQUIRE(runs[i].first <= runs[i].last && (i == 0 || runs[i].first > runs[i - 1].last));
        REQUIRE(runs[i].fitted <= runs[i].rows && runs[i].rows <= runs[i].last - runs[i].first + 1);
        left -= runs[i].fitted;
    }
    REQUIRE(left == 0 && count <= FLINDERS_OUTLIERS);
    free(far), free(out), free(scratch), free(distances), free(first), free(last), free(runs);
}

/* Compare two calibrations of anything. */
static void compare(const flinders_record *first, const flinders_record *second)
{
    const flinders_record *const records[2] = {first, second};
    flinders_calibrated both[2];
    flinders_difference apart;
    for (int i = 0; i < 2; i++) {
        memcpy(both[i].centre, records[i]->centre, sizeof both[i].centre);
        memcpy(both[i].shape, records[i]->shape, sizeof both[i].shape);
        memcpy(both[i].covariance, records[i]->covariance, sizeof both[i].covariance);
        both[i].strength = uniform() < 0.5 ? 0 : uniform() < 0.5 ? 50 : anything();
    }
    const int status = flinders_compare(both, both + 1, uniform() < 0.9 ? 60 : anything(), &apart);
    REQUIRE(status >= 0 && status <= 9 && apart.freedom >= 0 && apart.freedom <= 9);
    REQUIRE(!(apart.p_value < 0) && !(apart.p_value > 1));
    const int answer = flinders_holds(apart.worst_deg, apart.sigma_deg, apart.bound_deg, apart.p_value, 1);
    REQUIRE(answer >= FLINDERS_HOLDS && answer <= FLINDERS_CANNOT_TELL);
}

/* Renew the calibration of a record, or one of anything; returns 1 if that gave a calibration. */
static int renew(const flinders_real *field, const flinders_real *time, size_t rows, const flinders_record *record)
{
    const size_t size = flinders_workspace_size(rows);
    const flinders_options options = some_options();
    void *workspace = need(size);
    flinders_record renewed;
    flinders_earlier earlier;
    flinders_earlier_of(record->centre, record->shape, uniform() < 0.5 ? NULL : record->covariance, 0,
                        uniform() < 0.9 ? 1 : anything(), uniform() < 0.9 ? 0 : anything(), &earlier);
    if (uniform() < 0.1) fill_with_anything(earlier.parameters, 9);
    if (uniform() < 0.1) earlier.covariance[below(81)] = anything();
    if (uniform() < 0.1) fill_with_anything(earlier.covariance, 81);
    const int status = flinders_refresh(field, time, rows, &options, &earlier, workspace, size, &renewed);
    REQUIRE(status >= 0 && status <= 9 && status == renewed.status);
    REQUIRE(status || (isfinite(renewed.centre[0]) && isfinite(renewed.radius) && renewed.radius > 0));
    const flinders_real chance = flinders_soft_iron_p_value(&earlier, renewed.shape, renewed.textbook, renewed.covariance);
    REQUIRE(!(chance < 0) && !(chance > 1));
    flinders_turn_deg(field, rows, earlier.parameters + 3);
    compare(record, &renewed);
    free(workspace);
    return status == FLINDERS_OK;
}

/* Fit recordings one behind the other, each as by itself; returns how many gave a calibration. */
static int fit(size_t recordings)
{
    static const size_t ROWS[] = {1, 2, 9, 10, 11, 12, 13, 49, 50, 63, 64, 65, 99, 100, 101};
    size_t rows[4], longest = 0;
    int64_t offsets[5] = {0};
    int fitted = 0, worst = 0;
    for (size_t i = 0; i < recordings; i++) {
        rows[i] = ROWS[below(sizeof ROWS / sizeof *ROWS)];
        if (uniform() < 0.02) rows[i] = uniform() < 0.02 ? 20001 : 100 + below(1500);
        if (recordings > 1 && uniform() < 0.2) rows[i] = 0;
        offsets[i + 1] = offsets[i] + (int64_t)rows[i];
        longest = rows[i] > longest ? rows[i] : longest;
    }
    const size_t total = (size_t)offsets[recordings], size = flinders_workspace_size(longest);
    flinders_real *field = need(3 * total * sizeof *field), *time = need(total * sizeof *time);
    void *workspace = need(size);
    flinders_record *records = need(recordings * sizeof *records), single;
    const flinders_options options = some_options();
    const int is_timed = uniform() < 0.5;
    for (size_t i = 0; i < recordings; i++)
        if (rows[i]) fill(field + 3 * offsets[i], rows[i]);
    for (size_t row = 0; row < total; row++) time[row] = (flinders_real)row;
    if (uniform() < 0.05) fill_with_anything(time, total);
    const int status = flinders_fit_many(field, is_timed ? time : NULL, offsets, recordings, &options, workspace, size,
                                         records);
    for (size_t i = 0; i < recordings; i++) {
        const flinders_record *record = records + i;
        REQUIRE(record->status >= 0 && record->status <= 9);
        REQUIRE(record->status || (isfinite(record->centre[0]) && isfinite(record->radius) && record->radius > 0));
        worst = record->status > worst ? record->status : worst;
        fitted += record->status == FLINDERS_OK;
    }
    REQUIRE(status == worst);
    flinders_fit(field, is_timed ? time : NULL, rows[0], &options, workspace, size, &single);
    REQUIRE(memcmp(&single, records, sizeof single) == 0);
    const int told = flinders_drift(field, rows[0], records->centre, records->shape, options.dip_deg, workspace, size,
                                    &single);
    REQUIRE(told >= 0 && told <= 9);
    flinders_disturbance found;
    const int regressed = flinders_regress(field, time, rows[0], records->centre, records->shape,
                                           uniform() < 0.5 ? INFINITY : anything(), workspace, size, &found);
    REQUIRE(regressed >= 0 && regressed <= 9 && found.used <= (int64_t)rows[0]);
    if (uniform() < 0.3) fitted += renew(field, is_timed ? time : NULL, rows[0], records);
    ask_for_turns(field, rows[0], records, recordings);
    ask_for_a_plane();
    fit_level(field, is_timed ? time : NULL, rows[0], &options);
    cover(field, rows[0], records);
    look_for_swaps(field, rows[0]);
    place(field, rows[0], records);
    list_outliers(below(100) * below(100) + rows[0]);
    if (rows[0] == longest && longest)
        REQUIRE(flinders_fit(field, NULL, longest, &options, workspace, size - 1, &single) == FLINDERS_NO_WORKSPACE);
    free(field), free(time), free(workspace), free(records);
    return fitted;
}

/* Add, move, merge and solve sums of readings, or of anything; returns 1 if they gave a calibration. */
static int sum(void)
{
    flinders_sums sums, other;
    flinders_record record;
    const size_t rows = below(100) + 1;
    flinders_real *field = need(3 * rows * sizeof *field), origin[3] = {10, 20, 30}, scale = 64;
    if (uniform() < 0.2) fill_with_anything(origin, 3), scale = anything();
    fill(field, rows);
    flinders_sums_begin(&sums, uniform() < 0.5 ? origin : NULL, scale);
    flinders_sums_begin(&other, NULL, 1);
    flinders_sums_add(&sums, field, rows);
    flinders_sums_add(&other, field, rows / 2);
    if (uniform() < 0.1) fill_with_anything(sums.sums, 35);
    if (uniform() < 0.5) flinders_sums_move(&sums, origin, uniform() < 0.9 ? 32 : anything());
    flinders_sums_merge(&sums, &other);
    const int status = flinders_sums_solve(&sums, &record);
    REQUIRE(status >= 0 && status <= 9 && status == record.status);
    REQUIRE(status || (isfinite(record.centre[0]) && record.radius > 0));
    free(field);
    return status == FLINDERS_OK;
}

/* Ask a record of anything for distances and heading errors, and for bounds of any. */
static void ask(void)
{
    const size_t rows = below(70);
    flinders_real *field = need(3 * rows * sizeof *field), *out = need(rows * sizeof *out), bound;
    flinders_record record;
    memset(&record, 0, sizeof record);
    fill_with_anything(record.centre, 3);
    fill_with_anything(record.covariance, 81);
    fill_with_anything(record.shape, 6);
    if (uniform() < 0.5)
        for (int i = 0; i < 6; i++) record.shape[i] = i < 3 ? 50 : (flinders_real)uniform();
    if (uniform() < 0.5) fill_with_anything(field, 3 * rows);
    else if (rows) fill(field, rows);
    flinders_distances(field, rows, &record, out);
    flinders_heading_errors(&record, uniform() < 0.5 ? 60 : anything());
    flinders_heading_bound(record.shape, record.covariance, uniform() < 0.5 ? 60 : anything(), NULL, &bound);
    free(field), free(out);
}

/* A record of readings, and perhaps some of its bytes or numbers anything. */
static void some_record(flinders_record *record)
{
    const size_t rows = 10 + below(90), size = flinders_workspace_size(rows);
    flinders_real *field = need(3 * rows * sizeof *field);
    void *workspace = need(size);
    flinders_options options;
    flinders_default_options(&options);
    fill(field, rows);
    flinders_fit(field, NULL, rows, &options, workspace, size, record);
    if (uniform() < 0.3) flinders_clear_record(record);
    for (size_t times = below(20); times > 0; times--) {
        unsigned char *const bytes = (unsigned char *)record;
        bytes[below(sizeof *record)] = (unsigned char)below(256);
    }
    if (uniform() < 0.3) fill_with_anything(record->covariance, 81);
    if (uniform() < 0.2) fill_with_anything(record->centre, 9);
    record->plane = uniform() < 0.1 ? (int32_t)below(5) - 1 : 0;
    free(field), free(workspace);
}

/* Judge records of anything by requests of anything; returns 1 for a verdict that is no refusal. */
static int judge(void)
{
    flinders_record record;
    flinders_request request;
    flinders_judgement judgement;
    flinders_real quantities[FLINDERS_QUANTITIES], numbers[3], out[81];
    some_record(&record);
    flinders_default_request(&request);
    if (uniform() < 0.1) request.target_deg = anything();
    if (uniform() < 0.1) request.field_strength = anything();
    if (uniform() < 0.1) request.parameters = (int32_t)below(30) - 10;
    if (uniform() < 0.5) request.shrinks = 0;
    request.rotation = (int32_t)below(4), request.is_microtesla = (int32_t)below(2);
    const int status = flinders_judge(&record, &request, &judgement);
    REQUIRE(status >= 0 && status <= 9 && judgement.verdict >= 0 && judgement.verdict <= 3);
    REQUIRE(status == 0 || judgement.verdict == FLINDERS_REFUSES);
    for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++) {
        REQUIRE(judgement.severities[i] <= judgement.verdict && judgement.causes[i] <= FLINDERS_RULES_OF_A_FIT);
        REQUIRE(!judgement.severities[i] || judgement.shown[i] || judgement.causes[i]);
    }
    const flinders_real *const down = uniform() < 0.5 ? record.mean : NULL;
    flinders_tilted_error(record.shape, record.covariance, record.dip_deg, anything(), down, numbers, numbers + 1);
    flinders_uncorrected_error(record.centre, record.shape, record.dip_deg, down, numbers, numbers + 1);
    flinders_heading_bound(record.shape, record.covariance, record.dip_deg, down, numbers);
    if (uniform() < 0.05) flinders_attitude_limit(record.shape, record.covariance, record.dip_deg, 1, down, numbers);
    flinders_with_structure(record.shape, record.covariance, anything(), anything(), out);
    flinders_widening_by_few(anything());
    fill_with_anything(quantities, FLINDERS_QUANTITIES);
    for (int i = -1; i <= FLINDERS_RULES; i++) {
        const int severity = flinders_severity(i, quantities);
        REQUIRE(severity >= 0 && severity <= 3 && (i >= 0 || !flinders_rule_of(i)));
    }
    for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++) judgement.severities[i] = (uint8_t)below(4);
    flinders_causes(&judgement);
    return status == 0 && judgement.verdict < FLINDERS_REFUSES;
}

/* A belief of anything, or what a fit of few readings claims, some of whose directions nobody saw. */
static flinders_belief some_belief(void)
{
    flinders_belief belief;
    flinders_real counts[100], covariance[81] = {0}, shape[6], noise = (flinders_real)uniform();
    for (int i = 0; i < 6; i++) shape[i] = (flinders_real)(i < 3 ? 50 : uniform());
    for (int i = 0; i < 100; i++) counts[i] = (flinders_real)below(5);
    const size_t rank = below(10);
    for (size_t k = 0; k < rank; k++) {
        flinders_real root[9];
        for (int i = 0; i < 9; i++) root[i] = (flinders_real)(uniform() - 0.5);
        for (int i = 0; i < 81; i++) covariance[i] += root[i / 9] * root[i % 9];
    }
    const double kind = uniform();
    if (kind < 0.1) fill_with_anything(covariance, 81);
    else if (kind < 0.2) covariance[below(81)] = anything();
    else if (kind < 0.3) fill_with_anything(counts, 100);
    else if (kind < 0.4) fill_with_anything(shape, 6);
    else if (kind < 0.5) noise = anything();
    flinders_believe(shape, shape, covariance, noise, counts, &belief);
    if (uniform() < 0.1) belief.variance = anything();
    if (uniform() < 0.1) belief.readings = anything();
    return belief;
}

/* Whether an advice or a route is one: numbers where its status is FLINDERS_OK. */
static int is_answer(int status, flinders_real before, flinders_real after)
{
    return status >= 0 && status <= 9 && (status || (before >= 0 && after >= 0));
}

/* Ask for guidance, attitudes and a path. */
static void lead(void)
{
    flinders_belief belief = some_belief();
    flinders_goal goal;
    flinders_advice advice;
    flinders_route route;
    flinders_real down[3], at[3] = {(flinders_real)uniform(), 0, 1}, errors[3], *field;
    const size_t rows = below(900);
    flinders_default_goal(&goal);
    goal.is_attitude = (int32_t)below(2), goal.target_deg = (flinders_real)(10 * uniform());
    if (uniform() < 0.2) goal.dip_deg = anything(), goal.target_deg = anything();
    if (uniform() < 0.2) fill_with_anything(goal.down, 3);
    if (uniform() < 0.1) fill_with_anything(at, 3);
    if (uniform() < 0.3) {
        field = need(3 * rows * sizeof *field);
        if (rows) fill(field, rows);
        const int status = flinders_rough(field, rows, &belief);
        REQUIRE(status >= 0 && status <= 9 && (status || (isfinite(belief.variance) && belief.shape[0] > 0)));
        free(field);
    }
    int status = flinders_guidance(&belief, &goal, uniform() < 0.8 ? 0 : anything(), &advice);
    REQUIRE(is_answer(status, advice.worst_deg, advice.after_deg));
    status = flinders_path(&belief, &goal, at, uniform() < 0.8 ? 1 : anything(), &route);
    REQUIRE(is_answer(status, route.worst_deg, route.after_deg));
    REQUIRE(status ? route.count == 0 : route.count >= 1 && route.count <= 6);
    flinders_direction_errors(belief.shape, belief.covariance, at, 1, errors);
    for (int32_t frame = -1; frame < 3; frame++) {
        const int32_t pose = flinders_pose_towards(frame, &goal, advice.direction);
        REQUIRE(frame < 0 || frame > 1 || flinders_pose(frame, pose, down) >= 0);
    }
    REQUIRE(flinders_pose((int32_t)below(4), INT32_MIN + (int32_t)below(9), down) == -1);
}

/* Let a calibration keep itself, of readings and a clock of any kind. */
static void keep_calibrating(void)
{
    const size_t size = flinders_workspace_size(768);
    flinders_online *online = need(sizeof *online);
    void *workspace = need(size);
    flinders_real now = uniform() < 0.9 ? 0 : anything(), pace = (flinders_real)pow(10, 6 * uniform() - 3);
    flinders_online_begin(online);
    online->is_locked = uniform() < 0.1;
    if (uniform() < 0.3) flinders_online_expect_walk(online, anything(), anything());
    for (size_t blocks = 1 + below(4); blocks > 0; blocks--) {
        const size_t rows = 1 + below(uniform() < 0.02 ? 1000 : 150);
        flinders_real *field = need(3 * rows * sizeof *field), *time = need(rows * sizeof *time);
        fill(field, rows);
        for (size_t row = 0; row < rows; row++) {
            now += uniform() < 0.01 ? anything() : pace * (flinders_real)uniform();
            time[row] = now;
            if (!isfinite(now)) now = 0;
        }
        for (size_t row = 0; row < rows;) {
            int32_t events;
            const size_t added = flinders_online_add(online, field + 3 * row, time + row, rows - row, workspace, size, &events);
            REQUIRE(added > 0 && added <= rows - row && (events || added == rows - row));
            REQUIRE(online->kept >= 0 && online->kept <= 768 && online->tested >= 0 && online->tested <= online->kept);
            REQUIRE(online->doubtful >= -1 && online->doubtful <= online->kept);
            REQUIRE(online->state >= 0 && online->state <= 2);
            row += added;
        }
        flinders_online_claim claim;
        const int status = flinders_online_claim_at(online, uniform() < 0.9 ? now : anything(), &claim);
        REQUIRE(status == FLINDERS_OK || isnan(claim.worst_deg));
        REQUIRE(!(claim.worst_deg < 0) && !(claim.latest_deg < 0) && !(claim.walk < 0));
        REQUIRE(!(flinders_online_good_s(online) < 0));
        if (uniform() < 0.1) flinders_online_shift(online, uniform() < 0.9 ? 4096 : anything());
        if (uniform() < 0.2) flinders_online_adopt(online);
        if (uniform() < 0.2) flinders_online_take_back(online);
        if (uniform() < 0.1) {
            flinders_real covariance[81], parameters[9] = {1, 2, 3, 50, 50, 50, 0, 0, 0};
            for (int i = 0; i < 81; i++) covariance[i] = i % 10 ? 0 : (flinders_real)uniform();
            if (uniform() < 0.3) fill_with_anything(covariance, 81);
            if (uniform() < 0.3) fill_with_anything(parameters, 9);
            flinders_online_know(online, parameters, covariance, uniform() < 0.5 ? 1 : anything(), now);
        }
        free(field), free(time);
    }
    free(online), free(workspace);
}

int main(int count, char **arguments)
{
    const long calls = count > 1 ? atol(arguments[1]) : 1000;
    long fitted = 0;
    state = count > 2 ? (uint64_t)atol(arguments[2]) : 1;
    for (long i = 0; i < calls; i++) {
        const double kind = uniform();
        if (kind < 0.6) fitted += fit(1);
        else if (kind < 0.7) fitted += fit(1 + below(4));
        else if (kind < 0.8) fitted += sum();
        else if (kind < 0.88) judge();
        else if (kind < 0.94) ask();
        else if (kind < 0.985) lead();
        else keep_calibrating();
    }
    printf("%ld calls, %ld fitted\n", calls, fitted);
    return 0;
}
