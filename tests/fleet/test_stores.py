"""A fleet in an object store: read, and its table written, by what S3 and Google's store understand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from benchmarks.bucket import Bucket
from click.testing import CliRunner
from tests.sentences import assert_raises

from flinders import simulate
from flinders.apps.fleet import UnitResults
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import MAX_OPEN_FILES, plan_of
from flinders.cli import main
from flinders.errors import OutputError, OutputExists, UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flinders.apps.fleet.storage import StoredFile

pyarrow = pytest.importorskip("pyarrow")
pytest.importorskip("obstore")
from pyarrow import feather, parquet  # noqa: E402 - after it is known to be there

FIELDS = [simulate.tumble(seed=seed, n=120, motion="uniform").samples.field for seed in range(3)]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """A log of one unit, a Parquet table of each of two, and the readings of the second again in an Arrow file."""
    folder = tmp_path / "2026"
    (folder / "U0").mkdir(parents=True)
    text = "\n".join(",".join(f"{value:.3f}" for value in row) for row in FIELDS[0])
    (folder / "U0" / "run #1 50%.csv").write_text(f"mag_x_uT,mag_y_uT,mag_z_uT\n{text}\n")
    for place, field in enumerate(FIELDS[1:], 1):
        axes = {f"mag_{axis}_uT": field[:, column] for column, axis in enumerate("xyz")}
        table = pyarrow.table({"unit": [f"U{place}"] * len(field), **axes})
        parquet.write_table(table, folder / f"{place}.parquet")
    feather.write_feather(table, folder / "3.arrow", chunksize=50)
    return folder


@pytest.fixture
def bucket(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """The same in a bucket beside other things, to which ``s3://`` and ``gs://`` lead."""
    paths = [path for path in fleet.rglob("*") if path.is_file()]
    inside = {f"2026/{path.relative_to(fleet).as_posix()}": path.read_bytes() for path in paths}
    with Bucket({**inside, "2026b/other.parquet": b"", "notes.md": b""}) as bucket:
        for name, value in bucket.environment.items():
            monkeypatch.setenv(name, value)
        yield bucket


@pytest.mark.parametrize("scheme", ["s3", "gs"])
def test_a_bucket_gives_what_the_folder_gives(scheme: str, fleet: Path, bucket: Bucket, tmp_path: Path) -> None:
    run(str(fleet), tmp_path / "here.parquet", Options(), workers=0)
    for where, units in ((f"{scheme}://fleet/2026/", 3), (f"{scheme}://fleet/2026", 3)):
        told = run(where, tmp_path / "there.parquet", Options(), workers=0, force=True)
        assert (told.units, told.verdicts) == (units, {"good": 3})
        assert parquet.read_table(tmp_path / "here.parquet").equals(parquet.read_table(tmp_path / "there.parquet"))
    assert [file.name for file in plan_files(f"{scheme}://fleet/2026/*.parquet")] == ["1.parquet", "2.parquet"]


def plan_files(where: str) -> list[StoredFile]:
    return [part.file for each in plan_of(where, Options()).partitions for part in each.slices]


def test_looking_at_files_takes_a_request_each_and_many_at_a_time(
    bucket: Bucket, fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bucket.latency_s = 0.02
    monkeypatch.setattr("benchmarks.bucket.PAGE", 100)
    bucket.objects = {f"many/{place:04}.parquet": (fleet / "1.parquet").read_bytes() for place in range(110)}
    plan = plan_of("s3://fleet/many/", Options())
    assert plan.files == 110
    assert bucket.asked == 2 + 110, "two pages of the list, and footers"
    assert 8 < bucket.most <= MAX_OPEN_FILES


@pytest.mark.parametrize("scheme", ["s3", "gs"])
def test_the_table_goes_to_a_bucket_when_it_is_complete(
    scheme: str, fleet: Path, bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run(str(fleet), "here.parquet", Options(), workers=0)
    out = f"{scheme}://fleet/out/there.parquet"
    words = ["fleet", str(fleet), "--output", out, "--workers", "0", "--report", "report.html"]
    ended = CliRunner().invoke(main, words, prog_name="flinders")
    assert (ended.exit_code, (tmp_path / "there.parquet.parts").exists()) == (0, False), ended.output
    assert f"written to {out}" in ended.output
    assert bucket.objects["out/there.parquet"] == (tmp_path / "here.parquet").read_bytes()
    assert (tmp_path / "report.html").stat().st_size > 1000
    with assert_raises(OutputExists):
        run(str(fleet), out, Options(), workers=0)


def test_a_bucket_that_does_not_take_the_table_costs_nothing(
    fleet: Path, bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bucket.refuses = 403
    with pytest.raises(OutputError, match="5 of 5 partitions") as caught:
        run(str(fleet), "gs://fleet/there.parquet", Options(), workers=0)
    assert caught.value.hint == {"append": True}
    bucket.refuses = 0
    told = run(str(fleet), "gs://fleet/there.parquet", Options(), workers=0, append=True)
    assert (told.resumed, told.verdicts) == (told.partitions, {"good": 3})
    (tmp_path / "read.parquet").write_bytes(bucket.objects["there.parquet"])
    assert np.isfinite(UnitResults.read(tmp_path / "read.parquet").offset).all()


def test_what_is_no_object_is_said(fleet: Path, bucket: Bucket, tmp_path: Path) -> None:
    with assert_raises(OutputError):
        run(str(fleet), "s3://fleet/out/", Options(), workers=0)
    with assert_raises(UnreadableInput):
        run("gs://fleet/2027/", tmp_path / "out.parquet", Options(), workers=0)
