"""Compilation of the engine by the system's C compiler, or else by the Python package ``ziglang``.

The library is in the folder ``compiled`` of this package. Its name contains a digest of the sources, the options and
the platform: a change gives a new library, and nothing is compiled twice. A wheel's build hook (``hatch_build.py``)
loads this file by its path before anything is installed, so it imports only the standard library. Modules that only a
compilation needs are imported there, because every start of the program imports this file.

``python -m flinders.native.build`` compiles for this machine; with ``--web`` it makes the WebAssembly module of the
standalone page (`flinders.apps.live.standalone`), which has no imports and exports the functions of flinders.h.

>>> [source.name for source in sources()][:3]
['about.c', 'attitude.c', 'axes.c']
>>> PLATFORMS["macosx_11_0_arm64"].zig
'aarch64-macos.11.0'
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

SOURCE_FOLDER: Final = Path(__file__).parent

LIBRARY_FOLDER: Final = SOURCE_FOLDER / "compiled"
"""Folder of the library, in a wheel and in a checkout."""

STRICT_OPTIONS: Final = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wstrict-prototypes")
"""Options for language and warnings; only tests add ``-Werror``, so that new warnings never stop an installation."""

EXACT_OPTIONS: Final = ("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""Options for identical digits on all platforms: no fused multiply-add. ``-ffast-math`` would change digits."""

FAST_OPTIONS: Final = ("-O3", "-fvisibility=hidden")

SMALL_OPTIONS: Final = ("-Os", "-fno-vectorize", "-fno-slp-vectorize")
"""Options for browsers, for sources without loops over all readings; they save a third of the module's size."""

SMALL_LOOP_OPTIONS: Final = ("-fno-unroll-loops",)
"""Options for browsers, for loops over all readings: 5 kB less to transfer; a fit takes a tenth longer than 1.1 ms."""

PAGE_MODULE: Final = SOURCE_FOLDER.parent / "apps/live/static/standalone/engine.js"
"""Module of the page that calls the engine in browsers."""

TEST_FUNCTIONS: Final = ("flinders_is_checked",)
"""Functions that the module for browsers exports only for the test that compares the bindings."""

AVX2_OPTIONS: Final = ("-mavx2", "-mfma", "-DFL_VARIANT=avx2")

ZIG_PACKAGE: Final = "ziglang"

COMPILER_REMEDY: Final = (
    f"install gcc or clang, or run 'pip install {ZIG_PACKAGE}', or name a compiler in the variable CC, then try again"
)

SUFFIXES: Final = {"win32": ".dll", "darwin": ".dylib", "wasi": ".wasm"}
"""Suffixes of a shared library, by system."""

WEB_STACK_BYTES: Final = 1 << 20
"""Size of the stack of the WebAssembly module in bytes."""


class NoCompiler(Exception):
    """No C compiler was found, or it failed; the message says which."""


class Platform(NamedTuple):
    """Target of a compilation.

    Attributes
    ----------
    system : str
        System, as in `sys.platform`.
    machine : str
        Machine, as in `platform.machine`, with x86_64 for AMD64.
    zig : str
        Target of ``zig cc``; empty for this machine.
    """

    system: str
    machine: str
    zig: str = ""

    @property
    def suffix(self) -> str:
        """Suffix of a shared library."""
        return SUFFIXES.get(self.system, ".so")

    @property
    def options(self) -> list[str]:
        """Options of the compiler for this platform."""
        position = [] if self.system in ("win32", "wasi") else ["-fPIC"]
        wide = {"x86_64": ["-DFL_WITH_AVX2"], "wasm32": ["-msimd128"]}
        return [*position, *wide.get(self.machine, [])]

    def smaller(self, name: str) -> tuple[str, ...]:
        """Options that reduce the size of a source's code in browsers; loops over all readings stay fast."""
        if self.system != "wasi":
            return ()
        return SMALL_LOOP_OPTIONS if name == "kernels.c" else SMALL_OPTIONS

    def link_options(self, name: str) -> list[str]:
        """Options of the linker for this platform and a library of this name."""
        if self.system == "wasi":
            exports = (f"-Wl,--export={symbol}" for symbol in ("__heap_base", *page_functions()))
            return ["-mexec-model=reactor", f"-Wl,-z,stack-size={WEB_STACK_BYTES}", *exports]
        own = [f"-Wl,-install_name,@rpath/{name}"] if self.system == "darwin" else ["-lm"]
        return ["-shared", *([] if self.system == "win32" else own)]


THIS_PLATFORM: Final = Platform(sys.platform, {"AMD64": "x86_64"}.get(platform.machine(), platform.machine()))
"""The platform of this process."""

PLATFORMS: Final = {
    "manylinux_2_17_x86_64": Platform("linux", "x86_64", "x86_64-linux-gnu.2.17"),
    "manylinux_2_17_aarch64": Platform("linux", "aarch64", "aarch64-linux-gnu.2.17"),
    "macosx_11_0_x86_64": Platform("darwin", "x86_64", "x86_64-macos.11.0"),
    "macosx_11_0_arm64": Platform("darwin", "arm64", "aarch64-macos.11.0"),
    "win_amd64": Platform("win32", "x86_64", "x86_64-windows-gnu"),
}
"""Platforms of released wheels, by the tag of the wheel."""

WEB_PLATFORM: Final = Platform("wasi", "wasm32", "wasm32-wasi")
"""Platform of browsers, for which the engine is a WebAssembly module."""


def sources() -> list[Path]:
    """C files of the engine, in order of name."""
    return sorted(SOURCE_FOLDER.glob("*.c"))


def function_names() -> list[str]:
    """Functions that flinders.h declares, in its order."""
    import re

    text = (SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8")
    return re.findall(r"^FLINDERS_API .*?(flinders_\w+)\(", text, flags=re.MULTILINE)


def page_functions() -> list[str]:
    """Functions of the module for browsers: those that the page calls, and `TEST_FUNCTIONS`."""
    called = set(PAGE_MODULE.read_text(encoding="utf-8").replace("(", ".").split("."))
    return [name for name in function_names() if name in called or name in TEST_FUNCTIONS]


def library_path(
    directory: Path | None = None, *, options: Sequence[str] = (), target: Platform = THIS_PLATFORM
) -> Path:
    """Path of the library of these sources, whether or not it exists; parameters as in `library`."""
    directory = directory or Path(os.environ.get("FLINDERS_NATIVE_BUILD") or LIBRARY_FOLDER)
    return directory / f"flinders-{_source_digest(options, target)}{target.suffix}"


def library(directory: Path | None = None, *, options: Sequence[str] = (), target: Platform = THIS_PLATFORM) -> Path:
    """Compile the engine unless the library exists.

    Parameters
    ----------
    directory : Path, optional
        Folder of the library; by default that in the variable ``FLINDERS_NATIVE_BUILD``, or ``compiled`` in this
        package.
    options : sequence of str
        Additional options of the compiler, such as ``-DFLINDERS_FLOAT``.
    target : Platform
        Target platform; by default this machine.

    Returns
    -------
    Path
        The shared library.

    Raises
    ------
    NoCompiler
        If there is no C compiler, if it fails, or if the folder cannot be written.
    """
    made = library_path(directory, options=options, target=target)
    if not made.exists():
        import shutil

        try:
            made.parent.mkdir(parents=True, exist_ok=True)
            command = compiler(target)
            compile_library(made, compiler=command, options=options, target=target)
            for name, licence in _licences(command, target).items():
                shutil.copyfile(licence, made.parent / name)
        except OSError as error:
            raise NoCompiler(
                f"the engine cannot be compiled into {made.parent} ({error.strerror}): name a folder that can be "
                "written to, in the variable FLINDERS_NATIVE_BUILD"
            ) from error
    return made


def compiler(target: Platform = THIS_PLATFORM) -> list[str]:
    """Command of a C compiler: that in ``CC``, else the first of cc, gcc and clang that works, else zig.

    For other platforms than this machine it is always zig.

    Raises
    ------
    NoCompiler
        If there is none.
    """
    import importlib.util

    command = None if target.zig else system_compiler()
    if command:
        return command
    if importlib.util.find_spec(ZIG_PACKAGE) is None:
        if target.zig:
            install = f"'pip install {ZIG_PACKAGE}', or 'uv run --with {ZIG_PACKAGE} flinders …' in a checkout"
            raise NoCompiler(f"{ZIG_PACKAGE} is needed to compile for {target.zig}: run {install}")
        raise NoCompiler(f"the engine has to be compiled, and there is no C compiler here: {COMPILER_REMEDY}")
    machine = ["-target", target.zig] if target.zig else ["-mcpu=baseline"]
    return [sys.executable, "-m", ZIG_PACKAGE, "cc", *machine]


def system_compiler() -> list[str] | None:
    """Command of the system's C compiler, if it finds the C headers; None if there is none."""
    import shlex
    import shutil

    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    return next(([name] for name in ("cc", "gcc", "clang") if shutil.which(name) and _has_headers(name)), None)


def _has_headers(name: str) -> bool:
    """Whether a compiler finds math.h: gcc may lack headers, and `cc` of macOS may only offer to install a compiler."""
    import subprocess

    command = [name, "-E", "-x", "c", "-"]
    return subprocess.run(command, input=b"#include <math.h>\n", capture_output=True, check=False).returncode == 0


def compile_library(
    made: Path, *, compiler: Sequence[str], options: Sequence[str] = (), target: Platform = THIS_PLATFORM
) -> None:
    """Compile and link the engine, with kernels for the baseline processor and on x86-64 also for AVX2_OPTIONS.

    Parameters
    ----------
    made : Path
        Path of the shared library, which is written atomically.
    compiler : sequence of str
        Command of a C compiler with options as those of GCC, such as ``["zig", "cc", "-target", ...]``.
    options : sequence of str
        Additional options.
    target : Platform
        Target platform of the compiler.

    Raises
    ------
    NoCompiler
        If the compiler fails, with its output.
    """
    import tempfile
    from concurrent.futures import ThreadPoolExecutor

    flags = [*STRICT_OPTIONS, *FAST_OPTIONS, *EXACT_OPTIONS, *target.options, *options]
    with tempfile.TemporaryDirectory(dir=made.parent) as folder:
        room = Path(folder)
        jobs = [(source, room / f"{source.stem}.o", [*flags, *target.smaller(source.name)]) for source in sources()]
        if target.machine == "x86_64":
            jobs.append((SOURCE_FOLDER / "kernels.c", room / "kernels_avx2.o", [*flags, *AVX2_OPTIONS]))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda job: _run([*compiler, *job[2], "-c", str(job[0]), "-o", str(job[1])]), jobs))
        objects, linked = [str(compiled) for _, compiled, _ in jobs], room / made.name
        stripped = [] if "-g" in options else ["-Wl,-S"]
        _run([*compiler, *options, *stripped, *objects, *target.link_options(made.name), "-o", str(linked)])
        linked.replace(made)


def _licences(compiler: Sequence[str], target: Platform) -> dict[str, Path]:
    """Licences of the code that zig links into a library, by the name of their copy next to the library."""
    import importlib.util

    spec = importlib.util.find_spec(ZIG_PACKAGE)
    if ZIG_PACKAGE not in compiler or spec is None or spec.origin is None:
        return {}
    package = Path(spec.origin).parent
    libc = package / "lib" / "libc"
    linked = {
        "win32": {"LICENSE-mingw-w64": libc / "mingw" / "COPYING"},
        "wasi": {
            "LICENSE-wasi-libc": libc / "wasi" / "LICENSE-MIT",
            "LICENSE-musl": libc / "wasi" / "libc-top-half" / "musl" / "COPYRIGHT",
        },
    }
    return {"LICENSE-zig": package / "LICENSE", **linked.get(target.system, {})}


def _run(command: Sequence[str]) -> None:
    """Run a command of the compiler; raises `NoCompiler` if it fails."""
    import shlex
    import subprocess

    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise NoCompiler(f"{command[0]} cannot be run ({error}): set the variable CC to another C compiler") from error
    if done.returncode:
        raise NoCompiler(f"{shlex.join(command)} failed:\n{done.stderr.strip()}")


def _source_digest(options: Sequence[str], target: Platform) -> str:
    """Digest of sources, options and platform, 16 hexadecimal digits, independent of line endings."""
    exported = page_functions() if target.system == "wasi" else ()
    every = (
        STRICT_OPTIONS,
        FAST_OPTIONS,
        SMALL_OPTIONS,
        SMALL_LOOP_OPTIONS,
        EXACT_OPTIONS,
        AVX2_OPTIONS,
        target.options,
        tuple(options),
    )
    parts = (*every, target.system, target.machine, *exported)
    digest = hashlib.sha256(repr(parts).encode())
    for file in [*sources(), *sorted(SOURCE_FOLDER.glob("*.h"))]:
        digest.update(file.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    try:
        sys.stdout.write(f"{library(target=WEB_PLATFORM if '--web' in sys.argv else THIS_PLATFORM)}\n")
    except NoCompiler as error:
        sys.exit(str(error))
