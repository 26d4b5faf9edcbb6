r"""Gauge repeatability and reproducibility (gauge R&R) of a station's measurements, by analysis of variance.

Each of P parts is measured R times by each of O operators. The mean squares of the two-way table with interaction give
the variances of repeatability, operator, interaction and part; an interaction whose F test has p > 0.25 is pooled with
the repeatability, as AIAG recommends. With one operator reproducibility is not known, and the table is one-way.

Source: AIAG, *Measurement Systems Analysis*, 4th edition (2010), chapter III-B and appendix A.

>>> parts = np.array([10.0, 12.0, 15.0])[:, None, None]
>>> operators = np.array([0.0, 0.4])[None, :, None]
>>> repeats = np.array([-0.1, 0.1])[None, None, :]
>>> study = gauge_study(parts + operators + repeats)
>>> round(study.percent("gauge"), 1), study.distinct_categories, study.is_pooled
(12.0, 11, True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from flinders.errors import UsageError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats

Component = Literal["repeatability", "operator", "interaction", "reproducibility", "gauge", "part", "total"]
Grade = Literal["acceptable", "marginal", "unacceptable"]
Source = Literal["part", "operator", "interaction", "repeatability"]

POOLING_P: Final = 0.25  # p of the interaction above which it is pooled with the repeatability (AIAG, appendix A)
CATEGORIES: Final = 1.41  # √2, as AIAG rounds it: width of a distinct category, in standard deviations of the gauge
ACCEPTABLE, MARGINAL = 10.0, 30.0  # per cent of the total variation (AIAG, chapter II-D)
MIN_CATEGORIES: Final = 5
MIN_PARTS, MIN_REPEATS = 2, 2
SPREAD: Final = 6.0  # standard deviations of the gauge per tolerance
MAX_TERMS: Final = 300  # largest number of terms of the continued fraction
TINY: Final = 1e-300


@dataclass(frozen=True, slots=True)
class VarianceRow:
    """A source of variation in the table of the analysis of variance."""

    source: Source
    freedom: int  #: degrees of freedom
    squares: float  #: sum of squares
    mean_square: float
    f: float  #: ratio to the reference mean square; NaN for the repeatability
    p: float  #: probability of a larger ratio by chance; NaN for the repeatability


@dataclass(frozen=True, slots=True, eq=False)
class GaugeStudy:
    """Variation of a measured quantity, and the share of it that the gauge causes."""

    values: Floats  #: (P, O, R): measured, by part, operator and repeat
    rows: tuple[VarianceRow, ...]  #: the analysis of variance, before an interaction is pooled
    variances: dict[Component, float]  #: of each component, in the square of the unit of `values`
    is_pooled: bool  #: the interaction counts as repeatability

    def sigma(self, component: Component) -> float:
        """Standard deviation of a component, in the unit of `values`."""
        return math.sqrt(self.variances[component])

    def percent(self, component: Component) -> float:
        """Standard deviation of a component, in per cent of the total standard deviation; NaN without variation."""
        total = self.sigma("total")
        return 100.0 * self.sigma(component) / total if total else math.nan

    def percent_of_tolerance(self, tolerance: float) -> float:
        """Six standard deviations of the gauge in per cent of a tolerance, the width of a pass range."""
        return 100.0 * SPREAD * self.sigma("gauge") / tolerance

    @property
    def distinct_categories(self) -> int:
        """Number of classes of parts that the gauge can distinguish (ndc), 1 to 999."""
        gauge = self.sigma("gauge")
        ratio = math.inf if gauge == 0.0 else CATEGORIES * self.sigma("part") / gauge
        return max(1, math.floor(min(ratio, 999.0)))

    @property
    def grade(self) -> Grade:
        """Grade by AIAG's guidelines for the share of the gauge; acceptable needs five categories."""
        grade = grade_of(self.percent("gauge"))
        is_coarse = grade == "acceptable" and self.distinct_categories < MIN_CATEGORIES
        return "marginal" if is_coarse else grade

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "parts": self.values.shape[0],  # number of parts
            "operators": self.values.shape[1],  # number of operators
            "repeats": self.values.shape[2],  # of each part by each operator
            "mean": float(self.values.mean()),  # in `unit`
            "sigma": {name: self.sigma(name) for name in self.variances},  # in `unit`, by component
            "percent": {name: _finite_or_none(self.percent(name)) for name in self.variances},  # of the total variation
            "distinct_categories": self.distinct_categories,  # ndc
            "is_pooled": self.is_pooled,  # the interaction counts as repeatability
            # source, degrees of freedom, sum of squares, mean square, F and p
            "anova": [
                [row.source, row.freedom, row.squares, row.mean_square, _finite_or_none(row.f), _finite_or_none(row.p)]
                for row in self.rows
            ],
        }


def grade_of(percent: float) -> Grade:
    """Grade of a gauge by AIAG's guidelines, from its share in per cent of the total variation or of the tolerance.

    >>> grade_of(9.0), grade_of(30.0), grade_of(31.0)
    ('acceptable', 'marginal', 'unacceptable')
    """
    if not percent <= MARGINAL:
        return "unacceptable"
    return "acceptable" if percent < ACCEPTABLE else "marginal"


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def gauge_study(values: ArrayLike) -> GaugeStudy:
    """Analyse measured values.

    Parameters
    ----------
    values : (P, O, R)
        Measured values of P parts by O operators, R times; P and R are 2 at least.

    Raises
    ------
    UsageError
        For another shape, and values that are not finite.
    """
    measured = np.asarray(values, float)
    if measured.ndim != 3 or measured.shape[0] < MIN_PARTS or measured.shape[1] < 1 or measured.shape[2] < MIN_REPEATS:
        raise UsageError(
            f"values have shape {measured.shape}: a gauge study needs parts × operators × repeats, at least "
            f"{MIN_PARTS} parts and {MIN_REPEATS} repeats"
        )
    if not np.isfinite(measured).all():
        raise UsageError("a gauge study needs a number for each part, operator and repeat: some are missing")
    rows = _one_way(measured) if measured.shape[1] == 1 else _two_way(measured)
    is_pooled = any(row.source == "interaction" and not row.p <= POOLING_P for row in rows)
    return GaugeStudy(measured, rows, _variances(measured.shape, rows, is_pooled=is_pooled), is_pooled)


def _two_way(values: Floats) -> tuple[VarianceRow, ...]:
    """The table of the analysis of variance, with interaction."""
    parts, operators, repeats = values.shape
    mean, cells = values.mean(), values.mean(axis=2)
    of_parts, of_operators = cells.mean(axis=1), cells.mean(axis=0)
    between = cells - of_parts[:, None] - of_operators[None, :] + mean
    squares: dict[Source, tuple[int, float]] = {
        "part": (parts - 1, operators * repeats * float(((of_parts - mean) ** 2).sum())),
        "operator": (operators - 1, parts * repeats * float(((of_operators - mean) ** 2).sum())),
        "interaction": ((parts - 1) * (operators - 1), repeats * float((between**2).sum())),
        "repeatability": (parts * operators * (repeats - 1), float(((values - cells[:, :, None]) ** 2).sum())),
    }
    return _f_tests(squares, against={"part": "interaction", "operator": "interaction", "interaction": "repeatability"})


def _one_way(values: Floats) -> tuple[VarianceRow, ...]:
    """The table of the analysis of variance with one operator: parts and repeatability."""
    parts, _, repeats = values.shape
    mean, of_parts = values.mean(), values.mean(axis=(1, 2))
    squares: dict[Source, tuple[int, float]] = {
        "part": (parts - 1, repeats * float(((of_parts - mean) ** 2).sum())),
        "repeatability": (parts * (repeats - 1), float(((values - of_parts[:, None, None]) ** 2).sum())),
    }
    return _f_tests(squares, against={"part": "repeatability"})


def _f_tests(squares: dict[Source, tuple[int, float]], against: dict[Source, Source]) -> tuple[VarianceRow, ...]:
    """Make the rows of the table from sums of squares, with an F test of each `against` another row."""
    mean_squares = {name: total / freedom for name, (freedom, total) in squares.items()}
    rows = []
    for name, (freedom, total) in squares.items():
        f = p = math.nan
        if name in against:
            below = mean_squares[against[name]]
            f = mean_squares[name] / below if below else (math.inf if mean_squares[name] else math.nan)
            p = f_tail(f, freedom, squares[against[name]][0])
        rows.append(VarianceRow(name, freedom, total, mean_squares[name], f, p))
    return tuple(rows)


def _variances(shape: tuple[int, ...], rows: tuple[VarianceRow, ...], *, is_pooled: bool) -> dict[Component, float]:
    """Variances of the components from the mean squares; a negative variance becomes zero (AIAG, appendix A)."""
    _, operators, repeats = shape
    by_name = {row.source: row for row in rows}
    error = by_name["repeatability"]
    below = by_name.get("interaction", error)
    if is_pooled:
        freedom, squares = error.freedom + below.freedom, error.squares + below.squares
        repeatability = between = squares / freedom
    else:
        repeatability, between = error.mean_square, below.mean_square
    interaction = max((between - repeatability) / repeats, 0.0)
    part = max((by_name["part"].mean_square - between) / (operators * repeats), 0.0)
    operator = 0.0
    if "operator" in by_name:
        operator = max((by_name["operator"].mean_square - between) / (shape[0] * repeats), 0.0)
    gauge = repeatability + operator + interaction
    return {
        "repeatability": repeatability, "operator": operator, "interaction": interaction,
        "reproducibility": operator + interaction, "gauge": gauge, "part": part, "total": gauge + part,
    }  # fmt: skip


def f_tail(f: float, above: float, below: float) -> float:
    """Probability that a ratio of mean squares is larger than `f` by chance.

    `above` and `below` are the degrees of freedom of numerator and denominator.

    It is the regularised incomplete beta function I_x(below/2, above/2) at x = below/(below + above·f).

    >>> round(f_tail(4.256, 2, 9), 4)                                  # the table of F: 5 % at 4.256
    0.05
    """
    if math.isnan(f):
        return math.nan
    if f <= 0.0:
        return 1.0
    x = 0.0 if math.isinf(f) else below / (below + above * f)
    return _incomplete_beta(below / 2.0, above / 2.0, x)


def _incomplete_beta(a: float, b: float, x: float) -> float:
    """I_x(a, b) by its continued fraction (DLMF 8.17.22), or as 1 − I(b, a) at 1 − x if that converges faster."""
    if x in (0.0, 1.0):
        return x
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _incomplete_beta(b, a, 1.0 - x)
    logarithm = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    return math.exp(logarithm) / (a * _continued_fraction(a, b, x))


def _continued_fraction(a: float, b: float, x: float) -> float:
    """Continued fraction 1 + d₁/(1 + d₂/(1 + …)) of DLMF 8.17.22, by the method of Lentz."""
    value, upper, lower = 1.0, 1.0, 0.0
    for term in range(1, MAX_TERMS):
        m = term // 2
        if term % 2:
            d = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            d = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        lower = 1.0 / (1.0 + d * lower or TINY)
        upper = 1.0 + d / upper or TINY
        value *= upper * lower
        if abs(upper * lower - 1.0) < 1e-15:
            break
    return value
