"""A sample of each format that is read: a tumble of one sensor, written by the format's own library if there is one.

A reader without a sample in `WRITERS` fails a test.
"""

from __future__ import annotations

import struct
import zipfile
from typing import TYPE_CHECKING

import numpy as np

from flinders.readers import registry

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

NAMES = ("t_s", "mag_x_mG", "mag_y_mG", "mag_z_mG", "acc_x", "acc_y", "acc_z")
"""Columns of the table of a tumble: time in s, field in mG, acceleration."""


def write_npy(path: Path, table: Floats) -> None:
    records = np.zeros(len(table), dtype=[(name, "<f8") for name in NAMES])
    for name, column in zip(NAMES, table.T, strict=True):
        records[name] = column
    np.save(path, records)


def write_npz(path: Path, table: Floats) -> None:
    np.savez_compressed(path, t=table[:, 0], mag_mG=table[:, 1:4], acc=table[:, 4:], note=np.array("bench"), gain=3.0)


def write_mat(path: Path, table: Floats) -> None:
    from scipy.io import savemat

    log = {"t": table[:, :1], "mag_mG": table[:, 1:4], "acc": table[:, 4:].T}
    savemat(path, {"log": log, "operator": "bench"}, do_compression=True)


def write_hdf5(path: Path, table: Floats) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["log/t"] = table[:, 0]
        file.create_dataset("log/mag", data=table[:, 1:4], chunks=(64, 3), compression="gzip", shuffle=True)
        file["log/mag"].attrs["units"] = "mG"
        file["log/acc"] = table[:, 4:].T
        file["operator"] = "bench"


def write_parquet(path: Path, table: Floats) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = pyarrow.table({**dict(zip(NAMES, table.T, strict=True)), "note": ["a"] * len(table)})
    pyarrow.parquet.write_table(columns, path, row_group_size=64)


def write_arrow(path: Path, table: Floats) -> None:
    import pyarrow

    triples = {name: pyarrow.FixedSizeListArray.from_arrays(table[:, cells].ravel(), 3)
               for name, cells in (("mag (mG)", slice(1, 4)), ("acc", slice(4, 7)))}  # fmt: skip
    columns = pyarrow.table({"t": table[:, 0], **triples})
    with pyarrow.OSFile(str(path), "wb") as sink, pyarrow.ipc.new_file(sink, columns.schema) as writer:
        writer.write_table(columns, max_chunksize=100)


def write_zip(path: Path, table: Floats) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("meta/device.csv", "name,value\nphone,1\n")
        archive.writestr("Accelerometer.csv", "time,seconds_elapsed,z,y,x\n1,0.1,3,2,1\n")
        archive.writestr("Magnetometer.csv", text_of(table / 2))
        archive.writestr("MagnetometerUncalibrated.csv", text_of(table))


def write_ros(path: Path, table: Floats) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, field = types["geometry_msgs/msg/Vector3"], types["sensor_msgs/msg/MagneticField"]
    with Writer(path) as bag:
        topic = bag.add_connection("/imu/mag", field.__msgtype__, typestore=store)
        for time, *axes in table[:, :4].tolist():
            when = round(1e9 * time) + 1_600_000_000_000_000_000
            seconds, nanoseconds = divmod(when, 1_000_000_000)
            head = header(seq=0, stamp=stamp(sec=seconds, nanosec=nanoseconds), frame_id="imu")
            tesla = vector(*(1e-7 * axis for axis in axes))
            message = field(header=head, magnetic_field=tesla, magnetic_field_covariance=np.zeros(9))
            bag.write(topic, when, store.serialize_ros1(message, field.__msgtype__))


def write_tlog(path: Path, table: Floats) -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    class Sink:
        def __init__(self) -> None:
            self.packets: list[bytes] = []

        def write(self, packet: bytes) -> None:
            self.packets.append(bytes(packet))

    sink = Sink()
    link = ardupilotmega.MAVLink(sink, srcSystem=1, srcComponent=1)
    link.heartbeat_send(2, 3, 0, 0, 3)
    for time, *axes in np.rint(table[:, :4] * [1e6, 1, 1, 1]).astype(int).tolist():
        link.raw_imu_send(time, 0, 0, -1000, 0, 0, 0, *axes)
    stamped = [(1_600_000_000_000_000 + 20_000 * place).to_bytes(8, "big") + packet
               for place, packet in enumerate(sink.packets)]  # fmt: skip
    path.write_bytes(b"".join(stamped))


def write_text(path: Path, table: Floats) -> None:
    path.write_text(text_of(table), encoding="utf-8")


def write_dataflash(path: Path, table: Floats) -> None:
    """Write a DataFlash log as text, in whole mG."""
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 134, 18, MAG, QBhhhB, TimeUS,I,MagX,MagY,MagZ,Health",
    ]
    for time, x, y, z in np.rint(table[:, :4] * [1e6, 1, 1, 1]).astype(int).tolist():
        lines.append(f"MAG, {1_000_000 + time}, 0, {x}, {y}, {z}, 1")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def write_ulog(path: Path, table: Floats) -> None:
    """Write a ULog as PX4 does: definition of a topic, subscription, messages in gauss as float32."""
    fields = b"sensor_mag:uint64_t timestamp;uint32_t device_id;float x;float y;float z;"
    messages = [b"F" + fields, b"I" + b"\x17uint32_t ver_sw_release" + struct.pack("<I", 0x010D00FF)]
    messages.append(b"A" + struct.pack("<BH", 0, 0) + b"sensor_mag")
    for time, x, y, z in table[:, :4].tolist():
        packed = struct.pack("<QI3f", 1_000_000 + round(1e6 * time), 396809, 1e-3 * x, 1e-3 * y, 1e-3 * z)
        messages.append(b"D" + struct.pack("<H", 0) + packed)
    body = b"".join(struct.pack("<H", len(message) - 1) + message for message in messages)
    path.write_bytes(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000) + body)


def text_of(table: Floats) -> str:
    return "\n".join([",".join(NAMES), *(",".join(map(repr, row)) for row in table.tolist()), ""])


BY_NAME = {reader.name: reader for reader in registry()}
_ALL: dict[str, Callable[[Path, Floats], None]] = {
    "npy": write_npy,
    "npz": write_npz,
    "mat": write_mat,
    "hdf5": write_hdf5,
    "parquet": write_parquet,
    "arrow": write_arrow,
    "zip": write_zip,
    "text": write_text,
    "ros": write_ros,
    "tlog": write_tlog,
    "dataflash": write_dataflash,
    "ulog": write_ulog,
}
WRITERS = {name: write for name, write in _ALL.items() if name in BY_NAME}
"""Functions that write a sample, by the name of the reader; only of readers that are installed."""

LOGS = frozenset(reader.name for reader in registry() if reader.log is not None)
"""Names of readers for logs of several instruments, which state their own units and clocks."""


def written(name: str, folder: Path, table: Floats) -> Path:
    """Write the sample of a reader to a folder."""
    path = folder / f"tumble{BY_NAME[name].suffixes[0]}"
    WRITERS[name](path, table)
    return path
