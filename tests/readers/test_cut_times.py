"""Times whose digits were cut: left out and said, where buffers and coarse clocks that still order readings are not."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders import simulate
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

RATE_HZ = 50.0
BEGUN = 1_732_190_000.0
"""Seconds since 1970."""


@pytest.fixture(scope="module")
def field() -> Floats:
    """(3000, 3) µT."""
    return simulate.tumble(seed=3).samples.field


def times_of(field: Floats, rate_hz: float = RATE_HZ) -> Floats:
    return np.arange(len(field)) / rate_hz


def single(times: Floats) -> Floats:
    """Store times in single precision, in the files that can."""
    return cast("Floats", times.astype(np.float32))


def write_npz(path: Path, time: Floats, field: Floats) -> None:
    np.savez(path, t=time, mag_uT=field)


def write_parquet(path: Path, time: Floats, field: Floats) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = {"t": time, **{f"mag_{axis}_uT": column for axis, column in zip("xyz", field.T, strict=True)}}
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def write_hdf5(path: Path, time: Floats, field: Floats) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["t"], file["mag_uT"] = time, field


def write_csv(path: Path, time: Floats, field: Floats) -> None:
    rows = (f"{when},{x},{y},{z}" for when, (x, y, z) in zip(time.tolist(), field.tolist(), strict=True))
    path.write_text("\n".join(["t,mx_uT,my_uT,mz_uT", *rows]) + "\n", encoding="utf-8")


WRITERS: dict[str, Callable[[Path, Floats, Floats], None]] = {
    "tumble.npz": write_npz,
    "tumble.parquet": write_parquet,
    "tumble.h5": write_hdf5,
    "tumble.csv": write_csv,
}


@pytest.mark.parametrize("name", WRITERS)
def test_seconds_since_1970_in_float32_are_no_time(name: str, tmp_path: Path, field: Floats) -> None:
    path = tmp_path / name
    WRITERS[name](path, single(BEGUN + times_of(field)), field)
    recording = flinders.open_recording(path)
    assert "time in" not in str(recording)
    assert_sentences(str(recording))
    assert flinders.read(path).time is None
    with pytest.raises(UsageError, match="time"):
        flinders.read(path, start=1.0)


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_seconds_in_float64_are_one(name: str, tmp_path: Path, field: Floats) -> None:
    path = tmp_path / name
    WRITERS[name](path, BEGUN + times_of(field), field)
    time = flinders.read(path).time
    assert time is not None
    np.testing.assert_allclose(time, times_of(field), atol=1e-6)


CUT: dict[str, tuple[Callable[[Floats], Floats], str]] = {
    "printed with %g": (
        lambda t: np.array([float(f"{BEGUN + each:g}") for each in t]),
        "1e+04 s, 200 or more readings",
    ),
    "whole seconds": (lambda t: np.floor(BEGUN + t), "1 s, 50 readings"),
    "whole seconds of a clock that starts at 0": (np.floor, "1 s, 50 readings"),
    "ms since 1970 in float32": (lambda t: single(1e3 * (BEGUN + t)), "131 s, 200 or more readings"),
}


@pytest.mark.parametrize("name", CUT)
def test_a_time_that_lost_its_digits_is_left_out(name: str, tmp_path: Path, field: Floats) -> None:
    cut, says = CUT[name]
    write_csv(tmp_path / "tumble.csv", cut(times_of(field)), field)
    told = str(flinders.open_recording(tmp_path / "tumble.csv"))
    assert f"steps of {says} to each" in told
    assert_sentences(told)


def buffered(count: int, jitter_s: float = 0.0) -> Callable[[Floats], Floats]:
    """Times of readings that a sensor hands over so many at a time, stamped with whole milliseconds on arrival."""

    def stamped(times: Floats) -> Floats:
        arrivals = times[count - 1 :: count] + np.random.default_rng(1).uniform(0, jitter_s, len(times) // count)
        return np.round(np.repeat(arrivals, count), 3)

    return stamped


KEPT: dict[str, Callable[[Floats], Floats]] = {
    **{f"bursts of {count}": buffered(count) for count in (2, 3, 4)},
    "a buffer of 30 readings": buffered(30, jitter_s=0.01),
    "tenths of a second": lambda times: np.floor(10 * times) / 10,
    "hundredths at 400 Hz": lambda times: np.floor(100 * times * RATE_HZ / 400) / 100,
    "ms since start-up in float32 after ten hours": lambda times: single(36e6 + 1e3 * times),
    "a clock at rest": np.zeros_like,
    "not a number at first": lambda times: np.where(times < 1.5, np.nan, times),
}


@pytest.mark.parametrize("name", KEPT)
def test_a_time_that_still_orders_readings_is_kept(name: str, tmp_path: Path, field: Floats) -> None:
    times = KEPT[name](times_of(field))
    write_npz(tmp_path / "tumble.npz", times, field)
    recording = flinders.open_recording(tmp_path / "tumble.npz")
    assert "time in t" in str(recording)
    assert "left out" not in str(recording)


def test_another_time_is_read_in_its_place(tmp_path: Path, field: Floats) -> None:
    times = times_of(field)
    np.savez(tmp_path / "t.npz", t=(BEGUN + times).astype(np.float32), uptime_ms=1e3 * times, mag_uT=field)
    np.savez(tmp_path / "s.npz", time_s=(BEGUN + times).astype(np.float32), uptime_ms=1e3 * times, mag_uT=field)
    for path in (tmp_path / "t.npz", tmp_path / "s.npz"):
        time = flinders.read(path).time
        assert time is not None
        np.testing.assert_allclose(time, times, atol=1e-9)
    assert "time in uptime_ms" in str(flinders.open_recording(tmp_path / "s.npz"))


def test_a_fit_is_not_told_of_gaps_that_are_none(tmp_path: Path, field: Floats) -> None:
    """With its steps of 128 s it would miss 128 s in one stretch, at a reading every 0.043 s."""
    write_npz(tmp_path / "cut.npz", single(BEGUN + times_of(field)), field)
    fit = flinders.fit(flinders.open_recording(tmp_path / "cut.npz"))
    assert "time-gap" not in {finding.code for finding in fit.findings}


@pytest.mark.parametrize(("seconds", "nanoseconds"), [("header.stamp.sec", "header.stamp.nanosec"), ("secs", "nsecs")])
def test_whole_seconds_and_nanoseconds_side_by_side_are_one_time(
    seconds: str, nanoseconds: str, tmp_path: Path, field: Floats
) -> None:
    path, times = tmp_path / "tumble.csv", BEGUN + 0.98 + times_of(field)
    nanos = np.round(times * 1e9).astype(np.int64)
    rows = (
        f"{nano // 10**9},{nano % 10**9},{x},{y},{z}"
        for nano, (x, y, z) in zip(nanos.tolist(), field.tolist(), strict=True)
    )
    path.write_text("\n".join([f"{seconds},{nanoseconds},mx_uT,my_uT,mz_uT", *rows]) + "\n", encoding="utf-8")
    np.testing.assert_allclose(np.diff(cast("Floats", flinders.read(path).time)), 1 / RATE_HZ, atol=1e-6)
