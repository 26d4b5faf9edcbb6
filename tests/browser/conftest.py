"""A real browser that reaches only the program which a test has started; complaints of its pages fail the test.

Without a browser these tests are skipped with a reason; they fail if FLINDERS_BROWSER is ``required``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

import numpy as np
import pytest
from benchmarks.stage import NAMES, chromium, chromium_path
from tests.browser.visitor import UNTIL_MS
from tests.npm import package

from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser


IS_REQUIRED: Final = os.environ.get("FLINDERS_BROWSER") == "required"
HEADER: Final = "t_s,mx_uT,my_uT,mz_uT"


def missing(what: str) -> NoReturn:
    """Skip a test; fail it if browser tests are required."""
    if IS_REQUIRED:
        pytest.fail(f"{what}, and FLINDERS_BROWSER is required", pytrace=False)
    pytest.skip(what)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.browser)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        import playwright  # noqa: F401
    except ModuleNotFoundError:
        missing("playwright is not installed")
    if chromium_path() is None:
        missing(f"there is no browser here: install one of {', '.join(NAMES)}")
    from playwright.sync_api import expect

    expect.set_options(timeout=UNTIL_MS)  # a busy machine is slow, and what is expected is waited for
    with chromium() as found:
        yield found


@pytest.fixture(scope="session")
def tumble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of 60 s in µT: 3,000 readings of a sensor that is turned by hand through all directions."""
    samples = simulate.tumble(seed=3, noise=0.3).samples
    path = tmp_path_factory.mktemp("logs") / "tumble.csv"
    rows = np.column_stack([0.02 * np.arange(len(samples)), samples.field])
    np.savetxt(path, rows, fmt=("%.2f", "%.4f", "%.4f", "%.4f"), delimiter=",", header=HEADER, comments="")
    return path


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Source text of axe-core, in the version of web/package-lock.json."""
    installed = package("axe-core", tmp_path_factory.mktemp("axe"), missing)
    return (installed / "axe.min.js").read_text(encoding="utf-8")
