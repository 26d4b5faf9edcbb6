"""Several calibrations of one sensor put together into one, where the recordings are gone or too many to fit at once.

Each is weighted with the covariance that it claims; as far as they scatter beyond their claims, something changed from
one to the next, and the scatter goes into the covariance of what they say together. Those that contradict each
other are not averaged: the merger is limited or refused, and says which of them is off, by how many degrees.

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
from flinders.comparison.pairs import rescaled, trace_with, without_scale
from flinders.core.calibration import Calibration
from flinders.core.keywords import spell_checked
from flinders.core.units import Unit, label
from flinders.diagnostics.repeatability import RecordingFit, compared
from flinders.errors import UsageError, counted, figures
from flinders.findings import linked
from flinders.findings.catalogue import OF_CALIBRATION
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Diagnosis, Evidence, Residuals
from flinders.fitting.record import expected_error
from flinders.fitting.result import Fit, Judgement, Provenance, Refused
from flinders.fitting.verdict import judged_parts, of_contradiction
from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.summary.pooling import chi_square_of, pool

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration_file import SourceFile
    from flinders.diagnostics.repeatability import Repeats
    from flinders.findings import Finding

METHOD: Final = "merged"

LACKING: Final = frozenset({"coverage", "unobservable-parameters", "prior", "inflation", "level-plane"})
"""Findings of something that a recording did not see: one that did makes up for it."""

RENEWED: Final = frozenset({"heading-error", "axis-ratio", "mirrored-axes"})
"""Findings that are made anew of what is merged."""

LOOSE: Final = 0.05
"""Standard deviation of a radius, as a share of it, beyond which it cannot be taken out to first order.

Two level turns, whose radius rests on the prior to a sixth, came out twenty times worse than either:
`tests/comparison/test_merging.py`.
"""

UNLIKE: Final = 10.0
"""Radii that are as many times apart are not those of one sensor: the earth's field varies by three."""

SMALLEST, LARGEST, FARTHEST, FINEST, FLATTEST = 1e-30, 1e30, 1e6, 1e-9, 1e4
"""Radii of a sensor in any unit; an offset or an uncertainty, and what an offset was ever known to, in radii; the gain
of one axis over that of another. Beyond these lie slips of the pen, and the digits of a computer end."""


class NotMerged(Refused):
    """Calibrations that contradict each other, or leave too much open: `fit` holds what they say together."""

    code: ClassVar[str] = "not-merged"


@spell_checked()
def merge(parts: Sequence[Fit], *, target_deg: float = 1.0, dip_deg: float | None = None) -> Fit:
    """Put several calibrations of one sensor together.

    The mean over offset and shape is weighted with the inverse covariances, and minimises

        Σ (θᵢ − θ)ᵀ Pᵢ⁻¹ (θᵢ − θ)

    which is what a joint fit of all recordings finds, as far as each is linear about its own. To the covariance of
    the mean is added what the calibrations scatter beyond their claims (`flinders.summary.pooling`).

    The scale: unless all were given the strength of their field, each was recorded in a field of unknown strength,
    which says nothing of the sensor. All are then brought to the geometric mean of their radii, and the scale
    is left out of all weights.

    Parameters
    ----------
    parts : sequence of Fit
        Two or more, fitted or loaded from their files, from recordings of their own, in the same unit and axes, each
        with its covariance.
    target_deg : float
        Worst heading error that is good enough, in degrees.
    dip_deg : float, optional
        Inclination of the field at the site, positive where it points along +z of the mapped axes. By default the
        steepest that one of them was judged for, else 60°.

    Returns
    -------
    Fit
        With the covariance of the mean and of what they scatter beyond their claims, the readings of all and their
        noise; `Diagnosis.repeats` holds the calibrations against each other.

    Raises
    ------
    NotMerged
        Where they contradict each other, or the heading error is beyond use.
    UnitError, AxesError
        For calibrations in unlike units, axes or frames.
    UsageError
        For fewer than two, two sensors, recordings that went into two of them, a calibration that claims nothing or
        holds what others found, or that leaves its size open where no field strength gives it, a rotation that is not
        the symmetric one; or numbers out of range.
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    _refuse(parts)
    dip = _dip(parts) if dip_deg is None else dip_deg
    field = _Field.of(parts)
    brought = [field.bring(part) for part in parts]
    _refuse_constrained(brought)
    together = pool([part.parameters for part in brought], [part.covariance for part in brought])
    ellipsoid = Ellipsoid.of_parameters(together.mean)
    if not ellipsoid.semi_axes[0] > 0.0:
        raise UsageError("they have so little in common that no ellipsoid lies between them: they are of two sensors")
    ellipsoid, covariance = field.settle(ellipsoid, together.covariance + together.predicted)
    repeats = compared(brought, dip_deg=dip)
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
    merged = replace(merged, judgement=Judgement(_judged(merged, repeats, parts)))
    if merged.verdict == "refused":
        raise NotMerged(merged)
    return merged


def source_files(parts: Sequence[Fit]) -> tuple[SourceFile, ...]:
    """The recordings that calibrations came from, each once, by name."""
    files = {file.sha256: file for part in parts for file in part.provenance.files}
    return tuple(sorted(files.values(), key=lambda file: (file.name, file.sha256)))


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """The one field that several calibrations are brought to."""

    strength: float
    is_known: bool
    reference: Floats
    log_variance: float

    @classmethod
    def of(cls, parts: Sequence[Fit]) -> _Field:
        known = all(part.calibration.field_strength_known for part in parts)
        sizes = np.array([part.calibration.field_strength if known else _radius(part) for part in parts])
        strength = float(np.exp(np.log(sizes).mean()))
        shapes = [strength / size * part.calibration.shape for size, part in zip(sizes, parts, strict=True)]
        variances = [_log_size_variance(part) for part in parts]
        for part, variance in zip(parts, variances, strict=True):
            if not known and variance > LOOSE**2:
                raise UsageError(
                    f"{part.provenance.name} leaves the size of its ellipsoid open by {np.sqrt(variance):.0%}, and not "
                    "all were given a field strength to bring them to one size: calibrate it with that, or leave it "
                    "out",
                    hint={"site": None},
                )
        log_variance = 0.0 if known else float(np.sum(variances)) / len(parts) ** 2
        return cls(strength, known, np.mean(shapes, axis=0), log_variance)

    def bring(self, part: Fit) -> RecordingFit:
        """Bring a calibration to the field: its shape by a factor, its covariance without the scale unless known."""
        shape = (part.calibration.shape + part.calibration.shape.T) / 2.0
        if self.is_known:
            factor = self.strength / part.calibration.field_strength
            covariance = rescaled(_claim(part), factor)
        else:
            factor = 3.0 / float(trace_with(self.reference) @ upper(shape))
            covariance = without_scale(rescaled(_claim(part), factor), factor * shape, self.reference)
        return RecordingFit(
            part.provenance.name, part.evidence.samples, Ellipsoid(part.calibration.offset, factor * shape), covariance
        )

    def settle(self, ellipsoid: Ellipsoid, covariance: Floats) -> tuple[Ellipsoid, Floats]:
        """Give the mean the size that was agreed on, and its covariance what is known of that size."""
        if self.is_known:
            return ellipsoid, covariance
        factor = self.strength / ellipsoid.radius
        sized = Ellipsoid(ellipsoid.centre, factor * ellipsoid.shape)
        scale = np.concatenate([np.zeros(3), upper(sized.shape)])
        return sized, rescaled(covariance, factor) + self.log_variance * np.outer(scale, scale)


def _refuse(parts: Sequence[Fit]) -> None:
    """Refuse what cannot be put together, before anything is computed."""
    if len(parts) < 2:
        raise UsageError(f"{counted(len(parts), 'calibration')}: need two or more to merge")
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
    """Variance of the logarithm of an ellipsoid's radius, as the calibration claims."""
    trace = trace_with(part.calibration.shape)
    return float(trace @ _claim(part)[3:, 3:] @ trace / 9.0)


def _claim(part: Fit) -> Floats:
    """(9, 9) the covariance that a calibration is weighted with."""
    if not part.claim.states_uncertainty:
        raise UsageError(
            f"{part.provenance.name} states no uncertainty, and cannot be weighted: calibrate again from its "
            "recording, or leave it out"
        )
    return part.claim.covariance


def _distortion(part: Fit) -> float:
    """What belongs to the direction in a calibration, in its unit: every other one of the sensor has it too."""
    across = math.radians(part.claim.structure_deg) * math.cos(math.radians(part.claim.known_dip_deg))
    return across * part.calibration.ellipsoid.radius


def _refuse_alone(part: Fit) -> None:
    """Refuse a calibration that cannot be merged with any other."""
    _claim(part)
    if names := [disturbance.name for disturbance in part.calibration.disturbances]:
        raise UsageError(
            f"{part.provenance.name} follows {' and '.join(names)}, and a mean of offset and matrix would lose that: "
            "fit the recordings together",
            hint={"disturbances": names},
        )
    if part.calibration.linearization is not None:
        raise UsageError(
            f"{part.provenance.name} linearizes its axes, and a mean of offset and matrix would lose that: fit one "
            "recording that holds it all"
        )
    if part.calibration.rotation != "symmetric":
        raise UsageError(
            f"{part.provenance.name} holds a rotation ({part.calibration.rotation}), of which its covariance says "
            "nothing: merge the calibrations as they were fitted, and turn what comes out"
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
    is_sane = SMALLEST < radius < LARGEST and max(offset, largest) < FARTHEST * radius
    if not (is_sane and finest > FINEST * radius and gains[2] < FLATTEST * gains[0]):
        raise UsageError(
            f"{part.provenance.name} is not of a magnetometer: its radius is {radius:.2g}, its offset {offset:.2g}, "
            f"known to {finest:.2g}, and one axis reads {gains[2] / gains[0]:.2g} times as much as another"
        )
    if part.verdict == "refused":
        raise UsageError(f"{part.provenance.name} was refused when it was made, and is not fit for use: leave it out")


def _refuse_pair(a: Fit, b: Fit) -> None:
    """Refuse two that are not of one sensor, or not independent of each other."""
    ours, theirs = a.calibration, b.calibration
    if None not in (ours.sensor, theirs.sensor) and ours.sensor != theirs.sensor:
        raise UsageError(
            f"{a.provenance.name} is for sensor {ours.sensor!r}, {b.provenance.name} for {theirs.sensor!r}: only "
            "calibrations of one sensor can be merged"
        )
    strengths = ours.field_strength, theirs.field_strength
    gains = _radius(a) / strengths[0], _radius(b) / strengths[1]
    for low, high in (sorted(gains), sorted(strengths)):
        if high > UNLIKE * low:
            raise UsageError(
                f"{a.provenance.name} has a radius of {figures(_radius(a), 3)} {label(ours.unit)}, {b.provenance.name} "
                f"one of {figures(_radius(b), 3)}: the gain or the unit is another, calibrate both alike"
            )
    if np.array_equal(ours.offset, theirs.offset) and np.array_equal(ours.matrix, theirs.matrix):
        if a.provenance.name == b.provenance.name:
            raise UsageError(f"{a.provenance.name} is given twice: name each calibration once")
        raise UsageError(
            f"{a.provenance.name} and {b.provenance.name} are the same calibration: counted twice it would seem better "
            "than it is, leave one out"
        )
    shared = {file.sha256 for file in b.provenance.files}
    same = [file.name for file in a.provenance.files if file.sha256 in shared]
    if same:
        raise UsageError(
            f"{a.provenance.name} and {b.provenance.name} were both made from {' and '.join(same)}: readings that are "
            "counted twice seem better than they are, leave one out"
        )
    turns = [one.claim.plane is not None for one in (a, b)]
    if turns[0] != turns[1]:
        level, other = (a, b) if turns[0] else (b, a)
        raise UsageError(
            f"{level.provenance.name} comes from a level turn and rests on the dip that was given, "
            f"{other.provenance.name} found it: leave {level.provenance.name} out"
        )


def _refuse_constrained(parts: Sequence[RecordingFit]) -> None:
    """Refuse a calibration whose method holds what the others find: exact as it says to be, it would outweigh all."""
    zero = np.zeros(9)
    total = np.sum([part.covariance for part in parts], axis=0)
    freedom = chi_square_of(zero, total)[1]
    for part in parts:
        free = chi_square_of(zero, part.covariance)[1]
        if free < freedom:
            raise UsageError(
                f"{part.source} leaves {free} of {freedom} parameters free and holds the rest, as a simpler method "
                "does: calibrate with one that finds them all, such as auto"
            )


def _dip(parts: Sequence[Fit]) -> float:
    """The steepest dip that a calibration was judged for, with its sign."""
    dips = [part.heading_error_deg.dip_deg for part in parts if math.isfinite(part.heading_error_deg.dip_deg)]
    return max(dips, key=lambda dip: (abs(dip), dip), default=60.0)


def _noise(parts: Sequence[Fit]) -> float:
    """Root mean square over all readings of which it is known; NaN where it is known of none."""
    known = [part for part in parts if math.isfinite(part.evidence.noise)]
    if not known:
        return math.nan
    weights = [max(part.evidence.samples, 1) for part in known]
    return float(np.sqrt(np.average([part.evidence.noise**2 for part in known], weights=weights)))


def _calibration(parts: Sequence[Fit], ellipsoid: Ellipsoid, field: _Field) -> Calibration:
    """The merged correction, recorded as the parts are."""
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


def _judged(merged: Fit, repeats: Repeats, parts: Sequence[Fit]) -> tuple[Finding, ...]:
    """Say what there is to know, the most severe first."""
    part, worst_deg, scatter_deg = repeats.farthest, merged.heading_error_deg.worst, repeats.scatter_deg
    found = tuple(
        judged_parts(
            merged.calibration,
            ("recordings-differ", "heading-error", *OF_CALIBRATION),
            target_deg=merged.claim.target_deg,
            values={
                **of_contradiction(repeats, label(merged.calibration.unit)),
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
    own = [finding for finding in found if finding.code in OF_CALIBRATION]
    return linked([*apart, *accuracy, *_carried(repeats, parts), *own])


def _carried(repeats: Repeats, parts: Sequence[Fit]) -> Iterator[Finding]:
    """What limits the calibrations limits what is merged of them, unless another makes up for it."""
    limits = [[one for one in _limits(part) if one.code not in RENEWED] for part in parts]
    lacks = [[one for one in those if one.code in LACKING] for those in limits]
    if all(lacks):
        claims = [part.claimed_deg for part in repeats.parts]
        best = int(np.argmin(claims))
        for lack in lacks[best]:
            yield _of_part(lack, parts[best], is_best=True)
    for part, those in zip(parts, limits, strict=True):
        for limit in those:
            if limit.code not in LACKING:
                yield _of_part(limit, part)


def _of_part(finding: Finding, part: Fit, *, is_best: bool = False) -> Finding:
    """A finding of a calibration as one of what is merged of it and others; `is_best`: all of them have it."""
    parts = (*finding.values.get("parts", ()), (part.provenance.name, float(is_best)))
    return replace(finding, values={**finding.values, "parts": parts})


def _limits(part: Fit) -> Iterator[Finding]:
    """What a calibration says that it is limited by."""
    return (finding for finding in part.findings if finding.severity == "limits")
