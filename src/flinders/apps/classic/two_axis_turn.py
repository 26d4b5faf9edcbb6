"""Hard and soft iron of two axes from a turn about the third one; plane after plane gives three axes.

>>> from flinders.apps.classic.simulate_two_axis import TwoAxis, swing
>>> compass = TwoAxis((1.1, 0.9), (10.0, -5.0), 4.0, 0.1)
>>> found = two_axis(swing(compass, seed=1).samples)
>>> found.fit.evidence.method, found.fit.calibration.offset[:2].round(), found.turn.spacing.is_even(within_deg=1.0)
('two-axis xy', array([10., -5.]), True)

Of three quarters of a turn the mean is not the centre, and the ellipse is fitted by least squares:

>>> found = two_axis(swing(compass, seed=1).samples[:27])
>>> found.fit.evidence.method, found.fit.calibration.offset[:2].round(), [note.code for note in found.notes]
('ellipse xy', array([10., -5.]), ['mean-off'])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, TypeAlias

import numpy as np

from flinders.apps.classic.composition import compose, refuse_unloaded
from flinders.apps.classic.two_axis_recipe import TwoAxisRecipe
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.samples import RecordingWrapper
from flinders.errors import UnitError, UsageError, did_you_mean
from flinders.estimators import Readings, remove_saturated
from flinders.estimators.data import recording_of
from flinders.estimators.ellipse import Ellipse
from flinders.estimators.in_plane import require_turn
from flinders.estimators.likelihood import MAX_ITERATED_READINGS
from flinders.fitting import calibrate
from flinders.fitting.fit_file import fit_for
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import Refused, with_calibration
from flinders.geometry.plane import PLANES, PlaneEllipse, Turn, axis_order, turn_axis
from flinders.likelihood.site_field import Site
from flinders.readers import Instrument, is_source, open_recording
from flinders.summary.summary import Summary
from flinders.workflows.notes import Note
from flinders.workflows.recordings import own_recordings, require_same_frame

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.core.samples import Recording
    from flinders.fitting.fit_file import AnyCalibration
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.workflows.recordings import AnyReadings

TurnMethod: TypeAlias = Literal["two-axis", "ellipse"]

METHODS: Final[Mapping[str, type[TwoAxisRecipe | Ellipse]]] = {"two-axis": TwoAxisRecipe, "ellipse": Ellipse}
"""Mean and scatter of equally spaced points, and least squares, by name."""

MAX_FLATNESS: Final = 0.05
"""Largest ratio of smallest to middle variance of readings in a plane, and of middle to largest for a line."""

SENTENCES: Final[Mapping[str, str]] = {
    "other-plane": "the readings turn about {about}: this looks like a turn in the plane {lies}, not {plane}",
    "mean-off": "the mean of these points is not their centre: fitted by least squares, as with {method} ellipse",
}
"""Sentence of each code, with places for values and for the arguments of `TurnNote.arguments`."""


class TurnNote(Note):
    """A note on a turn in one plane."""

    __slots__ = ()
    sentences: ClassVar = SENTENCES
    arguments: ClassVar = ("method",)


@dataclass(frozen=True, slots=True, eq=False)
class TwoAxisFit:
    """Calibration of two axes by a turn, and its composition with the loaded calibration."""

    fit: Fit  #: fit of the turn; never better than limited
    turn: Turn  #: the points, with ellipses from mean and scatter and from least squares
    composed: Fit | None = None  #: composition of the loaded calibration with this one; None if none was loaded
    notes: tuple[Note, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: the fit, the turn, and the composed calibration to load, if there is one."""
        even = self.turn.spacing.is_even(within_deg=self.fit.claim.target_deg)
        return {
            **json_of(self.fit),
            "turn": {**self.turn.as_dict(), "is_mean_trusted": even},
            "composed": None if self.composed is None else json_of(self.composed),
        }


@dataclass(frozen=True, eq=False)
class TurnReadings:
    """Readings of a turn in one plane, raw or with a calibration loaded."""

    recording: Recording
    readings: Readings
    plane: Plane
    previous: Fit | None = None  #: the calibration that was loaded
    method: TurnMethod | None = None  #: None: the mean, or least squares if the mean is not the centre

    @property
    def notes(self) -> tuple[Note, ...]:
        """A note if the readings turn in another plane, else none."""
        summary = self.readings.summary
        if len(summary) < len(PLANES):
            return ()
        variances, axes = np.linalg.eigh(summary.moments.covariance)
        about = "xyz"[int(np.abs(axes[:, 0]).argmax())]
        goes_round = variances[0] < MAX_FLATNESS * variances[1] and variances[1] > MAX_FLATNESS * variances[2]
        if not goes_round or about == turn_axis(self.plane):
            return ()
        lies = next(plane for plane in PLANES if turn_axis(plane) == about)
        return (TurnNote("other-plane", values={"about": about, "lies": lies, "plane": self.plane}),)

    @cached_property
    def turn(self) -> Turn:
        """Points in the plane, a selection for a long recording, and the ellipse through them.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis`, `Unmoved` or `NotAnEllipse`.
        """
        require_turn(self.readings, Ellipse.unknowns, self.method or TwoAxisRecipe.name, self.plane)
        ellipsoid = Ellipse(self.plane, dip_deg=0.0).estimate(self.readings).ellipsoid
        cells = list(axis_order(self.plane)[:2])
        points = self.readings.thin(MAX_ITERATED_READINGS, Ellipse.name)[:, cells]
        return Turn.of(self.plane, points, PlaneEllipse(ellipsoid.centre[cells], ellipsoid.shape[cells][:, cells]))

    def fit(
        self,
        *,
        target_deg: float = 1.0,
        dip_deg: float | None = None,
        field_strength: float | None = None,
        sensor: str | None = None,
    ) -> TwoAxisFit:
        """Fit the turn, and compose it with the loaded calibration; parameters as of `two_axis`."""
        previous = self.previous
        if previous is None:
            asked = self._fit_arguments(
                target_deg, Site.merge_stated(strength=field_strength, inclination_deg=dip_deg), sensor
            )
            fit, notes = self._fit_with_notes(**asked)
            return TwoAxisFit(fit, self.turn, notes=notes)
        if field_strength is not None:
            words = f"{previous.provenance.name} has set the length of corrected readings: give no field strength"
            raise UsageError(words, hint={"field_strength": None})
        dip_deg, calibration = _dip_deg(previous, dip_deg), previous.calibration
        refuse_unloaded(previous, self.turn, dip_deg=dip_deg, source=self.recording.source)
        site = Site.merge_stated(strength=calibration.field_strength, inclination_deg=dip_deg)
        fit, notes = self._fit_with_notes(**self._fit_arguments(target_deg, site, sensor))
        fit = with_calibration(fit, replace(fit.calibration, field_strength_known=calibration.field_strength_known))
        return TwoAxisFit(fit, self.turn, compose(previous, fit), notes)

    def _fit_arguments(self, target_deg: float, site: Site | None, sensor: str | None) -> dict[str, Any]:
        """Arguments of a fit; for a log with several magnetometers, with the name of the selected one."""
        read = self.recording.recording if isinstance(self.recording, RecordingWrapper) else self.recording
        name = read.name if isinstance(read, Instrument) else sensor
        return {"target_deg": target_deg, "site": site, "sensor": name}

    def _fit_with_notes(self, **asked: Any) -> tuple[Fit, tuple[Note, ...]]:
        """Fit by the given method, else by the mean, or by least squares if the mean is not the centre."""
        if self.method is not None:
            return self._fit(self.method, **asked), ()
        try:
            fit = self._fit("two-axis", **asked)
        except Refused:
            is_right = False
        else:
            is_off = any(finding.code == "bias" for finding in fit.findings)
            is_right = not is_off and self.turn.spacing.is_even(within_deg=asked["target_deg"])
        return (fit, ()) if is_right else (self._fit("ellipse", **asked), (TurnNote("mean-off"),))

    def _fit(self, method: TurnMethod, **asked: Any) -> Fit:
        return calibrate.fit(self.recording, method=METHODS[method](plane=self.plane), **asked)


def _dip_deg(previous: Fit, dip_deg: float | None) -> float:
    """Dip in degrees: the given one, else that of the loaded calibration; raises `UsageError` if the two contradict."""
    known = previous.heading_error_deg.dip_deg
    if math.isnan(known):
        return ASSUMED_DIP_DEG if dip_deg is None else dip_deg
    if dip_deg is not None and abs(abs(known) - abs(dip_deg)) > 1e-6:
        raise UsageError(
            f"the dip is given as {dip_deg:g}°, and {previous.provenance.name} was made for {known:g}°: record all "
            "planes at one place, and leave the dip out",
            hint={"dip_deg": None},
        )
    return known if dip_deg is None else dip_deg


def read_turn(
    source: AnyReadings,
    previous: AnyCalibration | None = None,
    *,
    plane: Plane = "xy",
    method: TurnMethod | None = None,
) -> TurnReadings:
    """Read a turn; a file is read in the unit of the loaded calibration.

    Parameters and errors are those of `two_axis`.
    """
    if method is not None and method not in METHODS:
        words = f"no method {method!r} of two axes{did_you_mean(method, METHODS)}: need one of {', '.join(METHODS)}"
        raise UsageError(words)
    axis_order(plane)
    known = None if previous is None else fit_for(previous)
    if is_source(source):
        recording: Recording | Summary = open_recording(source, flat=plane)
    else:
        recording, _ = recording_of(source, None if known is None else known.calibration.raw)
    if isinstance(recording, Summary):
        raise UsageError("a turn needs readings: give the recording, not its summary")
    if known is not None:
        if is_source(source):
            require_same_frame(known.calibration, recording)
        if recording.unit.inside != known.calibration.unit:
            raise UnitError(
                f"{recording.source} is in {recording.unit.inside}, {known.provenance.name} in "
                f"{known.calibration.unit}: record all planes in one unit"
            )
        if own_recordings(known, [recording]):
            raise UsageError(
                f"{known.provenance.name} was made from {recording.source}, so this recording was made before that "
                f"calibration: record the next plane with {known.provenance.name} loaded, or correct a raw recording "
                "with flinders apply"
            )
    return TurnReadings(recording, remove_saturated(Readings.of(recording)), plane, known, method)


def two_axis(
    source: AnyReadings,
    previous: AnyCalibration | None = None,
    *,
    plane: Plane = "xy",
    method: TurnMethod | None = None,
    target_deg: float = 1.0,
    dip_deg: float | None = None,
    field_strength: float | None = None,
    sensor: str | None = None,
) -> TwoAxisFit:
    """Find hard and soft iron of two axes from a turn about the third one, which points up or down.

    The mean of points equally spaced in heading is the offset; the eigenvalues and eigenvectors of their scatter are
    the soft iron. The result holds for this plane alone, and is never better than limited.

    Parameters
    ----------
    source : Samples, Recording, (N, 3) array-like, path, open file or data frame
        Readings of the turn, as for `flinders.fit`.
    previous : Fit, Calibration or path, optional
        The calibration that was loaded in the sensor during the turn; `TwoAxisFit.composed` replaces it. With turns
        about one axis after the other, all three axes are calibrated.
    plane : ``xy``, ``yz`` or ``zx``
        The two axes in the plane of the turn.
    method : ``two-axis`` or ``ellipse``, optional
        Mean and scatter, or least squares, which allows any spacing of the points. By default the mean, or least
        squares if the points are not equally spaced.
    target_deg : float, degrees
        Worst heading error that is good enough.
    dip_deg : float, degrees
        Inclination of the field. By default that of the loaded calibration, else 60°.
    field_strength : float
        Length of corrected readings, in their unit; not allowed with a loaded calibration, which has set it.
    sensor : str, optional
        Name or serial number to store.

    Returns
    -------
    TwoAxisFit
        With a note if least squares replaced the mean.

    Raises
    ------
    FitError
        `TooFewSamples`, `StuckAxis` or `Unmoved` for readings that are no turn, and `Refused` for a poor turn.
    UsageError
        For a recording that was not made with the calibration loaded, and a field that contradicts it.
    InputError, UnitError, AxesError
        As for `flinders.apply`.
    """
    turn = read_turn(source, previous, plane=plane, method=method)
    return turn.fit(target_deg=target_deg, dip_deg=dip_deg, field_strength=field_strength, sensor=sensor)
