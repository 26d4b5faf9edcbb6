r"""A report as one HTML file: template, style sheet, script, and a security policy that permits nothing else.

Text from files, such as names and comments, is escaped. The policy in the page contains the hash of the page's script.

>>> style_of().strip()[:25]
':root { --paper: #f4f6f8;'
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from flinders.report.colours import variables
from flinders.report.modules import asset, join_modules

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import jinja2

SHEETS: Final = ("static/figure.css", "static/report.css")
"""Style sheets of every report."""


def html_file(template: str, given: Mapping[str, Any], *, style: str, script: str, filters: Mapping[str, Any]) -> str:
    """Fill in a template that is a whole page.

    The page may use `style` and `script`, and no others; `filters` format its numbers.
    """
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    return fill_template(template, {**given, "style": style, "script": script, **hashes}, filters) + "\n"


def fill_template(template: str, given: Mapping[str, Any], filters: Mapping[str, Callable[..., Any]]) -> str:
    """Fill in a template; text is escaped for HTML.

    The template is one of `flinders.report`, or a path in `flinders` such as ``apps/fleet/fleet.html.j2``.
    """
    return _compile_template(template, *filters.items()).render(**given)


@cache
def _compile_template(template: str, *filters: tuple[str, Callable[..., Any]]) -> jinja2.Template:
    """A template with its filters. It is cached, as compiling takes longer than filling in."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader("flinders.report"), jinja2.PackageLoader("flinders", "")]),
        autoescape=jinja2.select_autoescape(["html.j2"]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    return environment.get_template(template)


def style_of(*sheets: str) -> str:
    """Style sheets in addition to those of every report, with the colours of both themes; paper is always light.

    Sheets are named by their paths in the package `flinders`.
    """
    light, dark = variables("light"), variables("dark")
    rules = "\n".join(asset(sheet) for sheet in (*SHEETS, *sheets))
    return (
        f"\n:root {{ {light} }}\n"
        f'@media screen and (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
        f'@media screen {{ :root[data-theme="dark"] {{ {dark} }} }}\n{rules}'
    )


def script_of() -> str:
    """The script of a page without a 3-D view."""
    return f"\n{join_modules('static/plain.js')}\nm0.theming(() => {{}});\n"


def _hash(text: str) -> str:
    """Hash in the format of a Content-Security-Policy."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
