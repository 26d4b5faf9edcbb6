"""Units of a magnetic field, and their conversion to microtesla.

Flinders computes in µT if the unit of the recording is known. A recording in raw counts without a
scale stays in ``"counts"``.

>>> Unit.of("mG")
Unit(name='mG', scale=0.1, inside='uT')
>>> Unit.of("counts", scale=0.15)                     # 0.15 µT for each count
Unit(name='counts', scale=0.15, inside='uT')
>>> Unit.of("counts")
Unit(name='counts', scale=1.0, inside='counts')
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from flinders.errors import UnitError

MICROTESLA: Final = "uT"
COUNTS: Final = "counts"

PER_UNIT: Final = {"uT": 1.0, "mG": 0.1, "G": 100.0, "nT": 1e-3, "mT": 1e3, "T": 1e6}
"""Size of each unit in microtesla."""

EARTH_FIELD_RANGE_UT: Final = (22.0, 67.0)
"""Smallest and largest strength of the earth's field at its surface, in µT."""
WIDE_EARTH_FIELD_RANGE_UT: Final = (20.0, 70.0)
"""The same range with a tolerance for readings whose strength is known approximately, in µT."""

_WORDS: Final = {
    "uT": ("microtesla", "utesla", "µtesla", "μtesla"), "mG": ("milligauss", "mgauss"), "G": ("gauss",),
    "nT": ("nanotesla", "ntesla", "gamma"), "mT": ("millitesla", "mtesla"), "T": ("tesla",), "counts": ("count", "lsb"),
}  # fmt: skip
SPELLINGS: Final = {
    "ut": "uT", "µt": "uT", "μt": "uT", "mg": "mG", "g": "G", "gs": "G", "ga": "G", "nt": "nT", "mt": "mT", "t": "T",
    "microt": "uT", "millit": "mT", "nanot": "nT", "微特斯拉": "uT", "微特": "uT", "毫特斯拉": "mT", "毫特": "mT",
    "纳特斯拉": "nT", "纳特": "nT", "特斯拉": "T", "毫高斯": "mG", "高斯": "G", "raw": "counts",
    **{f"{word}{end}": name for name, words in _WORDS.items() for word in words for end in ("", "s", "es")},
}  # fmt: skip
"""Names of units by their lower-case spellings, with both code points of µ."""
SEPARATE_PREFIX: Final = re.compile(r"\b(micro|milli|nano)[\s_-]+(?=tesla|gauss)", re.IGNORECASE)
"""A prefix that is written as a separate word: ``micro Tesla``."""


@dataclass(frozen=True, slots=True)
class Unit:
    """The unit a recording is written in."""

    name: str  #: ``uT``, ``mG``, ``G``, ``nT``, ``mT``, ``T`` or ``counts``
    scale: float  #: size of this unit in the unit `inside`
    inside: str  #: unit in which Flinders computes: ``uT``, or ``counts`` if no scale is known

    @classmethod
    def of(cls, name: str = COUNTS, scale: float | None = None) -> Unit:
        """Find a unit by any of its spellings.

        Raises `UnitError` for a name that is not known, a scale that is not positive, or a scale for a unit other than
        counts.

        Parameters
        ----------
        name : str
            As users and file headers write it: ``µT``, ``uT``, ``mGauss``, ``LSB`` …
        scale : float, optional
            Size of one count in microtesla; only for counts.
        """
        known = SPELLINGS.get(SEPARATE_PREFIX.sub(r"\1", name.strip().casefold()))
        if known is None:
            raise UnitError(f"unit {name!r} is not known: use one of {', '.join((*PER_UNIT, COUNTS))}")
        if scale is not None and not (math.isfinite(scale) and scale > 0):
            raise UnitError(f"scale is {scale:g}: need a positive number of microtesla per count")
        if known == COUNTS:
            return cls(COUNTS, 1.0, COUNTS) if scale is None else cls(COUNTS, float(scale), MICROTESLA)
        if scale is not None:
            raise UnitError(f"{known} has a fixed scale: give a scale only with counts", hint={"scale": None})
        return cls(known, PER_UNIT[known], MICROTESLA)


def unit_label(inside: str) -> str:
    """Printed form of a unit: ``µT`` or ``counts``."""
    return "µT" if inside == MICROTESLA else inside


def earth_field_unit(strength: float) -> str:
    """Unit in which `strength` would be that of the earth's field; empty if there is none.

    >>> earth_field_unit(48.0), earth_field_unit(480.0), earth_field_unit(4.8e-5), earth_field_unit(3.0)
    ('uT', 'mG', 'T', '')
    """
    low, high = WIDE_EARTH_FIELD_RANGE_UT
    return next((name for name, scale in PER_UNIT.items() if low <= strength * scale <= high), "")
