"""The page that needs no program gives the numbers, the verdict and the sentences of the program.

One table holds both to each other: a formula, a rule or a sentence that changes on one side alone breaks a row of it.
"""

from __future__ import annotations

import base64
import math
from dataclasses import replace
from string import Formatter
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
from benchmarks.datasets import dataset
from benchmarks.page_verdict import asked, compared, page_answers, session_of, thinned
from tests.javascript import run
from tests.worlds import carried_about

import flinders
from flinders import simulate
from flinders.core.calibration_file import FindingRecord
from flinders.core.samples import Samples
from flinders.findings import Finding
from flinders.findings.catalogue import CATALOGUE, OF_A_FIT, QUANTITIES_OF_A_FIT
from flinders.live.evaluation import evaluate
from flinders.live.messages import SourceState
from flinders.native import build
from flinders.standalone import engine

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from benchmarks.page_verdict import Compared

    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal
    from flinders.live.session import LiveSession

try:
    build.library(target=build.WEB)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

GOALS: tuple[Goal, ...] = ("heading", "attitude")
ROWS = 600
ENGINE = 1e-9
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
        or row.reasons[0] != row.reasons[1]
        or not (math.isnan(row.claim) or abs(row.claim - 1.0) < CLAIM)
        or (row.verdicts[0] != "refused" and not row.engine_off < ENGINE)
    ]
    assert not off, off


def test_recordings_get_the_verdict_of_the_program(recordings: Callable[[str], Path]) -> None:
    samples = [thinned(flinders.read(recordings(name)), ROWS) for name in SHARED]
    rows = compared(SHARED, [session_of(each) for each in samples])
    assert not any(row.is_level for row in rows)
    assert {row.verdicts[0] for row in rows} == {"", "good", "limited", "refused"}, "and one gives no fit"
    held_together(rows)


def test_simulated_recordings_get_verdict_reasons_and_sentences_of_the_program() -> None:
    cases = worlds()
    rows = compared(list(cases), [session_of(samples) for samples in cases.values()])
    held_together(rows)
    unlike = [row for row in rows if row.method and row.sentences[0][1:] != row.sentences[1][1:]]
    assert not unlike, unlike
    assert {code for row in rows for code in row.reasons[1]} >= {
        *("too-few-samples", "no-rotation", "stale", "frozen-axis", "wrong-unit", "saturated", "outliers")
    }
    assert {code for row in rows for code, _ in row.findings[1]} >= {
        *("corrected-before", "coverage", "axis-swap", "inflation", "heading-error", "axis-ratio", "field-strength")
    }


def test_a_file_of_the_page_says_of_a_fit_what_the_program_says() -> None:
    cases = [session_of(samples) for samples in worlds().values()]
    checked = 0
    for session, page in zip(cases, page_answers(cases)["answers"], strict=True):
        if page["record"] is None:
            continue
        fit = evaluate(session).fit
        assert fit is not None
        records = msgspec.convert(page["record"]["findings"], tuple[FindingRecord, ...])
        loaded = [Finding.from_record(record, "page") for record in records]
        assert [finding.advice for finding in loaded] == [finding.advice for finding in fit.findings]
        assert [finding.follows_from for finding in loaded] == [finding.follows_from for finding in fit.findings]
        assert [finding.values.keys() for finding in loaded] == [finding.values.keys() for finding in fit.findings]
        checked += 1
    assert checked > 5


def test_a_level_turn_is_refused() -> None:
    (answer,) = page_answers([session_of(simulate.tumble(seed=1, n=800, motion="level").samples)])["answers"]
    assert answer["view"]["verdict"] == "refused"
    assert answer["view"]["offset"] is None
    assert answer["view"]["findings"][0]["advice"].endswith("flinders calibrate does")


TUMBLED = simulate.tumble(seed=3)
MOVED = replace(TUMBLED.sensor, offset=TUMBLED.sensor.offset + np.array([8.0, -5.0, 3.0]))


def renewals() -> dict[str, tuple[Samples, Fit]]:
    """Recordings of seconds, and an earlier calibration that each renews."""
    earlier = flinders.fit(TUMBLED.samples).with_name("monday.json")
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
        "of a known field": (wobble, known.with_name("known.json")),
        "no uncertainty": (wobble, bare.with_name("bare.json")),
        "level turn": (turn, earlier),
        "steel": (simulate.tumble(seed=4, motion="wobble", n=500, sensor=steel).samples, earlier),
        "outliers": (simulate.tumble(seed=4, motion="wobble", n=500, sensor=MOVED, outliers=0.04).samples, earlier),
        "end of range": (replace(wobble, field=np.minimum(wobble.field, top)), earlier),
        "too few": (wobble[:15], earlier),
        "at rest": (Samples(still, unit=wobble.unit, time=np.arange(100) / 50.0), earlier),
        "a tumble": (simulate.tumble(seed=6, n=1500, sensor=MOVED).samples, earlier),
    }


def test_the_page_renews_an_earlier_calibration_as_the_program_does() -> None:
    cases = renewals()
    sessions = [
        replace(session_of(thinned(samples)), previous=earlier, refreshes=True) for samples, earlier in cases.values()
    ]
    methods, codes = set(), set()
    for name, session, page in zip(cases, sessions, page_answers(sessions)["answers"], strict=True):
        program = evaluate(session)
        assert program.previous is not None
        assert page["previous"]["words"] == program.previous.words
        assert page["previous"]["change_deg"] == pytest.approx(program.previous.change_deg)
        assert [reason["code"] for reason in page["reasons"]] == [reason.code for reason in program.reasons], name
        if program.view is None:
            assert page["view"] is None, name
            continue
        drawn = msgspec.to_builtins(program.view)
        left_out: dict[str, Any] = {"findings": [], "guidance": None}  # a known shape makes opposite directions alike
        same({**page["view"], **left_out}, {**drawn, **left_out}, "view")
        found = [finding["code"] for finding in page["view"]["findings"]]
        assert found == [finding["code"] for finding in drawn["findings"]], name
        methods.add(page["view"]["method"])
        codes |= set(found)
    assert methods == {"refresh"}
    assert codes >= {"soft-iron-changed", "heading-error", "outliers", "scale-unknown"}


def test_the_page_says_what_chance_explains_of_a_difference_as_the_program_does() -> None:
    earlier = flinders.fit(TUMBLED.samples).with_name("monday.json")
    agrees, differs = (simulate.tumble(seed=8, n=1500, sensor=each).samples for each in (TUMBLED.sensor, MOVED))
    sessions = [replace(session_of(thinned(samples)), previous=earlier) for samples in (agrees, differs)]
    sessions.append(replace(sessions[1], target_deg=90.0))
    answers = page_answers(sessions)["answers"]
    states = [page["previous"] for page in answers]
    for session, state in zip(sessions, states, strict=True):
        program = evaluate(session).previous
        assert program is not None
        assert (state["name"], state["words"]) == (program.name, program.words)
        assert state["change_deg"] == pytest.approx(program.change_deg, rel=1e-6)
    assert [state["words"].split()[1] for state in states] == ["agrees", "contradicts", "differs"]


CLOSE = {
    "tiles_deg": (1e-3, 0.0),
    "tiles_seen": (0.0, 1.0),
    "counts": (0.0, 1.0),
    "before_deg": (0.0, 2e-4),
    "sigma_deg": (0.0, 2e-4),
    "bound_95": (0.01, 0.0),
    "any_attitude_deg": (1e-4, 0.0),
    "after_deg": (0.01, 0.0),
}
"""Relative and absolute tolerance of what is rounded on its way, or counted by cells on one side."""


def same(page: object, program: object, name: str) -> None:
    """Hold a part of the page's view to that of the program."""
    if isinstance(program, dict):
        assert isinstance(page, dict)
        assert set(page) == set(program), name
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


def test_the_page_draws_what_the_live_page_draws() -> None:
    samples = thinned(simulate.tumble(seed=7, n=600, motion="tilted", outliers=0.02).samples)
    sessions = [replace(session_of(samples, target_deg=0.5), goal=goal) for goal in GOALS]
    for session, answer in zip(sessions, page_answers(sessions)["answers"], strict=True):
        program = evaluate(session)
        same({**answer["view"], "findings": []}, {**msgspec.to_builtins(program.view), "findings": []}, "view")
        assert (answer["used"], answer["rejected"]) == (program.used, program.rejected)
        assert bool(answer["view"]["guidance"]["direction"]) == (session.goal == "attitude")


def test_the_page_leads_who_turns_the_sensor_as_the_live_page_does() -> None:
    level = simulate.tumble(seed=1, n=800, motion="level").samples
    cases = [
        simulate.tumble(seed=3, n=1500).samples[:100],
        simulate.tumble(seed=7, n=300, motion="tilted").samples,
        replace(level, field=level.field[:, [1, 2, 0]]),
    ]
    sessions = [followed(thinned(samples), goal) for samples in cases for goal in GOALS]
    for session, page in zip(sessions, page_answers(sessions)["answers"], strict=True):
        view = evaluate(session).view
        assert view is not None
        assert view.guidance is not None
        assert view.guidance.words.startswith("follow the arrow: ")
        same(page["view"]["guidance"], msgspec.to_builtins(view.guidance), "guidance")
        same(page["view"]["shown"], msgspec.to_builtins(view.shown), "shown")


def followed(samples: Samples, goal: Goal) -> LiveSession:
    """A session of a sensor that somebody turns."""
    session = replace(session_of(samples, target_deg=0.1), goal=goal)
    return replace(session, source=SourceState("sensor", "serial", "connected", ""))


NEVER_ON_THE_PAGE = frozenset({"level-plane", "mirrored-axes"})
"""Findings of what the page does not do: it fits no level turn, and maps no axes."""

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
    wasm = build.library(target=build.WEB).read_bytes()
    values, words, known = run(
        program, {"wasm": packed(wasm), "data": engine.data(), "asked": asked(session_of(samples))}
    )
    looked_for = [CATALOGUE[code] for code in OF_A_FIT if CATALOGUE[code].rule.compared <= set(known)]
    assert {"heading-error", "few-samples", "structure", "stale-repeats"} <= {row.code for row in looked_for}
    for row in looked_for:
        named = {name for _, name, _, _ in Formatter().parse(row.template) if name}
        assert row.code in NEVER_ON_THE_PAGE or named <= {*words, *values, *QUANTITIES_OF_A_FIT}, row.code
        assert row.code in NEVER_ON_THE_PAGE or {*row.names} <= {*values, *NEVER_THERE, *QUANTITIES_OF_A_FIT}, row.code


def packed(content: bytes) -> str:
    """Bytes as JSON has them."""
    return base64.b64encode(content).decode()


def test_the_engine_of_browsers_imports_nothing_and_exports_what_the_header_declares() -> None:
    program = """
const module = new WebAssembly.Module(Uint8Array.from(Buffer.from(given, "base64")));
return [WebAssembly.Module.imports(module), WebAssembly.Module.exports(module).map(({ name }) => name)];
"""
    imports, exports = run(program, packed(build.library(target=build.WEB).read_bytes()))
    assert imports == []
    assert set(exports) == {"memory", "_initialize", "__heap_base", *build.functions()}
