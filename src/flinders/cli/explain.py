"""``flinders explain``: meaning of the code of a finding or an error, and what to do."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_result


class Explain(program.Group):
    """The code to explain."""

    code: str = program.argument("CODE")
    as_json: bool = option.as_json()


@program.command_of(
    "explain",
    Explain,
    epilog="""\b
Example:
  flinders explain coverage
  flinders explain unmoved --json
""",
)
def command(options: Explain) -> None:
    """Explain the code of a finding or an error: the word in brackets after it."""
    from flinders.findings.explanation import explain
    from flinders.report.terminal import facts

    told = explain(options.code.strip("[]`"))
    rows = [
        ("code", told.code),
        ("means", told.meaning),
        ("verdict", told.verdict),
        ("N", told.number),
        ("limit", told.limit),
        ("what to do", told.action),
        ("more", told.anchor),
    ]
    print_result(told.as_dict, lambda: facts([row for row in rows if row[1]]), as_json=options.as_json)
