"""Recordings of two columns are level turns for ``flinders two-axis``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.readers.test_readers import two_columns
from tests.sentences import assert_sentences

import flinders
from flinders.cli import main

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("header", "third", "words"),
    [
        ("", False, ""),
        ("hx,hy\n", False, ""),
        ("hx,hy\n", False, "--columns hx,hy"),
        ("count,hx,hy\n", True, "--columns hx,hy"),
        ("count,hx,hy\n", True, "--columns 2,3"),
    ],
)
@pytest.mark.parametrize(("plane", "axes"), [("xy", (0, 1)), ("yz", (1, 2)), ("zx", (2, 0))])
def test_two_columns_are_those_of_the_plane(
    header: str, third: bool, words: str, plane: str, axes: tuple[int, int], tmp_path: Path
) -> None:
    path, _ = two_columns(tmp_path, header=header, third=third)
    line = ["two-axis", str(path), "--plane", plane, "--unit", "uT", "-o", str(tmp_path / "c.json"), *words.split()]
    ended = CliRunner().invoke(main, line)
    assert ended.exit_code == 3, ended.output
    offset = flinders.Calibration.load(tmp_path / "c.json").offset
    np.testing.assert_allclose(offset[list(axes)], [10.0, -5.0], atol=1e-3)


def test_an_array_of_two_columns_is_a_level_turn_too(tmp_path: Path) -> None:
    _, turn = two_columns(tmp_path)
    np.save(tmp_path / "turn.npy", turn)
    np.savez(tmp_path / "turn.npz", count=np.arange(len(turn)), hx=turn[:, 0], hy=turn[:, 1])
    for name, words in (("turn.npy", []), ("turn.npz", ["--columns", "hx,hy"])):
        line = ["two-axis", str(tmp_path / name), "-o", str(tmp_path / "c.json"), "--force", *words]
        ended = CliRunner().invoke(main, line)
        assert ended.exit_code == 3, ended.output
        np.testing.assert_allclose(flinders.Calibration.load(tmp_path / "c.json").offset[:2], [10.0, -5.0], atol=1e-3)


@pytest.mark.parametrize("command", ["calibrate", "info", "compare-methods"])
def test_two_columns_are_for_two_axis_alone(command: str, tmp_path: Path) -> None:
    path, _ = two_columns(tmp_path)
    ended = CliRunner().invoke(main, [command, str(path)])
    assert ended.exit_code == 5
    assert_sentences(ended.stderr)
    asked = CliRunner().invoke(main, [command, str(path), "--columns", "1,2"])
    assert asked.exit_code in {2, 5}
    assert_sentences(asked.stderr)
