"""Lines for RTIMULib.ini: ``c = Corr ((m − off) scale − O)`` with extremes that change nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.rtimulib import Settings
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.calibration import Calibration

SHEET: Final = Sheet(
    title="RTIMULib.ini",
    formula="c = Corr ((m - off) scale - O), off = (Min + Max)/2 = 0, scale = 1",
    unit="uT",
    keeps="all",
    storage="six decimals, read as float32",
    source="RTIMUSettings.cpp, RTIMU.cpp",
)


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the lines that replace those of the same names.

    Raises
    ------
    UnitError
        For a calibration in counts.
    """
    settings = Settings.of(calibration)
    lines = settings.lines()
    notes = ["replaces the lines of the same names in RTIMULib.ini; acts after the driver's own exchange of axes"]
    values = dict(line.split("=") for line in lines)
    return SHEET.export(
        calibration, settings.apply, lines, target=target, about=about, asked=asked, values=values, notes=notes
    )
