"""A finding: code, severity, and the named numbers that its sentence is made from wherever it is shown.

>>> found = stated("quantised", {"step": 0.152}, "note")
>>> found
Finding(code='quantised', severity='note', values={'step': 0.152})
>>> found.number, found.limit, found.advice[:48]
(0.152, 0.0, 'readings go in coarse steps of 0.15, which the h')
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from flinders.core.calibration_file import FindingRecord
from flinders.core.short_repr import ShortRepr
from flinders.errors import DocumentError, FlindersError
from flinders.findings.catalogue import CATALOGUE
from flinders.findings.row import VERDICTS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.findings.row import CatalogueRow, Severity


@dataclass(frozen=True, slots=True, repr=False)
class Finding(ShortRepr):
    """Something to know about a fit."""

    code: str  #: stable name, one of `flinders.findings.CATALOGUE`
    #: ``note``: good to know; ``limits``: the calibration holds with limits; ``refuses``: it is not given
    severity: Severity
    #: numbers by name, and short names such as that of an axis or a recording: all that its sentence takes. Lists where
    #: several are listed; not a number, null in a file, where there is none.
    values: Mapping[str, Any]
    follows_from: str | None = None  #: code of the finding that it follows from; None where it follows from no other

    @property
    def number(self) -> float:
        """What was found; its meaning and unit belong to the code."""
        return self._stated[0]

    @property
    def limit(self) -> float:
        """What it was compared with."""
        return self._stated[1]

    @property
    def _stated(self) -> tuple[float, float]:
        """Number and limit by the rule; NaN where the values do not tell them."""
        row = CATALOGUE.get(self.code)
        if row is None or not row.rule.stated_names <= self.values.keys():
            return float(self.values.get("number", math.nan)), float(self.values.get("limit", math.nan))
        return row.rule.stated(self.values)

    @property
    def advice(self) -> str:
        """What was found, and what to do, in a sentence; of values that are not stated what the catalogue advises."""
        said = self._said()
        for name, is_best in self.values.get("parts", ()):
            said = f"not even the best of them, {name}, is whole: {said}" if is_best else f"{name}: {said}"
        return said

    @property
    def fault(self) -> str:
        """What is wrong, without what to do, where a fit is refused in a line."""
        return self._said(is_short=True)

    @property
    def plain_words(self) -> str:
        """What it means for whoever uses the compass, without the mathematics."""
        row = CATALOGUE.get(self.code)
        return row.in_plain_words(self.values) if row is not None and self._is_stated(row) else self.advice

    @property
    def in_a_sentence(self) -> str:
        """The first sentence of that."""
        return self.plain_words.partition(". ")[0]

    @property
    def remedy(self) -> str:
        """What that person does about it, as a sentence; empty where there is nothing to do."""
        row = CATALOGUE.get(self.code)
        return row.remedy_words(self.values) if row is not None and self._is_stated(row) else ""

    def _is_stated(self, row: CatalogueRow) -> bool:
        """Whether it has all the values that its sentences take."""
        return self.values.keys() >= set(row.names)

    def _said(self, *, is_short: bool = False) -> str:
        """The sentence of the catalogue, or the first part of it."""
        row = CATALOGUE.get(self.code)
        if row is None:
            return self.code
        if not self._is_stated(row):
            return row.action.replace("`", "")
        return row.sentence(self.values, is_short=is_short)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, and the sentence for whoever reads them; a number that there is none of is None."""
        return {
            "code": self.code,
            "severity": self.severity,
            "number": plain(self.number),
            "limit": plain(self.limit),
            "values": {name: plain(value) for name, value in self.values.items()},
            "follows_from": self.follows_from,
            "advice": self.advice,  # the sentence that the values make
        }

    def to_record(self) -> FindingRecord:
        """The finding as it stands in a file, which has no sentence."""
        fields = self.as_dict()
        del fields["advice"]
        return FindingRecord(**fields)

    @classmethod
    def from_record(cls, record: FindingRecord, source: str) -> Self:
        """A finding as a file states it.

        Raises
        ------
        DocumentError
            For values that make no sentence; `source` names the file.
        """
        row = CATALOGUE.get(record.code)
        is_stated = row is not None and row.rule.stated_names <= record.values.keys()
        given = record.values if is_stated else {"number": record.number, "limit": record.limit, **record.values}
        severity = record.severity if record.severity in VERDICTS else "note"
        try:
            values = {name: _value(value) for name, value in given.items()}
            finding = cls(record.code, severity, values, record.follows_from)
            finding.as_dict()
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError, FlindersError) as error:
            raise DocumentError(f"{source}: fit.findings: values of {record.code} make no sentence: {error}") from None
        return finding


def stated(code: str, record: Mapping[str, Any], severity: Severity, follows_from: str | None = None) -> Finding:
    """A finding with what its sentence takes of a record, with a severity that its rule has.

    Parameters
    ----------
    record : mapping
        Quantities of the rule by name, and the other values of the sentence.
    """
    return Finding(code, severity, {name: _value(record[name]) for name in CATALOGUE[code].names}, follows_from)


def _value(value: Any) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
    """A value of a finding: a float, a name, or a tuple of either."""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return tuple(_value(member) for member in value)
    return math.nan if value is None or value != value else float(value)  # noqa: PLR0124 - one NaN, so that they compare


def plain(value: Any) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
    """A value as JSON has it: None for a number that there is none of."""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return tuple(plain(member) for member in value)
    return value if math.isfinite(value) else None


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Put the most severe findings first, those of one severity as they came."""
    order = list(VERDICTS)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
