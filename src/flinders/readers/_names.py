"""What names of columns say: which sensor, axis and unit, and which of them are magnetometers of their own.

Names are taken apart into words, so that no list of known headers is needed, and matched without regard to case or to
how badly µ survived the journey.

>>> meaning("magADC[0]")
Meaning(kind='field', axis='0', unit='', rank=0)
>>> meaning("MAGNETIC FIELD Y (î¼T)")
Meaning(kind='field', axis='y', unit='uT', rank=1)
>>> meaning("gyro_z_dps"), meaning("Time (s)").unit, meaning("mag_x_cal").rank > meaning("mag_x").rank
(Meaning(kind='rate', axis='z', unit='dps', rank=1), 's', True)

A table may hold ``mag1_x`` and ``mag2_x``, two instruments, or ``mag_raw_x`` and ``mag_cal_x``, one before and after
its calibration. What is left of a name without axis, unit and the words that every magnetometer has tells them apart:
numbers (``imu2.mag.x``), places (``mag_left_x``), chips (``rm3100_x``), a device (``imu_mx``) and letters in a row
(``mag_a_x``, ``mag_b_x``) are instruments. Any other word, such as ``filtered``, is the same instrument again: of that
the rawest is taken, and of equals the one with the plainest name. A reference, ``mag_ref_x``, is no instrument at all.

>>> def names(*sensors):
...     return [each.name for each in magnetometers([f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"])]
>>> names("mag1", "mag2", "mag2_cal"), names("mag", "mag_raw", "mag_ned"), names("mag_left", "mag_right")
(['mag1', 'mag2'], ['mag'], ['mag_left', 'mag_right'])
>>> names("mag", "imu_mag"), names("lis3mdl", "mpu6050", "rm3100_raw"), names("mag", "mag_lis3mdl_cal")
(['mag', 'imu_mag'], ['lis3mdl', 'rm3100'], ['mag'])
>>> names("mag_ref", "mag"), names("mag_filtered", "mag_main"), names("mag_t0", "mag_t1"), names("b", "m")
(['mag'], ['mag_main'], ['mag_t0'], ['m'])
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.core.units import PARTED, SPELLINGS
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

FIELD: Final = "field"
ACCELERATION: Final = "acceleration"
RATE: Final = "rate"
TIME: Final = "time"
TEMPERATURE: Final = "temperature"
CURRENT: Final = "current"
STRENGTH: Final = "strength"
THROTTLE: Final = "throttle"
ATTITUDE: Final = "attitude"
CURRENTS: Final = "currents"
THROTTLES: Final = "throttles"

_DEGREES = math.pi / 180

_OF_A_FIELD: Final = {name: 1.0 for name in SPELLINGS if name != "raw"}
# Spellings of units in names, and the factor to seconds, rad/s, °C and A; a field is scaled by `Unit`.
FACTORS: Final[dict[str, dict[str, float]]] = {
    FIELD: _OF_A_FIELD,
    ACCELERATION: dict.fromkeys(("m/s2", "m/s²", "m/s^2", "mps2", "ms2", "ms-2", "m/s/s", "m/sec2", "g", "mg"), 1.0),
    RATE: {
        **dict.fromkeys(("rad/s", "radps", "rads", "rad/sec", "rad/s/s", "radian/s", "radians/s", "radians/sec"), 1.0),
        **dict.fromkeys(("deg/s", "deg/sec", "degree/s", "degrees/s", "degrees/sec", "dps", "degps", "degs"), _DEGREES),
        **dict.fromkeys(("°/s", "º/s", "/s", "°/sec"), _DEGREES),
        "mdps": _DEGREES / 1000,
    },
    TIME: {
        **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), 1e-3),
        **dict.fromkeys(("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"), 1e-6),
        **dict.fromkeys(("ns", "nsec", "nanos", "nanosecond", "nanoseconds"), 1e-9),
    },
    TEMPERATURE: dict.fromkeys(("c", "°c", "ºc", "℃", "°", "º", "degc", "celsius"), 1.0),
    CURRENT: {**dict.fromkeys(("a", "amp", "amps", "ampere", "amperes"), 1.0), "ma": 1e-3},
    STRENGTH: _OF_A_FIELD,
}
_UNITS: Final = frozenset(unit for units in FACTORS.values() for unit in units)
_UNITS_OF_AXES: Final = frozenset(unit for kind in (FIELD, ACCELERATION, RATE) for unit in FACTORS[kind])
# Sensors that go by a letter or a few, as in ``mx``, ``B_x`` or ``geo_x``, and the letters that may follow the name of
# a device, as in ``imu_mx``; a ``b`` there is a bias or the second one.
_LETTERS: Final = {
    "m": FIELD, "h": FIELD, "b": FIELD, "mf": FIELD, "geo": FIELD, "a": ACCELERATION, "g": RATE, "w": RATE,
}  # fmt: skip
_LETTERS_OF_A_DEVICE: Final = "magw"
# Chips by what they measure; the last have several sensors, magnetometers or not: their name alone does not tell.
_CHIPS: Final = {
    FIELD: (
        r"lis[23]mdl|[hq]mc5[89]83[lp]?|mmc(?:34160|5603|5633|5983)(?:pj|njl?|ma)?|rm[23]100|ist83\d\d[a-z]?"
        r"|ak(?:89[67][35]|099\d\d)c?|bmm[13]50|mag3110|tl[ve]493d|mlx90393|fxms3110"
    ),
    ACCELERATION: r"adxl\d{3}|lis3dh|lis2dh12|lis331dlh|mma845\d|bma\d{3}",
    RATE: r"l3gd20h?|l3g4200d|itg3\d{3}|fxas21002c?|bmg\d{3}",
    "": (
        r"mpu[69]\d{3}|icm[24]\d{4}|lsm6ds(?:3|3tr|33|l|m|o|ox|r|v|v16x)|lsm9ds[01]|lsm303(?:agr|c|d|dlh|dlhc|dlm)?"
        r"|bmi\d{3}|[ai]sm330(?:dhcx|dlc|lhhx?|is)?|iim4\d{4}|qmi8658c?|fxos8700|bno0[58]\d|bmx(?:055|160)|adis16\d{3}"
    ),
}
# The name of a chip, with a number, letter and axis that nothing parts from it: ``rm3100x``.
_CHIP: Final = re.compile(rf"({'|'.join(_CHIPS.values())})(\d?)([{_LETTERS_OF_A_DEVICE}]?)([xyz]?)")
# Devices of several sensors, and places: words that tell a magnetometer from others.
_DEVICES: Final = frozenset(("imu", "ahrs", "ins"))
PLACES: Final = frozenset(
    (
        "left", "right", "front", "rear", "back", "fore", "aft", "bow", "stern", "port", "starboard", "top", "bottom",
        "upper", "lower", "inner", "outer", "int", "ext", "internal", "external", "main", "aux", "primary", "secondary",
        "backup", "master", "slave", "first", "second", "third",
    )
)  # fmt: skip
# Words of columns that stand beside readings and are none.
_OTHERS: Final = re.compile(
    r"(cov|std|sigma|var|offset|ofs|bias|abs|norm|total|magnitude|heading|health|accuracy|gain|scale$|quality|err)"
)
# Words of columns that are no sensor's with three axes, whatever their values are.
_ELSEWHERE: Final = re.compile(
    r"(lat|lon|lng|alt|gps|gnss|pos|vel|speed|course|roll|pitch|yaw|euler|baro|press|volt|batt|vbat|pwm|servo|rc$|hum"
    r"|light|lux|prox|step|index|seq|count|loop|sat|[hv]dop|rssi|status|flag|modes?$)"
)
# Where a strength comes from that is no length of the readings, and what it is called besides; not ``h``, which is the
# horizontal part in geomagnetism.
_REFERENCES: Final = frozenset(("reference", "ref", "igrf", "wmm"))
_STRENGTHS: Final = frozenset(("field", "strength", "total", "intensity", "f"))
_CORRECTED: Final = "cal|calib|calibrated|cald|corr|corrected|comp|compensated|filt|filter|filtered"
_SMOOTHED: Final = (  # a number after one is its own, as in ``avg10``, and not that of a sensor
    "lp|lpf|hp|hpf|bp|bpf|ema|sma|avg|average|averaged|mean|median|smooth|smoothed|prev|previous|kalman|decimated"
)
_CALIBRATED: Final = re.compile(rf"({_CORRECTED})$")
_DERIVED: Final = re.compile(rf"({_CORRECTED}|({_SMOOTHED})\d*)$")
# Words of three columns that are none of a sensor's readings, and what they are instead.
_NO_READINGS: Final = {
    **dict.fromkeys((*_REFERENCES, "model", "true", "truth", "expected", "predicted"), "a reference"),
    **dict.fromkeys(("ned", "enu", "nwu", "ecef", "earth", "world"), "in axes of the earth"),
    **dict.fromkeys(("dir", "direction"), "a direction"),
    **dict.fromkeys(("min", "max", "diff", "delta", "status", "innov", "innovation", "residual"), "no readings"),
}
# Such a word that nothing parts from the sensor's: ``magref``.
_GLUED: Final = re.compile(rf"(mag|acc|gyro)(raw|{_CORRECTED}|{_SMOOTHED}|unit|{'|'.join(_NO_READINGS)})([xyz]?)")
# Numbers that are not those of a sensor: of bits, of steps in time, of a filter, of a version.
_MEASURES: Final = re.compile(
    rf"\b(u?int (8|16|24|32|64)|float (32|64)|({_SMOOTHED}|t|v|ver|version|k|order|lag) \d+|\d+ (bits?|hz|ms))\b"
)
_RAW: Final = re.compile(r"(raw|adc|.*uncal(ib|ibrated)?)$")
# Words of what a sensor reads, where a model's field stands beside it.
_MEASURED: Final = "meas|measured|observed|obs"
_SENSED: Final = re.compile(rf"(sensors?|magnetometers?|compass|measurement|{_MEASURED})$")
_TIMES: Final = re.compile(
    r"(t[st]?|time.*|.*time|stamp|seconds|millis|micros|epoch|elapsed|zeit|temps|tiempo|时间|時間)$"
)
_CLOCKS: Final = re.compile(r"(dates?|day|datum|clock|utc|gmt|uhr.*|heure|hora|fecha|when)$")  # a time, or not
_BEGUN: Final = re.compile(r"offset[\s_]?(?=time\b)", re.IGNORECASE)  # a time since the beginning: ``offsetTime``
_NUMBERED: Final = re.compile(r"field[\s_]?\d+", re.IGNORECASE)  # of any quantity, as ThingSpeak has them
_NO_TIMES: Final = re.compile(r"(day|date|zone|fix|offset|gps|time_of_day)$")
# Words that any such sensor may have in its name.
_COMMON: Final = re.compile(
    r"(mag.*|flux.*|compass|acc.*|gyr.*|angular|velocity|linear|axis|field|strength|vector|imu|ahrs|ins|sensor|dev|device|unit|node"
    r"|board|module|no|nr|num|id|instance|ch|channel|data|value|reading|measurement)$"
)
_BETWEEN: Final = r"\s_.,:;%#\-\[\](){}'\""  # what parts the words of a name
_ATTACHED: Final = re.compile(
    r"(mag(?:n|net|netic|netometer|netom|adc|raw|field)?|acc(?:el|l|elero|eleration|elerometer)?|gyro?(?:scope|adc)?"
    r"|compass|[mhbagw]|mf|geo)([xyz])"
)
_AXIS_BEFORE: Final = re.compile(r"([xyz])(mag|acc|gyro|mf)")
_SEPARATORS: Final = re.compile(rf"[{_BETWEEN}]+")
_PIECES: Final = re.compile(rf"([{_BETWEEN}]*)([^{_BETWEEN}]+)")  # words, each with what is before it
_IN: Final = re.compile(r"(?<![^\W_])in[\s_]+(?=[^\s_()\[\]]+\s*[)\]]?\s*$)", re.IGNORECASE)  # before a unit at the end
_IN_BRACKETS: Final = re.compile(r"[(\[]([^)\]]*)[)\]]?\s*$")  # a unit, or the number of an axis
_BRACKET: Final = re.compile(r"\s*[(\[](?!\d+[)\]])[^)\]]*[)\]]?\s*$")
_OF_A_DIRECTION: Final = re.compile("unit|vec|field|mag|acc")
# Words and numbers that nothing parts: ``magX1`` has three.
_PARTS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\x00-\x7f]+")
_BROKEN_MICRO: Final = re.compile(r"(?:[^\x00-\x7f]+|i|\?)t")  # µT whose bytes were decoded as something else
CALIBRATED: Final = 10  # rank from which on readings were corrected already
BARE: Final = 2  # clearness of ``x``, ``y``, ``z``, which may be a position where something else is a magnetometer
# Columns that are known by their whole name only, as `flinders.simulate.recording` writes them: a ``throttle`` may be
# per cent or microseconds, and an attitude that of any axes.
_WRITTEN_HERE: Final = {
    "throttle_share": (THROTTLE, ""),
    **{f"{ATTITUDE}_{axis}": (ATTITUDE, axis) for axis in "wxyz"},
}
# Spellings of units in the names of single motors' columns, and the factor to A and shares; none of pulses in µs.
FACTORS_OF_MOTORS: Final[dict[str, dict[str, float]]] = {
    CURRENTS: {"": 1.0, "a": 1.0, "ma": 1e-3},
    THROTTLES: {"share": 1.0, "percent": 0.01, "pct": 0.01, "%": 0.01, "": 1e-3, "us": 1e-3, "µs": 1e-3},
}
# Columns of single motors, by their whole name: which motor, and in which unit.
_OF_MOTOR: Final = {
    CURRENTS: re.compile(
        r"(?:(?:esc|motor|mot|m)[ _.]?\[?(\d{1,2})\]?[ _.](?:esc[ _])?(?:current|curr|amps?)"
        r"|(?:(?:esc|motor)[ _.])?(?:current|curr)[ _.]?\[?(\d{1,2})\]?)(?:[ _]?[(\[]?(a|ma)[)\]]?)?"
    ),
    THROTTLES: re.compile(
        r"(?:(?:throttle|motor)[ _.]?\[?(\d{1,2})\]?|(?:motor|esc)[ _.]?\[?(\d{1,2})\]?[ _.](?:throttle|pwm))"
        r"(?:[ _]?[(\[]?(share|percent|pct|%|us|µs)[)\]]?)?"
    ),
}


FEW: Final = 10  # a bare number from here on is a sensor's where its neighbour is there: they count from 0 or 1 on
LONGEST: Final = 9  # digits of a number; what is longer is a word


class Meaning(NamedTuple):
    """What a name says."""

    kind: str  # one of those above, or nothing
    axis: str = ""  # x, y or z, of an attitude also w; 0 to 3 where axes are counted; the number of a motor; or nothing
    unit: str = ""  # as found in `FACTORS`; that of a field or a strength as `Unit` calls it; or nothing
    rank: int = 0  # which to take where there are several: the smallest

    @property
    def is_bare(self) -> bool:
        """It is an axis and nothing else: a field's, or that of something else."""
        return self.kind == FIELD and not self.unit and clearness(self.rank) >= BARE


def clearness(rank: int) -> int:
    """Tell how plainly a name says that it is a magnetometer's: ``mag_x``, then ``mx``, then ``x``."""
    return rank % CALIBRATED // 2


@lru_cache(maxsize=1_024)
def meaning(name: str) -> Meaning:
    """Meaning of a column name; its kind is empty where nothing is recognised."""
    if written := _WRITTEN_HERE.get(name.strip().casefold()):
        return Meaning(*written)
    for kind, pattern in _OF_MOTOR.items():
        if match := pattern.fullmatch(name.strip().casefold()):
            return Meaning(kind, match[1] or match[2], match[3] or "")
    words, units = _words(name)
    folded = [word.casefold() for word in words]
    if (not folded and not units) or _NUMBERED.fullmatch(name.strip()):
        return Meaning("")
    if _is_strength(folded, units):
        return Meaning(STRENGTH, "", _unit(STRENGTH, units))
    sensor, axis = _without_axis(folded)
    if any(_OTHERS.match(word) for word in sensor):
        return Meaning("")
    is_joined = len(sensor) == len(folded)  # the axis was no word of its own
    kind, rank = _vector(sensor, units, is_joined=is_joined) if axis else _scalar(sensor, units)
    if kind == FIELD and axis and any(_DERIVED.match(word.casefold()) for word in (*sensor, *units)):
        rank += CALIBRATED
    return Meaning(kind, axis, _unit(kind, units), rank)


def tells_nothing(name: str) -> bool:
    """Tell whether a name leaves open what a column is, so that it may be an axis of a magnetometer."""
    known, words = meaning(name), [word.casefold() for word in _words(name)[0]]
    is_other = any(_ELSEWHERE.match(word) or _OTHERS.match(word) for word in words)
    return known.is_bare or not (known.kind or is_other)


def is_like_time(name: str) -> bool:
    """Tell whether a column is called as times are.

    >>> [is_like_time(name) for name in ("timestamp", "UTC", "Date", "mx")]
    [True, True, True, False]
    """
    return meaning(name).kind == TIME or any(_CLOCKS.match(word.casefold()) for word in _words(name)[0])


def is_letter_of_time(name: str) -> bool:
    """Tell whether the only sign that a column is a time is a ``T``, which a temperature has too.

    >>> [is_letter_of_time(name) for name in ("T", "t_raw", "T_r", "t_ms", "time", "T_C")]
    [True, True, True, False, False, False]
    """
    words = [word.casefold() for word in _words(name)[0]]
    return meaning(name)[::2] == (TIME, "") and list(filter(_TIMES.match, words)) == ["t"]


def words_of(name: str) -> list[str]:
    """Take a name apart into its words, without a unit.

    >>> words_of("deviceID"), words_of("MAC address"), words_of("node_2 (uT)")
    (['device', 'ID'], ['MAC', 'address'], ['node', '2'])
    """
    return _words(name)[0]


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit and nothing else, as in a row of units below a header."""
    return _IN.sub("", PARTED.sub(r"\1", text)).casefold() in _UNITS


@lru_cache(maxsize=1_024)
def field_stem(name: str, axis: str) -> str:
    """Take the axis out of a name, so that the three columns of one sensor are left with the same text."""
    folded = name.strip().casefold()
    place = _place_of_axis(folded, axis)
    return f"{folded[:place]}*{folded[place + 1 :]}"


@lru_cache(maxsize=1_024)
def label(name: str) -> tuple[str, ...]:
    """Take the words of a three-axis sensor's column that distinguish it from others of its kind."""
    words = _words_of_sensor(name)
    has_kind = any(_kind_of_word(word) or kind_of_chip(word) for word in words)
    plain = (_COMMON, _RAW, _DERIVED, _SENSED)
    measured = _MEASURES.sub(lambda match: match[0].replace(" ", ""), " ".join(words)).split()
    apart = [word for word in measured if is_chip(word) or not any(pattern.match(word) for pattern in plain)]
    own = tuple(word for word in apart if has_kind or word not in _LETTERS)
    return own or tuple(word for word in words if word in _DEVICES)


def is_chip(word: str) -> bool:
    """Tell whether a word in lower case is the name of a known chip."""
    return bool((chip := _CHIP.fullmatch(word)) and chip[1] == word)


def kind_of_chip(word: str) -> str:
    """Tell what a chip measures, where that is one thing."""
    return next((kind for kind, pattern in _CHIPS.items() if re.fullmatch(pattern, word)), "")


def tells_apart(word: str) -> bool:
    """Tell whether a word other than a number names one of several sensors: a place, a chip, a device."""
    return word in PLACES or word in _DEVICES or is_chip(word)


def tells_readings_apart(word: str) -> bool:
    """Tell whether a word in lower case says which of several readings these are, or what was done to them."""
    return bool(tells_apart(word) or _RAW.match(word) or _DERIVED.match(word))


@lru_cache(maxsize=1_024)
def no_readings(name: str) -> str:
    """Tell what a three-axis column is where it is none of a sensor's readings; nothing where it may be one."""
    words = _words_of_sensor(name)
    if "main field" in " ".join(words):  # that of the core of the earth
        return "a reference"
    if "unit" in words and all(map(_OF_A_DIRECTION.match, words)):  # no unit of a device
        return "a direction"
    return next((_NO_READINGS[word] for word in words if word in _NO_READINGS), "")


@lru_cache(maxsize=1_024)
def sensor_name(name: str, axis: str, *, whole: bool = False) -> str:
    """Name the sensor of a column: without axis, unit, ``raw`` and the like; if `whole`, without the axis alone."""
    bare = name.strip() if whole else _BRACKET.sub("", name.strip())
    place = _place_of_axis(bare.casefold(), axis)
    pieces = _PIECES.findall(f"{bare[:place]}{bare[place + 1 :]}")
    own = ""
    for number, (between, piece) in enumerate(pieces):
        folded = piece.casefold()
        is_common = (number and folded in _UNITS_OF_AXES) or _RAW.match(folded) or _DERIVED.match(folded)
        if whole or not is_common:
            own += (between[-1:] if between[-1:] in " _.-" else "_") + piece
    bare_name = own.lstrip(" _.-")
    return bare_name if any(map(str.isalpha, bare_name)) else f"xyz{bare_name}"


def _words_of_sensor(name: str) -> list[str]:
    """Take a three-axis column's name apart, without axis and unit, in lower case."""
    words, units = _words(name)
    foreign = [unit for unit in units if unit.casefold() not in _UNITS_OF_AXES]
    return _without_axis([word.casefold() for word in words + foreign])[0]


def _place_of_axis(folded: str, axis: str) -> int:
    """Find the letter or digit of the axis in a name: the last that stands by itself, else the last."""
    places = [match.start() for match in re.finditer(axis, folded)]
    around = {place: folded[max(place - 1, 0) : place] + folded[place + 1 : place + 2] for place in places}
    alone = [place for place in places if not any(map(str.isalpha, around[place]))]
    return max(alone or places, default=0)


def _words(name: str) -> tuple[list[str], list[str]]:
    """Take a name apart into its words and, in the order of trust, the units it may state."""
    units = []
    name = _BEGUN.sub("", _IN.sub("", PARTED.sub(r"\1", name)))
    inside = _IN_BRACKETS.search(name)
    if inside and not inside[1].strip().isdigit():
        units.append(inside[1].strip())
        name = name[: inside.start()]
    words: list[str] = []
    for piece in _SEPARATORS.split(name):
        if piece.casefold() in _UNITS and (words or piece.casefold() in FACTORS[TIME]):
            units.append(piece)
        else:
            chip = _CHIP.fullmatch(piece.casefold())
            parts = [chip[1], chip[2], chip[3] + chip[4]] if chip else _PARTS.findall(piece)
            if len(parts) > 1 and parts[0].casefold() == "time" and parts[-1].casefold() in FACTORS[TIME]:
                units.append(parts.pop())
            elif len(parts) > 2 and (unit := "".join(parts[-2:])).casefold() in SPELLINGS:  # ``magXMicroT``
                units.append(unit)
                parts = parts[:-2]
            for part in parts:
                glued = _GLUED.fullmatch(part.casefold())
                words += filter(None, glued.groups() if glued else [part])
    return words, units


def _without_axis(words: list[str]) -> tuple[list[str], str]:
    """Find the axis in a name's words: a word of its own, the end or start of one, or a small number."""
    letters = [word for word in words if word in {"x", "y", "z"}]
    if len(letters) == 1:
        return [word for word in words if word != letters[0]], letters[0]
    for place, word in enumerate(words):
        if attached := _ATTACHED.fullmatch(word):
            return [*words[:place], attached[1], *words[place + 1 :]], attached[2]
        if ahead := _AXIS_BEFORE.fullmatch(word):
            return [*words[:place], ahead[2], *words[place + 1 :]], ahead[1]
    if len(words) > 1 and words[-1] in {"0", "1", "2", "3"} and not all(map(str.isdigit, words)):
        return words[:-1], words[-1]
    return words, ""


def _vector(words: list[str], units: list[str], *, is_joined: bool) -> tuple[str, int]:
    """Tell which three-axis sensor the words name, and how good a source of its raw readings this is."""
    raw = 0 if any(_RAW.match(word) for word in words) else 1
    names = [word for word in words if not word.isdigit()]
    kinds = [kind for word in names if (kind := _kind_of_word(word))] or list(filter(None, map(kind_of_chip, names)))
    if kinds:
        return kinds[0], raw + 5 * (kinds[0] == ACCELERATION and "linear" in words)
    aside = [word for word in names if _SENSED.match(word) or word in _NO_READINGS]
    others = {"axis", *aside}
    bare = [word for word in names if not (_RAW.match(word) or _CALIBRATED.match(word) or word in others)]
    if aside and not bare:
        return (FIELD, raw + 2) if all(word in _MEASURED.split("|") for word in aside) else ("", 0)
    own = [word for word in bare if not (tells_apart(word) or _COMMON.match(word))]
    is_of_device = len(own) == 1 and own[0] in _LETTERS_OF_A_DEVICE and (is_joined or any(map(is_chip, bare)))
    if is_of_device or (len(bare) == 1 and bare[0] in _LETTERS):
        return _LETTERS[own[0]], raw + 2
    if bare in (["field"], ["field", "strength"]):
        return FIELD, raw + 2
    return (_plain(units), raw + 4) if not bare else ("", 0)


def _kind_of_word(word: str) -> str:
    """Tell which three-axis sensor a word names."""
    if word.startswith(("mag", "flux")) or word == "compass":
        return FIELD
    return ACCELERATION if word.startswith("acc") else RATE if word.startswith(("gyr", "angular")) else ""


def _plain(units: list[str]) -> str:
    """Tell what a name that is only an axis may be: a field, unless its unit is that of something else."""
    for unit in units:
        if unit in {"g", "mg"}:  # lower case: of gravity
            return ACCELERATION
        for kind in (RATE, ACCELERATION):
            if unit.casefold() in FACTORS[kind] and unit.casefold() not in FACTORS[FIELD]:
                return kind
    return FIELD if not units or _unit(FIELD, units) else ""


def _scalar(words: list[str], units: list[str]) -> tuple[str, int]:
    """Tell which sensor without axes, or clock, the words name, and how good a source of it this is."""
    is_warm = words == ["t"] and any(unit.casefold() in FACTORS[TEMPERATURE] for unit in units)  # T = 23.4 C
    if is_warm or (any(word.startswith(("temp", "tmp")) for word in words) and words != ["temps"]):
        return TEMPERATURE, 0
    if any(word in {"curr", "current", "amps", "amp", "ampere"} for word in words):
        return CURRENT, 0
    is_of_week = "tow" in words or {"time", "week"} <= set(words)
    if any(_NO_TIMES.match(word) for word in words) and not is_of_week:
        return "", 0
    timed = is_of_week or any(_TIMES.match(word) for word in words)
    alone = not words and all(unit.casefold() in FACTORS[TIME] for unit in units)
    return (TIME, 0 if _unit(TIME, units) else 1) if timed or alone or (units and "elapsed" in words) else ("", 0)


def _is_strength(words: list[str], units: list[str]) -> bool:
    """Tell whether a name is that of a strength known from elsewhere: where from, what, and nothing besides."""
    named = {word for word in words if not word.isdigit()}
    if not named & _REFERENCES or not named <= _REFERENCES | _STRENGTHS:
        return False
    return bool(named & _STRENGTHS or _unit(STRENGTH, units))


def unit_of_field(name: str) -> str:
    """The unit that the name of a column states for a field; not a ``g``, which is that of gravity.

    >>> unit_of_field("磁场X(uT)"), unit_of_field("v1 [nT]"), unit_of_field("v1 (mg)"), unit_of_field("v1")
    ('uT', 'nT', '', '')
    """
    return _unit(FIELD, [unit for unit in _words(name)[1] if unit not in {"g", "mg"}])


def unit_of_strength(name: str) -> str:
    """The unit that the name of a column states for a strength of the field; nothing where it states none.

    >>> unit_of_strength("MAG_4_UNCOMP [nT]"), unit_of_strength("scalar")
    ('nT', '')
    """
    return _unit(STRENGTH, _words(name)[1])


def _unit(kind: str, units: list[str]) -> str:
    """Pick the unit that this kind of column can have, in the spelling of `FACTORS` or, for a field, of `Unit`."""
    for unit in units:
        folded = unit.casefold()
        if kind in (FIELD, STRENGTH) and folded != "raw":
            known = SPELLINGS.get(folded) or ("uT" if _BROKEN_MICRO.fullmatch(folded) else "")
            if known and not (known == "T" and unit == "t"):
                return known
        elif kind == RATE and folded.encode("ascii", "ignore") == b"/s":
            return "°/s"
        elif folded in FACTORS.get(kind, {}):
            return folded
    return ""


class Vector(NamedTuple):
    """Three columns of one sensor."""

    cells: tuple[int, ...]  # their places: x, y, z
    rank: int  # as in `Meaning`
    label: tuple[str, ...]  # words of their names that are not those of any such sensor
    name: str  # what they are called, without axis and unit
    whole: str = ""  # the same with ``raw``, ``filtered`` and the unit: tells it from a copy of its readings
    instead: str = ""  # what they are, such as ``a reference``, where they are not a sensor's readings

    @property
    def number(self) -> tuple[str, ...]:
        """The numbers and places of its label; all of it where it has none."""
        return tuple(word for word in self.label if _is_number(word) or tells_apart(word)) or self.label


def vectors(names: Sequence[str], meanings: Sequence[Meaning], kind: str) -> list[Vector]:
    """Find the columns of a kind that make three axes, in the order of the first; a name may stand there again."""
    sensors: dict[tuple[str, int], dict[str, int]] = defaultdict(dict)
    times: Counter[str] = Counter()
    for place, known in enumerate(meanings):
        if known.kind == kind and known.axis:
            name = names[place].strip().casefold()
            times[name] += 1
            sensors[field_stem(name, known.axis), times[name]][known.axis] = place
    for axis, place in [each for axes in sensors.values() if not _letters(axes) for each in axes.items()]:
        sensors["".join(_words_of_sensor(names[place])), 1].setdefault(axis, place)
    made = []
    for (_, time), axes in sensors.items():
        letters = _letters(axes)
        if letters:
            cells = tuple(axes[letter] for letter in letters)
            first, again = names[cells[0]], (str(time),) if time > 1 else ()
            name, whole = (" ".join((sensor_name(first, letters[0], whole=each), *again)) for each in (False, True))
            marks = (*label(first), *again)
            made.append(Vector(cells, meanings[cells[0]].rank, marks, name, whole, no_readings(first)))
    return sorted(made, key=lambda vector: min(vector.cells))


def _letters(axes: Iterable[str]) -> str:
    """The three of these that are the axes of a sensor; nothing where one is missing."""
    return next((letters for letters in ("xyz", "012", "123") if set(letters) <= set(axes)), "")


SET: Final = re.compile(r"_?(?<![a-zA-Z])(?:set|SET)(?![a-zA-Z])_?|_?Set(?![a-z])_?")
"""What a name has of a reading after a set pulse; that after a reset pulse has ``reset`` in its place."""


def polarities(names: Sequence[str]) -> dict[int, int]:
    """Places of readings after a set pulse, each with that of the same axis after a reset pulse.

    >>> polarities(["t", "mag_x_set", "mag_x_reset", "setpoint_x"]), polarities(["xReset", "xSet"])
    ({1: 2}, {1: 0})
    """
    places = {name.strip().casefold(): place for place, name in enumerate(names)}
    others = ((place, SET.sub(_reset, name.strip()).casefold()) for place, name in enumerate(names) if SET.search(name))
    return {place: places[other] for place, other in others if other in places}


def without_set(name: str) -> str:
    """A name without the word of the pulse.

    >>> without_set("mx_set_uT"), without_set("mag_x_set"), without_set("xSet"), without_set("Set X")
    ('mx_uT', 'mag_x', 'x', ' X')
    """
    return SET.sub(lambda match: "_" if len(match[0].strip("_")) == len(match[0]) - 2 else "", name)


def _reset(match: re.Match[str]) -> str:
    """The word of a set pulse as that of a reset."""
    return re.sub("set", "reset", match[0], flags=re.IGNORECASE)


def names_magnetometer(names: Sequence[str]) -> bool:
    """Tell whether three of these names are those of a magnetometer."""
    return bool(vectors(names, list(map(meaning, names)), FIELD))


def magnetometers(names: Sequence[str]) -> tuple[Vector, ...]:
    """Find the magnetometers of their own among the columns of these names."""
    return instruments(vectors(names, list(map(meaning, names)), FIELD))


def instruments(sensors: Sequence[Vector]) -> tuple[Vector, ...]:
    """Pick those that are magnetometers of their own, of each the rawest, in the order of their columns.

    Those that were corrected or filtered come last. Just the best, by `_quality`, where it is not clear that there are
    several; none without readings.
    """
    readings = [vector for vector in sensors if not vector.instead]
    if any(_manner(vector) == 0 and vector.rank < CALIBRATED for vector in readings):
        readings = [vector for vector in readings if vector.label or _manner(vector) < 2]  # a model's field beside it
    readings = [vector for vector in readings if clearness(vector.rank) < BARE] or readings
    if not readings:
        return ()
    kinds: dict[tuple[str, ...], Vector] = {}
    for vector in sorted(readings, key=_quality):
        kinds.setdefault(vector.label, vector)
    rawer = [kind for kind in kinds.values() if kind.rank < CALIBRATED]
    several = _told_apart([kind for kind in kinds.values() if not _is_copy(kind, rawer)])
    ordered = sorted(several, key=lambda vector: (vector.rank >= CALIBRATED, min(vector.cells)))
    return tuple(ordered) or (min(readings, key=_quality),)


def passed_over(sensors: Sequence[Vector], fields: Sequence[Vector]) -> tuple[str, ...]:
    """Name those that are as plainly a magnetometer's as those taken, and what they are where that is clear."""
    least = max(BARE - 1, max((clearness(each.rank) for each in fields), default=0))
    others = [each for each in sensors if each not in fields and clearness(each.rank) <= least]
    kinds = [(each.whole, each.instead or "corrected or filtered" * (each.rank >= CALIBRATED)) for each in others]
    return tuple(f"{whole} ({what})" if what else whole for whole, what in kinds)


def companion(sensors: Sequence[Vector], field: Vector, fields: Sequence[Vector]) -> Vector | None:
    """Pick the accelerometer or gyro that goes with a magnetometer: the best of its number, or with no other's number.

    Where there is one magnetometer all go with it. What is no readings, such as ``acc_ned_x``, is not taken.
    """
    readings = [each for each in sensors if not each.instead]
    if len(fields) < 2:
        return min(readings, key=_quality, default=None)
    numbers = {other.number for other in fields}
    fitting = [each for each in readings if each.number == field.number or each.number not in numbers]
    return min(fitting, key=lambda each: (each.number != field.number, *_quality(each)), default=None)


def _told_apart(sensors: Sequence[Vector]) -> list[Vector]:
    """Pick two or more whose labels are numbers, places or nothing; else letters or type numbers, if all are."""
    shared = set.intersection(*(set(each.label) for each in sensors)) if sensors else set()
    rest = [(each, [word for word in each.label if word not in shared]) for each in sensors]
    numbers = {int(word) for _, words in rest for word in words if _is_number(word)}

    folders = {each.name.partition(".")[0] for each in sensors}  # ``1423.Magnetometer``

    def counts(word: str) -> bool:
        is_sensors = bool(shared) or word in folders
        return tells_apart(word) or (_is_number(word) and (is_sensors or _is_one_of(numbers, int(word))))

    counted = [each for each, words in rest if all(map(counts, words))]
    if len(counted) > 1:
        return counted
    is_lettered = _in_a_row(words[0] if len(words) == 1 else "" for _, words in rest)
    is_typed = all(any(map(_is_number, words)) and not _is_number(words[0]) for _, words in rest if words)
    has_words = len(rest) > 1 and all(words for _, words in rest)
    return list(sensors) if has_words and (is_lettered or is_typed) else []


def _in_a_row(letters: Iterable[str]) -> bool:
    """Tell whether these are letters in a row, such as a, b, c, or left and right."""
    together = "".join(sorted(letters))
    return together == "lr" or (len(together) > 1 and together in "abcdefgh")


def _is_number(word: str) -> bool:
    """Tell whether a word is a number of usual length."""
    return word.isdecimal() and len(word) <= LONGEST


def _is_one_of(numbers: set[int], number: int) -> bool:
    """Tell whether a number is that of a sensor: a small one, or one in a row."""
    return number < FEW or bool(numbers & {number - 1, number + 1})


def _is_copy(one: Vector, rawer: Sequence[Vector]) -> bool:
    """Tell whether corrected or filtered readings are those of a rawer one: named after it, or in another way than all.

    Beside ``mag2`` a ``mag1_cal`` is another magnetometer; ``mag2_cal`` is not, nor is ``mag_cal``.
    """
    if one.rank < CALIBRATED or not rawer:
        return False
    manner = set(map(_is_number, one.label))  # by numbers, by words, by both or not at all
    is_named_after = any(set(other.label) <= set(one.label) for other in rawer)
    return is_named_after or all(set(map(_is_number, other.label)) != manner for other in rawer)


def _manner(vector: Vector) -> int:
    """0 where a name tells of a sensor, 2 of a field, which a model may give too, 1 of neither."""
    words = [word.casefold() for word in _words(vector.whole)[0]]
    if any(_SENSED.match(word) or _RAW.match(word) or is_chip(word) for word in words):
        return 0
    return 2 if "field" in words else 1


def _quality(vector: Vector) -> tuple[int, int, bool, int, int, int]:
    """Sort the best first: the rawest, a sensor before a field and m before b, then the name that says least besides.

    A b may be a bias.
    """
    foreign = sum(not (_is_number(word) or tells_apart(word)) for word in vector.label)
    is_symbol = vector.name.casefold() in ("b", "h")
    return vector.rank, _manner(vector), is_symbol, foreign, len(vector.label), min(vector.cells)


# Which of several magnetometers is meant ------------------------------------------------------------------------------

MOST_NAMED: Final = 8  # magnetometers that a line names; an array may have dozens


class Form(NamedTuple):
    """Columns that were asked for of a table, and what tells a table of the same form."""

    field: tuple[str, ...]  # names, or numbers from 1
    width: int  # columns of a line
    names: tuple[str, ...]  # its header; none where it has none
    increasing: tuple[int, ...] = ()  # without a header, numbers of its columns that are clocks and counters

    @classmethod
    def of(cls, field: Sequence[str], names: Sequence[str], width: int, increasing: Iterable[int]) -> Self:
        """That of a table; `increasing` are places of columns that only rise."""
        own = tuple(name.strip() for name in names)
        return cls(tuple(field), width, own, () if own else tuple(place + 1 for place in increasing))


@dataclass(frozen=True, slots=True)
class Choice:
    """Which of several magnetometers is meant: the one that was asked for, else the one a calibration was made from.

    >>> Choice("2").among(["mag_left", "mag_right"], "two.csv"), Choice(preferred="mag_right").among(["mag"], "one.csv")
    (1, 0)
    >>> Choice(preferred="mag_bow").among(["mag_left", "mag_right"], "two.csv")
    Traceback (most recent call last):
    flinders.errors.UsageError: two.csv has no magnetometer mag_bow, which the calibration is for: there are 1
        (mag_left), 2 (mag_right); say which one it is for (sensor=)
    """

    sensor: str | None = None  # asked for, by its number from 1 or its name
    preferred: str | None = None  # the name of the one that a calibration was made from
    is_name: bool = False  # `sensor` may be given to the only magnetometer of a table, which does not know its name
    forms: tuple[Form, ...] = ()  # of the tables that a calibration was made from

    @classmethod
    def of(cls, sensor: str | int | None) -> Self:
        """Take what the user gave: a name, or a number from 1 as digits or as an integer.

        >>> Choice.of(2) == Choice("2")
        True
        """
        if isinstance(sensor, (int, np.integer)) and not isinstance(sensor, bool):
            return cls(str(sensor))
        if sensor is None or isinstance(sensor, str):
            return cls(sensor)
        raise UsageError(f"sensor is {sensor!r}, which names no magnetometer: give its number from 1, or its name")

    @property
    def is_open(self) -> bool:
        """Nobody says which: the first is taken, and the others are named."""
        return self.sensor is None and self.preferred is None

    def remembered(self, names: Sequence[str], width: int, increasing: Iterable[int]) -> str | None:
        """The columns that were asked for of a table of the same form; None for another, and where a sensor is asked.

        >>> choice = Choice(forms=(Form(("2", "3", "4"), 7, (), (1,)),))
        >>> choice.remembered([], 7, [0]), choice.remembered([], 7, []), choice.remembered([], 6, [0])
        ('2,3,4', None, None)
        """
        own = Form.of((), names, width, increasing) if self.forms else None
        same = (form for form in self.forms if form._replace(field=()) == own and self.sensor is None)
        return next((",".join(form.field) for form in same if len(form.field) == len("xyz")), None)

    def among(self, names: Sequence[str], source: str) -> int:
        """Look up its place among these names, from 0; UsageError for one that there is not, with those there are."""
        wanted = self.preferred if self.sensor is None else self.sensor
        if wanted is None or (self.sensor is None and len(names) == 1):
            return 0
        for place, name in enumerate(names):
            numbers = () if self.sensor is None else (str(place + 1),)
            if wanted.strip().casefold() in (*numbers, name.casefold(), name.casefold().removeprefix("/")):
                return place
        verb = "are" if len(names) > 1 else "is"
        there = numbered([f"{number} ({name})" for number, name in enumerate(names, 1)])
        what = f"{source} has no magnetometer {wanted.strip() or repr(wanted)}"
        if self.sensor is None:
            raise UsageError(
                f"{what}, which the calibration is for: there {verb} {there}; say which one it is for",
                hint={"sensor": None},
            )
        raise UsageError(f"{what}: there {verb} {there or 'none'}")

    def refuse_alone(self, source: str) -> None:
        """Refuse to choose from a table of one magnetometer."""
        if self.sensor is not None and not self.is_name:
            raise UsageError(
                f"{source} has one magnetometer: leave its number out; it is chosen by columns",
                hint={"sensor": None, "columns": None},
            )


FIRST: Final = Choice()  # Nobody says which


def numbered(words: Sequence[str]) -> str:
    """Put numbers and names of magnetometers into a sentence, as many as fit.

    >>> numbered(["2 MAG2", "3 MAG3"])
    '2 MAG2, 3 MAG3'
    """
    more = f" and {len(words) - MOST_NAMED} more" if len(words) > MOST_NAMED else ""
    return ", ".join(words[:MOST_NAMED]) + more
