"""The messages of the live page as TypeScript.

``python -m tests.message_types > src/flinders/apps/live/static/wire.d.ts`` writes them.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from typing import Any, Final, Literal, Union

from flinders.apps.live.messages import FromServer


def typescript() -> str:
    """The messages as types for the page: ``static/wire.d.ts``."""
    declared: dict[str, str] = {}
    for kind in typing.get_args(FromServer):
        _declare(kind, declared)
    sent = " | ".join(kind.__name__ for kind in typing.get_args(FromServer))
    head = "// Generated from flinders/apps/live/messages.py: python -m tests.message_types > wire.d.ts\n"
    return "\n".join([head, *declared.values(), f"export type FromServer = {sent};\n"])


def _declare(kind: Any, declared: dict[str, str]) -> None:  # noqa: ANN401 - a struct or a dataclass
    """Declare a struct, after those that it holds."""
    if kind.__name__ in declared:
        return
    declared[kind.__name__] = ""
    is_struct = hasattr(kind, "__struct_config__")
    tag = kind.__struct_config__.tag if is_struct else None
    names = kind.__struct_fields__ if is_struct else [field.name for field in dataclasses.fields(kind)]
    lines = [f'  type: "{tag}";'] if tag else []
    hints = typing.get_type_hints(kind)
    may_lack = "" if is_struct else "?"  # a page need not say what has a default
    lines += [f"  {name}{may_lack}: {_type(hints[name], declared)};" for name in names]
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
