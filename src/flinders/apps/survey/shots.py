r"""Shots of survey instruments: calibration data of TopoDroid (CSV), of mag-cal and of the SAP6 (JSON).

>>> import tempfile
>>> from pathlib import Path
>>> file = Path(tempfile.mkdtemp()) / "calib.csv"
>>> _ = file.write_text("# 2026.11.27 created by TopoDroid v 6.3\n\n1, 120, -80, 24010, 9000, 100, 21000, 1\n")
>>> shots = instrument_shots(file, axes=Axes(), acceleration_axes=Axes(), pointing=None)
>>> shots.gravity, shots.groups, shots.pointing
(array([[  120.,   -80., 24010.]]), array([1]), 'x')

TopoDroid writes shot, gravity x y z, field x y z and group, then bearing, clino, roll, error and status, in counts of
the DistoX, whose laser is along x. Files of mag-cal and the SAP6 have ``{"mag": [[x, y, z], …], "grav": [[x, y, z],
…]}``, with the laser along y, x to the right and z up.

Sources: CalibExport.java and CalibTransform.java of TopoDroid (github.com/marcocorvi/topodroid); calibration.py
and tests/fixtures/SAP6 of mag-cal (github.com/furbrain/CircuitPython_mag_cal).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.survey.instrument import Shots
from flinders.core.axes import Axes
from flinders.core.keywords import check_keywords
from flinders.errors import ArrayError, NoMagnetometer, UnreadableInput, UsageError
from flinders.readers import read
from flinders.readers._lines import encoding_of
from flinders.readers._source import HEAD_BYTES, find
from flinders.readers._tokenizer import shorten

if TYPE_CHECKING:
    import os

    from flinders.apps.survey.instrument import Pointing
    from flinders.arrays import Floats
    from flinders.core.samples import Samples

TOPODROID: Final = "TopoDroid"

NEED: Final = (
    "need a calibration exported by TopoDroid (CSV), mag and grav of mag-cal or a SAP6 (JSON), or a table with "
    "magnetometer and accelerometer, one shot a line"
)


@check_keywords()
def read_shots(
    path: str | os.PathLike[str],
    *,
    axes: str = "x,y,z",
    acceleration_axes: str | None = None,
    pointing: Pointing | None = None,
) -> Shots:
    """Read the shots of a survey instrument: files of TopoDroid, mag-cal or a SAP6, else each reading of a recording.

    Parameters
    ----------
    axes : str
        Axes of the magnetometer that point along x, y and z of the right-handed instrument, such as ``x,y,-z``.
    acceleration_axes : str, optional
        Axes of the accelerometer that point along x, y and z of the instrument; by default as `axes`.
    pointing : str, optional
        Axis of the laser, x, y or z; by default y for files of mag-cal, else x.

    Raises
    ------
    InputError
        For a file that does not exist or cannot be read, and for a recording of a magnetometer alone.
    """
    if path == "-":
        raise UsageError("shots are read twice: name a file, not standard input")
    turned = Axes.of(axes)
    of_gravity = turned if acceleration_axes is None else Axes.of(acceleration_axes)
    shots = instrument_shots(path, axes=turned, acceleration_axes=of_gravity, pointing=pointing)
    return Shots.of(_read_table(path), turned, of_gravity, pointing or "x") if shots is None else shots


def _read_table(path: str | os.PathLike[str]) -> Samples:
    """Read a recording; an error is replaced if its hints name options that shots do not have."""
    try:
        return read(path)
    except (NoMagnetometer, UnreadableInput) as error:
        if not error.hint:
            raise
        raise type(error)(f"no shots are recognised in {find(path).name}: {NEED}") from None


def instrument_shots(
    path: str | os.PathLike[str], *, axes: Axes, acceleration_axes: Axes, pointing: Pointing | None
) -> Shots | None:
    """Read the shots of an instrument's file; None for any other file. Raises as `read_shots`."""
    source = find(path)
    text, turned = _text(source.head()), (axes, acceleration_axes)
    if text.lstrip().startswith("{") and '"grav"' in text:
        return _of_json(source.name, text, turned, pointing or "y")
    if TOPODROID in text.partition("\n")[0]:
        return _of_topodroid(source.name, text, turned, pointing or "x")
    return None


def _text(head: bytes) -> str:
    """Content of a small text file; empty for any other."""
    try:
        return head.decode(encoding_of(head)).removeprefix("\ufeff") if len(head) < HEAD_BYTES else ""
    except UnicodeDecodeError:
        return ""


def _of_json(name: str, text: str, turned: tuple[Axes, Axes], pointing: Pointing) -> Shots:
    """Shots from lists ``mag`` and ``grav``; gravity points down in the axes of the instrument."""
    try:
        content: Any = json.loads(text)
        field, gravity = (np.array(content[key], float) for key in ("mag", "grav"))
        return Shots(
            turned[0].apply(field), turned[1].apply(gravity), pointing=pointing, axes=turned[0],
            acceleration_axes=turned[1], source=name,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError, RecursionError, ArrayError) as error:
        raise UnreadableInput(f"{name} has no lists mag and grav of x, y and z ({error}): {NEED}") from None


def _of_topodroid(name: str, text: str, turned: tuple[Axes, Axes], pointing: Pointing) -> Shots:
    """Shots from lines of TopoDroid, without deleted ones; if there are groups, shots without a group are left out."""
    lines = [(at, line) for at, line in enumerate(text.splitlines(), 1) if _is_shot(line)]
    rows = np.array([_numbers(name, at, line) for at, line in lines])
    if not len(rows):
        raise UnreadableInput(f"{name} has no line of a shot: {NEED}")
    groups = rows[:, 7].astype(np.intp)
    is_grouped = bool((groups > 0).any())
    shots = Shots(
        turned[0].apply(rows[:, 4:7]), turned[1].apply(rows[:, 1:4]), groups if is_grouped else None,
        tuple(rows[:, 0].astype(int).tolist()), pointing, axes=turned[0], acceleration_axes=turned[1], source=name,
    )  # fmt: skip
    return shots[(rows[:, 8] == 0) & ((groups > 0) | (not is_grouped))]


def _is_shot(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _numbers(name: str, at: int, line: str) -> Floats:
    """(9,) shot, gravity, field, group and status from a line."""
    cells = line.split(",")
    try:
        row = np.array([*map(float, cells[:8]), float(cells[12]) if len(cells) > 12 else 0.0])
    except ValueError:
        row = np.empty(0)
    if len(row) != 9 or not np.isfinite(row).all():
        raise UnreadableInput(
            f"line {at} of {name} has no eight numbers (shot, gravity, field, group): {shorten(line)!r}: {NEED}"
        )
    return row
