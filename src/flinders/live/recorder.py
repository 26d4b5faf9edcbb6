r"""Records a running sensor: all that arrives goes to the disk as it arrives, as text that `flinders.read` reads.

A line that is not understood is kept as a comment and counted. What was received is handed to the operating system at
once and forced to the disk each second, so that a crash loses at most a second, and a program that is killed less.

>>> import tempfile
>>> from pathlib import Path
>>> from flinders.live.sinks import ToFile
>>> from flinders.live.sources import Scripted
>>> file = Path(tempfile.mkdtemp()) / "tumble.csv"
>>> board = Scripted([b"booting\r\nRaw:0,0,8192,0,0,0,217,4,-5", b"86\r\nRaw:0,0,8192,0,0,0,217,2,-587\r\n"])
>>> with ToFile(file) as sink:
...     print(Recorder(board, sink, readings=2).run())
2 readings (Raw: lines) in 0.0 s, ..., strength 62.5 µT (62.5 to 62.6)
>>> print(file.read_text())
# flinders ... record: the script, begun ...Z
# booting
t_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,mag_x_uT,mag_y_uT,mag_z_uT
...,0,0,1,0,0,0,21.7,0.4,-58.6
...,0,0,1,0,0,0,21.7,0.2,-58.7
<BLANKLINE>
>>> from flinders.readers import read
>>> read(file).field[0]
array([ 21.7,   0.4, -58.6])
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from flinders.errors import LinkError, UnreadableInput, counted, figures
from flinders.live.lines import Form, is_marked, settle
from flinders.readers._lines import shown
from flinders.readers._sniff import COMMENTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.live.sinks import Sink
    from flinders.live.sources import ByteSource

SYNC_S: Final = 1.0
"""Seconds after which what was received is forced to the disk."""
WAIT_S: Final = 0.1
"""Longest wait for bytes: how soon the end of a recording is noticed."""
SETTLE_S: Final = 0.9
"""Seconds that the first lines are held back until their layout is settled; less than `SYNC_S`."""
ENOUGH: Final = 20
"""Lines that settle it at once."""
LONGEST: Final = 4096
"""Bytes without a line end that are taken for no line."""
SILENT_S: Final = 3.0
"""Seconds without a reading after which advice is given."""
UNLIKE: Final = 50
"""Lines in a row that are not like the first ones, after which advice is given."""
WATCH_S: Final = 0.5
FIRST_RETRY_S, LAST_RETRY_S = 0.1, 2.0
"""Seconds between tries to open a lost port again: each twice the one before, up to the last."""
STEP_S: Final = 1e-4
"""Lines that arrive together are told apart by so much, the last digit of a time."""
BESIDE: Final = re.compile(r"\s*(Raw|Uni|Cal[12])\s*[: ]", re.IGNORECASE)
"""Lines that sketches print beside the readings: the same in other units, the calibration they hold."""
ENDS: Final = re.compile(rb"[\r\n]+")


@dataclass(slots=True)
class Recorded:
    """What has been recorded so far.

    Attributes
    ----------
    form : Form, optional
        How the lines are written; None where that is not known.
    readings, unknown, lines, received : int
        Rows, lines that were not understood, all lines, and bytes.
    seconds : float
        Since the start.
    strength_sum, weakest, strongest : float
        Of the length of the field, in the unit of `form`.
    losses : int
        How often the other end went away.
    first_unknown : str
        The first line that was not understood.
    """

    form: Form | None = None
    readings: int = 0
    unknown: int = 0
    lines: int = 0
    received: int = 0
    seconds: float = 0.0
    strengths: int = 0
    strength_sum: float = 0.0
    weakest: float = math.inf
    strongest: float = 0.0
    losses: int = 0
    first_unknown: str = ""
    first_at: float = 0.0
    last_at: float = 0.0

    def add(self, field: tuple[float, ...], at: float) -> None:
        """Count one reading."""
        self.first_at = self.first_at if self.readings else at
        self.readings, self.last_at = self.readings + 1, at
        strength = math.sqrt(sum(value * value for value in field))
        if field and math.isfinite(strength):
            self.strengths += 1
            self.strength_sum += strength
            self.weakest, self.strongest = min(self.weakest, strength), max(self.strongest, strength)

    @property
    def rate_hz(self) -> float:
        """Readings a second, gaps included; 0 before there are two."""
        span = self.last_at - self.first_at
        return (self.readings - 1) / span if self.readings > 1 and span > 0 else 0.0

    def as_dict(self) -> dict[str, object]:
        """JSON-ready."""
        known = self.strengths > 0
        return {
            "format": str(self.form) if self.form else None,
            "readings": self.readings,
            "seconds": self.seconds,
            "rate_hz": self.rate_hz or None,
            "strength": {
                "unit": self.form.unit if self.form else None,
                "mean": self.strength_sum / self.strengths if known else None,
                "min": self.weakest if known else None,
                "max": self.strongest if known else None,
            },
            "not_understood": self.unknown,
            "first_not_understood": self.first_unknown or None,
            "bytes": self.received,
            "losses": self.losses,
        }

    def __str__(self) -> str:
        told = [f"{counted(self.readings, 'reading')}{f' ({self.form})' if self.form else ''} in {self.seconds:.1f} s"]
        told += [f"{figures(self.rate_hz)} Hz"] * (self.rate_hz > 0)
        if self.strengths and self.form is not None:
            mean = self.strength_sum / self.strengths
            ends = f"({figures(self.weakest, 3)} to {figures(self.strongest, 3)})"
            told.append(f"strength {figures(mean, 3)} {self.form.unit} {ends}".replace("  ", " "))
        told += [f"lost {self.losses} time{'s' * (self.losses != 1)}"] * (self.losses > 0)
        return ", ".join(told)


class Recorder:
    """Takes what a source gives until it is told to stop.

    Parameters
    ----------
    source : ByteSource
    sink : Sink
    seconds, readings : float and int, optional
        When to stop.
    stopped : callable
        Tells whether to stop for another reason.
    say : callable
        Told what a person at the bench should know, a sentence each.
    watch : callable, optional
        Called twice a second with what has been recorded.
    clock : callable
        Seconds, ascending.
    """

    def __init__(
        self,
        source: ByteSource,
        sink: Sink,
        *,
        seconds: float | None = None,
        readings: int | None = None,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        watch: Callable[[Recorded], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source, self._sink, self._clock = source, sink, clock
        self._seconds, self._readings, self._stopped = seconds, readings, stopped
        self._say, self._watch = say, watch
        self._told = Recorded()
        self._title = ""
        self._rest = b""
        self._held: list[tuple[float, bytes]] = []
        self._start = self._last = 0.0
        self._is_cut = not source.is_framed
        self._is_headed = self._is_advised = self._is_named = False
        self._unlike = 0
        self._synced = self._watched = 0.0

    def run(self) -> Recorded:
        """Record until the end; what was received by then is written.

        Raises
        ------
        OutputError
            Where it cannot be written; what came before is saved.
        UnreadableInput
            Where no line of numbers came at all.
        """
        self._start = self._clock()
        begun = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._title = f"# flinders {version('flinders')} record: {self._source.name}, begun {begun}\n"
        while not self._is_over():
            try:
                content = self._source.read(self._wait())
            except LinkError as error:
                self._come_back(error)
                continue
            self._take(content)
            self._look_after()
        self._end()
        if not self._told.readings:
            raise UnreadableInput(self._nothing())
        return self._told

    def _is_over(self) -> bool:
        told = self._told
        late = self._seconds is not None and told.seconds >= self._seconds
        return late or (self._readings is not None and told.readings >= self._readings) or self._stopped()

    def _wait(self) -> float:
        return WAIT_S if self._seconds is None else max(min(WAIT_S, self._seconds - self._told.seconds), 0.0)

    def _take(self, content: bytes) -> None:
        """Cut what came in into lines and write them."""
        now = self._clock() - self._start
        self._told.seconds = now
        self._told.received += len(content)
        if content:
            if self._title:
                self._sink.write(self._title)
                self._title = ""
            *whole, self._rest = ENDS.split(self._rest + content + b"\n" * self._source.is_framed)
            if len(self._rest) > LONGEST:
                whole, self._rest = [*whole, self._rest], b""
            self._held += [(now, line) for line in whole if line.strip()]
        if self._held and (self._told.form or self._is_enough(now)):
            self._settle()
            self._flush()

    def _is_enough(self, now: float) -> bool:
        wanted = ENOUGH if self._readings is None else min(ENOUGH, self._readings)
        return len(self._held) >= ENOUGH or now - self._held[0][0] >= SETTLE_S or self._rows() >= wanted

    def _rows(self) -> int:
        """Count the held lines that would be rows."""
        form = settle([_text(line) for _, line in self._held])
        return sum(form.row(_text(line), 0.0) is not None for _, line in self._held) if form else 0

    def _settle(self) -> None:
        """Tell how the lines are written, where that is not known yet."""
        if self._told.form is None:
            lines = [_text(line) for _, line in self._held]
            self._told.form = settle(lines[1:] if self._is_cut and not is_marked(lines[0]) else lines)

    def _flush(self) -> None:
        """Write the lines that are held, each as a row or a comment."""
        out: list[str] = []
        while self._held and not self._has_all():
            now, line = self._held.pop(0)
            self._told.lines += 1
            out.append(self._written(_text(line), line, now))
        self._sink.write("".join(out))

    def _has_all(self) -> bool:
        return self._readings is not None and self._told.readings >= self._readings

    def _written(self, text: str, line: bytes, now: float) -> str:
        """One line as it goes into the file."""
        form = self._told.form
        cut, self._is_cut = self._is_cut and not is_marked(text), False
        at = max(now, self._last + STEP_S) if self._last else now
        row = None if cut or form is None else form.row(text, at)
        if form is None or row is None:
            self._note(text, form, cut=cut)
            return f"# {'cut off: ' * cut}{escaped(line)}\n"
        self._last, self._unlike = at, 0
        self._told.add(row.field, at)
        header = f"{form.header}\n" if form.header and not self._is_headed else ""
        self._is_headed = True
        return f"{header}{row.text}\n"

    def _note(self, text: str, form: Form | None, *, cut: bool) -> None:
        """Count what is not understood, but no comment of the sensor's own, header, or line that stands beside."""
        if cut or text.lstrip().startswith(COMMENTS) or (form and text.strip() in form.header):
            return
        sign = BESIDE.match(text)
        if sign and form and sign[1] != form.words.partition(":")[0]:
            return
        self._told.unknown += 1
        self._told.first_unknown = self._told.first_unknown or shown(text)
        self._unlike += form is not None
        if self._unlike == UNLIKE:
            self._say(
                f"! the last {UNLIKE} lines are not like the first ones ({form}) and are kept as comments: the "
                f"latest is {shown(text)!r}; stop, and record again"
            )

    def _look_after(self) -> None:
        """Sync, show how it goes, and give advice where nothing comes."""
        now, told = self._told.seconds, self._told
        if now - self._synced >= SYNC_S:
            self._synced = now
            self._sink.sync()
        if told.form and not self._is_named:
            self._is_named = True
            self._say(f"{self._source.name}: {told.form}")
        if self._watch and now - self._watched >= WATCH_S:
            self._watched = now
            self._watch(told)
        if not self._is_advised and not told.readings and now >= SILENT_S:
            self._is_advised = True
            self._say(f"! {self._nothing()}")

    def _nothing(self) -> str:
        """Say why there is no reading, and what to do."""
        if not self._told.received:
            return (
                f"nothing arrives from {self._source.name}: see that the sensor is on and prints its readings, and "
                "that port, cable and baud rate are right"
            )
        example = self._told.first_unknown or shown(_text(self._rest))
        return (
            f"{counted(self._told.received, 'byte')} arrived from {self._source.name} and no line of three numbers "
            f"({example!r}): check --baud, and what the sketch prints"
        )

    def _come_back(self, error: LinkError) -> None:
        """Wait for the other end, asking less and less often."""
        self._cut_off()
        self._told.losses += 1
        self._sink.write(f"# lost at {self._told.seconds:.4f} s\n")
        self._sink.sync()
        self._say(f"! {error}; what was recorded is saved. Waiting for it to come back; Ctrl-C ends the recording")
        pause = FIRST_RETRY_S
        while not self._is_over():
            until = self._clock() + pause
            while self._clock() < until and not self._is_over():
                time.sleep(min(pause, WAIT_S))
                self._told.seconds = self._clock() - self._start
            pause = min(2 * pause, LAST_RETRY_S)
            with contextlib.suppress(LinkError):
                self._source.reopen()
                break
        else:
            return
        self._told.seconds = self._clock() - self._start
        self._sink.write(f"# back at {self._told.seconds:.4f} s\n")
        self._say(f"{self._source.name} is back")
        self._is_cut = not self._source.is_framed

    def _end(self) -> None:
        self._cut_off()
        self._sink.sync()
        if self._watch:
            self._watch(self._told)

    def _cut_off(self) -> None:
        """Write what is held, and the start of a line that will have no end."""
        if self._held and not self._has_all():
            self._settle()
            self._flush()
        if self._rest.strip() and not self._has_all():
            self._sink.write(f"# cut off: {escaped(self._rest)}\n")
        self._rest = b""


def escaped(line: bytes) -> str:
    r"""Write bytes as printable ASCII from which they can be had back.

    >>> escaped(b"\xff\x00 42 \\"), escaped(b"\xff\x00 42 \\").encode().decode("unicode_escape").encode("latin-1")
    ('\\xff\\x00 42 \\\\', b'\xff\x00 42 \\')
    """
    return line.decode("latin-1").encode("unicode_escape").decode("ascii")


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip("\ufeff\0")
