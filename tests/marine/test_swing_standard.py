"""`flinders swing` by a rule: worked examples to their printed digits, limits, what to turn, certificates."""

from __future__ import annotations

import html
import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from rich.console import Console
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

from flinders.apps.marine.certificate import certificate
from flinders.apps.marine.compensation import compensation
from flinders.apps.marine.deviation import common_error, conformity, fit
from flinders.apps.marine.standards import STANDARDS
from flinders.apps.marine.swing_notes import COMPENSATION_ADVICE, READING_ADVICE
from flinders.apps.marine.swing_pages import of_swing
from flinders.apps.marine.swing_result import Swing
from flinders.apps.marine.swing_words import SwingAccount
from flinders.errors import FitError
from flinders.heading.harmonics import design
from flinders.heading.stationary import Rest, half_turns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.trials import Choose

CAP562 = (
    # magnetic and compass on N, E, S, W; B, C; made to read on S and on W; check swing from NW; A; residuals
    ((359, 91, 178, 267), (3, 85, 170, 265), (2, -6), (176, 263), (1, 2, 5, 4, 1, 2, 5, 4), 3),
    ((355, 92, 184, 272), (358, 92, 183, 266), (-3, -2), (185, 269), (2, 1, 2, 3, 2, 1, 2, 3), 2),
    ((2, 88, 182, 268), (355, 84, 185, 272), (4, 5), (180, 268), (1, 2, 1, 0, 1, 2, 1, 0), 1),
)
"""Worksheets 1 to 3 of UK CAA CAP 562, as printed: whole degrees, deviation is magnetic less compass."""

CHECKED = (317, 0, 47, 93, 135, 179, 225, 273)
"""Magnetic headings of a check swing, about NW, N, NE … W."""


@pytest.mark.parametrize(("magnetic", "compass", "coefficients", "made", "check", "a"), CAP562)
def test_worksheets_of_cap_562(
    magnetic: Sequence[int],
    compass: Sequence[int],
    coefficients: Sequence[int],
    made: Sequence[int],
    check: Sequence[int],
    a: int,
) -> None:
    found = compensation(compass, np.subtract(magnetic, compass))
    assert [found.b_deg, found.c_deg] == list(coefficients)
    assert [row.make_deg for row in found.rows[2:]] == list(made)
    checked = compensation(np.subtract(CHECKED, check), check)
    assert checked.a_deg == a


def test_the_compass_correction_card_of_the_us_army() -> None:
    """TM 1-1500-204-23-4, figure 4-22: 008, 086, 176 and 278 become 002, 092, 182 and 272."""
    found = compensation([8, 86, 176, 278], [-8, 4, 4, -8])
    assert [row.make_deg for row in found.rows] == [2.0, 92.0, 182.0, 272.0]
    assert {row.left_deg for row in found.rows} == {-2.0}


def test_the_alignment_of_mil_std_765a() -> None:
    """Errors, compass less magnetic, +6, 0, −5 and +6 on N, E, S and W: corrections 5.5 and −3, index 1.75."""
    found = compensation([6, 90, 175, 276], [-6, 0, 5, -6])
    assert (-found.c_deg, -found.b_deg, -found.a_deg) == (5.5, -3.0, 1.75)
    assert (found.rows[0].make_deg, found.rows[1].change_deg) == (0.5, 3.0)


def test_a_correction_swing_needs_all_four_headings() -> None:
    with assert_raises(FitError, missing=("E", "W")):
        compensation([0, 45, 180, 225], [0, 0, 0, 0])


def test_a_curve_within_a_limit_is_so_with_two_standard_deviations_to_spare(trials: Choose) -> None:
    """Compasses at their limit, or beyond, are said to be within it in less than 5 % of swings."""
    claim, rng, around = trials(1000, 200), np.random.default_rng(5), np.arange(0.0, 360.0, 30.0)
    said = 0
    for noise in rng.standard_normal((claim.count, len(around))):
        curve = fit(around, design(around) @ [0.0, 10.0, 0.0, 0.0, 0.0] + 0.5 * noise, sigma_deg=0.5)
        said += conformity(curve, 10.0).verdict == "within"
    assert said <= 0.05 * claim.count


def test_the_error_of_the_base_is_one_of_a_and_in_every_uncertainty() -> None:
    around = np.arange(0.0, 360.0, 30.0)
    swing = fit(around, np.zeros(12), sigma_deg=0.5)
    wider = swing.widen(common_error(1.0))
    own, all_of_it = swing.sigma_at(around), wider.sigma_at(around)
    assert own is not None
    assert all_of_it is not None
    npt.assert_allclose(all_of_it**2, own**2 + 1.0)
    five = fit(around[:5] * 2.4, np.arange(5.0))
    assert five.widen(common_error(1.0)) is five


def test_uncertainties_with_the_error_of_a_base_are_true(trials: Choose) -> None:
    """z of the coefficients on bases that are off by 0.5°; where residuals are large by chance, σ is enlarged."""
    claim, rng, around = trials(1000, 200), np.random.default_rng(8), np.arange(0.0, 360.0, 45.0)
    scores = []
    for draw in rng.standard_normal((claim.count, 9)):
        curve = fit(around, 0.5 * draw[0] + 0.4 * draw[1:], sigma_deg=0.4).widen(common_error(0.5))
        assert curve.sigmas_deg is not None
        scores.append(curve.coefficients_deg / curve.sigmas_deg)
    npt.assert_allclose(np.mean(np.square(scores), axis=0), 0.9, atol=0.2 * claim.widening)


CORRECTION = "compass,magnetic\n3,359\n85,91\n170,178\n265,267\n"
CHECK = "compass,magnetic\n" + "".join(
    f"{(magnetic - off) % 360},{magnetic}\n" for magnetic, off in zip(CHECKED, CAP562[0][4], strict=True)
)


@pytest.fixture
def tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("correction.csv").write_text(CORRECTION, encoding="utf-8")
    Path("check.csv").write_text(CHECK, encoding="utf-8")


@pytest.mark.parametrize("name", STANDARDS)
def test_every_rule_has_a_checklist_and_names_what_was_seen(name: str) -> None:
    ended = flinders_("swing", "--standard", name)
    assert ended.code == 0
    assert " ".join(STANDARDS[name].title.split()) in " ".join(ended.out.split())
    assert "seen" in ended.out
    assert flinders_("swing", "--standard", name, "--json").json["sources"] == list(STANDARDS[name].sources)


@pytest.mark.usefixtures("tables")
def test_what_to_turn_is_said_of_a_correction_swing() -> None:
    ended = flinders_("swing", "correction.csv", "--compensate")
    assert ended.code == 0
    assert "176.0°" in ended.out
    assert flinders_("swing", "correction.csv", "--compensate", "--json").json["B_deg"] == 2.0


@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize(
    ("words", "code", "verdict"),
    [
        ("--standard ac43.13-1b", 0, "within"),
        ("--standard marshall-islands", 3, "beyond"),
        ("--limit 5.4", 3, "open"),
        ("--limit 6 --base-error 0.5", 3, "open"),
    ],
)
def test_a_limit_decides_how_the_command_ends(words: str, code: int, verdict: str) -> None:
    ended = flinders_("swing", "check.csv", *words.split(), "--json")
    assert (ended.code, ended.json["conformity"]["verdict"]) == (code, verdict)


@pytest.mark.usefixtures("tables")
def test_a_rule_whose_text_was_not_seen_gets_no_limit() -> None:
    ended = flinders_("swing", "check.csv", "--standard", "iso25862")
    assert "no limit was checked" in " ".join(ended.out.split())
    assert flinders_("swing", "check.csv", "--standard", "iso25862", "--json").json["conformity"] is None
    held = flinders_("swing", "check.csv", "--standard", "iso25862", "--limit", "3", "--json").json["conformity"]
    assert held["verdict"] == "beyond"


@pytest.mark.usefixtures("tables")
def test_a_certificate_has_the_card_both_swings_and_fields_to_sign() -> None:
    words = "swing check.csv --standard ac43.13-1b --before correction.csv --certificate c.html --base-error 0.1"
    ended = flinders_(*words.split(), "--subject", "N1 <standby>")
    assert ended.code == 0
    text = Path("c.html").read_text(encoding="utf-8")
    assert text.count("<td><strong>") == 12
    for part in ("Within the limit", "N1 &lt;standby&gt;", "−6.0°", "0.1° (1 σ)", "AC 43.13-1B", "Signature"):
        assert part in text


AROUND = np.arange(0.0, 360.0, 45.0)
WAVE = np.sin(np.deg2rad(AROUND))
SWINGS = {
    "within": (AROUND, 4.0 * WAVE + [0.1, 0, 0, -0.1, 0, 0.1, 0, 0], 5.0),
    "open": (AROUND, 4.0 * WAVE + [1.5, 0, -1.5, -2.0, 0, 1.5, 1.5, -1.0], 5.4),
    "beyond": (AROUND, 20.0 * WAVE + [0.1, 0, 0, -0.1, 0, 0.1, 0, 0], 10.0),
    "beyond, no card holds": (AROUND, 70.0 * WAVE + [0.1, 0, 0, -0.1, 0, 0.1, 0, 0], 10.0),
    "five headings": (AROUND[:5], 4.0 * WAVE[:5], 5.0),
    "a gap": (AROUND[:6], 4.0 * WAVE[:6] + [0.1, 0, 0, -0.1, 0, 0.1], 5.0),
    "without a limit": (AROUND, 4.0 * WAVE + [0.1, 0, 0, -0.1, 0, 0.1, 0, 0], None),
}


def account(name: str) -> SwingAccount:
    compass, deviation, limit = SWINGS[name]
    curve = fit(compass, deviation)
    sigma = np.full(len(compass), np.nan if curve.sigma_deg is None else curve.sigma_deg).tolist()
    rests = [Rest(place, place + 1, heading, sigma[place], 0.1) for place, heading in enumerate(compass.tolist())]
    swing = Swing(
        curve,
        halves=half_turns(rests, (compass + deviation).tolist()),
        rule=STANDARDS["solas"],
        conformity=None if limit is None else conformity(curve, limit),
        before=compensation(np.arange(0.0, 360.0, 90.0), [2.0, -1.5, 1.0, 0.25]),
    )
    return SwingAccount(swing, step_deg=30.0)


def flat(text: str) -> str:
    """Text without markup, in small letters, with single spaces and one kind of minus."""
    plain = html.unescape(re.sub(r"<(style|script)\b.*?</\1>|<[^>]+>", " ", text, flags=re.DOTALL))
    return " ".join(plain.replace("−", "-").casefold().split())


def on_terminal(swing: SwingAccount) -> str:
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(of_swing(swing))
    return flat(console.export_text())


@pytest.mark.parametrize("name", SWINGS)
def test_a_certificate_says_what_the_terminal_says(name: str) -> None:
    """Each verdict with its words, what limits it, each coefficient and each line of the card, once."""
    said_of = account(name)
    deviation = said_of.swing.deviation
    assert deviation is not None
    pages = on_terminal(said_of), flat(certificate(said_of))
    said = [one.words for one in said_of.statements]
    said += [words for one in said_of.statements for _, words in one.notes] + said_of.rule_notes
    for words in map(str.casefold, said):
        assert [page.count(words.replace("−", "-")) for page in pages] == [1, 1], words
    cells = [cell for column in said_of.coefficients(deviation).values() for cell in column]
    cells += [cell for row in said_of.card(deviation) for cell in (row.heading, row.deviation, row.sigma)]
    for cell in (*(one.title for one in said_of.statements), *cells):
        assert all(cell.casefold().strip() in page for page in pages), cell
    for advice in (READING_ADVICE, COMPENSATION_ADVICE):
        assert all(page.count(advice) <= 1 for page in pages), advice


def test_the_gravest_verdict_heads_a_certificate() -> None:
    head = re.compile(r'class="verdict" data-verdict="(\w+)".*?<h1[^>]*>([^<]+)', re.DOTALL)
    heads = {name: found.groups() for name in SWINGS for found in head.finditer(certificate(account(name)))}
    assert {name: verdict for name, (verdict, _) in heads.items()} == {
        "within": "good", "open": "refused", "beyond": "refused", "beyond, no card holds": "refused",
        "five headings": "limited", "a gap": "limited", "without a limit": "good",
    }  # fmt: skip
    assert_sentences(f"{name}: {words}" for name, (_, words) in heads.items())


MISTAKES = {
    "a subject of nothing": ("check.csv --subject boat", 2),
    "another ending": ("check.csv --certificate c.doc", 2),
    "a card of a compensation": ("correction.csv --compensate -o card.csv", 2),
    "two tables": ("check.csv correction.csv --compensate", 2),
    "no such rule": ("check.csv --standard iso1", 2),
    "a limit of nothing": ("check.csv --limit 0", 2),
    "too few headings": ("check.csv --before check.csv --limit 10", 0),
    "one of four is missing": ("short.csv --compensate", 4),
}


@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named(name: str) -> None:
    words, code = MISTAKES[name]
    Path("short.csv").write_text(CORRECTION.rsplit("265", 1)[0], encoding="utf-8")
    ended = flinders_("swing", *words.split())
    assert ended.code == code, ended.said
    assert_sentences(ended.said)
