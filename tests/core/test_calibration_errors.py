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
from tests.sentences import assert_raises

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

MALFORMED: dict[str, bytes] = {
    "empty": b"",
    "spaces": b" \n\n",
    "cut short": WHOLE[:90],
    "two files in one": WHOLE + WHOLE,
    "text": b"x,y,z\n1,2,3\n",
    "binary": bytes(range(256)),
    "zeros": bytes(1000),
    "UTF-16": WHOLE.decode().encode("utf-16"),
    "bad UTF-8": WHOLE.replace(b'"sensor"', b'"\xff\xff"'),
    "gzip": gzip.compress(WHOLE),
    "too deep": b"[" * 100_000,
    "too large": b" " * (calibration_file.MAX_BYTES + 1),
    "a number": b"42",
    "a list": b"[1, 2, 3]",
    "another program's": b'{"magnetometer": {"bias": [1, 2, 3]}}',
    "another file of ours": b'{"flinders": "summary", "schema": 1}',
    "no schema": without("schema"),
    "schema as text": changed("schema", "1"),
    "schema true": changed("schema", True),
    "schema zero": changed("schema", 0),
    "newer schema": changed("schema", 7),
    "NaN": WHOLE.replace(b"49.8", b"NaN"),
    "infinity": WHOLE.replace(b"49.8", b"Infinity"),
    "too large a number": WHOLE.replace(b"49.8", b"1e999"),
    "too long a number": WHOLE.replace(b"49.8", b"9" * 400),
    "no calibration": without("calibration"),
    "no raw": without("raw"),
    "no matrix": without("calibration.matrix"),
    "an unknown key": changed("calibration.comment", "mine"),
    "a short offset": changed("calibration.offset", [1, 2]),
    "text in offset": changed("calibration.offset", [1, 2, "3"]),
    "null in offset": changed("calibration.offset", [1, 2, None]),
    "a 2 × 3 matrix": changed("calibration.matrix", [[1, 0, 0]] * 2),
    "a ragged matrix": changed("calibration.matrix", [[1], [0, 1, 0], [0, 0, 1]]),
    "a singular matrix": changed("calibration.matrix", [[1, 1, 1]] * 3),
    "a zero matrix": changed("calibration.matrix", [[0, 0, 0]] * 3),
    "a matrix that is not symmetric": changed("calibration.matrix", [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
    "negative strength": changed("calibration.field_strength", -49.8),
    "zero strength": changed("calibration.field_strength", 0),
    "unknown unit": changed("calibration.unit", "mT"),
    "unknown rotation": changed("calibration.rotation", "free"),
    "contradicting scale": changed("raw.scale", 0.5),
    "contradicting unit": changed("calibration.unit", "counts"),
    "zero scale": changed("raw.scale", 0),
    "axes twice": changed("raw.axes", "x,x,z"),
    "axes of words": changed("raw.axes", "forward"),
    "a covariance of the wrong size": changed("fit", {**FIT, "covariance": [[1]]}),
    "a negative variance": changed("fit", {**FIT, "covariance_of": ["offset_x"], "covariance": [[-1]]}),
    "a negative count": changed("fit", {**FIT, "samples": -5}),
    "an unknown verdict": changed("fit", {**FIT, "verdict": "fine"}),
    "a date without zone": changed("provenance", {"flinders": "0.1.0", "date": "2026-11-21T10:00:00"}),
}


@pytest.mark.parametrize("content", MALFORMED.values(), ids=MALFORMED)
def test_a_malformed_file_is_refused_in_one_line_that_names_file_and_fault(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    with assert_raises(DocumentError) as caught:
        Calibration.load(path)
    assert str(caught.value).startswith(f"{path}")
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
    with assert_raises(DocumentError):
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
BAD_ARGUMENTS: dict[str, tuple[Callable[[], object], type[FlindersError]]] = {
    "2 × 2 matrix": (lambda: Calibration(np.eye(2), np.zeros(3), 1.0), ArrayError),
    "NaN in matrix": (lambda: Calibration(EYE * np.nan, np.zeros(3), 1.0), ArrayError),
    "complex matrix": (lambda: Calibration(COMPLEX, np.zeros(3), 1.0), ArrayError),
    "singular matrix": (lambda: Calibration(np.ones((3, 3)), np.zeros(3), 1.0), ArrayError),
    "asymmetric": (lambda: Calibration(np.triu(np.ones((3, 3))), np.zeros(3), 1.0), ArrayError),
    "short offset": (lambda: Calibration(EYE, np.zeros(2), 1.0), ArrayError),
    "offset table": (lambda: Calibration(EYE, np.zeros((1, 3)), 1.0), ArrayError),
    "infinite offset": (lambda: Calibration(EYE, np.full(3, np.inf), 1.0), ArrayError),
    "no strength": (lambda: Calibration(EYE, np.zeros(3), 0.0), UsageError),
    "negative strength": (lambda: Calibration(EYE, np.zeros(3), -50), UsageError),
    "NaN strength": (lambda: Calibration(EYE, np.zeros(3), np.nan), UsageError),
    "text strength": (lambda: Calibration(EYE, np.zeros(3), "50"), ArrayError),  # type: ignore[arg-type]
    "unknown rotation": (lambda: Calibration(EYE, np.zeros(3), 1.0, rotation="free"), UsageError),  # type: ignore[arg-type]
    "flat ellipsoid": (lambda: Calibration.from_ellipsoid(np.zeros(3), np.diag([1.0, 1.0, 0.0])), ArrayError),
    "hyperboloid": (lambda: Calibration.from_ellipsoid(np.zeros(3), np.diag([1.0, 1.0, -1.0])), ArrayError),
    "turned ellipsoid": (lambda: Calibration.from_ellipsoid(np.zeros(3), EYE + np.triu(EYE[::-1])), ArrayError),
    "negative known strength": (lambda: Calibration.from_ellipsoid(np.zeros(3), EYE, field_strength=-1), UsageError),
    "pairs of readings": (lambda: Calibration.identity().apply([[1, 2]]), ArrayError),
    "words as readings": (lambda: Calibration.identity().apply(["a", "b", "c"]), ArrayError),
    "a lone number": (lambda: Calibration.identity().unapply(3.0), ArrayError),
}


@pytest.mark.parametrize(("make", "kind"), BAD_ARGUMENTS.values(), ids=BAD_ARGUMENTS)
def test_a_bad_argument_is_refused_by_name(make: Callable[[], object], kind: type[FlindersError]) -> None:
    with assert_raises(kind):
        make()


def test_a_mirror_is_a_calibration_as_two_of_them_may_compose_to_one() -> None:
    assert Calibration(np.diag([1.0, 1.0, -1.0]), np.zeros(3), 50.0).apply([1, 2, 3]).tolist() == [1, 2, -3]


def correction(**changes: Any) -> Correction:
    return Correction(**{**SOUND["calibration"], **changes})


@pytest.mark.parametrize(
    "content",
    [
        correction(offset=(1.0, float("nan"), 3.0)),
        correction(field_strength=float("inf")),
        correction(field_strength=-1.0),
        correction(offset=(1.0, 2.0)),
        correction(unit="mG"),
        correction(offset=(1j, 2, 3)),
    ],
)
def test_a_document_that_could_not_be_read_again_is_not_written(content: Correction, tmp_path: Path) -> None:
    with assert_raises(DocumentError):
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
    with assert_raises(OutputExists):
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
    "name",
    [
        "missing/out.json",
        ".",
        "",
        "file/out.json",
        "n" * 300,
        "a\0b",
        "loop",
        "pipe",
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_a_place_that_cannot_be_written_to_says_what_to_do(name: str, force: bool, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.iterdir())
    with assert_raises(OutputError) as caught:
        CALIBRATION.save(os.fspath(tmp_path) + "/" + name, force=force)
    assert caught.value.exit_code == 6
    assert sorted(tmp_path.iterdir()) == before


def failing(number: int) -> Callable[..., None]:
    """A function of `os` that fails as the operating system does."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.mark.parametrize(
    "number",
    [
        errno.ENOSPC,
        errno.EACCES,
        errno.EROFS,
        errno.EIO,
    ],
)
def test_a_failing_disk_leaves_the_old_file_and_nothing_else(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "calibration.json"
    path.write_text("precious")
    monkeypatch.setattr(os, "fsync", failing(number))
    with assert_raises(OutputError):
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
    with assert_raises(OutputError):
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
