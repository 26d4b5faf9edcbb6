"""The page that needs no program gives the numbers, the verdict and the sentences of the program.

One table holds both to each other: a formula, a rule or a sentence that changes on one side alone breaks a row of it.
"""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from string import Formatter
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
import pytest
from benchmarks.datasets import dataset
from benchmarks.page_verdict import case_of, compared, page_answers, thinned
from tests.javascript import run
from tests.worlds import carried_about

import flinders
from flinders import simulate
from flinders.apps.live.guided import Session
from flinders.apps.live.standalone import engine
from flinders.comparison.comparison import compare
from flinders.core.calibration_file import FindingRecord
from flinders.core.samples import Samples
from flinders.findings import Finding
from flinders.findings.catalogue import CATALOGUE, ENGINE_FINDINGS, QUANTITIES_OF_A_FIT
from flinders.fitting.result import document_of, with_name
from flinders.geometry.sphere import tiles
from flinders.native import build
from flinders.report.view import view

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from benchmarks.page_verdict import Compared

    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

GOALS: tuple[Goal, ...] = ("heading", "attitude")
ROWS = 600
ENGINE = 1e-7
CLAIM = 1e-6

SHARED = (
    "aleksandrbazhin_ellipsoid/mag_out.txt",
    "ckexplorer_acc_mag/acc_mag_log.csv",
    "dronekit_log171_3mags/log171_MAG.csv",
    "dronekit_log171_3mags/log171_MAG2.csv",
    "fhoevi_ellipsoid/mag_out.txt",
    "hightower70_magcal/mag.txt",
    "jremington_icm20948/icm_20948_cal_acc.csv",
    "jremington_icm20948/icm_20948_cal_mag.csv",
    "jremington_icm20948/mag3_raw.csv",
    "jremington_mpu9250/acc.txt",
    "jremington_mpu9250/mag.txt",
    "leiria_robot/V_300_path1_LSM9DS0.npz",
    "leiria_robot/V_300_path1_MPU9150.npz",
    "michaelwro_fxos8700/mag-readings.txt",
    "pichim_betaflight/20231008_apex5_mag_gyro_dedup.csv",
    "pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv",
    "pichim_betaflight/20231015_ctzsnooze_PR_Cal_3.csv",
    "pichim_betaflight/CalCareful_2282320.csv",
    "pichim_betaflight/calTest1_198_253_-9.csv",
    "pichim_betaflight/calTest1_208_249_-2.csv",
    "px4_pyulog_cubeorange/vehicle_magnetometer.csv",
    "risherlock_handheld/raw_data.csv",
    "sunsided_hmc5883l/full-sphere.csv",
    "timspi_imu_gnss/imu_gnss_data.csv",
    "tomisuarez_qmc5883l/noisy_raw_data.csv",
    "uutzinger_gearvr/acc_data.txt",
)


def worlds() -> dict[str, Samples]:
    """Simulated recordings, each of which makes a part of the verdict speak."""
    tumble = simulate.tumble(seed=5, n=1000).samples
    field = tumble.field
    rng = np.random.default_rng(1)
    tilted = simulate.tumble(seed=7, n=300, motion="tilted")
    matrix, offset = tilted.sensor.correction
    passed = simulate.tumble(seed=0, n=1000, disturbances=[simulate.PassingMagnet(100.0)]).samples
    worlds = {
        "all around": tumble,
        "beginning": simulate.tumble(seed=3, n=1500).samples[:40],
        "too few": tumble[:8],
        "never upside down": tilted.samples,
        "banked turns": simulate.tumble(seed=1, n=1000, motion="flight").samples,
        "at rest": Samples([20.0, -10.0, 40.0] + 0.2 * rng.normal(size=(300, 3)), time=np.arange(300) / 50.0),
        "stale": replace(tumble, field=np.concatenate([field[:850], np.tile(field[850], (150, 1))])),
        "frozen": replace(tumble, field=np.where(np.arange(1000)[:, np.newaxis] < 800, field, field * [1, 0, 1])),
        "swapped sign": replace(
            tumble, field=np.where(np.arange(1000)[:, np.newaxis] < 500, field, field * [1, -1, 1])
        ),
        "end of range": replace(
            tumble, field=np.minimum(field, np.array([np.quantile(field[:, 0], 0.93), np.inf, np.inf]))
        ),
        "milligauss": replace(tumble, field=10.0 * field),
        "corrected before": Samples((tilted.samples.field - offset) @ np.transpose(matrix), unit=tumble.unit),
        "outliers": simulate.tumble(seed=0, n=1000, outliers=0.02).samples,
        "carried about": carried_about(4, varies=0.2, turns=3),
        "a break on the way": carried_about(39, varies=0.35, turns=1, noise=1.5),
        "passing magnet": passed,
        "clock set back": replace(passed, time=np.arange(1000) / 50.0 - 1000.0 * (np.arange(1000) >= 500)),
        "step": simulate.tumble(seed=0, n=1000, disturbances=[simulate.Step(4.0, at=0.7)]).samples,
        "motor": simulate.tumble(seed=0, n=1500, disturbances=[simulate.MotorCurrent(0.2)]).samples,
        "coarse": dataset("60 coarse samples", trial=0, sigma=0.5).samples,
        "strong iron": dataset("strong iron", trial=0, sigma=0.5).samples,
    }
    return {name: thinned(samples) for name, samples in worlds.items()}


def held_together(rows: list[Compared]) -> None:
    """Hold page and program to each other, and name every row that is off."""
    off = [
        row
        for row in rows
        if row.verdicts[0] != row.verdicts[1]
        or row.findings[0] != row.findings[1]
        or not (math.isnan(row.claim) or abs(row.claim - 1.0) < CLAIM)
        or (row.verdicts[0] != "refused" and not row.engine_off < ENGINE)
    ]
    assert not off, off


def test_recordings_get_the_verdict_of_the_program(recordings: Callable[[str], Path]) -> None:
    samples = [thinned(flinders.read(recordings(name)), ROWS) for name in SHARED]
    rows = compared(SHARED, [case_of(each) for each in samples])
    assert {row.verdicts[0] for row in rows} == {"", "good", "limited", "refused"}, "and one gives no fit"
    held_together(rows)


def test_simulated_recordings_get_verdict_and_sentences_of_the_program() -> None:
    cases = worlds()
    rows = compared(list(cases), [case_of(samples) for samples in cases.values()])
    held_together(rows)
    unlike = [row for row in rows if row.method and row.sentences[0][1:] != row.sentences[1][1:]]
    assert not unlike, unlike
    assert {code for row in rows for code in row.reasons} >= {
        *("too-few-samples", "no-rotation", "stale", "frozen-axis", "wrong-unit", "saturated", "outliers")
    }
    assert {code for row in rows for code, _ in row.findings[1]} >= {
        *("corrected-before", "coverage", "axis-swap", "inflation", "heading-error", "axis-ratio", "field-strength")
    }


def test_a_file_of_the_page_says_of_a_fit_what_the_program_says() -> None:
    cases = [case_of(samples) for samples in worlds().values()]
    checked = 0
    for case, page in zip(cases, page_answers(cases)["answers"], strict=True):
        if page["record"] is None:
            continue
        fit = case.fit
        assert fit is not None
        records = msgspec.convert(page["record"]["findings"], tuple[FindingRecord, ...])
        loaded = [Finding.from_record(record, "page") for record in records]
        assert [finding.advice for finding in loaded] == [finding.advice for finding in fit.findings]
        assert [finding.follows_from for finding in loaded] == [finding.follows_from for finding in fit.findings]
        assert [finding.values.keys() for finding in loaded] == [finding.values.keys() for finding in fit.findings]
        checked += 1
    assert checked > 5


def level(dip_deg: float = 60.0, noise: float = 0.5, *, degrees: float = 360.0, sway_deg: float = 0.0) -> Samples:
    """Readings of a turn that is level but for its sway, by a sensor with iron; 800 in 16 s."""
    rng, time, dip = np.random.default_rng(7), np.arange(800) / 50.0, math.radians(dip_deg)
    heading, roll = np.radians(degrees) * time / 16.0, np.radians(sway_deg) * np.sin(2.0 * time)
    north, east = math.cos(dip) * np.cos(heading), -math.cos(dip) * np.sin(heading)
    right, down = np.cos(roll) * east + np.sin(roll) * math.sin(dip), np.cos(roll) * math.sin(dip) - np.sin(roll) * east
    shape = 50.0 * np.array([[1.02, 0.05, -0.04], [0.05, 0.97, 0.03], [-0.04, 0.03, 1.01]])
    field = np.stack([north, right, down], axis=1) @ shape + [20.0, -35.0, 60.0]
    return Samples(field + noise * rng.normal(size=(800, 3)), unit=flinders.Unit.of("uT"), time=time)


def turns() -> dict[str, Samples]:
    """Level turns, of which some are whole, and some leave their plane."""
    rng, whole = np.random.default_rng(3), level()
    field, passing = whole.field, np.outer(np.exp(-(((np.arange(800) - 400) / 15.0) ** 2)), [30.0, -20.0, 15.0])
    stray = np.where(rng.random((800, 1)) < 0.03, 20.0 * rng.normal(size=(800, 3)), 0.0)
    still = np.tile(field[-1], (300, 1)) + 0.5 * rng.normal(size=(300, 3))
    return {
        "whole": whole,
        "flat field": level(5.0),
        "steep field": level(75.0),
        "quiet": level(noise=0.05),
        "noisy": level(noise=2.0),
        "half": level(degrees=180.0),
        "a quarter": level(degrees=90.0),
        "two turns": level(degrees=720.0),
        "sways": level(sway_deg=0.5, degrees=720.0),
        "sways more": level(sway_deg=2.0, degrees=720.0),
        "rolls": level(sway_deg=8.0, degrees=720.0),
        "strays": replace(whole, field=field + stray),
        "magnet": replace(whole, field=field + passing),
        "magnet at its height": replace(whole, field=field + passing * [1.0, 1.0, 0.0]),
        "rest": Samples(np.concatenate([field, still]), unit=whole.unit, time=np.arange(1100) / 50.0),
        "end of range": replace(whole, field=np.minimum(field, [40.0, np.inf, np.inf])),
        "swapped sign": replace(whole, field=np.where(np.arange(800)[:, None] < 400, field, field * [1.0, -1.0, 1.0])),
        "coarse": replace(whole, field=np.round(field / 1.5) * 1.5),
        "counts": replace(whole, field=6.6 * field, unit=flinders.Unit.of("counts")),
        "untimed": replace(whole, time=None),
        "few": whole[::40],
    }


def test_level_turns_get_verdict_numbers_and_sentences_of_the_program() -> None:
    cases = turns()
    rows = compared(list(cases), [case_of(samples) for samples in cases.values()])
    held_together(rows)
    assert {row.name for row in rows if row.method != "level"} == {"rolls"}
    unlike = [row for row in rows if row.sentences[0][1:] != row.sentences[1][1:]]
    assert not unlike, unlike
    assert {row.verdicts[0] for row in rows if row.method == "level"} == {"limited", "refused"}
    assert {"level-plane", "outliers", "saturated", "at-rest"} <= {code for row in rows for code, _ in row.findings[1]}


def felt(samples: Samples, slope_deg: float, *, up: float = -9.81) -> Samples:
    """What an accelerometer measures with a level turn on a slope; of a few readings nothing."""
    heading, slope = np.radians(360.0) * np.arange(len(samples)) / len(samples), math.radians(slope_deg)
    across = np.stack([np.cos(heading), -np.sin(heading), np.zeros(len(samples))], axis=1) * math.sin(slope)
    acceleration = up * (across + np.array([0.0, 0.0, math.cos(slope)]))
    acceleration[::50] = np.nan
    return replace(samples, acceleration=acceleration)


def test_an_accelerometer_shows_slopes_and_where_z_points_as_in_the_program() -> None:
    known = flinders.Site(inclination_deg=60.0, inclination_sigma_deg=1.0)
    whole, rest, ends = (turns()[name] for name in ("whole", "rest", "end of range"))
    of = {
        "level": (felt(whole, 0.0), None), "slope": (felt(whole, 5.0), None), "rest": (felt(rest, 3.0), None),
        "end of range": (felt(ends, 5.0), None), "upside down": (felt(whole, 0.0, up=9.81), None),
        "nothing felt at a place": (whole, known), "slope at a place": (felt(whole, 5.0), known),
        "upside down at a place": (felt(whole, 0.0, up=9.81), known),
    }  # fmt: skip
    cases = [replace(case_of(samples), samples=samples, site=site) for samples, site in of.values()]
    rows = compared(list(of), cases)
    held_together(rows)
    unlike = [(row.name, row.sentences) for row in rows if row.sentences[0] != row.sentences[1]]
    assert not unlike, unlike
    records = [answer["record"] for answer in page_answers(cases)["answers"]]
    assert [each and each["z_down"] for each in records] == [
        case.fit and case.fit.evidence.z_down if record else None for case, record in zip(cases, records, strict=True)
    ]
    assert {each["z_down"] for each in records if each} == {True, False, None}


def test_level_turns_are_judged_at_the_dip_of_the_place() -> None:
    dips = (-70.0, 5.0, 75.0)
    cases = [replace(case_of(level(dip)), site=flinders.Site(inclination_deg=dip)) for dip in dips]
    rows = compared([f"{dip}" for dip in dips], cases)
    held_together(rows)
    assert all(row.method == "level" and row.sentences[0][1:] == row.sentences[1][1:] for row in rows), rows


@pytest.mark.parametrize("goal", GOALS)
def test_the_page_draws_where_a_level_turn_is_good(goal: Goal) -> None:
    cases = [case_of(turns()[name], goal=goal) for name in ("whole", "magnet", "flat field")]
    for answer in page_answers(cases)["answers"]:
        errors, words = answer["view"]["level_deg"], answer["view"]["guidance"]["words"]
        assert answer["view"]["guidance"]["direction"] is None
        if goal == "attitude":
            assert errors is None
            assert "upside down" in words
            continue
        assert "upside down" not in words
        known = [error for error in errors if error is not None]
        assert 20 < len(known) < 100
        assert max(known) == pytest.approx(answer["view"]["heading_error_deg"]["worst"], rel=0.01)


def test_a_file_of_a_level_turn_says_that_it_is_one() -> None:
    case = case_of(level())
    (page,) = page_answers([case])["answers"]
    assert case.fit is not None
    own = msgspec.to_builtins(document_of(case.fit).fit)
    assert (page["record"]["plane"], page["record"]["z_down"]) == (own["plane"], own["z_down"]) == ("xy", True)
    assert page["record"].keys() == own.keys() - {"good_until"}  # made anew when a file is read


TUMBLED = simulate.tumble(seed=3)
MOVED = replace(TUMBLED.sensor, offset=TUMBLED.sensor.offset + np.array([8.0, -5.0, 3.0]))


def renewals() -> dict[str, tuple[Samples, Fit]]:
    """Recordings of seconds, and an earlier calibration that each renews."""
    earlier = with_name(flinders.fit(TUMBLED.samples), "monday.json")
    known = flinders.fit(TUMBLED.samples, site=flinders.Site(strength=50.0, inclination_deg=-66.0))
    bare = replace(earlier, claim=replace(earlier.claim, covariance=np.zeros((9, 9))))
    bent = MOVED.matrix @ np.diag([1.1, 1.0, 0.93])
    steel = replace(MOVED, matrix=(bent + bent.T) / 2.0)
    wobble, turn = (
        simulate.tumble(seed=4, motion=motion, n=500, sensor=MOVED).samples for motion in ("wobble", "level")
    )
    still = np.random.default_rng(1).normal(wobble.field[0], 0.1, (100, 3))
    top = np.array([np.quantile(wobble.field[:, 0], 0.93), np.inf, np.inf])
    return {
        "wobble": (wobble, earlier),
        "of a known field": (wobble, with_name(known, "known.json")),
        "no uncertainty": (wobble, with_name(bare, "bare.json")),
        "level turn": (turn, earlier),
        "steel": (simulate.tumble(seed=4, motion="wobble", n=500, sensor=steel).samples, earlier),
        "outliers": (simulate.tumble(seed=4, motion="wobble", n=500, sensor=MOVED, outliers=0.04).samples, earlier),
        "end of range": (replace(wobble, field=np.minimum(wobble.field, top)), earlier),
        "too few": (wobble[:15], earlier),
        "at rest": (Samples(still, unit=wobble.unit, time=np.arange(100) / 50.0), earlier),
        "a tumble": (simulate.tumble(seed=6, n=1500, sensor=MOVED).samples, earlier),
    }


def test_the_page_renews_an_earlier_calibration_as_the_program_does() -> None:
    renewed = renewals()
    cases = [
        replace(case_of(thinned(samples)), previous=earlier, is_renewed=True) for samples, earlier in renewed.values()
    ]
    methods, codes = set(), set()
    for name, case, page in zip(renewed, cases, page_answers(cases)["answers"], strict=True):
        fit = case.fit
        if fit is None:
            assert page["view"] is None, name
            continue
        changed = fit.evidence.diagnosis.refreshed
        assert changed is not None
        expected = None if fit.verdict == "refused" else pytest.approx(changed.heading_change_deg)
        assert page["previous"]["change_deg"] == expected, name
        drawn = msgspec.to_builtins(view(fit, case.samples))
        left_out: dict[str, Any] = {"findings": [], "guidance": None}  # a known shape makes opposite directions alike
        same({**page["view"], **left_out}, {**drawn, **left_out}, "view")
        found = [finding["code"] for finding in page["view"]["findings"]]
        assert found == [finding["code"] for finding in drawn["findings"]], name
        methods.add(page["view"]["method"])
        codes |= set(found)
    assert methods == {"refresh"}
    assert codes >= {"soft-iron-changed", "heading-error", "outliers", "scale-unknown"}


SAID: Final = {"holds": "it still holds: ", "fails": "it no longer holds: ", "cannot-tell": "too little is known yet "}
"""How the page begins each answer."""


def test_the_page_answers_whether_an_earlier_calibration_holds_as_the_program_does() -> None:
    earlier = with_name(flinders.fit(TUMBLED.samples), "monday.json")
    agrees, differs = (simulate.tumble(seed=8, n=1500, sensor=each).samples for each in (TUMBLED.sensor, MOVED))
    cases = [replace(case_of(thinned(samples)), previous=earlier) for samples in (agrees, differs)]
    cases.append(replace(cases[1], target_deg=90.0))
    states = [page["previous"] for page in page_answers(cases)["answers"]]
    for case, state in zip(cases, states, strict=True):
        assert case.fit is not None
        apart = compare(earlier, case.fit, dip_deg=case.fit.claim.dip_deg, target_deg=case.target_deg)
        assert state["words"].startswith(SAID[apart.answer])
        assert state["change_deg"] == pytest.approx(apart.heading_difference_deg.worst, rel=1e-6)
    assert [state["words"].split()[1] for state in states] == ["still", "no", "still"]


CLOSE = {
    "tiles_deg": (1e-3, 0.0),
    "tiles_seen": (0.0, 1.0),
    "counts": (0.0, 1.0),
    "before_deg": (0.0, 2e-4),
    "sigma_deg": (0.0, 2e-4),
    "level_deg": (0.0, 2e-4),
    "bound_95": (0.01, 0.0),
    "any_attitude_deg": (1e-4, 0.0),
    "after_deg": (0.01, 0.0),
}
"""Relative and absolute tolerance of what is rounded on its way, or counted by cells on one side."""


PAGE_ALONE: Final = frozenset({"level_deg"})
"""Of the view: what a report does not draw."""


def same(page: object, program: object, name: str) -> None:
    """Hold a part of the page's view to that of the program."""
    if isinstance(program, dict):
        assert isinstance(page, dict)
        assert set(page) - PAGE_ALONE == set(program), name
        for key, value in program.items():
            same(page[key], value, name if name in CLOSE else key)
    elif name == "sentence":  # it has the bound of 95 %
        assert str(page).partition("(")[0] == str(program).partition("(")[0]
    elif program is None or isinstance(program, str | bool):
        assert page == program, name
    else:
        relative, absolute = CLOSE.get(name, (1e-9, 1e-12))
        own, other = np.array(page, float), np.array(program, float)
        np.testing.assert_allclose(own, other, rtol=relative, atol=absolute, err_msg=name)


def test_the_page_draws_what_the_report_draws() -> None:
    samples = thinned(simulate.tumble(seed=7, n=600, motion="tilted", outliers=0.02).samples)
    cases = [case_of(samples, target_deg=1.0, goal=goal) for goal in GOALS]
    answers = page_answers(cases)["answers"]
    for case, answer in zip(cases, answers, strict=True):
        assert case.fit is not None
        program = view(case.fit, case.samples, goal=case.goal)
        same({**answer["view"], "findings": []}, {**msgspec.to_builtins(program), "findings": []}, "view")
        used = sum(program.tiles_seen)
        assert (answer["used"], answer["rejected"]) == (used, len(samples) - used)
    assert answers[-1]["view"]["guidance"]["direction"]  # of an attitude that was never taken


def test_the_page_leads_who_turns_the_sensor_as_a_session_does() -> None:
    level = simulate.tumble(seed=1, n=800, motion="level").samples
    turned = [
        simulate.tumble(seed=3, n=1500).samples[:100],
        simulate.tumble(seed=7, n=300, motion="tilted").samples,
        replace(level, field=level.field[:, [1, 2, 0]]),
    ]
    cases = [case_of(thinned(samples), 0.1, goal, is_followed=True) for samples in turned for goal in GOALS]
    for case, page in zip(cases, page_answers(cases)["answers"], strict=True):
        session = Session(target_deg=case.target_deg, goal=case.goal, unit="uT")
        state = session.add(case.samples.field, time=case.samples.time)
        guidance = page["view"]["guidance"]
        assert state.direction is not None
        assert guidance["is_path"]
        assert guidance["words"] == f"follow the arrow: {state.turn}"
        np.testing.assert_allclose(guidance["direction"], state.direction, rtol=1e-9, atol=1e-12)


NEVER_ON_THE_PAGE = frozenset({"mirrored-axes"})
"""A finding of what the page does not do: it maps no axes."""

NEVER_THERE = frozenset({"halves_ratio", "differ_deg"})
"""Values that are no number on the page: it compares neither halves of a recording nor several recordings."""


def test_the_page_knows_every_word_of_a_finding_that_it_looks_for() -> None:
    samples = simulate.tumble(seed=1, n=100).samples
    program = """
const modules = await Promise.all(["fit.js", "findings.js", "engine.js"].map(load));
const [{ fitOf }, { NAMES }, { loadEngine }] = modules;
const loaded = await loadEngine(Uint8Array.from(Buffer.from(given.wasm, "base64")), given.data.layouts);
const field = new Float64Array(Uint8Array.from(Buffer.from(given.asked.field, "base64")).buffer);
const { quantities } = fitOf(loaded, given.data, { ...given.asked, field, time: null });
return [NAMES.values, NAMES.words, Object.keys(quantities).filter((name) => !Number.isNaN(quantities[name]))];
"""
    wasm = build.library(target=build.WEB_PLATFORM).read_bytes()
    values, words, known = run(program, {"wasm": packed(wasm), "data": engine.data(), "asked": case_of(samples).asked})
    looked_for = [CATALOGUE[code] for code in ENGINE_FINDINGS if CATALOGUE[code].rule.compared_quantities <= set(known)]
    assert {"heading-error", "few-samples", "structure", "stale-repeats"} <= {row.code for row in looked_for}
    for row in looked_for:
        named = {name for _, name, _, _ in Formatter().parse(row.template) if name}
        assert row.code in NEVER_ON_THE_PAGE or named <= {*words, *values, *QUANTITIES_OF_A_FIT}, row.code
        assert row.code in NEVER_ON_THE_PAGE or {*row.names} <= {*values, *NEVER_THERE, *QUANTITIES_OF_A_FIT}, row.code


def test_the_sphere_has_the_tiles_of_the_program() -> None:
    found = run('return (await load("tiles.js")).tiles();', {})
    np.testing.assert_allclose(np.reshape(found["centres"], (-1, 3)), tiles().centres, atol=1e-12)
    for corners, own in zip(found["corners"], tiles().polygons(), strict=True):
        cosines = np.reshape(corners, (-1, 3)) @ own.T
        np.testing.assert_allclose(cosines.max(axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(cosines.max(axis=0), 1.0, atol=1e-12)


def packed(content: bytes) -> str:
    """Bytes as JSON has them."""
    return base64.b64encode(content).decode()


def test_the_engine_of_browsers_imports_nothing_and_exports_what_the_page_calls() -> None:
    program = """
const module = new WebAssembly.Module(Uint8Array.from(Buffer.from(given, "base64")));
return [WebAssembly.Module.imports(module), WebAssembly.Module.exports(module).map(({ name }) => name)];
"""
    imports, exports = run(program, packed(build.library(target=build.WEB_PLATFORM).read_bytes()))
    assert imports == []
    assert set(exports) == {"memory", "_initialize", "__heap_base", *build.page_functions()}
