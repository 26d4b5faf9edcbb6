"""Every finding there is, found where it should be and with the severity it should have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

import flinders
from flinders import simulate
from flinders.axes import Axes
from flinders.result import Refused
from flinders.samples import Samples
from flinders.simulate import Sensor, tumble
from flinders.verdict import CODES

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.result import Finding, Fit

BARE: Final = Sensor(np.eye(3), np.array([20.0, -30.0, 10.0]), 0.2)


def judged(source: Samples | Floats, **options: object) -> Fit:
    """The fit, also where it is refused."""
    try:
        return flinders.fit(source, **options)  # type: ignore[arg-type]
    except Refused as error:
        return error.fit


def plain(n: int = 600, **options: object) -> Samples:
    """A sound recording, in µT."""
    settings: dict[str, object] = {"seed": 1, "motion": "uniform", "n": n, "sensor": BARE, **options}
    return tumble(**settings).samples  # type: ignore[arg-type]


def cap(half_angle_deg: float, noise: float = 0.2) -> Floats:
    """Readings within an angle of straight up."""
    directions = simulate.fibonacci(8000)
    directions = directions[directions[:, 2] > np.cos(np.radians(half_angle_deg))][:1500]
    white = np.random.default_rng(1).standard_normal(directions.shape)
    return np.asarray(50 * directions + BARE.offset + noise * white, np.float64)


def level() -> Fit:
    return judged(plain(motion="level"))


def poor_heading() -> Fit:
    return judged(plain(60, noise=2.0))


def hopeless_heading() -> Fit:
    return judged(cap(20.0), dip_deg=75.0)


def half_unseen() -> Fit:
    return judged(plain(3000, motion="tilted"))


def noisy() -> Fit:
    return judged(plain(4000, noise=4.0))


def drowned() -> Fit:
    return judged(plain(4000, noise=14.0))


def leaning_on_the_prior() -> Fit:
    return judged(cap(20.0))


def skewed_sphere() -> Fit:
    soft_iron = np.array([[1.0, 0.05, 0.0], [0.05, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return judged(plain(2000, sensor=Sensor(soft_iron, np.zeros(3), 0.2)), method="sphere")


def hardly_skewed_sphere() -> Fit:
    soft_iron = np.array([[1.0, 0.005, 0.0], [0.005, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return judged(plain(2000, sensor=Sensor(soft_iron, np.zeros(3), 0.2)), method="sphere")


def short() -> Fit:
    return judged(plain(16))


def crossing_rings() -> Fit:
    """A level turn, and the same on its side."""
    angle = np.linspace(0.0, 2 * np.pi, 500, endpoint=False)
    ring = np.stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), np.full(500, 0.866)], axis=1)
    white = np.random.default_rng(1).standard_normal((1000, 3))
    return judged(50.0 * np.concatenate([ring, np.roll(ring, 1, axis=1)]) + BARE.offset + 0.3 * white)


def remembering() -> Fit:
    """Noise that follows the noise before, by hand."""
    truth = tumble(seed=1, sensor=BARE, noise=0.0)
    noise = np.random.default_rng(1).standard_normal((3000, 3))
    for row in range(1, 3000):
        noise[row] = 0.8 * noise[row - 1] + 0.6 * noise[row]
    return judged(truth.samples.field + 0.3 * noise)


def struck(share: float) -> Fit:
    """A share of the readings moved alike."""
    field = plain(1000).field.copy()
    field[: round(share * 1000)] += [0.0, 60.0, 0.0]
    return judged(field)


def a_few_strays() -> Fit:
    return struck(0.05)


def many_strays() -> Fit:
    return struck(0.2)


def at_the_rails() -> Fit:
    return judged(plain(2000, sensor=Sensor(np.eye(3), np.array([20.0, -30.0, 10.0]), 0.2, limit=60.0)))


def stale() -> Fit:
    return judged(np.repeat(plain().field, 3, axis=0))


def interrupted() -> Fit:
    samples = plain()
    time = np.arange(len(samples)) * 0.02
    time[300:] += 60.0
    return judged(Samples.of(samples.field, unit="uT", time=time))


def back_in_time() -> Fit:
    samples = plain()
    return judged(Samples.of(samples.field, unit="uT", time=np.roll(np.arange(len(samples)) * 0.02, 100)))


def gaps() -> Fit:
    field = plain().field.copy()
    field[:3, 1] = np.nan
    return judged(field)


def mostly_gaps() -> Fit:
    field = plain().field.copy()
    field[:100] = np.inf
    return judged(field)


def unlike_axes() -> Fit:
    return judged(plain(2000, sensor=Sensor(np.diag([2.4, 1.0, 1.0]), np.zeros(3), 0.2)))


def weak_field() -> Fit:
    return judged(plain(2000, field_strength=5.0, noise=0.02))


def strong_field() -> Fit:
    return judged(plain(2000, field_strength=500.0))


def mirrored() -> Fit:
    return judged(Samples.of(plain().field, unit="uT", axes="x,y,-z"))


def sound() -> Fit:
    return judged(plain())


def only(fit: Fit, code: str) -> Finding:
    return next(finding for finding in fit.findings if finding.code == code)


CASES: Final[list[tuple[str, str, Callable[[], Fit], tuple[float, float]]]] = [
    # code, severity, recording, what the number should lie between
    ("one-plane", "refuses", level, (0.0, 0.05)),
    ("heading-error", "limits", poor_heading, (1.0, 5.0)),
    ("heading-error", "refuses", hopeless_heading, (5.0, 720.0)),
    ("coverage", "limits", half_unseen, (60.0, 180.0)),
    ("noise", "limits", noisy, (0.06, 0.1)),
    ("noise", "refuses", drowned, (0.2, 0.4)),
    ("prior", "limits", leaning_on_the_prior, (0.1, 1.0)),
    ("bias", "limits", skewed_sphere, (1.5, 5.0)),
    ("bias", "note", hardly_skewed_sphere, (0.1, 0.3)),
    ("few-samples", "limits", short, (12, 16)),
    ("rings", "limits", crossing_rings, (1, 1)),
    ("correlated", "note", remembering, (0.05, 0.25)),
    ("strays", "note", a_few_strays, (0.05, 0.08)),
    ("strays", "limits", many_strays, (0.2, 0.23)),
    ("saturated", "limits", at_the_rails, (0.01, 0.2)),
    ("stale-repeats", "note", stale, (0.66, 0.67)),
    ("time-jump", "note", interrupted, (60.0, 60.1)),
    ("time-jump", "note", back_in_time, (1, 1)),
    ("skipped-rows", "note", gaps, (3, 3)),
    ("skipped-rows", "limits", mostly_gaps, (100, 100)),
    ("axis-ratio", "limits", unlike_axes, (2.3, 2.5)),
    ("field-strength", "note", weak_field, (4.9, 5.1)),
    ("field-strength", "note", strong_field, (499, 501)),
    ("mirrored-axes", "limits", mirrored, (-1, -1)),
    ("scale-unknown", "note", sound, (49.9, 50.1)),
    ("rotation-unknown", "note", sound, (0, 0)),
]


@pytest.mark.parametrize(
    ("code", "severity", "recording", "between"), CASES, ids=[f"{case[0]}: {case[2].__name__}" for case in CASES]
)
def test_the_finding_is_there_with_its_severity_and_number(
    code: str, severity: str, recording: Callable[[], Fit], between: tuple[float, float]
) -> None:
    fit = recording()
    finding = only(fit, code)
    assert finding.severity == severity
    assert between[0] <= finding.number <= between[1]
    assert finding.advice
    assert finding.as_dict() == {
        "code": code, "severity": severity, "number": finding.number, "limit": finding.limit, "advice": finding.advice
    }  # fmt: skip
    assert {"note": ("good", "limited", "refused"), "limits": ("limited", "refused"), "refuses": ("refused",)}[
        severity
    ].count(fit.verdict) == 1


def test_every_code_is_tried() -> None:
    assert {code for code, *_ in CASES} == set(CODES)


def test_every_finding_of_every_recording_is_in_the_table_and_the_gravest_comes_first() -> None:
    order = ["refuses", "limits", "note"]
    for _, _, recording, _ in CASES:
        findings = recording().findings
        assert {finding.code for finding in findings} <= set(CODES)
        ranks = [order.index(finding.severity) for finding in findings]
        assert ranks == sorted(ranks)


def test_a_sound_recording_is_good_and_has_only_what_nobody_can_know() -> None:
    fit = sound()
    assert fit.verdict == "good"
    assert [finding.code for finding in fit.findings] == ["scale-unknown", "rotation-unknown"]
    known = judged(plain(), field_strength=50.0)
    assert [finding.code for finding in known.findings] == ["rotation-unknown"]


def test_what_refuses_is_raised_with_the_fit_and_its_numbers() -> None:
    with pytest.raises(Refused) as caught:
        flinders.fit(plain(4000, noise=14.0))
    error = caught.value
    assert (error.code, error.exit_code) == ("refused", 4)
    assert error.fit.verdict == "refused"
    assert error.evidence["noise"] == only(error.fit, "noise").number
    assert str(error) == "; ".join(f.advice for f in error.fit.findings if f.severity == "refuses")


def test_a_stricter_target_limits_and_then_refuses_the_same_recording() -> None:
    worst = sound().heading_error_deg.worst
    verdicts = [judged(plain(), target_deg=target).verdict for target in (1.01 * worst, 0.9 * worst, worst / 5.1)]
    assert verdicts == ["good", "limited", "refused"]


def test_advice_names_the_side_that_was_never_seen() -> None:
    """The field was never met within 140° of straight up: the gap's middle is at −z."""
    advice = only(judged(cap(40.0)), "coverage").advice
    assert "turn the sensor until its −z side points along the field" in advice


def test_a_stuck_rail_is_told_from_the_end_of_a_sphere() -> None:
    rails = [finding.advice for finding in at_the_rails().findings if finding.code == "saturated"]
    assert len(rails) >= 2
    assert any("highest value of x (60)" in advice for advice in rails)
    assert any("lowest value of y (-60)" in advice for advice in rails)
    coarse = judged(plain(5000, sensor=Sensor(np.eye(3), np.zeros(3), 0.2, resolution=4.0)))
    assert "saturated" not in {finding.code for finding in coarse.findings}


def test_the_axes_mapping_of_an_array_can_be_given() -> None:
    fit = judged(plain().field, axes=Axes.of("y,x,z"))
    assert only(fit, "mirrored-axes").severity == "limits"
