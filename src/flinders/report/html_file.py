r"""A report as one HTML file: template, style sheet and script in one, with a policy that lets nothing else run.

What comes from files, such as names and comments, is escaped; of a script the policy of the page names the hash.

>>> style_of("fleet.css").strip()[:25]
':root { --paper: #f4f6f8;'

Modules of the page become one script that a file can hold: no server, no second file, no request. A page that is opened
from a disk cannot import modules, so they are joined when a report is written: each becomes a function that is called
once and returns what it exports. Our modules use the two plainest forms of import and export, and `joined` refuses any
other. The live page gets its modules joined too, since a browser asks for them one by one.

>>> wrapped = _wrapped("m1", 'import { a as b } from "./x.js";\nexport const c = b + 1;\n', {"./x.js": "m0"})
>>> print(wrapped)
const m1 = (() => {
const { a: b } = m0;
const c = b + 1;
return { c };
})();
"""

from __future__ import annotations

import base64
import hashlib
import posixpath
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from flinders.report.colours import variables

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import jinja2

SHEETS: Final = ("figure.css", "report.css")
"""Style sheets of every report."""


def html_file(template: str, given: Mapping[str, Any], *, style: str, script: str, filters: Mapping[str, Any]) -> str:
    """Fill in a template of this package that is a page.

    `style` and `script` are what the page may use, and nothing else; `filters` say how it writes numbers.
    """
    hashes = {"style_hash": _hash(style), "script_hash": _hash(script)}
    return filled(template, {**given, "style": style, "script": script, **hashes}, filters) + "\n"


def filled(template: str, given: Mapping[str, Any], filters: Mapping[str, Callable[..., Any]]) -> str:
    """Fill in a template of this package; what stands in HTML is escaped."""
    return _compiled(template, *filters.items()).render(**given)


@cache
def _compiled(template: str, *filters: tuple[str, Callable[..., Any]]) -> jinja2.Template:
    """A template of this package with its filters, which takes longer to compile than to fill in."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flinders.report"),
        autoescape=jinja2.select_autoescape(["html.j2"]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    return environment.get_template(template)


def style_of(*sheets: str) -> str:
    """Style sheets after those of every report, with the colours of both themes; paper is always light."""
    light, dark = variables("light"), variables("dark")
    rules = "\n".join(asset(sheet) for sheet in (*SHEETS, *sheets))
    return (
        f"\n:root {{ {light} }}\n"
        f'@media screen and (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
        f'@media screen {{ :root[data-theme="dark"] {{ {dark} }} }}\n{rules}'
    )


def script_of() -> str:
    """The script of a page without a 3-D view."""
    return f"\n{joined('plain.js')}\nm0.theming(() => {{}});\n"


def _hash(text: str) -> str:
    """As a Content-Security-Policy names what may run."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


# ------------------------------------------------------------------------------------ modules of the page in one script

IMPORT: Final = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"([^"]+)";', re.MULTILINE)
EXPORT: Final = re.compile(r"^export (?=(?:async )?(?:function\*?|class|const) (\w+))", re.MULTILINE)
LIST: Final = re.compile(r"\bexport\s*\{([^{}]*)\};?\s*\Z")
"""The list at the end of a bundle of esbuild."""
LEFT: Final = re.compile(r"^(?:import|export)\b|^\s*export\s*(?:\{|default\b)", re.MULTILINE)
UNSAFE: Final = re.compile(r"</script|<!--", re.IGNORECASE)
"""What would end, or change the meaning of, a script inside a page."""


class NotJoined(Exception):
    """A module is written in a form that cannot be joined; that is a mistake of ours, which a test finds."""


@cache
def joined(entry: str = "report.js", *, exported: tuple[str, ...] = ()) -> str:
    """Join a module of ``static`` and all that it imports into the text of one module script, once in a process.

    The script exports what is named in `exported` of what the module does; a page imports that by name.

    Raises `FileNotFoundError` where a module is missing, as ``vendor/three.js`` is where Flinders was installed without
    the 3-D view; `NotJoined` for a module that imports or exports in another form.
    """
    names: dict[str, str] = {}
    parts: list[str] = []
    _join(entry, names, parts)
    if exported:
        parts.append(f"export const {{ {', '.join(exported)} }} = {names[entry]};\n")
    return "\n".join(parts)


def asset(path: str) -> str:
    """The text of a file of ``static``.

    Raises `FileNotFoundError`.
    """
    return files("flinders").joinpath("static", *path.split("/")).read_text(encoding="utf-8")


def _join(path: str, names: dict[str, str], parts: list[str]) -> None:
    """Add a module, after those that it imports."""
    text = asset(path)
    if UNSAFE.search(text):
        raise NotJoined(f"{path} holds the end of a script")
    inside = {}
    for match in IMPORT.finditer(text):
        other = posixpath.normpath(posixpath.join(posixpath.dirname(path), match[2]))
        if other not in names:
            _join(other, names, parts)
        inside[match[2]] = names[other]
    names[path] = f"m{len(names)}"
    parts.append(_wrapped(names[path], text, inside))


def _wrapped(name: str, text: str, inside: dict[str, str]) -> str:
    """A module as a function that is called at once.

    Raises `NotJoined`.
    """
    exported = [f"{match[1]}" for match in EXPORT.finditer(text)]
    body = IMPORT.sub(lambda match: f"const {{{match[1].replace(' as ', ': ')}}} = {inside[match[2]]};", text)
    body = EXPORT.sub("", body)
    listed = LIST.search(body)
    if listed:
        pairs = (pair.split(" as ") for pair in listed[1].split(","))
        exported += [f"{pair[-1].strip()}: {pair[0].strip()}" for pair in pairs]
        body = body[: listed.start()]
    left = LEFT.search(body)
    if left:
        raise NotJoined(f"{name}: {body[left.start() :][:60]!r} is a form that is not joined")
    return f"const {name} = (() => {{\n{body.strip()}\nreturn {{ {', '.join(exported)} }};\n}})();"
