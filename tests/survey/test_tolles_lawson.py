"""Tolles–Lawson: coefficients of a known aircraft, what they leave of other flights, and the command."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.apps import survey
from flinders.apps.survey.aeromagnetic import dumps, loads
from flinders.apps.survey.simulate_aircraft import Aircraft, calibration_flight, fluxgate
from flinders.apps.survey.tolles_lawson_fit import fit_coefficients
from flinders.apps.survey.tolles_lawson_terms import NAMES, Signal, as_coefficients, cosine_transform, rotation_map
from flinders.core.axes import Axes
from flinders.errors import DocumentError, FitError, FlindersError, InputError, StuckAxis, UnitError, UsageError
from flinders.simulate import Sensor
from flinders.simulate.recording import write_csv

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.apps.survey.simulate_aircraft import Flight
    from flinders.arrays import Floats
    from flinders.core.samples import Samples

PERFECT = Sensor()
FLIGHT = calibration_flight(1, vector=PERFECT)
OTHER = calibration_flight(2, aircraft=FLIGHT.aircraft, vector=PERFECT, headings_deg=(45.0, 135.0, 225.0, 315.0))
FIT = fit_coefficients(FLIGHT.samples)


def coefficients(aircraft: Aircraft) -> Floats:
    """(16,) of an aircraft, of what it adds to the field that is measured, its own included."""
    inverse = np.linalg.inv(np.eye(3) + aircraft.induced)
    induced, eddy = 50_000.0 * inverse @ aircraft.induced, 50_000.0 * inverse @ aircraft.eddy
    return as_coefficients(1000.0 * inverse @ aircraft.permanent, induced, eddy)


def spread(flight: Flight, values: Floats) -> float:
    """Standard deviation of what lies within the band."""
    runs = Signal.of(flight.samples).runs()
    cosines = np.concatenate([run.filter_band(values[run.rows]) for run in runs])
    return float(np.sqrt(np.sum(cosines**2) / sum(map(len, runs))))


def test_coefficients_are_those_of_the_aircraft_within_their_uncertainty() -> None:
    off = FIT.coefficients - coefficients(FLIGHT.aircraft)
    assert np.all(np.abs(off) < 4.0 * FIT.sigma)
    distance = float(off @ np.linalg.solve(FIT.covariance, off))
    assert 3.0 < distance < 45.0  # of 16 degrees of freedom: 0.02 % and 99.98 %


def test_another_flight_on_other_headings_is_compensated_as_claimed() -> None:
    assert FIT.verdict == "good"
    before = spread(OTHER, OTHER.interference)
    after = spread(OTHER, OTHER.interference - FIT.interference(OTHER.samples))
    assert after < 0.1 * before
    assert after < 2.5 * FIT.on_any_heading


def test_a_compensated_flight_is_the_field_without_the_aircraft() -> None:
    """Readings less the true interference, but for a constant, to within what the coefficients claim."""
    found = survey.compensate_flight(OTHER.samples, survey.tolles_lawson(FLIGHT.samples))
    off = found.compensated - (found.scalar - OTHER.interference)
    assert np.std(off) < 3.0 * found.summary.expected
    assert np.std(found.scalar - found.compensated) > 5.0 * np.std(off)
    assert found.time_s.shape == found.scalar.shape == found.compensated.shape


def test_what_is_left_of_a_recording_is_as_expected() -> None:
    left = FIT.compensate(OTHER.samples)
    assert left.before / left.after > 5.0
    assert 0.5 < left.after / left.expected < 2.0


def test_a_magnetic_aircraft_is_compensated_in_second_order() -> None:
    """A thousand nT of permanent field add ten in second order."""
    magnetic = Aircraft(permanent=np.array([0.6, -0.8, 0.5]))
    flight, other = (calibration_flight(seed, aircraft=magnetic, vector=PERFECT) for seed in (1, 2))
    fit = fit_coefficients(flight.samples)
    assert spread(other, other.interference - fit.interference(other.samples)) < 2.5 * fit.as_flown


def test_an_aircraft_of_two_percent_of_the_field_is_compensated_as_claimed(trials: Choose) -> None:
    """Four times as magnetic as a published one; its eddy currents follow the field of the earth, not the sum."""
    claim, squares = trials(200, 4), []
    for seed in range(claim.count):
        rng = np.random.default_rng([seed, 3])
        drawn = Aircraft.random(rng)
        aircraft = Aircraft(4.0 * drawn.permanent, 4.0 * drawn.induced, 4.0 * drawn.eddy)
        vector = fluxgate(rng)
        fit = fit_coefficients(calibration_flight(rng, aircraft=aircraft, vector=vector).samples)
        between = (45.0, 135.0, 225.0, 315.0)
        other = calibration_flight(rng, aircraft=aircraft, vector=vector, headings_deg=between)
        squares.append((spread(other, other.interference - fit.interference(other.samples)) / fit.on_any_heading) ** 2)
    assert math.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=min(0.15 * claim.widening, 0.4))


def test_a_misaligned_vector_magnetometer_compensates_as_well() -> None:
    """Its field over the scalar strength is linear in that of an aligned one, and no length spoils it."""
    lean = np.eye(3) + 0.02 * np.random.default_rng(5).standard_normal((3, 3))
    fit = fit_coefficients(replace(FLIGHT.samples, field=FLIGHT.samples.field @ lean.T))
    leant = replace(OTHER.samples, field=OTHER.samples.field @ lean.T)
    apart = fit.interference(leant) - FIT.interference(OTHER.samples)
    assert spread(OTHER, apart) < 0.1 * FIT.on_any_heading


@pytest.mark.parametrize("axes", ["x,-y,-z", "y,x,-z", "-x,-y,z"])
def test_the_axes_of_the_vector_magnetometer_do_not_matter(axes: str) -> None:
    turned = replace(FLIGHT.samples, field=Axes.of(axes).apply(FLIGHT.samples.field))
    fit = fit_coefficients(turned)
    npt.assert_allclose(fit.cross_validated, FIT.cross_validated, rtol=0.02)
    npt.assert_allclose(fit.before, FIT.before, rtol=1e-9)


def test_coefficients_turn_with_the_aircraft() -> None:
    turned_field = np.column_stack(
        [-FLIGHT.samples.field[:, 1], FLIGHT.samples.field[:, 0], FLIGHT.samples.field[:, 2]]
    )
    same, about = (Signal.of(replace(FLIGHT.samples, field=field)) for field in (FLIGHT.samples.field, turned_field))
    difference = about.terms() - same.terms() @ rotation_map(np.pi / 2.0)
    npt.assert_allclose(difference - difference.mean(axis=0), 0.0, atol=2e-3)  # the strength is not quite constant


def test_one_heading_alone_names_what_it_does_not_show() -> None:
    fit = fit_coefficients(calibration_flight(1, headings_deg=(0.0,) * 4).samples)
    assert fit.verdict == "refused"
    assert {"permanent x", "permanent z"} <= set(fit.unobserved) < set(NAMES)
    assert "four headings" in fit.limits[0]


def test_an_aircraft_without_a_field_is_said_to_gain_nothing() -> None:
    fit = fit_coefficients(calibration_flight(1, aircraft=Aircraft()).samples)
    assert fit.verdict == "limited"
    assert "hardly magnetic" in fit.limits[-1]


def test_ground_does_not_disturb_what_manoeuvres_show() -> None:
    rough = fit_coefficients(calibration_flight(1, vector=PERFECT, aircraft=FLIGHT.aircraft, geology=0.1).samples)
    assert np.all(np.abs(rough.coefficients - coefficients(FLIGHT.aircraft)) < 4.0 * rough.sigma)


def test_the_length_of_the_vector_stands_in_for_a_scalar_magnetometer() -> None:
    alone = replace(FLIGHT.samples, strength=None)
    fit = fit_coefficients(alone)
    assert spread(FLIGHT, FLIGHT.interference - fit.interference(alone)) < 4.0 * fit.as_flown


def test_dropouts_spikes_and_gaps_are_left_out() -> None:
    strength, time = np.array(FLIGHT.samples.strength), np.array(FLIGHT.samples.time)
    strength[200:300], strength[1000], strength[2000] = 0.0, np.nan, strength[2000] + 1.0
    time[1700:] += 100.0
    damaged = replace(FLIGHT.samples, strength=strength, time=time)
    fit = fit_coefficients(damaged)
    assert np.all(np.abs(fit.coefficients - coefficients(FLIGHT.aircraft)) < 4.0 * fit.sigma)
    assert np.flatnonzero(~np.isfinite(fit.interference(damaged))).tolist() == [
        *range(200, 300), 1000, 2000
    ]  # fmt: skip


def _with(**columns: object) -> Samples:
    return replace(FLIGHT.samples, **columns)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("samples", "error", "words"),
    [
        (_with(time=None), InputError, "no times"),
        (FLIGHT.samples[:400], FitError, "40 s without gaps"),
        (FLIGHT.samples[::10], FitError, "1.0 readings a second"),
        (FLIGHT.samples[:0], FitError, "0 of 0 readings"),
        (_with(strength=np.zeros(len(FLIGHT.samples))), FitError, "0 of"),
        (_with(strength=np.full(len(FLIGHT.samples), 50.0)), FitError, "always reads 50"),
        (_with(strength=1000.0 * np.array(FLIGHT.samples.strength)), UnitError, "scalar_nT"),
        (_with(field=FLIGHT.samples.field * [1, 1, 0] + [0, 0, 45]), StuckAxis, "z = 45"),
        (flinders.Samples.of(FLIGHT.samples.field, time=FLIGHT.samples.time), UnitError, "counts"),
    ],
)
def test_what_cannot_be_compensated_is_refused_with_advice(
    samples: Samples, error: type[FlindersError], words: str
) -> None:
    with pytest.raises(error, match=words):
        flinders.tolles_lawson(samples)


def test_a_summary_is_refused() -> None:
    with assert_raises(UsageError):
        flinders.tolles_lawson(flinders.Summary.of(FLIGHT.samples.field))


def test_the_cosine_transform_is_that_of_scipy() -> None:
    from scipy.fft import dct

    columns = np.random.default_rng(0).normal(size=(301, 3))
    npt.assert_allclose(cosine_transform(columns), dct(columns, axis=0, norm="ortho"), atol=1e-12)


@pytest.mark.nightly
def test_the_usual_recipe_leaves_no_less() -> None:
    """Band-pass of fourth order, forwards and backwards, ends cut, least squares: as MagNav.jl does it."""
    from scipy.signal import butter, sosfiltfilt

    band = butter(4, [0.1, 0.9], "bandpass", fs=10.0, output="sos")
    taken = Signal.of(FLIGHT.samples)
    columns = np.column_stack([taken.terms(), 1000.0 * taken.strength])
    passed = sosfiltfilt(band, columns, axis=0)[20:-20]
    usual = np.linalg.lstsq(passed[:, :-1], passed[:, -1], rcond=None)[0]
    theirs = spread(OTHER, OTHER.interference - Signal.of(OTHER.samples).terms() @ usual)
    ours = spread(OTHER, OTHER.interference - FIT.interference(OTHER.samples))
    assert ours < 1.5 * theirs


# files and the command


def test_a_file_is_read_back_to_the_bit() -> None:
    assert loads(dumps(FIT)) == FIT


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{}", "tolles-lawson"),
        ('{"flinders": "tolles-lawson", "schema": 9}', "schema 9"),
        (dumps(FIT).replace("permanent x", "permanent w"), "not the 16"),
        (dumps(FIT)[:200], "cut short"),
    ],
)
def test_a_damaged_file_is_refused(text: str, words: str) -> None:
    with pytest.raises(DocumentError, match=words):
        loads(text)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def renamed(column: str) -> None:
    """Call the scalar magnetometer's column in ``box.csv`` so."""
    write_csv(FLIGHT.samples, "box.csv", force=True)
    path = Path("box.csv")
    path.write_text(path.read_text(encoding="utf-8").replace("reference_strength_uT", column), encoding="utf-8")


def test_a_flight_is_fitted_and_another_one_compensated(home: Path) -> None:
    for words in ("-o box.csv --json", "-o lines.csv --headings 45,225 --seed 2 --json"):
        assert len(flinders_("simulate", "aircraft", *words.split()).json["permanent_nT"]) == 3
    ended = flinders_("tolles-lawson", "box.csv", "-o", "coefficients.json", "--json")
    assert ended.code == 0
    assert ended.json == flinders_("tolles-lawson", "box.csv", "--json").json
    assert set(ended.json["coefficients"]) == set(NAMES)
    compensate = ["tolles-lawson", "lines.csv", "--coefficients", "coefficients.json", "-o", "out.csv"]
    left = flinders_(*compensate, "--json").json
    assert left["improvement"] > 3.0
    header, *rows = Path("out.csv").read_text(encoding="utf-8").splitlines()
    assert header == "time_s,scalar_nT,compensated_nT"
    assert len(rows) == len(Path("lines.csv").read_text(encoding="utf-8").splitlines()) - 1


@pytest.mark.parametrize("column", ["tmi", "MAG4 [uT]", "5"])
def test_the_scalar_column_is_taken_by_name_or_number(column: str, home: Path) -> None:
    renamed("tmi" if column == "5" else column)
    ended = flinders_("tolles-lawson", "box.csv", "--scalar", column, "--json")
    assert ended.json["cross_validated"] == pytest.approx(FIT.cross_validated, rel=0.02)
    assert "scalar magnetometer: " in ended.err


def test_a_scalar_column_in_another_unit_is_converted(home: Path) -> None:
    columns = FLIGHT.samples.as_columns()
    columns["scalar_nT"] = 1000.0 * columns.pop("reference_strength_uT")
    rows = np.column_stack(list(columns.values()))
    np.savetxt("box.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.4f")
    ended = flinders_("tolles-lawson", "box.csv", "--scalar", "scalar_nT", "--json")
    assert ended.json["cross_validated"] == pytest.approx(FIT.cross_validated, rel=0.02)


@pytest.mark.parametrize("scalar", ["nope", "mag_x_uT"])
def test_a_wrong_scalar_column_is_refused(scalar: str, home: Path) -> None:
    renamed("tmi")
    ended = flinders_("tolles-lawson", "box.csv", "--scalar", scalar)
    assert ended.code == 2
    assert_sentences(ended.err)


def test_refused_coefficients_are_not_written(home: Path) -> None:
    flinders_("simulate", "aircraft", "-o", "box.csv", "--headings", "0,0,0,0")
    ended = flinders_("tolles-lawson", "box.csv", "-o", "coefficients.json")
    assert ended.code == 4
    assert not Path("coefficients.json").exists()


def test_wrong_headings_of_a_simulated_flight_are_refused() -> None:
    assert "need degrees" in flinders_("simulate", "aircraft", "--headings", "north").err
    with pytest.raises(UsageError, match="loop"):
        calibration_flight(manoeuvres=["loop"])


def test_manoeuvres_follow_each_other_on_each_heading() -> None:
    flown = [(each.name, each.heading_deg) for each in FLIGHT.manoeuvres]
    assert flown == [
        (name, heading) for heading, name in itertools.product((0, 90, 180, 270), ("roll", "pitch", "yaw"))
    ]
