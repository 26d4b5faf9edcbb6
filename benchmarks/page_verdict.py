"""How far the page that needs no program is off the program: ``python -m benchmarks.page_verdict``.

Recordings of the shared data, thinned to 5,000 readings, and simulated ones are evaluated by the page's modules under
Node.js, and by `flinders.live.evaluation` with the same readings. Compared are the numbers of the engine, in standard
deviations or relative, the verdict and its findings, the claim and the sentences; and the processor time of a fit.

The page has no method for a level turn, which the program calibrates: those are counted by themselves.
"""

from __future__ import annotations

import base64
import json
import math
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from flinders.live.evaluation import evaluate
from flinders.live.session import Arrived, LiveSession, step, used_readings
from tests.javascript import node

import flinders
from benchmarks.datasets import SETS, dataset
from benchmarks.fits import WORLDS, recordings
from benchmarks.recordings import FOLDER
from flinders.core.calibration_file import VERSION, dumps
from flinders.core.samples import Samples
from flinders.core.units import label
from flinders.fitting.calibrate import judged_dip
from flinders.likelihood.site_field import Site
from flinders.live.buffer import rows_of
from flinders.live.messages import SourceState
from flinders.native import build
from flinders.native.engine import engine
from flinders.standalone.engine import data

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.live.session import Evaluated

    from flinders.arrays import Floats
    from flinders.native.engine import Records

PROGRAM: Final = Path(__file__).with_suffix(".mjs")
MOST: Final = 5_000
"""Readings of a recording."""
SIGMA: Final = 0.5
RELATIVE: Final = ("noise", "radius", "level_worst_deg", "level_rms_deg", "correlation_time", "prior_influence")
"""Numbers of a record that are compared by their size."""
TURNS: Final = 3


@dataclass(frozen=True, slots=True)
class Compared:
    """What page and program make of the same readings.

    Attributes
    ----------
    name : str
    rows : int
    method : str
        Of the program; empty where it refuses to fit.
    verdicts : tuple of str
        Of the program and of the page; empty where there is no fit.
    findings : tuple of list of (code, severity)
        Of both, most severe first.
    sentences : tuple of list of str
        The sentence of the verdict and the advice of each finding, of both.
    reasons : tuple of list of str
        Codes of what speaks against the calibration, of both.
    claim : float
        Heading error of the page over that of the program; NaN where there is none.
    engine_off : float
        Largest difference of a number of the engine, in standard deviations, or relative.
    fit_ms, evaluate_ms : float
        Processor time that the page takes: for the engine's fit alone, and for all that it shows. 0 where it is not
        measured.
    """

    name: str
    rows: int
    method: str
    verdicts: tuple[str, str]
    findings: tuple[list[tuple[str, str]], list[tuple[str, str]]]
    sentences: tuple[list[str], list[str]]
    reasons: tuple[list[str], list[str]]
    claim: float
    engine_off: float
    fit_ms: float
    evaluate_ms: float

    @property
    def is_level(self) -> bool:
        """The program takes it for a level turn."""
        return self.method == "level"


def thinned(samples: Samples, most: int = MOST) -> Samples:
    """Field and time of every second, third … reading."""
    stride = max(1, -(-len(samples) // most))
    time = None if samples.time is None else samples.time[::stride]
    return Samples(samples.field[::stride], unit=samples.unit, axes=samples.axes, time=time, source=samples.source)


def session_of(samples: Samples, target_deg: float = 1.0) -> LiveSession:
    """A session of readings that have ended."""
    unit = flinders.Unit.of(samples.unit.inside)
    session, _ = step(LiveSession(target_deg=target_deg), Arrived(at=1e9, rows=rows_of(samples), unit=unit))
    return replace(session, source=SourceState(samples.source, "file", "ended", ""))


def asked(session: LiveSession) -> dict[str, Any]:
    """What the page is asked for a session."""
    samples, _ = used_readings(session)
    site = Site.stated(session.shown.known_site, inclination_deg=session.dip_deg)
    dip_deg, is_assumed = judged_dip(site)
    return {
        "field": _packed(samples.field),
        "time": None if samples.time is None else _packed(samples.time),
        "unit": label(session.shown.unit.inside),
        "targetDeg": session.target_deg,
        "dipDeg": dip_deg,
        "dipAssumed": is_assumed,
        "goal": session.goal,
        "isFollowed": session.is_followed,
        "site": None if site is None else site_of(site.evidence),
        "previous": None if session.previous is None else _file_of(session.previous),
        "isRenewed": session.renewed is not None,
    }


def site_of(known: Site | None) -> dict[str, float | None] | None:
    """What counts of a site, as the page asks its engine."""
    if known is None:
        return None
    names = ("strength", "gain_sigma", "inclination_deg", "inclination_sigma_deg")
    return {name: value if math.isfinite(value := getattr(known, name) or math.nan) else None for name in names}


def _file_of(fit: Fit) -> dict[str, str]:
    """Name and text of a calibration file."""
    return {"name": fit.name, "text": dumps(fit.to_document())}


def _packed(numbers: Floats) -> str:
    return base64.b64encode(np.ascontiguousarray(numbers, "<f8").tobytes()).decode()


def page_answers(sessions: Sequence[LiveSession], turns: int = 0) -> dict[str, Any]:
    """What the page's modules answer for each session, under Node.js; and the names that their sentences know."""
    given = {
        "modules": str(files("flinders").joinpath("static", "standalone")),
        "wasm": str(build.library(target=build.WEB)),
        "data": data(),
        "schema": VERSION,
        "recordings": [asked(session) for session in sessions],
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


def compared(names: Sequence[str], sessions: Sequence[LiveSession], turns: int = 0) -> list[Compared]:
    """Evaluate sessions by both, and put them side by side."""
    answers = page_answers(sessions, turns)["answers"]
    return [_compared(*each) for each in zip(names, sessions, answers, strict=True)]


def _compared(name: str, session: LiveSession, page: dict[str, Any]) -> Compared:
    program = evaluate(session)
    samples, _ = used_readings(session)
    record = engine().fit(samples.field, time=samples.time, dip_deg=asked(session)["dipDeg"])
    return Compared(
        name=name,
        rows=len(samples),
        method="" if program.view is None else program.view.method,
        verdicts=("" if program.view is None else program.view.verdict, (page["view"] or {}).get("verdict", "")),
        findings=(_findings(program), [(each["code"], each["severity"]) for each in _of(page)]),
        sentences=(_sentences(program), [_sentence(page), *(each["advice"] for each in _of(page))]),
        reasons=([reason.code for reason in program.reasons], [reason["code"] for reason in page["reasons"]]),
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


def _findings(program: Evaluated) -> list[tuple[str, str]]:
    view = program.view
    return [] if view is None else [(finding.code, finding.severity) for finding in view.findings]


def _sentences(program: Evaluated) -> list[str]:
    view = program.view
    return [""] if view is None else [view.sentence, *(finding.advice for finding in view.findings)]


def _claim(program: Evaluated, page: dict[str, Any]) -> float:
    """Heading error of the page over that of the program."""
    own, other = program.view and program.view.heading_error_deg, page["view"] and page["view"]["heading_error_deg"]
    return other["worst"] / own.worst if own and other else math.nan


def engine_off(record: Records, page: dict[str, Any]) -> float:
    """Largest difference of a record of the page from that of the program; infinite where only one has a fit."""
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
    """Simulated recordings by their names."""
    yield from ((f"{name} {seed}", world(seed).samples) for name, world in WORLDS.items() for seed in (0, 1))
    yield from ((name, dataset(name, trial=0, sigma=SIGMA).samples) for name in SETS)


def real() -> Iterator[tuple[str, Samples]]:
    """Recordings of the shared data by their names."""
    yield from ((name, flinders.read(FOLDER / name)) for name in recordings())


def report(title: str, rows: Sequence[Compared]) -> None:
    """Print how many agree in what, and what each of the others is."""
    full = [row for row in rows if not row.is_level and row.verdicts[0]]
    judged = [row for row in full if row.verdicts[0] != "refused"]
    alike = [row for row in full if row.verdicts[0] == row.verdicts[1]]
    same = [row for row in full if row.findings[0] == row.findings[1]]
    words = [row for row in full if row.sentences[0] == row.sentences[1]]
    claims = [abs(row.claim - 1.0) for row in full]
    print(f"\n{title}: {len(rows)} recordings, of them {sum(row.is_level for row in rows)} level turns for the program")
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
    """Compare, and print."""
    try:
        build.library(target=build.WEB)
    except build.NoCompiler as error:
        print(error, file=sys.stderr)
        return 1
    for title, cases in (("shared recordings", real()), ("simulated", simulated())):
        named = [(name, session_of(thinned(samples))) for name, samples in cases]
        report(title, compared([name for name, _ in named], [session for _, session in named], TURNS))
    tumble = session_of(flinders.simulate.tumble(seed=1, n=3000).samples)
    (row,) = compared(["tumble"], [tumble], 60)
    print(f"\n3,000 readings: a fit takes {row.fit_ms:.1f} ms, all that is shown {row.evaluate_ms:.1f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
