"""Writes a ROS 2 package with a calibrating node, an ``ament_python`` package to be built by colcon.

>>> sorted(contents())[:3]
['LICENSE', 'README.md', 'flinders_ros/__init__.py']
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Final

from flinders.core.files import licence_text, write_folder

SOURCE: Final = Path(__file__).parent / "flinders_ros"
VERSION: Final = version("flinders")
VERSION_MARK: Final = "@VERSION@"


def contents() -> dict[str, str]:
    """Content of each file of the package, by name."""
    files = (path for path in SOURCE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    texts = {path.relative_to(SOURCE).as_posix(): path.read_text(encoding="utf-8") for path in files}
    return {name: text.replace(VERSION_MARK, VERSION) for name, text in texts.items()} | {"LICENSE": licence_text()}


def write(directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write the package into a folder; details as `flinders.core.files.write_folder`."""
    return write_folder(contents(), directory, force=force)
