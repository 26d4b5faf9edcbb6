"""A terminal of 80 columns in an empty folder, for each golden test."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _page(page_of_80_columns: None) -> None:
    """Each test here has such a terminal."""
