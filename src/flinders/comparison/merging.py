"""Merging of several calibrations of one sensor, if the recordings are lost or too many for one fit.

Each calibration is weighted with its claimed covariance. If the calibrations scatter by more than they claim, something
changed between recordings, and the scatter is added to the covariance of the result. If they contradict each other, the
result is limited or refused, and states which calibration deviates, and by how many degrees.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> from flinders.fitting.result import with_calibration, with_name
>>> sensor = simulate.Sensor.random(np.random.default_rng(7))
>>> monday, tuesday = (
...     with_name(calibrate.fit(simulate.tumble(seed=seed, sensor=sensor, motion="uniform").samples), name)
...     for seed, name in ((1, "monday"), (2, "tuesday"))
... )
>>> merged = merge([monday, tuesday])
>>> merged.verdict, merged.evidence.samples
('good', 2000)
>>> merged.heading_error_deg.worst < merged.evidence.diagnosis.repeats.parts[0].claimed_deg
True
>>> moved = replace(tuesday.calibration, offset=tuesday.calibration.offset + [3, 0, 0])
>>> merge([monday, with_calibration(tuesday, moved)])
Traceback (most recent call last):
flinders.comparison.merging.NotMerged: monday and tuesday are 6.4° of heading apart (3.0 µT in the offset), \
which is not chance: something magnetic changed in between; use recordings made in the state of use
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.comparison.comparison import refuse_unlike
from flinders.comparison.pairs import remove_scale, rescale_covariance, trace_with
from flinders.core.calibration import Calibration
from flinders.core.keywords import check_keywords
from flinders.core.units import Unit, unit_label
from flinders.diagnostics.repeatability import RecordingFit, compare_recordings
from flinders.errors import UsageError, count_text, figures
from flinders.findings import link_causes
from flinders.findings.catalogue import CALIBRATION_FINDINGS
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Diagnosis, Evidence, Residuals
from flinders.fitting.record import expected_error
from flinders.fitting.result import Fit, Judgement, Provenance, Refused
from flinders.fitting.verdict import contradiction_values, judge_calibration
from flinders.geometry.ellipsoid import Ellipsoid, upper_entries
from flinders.summary.pooling import chi_square_of, pool

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration_file import SourceFile
    from flinders.diagnostics.repeatability import Repeats
    from flinders.findings import Finding

METHOD: Final = "merged"

COVERAGE_FINDINGS: Final = frozenset({"coverage", "unobservable-parameters", "prior", "inflation", "level-plane"})
"""Codes of findings on missing coverage, which do not apply if another recording has this coverage."""

RECOMPUTED_FINDINGS: Final = frozenset({"heading-error", "axis-ratio", "mirrored-axes"})
"""Codes of findings that are computed again for the result."""

MAX_RADIUS_SIGMA: Final = 0.05
"""Largest relative standard deviation of a radius at which the scale can be removed to first order.

Two level turns, whose radius is known by the prior to 1/6, gave a result 20 times worse than either:
`tests/comparison/test_merging.py`.
"""

MAX_RADIUS_RATIO: Final = 10.0
"""Largest ratio of radii of one sensor; the earth's field varies by a factor of three."""

MIN_RADIUS, MAX_RADIUS, MAX_OFFSET_RATIO, MIN_SIGMA_RATIO, MAX_GAIN_RATIO = 1e-30, 1e30, 1e6, 1e-9, 1e4
"""Limits of plausible calibrations, against typing errors and rounding errors.

They are the radius in any unit, the largest offset or uncertainty in radii, the smallest uncertainty of an offset in
radii, and the ratio of the gains of two axes.
"""


class NotMerged(Refused):
    """Calibrations contradict each other, or the result is too uncertain; the attribute `fit` has the result."""

    code: ClassVar[str] = "not-merged"


@check_keywords()
def merge(parts: Sequence[Fit], *, target_deg: float = 1.0, dip_deg: float | None = None) -> Fit:
    """Merge several calibrations of one sensor.

    The mean over offset and shape is weighted with the inverse covariances, and minimises

        Σ (θᵢ − θ)ᵀ Pᵢ⁻¹ (θᵢ − θ)

    which is to first order a joint fit of all recordings. The scatter of the calibrations beyond their claims is added
    to the covariance of the mean (`flinders.summary.pooling`).

    Scale: unless the field strength of all calibrations is known, the radius of each depends on an unknown field, and
    is no property of the sensor. All are then scaled to the geometric mean of their radii, and the weights exclude the
    scale.

    Parameters
    ----------
    parts : sequence of Fit
        Two or more, fitted or loaded from their files, from different recordings, in the same unit and axes, each with
        its covariance.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float, optional
        Inclination of the field at the site, positive if it points along +z of the mapped axes. By default the steepest
        dip at which one of them was judged, else 60°.

    Returns
    -------
    Fit
        Fit of the mean, whose covariance includes the scatter beyond the claims; `Diagnosis.repeats` compares the
        calibrations.

    Raises
    ------
    NotMerged
        If they contradict each other, or the heading error is too large for use.
    UnitError, AxesError
        For calibrations in different units, axes or frames.
    UsageError
        For fewer than two calibrations, calibrations of two sensors, or a recording used in two of them; for a
        calibration without a claim, with parameters that its method fixes, with an unknown size and no field strength,
        or with a rotation other than the symmetric one; for numbers out of range.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    _refuse(parts)
    dip = _dip(parts) if dip_deg is None else dip_deg
    field = _Field.of(parts)
    brought = [field.scale(part) for part in parts]
    _refuse_constrained(brought)
    together = pool([part.parameters for part in brought], [part.covariance for part in brought])
    ellipsoid = Ellipsoid.of_parameters(together.mean)
    if not ellipsoid.semi_axes[0] > 0.0:
        raise UsageError(
            "the calibrations are so different that their mean is no ellipsoid: merge calibrations of one sensor only"
        )
    ellipsoid, covariance = field.settle(ellipsoid, together.covariance + together.prediction_scatter)
    repeats = compare_recordings(brought, dip_deg=dip)
    distortion = max(map(_distortion, parts))
    error, structure_deg = expected_error(ellipsoid, covariance, dip_deg=dip, distortion=distortion)
    calibration = _calibration(parts, ellipsoid, field)
    evidence = Evidence(
        method=METHOD,
        samples=sum(part.evidence.samples for part in parts),
        noise=_noise(parts),
        residuals=Residuals(distortion=distortion),
        diagnosis=Diagnosis(repeats=repeats),
    )
    claim = Claim(
        calibration,
        covariance,
        heading_error_deg=error,
        structure_deg=structure_deg,
        dip_deg=abs(dip),
        target_deg=float(target_deg),
    )
    merged = Fit(calibration, evidence, claim, Judgement(), Provenance(METHOD))
    merged = replace(merged, judgement=Judgement(_findings(merged, repeats, parts)))
    if merged.verdict == "refused":
        raise NotMerged(merged)
    return merged


def source_files(parts: Sequence[Fit]) -> tuple[SourceFile, ...]:
    """The recordings of several calibrations, each once, in the order of their names."""
    files = {file.sha256: file for part in parts for file in part.provenance.files}
    return tuple(sorted(files.values(), key=lambda file: (file.name, file.sha256)))


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """The common field strength to which calibrations are scaled."""

    strength: float  # strength, in the unit of the calibrations
    is_known: bool  # whether all calibrations have a known field strength
    reference: Floats  # (3, 3): shape by which the scale is defined
    log_variance: float  # variance of the logarithm of the strength

    @classmethod
    def of(cls, parts: Sequence[Fit]) -> _Field:
        known = all(part.calibration.field_strength_known for part in parts)
        sizes = np.array([part.calibration.field_strength if known else _radius(part) for part in parts])
        strength = float(np.exp(np.log(sizes).mean()))
        shapes = [strength / size * part.calibration.shape for size, part in zip(sizes, parts, strict=True)]
        variances = [_log_size_variance(part) for part in parts]
        for part, variance in zip(parts, variances, strict=True):
            if not known and variance > MAX_RADIUS_SIGMA**2:
                raise UsageError(
                    f"the radius of {part.provenance.name} is uncertain by {np.sqrt(variance):.0%}, and not all "
                    "calibrations have a known field strength: calibrate it with a field strength, or leave it out",
                    hint={"site": None},
                )
        log_variance = 0.0 if known else float(np.sum(variances)) / len(parts) ** 2
        return cls(strength, known, np.mean(shapes, axis=0), log_variance)

    def scale(self, part: Fit) -> RecordingFit:
        """Scale the shape of a calibration to the field, and remove the scale from its covariance unless known."""
        shape = (part.calibration.shape + part.calibration.shape.T) / 2.0
        if self.is_known:
            factor = self.strength / part.calibration.field_strength
            covariance = rescale_covariance(_claim(part), factor)
        else:
            factor = 3.0 / float(trace_with(self.reference) @ upper_entries(shape))
            covariance = remove_scale(rescale_covariance(_claim(part), factor), factor * shape, self.reference)
        return RecordingFit(
            part.provenance.name, part.evidence.samples, Ellipsoid(part.calibration.offset, factor * shape), covariance
        )

    def settle(self, ellipsoid: Ellipsoid, covariance: Floats) -> tuple[Ellipsoid, Floats]:
        """Scale the mean to the common size, and add the uncertainty of that size to its covariance."""
        if self.is_known:
            return ellipsoid, covariance
        factor = self.strength / ellipsoid.radius
        sized = Ellipsoid(ellipsoid.centre, factor * ellipsoid.shape)
        scale = np.concatenate([np.zeros(3), upper_entries(sized.shape)])
        return sized, rescale_covariance(covariance, factor) + self.log_variance * np.outer(scale, scale)


def _refuse(parts: Sequence[Fit]) -> None:
    """Refuse calibrations that cannot be merged, before any computation."""
    if len(parts) < 2:
        raise UsageError(f"{count_text(len(parts), 'calibration')}: need two or more to merge")
    for part in parts:
        _refuse_alone(part)
    for a, b in combinations(parts, 2):
        refuse_unlike(a, b)
        _refuse_pair(a, b)


def _radius(part: Fit) -> float:
    """Geometric mean of the semi-axes: the length of readings about the offset."""
    _, log_gain = np.linalg.slogdet(part.calibration.matrix)
    with np.errstate(over="ignore", under="ignore"):
        return float(np.exp(np.log(part.calibration.field_strength) - log_gain / 3.0))


def _log_size_variance(part: Fit) -> float:
    """Claimed variance of the logarithm of an ellipsoid's radius."""
    trace = trace_with(part.calibration.shape)
    return float(trace @ _claim(part)[3:, 3:] @ trace / 9.0)


def _claim(part: Fit) -> Floats:
    """(9, 9) covariance by which a calibration is weighted."""
    if not part.claim.states_uncertainty:
        raise UsageError(
            f"{part.provenance.name} states no uncertainty to weight it by: calibrate again from its "
            "recording, or leave it out"
        )
    return part.claim.covariance


def _distortion(part: Fit) -> float:
    """Direction-dependent error of a calibration, in its unit; all calibrations of one sensor share this error."""
    across = math.radians(part.claim.structure_deg) * math.cos(math.radians(part.claim.known_dip_deg))
    return across * part.calibration.ellipsoid.radius


def _refuse_alone(part: Fit) -> None:
    """Refuse a calibration that cannot be merged with any other."""
    _claim(part)
    if names := [disturbance.name for disturbance in part.calibration.disturbances]:
        raise UsageError(
            f"{part.provenance.name} follows {' and '.join(names)}, and a mean of offset and matrix follows nothing: "
            "fit the recordings together",
            hint={"disturbances": names},
        )
    if part.calibration.linearization is not None:
        raise UsageError(
            f"{part.provenance.name} linearizes its axes, and a mean of offset and matrix is not linearized: calibrate "
            "from one recording"
        )
    if part.calibration.rotation != "symmetric":
        raise UsageError(
            f"{part.provenance.name} has a rotation ({part.calibration.rotation}), which its covariance does not "
            "include: merge the calibrations as fitted, and rotate the result"
        )
    gains = np.linalg.eigvalsh(part.calibration.matrix)
    if not gains[0] > 0.0:
        raise UsageError(
            f"{part.provenance.name} mirrors an axis, which no fit does: map its axes, and calibrate again",
            hint={"axes": None},
        )
    radius = _radius(part)
    offset, variances = float(np.abs(part.calibration.offset).max()), np.diag(_claim(part))
    largest, finest = np.sqrt([max(variances.max(), 0.0), max(variances[:3].max(), 0.0)]).tolist()
    is_sane = MIN_RADIUS < radius < MAX_RADIUS and max(offset, largest) < MAX_OFFSET_RATIO * radius
    if not (is_sane and finest > MIN_SIGMA_RATIO * radius and gains[2] < MAX_GAIN_RATIO * gains[0]):
        raise UsageError(
            f"{part.provenance.name} is no plausible calibration of a magnetometer: radius {radius:.2g}, offset "
            f"{offset:.2g} ± {finest:.2g}, one axis {gains[2] / gains[0]:.2g} times as sensitive as another; leave it "
            "out"
        )
    if part.verdict == "refused":
        raise UsageError(f"{part.provenance.name} has the verdict refused and must not be used: leave it out")


def _refuse_pair(a: Fit, b: Fit) -> None:
    """Refuse two calibrations that are not of one sensor, or not independent of each other."""
    ours, theirs = a.calibration, b.calibration
    if None not in (ours.sensor, theirs.sensor) and ours.sensor != theirs.sensor:
        raise UsageError(
            f"{a.provenance.name} is for sensor {ours.sensor!r}, {b.provenance.name} for {theirs.sensor!r}: only "
            "calibrations of one sensor can be merged"
        )
    strengths = ours.field_strength, theirs.field_strength
    gains = _radius(a) / strengths[0], _radius(b) / strengths[1]
    for low, high in (sorted(gains), sorted(strengths)):
        if high > MAX_RADIUS_RATIO * low:
            raise UsageError(
                f"{a.provenance.name} has a radius of {figures(_radius(a), 3)} {unit_label(ours.unit)}, "
                f"{b.provenance.name} one of {figures(_radius(b), 3)}: gain or unit differ; calibrate both "
                "with the same gain and unit"
            )
    if np.array_equal(ours.offset, theirs.offset) and np.array_equal(ours.matrix, theirs.matrix):
        if a.provenance.name == b.provenance.name:
            raise UsageError(f"{a.provenance.name} is given twice: name each calibration once")
        raise UsageError(
            f"{a.provenance.name} and {b.provenance.name} are the same calibration, which would be counted twice: "
            "leave one out"
        )
    shared = {file.sha256 for file in b.provenance.files}
    same = [file.name for file in a.provenance.files if file.sha256 in shared]
    if same:
        raise UsageError(
            f"{a.provenance.name} and {b.provenance.name} were both made from {' and '.join(same)}, which would be "
            "counted twice: leave one out"
        )
    turns = [one.claim.plane is not None for one in (a, b)]
    if turns[0] != turns[1]:
        level, other = (a, b) if turns[0] else (b, a)
        raise UsageError(
            f"{level.provenance.name} comes from a level turn and assumes the given dip, "
            f"{other.provenance.name} measured the dip: leave {level.provenance.name} out"
        )


def _refuse_constrained(parts: Sequence[RecordingFit]) -> None:
    """Refuse a calibration whose method fixes parameters that others estimate, as zero variances would dominate."""
    zero = np.zeros(9)
    total = np.sum([part.covariance for part in parts], axis=0)
    freedom = chi_square_of(zero, total)[1]
    for part in parts:
        free = chi_square_of(zero, part.covariance)[1]
        if free < freedom:
            raise UsageError(
                f"{part.source} estimates only {free} of {freedom} parameters: calibrate with a method that estimates "
                "all of them, such as auto"
            )


def _dip(parts: Sequence[Fit]) -> float:
    """The steepest dip at which a calibration was judged, with its sign."""
    dips = [part.heading_error_deg.dip_deg for part in parts if math.isfinite(part.heading_error_deg.dip_deg)]
    return max(dips, key=lambda dip: (abs(dip), dip), default=60.0)


def _noise(parts: Sequence[Fit]) -> float:
    """Rms noise over all calibrations with known noise; NaN if none is known."""
    known = [part for part in parts if math.isfinite(part.evidence.noise)]
    if not known:
        return math.nan
    weights = [max(part.evidence.samples, 1) for part in known]
    return float(np.sqrt(np.average([part.evidence.noise**2 for part in known], weights=weights)))


def _calibration(parts: Sequence[Fit], ellipsoid: Ellipsoid, field: _Field) -> Calibration:
    """The merged correction, with the unit and axes of the parts."""
    first = parts[0].calibration
    units = [part.calibration.raw for part in parts]
    named = sorted({part.calibration.sensor for part in parts if part.calibration.sensor is not None})
    merged = Calibration.from_ellipsoid(
        ellipsoid.centre,
        ellipsoid.shape,
        field_strength=field.strength if field.is_known else None,
        raw=first.raw if len(set(units)) == 1 else Unit.of(first.unit),
        axes=first.axes,
        sensor=named[0] if named else None,
    )
    return replace(merged, frame=first.frame)


def _findings(merged: Fit, repeats: Repeats, parts: Sequence[Fit]) -> tuple[Finding, ...]:
    """Findings on the merged calibration, the most severe first."""
    part, worst_deg, scatter_deg = repeats.most_deviating, merged.heading_error_deg.worst, repeats.scatter_deg
    found = tuple(
        judge_calibration(
            merged.calibration,
            ("recordings-differ", "heading-error", *CALIBRATION_FINDINGS),
            target_deg=merged.claim.target_deg,
            values={
                **contradiction_values(repeats, unit_label(merged.calibration.unit)),
                "differ_deg": min(scatter_deg, worst_deg) if scatter_deg > worst_deg / 2.0 else math.nan,
                "next_step": ("merge-others",),
            },
            level_worst_deg=worst_deg,
            apart_deg=part.difference_deg,
            apart_sigma_deg=part.difference_sigma_deg,
            apart_by_chance=part.p_value,
        )
    )
    is_said = any(finding.code == "recordings-differ" and finding.severity == "refuses" for finding in found)
    apart = [finding for finding in found if finding.code == "recordings-differ"]
    accuracy = [finding for finding in found if finding.code == "heading-error" and not is_said]
    own = [finding for finding in found if finding.code in CALIBRATION_FINDINGS]
    return link_causes([*apart, *accuracy, *_inherited_findings(repeats, parts), *own])


def _inherited_findings(repeats: Repeats, parts: Sequence[Fit]) -> Iterator[Finding]:
    """Limits of the parts that the result inherits, unless another part resolves them."""
    limits = [[one for one in _limits(part) if one.code not in RECOMPUTED_FINDINGS] for part in parts]
    lacks = [[one for one in those if one.code in COVERAGE_FINDINGS] for those in limits]
    if all(lacks):
        claims = [part.claimed_deg for part in repeats.parts]
        best = int(np.argmin(claims))
        for lack in lacks[best]:
            yield _inherit(lack, parts[best], is_best=True)
    for part, those in zip(parts, limits, strict=True):
        for limit in those:
            if limit.code not in COVERAGE_FINDINGS:
                yield _inherit(limit, part)


def _inherit(finding: Finding, part: Fit, *, is_best: bool = False) -> Finding:
    """Finding of the merged calibration from that of a part; `is_best` states that all parts have the finding."""
    parts = (*finding.values.get("parts", ()), (part.provenance.name, float(is_best)))
    return replace(finding, values={**finding.values, "parts": parts})


def _limits(part: Fit) -> Iterator[Finding]:
    """Findings that limit a calibration."""
    return (finding for finding in part.findings if finding.severity == "limits")
