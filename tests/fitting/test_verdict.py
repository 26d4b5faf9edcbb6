"""Every finding there is, found where it should be and with the severity it should have."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.claims import by_hand
from msgspec import json, structs
from tests.sentences import assert_raises, assert_sentences
from tests.worlds import judged, with_slow_noise

import flinders
from flinders import simulate
from flinders.core.axes import Axes
from flinders.core.calibration_file import FindingRecord, ProvenanceRecord, SourceFile
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.errors import DocumentError, FitError, StuckAxis, TooFewSamples
from flinders.findings import CATALOGUE, REFUSALS, Finding
from flinders.fitting.advice import next_guidance
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Refused
from flinders.likelihood.site_field import Site
from flinders.report.plain import page
from flinders.simulate import Sensor, tumble

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

BARE: Final = Sensor(np.eye(3), np.array([20.0, -30.0, 10.0]), 0.2)


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


def flat() -> Fit:
    return judged(plain(motion="level"), method="likelihood")


def level() -> Fit:
    return judged(plain(motion="level"))


def two(moved: float, n: int = 2000) -> Fit:
    """Two recordings of one sensor, the offset of which moved in between."""
    other = Sensor(np.eye(3), np.add(BARE.offset, [moved, 0.0, 0.0]), 0.2)
    return judged(Joined((plain(n), plain(n, seed=2, sensor=other))))


def hardly_moved() -> Fit:
    return two(0.3)


def moved() -> Fit:
    return two(0.7)


def moved_far() -> Fit:
    return two(3.0)


def ramped(change: float) -> Fit:
    """The offset creeps evenly while a hand tumbles the sensor."""
    field = tumble(seed=1, sensor=BARE).samples.field
    return judged(field + np.linspace(0.0, change, len(field))[:, np.newaxis] * [1.0, 0.0, 0.0])


def crept_a_little() -> Fit:
    return ramped(0.2)


def crept() -> Fit:
    return ramped(1.0)


def bent() -> Fit:
    """1 % of the field belongs to the direction, as of a sensor that is not linear."""
    return judged(by_hand(1, distorted=0.01, sigma=0.2).samples.field)


def far_too_wide() -> Fit:
    return judged(cap(20.0))


def poor_heading() -> Fit:
    return judged(plain(60, noise=2.0))


def hopeless_heading() -> Fit:
    return judged(cap(20.0), site=flinders.Site(inclination_deg=75.0))


def half_unseen() -> Fit:
    return judged(plain(3000, motion="tilted"))


def near_iron() -> Fit:
    """Two degrees of heading at a time, of which most averages out."""
    field = tumble(seed=1, n=6000, noise=0.2).samples.field
    return judged(Samples.of(with_slow_noise(field, sigma=1.0, memory=50.0), unit="uT"))


def slowly_disturbed() -> Fit:
    """A disturbance that lasts as long as the recording."""
    field = tumble(seed=1, n=3000, noise=0.2).samples.field
    return judged(Samples.of(with_slow_noise(field, sigma=0.3, memory=6000.0), unit="uT"))


def noisy() -> Fit:
    return judged(plain(4000, noise=4.0))


def drowned() -> Fit:
    return judged(plain(4000, noise=14.0))


def leaning_on_the_prior() -> Fit:
    return judged(cap(20.0))


def skewed() -> Fit:
    soft_iron = np.array([[1.0, 0.05, 0.0], [0.05, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return judged(plain(2000, sensor=Sensor(soft_iron, np.zeros(3), 0.2)), method="minmax")


def hardly_skewed() -> Fit:
    soft_iron = np.array([[1.0, 0.005, 0.0], [0.005, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return judged(plain(2000, sensor=Sensor(soft_iron, np.zeros(3), 0.2)), method="minmax")


def short() -> Fit:
    return judged(plain(14))


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
    return judged(plain(2000, sensor=Sensor(np.eye(3), np.array([20.0, -30.0, 10.0]), 0.2, saturation=60.0)))


def in_steps() -> Fit:
    return judged(plain(3000, sensor=Sensor(np.eye(3), np.zeros(3), 0.2, resolution=8.0)))


def shuffled() -> Fit:
    return judged(np.random.default_rng(1).permutation(plain(motion="hand").field))


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


def with_a_slip() -> Fit:
    field = simulate.tumble(seed=4, n=1500).samples.field.copy()
    field[900:, 1] *= -1.0
    return judged(Samples.of(field, unit="uT"))


def weak_field() -> Fit:
    return judged(plain(2000, field_strength=5.0, noise=0.02))


def strong_field() -> Fit:
    return judged(plain(2000, field_strength=500.0))


def mirrored() -> Fit:
    return judged(Samples.of(plain().field, unit="uT", axes="x,y,-z"))


def slightly_mixed() -> Fit:
    return mixed(0.4)


def two_sensors() -> Fit:
    return mixed(2.0)


def mixed(apart: float) -> Fit:
    """Readings of two sensors by turns, so many µT apart, while they are tumbled."""
    field = plain(2000, motion="hand").field.copy()
    field[1::2] += apart * np.array([0.6, -0.6, 0.53])
    return judged(Samples.of(field, unit="uT"))


def sound() -> Fit:
    return judged(plain())


def of_another_place() -> Fit:
    return judged(plain(), site=Site(35.0, gain_sigma=0.05))


def in_counts() -> Fit:
    return judged(Samples.of(300.0 * plain(motion="hand").field))


def only(fit: Fit, code: str) -> Finding:
    return next(finding for finding in fit.findings if finding.code == code)


CASES: Final[list[tuple[str, str, Callable[[], Fit], tuple[float, float]]]] = [
    # code, severity, recording, what the number should lie between
    ("one-plane", "refuses", flat, (0.0, 0.05)),
    ("level-plane", "limits", level, (0.0, 10.0)),
    ("heading-error", "limits", poor_heading, (1.0, 5.0)),
    ("heading-error", "refuses", hopeless_heading, (5.0, 720.0)),
    ("coverage", "limits", half_unseen, (60.0, 180.0)),
    ("unsteady-field", "limits", near_iron, (1.5, 3.0)),
    ("lasting-noise", "limits", slowly_disturbed, (0.3, 1.0)),
    ("noise", "limits", noisy, (0.06, 0.1)),
    ("noise", "refuses", drowned, (0.2, 0.4)),
    ("prior", "limits", leaning_on_the_prior, (0.1, 1.0)),
    ("bias", "limits", skewed, (1.5, 5.0)),
    ("bias", "note", hardly_skewed, (0.1, 0.3)),
    ("inflation", "limits", far_too_wide, (2.0, 4.0)),
    ("recordings-differ", "note", hardly_moved, (0.25, 1.0)),
    ("recordings-differ", "limits", moved, (1.0, 2.0)),
    ("recordings-differ", "refuses", moved_far, (6.0, 8.0)),
    ("field-changed", "note", crept_a_little, (0.25, 1.0)),
    ("field-changed", "limits", crept, (1.5, 3.0)),
    ("structure", "limits", bent, (0.006, 0.02)),
    ("few-samples", "limits", short, (12, 14)),
    ("unobservable-parameters", "limits", crossing_rings, (1, 1)),
    ("correlated", "note", remembering, (0.05, 0.25)),
    ("alternating", "limits", slightly_mixed, (-0.5, -0.25)),
    ("alternating", "refuses", two_sensors, (-1.0, -0.8)),
    ("outliers", "note", a_few_strays, (0.05, 0.08)),
    ("outliers", "limits", many_strays, (0.2, 0.23)),
    ("saturated", "limits", at_the_rails, (0.01, 0.2)),
    ("quantised", "note", in_steps, (8.0, 8.0)),
    ("stale-repeats", "note", stale, (0.66, 0.67)),
    ("unordered", "note", shuffled, (-0.1, 0.1)),
    ("time-gap", "note", interrupted, (60.0, 60.1)),
    ("time-back", "note", back_in_time, (1, 1)),
    ("skipped-rows", "note", gaps, (3, 3)),
    ("skipped-rows", "limits", mostly_gaps, (100, 100)),
    ("axis-ratio", "limits", unlike_axes, (2.3, 2.5)),
    ("axis-swap", "limits", with_a_slip, (5.0, 500.0)),
    ("field-strength", "limits", weak_field, (4.9, 5.1)),
    ("field-strength", "limits", strong_field, (499, 501)),
    ("strength-differs", "note", of_another_place, (8.5, 8.6)),
    ("mirrored-axes", "limits", mirrored, (-1, -1)),
    ("unit-unknown", "note", in_counts, (14900, 15100)),
    ("scale-unknown", "note", sound, (49.9, 50.1)),
    ("rotation-unknown", "note", sound, (0, 0)),
]


ELSEWHERE: Final = {
    "test_silence.py": ("no-answer",),
    "test_gravity.py": ("like-gravity",),
    "test_rests.py": ("at-rest",),
    "test_minmax.py": ("typed-extremes",),
    "test_report.py": ("no-uncertainty",),
    "test_filters.py": ("filtered",),
    "test_two_axis.py": ("composed",),
    "test_nonlinearity.py": ("nonlinear-axis", "linearized"),
    "test_attitude_dependence.py": ("attitude-dependent",),
    "test_axis_lag.py": ("axis-lag",),
    "test_shrinkage.py": ("corrected-before",),
    "test_refresh.py": ("soft-iron-changed", "poses-contradict"),
    "test_survey.py": ("pointing-error", "shots-contradict"),
    "test_disturbances.py": (
        "disturbance", "disturbance-unmodelled", "disturbance-constant", "disturbance-collinear-attitude",
        "disturbances-collinear", "disturbance-uncertain",
    ),
    "test_named_columns.py": ("column-unused",),
    "test_disturbance_findings.py": (
        "disturbance-monotone", "disturbance-noisy", "disturbance-lag", "disturbance-range", "disturbance-beyond",
        "bench-moved", "bench-tilted",
        "disturbance-reference", "disturbance-nonlinear",
    ),
    "test_aided.py": ("circular-attitude", "gyro-unit", "swapped-axes", "one-axis", "site-differs"),
    "test_mounted.py": ("aid-astray", "rotation-uncertain", "tilt-error", "leans-in-turns"),
    "test_wrong_use.py": ("gyro-differs", "aid-empty", "aid-diverged", "mirrored-axis"),
    "test_gyro_at_fault.py": ("gyro-clipped", "gyro-scales", "gyro-gaps", "aids-disagree"),
    "test_together.py": (
        "sensor-deviates", "sensor-deviates-throughout", "disagree", "copied-sensor", "mirrored-sensor", "turned-to",
        "unlike-units",
        "clock-differs", "not-together",
    ),
}  # fmt: skip
"""Where a finding is tried that takes more than a recording of readings alone."""


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
    stated = finding.as_dict()
    assert stated.pop("values").keys() == set(CATALOGUE[code].names)
    assert stated == {
        "code": code, "severity": severity, "number": finding.number, "limit": finding.limit,
        "follows_from": finding.follows_from, "advice": finding.advice,
    }  # fmt: skip
    assert {"note": ("good", "limited", "refused"), "limits": ("limited", "refused"), "refuses": ("refused",)}[
        severity
    ].count(fit.verdict) == 1


@pytest.mark.parametrize(
    "recording", dict.fromkeys(case[2] for case in CASES), ids=lambda recording: recording.__name__
)
def test_a_file_has_no_sentence_and_a_loaded_finding_has_the_same(recording: Callable[[], Fit]) -> None:
    for finding in recording().findings:
        record = json.decode(json.encode(finding.to_record()), type=FindingRecord)
        assert "advice" not in record.__struct_fields__
        loaded = Finding.from_record(record, "calibration.json")
        assert (loaded, loaded.advice) == (finding, finding.advice)


@pytest.mark.parametrize(
    "values",
    [{"hole_deg": "far"}, {"attitude_limit_deg": 5.0, "tilted": 1.0}, {"next_movement": ["up"]}, {"parts": [{}]}],
)
def test_values_that_make_no_sentence_are_refused(values: dict[str, Any]) -> None:
    record = only(half_unseen(), "coverage").to_record()
    wrong = structs.replace(record, values={**record.values, **values})
    with assert_raises(DocumentError):
        Finding.from_record(wrong, "calibration.json")


def test_values_that_go_too_deep_are_refused() -> None:
    deep: list[Any] = []
    for _ in range(2000):
        deep = [deep]
    record = only(half_unseen(), "coverage").to_record()
    with assert_raises(DocumentError):
        Finding.from_record(structs.replace(record, values={**record.values, "parts": deep}), "calibration.json")


def test_a_finding_without_its_values_says_what_the_catalogue_advises() -> None:
    finding = Finding.from_record(FindingRecord(code="noise", severity="limits", number=0.1, limit=0.05), "bare.json")
    assert (finding.number, finding.limit, finding.values) == (0.1, 0.05, {"number": 0.1, "limit": 0.05})
    assert finding.advice == CATALOGUE["noise"].action
    assert Finding.from_record(FindingRecord(code="new", severity="grave"), "bare.json").advice == "new"


def test_every_code_is_tried() -> None:
    """Here, or in the file that is named, which speaks of its code."""
    tried = {code for code, *_ in CASES}
    elsewhere = {code for codes in ELSEWHERE.values() for code in codes}
    assert not tried & elsewhere
    assert tried | elsewhere == set(CATALOGUE)
    for name, codes in ELSEWHERE.items():
        text = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parents[1].rglob(name))
        assert [code for code in codes if f'"{code}"' not in text] == [], name


def test_every_finding_of_every_recording_is_in_the_table_and_the_gravest_comes_first() -> None:
    order = ["refuses", "limits", "note"]
    for _, _, recording, _ in CASES:
        findings = recording().findings
        assert {finding.code for finding in findings} <= set(CATALOGUE)
        ranks = [order.index(finding.severity) for finding in findings]
        assert ranks == sorted(ranks)


def test_a_sound_recording_is_good_and_has_only_what_nobody_can_know() -> None:
    fit = sound()
    assert fit.verdict == "good"
    assert [finding.code for finding in fit.findings] == ["scale-unknown", "rotation-unknown"]
    known = judged(plain(), site=flinders.Site(strength=50.0))
    assert [finding.code for finding in known.findings] == ["rotation-unknown"]


def test_what_refuses_is_raised_with_the_fit_and_its_numbers() -> None:
    with pytest.raises(Refused) as caught:
        flinders.fit(plain(4000, noise=14.0))
    error = caught.value
    assert (error.code, error.exit_code) == ("refused", 4)
    assert error.fit.verdict == "refused"
    assert error.evidence["noise"] == only(error.fit, "noise").number
    assert str(error) == "; ".join(f.advice for f in error.fit.findings if f.severity == "refuses")


def test_what_limits_or_refuses_says_what_to_do() -> None:
    openings = "also |for all attitudes |else "
    verbs = "turn|hold|keep|record|check|choose|use|see what|find out|change the sign"
    for code, severity, recording, _ in CASES:
        if severity != "note":
            advice = only(recording(), code).advice
            assert re.search(rf"(?:^|[:;,.] )(?:{openings})*(?:{verbs})\b", advice.lower()), advice


def test_findings_count_what_there_is_one_of() -> None:
    field = plain().field.copy()
    field[300] += [0.0, 320.0, 0.0]
    told = " ".join(finding.advice for finding in (*judged(field).findings, *back_in_time().findings))
    assert_sentences(told)
    assert "time steps back once" in told


def test_what_everybody_reads_each_time_is_short() -> None:
    assert all(len(finding.advice) <= 76 for finding in sound().findings)
    assert all(len(finding.advice) <= 96 for finding in in_counts().findings)


def test_a_refused_fit_gives_no_number_to_copy_and_keeps_its_evidence() -> None:
    fit = drowned()
    fields = json_of(fit)
    assert (fields["calibration"], fields["uncorrected_heading_error_deg"]) == (None, None)
    assert fields["noise"] == fit.evidence.noise
    assert fields["coverage"] == fit.evidence.coverage.as_dict()
    assert fields["covariance"] == fit.claim.covariance.tolist()
    assert "noise" in [finding["code"] for finding in fields["findings"]]
    assert fields["heading_error_deg"]["worst"] == fit.heading_error_deg.worst
    assert fit.calibration.matrix.shape == (3, 3)


def test_of_flat_readings_nothing_is_told_that_rests_on_a_surface() -> None:
    fit = flat()
    fields = json_of(fit)
    told = {key for key, value in fields.items() if value is not None}
    assert fit.judgement.is_flat
    assert {"findings", "covariance", "noise", "samples", "unobserved", "prior_influence"} <= told
    assert not told & {"calibration", "coverage", "heading_error_deg", "direction_error_deg", "bias_deg"}


def test_the_fit_has_what_its_json_has() -> None:
    fit = leaning_on_the_prior()
    fields = json_of(fit)
    assert fields["direction_error_deg"] == fit.claim.direction_error_deg._asdict()
    assert 0.0 < fit.claim.direction_error_deg.rms < fit.claim.direction_error_deg.worst
    assert (fields["prior_influence"], fields["unobserved"], fields["bias_deg"]) == (
        fit.evidence.prior_influence,
        fit.evidence.unobserved,
        fit.claim.bias_deg,
    )
    assert fit.evidence.prior_influence > 0.1


# in plain words

READ: Final = ProvenanceRecord(
    flinders="1.2.3",
    date=datetime(2026, 5, 1, 12, 30, tzinfo=UTC),
    files=(SourceFile(name="tumble.csv", sha256="0" * 64, bytes=1, rows=1000),),
)
JARGON: Final = "ellipsoid|likelihood,|covariance|residual|posterior|\\bprior\\b|determinant|eigen|rms|χ|σ|Gauss"


def tree(error: type[FitError]) -> set[type[FitError]]:
    """All that descends from an error and has a code of its own."""
    own = {child for child in error.__subclasses__() if "code" in vars(child)}
    return own.union(*(tree(child) for child in error.__subclasses__()))


def test_all_there_is_to_say_has_plain_words() -> None:
    elsewhere = {"refused", "no-calibration", "needs-samples", "needs-recording", "not-merged", "not-validated"}
    raised = {error.code for error in tree(FitError)} - elsewhere
    assert raised <= {code for code, refusal in REFUSALS.items() if refusal.plain}


@pytest.mark.parametrize("code", CATALOGUE)
def test_plain_words_of_each_finding_take_its_number(code: str) -> None:
    words = CATALOGUE[code]
    assert words.plain.endswith(".")
    assert not re.search(JARGON, words.plain + words.remedy)


RECORDINGS: Final = tuple(dict.fromkeys(case[2] for case in CASES))


@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda recording: recording.__name__)
def test_the_page_of_plain_words(recording: Callable[[], Fit]) -> None:
    fit = recording()
    text = page(Refused(fit) if fit.verdict == "refused" else fit, READ)
    assert max(map(len, text.splitlines())) <= 80
    assert len(text.splitlines()) <= 90
    assert not re.search(JARGON, text)
    assert "1 May 2026, 12:30 UTC, Flinders 1.2.3" in text
    assert "tumble.csv: 1,000 readings" in text
    if fit.verdict == "refused":
        assert "WHY\n- " in text
        assert not re.search(r"offset|matrix|\d ±|\d\.\d{6}", text)
    else:
        assert len(re.findall(r"^    offset [xyz] +-?[\d.]+ ± [\d.]+ (?:µT|counts)$", text, re.MULTILINE)) == 3
        numbers = re.findall(r"^    matrix [xyz] +(-?\d\.\d+) +(-?\d\.\d+) +(-?\d\.\d+)$", text, re.MULTILINE)
        npt.assert_allclose(np.array(numbers, float), fit.calibration.matrix, atol=1e-6)


def test_the_page_of_plain_words_names_what_was_left_out() -> None:
    """Fifty readings that were moved, and half a second after them."""
    assert "readings 1–75: 75 readings" in " ".join(page(a_few_strays(), READ).split())
    assert_sentences(page(gaps(), READ), about="Left out")
    text = page(TooFewSamples(found=1, needed=10, method="level", skipped=["2 unreadable rows (line 3, 4)"]), READ)
    assert_sentences(text)


def test_a_refusal_in_plain_words_says_how_to_move_on() -> None:
    text = " ".join(page(Refused(flat()), READ).split())
    assert_sentences(text)
    stuck = page(StuckAxis(("x",), (1.0,)), READ)
    assert_sentences(stuck)


def test_a_stricter_target_limits_and_then_refuses_the_same_recording() -> None:
    worst = sound().heading_error_deg.worst
    verdicts = [judged(plain(), target_deg=target).verdict for target in (1.01 * worst, 0.9 * worst, worst / 5.1)]
    assert verdicts == ["good", "limited", "refused"]


def test_advice_names_the_side_that_was_never_seen() -> None:
    """The field was met within 40° of +z alone: turned over, it points out of the other side."""
    fit = judged(cap(40.0))
    advice = only(fit, "coverage").advice
    assert_sentences(advice)
    assert next_guidance(fit).direction[2] < -0.5


def test_what_limits_a_level_turn_is_told_with_angles() -> None:
    advice = only(level(), "level-plane").advice
    assert_sentences(advice)


def test_recordings_are_called_by_their_names() -> None:
    assert_sentences(only(moved_far(), "recordings-differ").advice)


def test_what_changed_and_by_how_much_is_told() -> None:
    advice = only(crept(), "field-changed").advice
    assert_sentences(advice)


def test_a_stuck_rail_is_told_from_the_end_of_a_sphere() -> None:
    advice = only(at_the_rails(), "saturated").advice
    assert_sentences(advice)
    coarse = judged(plain(5000, sensor=Sensor(np.eye(3), np.zeros(3), 0.2, resolution=4.0)))
    assert "saturated" not in {finding.code for finding in coarse.findings}


def test_the_axes_mapping_of_an_array_can_be_given() -> None:
    fit = judged(plain().field, axes=Axes.of("y,x,z"))
    assert only(fit, "mirrored-axes").severity == "limits"
