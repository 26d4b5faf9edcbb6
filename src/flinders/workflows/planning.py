"""The use case `plan`: motion and duration of a recording, and the heading error to expect.

A body, the noise of its sensor and a target determine the motion, its duration and the expected fit
(`flinders.workflows.planned_fit`). `flinders.simulate.bodies` has the sequences of turns that a body can make. The
shortest sequence with the best grade is selected. The best grade is a good verdict; then headings within the target at
every tilt of the body; then headings within the target while it is level; then the smallest error.

>>> drone = plan("drone", noise="0.5 uT", alternatives=False)
>>> drone.steps[1], round(drone.seconds), drone.expected.fit.verdict
('lower its nose by 45°, keep it so and turn it once around', 45, 'limited')
>>> 0.04 < drone.expected.fit.claim.heading_error_deg.rms < 0.1
True
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, get_args

from flinders.core.chips import find_chip
from flinders.core.keywords import check_keywords
from flinders.core.units import COUNTS, Unit
from flinders.errors import FitError, UsageError, did_you_mean
from flinders.simulate.bodies import BODIES, QUARTER_DEG, UPSIDE_DOWN_DEG
from flinders.simulate.motions import RATE_HZ
from flinders.workflows.planned_fit import (
    GOOD_RANK,
    LEVEL_RANK,
    REACHED_RANK,
    RecordingSettings,
    dip_of,
    expected_fit,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.likelihood.site_field import Site
    from flinders.simulate.bodies import Body
    from flinders.simulate.turn_sequence import PoseTurn
    from flinders.workflows.planned_fit import ExpectedFit

PlannedAid = Literal["dip", "rate"]
"""Aiding sensors of a plan: accelerometer and gyro."""

REPEATS: Final = (1, 2, 4, 8)
"""Numbers of circles in each attitude that are tried."""

MANY_REPEATS: Final = 4
"""Number of circles in each attitude from which the search for a plan stops once level headings meet the target."""

MAX_SECONDS: Final = 900.0
"""Duration in s beyond which no further circles are tried."""

MAX_SPEED_RATIO: Final = 2.0
"""Largest ratio of the rate of turning to the usual rate, if a duration is given."""

MORE_TILT_DEG: Final = (10.0, 20.0, 35.0)
"""Increases of the tilt, in degrees, that are tried as alternatives."""

NOISE_TEXT: Final = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\S*)\s*")
"""A number and its unit, as a text."""


class Alternative(NamedTuple):
    """A recording other than the planned one, and its expected fit."""

    name: str  #: what is increased, ``time`` or ``tilt``; or an added aiding sensor, ``dip`` or ``rate``
    tilt_deg: float  #: largest tilt in degrees
    seconds: float
    expected: ExpectedFit | None

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {
            "more": self.name,  # time, tilt, or an aiding sensor: dip, rate
            "tilt_deg": self.tilt_deg,  # largest tilt of the motion
            "seconds": self.seconds,  # duration
            "expected": None if self.expected is None else self.expected.as_dict(),  # null where no fit is expected
        }


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A planned recording: motion, duration, expected fit, and what more time, tilt or sensors would gain."""

    body: Body
    recording: RecordingSettings
    tilt_deg: float  #: largest tilt of the body in degrees
    sequence: tuple[PoseTurn, ...]
    expected: ExpectedFit
    alternatives: tuple[Alternative, ...] = ()

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return self.recording.seconds

    @property
    def steps(self) -> list[str]:
        """Instructions for a person, one for each attitude."""
        return self.body.steps(self.sequence)

    @property
    def readings(self) -> int:
        """Number of readings in the recording."""
        return round(self.seconds * self.recording.rate_hz)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {
            "body": self.body.name,  # body that carries the sensor
            "noise_uT": self.recording.noise,  # 1 σ of each axis and reading
            "rate_hz": self.recording.rate_hz,  # readings a second
            "target_deg": self.recording.target_deg,  # worst heading error that is good enough
            "dip_deg": dip_of(self.recording.site),  # inclination of the field that the plan is for
            "aiding": list(self.recording.aiding),  # aiding sensors that count in the fit
            "tilt_deg": self.tilt_deg,  # largest tilt of the body
            "seconds": self.seconds,  # duration of the recording
            "readings": self.readings,  # in that time
            "turns": [{"side": turn.side, "tilt_deg": turn.tilt_deg} for turn in self.sequence],  # side lowered, angle
            "steps": self.steps,  # instructions, one for each attitude
            "expected": self.expected.as_dict(),  # the fit to expect
            "alternatives": [each.as_dict() for each in self.alternatives],  # the same with more time, tilt or sensors
        }

    def __repr__(self) -> str:
        error = self.expected.fit.claim.heading_error_deg
        return f"Plan({self.body.name}: {self.seconds:.0f} s, {self.expected.fit.verdict}, {error})"


class _Candidate(NamedTuple):
    """A motion that a body can follow."""

    sequence: tuple[PoseTurn, ...]
    seconds: float


class _Choice(NamedTuple):
    """A motion with its expected fit."""

    candidate: _Candidate
    expected: ExpectedFit


@check_keywords()
def plan(
    body: str | Body = "hand",
    *,
    noise: float | str,
    site: Site | None = None,
    target_deg: float = 1.0,
    rate_hz: float = RATE_HZ,
    seconds: float | None = None,
    tilt_deg: float | None = None,
    aiding: str | Sequence[str] = (),
    alternatives: bool = True,
) -> Plan:
    """Plan a recording: its motion, its duration, and its expected heading error.

    Parameters
    ----------
    body : str or Body
        One of `flinders.simulate.bodies.BODIES`: ``hand``, ``drone``, ``boat``, ``robot``, ``wrist``.
    noise : float or str
        Noise of a reading, 1 σ of each axis: in µT as a number, or with its unit as ``"0.5uT"`` or ``"4 mG"``.
    site : Site, optional
        Field at the place, as for `flinders.fit`. By default 50 µT and a dip of 60°, and the fit knows neither.
    target_deg : float
        Largest acceptable heading error in degrees.
    rate_hz : float
        Readings per second.
    seconds : float, optional
        Duration of the recording; by default that of the selected motion.
    tilt_deg : float, optional
        Largest tilt of the body in degrees; by default the usual one of the body.
    aiding : str or sequence of str
        Aiding sensors that the fit will use: ``dip`` for an accelerometer, ``rate`` for a gyro.
    alternatives : bool
        Whether twice the time, more tilt and further sensors are tried too.

    Raises
    ------
    UsageError
        For an unknown body, a number out of range, noise without a unit, or a duration in which the body cannot turn
        once around. `UnitError` for an unknown unit.
    FitError
        If no motion of the body gives a fit, because the noise is too large.
    """
    body = body if not isinstance(body, str) else body_of(body)
    aids = aids_of(aiding)
    tilt = body.tilt_deg if tilt_deg is None else _within(tilt_deg, "tilt", UPSIDE_DOWN_DEG)
    made = RecordingSettings(
        seconds=0.0 if seconds is None else _above_zero(seconds, "duration", " s"),
        noise=noise_of(noise),
        sway_deg=body.sway_deg,
        rate_hz=_above_zero(rate_hz, "rate", " Hz"),
        site=site,
        target_deg=_above_zero(target_deg, "target", "°"),
        aiding=aids,
    )
    best = _choose(body, tilt, seconds, made)
    if best is None:
        raise FitError(
            f"no motion of a {body.name} gives a fit with a noise of {made.noise:g} µT: use a sensor with less noise, "
            "a higher rate or more time"
        )
    chosen = replace(made, seconds=best.candidate.seconds)
    others = tuple(_alternatives(body, tilt, seconds, chosen, best)) if alternatives else ()
    return Plan(body, chosen, tilt, best.candidate.sequence, best.expected, others)


def body_of(name: str) -> Body:
    """Body with a name; `UsageError` for an unknown name."""
    found = BODIES.get(name.strip().casefold())
    if found is None:
        raise UsageError(f"body {name!r} is not known{did_you_mean(name, BODIES)}: use one of {', '.join(BODIES)}")
    return found


def aids_of(aiding: str | Sequence[str]) -> tuple[str, ...]:
    """Aiding sensors of a plan, by name; `UsageError` for an unknown name."""
    names = [aiding] if isinstance(aiding, str) else list(aiding)
    words = [word.strip() for name in names for word in name.split(",") if word.strip()]
    known = get_args(PlannedAid)
    for word in words:
        if word not in known:
            raise UsageError(f"aiding sensor {word!r} cannot be planned: use one of {', '.join(known)}")
    return tuple(dict.fromkeys(words))


def noise_of(noise: float | str) -> float:
    """Noise of a reading in µT, from a number in µT or from a text with a unit.

    >>> noise_of(0.5), noise_of("5 mG"), round(noise_of("150nT"), 9)
    (0.5, 0.5, 0.15)
    >>> noise_of("0.5")
    Traceback (most recent call last):
    flinders.errors.UsageError: noise '0.5' has no unit: give it as 0.5uT, or in mG or nT

    Raises
    ------
    UsageError
        For a number that is not above zero, or a text without a unit. `UnitError` for an unknown unit.
    """
    if not isinstance(noise, str):
        return _above_zero(noise, "noise", " µT")
    found = NOISE_TEXT.fullmatch(noise)
    if found is None:
        return noise_of_chip(noise)
    number, unit = found.groups()
    try:
        value = float(number)
    except ValueError:
        raise UsageError(f"noise {noise!r} is no number: give it as 0.5uT") from None
    if not unit:
        raise UsageError(f"noise {noise!r} has no unit: give it as {number}uT, or in mG or nT")
    scale = Unit.of(unit)
    if scale.inside == COUNTS:
        raise UsageError(f"noise {noise!r} is in counts: give it in uT, mG or nT")
    return _above_zero(value * scale.scale, "noise", " µT")


def noise_of_chip(name: str) -> float:
    """Rms noise of a chip's reading in µT, by the name of the chip or of a package that contains it.

    Raises
    ------
    UsageError
        For an unknown chip, and for a chip whose noise no source states.
    """
    try:
        chip = find_chip(name)
    except UsageError:
        raise UsageError(
            f"noise {name!r} is no number with a unit and no chip: give it as 0.5uT, or in mG or nT"
        ) from None
    if chip.noise_ut is None:
        raise UsageError(f"no source states the noise of the {chip}: give it as 0.5uT, or in mG or nT")
    return chip.noise_ut


def _above_zero(value: float, what: str, unit: str) -> float:
    """A finite number above zero; `UsageError` for other numbers."""
    if not 0.0 < value < math.inf:
        raise UsageError(f"{what} is {value:g}{unit}: need a number above 0")
    return float(value)


def _within(value: float, what: str, most: float) -> float:
    """An angle from zero to a limit; `UsageError` for other angles."""
    if not 0.0 <= value <= most:
        raise UsageError(f"{what} is {value:g}°: need 0° to {most:g}°")
    return float(value)


def _choose(
    body: Body, tilt_deg: float, seconds: float | None, recording: RecordingSettings, repeats: Sequence[int] = REPEATS
) -> _Choice | None:
    """The motion with the best grade; of several the shortest, or for a given duration the one with the smallest error.

    More circles are tried if one circle in each attitude is not enough.
    """
    best: _Choice | None = None
    for times in repeats:
        for candidate in _candidates(body, tilt_deg, seconds, times):
            expected = expected_fit(candidate.sequence, replace(recording, seconds=candidate.seconds))
            if expected is None:
                continue
            choice = _Choice(candidate, expected)
            if best is None or _is_better(choice, best, tilt_deg, by_error=seconds is not None):
                best = choice
            if seconds is None and expected.rank(tilt_deg) == GOOD_RANK:
                break
        enough = REACHED_RANK if times < MANY_REPEATS else LEVEL_RANK
        if seconds is not None or (best is not None and best.expected.rank(tilt_deg) >= enough):
            break
    return best


def _is_better(one: _Choice, other: _Choice, tilt_deg: float, *, by_error: bool) -> bool:
    """Whether a motion is better than another: by its grade, then by its duration or by its error."""
    ranks = one.expected.rank(tilt_deg), other.expected.rank(tilt_deg)
    if ranks[0] != ranks[1]:
        return ranks[0] > ranks[1]
    if ranks[0] >= LEVEL_RANK and not by_error:
        return one.candidate.seconds < other.candidate.seconds
    one_deg, other_deg = (each.expected.fit.claim.heading_error_deg.worst for each in (one, other))
    return one_deg < other_deg


def _candidates(body: Body, tilt_deg: float, seconds: float | None, times: int) -> Iterator[_Candidate]:
    """Yield motions with `times` circles in each attitude, the shortest first; for a given duration, as many as fit.

    Raises
    ------
    UsageError
        For a duration in which the body cannot turn once around.
    """
    sequences = body.sequences(tilt_deg)
    if seconds is None:
        repeated = (tuple(turn for turn in sequence for _ in range(times)) for sequence in sequences)
        timed = (_Candidate(each, body.seconds(each)) for each in repeated)
        yield from (each for each in timed if each.seconds <= MAX_SECONDS or len(each.sequence) == 1)
        return
    least = body.seconds(sequences[0]) / MAX_SPEED_RATIO
    if seconds < least:
        raise UsageError(f"{seconds:g} s are too short: a {body.name} turns once around in {least:.0f} s or more")
    for sequence in sequences:
        if seconds >= body.seconds(sequence) / MAX_SPEED_RATIO:
            yield _Candidate(_circles(body, sequence, seconds), seconds)


def _circles(body: Body, sequence: tuple[PoseTurn, ...], seconds: float) -> tuple[PoseTurn, ...]:
    """The sequence with several circles in each attitude: the largest number that a duration allows."""
    times = max([1, *(each for each in REPEATS if body.seconds(sequence) * each <= seconds)])
    return tuple(turn for turn in sequence for _ in range(times))


def _alternatives(
    body: Body, tilt_deg: float, seconds: float | None, recording: RecordingSettings, best: _Choice
) -> Iterator[Alternative]:
    """Yield recordings with twice the time, with more tilt, and with each further sensor."""
    sequence, twice = best.candidate.sequence, replace(recording, seconds=2.0 * recording.seconds)
    doubled = tuple(turn for turn in sequence for _ in range(2))
    yield Alternative("time", tilt_deg, twice.seconds, expected_fit(doubled, twice))
    for more in MORE_TILT_DEG:
        steeper = tilt_deg + more
        if steeper > QUARTER_DEG:
            break
        other = _choose(body, steeper, seconds, recording, REPEATS[:1])
        if other is not None and other.candidate.sequence != sequence and not other.expected.is_upside_down:
            yield Alternative("tilt", steeper, other.candidate.seconds, other.expected)
    for aid in get_args(PlannedAid):
        if aid not in recording.aiding:
            aided = expected_fit(sequence, replace(recording, aiding=(*recording.aiding, aid)))
            is_left_out = aided is not None and aid in aided.unused_aids
            yield Alternative(aid, tilt_deg, recording.seconds, best.expected if is_left_out else aided)
