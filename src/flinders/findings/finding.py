"""A finding: code, severity, and the named numbers for its sentence.

>>> found = make_finding("quantised", {"step": 0.152}, "note")
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
    """A fact about a fit."""

    code: str  #: stable name, one of `flinders.findings.CATALOGUE`
    #: ``note``: for information; ``limits``: the calibration is usable with limits; ``refuses``: it is not given
    severity: Severity
    #: Values for its sentence by name: numbers, short names such as that of an axis, or lists of either. A missing
    #: number is NaN, or null in a file.
    values: Mapping[str, Any]
    follows_from: str | None = None  #: code of the finding that causes this one; None without a cause

    @property
    def number(self) -> float:
        """The number that the finding states; the catalogue has its meaning and unit by code."""
        return self._number_and_limit[0]

    @property
    def limit(self) -> float:
        """The limit with which the number was compared."""
        return self._number_and_limit[1]

    @property
    def _number_and_limit(self) -> tuple[float, float]:
        """Number and limit by the rule; NaN for missing values."""
        row = CATALOGUE.get(self.code)
        if row is None or not row.rule.stated_names <= self.values.keys():
            return float(self.values.get("number", math.nan)), float(self.values.get("limit", math.nan))
        return row.rule.stated(self.values)

    @property
    def advice(self) -> str:
        """Finding and advice as a sentence; the catalogue's advice if values are missing."""
        said = self._sentence()
        for name, is_best in self.values.get("parts", ()):
            said = f"not even the best of them, {name}, is whole: {said}" if is_best else f"{name}: {said}"
        return said

    @property
    def fault(self) -> str:
        """The fault without advice, for a refusal in one line."""
        return self._sentence(is_short=True)

    @property
    def plain_words(self) -> str:
        """Meaning for the user of the compass, without mathematics."""
        row = CATALOGUE.get(self.code)
        return row.in_plain_words(self.values) if row is not None and self._is_complete(row) else self.advice

    @property
    def in_a_sentence(self) -> str:
        """The first sentence of `plain_words`."""
        return self.plain_words.partition(". ")[0]

    @property
    def remedy(self) -> str:
        """Remedy for the user of the compass, as a sentence; empty without one."""
        row = CATALOGUE.get(self.code)
        return row.remedy_words(self.values) if row is not None and self._is_complete(row) else ""

    def _is_complete(self, row: CatalogueRow) -> bool:
        """Whether all values that its sentences need exist."""
        return self.values.keys() >= set(row.names)

    def _sentence(self, *, is_short: bool = False) -> str:
        """The sentence of the catalogue, or its first part."""
        row = CATALOGUE.get(self.code)
        if row is None:
            return self.code
        if not self._is_complete(row):
            return row.action.replace("`", "")
        return row.sentence(self.values, is_short=is_short)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields, with the sentence; a missing number becomes None."""
        return {
            "code": self.code,
            "severity": self.severity,
            "number": json_value(self.number),
            "limit": json_value(self.limit),
            "values": {name: json_value(value) for name, value in self.values.items()},
            "follows_from": self.follows_from,
            "advice": self.advice,  # sentence made from the values
        }

    def to_record(self) -> FindingRecord:
        """The finding as stored in a file, without its sentence."""
        fields = self.as_dict()
        del fields["advice"]
        return FindingRecord(**fields)

    @classmethod
    def from_record(cls, record: FindingRecord, source: str) -> Self:
        """A finding as stored in a file.

        Raises
        ------
        DocumentError
            For stored values that the sentence of the finding cannot take; `source` names the file.
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
            raise DocumentError(
                f"{source}: fit.findings: values of {record.code} do not fit its sentence: {error}"
            ) from None
        return finding


def make_finding(code: str, record: Mapping[str, Any], severity: Severity, follows_from: str | None = None) -> Finding:
    """Make a finding of a given severity, with the values for its sentence taken from a record.

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
    return math.nan if value is None or value != value else float(value)  # noqa: PLR0124 - one NaN object, for comparisons


def json_value(value: Any) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
    """A value for JSON; a missing number becomes None."""
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return tuple(json_value(member) for member in value)
    return value if math.isfinite(value) else None


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by severity, the most severe first; those of equal severity keep their order."""
    order = list(VERDICTS)
    return tuple(sorted(findings, key=lambda finding: order.index(finding.severity)))
