"""Each malformed calibration file, bad argument and bad place to write to gets one clear line."""

from __future__ import annotations

import errno
import gzip
import json
import os
import stat
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flinders.core import calibration_file
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import Correction, Document, Fitted, ProvenanceRecord, Recorded
from flinders.core.units import Unit
from flinders.errors import ArrayError, DocumentError, FlindersError, OutputError, OutputExists, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SOUND: dict[str, Any] = {
    "flinders": "calibration",
    "schema": 1,
    "calibration": {
        "matrix": [[1.0, 0.0, 0.0], [0.0, 1.25, 0.0], [0.0, 0.0, 0.8]],
        "offset": [1, 2, 3],
        "field_strength": 49.8,
        "field_strength_known": True,
        "unit": "uT",
        "rotation": "symmetric",
    },
    "raw": {"unit": "mG", "scale": 0.1, "axes": "x,y,z", "sensor": None, "frame": "sensor"},
    "fit": None,
    "provenance": None,
}
FIT = {"method": "auto", "samples": 100}


def changed(place: str, value: object) -> bytes:
    """The sound file with one value changed: ``changed("calibration.unit", "mT")``."""
    content = json.loads(json.dumps(SOUND))
    *parts, last = place.split(".")
    part = content
    for name in parts:
        part = part[name]
    part[last] = value
    return json.dumps(content).encode()


def without(place: str) -> bytes:
    """The sound file without one of its parts."""
    content = json.loads(json.dumps(SOUND))
    *parts, last = place.split(".")
    part = content
    for name in parts:
        part = part[name]
    del part[last]
    return json.dumps(content).encode()


WHOLE = json.dumps(SOUND).encode()

MALFORMED: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "is empty"),
    "spaces": (b" \n\n", "is empty"),
    "cut short": (WHOLE[:90], "truncated.*cut short"),
    "two files in one": (WHOLE + WHOLE, "trailing characters"),
    "text": (b"x,y,z\n1,2,3\n", "cannot be read as JSON.*need a calibration file"),
    "binary": (bytes(range(256)), "cannot be read as JSON"),
    "zeros": (bytes(1000), "cannot be read as JSON"),
    "UTF-16": (WHOLE.decode().encode("utf-16"), "cannot be read as JSON"),
    "bad UTF-8": (WHOLE.replace(b'"sensor"', b'"\xff\xff"'), "cannot be read as JSON"),
    "gzip": (gzip.compress(WHOLE), "cannot be read as JSON"),
    "too deep": (b"[" * 100_000, "cannot be read as JSON.*recursion"),
    "too large": (b" " * (calibration_file.LARGEST + 1), "more than 16 MB is no calibration file"),
    "a number": (b"42", "not a calibration file"),
    "a list": (b"[1, 2, 3]", "not a calibration file"),
    "another program's": (b'{"magnetometer": {"bias": [1, 2, 3]}}', 'lacks "flinders": "calibration"'),
    "another file of ours": (b'{"flinders": "summary", "schema": 1}', "not a calibration file"),
    "no schema": (without("schema"), "schema is null, need a version"),
    "schema as text": (changed("schema", "1"), 'schema is "1", need a version'),
    "schema true": (changed("schema", True), "schema is true"),
    "schema zero": (changed("schema", 0), "schema is 0"),
    "newer schema": (changed("schema", 7), "written in schema 7, .* reads up to 1: install .* knows schema 7"),
    "NaN": (WHOLE.replace(b"49.8", b"NaN"), "cannot be read as JSON"),
    "infinity": (WHOLE.replace(b"49.8", b"Infinity"), "cannot be read as JSON"),
    "too large a number": (WHOLE.replace(b"49.8", b"1e999"), "out of range"),
    "too long a number": (WHOLE.replace(b"49.8", b"9" * 400), "calibration.field_strength: number out of range"),
    "no calibration": (without("calibration"), "missing required field calibration"),
    "no raw": (without("raw"), "missing required field raw"),
    "no matrix": (without("calibration.matrix"), "calibration: object missing required field matrix"),
    "an unknown key": (changed("calibration.comment", "mine"), "calibration: object contains unknown field comment"),
    "a short offset": (changed("calibration.offset", [1, 2]), "calibration.offset: expected array of length 3, got 2"),
    "text in offset": (changed("calibration.offset", [1, 2, "3"]), r"calibration.offset\[2\]: expected float, got str"),
    "null in offset": (changed("calibration.offset", [1, 2, None]), r"calibration.offset\[2\]: expected float"),
    "a 2 × 3 matrix": (
        changed("calibration.matrix", [[1, 0, 0]] * 2),
        "calibration.matrix: expected array of length 3",
    ),
    "a ragged matrix": (changed("calibration.matrix", [[1], [0, 1, 0], [0, 0, 1]]), r"calibration.matrix\[0\]: exp"),
    "a singular matrix": (changed("calibration.matrix", [[1, 1, 1]] * 3), "matrix is singular"),
    "a zero matrix": (changed("calibration.matrix", [[0, 0, 0]] * 3), "matrix is singular"),
    "a matrix that is not symmetric": (
        changed("calibration.matrix", [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
        "matrix is not symmetric: .* 0.1; say how it is turned",
    ),
    "negative strength": (changed("calibration.field_strength", -49.8), "field_strength: expected float > 0"),
    "zero strength": (changed("calibration.field_strength", 0), "field_strength: expected .* > 0"),
    "unknown unit": (changed("calibration.unit", "mT"), "calibration.unit: invalid enum value 'mT'"),
    "unknown rotation": (changed("calibration.rotation", "free"), "calibration.rotation: invalid enum value 'free'"),
    "contradicting scale": (
        changed("raw.scale", 0.5),
        "raw.unit 'mG' with scale 0.5 .* contradict .* one mG is 0.1 uT",
    ),
    "contradicting unit": (changed("calibration.unit", "counts"), "calibration.unit 'counts' contradict"),
    "zero scale": (changed("raw.scale", 0), "raw.scale: expected .* > 0"),
    "axes twice": (changed("raw.axes", "x,x,z"), "axes 'x,x,z': need x, y and z once each"),
    "axes of words": (changed("raw.axes", "forward"), "raw.axes: expected str matching regex"),
    "a covariance of the wrong size": (
        changed("fit", {**FIT, "covariance": [[1]]}),
        "fit: covariance needs 9 rows of 9",
    ),
    "a negative variance": (
        changed("fit", {**FIT, "covariance_of": ["offset_x"], "covariance": [[-1]]}),
        "fit: covariance has a negative variance",
    ),
    "a negative count": (changed("fit", {**FIT, "samples": -5}), "fit.samples: expected int >= 0"),
    "an unknown verdict": (changed("fit", {**FIT, "verdict": "fine"}), "fit.verdict: invalid enum value 'fine'"),
    "a date without zone": (
        changed("provenance", {"flinders": "0.1.0", "date": "2026-11-21T10:00:00"}),
        "provenance.date: expected datetime with a timezone",
    ),
}


@pytest.mark.parametrize(("content", "words"), MALFORMED.values(), ids=MALFORMED)
def test_a_malformed_file_is_refused_in_one_line_that_names_file_and_fault(
    content: bytes, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    with pytest.raises(DocumentError, match=words) as caught:
        Calibration.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 5


def test_the_sound_file_is_read_even_with_a_byte_order_mark() -> None:
    for text in (WHOLE, b"\xef\xbb\xbf" + WHOLE):
        calibration = Calibration.from_document(calibration_file.loads(text))
        assert calibration.offset.tolist() == [1, 2, 3]
        assert calibration.raw == Unit.of("mG")


def test_counts_with_and_without_a_scale_are_understood() -> None:
    scaled = changed("raw", {"unit": "counts", "scale": 0.15})
    assert Calibration.from_document(calibration_file.loads(scaled)).raw == Unit.of("counts", 0.15)
    bare = Calibration.identity().to_document()
    assert Calibration.from_document(calibration_file.loads(calibration_file.dumps(bare))).raw == Unit.of("counts")


def test_a_newer_file_says_which_release_can_read_it() -> None:
    newer = {"flinders": "calibration", "schema": 2, "provenance": {"flinders": "3.1.0"}, "new": "part"}
    with pytest.raises(DocumentError, match=r"install Flinders 3\.1\.0 or newer"):
        calibration_file.loads(json.dumps(newer))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.json", "no such file"),
        (".", "is a directory"),
        ("file/below.json", "is a file, not a folder"),
        ("n" * 300, "name is too long"),
        ("a\0b", "null (byte|character)"),
        ("loop", "lead in a circle"),
    ],
)
def test_a_path_that_cannot_be_opened_is_refused_with_what_to_do(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(DocumentError, match=words):
        Calibration.load(tmp_path / name)


EYE = np.eye(3)
COMPLEX: Any = 1j * EYE
BAD_ARGUMENTS: dict[str, tuple[Callable[[], object], type[FlindersError], str]] = {
    "2 × 2 matrix": (lambda: Calibration(np.eye(2), np.zeros(3), 1.0), ArrayError, r"matrix has shape \(2, 2\)"),
    "NaN in matrix": (lambda: Calibration(EYE * np.nan, np.zeros(3), 1.0), ArrayError, "matrix is nan at index"),
    "complex matrix": (lambda: Calibration(COMPLEX, np.zeros(3), 1.0), ArrayError, "complex"),
    "singular matrix": (lambda: Calibration(np.ones((3, 3)), np.zeros(3), 1.0), ArrayError, "singular"),
    "asymmetric": (
        lambda: Calibration(np.triu(np.ones((3, 3))), np.zeros(3), 1.0),
        ArrayError,
        "not symmetric.*rotation",
    ),
    "short offset": (lambda: Calibration(EYE, np.zeros(2), 1.0), ArrayError, r"offset has shape \(2,\)"),
    "offset table": (lambda: Calibration(EYE, np.zeros((1, 3)), 1.0), ArrayError, r"offset has shape \(1, 3\)"),
    "infinite offset": (lambda: Calibration(EYE, np.full(3, np.inf), 1.0), ArrayError, "offset is inf"),
    "no strength": (
        lambda: Calibration(EYE, np.zeros(3), 0.0),
        UsageError,
        r"field_strength is 0\.0: need one positive",
    ),
    "negative strength": (lambda: Calibration(EYE, np.zeros(3), -50), UsageError, "field_strength is -50"),
    "NaN strength": (lambda: Calibration(EYE, np.zeros(3), np.nan), UsageError, "field_strength is nan"),
    "text strength": (lambda: Calibration(EYE, np.zeros(3), "50"), ArrayError, "field_strength holds text"),  # type: ignore[arg-type]
    "unknown rotation": (
        lambda: Calibration(EYE, np.zeros(3), 1.0, rotation="free"),  # type: ignore[arg-type]
        UsageError,
        "rotation is 'free': need one of symmetric, estimated, composed",
    ),
    "flat ellipsoid": (
        lambda: Calibration.from_ellipsoid(np.zeros(3), np.diag([1.0, 1.0, 0.0])),
        ArrayError,
        "shape has radii .* must be positive",
    ),
    "hyperboloid": (
        lambda: Calibration.from_ellipsoid(np.zeros(3), np.diag([1.0, 1.0, -1.0])),
        ArrayError,
        "shape has",
    ),
    "turned ellipsoid": (
        lambda: Calibration.from_ellipsoid(np.zeros(3), EYE + np.triu(EYE[::-1])),
        ArrayError,
        "shape is not symmetric",
    ),
    "negative known strength": (
        lambda: Calibration.from_ellipsoid(np.zeros(3), EYE, field_strength=-1),
        UsageError,
        "field_strength is -1",
    ),
    "pairs of readings": (lambda: Calibration.identity().apply([[1, 2]]), ArrayError, r"raw has shape \(1, 2\)"),
    "words as readings": (lambda: Calibration.identity().apply(["a", "b", "c"]), ArrayError, "raw holds text"),
    "a lone number": (lambda: Calibration.identity().unapply(3.0), ArrayError, "corrected has shape"),
}


@pytest.mark.parametrize(("make", "kind", "words"), BAD_ARGUMENTS.values(), ids=BAD_ARGUMENTS)
def test_a_bad_argument_is_refused_by_name(make: Callable[[], object], kind: type[FlindersError], words: str) -> None:
    with pytest.raises(kind, match=words):
        make()


def test_a_mirror_is_a_calibration_as_two_of_them_may_compose_to_one() -> None:
    assert Calibration(np.diag([1.0, 1.0, -1.0]), np.zeros(3), 50.0).apply([1, 2, 3]).tolist() == [1, 2, -3]


def correction(**changes: Any) -> Correction:
    return Correction(**{**SOUND["calibration"], **changes})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (correction(offset=(1.0, float("nan"), 3.0)), r"calibration.offset\[1\] is not finite"),
        (correction(field_strength=float("inf")), "calibration.field_strength is not finite"),
        (correction(field_strength=-1.0), "calibration.field_strength: expected float > 0"),
        (correction(offset=(1.0, 2.0)), "calibration.offset: expected array of length 3"),
        (correction(unit="mG"), "calibration.unit: invalid enum value"),
        (correction(offset=(1j, 2, 3)), "complex cannot be written"),
    ],
)
def test_a_document_that_could_not_be_read_again_is_not_written(
    content: Correction, words: str, tmp_path: Path
) -> None:
    with pytest.raises(DocumentError, match=words):
        calibration_file.write(Document(calibration=content, raw=Recorded(unit="mG", scale=0.1)), tmp_path / "out.json")
    assert list(tmp_path.iterdir()) == []


def test_numbers_of_numpy_are_written_as_numbers() -> None:
    fit = Fitted(method="auto", samples=np.int64(5), coverage={"seen": np.float32(0.5)})  # type: ignore[arg-type, dict-item]
    provenance = ProvenanceRecord(flinders="0.1.0", date=datetime(2026, 11, 21, tzinfo=UTC))
    kept = calibration_file.loads(
        calibration_file.dumps(Calibration.identity().to_document(fit=fit, provenance=provenance))
    )
    assert kept.fit is not None
    assert (kept.fit.samples, kept.fit.coverage) == (5, {"seen": 0.5})


CALIBRATION = Calibration.identity(field_strength=50.0)


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text("precious")
    with pytest.raises(OutputExists, match="exists: give another name, or overwrite it"):
        CALIBRATION.save(path)
    assert path.read_text() == "precious"
    CALIBRATION.save(path, force=True)
    assert Calibration.load(path).isclose(CALIBRATION, tolerance=0)
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_appears_while_writing_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "calibration.json"
    monkeypatch.setattr(os, "fsync", lambda _: path.write_text("precious"))
    with pytest.raises(OutputExists):
        CALIBRATION.save(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_system_without_hard_links_gets_the_file_by_renaming(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "link", failing(errno.EPERM))
    CALIBRATION.save(tmp_path / "calibration.json")
    assert [path.name for path in tmp_path.iterdir()] == ["calibration.json"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing/out.json", "no such folder: create it"),
        (".", "is a directory: give the name of a file"),
        ("", "is a directory"),
        ("file/out.json", "is a file, not a folder"),
        ("n" * 300, "name is too long"),
        ("a\0b", "null (byte|character)"),
        ("loop", "lead in a circle"),
        ("pipe", "device or a pipe"),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_a_place_that_cannot_be_written_to_says_what_to_do(name: str, words: str, force: bool, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(OutputError, match=words) as caught:
        CALIBRATION.save(os.fspath(tmp_path) + "/" + name, force=force)
    assert caught.value.exit_code == 6
    assert sorted(tmp_path.iterdir()) == before


def failing(number: int) -> Callable[..., None]:
    """A function of `os` that fails as the operating system does."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "no space left on the disk: free some"),
        (errno.EACCES, "no permission"),
        (errno.EROFS, "read-only: use another folder"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_failing_disk_leaves_the_old_file_and_nothing_else(
    number: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "calibration.json"
    path.write_text("precious")
    monkeypatch.setattr(os, "fsync", failing(number))
    with pytest.raises(OutputError, match=words):
        CALIBRATION.save(path, force=True)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_ctrl_c_while_writing_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        CALIBRATION.save(tmp_path / "calibration.json")
    assert list(tmp_path.iterdir()) == []


def test_a_read_only_file_is_kept_even_when_forced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "calibration.json"
    path.write_text("precious")
    monkeypatch.setattr(os, "access", lambda *_: False)  # as root, everything may be written
    with pytest.raises(OutputError, match="no permission"):
        CALIBRATION.save(path, force=True)
    assert path.read_text() == "precious"


def test_a_new_file_has_the_usual_permissions_and_a_replaced_one_keeps_its_own(tmp_path: Path) -> None:
    path, usual = tmp_path / "calibration.json", tmp_path / "usual"
    usual.touch()
    CALIBRATION.save(path)
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)
    path.chmod(0o640)
    CALIBRATION.save(path, force=True)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_symbolic_link_stays_one_and_its_target_is_written(tmp_path: Path) -> None:
    (tmp_path / "shelf").mkdir()
    target, link = tmp_path / "shelf" / "hull7.json", tmp_path / "calibration.json"
    link.symlink_to(target)
    CALIBRATION.save(link)
    CALIBRATION.save(link, force=True)
    assert link.is_symlink()
    assert Calibration.load(target).isclose(CALIBRATION)
    with pytest.raises(OutputExists):
        CALIBRATION.save(link)
