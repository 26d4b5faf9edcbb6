"""Joint calibration and comparison of several magnetometers of one body.

Each magnetometer gets a calibration into the axes of one of them, the reference. The readings of all determine the
offset and shape of each. The result states which magnetometer deviates from the others, when, and by how many degrees
of heading.

>>> from flinders import simulate
>>> tumble = simulate.tumble(seed=1, motion="hand", n=1500)
>>> rng = np.random.default_rng(1)
>>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
>>> second = simulate.Sensor.random(rng, noise=2.0).read(tumble.field_strength * tumble.directions @ quarter, rng)
>>> inside = replace(tumble.samples, field=second)
>>> together = fit_multi({"outside": tumble.samples, "inside": inside})
>>> inside = together["inside"]
>>> inside.fit.verdict, inside.axes, inside.fit.heading_error_deg.worst < inside.alone.heading_error_deg.worst
('good', '-y,x,z', True)
>>> together.agreement.disagreements
()
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.comparison.agreement import Disagreement, disagreements, heading_deg, length_scatter, usual_scatter
from flinders.comparison.common_moments import find_copies, pair_readings, require_reference, sorted_readings
from flinders.comparison.member_findings import add_member_findings
from flinders.comparison.members import Agreement, Member, MultiFit
from flinders.core.axes import SIGNED_PERMUTATIONS
from flinders.core.keywords import check_keywords
from flinders.errors import FitError, FlindersError, InputError
from flinders.estimators.auto import Auto, fit_alone
from flinders.estimators.multi_sensor import MultiSensorFit, fit_sensors, is_sound, mirror_or_rotation
from flinders.estimators.outliers import extend_to_runs
from flinders.fitting.aiding import Aiding
from flinders.fitting.calibrate import PARAMETERS_ELSEWHERE, fit, judge_estimate
from flinders.fitting.request import judged_dip
from flinders.fitting.result import Fit, Refused, fit_of
from flinders.likelihood.magnitude import distances
from flinders.likelihood.prior import SOFT_IRON_SPREAD

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.core.time_alignment import AlignedReadings
    from flinders.estimators import Estimate
    from flinders.estimators.outliers import Outlier
    from flinders.fitting.aiding import AnyAiding
    from flinders.likelihood.site_field import Site

MAX_MISFIT_RATIO: Final = 3.0
"""Largest ratio of a sensor's misfit to the best misfit of the others; a sensor with more deviates all the time."""

MAX_JOINT_ERROR_RATIO: Final = 1.5
"""Largest ratio of a sensor's heading error by the joint fit to that by its own fit, at which the joint fit is used."""

MAX_OUTLIER_SHARE: Final = 0.5
"""Largest share of outliers in a sensor's readings, and of inliers of the joint fit in outliers of its own fit."""

MAX_ROUNDS: Final = 3
"""Largest count of fits; each fit is without the stretches in which a sensor deviated in the fit before."""


@check_keywords(PARAMETERS_ELSEWHERE)
def fit_multi(
    sources: Mapping[str, Recording],
    *,
    reference: str | None = None,
    target_deg: float = 1.0,
    site: Site | None = None,
    prior: float = SOFT_IRON_SPREAD,
    aiding: AnyAiding = (),
) -> MultiFit:
    """Calibrate several magnetometers of one body together, and compare them.

    Minimises the sum of `flinders.estimators.multi_sensor`. Use it for a body with more than one magnetometer that was
    turned while all were recorded. A noisy magnetometer becomes nearly as accurate as the best one. Attitudes that the
    body was not turned to stay missing for all.

    Parameters
    ----------
    sources : mapping of str to Recording
        Two or more recordings by the names of the sensors, with clocks that differ by up to 2 s. Recordings without
        times must have the same length, and are paired row by row.
    reference : str, optional
        Name of the sensor whose axes corrected readings get; by default the first.
    target_deg : float
        As for `flinders.fit`.
    site : Site, optional
        As for `flinders.fit`; a strength requires that all sensors have one unit. Values with an uncertainty are used
        in the separate fit of each sensor, and with `aiding` for the mounting in the body.
    prior : float
        Standard deviation of the prior on the shape.
    aiding : str, sequence of str or Instruments
        As for `flinders.fit`: sensors recorded with the reference. If they determine its mounting in the body,
        corrected readings of all are in body axes, which are those of gyro and accelerometer.

    Raises
    ------
    UsageError
        For fewer than two sensors, an unknown reference, or some with and some without time.
    InputError
        If two of them have too few common times.

    Examples
    --------
    See the head of this module.
    """
    judged = None if site is None else site.for_judgement
    chosen = require_reference(sources, reference, None if judged is None else judged.fixed_length)
    options: dict[str, Any] = {"target_deg": target_deg, "site": judged}
    samples: dict[str, Samples] = {}
    silent: dict[str, FlindersError] = {}
    for name, source in sources.items():
        try:
            samples[name] = sorted_readings(source)
        except (FitError, InputError) as error:
            silent[name] = error
    if chosen in silent or len(samples) < 2:
        raise silent[chosen] if chosen in silent else next(iter(silent.values()))
    mounting = _body_aiding(sources[chosen], aiding, site, prior, target_deg) if aiding else None
    body = _Body.of({name: sources[name] for name in samples}, samples, chosen, mounting, prior, options, site)
    together = body.calibrate()
    order = {member.name: member for member in together.members}
    members = [order.get(name) or Member(name, silent[name], silent[name]) for name in sources]
    places = {place: list(sources).index(member.name) for place, member in enumerate(together.members)}
    runs = tuple(run.of_sensor(places) for run in together.agreement.disagreements)
    return replace(together, members=tuple(members), agreement=replace(together.agreement, disagreements=runs))


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """The magnetometers of one body that have readings."""

    sources: Mapping[str, Recording]
    reference: int
    mounting: Aiding | None
    starts: Sequence[Estimate | None]
    common: AlignedReadings
    copies: Mapping[int, int]
    prior: float
    options: dict[str, Any]
    site: Site | None  # known field, whose values with an uncertainty are used in the separate fit of each sensor

    @property
    def dip_deg(self) -> float:
        """Dip of the field; the assumed one if none was given."""
        return judged_dip(self.options["site"])[0]

    @classmethod
    def of(
        cls,
        sources: Mapping[str, Recording],
        samples: Mapping[str, Samples],
        reference: str,
        mounting: Aiding | None,
        prior: float,
        options: dict[str, Any],
        site: Site | None,
    ) -> Self:
        """Pair the readings, and estimate each sensor alone."""
        place = list(sources).index(reference)
        starts = [fit_alone(each.field) for each in samples.values()]
        common = pair_readings(list(samples.values()), place)
        copies = find_copies(common.fields, starts, place)
        return cls(sources, place, mounting, starts, common, copies, prior, options, site)

    @property
    def names(self) -> list[str]:
        """Names of all sensors."""
        return list(self.sources)

    @property
    def own(self) -> list[int]:
        """Indices of the sensors that are not copies."""
        return [place for place in range(len(self.sources)) if place not in self.copies]

    def calibrate(self) -> MultiFit:
        """Fit the sensors, together if possible."""
        several, runs = self.joint_fit()
        apart_deg = 0.0 if several is None else self.apart_deg(several)
        if apart_deg:
            several, runs = None, ()
        members = [self.member(place, several) for place in range(len(self.sources))]
        if several is not None:
            off = usual_scatter(_correct(several, self.common.fields[self.own]), several.directions, self.common.time)
            for place, share in zip(self.own, off.tolist(), strict=True):
                scatter_deg = heading_deg(share, self.dip_deg)
                members[place] = _better_fit(replace(members[place], scatter_deg=scatter_deg))
        is_joint = several is not None and not all(members[place].is_kept for place in self.own)
        agreement = Agreement(len(self.common.time), float(np.ptp(self.common.time)), runs, apart_deg)
        in_body = is_joint and self.mounting is not None
        together = MultiFit(tuple(members), self.names[self.reference], agreement, is_joint, in_body)
        target_deg = self.options["target_deg"]
        return replace(
            together, members=tuple(add_member_findings(together, place, target_deg) for place in range(len(members)))
        )

    def joint_fit(self) -> tuple[MultiSensorFit | None, tuple[Disagreement, ...]]:
        """Joint fit, repeated without the segments in which a sensor deviates; returns the fit and these segments.

        Readings that are outliers of most sensors' own fits are excluded from the start. Otherwise two of three sensors
        that are disturbed alike would be a majority. The fit is None for a single sensor, or if the readings do not
        determine it: directions that no sensor observes alone are not observed together either.
        """
        if len(self.own) < 2 or not any(start is not None and is_sound(start) for start in self.starts):
            return None, ()
        fields: Floats = self.common.fields[self.own]
        runs: tuple[Disagreement, ...] = ()
        several: MultiSensorFit | None = None
        begins = [self.starts[place] for place in self.own]
        outliers = _own_outliers(fields, begins)
        alike = outliers & (2 * outliers.sum(axis=0) > np.isfinite(fields[..., 0]).sum(axis=0))
        for _ in range(MAX_ROUNDS):
            left = np.where(alike[..., np.newaxis], np.nan, fields)
            for run in runs:
                if run.sensor is not None:
                    left[run.sensor, run.first : run.last + 1] = np.nan
            for sensor in {run.sensor for run in runs if run.sensor is not None}:
                begins[sensor] = fit_alone(left[sensor])
            try:
                several = fit_sensors(left, reference=self.own.index(self.reference), starts=begins, spread=self.prior)
            except FitError:
                return None, ()
            if several.unobserved:
                return None, ()
            limits = {"limit_deg": self.options["target_deg"], "dip_deg": self.dip_deg}
            before, runs = runs, disagreements(_correct(several, fields), self.common.time, **limits)
            if _segments(runs) == _segments(before):
                break
        placed = [run.of_sensor(dict(enumerate(self.own))) for run in runs]
        return several, tuple(sorted(placed, key=lambda run: run.start_s))

    def apart_deg(self, several: MultiSensorFit) -> float:
        """Constant difference of two sensors in degrees of heading, if it is unknown which one is wrong; else 0.

        Noise, or a field that moves with one sensor, changes lengths as well as directions, so that lengths show which
        sensor is wrong. Which one is wrong remains unknown in two cases: directions differ by far more than lengths, or
        the joint fit assigns the error to the sensor with the more constant length.
        """
        alone = [self.starts[place] for place in self.own]
        sound = [start for start in alone if start is not None and is_sound(start)]
        if len(self.own) != 2 or len(sound) != 2:
            return 0.0
        fields, dip_deg, time = self.common.fields[self.own], self.dip_deg, self.common.time
        corrected = _correct(several, fields)
        between_deg = heading_deg(float(usual_scatter(corrected[:1], corrected[1], time)[0]), dip_deg)
        lengths = length_scatter(np.stack([_correct_alone(*each) for each in zip(fields, sound, strict=True)]), time)
        by_length_deg = heading_deg(float(np.hypot(*lengths)), dip_deg)
        off = usual_scatter(corrected, several.directions, time)
        is_lopsided = bool(off.max() > MAX_MISFIT_RATIO * off.min() and np.argmax(off) != np.argmax(lengths))
        is_apart = between_deg > self.options["target_deg"] and (
            between_deg > MAX_MISFIT_RATIO * by_length_deg or is_lopsided
        )
        return between_deg if is_apart else 0.0

    def member(self, place: int, several: MultiSensorFit | None) -> Member:
        """The sensor at a place, with its results of the joint fit."""
        name = self.names[place]
        alone = self.fit_alone(name)
        member = Member(
            name, alone, alone,
            delay_s=float(self.common.delays_s[place]),
            delay_sigma_s=float(self.common.delay_sigmas_s[place]),
        )  # fmt: skip
        if place in self.copies:
            return self.copy_member(member, place)
        return member if several is None else self.joint_member(member, place, several)

    def fit_alone(self, name: str) -> Fit | FitError:
        """The fit of one sensor alone by `flinders.fit`, or its error."""
        try:
            return fit(self.sources[name], sensor=name, method=Auto(self.prior), **{**self.options, "site": self.site})
        except FitError as refusal:
            return refusal

    def copy_member(self, member: Member, place: int) -> Member:
        """A member that is a copy, with its rotation to the reference if both are calibrated alone."""
        member = replace(member, copy_of=self.names[self.copies[place]])
        start, reference = self.starts[place], self.starts[self.reference]
        if start is None or reference is None:
            return member
        own = _correct_alone(self.common.fields[place], start)
        into = _correct_alone(self.common.fields[self.reference], reference)
        both = np.isfinite(own).all(axis=1) & np.isfinite(into).all(axis=1)
        rotation = mirror_or_rotation(_unit(own[both]), _unit(into[both]))
        axes, off = nearest_axes(rotation)
        return replace(member, rotation=rotation, axes=axes, misalignment_deg=off)

    def joint_member(self, member: Member, place: int, several: MultiSensorFit) -> Member:
        """A member with its results of the joint fit."""
        index = self.own.index(place)
        rotation, covariance = several.rotation(index)
        is_reference = index == several.reference and self.mounting is None
        estimate = replace(several.estimate(index), outliers=self.outliers(member, place, several.is_inlier[index]))
        judged: Fit | FitError
        try:
            judged = judge_estimate(
                estimate, self.sources[member.name], sensor=member.name,
                aiding_result=None if is_reference else _rotation_aiding(rotation, covariance, self.mounting),
                **self.options,
            )  # fmt: skip
        except FitError as refusal:
            judged = refusal
        radii = [float(np.cbrt(np.linalg.det(at.shape))) for at in several.parameters]
        axes, off = nearest_axes(rotation)
        sigma = np.rad2deg(np.sqrt(np.diag(covariance)))
        return replace(
            member, fit=judged, rotation=rotation, rotation_sigma_deg=sigma, axes=axes, misalignment_deg=off,
            length_ratio=radii[index] / radii[several.reference],
        )  # fmt: skip

    def outliers(self, member: Member, place: int, is_inlier: NDArray[np.bool_]) -> tuple[Outlier, ...]:
        """Outliers of a sensor's own fit, if the joint fit rejects most of them, too."""
        alone = fit_of(member.alone)
        outliers = _own_outliers(self.common.fields[place][np.newaxis], [self.starts[place]])[0]
        if alone is None or not outliers.any() or np.mean(is_inlier[outliers]) > MAX_OUTLIER_SHARE:
            return ()
        return alone.evidence.outliers


def _body_aiding(
    source: Recording, aiding: AnyAiding, site: Site | None, prior: float, target_deg: float
) -> Aiding | None:
    """Mounting of the reference in the body, by other recorded sensors; None if not observed."""
    try:
        reference = fit(source, aiding=aiding, site=site, method=Auto(prior), target_deg=target_deg)
    except Refused as refusal:
        reference = refusal.fit
    except FitError:
        return None
    aiding_result = reference.evidence.aiding
    return (
        None
        if aiding_result is None or aiding_result.rotation is None or aiding_result.rotation_covariance is None
        else aiding_result
    )


def _rotation_aiding(rotation: Floats, covariance: Floats, body: Aiding | None) -> Aiding:
    """Result with a rotation into the reference, followed by that from the reference into the body if known."""
    if body is None or body.rotation is None or body.rotation_covariance is None:
        return Aiding((), rotation, covariance)
    turned = body.rotation @ covariance @ body.rotation.T + body.rotation_covariance
    return Aiding((), body.rotation @ rotation, turned)


def _better_fit(member: Member) -> Member:
    """A member with its own fit in place of the joint fit, if that is clearly better."""
    joint, alone = fit_of(member.fit), fit_of(member.alone)
    if member.copy_of or joint is None or alone is None or alone.claim.plane or alone.evidence.unobserved:
        return member
    worst = joint.heading_error_deg.worst
    if worst <= MAX_JOINT_ERROR_RATIO * alone.heading_error_deg.worst:
        return member
    return replace(
        member, fit=member.alone, rotation=None, rotation_sigma_deg=None, axes="x,y,z", misalignment_deg=0.0,
        is_kept=True, joint_deg=worst,
    )  # fmt: skip


def _own_outliers(fields: Floats, starts: Sequence[Estimate | None]) -> NDArray[np.bool_]:
    """(m, N) outliers of each sensor's own fit; none for a sensor with more outliers than inliers.

    >>> rng = np.random.default_rng(1)
    >>> q = rng.normal(size=(400, 3))
    >>> field = 50.0 * q / np.linalg.norm(q, axis=1, keepdims=True) + rng.normal(scale=0.5, size=q.shape)
    >>> field[100:150] *= 1.4
    >>> outliers = _own_outliers(field[np.newaxis], [fit_alone(field)])[0]
    >>> float(outliers[100:150].mean()), bool(outliers[:80].mean() < 0.1), bool(outliers[170:].mean() < 0.1)
    (1.0, True, True)
    """
    outliers = np.zeros(fields.shape[:2], dtype=bool)
    for sensor, (field, start) in enumerate(zip(fields, starts, strict=True)):
        if start is None or math.isinf(start.rejected_beyond):
            continue
        there = np.flatnonzero(np.isfinite(field).all(axis=1))
        out = extend_to_runs(np.abs(distances(field[there], start.ellipsoid)) > start.rejected_beyond)
        if np.count_nonzero(out) <= MAX_OUTLIER_SHARE * len(there):
            outliers[sensor, there[out]] = True
    return outliers


def _segments(runs: Sequence[Disagreement]) -> set[tuple[int | None, int, int]]:
    """Keys of segments, to compare those of two rounds."""
    return {(run.sensor, run.first, run.last) for run in runs if run.sensor is not None}


def _correct_alone(field: Floats, start: Estimate) -> Floats:
    """(N, 3) readings corrected by the sensor's own fit, over the field's strength."""
    corrected: Floats = (field - start.ellipsoid.centre) @ np.linalg.inv(start.ellipsoid.shape)
    return corrected


def _unit(vectors: Floats) -> Floats:
    """(N, 3) vectors scaled to length one."""
    unit: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _correct(several: MultiSensorFit, fields: Floats) -> Floats:
    """(m, N, 3) corrected readings of all sensors, in the axes of the reference."""
    return np.stack([several.correct(index, field) for index, field in enumerate(fields)])


def nearest_axes(rotation: Floats) -> tuple[str, float]:
    """The exchange of axes that is nearest to a (3, 3) rotation, and the angle between both in degrees.

    >>> nearest_axes(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    ('-y,x,z', 0.0)
    """
    matrices = [axes.apply(np.eye(3)).T for axes in SIGNED_PERMUTATIONS]
    best = int(np.argmax([float(np.sum(matrix * rotation)) for matrix in matrices]))
    cosine = 0.5 * (float(np.sum(matrices[best] * rotation)) - 1.0)
    return str(SIGNED_PERMUTATIONS[best]), float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))
