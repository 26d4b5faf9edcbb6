"""A person with a browser; complaints of the pages fail the test."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

import pytest

if TYPE_CHECKING:
    from benchmarks.stage import Program, Site
    from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, Request, Route, ViewportSize


class Visitor:
    """A person with a browser: opens pages, and stores their complaints and the hosts that they ask.

    A page without options stays open for the next test, which finds it in its first state: loaded again, with empty
    storage. Drawing is slow without a graphics card; unless a test asks for it, nothing moves and no sphere is drawn.
    """

    def __init__(self, browser: Browser, program: Program | Site) -> None:
        self.browser, self.program = browser, program
        self.contexts: list[BrowserContext] = []
        self.plain: Page | None = None
        self.complaints: list[str] = []
        self.strangers: list[str] = []
        self.requests = 0

    def context(self, *, draws: bool = False, **options: Any) -> BrowserContext:
        """A separate browser context, with its own storage, size and colours; with `draws` it draws the sphere."""
        options = {"viewport": DESK, "color_scheme": "dark", "reduced_motion": "reduce", **options}
        context = self.browser.new_context(accept_downloads=True, **options)
        context.set_default_timeout(UNTIL_MS)
        context.route(re.compile(f"^(?!{re.escape(self.program.address)}|blob:|data:)"), self._refuse)
        if not draws:
            context.route(f"{self.program.address}static/views/scene.js", self._without_sphere)
        context.on("request", self._count)
        context.on("console", self._listen)
        context.on("weberror", lambda error: self.complaints.append(str(error.error)))
        self.contexts.append(context)
        return context

    def page(self, context: BrowserContext | None = None, *, draws: bool = False, **options: Any) -> Page:
        """Open the page, or load the plain page again, and wait until it has heard from the program."""
        if context or draws or options:
            page = (context or self.context(draws=draws, **options)).new_page()
        else:
            page = self.plain = self.plain or self.context().new_page()
        if page.url == self.program.address:
            page.set_viewport_size(DESK)
            page.mouse.move(0, 0)
            page.evaluate("localStorage.clear()")
            page.reload()
        else:
            page.goto(self.program.address)
        until(page, "window.flinders?.store.hello")
        return page

    def forgive(self, status: int) -> None:
        """Forget refusals that a test has provoked: a browser reports each, and a page cannot prevent that."""
        self.complaints = [words for words in self.complaints if f"status of {status}" not in words]

    def leave(self) -> None:
        """Close all pages except the plain one, and assert that there were no complaints and no other hosts."""
        others = [context for context in self.contexts if self.plain is None or context != self.plain.context]
        for context in others:
            context.close()
            self.contexts.remove(context)
        wrong = [*(f"another host was asked: {address}" for address in self.strangers), *self.complaints]
        is_idle = not self.requests
        self.strangers, self.complaints, self.requests = [], [], 0
        if wrong or is_idle:
            pytest.fail("\n".join(wrong) or "no page was opened", pytrace=False)

    def close(self) -> None:
        """Close all pages."""
        for context in self.contexts:
            context.close()
        self.contexts.clear()
        self.plain = None

    def _without_sphere(self, route: Route) -> None:
        route.fulfill(content_type="text/javascript", body="throw new Error('this test needs no sphere');")

    def _refuse(self, route: Route) -> None:
        self.strangers.append(route.request.url)
        route.abort()

    def _count(self, _: Request) -> None:
        self.requests += 1

    def _listen(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.complaints.append(f"{message.text} ({message.location.get('url', '')})")


DESK: Final[ViewportSize] = {"width": 1280, "height": 800}
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
