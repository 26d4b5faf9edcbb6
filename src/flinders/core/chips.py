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
from typing import TYPE_CHECKING, Any, Final, Literal, Self

from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

TABLE: Final = Path(__file__).with_name("chips.toml")
SAME_AXES: Final = "x,y,z"
"""Mapping of a chip whose registers have the stated axes already."""
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

    @property
    def counts_ut(self) -> tuple[float, float | None]:
        """µT of a count of x and y, and of z."""
        return self.lsb_ut, self.lsb_z_ut


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
    axes_in: tuple[str, ...] = ()  # packages with those axes; empty if the axes are of the chip itself
    traps: tuple[str, ...] = ()  # known mistakes, a sentence each
    sources: tuple[str, ...] = ()  # documents and drivers that state these values
    ardupilot: tuple[int, ...] = ()  # numbers of the chip in device ids of ArduPilot
    px4: tuple[int, ...] = ()  # numbers of the chip in device ids of PX4

    def as_dict(self) -> dict[str, Any]:
        """Attributes by their names, JSON-ready."""
        return asdict(self)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class ChipReading:
    """How the readings of a chip are read: the µT of a count, and the mapping of axes.

    >>> reading = ChipReading.of("MPU-9250:16 bits")
    >>> reading.setting.lsb_ut, reading.axes
    (0.15, 'y,x,-z')
    >>> ChipReading.of("RM3100").setting.lsb_ut, ChipReading.of("RM3100").axes
    (0.0133, '')
    """

    name: str  # as it was given: the chip, or a package that holds it
    chip: Chip
    setting: ChipSetting
    axes: str  # mapping as ``--axes`` takes it; empty if the table has none for that name

    @classmethod
    def of(cls, text: str, *, is_in_counts: bool = True) -> Self:
        """Find chip and setting by a text: a name, or a name and a setting, such as ``QMC5883L:8G``.

        A text without a setting means that after power-on. Raises `UsageError` for a chip or setting that the table
        lacks; for readings in counts also for a text without a setting, if drivers select another setting than that
        after power-on.
        """
        name, colon, wanted = (part.strip() for part in text.partition(":"))
        chip = find_chip(name)
        if colon:
            setting = _setting_named(chip, name, wanted)
        elif is_in_counts and _is_set_by_drivers(chip):
            raise UsageError(
                f"a count of {chip} depends on its setting, and drivers select another one than that after power-on: "
                f"name one of {_settings_words(chip)}",
                hint={"chip": f"{name}:{_short_name(chip.settings[-1])}"},
            )
        else:
            setting = chip.settings[0]
        is_for_name = not chip.axes_in or _letters_and_digits(name) in map(_letters_and_digits, chip.axes_in)
        return cls(name, chip, setting, chip.axes if is_for_name else "")

    @property
    def count_words(self) -> str:
        """µT of a count in words, with the setting, and that of z if it differs."""
        setting, z_ut = self.setting, self.setting.lsb_z_ut
        which = "" if setting.name == "fixed" else f", setting {setting.name}"
        which += " as after power-on" if which and setting is self.chip.settings[0] else ""
        z = "" if z_ut is None else f"; z {z_ut:.6g} µT, which only a fit with a matrix corrects"
        return f"{setting.lsb_ut:.6g} µT in a count{which}{z}"

    @property
    def axes_words(self) -> str:
        """Mapping of axes in words, or why there is none."""
        chip = self.chip
        if self.axes == SAME_AXES:
            return f"axes as recorded, which are {chip.axes_are}"
        if self.axes:
            return f"axes {self.axes} for {chip.axes_are}"
        if chip.axes_in:
            return f"axes as recorded: {chip.axes} is for {' or '.join(chip.axes_in)}, which was not named"
        return f"axes as recorded: the table has none for {chip}"


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


def _is_set_by_drivers(chip: Chip) -> bool:
    """Whether drivers select a setting with another count than that after power-on."""
    return any(each.is_usual and each.counts_ut != chip.settings[0].counts_ut for each in chip.settings)


def _setting_named(chip: Chip, name: str, wanted: str) -> ChipSetting:
    """Return the setting of a chip whose name is some text, or begins with it."""
    key = _key_of_setting(wanted)
    named = {each: _key_of_setting(each.name) for each in chip.settings}
    found = [each for each, own in named.items() if own == key] or [
        each for each, own in named.items() if key and own.startswith(key)
    ]
    if len({each.counts_ut for each in found}) != 1:
        problem = "names several settings" if found else "names no setting"
        raise UsageError(
            f"{wanted!r} {problem} of {chip}: use one of {_settings_words(chip)}",
            hint={"chip": f"{name}:{_short_name(chip.settings[0])}"},
        )
    return found[0]


def _settings_words(chip: Chip) -> str:
    """Settings of a chip with different counts, each with its µT."""
    counts = {each.counts_ut: each for each in reversed(chip.settings)}
    return ", ".join(f"{each.name} ({each.lsb_ut:.3g} µT)" for each in reversed(counts.values()))


def _short_name(setting: ChipSetting) -> str:
    """Write the name of a setting in letters, digits and points alone: ``1.3G`` for ±1.3 G."""
    return re.sub(r"[^A-Za-z0-9.]", "", setting.name)


def _key_of_setting(name: str) -> str:
    """Write the name of a setting in lower case, letters, digits and points alone.

    >>> _key_of_setting("±1.3 G"), _key_of_setting("16 bits (CNTL3)")
    ('1.3g', '16bitscntl3')
    """
    return re.sub(r"[^a-z0-9.]", "", name.casefold())


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
