"""What the firmware costs and how far it is off the library: ``python -m benchmarks.firmware``.

The package that `flinders firmware` writes is compiled for this machine in single and in double precision, and for
Cortex-M0, M4 and M7 where ``arm-none-eabi-gcc`` is installed; ``qemu-system-arm`` runs those and counts instructions.

    python -m benchmarks.firmware                 # sizes, instructions, and every recording of the shared data
    python -m benchmarks.firmware --sizes         # sizes and instructions alone

Offsets and claims are compared with the library's fit of the same readings, those that the board had stored, and with
that of all readings of the recording.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from benchmarks.fits import recordings
from benchmarks.recordings import FOLDER
from flinders import simulate
from flinders.core.units import MICROTESLA
from flinders.errors import FitError, FlindersError
from flinders.findings.row import VERDICTS
from flinders.firmware import package, rules
from flinders.heading.error_propagation import level_gradients
from flinders.native.build import EXACT, STRICT, system_compiler

if TYPE_CHECKING:
    from flinders import Fit
    from flinders.arrays import Floats

HARNESS: Final = Path(__file__).parent / "firmware_board"
READINGS: Final = 300
SEVERITIES: Final = ("", "note", "limits", "refuses")
CROSS: Final = "arm-none-eabi-gcc"
LINKED: Final = ("-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-lm")
QEMU: Final = ("-nographic", "-monitor", "none", "-serial", "none", "-semihosting-config", "enable=on,target=native")
COUNTING: Final = ("-icount", "shift=2")
TIMEOUT_S: Final = 300.0


@dataclass(frozen=True, slots=True)
class Target:
    """A processor: its options for the compiler, and the machine that QEMU runs it on; none for this machine."""

    name: str
    options: tuple[str, ...] = ()
    machine: str = ""
    real: str = "<f4"


HOST: Final = Target("this machine, float")
HOST_DOUBLE: Final = Target("this machine, double", ("-DFLINDERS_DOUBLE",), real="<f8")
M0: Final = Target("Cortex-M0", ("-mcpu=cortex-m0", "-mthumb"), "mps2-an385")
M4: Final = Target("Cortex-M4F", ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"), "mps2-an386")
M7: Final = Target("Cortex-M7F", ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"), "mps2-an500")
BOARDS: Final = (M0, M4, M7)


def missing_tools() -> str:
    """Which tools for boards are not installed; empty where all are."""
    return " and ".join(name for name in (CROSS, "qemu-system-arm") if shutil.which(name) is None)


def build(target: Target, folder: Path, *, optimise: str = "-Os") -> Path:
    """Compile the package with its harness, warnings as errors; the program."""
    if not (folder / "package").exists():
        package.write(folder / "package")
    program = folder / f"{target.name.replace(' ', '-').replace(',', '')}{optimise}"
    linker = ("-nostartfiles", "--specs=nosys.specs", "-T", str(HARNESS / "mps2.ld")) if target.machine else ()
    compiler = [CROSS] if target.machine else system_compiler() or ["cc"]
    sources = [*sorted(map(str, (folder / "package" / "src").glob("*.c"))), str(HARNESS / "main.c")]
    wanted = ("-Werror", "-Wdouble-promotion", optimise, *EXACT, *target.options, *linker)
    command = [*compiler, *STRICT, *wanted, *sources, "-I", str(folder / "package" / "src"), *LINKED, "-o", str(program)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return program


def sizes(program: Path) -> dict[str, int]:
    """Bytes of code and constants in flash."""
    done = subprocess.run(["arm-none-eabi-size", str(program)], check=True, capture_output=True, text=True)
    text, data = done.stdout.splitlines()[1].split()[:2]
    return {"flash": int(text) + int(data)}


def layout(real: str) -> np.dtype[np.void]:
    """What the harness writes."""
    answer = np.dtype(
        [
            ("status", "<i4"), ("verdict", "<i4"), ("findings", "u1", (len(rules.on_board()),)), ("offset", real, (3,)),
            ("matrix", real, (3, 3)), ("field", real), ("noise", real), ("heading_rms_deg", real),
            ("heading_worst_deg", real), ("turn", real, (3,)), ("after_deg", real),
        ],
        align=True,
    )  # fmt: skip
    return np.dtype(
        [
            ("answer", answer), ("count", "<i4"), ("state", "<i4"), ("readings", real, (READINGS, 3)),
            ("per_reading", "<i4"), ("per_solve", "<i4"), ("stack", "<i4"),
        ],
        align=True,
    )  # fmt: skip


def run(
    target: Target, program: Path, field: Floats, *, dip_deg: float = 60.0, target_deg: float = 1.0, unit: bool = True
) -> Any:  # noqa: ANN401 - a row of `layout`
    """Run the harness over (N, 3) readings."""
    numbers = np.concatenate([[dip_deg, target_deg, float(unit)], np.ravel(field)]).astype(target.real)
    command = [str(program)]
    if target.machine:
        command = ["qemu-system-arm", "-M", target.machine, "-kernel", str(program), *QEMU, *COUNTING]
    with tempfile.TemporaryDirectory() as folder:
        numbers.tofile(Path(folder, "readings.bin"))
        subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=TIMEOUT_S)
        return np.fromfile(Path(folder, "answer.bin"), layout(target.real))[0]


def verdict_of(fit: Fit) -> int:
    """The worst severity of the library's findings that a board makes as well."""
    codes = {row.code for row in rules.on_board()}
    return max([1, *(SEVERITIES.index(finding.severity) for finding in fit.findings if finding.code in codes)])


def fit_of(samples: Any, unit: str | None = None) -> Fit | None:  # noqa: ANN401 - samples or an array
    """Fit by the library; also one that is refused, and None where there is none."""
    try:
        return flinders.fit(samples) if unit is None else flinders.fit(samples, unit=unit)
    except FitError as error:
        return getattr(error, "fit", None)


def apart_deg(outcome: Any, fit: Fit) -> float:  # noqa: ANN401 - a row of `layout`
    """How far board and library are apart at the worst level heading, degrees."""
    from flinders.geometry.ellipsoid import Ellipsoid

    own = Ellipsoid(outcome["answer"]["offset"], outcome["answer"]["field"] * np.linalg.inv(outcome["answer"]["matrix"]))
    change = own.parameters - fit.ellipsoid.parameters
    return math.degrees(np.abs(level_gradients(fit.ellipsoid, dip_deg=fit.known_dip_deg) @ change).max())


def main() -> None:
    """Print the tables."""


if __name__ == "__main__":
    main()
