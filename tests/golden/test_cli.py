"""What the program prints, to the letter; and the sessions in docs/cli/, which are those files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tests.golden.sessions import ROOT, assert_sessions_are_real, session
from tests.worlds import write_field

from flinders import simulate
from flinders.findings import CATALOGUE

if TYPE_CHECKING:
    import pytest
    from tests.golden.sessions import Golden

DOCS = ROOT / "docs"


def record(name: str, motion: str, *, axes: tuple[int, int, int] = (0, 1, 2)) -> None:
    """Write a simulated recording, its axes in another order where the sensor is mounted so."""
    field = simulate.tumble(seed=2, motion=motion).samples.field[:, axes]
    write_field(name, field)


def test_demo(golden: Golden) -> None:
    golden("cli/demo.txt", session("flinders demo"))


def test_a_good_calibration_applied(golden: Golden) -> None:
    record("tumble.csv", "hand")
    lines = (
        "flinders calibrate tumble.csv -o calibration.json",
        "flinders apply calibration.json tumble.csv -o corrected.csv",
    )
    golden("cli/good.txt", session(*lines))


def test_a_limited_calibration(golden: Golden) -> None:
    record("deck.csv", "swayed")
    golden("cli/limited.txt", session("flinders calibrate deck.csv -o calibration.json", code=3))


def test_a_limited_calibration_in_german(golden: Golden) -> None:
    record("deck.csv", "swayed")
    line = "flinders --language de calibrate deck.csv -o calibration.json"
    golden("cli/limited-de.txt", session(line, code=3))


def result_of(shown: str) -> str:
    """The JSON that a terminal shows, without messages."""
    return shown[shown.index("\n{") :]


def test_json_stays_english_and_the_language_of_the_system_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    record("deck.csv", "swayed")
    line = "flinders calibrate deck.csv --json"
    before = session(line, code=3)
    monkeypatch.setenv("FLINDERS_LANGUAGE", "de")
    assert result_of(session(line, code=3)) == result_of(before)
    monkeypatch.delenv("FLINDERS_LANGUAGE")
    monkeypatch.setenv("LANG", "de_DE.UTF-8")
    assert "LIMITED" in session("flinders calibrate deck.csv", code=3)
    monkeypatch.setenv("FLINDERS_LANGUAGE", "el")
    assert "ΠΕΡΙΟΡΙΣΜΕΝΗ" in session("flinders calibrate deck.csv", code=3)


def test_a_report_in_plain_words(golden: Golden) -> None:
    record("deck.csv", "swayed")
    shown = session("flinders calibrate deck.csv -o calibration.json --report-text -", code=3)
    dated = re.sub(r"(?m)^\d+ \w+ \d{4}, [\d:]+ UTC, Flinders [^,]+", "1 May 2026, 12:30 UTC, Flinders 1.2.3", shown)
    golden("cli/report.txt", dated)


def test_a_calibration_of_a_level_turn(golden: Golden) -> None:
    record("boat.csv", "sweep-xy")
    golden("cli/level.txt", session("flinders calibrate boat.csv -o calibration.json", code=3))


def test_a_refused_calibration(golden: Golden) -> None:
    """Turned about the vertical with its x axis down."""
    record("table.csv", "sweep-xy", axes=(2, 0, 1))
    golden("cli/refused.txt", session("flinders calibrate table.csv -o calibration.json", code=4))


def test_six_typed_numbers(golden: Golden) -> None:
    line = "flinders calibrate --minmax -157,98,-123,124,-109,101 --option variant=largest -o calibration.json"
    golden("cli/minmax.txt", session(line, code=3))


def test_an_error(golden: Golden) -> None:
    golden("cli/error.txt", session("flinders calibrate tumble.cvs", code=5))


def test_the_sessions_in_the_docs_are_real(request: pytest.FixtureRequest) -> None:
    pages = sorted(path.relative_to(DOCS).as_posix() for path in (DOCS / "cli").glob("*.md"))
    for page in ["cli.md", *pages]:
        assert_sessions_are_real(page, request, least=0)
    assert_sessions_are_real("classic/recipes/min-max.md", request)


def test_the_list_of_findings_is_made_from_the_catalogue(request: pytest.FixtureRequest) -> None:
    page = DOCS / "findings.md"
    before, rest = page.read_text(encoding="utf-8").split("<!-- made from the catalogue -->\n")
    shown, after = rest.split("<!-- end of the catalogue -->\n")
    sections = (
        f"### `{row.code}`\n\n"
        f"*{row.severities}* · number: {row.number} · limit: {row.limit_words}\n\n"
        f"{row.action[:1].upper()}{row.action[1:]}.\n\n"
        for row in CATALOGUE.values()
    )
    made = "".join(sections).replace(" · limit: \n", "\n")
    if request.config.getoption("--regenerate", default=False):
        parts = (before, "<!-- made from the catalogue -->\n", made, "<!-- end of the catalogue -->\n", after)
        page.write_text("".join(parts), encoding="utf-8")
    else:
        assert shown == made, "docs/findings.md: `uv run pytest --regenerate`, then review the diff"
