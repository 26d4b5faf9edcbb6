"""Answers of each binding of the judge for the same readings: Python, many fits at once, the page, a board.

``python -m tests.bindings READINGS.npy`` compiles the engine of the package that it finds, without optimisation, and
prints the answers for readings in µT as JSON.
"""

from __future__ import annotations

import base64
import ctypes
import json
import sys
import tempfile
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from benchmarks import firmware
from benchmarks.page_verdict import case_of
from tests.javascript import run

from flinders.apps.live.standalone.engine import data
from flinders.core.samples import Samples
from flinders.core.units import MICROTESLA
from flinders.findings import first_causes
from flinders.findings.catalogue import ENGINE_FINDINGS
from flinders.findings.rules import SEVERITIES
from flinders.native import build
from flinders.native.engine import engine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.native.layouts import Records

EVALUATE: Final = """
const [{ loadEngine }, { fitOf }, { evaluate }] = await Promise.all(["engine.js", "fit.js", "evaluate.js"].map(load));
const bytes = (text) => Uint8Array.from(Buffer.from(text, "base64"));
const floats = (text) => text && new Float64Array(bytes(text).buffer);
const engine = await loadEngine(bytes(given.wasm), given.data.layouts);
const quantities = engine.at.judgement + given.data.layouts.judgement.fields.quantities[0];
return given.asked.map((each) => {
    const readings = { ...each, field: floats(each.field), time: floats(each.time) };
    const { severities } = fitOf(engine, given.data, readings).judgement;
    const checked = severities.map((_, rule) => engine.call.flinders_is_checked(rule, quantities));
    const shown = evaluate(engine, given.data, readings).view.findings;
    return [severities, checked, Object.fromEntries(shown.map(({ code, advice }) => [code, advice]))];
});
"""


class Said(NamedTuple):
    """Answer of a binding about a fit.

    Attributes
    ----------
    findings : dict
        Severity of each finding, by code.
    checked : list of str
        Codes of the findings that the binding looks for.
    advice : dict
        Advice by code, for each finding that follows from no other; empty if the binding has no words.
    """

    findings: dict[str, str]
    checked: list[str]
    advice: dict[str, str]

    @classmethod
    def of(cls, severities: Sequence[int], checked: Sequence[int], advice: dict[str, str] | None = None) -> Said:
        """Answer from numbers for each finding of the catalogue."""
        found: dict[str, str] = {
            code: SEVERITIES[each] or "" for code, each in zip(ENGINE_FINDINGS, severities, strict=True) if each
        }
        looked_for = [code for code, each in zip(ENGINE_FINDINGS, checked, strict=True) if each]
        return cls(found, looked_for, advice or {})

    def among(self, codes: Sequence[str]) -> dict[str, str]:
        """Severities of the findings with these codes."""
        return {code: severity for code, severity in self.findings.items() if code in codes}

    def verdict_among(self, codes: Sequence[str]) -> str:
        """Verdict by the findings with these codes only."""
        found = self.among(codes).values()
        return next((verdict for verdict in ("refuses", "limits") if verdict in found), "good")


def python(samples: Samples) -> Said:
    """Answer of `flinders.fit`."""
    fit = firmware.fit_of(samples)
    assert fit is not None
    advice = {finding.code: finding.advice for finding in first_causes(fit.findings)}
    return Said({finding.code: finding.severity for finding in fit.findings}, list(ENGINE_FINDINGS), advice)


def many(each: Sequence[Samples]) -> list[Said]:
    """Answers of one call of the engine for recordings of one unit."""
    request = engine().request(is_microtesla=each[0].unit.inside == MICROTESLA)
    field = np.concatenate([samples.field for samples in each])
    judgements = engine().judge_many(engine().fit_many(field, np.cumsum([0, *map(len, each)])), request)
    return [Said.of(one["severities"].tolist(), _checked(one)) for one in judgements]


def _checked(judgement: Records) -> list[int]:
    """1 for each finding that was looked for, else 0."""
    library = ctypes.CDLL(str(build.library()))
    quantities = np.ascontiguousarray(judgement["quantities"]).ctypes
    return [library.flinders_is_checked(rule, ctypes.c_void_p(quantities.data)) for rule in range(len(ENGINE_FINDINGS))]


def page(each: Sequence[Samples]) -> list[Said]:
    """Answers of the page without a program."""
    wasm = base64.b64encode(build.library(target=build.WEB_PLATFORM).read_bytes()).decode()
    asked = [case_of(samples).asked for samples in each]
    return list(starmap(Said.of, run(EVALUATE, {"wasm": wasm, "data": data(), "asked": asked})))


def board(each: Sequence[Samples]) -> list[Said]:
    """Answers of a board, compiled for this machine in single precision."""
    with tempfile.TemporaryDirectory() as folder:
        program = firmware.build(firmware.HOST, Path(folder), optimise="-O0")
        answers = [
            firmware.run(firmware.HOST, program, samples.field, unit=samples.unit.inside == MICROTESLA)["answer"]
            for samples in each
        ]
    return [Said.of(answer["findings"].tolist(), answer["is_checked"].tolist()) for answer in answers]


def said(samples: Samples) -> dict[str, Said]:
    """Answer of each binding for a recording."""
    one = [samples]
    return {"python": python(samples), "many": many(one)[0], "page": page(one)[0], "board": board(one)[0]}


def main(readings: str) -> None:
    """Compile the engine, and print the answer of each binding."""
    for target, level in ((build.THIS_PLATFORM, "-O0"), (build.WEB_PLATFORM, "-O1")):  # without it zig links sanitizers
        made = build.library_path(target=target)
        made.parent.mkdir(exist_ok=True)
        build.compile_library(made, compiler=build.compiler(target), options=[level], target=target)
    print(json.dumps(said(Samples(np.load(readings)))))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1])
