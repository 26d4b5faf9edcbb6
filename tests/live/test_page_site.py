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
from benchmarks.page_verdict import Case, case_of, compared, page_answers, site_of
from tests.javascript import run
from tests.live.test_page_engine import held_together, packed, same
from tests.page_session import UT, PageSession, log_of
from tests.sentences import assert_sentences

from flinders import simulate
from flinders.apps.live.messages import MAX_DIP_DEG
from flinders.apps.live.standalone import engine
from flinders.core.geomag import newest_model, site_field
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import UsageError
from flinders.estimators import Readings
from flinders.estimators.known_dip import update_by_site
from flinders.estimators.level import Level
from flinders.fitting.record import record_of
from flinders.likelihood.site_field import Site
from flinders.native import build
from flinders.report.view import view

if TYPE_CHECKING:
    from flinders.core.geomag import SiteField
    from flinders.native.layouts import Records

try:
    build.library(target=build.WEB_PLATFORM)
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

PLACE: Final[dict[str, Any]] = {"type": "place", "latitude_deg": 48.2, "longitude_deg": 16.4, "year": 2026.9}
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


def field_at(latitude_deg: float, longitude_deg: float) -> SiteField | None:
    """Field of a place at which the page can judge; None where there is none, or it is too steep."""
    try:
        field = site_field(latitude_deg, longitude_deg, year=PLACE["year"])
    except UsageError:
        return None
    return field if abs(field.inclination_deg) <= MAX_DIP_DEG else None


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "is_known"),
    [
        (48.2, 16.4, True),
        (-33.9, 151.2, True),
        (0.0, -179.99, True),
        (86.0, 164.0, False),
        (95.0, 10.0, False),
        (-122.3, 47.6, False),
        (10.0, 400.0, False),
    ],
)
def test_a_place_is_answered_by_the_model_of_the_program(
    latitude_deg: float, longitude_deg: float, is_known: bool
) -> None:
    session, field = PageSession(), field_at(latitude_deg, longitude_deg)
    (notice,) = session.requested(1.0, **{**PLACE, "latitude_deg": latitude_deg, "longitude_deg": longitude_deg})
    assert (notice.severity, field is not None) == (("info", True) if is_known else ("warning", False))
    shown = session.state
    if field is None:
        assert shown.dip_assumed
    else:
        assert (shown.dip_deg, shown.dip_assumed) == (round(field.inclination_deg, 1), False)
        assert (f"is {shown.dip_deg:g}°" in notice.words, f"{field.strength:.1f} µT" in notice.words) == (True, True)
        assert_sentences(notice.words)


@pytest.mark.parametrize("year", [2019.5, 2024.999, 2030.001])
def test_a_year_without_a_model_on_the_page_is_refused(year: float) -> None:
    session = PageSession()
    (notice,) = session.requested(1.0, **{**PLACE, "year": year})
    assert notice.severity == "warning"
    assert_sentences(notice.words)
    assert session.state.dip_assumed


def placed_site() -> Site:
    """The site that the place is for a session."""
    return Site.of(site_field(PLACE["latitude_deg"], PLACE["longitude_deg"], year=PLACE["year"]))


@pytest.mark.parametrize("unit", ["uT", "counts"])
def test_the_strength_of_the_place_counts_for_readings_in_a_true_unit(unit: str) -> None:
    """Also after a new start; its dip counts with its uncertainty, in any unit."""
    session = PageSession()
    session.arrived(1.0, np.zeros((2, 7)), Unit.of(unit))
    session.requested(1.0, **PLACE)
    session.requested(2.0, "clear")
    session.arrived(3.0, np.zeros((2, 7)), Unit.of(unit))
    known, expected = session.used_site, site_of(placed_site().evidence)
    assert known is not None
    assert expected is not None
    for name in ("inclination_deg", "inclination_sigma_deg", "gain_sigma"):
        assert known[name] == pytest.approx(expected[name], rel=1e-9)
    assert known["strength"] == (None if unit == "counts" else pytest.approx(expected["strength"], rel=1e-9))


@pytest.mark.parametrize("unit", ["uT", "counts"])
def test_dip_and_strength_that_a_log_states_count_until_a_dip_is_typed(unit: str) -> None:
    """In counts the dip alone."""
    session, log = PageSession(), log_of(simulate.tumble(seed=1, n=60).samples)
    site = Site(strength=50.0, gain_sigma=0.05, inclination_deg=66.62, inclination_sigma_deg=1.0)
    session.opened(1.0, "a.bin", log._replace(unit=Unit.of(unit), site=site))
    known = session.used_site
    assert known is not None
    assert (session.state.dip_deg, session.state.dip_assumed, known["inclination_deg"]) == (66.6, False, 66.62)
    assert known["strength"] == (50.0 if unit == "uT" else None)
    session.requested(2.0, "dip", deg=40.0)
    assert (session.state.dip_deg, session.state.dip_assumed) == (40.0, False)
    known = session.used_site
    assert known is None or known["inclination_deg"] is None


def placed(samples: Samples) -> Case:
    """Readings at the place; those in counts have no strength."""
    site = placed_site()
    return replace(case_of(samples), site=site if samples.unit.inside == UT.inside else replace(site, strength=None))


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
    at_place = [placed(samples) for samples in cases.values()]
    rows = compared(list(cases), at_place)
    held_together(rows)
    unlike = [row for row in rows if row.method and row.sentences[0][1:] != row.sentences[1][1:]]
    assert not unlike, unlike
    told = {row.name: {code for code, _ in row.findings[1]} for row in rows}
    assert {name for name, codes in told.items() if "strength-differs" in codes} == {"another unit"}
    assert {name for name, codes in told.items() if "scale-unknown" in codes} == {"another unit", "counts"}
    for case, answer in zip(at_place, page_answers(at_place)["answers"], strict=True):
        assert case.fit is not None
        program = view(case.fit, case.samples)
        for name in ("field_strength", "field_strength_known", "offset", "offset_sigma", "matrix", "matrix_sigma"):
            same(answer["view"][name], getattr(program, name), name)
        same(answer["view"]["shown"], msgspec.to_builtins(program.shown), "shown")


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
        readings = Readings.of(replace(truth.samples, acceleration=None)).for_fit()
        alone = Level(dip_deg=60.0).estimate(readings)
        record = record_of(alone, readings.statistics)
        record["rejected_beyond"] = alone.rejected_beyond if np.isfinite(alone.rejected_beyond) else 0.0
        asked = {**(site_of(site) or {}), "alignment_sigma_deg": alignment_deg}
        turns.append({"field": readings.thin(20_000).ravel().tolist(), "record": as_json(record), "site": asked})
        expected.append(update_by_site(alone, readings, site, dip_deg=60.0, alignment_sigma_deg=alignment_deg))
    wasm = packed(build.library(target=build.WEB_PLATFORM).read_bytes())
    for page, program in zip(run(LEVEL, {"turns": turns, "wasm": wasm, "data": engine.data()}), expected, strict=True):
        parameters = np.array([*page["centre"], *page["shape"]])
        npt.assert_allclose(parameters, program.ellipsoid.parameters, rtol=1e-9, atol=1e-9)
        npt.assert_allclose(page["covariance"], program.covariance.ravel(), rtol=1e-9, atol=1e-9)
        assert page["isUsed"]
        assert page["site_strength"] == program.strength
        assert page["z_axis"] == 2
        assert program.z_down is None
