"""Truth of online calibration's claims over whole lives of a vehicle. Prints Markdown.

    python -m benchmarks.service [--days 1] [--lives 2] [--bodies robot …] [--events walk …] [--estimators once …]
                                 [--alone] [--detail] [--processes 2]

Lives are those of `benchmarks.service_lives`, estimators those of `benchmarks.service_peers`. Each estimator is
evaluated at random moments of a life, one each five minutes and at least 200, also without readings, and once during
each passage of steel. *Error* is the true worst heading error of a level vehicle at a dip of 60°, less its mean over
the turn, with the soft iron and the offset of that moment.

*In force* is the share of moments with a correction; all other columns are for these. *Within* is the share with an
error within the bound of 95 %, or within 1.96 claims for an estimator without a bound; then 85 % are expected for an
isotropic uncertainty of the offset, since a claim is 1 σ at the worst heading and an error is the largest. *Error ÷
claim* is a median, expected 1.2. The kind of a moment is the first of: steel passes or a magnet is near; step, until an
hour after the first reading with it; gap, or ten minutes after; else calm. Moments with steel are in no other row.

After a step the estimator is evaluated after 0, 5, 10, 20 … 1280 s of turning, until the next step; *covered* is the
first of two consecutive times with an error within the bound, *back* with one below 2° or 1.5 times the earlier error;
never, if that is not reached. A false report has `moved` in its code and no step in the hour before.

``--events`` leaves out other kinds of events; ``--alone`` has a table of each kind alone. ``--detail`` adds a row for
each estimator, body and kind of moment.
"""

from __future__ import annotations

import argparse
import math
import sys
import time as clock
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.adversary import headings, level_field, stream
from benchmarks.service_bodies import BODIES, FIRST_S, HOUR
from benchmarks.service_lives import KINDS, STRENGTH_UT, live
from benchmarks.service_peers import ESTIMATORS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from benchmarks.service_lives import Event, Life
    from benchmarks.service_peers import Correction, Estimator

MOMENT_PERIOD_S, MIN_MOMENTS = 300.0, 200
"""Seconds of life between two moments, and smallest number of moments of a life."""
STEP_S, GAP_S = HOUR, 600.0
"""Seconds for which a moment counts as after a step, and as after a gap."""
TURNED_S: Final = (0.0, *(5.0 * 2.0**power for power in range(9)))
"""Seconds of turning after a step."""
FIRST_SEED: Final = 300
"""Seed of the first life; earlier ones were used during the development of the estimators."""
MOMENTS: Final = ("calm", "step", "gap", "steel")


@dataclass(frozen=True, slots=True)
class Moment:
    """Moment of an evaluation, with its kind; after a step also the step's number, and the seconds of turning since."""

    seconds: float
    kind: str
    is_random: bool = True
    step: int = -1
    turned: float = math.nan


@dataclass(frozen=True, slots=True)
class Answer:
    """Error, claim and bound of an estimator at a moment, degrees; NaN without a correction."""

    moment: Moment
    error: float
    claim: float
    bound: float

    @property
    def is_within(self) -> bool:
        """Whether the error is within the bound."""
        return self.error <= self.bound


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the offset: size in µT, and seconds of turning until the bound holds and the error is back."""

    size: float
    covered: float
    back: float
    is_reported: bool


@dataclass(frozen=True, slots=True)
class Score:
    """Results of an estimator on a life."""

    body: str
    estimator: str
    answers: tuple[Answer, ...]
    steps: tuple[Step, ...]
    calm_hours: float  #: hours of life without a step in the hour before
    false_reports: int
    codes: tuple[str, ...]
    seconds: float  #: processor time
    readings: int


def moments_of(life: Life) -> list[Moment]:
    """Moments of evaluation, ascending."""
    rng = stream(life.seed, f"moments of {life.body}")
    count = max(MIN_MOMENTS, round(life.end_s / MOMENT_PERIOD_S))
    found = [Moment(at, kind_of(life, at)) for at in rng.uniform(FIRST_S, life.end_s, count).tolist()]
    within = [float(rng.uniform(event.begin, event.end)) for event in life.of_kind("steel")]
    found += [Moment(at, "steel", is_random=False) for at in within]
    steps = steps_of(life)
    for number, step in enumerate(steps):
        end = steps[number + 1].begin if number + 1 < len(steps) else life.end_s
        begun = float(np.interp(step.begin, life.seconds, life.turning))
        for turned in TURNED_S:
            row = int(np.searchsorted(life.turning, begun + turned))
            at = max(float(life.seconds[min(row, len(life.seconds) - 1)]), step.begin + 1.0)
            if row < len(life.seconds) and at < end:
                found.append(Moment(at, "step", is_random=False, step=number, turned=turned))
    return sorted(found, key=lambda moment: moment.seconds)


def steps_of(life: Life) -> tuple[Event, ...]:
    """Steps of the offset."""
    return life.of_kind("step", "magnetised")


def unsettled(life: Life) -> list[tuple[float, float]]:
    """For each step, its time and an hour after the first reading with it."""
    begins = [step.begin for step in steps_of(life)]
    rows = np.minimum(np.searchsorted(life.seconds, begins), len(life.seconds) - 1)
    return [(begin, float(life.seconds[row]) + STEP_S) for begin, row in zip(begins, rows, strict=True)]


def kind_of(life: Life, at: float) -> str:
    """Kind of a moment: one of `MOMENTS`."""
    if any(event.begin <= at <= event.end for event in life.of_kind("steel")):
        return "steel"
    if any(begin <= at < end for begin, end in unsettled(life)):
        return "step"
    if any(event.begin <= at < event.end + GAP_S for event in life.of_kind("gap")):
        return "gap"
    return "calm"


def scored(life: Life, name: str, make: Callable[[], Estimator]) -> Score:
    """Run an estimator on a life, and evaluate it."""
    began = clock.process_time()
    moments, estimator = moments_of(life), make()
    said: list[Correction | None] = []
    reports: list[tuple[float, str]] = []
    stops = np.array([moment.seconds for moment in moments])
    stamps, seen = life.clock_at(stops), 0
    for number, chunk in life.chunks(stops):
        if chunk is None:
            said.append(estimator.correction(float(stamps[number])))
        else:
            seen += len(chunk.time)
            reports += [(float(life.seconds[seen - 1]), report.code) for report in estimator.add(chunk)]
    answers = tuple(
        Answer(moment, error_deg(life, moment.seconds, one), *claims_of(one))
        for moment, one in zip(moments, said, strict=True)
    )
    after = np.reshape(unsettled(life), (-1, 2))
    moved = np.array([at for at, code in reports if "moved" in code])
    is_after = (moved[:, None] >= after[:, 0]) & (moved[:, None] < after[:, 1])
    followed = {answer.moment.step for answer in answers} - {-1}
    steps = [stepped(life, number, answers, bool(is_after[:, number].any())) for number in sorted(followed)]
    grid = np.arange(0.0, life.end_s, 60.0)[:, None]
    calm = float(np.mean(~((grid >= after[:, 0]) & (grid < after[:, 1])).any(axis=1))) * life.end_s / HOUR
    false = int(np.sum(~is_after.any(axis=1)))
    codes = tuple(code for _, code in reports)
    return Score(
        life.body, name, answers, tuple(steps), calm, false, codes, clock.process_time() - began, len(life.seconds)
    )


def claims_of(said: Correction | None) -> tuple[float, float]:
    """Claim and bound of a correction, degrees; NaN if missing."""
    if said is None or said.claim_deg is None or said.bound is None:
        return math.nan, math.nan
    return said.claim_deg, said.bound


def error_deg(life: Life, at: float, said: Correction | None) -> float:
    """True worst heading error of a correction at a moment of life, degrees."""
    if said is None:
        return math.nan
    readings = STRENGTH_UT * level_field() @ life.iron + life.offset_at(np.array([at]))
    return float(np.abs(headings((readings - said.offset) @ said.matrix.T)).max())


def stepped(life: Life, number: int, answers: Sequence[Answer], is_reported: bool) -> Step:
    """Result after a step."""
    step = steps_of(life)[number]
    before = [answer.error for answer in answers if answer.moment.seconds < step.begin]
    was = before[-1] if before else math.nan
    after = [answer for answer in answers if answer.moment.step == number]
    good = max(2.0, 1.5 * was) if math.isfinite(was) else 2.0
    covered = first_of_two(after, [answer.is_within for answer in after])
    return Step(step.size, covered, first_of_two(after, [answer.error <= good for answer in after]), is_reported)


def first_of_two(after: Sequence[Answer], holds: Sequence[bool]) -> float:
    """Seconds of turning at the first of two consecutive moments at which a condition holds; infinite if none."""
    for place, answer in enumerate(after):
        if all(holds[place : place + 2]):
            return answer.moment.turned
    return math.inf


def tried(case: tuple[str, int], *, days: float, kinds: Collection[str], names: Sequence[str]) -> list[Score]:
    """All estimators on one life."""
    life = live(case[0], case[1], days=days, kinds=kinds)
    return [scored(life, name, ESTIMATORS[name]) for name in names]


def share(values: Sequence[bool]) -> str:
    """A share in percent; a dash without values."""
    return f"{np.mean(values):.0%}" if len(values) else "–"


def middle(values: Sequence[float], digits: int = 2) -> str:
    """Median of the finite values."""
    finite = [value for value in values if math.isfinite(value)]
    return f"{np.median(finite):.{digits}f}" if finite else "–"


HEAD: Final = "moments | in force | within | error ÷ claim | claim ≤ 1° | error, mean | median | 95 % |"


def cells(answers: Sequence[Answer]) -> str:
    """Cells of the columns of `HEAD`."""
    told = [answer for answer in answers if math.isfinite(answer.error)]
    claimed = [answer for answer in told if math.isfinite(answer.claim)]
    ratios = [answer.error / answer.claim for answer in claimed if answer.claim > 0.0]
    errors = np.array([answer.error for answer in told])
    sizes = (f"{errors.mean():.2f}° | {np.median(errors):.2f}° | {np.quantile(errors, 0.95):.1f}°",) if told else ()
    return " | ".join(
        [
            str(len(answers)),
            share([math.isfinite(answer.error) for answer in answers]),
            share([answer.is_within for answer in claimed]),
            middle(ratios),
            share([answer.claim <= 1.0 for answer in claimed]),
            *(sizes or ("– | – | –",)),
        ]
    )


def chosen(scores: Sequence[Score], kind: str = "") -> list[Answer]:
    """Answers at random moments of one kind, by default of all kinds but steel; of steel also at the extra moments."""
    answers = [answer for score in scores for answer in score.answers]
    if kind == "steel":
        return [answer for answer in answers if answer.moment.kind == "steel"]
    random = [answer for answer in answers if answer.moment.is_random and answer.moment.kind != "steel"]
    return [answer for answer in random if kind in ("", answer.moment.kind)]


def tables(scores: Sequence[Score], names: Sequence[str], bodies: Sequence[str], *, detail: bool) -> Iterator[str]:
    """All tables."""
    by = {name: [score for score in scores if score.estimator == name] for name in names}
    yield from ("Each body, all moments without steel:", "", f"| estimator | body | {HEAD}", RULE)
    for name, body in product(names, bodies):
        yield f"| {name} | {body} | {cells(chosen([score for score in by[name] if score.body == body]))} |"
    yield from ("", "Each kind of moment, all bodies:", "", f"| estimator | moments | {HEAD}", RULE)
    for name, kind in product(names, MOMENTS):
        yield f"| {name} | {kind} | {cells(chosen(by[name], kind))} |"
    if detail:
        yield from ("", "Both:", "", f"| estimator | body, moments | {HEAD}", RULE)
        for name, body, kind in product(names, bodies, MOMENTS):
            of = [score for score in by[name] if score.body == body]
            yield f"| {name} | {body}, {kind} | {cells(chosen(of, kind))} |"
    yield from ("", "Mean error:", "", f"| estimator | {' | '.join(bodies)} |", "|---|" + "---:|" * len(bodies))
    for name in names:
        means = [mean_error([score for score in by[name] if score.body == body]) for body in bodies]
        yield f"| {name} | {' | '.join(means)} |"
    yield from ("", "Steps of the offset, seconds of turning:", "", STEPS)
    for name in names:
        yield f"| {name} | {step_cells(by[name])} |"
    yield from ("", "Reports, and cost:", "", REPORTS)
    for name in names:
        yield f"| {name} | {report_cells(by[name])} |"


RULE: Final = "|---|---|" + "---:|" * 8
STEPS: Final = (
    "| estimator | steps | covered at once | covered, median | never covered | back, median | never back |\n"
    "|---|" + "---:|" * 6
)
REPORTS: Final = (
    "| estimator | steps ≥ 3 µT reported | false “moved” an hour | codes | µs a reading |\n|---|---:|---:|---|---:|"
)


def mean_error(scores: Sequence[Score]) -> str:
    """Mean error at the random moments, and the share without one."""
    errors = [answer.error for answer in chosen(scores) if math.isfinite(answer.error)]
    return f"{np.mean(errors):.2f}°" if errors else "–"


def step_cells(scores: Sequence[Score]) -> str:
    """Cells of the results after steps."""
    steps = [step for score in scores for step in score.steps]
    if not steps:
        return "0 | – | – | – | – | –"
    has_claims = any(math.isfinite(answer.bound) for score in scores for answer in score.answers)
    covered, back = ([getattr(step, of) for step in steps] for of in ("covered", "back"))
    of_bound = [share([one == 0.0 for one in covered]), *delays(covered)] if has_claims else ["–", "–", "–"]
    return " | ".join([str(len(steps)), *of_bound, *delays(back)])


def delays(seconds: Sequence[float]) -> tuple[str, str]:
    """Median of delays, and the share that is infinite."""
    median = float(np.median(seconds))
    return f"{median:.0f} s" if math.isfinite(median) else "never", share([math.isinf(one) for one in seconds])


def report_cells(scores: Sequence[Score]) -> str:
    """Cells of reports and processor time."""
    large = [step.is_reported for score in scores for step in score.steps if step.size >= 3.0]
    codes = [code for score in scores for code in score.codes]
    counts = ", ".join(f"{code} {codes.count(code)}" for code in sorted(set(codes)))
    hours = sum(score.calm_hours for score in scores)
    false = sum(score.false_reports for score in scores)
    cost = 1e6 * sum(score.seconds for score in scores) / sum(score.readings for score in scores)
    says = bool(codes)
    return f"{share(large) if says else '–'} | {false / hours:.3f} | {counts or '–'} | {cost:.1f} |"[:-2]


def run(
    bodies: Sequence[str], lives: int, processes: int, *, days: float, kinds: Collection[str], names: Sequence[str]
) -> list[Score]:
    """All lives, each in a process."""
    cases = list(product(bodies, range(FIRST_SEED, FIRST_SEED + lives)))
    with ProcessPoolExecutor(processes) as pool:
        each = pool.map(partial(tried, days=days, kinds=tuple(kinds), names=tuple(names)), cases)
        return [score for scores in each for score in scores]


def alone(
    bodies: Sequence[str], lives: int, processes: int, *, days: float, kinds: Sequence[str], names: Sequence[str]
) -> Iterator[str]:
    """Yield a row for each kind of event and each estimator; lives of a row have no other kind of event."""
    yield from (f"| events | estimator | {HEAD}", RULE)
    for kind in ("none", *kinds):
        some = run(bodies, lives, processes, days=days, kinds=[kind] if kind in KINDS else [], names=names)
        for name in names:
            of = [score for score in some if score.estimator == name]
            yield f"| {kind} | {name} | {cells(chosen(of))} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--days", type=float, default=1.0, help="of each life")
    parser.add_argument("--lives", type=int, default=2, help="of each body")
    parser.add_argument("--bodies", nargs="+", default=list(BODIES), choices=BODIES, metavar="BODY")
    parser.add_argument("--events", nargs="*", default=list(KINDS), choices=KINDS, metavar="KIND")
    parser.add_argument("--estimators", nargs="+", default=list(ESTIMATORS), choices=ESTIMATORS, metavar="NAME")
    parser.add_argument("--alone", action="store_true", help="each kind of event alone")
    parser.add_argument("--detail", action="store_true", help="a row for each estimator, body and kind of moment")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    how = {"days": options.days, "kinds": options.events, "names": options.estimators}
    if options.alone:
        for line in alone(options.bodies, options.lives, options.processes, **how):
            print(line, flush=True)
        return
    scores = run(options.bodies, options.lives, options.processes, **how)
    for line in tables(scores, options.estimators, options.bodies, detail=options.detail):
        print(line)


if __name__ == "__main__":
    main(sys.argv[1:])
