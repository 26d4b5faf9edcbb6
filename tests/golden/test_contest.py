"""What `flinders compare-methods` prints, to the letter; its clock ticks once a millisecond."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from tests.golden.sessions import session

from flinders import simulate

if TYPE_CHECKING:
    from pathlib import Path

    import pytest
    from tests.golden.sessions import Golden


def test_a_few_methods_on_a_tumble(golden: Golden, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = itertools.count()
    monkeypatch.setattr("flinders.comparison.methods.time.perf_counter", lambda: next(ticks) * 1e-3)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    field = simulate.tumble(seed=8, n=1500).samples.field
    rows = [",".join(f"{value:.3f}" for value in row) for row in field]
    (tmp_path / "tumble.csv").write_text("\n".join(["mag_x_uT,mag_y_uT,mag_z_uT", *rows, ""]), encoding="utf-8")
    line = "flinders compare-methods tumble.csv --methods auto,algebraic,axes,sphere,minmax"
    golden("cli/compare-methods.txt", session(line))
