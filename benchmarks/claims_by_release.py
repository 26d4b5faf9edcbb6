"""Claims on real recordings, release by release: a smaller claim or a better verdict needs a reason.

    python -m benchmarks.claims_by_release                          # fit, and compare with the last column
    python -m benchmarks.claims_by_release --keep 0.2.0 --because "Claims include the thermal drift."

``benchmarks/claims_by_release.toml`` has a column for each release. For each recording in
`benchmarks.recordings.FOLDER` it has the verdict, the claimed worst level heading error, the noise, and the findings
that limit or refuse, by `auto`. The table contains only names of recordings. A claim counts as smaller if it is more
than a third below the largest claim since the last reason, so that several small steps need a reason too. ``--keep``
asks for each reason; while one is missing, ``tests/test_claims_by_release.py`` fails.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import flinders
from benchmarks import fits
from benchmarks.recordings import FOLDER, NO_RECORDINGS
from flinders.errors import FitError
from flinders.fitting.result import Refused

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

TABLE: Final = Path(__file__).with_suffix(".toml")
MAX_CLAIM_DROP: Final = 1.0 / 3.0
"""Largest relative decrease of a claim that needs no reason."""
MIN_SHOWN_CHANGE: Final = 0.2
"""Largest relative change of a claim that is not printed."""
VERDICTS: Final = ("refused", "limited", "good")
"""Verdicts from the worst to the best."""
OTHER_SENSORS: Final = {"acc.txt", "acc_data.txt", "reference_magneto14_acc.lis", "reference_magneto14_mag.lis"}
"""Recordings of accelerometers, and transcripts of other recordings."""


@dataclass(frozen=True, slots=True)
class Kept:
    """Result of one release for one recording."""

    verdict: str
    claimed_deg: float | None = None  #: worst level heading error in degrees; None for a refused fit
    noise: float | None = None  #: noise in µT, or in counts without a known unit; None without a fit
    limits: tuple[str, ...] = ()  #: codes of the findings that limit or refuse; or the code of the error
    reason: str = ""  #: reason for a smaller claim or a better verdict


@dataclass(frozen=True, slots=True)
class Column:
    """Results of one release, by the names of recordings below the folder."""

    name: str
    because: str
    recordings: dict[str, Kept]


def names() -> list[str]:
    """Names of the recordings of magnetometers in the folder."""
    return [name for name in fits.recordings() if Path(name).name not in NO_RECORDINGS | OTHER_SENSORS]


def fitted(name: str) -> Kept:
    """Result of a fit of one recording by `auto`."""
    try:
        fit = flinders.fit(flinders.read(FOLDER / name))
    except Refused as refusal:
        fit = refusal.fit
    except FitError as error:
        return Kept("refused", limits=(error.code,))
    limits = tuple(sorted(finding.code for finding in fit.findings if finding.severity != "note"))
    claimed = None if fit.verdict == "refused" else _digits(fit.heading_error_deg.worst)
    return Kept(fit.verdict, claimed, _digits(fit.evidence.noise), limits)


def _digits(number: float) -> float:
    return float(f"{number:.3g}")


def kept() -> list[Column]:
    """Columns of the table, with the oldest first."""
    return [
        Column(
            one["name"],
            one["because"],
            {name: Kept(**{**row, "limits": tuple(row["limits"])}) for name, row in one["recordings"].items()},
        )
        for one in tomllib.loads(TABLE.read_text()).get("release", [])
    ]


def unexplained(name: str, columns: Sequence[Column], now: Kept) -> str:
    """Sentence about a result that needs a reason and has none; empty otherwise.

    >>> columns = [Column(str(claim), "", {"a.csv": Kept("limited", claim)}) for claim in (0.9, 0.7)]
    >>> unexplained("a.csv", columns, Kept("limited", 0.61)), unexplained("a.csv", columns, Kept("limited", 0.59))
    ('', 'a.csv claims 0.59° and claimed 0.9° by 0.9')
    >>> unexplained("a.csv", columns, Kept("good", 0.7)), unexplained("a.csv", columns, Kept("good", 0.1, reason="why"))
    ('a.csv is good and was limited by 0.7', '')
    """
    before = [(column.name, column.recordings[name]) for column in columns if name in column.recordings]
    if now.reason or not before:
        return ""
    release, last = before[-1]
    if VERDICTS.index(now.verdict) > VERDICTS.index(last.verdict):
        return f"{name} is {now.verdict} and was {last.verdict} by {release}"
    claims = [(row.claimed_deg, release) for release, row in _since_reason(before) if row.claimed_deg is not None]
    if now.claimed_deg is not None and claims:
        largest, release = max(claims)
        if now.claimed_deg < (1.0 - MAX_CLAIM_DROP) * largest:
            return f"{name} claims {now.claimed_deg:g}° and claimed {largest:g}° by {release}"
    return ""


def _since_reason(before: list[tuple[str, Kept]]) -> list[tuple[str, Kept]]:
    """Results of a recording, from the last one that has a reason on."""
    reasons = [number for number, (_, row) in enumerate(before) if row.reason]
    return before[reasons[-1] if reasons else 0 :]


def changes(old: Column, new: Mapping[str, Kept]) -> Iterator[str]:
    """Yield a line for each recording whose verdict changed, or whose claim changed by more than a fifth."""
    for name in sorted(old.recordings.keys() | new.keys()):
        was, now = old.recordings.get(name), new.get(name)
        if was is None or now is None:
            yield f"{name}: {'is new' if was is None else 'is missing'}"
            continue
        words = [f"{was.verdict} → {now.verdict}"] if was.verdict != now.verdict else []
        if was.claimed_deg and now.claimed_deg and abs(now.claimed_deg / was.claimed_deg - 1.0) > MIN_SHOWN_CHANGE:
            grew = "grew" if now.claimed_deg > was.claimed_deg else "shrank"
            words.append(f"claim {grew}, {was.claimed_deg:g}° → {now.claimed_deg:g}°")
        if words and was.limits != now.limits:
            words.append(f"{', '.join(was.limits) or 'no limit'} → {', '.join(now.limits) or 'no limit'}")
        if words:
            yield f"{name}: {'; '.join(words)}"


def keep(name: str, because: str, columns: Sequence[Column], new: Mapping[str, Kept]) -> None:
    """Add a column to the table, and ask for the reasons that it needs."""
    if any(column.name == name for column in columns):
        sys.exit(f"{TABLE.name} has a column {name}: choose another name")
    rows = {}
    for recording, row in new.items():
        question = unexplained(recording, columns, row)
        rows[recording] = replace(row, reason=_answer(question)) if question else row
    with TABLE.open("a", encoding="utf-8") as file:
        file.write(written(Column(name, because, rows)))


def _answer(question: str) -> str:
    try:
        reason = input(f"{question}. Why? ").strip()
    except EOFError:
        reason = ""
    return reason or sys.exit("a reason is needed; nothing was kept")


def written(column: Column) -> str:
    """Write a column as TOML."""
    lines = ["", "[[release]]", f"name = {_quoted(column.name)}", f"because = {_quoted(column.because)}", ""]
    lines.append("[release.recordings]")
    for name, row in sorted(column.recordings.items()):
        cells = {key: value for key, value in asdict(row).items() if value is not None and value != ""}
        words = ", ".join(f"{key} = {_quoted(value)}" for key, value in cells.items())
        lines.append(f"{_quoted(name)} = {{ {words} }}")
    return "\n".join(lines) + "\n"


def _quoted(value: object) -> str:
    """Write a value for TOML, whose strings, numbers and lists of strings have the syntax of JSON."""
    return json.dumps(value, ensure_ascii=False)


def main() -> None:
    """Compare with the last column, or add one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--keep", metavar="NAME", help="add a column: a release, or a date")
    parser.add_argument("--because", metavar="WHY", help="what changed since the last column, one line")
    asked = parser.parse_args()
    if bool(asked.keep) != bool(asked.because):
        parser.error("a column needs a name and a reason: --keep NAME --because WHY")
    if not FOLDER.is_dir():
        sys.exit(f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them")
    columns, new = kept(), {name: fitted(name) for name in names()}
    if columns:
        lines = list(changes(columns[-1], new))
        print("\n".join([*lines, f"{len(new)} recordings compared with {columns[-1].name}, {len(lines)} changed"]))
    if asked.keep:
        keep(asked.keep, asked.because, columns, new)


if __name__ == "__main__":
    main()
