"""Odd inputs at the command line: a correct result, or one clear line and the right exit code; nothing half-written."""

from __future__ import annotations

import gc
import gzip
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.trials import daily, nightly

from flinders import simulate
from flinders.cli import main
from flinders.core.calibration import Calibration
from flinders.core.units import Unit

if TYPE_CHECKING:
    from collections.abc import Callable

TUMBLE = simulate.tumble(seed=5, n=400, motion="uniform")
TEXT = "".join(f"{x:.3f},{y:.3f},{z:.3f}\n" for x, y, z in TUMBLE.samples.field)
HEADED = "mx_uT,my_uT,mz_uT\n" + TEXT
LINES = TEXT.splitlines(keepends=True)
MOTIONCAL = "".join(f"Raw:0,0,8192,0,0,0,{x:.0f},{y:.0f},{z:.0f}\r\n" for x, y, z in TUMBLE.samples.field * 10)
GOOD, USAGE, LIMITED, REFUSED, UNREADABLE, UNWRITABLE = 0, 2, 3, 4, 5, 6
TELLS = ("error: ", "refused: ")


@dataclass(frozen=True)
class Odd:
    """What is typed, what stands in ``odd.csv`` or comes through a pipe, and how it should end.

    A code of 0 or 3 promises the offset of the simulated sensor too.
    """

    code: int
    content: bytes | str = TEXT
    words: str = "calibrate odd.csv"
    stdin: bytes | str = b""


def rows(values: object) -> str:
    """A table of numbers as text."""
    return "".join(",".join(f"{value:.17g}" for value in row) + "\n" for row in np.asarray(values, float))


def ring(n: int = 200) -> str:
    """A sensor turned about one axis that is not one of its own."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    across = np.array([[1, 1, 1], [1, -1, 0]]) / np.sqrt([[3], [2]])
    noise = np.random.default_rng(1).normal(0, 0.2, (n, 3))
    return rows(50 * (np.outer(np.cos(angle), across[0]) + np.outer(np.sin(angle), across[1])) + [10, 20, 30] + noise)


def level_turn(n: int = 200) -> str:
    """A sensor turned about its z axis, which reads the same all the time."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return rows(np.stack([25 * np.cos(angle) + 10, 25 * np.sin(angle) + 20, np.full(n, 43.0)], axis=1))


def zipped(**members: str) -> bytes:
    """A ZIP archive."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return file.getvalue()


GAUSS = np.random.default_rng(2).normal(size=(100, 3))

ODD: dict[str, Odd] = {
    # nothing to read
    "nothing": Odd(UNREADABLE, b""),
    "blank lines": Odd(UNREADABLE, " \n\n \t\n"),
    "comments only": Odd(UNREADABLE, "# one\n# two\n"),
    "a header only": Odd(UNREADABLE, "mx,my,mz\n"),
    "text only": Odd(UNREADABLE, "hello\nworld\n"),
    "NaN only": Odd(UNREADABLE, "nan,nan,nan\n" * 50),
    "infinity only": Odd(UNREADABLE, "inf,-inf,inf\n" * 50),
    "nothing through a pipe": Odd(UNREADABLE, words="calibrate -"),
    "no such file": Odd(UNREADABLE, words="calibrate nix.csv"),
    "a file for a folder": Odd(UNREADABLE, words="calibrate odd.csv/x"),
    "a folder": Odd(UNREADABLE, words="calibrate folder"),
    "a name too long": Odd(UNREADABLE, words=f"calibrate {'a' * 300}.csv"),
    "a null character in the name": Odd(UNREADABLE, words="calibrate odd\0.csv"),
    # not text
    "random bytes": Odd(UNREADABLE, np.random.default_rng(3).bytes(5000)),
    "zeros": Odd(UNREADABLE, bytes(5000)),
    "a PNG image": Odd(UNREADABLE, b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + bytes(100)),
    "a spreadsheet": Odd(UNREADABLE, zipped(**{"[Content_Types].xml": "<x/>"})),
    "an archive without a recording": Odd(UNREADABLE, zipped(photo="x")),
    "an HTML page": Odd(UNREADABLE, "<!DOCTYPE html><html><body>1,2,3</body></html>"),
    "broken gzip": Odd(UNREADABLE, gzip.compress(TEXT.encode())[:60] + b"?" * 600),
    "a line of 10 MB": Odd(UNREADABLE, "1,2,3," * 1_700_000),
    "broken JSON": Odd(UNREADABLE, "[[1, 2, 3], [4, 5"),
    "JSON with one object": Odd(UNREADABLE, '{\n"a": [1, 2]\n}'),
    "a calibration as recording": Odd(UNREADABLE, words="calibrate calibration.json"),
    # other columns
    "two columns": Odd(UNREADABLE, rows(GAUSS[:, :2])),
    "six columns without a header": Odd(UNREADABLE, rows(np.hstack([GAUSS, GAUSS]))),
    "other sensors only": Odd(UNREADABLE, "ax,ay,az\n" + TEXT),
    "a column that is not there": Odd(USAGE, words="calibrate odd.csv --columns 1,2,9"),
    "column nought": Odd(USAGE, words="calibrate odd.csv --columns 0,1,2"),
    "a name that is not there": Odd(USAGE, words="calibrate odd.csv --columns mx,my,mz"),
    "two columns asked for": Odd(USAGE, words="calibrate odd.csv --columns 1,2"),
    "a column asked for twice": Odd(USAGE, words="calibrate odd.csv --columns 1,1,2"),
    # no ellipsoid
    "one reading": Odd(REFUSED, "1,2,3\n"),
    "eight readings": Odd(REFUSED, "".join(LINES[:8])),
    "all readings equal": Odd(REFUSED, "1.5,2.5,3.5\n" * 99),
    "two axes constant": Odd(REFUSED, rows(GAUSS * [0, 0, 1] + [1, 2, 3])),
    "a straight line": Odd(REFUSED, rows([[i, 2 * i, 3 * i + 1] for i in range(100)])),
    "a ring in a plane": Odd(REFUSED, ring()),
    "a ring in a plane, by sums": Odd(REFUSED, ring(), "calibrate odd.csv --method consistent"),
    "noise without a field": Odd(REFUSED, rows(GAUSS)),
    "a z that is stuck": Odd(REFUSED, rows(GAUSS * [1, 1, 0] + [0, 0, 7])),
    "a level turn of which z is stuck": Odd(REFUSED, level_turn()),
    "two recordings that contradict each other": Odd(
        REFUSED, rows(np.add(TUMBLE.samples.field, [9, 0, 0])), "calibrate good.csv odd.csv --unit uT"
    ),
    "level turns without a prior": Odd(USAGE, words="calibrate odd.csv --method level --prior none"),
    "numbers of 1e300": Odd(REFUSED, rows(GAUSS * 1e300)),
    "numbers of 1e150": Odd(REFUSED, rows(GAUSS * 1e150)),
    "numbers of 1e-300": Odd(REFUSED, rows(GAUSS * 1e-300)),
    # read as meant
    "some NaN": Odd(GOOD, TEXT + "nan,1,2\n1,,2\n3,inf,4\n"),
    "ragged lines": Odd(GOOD, TEXT + "1,2\n1,2,3,4,5\n"),
    "a bad line in the middle": Odd(GOOD, TEXT + "12.3,4\x005.6,oops\n" + TEXT),
    "mixed delimiters": Odd(LIMITED, TEXT + "".join(LINES[:100]).replace(",", ";")),
    "UTF-8 cut in a character": Odd(GOOD, (HEADED + "# µ").encode()[:-1]),
    "UTF-8 with a byte order mark": Odd(GOOD, b"\xef\xbb\xbf" + HEADED.encode()),
    "UTF-16": Odd(GOOD, HEADED.encode("utf-16")),
    "gzip": Odd(GOOD, gzip.compress(HEADED.encode())),
    "gzip cut short": Odd(GOOD, gzip.compress(TEXT.encode())[:-500]),
    "gzip through a pipe": Odd(GOOD, words="calibrate -", stdin=gzip.compress(HEADED.encode())),
    "CR alone": Odd(GOOD, HEADED.replace("\n", "\r")),
    "decimal comma": Odd(GOOD, TEXT.replace(",", ";").replace(".", ",")),
    "quotes": Odd(GOOD, '"' + TEXT.replace(",", '","').replace("\n", '"\n"')[:-1]),
    "JSON triples": Odd(GOOD, json.dumps(TUMBLE.samples.field.tolist())),
    "lines of MotionCal": Odd(GOOD, MOTIONCAL),
    "a pipe": Odd(GOOD, words="calibrate -", stdin=TEXT),
    "another alphabet in the name": Odd(GOOD, words="calibrate Zürich-磁力.csv"),
    "spaces and a line end in the name": Odd(GOOD, words="calibrate two\vwords\n.csv"),
    # options
    "a negative scale": Odd(USAGE, words="calibrate odd.csv --scale -1"),
    "an infinite scale": Odd(USAGE, words="calibrate odd.csv --scale inf"),
    "a scale for microtesla": Odd(USAGE, words="calibrate odd.csv --unit uT --scale 2"),
    "an unknown unit": Odd(USAGE, words="calibrate odd.csv --unit furlong"),
    "a unit against the header": Odd(USAGE, HEADED, "calibrate odd.csv --unit mG"),
    "an axis twice": Odd(USAGE, words="calibrate odd.csv --axes x,x,z"),
    "an unknown method": Odd(USAGE, words="calibrate odd.csv --method nix"),
    "a prior for minmax": Odd(USAGE, words="calibrate odd.csv --method minmax --prior 0.3"),
    "a prior of nonsense": Odd(USAGE, words="calibrate odd.csv --prior nix"),
    "a field strength of nought": Odd(USAGE, words="calibrate odd.csv --field-strength 0"),
    "a dip past the pole": Odd(USAGE, words="calibrate odd.csv --dip 91"),
    "a target that is no number": Odd(USAGE, words="calibrate odd.csv --target nan"),
    "an unknown option": Odd(USAGE, words="calibrate odd.csv --nix"),
    "an unknown command": Odd(USAGE, words="nix"),
    "what another command does": Odd(USAGE, words="plot odd.csv"),
    "no recording": Odd(USAGE, words="calibrate"),
    "the same recording twice": Odd(USAGE, words="calibrate odd.csv folder/../odd.csv"),
    "standard input twice": Odd(USAGE, words="calibrate - -", stdin=TEXT),
    "recordings in two units": Odd(USAGE, words="calibrate odd.csv good.csv"),
    # output
    "no such folder": Odd(UNWRITABLE, words="calibrate odd.csv -o nix/c.json"),
    "a folder for a file": Odd(UNWRITABLE, words="calibrate odd.csv -o folder"),
    "below a file": Odd(UNWRITABLE, words="calibrate odd.csv -o good.csv/c.json"),
    "a file that is there": Odd(UNWRITABLE, words="calibrate odd.csv -o calibration.json"),
    "the file that is there, before reading": Odd(UNWRITABLE, b"", "calibrate odd.csv -o calibration.json"),
    "an output name too long": Odd(UNWRITABLE, words=f"calibrate odd.csv -o {'a' * 300}"),
    "a null character in the output": Odd(UNWRITABLE, words="calibrate odd.csv -o c\0.json"),
    "a device": Odd(UNWRITABLE, words="calibrate odd.csv -o /dev/null --force"),
    "over the recording": Odd(USAGE, words="calibrate odd.csv -o odd.csv --force"),
    "JSON and calibration to one place": Odd(USAGE, words="calibrate odd.csv -o - --json"),
    # apply
    "arguments the wrong way round": Odd(USAGE, words="apply odd.csv calibration.json"),
    "two recordings": Odd(USAGE, words="apply odd.csv good.csv"),
    "two calibrations": Odd(UNREADABLE, words="apply calibration.json calibration.json"),
    "a calibration cut short": Odd(UNREADABLE, b'{"flinders": "calibr', "apply odd.csv good.csv"),
    "a calibration of the future": Odd(
        UNREADABLE, '{"flinders": "calibration", "schema": 99}', "apply odd.csv good.csv"
    ),
    "no calibration": Odd(UNREADABLE, words="apply nix.json good.csv"),
    "a calibration through a pipe": Odd(USAGE, words="apply - good.csv"),
    "a recording in counts": Odd(USAGE, "Raw:0,0,0,0,0,0,1,2,3\n" * 9, "apply counts.json good.csv"),
    "another sensor": Odd(UNREADABLE, rows(GAUSS * 5000), "apply calibration.json odd.csv"),
    "over the raw recording": Odd(USAGE, words="apply calibration.json good.csv -o good.csv --force"),
    "over the calibration": Odd(USAGE, words="apply calibration.json good.csv -o calibration.json --force"),
    "corrected to a folder that is not there": Odd(UNWRITABLE, words="apply calibration.json good.csv -o nix/out.csv"),
    "JSON and readings to one place": Odd(USAGE, words="apply calibration.json good.csv --json"),
    "an empty recording to apply to": Odd(UNREADABLE, b"", "apply calibration.json odd.csv -o out.csv"),
    "a recording that breaks off": Odd(
        UNREADABLE, gzip.compress((HEADED + TEXT * 30).encode())[:-8] + bytes(8),
        "apply calibration.json odd.csv -o out.csv"
    ),
}  # fmt: skip

REAL = (
    "nothing through a pipe", "gzip through a pipe", "another alphabet in the name",
    *map(nightly, ("a folder", "no such folder", "nothing", "random bytes", "two axes constant", "a negative scale")),
    nightly("over the raw recording"),
)  # fmt: skip
"""Those that are also run as a program of their own."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a good recording, a calibration of it, one in counts, and a folder; the working directory."""
    home = tmp_path / "home"
    (home / "folder").mkdir(parents=True)
    (tmp_path / "scratch").mkdir()
    (home / "good.csv").write_text(HEADED, encoding="utf-8")
    for name, unit in (("calibration.json", "uT"), ("counts.json", "counts")):
        Calibration(np.eye(3), TUMBLE.sensor.offset, 50.0, raw=Unit.of(unit)).save(home / name)
    monkeypatch.chdir(home)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    return home


def prepared(odd: Odd, folder: Path) -> list[str]:
    """Lay the odd file down under every name that the command line gives it."""
    words = [word.replace("\v", " ") for word in odd.words.split(" ")]
    content = odd.content.encode() if isinstance(odd.content, str) else odd.content
    for name in {"odd.csv", *(words[1:] if words[0] == "calibrate" and odd.code == GOOD else ())} - {"-"}:
        if not name.startswith("--"):
            (folder / name).write_bytes(content)
    return [*words, "--json"] if odd.code in {GOOD, LIMITED} else words


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def judged(odd: Odd, code: int, out: str, err: str) -> None:
    """Hold what the program said against what it should say."""
    last = err.rstrip("\n").rpartition("\n")[2]
    is_packed = isinstance(odd.content, bytes) and odd.content.startswith(b"\x1f\x8b")  # as short as zlib makes it
    assert "Traceback" not in err
    assert "internal error" not in err, err
    assert code == odd.code, err
    if code in {GOOD, LIMITED}:
        found = json.loads(out)
        assert found["verdict"] == {GOOD: "good", LIMITED: "limited"}[code]
        npt.assert_allclose(found["calibration"]["offset"], TUMBLE.sensor.offset, atol=0.3)
        assert_sentences([err, *(finding["advice"] for finding in found["findings"])], numbers=not is_packed)
        return
    assert (json.loads(out)["error"]["exit_code"] == code) if "--json" in odd.words else out == ""
    if "REFUSED" in err:
        assert "no calibration was written" in err
        assert_sentences(" ".join(err.split()))
        return
    assert last.startswith(TELLS)
    assert_sentences(last)
    assert ": " in last.partition(": ")[2] or ";" in last, f"does not say what to do: {last}"


def test_the_table_is_long_enough() -> None:
    assert len(ODD) >= 60


@pytest.mark.parametrize("name", ODD)
def test_odd_input(name: str, folder: Path, tmp_path: Path) -> None:
    odd = ODD[name]
    words = prepared(odd, folder)
    before = contents(folder)
    result = CliRunner().invoke(main, words, input=odd.stdin)
    code, out, err = result.exit_code, result.stdout, result.stderr
    del result
    judged(odd, code, out, err)
    assert contents(folder) == before
    if any((tmp_path / "scratch").iterdir()):
        gc.collect()
    assert list((tmp_path / "scratch").iterdir()) == []


@pytest.mark.parametrize("name", REAL)
def test_odd_input_to_the_real_program(name: str, folder: Path, tmp_path: Path) -> None:
    odd = ODD[name]
    words = prepared(odd, folder)
    before = contents(folder)
    done = program(words, odd.stdin.encode() if isinstance(odd.stdin, str) else odd.stdin, scratch=tmp_path / "scratch")
    judged(odd, done.returncode, done.stdout.decode(), done.stderr.decode())
    assert contents(folder) == before
    assert list((tmp_path / "scratch").iterdir()) == []


def program(
    words: list[str], stdin: bytes = b"", *, scratch: Path | None = None, stdout: int | None = subprocess.PIPE
) -> subprocess.CompletedProcess[bytes]:
    """Run flinders as a program of its own."""
    command = [sys.executable, "-c", "from flinders.cli import main; main(prog_name='flinders')", *words]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"} | ({"TMPDIR": str(scratch)} if scratch else {})
    return subprocess.run(command, input=stdin, stdout=stdout, stderr=subprocess.PIPE, check=False, env=environment)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize(
    "words", daily(["demo --json", "--help", "calibrate good.csv", "apply calibration.json good.csv"], 3)
)
def test_a_full_disk_behind_standard_output_ends_with_6_and_a_line(words: str, folder: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        done = program(words.split(), stdout=full.fileno())
    assert done.returncode == UNWRITABLE, done.stderr.decode()
    last = done.stderr.decode().rstrip("\n").rpartition("\n")[2]
    assert_sentences(last)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read and write everything")
def test_no_permission_is_said(folder: Path) -> None:
    (folder / "good.csv").chmod(0)
    result = CliRunner().invoke(main, ["calibrate", "good.csv"])
    assert result.exit_code == UNREADABLE
    assert_sentences(result.stderr)
    (folder / "good.csv").chmod(0o600)
    (folder / "folder").chmod(0o500)
    result = CliRunner().invoke(main, ["calibrate", "good.csv", "-o", "folder/c.json"])
    (folder / "folder").chmod(0o700)
    assert result.exit_code == UNWRITABLE
    assert_sentences(result.stderr)


def test_a_fault_of_ours_is_confessed_with_a_report(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> Callable[[], None]:
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr("flinders.fitting.filtering.fit", broken)
    result = CliRunner().invoke(main, ["calibrate", "good.csv"])
    assert result.exit_code == 70
    report = result.stderr.rstrip().rpartition(" with ")[2]
    assert_sentences(result.stderr)
    assert_sentences(result.stderr)
    assert "Traceback" not in result.stderr
    assert "Traceback" in Path(report).read_text(encoding="utf-8")
