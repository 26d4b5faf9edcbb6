"""The commands and queries of docs/fleet/growing.md are run, as cron, Airflow and DuckDB run them."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
from click.testing import CliRunner
from tests.golden.sessions import ROOT

from flinders.apps.fleet.simulate import line_of
from flinders.cli import main
from flinders.simulate import write_csv

pytest.importorskip("pyarrow")

PAGE: Final = (ROOT / "docs" / "fleet" / "growing.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Blocks of code of the page."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line of a dozen units, of which some are not good, and their properties."""
    monkeypatch.chdir(tmp_path)
    for truth, samples in line_of(12, seed=2, bad=0.3, recordings=1, readings=200):
        Path("logs", truth.unit).mkdir(parents=True)
        write_csv(samples, Path("logs", truth.unit, truth.recording))
    Path("units.csv").write_text("".join(["unit,firmware\n", *(f"U{unit:04d},1.{unit % 2}\n" for unit in range(12))]))


def run(line: str) -> int:
    """Exit code of a command line."""
    words = [*shlex.split(line)[1:], "--workers", "0"]
    return CliRunner().invoke(main, words, prog_name="flinders").exit_code


def test_what_cron_runs_makes_the_table_and_extends_it() -> None:
    (crontab,) = [block for block in blocks("text") if "dom mon dow" in block]
    (command,) = re.findall(r"&& (flinders .*?) \|\|", crontab)
    assert run(command) in {0, 3}
    assert run(command) == 0, "nothing is new"
    assert Path("alerts.csv").read_text(encoding="utf-8").startswith("unit,recording,alert,")


class StubOperator:
    """Stub of Airflow's operator, which notes what it was made with; Airflow itself is not installed."""

    made: Final[list[dict[str, Any]]] = []

    def __init__(self, **given: Any) -> None:
        self.made.append(given)


class StubDag:
    """Stub of Airflow's graph of tasks."""

    def __init__(self, name: str, **given: Any) -> None:
        self.name, self.given = name, given

    def __enter__(self) -> StubDag:
        return self

    def __exit__(self, *_: object) -> None:
        pass


@pytest.fixture
def stub_airflow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stubs of the modules that the file imports."""
    names = ("airflow", "airflow.providers.standard.operators.bash", "pendulum")
    modules = {name: ModuleType(name) for name in names}
    vars(modules["airflow"])["DAG"] = StubDag
    vars(modules[names[1]])["BashOperator"] = StubOperator
    vars(modules["pendulum"])["datetime"] = lambda *date: date
    for parent in ("airflow.providers", "airflow.providers.standard", "airflow.providers.standard.operators"):
        modules[parent] = ModuleType(parent)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    StubOperator.made.clear()


@pytest.mark.usefixtures("stub_airflow")
def test_the_file_for_airflow_has_a_task_whose_command_runs() -> None:
    (source,) = blocks("python")
    exec(compile(source, "dag.py", "exec"), {})
    (task,) = StubOperator.made
    assert run(task["bash_command"]) in {0, 3}
    assert run(task["bash_command"]) == 0
    assert task["skip_on_exit_code"] == 3


def test_the_queries_for_duckdb_give_rows() -> None:
    duckdb = pytest.importorskip("duckdb", reason="DuckDB is not installed: uv pip install duckdb")
    run("flinders fleet logs -o calibrations.parquet --properties units.csv")
    shares, bad = (duckdb.sql(query).fetchall() for query in blocks("sql"))
    assert [row[0] for row in shares] == ["1.0", "1.1"] or [row[0] for row in shares] == ["1.1", "1.0"]
    assert sum(row[1] for row in shares) == 12
    assert all(row[2] for row in bad)
