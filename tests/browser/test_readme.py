"""As a repository shows it, the README has two screens; picture and first output stand on the first."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest
from markdown_it import MarkdownIt

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ViewportSize

ROOT: Final = Path(__file__).resolve().parent.parent.parent
STYLE: Final = """
body { margin: 32px auto; width: 838px; font: 16px/1.5 sans-serif; }
h1 { font-size: 32px; line-height: 1.25; margin: 0 0 16px; padding-bottom: 10px; border-bottom: 1px solid; }
p, pre, table { margin: 0 0 16px; }
pre { padding: 16px; font: 13.6px/1.45 monospace; }
h2 { font-size: 24px; line-height: 1.25; margin: 24px 0 16px; padding-bottom: 7px; border-bottom: 1px solid; }
ul { margin: 0 0 16px; padding-left: 2em; }
li + li { margin-top: 4px; }
table { border-collapse: collapse; display: block; }
th, td { padding: 6px 13px; border: 1px solid; }
code { font-size: 13.6px; }
"""
"""Sizes of the style sheet with which GitHub shows a README."""
SCREEN: Final[ViewportSize] = {"width": 1280, "height": 800}


@pytest.mark.tools
def test_readme_has_two_screens_and_its_picture_and_first_output_need_no_scrolling(browser: Browser) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    picture = re.search(r'<img src="([^"]+)"', text)
    assert picture is not None
    page = browser.new_page(viewport=SCREEN)
    page.goto((ROOT / "docs" / "images").as_uri())
    html = MarkdownIt("commonmark").enable("table").render(text).replace(picture[1], (ROOT / picture[1]).as_uri())
    page.set_content(f"<style>{STYLE}</style>{html}")
    page.wait_for_function("document.images[0].complete && document.images[0].naturalWidth > 0")
    for first in ("img", "pre"):
        box = page.locator(first).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= SCREEN["height"], first
    box = page.locator("body").bounding_box()
    assert box is not None
    assert box["height"] <= 2 * SCREEN["height"]
    page.close()
