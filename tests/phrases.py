"""English phrases, collected from the sources: ``python -m tests.phrases`` writes `languages/en.json`.

Phrases of the page are calls of ``phrase("key", "English")``, elements with ``data-phrase="key"``, and tables. Phrases
of verdicts are tables in Python, and rows of the catalogue of findings.
"""

from __future__ import annotations

import ast
import json
import re
from html import unescape
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from tests.javascript import run

from flinders.findings import CATALOGUE
from flinders.findings.headline import CAVEAT, LEADS, REACH_NAMES, REACHES, UNSTATED_REASON
from flinders.findings.row import CONDITIONS, VERIFICATIONS
from flinders.findings.words import STEPS, WHY_LARGE
from flinders.report.fit_pages import NO_BETTER_WORDS
from flinders.simulate.bodies import BODIES

PACKAGE: Final = Path(str(files("flinders")))
PAGE: Final = PACKAGE / "apps" / "live" / "static"
ENGLISH: Final = PACKAGE / "languages" / "en.json"
LITERAL: Final = r'"(?:[^"\\]|\\.)*"'
CALL: Final = re.compile(rf'\bphrase\(\s*"([\w.-]+)",\s*({LITERAL}(?:\s*\+\s*{LITERAL})*)')
CONTENT: Final = re.compile(r'<(\w+)\b[^<>]*\sdata-phrase="([\w.-]+)"[^<>]*>(.*?)</\1>', re.DOTALL)
ATTRIBUTES: Final = {"title": "title", "label": "aria-label", "placeholder": "placeholder"}
TABLES: Final = """
const words = await load("../views/words.js");
const { NAMES } = await load("../views/bodies.js");
const { SEQUENCES } = await load("choreography.js");
const { FRONTS } = await load("lead.js");
const { POSES, REFUSALS } = await load("../verdict_words.js");
const widgets = await Promise.all(given.widgets.map(async (name) => (await load(`../views/${name}.js`))[name]));
const named = (prefix, table) => Object.entries(table).map(([key, english]) => [`${prefix}.${key}`, english]);
const turns = Object.entries(SEQUENCES).filter(([body]) => body !== "phone");
return Object.fromEntries([
    ...named("phase", words.PHASES), ...named("fault", words.REASONS), ...named("verdict", words.VERDICTS),
    ...named("name", words.SOURCES), ...named("simulation", words.REMARKS),
    ["verdict.while-level", words.whileLevelTitle()],
    ...named("body", NAMES), ...named("front", FRONTS), ...named("pose", POSES), ...named("refusal", REFUSALS),
    ...turns.flatMap(([body, steps]) => steps.map(({ words }, i) => [`turn.${body}.${i + 1}`, words])),
    ...widgets.flatMap(({ name, title, enlarges, legend = [] }) => [
        [`widget.${name}`, title], [`enlarge.${name}`, `Enlarge ${enlarges}`],
        ...legend.map(([, word]) => [`plot.${word}`, word]),
    ]),
]);
"""
WIDGETS: Final = ("heading", "deviation", "residuals", "strength", "projections")


def english() -> dict[str, str]:
    """All English phrases by key, sorted."""
    return dict(sorted({**of_page(), **of_verdicts(), **of_python()}.items()))


def of_page() -> dict[str, str]:
    """Phrases of the page."""
    sources = [path for path in PAGE.glob("**/*.js") if path.parent.name not in ("bundled", "station")]
    texts = [path.read_text(encoding="utf-8") for path in [*sorted(sources), PAGE / "index.html"]]
    tables: dict[str, str] = run(TABLES, {"widgets": WIDGETS})
    found = dict(tables)
    for text in texts:
        found |= {key: _joined(literals) for key, literals in CALL.findall(text)}
        found |= {key: _marked(content) for _, key, content in CONTENT.findall(text)}
        for kind, attribute in ATTRIBUTES.items():
            pattern = rf'\b{attribute}="([^"]*)" data-phrase-{kind}="([\w.-]+)"'
            found |= {key: unescape(words) for words, key in re.findall(pattern, text)}
    return found


def of_verdicts() -> dict[str, str]:
    """Phrases of verdicts and findings, and descriptions of bodies."""
    reaches = {name: row[1:] for name, row in zip(REACH_NAMES, REACHES, strict=True)}
    return {
        **{f"lead.{kind}": words for kind, words in LEADS.items()},
        **{f"reach.{name}": reach for name, (reach, _) in reaches.items()},
        **{f"beyond.{name}": beyond for name, (_, beyond) in reaches.items() if beyond},
        "basis.no-better": NO_BETTER_WORDS,
        "verdict.left-out": CAVEAT,
        "verdict.unstated": UNSTATED_REASON,
        **{f"step.{name}": words.replace("{}", "{pose}") for name, words in STEPS.items()},
        **{f"why-large.{name}": words for name, words in WHY_LARGE.items()},
        **{f"condition.{code}": words for code, words in CONDITIONS.items()},
        **{f"verification.{code}": words for code, words in VERIFICATIONS.items()},
        **{f"findings.{code}.plain": row.plain for code, row in CATALOGUE.items()},
        **{f"findings.{code}.remedy": row.remedy for code, row in CATALOGUE.items() if row.remedy},
        **{f"plan.for.{name}": body.description for name, body in BODIES.items()},
        "list.and": "and",
        "number.decimal": ".",
        "number.group": ",",
        **{f"things.{noun}.one": f"{{count}} {noun}" for noun in ("reading", "outlier")},
        **{f"things.{noun}.other": f"{{count}} {noun}s" for noun in ("reading", "outlier")},
    }


def of_python() -> dict[str, str]:
    """Phrases in the sources of reports and findings."""
    texts = (path.read_text(encoding="utf-8") for path in sorted((PACKAGE / "report").glob("*.py")))
    return {key: _joined(literals) for text in texts for key, literals in CALL.findall(text)}


def fields(template: str) -> set[str]:
    """Placeholders of a format, each with the format of its value."""
    return set(re.findall(r"\{[^{}]*\}", template))


def _joined(literals: str) -> str:
    """Text of string literals that are concatenated."""
    return "".join(ast.literal_eval(literal) for literal in re.findall(LITERAL, literals))


def _marked(content: str) -> str:
    """Words of an element, with marks for bold words and for code."""
    marked = re.sub(r"</?strong>", "**", re.sub(r"</?code>", "`", content))
    assert "<" not in marked, f"a phrase has markup: {content}"
    return unescape(marked)


def text_of(phrases: dict[str, Any]) -> str:
    """Text of the file of a language."""
    return json.dumps(phrases, ensure_ascii=False, indent=2) + "\n"


if __name__ == "__main__":
    ENGLISH.parent.mkdir(exist_ok=True)
    ENGLISH.write_text(text_of(english()), encoding="utf-8")
