"""Makes the drawings of docs/gallery.md: ``python -m docs.gallery`` runs the code under each.

A block that writes ``NAME.svg`` makes ``docs/images/gallery-NAME.svg``.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import shutil
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests import bench_files

from flinders.cli import main as command_line

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCS: Final = Path(__file__).resolve().parent
BLOCK: Final = re.compile(r"^```(python|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
WRITES_SVG: Final = re.compile(r"\b(\w+)\.svg")


def blocks() -> Iterator[tuple[str, str, str]]:
    """Yield name of the drawing, language and text of each block that makes a drawing."""
    for language, text in BLOCK.findall((DOCS / "gallery.md").read_text(encoding="utf-8")):
        if made := WRITES_SVG.search(text):
            yield made[1], language, text


def run(language: str, text: str) -> None:
    """Run a block in the folder of its files."""
    if language == "python":
        exec(compile(text, "gallery.md", "exec"), {"__name__": "gallery"})
        return
    words = shlex.split(text)[1:]
    for word in words:
        if word.endswith(".csv"):
            bench_files.make(word, words)
    with contextlib.suppress(SystemExit):
        command_line(words)


def main() -> None:
    """Make all drawings."""
    for name, language, text in blocks():
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            run(language, text)
            shutil.move(f"{name}.svg", DOCS / "images" / f"gallery-{name}.svg")
        sys.stdout.write(f"gallery-{name}.svg\n")


if __name__ == "__main__":
    main()
