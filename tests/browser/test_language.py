"""The page in another language, and its spoken words, by a browser whose speech synthesis is a fake."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest
from benchmarks.stage import Program, Site
from playwright.sync_api import expect
from tests.browser.test_page import dropped
from tests.browser.visitor import Visitor, until
from tests.test_languages import OTHERS, foreign_words

from flinders.apps.live.standalone.package import write
from flinders.core.language import language_of
from flinders.simulate.bodies import BODIES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.tools

SPEECH: Final = """(() => {
    const spoken = [];
    const speaking = new Set();
    const voices = VOICES.map((lang) => ({ lang, name: lang }));
    window.SpeechSynthesisUtterance = class { constructor(text) { this.text = text; } };
    const synthesis = {
        getVoices: () => voices,
        addEventListener: () => {},
        cancel: () => speaking.clear(),
        speak: (utterance) => {
            speaking.add(utterance);
            spoken.push({ text: utterance.text, lang: utterance.lang, at_once: speaking.size });
        },
    };
    Object.defineProperty(window, "speechSynthesis", { value: synthesis });
    window.spoken = spoken;
})()"""
WIDE: Final = """() => [...document.querySelectorAll("button, label, h2, dt, output, .panel p")].filter((part) => {
    const { right, width } = part.getBoundingClientRect();
    return width > 0 && !part.closest(".visually-hidden, .skip, #scene") && right > innerWidth + 1;
}).map(({ id, className, textContent }) => `${id} ${className} ${textContent}`)"""
PHONE: Final[dict[str, Any]] = {"viewport": {"width": 360, "height": 740}, "is_mobile": True, "has_touch": True}
TEXTS: Final = """() => {
    const own = document.documentElement.lang;
    const isLeftOut = (part) => part.closest("LEFT_OUT") || (part.closest("[lang]")?.lang ?? own) !== own;
    const texts = [];
    const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
        if (!isLeftOut(walk.currentNode.parentElement)) texts.push(walk.currentNode.textContent.trim());
    }
    for (const name of ["title", "aria-label", "placeholder"]) {
        const parts = [...document.querySelectorAll(`[${name}]`)].filter((part) => !isLeftOut(part));
        texts.push(...parts.map((part) => part.getAttribute(name)));
    }
    return texts.filter(Boolean);
}"""
LEFT_OUT: Final = "noscript, script, style, code, pre, textarea, optgroup, #preview, #export-target"
"""Parts of the page that are English in every language: code, names of chips and targets, words without scripts."""
NAMES: Final = {"flinders", "session", "before", "csv", "json", "likelihood", "deutsch", *BODIES}
"""Words of names: of the program, of files, of a method, of a language, and of bodies."""


@pytest.fixture
def visitor(browser: Browser, tmp_path: Path) -> Iterator[Visitor]:
    """Of a simulation, ten times as fast."""
    with Program(tmp_path, "--simulate", "--speed", "10") as program:
        visitor = Visitor(browser, program)
        yield visitor
        visitor.leave()
        visitor.close()


def opened(visitor: Visitor, locale: str, voices: str = "[]", **options: Any) -> Page:
    """The page for a browser of a language, with such voices."""
    context = visitor.context(locale=locale, **options)
    context.add_init_script(SPEECH.replace("VOICES", voices))
    return visitor.page(context)


def test_the_page_speaks_german_one_sentence_at_a_time(visitor: Visitor) -> None:
    page = opened(visitor, "de-AT", '["en-GB", "de-DE"]')
    assert page.evaluate("document.documentElement.lang") == "de"
    expect(page.locator("#finish")).to_contain_text("Abschließen")
    page.keyboard.press("?")
    expect(page.locator("#voice-words")).to_have_text("")
    page.locator("#voice").check()
    page.keyboard.press("Escape")
    until(page, "flinders.store.state.phase === 'good'")
    expect(page.locator("#phase")).to_have_text("Gut")
    expect(page.locator("#phase-words")).to_contain_text("Der größte zu erwartende Kursfehler")
    until(page, "window.spoken.some(({ text }) => text.startsWith('Gut.'))")
    spoken = page.evaluate("window.spoken")
    assert {(each["lang"], each["at_once"]) for each in spoken} == {("de-DE", 1)}
    assert any(each["text"].startswith("Drehung fertig.") for each in spoken)
    page.locator("#finish").click()
    expect(page.locator("#verdict-words")).to_contain_text("Kurse sind in jeder Lage auf 0,")
    expect(page.locator("#findings")).to_contain_text("seinen eigenen Einbauwinkel im Fahrzeug")
    page.locator("#export-target").select_option("json")
    expect(page.locator("#preview")).to_contain_text('"field_strength_known": false')


def test_a_language_that_is_chosen_is_remembered_and_a_missing_voice_is_said(visitor: Visitor) -> None:
    page = opened(visitor, "en-GB", '["en-GB"]', **PHONE)
    assert page.evaluate("document.documentElement.lang") == "en-GB"
    page.locator("#help").click()
    page.locator("#voice").check()
    with page.expect_navigation():
        page.locator("#language").select_option("el")
    page.reload()
    until(page, "window.flinders?.store.hello")
    expect(page.locator("#status-title")).to_have_text("Αναμενόμενο σφάλμα πορείας")
    page.locator("#help").click()
    expect(page.locator("#language")).to_have_value("el")
    expect(page.locator("#voice")).to_be_disabled()
    expect(page.locator("#voice-words")).to_have_text("Αυτός ο περιηγητής δεν έχει φωνή για αυτή τη γλώσσα.")
    page.keyboard.press("Escape")
    until(page, "flinders.store.view")
    assert page.evaluate(WIDE) == []


@pytest.mark.parametrize("language", OTHERS)
def test_the_page_shows_no_english_in_another_language(visitor: Visitor, language: str) -> None:
    """While a sensor is turned, when it is good, in the panels, and compared with an earlier calibration."""
    page = opened(visitor, language, **PHONE)
    shown: list[str] = []
    until(page, "flinders.store.view")
    shown += texts(page)
    until(page, "flinders.store.state.phase === 'good'")
    shown += texts(page)
    page.locator("#finish").click()
    expect(page.locator("#numbers")).to_contain_text("likelihood")
    with page.expect_download() as saved:
        page.locator("#save-calibration").click()
    shown += texts(page)
    dropped(page, "before.json", Path(saved.value.path()).read_bytes())
    expect(page.locator("#previous-words")).to_contain_text("before.json")
    shown += texts(page)
    assert page.evaluate(WIDE) == []
    assert foreign(shown, language) == {}


def foreign(shown: list[str], language: str) -> dict[str, set[str]]:
    """Texts with words in Latin letters that neither the language nor a name has."""
    words = dict(language_of(language).words)
    found = {text: {word.lower() for word in foreign_words(text, words)} - NAMES for text in shown}
    return {text: each for text, each in found.items() if each}


def texts(page: Page) -> list[str]:
    """What a page shows or says in the language that it is in."""
    found: list[str] = page.evaluate(TEXTS.replace("LEFT_OUT", LEFT_OUT))
    return found


@pytest.mark.parametrize("language", OTHERS)
def test_a_plan_on_the_page_shows_no_english(browser: Browser, tmp_path: Path, language: str) -> None:
    write(tmp_path / "page")
    with Site(tmp_path / "page") as site:
        visitor = Visitor(browser, site)
        page = visitor.page(visitor.context(locale=language, **PHONE))
        page.locator("#plan summary").click()
        page.locator("#plan-ask").click()
        expect(page.locator("#plan-steps li")).to_have_count(5)
        shown = texts(page)
        assert any("0,0" in text for text in shown)
        visitor.leave()
        visitor.close()
    assert foreign(shown, language) == {}


def test_the_page_without_a_program_loads_its_language_on_demand(browser: Browser, tmp_path: Path) -> None:
    write(tmp_path / "page")
    with Site(tmp_path / "page") as site:
        visitor = Visitor(browser, site)
        context = visitor.context(locale="el")
        asked: list[str] = []
        context.on("request", lambda request: asked.append(request.url.rpartition("/")[2]))
        page = context.new_page()
        page.goto(site.address)
        expect(page.locator("#start-title")).to_have_text("Βαθμονόμηση μαγνητομέτρου")
        assert "el.json" in asked
        assert "de.json" not in asked
        visitor.leave()
        visitor.close()
