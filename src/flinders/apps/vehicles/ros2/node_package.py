"""Writes the ROS 2 package with a node that calibrates, for those who have ROS: ``ament_python``, built by colcon.

>>> sorted(contents())[:3]
['LICENSE', 'README.md', 'flinders_ros/__init__.py']
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Final

from flinders.core.files import licence, write_folder

SOURCE: Final = Path(__file__).parent / "flinders_ros"
VERSION: Final = version("flinders")
PLACE: Final = "@VERSION@"


def contents() -> dict[str, str]:
    """Every file of the package by its name."""
    files = (path for path in SOURCE.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    texts = {path.relative_to(SOURCE).as_posix(): path.read_text(encoding="utf-8") for path in files}
    return {name: text.replace(PLACE, VERSION) for name, text in texts.items()} | {"LICENSE": licence()}


def write(directory: str | Path, *, force: bool = False) -> list[Path]:
    """Write the package into a folder; as `flinders.core.files.write_folder`."""
    return write_folder(contents(), directory, force=force)
