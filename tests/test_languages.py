"""Every language has the phrases of the English one, with the same placeholders; a key that it lacks stays English."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Final

import msgspec
import pytest
from tests.javascript import run
from tests.phrases import ENGLISH, english, fields, text_of

from flinders import simulate
from flinders.apps.live.simulated import COMMENTS
from flinders.apps.live.standalone.engine import data
from flinders.core.language import LANGUAGES, language_of
from flinders.findings import CATALOGUE, first_causes, translation
from flinders.findings.translation import POSES
from flinders.fitting.calibrate import fit
from flinders.fitting.verdict import headline_of
from flinders.report.view import view

if TYPE_CHECKING:
    from tests.golden.sessions import Golden

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


def test_a_language_has_all_phrases_of_the_page_and_of_the_first_sentence(words: dict[str, str]) -> None:
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
