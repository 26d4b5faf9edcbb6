"""The first minutes of a newcomer, as docs/start shows them: each command is run, and prints what the page shows.

Renew the pages with ``pytest --regenerate``. The board is a pseudo-terminal that sends a minute of readings in a second
or two, so that the time of arrival is set to what the page says.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import termios
import threading
import time
import tty
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from click.testing import CliRunner
from tests.flight_log import dataflash
from tests.golden.sessions import ROOT
from tests.worlds import table_text

from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from collections.abc import Callable

START: Final = ROOT / "docs" / "start"
PORT: Final = "/dev/ttyACM0"
CONSOLE: Final = re.compile(r"(?<=^```console\n)(.*?)(?=^```$)", re.MULTILINE | re.DOTALL)
SCRIPT: Final = re.compile(r"^```python\n(?!>>>)(.*?)^```$", re.MULTILINE | re.DOTALL)
LAST_DIGITS: Final = re.compile(r"(\.\d{5})\d+")
"""Machines agree on five decimals of a fit."""
ARRIVED: Final = re.compile(r"in [\d.]+ s, [\d,.]+ Hz")


def plug_in_board() -> str:
    """The name of a serial port whose board prints lines once the port is open at its speed."""
    board, port = os.openpty()
    tty.setraw(port)
    field = simulate.tumble(seed=2, motion="hand", n=1200).samples.field

    def sketch() -> None:
        while termios.tcgetattr(port)[5] != termios.B115200:
            time.sleep(0.01)
        time.sleep(0.2)
        for row, (x, y, z) in enumerate(field):
            os.write(board, f"t_ms: {1000 + 50 * row} mag_uT: {x:.1f} {y:.1f} {z:.1f}\r\n".encode())
            time.sleep(0.001)

    threading.Thread(target=sketch, daemon=True).start()
    return os.ttyname(port)


def log_flight() -> str:
    """A log of ArduPilot; no board."""
    Path("flight.bin").write_bytes(b"".join(dataflash()))
    return PORT


def log_line() -> str:
    """Recordings of a line: a unit was moved between two, one was hardly turned, one wrote half a file; no board."""
    recordings = [(unit, month) for unit in ("V101", "V102", "V103") for month in (3, 6)]
    for place, (unit, month) in enumerate([*recordings, ("V104", 6), ("V105", 6)]):
        sensor = simulate.tumble(seed=int(unit[1:])).sensor
        moved = [0.0, 4.0, 0.0] if (unit, month) == ("V103", 6) else [0.0, 0.0, 0.0]
        seen = replace(sensor, offset=sensor.offset + moved)
        field = simulate.tumble(seed=place, sensor=seen, n=400, motion="uniform").samples.field
        field = field[field[:, 2] < np.quantile(field[:, 2], 0.3)] if unit == "V104" else field
        path = Path("logs", unit, f"2026-0{month}-01.csv")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            table_text("mag_x_uT,mag_y_uT,mag_z_uT", field[: 6 if unit == "V105" else None]), encoding="utf-8"
        )
    return PORT


def answered(line: str, port: str) -> str:
    """What a command line prints."""
    ended = CliRunner().invoke(main, shlex.split(line.replace(PORT, port))[1:], prog_name="flinders")
    assert ended.exit_code in {0, 3}, ended.output  # 3: a unit is not good, or has changed
    return ARRIVED.sub("in 60.0 s, 20.0 Hz", ended.output.replace(port, PORT))


@pytest.mark.parametrize(
    ("page", "prepare"), [("maker.md", plug_in_board), ("pilot.md", log_flight), ("line.md", log_line)]
)
def test_the_first_minutes_are_as_the_page_shows(
    page: str, prepare: Callable[[], str], request: pytest.FixtureRequest
) -> None:
    path, port = START / page, prepare()
    text = path.read_text(encoding="utf-8")

    def real(shown: re.Match[str]) -> str:
        lines = [line for line in shown[1].splitlines() if line.startswith("$ ")]
        return "".join(f"{line}\n{answered(line[2:], port)}" for line in lines)

    renewed = CONSOLE.sub(real, text)
    for script in SCRIPT.findall(text):
        exec(compile(script, page, "exec"), {})
    if request.config.getoption("--regenerate", default=False):
        path.write_text(renewed, encoding="utf-8")
    shown = path.read_text(encoding="utf-8")
    assert LAST_DIGITS.sub(r"\1", renewed) == LAST_DIGITS.sub(r"\1", shown), (
        f"docs/start/{page}: `uv run pytest --regenerate`, then review"
    )


TOOL: Final = re.compile(r"^\$ uv run (.*)$")
"""A line of the contributor's page, whose tools are those of this environment."""


def test_a_contributors_first_commands_end_as_the_page_shows(request: pytest.FixtureRequest) -> None:
    path = START / "contributor.md"
    text = path.read_text(encoding="utf-8")

    def real(shown: re.Match[str]) -> str:
        found = (TOOL.match(line) for line in shown[1].splitlines())
        return "".join(f"$ uv run {line[1]}\n{tool_says(line[1])}" for line in found if line)

    renewed = CONSOLE.sub(real, text)
    if request.config.getoption("--regenerate", default=False):
        path.write_text(renewed, encoding="utf-8")
    assert renewed == path.read_text(encoding="utf-8"), "docs/start/contributor.md: `uv run pytest --regenerate`"


def tool_says(line: str) -> str:
    """The last line that a tool of the project prints, without what it took."""
    words = shlex.split(line)
    tool = shutil.which(words[0], path=Path(sys.executable).parent)
    assert tool is not None
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    ended = subprocess.run([tool, *words[1:]], cwd=ROOT, capture_output=True, text=True, env=environment, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    last = next(line for line in reversed(ended.stdout.splitlines()) if line.strip())
    return f"{re.sub(r' in [0-9.]+s', '', last)}\n"


@pytest.mark.parametrize("page", ["maker.md", "pilot.md", "notebook.md", "line.md", "contributor.md"])
def test_nobody_needs_more_than_three_steps(page: str) -> None:
    steps = re.findall(r"^\*\*(\d)\.", (START / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert steps in (["1", "2"], ["1", "2", "3"])
