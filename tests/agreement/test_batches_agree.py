"""A batch gives each unit what `flinders.fit` gives it alone: numbers to a billionth, verdicts and codes.

Those whose record does not tell all went through `flinders.fit` itself, so only the others are fitted again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import daily
from tests.worlds import SWAPS

from flinders.core.samples import Samples
from flinders.errors import FitError
from flinders.fitting import batch, calibrate
from flinders.fitting.batch import UPPER_ENTRIES, fit_batch
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import symmetric_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.fitting.batch import BatchColumns
    from flinders.fitting.result import Fit

AGREED = 1e-9


def spheres(rng: np.random.Generator, units: int, many: int) -> Floats:
    directions = rng.normal(size=(units, many, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    return directions


def walks(rng: np.random.Generator, units: int, many: int, pace: float = 0.15) -> Floats:
    """Directions that follow each other, as by hand."""
    steps = rng.normal(size=(units, many, 4)) * pace
    q = np.cumsum(steps, axis=1) + rng.normal(size=(units, 1, 4))
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=2, keepdims=True), 2, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=2)


def measured(rng: np.random.Generator, directions: Floats, *, noise: float = 0.4, offset: float = 40.0) -> Floats:
    units = len(directions)
    entries = np.array([1.0, 1, 1, 0, 0, 0]) + rng.normal(scale=0.08, size=(units, 6))
    shape = 50.0 * np.stack([symmetric_matrix(each) for each in entries])
    centre = offset * rng.uniform(-1.0, 1.0, size=(units, 1, 3))
    return directions @ shape + centre + noise * rng.normal(size=directions.shape)


def clean(rng: np.random.Generator, units: int) -> list[Floats]:
    return list(measured(rng, spheres(rng, units, 160)))


def by_hand(rng: np.random.Generator, units: int) -> list[Floats]:
    return list(measured(rng, walks(rng, units, 240)))


def partial(rng: np.random.Generator, units: int) -> list[Floats]:
    directions = spheres(rng, units, 160)
    heights = np.linspace(-0.6, 0.6, units)[:, np.newaxis]
    directions[..., 2] = np.maximum(directions[..., 2], heights)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    return list(measured(rng, directions, noise=0.1))


def level(rng: np.random.Generator, units: int) -> list[Floats]:
    heading = np.linspace(0.0, 12.0, 120)
    tilt = np.linspace(0.0, 0.8, units)[:, np.newaxis] * np.sin(3.0 * heading)
    directions = np.stack([np.cos(heading) + 0 * tilt, np.sin(heading) + 0 * tilt, 1.2 + tilt], axis=2)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    return list(measured(rng, directions, noise=0.2))


def spiky(rng: np.random.Generator, units: int) -> list[Floats]:
    readings = measured(rng, spheres(rng, units, 200))
    outliers = rng.random(readings.shape[:2]) < rng.uniform(0.0, 0.03, size=(units, 1))
    readings[outliers] += 40.0 * rng.normal(size=(int(outliers.sum()), 3))
    return list(readings)


def coloured(rng: np.random.Generator, units: int) -> list[Floats]:
    readings = measured(rng, walks(rng, units, 300), noise=0.1)
    creeping = np.cumsum(rng.normal(size=readings.shape), axis=1) * np.linspace(0.0, 0.05, units)[:, None, None]
    return list(readings + creeping + 0.2 * np.roll(rng.normal(size=readings.shape), 1, axis=1))


def broken(rng: np.random.Generator, units: int) -> list[Floats]:
    readings = measured(rng, spheres(rng, units, 150))
    for unit, kind in enumerate(np.arange(units) % 6):
        if kind == 0:
            readings[unit, :, unit % 3] = 12.0  # a stuck axis
        elif kind == 1:
            readings[unit] = np.round(readings[unit] / 4.0) * 4.0  # coarse steps
        elif kind == 2:
            readings[unit] = np.minimum(readings[unit], 0.7 * readings[unit].max())  # a rail
        elif kind == 3:
            readings[unit] = np.repeat(readings[unit, ::3], 3, axis=0)  # stale repeats
        elif kind == 4:
            readings[unit] *= 10.0 ** rng.uniform(-9, 9)  # any unit there is
        else:
            readings[unit, unit % 150] = np.nan
    return list(readings)


def unlike(rng: np.random.Generator, units: int) -> list[Floats]:
    counts = rng.integers(5, 420, size=units)
    return [measured(rng, walks(rng, 1, count, 0.4))[0] for count in counts.tolist()]


def far_off(rng: np.random.Generator, units: int) -> list[Floats]:
    offsets = np.geomspace(1.0, 1e5, units)
    return [measured(rng, spheres(rng, 1, 120), offset=offset)[0] for offset in offsets.tolist()]


def ill_conditioned(rng: np.random.Generator, units: int) -> list[Floats]:
    widths = np.geomspace(0.15, 2.0, units)[:, np.newaxis]
    directions = spheres(rng, units, 200)
    directions[..., 0] = 1.0 / widths + np.abs(directions[..., 0])
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    return list(measured(rng, directions, noise=0.1))


def corrected_before(rng: np.random.Generator, units: int) -> list[Floats]:
    return list(measured(rng, spheres(rng, units, 200), offset=1.0))


KINDS: dict[Callable[[np.random.Generator, int], list[Floats]], tuple[int, float]] = {
    clean: (200, 0.95), by_hand: (150, 0.5), partial: (150, 0.3), level: (250, 0.05), spiky: (250, 0.02),
    coloured: (150, 0.05), broken: (300, 0.05), unlike: (150, 0.2), far_off: (250, 0.2), ill_conditioned: (250, 0.05),
    corrected_before: (60, 0.95),
}  # fmt: skip
"""Kinds of units, how many, and the share that comes through at the least: what never did would prove nothing."""


def test_kinds_are_enough() -> None:
    assert sum(many for many, _ in KINDS.values()) >= 2000


def alone(one: Samples, target_deg: float) -> Fit:
    try:
        return calibrate.fit(one, target_deg=target_deg)
    except Refused as error:
        return error.fit


def assert_alike(found: BatchColumns, place: int, fit: Fit) -> None:
    calibration = fit.calibration
    told = (found.verdict[place], found.method[place], found.samples[place], found.findings[place])
    assert told == (
        fit.verdict,
        fit.evidence.method,
        fit.evidence.samples,
        tuple(finding.code for finding in fit.findings),
    ), place
    radius = calibration.field_strength
    assert np.abs(found.offset[place] - calibration.offset).max() < AGREED * radius
    for name, expected in (
        ("matrix", calibration.matrix.ravel()), ("covariance", fit.claim.covariance.ravel()[UPPER_ENTRIES]),
        ("noise", fit.evidence.noise),
        ("field_strength", radius), ("coverage", fit.evidence.coverage.fraction),
        ("worst_deg", fit.heading_error_deg.worst), ("rms_deg", fit.heading_error_deg.rms),
        ("dip_deg", fit.heading_error_deg.dip_deg),
    ):  # fmt: skip
        numbers = getattr(found, name)[place]
        assert np.abs(numbers - expected).max() <= AGREED * np.abs(expected).max(), (place, name)


@pytest.mark.parametrize("kind", daily(KINDS, 3))
def test_a_batch_gives_what_each_gives_alone(
    kind: Callable[[np.random.Generator, int], list[Floats]], monkeypatch: pytest.MonkeyPatch, trials: Choose
) -> None:
    """Of those judged from their records every fourth is fitted again, under ``-m claims`` each."""
    step = 4 // trials(4, 1).count
    units, share = KINDS[kind]
    rng = np.random.default_rng(7)
    samples = [Samples.of(field, unit="uT") for field in kind(rng, units)]
    monkeypatch.setattr(batch, "_fit_one", lambda *_, **__: ValueError("does not tell all"))
    found = fit_batch(samples, target_deg=5.0)
    by_record = np.flatnonzero(found.by_record)
    assert len(by_record) >= share * units
    for place in by_record[::step].tolist():
        assert_alike(found, place, alone(samples[place], 5.0))


def test_those_whose_record_does_not_tell_all_are_fitted_alone() -> None:
    rng = np.random.default_rng(3)
    samples = [Samples.of(field, unit="uT") for field in [*clean(rng, 3), *broken(rng, 6), *level(rng, 2)]]
    found = fit_batch([*samples, samples[0][:5], samples[0][:0]], target_deg=5.0)
    assert found.by_record[:3].all()
    assert not found.by_record[-2:].any()
    assert found.code.tolist()[-2:] == ["too-few-samples"] * 2
    for place, one in enumerate(samples):
        fit = refusal = None
        try:
            fit = calibrate.fit(one, target_deg=5.0)
            assert_alike(found, place, fit)
        except FitError as error:
            refusal = error
        expected = (fit.verdict, "") if fit else ("refused", refusal.code if refusal else "")
        assert (found.verdict[place], found.code[place]) == expected


def slipped(rng: np.random.Generator) -> list[Samples]:
    """Turned by hand, with an axis that changes its sign or two that change places on the way."""
    fields = measured(rng, walks(rng, 6, 400, 0.1), noise=0.1)
    for place, field in enumerate(fields):
        field[200:] = field[200:] @ list(SWAPS.values())[place]
    return [Samples.of(field, unit="uT") for field in fields]


def driven(rng: np.random.Generator) -> list[Samples]:
    """With a current that moves the readings, one that does not, and one that hardly changes."""
    current = np.abs(np.sin(np.arange(200.0))) * np.array([[20.0], [20.0], [0.01]])
    fields = measured(rng, spheres(rng, 3, 200), noise=0.1)
    fields[0] += 0.5 * current[0][:, np.newaxis]
    return [Samples.of(field, unit="uT", current=amperes) for field, amperes in zip(fields, current, strict=True)]


def in_another_unit(rng: np.random.Generator) -> list[Samples]:
    """Fields of 50 µT read as so many times as much: within the earth's, a little outside, and of another unit."""
    return [Samples.of(field, unit="uT") for one in (1.0, 1.5, 10.0, 0.02) for field in one * np.array(clean(rng, 2))]


@pytest.mark.parametrize(("units", "code"), [(slipped, "axis-swap"), (driven, "disturbance-unmodelled")])
def test_what_only_a_look_at_the_whole_recording_tells_is_found(
    units: Callable[[np.random.Generator], list[Samples]], code: str
) -> None:
    samples = units(np.random.default_rng(2))
    found = fit_batch(samples, target_deg=5.0)
    told = [alone(one, 5.0) for one in samples]
    assert found.findings.tolist() == [tuple(finding.code for finding in fit.findings) for fit in told]
    assert any(code in codes for codes in found.findings)


def spirals(rng: np.random.Generator, units: int, *, drift: float = 0.0) -> list[Samples]:
    """From pole to pole, each reading told twice: time and direction go together."""
    place = np.linspace(0.0, 1.0, 300)
    around, height = 24.0 * np.pi * place, 1.0 - 2.0 * place
    level = np.sqrt(1.0 - height**2)
    directions = np.stack([level * np.cos(around), level * np.sin(around), height], axis=1)
    fields = measured(rng, np.broadcast_to(directions, (units, 300, 3)), noise=0.3)
    fields += drift * np.stack([place, 0 * place, 0 * place], axis=1)
    return [Samples.of(np.repeat(field.round(1), 2, axis=0), unit="uT") for field in fields]


def test_time_that_goes_with_direction_tells_no_change() -> None:
    rng = np.random.default_rng(6)
    samples = spirals(rng, 40)
    found = fit_batch(samples)
    assert not any("field-changed" in codes for codes in found.findings)
    for place, one in enumerate(samples):
        assert_alike(found, place, alone(one, 1.0))


def test_quiet_sensors_and_large_offsets_agree_too() -> None:
    rng = np.random.default_rng(11)
    samples = [
        Samples.of(measured(rng, spheres(rng, 1, 200), noise=noise, offset=offset)[0], unit="uT")
        for noise in (0.0, 1e-9, 1e-6, 1e-3, 1e-2, 0.1)
        for offset in (10.0, 300.0, 900.0)
    ]
    together = fit_batch(samples)
    for place, one in enumerate(samples):
        assert_alike(together, place, alone(one, 1.0))


def test_what_stands_beside_readings_and_moves_nothing_is_told_by_the_record() -> None:
    rng = np.random.default_rng(3)
    warmer = 20.0 + np.linspace(0.0, 8.0, 300)
    samples = [Samples.of(field, unit="uT", temperature=warmer) for field in measured(rng, spheres(rng, 20, 300))]
    found = fit_batch(samples, target_deg=5.0)
    assert found.by_record.all()
    for place, one in enumerate(samples):
        assert_alike(found, place, alone(one, 5.0))


def test_another_unit_limits_and_a_strong_field_is_noted() -> None:
    samples = in_another_unit(np.random.default_rng(2))
    found = fit_batch(samples, target_deg=5.0)
    assert found.by_record.all()
    assert found.verdict.tolist() == ["good"] * 4 + ["limited"] * 4
    assert ["field-strength" in codes for codes in found.findings] == [False] * 2 + [True] * 6
    for place, one in enumerate(samples):
        assert_alike(found, place, alone(one, 5.0))


def timed(rng: np.random.Generator) -> Samples:
    """With a step back, a gap, or neither; in counts or in µT; of this length or that."""
    many = int(rng.integers(90, 130))
    steps = np.full(many, 0.02)
    steps[40] = rng.choice([0.02, -1.0, 9.0])
    field = measured(rng, spheres(rng, 1, many))[0]
    return Samples.of(field, unit=str(rng.choice(["uT", "counts"])), time=np.cumsum(steps))


def test_times_units_and_lengths_may_be_mixed() -> None:
    rng = np.random.default_rng(5)
    samples = [timed(rng) for _ in range(40)]
    found = fit_batch(samples, target_deg=5.0)
    assert found.by_record.sum() > 30
    told = {code for codes in found.findings for code in codes}
    assert {"time-back", "time-gap", "unit-unknown"} <= told
    for place, one in enumerate(samples):
        assert_alike(found, place, alone(one, 5.0))
    assert found.unit_of_field.tolist() == [one.unit.inside for one in samples]
