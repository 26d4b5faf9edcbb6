"""A calibration that keeps itself: readings in, all day; out, the calibration in force and its heading error now.

No thread, no socket, no clock: time is that of the readings, so that a log that is replayed gives the numbers that were
given live. The engine learns and judges (`flinders.native`, ``online.c``); here are units, events, states and files.

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
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import msgspec
import numpy as np

from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.files import read_bytes, write_text
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import DocumentError, UsageError
from flinders.findings.catalogue import OF_CALIBRATION
from flinders.findings.rules import limit_of, linked
from flinders.fitting.claim import Claim
from flinders.fitting.evidence import Evidence
from flinders.fitting.result import Fit, Judgement, Provenance
from flinders.fitting.verdict import judged_parts
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import HeadingError
from flinders.native.engine import engine
from flinders.native.layouts import ONLINE, blank
from flinders.native.online import EVIDENCE
from flinders.workflows.timeline import Code, Doing, OnlinePoint, Timeline

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.findings.row import Verdict
    from flinders.native.layouts import Records

METHOD: Final = "online"
SOURCE: Final = "the readings"
FORMAT: Final = "flinders online calibration"
LARGEST: Final = 4_000_000
"""Bytes of a state file at most."""
HISTORY: Final = 1000
"""Events that are kept."""
BEFORE_ANY: Final = -1e99
"""Time of no reading."""
LONGEST_S: Final = 10 * 365.25 * 86400.0
"""Ahead of which nothing is said."""
GAP_S: Final = 600.0
"""Without readings, from which on the timeline tells how the claim grew."""
GAP_POINTS: Final = 8
"""Of the timeline, in such a gap."""

DOING: Final[tuple[Doing, ...]] = ("learning", "undisturbed", "disturbed")
"""By the engine's numbers."""
CODES: Final[dict[int, Code]] = {
    1: "learnt", 2: "contradicted", 4: "passed", 8: "moved", 16: "adopted", 32: "clock-back"
}  # fmt: skip
"""What happened, by the engine's bits."""

WORDS: Final[dict[Code, str]] = {
    "learnt": "a first calibration was found",
    "contradicted": "readings no longer agree with the calibration: something passes, or its offset has moved",
    "passed": "readings agree again: something passed",
    "moved": "the offset has moved, and was learnt anew",
    "adopted": "another calibration is in force",
    "clock-back": "the clock went back: readings are left out until it is where it was",
    "taken-back": "the calibration from before is in force again",
}
"""What each event means."""


@dataclass(frozen=True, slots=True)
class OnlineEvent:
    """Something that happened."""

    time_s: float  #: of the reading at which it was seen
    code: Code
    heading_error_deg: float  #: that is claimed after it, worst heading, 1 σ; NaN where nothing is in force

    def __str__(self) -> str:
        return WORDS[self.code]


@dataclass(frozen=True, slots=True)
class OnlineState:
    """What is known at a time. Numbers are NaN where no calibration is in force."""

    time_s: float
    doing: Doing  #: ``learning`` without a calibration; ``disturbed`` where readings contradict it
    heading_error_deg: float  #: to expect of a level vehicle with the calibration in force, worst heading, 1 σ
    bound_deg: float  #: that no heading exceeds with 95 %
    latest_deg: float  #: heading error with the newest calibration, which may not be in force
    age_s: float  #: since readings last told something of it
    walk: float  #: by which the offset moves in an hour, 1 σ, in µT, or counts where no scale is known
    target_deg: float

    @property
    def verdict(self) -> Verdict:
        """``good`` within the target, ``refused`` beyond five times the target or without a calibration."""
        if not self.heading_error_deg <= limit_of("heading-error", "refuses") * self.target_deg:
            return "refused"
        return "good" if self.heading_error_deg <= self.target_deg else "limited"


class OnlineCalibration:
    """A calibration that goes on while its sensor is used.

    Parameters
    ----------
    start : Fit, optional
        What is in force at first, as `flinders.fit` found it or `Fit.load` read it; without it, the first readings
        from all directions, or of a level turn, make one.
    at : float, s, optional
        When that was known, in the clock of the readings; by default their first time.
    unit, axes : str, Unit and Axes
        Of the readings, as `flinders.read` takes them; of `start` where that is given.
    frame : str
        What their axes are: ``sensor`` or ``vehicle``, as of `Calibration`; of `start` where that is given.
    target_deg, dip_deg : float
        As for `flinders.fit`.

    Raises
    ------
    UsageError
        For a target or dip out of range, or a calibration that cannot go on: one that is refused, states no
        uncertainty, or has more than an offset and a matrix.
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
    ) -> None:
        if dip_deg is not None and not abs(dip_deg) <= 89.0:
            raise UsageError(f"dip is {dip_deg:g}°: need -89 to 89")
        given = unit if isinstance(unit, Unit) else Unit.of(unit)
        self._raw = given if start is None else start.calibration.raw
        mapped = axes if isinstance(axes, Axes) else Axes.of(axes)
        self._axes = mapped if start is None else start.calibration.axes
        self._frame = frame if start is None else start.calibration.frame
        self._start, self._sensor, self._strength = start, None, None
        self._is_dip_assumed, self._history = dip_deg is None, list[OnlineEvent]()
        self._timeline = Timeline()
        self._record = engine().online()
        self.target_deg = target_deg
        self._record["dip_deg"] = ASSUMED_DIP_DEG if dip_deg is None else dip_deg
        if start is not None:
            _refuse(start)
            calibration = start.calibration
            self._sensor = calibration.sensor
            self._strength = calibration.field_strength if calibration.field_strength_known else None
            if at is not None:
                self._know(start, at)

    @property
    def unit(self) -> Unit:
        """Of the readings."""
        return self._raw

    @property
    def axes(self) -> Axes:
        """How the axes of the readings are turned."""
        return self._axes

    @property
    def target_deg(self) -> float:
        """Worst heading error that is good enough; `UsageError` for one that is not positive."""
        return float(self._record["target_deg"])

    @target_deg.setter
    def target_deg(self, target_deg: float) -> None:
        if not target_deg > 0.0:
            raise UsageError(f"target is {target_deg:g}°: need a positive angle")
        self._record["target_deg"] = target_deg

    @property
    def is_locked(self) -> bool:
        """Whether the calibration in force stays whatever is learnt."""
        return bool(self._record["is_locked"])

    @is_locked.setter
    def is_locked(self, is_locked: bool) -> None:
        self._record["is_locked"] = is_locked

    def add(self, readings: ArrayLike, *, time: ArrayLike) -> tuple[OnlineEvent, ...]:
        """Take readings in.

        Parameters
        ----------
        readings : (N, 3) or (3,), in the unit of the readings
            In the sensor's own axes, in the order of time.
        time : (N,) float, s
            Of any clock.

        Returns
        -------
        tuple of OnlineEvent
            What happened, in the order of time.

        Raises
        ------
        ArrayError
            For another shape.
        """
        samples = Samples.of(readings, unit=self._raw, axes=self._axes, time=np.atleast_1d(time), source=SOURCE)
        assert samples.time is not None
        if self._start is not None and len(samples):
            self._know(self._start, float(samples.time[0]))
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

    def _put(self, codes: list[Code]) -> None:
        """Put what is known now into the timeline, if something happened or a point is due."""
        now = float(self._record["now"])
        if codes or now >= self._timeline.due_s:
            self._timeline.put(self._point(now, codes))

    def _put_gap(self, until: float) -> None:
        """Put how the claim grew between the newest reading and the next one, if they are far apart."""
        for point in self._gap(until):
            self._timeline.put(point)

    def _gap(self, until: float) -> Iterator[OnlinePoint]:
        """The newest reading, and then how the claim grows with the root of time; nothing of a short while."""
        now = self.time_s
        if until - now > GAP_S:
            yield self._point(now)
            for part in range(1, GAP_POINTS):
                yield self._point(now + (until - now) * (part / GAP_POINTS) ** 2, is_read=False)

    def _point(self, time_s: float, codes: list[Code] | None = None, *, is_read: bool = True) -> OnlinePoint:
        doing, events = DOING[int(self._record["state"])], tuple(codes or ())
        if not self._record["state"]:
            return OnlinePoint(time_s, doing, is_read=is_read, events=events)
        claim = engine().online_claim(self._record, time_s)
        latest = self._record["latest"][:3]
        apart = self._record["in_force"][:3] - latest  # part of what is claimed with the calibration in force
        variances = np.maximum(claim["covariance"].reshape(9, 9).diagonal()[:3] - apart**2, 0.0)
        return OnlinePoint(
            time_s, doing, float(claim["worst_deg"]), float(claim["bound_deg"]), tuple(latest.tolist()),
            tuple(np.sqrt(variances).tolist()), is_read, events,
        )  # fmt: skip

    def _events(self, bits: int, before: OnlineEvent | None) -> list[OnlineEvent]:
        """What happened, by the engine's bits; a clock that goes back is said once."""
        if not bits:
            return []
        state = self.state
        codes = [code for bit, code in CODES.items() if bits & bit]
        if codes == ["clock-back"] and before is not None and before.code == "clock-back":
            return []
        return [OnlineEvent(state.time_s, code, state.heading_error_deg) for code in codes]

    def _note(self, found: list[OnlineEvent]) -> None:
        self._history = [*self._history, *found][-HISTORY:]

    def _know(self, start: Fit, at: float) -> None:
        """Put the calibration that it begins with in force."""
        parameters, covariance = start.calibration.ellipsoid.parameters, start.claim.claimed_covariance
        engine().online_know(self._record, parameters, covariance, noise=start.noise, time=at)
        self._start = None

    @property
    def time_s(self) -> float:
        """Time of the newest reading; NaN before the first."""
        now = float(self._record["now"])
        return now if now > BEFORE_ANY else math.nan

    @property
    def state(self) -> OnlineState:
        """What is known at the newest reading."""
        return self.at(self.time_s)

    def at(self, time_s: float) -> OnlineState:
        """What would be known at a time if nothing were learnt until then."""
        claim = engine().online_claim(self._record, time_s)
        return OnlineState(
            time_s,
            DOING[int(self._record["state"])],
            heading_error_deg=float(claim["worst_deg"]),
            bound_deg=float(claim["bound_deg"]),
            latest_deg=float(claim["latest_deg"]),
            age_s=float(claim["age_s"]),
            walk=float(claim["walk"]),
            target_deg=self.target_deg,
        )

    @property
    def is_level(self) -> bool:
        """Whether it is of a vehicle that stays level: nothing is known of the axis across."""
        return bool(self._record["is_level"])

    def error_with_deg(self, calibration: Calibration, time_s: float | None = None) -> float:
        """Heading error to expect with another calibration of the same readings, worst heading, 1 σ.

        Parameters
        ----------
        calibration : Calibration
            An offset and a symmetric matrix; which strength of the field it has makes no difference.
        time_s : float, optional
            By default at the newest reading.
        """
        record = self._record.copy()
        parameters, latest = calibration.ellipsoid.parameters.copy(), Ellipsoid.of_parameters(self._record["latest"])
        parameters[3:] *= latest.radius / calibration.ellipsoid.radius
        record["in_force"] = parameters
        return float(engine().online_claim(record, self.time_s if time_s is None else time_s)["worst_deg"])

    @property
    def good_until_s(self) -> float:
        """Time at which the heading error reaches the target if nothing is learnt until then.

        Infinite beyond ten years; NaN where it is not within the target now.
        """
        now, target = self.state.time_s, self.target_deg
        if not self.state.heading_error_deg <= target:
            return math.nan
        if self.at(now + LONGEST_S).heading_error_deg <= target:
            return math.inf
        low, high = 0.0, LONGEST_S
        while high - low > 1.0:
            middle = (low + high) / 2.0
            low, high = (middle, high) if self.at(now + middle).heading_error_deg <= target else (low, middle)
        return now + low

    @property
    def fit(self) -> Fit | None:
        """The calibration in force with its claim, to be saved and exported as every fit; None where there is none."""
        claim = engine().online_claim(self._record, float(self._record["now"]))
        return None if not self._record["state"] else self._fit(self._record["in_force"], claim)

    def _fit(self, parameters: Floats, claimed: Records) -> Fit:
        ellipsoid = Ellipsoid.of_parameters(np.array(parameters))
        calibration = Calibration.from_ellipsoid(
            ellipsoid.centre,
            ellipsoid.shape,
            field_strength=self._strength,
            raw=self._raw,
            axes=self._axes,
            sensor=self._sensor,
            frame=self._frame,
        )
        dip = float(self._record["dip_deg"])
        error = HeadingError(float(claimed["rms_deg"]), float(claimed["worst_deg"]), dip)
        claim = Claim(
            calibration,
            np.array(claimed["covariance"]).reshape(9, 9),
            heading_error_deg=error,
            dip_deg=dip,
            dip_assumed=self._is_dip_assumed,
            target_deg=self.target_deg,
        )
        findings = linked(
            judged_parts(
                calibration,
                ("heading-error", *OF_CALIBRATION),
                target_deg=claim.target_deg,
                values={"next_step": ("record-longer",)},
                level_worst_deg=error.worst,
            )
        )
        evidence = Evidence(method=METHOD, noise=float(self._record["noise"]))
        return Fit(calibration, evidence, claim, Judgement(findings), Provenance(METHOD))

    @property
    def calibration(self) -> Calibration | None:
        """The calibration in force; None where there is none."""
        fit = self.fit
        return None if fit is None else fit.calibration

    @property
    def history(self) -> tuple[OnlineEvent, ...]:
        """What happened, the newest last; the last thousand events."""
        return tuple(self._history)

    @property
    def timeline(self) -> tuple[OnlinePoint, ...]:
        """What was known over time, the newest last: at each event, and every minute; earlier ones are thinned.

        At most a thousand points. The times of the readings alone decide which: live or replayed, cut or saved and
        read again, it is the same.
        """
        return tuple(self._timeline.points)

    def timeline_until(self, time_s: float) -> tuple[OnlinePoint, ...]:
        """`timeline`, and what would be known until a time after it if nothing were learnt."""
        later = [*self._gap(time_s), *([self._point(time_s, is_read=False)] if time_s > self.time_s else [])]
        newest = -math.inf if not self.timeline else self.timeline[-1].time_s
        return (*self.timeline, *(point for point in later if point.time_s > newest))

    def adopt(self) -> None:
        """Put the newest calibration in force, also while it is locked; `UsageError` where there is none."""
        self._require()
        engine().online_adopt(self._record)
        self._note([OnlineEvent(self.state.time_s, "adopted", self.state.heading_error_deg)])
        self._put(["adopted"])

    def take_back(self) -> None:
        """Put the calibration in force again that was in force before; `UsageError` where there is none."""
        self._require()
        if np.isnan(self._record["replaced"]).any():
            raise UsageError("no calibration was in force before: there is nothing to take back")
        engine().online_take_back(self._record)
        self._note([OnlineEvent(self.state.time_s, "taken-back", self.state.heading_error_deg)])
        self._put(["taken-back"])

    def _require(self) -> None:
        if not self._record["state"]:
            raise UsageError("nothing was learnt yet: turn the sensor through all directions first")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything that is known, whole or not at all, so that `load` goes on where this ended.

        Raises `OutputError` where it cannot be written.
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
            "history": [_finite(asdict(event)) for event in self._history],
            "timeline": self._timeline.as_dict(),
            "record": {name: _listed(self._record[name]) for name in ONLINE.names or ()},
        }
        write_text(msgspec.json.encode(content).decode() + "\n", path, force=True)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what `save` wrote; the same numbers, to the bit.

        Raises `DocumentError` for a file that is none.
        """
        text = read_bytes(path, largest=LARGEST, what="the state of an online calibration", refused=DocumentError)
        try:
            content = msgspec.json.decode(text)
            return cls._of(content)
        except (msgspec.DecodeError, KeyError, TypeError, ValueError, IndexError) as error:
            raise DocumentError(
                f"{os.fspath(path)}: is no state of an online calibration ({error}): give the file that `save` wrote"
            ) from None

    @classmethod
    def _of(cls, content: dict[str, Any]) -> Self:
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        online = cls(axes=content["axes"], frame=content["frame"])
        online._raw, online._strength = (
            Unit(content["unit"], content["scale"], content["inside"]),
            content["field_strength"],
        )
        online._sensor, online._is_dip_assumed = content["sensor"], bool(content["dip_assumed"])
        online._history = [
            OnlineEvent(**{**event, "heading_error_deg": _number(event["heading_error_deg"])})
            for event in content["history"]
        ]
        online._timeline = Timeline.of(content["timeline"])
        record = blank(ONLINE)
        for name in ONLINE.names or ():
            values = np.array(_numbers(content["record"][name]))
            if values.shape != record[name].shape:
                raise ValueError(f"{name} has {values.size} numbers, and not {record[name].size}")
            record[name] = values
        _refuse_record(record, version=int(online._record["version"]))
        online._record = record
        return online

    def __repr__(self) -> str:
        state = self.state
        return f"OnlineCalibration({state.doing}, {state.verdict}, heading error {state.heading_error_deg:.2g}°)"


def _refuse(start: Fit) -> None:
    """Refuse a calibration that cannot go on."""
    calibration = start.calibration
    why = (
        "is refused" if start.verdict == "refused"
        else "states no uncertainty" if not start.claim.states_uncertainty
        else "is of a level turn, which is learnt anew" if start.claim.plane is not None
        else "follows disturbances" if calibration.disturbances
        else "is linearized" if calibration.linearization is not None
        else "has a mounting that an aid found" if calibration.rotation != "symmetric"
        else ""
    )  # fmt: skip
    if why:
        raise UsageError(f"{start.name} {why}: begin with a calibration of the magnetometer alone, or with none")


def _refuse_record(record: Records, *, version: int) -> None:
    """Raise ValueError for a record that this engine has not written: its counts are places in memory."""
    if record["version"] != version:
        raise ValueError(f"it was written by version {int(record['version'])} of this record")
    kept, tested, doubtful = (int(record[name]) for name in ("kept", "tested", "doubtful"))
    is_sound = 0 <= tested <= kept <= EVIDENCE and -1 <= doubtful <= kept and record["averaged"] >= 0
    if not (is_sound and 0 <= record["state"] < len(DOING)):
        raise ValueError("its counts are none")


def _listed(values: Records) -> Any:  # noqa: ANN401 - JSON
    """Numbers for JSON; words for those that it has not."""
    return values.tolist() if np.isfinite(values).all() else _finite(values.tolist())


def _finite(content: Any) -> Any:  # noqa: ANN401 - JSON
    """JSON has no NaN and no infinity: words in their place."""
    if isinstance(content, dict):
        return {name: _finite(value) for name, value in content.items()}
    if isinstance(content, list):
        return [_finite(value) for value in content]
    return str(content) if isinstance(content, float) and not math.isfinite(content) else content


def _number(value: float | str) -> float:
    return float(value)


def _numbers(values: Any) -> Any:  # noqa: ANN401 - a number or a list of them
    return (
        [_numbers(value) for value in values]
        if isinstance(values, list)
        else _number(values)
        if isinstance(values, str)
        else values
    )
