"""Calibrations and fits as a notebook shows them: a small table, without a script, a colour or a size of its own.

This knows plain numbers only, and so lies below what it shows; `Calibration` and `flinders.report.notebook` call it.

>>> told = correction([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, -3.0], "µT", title="<b>")
>>> "&lt;b&gt;" in told, "−3" in told, "<script" in told
(True, True, False)
>>> measured(28.5571, 0.0432), measured(-3.0, None)
('28.557 ± 0.043', '−3')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

SIGNS: Final = {"good": "✓", "limited": "!", "refused": "✗", "note": "·", "limits": "!", "refuses": "✗"}
"""What stands before a verdict or a finding, so that colour need not."""


def correction(
    matrix: Sequence[Sequence[float]],
    offset: Sequence[float],
    unit: str,
    *,
    title: str,
    words: Iterable[str] = (),
    offset_sigma: Sequence[float] | None = None,
    terms: Mapping[str, Sequence[float]] | None = None,
    pictures: str = "",
) -> str:
    """Lay out a (3, 3) matrix and a (3,) offset with its optional standard deviations, in `unit`, as HTML.

    And (3,) `terms` of a linearization by their names, with the formula that holds then.

    Below the title stand `words`, a line each; all text but the HTML of `pictures` is escaped.
    """
    sigmas = [None] * 3 if offset_sigma is None else list(offset_sigma)
    terms = terms or {}
    curves = list(zip(*terms.values(), strict=True)) or [()] * 3
    rows = "".join(
        f"<tr><th>{axis}</th><td>{measured(value, sigma)}</td>{_cells(row)}"
        f"{''.join(f'<td>{measured(term, None)}</td>' for term in curve)}</tr>"
        for axis, value, sigma, row, curve in zip("xyz", offset, sigmas, matrix, curves, strict=True)
    )
    more = "".join(f"<th>{_escaped(name)}</th>" for name in terms)
    head = f'<tr><td></td><th>offset, {_escaped(unit)}</th><th colspan="3">matrix</th>{more}</tr>'
    formula = (
        "corrected = matrix · (d − (quadratic + cubic · d) · d²), d = raw − offset, held at limit" if terms else ""
    )
    words = [*words, formula or "corrected = matrix · (raw − offset)"]
    return f"{_head(title, words)}{pictures}<table><thead>{head}</thead><tbody>{rows}</tbody></table></div>"


def refusal(title: str, words: Iterable[str]) -> str:
    """Lay out what has no numbers to show."""
    return f"{_head(title, words)}</div>"


def as_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], words: Iterable[str] = ()) -> str:
    """Lay out rows of words below headings, the first of each row as its heading.

    >>> as_table("two", ["", "n"], [["a", "1"]])
    '<div><p><b>two</b></p><table><thead><tr><th></th><th>n</th></tr></thead><tbody>...</tbody></table></div>'
    """
    head = "".join(f"<th>{_escaped(name)}</th>" for name in headings)
    body = "".join(
        f"<tr><th>{_escaped(first)}</th>{''.join(f'<td>{_escaped(word)}</td>' for word in others)}</tr>"
        for first, *others in rows
    )
    return f"{_head(title, words)}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def in_columns(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows of words below headings as text, a line for each row.

    >>> print(in_columns(["method", "n"], [["a", "12"]]))
    method   n
    a       12
    """
    table = [headings, *rows]
    first, *widths = (max(map(len, column)) for column in zip(*table, strict=True))
    lines = (
        "  ".join([name.ljust(first), *(word.rjust(width) for word, width in zip(others, widths, strict=True))])
        for name, *others in table
    )
    return "\n".join(line.rstrip() for line in lines)


def measured(value: float, sigma: float | None) -> str:
    """Write a number to the second digit of its standard deviation; to six digits where there is none."""
    if sigma is None or not (math.isfinite(sigma) and sigma > 0.0):
        return _signed(f"{value:.6g}")
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), 9)
    return _signed(f"{round(value, digits) + 0.0:.{digits}f} ± {sigma:.{digits}f}")


def _cells(row: Iterable[float]) -> str:
    return "".join(f"<td>{_signed(format(entry, '.6f'))}</td>" for entry in row)


def _head(title: str, words: Iterable[str]) -> str:
    lines = "".join(f"<br>{_escaped(line)}" for line in words)
    return f"<div><p><b>{_escaped(title)}</b>{lines}</p>"


def _escaped(text: str) -> str:
    """As HTML, which is imported where something is displayed."""
    from html import escape

    return escape(text)


def _signed(number: str) -> str:
    """With the sign that is as wide as a plus."""
    return number.replace("-", "−")
