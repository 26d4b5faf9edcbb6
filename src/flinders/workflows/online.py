"""Online calibration: a stream of readings gives the calibration in force and its present heading error.

There is no thread, socket or clock: time is that of the readings, so that a replayed log gives the same numbers as a
live sensor. The engine learns and judges (`flinders.native`, ``online.c``); this module adds units, events, states and
files.

>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1).samples
>>> online = OnlineCalibration(unit="uT")
>>> [event.code for event in online.add(tumble.field, time=tumble.time)][:2]
['learnt', 'adopted']
>>> online.state.doing, online.state.verdict, online.state.heading_error_deg < 0.5
('undisturbed', 'good', True)
>>> week = online.at(online.state.time_s + 7 * 86400)                               # nothing is learnt for a week
>>> week.heading_error_deg > online.state.heading_error_deg, week.age_s > 6e5
(True, True)
"""

from __future__ import annotations

import math
import os
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, Final, Self

import msgspec
import numpy as np

from flinders.arrays import check_vectors
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance, shift_and_gain, values_by_name
from flinders.core.files import read_bytes, write_text
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.offset_walk import Walk
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import DocumentError, UsageError
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.native.engine import engine
from flinders.native.layouts import ONLINE
from flinders.workflows._online_files import json_of, json_of_record, numbers_from_json, record_from
from flinders.workflows._online_fit import fit_of, require_usable_start
from flinders.workflows._online_releases import convert, is_of_this_release
from flinders.workflows.online_events import ACTIVITIES, CODES, WORDS, OnlineEvent, OnlineState
from flinders.workflows.timeline import UNKNOWN_VECTOR, OnlinePoint, Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.native.layouts import Records
    from flinders.workflows.timeline import Code

SOURCE: Final = "the readings"
FORMAT: Final = "flinders online calibration"
MAX_BYTES: Final = 4_000_000
"""Largest size in bytes of a state file."""
MAX_EVENTS: Final = 1000
"""Largest number of events in `history`."""
NO_TIME_S: Final = -1e99
"""Time in the engine before the first reading, in s."""
MIN_GAP_S: Final = 600.0
"""Shortest gap between readings, in s, for which the timeline shows how the heading error grows."""
GAP_POINTS: Final = 8
"""Number of points in the timeline for such a gap."""


class OnlineCalibration:
    """A calibration that is updated while its sensor is used.

    Parameters
    ----------
    start : Fit, optional
        Calibration in force at first, from `flinders.fit` or `flinders.load`. By default it is learnt from the first
        readings in all directions, or of a level turn.
    at : float, s, optional
        Time of `start`, by the clock of the readings; by default the time of the first reading.
    unit, axes : str, Unit and Axes
        Unit and axes of the readings, as for `flinders.read`; if `start` is given, its unit and axes.
    frame : str
        Frame of the axes, ``sensor`` or ``vehicle``, as in `Calibration`; if `start` is given, its frame.
    target_deg, dip_deg : float
        As for `flinders.fit`.
    walk : float or Walk, optional
        Random walk of this unit's offset by its history: change in an hour, 1 σ, in µT or counts. A number counts as
        known within a factor of two; a `Walk`, such as one of `flinders.OffsetHistory`, states its uncertainty. By
        default it is the prior of all units. Readings update it in each case.

    Raises
    ------
    UsageError
        For a target, dip or walk out of range. For a `start` that cannot be used: one that is refused, states no
        uncertainty, is linearized, or has a disturbance with a lag.
    """

    def __init__(
        self,
        start: Fit | None = None,
        *,
        at: float | None = None,
        unit: str | Unit = "uT",
        axes: str | Axes = "x,y,z",
        frame: str = "sensor",
        target_deg: float = 1.0,
        dip_deg: float | None = None,
        walk: float | Walk | None = None,
    ) -> None:
        if dip_deg is not None and not abs(dip_deg) <= 89.0:
            raise UsageError(f"dip is {dip_deg:g}°: need -89° to 89°")
        given = unit if isinstance(unit, Unit) else Unit.of(unit)
        self._raw = given if start is None else start.calibration.raw
        mapped = axes if isinstance(axes, Axes) else Axes.of(axes)
        self._axes = mapped if start is None else start.calibration.axes
        self._frame = frame if start is None else start.calibration.frame
        self._start, self._sensor, self._strength = start, None, None
        self._disturbances, self._reference = tuple[Disturbance, ...](), check_vectors(np.zeros(3))
        self._is_dip_assumed, self._history = dip_deg is None, list[OnlineEvent]()
        self._is_converted = False
        self._timeline = Timeline()
        self._record = engine().make_online()
        self.target_deg = target_deg
        self._record["dip_deg"] = ASSUMED_DIP_DEG if dip_deg is None else dip_deg
        if walk is not None:
            known = walk if isinstance(walk, Walk) else Walk.from_rate(walk)
            engine().online_expect_walk(self._record, known.rate, known.log_sigma)
        if start is not None:
            require_usable_start(start)
            calibration = start.calibration
            self._sensor = calibration.sensor
            self._disturbances, self._reference = calibration.disturbances, calibration.offset
            self._strength = calibration.field_strength if calibration.field_strength_known else None
            if at is not None:
                self._start_with(start, at)

    @property
    def unit(self) -> Unit:
        """Unit of the readings."""
        return self._raw

    @property
    def axes(self) -> Axes:
        """Mapping of the axes of the readings."""
        return self._axes

    @property
    def frame(self) -> str:
        """Frame of the axes of the readings: ``sensor`` or ``vehicle``."""
        return self._frame

    @property
    def dip_deg(self) -> float:
        """Inclination of the field at which headings are judged."""
        return float(self._record["dip_deg"])

    @property
    def target_deg(self) -> float:
        """Largest acceptable heading error in degrees; `UsageError` for a number that is not positive."""
        return float(self._record["target_deg"])

    @target_deg.setter
    def target_deg(self, target_deg: float) -> None:
        if not target_deg > 0.0:
            raise UsageError(f"target is {target_deg:g}°: need a positive angle")
        self._record["target_deg"] = target_deg

    @property
    def is_locked(self) -> bool:
        """Whether the calibration in force stays, whatever is learnt."""
        return bool(self._record["is_locked"])

    @is_locked.setter
    def is_locked(self, is_locked: bool) -> None:
        self._record["is_locked"] = is_locked

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Names of the disturbances whose values `add` needs: ``current``, ``temperature`` and so on."""
        return tuple(disturbance.name for disturbance in self._disturbances)

    def add(self, readings: ArrayLike, *, time: ArrayLike, **disturbances: ArrayLike | None) -> tuple[OnlineEvent, ...]:
        """Add readings.

        Parameters
        ----------
        readings : (N, 3) or (3,), in the unit of the readings
            Readings in the sensor's own axes, in the order of time.
        time : (N,) float, s
            Times by any clock.
        **disturbances : (N,) or (N, M), optional
            Values of `disturbances`, named as in `Calibration.apply`. Their effect on readings is that in `start`.
            Readings without a value are left out.

        Returns
        -------
        tuple of OnlineEvent
            Events, in the order of time.

        Raises
        ------
        ArrayError
            For another shape.
        UsageError
            If values of a disturbance are missing.
        """
        samples = Samples.of(readings, unit=self._raw, axes=self._axes, time=np.atleast_1d(time), source=SOURCE)
        if self._disturbances:
            samples = replace(samples, field=self._compensate(samples.field, disturbances))
        assert samples.time is not None
        if self._start is not None and len(samples):
            self._start_with(self._start, float(samples.time[0]))
        found: list[OnlineEvent] = []
        is_usable = np.isfinite(samples.field).all(axis=1) & np.isfinite(samples.time)
        reached = np.maximum.accumulate(np.where(is_usable, samples.time, -np.inf))
        row = 0
        while row < len(samples):
            due = int(np.searchsorted(reached, self._timeline.due_s))
            if due <= row:
                self._put_gap(float(reached[row]))
            until = max(due, row + 1)
            added, bits = engine().online_add(self._record, samples.field[row:until], samples.time[row:until])
            row += added
            events = self._events(bits, [*self._history[-1:], *found][-1] if self._history or found else None)
            found += events
            self._put([event.code for event in events])
        self._note(found)
        return tuple(found)

    def _compensate(self, field: Floats, values: Mapping[str, ArrayLike | None]) -> Floats:
        """(N, 3) readings, compensated to the reference values of the disturbances."""
        shift, gain = shift_and_gain(self._disturbances, values_by_name(self._disturbances, **values))
        quiet: Floats = self._reference + (field - self._reference - shift) / gain[..., np.newaxis]
        return quiet

    def _put(self, codes: list[Code]) -> None:
        """Add a point to the timeline if there was an event, or if a point is due."""
        now = float(self._record["now"])
        if codes or now >= self._timeline.due_s:
            self._timeline.put(self._point(now, codes))

    def _put_gap(self, until: float) -> None:
        """Add points that show how the heading error grows until the next reading, if this is far in the future."""
        for point in self._gap(until):
            self._timeline.put(point)

    def _gap(self, until: float) -> Iterator[OnlinePoint]:
        """Yield points that show how the heading error grows after the newest reading; none for a short gap."""
        now = self.time_s
        if until - now > MIN_GAP_S:
            yield self._point(now)
            for part in range(1, GAP_POINTS):
                yield self._point(now + (until - now) * (part / GAP_POINTS) ** 2, is_read=False)

    def _point(self, time_s: float, codes: list[Code] | None = None, *, is_read: bool = True) -> OnlinePoint:
        known = self.at(time_s)
        errors, offset = (known.heading_error_deg, known.bound_deg), (known.offset, known.offset_sigma)
        return OnlinePoint(time_s, known.doing, *errors, *offset, is_read, tuple(codes or ()))

    def _offset(self, claim: Records) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Newest estimate of the offset, and 1 σ of its components, from a claim of the engine."""
        latest = self._record["latest"][:3]
        apart = self._record["in_force"][:3] - latest  # the claim for the calibration in force includes this difference
        variances = np.maximum(claim["covariance"].reshape(9, 9).diagonal()[:3] - apart**2, 0.0)
        return tuple(latest.tolist()), tuple(np.sqrt(variances).tolist())

    def _events(self, bits: int, before: OnlineEvent | None) -> list[OnlineEvent]:
        """Events from the engine's bits; a clock that goes back is reported only once."""
        if not bits:
            return []
        state = self.state
        codes = [code for bit, code in CODES.items() if bits & bit]
        if codes == ["clock-back"] and before is not None and before.code == "clock-back":
            return []
        return [OnlineEvent(state.time_s, code, state.heading_error_deg) for code in codes]

    def _note(self, found: list[OnlineEvent]) -> None:
        self._history = [*self._history, *found][-MAX_EVENTS:]

    def _start_with(self, start: Fit, at: float) -> None:
        """Put the calibration with which it starts in force."""
        parameters, covariance = start.calibration.ellipsoid.parameters, start.claim.claimed_covariance
        engine().online_activate(self._record, parameters, covariance, noise=start.evidence.noise, time=at)
        self._start = None

    @property
    def time_s(self) -> float:
        """Time of the newest reading in s; NaN before the first one."""
        now = float(self._record["now"])
        return now if now > NO_TIME_S else math.nan

    @property
    def state(self) -> OnlineState:
        """State at the newest reading."""
        return self.at(self.time_s)

    def at(self, time_s: float) -> OnlineState:
        """State that is predicted for a time in s if there are no further readings."""
        claim = engine().online_claim(self._record, time_s)
        offset, offset_sigma = self._offset(claim) if self._record["state"] else (UNKNOWN_VECTOR, UNKNOWN_VECTOR)
        return OnlineState(
            time_s,
            ACTIVITIES[int(self._record["state"])],
            heading_error_deg=float(claim["worst_deg"]),
            bound_deg=float(claim["bound_deg"]),
            latest_deg=float(claim["latest_deg"]),
            age_s=float(claim["age_s"]),
            walk=float(claim["walk"]),
            target_deg=self.target_deg,
            offset=offset,
            offset_sigma=offset_sigma,
            radius=float(self._record["latest"][3:6].mean()),
        )

    @property
    def is_level(self) -> bool:
        """Whether the vehicle stays level, so that the calibration along the vertical axis is unknown."""
        return bool(self._record["is_level"])

    def error_with_deg(self, calibration: Calibration, time_s: float | None = None) -> float:
        """Expected worst heading error, 1 σ in degrees, if another calibration were used for the same readings.

        Parameters
        ----------
        calibration : Calibration
            Calibration with an offset and a symmetric matrix; its field strength does not matter.
        time_s : float, optional
            Time for which the error holds; by default that of the newest reading.
        """
        record = self._record.copy()
        parameters, latest = calibration.ellipsoid.parameters.copy(), Ellipsoid.of_parameters(self._record["latest"])
        parameters[3:] *= latest.radius / calibration.ellipsoid.radius
        record["in_force"] = parameters
        return float(engine().online_claim(record, self.time_s if time_s is None else time_s)["worst_deg"])

    @property
    def good_until_s(self) -> float:
        """Time in s at which the heading error will reach the target if there are no further readings.

        Infinite if it takes more than ten years; NaN if the error exceeds the target already.
        """
        return self.state.time_s + engine().online_good_s(self._record)

    @property
    def fit(self) -> Fit | None:
        """The calibration in force with its claim, as a fit that can be saved and exported; None if there is none."""
        if not self._record["state"]:
            return None
        ellipsoid = Ellipsoid.of_parameters(self._record["in_force"].copy())
        calibration = Calibration.from_ellipsoid(
            ellipsoid.centre,
            ellipsoid.shape,
            field_strength=self._strength,
            raw=self._raw,
            axes=self._axes,
            sensor=self._sensor,
            frame=self._frame,
        )
        return fit_of(
            replace(calibration, disturbances=self._disturbances),
            engine().online_claim(self._record, self.time_s),
            noise=float(self._record["noise"]),
            dip_deg=self.dip_deg,
            is_dip_assumed=self._is_dip_assumed,
            target_deg=self.target_deg,
        )

    @property
    def calibration(self) -> Calibration | None:
        """The calibration in force; None if there is none."""
        fit = self.fit
        return None if fit is None else fit.calibration

    @property
    def history(self) -> tuple[OnlineEvent, ...]:
        """The last 1,000 events, the newest last."""
        return tuple(self._history)

    @property
    def is_converted(self) -> bool:
        """Whether `load` has read the state of another release, without its evidence."""
        return self._is_converted

    @property
    def timeline(self) -> tuple[OnlinePoint, ...]:
        """Points over time, the newest last: one at each event and every minute; older points are thinned.

        There are at most 1,000 points. They depend only on the times of the readings: they are the same live or
        replayed, in blocks of any size, and after saving and loading.
        """
        return tuple(self._timeline.points)

    def timeline_until(self, time_s: float) -> tuple[OnlinePoint, ...]:
        """`timeline`, continued to a time in s by the prediction without further readings."""
        later = [*self._gap(time_s), *([self._point(time_s, is_read=False)] if time_s > self.time_s else [])]
        newest = -math.inf if not self.timeline else self.timeline[-1].time_s
        return (*self.timeline, *(point for point in later if point.time_s > newest))

    def adopt(self) -> None:
        """Put the newest calibration in force, even if locked; `UsageError` if there is none."""
        self._require()
        engine().online_activate_latest(self._record)
        self._note([OnlineEvent(self.state.time_s, "adopted", self.state.heading_error_deg)])
        self._put(["adopted"])

    def take_back(self) -> None:
        """Put the previous calibration in force again; `UsageError` if there is none."""
        self._require()
        if np.isnan(self._record["replaced"]).any():
            raise UsageError("there is no previous calibration to take back")
        engine().online_revert(self._record)
        self._note([OnlineEvent(self.state.time_s, "taken-back", self.state.heading_error_deg)])
        self._put(["taken-back"])

    def _require(self) -> None:
        if not self._record["state"]:
            raise UsageError("no calibration was learnt yet: turn the sensor through all directions first")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the whole state, completely or not at all; `load` continues from it.

        Raises `OutputError` if the file cannot be written.
        """
        content = {
            "format": FORMAT,
            "unit": self._raw.name,
            "scale": self._raw.scale,
            "inside": self._raw.inside,
            "field_strength": self._strength,
            "axes": str(self._axes),
            "frame": self._frame,
            "sensor": self._sensor,
            "dip_assumed": self._is_dip_assumed,
            "disturbances": [asdict(one) | {"per_unit": one.per_unit.tolist()} for one in self._disturbances],
            "reference": self._reference.tolist(),
            "history": [json_of(asdict(event)) for event in self._history],
            "timeline": self._timeline.as_dict(),
            "record": {name: json_of_record(self._record[name]) for name in ONLINE.names or ()},
        }
        write_text(msgspec.json.encode(content).decode() + "\n", path, force=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a state that `save` has written; all numbers are restored bit for bit.

        The state of another release is converted without its evidence: an event and `is_converted` say so.

        Raises `DocumentError` for any other file.
        """
        text = read_bytes(path, largest=MAX_BYTES, what="the state of an online calibration", refused=DocumentError)
        try:
            content = msgspec.json.decode(text)
            return cls._of(content)
        except (msgspec.DecodeError, UsageError, AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise DocumentError(
                f"{os.fspath(path)}: is no state of an online calibration ({error}): give the file that `save` wrote"
            ) from None

    @classmethod
    def _of(cls, content: dict[str, Any]) -> Self:
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        online = cls(axes=content["axes"], frame=content.get("frame", "sensor"))
        online._raw = Unit(content["unit"], content["scale"], content["inside"])
        online._strength, online._sensor = content.get("field_strength"), content.get("sensor")
        online._is_dip_assumed = bool(content.get("dip_assumed", True))
        online._disturbances = tuple(Disturbance(**one) for one in content.get("disturbances", ()))
        online._reference = check_vectors(content.get("reference", (0.0, 0.0, 0.0)), "the offset of its disturbances")
        online._history = [
            OnlineEvent(**{**event, "heading_error_deg": float(event["heading_error_deg"])})
            for event in content.get("history", [])
            if event["code"] in WORDS  # another release can have other codes
        ]
        saved = {name: numbers_from_json(values) for name, values in content["record"].items()}
        online._is_converted = not is_of_this_release(saved, int(online._record["version"]))
        online._record = convert(saved) if online._is_converted else record_from(saved)
        if "timeline" in content:
            online._timeline = Timeline.of(content["timeline"])
        if online._is_converted:
            online._note([OnlineEvent(online.state.time_s, "other-release", online.state.heading_error_deg)])
            if online._record["now"] > NO_TIME_S:
                online._put(["other-release"])
        return online

    def __repr__(self) -> str:
        state = self.state
        return f"OnlineCalibration({state.doing}, {state.verdict}, heading error {state.heading_error_deg:.2g}°)"
