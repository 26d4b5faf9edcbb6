"""Number of the project's files in the call path of one operation, such as a reading, a line on a wire, a row group.

    python -m benchmarks.walk            # the counts
    python -m benchmarks.walk --list     # and the files, in the order in which they are entered
    python -m benchmarks.walk --sizes    # instead: files, lines of code and lines of docstrings of each package, and
                                         # of all JavaScript and C that is not of others

Counted are the distinct files of `flinders` in which a traced run enters a function, and the functions called from a
lower package, such as callbacks; code that runs at the import of a module does not count.

reading     from a CSV file to the exported header: ``calibrate`` and ``export --for arduino``
line        from a line of a serial port to the frame that pages are sent; the session is theirs, in JavaScript
array       from an array of readings to its fit: `flinders.fit`
session     from the readings of a session to the calibration that it is finished with
row group   from a row group of a Parquet file to a row of the table: ``fleet``, all but what its worker does
worker      from the readings of that row group to the row: the same in one process, less the files of the other
"""

from __future__ import annotations

import argparse
import ast
import functools
import re
import sys
import tempfile
import threading
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from click.testing import CliRunner

import flinders
from flinders import simulate
from flinders.cli import main as program
from flinders.findings.c_tables import NOTICE

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

ROOT: Final = Path(flinders.__file__).parent
LANGUAGES: Final = {".js": "JavaScript", ".c": "C", ".h": "C"}
IMPORT_FUNCTIONS: Final = {"<module>", "__getattr__"}
"""Functions that run at the import of a module, or forward a name."""


@dataclass(frozen=True)
class Walk:
    """Files that a run enters, in order, and calls from a lower package to a higher one."""

    files: dict[str, None] = field(default_factory=dict)
    climbs: dict[str, None] = field(default_factory=dict)

    def look(self, frame: FrameType, event: str, _: object) -> None:
        """Record a call; for `sys.setprofile`."""
        own = _own_file(frame)
        if event != "call" or own is None or frame.f_code.co_name in IMPORT_FUNCTIONS:
            return
        self.files.setdefault(own)
        caller = frame.f_back
        while caller is not None and _own_file(caller) is None:
            caller = caller.f_back
        below = _own_file(caller) if caller is not None else None
        if below is not None and _layer(own) < _layer(below):
            self.climbs.setdefault(f"{below} to {own}, {frame.f_code.co_qualname}")


def _own_file(frame: FrameType) -> str | None:
    """File of a frame, relative to the package; None for other code."""
    path = Path(frame.f_code.co_filename)
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else None


@functools.cache
def _layers() -> dict[str, int]:
    """Layer of each package and module in pyproject.toml, the highest 0."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    return {name: place for place, names in enumerate(layers) for name in names.split(" | ")}


def _layer(file: str) -> int:
    """Layer of a file, the highest 0."""
    return _layers()[file.partition("/")[0].removesuffix(".py")]


def walked(run: Callable[[Path], None]) -> Walk:
    """Trace a run in an empty folder, with all imports done before."""
    walk = Walk()
    with tempfile.TemporaryDirectory() as folder:
        run(Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        threading.setprofile(walk.look)
        sys.setprofile(walk.look)
        try:
            run(Path(folder))
        finally:
            sys.setprofile(None)
            threading.setprofile(None)
    return walk


def a_reading(folder: Path) -> None:
    """Run from a CSV file to the exported header."""
    log, result, header = folder / "tumble.csv", folder / "calibration.json", folder / "calibration.h"
    field = _tumble().field
    log.write_text("mx_uT,my_uT,mz_uT\n" + "".join(f"{x:.2f},{y:.2f},{z:.2f}\n" for x, y, z in field.tolist()))
    _command("calibrate", str(log), "-o", str(result))
    _command("export", str(result), "--for", "arduino", "-o", str(header))


@functools.cache
def _tumble() -> Samples:
    """600 readings, cached in the untraced run."""
    return simulate.tumble(seed=1, n=600).samples


@functools.cache
def _three_tumbles() -> Floats:
    """(900, 3) readings, cached in the untraced run."""
    return np.concatenate([simulate.tumble(seed=seed, n=300).samples.field for seed in range(3)])


def a_row_group(folder: Path, workers: int = 1) -> None:
    """Run from a row group of a Parquet file to a row of the table; a worker process is not traced."""
    import pyarrow as pa
    from pyarrow import parquet

    field = _three_tumbles()
    columns = {"unit": np.repeat(["A1", "A2", "A3"], 300)}
    columns |= {f"m{axis}_uT": field[:, place] for place, axis in enumerate("xyz")}
    parquet.write_table(pa.table(columns), folder / "units.parquet", row_group_size=300)
    units, table = str(folder / "units.parquet"), str(folder / "table.parquet")
    _command("fleet", units, "-o", table, "--unit-column", "unit", "--workers", str(workers))


def a_line(_: Path) -> None:
    """Run from a line of a serial port to the frame for pages, without port, recorder and socket."""
    from flinders.apps.live.buffer import ReadingBuffer, Timeline, rows_of
    from flinders.apps.live.messages import readings_frame
    from flinders.links.transcript import Transcript

    transcript, timeline, buffer = Transcript("the board"), Timeline(), ReadingBuffer.empty()
    for number, (x, y, z) in enumerate(_tumble().field.tolist()):
        line = f"X: {x:.2f} Y: {y:.2f} Z: {z:.2f} uT\n"
        taken = transcript.take(line.encode(), at=0.1 * number)
        if taken.readings is not None:
            rows = rows_of(taken.readings)
            rows[:, 0], timeline = timeline(rows[:, 0])
            buffer = buffer.with_rows(rows)
    readings_frame(
        generation=1, first=0, stride=buffer.stride, total=buffer.total, is_last=True,
        rows=buffer.rows(0, len(buffer)), latest=buffer.latest, is_microtesla=True,
        is_vehicle=False,
    )  # fmt: skip


def an_array(_: Path) -> None:
    """Run from an array to its fit."""
    flinders.fit(_tumble().field, unit="uT")


def a_session(_: Path) -> None:
    """Run from the readings of a session to its final calibration."""
    from flinders.apps.live.buffer import ReadingBuffer, rows_of
    from flinders.apps.live.finished import FinishInputs, finish_calibration
    from flinders.apps.live.messages import Edits
    from flinders.apps.live.session_file import Log

    log = Log(ReadingBuffer.empty().with_rows(rows_of(_tumble())), _tumble().unit)
    made = finish_calibration("1", FinishInputs("the board", Edits(), log, None, {}, None))
    if made.view is None:
        sys.exit(made.refusal)


def sizes() -> dict[str, list[int]]:
    """Files, lines of code, and lines of docstrings of each package; comments and empty lines are neither."""
    counts: dict[str, list[int]] = {}
    for path in sorted(ROOT.rglob("*.py")):
        text = path.read_text("utf-8")
        docstrings = _docstrings(ast.parse(text))
        lines = {number for number, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"}
        for name in (path.relative_to(ROOT).parts[0], "in all"):
            count = counts.setdefault(name, [0, 0, 0])
            count[:] = count[0] + 1, count[1] + len(lines - docstrings), count[2] + len(docstrings)
    return counts


def foreign_sizes() -> dict[str, list[int]]:
    """Files, lines of code and lines of comments of JavaScript and of C, with generated tables of C separately."""
    counts: dict[str, list[int]] = {}
    for path in sorted(ROOT.rglob("*.*")):
        name = LANGUAGES.get(path.suffix, "")
        if not name or {"vendor", "bundled"} & set(path.parts):
            continue
        text = path.read_text("utf-8")
        comments = re.findall(r"^[ \t]*(?:/\*.*?\*/[ \t]*$|//[^\n]*)", text, flags=re.MULTILINE | re.DOTALL)
        filled = sum(bool(line.strip()) for line in text.splitlines())
        lines = sum(len(comment.splitlines()) for comment in comments)
        count = counts.setdefault(f"{name}, made" if NOTICE in text else name, [0, 0, 0])
        count[:] = count[0] + 1, count[1] + filled - lines, count[2] + lines
    return counts


def _docstrings(module: ast.Module) -> set[int]:
    """Numbers of the lines of all docstrings."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    first = [node.body[0] for node in ast.walk(module) if isinstance(node, owners) and ast.get_docstring(node)]
    return {number for each in first for number in range(each.lineno, (each.end_lineno or each.lineno) + 1)}


def _command(*words: str) -> None:
    """Run a command of the program in this process."""
    done = CliRunner().invoke(program, words)
    if done.exit_code not in (0, 3, 4):
        sys.exit(f"flinders {' '.join(words)}: {done.output}")


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--list", action="store_true", help="also list the files")
    parser.add_argument("--sizes", action="store_true", help="print the sizes of the packages instead")
    asked = parser.parse_args()
    if asked.sizes:
        for name, (files, code, docstrings) in (sizes() | foreign_sizes()).items():
            print(f"{name:<16} {files:>3} files, {code:>6,} lines of code, {docstrings:>6,} of docstrings or comments")
        return
    runs = {
        "a reading, to the header": a_reading,
        "a line, to the page": a_line,
        "an array, to its fit": an_array,
        "a session, to its end": a_session,
        "a row group": a_row_group,
    }
    made = {name: walked(run) for name, run in runs.items()}
    whole = walked(functools.partial(a_row_group, workers=0))
    job = made["a row group"]
    made["its worker"] = Walk(*({each: None for each in new if each not in old} for new, old in (
        (whole.files, job.files), (whole.climbs, job.climbs),
    )))  # fmt: skip
    for name, walk in made.items():
        print(f"{name:<26} {len(walk.files):>3} files, {len(walk.climbs):>2} calls into a higher package")
        if asked.list:
            print("".join(f"    {each}\n" for each in (*walk.files, *(f"up: {climb}" for climb in walk.climbs))))


if __name__ == "__main__":
    main()
