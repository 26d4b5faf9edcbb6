"""The certificate of a swing as one HTML file: conformity with a limit, the deviation card, and fields to sign.

>>> from flinders.apps.marine.deviation import fit
>>> from flinders.apps.marine.swing_result import Swing
>>> from flinders.apps.marine.swing_words import SwingAccount
>>> curve = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> text = certificate(SwingAccount(Swing(curve), step_deg=45.0))
>>> text.startswith("<!doctype html>"), text.count("<tr>"), "Signature" in text
(True, 16, True)
"""

from __future__ import annotations

import base64
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Final

from flinders.apps.marine.drawing import swing_drawing
from flinders.apps.marine.swing_words import TITLES
from flinders.errors import UsageError
from flinders.findings.words import as_sentence
from flinders.report.formatting import minus
from flinders.report.html_file import html_file, script_of, style_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.apps.marine.swing_result import Swing
    from flinders.apps.marine.swing_words import Statement, SwingAccount

FIELDS: Final = ("Place and date", "Swung by, licence", "Reference of headings", "Next swing due", "Signature")
"""Fields that are filled in by hand."""

VERDICT_ORDER: Final = ("refused", "limited", "good")
"""Verdicts, the gravest first."""


def certificate(account: SwingAccount, facts: Mapping[str, str] | None = None) -> str:
    """HTML of the certificate of a swing; raises `UsageError` for a swing without a curve.

    Parameters
    ----------
    account : SwingAccount
        The swing with its statements; its uncertainty includes the error of the compass base.
    facts : mapping of str to str, optional
        Further facts, such as vehicle and compass.
    """
    swing = account.swing
    if swing.deviation is None:
        raise UsageError("a certificate needs the curve of a swing: give the known headings")
    drawing = base64.b64encode(swing_drawing(swing.deviation).encode()).decode()
    first, *others = sorted(account.statements, key=_statement_order)
    site = {} if swing.site is None else {"Declination": str(swing.site)}
    table, card = account.coefficients(swing.deviation), account.card(swing.deviation)
    (_, *columns, _), rows = table, zip(*table.values(), strict=True)
    given = {
        "outcome": {"verdict": first.verdict, "title": first.title, "sentence": as_sentence(first.words)},
        "what": "Compass swing",
        "numbers": (),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "release": version("flinders"),
        "facts": {**(facts or {}), **_rule_facts(swing), **site},
        "others": [(one, as_sentence(one.words)) for one in others],
        "notes": [(kind, as_sentence(words)) for kind, words in _notes(account)],
        "columns": columns,
        "coefficients": [(name, meaning, cells) for name, *cells, meaning in rows],
        "halves_of_card": [half for half in (card[: -(-len(card) // 2)], card[-(-len(card) // 2) :]) if half],
        "drawing": f"data:image/svg+xml;base64,{drawing}",
        "fields": FIELDS,
    }
    template, style = "apps/marine/certificate.html.j2", style_of("apps/marine/certificate.css")
    return html_file(template, given, style=style, script=script_of(), filters={"minus": minus})


def _statement_order(statement: Statement) -> tuple[int, bool]:
    """Sort key of statements: the gravest first, and of equal ones the statement on the limit first."""
    return VERDICT_ORDER.index(statement.verdict), statement.title not in TITLES.values()


def _notes(account: SwingAccount) -> list[tuple[str, str]]:
    """Kind and words of notes: limits of the swing first, then other notes."""
    logged = account.swing.logged
    said = [note for one in account.statements for note in one.notes]
    said += [("note", str(note)) for note in (*(logged.notes if logged else ()), *account.rule_notes)]
    return sorted(said, key=lambda note: note[0] != "limits")


def _rule_facts(swing: Swing) -> dict[str, str]:
    """Rule, limit, and the texts of the rule from which they were taken."""
    limit = {} if swing.conformity is None else {"Limit": f"{swing.conformity.limit_deg:g}° on any heading"}
    if swing.rule is None:
        return limit
    return {"Rule": swing.rule.title, **limit, "Seen of the rule": "; ".join(swing.rule.sources)}
