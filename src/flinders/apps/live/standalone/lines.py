r"""Line formats of boards and tables as data for ``static/standalone/``: patterns, words, units and limits.

Exports the constants of the text readers whose names occur in JavaScript, so that a change in Python changes both
languages. Patterns are converted to JavaScript's syntax.

>>> in_javascript(re.compile(r"(?P<axis>[xyz])\s*\W?(?=[^\W\d_])", re.IGNORECASE))
{'pattern': '(?<axis>[xyz])\\s*[^\\p{L}\\p{N}_]?(?=\\p{L})', 'flags': 'iu'}
"""

from __future__ import annotations

import dataclasses
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flinders.core import silence, units
from flinders.links import transcript
from flinders.readers import (
    _cells,
    _choice,
    _clock,
    _column_choice,
    _columns,
    _columns_by_name,
    _columns_by_place,
    _delimiters,
    _devices,
    _foreign_files,
    _grid,
    _header,
    _instruments,
    _layout,
    _lines,
    _names,
    _recognition,
    _refusals,
    _times,
    _tokenizer,
    registry,
)
from flinders.readers.dialects import json_records, labelled, marked, wrapped

if TYPE_CHECKING:
    from types import ModuleType

MODULES: Final = {
    "units": (units,),
    "silence": (silence,),
    "names": (_names, _instruments, _choice),
    "tokenizer": (_tokenizer, _cells, _grid, _lines),
    "clock": (_clock,),
    "columns": (_columns, _columns_by_name, _columns_by_place, _times, _column_choice),
    "devices": (_devices,),
    "layout": (_layout, _delimiters, _header, _recognition, _refusals),
    "marked": (marked,),
    "json": (json_records,),
    "wrapped": (wrapped,),
    "labelled": (labelled,),
    "transcript": (transcript,),
}
"""Modules whose constants are exported, by key."""

_WORD: Final = r"\p{L}\p{N}_"
_EDGE: Final = rf"(?:(?<=[{_WORD}])(?![{_WORD}])|(?<![{_WORD}])(?=[{_WORD}]))"
_TOKENS: Final = re.compile(
    r"\(\?(?P<flags>[a-z]+)\)|\(\?P<(?P<name>\w+)>|\[\^\\W\\d_\](?P<letter>)|\[\\W\\d_\](?P<no_letter>)"
    r"|\[(?P<inside>\^?(?:\\.|[^\\\]])+)\]|\\(?P<escaped>.)|(?P<closing>[\]}])|(?P<count>\{\d+(?:,\d*)?\})",
    re.DOTALL,
)
"""Tokens with another spelling in JavaScript with the flag ``u``."""
_ESCAPE: Final = re.compile(r"\\(.)")
_KINDS: Final = {"w": f"[{_WORD}]", "W": f"[^{_WORD}]", "b": _EDGE, "A": "^", "Z": "$"}
_SYNTAX: Final = frozenset(r"^$\.*+?()[]{}|/")


def data() -> dict[str, Any]:
    """Data for ``standalone/lines.js``."""
    return {**{key: constants(*modules) for key, modules in MODULES.items()}, "files": _files()}


@cache
def _names_in_javascript() -> frozenset[str]:
    """Names of constants that occur in the modules of the page."""
    modules = (Path(__file__).parents[1] / "static" / "standalone").glob("*.js")
    return frozenset(re.findall(r"\b_?[A-Z][A-Z0-9_]*\b", " ".join(path.read_text("utf-8") for path in modules)))


def constants(*modules: ModuleType) -> dict[str, Any]:
    """Constants of modules, by name, that occur in JavaScript and that JSON can hold."""
    wanted = _names_in_javascript()
    known = [pair for module in modules for pair in vars(module).items()]
    named = {name: value for name, value in known if name in wanted and _is_portable(value)}
    return {name: _json_value(value) for name, value in named.items()}


def in_javascript(pattern: re.Pattern[str]) -> dict[str, str]:
    """Convert a pattern to JavaScript, with Unicode letters and digits in words."""
    known = {"i": re.IGNORECASE, "m": re.MULTILINE, "s": re.DOTALL}
    flags = "".join(letter for letter, flag in known.items() if pattern.flags & flag)
    return {"pattern": _TOKENS.sub(_token, pattern.pattern), "flags": f"{flags}u"}


def _token(match: re.Match[str]) -> str:
    """Convert one token of a pattern to JavaScript."""
    token, kind = match[0], match.lastgroup
    if kind == "flags":
        return ""
    if kind == "name":
        return f"(?<{match['name']}>"
    if kind in ("letter", "no_letter"):
        return r"\p{L}" if kind == "letter" else r"\P{L}"
    if kind == "inside":
        return f"[{_ESCAPE.sub(_inside, match['inside'])}]"
    if kind == "escaped":
        return _KINDS.get(match["escaped"]) or _remove_escape(token, _SYNTAX)
    return f"\\{token}" if kind == "closing" else token


def _inside(match: re.Match[str]) -> str:
    """Convert an escape in a set of characters to JavaScript."""
    return _WORD if match[1] == "w" else _remove_escape(match[0], _SYNTAX | {"-"})


def _remove_escape(token: str, syntax: frozenset[str]) -> str:
    """Remove an escape that JavaScript forbids: that of a character without a meaning in patterns."""
    return token if token[1] in syntax or token[1].isalnum() else token[1]


def _is_portable(value: object) -> bool:
    """Whether JSON can hold a constant; patterns and rows of dialects are written as objects."""
    if isinstance(value, dict):
        return all(isinstance(key, str | int) for key in value) and all(map(_is_portable, value.values()))
    if isinstance(value, tuple | frozenset):
        return all(map(_is_portable, value))
    if isinstance(value, re.Pattern):
        return isinstance(value.pattern, str)
    return isinstance(value, str | int | float | marked.Marked) and not isinstance(value, bool)


def _json_value(value: Any) -> Any:  # noqa: ANN401 - as JSON
    """Convert a constant to a value that JSON can hold."""
    if isinstance(value, re.Pattern):
        return in_javascript(value)
    if isinstance(value, marked.Marked):
        own = {each.name: getattr(value, each.name) for each in dataclasses.fields(value) if each.init}
        return _json_value(own)
    if isinstance(value, dict):
        return {key: _json_value(member) for key, member in value.items()}
    if isinstance(value, frozenset):
        return sorted(map(_json_value, value))
    return list(map(_json_value, value)) if isinstance(value, tuple) else value


def _files() -> dict[str, Any]:
    """Types of files by suffix and first bytes: recordings that the program reads, and other files."""
    rows = [row for row in registry() if row.name != "text"]
    return {
        "suffixes": {suffix: row.title for row in rows for suffix in row.suffixes if suffix not in (".log", ".zip")},
        "starts": {start.hex(): row.title for row in rows for start in row.starts if len(start) > 1},
        "others": {start.hex(): list(kind) for start, kind in _foreign_files.MAGIC.items()},
        "controls": list(_foreign_files.CONTROLS),
        "most_controls": _foreign_files.MAX_CONTROL_SHARE,
        "pages": {start.decode(): name for start, name in _foreign_files.PAGES.items()},
    }
