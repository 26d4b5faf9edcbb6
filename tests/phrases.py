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

from flinders.core.durations import UNITS
from flinders.core.language import SIGNS
from flinders.findings import CATALOGUE
from flinders.findings.headline import CAVEAT, LEADS, REACH_NAMES, REACHES, UNSTATED_REASON
from flinders.findings.row import CONDITIONS, VERIFICATIONS
from flinders.findings.words import STEPS, WHY_LARGE
from flinders.fitting import refreshing
from flinders.report import comparison_pages, onboard_pages, plan_pages
from flinders.report.fit_pages import NO_BETTER_WORDS
from flinders.report.formatting import SOURCES
from flinders.simulate.bodies import BODIES, CIRCLES, MANY_TIMES, STEP_FORMS, TIMES, side_key
from flinders.workflows.onboard import ONBOARD_NAME

PACKAGE: Final = Path(str(files("flinders")))
PAGE: Final = PACKAGE / "apps" / "live" / "static"
ENGLISH: Final = PACKAGE / "languages" / "en.json"
LITERAL: Final = r"""(?:"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')"""
CALL: Final = re.compile(rf"""\bphrase\(\s*["']([\w.-]+)["'],\s*({LITERAL}(?:\s*\+?\s*{LITERAL})*)""")
CONTENT: Final = re.compile(r'<(\w+)\b[^<>]*\sdata-phrase="([\w.-]+)"[^<>]*>(.*?)</\1>', re.DOTALL)
ATTRIBUTES: Final = {"title": "title", "label": "aria-label", "placeholder": "placeholder"}
TABLES: Final = """
const words = await load("../views/words.js");
const { NAMES } = await load("../views/bodies.js");
const { SEQUENCES } = await load("choreography.js");
const { FRONTS } = await load("lead.js");
const { EVERYWHERE } = await load("view.js");
const { WHILE_LEVEL } = await load("evaluate.js");
const { KEYS } = await load("../keys.js");
const { COMPARED } = await load("previous.js");
const { POSES, REFUSALS } = await load("../verdict_words.js");
const widgets = await Promise.all(given.widgets.map(async (name) => (await load(`../views/${name}.js`))[name]));
const named = (prefix, table) => Object.entries(table).map(([key, english]) => [`${prefix}.${key}`, english]);
const turns = Object.entries(SEQUENCES).filter(([body]) => body !== "phone");
return Object.fromEntries([
    ...named("phase", words.PHASES), ...named("fault", words.REASONS), ...named("verdict", words.VERDICTS),
    ...named("name", words.SOURCES), ...named("simulation", words.REMARKS),
    ["verdict.while-level", words.whileLevelTitle()], ["step.everywhere", EVERYWHERE],
    ...named("body", NAMES), ...named("front", FRONTS), ...named("pose", POSES), ...named("refusal", REFUSALS),
    ...named("earlier", COMPARED), ...named("key", KEYS),
    ...Object.entries(WHILE_LEVEL).map(([goal, english]) => [`step.while-level-${goal}`, english]),
    ...turns.flatMap(([body, steps]) => steps.map(({ words }, i) => [`turn.${body}.${i + 1}`, words])),
    ...widgets.flatMap(({ name, title, enlarges, legend = [] }) => [
        [`widget.${name}`, title], [`enlarge.${name}`, `Enlarge ${enlarges}`],
        ...legend.map(([, word]) => [`plot.${word}`, word]),
    ]),
]);
"""
NOUNS: Final = ("reading", "outlier", "time")
PYTHON: Final = ("core/durations.py", "fitting/good_until.py", "report/*.py", "cli/*.py")
WIDGETS: Final = ("heading", "deviation", "residuals", "strength", "projections")


def english() -> dict[str, str]:
    """All English phrases by key, sorted."""
    return dict(sorted({**of_page(), **of_verdicts(), **of_plans(), **of_answers(), **of_python()}.items()))


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
        "list.and": "and",
        **{f"number.{name}": sign for name, sign in SIGNS.items()},
        **{f"things.{noun}.one": f"{{count}} {noun}" for noun in NOUNS},
        **{f"things.{noun}.other": f"{{count}} {noun}s" for noun in NOUNS},
    }


def of_plans() -> dict[str, str]:
    """Phrases of plans, and durations."""
    sides = {side_key(words): words for body in BODIES.values() for words in body.sides.values()}
    return {
        **{f"plan.for.{name}": body.description for name, body in BODIES.items()},
        **{f"plan.times.{count}": words for count, words in TIMES.items()},
        "plan.times.many": MANY_TIMES,
        **{f"plan.circle.{name}": words for name, words in CIRCLES.items()},
        **{f"plan.side.{key}": words for key, words in sides.items()},
        **{f"plan.step.{form}": words for form, words in STEP_FORMS.items()},
        **{f"plan.aid.{name}": words for name, words in plan_pages.AIDS.items()},
        **{f"duration.{unit}": unit for unit, _, _ in UNITS},
        "duration.s": "s",
    }


def of_answers() -> dict[str, str]:
    """Titles of comparisons, and names of instruments."""
    pairs = comparison_pages.TITLES.items()
    truth = comparison_pages.EVALUATION_TITLES.items()
    return {
        **{f"answer.calibrations.{answer}": words for answer, (words, _) in pairs},
        **{f"answer.check.{answer}": words for answer, (_, words) in pairs},
        **{f"onboard.title.{answer}": words for answer, words in onboard_pages.TITLES.items()},
        **{f"truth.title.{name.replace(' ', '-')}": words for name, words in truth},
        **{f"instrument.{name.replace(' ', '-')}": f"the {name}" for name in SOURCES.values()},
        **{f"numbers.{name}": name for name in ("quadratic", "cubic")},
        "check.onboard": ONBOARD_NAME,
        "earlier.other-unit": refreshing.OTHER_UNIT,
        "earlier.other-axes": refreshing.OTHER_AXES,
    }


def of_python() -> dict[str, str]:
    """Phrases in the sources of the terminal's pages and of the command line."""
    texts = (path.read_text(encoding="utf-8") for pattern in PYTHON for path in sorted(PACKAGE.glob(pattern)))
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
