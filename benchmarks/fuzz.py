"""Fuzzer: mutates samples of every format and wire, and reads them in forked children with limits of time and memory.

    uv run python -m benchmarks.fuzz [--inputs 100000] [--seed 1] [--target page|fleet] [--into FOLDER] [--of FILE ...]

An input is a sample with one to four mutations, determined by seed and number. An outcome other than a result or an
error of Flinders is a finding: another exception, a warning, the end of the child, more than `MAX_CPU_S` of CPU, more
than `MAX_GROWTH_MB` of memory, or an invalid answer of the page. A finding is minimised and written to the folder.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import json
import os
import resource
import signal
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.arrays import Floats

MAX_CPU_S: Final = 10
MAX_GROWTH_MB: Final = 300
MAX_WAIT_S: Final = 600
"""Longest duration of an input without CPU use, s; generous for a loaded machine."""
ADDRESS_SPACE: Final = 16 << 30
"""Address space of a child in bytes; more raises MemoryError, which protects the machine."""
BATCH: Final = 100
"""Inputs per child, unless it ends before."""
MAX_MESSAGE_LENGTH: Final = 600
"""Most characters of a message."""
MAX_FILE_BYTES: Final = 300_000
"""Bytes of a file to use, as hundreds of copies have to be read in seconds."""
FLEET_PREFIX: Final = "fleet-"
"""Prefix of the kinds of tables of many units."""
WORDS: Final = tuple(
    struct.pack(f"{order}{kind}", value)
    for order in "<>"
    for kind, values in (("B", (0, 1, 255)), ("H", (0, 0xFFFF)), ("I", (0, 1, 0x7FFFFFFF, 0xFFFFFFFF)), ("Q", (2**40,)))
    for value in values
)
"""Wrong lengths and counts."""
NUMBERS: Final = (b"1e308", b"-1e300", b"nan", b"inf", b"", b"0x1p9", b"9" * 400, b"\xff\xfe", b"1" * 5000, b"\0", b'"')
"""Replacements of numbers in text."""


@dataclass(frozen=True)
class Input:
    """A mutated sample with its kind."""

    kind: str  # of `SAMPLES`
    content: bytes


@dataclass(frozen=True)
class Finding:
    """An input with an unexpected outcome."""

    number: int
    input: Input
    words: str


# ------------------------------------------------------------------------------------------------------------- samples


def samples(folder: Path, rows: int = 80) -> dict[str, bytes]:
    """A sample of each format and wire, written in a child, as some libraries start threads."""
    child = os.fork()
    if not child:
        _write_samples(folder, rows)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        raise RuntimeError("the samples cannot be written")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _write_samples(folder: Path, rows: int) -> None:
    """Write the samples, each to a file named by its kind."""
    from tests.flight_log import dataflash
    from tests.samples import WRITERS

    field = np.random.default_rng(5).normal(size=(rows, 3))
    field *= 480 / np.linalg.norm(field, axis=1)[:, None]
    table = np.column_stack([np.arange(rows) / 50, np.rint(field), np.tile([0.0, 0.0, 9.8], (rows, 1))])
    for name, write in WRITERS.items():
        write(folder / name, table)
        next(folder.glob(f"{name}.*"), folder / name).rename(folder / name)  # NumPy adds an ending
    text = (folder / "text").read_bytes()
    printed = [f"Raw:0,0,8192,0,0,0,{x:.0f},{y:.0f},{z:.0f}" for x, y, z in field.tolist()]
    labelled = [f"X: {x:.1f} Y: {y:.1f} Z: {z:.1f} uT" for x, y, z in field.tolist()]
    objects = [{"time": place / 50, "mag": vector} for place, vector in enumerate(field.tolist())]
    others = {
        "gzip": gzip.compress(text, mtime=0),
        "json": json.dumps(objects).encode(),
        "labelled": "\n".join(labelled).encode(),
        "binary-dataflash": b"".join(dataflash())[: 400 * rows],
        "live-lines": "\r\n".join(printed).encode(),
        "live-labels": "\r\n".join(labelled).encode(),
        "live-mavlink": b"".join(_packets((folder / "tlog").read_bytes())),
    }
    for name, content in others.items():
        (folder / name).write_bytes(content)
    _write_fleets(folder, field)


def _write_fleets(folder: Path, field: Floats) -> None:
    """Write tables of two units in several row groups and record batches."""
    import pyarrow
    from pyarrow import ipc, parquet

    axes = dict(zip(("mx_mG", "my_mG", "mz_mG"), field.T, strict=True))
    table = pyarrow.table({"unit": np.repeat(["A17", "B02"], len(field) // 2), **axes})
    parquet.write_table(table, folder / f"{FLEET_PREFIX}parquet", row_group_size=len(field) // 4)
    with ipc.new_file(folder / f"{FLEET_PREFIX}arrow", table.schema) as writer:
        writer.write_table(table, max_chunksize=len(field) // 4)


def _packets(tlog: bytes) -> Iterator[bytes]:
    """Yield the packets of a recording of MAVLink 2 without the times before them."""
    place = 8
    while place < len(tlog):
        length = 12 + tlog[place + 1]
        yield tlog[place : place + length]
        place += length + 8


# ----------------------------------------------------------------------------------------------------------- mutations


def mutated(kinds: Mapping[str, bytes], seed: int, number: int) -> Input:
    """Return the input with a number."""
    rng = np.random.default_rng([seed, number])
    kind = str(rng.choice(list(kinds)))
    content = kinds[kind]
    for mutate in rng.choice(np.array(MUTATIONS, dtype=object), rng.integers(1, 5)):
        content = mutate(content or b"\n", rng, kinds)
    return Input(kind, content)


def _flip_bits(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    changed = bytearray(content)
    for place in _places(content, rng, int(rng.integers(1, 9))):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _lie(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    """Overwrite bytes with a length or a count."""
    (place,), word = _places(content, rng, 1), WORDS[rng.integers(len(WORDS))]
    return content[:place] + word + content[place + len(word) :]


def _renumber(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    """Replace the text between two delimiters."""
    (place,) = _places(content, rng, 1)
    start = max(content.rfind(mark, 0, place) for mark in (b",", b" ", b":", b"\n")) + 1
    end = min((at for mark in (b",", b" ", b"\n") if (at := content.find(mark, start)) >= 0), default=start)
    return content[:start] + NUMBERS[rng.integers(len(NUMBERS))] + content[end:]


def _truncate(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    return content[: rng.integers(len(content))]


def _remove(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    start, end = sorted(_places(content, rng, 2))
    return content[:start] + content[min(end, start + 512) :]


def _splice(content: bytes, rng: np.random.Generator, kinds: Mapping[str, bytes]) -> bytes:
    """Insert a piece of this sample or another."""
    other = content if rng.integers(2) else kinds[str(rng.choice(list(kinds)))]
    (place,), (start,) = _places(content, rng, 1), _places(other or b"\n", rng, 1)
    return content[:place] + other[start : start + int(rng.integers(1, 2048))] + content[place:]


def _repeat(content: bytes, rng: np.random.Generator, _: Mapping[str, bytes]) -> bytes:
    """Repeat a piece, up to a million bytes, for huge lines, tables of many columns, or preallocated zeros."""
    (start,) = _places(content, rng, 1)
    piece = bytes(64) if rng.integers(4) == 0 else content[start : start + int(rng.integers(1, 64))]
    place = len(content) if rng.integers(2) else start
    return content[:place] + piece * int(10 ** rng.uniform(0, 4.2)) + content[place:]


def _places(content: bytes, rng: np.random.Generator, count: int) -> list[int]:
    """Positions of bytes: anywhere, or in the first or last kilobyte, with headers and footers."""
    start = int(rng.choice([0, 0, 0, max(len(content) - 1024, 0)]))
    end = int(rng.choice([len(content), min(start + 1024, len(content))]))
    return [int(place) for place in rng.integers(start, max(end, start + 1), count)]


MUTATIONS: Final = (_flip_bits, _flip_bits, _lie, _renumber, _truncate, _remove, _splice, _repeat)


# ------------------------------------------------------------------------------------------------------------- reading


def read_file(content: bytes, folder: Path, _: str) -> None:
    """Read the whole content of a file."""
    import flinders

    path = folder / "input"
    path.write_bytes(content)
    for instrument in flinders.open_log(path).instruments:
        for _block in instrument.blocks():
            pass
        instrument.describe()


def calibrate_fleet(content: bytes, folder: Path, kind: str) -> None:
    """Calibrate a fleet of one file."""
    from flinders.apps.fleet.job import run as calibrate
    from flinders.apps.fleet.options import Options

    fleet = folder / "fleet"
    fleet.mkdir(exist_ok=True)
    (fleet / f"units.{kind.removeprefix(FLEET_PREFIX)}").write_bytes(content)
    calibrate(str(fleet / "units.*"), folder / "out.parquet", Options(), workers=0, force=True)


def read_live(content: bytes, _: Path, kind: str) -> None:
    """Read the input of a wire, as lines or as MAVLink."""
    if kind == "live-mavlink":
        _read_mavlink(content)
        return
    from flinders.links.transcript import Transcript

    transcript, step = Transcript("the board"), max(len(content) // 20, 1)
    for number, start in enumerate(range(0, len(content), step)):
        transcript.take(content[start : start + step], at=0.1 * number)
    transcript.end(at=10.0)


def _read_mavlink(content: bytes) -> None:
    from flinders.apps.vehicles.mavlink import PX4, Vehicle
    from flinders.apps.vehicles.telemetry import Telemetry
    from flinders.links.transports import ScriptedSource

    vehicle = Vehicle(ScriptedSource([content[start : start + 512] for start in range(0, len(content), 512)]))
    vehicle.autopilot, vehicle.system = PX4, 1
    telemetry = Telemetry(vehicle)
    while not vehicle.source.is_done:  # type: ignore[attr-defined]
        telemetry.next(0.001)


def ask_page(content: bytes, folder: Path, kind: str) -> None:
    """Upload a file to the page and finish: the page must answer with a result or a refusal, and continue."""
    client = _client(str(folder))
    answer = client.post(f"/open?name={kind}", content=content)
    told = json.loads(_head(answer.content)) if answer.status_code == 200 else answer.json()
    if answer.status_code not in (200, 413, 422) or "words" not in told:
        raise AssertionError(f"the page answers {answer.status_code}: {answer.text[:MAX_MESSAGE_LENGTH]}")
    if answer.status_code == 200:
        made = client.post(f"/finish?log={told['number']}", content=b'{"type":"edits"}')
        if made.status_code != 200:
            raise AssertionError(f"the page answers {made.status_code}: {made.text[:MAX_MESSAGE_LENGTH]}")
    assert client.get("/").status_code == 200


def _head(content: bytes) -> bytes:
    """Facts about a log in the page's answer, before the readings."""
    return content[8 : 8 + int.from_bytes(content[:8], "little")]


@cache
def _client(folder: str) -> TestClient:
    """Client of a page with its own server in this process."""
    from flinders import simulate
    from flinders.apps.live.access import Gate
    from flinders.apps.live.hub import Hub
    from flinders.apps.live.server import application
    from flinders.apps.live.session_file import Supply
    from flinders.core.axes import Axes
    from flinders.links.feed_recording import RecordedFeed
    from flinders.links.feeds import Replay
    from flinders.links.sinks import FileSink

    path = Path(folder) / "session.csv"
    sink = FileSink(path, force=True)
    feed = RecordedFeed(Replay(simulate.tumble(seed=1).samples, speed=None), sink)
    hub = Hub(Supply(feed, "replay", sink, path, Axes()))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that its client may be another one some day
        from starlette.testclient import TestClient
    host = "127.0.0.1:8410"
    app = application(hub, Gate.of("127.0.0.1", 8410, ("bench",)), None, lambda _: None)
    client = TestClient(app, base_url=f"http://{host}", headers={"host": host, "origin": f"http://{host}"})
    return client.__enter__()


if TYPE_CHECKING:
    from starlette.testclient import TestClient


def reader_of(kind: str, target: str) -> Callable[[bytes, Path, str], None]:
    """Return the function that reads an input."""
    if target != "readers":
        return ask_page if target == "page" else calibrate_fleet
    return read_live if kind.startswith("live-") else read_file


def is_for(kind: str, target: str) -> bool:
    """Whether a sample is suitable for a target."""
    if target == "fleet":
        return kind.startswith(FLEET_PREFIX)
    return target == "readers" or not kind.startswith("live-")


def outcome(given: Input, folder: Path, target: str) -> str:
    """Read an input, and return a description of a failure, or empty."""
    from flinders.errors import FlindersError

    begun, memory = time.process_time(), _memory_mb("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak is that of this input
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            reader_of(given.kind, target)(given.content, folder, given.kind)
        except FlindersError as error:
            message = str(error)
            if not message.isprintable() or len(message) > MAX_MESSAGE_LENGTH:
                return f"a message of {len(message)} characters: {message[:MAX_MESSAGE_LENGTH]!r}"
        except BaseException as error:  # noqa: BLE001 - that is what is looked for
            return f"{type(error).__name__}: {str(error)[:200]} in {_place(error)}"
    if ours := [each for each in warned if "flinders" in each.filename]:
        return f"warning: {ours[0].message} in {Path(ours[0].filename).name}:{ours[0].lineno}"
    if _memory_mb("VmHWM") - memory > MAX_GROWTH_MB:
        return "more memory than it may take"
    if time.process_time() - begun > MAX_CPU_S:
        return "more time than it may take"
    return ""


def _place(error: BaseException) -> str:
    """Last lines in the traceback of an exception."""
    frames = traceback.extract_tb(error.__traceback__)[-6:]
    return " ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in frames)


def _memory_mb(name: str) -> float:
    """Memory of this process now (VmRSS) or at its peak (VmHWM)."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith(name))) / 1024


# ------------------------------------------------------------------------------------------------------------ children


def in_child(inputs: Sequence[Input], target: str) -> Iterator[str]:
    """Read inputs in a child, and yield the outcome of each; one that ends the child is the last."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _serve(inputs, target, writing)
        os._exit(0)
    os.close(writing)
    count = 0
    with os.fdopen(reading) as lines:
        for line in lines:
            count += 1
            yield json.loads(line)
    _, status = os.waitpid(child, 0)
    if count < len(inputs):
        yield f"the child ended: {signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else status}"


def _serve(inputs: Sequence[Input], target: str, writing: int) -> None:
    """Read inputs under limits, and write a line about each."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with open(os.devnull, "w") as silence, tempfile.TemporaryDirectory() as folder:  # noqa: PTH123
        os.dup2(silence.fileno(), 1)
        os.dup2(silence.fileno(), 2)
        for given in inputs:
            signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)  # ends the child
            signal.alarm(MAX_WAIT_S)  # and where it waits for something that does not come
            words = outcome(given, Path(folder), target)
            os.write(writing, json.dumps(words).encode() + b"\n")


def findings(kinds: Mapping[str, bytes], target: str, seed: int, numbers: range) -> Iterator[Finding]:
    """Read inputs with some numbers, and yield findings."""
    start = numbers.start
    while start < numbers.stop:
        inputs = [mutated(kinds, seed, number) for number in range(start, min(start + BATCH, numbers.stop))]
        for given, words in zip(inputs, in_child(inputs, target), strict=False):
            if words:
                yield Finding(start, given, words)
            start += 1
        print(f"{start:,} inputs", file=sys.stderr, end="\r", flush=True)


def minimised(finding: Finding, target: str, tries: int = 300) -> Finding:
    """Remove parts of an input that do not affect its failure."""
    content, step = finding.input.content, len(finding.input.content) // 2
    while step and tries > 0:
        for start in range(0, len(content), step):
            smaller = replace(finding.input, content=content[:start] + content[start + step :])
            tries -= 1
            if _alike(next(in_child([smaller], target)), finding.words):
                content = smaller.content
                break
            if not tries:
                break
        else:
            step //= 2
    return replace(finding, input=replace(finding.input, content=content))


def _alike(words: str, others: str) -> bool:
    """Whether two findings are of one kind."""
    return _kind(words) == _kind(others)


def _kind(words: str) -> str:
    """Shorten a finding to its kind and place."""
    return f"{words.partition(':')[0]} {words.rpartition(' ')[2][:40]}"


def preload() -> None:
    """Import modules that readers need before forking."""
    for name in ("h5py", "pyarrow.parquet", "pyarrow.ipc", "pyarrow.compute", "pyulog", "rosbags.highlevel",
                 "pymavlink.dialects.v20.common", "flinders.links.transcript",
                 "flinders.apps.vehicles.mavlink"):  # fmt: skip
        with contextlib.suppress(ImportError):
            __import__(name)


def run(inputs: int, seed: int, target: str, into: Path | None = None, of: Sequence[Path] = ()) -> Counter[str]:
    """Read inputs, count the findings of each kind, and print and write new ones.

    Inputs are mutations of the files `of`, or of all samples.
    """
    preload()
    with tempfile.TemporaryDirectory() as folder:
        kinds = {path.name: path.read_bytes()[:MAX_FILE_BYTES] for path in of} or samples(Path(folder))
    kinds = {name: content for name, content in kinds.items() if is_for(name, target)}
    counts: Counter[str] = Counter()
    for finding in findings(kinds, target, seed, range(inputs)):
        likeness = f"{finding.input.kind}: {_kind(finding.words)}"
        counts[likeness] += 1
        if counts[likeness] == 1:
            print(f"{finding.number} {finding.input.kind}: {finding.words}", flush=True)
            if into:
                into.mkdir(exist_ok=True)
                smallest = minimised(finding, target)
                (into / f"{seed}-{finding.number}-{finding.input.kind}").write_bytes(smallest.input.content)
    return counts


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the fuzzer from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", choices=("readers", "page", "fleet"), default="readers")
    parser.add_argument("--into", type=Path)
    parser.add_argument("--of", type=Path, nargs="*", default=(), help="files to mutate, in place of the samples")
    options = parser.parse_args(arguments)
    begun = time.monotonic()
    counts = run(options.inputs, options.seed, options.target, options.into, options.of)
    print(f"{options.inputs:,} inputs, {sum(counts.values())} findings, {time.monotonic() - begun:.0f} s")
    sys.exit(bool(counts))


if __name__ == "__main__":
    main()
