"""Calibrations of one simulated sensor put together: as good as they say, as a joint fit, and never silently wrong."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.program import Ended, flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily
from tests.worlds import RANDOM_SENSOR

import flinders
from flinders import simulate
from flinders.comparison.merging import NotMerged, merge
from flinders.core import calibration_file
from flinders.core.axes import Axes
from flinders.core.units import Unit
from flinders.errors import AxesError, UnitError, UsageError
from flinders.findings import Finding
from flinders.fitting.claim import Claim
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Fit, Judgement, bare_fit, with_calibration, with_name
from flinders.geometry.ellipsoid import upper_entries
from flinders.summary.pooling import chi_square_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Samples
    from flinders.diagnostics.repeatability import Repeats


def moved(by: float) -> simulate.Sensor:
    """The sensor after its battery moved."""
    return replace(RANDOM_SENSOR, offset=RANDOM_SENSOR.offset + np.array([by, 0.0, 0.0]))


@cache
def judged(
    seed: int, name: str = "", *, n: int = 1000, motion: str = "uniform", by: float = 0.0, method: str = "auto"
) -> Fit:
    recording = simulate.tumble(seed=seed, motion=motion, n=n, sensor=moved(by))
    return with_name(flinders.fit(recording.samples, method=method), name or f"{motion} {seed}")


def repeats(merged: Fit) -> Repeats:
    assert merged.evidence.diagnosis.repeats is not None
    return merged.evidence.diagnosis.repeats


def parameters(calibration: Calibration) -> Floats:
    return np.concatenate([calibration.offset, upper_entries(calibration.shape)])


# how good it is


@pytest.mark.parametrize(
    ("known", "fields", "motion"),
    daily([(True, (50.0, 50.0), "uniform"), (False, (45.0, 60.0), "uniform"), (False, (50.0, 50.0), "tilted")]),
)
def test_it_is_as_good_as_it_claims(known: bool, fields: tuple[float, float], motion: str, trials: Choose) -> None:
    """With 400 pairs of 500 readings 0.94 (0.02), 0.94 (0.02), and 1.04 (0.04) with 200 of 1,000."""
    claim = trials(60, 12)
    squares = []
    for trial in claim.seeds:
        sensor = simulate.Sensor.random(np.random.default_rng(1000 + trial))
        parts = []
        for part, field in enumerate(fields):
            samples = simulate.tumble(
                seed=2 * trial + part, sensor=sensor, motion=motion, n=500, field_strength=field
            ).samples
            fit = flinders.fit(samples, site=flinders.Site(strength=field if known else None))
            parts.append(with_name(fit, f"part {part}"))
        merged = merge(parts)
        assert merged.calibration.field_strength_known is known
        turn, gains, _ = np.linalg.svd(sensor.matrix)
        true = np.concatenate([sensor.offset, upper_entries(np.sqrt(np.prod(fields)) * (turn * gains) @ turn.T)])
        square, freedom = chi_square_of(parameters(merged.calibration) - true, merged.claim.covariance)
        assert freedom == 9
        squares.append(square)
    low, high = claim.ratios(0.7, 1.35)
    assert low < np.mean(squares) / 9.0 < high


def halves(samples: Samples, **options: Any) -> tuple[flinders.Fit, list[flinders.Fit]]:
    middle = len(samples.field) // 2
    parts = (samples[:middle], samples[middle:])
    return flinders.fit(samples, **options), [flinders.fit(part, **options) for part in parts]


@pytest.mark.parametrize("field_strength", [None, 50.0])
def test_two_halves_merged_are_the_joint_fit(field_strength: float | None) -> None:
    """To a tenth of its sigma, where neither half takes its residuals for correlated and so weighs less."""
    ratios = []
    for seed in range(12):
        recording = simulate.tumble(seed=seed, motion="uniform", n=2000, sensor=RANDOM_SENSOR)
        whole, parts = halves(recording.samples, site=flinders.Site(strength=field_strength))
        merged = merge([with_name(part, name) for part, name in zip(parts, "ab", strict=True)])
        sigma = np.sqrt(np.diag(whole.claim.covariance))
        off = parameters(merged.calibration) - parameters(whole.calibration)
        if any(part.evidence.residuals.independent_samples < part.evidence.samples for part in parts):
            continue
        assert np.abs(off / sigma).max() < 0.1
        if not repeats(merged).scatter.any():
            npt.assert_allclose(np.sqrt(np.diag(merged.claim.covariance)), sigma, rtol=0.08)
            ratios.append(merged.heading_error_deg.worst / whole.heading_error_deg.worst)
    assert len(ratios) >= 3
    assert np.median(ratios) == pytest.approx(1.0, abs=0.03)


def test_two_hemispheres_make_up_for_each_other() -> None:
    """Each is weak where the other is strong; the plain mean would be as weak as the weaker."""
    down, up = (with_name(one, name) for one, name in ((judged(1, motion="hemisphere"), "a"), (judged(2), "b")))
    merged = merge([down, up])
    assert merged.heading_error_deg.worst < min(part.claimed_deg for part in repeats(merged).parts)
    assert merged.verdict == "good"


def test_unlike_fields_of_unknown_strength_merge_well() -> None:
    parts = []
    for seed, field in enumerate((25.0, 50.0, 65.0)):
        samples = simulate.tumble(seed=seed, motion="uniform", sensor=RANDOM_SENSOR, field_strength=field).samples
        parts.append(with_name(flinders.fit(samples), f"{field:g} µT"))
    merged = merge(parts)
    assert merged.verdict == "good"
    assert repeats(merged).p_value > 0.01
    assert np.linalg.det(merged.calibration.matrix) == pytest.approx(1.0)
    turn, gains, _ = np.linalg.svd(RANDOM_SENSOR.matrix)
    shape = (turn * gains) @ turn.T
    npt.assert_allclose(merged.calibration.matrix, np.linalg.inv(shape) * np.cbrt(np.linalg.det(shape)), atol=0.004)
    radius = np.cbrt(25.0 * 50.0 * 65.0 * np.linalg.det(shape))
    assert merged.calibration.field_strength == pytest.approx(radius, rel=1e-3)


# those that contradict each other


def test_a_moved_battery_is_refused_by_name() -> None:
    parts = [judged(1, "monday"), judged(2, "tuesday"), judged(3, "moved", by=3.0)]
    with assert_raises(NotMerged) as caught:
        merge(parts)
    merged = caught.value.fit
    assert merged.verdict == "refused"
    assert repeats(merged).most_deviating.source == "moved"
    assert repeats(merged).most_deviating.difference_deg == pytest.approx(np.rad2deg(3.0 / 25.0), rel=0.15)
    assert json_of(merged)["calibration"] is None
    assert caught.value.evidence["recordings-differ"] == pytest.approx(repeats(merged).most_deviating.difference_deg)
    with assert_raises(NotMerged):
        merge([parts[2], parts[0]])


def test_by_how_much_they_differ_makes_the_verdict() -> None:
    """0.15 µT is a third of a degree, 0.7 µT one and a half."""
    one = judged(1, "monday", n=8000)
    near, far = (judged(2, "tuesday", n=8000, by=by) for by in (0.15, 0.7))
    slight, limited = merge([one, near]), merge([one, far])
    assert [finding.severity for finding in slight.findings if finding.code == "recordings-differ"] == ["note"]
    assert slight.verdict == "good"
    assert limited.verdict == "limited"
    assert limited.findings[0].code in ("recordings-differ", "heading-error")
    assert limited.heading_error_deg.worst > 3.0 * max(part.claimed_deg for part in repeats(limited).parts)
    with pytest.raises(NotMerged):
        merge([one, far], target_deg=0.25)


def test_what_they_differ_by_is_in_the_heading_error() -> None:
    one, far = judged(1, "monday", n=8000), judged(2, "tuesday", n=8000, by=0.7)
    error = merge([one, far]).heading_error_deg.worst
    apart = repeats(merge([one, far])).most_deviating.difference_deg
    assert 0.5 * apart < error < 1.5 * apart


# what limits them limits the result


def limited_by(one: Fit, code: str) -> Fit:
    return replace(one, judgement=Judgement((Finding(code, "limits", {}),)))


def test_what_one_lacks_another_makes_up_for() -> None:
    assert merge([limited_by(judged(1), "coverage"), judged(2)]).verdict == "good"
    both = merge([limited_by(judged(1), "coverage"), limited_by(judged(2), "unobservable-parameters")])
    assert both.verdict == "limited"
    assert [is_best for _, is_best in both.findings[0].values["parts"]] == [1.0]


def test_what_was_wrong_with_one_stays_wrong() -> None:
    merged = merge([limited_by(judged(1, "monday"), "saturated"), judged(2)])
    assert merged.verdict == "limited"
    assert merged.findings[0].values["parts"] == (("monday", 0.0),)
    assert_sentences(merged.findings[0].advice)


# what cannot be merged


def test_fewer_than_two() -> None:
    for parts in ([], [judged(1)]):
        with assert_raises(UsageError):
            merge(parts)


def turned(one: Fit) -> Fit:
    angle = np.deg2rad(5.0)
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return replace(
        one, calibration=replace(one.calibration, matrix=about_z @ one.calibration.matrix, rotation="estimated")
    )


def with_(**changes: Any) -> Callable[[Fit], Fit]:
    return lambda one: with_calibration(one, replace(one.calibration, **changes))


def refused(one: Fit) -> Fit:
    return replace(one, judgement=replace(one.judgement, stated_verdict="refused"))


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (with_(raw=Unit.of("counts")), UnitError),
        (with_(axes=Axes.of("x,-y,-z")), AxesError),
        (with_(frame="boat"), AxesError),
        (with_(matrix=np.diag([1.0, 1.0, -1.0])), UsageError),
        (turned, UsageError),
        (refused, UsageError),
        (lambda one: replace(one, claim=replace(one.claim, covariance=np.zeros((9, 9)))), UsageError),
    ],
)
def test_what_cannot_be_merged(change: Callable[[Fit], Fit], error: type[Exception]) -> None:
    with assert_raises(error):
        merge([judged(1, "monday"), change(judged(2, "other"))])


def test_sensors_are_not_mixed() -> None:
    named = [with_(sensor=name)(judged(seed)) for seed, name in ((1, "A7"), (2, "B8"), (3, None))]
    with assert_raises(UsageError):
        merge(named)
    assert merge([named[2], named[0]]).calibration.sensor == "A7"


def test_a_level_turn_is_not_merged_with_a_tumble() -> None:
    with assert_raises(UsageError):
        merge([judged(1), judged(2, "turn", motion="level", method="level")])


def test_two_level_turns_are_as_limited_as_each() -> None:
    with assert_raises(UsageError):
        merge([judged(seed, motion="level", method="level") for seed in (1, 2)])
    recordings = [simulate.tumble(seed=seed, motion="level", sensor=RANDOM_SENSOR).samples for seed in (1, 2)]
    fits = [flinders.fit(recording, method="level", site=flinders.Site(strength=50.0)) for recording in recordings]
    merged = merge([with_name(fit, f"turn {number}") for number, fit in enumerate(fits)])
    assert merged.verdict == "limited"
    assert "level-plane" in [finding.code for finding in merged.findings]
    assert merged.heading_error_deg.worst < min(part.claimed_deg for part in repeats(merged).parts)


def test_the_scale_is_known_only_where_all_know_it() -> None:
    fits = [
        flinders.fit(
            simulate.tumble(seed=seed, motion="uniform", sensor=RANDOM_SENSOR).samples,
            site=flinders.Site(strength=field),
        )
        for seed, field in ((1, 50.0), (2, 50.0), (3, None))
    ]
    parts = [with_name(fit, f"{seed}") for seed, fit in enumerate(fits)]
    known, mixed = merge(parts[:2]), merge(parts)
    assert known.calibration.field_strength_known
    assert known.calibration.field_strength == pytest.approx(50.0)
    assert not mixed.calibration.field_strength_known
    npt.assert_allclose(np.linalg.det(mixed.calibration.matrix), 1.0)


def test_recordings_in_other_units_of_one_kind_merge() -> None:
    """In milligauss and in nanotesla: what is merged is for microtesla."""
    parts = [with_(raw=Unit.of(unit))(judged(seed)) for seed, unit in ((1, "mG"), (2, "nT"))]
    assert merge(parts).calibration.raw == Unit.of("uT")
    assert merge([with_(raw=Unit.of("mG"))(part) for part in parts]).calibration.raw == Unit.of("mG")


def test_numbers_out_of_range() -> None:
    parts = [judged(1), judged(2)]
    for wrong in ({"target_deg": 0.0}, {"target_deg": float("nan")}, {"dip_deg": 90.0}):
        with pytest.raises(UsageError):
            merge(parts, **wrong)


def test_the_dip_is_that_of_the_calibrations() -> None:
    def at(dip: float, seed: int) -> Fit:
        samples = simulate.tumble(seed=seed, motion="uniform", sensor=RANDOM_SENSOR).samples
        return with_name(flinders.fit(samples, site=flinders.Site(inclination_deg=dip)), f"dip {dip:g}")

    assert merge([at(50.0, 1), at(70.0, 2)]).heading_error_deg.dip_deg == 70.0
    assert merge([at(50.0, 1), at(70.0, 2)], dip_deg=40.0).heading_error_deg.dip_deg == 40.0
    fits = (judged(1), judged(2))
    bare = [
        replace(bare_fit(one.calibration, name=name), claim=Claim(one.calibration, one.claim.covariance))
        for one, name in zip(fits, "ab", strict=True)
    ]
    found = merge(bare)
    assert (found.heading_error_deg.dip_deg, found.evidence.samples, np.isnan(found.evidence.noise)) == (60.0, 0, True)


# on the command line

HEADER = "mx_uT,my_uT,mz_uT"
RECORDINGS = (("monday", 3, 0.0), ("tuesday", 4, 0.0), ("friday", 5, 0.0), ("moved", 6, 3.0))


def run(words: str) -> Ended:
    return flinders_(*words.split())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of a sensor and their calibrations, the last after its battery moved; files that are not sound."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as context:
        context.chdir(folder)
        for name, seed, by in RECORDINGS:
            field = simulate.tumble(seed=seed, motion="uniform", sensor=moved(by)).samples.field
            rows = [",".join(f"{value:.3f}" for value in row) for row in field]
            Path(f"{name}.csv").write_text("\n".join([HEADER, *rows, ""]), encoding="utf-8")
            assert run(f"calibrate {name}.csv -o {name}.json").code == 0
        assert run("calibrate friday.csv tuesday.csv -o both.json").code == 0
        spoil()
    return folder


@pytest.fixture
def home(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


def edit(source: str, target: str, **parts: dict[str, object] | None) -> None:
    """Copy a calibration file with some of its parts changed."""
    content = json.loads(Path(source).read_text(encoding="utf-8"))
    for part, entries in parts.items():
        content[part] = None if entries is None else {**content[part], **entries}
    Path(target).write_text(json.dumps(content), encoding="utf-8")


@pytest.mark.usefixtures("home")
def test_the_file_that_is_written() -> None:
    ended = run("merge monday.json tuesday.json friday.json -o merged.json")
    assert ended.code == 0
    assert_sentences(ended.err)
    for words in ("tuesday.json", "1,000", "GOOD", "3 calibrations of 3,000 readings"):
        assert words in ended.out
    found = calibration_file.read("merged.json")
    assert found.fit is not None
    assert found.provenance is not None
    assert (found.fit.method, found.fit.samples, found.fit.verdict, found.fit.coverage) == ("merged", 3000, "good", {})
    assert [file.name for file in found.provenance.files] == ["friday.csv", "monday.csv", "tuesday.csv"]
    assert found.fit.noise == pytest.approx(0.5, rel=0.05)
    for line, code in (
        ("check merged.json moved.csv", 4),
        ("apply merged.json friday.csv -o corrected.csv", 0),
        ("compare merged.json moved.json", 4),
    ):
        assert run(line).code == code
    own = run("check merged.json friday.csv")
    assert "CANNOT TELL" in own.out


@pytest.mark.usefixtures("home")
def test_a_refusal_shows_no_number_of_the_calibration_and_writes_nothing() -> None:
    ended = run("merge monday.json tuesday.json moved.json -o merged.json")
    assert (ended.code, ended.out) == (4, "")
    assert "REFUSED" in ended.err
    assert_sentences(" ".join(ended.err.split()))
    assert "offset  " not in ended.err
    assert not Path("merged.json").exists()


@pytest.mark.usefixtures("home")
def test_json() -> None:
    good, bad = run("merge monday.json tuesday.json --json"), run("merge monday.json moved.json --json")
    found, refusal = json.loads(good.out), json.loads(bad.out)
    assert list(found) == list(json_of(judged(1)))
    assert (good.code, found["verdict"], found["method"]) == (0, "good", "merged")
    assert [part["source"] for part in found["repeats"]["parts"]] == ["monday.json", "tuesday.json"]
    assert (bad.code, refusal["verdict"], refusal["calibration"]) == (4, "refused", None)
    assert refusal["error"]["code"] == "not-merged"
    assert refusal["error"]["exit_code"] == 4
    assert refusal["error"]["evidence"]["recordings-differ"] == pytest.approx(6.9, rel=0.15)


@pytest.mark.usefixtures("home")
def test_a_limited_result_is_written() -> None:
    ended = run("merge monday.json tuesday.json --target 0.05 -o merged.json")
    assert ended.code == 3
    assert Path("merged.json").exists()


@pytest.mark.usefixtures("home")
def test_to_standard_output() -> None:
    ended = run("merge monday.json tuesday.json -o -")
    assert ended.code == 0
    assert calibration_file.loads(ended.out).calibration.unit == "uT"
    assert "GOOD" in ended.err


CORRECTIONS: dict[str, dict[str, object]] = {
    "huge": {"matrix": (1e-300 * np.eye(3)).tolist(), "field_strength": 1e300},
    "tiny": {"matrix": (1e-5 * np.eye(3)).tolist(), "field_strength": 1e-200},
    "far": {"offset": [1e200, 0.0, 0.0]},
    "gain": {"field_strength": 5000.0},
    "flat": {"matrix": np.diag([1.0, 1.0, 1e9]).tolist(), "field_strength": 5e4},
}
COVARIANCES = {
    "vague": 1e300 * np.eye(9),
    "exact": 1e-30 * np.eye(9),
    "correlated": np.diag([0.0] * 8 + [1.0]),
    "fine": 1e-13 * np.eye(9),
}
"""Of what a file may say."""


def spoil() -> None:
    """Write calibration files that cannot be merged."""
    edit("monday.json", "copy.json", provenance=None)
    edit("monday.json", "again.json", calibration={"offset": [1.0, 2.0, 3.0]})
    edit("tuesday.json", "bare.json", fit=None)
    for name, numbers in CORRECTIONS.items():
        edit("tuesday.json", f"{name}.json", calibration=numbers)
    for name, covariance in COVARIANCES.items():
        edit("tuesday.json", f"{name}.json", fit={"covariance": covariance.tolist()})
    Path("broken.json").write_text("{", encoding="utf-8")


@pytest.mark.usefixtures("home")
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("merge", 2),
        ("merge monday.json", 2),
        ("merge monday.json monday.json", 2),
        ("merge monday.json ./monday.json", 2),
        ("merge monday.json copy.json", 2),
        ("merge monday.json again.json", 2),
        ("merge both.json tuesday.json", 2),
        ("merge monday.json monday.csv", 2),
        ("merge monday.json -", 2),
        ("merge monday.json missing.json", 5),
        ("merge monday.json broken.json", 5),
        ("merge monday.json bare.json", 2),
        ("merge monday.json huge.json", 2),
        ("merge monday.json tiny.json", 2),
        ("merge monday.json far.json", 2),
        ("merge monday.json vague.json", 2),
        ("merge monday.json gain.json", 2),
        ("merge monday.json flat.json", 2),
        ("merge monday.json exact.json", 2),
        ("merge monday.json fine.json", None),
        ("merge monday.json correlated.json", 2),
        ("merge monday.json tuesday.json -o friday.json", 6),
        ("merge monday.json tuesday.json -o monday.json --force", 2),
        ("merge monday.json tuesday.json -o nowhere/merged.json", 6),
        ("merge monday.json tuesday.json -o - --json", 2),
        ("merge monday.json tuesday.json --dip 95", 2),
        ("merge monday.json tuesday.json --target 0", 2),
    ],
)
def test_bad_input_is_one_line(words: str, code: int | None) -> None:
    ended = run(words)
    assert ended.code in ((code,) if code else (0, 3, 4)), ended
    assert_sentences(ended.err)
    assert "Traceback" not in ended.err
    assert "internal error" not in ended.err
    if code:
        assert len(ended.err.splitlines()) == 1
