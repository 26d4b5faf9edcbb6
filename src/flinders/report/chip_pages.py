"""The table of chips, and each chip with its settings, known errors and sources, for the terminal and the docs."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.report.terminal import facts, page, table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

    from flinders.core.chips import Chip, ChipSetting

HEADINGS: Final = ("chip", "maker", "µT of a count", "range, µT", "noise, µT", "axes")


def of_chips(rows: Iterable[Chip]) -> RenderableType:
    """Lay out one line for each chip, in its power-on setting, below the name of its maker."""
    name, _, *values = HEADINGS
    laid: list[tuple[RenderableType, ...]] = []
    for maker, chips in groupby(rows, key=lambda chip: chip.maker):
        laid.append((Text(maker, "bold"), *[""] * len(values)))
        for chip in chips:
            named, _, *cells = _row(chip)
            laid.append((f"  {named}", *cells))
    return table([Column(name, no_wrap=True), *map(Column, values)], laid, is_dense=True)


def of_chip(chip: Chip) -> RenderableType:
    """Lay out one chip with all settings, its axes, known errors and sources."""
    rows = [
        ("chip", chip.name),
        ("maker", chip.maker),
        ("also", ", ".join(chip.also)),
        ("word", "" if chip.bits is None else f"{chip.bits} bits"),
        ("noise", noise_words(chip)),
        ("axes", axes_words(chip)),
    ]
    settings = [
        (each.name, lsb_words(each), "" if each.range_ut is None else f"±{each.range_ut:g}", str(each.zero))
        for each in chip.settings
    ]
    headings = ["setting, power-on first", "µT of a count (--scale)", "range, µT", "zero, counts"]
    said = [("mistake", trap) for trap in chip.traps] + [("source", source) for source in chip.sources]
    return Group(facts([row for row in rows if row[1]]), page(table(headings, settings), facts(said)))


def markdown(rows: Iterable[Chip]) -> str:
    """Write the page of the docs: a table, then the settings, known errors and sources of each chip."""
    chips = list(rows)
    lines = [f"| {' | '.join(HEADINGS)} |", f"|{'---|' * len(HEADINGS)}"]
    lines += [f"| {' | '.join(_row(chip))} |" for chip in chips]
    return "\n".join([*lines, *(line for chip in chips for line in _section(chip))]) + "\n"


def lsb_words(setting: ChipSetting, digits: int = 6) -> str:
    """Write the µT per count, and that of the z axis if it differs.

    >>> from flinders.core.chips import find_chip
    >>> lsb_words(find_chip("BMM350").settings[0], 3)
    '0.00707, z 0.00717'
    """
    z = "" if setting.lsb_z_ut is None else f", z {setting.lsb_z_ut:.{digits}g}"
    return f"{setting.lsb_ut:.{digits}g}{z}"


def noise_words(chip: Chip) -> str:
    """Write the rms noise, with the setting that it is for; empty without a source."""
    return "" if chip.noise_ut is None else f"{chip.noise_ut:g} µT rms ({chip.noise_at})"


def axes_words(chip: Chip) -> str:
    """Write the mapping of axes, and the axes that result; empty if no mapping is known."""
    return chip.axes and f"--axes={chip.axes} for {chip.axes_are}"


def _row(chip: Chip) -> tuple[str, ...]:
    """Row of a chip in the table, in its power-on setting."""
    setting = chip.settings[0]
    ranges = "" if setting.range_ut is None else f"±{setting.range_ut:g}"
    noise = "" if chip.noise_ut is None else f"{chip.noise_ut:g}"
    return chip.name, chip.maker, lsb_words(setting, 4), ranges, noise, chip.axes


def _section(chip: Chip) -> list[str]:
    """Lines of the docs about one chip."""
    settings = "; ".join(_setting_words(each) for each in chip.settings)
    known = {
        "Also": ", ".join(chip.also),
        "Word": "" if chip.bits is None else f"{chip.bits} bits",
        "µT of a count, power-on first": settings,
        "Noise": noise_words(chip),
        "Axes": f"`--axes={chip.axes}` for {chip.axes_are}" if chip.axes else "",
    }
    lines = ["", f"## {chip.name}", "", f"{chip.maker}."]
    lines += [f"{name}: {words}." for name, words in known.items() if words]
    if chip.traps:
        lines += ["", "Known mistakes:", "", *(f"- {trap}" for trap in chip.traps)]
    return [*lines, "", "Sources:", "", *(f"- {_literal(source)}" for source in chip.sources)]


def _setting_words(setting: ChipSetting) -> str:
    """Write a setting for the docs: µT per count, the reading in zero field if it is not 0, and the use."""
    zero = f", {setting.zero} counts in zero field" if setting.zero else ""
    usual = " (usual)" if setting.is_usual else ""
    return f"{lsb_words(setting)}{'' if setting.name == 'fixed' else f' at {setting.name}'}{zero}{usual}"


def _literal(text: str) -> str:
    """Write a text for Markdown, so that stars and underscores in names have no effect."""
    return text.replace("*", r"\*").replace("_", r"\_")
