"""Targets: a calibration in, a file for another tool out, and back where that can be. The caller writes the file.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> export = find("esphome").render(Calibration.identity(field_strength=50.0, raw=Unit.of("uT")))
>>> export.text.splitlines()[0][:9]
'# ESPHome'

Each module is a target or a family of them: formula, writer and reader, and at its end a row for each in ``TARGETS``,
by which `registry` finds it. A new target is a new module and nothing else. Other packages add targets through the
entry points ``flinders.targets``.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Final

from flinders.core.plugins import modules_of, plugin_rows
from flinders.errors import DocumentError, PluginError, UsageError, did_you_mean
from flinders.targets._measurement_noise import MeasurementNoise, YawFilter
from flinders.targets._target import Export, ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.core.calibration import Calibration
    from flinders.targets._mounting import MountingTable

__all__ = [
    "Export",
    "ExportOptions",
    "MeasurementNoise",
    "Target",
    "TargetReader",
    "Written",
    "YawFilter",
    "find",
    "mounting_table",
    "read_back",
    "registry",
    "taking",
]

FIRST: Final = (
    "ardupilot", "px4", "motioncal", "adafruit", "fusion", "rtimulib", "betaflight", "betaflight_model", "inav",
    "paparazzi", "vectornav", "adis16480", "ros", "esphome", "zscilib", "matlab", "code", "plain", "system_mounting",
    "ros_mounting",
)  # fmt: skip
"""Modules in the order in which their targets are listed; all others come after them, by name."""

HEAD: Final = 65536
"""Bytes of a file that are looked at to tell what it is."""


@cache
def registry() -> Mapping[str, Target]:
    """All targets by name, in the order they are listed; the first call imports their modules.

    Raises `PluginError` for a package whose targets cannot be loaded, or have the name of another.
    """
    modules = map(import_module, modules_of(sys.modules[__name__], "TARGETS", first=FIRST).values())
    targets = {row.name: row for module in modules for row in module.TARGETS}
    for row in plugin_rows("flinders.targets", Target):
        if row.name in targets:
            raise PluginError(row.write.__module__, f"there is a target {row.name!r} already")
        targets[row.name] = row
    return targets


def find(name: str) -> Target:
    """Look up a target.

    Raises `UsageError` for one that there is not; names those there are.
    """
    known = registry().get(name.strip().casefold())
    if known is None:
        meant = did_you_mean(name, registry())
        raise UsageError(f"target {name!r} is not known{meant}: use one of {', '.join(registry())}")
    return known


def mounting_table(target: Target) -> MountingTable:
    """The mountings that a target can be given; `UsageError` for one that takes none."""
    if target.mountings is None:
        takes = ", ".join(each.name for each in registry().values() if each.mountings)
        raise UsageError(
            f"a mounting goes with {takes}: {target.name} has no setting of it, leave it out", hint={"mounting": None}
        )
    return target.mountings


def taking(name: str, *, compass: int | None = None, code_name: str | None = None, noise: bool = False) -> Target:
    """Look up a target as `find`, and refuse what it does not take: `UsageError`.

    That may be the number of a compass, a name for code, or the noise for an estimator.
    """
    target = find(name)
    if compass is not None and not target.compasses:
        takes = ", ".join(each.name for each in registry().values() if each.compasses)
        raise UsageError(
            f"the number of a compass goes with {takes}: {target.name} holds one compass only, leave it out",
            hint={"compass": None},
        )
    if code_name is not None and not target.named:
        takes = ", ".join(each.name for each in registry().values() if each.named)
        raise UsageError(
            f"a name goes with {takes}: {target.name} has no names to choose, leave it out", hint={"name": None}
        )
    if noise and not target.estimator:
        takes = ", ".join(each.name for each in registry().values() if each.estimator)
        raise UsageError(
            f"the noise for an estimator is asked for with {takes}: {target.name} gets what it has room for without "
            "asking, leave it out",
            hint={"noise": None},
        )
    return target


def read_back(
    content: bytes, source: str, *, target: str | None = None, strength: float | None = None, compass: int | None = None
) -> tuple[str, Calibration]:
    """Read the calibration that a target's file stands for, in the unit and axes of the target.

    Raises `UsageError` for a target whose files cannot be read back, or a compass where there is one only;
    `DocumentError` for a file that is none of theirs, or damaged.

    Parameters
    ----------
    source : str
        For messages.
    target : str, optional
        Whose file it is; found by its content where it is not given.
    strength : float, optional, µT
        Length of corrected readings, where the target does not hold it; in counts for files in counts.
    compass : int, optional
        Which of several.

    Returns
    -------
    name : str
        Of the target.
    calibration : Calibration

    Examples
    --------
    >>> sentence = b"$VNWRG,23,1,0,0,0,1,0,0,0,1,0.1,-0.2,0.3*XX"
    >>> name, found = read_back(sentence, "line.txt", strength=48.0)
    >>> name, found.offset
    ('vectornav', array([ 10., -20.,  30.]))
    """
    readable = {name: row.reader for name, row in registry().items() if row.reader is not None}
    if target is None:
        name = next((name for name, reader in readable.items() if reader.sniff(content[:HEAD])), None)
        if name is None:
            raise DocumentError(
                f"{source}: is no file of {', '.join(readable)}: name the target, if it is", hint={"target": None}
            )
    else:
        name = find(target).name
        if name not in readable:
            raise UsageError(f"files of {name} cannot be read back: those of {', '.join(readable)} can")
    reader = readable[name]
    if compass is not None and reader.which is None:
        several = dict.fromkeys(row.family for row in registry().values() if row.compasses)
        raise UsageError(
            f"the number of a compass goes with {' and '.join(several)}: {name} holds one compass only, leave it out",
            hint={"compass": None},
        )
    more = {"compass": compass} if reader.which is not None else {}
    return name, reader.read(content, source, strength=strength, **more)
