"""Types of a finding, and a row of the catalogue: its rule, its sentences, and its remedy.

A rule is data: comparisons of numbers with limits, which the engine applies (`flinders.findings.rules`).

>>> hot = CatalogueRow(
...     code="hot", number="temperature, °C", grades="note; limits above 80",
...     rule=Rule("celsius", (Grade("note", 60.0), Grade("limits", 80.0))),
...     said="the sensor was at {celsius:.0f} °C", plain="It was hot.", remedy="Cool it.", action="cool it",
... )
>>> hot.names, hot.sentence({"celsius": 85.0}), hot.rule.stated({"celsius": 85.0})
(('celsius',), 'the sensor was at 85 °C', (85.0, 60.0))
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from string import Formatter
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

from flinders.errors import figures
from flinders.findings.sensor_words import SENSOR_WORDS
from flinders.findings.words import WORDS as FIT_WORDS
from flinders.findings.words import angle, as_sentence, value_names

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flinders.errors import Hint
    from flinders.verdicts import Verdict

Severity = Literal["note", "limits", "refuses"]

Affects = Literal["error", "attitudes", "claim", "use"]
"""Aspect of a fit that a limiting finding affects, which selects the verdict's first sentence (`findings.headline`).

``error``: the heading error is above the target; ``attitudes``: some attitudes are not known; ``claim``: the heading
error may exceed the claim; ``use``: something to check before the calibration is used.
"""

Condition = Literal["same-soft-iron", "unchanged-body", "uniform-field", "constant-iron"]
"""Assumption on which a verdict rests and which no finding checks."""

VERDICTS: Final[dict[Severity, Verdict]] = {"refuses": "refused", "limits": "limited", "note": "good"}
"""Verdict for each severity, the most severe first."""

CONDITIONS: Final[dict[Condition, str]] = {
    "same-soft-iron": "soft iron is as it was",
    "unchanged-body": "nothing on the body changes (a display, a current, the hand)",
    "uniform-field": "no iron is near",
    "constant-iron": "currents are constant",
}
"""Assumptions of a verdict, in words."""

TUMBLE_ASSUMPTIONS: Final[tuple[Condition, ...]] = ("uniform-field", "constant-iron")
"""Assumptions for a recording of a magnetometer alone that is longer than a few seconds."""

VERIFICATIONS: Final[dict[Condition, str]] = {
    "same-soft-iron": "tumble again",
    "unchanged-body": "record again while it is in use",
    "uniform-field": "record elsewhere too",
    "constant-iron": "record the currents",
}
"""Ways to verify each assumption."""

Comparison = Literal["<", ">", ">="]

STATED_NUMBERS: Final = ("number", "limit", "angle", "seconds")
"""Names for the number and the limit of the rule in `CatalogueRow.plain`."""

WORDS: Final[Mapping[str, Callable[..., str]]] = {**FIT_WORDS, **SENSOR_WORDS}
"""Words in sentences: each is a function of the finding's values."""

_TARGET_FRACTIONS: Final = {1.0: "the target", 0.5: "half the target", 0.1: "a tenth of the target"}


class Limit(NamedTuple):
    """A limit: `factor`, or `factor` times the quantity of the record named by `times`."""

    factor: float
    times: str = ""


class Grade(NamedTuple):
    """Severity of a finding beyond a limit: `factor`, or `factor` times the quantity of the record named by `times`."""

    severity: Severity
    factor: float
    times: str = ""


class Needs(NamedTuple):
    """A further comparison that a rule needs: with `factor`, or with `factor` times the quantity named by `times`."""

    quantity: str
    comparison: Comparison
    factor: float
    times: str = ""


@dataclass(frozen=True, slots=True)
class Rule:
    """A comparison of a quantity with limits; the last grade that holds gives the severity."""

    quantity: str  #: name of a number of the record; NaN is beyond no limit
    grades: tuple[Grade, ...]  #: limits with their severities
    comparison: Comparison = ">"  #: comparison by which the quantity exceeds a limit
    needs: tuple[Needs, ...] = ()  #: further comparisons that must hold
    number: str = ""  #: quantity that the finding states; empty if it is the compared one
    limit: Limit | None = None  #: limit that the finding states; None if it is that of the first grade

    @property
    def stated_limit(self) -> Limit:
        """The limit that the finding states."""
        return self.limit or Limit(*self.grades[0][1:])

    @property
    def compared_quantities(self) -> frozenset[str]:
        """Names of the compared quantities."""
        graded = (grade.times for grade in self.grades)
        needed = (name for need in self.needs for name in (need.quantity, need.times))
        return frozenset({self.quantity, *graded, *needed} - {""})

    @property
    def stated_names(self) -> set[str]:
        """Names of the quantities that make up the stated number and limit."""
        return {self.number or self.quantity, self.stated_limit.times} - {""}

    @property
    def names(self) -> frozenset[str]:
        """Names of all quantities that are compared or stated."""
        return self.compared_quantities | self.stated_names

    def stated(self, values: Mapping[str, Any]) -> tuple[float, float]:
        """Number and limit that a finding with these values states."""
        factor, times = self.stated_limit
        return float(values[self.number or self.quantity]), float(factor * values[times] if times else factor)


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueRow:
    """All data of one possible finding."""

    code: str  #: stable name
    rule: Rule  #: condition of the finding
    number: str  #: meaning and unit of the number, for the table of docs/findings.md
    action: str  #: action for an engineer
    said: str  #: the technical sentence, or its part after `fault`: a format of values and of `WORDS`
    plain: str  #: meaning for the user of the compass, without mathematics
    remedy: str = ""  #: remedy for the user
    fault: str = ""  #: first part of the sentence: the fault, for a refusal in one line
    offer: str = ""  #: clause on what the arguments of `hint` do, for an interface that has them
    #: arguments that the advice needs, spelled by each interface; sentences contain none
    hint: Hint = field(default_factory=dict)
    #: meaning of the limit, for the table; None if it is a plain number or a share of the target
    limit: str | None = None
    grades: str = ""  #: severities with their conditions, for the table; empty if the rule has one severity
    affects: Affects = "claim"  #: aspect of the fit that the finding affects if it limits the fit
    alarm: bool = False  #: whether the live page warns of it: true for faults, false for too little turning
    #: action in a report of many units, if `action` refers to the advice for one unit
    fleet_action: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values of a finding: number, limit, and values in the sentences and their words."""
        stated = (self.rule.number or self.rule.quantity, self.rule.stated_limit.times)
        said = (name for words in (self.template, self.plain, self.remedy) for name in _values_of(words))
        return tuple(name for name in dict.fromkeys((*stated, *said)) if name and name not in STATED_NUMBERS)

    @property
    def template(self) -> str:
        """Format of the technical sentence."""
        return f"{self.fault}: {self.said}" if self.fault else self.said

    def sentence(self, values: Mapping[str, Any], *, is_short: bool = False) -> str:
        """The technical sentence; with `is_short` only its fault, if the row has one."""
        return (self.fault if is_short and self.fault else self.template).format_map(_Stated(values))

    def in_plain_words(self, values: Mapping[str, Any]) -> str:
        """Meaning for the user of the compass."""
        number, limit = map(Quantity, self.rule.stated(values))
        stated = {"number": number, "limit": limit, "angle": angle(number), "seconds": figures(number)}
        return self.plain.format_map(_Stated({**values, **stated}))

    def remedy_words(self, values: Mapping[str, Any]) -> str:
        """Remedy for the user, as a sentence; empty without one."""
        return as_sentence(self.remedy.format_map(_Stated(values))) if self.remedy else ""

    @property
    def severities(self) -> str:
        """Severities with their conditions, for the table of docs/findings.md."""
        return self.grades or self.rule.grades[0].severity

    @property
    def limit_words(self) -> str:
        """Meaning of the limit, for the table of docs/findings.md."""
        if self.limit is not None:
            return self.limit
        factor, times = self.rule.stated_limit
        return _TARGET_FRACTIONS[factor] if times else f"{factor:g}"


class Quantity(float):
    """A number that is formatted to two digits by default, or in degrees with the format ``angle``.

    >>> f"{Quantity(12.3456)} {Quantity(0.25):.0%} {Quantity(2.04):angle} {Quantity(400.0):angle}"
    '12 25% 2.0° any angle'
    """

    def __format__(self, spec: str) -> str:
        if spec == "angle":
            return angle(float(self))
        return format(float(self), spec) if spec else figures(float(self))


class Record(dict[str, Any]):
    """Quantities of a fit by name; some values are computed when they are first read.

    >>> record = Record({"noise": 0.12}, who=lambda: "somebody")
    >>> record["noise"], record["who"]
    (0.12, 'somebody')
    """

    def __init__(self, numbers: Mapping[str, Any], **made: Callable[[], Any]) -> None:
        super().__init__(numbers)
        self._made = made

    def __missing__(self, name: str) -> Any:  # noqa: ANN401 - a number, a name, or a list of either
        self[name] = self._made[name]()
        return self[name]


class _Stated(dict[str, Any]):
    """Values in a sentence: numbers to two digits, and words made from them."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__()
        self._values = values

    def __missing__(self, name: str) -> Any:  # noqa: ANN401 - a quantity, or a word
        if name in WORDS:
            return WORDS[name](**{taken: self._values[taken] for taken in value_names(WORDS[name])})
        value = self._values[name]
        return value if isinstance(value, str) else Quantity(value)


@cache
def _values_of(said: str) -> tuple[str, ...]:
    """Names of the values in a sentence and its words."""
    named = [name for _, name, _, _ in Formatter().parse(said) if name]
    return tuple(taken for name in named for taken in (value_names(WORDS[name]) if name in WORDS else (name,)))


def words_of_conditions(conditions: Sequence[Condition]) -> str:
    """Assumptions of a verdict in words; empty without any.

    >>> words_of_conditions(("uniform-field", "constant-iron")), words_of_conditions(())
    ('holds if no iron is near and currents are constant', '')
    """
    *first, last = (CONDITIONS[code] for code in conditions) if conditions else ("",)
    return f"holds if {', '.join(first)}{' and ' if first else ''}{last}" if conditions else ""


def verifiable_conditions(conditions: Sequence[Condition]) -> str:
    """Assumptions of a verdict, with a way to verify the first one.

    >>> verifiable_conditions(("uniform-field", "constant-iron")), verifiable_conditions(())
    ('holds if no iron is near and currents are constant: record elsewhere too', '')
    """
    return f"{words_of_conditions(conditions)}: {VERIFICATIONS[conditions[0]]}" if conditions else ""


TUMBLE_CONDITIONS: Final = verifiable_conditions(TUMBLE_ASSUMPTIONS)
"""Assumptions for a recording of a magnetometer alone, with a way to verify the first one."""


# ------------------------------------------------------------------------------------------- causes and consequences

RESIDUAL_CODES: Final = (
    *("unsteady-field", "lasting-noise", "nonlinear-axis", "axis-lag", "structure", "correlated"),
    "tilt-error",  # a dip that varies
)
"""Findings about residuals, each of which can have several causes."""

SURFACE_CODES: Final = ("prior", "unobservable-parameters", "axis-ratio", "field-strength")
"""Findings about a fitted ellipsoid."""


class Cause(NamedTuple):
    """A finding that causes others, from a given severity on and unless the finding `unless` is present."""

    code: str
    severity: Severity
    consequences: tuple[str, ...]
    unless: str = ""


CAUSES: Final = (
    Cause(
        "axis-swap", "limits", ("heading-error", "noise", "field-changed", "outliers", "few-samples", *RESIDUAL_CODES)
    ),
    Cause("alternating", "limits", ("heading-error", "noise", "field-changed", "few-samples", *RESIDUAL_CODES)),
    Cause("soft-iron-changed", "limits", ("heading-error",)),
    Cause("saturated", "limits", ("nonlinear-axis", "structure")),
    Cause("disturbance-unmodelled", "limits", ("attitude-dependent", "noise", "field-changed", *RESIDUAL_CODES)),
    Cause("attitude-dependent", "limits", ("noise", *RESIDUAL_CODES)),
    Cause(
        "noise",
        "refuses",
        (
            *("heading-error", "coverage", "few-samples", "field-changed", "outliers"),
            *(*RESIDUAL_CODES, *SURFACE_CODES),
        ),
        unless="level-plane",  # an ellipse through a short arc is small compared with its noise
    ),
    Cause("inflation", "limits", ("field-changed", "coverage", *RESIDUAL_CODES, *SURFACE_CODES)),
    Cause("recordings-differ", "limits", ("heading-error", "structure")),
    Cause("field-changed", "refuses", ("heading-error", "noise", *RESIDUAL_CODES)),
    Cause("heading-error", "refuses", ("level-plane", "tilt-error", *SURFACE_CODES)),
    Cause("field-changed", "limits", ("noise", *RESIDUAL_CODES)),
    *(
        Cause(code, "limits", ("correlated",), unless="few-samples")
        for code in ("axis-lag", "nonlinear-axis", "structure")
    ),
    Cause("heading-error", "limits", ()),
    Cause("coverage", "limits", ("prior", "unobservable-parameters")),
    Cause("lasting-noise", "limits", ("few-samples", "correlated")),
    Cause("few-samples", "limits", ("nonlinear-axis", "axis-lag", "structure", "correlated")),
    Cause("quantised", "note", ("stale-repeats",)),
)
"""Causes, in the order in which they are shown."""
