"""What a good verdict rests on is stated of each unit of a fleet, too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from tests.findings.test_conditions import assert_states_it

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("options", [(), ("--json",), ("--report", "page.html")], ids=["terminal", "JSON", "page"])
def test_a_current_that_follows_the_attitude_is_a_condition(
    options: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_states_it(("fleet", "logs", "--output", "rows.parquet", "--workers", "0", *options), tmp_path)
