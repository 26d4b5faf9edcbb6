"""A terminal of 80 columns in an empty folder, for each golden test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def page_of_80_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Help is as wide as the terminal; recordings lie in the working directory."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
