"""Cost of the firmware, and its difference from the library: ``python -m benchmarks.firmware``.

The package of `flinders firmware` is compiled for this machine in single and double precision and, if
``arm-none-eabi-gcc`` is installed, for Cortex-M0, M4 and M7; ``qemu-system-arm`` runs those and counts instructions.

    python -m benchmarks.firmware                 # sizes, instructions, and every recording of the shared data
    python -m benchmarks.firmware --sizes         # sizes and instructions alone

Offsets and claims are compared with the library's fits of the readings stored by the board, and of all readings.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from benchmarks.fits import recordings
from benchmarks.recordings import FOLDER
from flinders import simulate
from flinders.apps.board import package
from flinders.core.units import MICROTESLA
from flinders.errors import FitError
from flinders.findings.catalogue import ENGINE_FINDINGS
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import level_gradients
from flinders.native.build import EXACT_OPTIONS, STRICT_OPTIONS, system_compiler

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders import Fit
    from flinders.arrays import Floats

    Rows = NDArray[np.void]

HARNESS: Final = Path(__file__).parent / "firmware_board"
READINGS: Final = 300
SEVERITIES: Final = ("", "note", "limits", "refuses")
CROSS: Final = "arm-none-eabi-gcc"
SECTIONS: Final = ("-ffunction-sections", "-fdata-sections")
LINKED: Final = ("-Wl,--gc-sections", "-lm")
QEMU: Final = ("-nographic", "-monitor", "none", "-serial", "none", "-semihosting-config", "enable=on,target=native")
COUNTING: Final = ("-icount", "shift=0")
TIMEOUT_S: Final = 300.0
WORDS: Final = ("", "yes", "lim", "no")
"""Words for the verdicts good, limited and refused, after none."""
BOUND: Final = 2.4
"""Bound of 95 % for all headings over the claim (1 σ at the worst heading), for an offset alone."""


@dataclass(frozen=True, slots=True)
class Target:
    """A processor: compiler options, and QEMU's machine; empty for this machine."""

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
RAM_IN_SERVICE: Final = 10 * 1024
"""RAM for online calibration, with the stack and the C library's data, bytes."""
IN_SERVICE: Final = ("-DSTORED", "--specs=nano.specs", f"-Wl,--defsym=RAM={RAM_IN_SERVICE}")
"""Options for a program that begins from storage, without the calibrator."""


def missing_tools() -> str:
    """Names of missing tools for boards; empty if all are installed."""
    return " and ".join(name for name in (CROSS, "qemu-system-arm") if shutil.which(name) is None)


def compiled(target: Target, folder: Path, *, optimise: str = "-Os") -> list[Path]:
    """Compile the package with warnings as errors, and return the objects."""
    if not (folder / "package").exists():
        package.write(folder / "package")
    objects = folder / f"objects-{_named(target, optimise)}"
    sources = sorted((folder / "package" / "src").glob("*.c"))
    made = [objects / f"{source.stem}.o" for source in sources]
    if objects.exists():
        return made
    objects.mkdir()
    flags = [*STRICT_OPTIONS, "-Werror", "-Wdouble-promotion", optimise, *EXACT_OPTIONS, *target.options, *SECTIONS]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        commands = [
            [*_compiler(target), *flags, "-c", str(source), "-o", str(object_)]
            for source, object_ in zip(sources, made, strict=True)
        ]
        list(pool.map(lambda command: subprocess.run(command, check=True, capture_output=True, text=True), commands))
    return made


def build(
    target: Target, folder: Path, *, optimise: str = "-Os", harness: str = "main", options: Sequence[str] = ()
) -> Path:
    """Link the package with a harness, and return the program."""
    objects = compiled(target, folder, optimise=optimise)
    program = folder / f"{harness}-{_named(target, optimise)}{''.join(options)}"
    linker = ("-nostartfiles", "--specs=nosys.specs", "-T", str(HARNESS / "mps2.ld")) if target.machine else ()
    wanted = (
        *STRICT_OPTIONS,
        "-Werror",
        "-Wdouble-promotion",
        optimise,
        *EXACT_OPTIONS,
        *target.options,
        *SECTIONS,
        *linker,
    )
    sources = [str(HARNESS / f"{harness}.c"), *map(str, objects)]
    include = ["-I", str(folder / "package" / "src")]
    command = [*_compiler(target), *wanted, *options, *sources, *include, *LINKED, "-o", str(program)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return program


def _named(target: Target, optimise: str) -> str:
    return f"{target.name.replace(' ', '-').replace(',', '')}{optimise}"


def _compiler(target: Target) -> Sequence[str]:
    return [CROSS] if target.machine else system_compiler() or ["cc"]


def sizes(program: Path) -> dict[str, int]:
    """Bytes in flash and in RAM of a linked program, without an EEPROM."""
    done = subprocess.run(["arm-none-eabi-size", "-A", str(program)], check=True, capture_output=True, text=True)
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith(".")]
    of = {name: int(size) for name, size, _ in rows}
    data = of.get(".data", 0)
    return {"flash": of[".text"] + of.get(".ARM.exidx", 0) + data, "ram": data + of.get(".bss", 0)}


def layout(real: str) -> np.dtype[np.void]:
    """Layout of the harness's output."""
    return np.dtype(
        [
            ("answer", answer_layout(real)), ("count", "<i4"), ("state", "<i4"), ("readings", real, (READINGS, 3)),
            ("per_reading", "<i4"), ("per_solve", "<i4"), ("stack", "<i4"),
        ],
        align=True,
    )  # fmt: skip


def run(
    target: Target, program: Path, field: Floats, *, dip_deg: float = 60.0, target_deg: float = 1.0, unit: bool = True
) -> Any:  # noqa: ANN401 - a row of `layout`
    """Run the harness over (N, 3) readings."""
    numbers = np.concatenate([[dip_deg, target_deg, float(unit)], np.ravel(field)]).astype(target.real)
    with tempfile.TemporaryDirectory() as folder:
        numbers.tofile(Path(folder, "readings.bin"))
        subprocess.run(_command(target, program), cwd=folder, check=True, capture_output=True, timeout=TIMEOUT_S)
        return np.fromfile(Path(folder, "answer.bin"), layout(target.real))[0]


STORED: Final = np.dtype(
    [
        ("version", "<u4"), ("sequence", "<u4"), ("clock_s", "<u4"), ("is_level", "<i4"), ("in_force", "<f4", (9,)),
        ("latest", "<f4", (9,)), ("covariance", "<f4", (45,)), ("latest_s", "<f4"), ("moved_s", "<f4"),
        ("worst_deg", "<f4"), ("target_deg", "<f4"), ("dip_deg", "<f4"), ("noise", "<f4"), ("place", "<f4"),
        ("scatter", "<f4"), ("rates", "<f4", (7,)), ("expected_walk", "<f4"), ("expected_walk_sigma", "<f4"),
        ("moves", "<f4"), ("moves_square", "<f4"), ("watched", "<f4"), ("moved", "<f4", (3,)),
        ("height", "<f4"), ("height_now", "<f4"), ("height_sigma", "<f4"), ("checksum", "<u4"),
    ]
)  # fmt: skip
"""Layout of a stored record of the online calibration."""
STEPS: Final = ("reading", "begin", "power", "sleep", "ask")
"""Steps of the harness for online calibration."""


def answer_layout(real: str) -> np.dtype[np.void]:
    """Layout of a board's answer."""
    return np.dtype(
        [
            ("status", "<i4"), ("verdict", "<i4"), ("findings", "u1", (len(ENGINE_FINDINGS),)),
            ("is_checked", "u1", (len(ENGINE_FINDINGS),)), ("offset", real, (3,)), ("matrix", real, (3, 3)), ("field", real),
            ("noise", real), ("heading_rms_deg", real), ("heading_worst_deg", real), ("turn", real, (3,)),
            ("after_deg", real),
        ],
        align=True,
    )  # fmt: skip


def steps_of(
    target: Target, what: str, *, ms: ArrayLike = 0, clock_s: ArrayLike = 0, field: ArrayLike = (0.0, 0.0, 0.0)
) -> Rows:
    """Steps of one kind, with times of the board's clock and of a clock that runs without power."""
    kind = np.dtype([("what", "<i4"), ("ms", "<u4"), ("clock_s", "<u4"), ("field", target.real, (3,))], align=True)
    count = max(len(np.atleast_1d(ms)), len(np.atleast_2d(field)))
    rows = np.zeros(count, kind)
    rows["what"], rows["ms"], rows["clock_s"], rows["field"] = STEPS.index(what), ms, clock_s, field
    return rows


def go_on(target: Target, program: Path, steps: Sequence[Rows], eeprom: Rows | None = None) -> tuple[Rows, np.void]:
    """Run the harness for online calibration; returns the state after each step, and the cost."""
    answer = answer_layout(target.real)
    known = [("in_force", answer), ("good_s", target.real), ("adopted_s", target.real), ("learnt_s", target.real)]
    known += [("moved_s", target.real), ("moved_by", target.real), ("is_disturbed", "<i4")]
    counts = [("what", "<i4"), ("ms", "<u4"), ("events", "<i4"), ("stores", "<i4")]
    row = np.dtype([*counts, ("answer", np.dtype(known, align=True))], align=True)
    costs = [("state", "<i4"), ("stack", "<i4"), ("per_reading", "<i4"), ("most", "<i4"), ("eeprom", STORED, (2,))]
    with tempfile.TemporaryDirectory() as folder:
        places = np.zeros(2, STORED) if eeprom is None else eeprom
        Path(folder, "steps.bin").write_bytes(places.tobytes() + b"".join(rows.tobytes() for rows in steps))
        subprocess.run(_command(target, program), cwd=folder, check=True, capture_output=True, timeout=TIMEOUT_S)
        cost = np.fromfile(Path(folder, "cost.bin"), np.dtype(costs))[0]
        return np.fromfile(Path(folder, "answers.bin"), row), cost


def _command(target: Target, program: Path) -> list[str]:
    """Command that runs a program."""
    if not target.machine:
        return [str(program)]
    return ["qemu-system-arm", "-M", target.machine, "-kernel", str(program), *QEMU, *COUNTING]


def verdict_of(fit: Fit, answer: Any) -> int:  # noqa: ANN401 - a row of `layout`
    """Worst severity of those findings of the library that a board also checks."""
    codes = {code for code, is_checked in zip(ENGINE_FINDINGS, answer["is_checked"], strict=True) if is_checked}
    return max([1, *(SEVERITIES.index(finding.severity) for finding in fit.findings if finding.code in codes)])


def fit_of(samples: Any, unit: Any = None) -> Fit | None:  # noqa: ANN401 - samples, or an array and its unit
    """Fit by the library, also a refused one; None without a fit."""
    try:
        return flinders.fit(samples) if unit is None else flinders.fit(samples, unit=unit)
    except FitError as error:
        return getattr(error, "fit", None)


def apart_deg(outcome: Any, fit: Fit) -> float:  # noqa: ANN401 - a row of `layout`
    """Difference of board and library at the worst level heading, degrees."""
    own = Ellipsoid(
        outcome["answer"]["offset"], outcome["answer"]["field"] * np.linalg.inv(outcome["answer"]["matrix"])
    )
    change = own.parameters - fit.calibration.ellipsoid.parameters
    return math.degrees(
        np.abs(level_gradients(fit.calibration.ellipsoid, dip_deg=fit.claim.known_dip_deg) @ change).max()
    )


def compared(name: str, floats: Path, doubles: Path, m4: Path | None) -> dict[str, Any] | None:
    """Compare board and library on a recording; None without two fits.

    `rounding_ut` and `claim_of_double` compare single with double precision on the readings stored by the board,
    `claim_of_library` and `verdicts` board with library on those, and `apart_deg` the board with the library's fit of
    all readings, with both claims. Lengths are scaled to a field of 50 µT. `per_solve` are instructions of a
    Cortex-M4F, and `m4_ut` its difference from this machine; NaN without the tools.
    """
    samples = flinders.read(FOLDER / name)
    unit = samples.unit.inside
    is_ut = unit == MICROTESLA
    board = run(HOST, floats, samples.field, unit=is_ut)
    stored = board["readings"][: int(board["count"])].astype(float)
    single, double = run(HOST, floats, stored, unit=is_ut), run(HOST_DOUBLE, doubles, stored, unit=is_ut)
    fit, whole = fit_of(stored, unit), fit_of(samples)
    if fit is None or whole is None or single["answer"]["status"]:
        return None
    of_single, of_double = single["answer"], double["answer"]
    off = np.abs(of_single["offset"] - of_double["offset"]).max()
    return {
        "name": name,
        "readings": len(samples),
        "method": fit.evidence.method,
        "rounding_ut": float(off * 50.0 / of_double["field"]),
        "claim_of_double": float(of_single["heading_worst_deg"] / of_double["heading_worst_deg"]),
        "verdicts_of_precision": (int(of_single["verdict"]), int(of_double["verdict"])),
        "claim_of_library": float(of_single["heading_worst_deg"] / fit.heading_error_deg.worst),
        "verdicts": (int(of_single["verdict"]), verdict_of(fit, of_single)),
        "claim_deg": float(board["answer"]["heading_worst_deg"]),
        "claim_of_all_deg": whole.heading_error_deg.worst,
        "apart_deg": apart_deg(board, whole),
        "verdict": whole.verdict,
        **_on_m4(m4, stored, single, is_ut=is_ut),
    }


def _on_m4(program: Path | None, stored: Floats, single: Any, *, is_ut: bool) -> dict[str, float]:  # noqa: ANN401
    """Instructions of a solve on a Cortex-M4F, and the difference of its offset from this machine's."""
    if program is None:
        return {"per_solve": math.nan, "m4_ut": math.nan}
    outcome = run(M4, program, stored, unit=is_ut)
    off = np.abs(outcome["answer"]["offset"] - single["answer"]["offset"]).max()
    return {"per_solve": float(outcome["per_solve"]), "m4_ut": float(off * 50.0 / single["answer"]["field"])}


def costs(folder: Path, seed: int = 1) -> list[dict[str, Any]]:
    """Sizes and instructions for each processor, on a simulated tumble with outliers and 300 stored readings."""
    rows = []
    tumble = simulate.tumble(seed=seed, n=500, outliers=0.02).samples.field
    for target in BOARDS:
        program = build(target, folder)
        outcome = run(target, program, tumble)
        numbers = {name: int(outcome[name]) for name in ("state", "stack", "per_reading", "per_solve")}
        rows.append({"target": target.name, **sizes(program), **numbers})
    return rows


def used(target: Target, *, begins: bool) -> list[Rows]:
    """Steps of a sensor turned by hand for two minutes at ten readings a second, after a start of half a minute."""
    sensor = simulate.tumble(seed=1).sensor
    first, later = (simulate.tumble(seed=seed, n=n, sensor=sensor).samples.field for seed, n in ((1, 300), (2, 1200)))
    calibrated = [
        steps_of(target, "reading", ms=100 * np.arange(300), field=first),
        steps_of(target, "begin", ms=30_000),
    ]
    begin = calibrated if begins else [steps_of(target, "power", ms=30_000)]
    return [*begin, steps_of(target, "reading", ms=30_000 + 100 * np.arange(1200), field=later)]


def costs_of_going_on(folder: Path) -> list[dict[str, Any]]:
    """Sizes and instructions of a program that begins from storage, and its flash with a calibrator."""
    here = build(HOST, folder, harness="service")
    eeprom = go_on(HOST, here, used(HOST, begins=True))[1]["eeprom"]
    rows = []
    for target in BOARDS:
        program = build(target, folder, harness="service", options=IN_SERVICE)
        cost = go_on(target, program, used(target, begins=False), eeprom)[1]
        numbers = {name: int(cost[name]) for name in ("state", "stack", "per_reading", "most")}
        both = sizes(build(target, folder, harness="service"))["flash"]
        rows.append({"target": target.name, **sizes(program), "both": both, **numbers})
    return rows


def print_costs(folder: Path) -> None:
    """Print the cost of the firmware, or the missing tools."""
    missing = missing_tools()
    if missing:
        print(f"{missing} not installed: no sizes and no instructions")
        return
    print(f"{'':12} {'flash':>7} {'state':>6} {'stack':>6} {'per reading':>12} {'per solve':>12}")
    for row in costs(folder):
        sized = f"{row['flash']:7,} {row['state']:6,} {row['stack']:6,}"
        print(f"{row['target']:12} {sized} {row['per_reading']:12,} {row['per_solve']:12,}")
    print("\nGoing on, without the calibrator; flash with it")
    print(f"{'':12} {'flash':>7} {'both':>7} {'RAM':>6} {'state':>6} {'stack':>6} {'per reading':>12} {'at most':>12}")
    for row in costs_of_going_on(folder):
        sized = f"{row['flash']:7,} {row['both']:7,} {row['ram']:6,} {row['state']:6,} {row['stack']:6,}"
        print(f"{row['target']:12} {sized} {row['per_reading']:12,} {row['most']:12,}")


def print_accuracy(folder: Path) -> None:
    """Print a row for each recording, and a summary."""
    floats, doubles = build(HOST, folder, optimise="-O2"), build(HOST_DOUBLE, folder, optimise="-O2")
    m4 = None if missing_tools() else build(M4, folder)
    rows = [row for row in (compared(name, floats, doubles, m4) for name in recordings()) if row is not None]
    print(f"{'recording':40} {'readings':>8} {'float-double':>20} {'of library':>16} {'of all readings':>22}")
    for row in rows:
        same = f"{row['rounding_ut']:9.4f} µT {row['claim_of_double']:8.3f}"
        library = f"{row['claim_of_library']:9.2f} {WORDS[row['verdicts'][0]]:>3}/{WORDS[row['verdicts'][1]]:3}"
        whole = f"{row['apart_deg']:8.2f}° {row['claim_deg']:6.2f}° {row['claim_of_all_deg']:6.2f}° {row['verdict']}"
        print(f"{row['name'][-40:]:40} {row['readings']:8,} {same} {library:>16} {whole}")
    print_summary(rows)


def print_summary(rows: list[dict[str, Any]]) -> None:
    """Print a summary of the rows with a verdict of the board."""
    given = [row for row in rows if row["verdicts"][0] < SEVERITIES.index("refuses")]
    ratios = np.sort([row["claim_of_library"] for row in given])
    alike = sum(row["verdicts"][0] == row["verdicts"][1] for row in given)
    solves = [row["per_solve"] for row in given]
    beyond = sum(row["apart_deg"] > BOUND * row["claim_deg"] for row in given)
    print(
        f"\n{len(rows)} recordings, {len(given)} that the board does not refuse, of these:\n"
        f"single off double by at most {max(row['rounding_ut'] for row in given):.4f} µT of 50, its claim by "
        f"{max(abs(row['claim_of_double'] - 1.0) for row in given):.1%}, "
        f"verdicts alike {sum(row['verdicts_of_precision'][0] == row['verdicts_of_precision'][1] for row in given)}\n"
        f"claim over that of the library for the same readings: median {np.median(ratios):.2f}, "
        f"{np.quantile(ratios, 0.1):.2f} to {np.quantile(ratios, 0.9):.2f} for eight of ten, "
        f"verdicts alike {alike}\n"
        f"off the fit of all readings by more than {BOUND} claims: {beyond}\n"
        f"Cortex-M4F: off this machine by at most {max(row['m4_ut'] for row in given):.4f} µT, instructions of a "
        f"solve: median {np.median(solves):,.0f}, nine of ten below {np.quantile(solves, 0.9):,.0f}, at most "
        f"{max(solves):,.0f}, refused ones {max(row['per_solve'] for row in rows):,.0f}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sizes", action="store_true", help="sizes and instructions alone")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print_costs(Path(folder))
        if not arguments.sizes:
            print_accuracy(Path(folder))


if __name__ == "__main__":
    main()
