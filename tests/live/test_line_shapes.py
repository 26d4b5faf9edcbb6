"""What boards print, by fifty public example sketches: a file, a recording and the live page read the same numbers.

The shapes are the rows of docs/line-shapes.toml. Each is printed for a simulated tumble, with lines between that are no
readings, and read back from a file, from the file that the recorder writes, and as the live page takes it.
"""

from __future__ import annotations

import os
import re
import threading
import tty
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from tests.sketches import DOCS, SHAPES, printed
from tests.trials import daily
from tests.waiting import wait_until

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.links.recorder import Recorder
from flinders.links.sinks import FileSink
from flinders.links.transports import Serial

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


IDS: Final = [shape["name"] for shape in SHAPES]
TUMBLE: Final = simulate.tumble(seed=5).samples[:600:10]
IN_WORDS: Final = {"uT": "µT", "": "counts"}
NOISE: Final = ("low battery", "wifi: retry 3", "\ufffd\ufffd~")
"""Lines of a board that are no readings."""


def with_noise(shape: dict[str, Any], readings: list[list[str]]) -> list[str]:
    """What comes out of the port: the boot messages, the readings, and between them lines that are none."""
    lines = list(shape["boot"]) or ["starting"]
    for row, reading in enumerate(readings):
        lines += reading
        if row in (20, 31, 44):
            longest = max(reading, key=len)
            lines += [NOISE[row % 3], longest[: len(longest) // 3]]
    return lines


def options_of(shape: dict[str, Any]) -> dict[str, Any]:
    """What the user has to say of this shape; nothing of most."""
    return {name: shape[name] for name in ("pattern", "columns") if name in shape}


def test_there_are_fifty_shapes_with_their_origin() -> None:
    assert len(SHAPES) >= 50
    assert len(set(IDS)) == len({tuple(shape["lines"]) for shape in SHAPES}) == len(SHAPES)
    assert all(shape["project"].count("/") == 1 and shape["file"] and shape["licence"] for shape in SHAPES)


def test_the_page_of_shapes_is_made_from_the_table(request: pytest.FixtureRequest) -> None:
    path = DOCS / "line-shapes.md"
    text = path.read_text(encoding="utf-8")
    pattern = re.compile(r"(?<=<!-- table of shapes -->\n).*?(?=<!-- end of the table -->)", re.DOTALL)
    rows = ["| a reading, as printed | read as | origin | licence |", "|---|---|---|---|"]
    for shape in SHAPES:
        lines = "<br>".join(f"`{_shown(line)}`" for line in printed(shape, TUMBLE)[0][4] if line.strip())
        said = "".join(f", `--{name} '{_escaped(value)}'`" for name, value in options_of(shape).items())
        unit = IN_WORDS.get(shape["unit"], shape["unit"]) if shape["stated"] else "counts"
        rows.append(f"| {lines} | {unit}{said} | {shape['project']}: {shape['file']} | {shape['licence']} |")
    made = pattern.sub(lambda _: "\n".join([*rows, ""]), text)
    if request.config.getoption("--regenerate", default=False):
        path.write_text(made, encoding="utf-8")
    assert path.read_text(encoding="utf-8") == made, (
        "docs/line-shapes.md has another table: pytest --regenerate this test"
    )


def _shown(line: str) -> str:
    """A printed line in a cell of a table, without digits that depend on the processor."""
    rounded = re.sub(r"\d+\.\d{12,}", lambda number: f"{float(number[0]):.12g}", line)
    return _escaped(re.sub(r"\s+", " ", rounded.strip()))


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


@pytest.mark.parametrize("shape", SHAPES, ids=IDS)
def test_a_file_of_what_a_sketch_prints_gives_its_numbers(shape: dict[str, Any], tmp_path: Path) -> None:
    """Also with lines between that are none, which lose nothing but themselves."""
    readings, numbers = printed(shape, TUMBLE)
    path = tmp_path / "print.txt"
    path.write_text("\r\n".join([*with_noise(shape, readings), ""]), encoding="utf-8", newline="")
    samples = flinders.read(path, **options_of(shape))
    np.testing.assert_allclose(samples.field / samples.unit.scale, numbers, rtol=1e-9, atol=1e-9)
    assert samples.unit.name == ((shape["unit"] or "counts") if shape["stated"] else "counts")


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the end of the board, and the name of the port."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize("shape", daily(SHAPES, 4), ids=IDS)
def test_a_recording_and_the_live_page_give_the_same_numbers(
    shape: dict[str, Any], port: tuple[int, str], tmp_path: Path
) -> None:
    readings, numbers = printed(shape, TUMBLE)
    content = "\r\n".join([*with_noise(shape, readings), ""]).encode()
    options, path = options_of(shape), tmp_path / "recorded.csv"
    source = Serial(port[1])
    sender = threading.Thread(target=_send, args=(port[0], content))
    with FileSink(path, force=False) as sink:
        recorder = Recorder(source, sink, columns=options.get("columns"), pattern=options.get("pattern"))
        sender.start()
        live = []

        def has_all() -> bool:
            found = recorder.next(0.1)
            live.extend([found.field] if isinstance(found, Samples) else [])
            return recorder.statistics.readings >= len(numbers)

        wait_until(has_all)
        recorder.close()
        while found := recorder.next(0.0):
            live += [found.field] if isinstance(found, Samples) else []
    sender.join()
    recorded = flinders.read(path, columns=options.get("columns") and _after_time(options["columns"]))
    np.testing.assert_allclose(recorded.field / recorded.unit.scale, numbers, rtol=1e-9, atol=1e-9)
    assert recorded.unit.name == ((shape["unit"] or "counts") if shape["stated"] else "counts")
    if "columns" not in shape:
        np.testing.assert_allclose(np.concatenate(live), recorded.field, rtol=1e-12)


def _send(master: int, content: bytes) -> None:
    while content:
        content = content[os.write(master, content[:1024]) :]


def _after_time(columns: str) -> str:
    """The same columns behind the time that the recorder puts first."""
    return ",".join(str(int(column) + 1) for column in columns.split(","))
