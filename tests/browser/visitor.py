"""A person with a browser, whose complaints fail the test."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from benchmarks.stage import Program
    from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, Request, Route


class Visitor:
    """A person with a browser: opens pages, and remembers what they complain of and whom they ask."""

    def __init__(self, browser: Browser, program: Program) -> None:
        self.browser, self.program = browser, program
        self.contexts: list[BrowserContext] = []
        self.complaints: list[str] = []
        self.strangers: list[str] = []
        self.requests = 0

    def context(self, **options: Any) -> BrowserContext:
        """A browser of its own: its own storage, size, and colours."""
        options = {"viewport": {"width": 1280, "height": 800}, "color_scheme": "dark", **options}
        context = self.browser.new_context(accept_downloads=True, **options)
        context.set_default_timeout(UNTIL_MS)
        context.route(re.compile(f"^(?!{re.escape(self.program.address)}|blob:|data:)"), self._refuse)
        context.on("request", self._count)
        context.on("console", self._listen)
        context.on("weberror", lambda error: self.complaints.append(str(error.error)))
        self.contexts.append(context)
        return context

    def page(self, context: BrowserContext | None = None, **options: Any) -> Page:
        """Open the page, and wait until it has heard from the program."""
        page = (context or self.context(**options)).new_page()
        page.goto(self.program.address)
        until(page, "window.flinders?.store.hello")
        return page

    def forgive(self, status: int) -> None:
        """Forget refusals that a test asked for: a browser notes each, and no page can keep it from that."""
        self.complaints = [words for words in self.complaints if f"status of {status}" not in words]

    def close(self) -> None:
        """Close all pages."""
        for context in self.contexts:
            context.close()
        self.contexts.clear()

    def _refuse(self, route: Route) -> None:
        self.strangers.append(route.request.url)
        route.abort()

    def _count(self, _: Request) -> None:
        self.requests += 1

    def _listen(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.complaints.append(f"{message.text} ({message.location.get('url', '')})")


def visiting(browser: Browser, program: Program) -> Iterator[Visitor]:
    """A visitor for one test; afterwards nothing may have been complained of, and nobody else asked."""
    visitor = Visitor(browser, program)
    yield visitor
    visitor.close()
    wrong = [*(f"another host was asked: {address}" for address in visitor.strangers), *visitor.complaints]
    if wrong or not visitor.requests:
        pytest.fail("\n".join(wrong) or "no page was opened", pytrace=False)


UNTIL_MS: Final = 60_000
UNTIL: Final = """words => new Promise((resolve, reject) => {
    const end = performance.now() + MS;
    const look = () => {
        if (EXPRESSION) resolve();
        else if (performance.now() < end) setTimeout(look, 25);
        else reject(new Error(`still false: ${words}: ${JSON.stringify(window.flinders?.store.state)}`));
    };
    look();
})"""


def until(page: Page, expression: str) -> None:
    """Wait until an expression of the page is true.

    `Page.wait_for_function` would evaluate text on the page again and again, which its Content Security Policy refuses.

    Raises
    ------
    Error
        Where it is still false after a minute; with the state of the page.
    """
    page.evaluate(UNTIL.replace("MS", str(UNTIL_MS)).replace("EXPRESSION", expression), expression)


SERIOUS: Final = ("serious", "critical")
RULES: Final = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}


def grave(page: Page, axe: str) -> list[str]:
    """What axe finds serious or critical."""
    page.evaluate(axe)
    found = page.evaluate("rules => axe.run(document, rules)", RULES)
    assert len(found["passes"]) > 10
    return [
        f"{violation['id']}: {violation['help']}: {node['html'][:120]} {node.get('failureSummary', '')}"
        for violation in found["violations"]
        if violation["impact"] in SERIOUS
        for node in violation["nodes"]
    ]
