"""A report as one HTML file: a template with its style sheet and script in it, and a policy that lets nothing else run.

What comes from files, such as names and comments, is escaped; of a script the policy of the page names the hash.

>>> style_of("fleet.css").strip()[:25]
':root { --paper: #f4f6f8;'
"""

from __future__ import annotations

import base64
import hashlib
from typing import TYPE_CHECKING, Any, Final

from flinders.report.colours import variables
from flinders.report.script import asset

if TYPE_CHECKING:
    from collections.abc import Mapping

SHEETS: Final = ("figure.css", "report.css")
"""Style sheets of every report."""


def html_file(template: str, given: Mapping[str, Any], *, style: str, script: str, filters: Mapping[str, Any]) -> str:
    """Fill in a template of this package.

    Parameters
    ----------
    template : str
        Name of its file.
    given : mapping of str to Any
        What it takes by name, besides `style`, `script` and their hashes.
    style, script : str
        What the page may use, and nothing else.
    filters : mapping of str to function
        How it writes numbers.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flinders.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    return environment.get_template(template).render(**given, style=style, script=script, **hashes) + "\n"


def style_of(*sheets: str) -> str:
    """Style sheets after those of every report, with the colours of both themes; paper is always light."""
    light, dark = variables("light"), variables("dark")
    rules = "\n".join(asset(sheet) for sheet in (*SHEETS, *sheets))
    return (
        f"\n:root {{ {light} }}\n"
        f'@media screen and (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
        f'@media screen {{ :root[data-theme="dark"] {{ {dark} }} }}\n{rules}'
    )


def _hash(text: str) -> str:
    """As a Content-Security-Policy names what may run."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
