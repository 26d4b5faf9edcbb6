"""The deviation of a compass from a swing: a table of headings, a boat's log, or a recording with rests.

A compass with 3° of hard iron athwartships, read on eight headings:

>>> from flinders.apps.marine.swing_table import SwingTable
>>> around = np.arange(0.0, 360.0, 45.0)
>>> deviation = 3.0 * np.cos(np.deg2rad(around))
>>> table = SwingTable("swing.csv", {"compass": around, "deviation": deviation}, tuple(range(2, 10)))
>>> found = swing(table, sigma_deg=0.2, limit_deg=5.0)
>>> found.deviation.coefficients_deg.round(1) + 0.0, found.conformity.verdict, found.verdict
(array([0., 0., 3., 0., 0.]), 'within', 'good')
>>> [note.code for note in found.notes]
['argument']
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from flinders.apps.marine.compass_log import CompassLog, is_compass_log, read_compass_log
from flinders.apps.marine.compensation import compensation
from flinders.apps.marine.deviation import common_error, conformity, fit
from flinders.apps.marine.legs import CRAB_DEG, MIN_LEG_S, MIN_SPEED_M_S, legs, turn_readings
from flinders.apps.marine.standards import STANDARDS
from flinders.apps.marine.swing_recording import SwingRecording, read_rests
from flinders.apps.marine.swing_result import Swing
from flinders.apps.marine.swing_table import SwingTable, read_swing
from flinders.core.keywords import check_keywords
from flinders.errors import FitError, FlindersError, InputError, UsageError, did_you_mean
from flinders.geometry.angles import wrap_360
from flinders.heading.stationary import Rest, half_turns
from flinders.readers import open_recording

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flinders.apps.marine.compensation import Compensation
    from flinders.apps.marine.standards import Standard
    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.heading.stationary import HalfTurn
    from flinders.workflows.recordings import AnyReadings

    AnyTable: TypeAlias = SwingTable | str | os.PathLike[str]
    AnySwing: TypeAlias = SwingTable | CompassLog | SwingRecording | AnyReadings

Kind: TypeAlias = Literal["table", "boat", "recording"]


@check_keywords()
def swing(
    source: AnySwing,
    calibration: AnyCalibration | None = None,
    *,
    headings_deg: Sequence[float] | None = None,
    site: SiteField | None = None,
    sigma_deg: float | None = None,
    stationary_s: float | None = None,
    level: bool = False,
    min_speed: float = MIN_SPEED_M_S,
    crab_deg: float = CRAB_DEG,
    target_deg: float = 1.0,
    rule: Standard | str | None = None,
    limit_deg: float | None = None,
    base_error_deg: float = 0.0,
    before: AnyTable | None = None,
) -> Swing:
    """Find the deviation of a compass: coefficients A to E with their uncertainty, and conformity with a limit.

    Without known headings, a recording is tested by half turns alone: a turn of the sensor by 180° has to change its
    heading by 180°.

    Parameters
    ----------
    source : path, SwingTable, CompassLog, SwingRecording, Samples, Recording or (N, 3) array-like
        A table with one heading a line; a boat's log of NMEA 0183, NMEA 2000 or Signal K; or a recording in which the
        sensor rests on one heading after another. `read_swing`, `read_compass_log` and `read_rests` have more options
        for each.
    calibration : Fit, Calibration or path, optional
        Calibration that corrects a recording; by default readings are used as they are.
    headings_deg : sequence of float, degrees
        Known heading of each rest of a recording, in order: magnetic, or true with `site`.
    site : SiteField, optional
        Field whose declination converts true headings to magnetic ones; by default that of the log of a boat.
    sigma_deg : float, degrees
        1 σ of a heading; by default from the residuals. A boat's log states its own.
    stationary_s : float, s
        Shortest rest of a recording, by default 2 s; shortest leg of a boat, by default 20 s.
    level : bool
        Whether the sensor was never tilted, so that no accelerometer is needed.
    min_speed, crab_deg : float, m/s and degrees
        For a boat that is compared with its course: smallest speed of a leg, and 1 σ of leeway.
    target_deg : float, degrees
        Largest error of a turn by 180°, and largest 1 σ of the curve, that is good enough.
    rule : Standard or name of one, optional
        Rule for compasses, of `flinders.marine.STANDARDS`.
    limit_deg : float, degrees
        Largest deviation allowed. By default that of the rule.
    base_error_deg : float, degrees
        1 σ of an error that all known headings share, such as that of the compass base.
    before : SwingTable or path, optional
        Readings on N, E, S and W before the compass was compensated.

    Raises
    ------
    InputError
        For a file that cannot be read, or is of another kind.
    FitError
        For fewer than five headings or less than half a circle of them; for a recording without known headings and
        half turns, or with another number of rests than headings; for fewer than five straight legs.
    UsageError
        For arguments that conflict, and for true headings without a site.
    """
    standard = standard_of(rule) if isinstance(rule, str) else rule
    opened = _read_source(source, calibration, site=site, stationary_s=stationary_s, level=level)
    if isinstance(opened, SwingRecording):
        found = _of_recording(opened, headings_deg, site or opened.stream.site, sigma_deg)
    elif isinstance(opened, SwingTable):
        _refuse(opened.source, headings_deg=headings_deg, stationary_s=stationary_s)
        found = _of_table(opened, site, sigma_deg)
    else:
        _refuse(opened.source, headings_deg=headings_deg, sigma_deg=sigma_deg)
        limits = {"least_s": MIN_LEG_S if stationary_s is None else stationary_s, "slowest": min_speed}
        found = _of_boat(opened, site or opened.site(), {**limits, "crab_deg": crab_deg})
    if found.deviation is None:
        _refuse(f"{opened.source}, without known headings,", limit_deg=limit_deg, before=before)
        return replace(found, target_deg=target_deg, rule=standard)
    curve = found.deviation.widen(common_error(base_error_deg))
    limit_deg = standard.limit_deg if limit_deg is None and standard is not None else limit_deg
    return replace(
        found,
        deviation=curve,
        target_deg=target_deg,
        rule=standard,
        conformity=None if limit_deg is None else conformity(curve, limit_deg),
        before=None if before is None else compensate(before, site=site),
    )


def compensate(source: AnyTable, *, site: SiteField | None = None) -> Compensation:
    """Find the corrections on N, E, S and W, from a table with a reading on each.

    Parameters
    ----------
    source : SwingTable or path
    site : SiteField, optional
        Field whose declination converts true headings to magnetic ones.

    Raises
    ------
    FitError
        If no reading is within 5° of one of these headings.
    InputError, UsageError
        As for `swing`.
    """
    table = source if isinstance(source, SwingTable) else read_swing(source)
    return compensation(*table.deviations(site))


def kind_of(path: str | os.PathLike[str]) -> Kind:
    """Kind of a file: the log of a boat, a recording, or else a table; standard input is a table."""
    if path == "-":  # which can be read once
        return "table"
    if is_compass_log(path):
        return "boat"
    try:
        read_swing(path)
    except InputError:
        return "recording" if _is_recording(path) else "table"
    return "table"


def standard_of(name: str) -> Standard:
    """Rule for compasses with this name; raises `UsageError` for an unknown name."""
    if name not in STANDARDS:
        raise UsageError(f"no rule {name!r}{did_you_mean(name, STANDARDS)}: need one of {', '.join(STANDARDS)}")
    return STANDARDS[name]


def _is_recording(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a recording of a magnetometer."""
    try:
        return bool(open_recording(path))
    except FlindersError:
        return False


def _read_source(
    source: AnySwing, calibration: AnyCalibration | None, *, site: SiteField | None, **rests: Any
) -> SwingTable | CompassLog | SwingRecording:
    """Read the source of a swing, unless it has been read; `rests` are arguments of `read_rests`."""
    if isinstance(source, SwingTable | CompassLog | SwingRecording):
        is_read = isinstance(source, SwingRecording)
        unused = {"level": rests["level"] or None, "stationary_s": rests["stationary_s"] if is_read else None}
        _refuse(source.source, calibration=calibration, **unused)
        return source
    if isinstance(source, str | os.PathLike) and calibration is None and (kind := kind_of(source)) != "recording":
        _refuse(source, level=rests["level"] or None)
        return read_swing(source) if kind == "table" else read_compass_log(source)
    return read_rests(source, calibration, site=site, **rests)


def _refuse(name: object, **given: object) -> None:
    """Refuse arguments that do not apply to the source with this name."""
    unused: Mapping[str, object] = {word: None for word, value in given.items() if value is not None}
    if unused:
        raise UsageError(f"{name} does not use these arguments: leave them out", hint=unused)


def _of_table(table: SwingTable, site: SiteField | None, sigma_deg: float | None) -> Swing:
    """Make a swing from a table of headings."""
    compass, deviations = table.deviations(site)
    stated = table.columns.get("sigma")
    if stated is not None and sigma_deg is not None:
        raise UsageError(
            f"{table.source} has a column with sigma of each heading: leave sigma out", hint={"sigma_deg": None}
        )
    sigma = sigma_deg if stated is None else stated
    curve = fit(compass, deviations, sigma_deg=sigma)
    halves = _half_turns(compass, compass + deviations, curve.sigma_deg if sigma is None else sigma)
    return Swing(curve, site=site, halves=halves)


def _of_boat(log: CompassLog, site: SiteField, limits: Mapping[str, float]) -> Swing:
    """Make a swing from the straight legs of a log; with too few legs and a heading as reference, from its turns."""
    magnetic = wrap_360(log.reference_deg - site.declination_deg)
    try:
        logged = legs(log.time, log.compass_deg, magnetic, log.speed, is_course=log.is_course, **limits)
    except FitError:
        if log.is_course:
            raise
        logged = turn_readings(log.time, log.compass_deg, magnetic)
    curve = fit(logged.compass_deg, logged.deviation_deg, sigma_deg=logged.sigma_deg).widen(logged.common_covariance)
    has_headings = logged.is_steady and not log.is_course
    compass, deviations = logged.compass_deg, logged.deviation_deg
    halves = _half_turns(compass, compass + deviations, logged.sigma_deg) if has_headings else ()
    return Swing(curve, site=site, halves=halves, logged=logged)


def _of_recording(
    recording: SwingRecording, headings_deg: Sequence[float] | None, site: SiteField | None, sigma_deg: float | None
) -> Swing:
    """Make a swing from rests on known headings, with their half turns."""
    halves = recording.half_turns()
    if headings_deg is None and not halves:
        raise FitError(
            f"no turn by 180° in {recording.source}, {recording.rest_words()}: rest on a heading, turn by 180°, rest "
            "again; or name the known headings",
            hint={"headings_deg": None},
            rests=len(recording.rests),
        )
    curve = None if headings_deg is None else recording.deviation(headings_deg, site=site, sigma_deg=sigma_deg)
    expected, doubts = recording.expected_deviation(), recording.doubts
    return Swing(curve, site=site, rests=recording.rests, halves=halves, expected=expected, doubts=doubts)


def _half_turns(compass: Floats, magnetic: Floats, sigma_deg: Floats | float | None) -> tuple[HalfTurn, ...]:
    """Pairs of headings of a table that are half a turn apart."""
    sigmas = np.broadcast_to(np.nan if sigma_deg is None else sigma_deg, compass.shape).tolist()
    rows = enumerate(zip(compass.tolist(), sigmas, strict=True))
    rests = [Rest(place, place + 1, heading, sigma, sigma) for place, (heading, sigma) in rows]
    return half_turns(rests, magnetic.tolist())
