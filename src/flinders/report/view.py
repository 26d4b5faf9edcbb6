"""Data of one fit for the live page and for reports, ready for JSON.

`view` converts a good, limited or refused `Fit` and its readings to a `View`. For a refused fit the view has no number
that could be copied into firmware. If the fit has a surface, `shown` is a correction for drawing the readings only, so
that the picture improves while the sensor is being turned.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> samples = simulate.tumble(seed=1).samples
>>> fit = calibrate.fit(samples)
>>> seen = view(fit, samples)
>>> seen.verdict, seen.unit, seen.heading_error_deg.worst == fit.heading_error_deg.worst
('good', 'µT', True)
>>> seen.sentence.partition(';')[0]
'Headings are good to 0.066° (95 % within 0.16°) at any attitude'
>>> sum(seen.tiles_seen) == len(samples), len(seen.tiles_deg)
(True, 642)
"""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from msgspec import Struct

from flinders.arrays import true_runs
from flinders.core.units import unit_label
from flinders.errors import NeedsRecording
from flinders.findings import first_causes
from flinders.findings.finding import json_value
from flinders.findings.row import words_of_conditions
from flinders.findings.words import ANY_ANGLE_DEG
from flinders.fitting.advice import MIN_SAVED_SHARE, guidance_for, movement, next_movement
from flinders.fitting.verdict import headline_of
from flinders.geometry.plane import down_direction
from flinders.geometry.sphere import tile_indices, tiles
from flinders.native.engine import engine
from flinders.summary.coverage import cell_indices
from flinders.summary.quality import DataQuality

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.findings import Finding
    from flinders.findings.poses import Frame
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.heading.guidance import Goal

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]

BIN_COUNT: Final = 40
MAX_SIGMAS: Final = 4.0
"""Range of the histogram in standard deviations; residuals beyond it count in the outermost bins."""


IN_PLAIN_WORDS: Final = ("next_movement", "next_step", "corrected_length", "unit")
"""Values in the plain words of findings, in addition to number and limit."""


class HeadingErrorView(Struct, frozen=True):
    """Expected heading error, 1 σ in degrees, and the case for which it holds."""

    rms: float
    worst: float
    bound_95: float  # bound that the errors of all headings keep with a probability of 95 %
    dip_deg: float
    dip_assumed: bool
    target_deg: float


class ErrorView(Struct, frozen=True):
    """An error in degrees."""

    rms: float
    worst: float


class FindingView(Struct, frozen=True):
    """A finding, with the fields of `flinders.findings.Finding`."""

    code: str
    severity: Literal["note", "limits", "refuses"]
    number: float | None
    limit: float | None
    advice: str
    values: dict[str, Any] = {}  # values in its plain words, for pages in other languages


class Shown(Struct, frozen=True):
    """Correction of readings for drawing only: ``matrix @ (raw - offset) / strength``."""

    offset: Triple
    matrix: Matrix
    strength: float


class ResidualHistogram(Struct, frozen=True):
    """Histogram of the distances of used readings from the surface; large distances count in the outermost bins."""

    edges: tuple[float, ...]  # (n + 1,), in the view's unit
    counts: tuple[int, ...]


class LevelTurn(Struct, frozen=True):
    """Heading errors of a vehicle over a level turn."""

    heading_deg: tuple[float, ...]  # (72,), clockwise from magnetic north
    before_deg: tuple[float, ...]  # deviation of the raw compass minus its mean, −180 to 180
    sigma_deg: tuple[float, ...]  # 1 σ of the corrected heading


class GuidanceView(Struct, frozen=True):
    """The next direction to turn to."""

    direction: Triple | None  # direction of the field in corrected sensor axes; None if none is better than the others
    words: str
    worst_deg: float  # heading error in degrees now, for the goal
    after_deg: float  # heading error in degrees after some readings in this direction
    goal: Literal["heading", "attitude"]  # heading of a level vehicle, or of a vehicle at any attitude
    frame: Literal["vehicle", "sensor"] = "sensor"  # axes to which direction and words refer
    # whether it is the first step of a path from the newest reading, which the page shows as an arrow
    is_path: bool = False
    code: str = ""  # code of words without a direction, for pages in other languages


class View(Struct, frozen=True, kw_only=True):
    """Data of one fit for drawing; values that cannot be trusted are None."""

    verdict: Literal["good", "limited", "refused"]
    sentence: str  # the verdict in plain words
    condition: str = ""  # assumptions of a verdict that no finding covers, in a few words
    method: str
    unit: str  # unit of all field values, "µT" or "counts"
    field_strength: float | None = None
    field_strength_known: bool
    offset: Triple | None = None
    offset_sigma: Triple | None = None
    matrix: Matrix | None = None
    matrix_sigma: Matrix | None = None
    noise: float | None = None
    samples: int  # number of readings used
    heading_error_deg: HeadingErrorView | None = None  # heading error of a level vehicle
    uncorrected_heading_error_deg: ErrorView | None = None
    # tilt in degrees up to which the worst heading is within the target; 180 for all attitudes
    attitude_limit_deg: float | None = None
    any_attitude_deg: ErrorView | None = None  # heading error over all tiles
    findings: tuple[FindingView, ...]  # most severe first
    tiles_deg: tuple[float | None, ...] = ()  # (642,), see `tile_errors_deg`; None if unknown
    tiles_seen: tuple[int, ...] = ()  # (642,) count of readings used, by tile
    # first and last reading of each run of rejected readings, counted from 0
    rejected: tuple[tuple[int, int], ...] = ()
    residuals: ResidualHistogram | None = None
    turn: LevelTurn | None = None
    guidance: GuidanceView | None = None
    shown: Shown | None = None  # correction for drawing, also for a refused fit


class TilesView(Struct, frozen=True):
    """The tiles of the sphere of directions, which are sent once."""

    centres: tuple[float, ...]  # (1926,): x, y and z of each tile
    corners: tuple[tuple[float, ...], ...]  # 642 tuples of 15 or 18 numbers


def tiles_view() -> TilesView:
    """The tiles with 5 decimals: an error of 1e-5 of the radius is less than a thousandth of a degree."""
    return TilesView(
        tuple(tiles().centres.round(5).ravel().tolist()),
        tuple(tuple(corners.round(5).ravel().tolist()) for corners in tiles().polygons()),
    )


def view(
    fit: Fit, samples: Samples, *, numbers: ArrayLike | None = None, goal: Goal = "heading", frame: Frame = "sensor"
) -> View:
    """Collect the data of a fit for drawing, also of a refused fit.

    Parameters
    ----------
    samples : Samples
        The fitted readings, in their original order.
    numbers : (N,) int, optional
        Index of each reading in the whole recording, counted from 0; by default these are all readings.
    goal, frame : str
        As in `flinders.heading.guidance`.
    """
    is_rejected, rejected = _left_out_readings(fit, samples)
    numbered = np.arange(len(samples)) if numbers is None else np.asarray(numbers)
    corrected = np.empty((0, 3)) if fit.judgement.is_flat else fit.calibration.affine.apply(samples.field[~is_rejected])
    is_known = fit.claim.states_uncertainty and not fit.judgement.is_flat
    errors = tile_errors_deg(fit) if is_known else np.full(len(tiles().centres), np.nan)
    claims = _claim_fields(fit, errors, goal, frame) if is_known else {}
    return View(
        verdict=fit.verdict,
        method=fit.evidence.method,
        unit=unit_label(fit.calibration.unit),
        field_strength_known=fit.calibration.field_strength_known,
        samples=fit.evidence.samples,
        findings=tuple(map(finding_view, first_causes(fit.findings))),
        tiles_deg=_shown_errors(errors),
        tiles_seen=tuple(np.bincount(tile_indices(corrected), minlength=len(errors)).tolist()),
        rejected=tuple((int(numbered[first]), int(numbered[last])) for first, last in sorted(rejected)),
        **({} if fit.verdict == "refused" else _number_fields(fit)),
        sentence=headline_of(fit, claims.get("attitude_limit_deg")).words,
        condition=words_of_conditions(fit.judgement.conditions),
        **({} if fit.judgement.is_flat else _surface_fields(fit, corrected)),
        **claims,
    )


def view_of_numbers(fit: Fit) -> View:
    """Numbers and words of a fit, also of a refused fit, without data from its readings."""
    is_known = fit.claim.states_uncertainty and not fit.judgement.is_flat
    limit_deg = fit.claim.attitude_limit_deg if is_known else None
    return View(
        verdict=fit.verdict,
        sentence=headline_of(fit, limit_deg).words,
        condition=words_of_conditions(fit.judgement.conditions),
        method=fit.evidence.method,
        unit=unit_label(fit.calibration.unit),
        field_strength_known=fit.calibration.field_strength_known,
        samples=fit.evidence.samples,
        findings=tuple(map(finding_view, first_causes(fit.findings))),
        noise=None if fit.judgement.is_flat else fit.evidence.noise,
        heading_error_deg=_heading_error(fit) if is_known else None,
        attitude_limit_deg=limit_deg,
        any_attitude_deg=_any_attitude(tile_errors_deg(fit)) if is_known else None,
        **({} if fit.verdict == "refused" else _number_fields(fit)),
    )


def view_alone(fit: Fit) -> View:
    """Data for the sphere and the level turn of a fit with a stated uncertainty, without its readings.

    A tile counts as covered if its cell of the coverage has a reading; for a loaded fit all tiles count as covered.
    """
    by_tile: Floats = np.ones(len(tiles().centres))
    with contextlib.suppress(NeedsRecording):
        by_tile = fit.evidence.coverage.counts[cell_indices(tiles().centres @ rotation_of(fit))]
    return View(
        verdict=fit.verdict,
        sentence=headline_of(fit).words,
        method=fit.evidence.method,
        unit=unit_label(fit.calibration.unit),
        field_strength_known=fit.calibration.field_strength_known,
        samples=fit.evidence.samples,
        findings=(),
        tiles_deg=_shown_errors(tile_errors_deg(fit)),
        tiles_seen=tuple((by_tile > 0.0).astype(int).tolist()),
        rejected=(),
        turn=turn(fit),
    )


def _shown_errors(errors_deg: Floats) -> tuple[float | None, ...]:
    """Errors of tiles for the page; an unknown error is None."""
    return tuple(round(angle, 4) if angle < ANY_ANGLE_DEG else None for angle in errors_deg.tolist())


def _number_fields(fit: Fit) -> dict[str, Any]:
    """Fields with numbers that could be copied into firmware; empty for a refused fit."""
    calibration, raw = fit.calibration, fit.claim.uncorrected_heading_error_deg
    sigmas = {"offset_sigma": triple(fit.claim.offset_sigma), "matrix_sigma": _matrix(matrix_sigma(fit))}
    return {
        "field_strength": calibration.field_strength,
        "offset": triple(calibration.offset),
        "matrix": _matrix(calibration.matrix),
        "uncorrected_heading_error_deg": ErrorView(raw.rms, raw.worst),
        **(sigmas if fit.claim.states_uncertainty else {}),
    }


def _surface_fields(fit: Fit, corrected: Floats) -> dict[str, Any]:
    """Fields that need a surface; empty for readings in one plane, which do not determine one."""
    calibration = fit.calibration
    return {
        "noise": fit.evidence.noise,
        "residuals": residuals(fit, corrected),
        "shown": Shown(triple(calibration.offset), _matrix(calibration.matrix), calibration.field_strength),
    }


def _claim_fields(fit: Fit, errors_deg: Floats, goal: Goal, frame: Frame) -> dict[str, Any]:
    """Fields that need the covariance of the calibration."""
    return {
        "heading_error_deg": _heading_error(fit),
        "attitude_limit_deg": fit.claim.attitude_limit_deg,
        "any_attitude_deg": _any_attitude(errors_deg),
        "turn": turn(fit),
        "guidance": guidance(fit, goal, frame),
    }


def _heading_error(fit: Fit) -> HeadingErrorView:
    """Heading error of a level vehicle."""
    claim, error = fit.claim, fit.heading_error_deg
    return HeadingErrorView(
        error.rms, error.worst, claim.heading_bound_deg, error.dip_deg, claim.dip_assumed, claim.target_deg
    )


def _any_attitude(errors_deg: Floats) -> ErrorView:
    """Error over all tiles."""
    return ErrorView(float(np.sqrt(np.mean(errors_deg**2))), float(errors_deg.max()))


def _left_out_readings(fit: Fit, samples: Samples) -> tuple[NDArray[np.bool_], list[tuple[int, int]]]:
    """(N,) booleans of the readings that a fit left out, as outliers or as saturated, and runs of such readings.

    The fit counts outliers among the readings that are not saturated. If a run contains good readings too, its outliers
    are the readings farthest from the ellipsoid.
    """
    is_at_rail = np.zeros(len(samples), bool)
    for rail in DataQuality.of(samples).rails:
        is_at_rail |= samples.field[:, rail.axis] == rail.value
    free, is_rejected = np.flatnonzero(~is_at_rail), is_at_rail.copy()
    ends = [(run.start, run.stop - 1) for run in true_runs(is_at_rail)]
    for outlier in fit.evidence.outliers:
        first, last = int(free[outlier.first - 1]), int(free[outlier.last - 1])
        inside = slice(first, last + 1)
        lengths = np.linalg.norm(fit.calibration.affine.apply(samples.field[inside]), axis=1)
        distances = np.where(is_at_rail[inside], -1.0, np.abs(lengths - fit.calibration.field_strength))
        is_rejected[first + np.argsort(-distances, kind="stable")[: outlier.readings]] = True
        ends.append((first, last))
    return is_rejected, ends


def rotation_of(fit: Fit) -> Floats:
    """(3, 3) rotation from the magnetometer's axes, in which the covariance is, to the axes of corrected readings."""
    if fit.calibration.rotation == "symmetric":
        return np.eye(3)
    rotation: Floats = fit.calibration.matrix @ fit.calibration.ellipsoid.shape / fit.calibration.field_strength
    return rotation


def tile_errors_deg(fit: Fit) -> Floats:
    """(642,) expected heading error, 1 σ in degrees, of a vehicle whose corrected field is in the direction of a tile.

    A field along u does not determine the vertical of the vehicle: with the dip I, the vertical makes an angle of 90° −
    I with u, in any direction around it. The horizontal part of an error δu across u, divided by cos I, is the heading
    error. The largest variance over these attitudes is therefore the largest eigenvalue of the transverse covariance of
    u, (1 − uuᵀ) S⁻¹ J P Jᵀ S⁻ᵀ (1 − uuᵀ), divided by cos² I. The part that depends on the direction is added, as for
    all headings. No mean is subtracted, since no mounting would explain one.
    """
    directions, dip_deg = tiles().centres @ rotation_of(fit), fit.heading_error_deg.dip_deg
    claim = fit.claim
    return engine().attitude_errors(claim.ellipsoid.shape, claim.claimed_covariance, directions, dip_deg=dip_deg)


def finding_view(finding: Finding) -> FindingView:
    """A finding with its sentence."""
    number, limit = json_value(finding.number), json_value(finding.limit)
    values = {name: json_value(finding.values[name]) for name in IN_PLAIN_WORDS if name in finding.values}
    return FindingView(finding.code, finding.severity, number, limit, finding.advice, values)


def matrix_sigma(fit: Fit) -> Floats:
    """(3, 3) standard deviations of the entries of W = F S⁻¹, to first order.

    δW = (δF/F) W − W δS S⁻¹. δF is F tr(S⁻¹ δS)/3 if F is the fitted radius, and 0 if F is known.
    """
    is_known = fit.calibration.field_strength_known
    claim = fit.claim
    return engine().matrix_sigmas(fit.calibration.matrix, claim.ellipsoid.shape, claim.covariance, is_known=is_known)


def turn(fit: Fit) -> LevelTurn:
    """Heading errors over a level turn, before and after correction."""
    dip, down = fit.heading_error_deg.dip_deg, down_direction(fit.claim.plane)
    ellipsoid, covariance = fit.calibration.ellipsoid, fit.claim.claimed_covariance
    columns = engine().level_turn(ellipsoid.centre, ellipsoid.shape, covariance, dip_deg=dip, down=down)
    return LevelTurn(*(tuple(column.round(4).tolist()) for column in columns))


def residuals(fit: Fit, corrected: Floats) -> ResidualHistogram:
    """Histogram of the distances of (N, 3) corrected readings from the sphere; in one plane, from the circle."""
    widest = max(MAX_SIGMAS * fit.evidence.noise, np.finfo(float).tiny)
    edges = np.linspace(-widest, widest, BIN_COUNT + 1)
    lengths = excess_lengths(corrected, fit.calibration.field_strength, fit.claim.plane)
    counts, _ = np.histogram(lengths.clip(-widest, widest), edges)
    return ResidualHistogram(tuple(edges.tolist()), tuple(counts.tolist()))


def excess_lengths(corrected: Floats, strength: float, plane: Plane | None) -> Floats:
    """(N,) lengths of (N, 3) corrected readings minus the field strength; in one plane, minus their mean length."""
    if plane is None:
        lengths: Floats = np.linalg.norm(corrected, axis=1)
        return lengths - strength
    lengths = np.linalg.norm(corrected[:, ["xyz".index(axis) for axis in plane]], axis=1)
    return lengths - lengths.mean() if len(lengths) else lengths


def guidance(fit: Fit, goal: Goal, frame: Frame) -> GuidanceView:
    """The next direction to turn to, for one of the goals.

    For a turn in one plane, and if no direction is better than the others, there are words but no direction.
    """
    next_turn = guidance_for(fit, goal)
    direction, words = None, "turn it slowly through all directions, away from iron and from currents"
    code = "everywhere"
    if fit.claim.plane:
        words, code = movement(fit), next_movement(fit)[0]
    elif next_turn.after_deg <= (1.0 - MIN_SAVED_SHARE) * next_turn.worst_deg:
        direction, words, code = triple(rotation_of(fit) @ next_turn.direction), next_turn.words(frame), ""
    worst, after = (math.hypot(error, fit.claim.structure_deg) for error in (next_turn.worst_deg, next_turn.after_deg))
    return GuidanceView(direction, words, worst, after, goal, frame, code=code)


def triple(vector: Floats) -> Triple:
    """Three numbers of an array."""
    x, y, z = vector.tolist()
    return x, y, z


def _matrix(matrix: Floats) -> Matrix:
    x, y, z = map(triple, matrix)
    return x, y, z
