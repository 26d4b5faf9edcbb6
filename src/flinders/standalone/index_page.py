"""The first file of the folder: the live page's own, with what a page without a server has in other words or not.

>>> '<script type="module" src="static/standalone.js">' in index_page()
True
"""

from __future__ import annotations

from typing import Final

from flinders.report.html_file import asset

CSP: Final = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'"
)
"""WebAssembly is compiled in the worker; some browsers hold it to the policy of the page."""

SOURCE_BUTTON: Final = (
    '<button type="button" id="connect" title="Where readings come from">'
    '<svg class="icon" aria-hidden="true"><use href="#i-send"/></svg><span>Source</span></button>\n      '
)
KEPT: Final = (
    '<p class="faint kept">For a report, and to send it to a board: save the readings or the calibration, and use '
    "<code>flinders report</code> and <code>flinders send</code>.</p>\n        "
)
HELP: Final = (
    "Nothing leaves this browser: readings of a board stay in it until you start again, also when the page is loaded "
    "again. Reports, sending to a board, binary logs and the dip of a place need the program: "
    "<code>pip install flinders</code>."
)


def _hidden(name: str) -> tuple[str, str]:
    """Hide an element that the page has nothing for."""
    return f'id="{name}"', f'id="{name}" hidden'


EDITS: Final = (
    (
        '<meta charset="utf-8">',
        f'<meta charset="utf-8">\n  <meta http-equiv="Content-Security-Policy" content="{CSP}">',
    ),
    ("static/live.js", "static/standalone.js"),
    (
        '<link rel="stylesheet" href="static/page.css">',
        '<link rel="stylesheet" href="static/page.css">\n  <link rel="stylesheet" href="static/standalone.css">',
    ),
    ('<button type="button" id="open"', f'{SOURCE_BUTTON}<button type="button" id="open"'),
    ('<main class="board">', '<main class="board">\n    {start}'),
    *map(_hidden, ("open", "save-report", "send", "place")),
    ("the dip is assumed: give it, or the place", "the dip is assumed: look it up for your place, and type it"),
    ('<p class="faint kept" id="kept">', f'{KEPT}<p class="faint kept" id="kept">'),
    ("Everything that arrives is recorded on the computer that runs Flinders; closing this page loses nothing.", HELP),
    (
        "The readings so far leave this page. The file they were recorded to stays.",
        "The readings so far are deleted from this browser. To keep them, press Finish and Readings first.",
    ),
    (
        "This page draws what the server measures, and needs JavaScript for it. Nothing leaves this computer.",
        "This page calibrates in your browser, and needs JavaScript for it. Nothing leaves this computer.",
    ),
)
"""What stands once in the live page, and what stands here in its place."""


def index_page() -> str:
    """The page as HTML."""
    text = asset("index.html")
    for old, new in EDITS:
        if text.count(old) != 1:
            raise ValueError(f"index.html has {old!r} {text.count(old)} times: need it once")
        text = text.replace(old, new.replace("{start}", asset("standalone/start.html").rstrip()))
    return text
