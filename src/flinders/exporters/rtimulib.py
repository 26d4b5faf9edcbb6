"""Lines for RTIMULib.ini: ``c = Corr ((m − off) scale − O)`` with extremes that change nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.conventions.rtimulib import Settings
from flinders.exporters._export import Written
from flinders.exporters._sheet import Sheet

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

SHEET: Final = Sheet(
    title="RTIMULib.ini",
    formula="c = Corr ((m - off) scale - O), off = (Min + Max)/2 = 0, scale = 1",
    unit="uT",
    keeps="all",
    storage="six decimals, read as float32",
    source="RTIMUSettings.cpp, RTIMU.cpp",
)


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the lines that replace those of the same names; a calibration in counts raises `UnitError`."""
    settings = Settings.of(calibration)
    lines = settings.lines()
    notes = ["replaces the lines of the same names in RTIMULib.ini; acts after the driver's own exchange of axes"]
    return Written(settings.apply, lines, dict(line.split("=") for line in lines), notes)
