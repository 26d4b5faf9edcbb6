"""How an estimate settles, to the letter: the drawing that `--convergence` writes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main
from flinders.estimators import METHODS, Convergence
from flinders.report.colours import SERIES
from flinders.report.drawings import Trace, convergence_drawing, convergence_table

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.testing import Result

    Golden = Callable[[str, str], None]


def record(name: str, *, n: int = 1000) -> None:
    field = simulate.tumble(seed=2, motion="hand", n=n).samples.field
    write_field(name, field)


def calibrate(*words: str) -> Result:
    return CliRunner().invoke(main, ["calibrate", *words])


def test_the_drawing(golden: Golden) -> None:
    record("tumble.csv")
    ended = calibrate("tumble.csv", "--method", "sequential", "--convergence", "settling.svg")
    assert_sentences(ended.output, about="settling.svg")
    golden("convergence/sequential.svg", Path("settling.svg").read_text(encoding="utf-8"))


@pytest.mark.parametrize("method", ["sequential", "ekf"])
def test_a_drawing_is_whole_and_fits_light_and_dark_pages(method: str) -> None:
    """Well-formed, no number that is none, everything inside, as narrow as the page, and colours for both."""
    record("tumble.csv")
    calibrate("tumble.csv", "--method", method, "--convergence", "s.svg")
    text = Path("s.svg").read_text(encoding="utf-8")
    root = ET.fromstring(text)
    assert "nan" not in text
    assert "inf" not in text
    assert "max-width: 100%" in text
    wide, high = (float(number) for number in root.attrib["viewBox"].split()[2:])
    for mark in root.iter("{http://www.w3.org/2000/svg}text"):
        assert 0 <= float(mark.attrib["x"]) <= wide
        assert 0 < float(mark.attrib["y"]) < high
    assert "prefers-color-scheme: dark" in text
    assert all(colour in text for colours in SERIES.values() for colour in colours)


def test_an_estimate_that_never_moves_can_be_drawn() -> None:
    """No noise at all, one step, and a start without an ellipsoid."""
    steps = Convergence(
        np.array([10, 20]),
        np.array([[np.nan] * 9, [1.0] * 3 + [50.0] * 3 + [0.0] * 3]),
        np.array([[np.nan] * 9, [0.0] * 9]),
    )
    for settling in (Trace(steps, "x", "counts"), Trace(steps, "x", "uT", dip_deg=-60.0, target_deg=45.0)):
        assert "nan" not in convergence_drawing(settling)
        assert convergence_table(settling).splitlines()[1] == "10" + "," * 19
        assert settling.heading_differences_deg[1] == 0.0


def test_a_refused_fit_can_be_watched_too() -> None:
    field = simulate.tumble(seed=2, motion="level").samples.field[:, (2, 0, 1)]
    np.savetxt("table.csv", field, delimiter=",", fmt="%.3f", header="mx_uT,my_uT,mz_uT", comments="")
    ended = calibrate("table.csv", "--method", "ekf", "--convergence", "s.csv")
    assert ended.exit_code == 4
    assert Path("s.csv").exists() == ("convergence written" in ended.output)


def test_what_there_was_is_drawn_of_a_filter_that_is_lost() -> None:
    field = simulate.tumble(seed=2, motion="hand", n=2000).samples.field
    np.savetxt("t.csv", field, delimiter=",", fmt="%.3f", header="mx_uT,my_uT,mz_uT", comments="")
    words = ("t.csv", "--method", "ekf", "--option", "spread=0.3", "--convergence")
    ended = calibrate(*words, "s.svg")
    assert ended.exit_code == 4
    assert "convergence written to s.svg" in ended.output
    assert ": lost after " in Path("s.svg").read_text(encoding="utf-8")


def test_where_there_was_nothing_at_any_step_nothing_is_written() -> None:
    record("few.csv", n=30)
    ended = calibrate("few.csv", "--method", "sequential", "--option", "find=all", "--convergence", "s.svg")
    assert ended.exit_code == 4
    assert_sentences(ended.output)
    assert not Path("s.svg").exists()


def test_several_recordings_are_watched_one_after_the_other() -> None:
    record("a.csv")
    record("b.csv", n=700)
    ended = calibrate("a.csv", "b.csv", "--method", "ekf", "--convergence", "s.csv", "--filter", "median:3")
    assert ended.exit_code in {0, 3}, ended.output
    assert Path("s.csv").read_text(encoding="utf-8").splitlines()[-1].startswith("1700,")


def test_methods_that_cannot_be_watched_say_which_can() -> None:
    record("tumble.csv")
    watched = [name for name, method in METHODS.items() if hasattr(method, "converge")]
    assert {"sequential", "ekf"} <= set(watched)
    for method in sorted(set(METHODS) - set(watched)):
        ended = calibrate("tumble.csv", "--method", method, "--convergence", "s.svg")
        assert ended.exit_code == 2
        assert f"--convergence needs --method {' or '.join(watched)}: {method} uses all" in ended.output


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--convergence", "s.png"], 2),
        (["--convergence", "s"], 2),
        (["--convergence", "-"], 2),
        (["--convergence", "tumble.csv"], 2),
        (["--convergence", "there.svg"], 6),
        (["--convergence", "no/where.svg"], 6),
        (["--convergence", "c.svg", "-o", "c.svg"], 2),
        (["--convergence", "c.svg", "--report-text", "./c.svg"], 2),
    ],
)
def test_what_cannot_be_written_is_found_before_anything_is_read(words: list[str], code: int) -> None:
    record("tumble.csv")
    Path("there.svg").write_text("mine", encoding="utf-8")
    ended = calibrate("tumble.csv", "--method", "sequential", *words)
    assert ended.exit_code == code, ended.output
    assert_sentences(ended.output)
    assert "columns" not in ended.output
    assert Path("there.svg").read_text(encoding="utf-8") == "mine"


def test_typed_extremes_cannot_be_watched() -> None:
    ended = calibrate("--minmax", "-1,1,-1,1,-1,1", "--convergence", "s.svg")
    assert ended.exit_code == 2
    assert_sentences(ended.output)
