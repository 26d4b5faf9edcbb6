"""Shared parts of all tests: real recordings, golden files, numbers of trials, hypothesis profiles."""

from __future__ import annotations

import gc
import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings
from tests.trials import Trials

pytest.register_assert_rewrite("tests.sentences")
from tests.sentences import RECORDINGS, Sentences  # noqa: E402 - asserts in it are rewritten

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from tests.trials import Choose

ROOT = Path(__file__).resolve().parent.parent
GOLDEN = ROOT / "tests" / "golden" / "files"
# A worker takes a file at a time. These take longest, and one that is begun last keeps the others waiting. Tests that
# wait for a browser or a port stand between tests that compute, so that no core is idle.
LONGEST = (
    "test_page", "test_cli", "test_standalone", "test_fleet", "test_text_reader", "test_live_program",
    "test_report_command", "test_recorder", "test_disturbances", "test_page_engine", "test_together", "test_record",
    "test_foreign_files", "test_ros", "test_send_mavlink", "test_report", "test_dates", "test_readers",
    "test_watch", "test_feeds", "test_disturbance_findings", "test_page_lines", "test_drift", "test_heading_command",
    "test_live_server", "test_firmware", "test_one_judge", "test_aided", "test_several_magnetometers",
    "test_real_recordings",
)  # fmt: skip
ON_CI = bool(os.environ.get("CI"))

# The workers of pytest take all cores already. Threads of BLAS would wait for each other: with two of them, a joint fit
# of three sensors takes eight times as long. NumPy reads this when it is first imported, which is after this file.
for _threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_threads, "1")

# A shared machine is sometimes slow for a moment: no deadline. On CI the same examples every time.
settings.register_profile("default", deadline=None, max_examples=10)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True, max_examples=10)
settings.register_profile("full", deadline=None, print_blob=True, max_examples=100)
settings.load_profile("ci" if ON_CI else "default")

# A shell starts what runs in the background deaf to Ctrl-C, and so would be the programs that tests interrupt.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Hundreds of tests start a program: compiled once, each starts in half the time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Texts are as wide as the terminal: here as if there were none.
os.environ["COLUMNS"] = "80"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate", action="store_true", help="rewrite the golden files instead of comparing")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Sentences(config))


def pytest_xdist_auto_num_workers() -> int:
    """Number of workers: one more than cores, as tests with a browser or a serial port mostly wait."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Collect no doctests from files of tests; a search for them takes as long as the collection of tests."""
    collectors = yield
    is_of_tests = file_path.name.startswith("test_")
    return [one for one in collectors if not (is_of_tests and isinstance(one, DoctestModule))]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests with a number of trials as claims, for ``pytest -m claims``, and sort long files first."""
    for item in items:
        if "trials" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.claims)
    items.sort(key=lambda item: LONGEST.index(item.path.stem) if item.path.stem in LONGEST else len(LONGEST))


def pytest_collection_finish() -> None:
    """Keep the garbage collector from scanning the thousands of tests, which stay until the end."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def trials(pytestconfig: pytest.Config) -> Choose:
    """Number of trials of a claim: ``trials(500, 40)`` is 500 under ``pytest -m claims``, else 40 as a smoke test."""
    chosen = str(pytestconfig.getoption("markexpr", default=""))
    is_complete = "claims" in chosen and "not claims" not in chosen
    return partial(Trials.choose, is_complete)


@pytest.fixture(scope="session")
def recordings() -> Callable[[str], Path]:
    """Path of a real recording: ``recordings("michaelwro_fxos8700/mag-readings.txt")``.

    Recordings are in the folder FLINDERS_DATA, else in ``shared/data`` next to the project. Without them a test is
    skipped; on CI it fails.
    """

    def find(name: str) -> Path:
        path = RECORDINGS / name
        if path.exists():
            return path
        message = f"no recording {path}: set FLINDERS_DATA to the folder that holds {name}"
        if ON_CI:
            pytest.fail(message)
        pytest.skip(message)

    return find


@pytest.fixture(autouse=True)
def page_of_80_columns(request: pytest.FixtureRequest) -> None:
    """Run golden tests in an empty folder, with a terminal of 80 columns, which is the width of help."""
    if request.path.parent.name == "golden" or request.path.stem.endswith("_golden"):
        monkeypatch = request.getfixturevalue("monkeypatch")
        monkeypatch.setenv("COLUMNS", "80")
        monkeypatch.chdir(request.getfixturevalue("tmp_path"))


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Compare a text with a reviewed file: ``golden("cli/demo.txt", output)``; ``pytest --regenerate`` rewrites it."""
    regenerate = bool(request.config.getoption("--regenerate", default=False))

    def check(name: str, text: str) -> None:
        path = GOLDEN / name
        if regenerate:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text.encode())
            return
        if not path.exists():
            pytest.fail(f"no golden file {path}: write it with `uv run pytest --regenerate` and review it")
        assert text == path.read_bytes().decode(), f"{name} differs: `uv run pytest --regenerate`, then review the diff"

    return check
