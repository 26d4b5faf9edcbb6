"""The first screen of the README, as a page of a repository shows it, has the picture and the first output."""

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
"""
"""Sizes of the style sheet with which GitHub shows a README."""
SCREEN: Final[ViewportSize] = {"width": 1280, "height": 800}


@pytest.mark.tools
def test_picture_and_first_output_need_no_scrolling(browser: Browser) -> None:
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
    page.close()
