"""Several magnetometers of one body, calibrated together and held against each other.

Each gets a calibration whose corrected readings are in the axes of one of them, the reference; each offset and shape
rests on all of them; and it is told which of them departs from the others, when, and by how many degrees of heading.

>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1, motion="hand", n=1500)
>>> rng = np.random.default_rng(1)
>>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
>>> second = simulate.Sensor.random(rng, noise=2.0).read(tumble.field_strength * tumble.directions @ quarter, rng)
>>> inside = replace(tumble.samples, field=second)
>>> found = fit_multi({"outside": tumble.samples, "inside": inside})
>>> inside = found["inside"]
>>> inside.fit.verdict, inside.axes, inside.fit.heading_error_deg.worst < inside.alone.heading_error_deg.worst
('good', '-y,x,z', True)
>>> found.agreement.departures
()
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from flinders.comparison.agreement import Departure, departures, heading_deg, length_scatter, scatter
from flinders.core.axes import EXCHANGES
from flinders.core.samples import Samples
from flinders.core.time_alignment import Paired, paired
from flinders.deprecation import renamed_keywords
from flinders.errors import FitError, FlindersError, InputError, UsageError, figures
from flinders.estimators import Readings, within_range
from flinders.estimators.auto import Auto
from flinders.estimators.data import concatenated, dense_in, left_out
from flinders.estimators.multi_sensor import FEWEST, Several, is_sound, mirror_or_rotation, solve
from flinders.findings import CATALOGUE, Finding, Record, by_severity
from flinders.fitting.aiding import Aiding
from flinders.fitting.calibrate import fit, judged_as
from flinders.fitting.result import Fit, Refused
from flinders.likelihood.magnitude import distances
from flinders.likelihood.prior import SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators import Estimate
    from flinders.estimators.outliers import Outlier
    from flinders.likelihood.site_field import Site

COPY: Final = 0.1
"""Of their noise: what readings of two sensors differ by at most, turned and scaled, where they are one sensor's."""

NOISIER: Final = 3.0
"""Times as far off as the best of the others: something is wrong with a sensor all the time."""

WORSE: Final = 1.5
"""Times the heading error of a sensor by itself: where it is more with the others, they do not belong together."""


MOST_STRAYS: Final = 0.5
"""Of a sensor's readings that it may leave out by itself, and of those that may yet belong to the others."""

DECADE: Final = 0.25
"""Of a power of ten: how far from it the sizes of two sensors' readings may be where their units differ by it."""

ROUNDS: Final = 3
"""Of fits, each without the stretches in which a sensor departed from the one before."""


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One of the magnetometers.

    Attributes
    ----------
    name : str
    fit : Fit or error
        With the others; `Refused` carries the fit where there is one that cannot be trusted.
    alone : Fit or error
        What it finds by itself.
    rotation : (3, 3) float, optional
        From its axes into those of the reference; its determinant is −1 where they are mirror images. None where it
        was not found.
    rotation_sigma_deg : (3,) float, optional
        Standard deviation of that about the axes of the reference.
    axes : str
        The nearest way to exchange axes: where each axis of the reference comes from.
    off_axes_deg : float
        How far the rotation is from that.
    size : float
        Length of its readings over that of the reference's.
    scatter_deg : float
        What its readings, averaged over a second, are usually off, in degrees of a level heading.
    delay_s, delay_sigma_s : float
        By how much its clock is behind that of the reference, where that is proven.
    copy_of : str
        The sensor whose readings it repeats; nothing where it has its own.
    is_kept : bool
        `fit` is `alone`, since with the others it was known clearly worse: corrected readings are in its own axes.
    joint_deg : float
        Worst heading error with the others, of one that was kept.
    findings : tuple of Finding
        What the others tell of it; those of `fit`, too, where that is a fit.
    """

    name: str
    fit: Fit | FlindersError
    alone: Fit | FlindersError
    rotation: Floats | None = None
    rotation_sigma_deg: Floats | None = None
    axes: str = "x,y,z"
    off_axes_deg: float = 0.0
    size: float = 1.0
    scatter_deg: float = 0.0
    delay_s: float = 0.0
    delay_sigma_s: float = 0.0
    copy_of: str = ""
    is_kept: bool = False
    joint_deg: float = 0.0
    findings: tuple[Finding, ...] = ()

    @property
    def is_mirrored(self) -> bool:
        """Its axes are a mirror image of those of the reference."""
        return self.rotation is not None and bool(np.linalg.det(self.rotation) < 0.0)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        arrays = {"rotation": self.rotation, "rotation_sigma_deg": self.rotation_sigma_deg}
        plain = ("axes", "off_axes_deg", "size", "scatter_deg", "delay_s", "copy_of")
        return {
            **{name: None if value is None else value.tolist() for name, value in arrays.items()},
            **{name: getattr(self, name) for name in plain},
            "alone_heading_error_deg": _worst(self.alone),
            "findings": [finding.as_dict() for finding in self.findings],
        }


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well the magnetometers agree.

    Attributes
    ----------
    moments : int
        At which two or more were read.
    seconds : float
        From the first of those to the last.
    departures : tuple of Departure
        Stretches in which they do not, in the order of time.
    apart_deg : float
        Of two: how far apart they are all the time, in degrees of heading, 1 σ, where nothing tells which is off; else
        0.
    """

    moments: int
    seconds: float
    departures: tuple[Departure, ...] = ()
    apart_deg: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Several magnetometers of one body.

    Attributes
    ----------
    members : tuple of Member
    reference : str
        Whose axes corrected readings of all are in.
    agreement : Agreement
    is_joint : bool
        The fits rest on all of them, but for those that are kept. Where the body was turned too little for that, none
        but one is left, or two disagree all the time, each has what it finds by itself.
    in_body : bool
        Corrected readings of all are in the axes of gyro and accelerometer, and not in those of the reference.
    """

    members: tuple[Member, ...]
    reference: str
    agreement: Agreement
    is_joint: bool
    in_body: bool = False

    def __getitem__(self, name: str) -> Member:
        """One of them, by its name."""
        return next(member for member in self.members if member.name == name)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what there is beside the fit of each."""
        names = [member.name for member in self.members]
        runs = [
            {**run.as_dict(), "sensor": None if run.sensor is None else names[run.sensor]}
            for run in self.agreement.departures
        ]
        return {
            "reference": self.reference,
            "is_joint": self.is_joint,
            "in_body": self.in_body,
            "moments": self.agreement.moments,
            "seconds": self.agreement.seconds,
            "departures": runs,
        }


@renamed_keywords(aids="aiding")
def fit_multi(
    sources: Mapping[str, Recording],
    *,
    reference: str | None = None,
    target_deg: float = 1.0,
    dip_deg: float = 60.0,
    field_strength: float | None = None,
    prior: float = SPREAD,
    aiding: str | Sequence[str] = (),
    site: Site | None = None,
) -> Together:
    """Calibrate several magnetometers of one body, and say whether they agree.

    Minimises the sum of `flinders.estimators.multi_sensor`. Use it wherever a body carries more than one magnetometer
    and was turned with all of them running. It makes a noisy one nearly as good as the best; it does not make up for
    attitudes that the body never took.

    Parameters
    ----------
    sources : mapping of str to Recording
        Two or more, by their names, all from one clock that may differ by up to two seconds; recordings without time
        have to be as long as each other, and are taken row by row.
    reference : str, optional
        Into whose axes the others are turned; by default the first.
    target_deg, dip_deg : float
        As for `flinders.fit`.
    field_strength : float, optional
        Strength of the field at the site; for sensors in one unit.
    prior : float
        Soft iron thought likely where nothing was seen.
    aiding : str or sequence of str
        As for `flinders.fit`: what was recorded beside the reference and tells how it sits in the body. Where that is
        seen, corrected readings of all are in the axes of the body, those of gyro and accelerometer.
    site : Site, optional
        What is known of the field at the place, with `aiding`.

    Raises
    ------
    UsageError
        For fewer than two, a reference that is none of them, or some with and some without time.
    InputError
        Where hardly any moment is common to two of them.

    Examples
    --------
    See the head of this module.
    """
    chosen = _checked(sources, reference, field_strength)
    options: dict[str, Any] = {"target_deg": target_deg, "dip_deg": dip_deg, "field_strength": field_strength}
    samples: dict[str, Samples] = {}
    silent: dict[str, FlindersError] = {}
    for name, source in sources.items():
        try:
            samples[name] = _in_memory(source)
        except (FitError, InputError) as error:
            silent[name] = error
    if chosen in silent or len(samples) < 2:
        raise silent[chosen] if chosen in silent else next(iter(silent.values()))
    body = _in_body(sources[chosen], aiding, site, prior, options) if aiding else None
    found = _fitted({name: sources[name] for name in samples}, samples, chosen, prior, options, body)
    order = {member.name: member for member in found.members}
    members = [order.get(name) or Member(name, silent[name], silent[name]) for name in sources]
    placed = {place: list(sources).index(member.name) for place, member in enumerate(found.members)}
    runs = tuple(
        replace(run, sensor=None if run.sensor is None else placed[run.sensor]) for run in found.agreement.departures
    )
    return replace(found, members=tuple(members), agreement=replace(found.agreement, departures=runs))


def _fitted(
    sources: Mapping[str, Recording],
    samples: Mapping[str, Samples],
    reference: str,
    prior: float,
    options: dict[str, Any],
    body: Aiding | None,
) -> Together:
    """Fit those that have readings, together where that can be."""
    names, held = list(sources), list(samples.values())
    chosen = names.index(reference)
    starts = [_estimated(each.field) for each in held]
    alone = [_alone(source, name, prior, options) for name, source in sources.items()]
    common = _paired(held, chosen)
    copies = _copies(common.fields, starts, chosen)
    own = [place for place in range(len(names)) if place not in copies]
    several, runs = _agreed(common, own, chosen, starts, prior, options)
    apart_deg = 0.0 if several is None else _torn(several, common, own, starts, options)
    if apart_deg:
        several, runs = None, ()
    members = []
    for place, name in enumerate(names):
        member = Member(
            name, alone[place], alone[place],
            delay_s=float(common.delays_s[place]),
            delay_sigma_s=float(common.delay_sigmas_s[place]),
        )  # fmt: skip
        if place in copies:
            member = replace(_copied(member, common.fields, starts, place, chosen), copy_of=names[copies[place]])
        elif several is not None:
            index = own.index(place)
            outliers = _left_out(member, common.fields[place], starts[place], several.belongs[index])
            member = _joined(member, several, index, sources[name], options, body, outliers)
        members.append(member)
    if several is not None:
        off = scatter(_seen(several, common.fields[own]), several.directions, common.time)
        for index, place in enumerate(own):
            off_deg = heading_deg(float(off[index]), options["dip_deg"])
            members[place] = replace(members[place], scatter_deg=off_deg)
        members = [_better(member) for member in members]
    is_joint = several is not None and not all(members[place].is_kept for place in own)
    agreement = Agreement(len(common.time), float(np.ptp(common.time)), runs, apart_deg)
    found = Together(tuple(members), names[chosen], agreement, is_joint, is_joint and body is not None)
    return replace(found, members=tuple(_told(found, place, options["target_deg"]) for place in range(len(names))))


def _in_body(
    source: Recording, aiding: str | Sequence[str], site: Site | None, prior: float, options: dict[str, Any]
) -> Aiding | None:
    """How the reference sits in the body, by what was recorded beside it; None where nothing saw that.

    Raises
    ------
    UsageError
        For an aid that is not known, or was not recorded.
    """
    try:
        found = fit(source, aiding=aiding, site=site, prior=prior, **options)
    except Refused as refusal:
        found = refusal.fit
    except FitError:
        return None
    aiding_result = found.aiding
    return (
        None
        if aiding_result is None or aiding_result.rotation is None or aiding_result.rotation_covariance is None
        else aiding_result
    )


def _turned(rotation: Floats, covariance: Floats, body: Aiding | None) -> Aiding:
    """A rotation into the reference, taken on into the body where that is known."""
    if body is None or body.rotation is None or body.rotation_covariance is None:
        return Aiding((), rotation, covariance)
    turned = body.rotation @ covariance @ body.rotation.T + body.rotation_covariance
    return Aiding((), body.rotation @ rotation, turned)


def _joined(
    member: Member,
    several: Several,
    index: int,
    source: Recording,
    options: dict[str, Any],
    body: Aiding | None,
    outliers: tuple[Outlier, ...],
) -> Member:
    """A member with what the joint fit finds of it; outliers are what it left out by itself and with the others."""
    rotation, covariance = several.rotation(index)
    aiding_result = None if index == several.reference and body is None else _turned(rotation, covariance, body)
    made: Fit | FitError
    try:
        made = judged_as(
            replace(several.estimate(index), outliers=outliers),
            source,
            aiding_result=aiding_result,
            sensor=member.name,
            **options,
        )
    except FitError as refusal:
        made = refusal
    radii = [float(np.cbrt(np.linalg.det(at.shape))) for at in several.parameters]
    axes, off = nearest_axes(rotation)
    sigma = np.rad2deg(np.sqrt(np.diag(covariance)))
    return replace(
        member, fit=made, rotation=rotation, rotation_sigma_deg=sigma, axes=axes, off_axes_deg=off,
        size=radii[index] / radii[several.reference],
    )  # fmt: skip


def _better(member: Member) -> Member:
    """A member, as it is by itself where that is clearly better known than it is with the others."""
    joint, alone = (each.fit if isinstance(each, Refused) else each for each in (member.fit, member.alone))
    if member.copy_of or not isinstance(joint, Fit) or not isinstance(alone, Fit) or alone.plane or alone.unobserved:
        return member
    worst = joint.heading_error_deg.worst
    if worst <= WORSE * alone.heading_error_deg.worst:
        return member
    return replace(
        member, fit=member.alone, rotation=None, rotation_sigma_deg=None, axes="x,y,z", off_axes_deg=0.0,
        is_kept=True, joint_deg=worst,
    )  # fmt: skip


def _torn(
    several: Several, common: Paired, own: Sequence[int], starts: Sequence[Estimate | None], options: dict[str, Any]
) -> float:
    """How far two are apart all the time, in degrees of heading, where nothing tells which is off; else 0.

    Noise, or a field that moves with one sensor, changes lengths as it changes directions. Where directions are apart
    by far more than lengths, or where the joint fit lays it to the sensor whose length is the steadier, the fit would
    lay to one of two what may be the other's.
    """
    alone = [starts[place] for place in own]
    sound = [start for start in alone if start is not None and is_sound(start)]
    if len(own) != 2 or len(sound) != 2:
        return 0.0
    fields, dip_deg = common.fields[own], options["dip_deg"]
    seen = _seen(several, fields)
    between_deg = heading_deg(float(scatter(seen[:1], seen[1], common.time)[0]), dip_deg)
    by_itself = [
        (field - start.ellipsoid.centre) @ np.linalg.inv(start.ellipsoid.shape)
        for field, start in zip(fields, sound, strict=True)
    ]
    lengths = length_scatter(np.stack(by_itself), common.time)
    told_deg = heading_deg(float(np.hypot(*lengths)), dip_deg)
    off = scatter(seen, several.directions, common.time)
    is_lopsided = bool(off.max() > NOISIER * off.min() and np.argmax(off) != np.argmax(lengths))
    is_torn = between_deg > options["target_deg"] and (between_deg > NOISIER * told_deg or is_lopsided)
    return between_deg if is_torn else 0.0


def _copied(member: Member, fields: Floats, starts: Sequence[Estimate | None], place: int, reference: int) -> Member:
    """A copy, with the rotation that leads from it to the reference where both are known by themselves."""
    seen, into = (_directions(fields[which], starts[which]) for which in (place, reference))
    if seen is None or into is None:
        return member
    both = np.isfinite(seen).all(axis=1) & np.isfinite(into).all(axis=1)
    rotation = mirror_or_rotation(seen[both], into[both])
    axes, off = nearest_axes(rotation)
    return replace(member, rotation=rotation, axes=axes, off_axes_deg=off)


def _checked(sources: Mapping[str, Recording], reference: str | None, field_strength: float | None) -> str:
    """Name of the reference among sensors that can be taken together.

    Raises
    ------
    UsageError
        Where they cannot.
    """
    names = list(sources)
    if len(names) < 2:
        raise UsageError(f"{len(names)} magnetometer: need two or more of one body; use flinders.fit for one")
    if reference is not None and reference not in names:
        raise UsageError(f"reference {reference!r} is none of {', '.join(names)}: name one of them")
    units = {source.unit.inside for source in sources.values()}
    if field_strength is not None and len(units) > 1:
        raise UsageError(f"one field strength for readings in {' and '.join(sorted(units))}: leave it out")
    return names[0] if reference is None else reference


def _in_memory(source: Recording) -> Samples:
    """All readings that are at no rail, in the order of time.

    Raises
    ------
    FitError
        Where they are too few, or do not move.
    """
    readings = within_range(Readings.of(source))
    readings.require(FEWEST, "together")
    recording = cast("Recording", readings.recording)
    samples = recording if isinstance(recording, Samples) else concatenated(list(recording.blocks()), recording)
    if samples.time is None:
        return samples
    known = np.flatnonzero(np.isfinite(samples.time))
    order = known[np.argsort(samples.time[known], kind="stable")]
    return samples[order.tolist()] if len(order) < len(samples) or np.any(np.diff(order) < 0) else samples


def _estimated(field: Floats) -> Estimate | None:
    """What a sensor finds by itself, where that is an ellipsoid, of those readings that are there."""
    try:
        return Auto().estimate(Readings.of(field[np.isfinite(field).all(axis=1)]))
    except FitError:
        return None


def _alone(source: Recording, name: str, prior: float, options: dict[str, Any]) -> Fit | FitError:
    """The judged fit of one sensor by itself."""
    try:
        return fit(source, sensor=name, prior=prior, **options)
    except FitError as refusal:
        return refusal


def _paired(samples: Sequence[Samples], reference: int) -> Paired:
    """Readings of all at common moments.

    Raises
    ------
    UsageError
        Where some have time and some have not, or none has and they differ in length.
    InputError
        Where hardly any moment is common to two of them.
    """
    times = [each.time for each in samples if each.time is not None]
    fields = [each.field for each in samples]
    if len(times) == len(samples):
        found = paired(times, fields, reference=reference)
        if len(found.time) < FEWEST:
            spans = "; ".join(f"{each.source}: {time[0]:.1f} to {time[-1]:.1f} s" for each, time in
                              zip(samples, times, strict=True) if len(time))  # fmt: skip
            raise InputError(
                f"{len(found.time)} moments are common to two magnetometers, {FEWEST} are needed ({spans}): "
                "record them at the same time, by one clock"
            )
        return found
    lengths = {len(field) for field in fields}
    if times or len(lengths) > 1:
        told = "some have time and some have none" if times else f"without time they are {sorted(lengths)} long"
        raise UsageError(f"readings of several magnetometers belong together by their time: {told}; record time")
    zero = np.zeros(len(fields))
    return Paired(np.arange(lengths.pop(), dtype=float), np.stack(fields), zero, zero)


def _copies(fields: Floats, starts: Sequence[Estimate | None], reference: int) -> dict[int, int]:
    """Which sensors repeat the readings of another, turned and scaled, and of which; never the reference of another."""
    order = [reference, *(place for place in range(len(fields)) if place != reference)]
    found: dict[int, int] = {}
    for rank, place in enumerate(order):
        for other in order[:rank]:
            if other not in found and place not in found and _is_copy(fields[other], fields[place], starts[place]):
                found[place] = other
    return found


def _is_copy(first: Floats, second: Floats, start: Estimate | None) -> bool:
    """Whether an affine map of one gives the other far better than the other's own noise lets it."""
    both = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    if np.count_nonzero(both) < FEWEST:
        return False
    design = np.column_stack([first[both], np.ones(int(both.sum()))])
    left = second[both] - design @ np.linalg.lstsq(design, second[both], rcond=None)[0]
    width = float(np.sqrt(np.mean(np.var(second[both], axis=0))))
    noise = 1e-6 * width if start is None else max(start.noise, 1e-6 * width)
    return float(np.sqrt(np.mean(left**2))) < COPY * noise


def _agreed(
    common: Paired,
    own: Sequence[int],
    reference: int,
    starts: Sequence[Estimate | None],
    prior: float,
    options: dict[str, Any],
) -> tuple[Several | None, tuple[Departure, ...]]:
    """Fit jointly, and again without the stretches in which a sensor departs; and those stretches, by their place.

    What most sensors by themselves show to be outliers does not count from the start, so that two of three which are
    disturbed alike have no majority. No fit where there is but one sensor, or where the readings leave it open: what no
    sensor sees by itself, they do not see together.
    """
    if len(own) < 2 or not any(start is not None and is_sound(start) for start in starts):
        return None, ()
    fields: Floats = common.fields[own]
    runs: tuple[Departure, ...] = ()
    several: Several | None = None
    begins = [starts[place] for place in own]
    outliers = _own_outliers(fields, begins)
    alike = outliers & (2 * outliers.sum(axis=0) > np.isfinite(fields[..., 0]).sum(axis=0))
    for _ in range(ROUNDS):
        left = np.where(alike[..., np.newaxis], np.nan, fields)
        for run in runs:
            if run.sensor is not None:
                left[run.sensor, run.first : run.last + 1] = np.nan
        for sensor in {run.sensor for run in runs if run.sensor is not None}:
            begins[sensor] = _estimated(left[sensor])
        try:
            found = solve(left, reference=own.index(reference), starts=begins, spread=prior)
        except FitError:
            return None, ()
        if found.unobserved:
            return None, ()
        several, before = found, runs
        limits = {"limit_deg": options["target_deg"], "dip_deg": options["dip_deg"]}
        runs = departures(_seen(several, fields), common.time, **limits)
        if _stretches(runs) == _stretches(before):
            break
    placed = [replace(run, sensor=None if run.sensor is None else own[run.sensor]) for run in runs]
    return several, tuple(sorted(placed, key=lambda run: run.start_s))


def _own_outliers(fields: Floats, starts: Sequence[Estimate | None]) -> NDArray[np.bool_]:
    """(m, N) readings that a sensor by itself leaves out; none where it would leave out most.

    >>> rng = np.random.default_rng(1)
    >>> q = rng.normal(size=(400, 3))
    >>> field = 50.0 * q / np.linalg.norm(q, axis=1, keepdims=True) + rng.normal(scale=0.5, size=q.shape)
    >>> field[100:150] *= 1.4
    >>> outliers = _own_outliers(field[np.newaxis], [_estimated(field)])[0]
    >>> float(outliers[100:150].mean()), bool(outliers[:80].mean() < 0.1), bool(outliers[170:].mean() < 0.1)
    (1.0, True, True)
    """
    outliers = np.zeros(fields.shape[:2], dtype=bool)
    for sensor, (field, start) in enumerate(zip(fields, starts, strict=True)):
        if start is None or math.isinf(start.rejected_beyond):
            continue
        there = np.flatnonzero(np.isfinite(field).all(axis=1))
        some, limit = field[there], start.rejected_beyond
        far = np.abs(distances(some, start.ellipsoid)) > limit
        parts = left_out([Samples(some)], start.ellipsoid, limit, dense_in(far, len(some)))
        out = np.concatenate([part for _, _, part in parts])
        if np.count_nonzero(out) <= MOST_STRAYS * len(there):
            outliers[sensor, there[out]] = True
    return outliers


def _left_out(member: Member, field: Floats, start: Estimate | None, belongs: NDArray[np.bool_]) -> tuple[Outlier, ...]:
    """What a sensor left out by itself, where the joint fit left out most of that, too."""
    alone = member.alone.fit if isinstance(member.alone, Refused) else member.alone
    outliers = _own_outliers(field[np.newaxis], [start])[0]
    if not isinstance(alone, Fit) or not outliers.any() or np.mean(belongs[outliers]) > MOST_STRAYS:
        return ()
    return alone.outliers


def _stretches(runs: Sequence[Departure]) -> set[tuple[int | None, int, int]]:
    return {(run.sensor, run.first, run.last) for run in runs if run.sensor is not None}


def _seen(several: Several, fields: Floats) -> Floats:
    """(m, N, 3) corrected readings of all, in the axes of the reference."""
    return np.stack([several.corrected(index, field) for index, field in enumerate(fields)])


def _directions(field: Floats, start: Estimate | None) -> Floats | None:
    """(N, 3) unit directions by what a sensor finds by itself."""
    if start is None:
        return None
    seen = (field - start.ellipsoid.centre) @ np.linalg.inv(start.ellipsoid.shape)
    unit: Floats = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    return unit


def nearest_axes(rotation: Floats) -> tuple[str, float]:
    """Which exchange of axes a (3, 3) rotation is nearest to, and by how many degrees it is off that.

    >>> nearest_axes(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    ('-y,x,z', 0.0)
    """
    matrices = [axes.apply(np.eye(3)).T for axes in EXCHANGES]
    best = int(np.argmax([float(np.sum(matrix * rotation)) for matrix in matrices]))
    cosine = 0.5 * (float(np.sum(matrices[best] * rotation)) - 1.0)
    return str(EXCHANGES[best]), float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _told(found: Together, place: int, target_deg: float) -> Member:
    """Add to a member, and to its fit, what the others tell of it."""
    member = found.members[place]
    findings = by_severity(_findings(found, place, target_deg))
    made = member.fit.fit if isinstance(member.fit, Refused) else member.fit
    if isinstance(made, Fit):
        made = replace(made, findings=by_severity((*made.findings, *findings)))
        made = Refused(made) if made.verdict == "refused" else made
    return replace(member, fit=made, findings=findings)


def _findings(found: Together, place: int, target_deg: float) -> Iterator[Finding]:
    """What there is to know of a member beside its own fit."""
    member, reference = found.members[place], found.reference
    if member.copy_of:
        yield _certain("copied-sensor", {"is_copy": 1.0}, other=member.copy_of)
        return
    if found.agreement.apart_deg:
        yield _apart_throughout(found.agreement.apart_deg, target_deg)
        return
    if member.is_kept:
        yield _better_alone(member)
    elif not found.is_joint:
        why = (
            "the readings leave open how the magnetometers are turned against each other, and each has what it finds "
            "by itself: turn the body about all its axes"
        )
        yield _certain("not-together", {"is_alone": 1.0, "together_deg": 0.0, "alone_deg": 0.0}, why=why)
        return
    yield from _of_axes(found, member)
    yield from _of_clock(member, reference)
    others = [other.scatter_deg for other in found.members if other is not member and not other.copy_of]
    numbers = {"scatter_deg": member.scatter_deg, "best_other_deg": min(others, default=math.inf)}
    departs = CATALOGUE["sensor-deviates-throughout"].finding(Record({**numbers, "target_deg": target_deg}))
    yield from () if departs is None else (departs,)
    yield from _of_departures(found, place, target_deg)


def _certain(code: str, numbers: dict[str, float], **words: str) -> Finding:
    """What the catalogue says where code has decided."""
    return CATALOGUE[code].certain(Record(numbers, **words))


def _apart_throughout(apart_deg: float, target_deg: float) -> Finding:
    """Two that disagree all the time."""
    disagreement = f"even averaged over a second the two are {figures(apart_deg)}° of heading apart all the time (1 σ)"
    alone = ". Each has what it finds by itself: see whether one is loose or its clock off, or fit a third"
    numbers = {"apart_deg": apart_deg, "target_deg": target_deg}
    return _certain("disagree", numbers, disagreement=disagreement, alone=alone)


def _better_alone(member: Member) -> Finding:
    """One that would be known worse with the others."""
    alone = member.alone.fit if isinstance(member.alone, Refused) else cast("Fit", member.alone)
    worst = alone.heading_error_deg.worst
    why = (
        f"with the others its worst heading error would be {figures(member.joint_deg)}°, and by itself it is "
        f"{figures(worst)}°: it has what it finds by itself, in its own axes. Look at what is wrong with the others, "
        "and at their clocks"
    )
    return _certain("not-together", {"is_alone": 1.0, "together_deg": member.joint_deg, "alone_deg": worst}, why=why)


def _handed(found: Together) -> str:
    """Which sensors are most likely not right-handed: those that are fewer."""
    turned = [member for member in found.members if member.rotation is not None and not member.copy_of]
    mirrored = sum(member.is_mirrored for member in turned)
    rest = len(turned) - mirrored
    if mirrored == rest:
        return "One of the two is not right-handed: check which, and map its axes with --axes"
    fewer = [member.name for member in turned if member.is_mirrored == (mirrored < rest)]
    return f"Most likely {' and '.join(fewer)} is not right-handed, as the others agree: map its axes with --axes"


def _of_axes(found: Together, member: Member) -> Iterator[Finding]:
    """How it is turned, and in what it is written."""
    reference = found.reference
    if member.rotation is None or member.rotation_sigma_deg is None or member.name == reference:
        return
    words = {"reference": reference, "axes": str(member.axes)}
    if member.is_mirrored:
        yield _certain("mirrored-sensor", {"handedness": -1.0}, **words, who=_handed(found))
    worst = float(member.rotation_sigma_deg.max())
    where = "" if found.in_body else "; how those sit in the vehicle is unseen"
    turned = {"is_turned": 1.0, "rotation_sigma_deg": worst, "off_axes_deg": member.off_axes_deg}
    yield _certain("turned-to", turned, **words, where=where)
    decades = round(math.log10(member.size))
    if decades and abs(math.log10(member.size) - decades) < DECADE * 0.5:
        numbers = {"is_decades_off": 1.0, "times_as_long": member.size, "decade": 10.0**decades}
        yield _certain("unlike-units", numbers, reference=reference)


def _of_clock(member: Member, reference: str) -> Iterator[Finding]:
    """Whether its clock is another."""
    if member.delay_s:
        numbers = {
            "is_delayed": 1.0,
            "delay_s": member.delay_s,
            "delay_ms": 1e3 * abs(member.delay_s),
            "delay_sigma_ms": 1e3 * member.delay_sigma_s,
        }
        yield _certain(
            "clock-differs", numbers, reference=reference, behind="behind" if member.delay_s > 0 else "ahead of"
        )


def _of_departures(found: Together, place: int, target_deg: float) -> Iterator[Finding]:
    """When it departs from the others, or one of two does of which it may be the one."""
    runs = [run for run in found.agreement.departures if run.sensor == place]
    if runs:
        numbers = {
            "departs_share": _share(runs, found),
            "departs_deg": max(run.heading_deg for run in runs),
            "target_deg": target_deg,
        }
        yield _certain(
            "sensor-deviates",
            numbers,
            when=_when(runs),
            why="the length of its readings changes" if all(run.by_length for run in runs) else "the others agree",
            rests="" if found.members[place].is_kept else ". The calibration does not rest on that",
        )
    unsettled = [run for run in found.agreement.departures if run.sensor is None]
    if unsettled and (len(found.members) == 2 or found.members[place].name == found.reference):
        worst, share = max(run.heading_deg for run in unsettled), _share(unsettled, found)
        disagreement = (
            f"magnetometers disagree by up to {figures(worst)}° of heading, for {share:.0%} of the time "
            f"({_when(unsettled)})"
        )
        numbers = {"apart_deg": worst, "target_deg": target_deg}
        yield _certain("disagree", numbers, disagreement=disagreement, alone="")


def _share(runs: Sequence[Departure], found: Together) -> float:
    """Of all moments, those of some stretches."""
    return sum(run.last - run.first + 1 for run in runs) / max(found.agreement.moments, 1)


def _when(runs: Sequence[Departure]) -> str:
    """The gravest few stretches, in the order of time.

    >>> _when([Departure(0, False, 0, 9, 1.0, 2.0, 3.0, 6.0, 0.0)])
    '1.0–2.0 s'
    """
    chosen = sorted(runs, key=lambda run: -run.heading_deg)[:3]
    told = "; ".join(str(run) for run in sorted(chosen, key=lambda run: run.start_s))
    return told + ("; …" if len(runs) > len(chosen) else "")


def _worst(outcome: Fit | FlindersError) -> float | None:
    """Worst heading error of what is not refused."""
    return outcome.heading_error_deg.worst if isinstance(outcome, Fit) else None
