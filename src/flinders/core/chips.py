"""Common magnetometer chips: µT of a count, range, noise, axes and known mistakes, each with its source.

``chips.toml`` beside this module has a table for each chip, and explains its keys. A value without a source is left
out.

>>> chip = find_chip("mpu-9250")
>>> chip.name, chip.axes, [setting.lsb_ut for setting in chip.settings]
('AK8963', 'y,x,-z', [0.6, 0.15])
>>> chip_of_device(0x0D0E09, "ardupilot").name
'QMC5883L'
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

TABLE: Final = Path(__file__).with_name("chips.toml")
DEVICE_TYPE_BIT: Final = 16
"""Lowest of the 8 bits that name the chip in a device id of ArduPilot and PX4."""
MAX_SUGGESTIONS: Final = 3
"""Largest count of names that are suggested for a mistyped one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChipSetting:
    """A gain or range of a chip."""

    name: str  # name of the range, gain or mode
    lsb_ut: float  # µT: size of one count of x and y
    lsb_z_ut: float | None = None  # µT: size of one count of z; None if equal to that of x and y
    range_ut: float | None = None  # µT: largest field; None without a source
    zero: int = 0  # counts: the reading in zero field
    is_usual: bool = False  # whether a driver among the sources selects this setting instead of that after power-on


@dataclass(frozen=True, slots=True, kw_only=True)
class Chip:
    """A magnetometer chip."""

    name: str  # as its maker writes it
    also: tuple[str, ...]  # further spellings, and packages that contain the chip
    maker: str  # name of the manufacturer
    settings: tuple[ChipSetting, ...]  # gains and ranges; the setting after power-on first
    bits: int | None = None  # word length of an axis; None without a source
    noise_ut: float | None = None  # µT: rms noise of one reading; None without a source
    noise_at: str = ""  # setting at which `noise_ut` holds
    axes: str = ""  # mapping of the chip's registers as ``--axes`` takes it; empty if no source states one
    axes_are: str = ""  # description of the mapped axes, such as "right-handed axes"
    traps: tuple[str, ...] = ()  # known mistakes, a sentence each
    sources: tuple[str, ...] = ()  # documents and drivers that state these values
    ardupilot: tuple[int, ...] = ()  # numbers of the chip in device ids of ArduPilot
    px4: tuple[int, ...] = ()  # numbers of the chip in device ids of PX4

    def as_dict(self) -> dict[str, Any]:
        """Attributes by their names, JSON-ready."""
        return asdict(self)

    def __str__(self) -> str:
        return self.name


def chips() -> tuple[Chip, ...]:
    """Return all chips of the table, grouped by manufacturer."""
    return tuple(_table().values())


def find_chip(name: str) -> Chip:
    """Return the chip of a name, or the one in a package of that name.

    Raises `UsageError` for a name that the table lacks.

    Parameters
    ----------
    name : str
        Of a chip or a package: case, hyphens and spaces do not matter.

    Examples
    --------
    >>> find_chip("hmc5883l").settings[0]
    ChipSetting(name='±1.3 G', lsb_ut=0.0917431, lsb_z_ut=None, range_ut=130.0, zero=0, is_usual=False)
    >>> find_chip("HMC5883M")
    Traceback (most recent call last):
    flinders.errors.UsageError: chip 'HMC5883M' is not known: did you mean HMC5883, HMC5883L, MMC5883MA?
    """
    spelled = _spellings()
    found = spelled.get(_letters_and_digits(name))
    if found is None:
        near = get_close_matches(_letters_and_digits(name), spelled, n=MAX_SUGGESTIONS)
        written = [_written_name(spelled[key], key) for key in near]
        remedy = f"did you mean {', '.join(written)}?" if near else "give the name that is printed on the chip itself"
        raise UsageError(f"chip {name!r} is not known: {remedy}")
    return found


def chips_named_in(text: str) -> tuple[Chip, ...]:
    """Return the chips whose names are words of a text, each once.

    >>> [str(chip) for chip in chips_named_in("walk_hmc5883l_x.csv, MPU9250 mag, rm3100x")]
    ['HMC5883L', 'AK8963', 'RM3100']
    >>> chips_named_in("magnetometer 5883")
    ()
    """
    words = _pattern().findall(text.casefold())
    return tuple(dict.fromkeys(_spellings()[_letters_and_digits(word)] for word in words))


def chip_of_device(device_id: int, autopilot: Literal["ardupilot", "px4"]) -> Chip | None:
    """Return the chip that a device id of an autopilot names; None if the table lacks its type."""
    kind = device_id >> DEVICE_TYPE_BIT & 0xFF
    return next((chip for chip in chips() if kind in getattr(chip, autopilot)), None)


@lru_cache(maxsize=1)
def _table() -> Mapping[str, Chip]:
    """Chips by name, in the order of the file."""
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["chip"]
    return {row["name"]: _chip_of(row) for row in rows}


def _chip_of(row: Mapping[str, Any]) -> Chip:
    """Make a chip of its table."""
    lists = {key: tuple(value) for key, value in row.items() if isinstance(value, list)}
    settings = tuple(ChipSetting(**setting) for setting in row["settings"])
    return Chip(**{**row, **lists, "settings": settings})


@lru_cache(maxsize=1)
def _spellings() -> Mapping[str, Chip]:
    """Chips by all their names, in lower case without hyphens."""
    return {_letters_and_digits(name): chip for chip in chips() for name in (chip.name, *chip.also)}


@lru_cache(maxsize=1)
def _pattern() -> re.Pattern[str]:
    """Pattern of the name of a chip in lower case, as a word with or without hyphens.

    The letters of a sensor and of an axis may follow, as in ``mpu9250mx``.
    """
    names = sorted(_spellings(), key=len, reverse=True)
    loose = "|".join(re.sub(r"(?<=[a-z])(?=\d)", "[-_ ]?", name) for name in names)
    return re.compile(rf"(?<![a-z0-9])({loose})(?:[magw]?[xyz]?)(?![a-z0-9])")


def _written_name(chip: Chip, key: str) -> str:
    """Spelling of a chip's name in the table, for the key of that spelling in `_spellings`."""
    return next(name for name in (chip.name, *chip.also) if _letters_and_digits(name) == key)


def _letters_and_digits(name: str) -> str:
    """Write a name in lower case, letters and digits alone."""
    return re.sub(r"[^a-z0-9]", "", name.casefold())
