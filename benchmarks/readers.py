"""Speed of the readers, as ratios measured in one run, on the real recordings. Prints Markdown.

    FLINDERS_DATA=… python -m benchmarks.readers

Each reader is compared with another reader of the format; both read the whole file: every magnetometer with its
auxiliary columns, into arrays. "We use" means the messages and fields that Flinders needs; the text after ÷ states the
part that the other package reads. CSV is a generated file of a million rows of four columns, and there are 300,000
generated labelled lines. Times are medians of interleaved repeats, on one thread except for pyarrow, from a cached
file. If the recording or the other package is missing, the row states the reason.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from unittest.mock import patch

import numpy as np

from benchmarks.speed import interleaved
from flinders.readers import open_log, read, text

if TYPE_CHECKING:
    from collections.abc import Callable

SECONDS: Final = 6.0
"""Duration of the repeats of a row, s."""

DATAFLASH_FIELDS: Final = {
    **dict.fromkeys(
        ("MAG", "MAG2", "MAG3"),
        ("TimeMS", "MagX", "MagY", "MagZ", "OfsX", "OfsY", "OfsZ", "MOfsX", "MOfsY", "MOfsZ", "Health"),
    ),
    "IMU": ("TimeMS", "AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ", "Temp"),
    "CURR": ("TimeMS", "Curr"),
    "ATT": ("TimeMS", "Roll", "Pitch", "Yaw"),
    "CTUN": ("TimeMS", "ThrOut"),
    "PARM": ("Name", "Value"),
    "GPS": ("Status", "TimeMS", "Week", "Lat", "Lng", "Alt", "T"),
    "MSG": ("Message",),
}
"""Fields that Flinders reads, by name of the message."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    label : str
    recording : str
        Path in the folder of recordings; `CSV` is generated.
    package : str
        The other package.
    ours, other : callable
        Read the file.
    limit : float
        Limit of the ratio of times, ours ÷ theirs.
    """

    label: str
    recording: str
    package: str
    ours: Callable[[Path], object]
    other: Callable[[Path], object]
    limit: float


def every_instrument(path: Path) -> object:
    """Each magnetometer of a log with its auxiliary columns, un-applied."""
    return [list(instrument.blocks()) for instrument in open_log(path).instruments]


def by_pymavlink(path: Path) -> object:
    """The same fields as arrays, by pymavlink's reader, which skips other messages."""
    from pymavlink import DFReader

    columns: dict[str, dict[str, list[Any]]] = {
        name: {label: [] for label in labels} for name, labels in DATAFLASH_FIELDS.items()
    }
    with DFReader.DFReader_binary(str(path)) as log:
        while (message := log.recv_match(type=list(columns))) is not None:
            for label, values in columns[message.get_type()].items():
                values.append(getattr(message, label))
    return {name: {label: np.array(values) for label, values in each.items()} for name, each in columns.items()}


def all_by_pymavlink(path: Path) -> object:
    """All messages of the log with all fields, as read by tools that select later."""
    from pymavlink import DFReader

    messages = []
    with DFReader.DFReader_binary(str(path)) as log:
        while (message := log.recv_msg()) is not None:
            messages.append(message.to_dict())
    return messages


def by_pyulog(path: Path) -> object:
    """The whole log by pyulog with default options."""
    import pyulog

    return pyulog.ULog(str(path)).data_list


def by_rosbags(path: Path) -> object:
    """Messages of all topics, decoded by rosbags."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as bag:
        return [bag.deserialize(packed, connection.msgtype) for connection, _, packed in bag.messages()]


def without_pyarrow(path: Path) -> object:
    """Read text as without pyarrow."""
    with patch.object(text, "MIN_BYTES_FOR_ARROW", sys.maxsize):
        return read(path)


def by_loadtxt(path: Path) -> object:
    """The table below the header by NumPy."""
    return np.loadtxt(path, delimiter=",", skiprows=1)


def by_pyarrow(path: Path) -> object:
    """The table by pyarrow with default options, on all cores, in Arrow columns."""
    from pyarrow import csv

    return csv.read_csv(path)


CSV: Final = "million.csv"
ULOG: Final = "px4_pyulog_auavx21/sample.ulg"
ROS_BAG: Final = "ros1_imu_tools_bags/phidgets_imu_upside_down.bag"
DATAFLASH: Final = "dronekit_log171_3mags/log171.bin"

ROWS: Final = (
    Row("DataFlash ÷ pymavlink, the fields we use", DATAFLASH, "pymavlink", every_instrument, by_pymavlink, 1 / 20),
    Row("DataFlash, those ÷ pymavlink, all of it", DATAFLASH, "pymavlink", every_instrument, all_by_pymavlink, 1 / 50),
    Row("ULog, the topics we use ÷ pyulog, the whole log", ULOG, "pyulog", every_instrument, by_pyulog, 1.2),
    Row("ROS 1 bag, the topics we use ÷ rosbags, all messages", ROS_BAG, "rosbags", every_instrument, by_rosbags, 1.2),
    Row("CSV ÷ numpy.loadtxt, without pyarrow", CSV, "numpy", without_pyarrow, by_loadtxt, 1.5),
    Row("CSV ÷ pyarrow.csv, with pyarrow", CSV, "pyarrow", read, by_pyarrow, 1.5),
)


def measured(row: Row, folder: Path) -> str:
    """Write a row of the table."""
    path = folder / row.recording
    if not path.exists() or find_spec(row.package) is None:
        return f"| {row.label} | – | – | – | no {row.package if path.exists() else path} |"
    mine, other = interleaved(lambda: row.ours(path), lambda: row.other(path), seconds=SECONDS)
    size = path.stat().st_size / 1e6
    ratio = f"{other / mine:.3g} × faster" if mine < other else f"{mine / other:.2f}"
    judged = ratio if mine / other <= row.limit else f"**{ratio}**"
    allowed = f"{1 / row.limit:.0f} × faster" if row.limit < 1 else f"{row.limit:g}"
    return f"| {row.label}, {size:.1f} MB | {mine * 1e3:.3g} ms | {other * 1e3:.3g} ms | {judged} | {allowed} |"


def write_csv(path: Path, rows: int = 1_000_000) -> None:
    """Write a time and three axes, with four decimals."""
    field = np.random.default_rng(0).normal(0.0, 30.0, (rows, 3))
    header = "time_s,mag_x_uT,mag_y_uT,mag_z_uT"
    np.savetxt(path, np.column_stack([np.arange(rows) / 50, field]), "%.4f", ",", header=header, comments="")


def labelled(folder: Path, rows: int = 300_000) -> str:
    """Sentence on the labelled lines read per second, the best of three runs."""
    field = np.random.default_rng(0).normal(0.0, 30.0, (rows, 3))
    path = folder / "print.txt"
    path.write_text("".join(f"X: {x:.2f} Y: {y:.2f} Z: {z:.2f} uT\n" for x, y, z in field), encoding="utf-8")
    took = []
    for _ in range(3):
        begin = time.perf_counter()
        read(path)
        took.append(time.perf_counter() - begin)
    return f"{rows / min(took):,.0f} labelled lines a second, as of `X: -20.80 Y: -20.20 Z: 26.10 uT`; limit 300,000"


def main() -> None:
    """Print the table."""
    folder = Path(os.environ.get("FLINDERS_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    print("| what | Flinders | other | ratio | limit |\n|---|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as made:
        write_csv(Path(made) / CSV)
        for row in ROWS:
            print(measured(row, Path(made) if row.recording == CSV else folder), flush=True)
        print(f"\n{labelled(Path(made))}")


if __name__ == "__main__":
    main()
