"""The page without a program knows the field of a place, and lets it count in a fit, as the program does."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.level import Turned
from benchmarks.page_verdict import compared, page_answers, session_of, site_of
from flinders.live.evaluation import evaluate
from flinders.live.session import LiveSession, Requested, step
from tests.agreement.test_page_engine import held_together, packed, same
from tests.javascript import run

from flinders import simulate
from flinders.core.geomag import newest_model, site_field
from flinders.core.samples import Samples
from flinders.errors import UsageError
from flinders.estimators import Readings
from flinders.estimators.known_dip import sited
from flinders.estimators.level import Level
from flinders.fitting.record import record_of
from flinders.likelihood.site_field import Site
from flinders.live.messages import parse
from flinders.native import build
from flinders.standalone import engine
from flinders.standalone.package import session_rules

if TYPE_CHECKING:
    from flinders.native.engine import Records

try:
    build.library(target=build.WEB)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

PLACE: Final = {"type": "place", "latitude_deg": 48.2, "longitude_deg": 16.4, "year": 2026.9}
FIELDS: Final = """
const { siteField } = await load("geomag.js");
return given.places.map((place) => Object.values(siteField(given.model, ...place)));
"""


def test_the_model_of_the_page_is_that_of_the_program() -> None:
    """At the poles, near them, at the antimeridian and all over the earth, through the five years of the model."""
    latitudes = (-90.0, -89.9999, -77.0, -45.0, -0.001, 0.0, 33.3, 66.6, 89.0, 90.0)
    longitudes = (-180.0, -179.999, -97.0, 0.0, 45.5, 179.999, 180.0, 270.0, 360.0)
    places = [(lat, long, year) for lat in latitudes for long in longitudes for year in (2025.0, 2026.9, 2030.0)]
    found = np.array(run(FIELDS, {"places": places, "model": newest_model()}))
    fields = [site_field(latitude, longitude, year=year) for latitude, longitude, year in places]
    expected = np.array([(field.strength, field.inclination_deg, field.declination_deg) for field in fields])
    npt.assert_allclose(found[:, 0], expected[:, 0], rtol=1e-9)
    npt.assert_allclose(found[:, 1], expected[:, 1], atol=1e-6)
    turned = (found[:, 2] - expected[:, 2] + 180.0) % 360.0 - 180.0
    npt.assert_allclose(turned, 0.0, atol=1e-6)


def test_the_coefficients_take_few_bytes() -> None:
    assert len(json.dumps(newest_model(), separators=(",", ":"))) < 2500


ANSWERS: Final = """
const { Session } = await load("session.js");
return given.commands.map((command) => {
    const session = new Session(given.rules);
    return [session.requested(1, command)[0], session.judgedDip];
});
"""


def answered(command: dict[str, Any]) -> tuple[str, float | None]:
    """What the live page answers to a place, and the dip that it judges at then."""
    try:
        session, (notice,) = step(LiveSession(), Requested(1.0, parse(json.dumps(command))))
    except UsageError as refused:
        return refused.message, None
    return notice.words, session.dip_deg


def test_a_place_is_answered_as_on_the_live_page() -> None:
    places = ((48.2, 16.4), (-33.9, 151.2), (0.0, -179.99), (86.0, 164.0), (95.0, 10.0), (-122.3, 47.6), (10.0, 400.0))
    commands = [{**PLACE, "latitude_deg": latitude, "longitude_deg": longitude} for latitude, longitude in places]
    answers = run(ANSWERS, {"commands": commands, "rules": session_rules()})
    for command, (notice, (dip_deg, is_assumed)) in zip(commands, answers, strict=True):
        words, expected = answered(command)
        assert notice["words"] == words
        assert notice["severity"] == ("warning" if expected is None else "info")
        assert (dip_deg, is_assumed) == ((60.0, True) if expected is None else (expected, False))


def test_a_year_without_a_model_on_the_page_is_refused() -> None:
    commands = [{**PLACE, "year": year} for year in (2019.5, 2024.999, 2030.001)]
    for notice, (_, is_assumed) in run(ANSWERS, {"commands": commands, "rules": session_rules()}):
        assert notice["severity"] == "warning"
        assert "WMM-2025, from 2025 to 2030" in notice["words"]
        assert is_assumed


ASKED: Final = """
const { Session } = await load("session.js");
return given.units.map((inside) => {
    const session = new Session(given.rules);
    const rows = { time: Float64Array.of(0, 1), field: new Float64Array(6) };
    const unit = { inside, recorded: inside, scale: 1 };
    session.arrived(1, rows, unit);
    session.requested(1, given.place);
    session.requested(2, { type: "clear" });
    session.arrived(3, rows, unit);
    return session.task(9).site;
});
"""


def test_the_strength_of_the_place_counts_for_readings_in_a_true_unit() -> None:
    """Also after a new start; the dip, to a tenth of a degree, is judged at and no more, as on the live page."""
    in_microtesla, in_counts = run(ASKED, {"units": ["uT", "counts"], "rules": session_rules(), "place": PLACE})
    session = placed(simulate.tumble(seed=1, n=60).samples)
    expected = site_of((Site.stated(session.shown.known_site, inclination_deg=session.dip_deg) or Site()).evidence)
    assert expected is not None
    assert (in_microtesla["inclination_deg"], expected["inclination_deg"]) == (None, None)
    same({**in_microtesla, "inclination_sigma_deg": None}, expected, "site")
    assert in_counts is None


OWN: Final = """
const { Session } = await load("session.js");
const session = new Session(given.rules);
session.live.site = given.site;
const before = [session.judgedDip, session.task(1).site];
session.requested(1, { type: "dip", deg: 40 });
return [...before, session.judgedDip, session.task(1).site];
"""


def test_dip_and_strength_that_a_log_states_count_until_a_dip_is_typed() -> None:
    """In counts the dip alone."""
    site = {"strength": 50.0, "gain_sigma": 0.05, "inclination_deg": 66.62, "inclination_sigma_deg": 1.0}
    own, known, typed, nothing = run(OWN, {"rules": session_rules(), "site": site})
    assert (own, known) == ([66.62, False], {**site, "strength": None})
    assert (typed, nothing) == ([40, False], None)


def placed(samples: Samples, **place: float) -> LiveSession:
    """A session of readings that have ended, at a place."""
    session, _ = step(session_of(samples), Requested(1e9, parse(json.dumps({**PLACE, **place}))))
    return session


def test_a_tumble_at_a_place_gets_numbers_verdict_and_sentences_of_the_program() -> None:
    tilted = simulate.tumble(seed=7, n=300, motion="tilted").samples
    cases = {
        "all around": simulate.tumble(seed=5, n=1000).samples,
        "never upside down": tilted,
        "outliers": simulate.tumble(seed=0, n=1000, outliers=0.02).samples,
        "another unit": replace(tilted, field=10.0 * tilted.field),
        "counts": Samples(100.0 * tilted.field),
        "structure": simulate.tumble(seed=0, n=1500, disturbances=[simulate.MotorCurrent(0.2)]).samples,
        "few": tilted[:60],
    }
    sessions = [placed(samples) for samples in cases.values()]
    rows = compared(list(cases), sessions)
    held_together(rows)
    unlike = [row for row in rows if row.method and row.sentences[0][1:] != row.sentences[1][1:]]
    assert not unlike, unlike
    told = {row.name: {code for code, _ in row.findings[1]} for row in rows}
    assert {name for name, codes in told.items() if "strength-differs" in codes} == {"another unit"}
    assert {name for name, codes in told.items() if "scale-unknown" in codes} == {"another unit", "counts"}
    for session, answer in zip(sessions, page_answers(sessions)["answers"], strict=True):
        program = evaluate(session)
        assert program.view is not None
        for name in ("field_strength", "field_strength_known", "offset", "offset_sigma", "matrix", "matrix_sigma"):
            same(answer["view"][name], getattr(program.view, name), name)
        same(answer["view"]["shown"], msgspec.to_builtins(program.view.shown), "shown")


LEVEL: Final = """
const [{ loadEngine }] = await Promise.all(["engine.js"].map(load));
const engine = await loadEngine(Uint8Array.from(Buffer.from(given.wasm, "base64")), given.data.layouts);
const filled = (known) => Object.fromEntries(Object.entries(known).map(([name, value]) => [name, value ?? NaN]));
return given.turns.map(({ field, record, site }) => {
    const placed = engine.atSite(Float64Array.from(field), filled(record), site);
    return { ...placed, isUsed: engine.usesStrength(placed) };
});
"""


def as_json(record: Records) -> dict[str, Any]:
    """Fields of a record that a site counts in; None is NaN."""
    names = ("centre", "shape", "radius", "covariance", "textbook", "noise", "rejected_beyond", "dip_deg", "plane")
    values = {name: record[name].tolist() for name in names}
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in values.items()}


def test_a_level_turn_at_a_place_is_where_the_program_puts_it() -> None:
    """By the page's engine, from the record of a turn and the readings of that."""
    turns, expected = [], []
    for number, alignment_deg in ((1, None), (2, 2.0), (3, 5.0)):
        truth, site = Turned(mounted_deg=2.0).record(number, 300)
        readings = Readings.of(replace(truth.samples, acceleration=None)).fitted()
        alone = Level(dip_deg=60.0).estimate(readings)
        record = record_of(alone, readings.statistics)
        record["rejected_beyond"] = alone.rejected_beyond if np.isfinite(alone.rejected_beyond) else 0.0
        asked = {**(site_of(site) or {}), "alignment_sigma_deg": alignment_deg}
        turns.append({"field": readings.thinned(20_000).ravel().tolist(), "record": as_json(record), "site": asked})
        expected.append(sited(alone, readings, site, dip_deg=60.0, alignment_sigma_deg=alignment_deg))
    wasm = packed(build.library(target=build.WEB).read_bytes())
    for page, program in zip(run(LEVEL, {"turns": turns, "wasm": wasm, "data": engine.data()}), expected, strict=True):
        parameters = np.array([*page["centre"], *page["shape"]])
        npt.assert_allclose(parameters, program.ellipsoid.parameters, rtol=1e-9, atol=1e-9)
        npt.assert_allclose(page["covariance"], program.covariance.ravel(), rtol=1e-9, atol=1e-9)
        assert page["isUsed"]
        assert page["site_strength"] == program.strength
        assert page["z_axis"] == 2
        assert program.z_down is None
