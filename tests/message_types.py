"""The messages of the live page as TypeScript.

``python -m tests.message_types > src/flinders/static/messages.d.ts`` writes them.
"""

from __future__ import annotations

import types
import typing
from typing import Any, Final, Literal, Union

from flinders.live.messages import Command, FitMessage, Hello, Notice, SessionState

if typing.TYPE_CHECKING:
    from msgspec import Struct


def typescript() -> str:
    """The messages as types for the page: ``static/messages.d.ts``."""
    declared: dict[str, str] = {}
    for kind in (Hello, SessionState, FitMessage, Notice, *typing.get_args(Command)):
        _declare(kind, declared)
    sent = " | ".join(kind.__name__ for kind in (Hello, SessionState, FitMessage, Notice))
    commands = " | ".join(kind.__name__ for kind in typing.get_args(Command))
    head = "// Generated from flinders/live/messages.py: python -m tests.message_types > messages.d.ts\n"
    unions = f"export type FromServer = {sent};\n\nexport type ToServer = {commands};\n"
    return "\n".join([head, *declared.values(), unions])


def _declare(kind: type[Struct], declared: dict[str, str]) -> None:
    """Declare a struct, after those that it holds."""
    if kind.__name__ in declared:
        return
    declared[kind.__name__] = ""
    tag = kind.__struct_config__.tag
    lines = [f'  type: "{tag}";'] if tag else []
    hints = typing.get_type_hints(kind)
    lines += [f"  {name}: {_type(hints[name], declared)};" for name in kind.__struct_fields__]
    comment = (kind.__doc__ or "").partition("\n")[0]
    del declared[kind.__name__]
    declared[kind.__name__] = f"/** {comment} */\nexport interface {kind.__name__} {{\n" + "\n".join(lines) + "\n}\n"


PLAIN: Final = {bool: "boolean", int: "number", float: "number", str: "string", type(None): "null"}


def _type(hint: Any, declared: dict[str, str]) -> str:  # noqa: ANN401 - a type, whatever its kind
    """One type as TypeScript has it; a tuple of fixed length stays one."""
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if hint in PLAIN:
        return PLAIN[hint]
    if origin in (Union, types.UnionType):
        return " | ".join(_type(one, declared) for one in inside)
    if origin is Literal:
        return " | ".join(f'"{one}"' for one in inside)
    if origin is tuple and inside[-1] is Ellipsis:
        return f"Array<{_type(inside[0], declared)}>"
    if origin is tuple:
        return f"[{', '.join(_type(one, declared) for one in inside)}]"
    _declare(hint, declared)
    return str(hint.__name__)


if __name__ == "__main__":
    print(typescript(), end="")  # noqa: T201
