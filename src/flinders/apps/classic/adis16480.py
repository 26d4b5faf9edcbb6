"""The magnetometer registers of Analog Devices' ADIS16480 and ADIS16488: ``M_C = (I + S) M + H``.

Twelve registers of 16 bits on page 2, two's complement: the hard iron H in steps of 0.1 mG, the soft iron S in steps of
1/32768, that is ±100 %. M is the measured field in mG, M_C the output. A calibration is corrected = W (raw − b), so

    S = W − I,   H = −W b

>>> from flinders.core.units import Unit
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.75]), [10.0, -20.0, 0.005], 50.0, raw=Unit.of("mG"))
>>> registers = Registers.of(calibration)
>>> for register in registers.rows[:4]:
...     print(register.name, register.page, hex(register.address), register.code, f"0x{register.word:04X}")
HARD_IRON_X 2 0x28 -1250 0xFB1E
HARD_IRON_Y 2 0x2a 2000 0x07D0
HARD_IRON_Z 2 0x2c 0 0x0000
SOFT_IRON_S11 2 0x2e 8192 0x2000
>>> registers.apply([[100.0, -200.0, 500.0]])                      # in mG: 10, −20 and 50 µT
array([[  0.,   0., 375.]])
>>> from flinders.targets import find
>>> print(*find("adis16480").render(calibration).text.splitlines()[-12:-9], sep=chr(10))
HARD_IRON_X       2     0x28   -1250  0xFB1E   -125.0 mG
HARD_IRON_Y       2     0x2A    2000  0x07D0   +200.0 mG
HARD_IRON_Z       2     0x2C       0  0x0000     +0.0 mG

Sources: the data sheets (ADIS16480 Rev. H page 35, Tables 117 to 129; ADIS16488 Rev. B page 25, Tables 84 to 96) state
names, page, addresses, the step of 0.1 mG, and that the soft iron acts "in terms of percent change". They do **not**
state the step of the soft iron and the order of the formula: verify both against your revision, as
``docs/classic/registers.md`` shows.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.arrays import Floats, check_vectors, to_floats
from flinders.core.calibration import Calibration
from flinders.core.units import MICROTESLA, PER_UNIT, Unit
from flinders.errors import ArrayError, NotExportable, UnitError, UsageError, figures
from flinders.targets._numbers import in_recorded_axes
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from flinders.core.calibration_file import Rotation

PAGE: Final = 2
FIRST_ADDRESS: Final = 0x28
NAMES: Final = (
    "HARD_IRON_X", "HARD_IRON_Y", "HARD_IRON_Z",
    "SOFT_IRON_S11", "SOFT_IRON_S12", "SOFT_IRON_S13",
    "SOFT_IRON_S21", "SOFT_IRON_S22", "SOFT_IRON_S23",
    "SOFT_IRON_S31", "SOFT_IRON_S32", "SOFT_IRON_S33",
)  # fmt: skip
"""Registers in the order of their addresses, two bytes apart; the Linux driver's X_HARD_IRON is HARD_IRON_X."""

HARD_IRON_STEP_MG: Final = 0.1
SOFT_IRON_STEP: Final = 2.0**-15
LOWEST, HIGHEST = -(2**15), 2**15 - 1
WORDS: Final = 2**16
"""Number of words of 16 bits."""

MG: Final = PER_UNIT["mG"]
"""µT in one mG."""

HEADING: Final = f"# {'register':<15}{'page':>4}  {'address':>7}  {'code':>6}  {'hex':<6}  {'value':>9}"

STEPS: Final = np.array([HARD_IRON_STEP_MG] * 3 + [SOFT_IRON_STEP] * 9)


@dataclass(frozen=True, slots=True)
class Register:
    """One register of the magnetometer, and its content."""

    name: str  #: as in the data sheet
    page: int
    address: int
    code: int  #: −32768 to 32767

    @property
    def word(self) -> int:
        """The 16 bits that are written for the code: two's complement, 0 to 65535."""
        return self.code % WORDS

    @property
    def value(self) -> float:
        """Value of the code: mG of hard iron, percent of soft iron."""
        return self.code * (HARD_IRON_STEP_MG if self.unit == "mG" else 100 * SOFT_IRON_STEP)

    @property
    def unit(self) -> str:
        """Unit of `value`: ``mG`` or ``%``."""
        return "mG" if self.name.startswith("HARD") else "%"

    def as_row(self) -> str:
        """Line of text with the columns of `HEADING`."""
        value, address = f"{self.value:+.{1 if self.unit == 'mG' else 3}f} {self.unit}", f"0x{self.address:02X}"
        return f"{self.name:<17}{self.page:>2}  {address:>7}  {self.code:>6}  0x{self.word:04X}  {value:>9}"

    def as_dict(self) -> dict[str, int | float | str]:
        """JSON-ready fields of a register."""
        more = {"word": self.word, "hex": f"0x{self.word:04X}", "value": self.value, "unit": self.unit}
        return {**asdict(self), **more}


@dataclass(frozen=True, slots=True)
class Registers:
    """Contents of the twelve registers."""

    codes: tuple[int, ...]  #: (12,): −32768 to 32767, in the order of `NAMES`

    @classmethod
    def of(cls, calibration: Calibration) -> Self:
        """Round a calibration to codes, half to even; the registers act in the axes as recorded.

        Raises
        ------
        UnitError, NotExportable
            For a calibration in counts; if a value is beyond the range of its register.
        """
        if calibration.unit != MICROTESLA:
            raise UnitError(
                "the calibration is in counts, and the registers are in mG: calibrate again in mG (or G, uT …), or "
                "with a scale of 0.01 µT if a count is the 0.1 mG of x_MAGN_OUT",
                hint={"unit": "mG", "scale": 0.01},
            )
        wanted = _register_values(calibration)
        codes = np.clip(np.rint(wanted), LOWEST, HIGHEST)
        registers = cls(tuple(int(code) for code in codes))
        if not np.array_equal(codes, np.rint(wanted)):
            raise _refusal(calibration, wanted, registers)
        return registers

    @classmethod
    def from_words(cls, words: Iterable[int]) -> Self:
        """Registers from twelve words read from a device, 0 to 65535 or signed, in the order of `NAMES`.

        Raises `UsageError` unless there are twelve words of 16 bits.

        >>> Registers.from_words([2, 0xFFFF, 0x8000] + [0] * 9).hard_iron.round(1)
        array([ 2.000e-01, -1.000e-01, -3.2768e+03])
        """
        read = list(words)
        if len(read) != len(NAMES) or not all(LOWEST <= word < WORDS for word in read):
            raise UsageError(f"registers {read}: need {len(NAMES)} words of 16 bits, {NAMES[0]} to {NAMES[-1]}")
        return cls(tuple((int(word) - LOWEST) % WORDS + LOWEST for word in read))

    @property
    def rows(self) -> tuple[Register, ...]:
        """Registers with names, pages and addresses."""
        return tuple(
            Register(name, PAGE, FIRST_ADDRESS + 2 * index, code)
            for index, (name, code) in enumerate(zip(NAMES, self.codes, strict=True))
        )

    @property
    def hard_iron(self) -> Floats:
        """(3,) hard iron H in mG."""
        return HARD_IRON_STEP_MG * to_floats(self.codes[:3])

    @property
    def soft_iron(self) -> Floats:
        """(3, 3) soft iron S, as a fraction: 0.01 is 1 %."""
        return SOFT_IRON_STEP * to_floats(self.codes[3:]).reshape(3, 3)

    def apply(self, field: ArrayLike) -> Floats:
        """Correct readings as the device does, M_C = (I + S) M + H: (..., 3) in mG to (..., 3) in mG.

        The device then rounds its output to 0.1 mG.
        """
        corrected: Floats = check_vectors(field, finite=False) @ (np.eye(3) + self.soft_iron).T + self.hard_iron
        return corrected

    def to_calibration(self, field_strength: float, *, known: bool = False) -> Calibration:
        """Calibration with the values of the codes, in the axes of the device.

        The codes do not contain the field strength of the site: `field_strength` gives it in µT, and `known` says
        whether it was measured. Raises `ArrayError` for codes whose I + S is singular.
        """
        matrix = np.eye(3) + self.soft_iron
        try:
            offset = -MG * np.linalg.solve(matrix, self.hard_iron)
        except np.linalg.LinAlgError:
            raise ArrayError(f"(I + S) of the codes {self.codes} is singular: it cannot be undone") from None
        rotation: Rotation = "symmetric" if np.array_equal(matrix, matrix.T) else "composed"
        return Calibration(matrix, offset, field_strength, known, rotation, raw=Unit.of("mG"))


def _register_values(calibration: Calibration) -> Floats:
    """(12,) exact value for each register, in steps of that register, before rounding."""
    matrix, offset = in_recorded_axes(calibration)
    with np.errstate(over="ignore", invalid="ignore"):
        hard_iron = -(matrix @ offset) / MG
        wanted: Floats = np.concatenate([hard_iron, (matrix - np.eye(3)).ravel()]) / STEPS
    return wanted


def _refusal(calibration: Calibration, wanted: Floats, registers: Registers) -> NotExportable:
    """Error for values beyond the range of their register, with the error that clipped registers would cause."""
    beyond = [index for index, code in enumerate(registers.codes) if np.rint(wanted[index]) != code]
    worst = _largest_error(calibration, registers)
    angle = np.rad2deg(np.arcsin(min(worst / calibration.field_strength, 1.0))) if np.isfinite(worst) else 90.0
    off = f"by up to {figures(worst / MG, 3)} mG and {figures(float(angle))}°" if angle < 90 else "in any direction"
    losses = "; ".join(_loss(index, float(wanted[index])) for index in beyond)
    return NotExportable(
        f"{losses}. With clipped registers, corrected readings would be off {off}. {_advice(calibration)}",
        beyond=[NAMES[index] for index in beyond],
        wanted={NAMES[index]: float(wanted[index] * STEPS[index]) for index in beyond},
        lost={NAMES[index]: float((wanted[index] - registers.codes[index]) * STEPS[index]) for index in beyond},
        error_mG=float(worst / MG),
    )


def _loss(index: int, wanted: float) -> str:
    """Words about one register whose value is out of range: value, range, and the part beyond the range.

    >>> _loss(0, -34120.0)
    'HARD_IRON_X would be -3,412 mG and holds -3276.8 to +3276.7 mG, 135 mG are lost'
    >>> _loss(7, 34180.0)
    'SOFT_IRON_S22 would be +104.31% and holds -100% to +99.997%, 4.31% are lost'
    """
    lost = abs(wanted - (LOWEST if wanted < 0 else HIGHEST))
    step, unit, sizes, room = (
        (HARD_IRON_STEP_MG, " mG", 4, "-3276.8 to +3276.7 mG")
        if index < 3
        else (100 * SOFT_IRON_STEP, "%", 5, "-100% to +99.997%")
    )
    return (
        f"{NAMES[index]} would be {'+' * (wanted > 0)}{figures(wanted * step, sizes)}{unit} and holds {room}, "
        f"{figures(lost * step, 3)}{unit} are lost"
    )


def _largest_error(calibration: Calibration, registers: Registers) -> float:
    """Bound in µT on the error of corrected readings, |F (W' W⁻¹ − I) u + W' b + H| in a field F u."""
    matrix, offset = in_recorded_axes(calibration)
    effective = np.eye(3) + registers.soft_iron
    with np.errstate(all="ignore"):
        stretch = calibration.field_strength * (effective @ np.linalg.inv(matrix) - np.eye(3))
        shift = effective @ offset + MG * registers.hard_iron
        if not (np.isfinite(stretch).all() and np.isfinite(shift).all()):
            return float("inf")
        return float(np.linalg.norm(stretch, 2) + np.linalg.norm(shift))


def _advice(calibration: Calibration) -> str:
    """Advice on registers that are too small: calibrate without the field strength, or else remove magnetic parts."""
    scale = float(np.exp(np.linalg.slogdet(calibration.matrix)[1] / 3))
    relative = np.rint(_register_values(replace(calibration, matrix=calibration.matrix / scale)))
    if calibration.field_strength_known and relative.min() >= LOWEST and relative.max() <= HIGHEST:
        return "Calibrated without the field strength it fits: headings stay the same, lengths become relative"
    return "Take away or demagnetise what is near the sensor, or correct its readings outside the device"


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the twelve registers.

    Raises the errors of `Registers.of`, and `NotExportable` if rounding makes I + S singular.
    """
    registers = Registers.of(calibration)
    try:
        decoded = registers.to_calibration(calibration.field_strength)
    except ArrayError:
        raise NotExportable(
            "rounded to the steps of the registers, all readings would lie in a plane: check the unit of the "
            "recording, and the field strength if it was given",
            hint={"unit": None, "site": None},
            beyond=(),
        ) from None
    values: dict[str, Any] = {
        "hard_iron_step_mG": HARD_IRON_STEP_MG,
        "soft_iron_step": SOFT_IRON_STEP,
        "registers": [register.as_dict() for register in registers.rows],
        "decoded": {"matrix": decoded.matrix, "offset_mG": decoded.offset / MG},
    }
    body = ["#", HEADING, *(register.as_row() for register in registers.rows)]
    return Written(registers.apply, body, values, ["for readings recorded with these registers at 0"])


ADIS16480: Final = Target(
    name="adis16480",
    use="ADIS16480 registers",
    group="chips and IMUs",
    suffix=".txt",
    title="ADIS16480",
    formula="M_C = (I + S) M + H",
    unit="mG",
    keeps="all",
    storage="int16: H in 0.1 mG to +/-3276.7, S in 1/32768 to +/-100 %",
    source="data sheets, ADIS16480 Rev. H page 35 and ADIS16488 Rev. B page 25",
    errors_in="mG",
    unverified=("that one step of S is 1/32768, and that H is added after (I + S); look both up in your data sheet",),
    docs="classic/registers.md",
    write=write,
)
TARGETS: Final = (ADIS16480, replace(ADIS16480, name="adis16488", use="ADIS16488 registers", title="ADIS16488"))
