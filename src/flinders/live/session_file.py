"""The file of a session: what it is called, what was done by hand in it, and how it is read again.

Readings are written by the recorder, as they arrive. Between them stand comments with what a person did, so that a
session that was ended by a crash goes on as it was:

>>> done = Edits(excluded=((3.0, 5.5),), target_deg=0.5)
>>> print(done.line(), end="")
# flinders live: {"excluded":[[3.0,5.5]],"begun_s":null,"target_deg":0.5,"dip_deg":60.0,"goal":"heading"}
>>> Edits.within(["0.1,1,2,3", done.line()]) == done
True

The readings that a calibration is made of in the end are those of the file, and not those in memory: all of them, with
the unit they were written in, so that ``flinders calibrate SESSION`` finds the same, but for what was taken out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import msgspec
import numpy as np

from flinders.core.files import reason
from flinders.core.samples import Wrapped
from flinders.errors import OutputError
from flinders.live.buffer import Timeline

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator
    from datetime import datetime

    from flinders.core.samples import Recording, Samples
    from flinders.live.buffer import Span
    from flinders.live.session import Session

FOLDER: Final = "flinders-sessions"
SIGN: Final = "# flinders live: "


class Edits(msgspec.Struct, frozen=True, kw_only=True):
    """What a person did in a session.

    Attributes
    ----------
    excluded : tuple of (start, end), s
    begun_s : float or None, s
        What came up to then was left behind.
    target_deg, dip_deg : float
    goal : str
    """

    excluded: tuple[tuple[float, float], ...] = ()
    begun_s: float | None = None
    target_deg: float = 1.0
    dip_deg: float = 60.0
    goal: Literal["heading", "attitude"] = "heading"

    @classmethod
    def of(cls, session: Session) -> Edits:
        """What was done in a session so far, on the readings of the sensor."""
        live = session.live
        return cls(
            excluded=live.excluded,
            begun_s=live.begun_s,
            target_deg=session.target_deg,
            dip_deg=session.dip_deg,
            goal=session.goal,
        )

    def line(self) -> str:
        """Write it as a comment."""
        return f"{SIGN}{msgspec.json.encode(self).decode()}\n"

    @classmethod
    def within(cls, lines: Iterable[str]) -> Edits:
        """What the last such comment says; one that a crash has cut is passed over."""
        edits = cls()
        for line in lines:
            if line.startswith(SIGN):
                try:
                    edits = msgspec.json.decode(line.removeprefix(SIGN), type=cls)
                except msgspec.DecodeError:
                    continue
        return edits

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Edits:
        """What the file of a session says.

        Raises
        ------
        OutputError
            Where it cannot be read.
        """
        try:
            with Path(path).open(encoding="utf-8", errors="replace") as file:
                return cls.within(line for line in file if line.startswith(SIGN))
        except OSError as error:
            raise OutputError(f"{path}: cannot be continued: {reason(error)}") from None

    @property
    def left_out(self) -> tuple[Span, ...]:
        """All spans that a calibration does without."""
        return self.excluded if self.begun_s is None else ((-np.inf, self.begun_s), *self.excluded)


def default_path(now: datetime, folder: str = FOLDER) -> Path:
    """Name a session by its time, in a folder that is made where it is not there.

    Raises
    ------
    OutputError
        Where it cannot be made.
    """
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made: {reason(error)}; give the recording another place with --output"
        ) from None
    name = now.astimezone().strftime("%Y-%m-%d %H-%M-%S").replace(" ", "_")
    file = path / f"{name}.csv"
    again = 2
    while file.exists():
        file, again = path / f"{name}_{again}.csv", again + 1
    return file


@dataclass(slots=True, eq=False)
class TrimmedRecording(Wrapped):
    """A recording on the timeline of its session, without some stretches of it.

    Attributes
    ----------
    recording : Recording
    spans : tuple of (start, end), s
        Ends included.
    timeline : Timeline
        Where the last pass ended.

    Examples
    --------
    >>> from flinders.core.samples import Samples
    >>> samples = Samples.of(np.ones((5, 3)), time=[0, 1, 2, 3, 4])
    >>> [block.time.tolist() for block in TrimmedRecording(samples, ((1.0, 2.0),)).blocks()]
    [[0.0, 3.0, 4.0]]
    """

    recording: Recording
    spans: tuple[Span, ...]
    timeline: Timeline = field(default_factory=Timeline)

    def blocks(self) -> Iterator[Samples]:
        """Go through the recording."""
        self.timeline, count = Timeline(), 0
        for block in self.recording.blocks():
            times = np.arange(count, count + len(block), dtype=float) if block.time is None else block.time
            count += len(block)
            times, self.timeline = self.timeline(times)
            used = np.ones(len(block), bool)
            for start, end in self.spans:
                used &= (times < start) | (times > end)
            yield replace(block, time=times)[used]
