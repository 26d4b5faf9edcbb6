"""The door in Python: what `fit` and `read` take, values as values, and tables for other libraries."""

from __future__ import annotations

import ast
import copy
import inspect
import io
import pickle
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.frames import PolarsLike, Streamed, of_polars, refuse
from tests.sentences import assert_raises

import flinders
from flinders.core.samples import COLUMNS
from flinders.core.units import Unit
from flinders.errors import (
    AxesError,
    MissingExtra,
    NoMagnetometer,
    OutputExists,
    UnitError,
    UnknownParameter,
    UsageError,
)
from flinders.simulate.recording import write_csv

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.samples import Samples

pandas = pytest.importorskip("pandas")
pyarrow = pytest.importorskip("pyarrow")

SOURCE = Path(flinders.__file__).parent


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=1).samples


def dated(samples: Samples) -> Any:  # noqa: ANN401 - a frame
    """A frame with its time in an index of dates, which has no name, and a column of words."""
    frame = pandas.DataFrame(samples.as_columns()).drop(columns="time_s").assign(note="calm")
    return frame.set_index(pandas.to_datetime(1.7e9 + np.asarray(samples.time), unit="s", utc=True))


FRAMES: dict[str, Callable[[Samples], Any]] = {
    "pandas": lambda samples: pandas.DataFrame(samples.as_columns()),
    "pandas, time as index": lambda samples: pandas.DataFrame(samples.as_columns()).set_index("time_s"),
    "pandas, dates as index": dated,
    "pandas, types with missing values": lambda samples: pandas.DataFrame(samples.as_columns()).convert_dtypes(),
    "pyarrow": lambda samples: samples.to_arrow(),
    "a stream of Arrow": lambda samples: Streamed(samples.as_columns()),
}


@pytest.mark.parametrize("make", FRAMES.values(), ids=FRAMES)
def test_a_frame_reads_as_the_samples_it_was_made_of(make: Callable[[Samples], Any], samples: Samples) -> None:
    again = flinders.read(make(samples))
    assert again.unit == Unit.of("uT")
    np.testing.assert_array_equal(again.field, samples.field)
    np.testing.assert_allclose(np.asarray(again.time), np.asarray(samples.time), atol=1e-6)
    assert flinders.fit(make(samples)).calibration.isclose(flinders.fit(samples).calibration)


@pytest.mark.parametrize("make", [pandas.DataFrame, PolarsLike, of_polars])
def test_frames_of_pandas_and_polars_need_no_pyarrow(
    samples: Samples, monkeypatch: pytest.MonkeyPatch, make: Callable[[dict[str, Any]], Any]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    dates = (1.7e18 + 1e9 * np.asarray(samples.time)).astype("datetime64[ns]")
    axes = {name: column for name, column in samples.as_columns().items() if name != "time_s"}
    frame = make({"time": dates, **axes, "device": ["a", "b"] * (len(samples) // 2), "note": ["calm"] * len(samples)})
    again = flinders.read(frame, sensor="device=a")
    np.testing.assert_array_equal(again.field, samples.field[::2])
    np.testing.assert_allclose(np.diff(np.asarray(again.time)), np.diff(np.asarray(samples.time)[::2]), atol=1e-6)
    assert flinders.fit(make(samples.as_columns())).calibration.isclose(flinders.fit(samples).calibration)


def test_other_streams_of_arrow_need_pyarrow(samples: Samples, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flinders.foreign_errors.import_module", refuse)
    with assert_raises(MissingExtra, package="pyarrow", extra="parquet"):
        flinders.fit(Streamed(samples.as_columns()))
    with assert_raises(MissingExtra, package="pyarrow", extra="parquet"):
        samples.to_arrow()


def test_columns_of_a_frame_are_chosen_as_those_of_a_file(samples: Samples) -> None:
    frame = pandas.DataFrame(samples.field, columns=["a", "b", "c"]).assign(d=0.0)
    with assert_raises(NoMagnetometer):
        flinders.fit(frame)
    chosen = flinders.read(frame, columns="a,b,c", unit="uT", axes="x,-y,-z")
    np.testing.assert_array_equal(chosen.field, samples.field * [1, -1, -1])
    with pytest.raises(UsageError, match="topic="):
        flinders.read(frame, topic="mag")


def test_all_columns_survive_a_table(samples: Samples) -> None:
    count = 50
    whole = flinders.Samples.of(
        samples.field[:count], unit="uT", time=np.arange(count) / 10, acceleration=samples.field[:count],
        rate=samples.field[:count] / 100, temperature=np.linspace(20, 30, count), current=np.linspace(0, 9, count),
        throttle=np.linspace(0, 1, count), strength=np.full(count, 48.0), attitude=[[0.6, 0.0, 0.8, 0.0]] * count,
        currents=np.ones((count, 2)), throttles=np.ones((count, 2)),
    )  # fmt: skip
    again = flinders.read(whole.to_arrow())
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(again, name), getattr(whole, name), atol=1e-12, err_msg=name)


def test_a_path_reads_as_read_reads_it(samples: Samples, tmp_path: Path) -> None:
    write_csv(samples, tmp_path / "log.csv")
    expected = flinders.fit(flinders.read(tmp_path / "log.csv")).calibration
    text = (tmp_path / "log.csv").read_text()
    with (tmp_path / "log.csv").open("rb") as file:
        sources = [tmp_path / "log.csv", str(tmp_path / "log.csv"), file, io.StringIO(text), [tmp_path / "log.csv"]]
        for source in sources:
            assert flinders.fit(source).calibration == expected
    assert flinders.fit(tmp_path / "log.csv", sensor="A17").calibration == replace(expected, sensor="A17")
    assert flinders.fit(tmp_path / "log.csv", sensor=1).calibration == replace(expected, sensor="1")
    assert flinders.fit(samples, sensor=7).calibration.sensor == "7"


def test_unit_and_axes_of_an_array_are_words(samples: Samples) -> None:
    expected = flinders.fit(flinders.Samples.of(samples.field * 10, unit="mG", axes="x,-y,-z")).calibration
    assert flinders.fit(samples.field * 10, unit="mG", axes="x,-y,-z").calibration == expected
    assert (
        flinders.fit(samples.field * 10, unit=Unit.of("mG"), axes=flinders.Axes.of("x,-y,-z")).calibration == expected
    )
    with assert_raises(UnitError):
        flinders.fit(samples.field, unit="furlong")
    with assert_raises(AxesError):
        flinders.fit(samples.field, axes="x,x,z")


def test_a_mistyped_parameter_is_answered_with_the_one_that_was_meant(samples: Samples) -> None:
    with assert_raises(UsageError, "unknown-parameter"):
        flinders.fit(samples.field, topic="mag")  # type: ignore[call-arg]
    with assert_raises(UsageError, "unknown-parameter"):
        flinders.read("log.csv", method="robust")  # type: ignore[call-arg]
    calls: list[tuple[Callable[..., object], str]] = [
        (flinders.fit, "unit"), (flinders.read, "unit"), (flinders.open_recording, "unit"), (flinders.open_log, "unit"),
        (flinders.Samples.of, "unit"), (flinders.from_extremes, "unit"), (flinders.export, "compass"),
        (flinders.compare, "dip_deg"), (flinders.merge, "dip_deg"), (flinders.fit_many, "unit"),
    ]  # fmt: skip
    for function, word in calls:
        with assert_raises(UnknownParameter) as unknown:
            function(samples.field, **{f"{word}s": None})
        assert isinstance(unknown.value, TypeError)
    with assert_raises(UsageError):
        flinders.fit(samples.field, method="libelihood")
    with assert_raises(AttributeError):
        flinders.estimators.Robst()


def test_a_fit_has_eleven_parameters_and_all_are_named() -> None:
    """No ``**options``: a type checker sees a mistake, and no two parameters say the same."""
    parameters = inspect.signature(flinders.fit).parameters.values()
    assert len(parameters) <= 11
    assert all(parameter.kind is not parameter.VAR_KEYWORD for parameter in parameters)


def test_a_type_checker_knows_every_method() -> None:
    """`flinders.estimators` names the class of each of its methods where a type checker looks."""
    text = Path(flinders.estimators.__file__).read_text(encoding="utf-8")
    for kind in flinders.estimators.METHODS.values():
        if not kind.__module__.startswith("flinders.apps."):
            assert f"from {kind.__module__} import {kind.__name__} as {kind.__name__}\n" in text


def test_a_method_with_options_is_the_method_by_its_name(samples: Samples) -> None:
    by_name = flinders.fit(samples, method="robust").calibration
    assert flinders.fit(samples, method=flinders.estimators.Robust()).calibration == by_name
    with assert_raises(UsageError):
        flinders.fit(samples, method=flinders.estimators.Robust)  # type: ignore[arg-type]


def test_a_method_takes_dip_and_strength_from_the_site(samples: Samples) -> None:
    level = flinders.simulate.tumble(seed=1, motion="level").samples
    there = flinders.Site(inclination_deg=70.0)
    stated = flinders.fit(level, method=flinders.estimators.Level(dip_deg=70.0), site=there)
    assert stated.calibration == flinders.fit(level, method="level", site=there).calibration
    with assert_raises(UsageError) as caught:
        flinders.fit(level, method=flinders.estimators.Level(dip_deg=70.0))
    assert caught.value.hint == {"site": None}


def test_a_strength_without_uncertainty_is_a_length_and_with_one_counts(samples: Samples) -> None:
    """A gain that is off by half contradicts what is known of it, and no length."""
    length = flinders.fit(samples, site=flinders.Site(strength=75.0)).calibration
    assert (length.field_strength, length.field_strength_known) == (75.0, True)
    counted = flinders.fit(samples, site=flinders.Site(strength=75.0, gain_sigma=0.05)).calibration
    assert counted.field_strength < 55.0
    assert not counted.field_strength_known


def test_a_calibration_is_a_value(samples: Samples) -> None:
    one, other = (flinders.fit(samples).calibration for _ in range(2))
    assert one == other
    assert hash(one) == hash(other)
    assert one not in (one.inv, "one")
    for copied in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert copied == one
        assert not copied.matrix.flags.writeable


def test_a_calibration_is_written_for_a_target(samples: Samples, tmp_path: Path) -> None:
    calibration = flinders.fit(samples).calibration
    sketch = flinders.export(calibration, "arduino", name="mast")
    sketch.save(tmp_path / "mag.ino")
    assert (tmp_path / "mag.ino").read_text() == sketch.text
    assert "mast" in sketch.text
    with pytest.raises(OutputExists, match="force=True"):
        sketch.save(tmp_path / "mag.ino")
    flinders.export(calibration, "adafruit-eeprom").save(tmp_path / "mag.ino", force=True)
    assert len((tmp_path / "mag.ino").read_bytes()) == 68
    with assert_raises(UsageError):
        flinders.export(calibration, "c", compass=1)


def test_no_message_of_the_library_names_an_option() -> None:
    """Options are words of the command line, which puts them in the place of keywords by itself."""
    rooms = {"cli", "live", "links", "vehicles", "report", "findings"}
    named = [
        (path.name, part.value)
        for path in SOURCE.rglob("*.py")
        if rooms.isdisjoint(path.relative_to(SOURCE).parts)
        if re.search(r"(^|[^-])--[a-z]", text := path.read_text())
        for raised in ast.walk(ast.parse(text))
        if isinstance(raised, ast.Raise)
        for part in ast.walk(raised)
        if isinstance(part, ast.Constant) and isinstance(part.value, str) and re.search(r"(^|[^-])--[a-z]", part.value)
    ]
    assert [each for each in named if "flinders calibrate ONE TWO" not in each[1]] == []
