"""Writes the firmware package: a library for Arduino, PlatformIO and CMake in one folder.

The C files are those of the engine (`flinders.native`), unchanged, with `board.c` and `packet.c` added. Two definitions
at the head of the package's `flinders.h` select single precision and a small stack.

>>> sorted(contents())[:3]
['CMakeLists.txt', 'LICENSE', 'README.md']
>>> "src/likelihood.c" in contents()
True
"""

from __future__ import annotations

import json
from importlib.metadata import metadata, version
from pathlib import Path
from typing import Final

from flinders.apps.board import poses
from flinders.core.files import licence_text, write_folder
from flinders.native.build import SOURCE_FOLDER as NATIVE

BOARD: Final = Path(__file__).parent / "board"

ENGINE: Final = (
    "flinders.h", "flinders_rules.h", "internal.h", "judge.h", "online.h", "random.h", "record.h", "residuals.h",
    "sums.h", "about.c", "claim.c", "cloud.c", "covariance.c", "dispatch.c", "fit.c", "guidance.c", "heading.c",
    "judge.c", "kernels.c", "knowledge.c", "likelihood.c", "linear.c", "online.c", "quality.c", "random.c",
    "residuals.c", "rests.c", "robust.c", "rules.c", "runs.c", "start.c", "sums.c",
)  # fmt: skip
"""Files of the engine that a board needs."""

CONFIGURATION: Final = """\
/* Single precision, and a stack of a few kilobytes. Define FLINDERS_DOUBLE where the processor has double precision. */
#define FLINDERS_SMALL
#ifndef FLINDERS_DOUBLE
#define FLINDERS_FLOAT
#endif

"""
"""Head of `flinders.h` on a board."""


NAME: Final = "Flinders"
VERSION: Final = version("flinders")
AUTHORS: Final = "The Flinders developers"
SENTENCE: Final = "Calibrates a magnetometer on the board, and states the expected heading error."
PARAGRAPH: Final = "Maximum-likelihood fit of offset and soft iron, verdict, and how to hold the sensor next."


def write(directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write the package.

    Parameters
    ----------
    directory : str or Path
        The folder, created if missing; any name is possible.
    force : bool
        Replace existing files.

    Returns
    -------
    list of Path
        The files, in order of name.

    Raises
    ------
    OutputExists
        If a file exists and `force` is not given; then nothing is written.
    OutputError
        If a file cannot be written.
    """
    return write_folder(contents(), directory, force=force)


def contents() -> dict[str, str]:
    """Content of each file of the package, by name."""
    engine = {f"src/{name}": (NATIVE / name).read_text(encoding="utf-8") for name in ENGINE}
    engine["src/flinders.h"] = CONFIGURATION + engine["src/flinders.h"]
    own = (path for path in BOARD.rglob("*") if path.is_file())
    return {
        **engine,
        **{path.relative_to(BOARD).as_posix(): path.read_text(encoding="utf-8") for path in own},
        "src/poses.c": poses.source(),
        "library.properties": _properties(),
        "library.json": _manifest(),
        "LICENSE": licence_text(),
    }


def _page() -> str:
    """Address of the page about this package: `[project.urls]` of pyproject.toml."""
    urls = dict(line.split(", ", 1) for line in metadata("flinders").get_all("Project-URL") or [])
    return f"{urls['Documentation']}board/firmware.html"


def _properties() -> str:
    """`library.properties` of Arduino's library specification 1.5, rev. 2.2."""
    fields = {
        "name": NAME,
        "version": VERSION,
        "author": AUTHORS,
        "maintainer": AUTHORS,
        "sentence": SENTENCE,
        "paragraph": PARAGRAPH,
        "category": "Sensors",
        "url": _page(),
        "architectures": "*",
        "includes": "flinders_board.h",
    }
    return "".join(f"{name}={value}\n" for name, value in fields.items())


def _manifest() -> str:
    """`library.json` of PlatformIO."""
    fields = {
        "name": NAME,
        "version": VERSION,
        "description": f"{SENTENCE} {PARAGRAPH}",
        "keywords": ["magnetometer", "compass", "calibration", "hard iron", "soft iron"],
        "authors": [{"name": AUTHORS, "maintainer": True}],
        "license": "BSD-3-Clause",
        "homepage": _page(),
        "headers": "flinders_board.h",
        "frameworks": "*",
        "platforms": "*",
        "build": {"flags": ["-ffp-contract=off"]},
    }
    return json.dumps(fields, indent=2) + "\n"
