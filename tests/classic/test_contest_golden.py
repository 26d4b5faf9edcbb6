"""What `flinders compare-methods` prints, to the letter; its clock ticks once a millisecond."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from tests.golden.sessions import session
from tests.worlds import write_field

from flinders import simulate

if TYPE_CHECKING:
    from pathlib import Path

    import pytest
    from tests.golden.sessions import Golden


def test_a_few_methods_on_a_tumble(golden: Golden, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = itertools.count()
    monkeypatch.setattr("flinders.apps.classic.methods.time.perf_counter", lambda: next(ticks) * 1e-3)
    field = simulate.tumble(seed=8, n=1500).samples.field
    write_field(tmp_path / "tumble.csv", field)
    line = "flinders compare-methods tumble.csv --methods auto,algebraic,axes,sphere,minmax"
    golden("cli/compare-methods.txt", session(line))
