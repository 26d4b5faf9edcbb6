"""HTML of calibrations and fits for notebooks: a small table without scripts, colours or sizes.

The functions take plain numbers only; `Calibration` and `flinders.report.notebook` call them.

>>> html = correction_html([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, -3.0], "µT", title="<b>")
>>> "&lt;b&gt;" in html, "−3" in html, "<script" in html
(True, True, False)
>>> number_text(28.5571, 0.0432), number_text(-3.0, None)
('28.557 ± 0.043', '−3')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

SEVERITY_SIGNS: Final = {"good": "✓", "limited": "!", "refused": "✗", "note": "·", "limits": "!", "refuses": "✗"}
"""Sign before a verdict or a finding, which shows its severity without colour."""


def correction_html(
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
    """HTML of a (3, 3) matrix and a (3,) offset with its optional standard deviations, in `unit`.

    `terms` are the (3,) terms of a linearization by their names. `words` are lines below the title. All text is
    escaped except `pictures`, which is HTML.
    """
    sigmas = [None] * 3 if offset_sigma is None else list(offset_sigma)
    terms = terms or {}
    curves = list(zip(*terms.values(), strict=True)) or [()] * 3
    rows = "".join(
        f"<tr><th>{axis}</th><td>{number_text(value, sigma)}</td>{_row_html(row)}"
        f"{''.join(f'<td>{number_text(term, None)}</td>' for term in curve)}</tr>"
        for axis, value, sigma, row, curve in zip("xyz", offset, sigmas, matrix, curves, strict=True)
    )
    more = "".join(f"<th>{_escape(name)}</th>" for name in terms)
    head = f'<tr><td></td><th>offset, {_escape(unit)}</th><th colspan="3">matrix</th>{more}</tr>'
    formula = (
        "corrected = matrix · (d − (quadratic + cubic · d) · d²), d = raw − offset; constant correction beyond limit"
        if terms
        else ""
    )
    words = [*words, formula or "corrected = matrix · (raw − offset)"]
    return f"{_title_html(title, words)}{pictures}<table><thead>{head}</thead><tbody>{rows}</tbody></table></div>"


def text_html(title: str, words: Iterable[str]) -> str:
    """HTML of a title and lines of text, without numbers."""
    return f"{_title_html(title, words)}</div>"


def html_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], words: Iterable[str] = ()) -> str:
    """HTML table of words below headings; the first word of each row is the heading of the row.

    >>> html_table("two", ["", "n"], [["a", "1"]])
    '<div><p><b>two</b></p><table><thead><tr><th></th><th>n</th></tr></thead><tbody>...</tbody></table></div>'
    """
    head = "".join(f"<th>{_escape(name)}</th>" for name in headings)
    body = "".join(
        f"<tr><th>{_escape(first)}</th>{''.join(f'<td>{_escape(word)}</td>' for word in others)}</tr>"
        for first, *others in rows
    )
    return f"{_title_html(title, words)}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


def text_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Text table of words below headings, with a line for each row.

    >>> print(text_table(["method", "n"], [["a", "12"]]))
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


def number_text(value: float, sigma: float | None) -> str:
    """Write a number to the second digit of its standard deviation; to six digits without one."""
    if sigma is None or not (math.isfinite(sigma) and sigma > 0.0):
        return _with_minus_signs(f"{value:.6g}")
    digits = min(max(0, 1 - math.floor(math.log10(sigma))), 9)
    return _with_minus_signs(f"{round(value, digits) + 0.0:.{digits}f} ± {sigma:.{digits}f}")


def _row_html(row: Iterable[float]) -> str:
    return "".join(f"<td>{_with_minus_signs(format(entry, '.6f'))}</td>" for entry in row)


def _title_html(title: str, words: Iterable[str]) -> str:
    lines = "".join(f"<br>{_escape(line)}" for line in words)
    return f"<div><p><b>{_escape(title)}</b>{lines}</p>"


def _escape(text: str) -> str:
    """Escape text for HTML; the module `html` is imported at the first use."""
    from html import escape

    return escape(text)


def _with_minus_signs(number: str) -> str:
    """Replace hyphens by minus signs, which are as wide as a plus."""
    return number.replace("-", "−")
