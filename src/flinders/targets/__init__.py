"""Targets: other tools for which a calibration is written, and from which it is read if possible.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> export = find("esphome").render(Calibration.identity(field_strength=50.0, raw=Unit.of("uT")))
>>> export.text.splitlines()[0][:9]
'# ESPHome'

Each module is a target or a family of targets: formula, writer, reader, and a row for each target in the ``TARGETS`` at
its end. `registry` collects these rows, so that a new target is just a new module. Other packages add targets through
the entry points ``flinders.targets``. The caller writes the files.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Final

from flinders.core.plugins import modules_of, plugin_rows
from flinders.errors import DocumentError, PluginError, UsageError, did_you_mean
from flinders.targets._measurement_noise import MeasurementNoise, YawFilter
from flinders.targets._target import GROUPS, Export, ExportOptions, Target, TargetReader, Written

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
    "find_accepting",
    "mounting_table",
    "read_back",
    "registry",
    "search",
]

LISTED_FIRST: Final = (
    "ardupilot", "px4", "betaflight", "betaflight_model", "inav", "paparazzi", "vectornav", "adis16480", "ros", "code",
    "esphome", "zscilib", "motioncal", "adafruit", "fusion", "rtimulib", "matlab", "plain", "system_mounting",
    "ros_mounting",
)  # fmt: skip
"""Modules in the order in which their targets are listed within a group; all others follow, sorted by name."""

HEAD_BYTES: Final = 65536
"""Number of first bytes by which the target of a file is recognised."""


@cache
def registry() -> Mapping[str, Target]:
    """All targets by name, by group in the order of `GROUPS`. The first call imports their modules.

    Raises `PluginError` for a package whose targets cannot be loaded, or whose names are already in use.
    """
    modules = map(import_module, modules_of(sys.modules[__name__], "TARGETS", first=LISTED_FIRST).values())
    targets = {row.name: row for module in modules for row in module.TARGETS}
    for row in plugin_rows("flinders.targets", Target):
        if row.name in targets:
            raise PluginError(row.write.__module__, f"there is a target {row.name!r} already")
        if row.group not in GROUPS:
            raise PluginError(row.write.__module__, f"group {row.group!r} is not known: use one of {'; '.join(GROUPS)}")
        targets[row.name] = row
    order = list(GROUPS)
    return {row.name: row for row in sorted(targets.values(), key=lambda row: order.index(row.group))}


def find(name: str) -> Target:
    """Target with a name.

    Raises `UsageError` for an unknown name, with the existing names. For the name of a program that uses the output of
    a target, such as ``ekf2``, the error names that target.
    """
    known = registry().get(name.strip().casefold())
    if known is None:
        meant = did_you_mean(name, registry(), by_other=_names_by_program())
        raise UsageError(f"target {name!r} is not known{meant}: use one of {', '.join(registry())}")
    return known


def _names_by_program() -> dict[str, str]:
    """Names of targets by their titles and by the programs that use their output; of several targets the first."""
    names: dict[str, str] = {}
    for row in registry().values():
        for program in filter(None, (row.title, row.estimator, *row.programs)):
            names.setdefault(program, row.name)
    return names


def search(words: str) -> tuple[Target, ...]:
    """Return the targets whose name, written form and group together contain all of these words.

    Raises `UsageError` if there is none.

    >>> [target.name for target in search("python")]
    ['micropython', 'fusion-python']
    >>> [target.name for target in search("ROS mount")]
    ['urdf', 'static-transform']
    """
    found = tuple(row for row in registry().values() if all(word in _text_of(row) for word in words.casefold().split()))
    if not found:
        meant = did_you_mean(words, registry(), by_other=_names_by_program())
        raise UsageError(
            f"no target has {words!r} in its name, written form or group{meant}: give no word to list all targets"
        )
    return found


def _text_of(target: Target) -> str:
    """Name, written form and group of a target, in lower case."""
    return f"{target.name} {target.use} {target.group} {GROUPS[target.group]}".casefold()


def mounting_table(target: Target) -> MountingTable:
    """Mountings that a target can set; `UsageError` for a target that sets no mounting."""
    if target.mountings is None:
        takes = ", ".join(each.name for each in registry().values() if each.mountings)
        raise UsageError(
            f"{target.name} has no setting for a mounting: leave it out; targets that have one: {takes}",
            hint={"mounting": None},
        )
    return target.mountings


def find_accepting(
    name: str, *, compass: int | None = None, code_name: str | None = None, noise: bool = False
) -> Target:
    """Target with a name, checked for options that it must accept.

    Raises `UsageError` for an unknown name, and for an option that the target does not accept: the number of a compass,
    a name in generated code, or the noise for an estimator.
    """
    target = find(name)
    if compass is not None and not target.compasses:
        takes = ", ".join(each.name for each in registry().values() if each.compasses)
        raise UsageError(
            f"{target.name} has one compass only: leave the number out; targets with several: {takes}",
            hint={"compass": None},
        )
    if code_name is not None and not target.named:
        takes = ", ".join(each.name for each in registry().values() if each.named)
        raise UsageError(
            f"names in code of {target.name} are fixed: leave the name out; targets with a choice: {takes}",
            hint={"name": None},
        )
    if noise and target.writes_noise:
        raise UsageError(f"{target.name} always writes its noise: leave the option out", hint={"noise": None})
    if noise and not target.estimator:
        takes = ", ".join(each.name for each in registry().values() if each.estimator)
        raise UsageError(
            f"{target.name} has no option for the noise: leave it out; targets with that option: {takes}",
            hint={"noise": None},
        )
    return target


def read_back(
    content: bytes, source: str, *, target: str | None = None, strength: float | None = None, compass: int | None = None
) -> tuple[str, Calibration]:
    """Read the calibration in a target's file, in the unit and axes of the target.

    Raises `UsageError` for a target whose files cannot be read, and for a compass number if the target has only one
    compass. Raises `DocumentError` for a file of no target, and for a damaged file.

    Parameters
    ----------
    source : str
        Name of the file, for messages.
    target : str, optional
        Target of the file; by default it is recognised by the content.
    strength : float, optional, µT
        Length of corrected readings, if the file does not state it; in counts for a file in counts.
    compass : int, optional
        Number of the compass, if there are several.

    Returns
    -------
    name : str
        Name of the target.
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
        name = next((name for name, reader in readable.items() if reader.sniff(content[:HEAD_BYTES])), None)
        if name is None:
            raise DocumentError(
                f"{source}: is no file of {', '.join(readable)}: if it is, name the target", hint={"target": None}
            )
    else:
        name = find(target).name
        if name not in readable:
            raise UsageError(f"files of {name} cannot be read: use a file of {', '.join(readable)}")
    reader = readable[name]
    if compass is not None and reader.which is None:
        several = dict.fromkeys(row.family for row in registry().values() if row.compasses)
        raise UsageError(
            f"{name} has one compass only: leave the number out; targets with several: {' and '.join(several)}",
            hint={"compass": None},
        )
    more = {"compass": compass} if reader.which is not None else {}
    return name, reader.read(content, source, strength=strength, **more)
