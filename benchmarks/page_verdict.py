"""Differences of the page without a server from the program: ``python -m benchmarks.page_verdict``.

Recordings of the shared data, thinned to 5,000 readings, and simulated ones are evaluated by the page's modules under
Node.js, and by `flinders.fit` with the same readings. Compared are the numbers of the engine, in standard deviations or
relative, the verdict and its findings, the claim and the sentences; and the processor time of a fit.
"""

from __future__ import annotations

import base64
import json
import math
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from tests.javascript import node

import flinders
from benchmarks.datasets import SETS, dataset
from benchmarks.fits import WORLDS, recordings
from benchmarks.recordings import FOLDER
from flinders.apps.live.buffer import Timeline
from flinders.apps.live.standalone.engine import data
from flinders.core.calibration_file import VERSION, dumps
from flinders.core.samples import Samples
from flinders.core.units import unit_label
from flinders.errors import FitError
from flinders.fitting.refreshing import refresh
from flinders.fitting.request import judged_dip
from flinders.fitting.result import Refused, document_of
from flinders.native import build
from flinders.native.engine import engine
from flinders.report.view import view

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Goal
    from flinders.likelihood.site_field import Site
    from flinders.native.layouts import Records
    from flinders.report.view import View

PROGRAM: Final = Path(__file__).with_suffix(".mjs")
MAX_READINGS: Final = 5_000
"""Most readings of a recording."""
SIGMA: Final = 0.5
RELATIVE: Final = ("noise", "radius", "level_worst_deg", "level_rms_deg", "correlation_time", "prior_influence")
"""Numbers of a record that are compared by relative difference."""
TURNS: Final = 3


@dataclass(frozen=True, slots=True)
class Case:
    """Readings on a timeline, with settings of their fit.

    The user may be turning the sensor; there may be an earlier calibration, to be renewed or not.
    """

    samples: Samples
    target_deg: float = 1.0
    site: Site | None = None
    goal: Goal = "heading"
    is_followed: bool = False
    previous: Fit | None = None
    is_renewed: bool = False

    @property
    def fit(self) -> Fit | None:
        """Fit by the program, also a refused one; None without a fit."""
        renewed = self.previous if self.is_renewed else None
        fitted = flinders.fit if renewed is None else partial(refresh, previous=renewed)
        try:
            return fitted(self.samples, target_deg=self.target_deg, site=self.site)
        except Refused as refused:
            return refused.fit
        except FitError:
            return None

    @property
    def asked(self) -> dict[str, Any]:
        """Request to the page."""
        dip_deg, is_assumed = judged_dip(self.site)
        return {
            "field": _packed(self.samples.field),
            "time": None if self.samples.time is None else _packed(self.samples.time),
            "acceleration": None if self.samples.acceleration is None else _packed(self.samples.acceleration),
            "unit": unit_label(self.samples.unit.inside),
            "targetDeg": self.target_deg,
            "dipDeg": dip_deg,
            "dipAssumed": is_assumed,
            "goal": self.goal,
            "isFollowed": self.is_followed,
            "site": None if self.site is None else site_of(self.site.evidence),
            "previous": None if self.previous is None else _file_of(self.previous),
            "isRenewed": self.is_renewed,
        }


@dataclass(frozen=True, slots=True)
class Compared:
    """Results of page and program for the same readings.

    Attributes
    ----------
    name : str
    rows : int
    method : str
        Method of the program; empty without a fit.
    verdicts : tuple of str
        Of the program and of the page; empty without a fit.
    findings : tuple of list of (code, severity)
        Of both, most severe first.
    sentences : tuple of list of str
        The sentence of the verdict and the advice of each finding, of both.
    reasons : list of str
        Codes of the page's reasons against the calibration.
    claim : float
        Heading error of the page over that of the program; NaN without both.
    engine_off : float
        Largest difference of a number of the engine, in standard deviations, or relative.
    fit_ms, evaluate_ms : float
        Processor time of the page: for the engine's fit alone, and for the whole evaluation. 0 if not measured.
    """

    name: str
    rows: int
    method: str
    verdicts: tuple[str, str]
    findings: tuple[list[tuple[str, str]], list[tuple[str, str]]]
    sentences: tuple[list[str], list[str]]
    reasons: list[str]
    claim: float
    engine_off: float
    fit_ms: float
    evaluate_ms: float


def thinned(samples: Samples, most: int = MAX_READINGS) -> Samples:
    """Field and time of every second, third … reading."""
    stride = max(1, -(-len(samples) // most))
    time = None if samples.time is None else samples.time[::stride]
    return Samples(samples.field[::stride], unit=samples.unit, axes=samples.axes, time=time, source=samples.source)


def case_of(samples: Samples, target_deg: float = 1.0, goal: Goal = "heading", *, is_followed: bool = False) -> Case:
    """Case of readings as in a session, with ascending times."""
    times = np.arange(float(len(samples))) if samples.time is None else samples.time
    unit = flinders.Unit.of(samples.unit.inside)
    there = Samples(samples.field, unit=unit, axes=samples.axes, time=Timeline()(times)[0], source=samples.source)
    return Case(there, target_deg, None, goal, is_followed)


def site_of(known: Site | None) -> dict[str, float | None] | None:
    """Site for the page's engine."""
    if known is None:
        return None
    names = ("strength", "gain_sigma", "inclination_deg", "inclination_sigma_deg")
    return {name: value if math.isfinite(value := getattr(known, name) or math.nan) else None for name in names}


def _file_of(fit: Fit) -> dict[str, str]:
    """Name and text of a calibration file."""
    return {"name": fit.provenance.name, "text": dumps(document_of(fit))}


def _packed(numbers: Floats) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers, "<f8").tobytes()).decode()


def page_answers(cases: Sequence[Case], turns: int = 0) -> dict[str, Any]:
    """Answers of the page's modules under Node.js for each case, and the names of values in their sentences."""
    given = {
        "modules": str(files("flinders.apps.live").joinpath("static", "standalone")),
        "wasm": str(build.library(target=build.WEB_PLATFORM)),
        "data": data(),
        "schema": VERSION,
        "recordings": [case.asked for case in cases],
        "turns": turns,
    }
    done = subprocess.run(
        [node(), str(PROGRAM)],
        input=json.dumps(given), capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stderr)
    answers: dict[str, Any] = json.loads(done.stdout)
    return answers


def compared(names: Sequence[str], cases: Sequence[Case], turns: int = 0) -> list[Compared]:
    """Evaluate cases by page and program, and compare the results."""
    answers = page_answers(cases, turns)["answers"]
    return [_compared(*each) for each in zip(names, cases, answers, strict=True)]


def _compared(name: str, case: Case, page: dict[str, Any]) -> Compared:
    fit, samples = case.fit, case.samples
    program = None if fit is None else view(fit, samples, goal=case.goal)
    record = engine().fit(samples.field, time=samples.time, dip_deg=case.asked["dipDeg"])
    return Compared(
        name=name,
        rows=len(samples),
        method="" if program is None else program.method,
        verdicts=("" if program is None else program.verdict, (page["view"] or {}).get("verdict", "")),
        findings=(_findings(program), [(each["code"], each["severity"]) for each in _of(page)]),
        sentences=(_sentences(program), [_sentence(page), *(each["advice"] for each in _of(page))]),
        reasons=[reason["code"] for reason in page["reasons"]],
        claim=_claim(program, page),
        engine_off=engine_off(record, page["engine"]),
        fit_ms=page["fit_ms"],
        evaluate_ms=page["evaluate_ms"],
    )


def _of(page: dict[str, Any]) -> list[dict[str, Any]]:
    """Findings of the page's view."""
    findings: list[dict[str, Any]] = (page["view"] or {}).get("findings", [])
    return findings


def _sentence(page: dict[str, Any]) -> str:
    return str((page["view"] or {}).get("sentence", ""))


def _findings(program: View | None) -> list[tuple[str, str]]:
    return [] if program is None else [(finding.code, finding.severity) for finding in program.findings]


def _sentences(program: View | None) -> list[str]:
    return [""] if program is None else [program.sentence, *(finding.advice for finding in program.findings)]


def _claim(program: View | None, page: dict[str, Any]) -> float:
    """Heading error of the page over that of the program."""
    own, other = program and program.heading_error_deg, page["view"] and page["view"]["heading_error_deg"]
    return other["worst"] / own.worst if own and other else math.nan


def engine_off(record: Records, page: dict[str, Any]) -> float:
    """Largest difference of the page's record from the program's; infinite if only one has a fit."""
    if record["status"] or page["status"]:
        return 0.0 if record["status"] == page["status"] else math.inf
    sigma = np.sqrt(np.abs(record["covariance"].reshape(9, 9).diagonal()))
    parameters = np.concatenate([record["centre"], record["shape"]])
    covariance = (np.array(page["covariance"]) - record["covariance"]) / np.outer(sigma, sigma).ravel()
    moved = (np.array([*page["centre"], *page["shape"]]) - parameters) / sigma
    own = np.array([float(record[name]) for name in RELATIVE])
    other = np.array([math.nan if page[name] is None else page[name] for name in RELATIVE])
    relative = (other - own) / np.maximum(np.abs(own), np.finfo(float).tiny)
    return float(np.nanmax(np.abs(np.concatenate([moved, covariance, relative]))))


def simulated() -> Iterator[tuple[str, Samples]]:
    """Yield simulated recordings by name."""
    yield from ((f"{name} {seed}", world(seed).samples) for name, world in WORLDS.items() for seed in (0, 1))
    yield from ((name, dataset(name, trial=0, sigma=SIGMA).samples) for name in SETS)


def real() -> Iterator[tuple[str, Samples]]:
    """Yield recordings of the shared data by name."""
    yield from ((name, flinders.read(FOLDER / name)) for name in recordings())


def report(title: str, rows: Sequence[Compared]) -> None:
    """Print the number of agreements, and each disagreement."""
    full = [row for row in rows if row.verdicts[0]]
    judged = [row for row in full if row.verdicts[0] != "refused"]
    alike = [row for row in full if row.verdicts[0] == row.verdicts[1]]
    same = [row for row in full if row.findings[0] == row.findings[1]]
    words = [row for row in full if row.sentences[0] == row.sentences[1]]
    claims = [abs(row.claim - 1.0) for row in full]
    print(f"\n{title}: {len(rows)} recordings, of them {sum(row.method == 'level' for row in rows)} level turns")
    print(f"  same verdict            {len(alike)} of {len(full)}")
    print(f"  same findings           {len(same)} of {len(full)}")
    print(f"  same sentences          {len(words)} of {len(full)}")
    print(f"  claim within            {max(claims, default=0.0):.1e} of the program's")
    print(f"  engine, of {len(judged)} not refused  within {max((row.engine_off for row in judged), default=0.0):.1e}")
    print(f"  engine, of all          within {max((row.engine_off for row in full), default=0.0):.1e}")
    print(f"  fit                     {median(row.fit_ms for row in rows):.1f} ms (median)")
    print(f"  all that is shown       {median(row.evaluate_ms for row in rows):.1f} ms (median)")
    for row in rows:
        if row.verdicts[0] != row.verdicts[1] or row.findings[0] != row.findings[1]:
            print(f"  {row.name}: {row.method or 'no fit'}, {row.verdicts[0]} / {row.verdicts[1]}")


def main() -> int:
    """Compare, and print the report."""
    try:
        build.library(target=build.WEB_PLATFORM)
    except build.NoCompiler as error:
        print(error, file=sys.stderr)
        return 1
    for title, cases in (("shared recordings", real()), ("simulated", simulated())):
        named = [(name, case_of(thinned(samples))) for name, samples in cases]
        report(title, compared([name for name, _ in named], [case for _, case in named], TURNS))
    tumble = case_of(flinders.simulate.tumble(seed=1, n=3000).samples)
    (row,) = compared(["tumble"], [tumble], 60)
    print(f"\n3,000 readings: a fit takes {row.fit_ms:.1f} ms, all that is shown {row.evaluate_ms:.1f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
