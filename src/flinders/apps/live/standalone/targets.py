r"""Export targets as templates for JavaScript: texts with slots for the numbers of a calibration.

Each writer of `flinders.targets` writes a calibration with unique placeholder numbers. The text is split at these
numbers, and each number is matched with the quantities and formats that a target may use. A template is a list of texts
and slot numbers; a slot states the quantity and its format.

>>> px4 = next(row for row in data()["rows"] if row["name"] == "px4")
>>> template = px4["variants"]["uT known"]
>>> [piece for piece in template["body"] if isinstance(piece, str)][0], data()["slots"][template["body"][1]]
('1\t1\tCAL_MAG0_XOFF\t', {'of': 'offset', 'at': 0, 'over': 100.0, 'sign': 1, 'format': 'general'})
"""

from __future__ import annotations

import json
import re
import zlib
from dataclasses import asdict
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.calibration import Calibration
from flinders.core.calibration_file import VERSION
from flinders.core.units import COUNTS, MICROTESLA, PER_UNIT, Unit
from flinders.errors import FlindersError, figures
from flinders.targets import motioncal, registry
from flinders.targets._code_text import digits
from flinders.targets._comments import ASCII
from flinders.targets._difference import DIRECTIONS, MAX_ROUNDING_DEG
from flinders.targets._target import NEGLIGIBLE_ERROR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.arrays import Floats
    from flinders.core.calibration_file import Rotation
    from flinders.targets import Export, Target
    from flinders.targets._target import Limit

NAMES: Final = (
    "arduino", "c", "micropython", "motioncal", "adafruit-eeprom", "sensorlab", "ardupilot", "px4", "px4-shell",
    "fusion", "fusion-python", "esphome", "zscilib", "matlab", "json", "yaml",
)  # fmt: skip
"""Targets whose numbers are those of the calibration in some unit; others select or round numbers.

In the order of the page's list, whose groups follow their first targets: it is for boards first.
"""
OWN_FORMATS: Final = {"ardupilot": "general", "px4": "general", "matlab": "seventeen"}
"""Format of each target whose numbers do not show its format, since another target may write the same numbers."""

RECORDED: Final = "\N{CURRENCY SIGN}"
"""Placeholder for the name of the recorded unit; as `over` of a slot, it stands for the size of that unit."""
MATRIX: Final = np.array(
    [[1.0837465291, 0.0213876541, -0.0342918763], [0.0213876541, 0.9471829354, 0.0158273649],
     [-0.0342918763, 0.0158273649, 0.9912837465]]
)  # fmt: skip
SKEW: Final = 1e-5 * np.array([[0.0, 0.0, 0.0], [3.1728394, 0.0, 0.0], [-5.9182736, 7.1928374, 0.0]])
"""Matrix added to `MATRIX` for targets that hold any matrix, so that rows and columns differ."""
OFFSET: Final = np.array([12.345678912, -23.192837465, 34.564738291])
STRENGTH: Final = 47.123584967
SCALE: Final = 0.7310585786
"""Placeholder for the size of the recorded unit; the numbers above are placeholders of a calibration."""
DIVISORS: Final = (1.0, RECORDED, PER_UNIT["mG"], PER_UNIT["G"])
FORMATS: Final[dict[str, Callable[[float], str]]] = {
    "general": lambda value: f"{np.float32(value) + np.float32(0):.9g}",
    "digits": digits,
    "shortest": json.dumps,
    "nine": lambda value: json.dumps(float(f"{value:.9g}")),
    "exponent": lambda value: f"{value:.17e}",
    "seventeen": lambda value: f"{value:.17g}",
    "figures": lambda value: figures(value, 4),
}
"""Formats of numbers. The first two round to single precision; only the first omits the point of a whole number."""
NUMBER: Final = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
ERROR: Final = re.compile(r"(?:less than|at most) \S+ (\S+) and \S+°")


@cache
def data() -> dict[str, Any]:
    """Data for ``standalone/targets.js`` to write targets and calibration files."""
    slots = _Slots()
    return {
        "rows": [_row(registry()[name], slots) for name in NAMES if name in registry()],
        "slots": slots.rows,
        "ascii": {chr(code): text for code, text in ASCII.items()},
        "schema": VERSION,
        "units": PER_UNIT,
        "recorded": RECORDED,
        "directions": len(DIRECTIONS),
        "negligible": NEGLIGIBLE_ERROR,
        "coarsest_deg": MAX_ROUNDING_DEG,
    }


class _Slots:
    """Slots of all templates, numbered, each only once."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self._places: dict[str, int] = {}

    def place(self, slot: dict[str, Any]) -> int:
        """Number of a slot, added if new."""
        key = json.dumps(slot)
        if key not in self._places:
            self._places[key] = len(self.rows)
            self.rows.append(slot)
        return self._places[key]

    def pieces(self, text: str, written: dict[str, dict[str, Any]]) -> list[str | int]:
        """Split a text at the placeholder numbers in `written`, and at placeholders for heading errors."""
        made: list[str | int] = []
        end = 0
        for match in sorted([*NUMBER.finditer(text), *ERROR.finditer(text)], key=lambda match: match.start()):
            is_error = match.re is ERROR
            slot = {"format": "error", "unit": match[1]} if is_error else written.get(match[0])
            if slot is not None and match.start() >= end:
                made += [text[end : match.start()], self.place(slot)]
                end = match.end()
        return [*made, text[end:]]


def _row(target: Target, slots: _Slots) -> dict[str, Any]:
    """Data of one target: names, limits, and a template for each variant."""
    return {
        "name": target.name,
        "use": target.use,
        "title": target.title,
        "suffix": target.suffix,
        "group": target.group,
        "comment": target.comment and asdict(target.comment),
        "relative": bool(target.lengths),
        "limits": [_limit(limit, slots) for limit in target.limits],
        "variants": {name: _variant(target, calibration, slots) for name, calibration in _variants(target)},
    }


def _variants(target: Target) -> Iterator[tuple[str, Calibration]]:
    """Yield calibrations that a target may write differently: each unit, with known and unknown field strength."""
    is_any = target.keeps == "all"
    matrix: Floats = MATRIX + SKEW if is_any else MATRIX
    rotation: Rotation = "composed" if is_any else "symmetric"
    units = {MICROTESLA: Unit(RECORDED, SCALE, MICROTESLA), COUNTS: Unit.of(COUNTS)}
    for (name, raw), known in product(units.items(), (False, True)):
        words = "known" if known else "relative"
        yield f"{name} {words}", Calibration(matrix, OFFSET, STRENGTH, known, rotation, raw=raw)


def _variant(target: Target, calibration: Calibration, slots: _Slots) -> dict[str, Any]:
    """Template of a target for a calibration, or the reason why the target cannot hold it."""
    try:
        export = target.render(calibration)
    except FlindersError as error:
        return {"refusal": error.message}
    written = _slots_by_text(calibration, OWN_FORMATS.get(target.family, "digits"))
    remarks = _remarks(target, export)
    head = target.comment.lines(remarks) if target.comment else []
    body = export.text.removeprefix("\n".join([*head, ""]) if head else "")
    packet = None if export.data is None else _packet(export.data, calibration, slots)
    return {
        "remarks": [slots.pieces(remark, written) for remark in remarks],
        "warnings": list(export.warnings),
        "body": [] if packet else slots.pieces(body, written),
        "guarded": _is_guarded(body),
        "packet": packet,
    }


def _remarks(target: Target, export: Export) -> list[str]:
    """Remarks in the head of a file; the origin is inserted after the first."""
    first = f"{target.title}: {target.formula}, in {export.fields['unit']}"
    return [first, *export.fields["notes"], *export.warnings, export.checked]


def _is_guarded(body: str) -> bool:
    """Whether the first lines hold a checksum of the text between them and the last four lines."""
    lines = body.splitlines()
    return lines[1:2] == [f"{lines[1].rpartition(' ')[0]} 0x{zlib.crc32(chr(10).join(lines[3:-4]).encode()):08x}u"]


def _quantities(calibration: Calibration) -> Iterator[tuple[dict[str, Any], float]]:
    """Yield each quantity and its value; a matrix in the recorded unit is multiplied by the size of the unit."""
    matrix, scale = calibration.matrix, float(np.trace(calibration.matrix) / 3)
    size = float(np.exp(np.linalg.slogdet(matrix)[1] / 3))
    matrices: dict[str, Floats] = {"matrix": matrix, "iron": matrix / scale, "unimodular": matrix / size}
    single: dict[str, Floats] = {"scale": np.array([scale]), "radius": np.array([calibration.field_strength / size])}
    for name, values in {**matrices, **single}.items():
        for at, value in enumerate(values.ravel().tolist()):
            yield {"of": name, "at": at, "over": 1.0}, value
    for at, value in enumerate((matrix * calibration.raw.scale).ravel().tolist()):
        yield {"of": "matrix", "at": at, "over": RECORDED}, value
    for over in DIVISORS:
        unit = calibration.raw.scale if isinstance(over, str) else over
        yield {"of": "strength", "at": 0, "over": over}, calibration.field_strength / unit
        for at, value in enumerate((calibration.offset / unit).tolist()):
            yield {"of": "offset", "at": at, "over": over}, value


def _slots_by_text(calibration: Calibration, own: str) -> dict[str, dict[str, Any]]:
    """Slots by the texts in which numbers of the calibration may be written; the `own` format takes precedence."""
    written: dict[str, dict[str, Any]] = {}
    for (slot, value), sign, name in product(list(_quantities(calibration)), (1, -1), sorted(FORMATS, key=own.__ne__)):
        written.setdefault(FORMATS[name](sign * value), {**slot, "sign": sign, "format": name})
    return written


def _packet(content: bytes, calibration: Calibration, slots: _Slots) -> dict[str, Any]:
    """Slots of the numbers in MotionCal's packet; None for 0."""
    single = {
        float(np.float32(value)): {**slot, "sign": 1, "format": "digits"} for slot, value in _quantities(calibration)
    }
    _, *values, _ = motioncal.LAYOUT.unpack(content)
    return {
        "signature": motioncal.SIGNATURE.hex(),
        "values": [slots.place(single[value]) if value else None for value in values],
        "polynomial": motioncal.POLYNOMIAL,
    }


def _limit(limit: Limit, slots: _Slots) -> dict[str, Any]:
    """Allowed range of a target's parameter; with several slots, the range of the length of their vector."""
    common = {"over": limit.unit, "sign": 1, "format": "general"}
    places = [slots.place({"of": limit.quantity, "at": at, **common}) for at in limit.places]
    return {"name": limit.name, "slots": places, "low": limit.low, "high": limit.high}
