"""The engine never crashes, whatever the numbers: fuzzed, and run under the compiler's sanitizers."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.trials import nightly

from flinders.native import build
from flinders.native.engine import engine

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats

try:
    build.compiler()
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

HARNESS = Path(__file__).with_name("native_fuzz.c")

SANITIZED = ("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")


def wild(rng: np.random.Generator) -> Floats:
    """Readings of a kind that no sensor gives, or hardly any."""
    rows = int(rng.choice([0, 1, 2, 5, 9, 10, 11, 12, 13, 40, 64, 65, 300]))
    field: Floats = rng.normal(size=(rows, 3)) * 10.0 ** rng.uniform(-20, 20) + 10.0 ** rng.uniform(-3, 8)
    for change in rng.choice(6, size=2):
        if change == 0 and rows:
            field[rng.integers(rows), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324])
        elif change == 1:
            field[:] = field[:1] if rows else 0.0
        elif change == 2:
            field[:, rng.integers(3)] = 0.0
        elif change == 3:
            field = np.round(field)
    return field


def test_whatever_is_given_a_status_comes_back() -> None:
    rng = np.random.default_rng(5)
    for _ in range(1000):
        robust = int(rng.integers(3))
        prior = float(rng.choice([0.0, 0.3, 1e-9, 1e9, np.nan, -1.0]))
        record = engine().fit(wild(rng), robust=robust, prior=prior)
        assert 0 <= record["status"] <= 9
        assert record["status"] != 0 or np.isfinite(record["centre"]).all()


def harness(folder: Path, *options: str) -> Path:
    """The fuzz harness, linked to an engine with sanitizers, all warnings errors."""
    program = folder / "fuzz"
    flags = ["-Werror", "-g", *SANITIZED, *options]
    empty = folder / "empty.c"
    empty.write_text("int main(void) { return 0; }\n")
    if ran(*build.compiler(), *SANITIZED, str(empty), "-o", str(program)).returncode:
        message = f"{build.compiler()[0]} cannot link {' '.join(SANITIZED)}"
        if os.environ.get("FLINDERS_SANITIZERS") == "required":
            pytest.fail(message)
        pytest.skip(message)
    engine = build.library(folder, options=flags)
    files = [f"-I{build.SOURCE_FOLDER}", str(HARNESS), str(engine), f"-Wl,-rpath,{folder}", "-lm"]
    done = ran(*build.compiler(), *build.STRICT_OPTIONS, *flags, *files, "-o", str(program))
    assert done.returncode == 0, done.stderr
    return program


def ran(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.tools
@pytest.mark.parametrize("real", [None, nightly("-DFLINDERS_FLOAT")], ids=["double", "float"])
def test_no_memory_error_and_nothing_undefined(tmp_path: Path, trials: Choose, real: str | None) -> None:
    """A few calls are sooner made than an optimising compiler is done."""
    claim = trials(1_000_000, 200)
    calls, optimised = claim.count, "-O1" if claim.widening == 1.0 else "-O0"
    done = ran(str(harness(tmp_path, optimised, *([real] if real else []))), str(calls))
    assert done.returncode == 0, done.stdout + done.stderr
    said = re.fullmatch(r"(\d+) calls, (\d+) fitted\n", done.stdout)
    assert said
    assert int(said[1]) == calls
    assert 0.2 * calls < int(said[2]) < 0.8 * calls, "the numbers are as wild as readings are, not wilder"


@pytest.mark.nightly
def test_the_product_is_compiled_without_a_warning(tmp_path: Path) -> None:
    """By a compiler that optimises, which sees more; every run has the harness above, and `test_native.py` floats."""
    for real in ([], ["-DFLINDERS_FLOAT"]):
        assert build.library(tmp_path, options=["-Werror", *real]).exists()
