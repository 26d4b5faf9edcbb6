"""A session of the page in Node.js: events with their times go in, and what the page shows comes out.

A fit is that of the page's worker, with the engine as WebAssembly. There is no clock, socket or browser.
"""

from __future__ import annotations

import atexit
import itertools
import json
import subprocess
import weakref
from base64 import b64decode, b64encode
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np
from tests.javascript import modules, node

from flinders.apps.live.buffer import ReadingBuffer, rows_of
from flinders.apps.live.messages import Edits, SourceState, readings_frame
from flinders.apps.live.session_file import Log
from flinders.apps.live.standalone.package import live_data
from flinders.core.calibration_file import dumps
from flinders.core.units import MICROTESLA, Unit
from flinders.fitting.result import document_of
from flinders.native import build

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.apps.live.messages import Link
    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

PROGRAM: Final = Path(__file__).with_suffix(".mjs")
SENSOR: Final = SourceState("/dev/ttyACM0", "serial", "connected", "")
UT: Final = Unit.of("uT")

_numbers = itertools.count()
_gone: list[int] = []
"""Numbers of sessions that no test uses any more, and that Node.js has to forget."""


class PageSession:
    """A session that runs in Node.js.

    Parameters
    ----------
    source : SourceState, optional
    frame : str
        Axes of the readings: ``sensor`` or ``vehicle``.
    rules : dict
        Numbers that replace those in `RULES` of ``session.js``.
    **changes
        Initial values of attributes of `Session` in ``session.js``.
    """

    def __init__(
        self,
        source: SourceState = SENSOR,
        *,
        frame: str = "sensor",
        rules: dict[str, float] | None = None,
        **changes: Any,
    ) -> None:
        self.at = 0.0
        self._number = next(_numbers)
        weakref.finalize(self, _gone.append, self._number)
        given = {"source": msgspec.to_builtins(source), "frame": frame, "rules": rules or {}, **changes}
        self._ask("new", **given)

    # Events

    def arrived(self, at: float, rows: Floats, unit: Unit = UT) -> None:
        """Add readings of the sensor: (N, 7) as `rows_of` returns them."""
        acceleration = _packed(rows[:, 4:]) if np.isfinite(rows[:, 4:]).any() else None
        columns = {"time": _packed(rows[:, 0]), "field": _packed(rows[:, 1:4]), "acceleration": acceleration}
        self._tell("arrived", at, unit=_unit(unit), **columns)

    def received(self, at: float, frame: bytes, *, is_old: bool = False) -> None:
        """Add readings that a server has sent."""
        self._tell("received", at, frame=b64encode(frame).decode(), is_old=is_old)

    def adopted(self, at: float, edits: Edits) -> None:
        """Apply edits that were made on another page."""
        self._tell("adopted", at, edits=msgspec.to_builtins(edits))

    def linked(self, at: float, link: Link, words: str = "") -> list[SimpleNamespace]:
        """Change the link to the source; returns the messages to the user."""
        return self._told("linked", at, link=link, words=words)

    def unrecorded(self, at: float, words: str) -> None:
        """Report that readings cannot be recorded."""
        self._tell("unrecorded", at, words=words)

    def opened(self, at: float, name: str, log: Log) -> None:
        """Open a log that was dropped onto the page."""
        about = {"is_timed": log.is_timed, "frame": log.advice_frame, "axes": str(log.axes), "site": log.site}
        frame = b64encode(frame_of_buffer(log.buffer, log.unit)).decode()
        self._tell("opened", at, name=name, frame=frame, about=msgspec.to_builtins(about))

    def got_previous(self, at: float, fit: Fit) -> None:
        """Add an earlier calibration."""
        self._tell("previous", at, name=fit.provenance.name, text=dumps(document_of(fit)))

    def requested(self, at: float, type: str, **command: Any) -> list[SimpleNamespace]:
        """Send a command of the user; returns the messages to the user."""
        return self._told("requested", at, command={"type": type, **command})

    def ticked(self, at: float) -> None:
        """Let time pass until `at` s."""
        self._tell("ticked", at)

    def begin_fit(self) -> None:
        """Begin a fit; its result waits for `fit_done`."""
        self._ask("begun")

    def fit_done(self, at: float, seconds: float = 0.01) -> None:
        """Accept the result of the fit."""
        self._tell("done", at, seconds=seconds)

    def fit(self) -> None:
        """Fit at once."""
        self.begin_fit()
        self.fit_done(self.at)

    # What it shows

    @property
    def state(self) -> SimpleNamespace:
        """State that the page gets."""
        state: SimpleNamespace = self._ask("state")
        return state

    @property
    def shown(self) -> SimpleNamespace:
        """The newest fit on the page."""
        shown: SimpleNamespace = self._ask("shown")
        return shown

    @property
    def view(self) -> Any:  # noqa: ANN401 - a namespace, or None
        """View that is drawn: of the newest fit or of one that is kept; None without one."""
        return self._ask("view")

    def evaluated(self) -> SimpleNamespace:
        """Result that a fit of the readings would have now."""
        found: SimpleNamespace = self._ask("evaluated")
        return found

    def wants_fit(self, at: float) -> bool:
        """Whether a fit is due."""
        return bool(self._ask("wants", at=at))

    @property
    def used(self) -> list[int]:
        """Numbers of the readings that a fit uses, from 0."""
        return list(self._ask("used").numbers)

    @property
    def used_field(self) -> Floats:
        """(N, 3) readings that a fit uses."""
        return _floats(self._ask("used").field).reshape(-1, 3)

    @property
    def used_site(self) -> dict[str, Any] | None:
        """Site that a fit uses, as far as it is known."""
        site: dict[str, Any] | None = self._ask("used", as_dict=True)["site"]
        return site

    @property
    def held(self) -> SimpleNamespace:
        """Readings in memory: `total`, `stride`, `time` (N,), `field` (N, 3)."""
        held: SimpleNamespace = self._ask("held")
        held.time, held.field = _floats(held.time), _floats(held.field).reshape(-1, 3)
        return held

    @property
    def edits(self) -> Edits:
        """Edits that other pages need."""
        return msgspec.convert(self._ask("edits", as_dict=True), Edits)

    @property
    def finishing(self) -> Edits:
        """Edits by which the final calibration is made."""
        return msgspec.convert(self._ask("finishing", as_dict=True), Edits)

    def points(self, page: str = "") -> SimpleNamespace:
        """Points that one page draws: `first` new one (None: none), `stride`, `time`, `acceleration`."""
        points: SimpleNamespace = self._ask("points", page=page)
        return points

    def _told(self, name: str, at: float, /, **given: Any) -> list[SimpleNamespace]:
        self.at = at
        return list(self._ask(name, at=at, **given) or ())

    def _tell(self, name: str, at: float, /, **given: Any) -> None:
        self._told(name, at, **given)

    def _ask(self, name: str, /, *, as_dict: bool = False, **given: Any) -> Any:  # noqa: ANN401 - as JSON
        while _gone:
            _asked({"number": _gone.pop(), "name": "forget"})
        answer = _asked({"number": self._number, "name": name, "given": given})
        said = json.loads(answer)
        assert "fault" not in said, said["fault"]
        return said["answer"] if as_dict else _named(said["answer"])


def log_of(samples: Samples) -> Log:
    """Samples as a log that is dropped onto the page."""
    buffer = ReadingBuffer.empty().with_rows(rows_of(samples))
    return Log(buffer, samples.unit, samples.axes, "sensor", samples.time is not None)


def frame_of_buffer(buffer: ReadingBuffer, unit: Unit = UT) -> bytes:
    """All readings in memory, in the form that the server sends."""
    return readings_frame(
        generation=0, first=0, stride=buffer.stride, total=buffer.total, is_last=True,
        rows=buffer.rows(0, len(buffer)), latest=buffer.latest, is_microtesla=unit.inside == MICROTESLA,
        is_vehicle=False,
    )  # fmt: skip


def codes(state: SimpleNamespace) -> list[str]:
    """Codes of the reasons in a state."""
    return [reason.code for reason in state.reasons]


def warnings(reasons: Iterable[SimpleNamespace]) -> list[str]:
    """Codes of those reasons that are warnings."""
    return [reason.code for reason in reasons if reason.severity == "warning"]


def _named(value: Any) -> Any:  # noqa: ANN401 - as JSON
    """JSON with attributes instead of keys."""
    if isinstance(value, dict):
        return SimpleNamespace(**{name: _named(each) for name, each in value.items()})
    return [_named(each) for each in value] if isinstance(value, list) else value


def _packed(numbers: Floats) -> str:
    return b64encode(np.ascontiguousarray(numbers, "<f8").tobytes()).decode()


def _floats(text: str) -> Floats:
    return np.frombuffer(b64decode(text), "<f8").copy()


def _unit(unit: Unit) -> dict[str, Any]:
    return {"inside": unit.inside, "recorded": unit.inside, "scale": 1.0}


def _asked(message: dict[str, Any]) -> str:
    """Answer of Node.js to a message."""
    program = _program()
    assert program.stdin is not None
    assert program.stdout is not None
    program.stdin.write(json.dumps(message) + "\n")
    program.stdin.flush()
    answer = program.stdout.readline()
    assert answer, f"{message['name']}: Node.js has ended"
    return answer


@cache
def _program() -> subprocess.Popen[str]:
    """Process of Node.js that plays all sessions of this test process, until that ends."""
    wasm = build.library(target=build.WEB_PLATFORM).read_bytes()
    program = subprocess.Popen(
        [node(), str(PROGRAM)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
    )
    assert program.stdin is not None
    start = {"modules": modules(), "wasm": b64encode(wasm).decode(), "data": json.loads(live_data())}
    program.stdin.write(json.dumps(start) + "\n")
    atexit.register(_end, program)
    return program


def _end(program: subprocess.Popen[str]) -> None:
    program.communicate()
