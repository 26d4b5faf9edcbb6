"""Plane after plane: the calibration of a turn composed with the one that was loaded, and the error that this leaves.

Each turn gives a symmetric matrix, and the product of symmetric matrices is not symmetric. Its rotation is of second
order in the soft iron; no turn in a plane sees it. With the composed matrix W = R S, R the rotation and S symmetric, a
sensor whose soft iron is symmetric has the inverse of S, so that R is what the composition makes of it. What R lends
from the vertical field to the axes of a turn, the offset of that turn has removed: along each of its axes i, turned
about k, it is wrong by −R_ik sin I in units of the field. A level vehicle sees what is left of both.

>>> tilted = np.array([[1.0, 0.0, 0.02], [0.0, 1.0, 0.0], [-0.02, 0.0, 1.0]])
>>> rotation_error(tilted, ("xy", "yz", "zx"), dip_deg=60.0)      # 0.02 of the vertical field, 1.7 of the level one
HeadingError(rms=1.40°, worst=1.98°, dip=60°)
>>> rotation_error(tilted, ("yz", "zx", "xy"), dip_deg=60.0).worst < 0.01      # the last turn has taken it off
True
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from flinders.core.units import label
from flinders.errors import UsageError, figures
from flinders.findings import Finding, certain, linked
from flinders.fitting.verdict import of_calibration
from flinders.geometry.plane import PLANES, heading_errors, order_of
from flinders.heading.error_propagation import HeadingError, level_turn
from flinders.summary.coverage import Coverage

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane, Turn

FAR: Final = 0.2
"""Of the field: an offset that is smaller does not tell whether it has been removed, as soft iron lends as much."""

TOO_FAR: Final = 0.5
"""Of the field: what soft iron does not lend to a turn that follows others; a vehicle has more for a sensor put in."""

OTHER_SCALE: Final = 3.0
"""Readings larger or smaller by this are in another unit, or corrected by something else; no dip explains it."""

ANY_ANGLE: Final = 180.0
"""What a heading may be off by where nothing is claimed of it."""


def turns_of(fit: Fit) -> tuple[str, ...]:
    """The plane of each turn that a fit rests on, in their order; an empty one for what is no turn."""
    composition = next((finding for finding in fit.findings if finding.code == "composed"), None)
    planes: tuple[str, ...] = (
        (fit.claim.plane or "",) if composition is None else composition.values.get("planes", ("",))
    )
    return planes


def rotation_error(matrix: Floats, turns: Sequence[str], *, dip_deg: float) -> HeadingError:
    """What the rotation of a composed matrix costs a level vehicle; see above.

    Of a plane that has not been turned in, soft iron is taken to be as strong there as in the others (rms), of either
    sign.

    Parameters
    ----------
    matrix : (3, 3) float
    turns : of str
        Planes of the turns, in their order, each with its third axis down; others than planes change no offset.
    dip_deg : float
        Inclination of the field.

    Returns
    -------
    HeadingError
        To second order in the soft iron; not 1 σ, but what it is if the soft iron is symmetric.
    """
    heading, directions = level_turn(dip_deg)
    squares, worst = [], 0.0
    for made in _made(matrix, turns):
        offset = np.zeros(3)
        for plane in filter(None, turns):
            first, second, third = order_of(cast("Plane", plane))
            offset[[first, second]] = -made[[first, second], third] * np.sin(np.deg2rad(dip_deg))
        errors = np.rad2deg(heading_errors(made @ directions + offset[:, np.newaxis], heading)[0])
        squares.append(float(np.mean(errors**2)))
        worst = max(worst, float(np.abs(errors).max()))
    return HeadingError(math.sqrt(sum(squares) / len(squares)), worst, float(dip_deg))


def _made(matrix: Floats, turns: Sequence[str]) -> Iterator[Floats]:
    """(3, 3) products of a composed matrix with each sensor that it may be for: a rotation, and the error left."""
    squares, axes = np.linalg.eigh(matrix.T @ matrix)
    sensor = (axes / np.sqrt(squares)) @ axes.T
    known = [sensor[order_of(plane)[:2]] for plane in PLANES if plane in turns]
    missing = [] if "" in turns else [order_of(plane)[:2] for plane in PLANES if plane not in turns]
    across = float(np.sqrt(np.mean(np.square(known)))) if known and missing else 0.0
    for signs in product((-across, across), repeat=len(missing)):
        iron = np.zeros((3, 3))
        for cell, sign in zip(missing, signs, strict=True):
            iron[cell] = iron[cell[::-1]] = sign
        yield matrix @ (sensor + iron)


def refuse_unloaded(first: Fit, turn: Turn, *, dip_deg: float, source: str) -> None:
    """Refuse a turn that was not recorded with a calibration loaded.

    Along the axes that the calibration knows, a loaded turn goes as far up and down as the level part of its field,
    and about zero but for what soft iron lends from the vertical field.

    Raises `UsageError` where the readings are larger or smaller by three, lie nearer to the offset of the calibration
    than to zero, or, after other turns, far from zero.

    Parameters
    ----------
    first : Fit
        What should have been loaded.
    dip_deg : float
        Inclination of the field.
    source : str
        What the message calls the recording.
    """
    turns = turns_of(first)
    known = "xyz" if "" in turns else "".join(turns)
    seen = [place for place, axis in enumerate(turn.plane) if axis in known]
    if not seen:
        return
    unit, named = label(first.calibration.unit), " and ".join(turn.plane[place] for place in seen)
    level = first.calibration.field_strength * math.cos(math.radians(dip_deg))
    reach = np.linalg.norm(turn.ellipse.shape, axis=1)[seen]
    farthest = float(reach[np.abs(np.log(reach / level)).argmax()])
    name = first.provenance.name
    again = f"record it with {name} loaded, or correct a raw recording with flinders apply {name}"
    if not 1.0 / OTHER_SCALE < farthest / level < OTHER_SCALE:
        raise UsageError(
            f"{source} goes {figures(farthest)} {unit} up and down along {named}, where readings with "
            f"{first.provenance.name} loaded go {figures(level)} (level field, dip {dip_deg:g}°): it is in another "
            f"unit, or was made without; {again}, or name the unit",
            hint={"unit": None},
        )
    centre = turn.ellipse.centre[seen]
    offset = first.calibration.offset[list(order_of(turn.plane))[:2]][seen]
    strength = first.calibration.field_strength
    if np.linalg.norm(offset) > FAR * strength and np.linalg.norm(centre - offset) < np.linalg.norm(centre):
        raise UsageError(
            f"{source} lies about {_listed(centre)} {unit} along {named}, which is the offset that "
            f"{first.provenance.name} takes off ({_listed(offset)}): it was made without {first.provenance.name} "
            f"loaded; {again}"
        )
    if "" not in turns and np.linalg.norm(centre) > TOO_FAR * strength:
        raise UsageError(
            f"{source} lies about {_listed(centre)} {unit} along {named}, where readings with {first.provenance.name} "
            f"loaded lie about 0: it was made without, or of another sensor; {again}"
        )


def composed(first: Fit, fit: Fit) -> Fit:
    """Compose the fit of a turn in a plane with the calibration that was loaded for it.

    Parameters
    ----------
    first : Fit
        What was loaded.
    fit : Fit
        Of the turn.

    Returns
    -------
    Fit
        To be loaded in place of the first; `turns_of` it are all turns so far. The heading error of a level
        vehicle is what the turns claim together, and what the rotation of the matrix costs: it rests on the last turn
        in xy and those after it. 180° where nobody can say: there was no turn in xy yet, or what was loaded claims
        nothing. It has no covariance, as offset and matrix of several turns are correlated.

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
    >>> both = composed(first, second)      # the same turn once more, which changes nothing
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
        heading_error_deg=_claimed(first, fit, turns, left),
        plane=None,
    )
    evidence = replace(
        fit.evidence, method=method, samples=first.evidence.samples + fit.evidence.samples, coverage=Coverage()
    )
    findings = linked([_finding(turns, left.worst, claim.target_deg), *of_calibration(calibration)])
    judgement = replace(fit.judgement, findings=findings)
    return replace(fit, calibration=calibration, evidence=evidence, claim=claim, judgement=judgement)


def as_dict(both: Fit) -> dict[str, Any]:
    """JSON-ready, of `composed`: the calibration, what is claimed of it, and what is open."""
    error, turns = both.heading_error_deg, turns_of(both)
    return {
        **both.calibration.as_dict(),
        "turns": list(turns),
        "heading_error_deg": error.as_dict(dip_deg=error.dip_deg),
        "rotation_deg": rotation_error(both.calibration.matrix, turns, dip_deg=error.dip_deg).worst,
        "findings": [finding.as_dict() for finding in both.findings],
    }


def _claimed(first: Fit, fit: Fit, turns: Sequence[str], left: HeadingError) -> HeadingError:
    """What is claimed of a level heading; the rotation of the matrix counts as it is now, not as it was before."""
    own, stated = fit.heading_error_deg, first.heading_error_deg
    if fit.claim.plane == "xy":
        return own
    if math.isnan(stated.worst) or not {"xy", ""} & set(turns[:-1]):
        return HeadingError(ANY_ANGLE, ANY_ANGLE, own.dip_deg)
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
    """Say what the turns so far leave open."""
    left_deg = left_deg if {"xy", ""} & set(turns) else ANY_ANGLE
    numbers = {"is_composed": 1.0, "rotation_left_deg": left_deg, "target_deg": target_deg}
    return certain({**numbers, "planes": turns}, "composed")


def _listed(values: Floats) -> str:
    """Numbers with three digits, for a message."""
    return ", ".join(figures(value, 3) for value in values.tolist())
