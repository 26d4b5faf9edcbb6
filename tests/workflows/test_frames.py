"""`Calibration.apply` of a data frame: the same kind of frame, with corrected columns and headings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.frames import Streamed, of_polars, pyarrow
from tests.sentences import assert_raises

import flinders
from flinders.core.frames import with_columns
from flinders.errors import NoAccelerometer, UnknownParameter, UsageError
from flinders.simulate.disturbances import MotorCurrent

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.calibration import Calibration
    from flinders.core.samples import Samples

pandas = pytest.importorskip("pandas")


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=1, n=600).samples


@pytest.fixture(scope="module")
def calibration(samples: Samples) -> Calibration:
    return flinders.fit(samples).calibration


def structured(columns: dict[str, Any]) -> Any:  # noqa: ANN401 - of records
    table = np.empty(len(columns["time_s"]), dtype=[(name, np.float32) for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table


def of_xarray(columns: dict[str, Any]) -> Any:  # noqa: ANN401 - a data set
    xarray = pytest.importorskip("xarray")
    return xarray.Dataset({name: ("time_s", column) for name, column in columns.items()})


def of_duckdb(columns: dict[str, Any]) -> Any:  # noqa: ANN401 - a relation
    return pytest.importorskip("duckdb").from_df(pandas.DataFrame(columns))


KINDS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "pandas": pandas.DataFrame,
    "pandas, time as index": lambda columns: pandas.DataFrame(columns).set_index("time_s"),
    "pyarrow": pyarrow.table,
    "a batch of pyarrow": pyarrow.RecordBatch.from_pydict,
    "polars": of_polars,
    "a lazy frame of polars": lambda columns: of_polars(columns).lazy(),
    "a mapping of arrays": dict,
    "a mapping of lists": lambda columns: {name: column.tolist() for name, column in columns.items()},
    "a structured array": structured,
    "xarray": of_xarray,
}


def column(frame: Any, name: str) -> Any:  # noqa: ANN401 - an array
    return np.asarray((frame.collect() if hasattr(frame, "collect") else frame)[name], float)


@pytest.mark.parametrize("make", KINDS.values(), ids=KINDS)
def test_a_frame_comes_back_corrected_and_as_the_kind_it_was(
    make: Callable[[dict[str, Any]], Any], samples: Samples, calibration: Calibration
) -> None:
    columns = samples.as_columns()
    frame = make(columns)
    corrected = calibration.apply(frame, heading=True)
    assert type(corrected) is type(frame)
    expected = calibration.apply(np.float32(samples.field) if make is structured else samples.field)
    for place, axis in enumerate("xyz"):
        np.testing.assert_allclose(column(corrected, f"mag_{axis}_uT"), expected[:, place], atol=1e-9)
        np.testing.assert_allclose(column(frame, f"mag_{axis}_uT"), samples.field[:, place], rtol=1e-6)
    np.testing.assert_allclose(column(corrected, "acc_x_mps2"), column(frame, "acc_x_mps2"))
    expected = flinders.headings(samples, calibration).headings.magnetic_deg
    apart = (column(corrected, "heading_deg") - expected + 180.0) % 360.0 - 180.0
    assert np.abs(apart).max() < 1e-3


@pytest.mark.parametrize("make", [*KINDS.values(), of_duckdb], ids=[*KINDS, "duckdb"])
def test_any_frame_is_fitted(make: Callable[[dict[str, Any]], Any], samples: Samples, calibration: Calibration) -> None:
    assert flinders.fit(make(samples.as_columns())).calibration.isclose(calibration, tolerance=1e-5)


def test_a_frame_keeps_its_index_and_the_place_of_its_columns(samples: Samples, calibration: Calibration) -> None:
    frame = pandas.DataFrame(samples.as_columns()).iloc[::-1].assign(note="calm")
    corrected = calibration.apply(frame, level=True)
    assert corrected.index.equals(frame.index)
    assert [*corrected.columns] == [*frame.columns, "heading_deg"]


def test_a_row_that_is_no_reading_becomes_nan_and_keeps_its_place(samples: Samples, calibration: Calibration) -> None:
    frame = pandas.DataFrame(samples.as_columns())
    frame.loc[7, "mag_y_uT"] = np.nan
    frame.loc[9, ["mag_x_uT", "mag_y_uT", "mag_z_uT"]] = 0.0  # the sensor did not answer
    corrected = calibration.apply(frame, heading=True)
    is_missing = corrected[["mag_x_uT", "mag_y_uT", "mag_z_uT", "heading_deg"]].isna().all(axis=1)
    assert [*np.flatnonzero(is_missing)] == [7, 9]
    np.testing.assert_allclose(corrected["mag_z_uT"][8], calibration.apply(samples.field)[8, 2])


def test_columns_keep_the_unit_that_their_names_say(samples: Samples, calibration: Calibration) -> None:
    frame = pandas.DataFrame(10.0 * samples.field, columns=["mx_mG", "my_mG", "mz_mG"])
    np.testing.assert_allclose(calibration.apply(frame), 10.0 * calibration.apply(samples.field))


def test_columns_are_chosen_by_name_or_number(samples: Samples, calibration: Calibration) -> None:
    frame = pandas.DataFrame(samples.field, columns=["east", "raw, north", "down"]).assign(d=0.0)
    for columns in (["east", "raw, north", "down"], [1, 2, 3], "1,2,3"):
        corrected = calibration.apply(frame, columns=columns)
        np.testing.assert_allclose(corrected["raw, north"], calibration.apply(samples.field)[:, 1])
        assert flinders.fit(frame, columns=columns, unit="uT").calibration.isclose(calibration, tolerance=1e-9)
        np.testing.assert_array_equal(flinders.read(frame, columns=columns, unit="uT").field, samples.field)


def test_a_mistyped_option_of_a_frame_is_answered_with_the_one_that_was_meant(
    samples: Samples, calibration: Calibration
) -> None:
    with assert_raises(UnknownParameter):
        calibration.apply(pandas.DataFrame(samples.as_columns()), headings=True)


def test_a_column_of_triples_is_corrected_as_one(samples: Samples, calibration: Calibration) -> None:
    frame: dict[str, Any] = {"t": samples.time, "mag": samples.field}
    corrected = calibration.apply(frame)
    np.testing.assert_allclose(corrected["mag"], calibration.apply(samples.field))
    triples = pyarrow.FixedSizeListArray.from_arrays(samples.field.ravel(), 3)
    table = calibration.apply(pyarrow.table({"t": samples.time, "mag": triples}))
    np.testing.assert_allclose(table["mag"].to_pylist(), corrected["mag"])


def test_disturbances_are_columns_of_a_frame() -> None:
    flown = flinders.simulate.tumble(seed=3, disturbances=[MotorCurrent(0.2)]).samples
    calibration = flinders.fit(flown, disturbances=["current"]).calibration
    corrected = calibration.apply(flown.as_columns())
    np.testing.assert_allclose(corrected["mag_x_uT"], calibration.apply(flown.field, current=flown.current)[:, 0])
    with pytest.raises(UsageError) as raised:
        calibration.apply(flown.as_columns(), current=3.0)  # type: ignore[call-overload]
    assert raised.value.hint == {"current": None}


def test_what_a_frame_lacks_is_told(samples: Samples, calibration: Calibration) -> None:
    field = pandas.DataFrame(samples.field, columns=["mx", "my", "mz"])
    with pytest.raises(NoAccelerometer) as lacking:
        calibration.apply(field, heading=True)
    assert lacking.value.hint == {"level": True}
    with pytest.raises(UsageError, match="heading_deg"):
        calibration.apply(field.assign(heading_deg=0.0), level=True)
    with assert_raises(UsageError):
        calibration.apply(samples.field, heading=True)
    with assert_raises(UsageError):
        flinders.fit(samples.field, columns=[1, 2, 3])
    with pytest.raises(UsageError) as late:
        flinders.fit(samples, columns=[1, 2, 3])
    assert late.value.hint == {"columns": None}


def test_a_frame_that_takes_no_columns_says_what_to_give(samples: Samples) -> None:
    with pytest.raises(UsageError, match=r"pyarrow\.table\(frame\)"):
        with_columns(Streamed(samples.as_columns()), {"a": np.zeros(3)})


def test_a_recording_in_the_place_of_the_calibration_is_a_mistake_of_use(
    samples: Samples, calibration: Calibration
) -> None:
    frame = pandas.DataFrame(samples.as_columns())
    with pytest.raises(UsageError, match="DataFrame"):
        flinders.headings(calibration, frame)
