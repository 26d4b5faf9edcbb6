# /// script
# requires-python = ">=3.11"
# dependencies = ["lief==1.0.0"]
# ///
"""Builds the wheels of a release for all platforms on this machine, and inspects what is in them.

    uv run release/wheels.py [--platform win_amd64 ...] [--out dist] [--inspect]

The source archive is built once, and of it a wheel for each platform of `src/flinders/native/build.py`: zig compiles
the engine for all of them, this machine's included, so that a Linux wheel asks for glibc 2.17 and no newer. Each
library is then taken out of its wheel and read: format and machine, what it exports, and what it needs of the system.
A bill of materials is written beside them.
Whatever differs from what is expected is printed, and the exit code is 1. ``--inspect`` reads wheels that are there.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import ModuleType

    import lief

    from flinders.native import build

ROOT: Final = Path(__file__).resolve().parent.parent

PINS: Final = "ziglang==0.17.1\n"
"""The compiler of a release; with another one read what `--inspect` says."""

GLIBC: Final = (2, 17)
"""The newest version of a symbol that a Linux library may need: CentOS 7, Debian 8."""

MACOS: Final = (11, 0)
"""The oldest macOS that a library has to run on."""

SYSTEM_LIBRARIES: Final = {
    "ELF": r"lib[cm]\.so\.6",
    "MACHO": r"/usr/lib/libSystem\.B\.dylib",
    "PE": r"(?i:kernel32\.dll|api-ms-win-crt-[\w-]+\.dll)",
}
"""Libraries that every system of a format has."""

EXPECTED: Final = {
    ("linux", "x86_64"): ("ELF", "X86_64"),
    ("linux", "aarch64"): ("ELF", "AARCH64"),
    ("darwin", "x86_64"): ("MACHO", "X86_64"),
    ("darwin", "arm64"): ("MACHO", "ARM64"),
    ("win32", "x86_64"): ("PE", "AMD64"),
}
"""Format and machine of a library, by system and machine of Python."""


@dataclass(frozen=True)
class Library:
    """What the headers of a shared library say.

    Attributes
    ----------
    format, machine : str
        Such as ELF and X86_64.
    exports, libraries : tuple of str
        Names that it defines for others, and libraries that it loads.
    system : tuple of int
        glibc that its symbols need, or the oldest macOS; empty on Windows.
    is_signed : bool
        It has a code signature, as macOS asks for on ARM.
    """

    format: str
    machine: str
    exports: tuple[str, ...]
    libraries: tuple[str, ...]
    system: tuple[int, ...] = ()
    is_signed: bool = False


def read_library(path: Path) -> Library:
    """Read the headers of a shared library."""
    import lief

    lief.logging.disable()
    parsed = lief.parse(str(path))
    readers: dict[str, Callable[[lief.Binary], Library]] = {"ELF": _elf, "MACHO": _macho, "PE": _pe}
    return readers[parsed.format.name](parsed)


def _elf(parsed: lief.ELF.Binary) -> Library:
    """A library of Linux."""
    versions = [symbol.symbol_version for symbol in parsed.dynamic_symbols if symbol.has_version]
    names = [version.symbol_version_auxiliary.name for version in versions if version.has_auxiliary_version]
    glibc = [tuple(map(int, name.removeprefix("GLIBC_").split("."))) for name in names if name.startswith("GLIBC_")]
    exports = tuple(sorted({str(symbol.name) for symbol in parsed.exported_symbols}))
    needs = tuple(map(str, parsed.libraries))
    return Library("ELF", parsed.header.machine_type.name, exports, needs, max(glibc, default=()))


def _macho(parsed: lief.MachO.Binary) -> Library:
    """A library of macOS; the linker's own names, of its header, are no exports."""
    linkers = {"__mh_dylib_header", "___dso_handle"}
    names = {str(symbol.name) for symbol in parsed.exported_symbols} - linkers
    exports = tuple(sorted(name.removeprefix("_") for name in names))
    loads = tuple(str(entry.name) for entry in parsed.libraries if entry.command.name != "ID_DYLIB")
    oldest = tuple(parsed.build_version.minos)[:2] if parsed.has_build_version else ()
    return Library("MACHO", parsed.header.cpu_type.name, exports, loads, oldest, parsed.has_code_signature)


def _pe(parsed: lief.PE.Binary) -> Library:
    """A library of Windows."""
    exports = tuple(sorted(str(entry.name) for entry in parsed.get_export().entries))
    return Library("PE", parsed.header.machine.name, exports, tuple(str(entry.name) for entry in parsed.imports))


def problems(library: Library, target: build.Platform, functions: set[str]) -> Iterator[str]:
    """Say what is wrong with a library that was compiled for a platform and has to export these functions."""
    wanted = EXPECTED[target.system, target.machine]
    if (library.format, library.machine) != wanted:
        yield f"it is {library.format} for {library.machine}, and has to be {wanted[0]} for {wanted[1]}"
    for names, what in (
        (sorted(functions - set(library.exports)), "does not export"),
        (sorted(set(library.exports) - functions), "exports more than flinders.h declares:"),
        ([name for name in library.libraries if not re.fullmatch(SYSTEM_LIBRARIES[wanted[0]], name)], "loads"),
    ):
        if names:
            yield f"it {what} {', '.join(names)}"
    if target.system == "linux" and library.system > GLIBC:
        yield f"it needs glibc {_dotted(library.system)}, newer than {_dotted(GLIBC)}"
    if target.system == "darwin" and library.system != MACOS:
        yield f"it is for macOS {_dotted(library.system)}, and has to be for {_dotted(MACOS)}"
    if (target.system, target.machine) == ("darwin", "arm64") and not library.is_signed:
        yield "it is not signed, and macOS on ARM does not load it"


def declared_functions() -> set[str]:
    """Functions that flinders.h declares."""
    return set(_build_module().function_names())


def inspect_wheel(wheel: Path, tag: str, target: build.Platform) -> list[str]:
    """Print what a wheel's library is, and say what is wrong with the wheel."""
    with zipfile.ZipFile(wheel) as opened, tempfile.TemporaryDirectory() as folder:
        compiled = {Path(name).name: name for name in opened.namelist() if "/native/compiled/" in name}
        licences = {name for name in compiled if name.startswith("LICENSE")}
        modules = {name for name in compiled if name.endswith(".wasm")}
        libraries = sorted(set(compiled) - licences - modules)
        wrong = [] if len(libraries) == 1 else [f"it has {len(libraries)} libraries, and has to have one"]
        wrong += [] if len(modules) == 1 else [f"it has {len(modules)} WebAssembly modules, and has to have one"]
        own = ["LICENSE-mingw-w64"] if target.system == "win32" else []
        wanted = {"LICENSE-zig", "LICENSE-wasi-libc", "LICENSE-musl", *own}
        wrong += [f"it lacks {name}, the licence of what zig links" for name in sorted(wanted - licences)]
        wrong += [] if f"-py3-none-{tag}." in wheel.name else [f"its name does not say {tag}"]
        for name in libraries:
            library = read_library(Path(opened.extract(compiled[name], folder)))
            print(
                f"{wheel.name}: {library.format} {library.machine}, {len(library.exports)} functions, system "
                f"{_dotted(library.system) or 'any'}, loads {', '.join(library.libraries)}"
            )
            wrong += problems(library, target, declared_functions())
    return wrong


def build_wheel(archive: Path, tag: str, out: Path) -> None:
    """Build a wheel for a platform from the source archive."""
    with tempfile.TemporaryDirectory() as folder:
        pins = Path(folder) / "pins.txt"
        pins.write_text(PINS, encoding="utf-8")
        command = ["uv", "build", "--quiet", "--wheel", "--build-constraints", str(pins), "--out-dir", str(out)]
        subprocess.run([*command, str(archive)], env={**os.environ, "FLINDERS_TARGET": tag}, check=True)


def build_archive(out: Path) -> Path:
    """Build the source archive."""
    subprocess.run(["uv", "build", "--quiet", "--sdist", "--out-dir", str(out), str(ROOT)], check=True)
    return max(out.glob("flinders-*.tar.gz"), key=lambda path: path.stat().st_mtime)


def write_bill_of_materials(out: Path) -> None:
    """Write what Flinders and its extras were resolved to, with hashes, as ``flinders.cdx.json`` (CycloneDX 1.5)."""
    out.mkdir(parents=True, exist_ok=True)
    words = ["uv", "export", "--quiet", "--format", "cyclonedx1.5", "--all-extras", "--no-dev"]
    subprocess.run([*words, "--output-file", str(out / "flinders.cdx.json")], check=True, cwd=ROOT)


def platforms() -> dict[str, build.Platform]:
    """Platforms that wheels are released for, by tag."""
    known: dict[str, build.Platform] = _build_module().PLATFORMS
    return known


def _build_module() -> ModuleType:
    """`native/build.py` from the package's source, which need not be installed."""
    path = ROOT / "src/flinders/native/build.py"
    spec = importlib.util.spec_from_file_location("flinders_build", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _dotted(version: tuple[int, ...]) -> str:
    """A version as it is written."""
    return ".".join(map(str, version))


def main() -> int:
    """Build and inspect; 1 if something is wrong."""
    known = platforms()
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--platform", action="append", choices=list(known), help="one of them; default: all")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheels; default: dist")
    parser.add_argument("--inspect", action="store_true", help="build nothing, inspect the wheels that there are")
    chosen = parser.parse_args()
    tags = chosen.platform or list(known)
    if not chosen.inspect:
        write_bill_of_materials(chosen.out)
        archive = build_archive(chosen.out)
        for tag in tags:
            build_wheel(archive, tag, chosen.out)
    failed = 0
    for tag in tags:
        wheels = sorted(chosen.out.glob(f"flinders-*-{tag}.whl"))
        wrong = [] if wheels else [f"there is no wheel for {tag} in {chosen.out}"]
        wrong += [f"{wheel.name}: {text}" for wheel in wheels for text in inspect_wheel(wheel, tag, known[tag])]
        print(*(f"WRONG {text}" for text in wrong), sep="\n", end="\n" * bool(wrong))
        failed += len(wrong)
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
