"""Every language has the phrases of the English one, and everyday pages show no English but what `LEFT_OUT` names."""

from __future__ import annotations

import io
import json
import re
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np
import pytest
from rich.console import Console
from tests.golden.sessions import session
from tests.golden.test_cli import record
from tests.javascript import run
from tests.phrases import ENGLISH, english, fields, text_of
from tests.worlds import write_field

from flinders import simulate
from flinders.apps.live.planned import planned_table
from flinders.apps.live.simulated import COMMENTS
from flinders.apps.live.standalone.engine import data
from flinders.core.language import LANGUAGES, TERMINAL_LANGUAGE, language_of
from flinders.findings import CATALOGUE, first_causes, translation
from flinders.findings.translation import POSES
from flinders.fitting.calibrate import fit
from flinders.fitting.verdict import headline_of
from flinders.report.fit_pages import page_of_fit
from flinders.report.plan_pages import of_plan
from flinders.report.view import view
from flinders.simulate.bodies import BODIES
from flinders.workflows.onboard import judge_onboard
from flinders.workflows.planning import plan

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.console import RenderableType
    from tests.golden.sessions import Golden

    from flinders.native.faults import Answer
    from flinders.workflows.planning import Plan

OTHERS: Final = tuple(code for code in LANGUAGES if code != "en")
PHRASES: Final = english()


@pytest.fixture(params=OTHERS)
def words(request: pytest.FixtureRequest) -> dict[str, str]:
    """The phrases of a language."""
    return dict(language_of(request.param).words)


def test_the_list_of_english_phrases_is_that_of_the_sources(request: pytest.FixtureRequest) -> None:
    if request.config.getoption("--regenerate", default=False):
        ENGLISH.write_text(text_of(PHRASES), encoding="utf-8")
    assert json.loads(ENGLISH.read_text(encoding="utf-8")) == PHRASES, (
        "run `uv run pytest --regenerate tests/test_languages.py`"
    )


def test_a_language_has_no_key_that_english_lacks(words: dict[str, str]) -> None:
    assert words.keys() <= PHRASES.keys()


def test_a_translation_has_the_placeholders_of_the_english_phrase(words: dict[str, str]) -> None:
    wrong = {key: said for key, said in words.items() if fields(said) != fields(PHRASES[key])}
    assert wrong == {}


def test_a_language_has_all_phrases_but_those_of_findings(words: dict[str, str]) -> None:
    needed = {key for key in PHRASES if not key.startswith("findings.")}
    assert needed - words.keys() == set()


def test_german_has_every_finding_that_limits_or_refuses() -> None:
    graver = [
        row for row in CATALOGUE.values() if {grade.severity for grade in row.rule.grades} & {"limits", "refuses"}
    ]
    needed = {f"findings.{row.code}.plain" for row in graver}
    needed |= {f"findings.{row.code}.remedy" for row in graver if row.remedy}
    assert needed - language_of("de").words.keys() == set()


def test_a_translated_finding_has_its_remedy_too(words: dict[str, str]) -> None:
    plain = {code for code in CATALOGUE if f"findings.{code}.plain" in words}
    assert {code for code in plain if CATALOGUE[code].remedy and f"findings.{code}.remedy" not in words} == set()


def test_coverage_of_each_language(golden: Golden) -> None:
    lines = []
    for code in OTHERS:
        known = language_of(code).words
        lacking = [key for key in PHRASES if key not in known]
        lines += [f"{code}: {len(PHRASES) - len(lacking)} of {len(PHRASES)} phrases", *(f"  {key}" for key in lacking)]
    golden("languages.txt", "\n".join(lines) + "\n")


def test_page_and_program_name_the_attitudes_of_a_sensor_alike() -> None:
    assert run("return (await load('../verdict_words.js')).POSES;", None) == POSES


def test_the_page_offers_every_language() -> None:
    page = (ENGLISH.parents[1] / "apps" / "live" / "static" / "index.html").read_text(encoding="utf-8")
    assert re.findall(r'<option value="(\w+)" lang="\1">', page) == list(LANGUAGES)
    assert re.findall(r'flinders-languages" content="([\w ]+)"', page) == [" ".join(OTHERS)]


SENTENCES: Final = """
const { useLanguage, inEnglish, phrase, numeral, pluralForm } = await load("../language.js");
const { useVerdictTables, sentenceOf, conditionOf, adviceOf, reasonWords } = await load("../verdict_words.js");
const { degrees, things } = await load("../views/words.js");
const before = sentenceOf(given.view);
useLanguage("de", given.words);
useVerdictTables(given.engine);
return {
    before, sentence: sentenceOf(given.view), condition: conditionOf(given.view),
    findings: given.view.findings.map(adviceOf), reason: reasonWords(given.reason),
    numbers: [degrees(0.0712), things(3000, "reading"), things(1, "outlier"), numeral("1,234.5")],
    english: inEnglish(() => [degrees(0.0712), sentenceOf(given.view)]), after: phrase("no.key", "{a} b", { a: 1 }),
};
"""


def test_the_page_says_in_german_what_the_program_says_in_german() -> None:
    german = language_of("de")
    samples = simulate.tumble(seed=1, motion="tilted").samples
    limited = fit(samples)
    engine = json.loads(json.dumps(data()))
    given = {
        "words": dict(german.words), "engine": engine, "view": json.loads(msgspec.json.encode(view(limited, samples))),
        "reason": {"code": "stale", "advice": "A.", "severity": "warning", "spans": [], "values": {"count": "1,200"}},
    }  # fmt: skip
    said = run(SENTENCES, given)
    assert said["before"] == headline_of(limited).words
    assert said["sentence"] == headline_of(limited, language=german).words
    assert said["condition"].startswith("gilt, wenn ")
    assert said["findings"] == [translation.advice(finding, german) for finding in first_causes(limited.findings)]
    assert said["reason"].startswith("Die letzten 1.200 Messungen")
    assert said["numbers"] == ["0,071°", "3.000 Messungen", "1 Ausreißer", "1.234,5"]
    assert said["english"] == ["0.071°", headline_of(limited).words]
    assert said["after"] == "1 b"


def test_the_page_knows_the_remarks_of_the_simulated_sensor() -> None:
    remarks = run("return Object.values((await load('../views/words.js')).REMARKS);", None)
    assert remarks == [words for _, words in COMMENTS]


# ------------------------------------------------------------------------------- no English in the everyday journeys

LEFT_OUT: Final = {
    r"(?m)^\$ .*$": "the line that was typed",
    r"(?m)^\S+: columns .*$": "how a file was read; errors of readers and of options",
    r"\bflinders [a-z][^\n]*": "commands to type",
    r"(?m) \[[a-z-]+\]": "codes of findings",
    r"\S+\.(csv|json)\b": "names of files",
    r"\b(likelihood|level|refresh|robust)\b": "names of methods",
    rf"\b({'|'.join(BODIES)}): ": "names of bodies, as they are typed",
    r"\b(UTC|counts)\b": "the time scale and units",
}
"""What is English on a terminal in every language, by pattern; `docs/live/live.md` lists the same."""

LATIN_WORD: Final = re.compile(r"[A-Za-zÄÖÜäöüß]{3,}")


def foreign_words(text: str, words: dict[str, str]) -> list[str]:
    """Words of a text in Latin letters that no phrase of a language has."""
    for pattern in LEFT_OUT:
        text = re.sub(pattern, " ", text)
    own = {word.lower() for phrase in words.values() for word in LATIN_WORD.findall(phrase)}
    return sorted({word for word in LATIN_WORD.findall(text) if word.lower() not in own})


JOURNEYS: Final = (
    ("calibrate tumble.csv -o calibration.json", 0),
    ("calibrate deck.csv -o limited.json", 3),
    ("calibrate table.csv", 4),
    ("calibrate short.csv", 4),
    ("calibrate noisy.csv", 4),
    ("show limited.json", 0),
    ("check calibration.json again.csv", 0),
    ("check calibration.json deck.csv --target 0.01", 3),
    ("check calibration.json other.csv", 4),
    ("check calibration.json tumble.csv", 3),
    ("check calibration.json table.csv", 3),
    ("check calibration.json short.csv", 3),
    ("check calibration.json", 0),
    ("check calibration.json --date 2100-01-01", 3),
    ("compare calibration.json limited.json", 3),
    ("refresh --previous calibration.json again.csv -o renewed.json", 0),
    ("demo", 0),
)
"""Command lines with their exit codes, in an order in which the files that they need are there."""


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of a good, a limited and three refused calibrations, of the same sensor again, and of another."""
    monkeypatch.chdir(tmp_path)
    record("tumble.csv", "hand")
    record("deck.csv", "swayed")
    record("table.csv", "sweep-xy", axes=(2, 0, 1))
    for name, seed in (("again.csv", 2), ("other.csv", 3)):
        sensor = simulate.tumble(seed=seed, motion="uniform", n=1500)
        write_field(name, sensor.samples.field)
    write_field("short.csv", simulate.tumble(seed=2, motion="hand").samples.field[:5])
    write_field("noisy.csv", simulate.tumble(seed=1, motion="hand", n=150, noise=5.0).samples.field)


@pytest.mark.usefixtures("recordings")
@pytest.mark.parametrize("language", OTHERS)
def test_everyday_commands_show_no_english(language: str) -> None:
    """Of whatever the terminal shows, each word is one of the language's phrases."""
    words = dict(language_of(language).words)
    found = {
        line: foreign
        for line, code in JOURNEYS
        if (foreign := foreign_words(session(f"flinders --language {language} {line}", code=code), words))
    }
    assert found == {}
    assert foreign_words("the claim doubles in 3 days", words)


@cache
def planned_with_noise(body: str) -> Plan:
    """A plan for a noise of 0.5 µT."""
    return plan(body, noise=0.5, alternatives=body == "drone")


@pytest.mark.parametrize("language", OTHERS)
@pytest.mark.parametrize("body", BODIES)
def test_a_plan_shows_no_english(language: str, body: str) -> None:
    planned = planned_with_noise(body)
    with shown_in(language):
        text = drawn(of_plan(planned, []))
    assert foreign_words(text, dict(language_of(language).words)) == []


@pytest.mark.parametrize("language", OTHERS)
@pytest.mark.parametrize(("moved_ut", "answer"), [(0.0, "holds"), (1.0, "fails"), (0.3, "cannot-tell")])
def test_advice_on_the_onboard_calibration_shows_no_english(language: str, moved_ut: float, answer: Answer) -> None:
    tumble = simulate.tumble(seed=1, n=1000)
    found = fit(tumble.samples)
    known = replace(found.calibration, offset=found.calibration.offset + np.array([moved_ut, 0.0, 0.0]))
    onboard = judge_onboard(replace(tumble.samples, onboard=known), found)
    assert onboard is not None
    assert onboard.answer == answer
    with shown_in(language):
        text = drawn(page_of_fit(found, onboard=onboard))
    assert foreign_words(text, dict(language_of(language).words)) == []


PLANS: Final = """
const { useLanguage } = await load("../language.js");
const { useVerdictTables, previousWords } = await load("../verdict_words.js");
const { resultWords, stepWords } = await load("../plan.js");
const { COMPARED } = await load("previous.js");
const english = given.rows.map((row) => [resultWords(row), ...stepWords(row)]);
useLanguage(given.language, given.words);
useVerdictTables(given.engine);
const said = (code, values) => previousWords({ name: "", change_deg: null, words: "", code, values });
const values = { difference: "0.12°", distance: "1.5", unit: "µT", worst: "2.4" };
const other = { source: "this recording", unit: "counts", name: "a", other: "µT", axes: "x,y,z" };
const previous = [
    ...Object.keys(COMPARED).map((code) => said(code, values)), said("holds", { difference: "x", below: "0.001" }),
    said("other-unit", other), said("other-axes", other),
];
return { english, plans: given.rows.map(resultWords), steps: given.rows.map(stepWords), previous };
"""


@pytest.mark.parametrize("language", OTHERS)
def test_plans_and_comparisons_of_the_page_show_no_english(language: str) -> None:
    words, rows = dict(language_of(language).words), planned_table()
    given = {
        "language": language, "words": words, "engine": json.loads(json.dumps(data())),
        "rows": msgspec.to_builtins(rows),
    }  # fmt: skip
    said = run(PLANS, given)
    assert said["english"] == [[row.sentence, *row.steps] for row in rows]
    row = next(row for row in rows if row.body == "drone" and row.noise == 0.5)
    steps = BODIES["drone"].coded_steps(planned_with_noise("drone").sequence)
    assert said["steps"][rows.index(row)] == [step.words(language_of(language)) for step in steps]
    shown = [*said["plans"], *(step for steps in said["steps"] for step in steps), *said["previous"]]
    assert {text: foreign for text in shown if (foreign := foreign_words(text, words))} == {}
    assert all(shown)


@pytest.mark.usefixtures("recordings")
def test_files_stay_english_in_every_language(tmp_path: Path) -> None:
    """Where the language is set, too."""
    lines = (
        "calibrate deck.csv -o a.json --report a.html --report-text a.txt --force",
        "plan --body boat --noise 0.5uT -o a.svg --force",
    )
    written = []
    for language in ("en", "el"):
        for line, code in zip(lines, (3, 3), strict=True):
            session(f"flinders --language {language} {line}", code=code)
        kinds = ("json", "html", "txt", "svg")
        written.append([re.sub(TIME, "", (tmp_path / f"a.{kind}").read_text(encoding="utf-8")) for kind in kinds])
    assert written[0] == written[1]


TIME: Final = r"\d{2}:\d{2}(:\d{2})?"


@contextmanager
def shown_in(language: str) -> Iterator[None]:
    """Pages in a language."""
    token = TERMINAL_LANGUAGE.set(language_of(language))
    yield
    TERMINAL_LANGUAGE.reset(token)


def drawn(page: RenderableType) -> str:
    """A page as text of 80 columns, none of which is cut."""
    console = Console(width=80, file=io.StringIO(), highlight=False)
    with console.capture() as shown:
        console.print(page)
    text = shown.get()
    assert "…" not in text
    return text
