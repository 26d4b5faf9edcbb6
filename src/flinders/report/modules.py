r"""Modules of the page as one script for a self-contained file: no server, no second file, no request.

A page that is opened from a disk cannot import modules, so its modules are joined when a report is written: each
becomes a function that is called once and returns its exports. Our modules use the two plainest forms of import and
export; `join_modules` refuses any other form. Normally a bundle is used instead, which is a third as large; esbuild
makes it when Flinders is installed (``hatch_build.py``). While modules are being edited, they are joined.

Files are named by their paths in the package `flinders`: ``static/report.js`` belongs to the library,
``apps/live/static/live.js`` to an app.

>>> bundle_of("apps/live/static/standalone/main.js")
'apps/live/static/bundled/main.js'

>>> wrapped = _wrap_module("m1", 'import { a as b } from "./x.js";\nexport const c = b + 1;\n', {"./x.js": "m0"})
>>> print(wrapped)
const m1 = (() => {
const { a: b } = m0;
const c = b + 1;
return { c };
})();
"""

from __future__ import annotations

import contextlib
import hashlib
import posixpath
import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).resolve().parent.parent
BUNDLE_FOLDER: Final = "bundled"
"""Folder for bundles inside a ``static`` folder."""


def headline(package: Path = PACKAGE) -> str:
    """The first line of a bundle: a hash of the modules in it."""
    digest = hashlib.sha256()
    for path in sorted([*package.glob("static/**/*.js"), *package.glob("apps/*/static/**/*.js")]):
        if path.parent.name != BUNDLE_FOLDER:
            digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return f"/* of sha256:{digest.hexdigest()} */\n"


_headline = cache(headline)


def bundle_of(entry: str) -> str:
    """Path of the bundle for a module, in the static folder of that module."""
    folder, static, module = entry.rpartition("static/")
    return f"{folder}{static}{BUNDLE_FOLDER}/{posixpath.basename(module)}"


@cache
def script(entry: str, *, exported: tuple[str, ...] = ()) -> str:
    """A module with all its imports as one script: its bundle, if that is up to date, else joined modules."""
    with contextlib.suppress(FileNotFoundError):
        text = asset(bundle_of(entry))
        if text.startswith(_headline()):
            return text
    return join_modules(entry, exported=exported)


IMPORT: Final = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"([^"]+)";', re.MULTILINE)
EXPORT: Final = re.compile(r"^export (?=(?:async )?(?:function\*?|class|const) (\w+))", re.MULTILINE)
EXPORT_LIST: Final = re.compile(r"\bexport\s*\{([^{}]*)\};?\s*\Z")
"""The list of exports at the end of a bundle that esbuild has made."""
OTHER_FORM: Final = re.compile(r"^(?:import|export)\b|^\s*export\s*(?:\{|default\b)", re.MULTILINE)
WAITS: Final = re.compile(r"^(?:if \(.*\) )?await ", re.MULTILINE)
"""A line that waits at the top level of a module."""
UNSAFE_TEXT: Final = re.compile(r"</script|<!--", re.IGNORECASE)
"""Text that would end a script inside a page, or change its meaning."""


class NotJoined(Exception):
    """A module with a form of import or export that cannot be joined: a mistake in Flinders, which a test finds."""


@cache
def join_modules(entry: str = "static/report.js", *, exported: tuple[str, ...] = ()) -> str:
    """Join a module and all its imports into the text of one module script, once per process.

    The script exports the names in `exported`, so that a page can import them.

    Raises `NotJoined` for a module with another form of import or export, and `FileNotFoundError` for a missing module,
    such as ``vendor/three.js`` if Flinders was installed without the 3-D view.
    """
    names: dict[str, str] = {}
    parts: list[str] = []
    _join(entry, names, parts)
    if exported:
        parts.append(f"export const {{ {', '.join(exported)} }} = {names[entry]};\n")
    return "\n".join(parts)


def asset(path: str) -> str:
    """The text of a file of `flinders`.

    Raises `FileNotFoundError` if it is missing.
    """
    return files("flinders").joinpath(*path.split("/")).read_text(encoding="utf-8")


def _join(path: str, names: dict[str, str], parts: list[str]) -> None:
    """Append a module, after its imports."""
    text = asset(path)
    if UNSAFE_TEXT.search(text):
        raise NotJoined(f"{path} holds the end of a script")
    inside = {}
    for match in IMPORT.finditer(text):
        other = posixpath.normpath(posixpath.join(posixpath.dirname(path), match[2]))
        if other not in names:
            _join(other, names, parts)
        inside[match[2]] = names[other]
    names[path] = f"m{len(names)}"
    parts.append(_wrap_module(names[path], text, inside))


def _wrap_module(name: str, text: str, inside: dict[str, str]) -> str:
    """A module as a function that is called at once.

    Raises `NotJoined` for another form of import or export.
    """
    exported = [f"{match[1]}" for match in EXPORT.finditer(text)]
    body = IMPORT.sub(lambda match: f"const {{{match[1].replace(' as ', ': ')}}} = {inside[match[2]]};", text)
    body = EXPORT.sub("", body)
    listed = EXPORT_LIST.search(body)
    if listed:
        pairs = (pair.split(" as ") for pair in listed[1].split(","))
        exported += [f"{pair[-1].strip()}: {pair[0].strip()}" for pair in pairs]
        body = body[: listed.start()]
    left = OTHER_FORM.search(body)
    if left:
        raise NotJoined(f"{name}: {body[left.start() :][:60]!r} is a form that is not joined")
    opening = "await (async () => {" if WAITS.search(body) else "(() => {"
    return f"const {name} = {opening}\n{body.strip()}\nreturn {{ {', '.join(exported)} }};\n}})();"
