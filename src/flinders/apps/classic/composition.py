"""Composes the calibrations of turns in one plane after another, and computes the heading error that remains.

Each turn gives a symmetric matrix, but a product of symmetric matrices is not symmetric: W = R S, with R a rotation and
S symmetric. If the soft iron is symmetric, it is S⁻¹, and R is an error of the composition. R is of second order in the
soft iron, and a turn in one plane cannot observe it.

R has two effects on the heading of a level vehicle. It rotates the readings, and it adds a part of the vertical field
to the axes of each turn. The offset of a turn about axis k at a dip I absorbs that part: along axis i it is wrong by
−R_ik sin I, in units of the field. The heading error is the sum of both effects.

>>> tilted = np.array([[1.0, 0.0, 0.02], [0.0, 1.0, 0.0], [-0.02, 0.0, 1.0]])
>>> rotation_error(tilted, ("xy", "yz", "zx"), dip_deg=60.0)      # 0.02 of the vertical field, 1.7 of the level one
HeadingError(rms=1.40°, worst=1.98°, dip=60°)
>>> rotation_error(tilted, ("yz", "zx", "xy"), dip_deg=60.0).worst < 0.01      # removed by the offset of the last turn
True
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from flinders.core.units import unit_label
from flinders.errors import UsageError, figures
from flinders.findings import Finding, certain_finding, link_causes
from flinders.fitting.verdict import calibration_findings
from flinders.geometry.plane import PLANES, axis_order, heading_errors
from flinders.heading.error_propagation import HeadingError, level_turn
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane, Turn

MIN_OFFSET_SHARE: Final = 0.2
"""Smallest offset, in units of the field, whose removal can be recognised; soft iron causes smaller offsets."""

MAX_CENTRE_SHARE: Final = 0.5
"""Largest distance of a turn's centre from zero that soft iron can cause with a calibration loaded, in units of the
field."""

MAX_SCALE_RATIO: Final = 3.0
"""Largest ratio of expected and read amplitude; beyond it the unit or the loaded calibration is wrong."""

UNKNOWN_ANGLE_DEG: Final = 180.0
"""Value of a heading error that is not known."""


def turns_of(fit: Fit) -> tuple[str, ...]:
    """Planes of the turns that a fit is based on, in their order; empty text for a fit that is no turn."""
    composition = next((finding for finding in fit.findings if finding.code == "composed"), None)
    planes: tuple[str, ...] = (
        (fit.claim.plane or "",) if composition is None else composition.values.get("planes", ("",))
    )
    return planes


def rotation_error(matrix: Floats, turns: Sequence[str], *, dip_deg: float) -> HeadingError:
    """Heading error of a level vehicle from the rotation R in a composed matrix.

    In a plane without a turn, the soft iron is assumed to be as strong as in the others (rms), with either sign.

    Parameters
    ----------
    matrix : (3, 3) float
    turns : of str
        Planes of the turns, in their order, each turned with its third axis down. The empty text, for a fit that is no
        turn, changes no offset.
    dip_deg : float
        Inclination of the field.

    Returns
    -------
    HeadingError
        To second order in the soft iron. It is no 1 σ, but the error itself if the soft iron is symmetric.
    """
    heading, directions = level_turn(dip_deg)
    squares, worst = [], 0.0
    for made in _products(matrix, turns):
        offset = np.zeros(3)
        for plane in filter(None, turns):
            first, second, third = axis_order(cast("Plane", plane))
            offset[[first, second]] = -made[[first, second], third] * np.sin(np.deg2rad(dip_deg))
        errors = np.rad2deg(heading_errors(made @ directions + offset[:, np.newaxis], heading)[0])
        squares.append(float(np.mean(errors**2)))
        worst = max(worst, float(np.abs(errors).max()))
    return HeadingError(math.sqrt(sum(squares) / len(squares)), worst, float(dip_deg))


def _products(matrix: Floats, turns: Sequence[str]) -> Iterator[Floats]:
    """Yield the (3, 3) product of a composed matrix and the soft iron, for each soft iron that the turns allow."""
    squares, axes = np.linalg.eigh(matrix.T @ matrix)
    sensor = (axes / np.sqrt(squares)) @ axes.T
    known = [sensor[axis_order(plane)[:2]] for plane in PLANES if plane in turns]
    missing = [] if "" in turns else [axis_order(plane)[:2] for plane in PLANES if plane not in turns]
    across = float(np.sqrt(np.mean(np.square(known)))) if known and missing else 0.0
    for signs in product((-across, across), repeat=len(missing)):
        iron = np.zeros((3, 3))
        for cell, sign in zip(missing, signs, strict=True):
            iron[cell] = iron[cell[::-1]] = sign
        yield matrix @ (sensor + iron)


def refuse_unloaded(first: Fit, turn: Turn, *, dip_deg: float, source: str) -> None:
    """Refuse a turn that was not recorded with a calibration loaded.

    Along the axes that the calibration corrects, readings of a loaded turn have the amplitude of the level field and a
    mean near zero, except for a part of the vertical field that soft iron adds.

    Raises `UsageError` if the amplitude is wrong by a factor of three, or if the mean is nearer to the offset of the
    calibration than to zero. After other turns, it also raises `UsageError` if the mean is far from zero.

    Parameters
    ----------
    first : Fit
        Fit whose calibration should have been loaded.
    dip_deg : float
        Inclination of the field.
    source : str
        Name of the recording in messages.
    """
    turns = turns_of(first)
    known = "xyz" if "" in turns else "".join(turns)
    seen = [place for place, axis in enumerate(turn.plane) if axis in known]
    if not seen:
        return
    unit, named = unit_label(first.calibration.unit), " and ".join(turn.plane[place] for place in seen)
    level = first.calibration.field_strength * math.cos(math.radians(dip_deg))
    reach = np.linalg.norm(turn.ellipse.shape, axis=1)[seen]
    farthest = float(reach[np.abs(np.log(reach / level)).argmax()])
    name = first.provenance.name
    again = f"record it with {name} loaded, or correct a raw recording with flinders apply {name}"
    if not 1.0 / MAX_SCALE_RATIO < farthest / level < MAX_SCALE_RATIO:
        raise UsageError(
            f"{source} has an amplitude of {figures(farthest)} {unit} along {named}, but with {first.provenance.name} "
            f"loaded it would be {figures(level)} (level field, dip {dip_deg:g}°): the recording is in another unit, "
            f"or was made without that calibration; {again}, or name the unit",
            hint={"unit": None},
        )
    centre = turn.ellipse.centre[seen]
    offset = first.calibration.offset[list(axis_order(turn.plane))[:2]][seen]
    strength = first.calibration.field_strength
    if np.linalg.norm(offset) > MIN_OFFSET_SHARE * strength and np.linalg.norm(centre - offset) < np.linalg.norm(
        centre
    ):
        raise UsageError(
            f"{source} has a mean of {_number_list(centre)} {unit} along {named}, which is the offset that "
            f"{first.provenance.name} removes ({_number_list(offset)}): the recording was made without "
            f"{first.provenance.name} loaded; {again}"
        )
    if "" not in turns and np.linalg.norm(centre) > MAX_CENTRE_SHARE * strength:
        raise UsageError(
            f"{source} has a mean of {_number_list(centre)} {unit} along {named}, but with {first.provenance.name} "
            f"loaded it would be near 0: the recording was made without it, or of another sensor; {again}"
        )


def compose(first: Fit, fit: Fit) -> Fit:
    """Compose the fit of a turn in a plane with the calibration that was loaded for it.

    Parameters
    ----------
    first : Fit
        Fit of the loaded calibration.
    fit : Fit
        Fit of the turn.

    Returns
    -------
    Fit
        Calibration to load in place of the first; `turns_of` gives all turns so far. The heading error is for a level
        vehicle. It combines the claims of the last turn in xy and of the turns after it with the error from the
        rotation of the matrix. It is 180°, which stands for unknown, without a turn in xy or if the loaded calibration
        has no claim. There is no covariance, as offset and matrix of several turns are correlated.

    Examples
    --------
    >>> from flinders import simulate
    >>> from flinders.fitting import calibrate
    >>> from flinders.likelihood.site_field import Site
    >>> sweep = simulate.tumble(seed=1, motion="sweep-xy")
    >>> first = calibrate.fit(sweep.samples, method="ellipse")
    >>> loaded = replace(sweep.samples, field=first.calibration.apply(sweep.samples.field))
    >>> site = Site(strength=first.calibration.field_strength)
    >>> second = calibrate.fit(loaded, method="ellipse", site=site)
    >>> both = compose(first, second)      # the same turn again, which changes nothing
    >>> turns_of(both), both.calibration.isclose(first.calibration, tolerance=1e-3)
    (('xy', 'xy'), True)
    """
    before = first.evidence.method if first.evidence.is_described else "a calibration"
    method = f"{before}, then {fit.evidence.method}"
    turns = (*turns_of(first), *turns_of(fit))
    known = first.calibration.field_strength_known
    calibration = replace(fit.calibration @ first.calibration, field_strength_known=known)
    left = rotation_error(calibration.matrix, turns, dip_deg=fit.heading_error_deg.dip_deg)
    claim = replace(
        fit.claim,
        calibration=calibration,
        covariance=np.zeros((9, 9)),
        heading_error_deg=_claimed_error(first, fit, turns, left),
        plane=None,
    )
    evidence = replace(
        fit.evidence, method=method, samples=first.evidence.samples + fit.evidence.samples, coverage=Coverage()
    )
    findings = link_causes([_finding(turns, left.worst, claim.target_deg), *calibration_findings(calibration)])
    judgement = replace(fit.judgement, findings=findings)
    return replace(fit, calibration=calibration, evidence=evidence, claim=claim, judgement=judgement)


def as_dict(both: Fit) -> dict[str, Any]:
    """JSON-ready result of `compose`: the calibration, its claim, and its findings."""
    error, turns = both.heading_error_deg, turns_of(both)
    return {
        **both.calibration.as_dict(),
        "turns": list(turns),
        "heading_error_deg": error.as_dict(dip_deg=error.dip_deg),
        "rotation_deg": rotation_error(both.calibration.matrix, turns, dip_deg=error.dip_deg).worst,
        "findings": [finding.as_dict() for finding in both.findings],
    }


def _claimed_error(first: Fit, fit: Fit, turns: Sequence[str], left: HeadingError) -> HeadingError:
    """Claimed heading error of a level vehicle: the error from the rotation of the new matrix replaces the old one."""
    own, stated = fit.heading_error_deg, first.heading_error_deg
    if fit.claim.plane == "xy":
        return own
    if math.isnan(stated.worst) or not {"xy", ""} & set(turns[:-1]):
        return HeadingError(UNKNOWN_ANGLE_DEG, UNKNOWN_ANGLE_DEG, own.dip_deg)
    before = rotation_error(first.calibration.matrix, turns[:-1], dip_deg=own.dip_deg)
    rms, worst = (
        math.sqrt(max(was**2 - gone**2, 0.0) + now**2 + new**2)
        for was, gone, now, new in (
            (stated.rms, before.rms, own.rms, left.rms),
            (stated.worst, before.worst, own.worst, left.worst),
        )
    )
    return HeadingError(rms, worst, own.dip_deg)


def _finding(turns: Sequence[str], left_deg: float, target_deg: float) -> Finding:
    """Finding about the heading error that remains after the turns so far."""
    left_deg = left_deg if {"xy", ""} & set(turns) else UNKNOWN_ANGLE_DEG
    numbers = {"is_composed": 1.0, "rotation_left_deg": left_deg, "target_deg": target_deg}
    return certain_finding({**numbers, "planes": turns}, "composed")


def _number_list(values: Floats) -> str:
    """Numbers with three digits, joined by commas."""
    return ", ".join(figures(value, 3) for value in values.tolist())
