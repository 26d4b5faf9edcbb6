"""``flinders --version``: versions of the software on which results depend."""

from __future__ import annotations

import ctypes
import platform
from importlib import metadata, resources
from typing import TYPE_CHECKING, Final

from flinders.core.version import VERSION
from flinders.foreign_errors import packages_of_extra

if TYPE_CHECKING:
    from collections.abc import Iterable

KERNELS: Final = {1: "baseline kernels", 2: "AVX2 kernels"}
"""Names of the engine's compute kernels, by the number that the engine returns."""


def versions() -> str:
    """Versions, one line each, beginning with that of the program."""
    optional = sorted(packages_of_extra("all"))
    there = [f"{name} {_version(name)}" for name in optional if _version(name)]
    missing = [name for name in optional if not _version(name)]
    rows = {
        "flinders": VERSION,
        "Python": f"{platform.python_version()}, {platform.system()} {platform.machine()}",
        "NumPy": _version("numpy"),
        "engine": _engine(),
        "3-D view": _bundle(),
        "optional": ", ".join(there) or "none",
        "missing": ", ".join(missing) + "; each by: pip install NAME" if missing else "",
        "plugins": ", ".join(_plugins()),
    }
    return "\n".join(f"{name:<8} {value}" for name, value in rows.items() if value)


def _version(package: str) -> str:
    """Version of an installed package; empty if the package is missing."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def _engine() -> str:
    """Name of the engine's kernels for this processor; determined without importing NumPy."""
    from flinders.native import build

    try:
        library = ctypes.CDLL(str(build.library()))
    except (build.NoCompiler, OSError) as error:
        return f"not usable: {error}"
    return KERNELS[library.flinders_kernels(0)]


def _bundle() -> str:
    """State of the page's 3-D library, with advice if the library is missing."""
    if resources.files("flinders").joinpath("static", "vendor", "three.js").is_file():
        return "installed"
    return (
        "not installed, npm could not fetch it; in the checkout: pip install --force-reinstall --no-deps . "
        "(with uv: uv sync --reinstall-package flinders)"
    )


def _plugins() -> Iterable[str]:
    """Yield the packages that add readers or targets."""
    entries = [*metadata.entry_points(group="flinders.readers"), *metadata.entry_points(group="flinders.targets")]
    return dict.fromkeys(f"{entry.dist.name} {entry.dist.version}" for entry in entries if entry.dist)
