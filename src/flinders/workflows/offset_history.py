"""History of the offset of one sensor, from files of an online calibration.

>>> from flinders import OnlineCalibration, simulate
>>> tumble = simulate.tumble(seed=1, n=9000).samples
>>> online = OnlineCalibration()
>>> _ = online.add(tumble.field, time=tumble.time)
>>> history = OffsetHistory.of(online, name="U17")
>>> history.offset.shape[1], history.unit, history.walk is None                        # three minutes tell no walk
(3, 'uT', True)
"""

from __future__ import annotations

import os
import re
from array import array
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import msgspec
import numpy as np

from flinders.core.files import reason_and_remedy
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.errors import DocumentError
from flinders.estimators.data import MAX_READING, MIN_READING
from flinders.fitting.fit_file import load
from flinders.readers._times import MIN_EPOCH_S
from flinders.workflows.online import FORMAT, OnlineCalibration
from flinders.workflows.walk import walk_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.offset_walk import Walk

MIN_STEP_S: Final = 7200.0
"""Smallest time between estimates for a random walk; estimates that are closer count as one."""
MAX_ESTIMATES: Final = 400
"""Largest number of estimates for a random walk."""
MAX_EPOCH_S: Final = 2.5e11
"""Largest time of a date, in s from 1970."""
ADOPTED_NAME: Final = re.compile(r"calibration-(?:(\d{8}T\d{6})Z|(-?\d+(?:\.\d+)?)s)\.json")
"""Pattern of the file name of an adopted calibration, which contains the time at which it came into force."""
HEAD_BYTES: Final = 200  # Bytes at the start of a file by which its kind is recognised


@dataclass(frozen=True, slots=True, eq=False)
class OffsetHistory:
    """The offset of one sensor over time."""

    name: str
    time_s: Floats  #: (n,) s, ascending: by the clock of the readings, from 1970 if the date is known
    offset: Floats  #: (n, 3), in `unit`: newest estimate of the offset at each time
    sigma: Floats  #: (n, 3): 1 σ of each component
    unit: str  #: ``uT`` or ``counts``
    radius: float  #: mean length of readings about the offset, in `unit`
    dip_deg: float  #: inclination of the field, for headings
    moved_s: tuple[float, ...] = ()  #: times at which the offset had moved and was learnt again
    heading_error_deg: float = np.nan  #: claimed heading error at the end of the history, in degrees

    @classmethod
    def of(cls, online: OnlineCalibration, *, name: str = "calibration") -> Self:
        """History of an online calibration."""
        points = [point for point in online.timeline if point.is_read and np.isfinite(point.offset).all()]
        state = online.state
        return cls(
            name,
            np.array([point.time_s for point in points]),
            np.array([point.offset for point in points]).reshape(-1, 3),
            np.array([point.offset_sigma for point in points]).reshape(-1, 3),
            unit=online.unit.inside,
            radius=state.radius,
            dip_deg=online.dip_deg,
            moved_s=tuple(point.time_s for point in points if "moved" in point.events),
            heading_error_deg=state.heading_error_deg,
        )

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, name: str | None = None) -> Self:
        """Read the output of `flinders watch`: a state file, a folder of adopted calibrations, or lines of JSON.

        Raises `DocumentError` for any other file.
        """
        path = Path(path)
        name = path.stem if name is None else name
        try:
            if path.is_dir():
                return cls._of_folder(path, name)
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES)
            if f'"{FORMAT}"'.encode() in head:
                return cls.of(OnlineCalibration.load(path), name=name)
            return cls._of_lines(path, name)
        except OSError as error:
            raise DocumentError(f"{path} cannot be read: {reason_and_remedy(error)}") from None

    @classmethod
    def _of_folder(cls, folder: Path, name: str) -> Self:
        """Read the history from files of adopted calibrations."""
        times = {path: time for path in folder.iterdir() if (time := adoption_time_s(path.name)) is not None}
        if not times:
            raise DocumentError(
                f"{folder}: holds no calibration-TIME.json: give a folder of calibrations that `flinders watch` "
                "adopted; for a folder of recordings give the table that `flinders fleet` writes"
            )
        paths = sorted(times, key=times.__getitem__)
        fits = [load(path) for path in paths]
        last = fits[-1]
        unit = last.calibration.unit
        alike = [place for place, fit in enumerate(fits) if fit.calibration.unit == unit]
        return cls(
            name,
            np.array([times[paths[place]] for place in alike]),
            np.array([fits[place].calibration.offset for place in alike]),
            np.array([np.sqrt(fits[place].claim.covariance.diagonal()[:3]) for place in alike]),
            unit=unit,
            radius=last.calibration.ellipsoid.radius,
            dip_deg=last.claim.known_dip_deg,
            heading_error_deg=last.heading_error_deg.worst,
        )

    @classmethod
    def _of_lines(cls, path: Path, name: str) -> Self:
        """Read lines of ``--json`` since the last change of the unit; the last line may be incomplete."""
        rows, moved, last = array("d"), list[float](), None
        with path.open("rb") as file:
            for line in _reports(file, path):
                if line.kind == "source" or line.time_s is None or line.offset is None or line.offset_sigma is None:
                    continue
                if last is not None and line.unit != last.unit:
                    rows, moved = array("d"), []
                rows.extend((line.time_s, *line.offset, *line.offset_sigma))
                moved += [line.time_s] if line.event == "moved" else []
                last = line
        if last is None or last.radius is None:
            raise DocumentError(f"{path}: no line has an offset, as no calibration was found yet: record for longer")
        table = np.frombuffer(rows).reshape(-1, 7)
        if last.radius < MIN_READING or np.abs(table).max() > MAX_READING:
            raise DocumentError(
                f"{path}: has implausible numbers for a magnetometer: give the lines of JSON as they were printed"
            )
        table = table[np.argsort(table[:, 0], kind="stable")]
        return cls(
            name,
            *(table[:, 0], table[:, 1:4], table[:, 4:]),
            unit=last.unit or "counts",
            radius=last.radius,
            dip_deg=ASSUMED_DIP_DEG,
            moved_s=tuple(moved),
            heading_error_deg=last.heading_error_deg or np.nan,
        )

    @property
    def is_dated(self) -> bool:
        """Whether times count from 1970."""
        return bool(len(self.time_s)) and bool(self.time_s[0] >= MIN_EPOCH_S)

    @property
    def estimates(self) -> Self:
        """Independent estimates: the most certain one in every two hours, without repetitions."""
        if not len(self.time_s):
            return self
        cell_s = max(MIN_STEP_S, float(self.time_s[-1] - self.time_s[0]) / MAX_ESTIMATES)
        cells = np.floor((self.time_s - self.time_s[0]) / cell_s)
        surest_last = np.lexsort((-self.sigma.sum(axis=1), cells))
        rows = surest_last[np.flatnonzero(np.diff(cells[surest_last], append=np.inf))]
        is_new = np.concatenate([[True], (np.diff(self.offset[rows], axis=0) != 0.0).any(axis=1)])
        rows = rows[is_new]
        return self._with_estimates(self.time_s[rows], self.offset[rows], self.sigma[rows])

    def _with_estimates(self, time_s: Floats, offset: Floats, sigma: Floats) -> Self:
        others = self.unit, self.radius, self.dip_deg, self.moved_s, self.heading_error_deg
        return type(self)(self.name, time_s, offset, sigma, *others)

    @property
    def walk(self) -> Walk | None:
        """Random walk of the offset; None if the history is too short."""
        estimates = self.estimates
        return walk_of(estimates.time_s, estimates.offset, estimates.sigma)


def find_histories(paths: Sequence[str | os.PathLike[str]]) -> dict[Path, str]:
    """Paths of histories, with the names of their units, from files or folders.

    A folder without adopted calibrations is searched for such files and folders. If several units have the same name,
    all are named by their paths. Raises `DocumentError` for a folder without a history, and for one that cannot be
    read.
    """
    found = [each for path in paths for each in _histories_at(Path(path))]
    is_clear = len({path.stem for path in found}) == len(found)
    return {path: path.stem if is_clear else os.fspath(path) for path in found}


def _histories_at(path: Path) -> Iterable[Path]:
    """Paths of the histories at a path."""
    try:
        if not path.is_dir() or any(adoption_time_s(each.name) is not None for each in path.iterdir()):
            return [path]
        found = sorted(each for each in path.iterdir() if is_history(each))
    except OSError as error:
        raise DocumentError(f"{path} cannot be read: {reason_and_remedy(error)}") from None
    if not found:
        raise DocumentError(f"{path}: holds no output of `flinders watch`: give states, or adopted calibrations")
    return found


def is_history(path: str | os.PathLike[str]) -> bool:
    """Whether a path can be a history: a folder, a state file, or lines of ``watch --json``."""
    try:
        if Path(path).is_dir():
            return True
        with Path(path).open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return False
    return f'"{FORMAT}"'.encode() in head or re.match(rb'\{ *"kind" *:', head) is not None


def adoption_file_name(time_s: float) -> str:
    """File name of a calibration, made from the time in s at which it came into force.

    >>> adoption_file_name(1795946435.0), adoption_file_name(4.836)
    ('calibration-20261129T100035Z.json', 'calibration-4.84s.json')
    """
    if not MIN_EPOCH_S <= time_s <= MAX_EPOCH_S:
        return f"calibration-{time_s:.2f}s.json"
    return f"calibration-{datetime.fromtimestamp(time_s, UTC):%Y%m%dT%H%M%SZ}.json"


def adoption_time_s(name: str) -> float | None:
    """Time in s that the file name of a calibration contains; None for other names.

    >>> names = "calibration-20261129T100035Z.json", "calibration-4.84s.json", "old.json"
    >>> [adoption_time_s(name) for name in names]
    [1795946435.0, 4.84, None]
    """
    match = ADOPTED_NAME.fullmatch(name)
    if match is None:
        return None
    date, seconds = match.groups()
    try:
        return float(seconds) if date is None else datetime.strptime(f"{date}+0000", "%Y%m%dT%H%M%S%z").timestamp()
    except ValueError:
        return None


class _Line(msgspec.Struct):
    """Fields of a line of ``flinders watch --json`` that are used here."""

    kind: str
    event: str | None
    time_s: float | None
    offset: tuple[float, float, float] | None
    offset_sigma: tuple[float, float, float] | None
    radius: float | None
    unit: str | None
    heading_error_deg: float | None


def _reports(lines: Iterable[bytes], path: Path) -> Iterator[_Line]:
    """Yield lines of ``flinders watch --json``; `DocumentError` for other lines, except an incomplete last one."""
    decoder = msgspec.json.Decoder(_Line)
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            yield decoder.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError):
            if number > 1 and not line.endswith(b"\n"):
                return
            raise DocumentError(
                f"{path}: line {number} is not JSON of `flinders watch`: give its state, a folder of the "
                "calibrations that it adopted, or its output"
            ) from None
