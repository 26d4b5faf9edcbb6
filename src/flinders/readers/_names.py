"""Meanings of column names: the sensor, the axis and the unit that a name states.

A name is split into words, so that no list of known headers is needed. Words match regardless of case, and µ may be
wrongly encoded.

>>> meaning("magADC[0]")
Meaning(kind='field', axis='0', unit='', rank=0)
>>> meaning("MAGNETIC FIELD Y (î¼T)")
Meaning(kind='field', axis='y', unit='uT', rank=1)
>>> meaning("gyro_z_dps"), meaning("Time (s)").unit, meaning("mag_x_cal").rank > meaning("mag_x").rank
(Meaning(kind='rate', axis='z', unit='dps', rank=1), 's', True)
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Final, NamedTuple

from flinders.core.units import SEPARATE_PREFIX, SPELLINGS

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
AUXILIARY: Final = "auxiliary"  # a column that is requested by its name

_DEGREES = math.pi / 180

_FIELD_FACTORS: Final = {name: 1.0 for name in SPELLINGS if name != "raw"}
# Spellings of units in names, with the factor to s, rad/s, °C and A; a field is scaled by `Unit`.
FACTORS: Final[dict[str, dict[str, float]]] = {
    FIELD: _FIELD_FACTORS,
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
    STRENGTH: _FIELD_FACTORS,
}
_UNITS: Final = frozenset(unit for units in FACTORS.values() for unit in units)
_UNITS_OF_AXES: Final = frozenset(unit for kind in (FIELD, ACCELERATION, RATE) for unit in FACTORS[kind])
# Letters that stand for sensors, as in ``mx``, ``B_x`` or ``geo_x``; then the letters that may follow the name of a
# device, as in ``imu_mx``. A ``b`` after a device is a bias or the second device.
_LETTERS: Final = {
    "m": FIELD, "h": FIELD, "b": FIELD, "mf": FIELD, "geo": FIELD, "a": ACCELERATION, "g": RATE, "w": RATE,
}  # fmt: skip
_LETTERS_OF_A_DEVICE: Final = "magw"
# Chips by the quantity that they measure. Those of the last row have several sensors, so that their name alone is
# ambiguous. All chips of core/chips.toml are among them (tests/core/test_chips.py).
_CHIPS: Final = {
    FIELD: (
        r"lis[23]mdl|iis2mdc|[hq]mc5[89]83[lp]?|hmc5843|vcm5883l?|qmc6310[un]?"
        r"|mmc(?:34160|5603|5613|5633|5883|5983)(?:pj|njl?|ma)?|rm[23]100|ist83\d\d[a-z]?|ak(?:89[67][35]|099\d\d)c?|bmm[13]50|mag3110|tl[ve]493d|mlx90393|fxms3110"
    ),
    ACCELERATION: r"adxl\d{3}|lis3dh|lis2dh12|lis331dlh|mma845\d|bma\d{3}",
    RATE: r"l3gd20h?|l3g4200d|itg3\d{3}|fxas21002c?|bmg\d{3}",
    "": (
        r"mpu[69]\d{3}|icm[24]\d{4}|lsm6ds(?:3|3tr|33|l|m|o|ox|r|v|v16x)|lsm9ds[01]|lsm303(?:agr|c|d|dlh|dlhc|dlm)?"
        r"|bmi\d{3}|[ai]sm330(?:dhcx|dlc|lhhx?|is)?|iim4\d{4}|qmi8658c?|fxos8700(?:cq)?|bno0[58]\d|bno08x"
        r"|bmx(?:055|160)|bmc15[06]|adis16\d{3}a?"
    ),
}
# The name of a chip that is directly followed by a number, a letter and an axis: ``rm3100x``.
_CHIP: Final = re.compile(rf"({'|'.join(_CHIPS.values())})(\d?)([{_LETTERS_OF_A_DEVICE}]?)([xyz]?)")
# Devices with several sensors, and places: words that distinguish magnetometers.
_DEVICES: Final = frozenset(("imu", "ahrs", "ins"))
PLACES: Final = frozenset(
    (
        "left", "right", "front", "rear", "back", "fore", "aft", "bow", "stern", "port", "starboard", "top", "bottom",
        "upper", "lower", "inner", "outer", "int", "ext", "internal", "external", "main", "aux", "primary", "secondary",
        "backup", "master", "slave", "first", "second", "third",
    )
)  # fmt: skip
# Words of columns with information about readings, such as their status.
_OTHERS: Final = re.compile(
    r"(cov|std|sigma|var|offset|ofs|bias|abs|norm|total|magnitude|heading|health|accuracy|gain|scale$|quality|err)"
)
# Words of columns that belong to no three-axis sensor, whatever their values.
_UNRELATED_WORDS: Final = re.compile(
    r"(lat|lon|lng|alt|gps|gnss|pos|vel|speed|course|roll|pitch|yaw|euler|baro|press|volt|batt|vbat|pwm|servo|rc$|hum"
    r"|light|lux|prox|step|index|seq|count|loop|sat|[hv]dop|rssi|status|flag|modes?$)"
)
# Sources of a reference field strength, and words for a strength. ``h`` is not among them: in geomagnetism it is the
# horizontal component.
_REFERENCES: Final = frozenset(("reference", "ref", "igrf", "wmm"))
_STRENGTHS: Final = frozenset(("field", "strength", "total", "intensity", "f"))
_CORRECTION_WORDS: Final = "cal|calib|calibrated|cald|corr|corrected|comp|compensated|filt|filter|filtered"
_FILTER_WORDS: Final = (  # a number after one belongs to it, as in ``avg10``, and is no sensor's
    "lp|lpf|hp|hpf|bp|bpf|ema|sma|avg|average|averaged|mean|median|smooth|smoothed|prev|previous|kalman|decimated"
)
_CALIBRATION_WORD: Final = re.compile(rf"({_CORRECTION_WORDS})$")
_DERIVED_WORD: Final = re.compile(rf"({_CORRECTION_WORDS}|({_FILTER_WORDS})\d*)$")
# Words that mark three columns as something other than readings of a sensor, with their kind.
_DERIVED_KINDS: Final = {
    **dict.fromkeys((*sorted(_REFERENCES), "model", "true", "truth", "expected", "predicted"), "a reference"),
    **dict.fromkeys(("ned", "enu", "nwu", "ecef", "earth", "world"), "in axes of the earth"),
    **dict.fromkeys(("dir", "direction"), "a direction"),
    **dict.fromkeys(("min", "max", "diff", "delta", "status", "innov", "innovation", "residual"), "no readings"),
}
# Such a word directly after the word for a sensor: ``magref``.
_JOINED_WORDS: Final = re.compile(
    rf"(mag|acc|gyro)(raw|{_CORRECTION_WORDS}|{_FILTER_WORDS}|unit|{'|'.join(_DERIVED_KINDS)})([xyz]?)"
)
# Words whose number is not that of a sensor: bits, time steps, a filter, a version.
_MEASURES: Final = re.compile(
    rf"\b(u?int (8|16|24|32|64)|float (32|64)|({_FILTER_WORDS}|t|v|ver|version|k|order|lag) \d+|\d+ (bits?|hz|ms))\b"
)
_RAW: Final = re.compile(r"(raw|adc|.*uncal(ib|ibrated)?)$")
# Words for readings of a sensor, as opposed to the field of a model.
_MEASUREMENT_WORDS: Final = "meas|measured|observed|obs"
_SENSOR_WORD: Final = re.compile(rf"(sensors?|magnetometers?|compass|measurement|{_MEASUREMENT_WORDS})$")
_TIMES: Final = re.compile(
    r"(t[st]?|time.*|.*time|stamp|seconds|millis|micros|epoch|elapsed|zeit|temps|tiempo|时间|時間)$"
)
_CLOCKS: Final = re.compile(r"(dates?|day|datum|clock|utc|gmt|uhr.*|heure|hora|fecha|when)$")  # times or dates
_ELAPSED: Final = re.compile(r"offset[\s_]?(?=time\b)", re.IGNORECASE)  # a time since the start: ``offsetTime``
_NUMBERED: Final = re.compile(r"field[\s_]?\d+", re.IGNORECASE)  # any quantity, as in ThingSpeak
_NON_TIME_WORD: Final = re.compile(r"(day|date|zone|fix|offset|gps|time_of_day)$")
# Words that may occur in the name of any three-axis sensor.
_COMMON: Final = re.compile(
    r"(mag.*|flux.*|compass|acc.*|gyr.*|angular|velocity|linear|axis|field|strength|vector|imu|ahrs|ins|sensor|dev|device|unit|node"
    r"|board|module|no|nr|num|id|instance|ch|channel|data|value|reading|measurement)$"
)
_SEPARATOR_SIGNS: Final = r"\s_.,:;%#\-\[\](){}'\""  # characters between the words of a name
_ATTACHED_AXIS: Final = re.compile(
    r"(mag(?:n|net|netic|netometer|netom|adc|raw|field)?|acc(?:el|l|elero|eleration|elerometer)?|gyro?(?:scope|adc)?"
    r"|compass|[mhbagw]|mf|geo)([xyz])"
)
_AXIS_BEFORE: Final = re.compile(r"([xyz])(mag|acc|gyro|mf)")
_SEPARATORS: Final = re.compile(rf"[{_SEPARATOR_SIGNS}]+")
_PIECES: Final = re.compile(
    rf"([{_SEPARATOR_SIGNS}]*)([^{_SEPARATOR_SIGNS}]+)"
)  # words, each with the separator before it
_IN: Final = re.compile(
    r"(?<![^\W_])in[\s_]+(?=[^\s_()\[\]]+\s*[)\]]?\s*$)", re.IGNORECASE
)  # ``in`` before a unit at the end
_RATE_WORDS: Final = re.compile(
    r"(?<![^\W_])(rad|deg)(?:ians?|rees?)?[\s_]+(?:per[\s_]+)?s(?:ec(?:ond)?)?(?=\s*[)\]]?\s*$)", re.IGNORECASE
)  # the unit of a rate at the end, in words: ``rad_s``
_BRACKETED_UNIT: Final = re.compile(r"[(\[]([^)\]]*)[)\]]?\s*$")  # a unit, or the number of an axis
_BRACKET: Final = re.compile(r"\s*[(\[](?!\d+[)\]])[^)\]]*[)\]]?\s*$")
_DIRECTION_WORDS: Final = re.compile("unit|vec|field|mag|acc")
# Words and numbers without separators: ``magX1`` has three.
_PARTS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\x00-\x7f]+")
_BROKEN_MICRO: Final = re.compile(r"(?:[^\x00-\x7f]+|i|\?)t")  # µT with wrongly decoded bytes
CALIBRATED_RANK: Final = 10  # smallest rank of corrected readings
BARE_CLEARNESS: Final = 2  # clearness of ``x``, ``y``, ``z``, which may be a position if a magnetometer is recorded too
# Columns that are recognised by their whole name only, as `flinders.simulate.recording` writes it: otherwise a
# ``throttle`` may be per cent or microseconds, and an attitude may refer to any axes.
_WRITTEN_HERE: Final = {
    "throttle_share": (THROTTLE, ""),
    **{f"{ATTITUDE}_{axis}": (ATTITUDE, axis) for axis in "wxyz"},
}
# Units in the names of single motors' columns, with the factor to A or to a fraction of 1; pulses in µs have no factor.
FACTORS_OF_MOTORS: Final[dict[str, dict[str, float]]] = {
    CURRENTS: {"": 1.0, "a": 1.0, "ma": 1e-3},
    THROTTLES: {"share": 1.0, "percent": 0.01, "pct": 0.01, "%": 0.01, "": 1e-3, "us": 1e-3, "µs": 1e-3},
}
# Columns of single motors, by their whole name: number of the motor, and unit.
_MOTOR_COLUMNS: Final = {
    CURRENTS: re.compile(
        r"(?:(?:esc|motor|mot|m)[ _.]?\[?(\d{1,2})\]?[ _.](?:esc[ _])?(?:current|curr|amps?)"
        r"|(?:(?:esc|motor)[ _.])?(?:current|curr)[ _.]?\[?(\d{1,2})\]?)(?:[ _]?[(\[]?(a|ma)[)\]]?)?"
    ),
    THROTTLES: re.compile(
        r"(?:(?:throttle|motor)[ _.]?\[?(\d{1,2})\]?|(?:motor|esc)[ _.]?\[?(\d{1,2})\]?[ _.](?:throttle|pwm))"
        r"(?:[ _]?[(\[]?(share|percent|pct|%|us|µs)[)\]]?)?"
    ),
}


class Meaning(NamedTuple):
    """Meaning of the name of a column."""

    kind: str  # one of the kinds above; empty for an unknown name
    axis: str = ""  # x, y or z, also w for an attitude; 0 to 3 for numbered axes; the number of a motor; or empty
    unit: str = ""  # as in `FACTORS`; for a field or a strength as in `Unit`; empty if not stated
    rank: int = 0  # priority among several columns of a kind: the smallest rank is used

    @property
    def is_bare(self) -> bool:
        """Whether the name is nothing but an axis, of a field or of another quantity."""
        return self.kind == FIELD and not self.unit and clearness(self.rank) >= BARE_CLEARNESS


def clearness(rank: int) -> int:
    """Grade of how clearly a name is that of a magnetometer, the best first: 0 ``mag_x``, 1 ``mx``, 2 ``x``."""
    return rank % CALIBRATED_RANK // 2


@lru_cache(maxsize=1_024)
def meaning(name: str) -> Meaning:
    """Meaning of the name of a column; the kind is empty for an unknown name."""
    if written := _WRITTEN_HERE.get(name.strip().casefold()):
        return Meaning(*written)
    for kind, pattern in _MOTOR_COLUMNS.items():
        if match := pattern.fullmatch(name.strip().casefold()):
            return Meaning(kind, match[1] or match[2], match[3] or "")
    words, units = _words(name)
    folded = [word.casefold() for word in words]
    if (not folded and not units) or _NUMBERED.fullmatch(name.strip()):
        return Meaning("")
    if _is_strength(folded, units):
        return Meaning(STRENGTH, "", _unit(STRENGTH, units))
    sensor, axis = _split_axis(folded)
    if any(_OTHERS.match(word) for word in sensor):
        return Meaning("")
    is_joined = len(sensor) == len(folded)  # the axis was not a separate word
    kind, rank = _vector(sensor, units, is_joined=is_joined) if axis else _scalar(sensor, units)
    if kind == FIELD and axis and any(_DERIVED_WORD.match(word.casefold()) for word in (*sensor, *units)):
        rank += CALIBRATED_RANK
    return Meaning(kind, axis, _unit(kind, units), rank)


def is_inconclusive(name: str) -> bool:
    """Whether a name says so little that the column may be an axis of a magnetometer."""
    known, words = meaning(name), [word.casefold() for word in _words(name)[0]]
    is_other = any(_UNRELATED_WORDS.match(word) or _OTHERS.match(word) for word in words)
    return known.is_bare or not (known.kind or is_other)


def is_like_time(name: str) -> bool:
    """Whether the name of a column looks like that of a time.

    >>> [is_like_time(name) for name in ("timestamp", "UTC", "Date", "mx")]
    [True, True, True, False]
    """
    return meaning(name).kind == TIME or any(_CLOCKS.match(word.casefold()) for word in _words(name)[0])


def is_letter_of_time(name: str) -> bool:
    """Whether only a ``T`` marks a column as a time; ``T`` may also stand for a temperature.

    >>> [is_letter_of_time(name) for name in ("T", "t_raw", "T_r", "t_ms", "time", "T_C")]
    [True, True, True, False, False, False]
    """
    words = [word.casefold() for word in _words(name)[0]]
    return meaning(name)[::2] == (TIME, "") and list(filter(_TIMES.match, words)) == ["t"]


def words_of(name: str) -> list[str]:
    """Split a name into its words, without a unit.

    >>> words_of("deviceID"), words_of("MAC address"), words_of("node_2 (uT)")
    (['device', 'ID'], ['MAC', 'address'], ['node', '2'])
    """
    return _words(name)[0]


def is_unit(text: str) -> bool:
    """Whether a text is just a unit, as in a row of units below a header."""
    return _RATE_WORDS.sub(r"\1/s", _IN.sub("", SEPARATE_PREFIX.sub(r"\1", text))).casefold() in _UNITS


@lru_cache(maxsize=1_024)
def field_stem(name: str, axis: str) -> str:
    """A name without its axis; it is equal for the three columns of one sensor."""
    folded = name.strip().casefold()
    place = _place_of_axis(folded, axis)
    return f"{folded[:place]}*{folded[place + 1 :]}"


@lru_cache(maxsize=1_024)
def label(name: str) -> tuple[str, ...]:
    """Words in the name of a three-axis sensor's column that distinguish it from other sensors of its kind."""
    words = words_of_sensor(name)
    has_kind = any(_kind_of_word(word) or kind_of_chip(word) for word in words)
    plain = (_COMMON, _RAW, _DERIVED_WORD, _SENSOR_WORD)
    measured = _MEASURES.sub(lambda match: match[0].replace(" ", ""), " ".join(words)).split()
    apart = [word for word in measured if is_chip(word) or not any(pattern.match(word) for pattern in plain)]
    own = tuple(word for word in apart if has_kind or word not in _LETTERS)
    return own or tuple(word for word in words if word in _DEVICES)


def is_chip(word: str) -> bool:
    """Whether a lower-case word is the name of a known chip."""
    return bool((chip := _CHIP.fullmatch(word)) and chip[1] == word)


def kind_of_chip(word: str) -> str:
    """Quantity that a chip measures; empty for a chip with several sensors."""
    return next((kind for kind, pattern in _CHIPS.items() if re.fullmatch(pattern, word)), "")


def identifies_sensor(word: str) -> bool:
    """Whether a word, other than a number, identifies one of several sensors: a place, a chip or a device."""
    return word in PLACES or word in _DEVICES or is_chip(word)


def identifies_readings(word: str) -> bool:
    """Whether a lower-case word identifies one of several sets of readings, or the processing of readings."""
    return bool(identifies_sensor(word) or _RAW.match(word) or _DERIVED_WORD.match(word))


@lru_cache(maxsize=1_024)
def kind_of_no_readings(name: str) -> str:
    """Kind of three columns that are not readings of a sensor; empty if they may be readings."""
    words = words_of_sensor(name)
    if "main field" in " ".join(words):  # main field of the earth's core
        return "a reference"
    if "unit" in words and all(map(_DIRECTION_WORDS.match, words)):  # but a unit of a device is not a direction
        return "a direction"
    return next((_DERIVED_KINDS[word] for word in words if word in _DERIVED_KINDS), "")


def source_rank(whole: str) -> int:
    """Rank of a name by its source: 0 for a sensor, 2 for a field, which may be that of a model, 1 for neither."""
    words = [word.casefold() for word in _words(whole)[0]]
    if any(_SENSOR_WORD.match(word) or _RAW.match(word) or is_chip(word) for word in words):
        return 0
    return 2 if "field" in words else 1


@lru_cache(maxsize=1_024)
def sensor_name(name: str, axis: str, *, whole: bool = False) -> str:
    """Name of a column's sensor: without axis, unit, ``raw`` and the like; with `whole`, only without the axis."""
    bare = name.strip() if whole else _BRACKET.sub("", name.strip())
    place = _place_of_axis(bare.casefold(), axis)
    pieces = _PIECES.findall(f"{bare[:place]}{bare[place + 1 :]}")
    own = ""
    for number, (between, piece) in enumerate(pieces):
        folded = piece.casefold()
        is_common = (number and folded in _UNITS_OF_AXES) or _RAW.match(folded) or _DERIVED_WORD.match(folded)
        if whole or not is_common:
            own += (between[-1:] if between[-1:] in " _.-" else "_") + piece
    bare_name = own.lstrip(" _.-")
    return bare_name if any(map(str.isalpha, bare_name)) else f"xyz{bare_name}"


def words_of_sensor(name: str) -> list[str]:
    """Words of a three-axis column in lower case, without axis and unit."""
    words, units = _words(name)
    foreign = [unit for unit in units if unit.casefold() not in _UNITS_OF_AXES]
    return _split_axis([word.casefold() for word in words + foreign])[0]


def _place_of_axis(folded: str, axis: str) -> int:
    """Position of the axis letter or digit in a name: the last that is separate, else the last of all."""
    places = [match.start() for match in re.finditer(axis, folded)]
    around = {place: folded[max(place - 1, 0) : place] + folded[place + 1 : place + 2] for place in places}
    alone = [place for place in places if not any(map(str.isalpha, around[place]))]
    return max(alone or places, default=0)


def _words(name: str) -> tuple[list[str], list[str]]:
    """Split a name into its words, and into the units that it may state, the most reliable first."""
    units = []
    name = _RATE_WORDS.sub(r"\1/s", _ELAPSED.sub("", _IN.sub("", SEPARATE_PREFIX.sub(r"\1", name))))
    inside = _BRACKETED_UNIT.search(name)
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
                glued = _JOINED_WORDS.fullmatch(part.casefold())
                words += filter(None, glued.groups() if glued else [part])
    return words, units


def _split_axis(words: list[str]) -> tuple[list[str], str]:
    """Find the axis among the words of a name: a word of its own, the end or start of a word, or a small number."""
    letters = [word for word in words if word in {"x", "y", "z"}]
    if len(letters) == 1:
        return [word for word in words if word != letters[0]], letters[0]
    for place, word in enumerate(words):
        if attached := _ATTACHED_AXIS.fullmatch(word):
            return [*words[:place], attached[1], *words[place + 1 :]], attached[2]
        if ahead := _AXIS_BEFORE.fullmatch(word):
            return [*words[:place], ahead[2], *words[place + 1 :]], ahead[1]
    if len(words) > 1 and words[-1] in {"0", "1", "2", "3"} and not all(map(str.isdigit, words)):
        return words[:-1], words[-1]
    return words, ""


def _vector(words: list[str], units: list[str], *, is_joined: bool) -> tuple[str, int]:
    """Three-axis sensor that the words name, and the rank of its readings; the rawest have the smallest rank."""
    raw = 0 if any(_RAW.match(word) for word in words) else 1
    names = [word for word in words if not word.isdigit()]
    kinds = [kind for word in names if (kind := _kind_of_word(word))] or list(filter(None, map(kind_of_chip, names)))
    if kinds:
        return kinds[0], raw + 5 * (kinds[0] == ACCELERATION and "linear" in words)
    aside = [word for word in names if _SENSOR_WORD.match(word) or word in _DERIVED_KINDS]
    others = {"axis", *aside}
    bare = [word for word in names if not (_RAW.match(word) or _CALIBRATION_WORD.match(word) or word in others)]
    if aside and not bare:
        return (FIELD, raw + 2) if all(word in _MEASUREMENT_WORDS.split("|") for word in aside) else ("", 0)
    own = [word for word in bare if not (identifies_sensor(word) or _COMMON.match(word))]
    is_of_device = len(own) == 1 and own[0] in _LETTERS_OF_A_DEVICE and (is_joined or any(map(is_chip, bare)))
    if is_of_device or (len(bare) == 1 and bare[0] in _LETTERS):
        return _LETTERS[own[0]], raw + 2
    if bare in (["field"], ["field", "strength"]):
        return FIELD, raw + 2
    return (_kind_of_bare_axis(units), raw + 4) if not bare else ("", 0)


def _kind_of_word(word: str) -> str:
    """Three-axis sensor that a word names; empty for other words."""
    if word.startswith(("mag", "flux")) or word == "compass":
        return FIELD
    return ACCELERATION if word.startswith("acc") else RATE if word.startswith(("gyr", "angular")) else ""


def _kind_of_bare_axis(units: list[str]) -> str:
    """Kind of a name that is just an axis: a field, unless its unit is that of another quantity."""
    for unit in units:
        if unit in {"g", "mg"}:  # lower case: gravity
            return ACCELERATION
        for kind in (RATE, ACCELERATION):
            if unit.casefold() in FACTORS[kind] and unit.casefold() not in FACTORS[FIELD]:
                return kind
    return FIELD if not units or _unit(FIELD, units) else ""


def _scalar(words: list[str], units: list[str]) -> tuple[str, int]:
    """Sensor without axes, or clock, that the words name, and its rank."""
    is_warm = words == ["t"] and any(unit.casefold() in FACTORS[TEMPERATURE] for unit in units)  # T = 23.4 C
    if is_warm or (any(word.startswith(("temp", "tmp")) for word in words) and words != ["temps"]):
        return TEMPERATURE, 0
    if any(word in {"curr", "current", "amps", "amp", "ampere"} for word in words):
        return CURRENT, 0
    is_of_week = "tow" in words or {"time", "week"} <= set(words)
    if any(_NON_TIME_WORD.match(word) for word in words) and not is_of_week:
        return "", 0
    timed = is_of_week or any(_TIMES.match(word) for word in words)
    alone = not words and all(unit.casefold() in FACTORS[TIME] for unit in units)
    return (TIME, 0 if _unit(TIME, units) else 1) if timed or alone or (units and "elapsed" in words) else ("", 0)


def _is_strength(words: list[str], units: list[str]) -> bool:
    """Whether a name states a reference field strength: its source and the quantity, and nothing else."""
    named = {word for word in words if not word.isdigit()}
    if not named & _REFERENCES or not named <= _REFERENCES | _STRENGTHS:
        return False
    return bool(named & _STRENGTHS or _unit(STRENGTH, units))


def unit_of_field(name: str) -> str:
    """Unit of a field in the name of a column; ``g`` is ignored, since it means gravity.

    >>> unit_of_field("磁场X(uT)"), unit_of_field("v1 [nT]"), unit_of_field("v1 (mg)"), unit_of_field("v1")
    ('uT', 'nT', '', '')
    """
    return _unit(FIELD, [unit for unit in _words(name)[1] if unit not in {"g", "mg"}])


def unit_of_strength(name: str) -> str:
    """Unit in the name of a column for a field strength; empty if it states none.

    >>> unit_of_strength("MAG_4_UNCOMP [nT]"), unit_of_strength("scalar")
    ('nT', '')
    """
    return _unit(STRENGTH, _words(name)[1])


def _unit(kind: str, units: list[str]) -> str:
    """The unit that fits a column of this kind, as spelled in `FACTORS` or, for a field, in `Unit`."""
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
