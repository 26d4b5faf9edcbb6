"""What `flinders info` prints of a table, to the letter, as docs/cli/ shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.golden.sessions import session

from flinders import simulate

if TYPE_CHECKING:
    from tests.golden.sessions import Golden


@pytest.fixture(autouse=True)
def table() -> None:
    """A table with one magnetometer, in the working directory."""
    field = simulate.tumble(seed=2).samples.field
    np.savez("bench.npz", t=np.arange(len(field)) / 50, mag=field.round(2))


def test_info_of_a_table(golden: Golden) -> None:
    golden("cli/info-table.txt", session("flinders info bench.npz --at 43.77,11.26 --date 2026-06-01"))
