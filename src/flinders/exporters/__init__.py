"""Exporters: a calibration in, text for another tool out. The caller writes the file.

>>> from flinders.calibration import Calibration
>>> from flinders.units import Unit
>>> export = find("adis16480").render(Calibration.identity(field_strength=50.0, raw=Unit.of("uT")), target="adis16480")
>>> [register["code"] for register in export.fields["registers"]]
[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]

An exporter is a row of `EXPORTERS`: a new target adds a file here, one with its formulas to `conventions`, and a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from flinders.errors import UsageError
from flinders.exporters import adis16480
from flinders.exporters._export import Deviation, Export, Render

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["EXPORTERS", "Deviation", "Export", "Exporter", "Render", "find"]


@dataclass(frozen=True, slots=True)
class Exporter:
    """One row of the table of targets.

    Attributes
    ----------
    name : str
        What `find` and ``--to`` look for.
    use : str
        What it writes, for people.
    suffix : str
        Ending of such a file.
    render : callable
        Writes it.
    docs : str
        The page that tells about it.
    """

    name: str
    use: str
    suffix: str
    render: Render
    docs: str


EXPORTERS: Final[Mapping[str, Exporter]] = {
    row.name: row
    for row in (
        Exporter("adis16480", "registers of the Analog Devices ADIS16480", ".txt", adis16480.render, "registers.md"),
        Exporter("adis16488", "registers of the Analog Devices ADIS16488", ".txt", adis16480.render, "registers.md"),
    )
}
"""By name, in the order they are listed."""


def find(name: str) -> Exporter:
    """Look up a target.

    Raises
    ------
    UsageError
        For one that there is not; names those there are.
    """
    known = EXPORTERS.get(name.strip().casefold())
    if known is None:
        raise UsageError(f"target {name!r} is not known: use one of {', '.join(EXPORTERS)}")
    return known
