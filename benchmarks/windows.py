"""Parts of real recordings compared with the whole: claims and errors of short or one-sided recordings.

    python -m benchmarks.windows

Each recording with a calibration to 1.3° is cut into 2, 4 and 8 parts, each part is fitted alone, and its heading error
is the difference from the fit of the whole: an eighth of a tumble is often a turn about nearly one axis. *Corrected
before* are the same parts with readings corrected by the whole first, *offset alone* with its offset removed, as in
much firmware: a further calibration should not make such a compass worse.

*Ratio* is the worst level heading difference over the combined claim of part and whole: for true claims, 1.2 in the
median and 2.1 at 90 %. *Made worse* counts parts whose error exceeds that of the readings themselves by more than twice
that claim. Recordings are searched as by `benchmarks.recordings`; local changes of the strength of the field are
removed. The first table compares whole recordings of one board: root mean square of the difference over its claim, of
all nine parameters, of the eight without the strength, of groups of those, of the strength.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

import flinders
from benchmarks.recordings import FOLDER, text_recordings
from flinders.errors import FlindersError
from flinders.fitting.result import Refused
from flinders.heading.error_propagation import level_error, raw_error

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

BOARD: Final = ("calTest1_198_253_-9", "calTest1_208_249_-2", "calTest1_215_253_0", "calTest1_222_240_-8",
                "CalCareful_2282320")  # fmt: skip
PARTS: Final = (2, 4, 8)
MAX_CLAIM_DEG: Final = 1.3
KINDS: Final = ("as recorded", "offset alone", "corrected before")
GROUPS: Final = {"offset": (slice(0, 3), 3), "gains": (slice(3, 6), 2), "cross-axis": (slice(6, 9), 3)}
"""Groups of the nine parameters, with their degrees of freedom without the strength of the field."""
SIZE: Final = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0


class Part(NamedTuple):
    """Result of a part of a recording, degrees."""

    verdict: str
    off: float  # difference from the whole
    combined: float  # combined claim of part and whole
    claim: float
    raw: float  # error of the readings themselves

    @property
    def is_worse(self) -> bool:
        """Whether the calibration makes the compass worse."""
        return self.off > self.raw + 2.0 * self.combined


def fitted(samples: Samples) -> Fit | None:
    """Fit of readings, also a refused one; None if no ellipsoid fits them."""
    try:
        return flinders.fit(samples)
    except Refused as refusal:
        return refusal.fit
    except FlindersError:
        return None


def off_deg(fit: Fit, whole: Fit) -> float:
    """Worst level heading difference, degrees, without the strength of the field."""
    ours, theirs = fit.calibration.ellipsoid.parameters, whole.calibration.ellipsoid.parameters
    apart = difference(ours, theirs)
    return level_error(whole.calibration.ellipsoid, np.outer(apart, apart), dip_deg=60.0).worst


def difference(ours: Floats, theirs: Floats) -> Floats:
    """(9,) difference of offset and shape, the other shape scaled to the same strength of the field."""
    scale = np.ones(9)
    scale[3:] = (SIZE @ ours) / (SIZE @ theirs)
    return ours - scale * theirs


def of_kind(samples: Samples, whole: Fit, kind: str) -> Samples:
    """The recording as one of `KINDS`: unchanged, or corrected with the fit of the whole."""
    if kind == "as recorded":
        return samples
    if kind == "offset alone":
        return replace(samples, field=samples.field - whole.calibration.offset)
    return replace(samples, field=whole.calibration.apply(samples.field))


def parts_of(samples: Samples) -> Iterator[Part]:
    """Fit the parts of a recording."""
    whole = fitted(samples)
    if whole is None:
        return
    for count in PARTS:
        ends = np.linspace(0, len(samples), count + 1).astype(int).tolist()
        for begin, end in pairwise(ends):
            fit = fitted(samples[begin:end])
            if fit is None or fit.claim.plane:
                continue
            claims = fit.heading_error_deg.worst, whole.heading_error_deg.worst
            raw = raw_error(whole.calibration.ellipsoid, dip_deg=60.0).worst
            yield Part(fit.verdict, off_deg(fit, whole), math.hypot(*claims), claims[0], raw)


def recordings() -> Iterator[tuple[Samples, Fit]]:
    """Yield recordings with a calibration, and the calibration."""
    for path in text_recordings():
        try:
            samples = flinders.read(path)
        except FlindersError:
            continue
        whole = fitted(samples)
        if (
            whole
            and whole.verdict != "refused"
            and not whole.claim.plane
            and whole.heading_error_deg.worst < MAX_CLAIM_DEG
        ):
            yield samples, whole


def windows() -> Iterator[str]:
    """The table of parts."""
    yield "| readings | verdict | parts | off 50 / 90 % | claim | ratio 50 / 90 % | beyond 3 | made worse |"
    yield "|---|---|---:|---:|---:|---:|---:|---:|"
    known = list(recordings())
    for kind in KINDS:
        parts = [part for samples, whole in known for part in parts_of(of_kind(samples, whole, kind))]
        for verdict in ("good", "limited", "refused"):
            some = [part for part in parts if part.verdict == verdict]
            off, ratios = np.array([part.off for part in some]), np.array([part.off / part.combined for part in some])
            yield (
                f"| {kind} | {verdict} | {len(some)} | {np.median(off):.2f}° / {np.quantile(off, 0.9):.2f}° | "
                f"{np.median([part.claim for part in some]):.2f}° | {np.median(ratios):.2f} / "
                f"{np.quantile(ratios, 0.9):.2f} | {np.sum(ratios > 3.0)} | {sum(part.is_worse for part in some)} |"
            )


def scaled_off(fit: Fit) -> Floats:
    """(9, 9) covariance of offset and shape without the part of the field's strength."""
    parameters, jacobian = fit.calibration.ellipsoid.parameters, np.eye(9)
    jacobian[3:] -= np.outer(parameters[3:], SIZE) / (SIZE @ parameters)
    scaled: Floats = jacobian @ fit.claim.covariance @ jacobian.T
    return scaled


def repeats() -> Iterator[str]:
    """The table of pairs of recordings of one board."""
    fits = {name: fitted(flinders.read(FOLDER / "pichim_betaflight" / f"{name}.csv")) for name in BOARD}
    names = " | ".join(GROUPS)
    yield f"| recordings of one board | verdicts | heading, worst | claim | ratio | nine | eight | {names} | strength |"
    yield "|---|---|" + "---:|" * (6 + len(GROUPS))
    rows = []
    for one, other in combinations(fits, 2):
        first, second = fits[one], fits[other]
        if first is None or second is None:
            continue
        off, claim = off_deg(first, second), math.hypot(first.heading_error_deg.worst, second.heading_error_deg.worst)
        rows.append([off / claim, *ratios(first, second)])
        cells = [f"{off:.2f}°", f"{claim:.2f}°", *(f"{number:.2f}" for number in rows[-1])]
        yield f"| {one}, {other} | {first.verdict}, {second.verdict} | {' | '.join(cells)} |"
    yield f"| median | | | | {' | '.join(f'{number:.2f}' for number in np.median(rows, axis=0))} |"


def ratios(first: Fit, second: Fit) -> list[float]:
    """Difference over its claim: of all nine parameters, without the strength, of each of `GROUPS`, of the strength."""
    ours, theirs = first.calibration.ellipsoid.parameters, second.calibration.ellipsoid.parameters
    whole, apart = first.claim.covariance + second.claim.covariance, difference(ours, theirs)
    scaled = scaled_off(first) + scaled_off(second)
    each = [chi(apart[part], scaled[part, part], freedom) for part, freedom in GROUPS.values()]
    strength = abs(SIZE @ (ours - theirs)) / math.sqrt(SIZE @ whole @ SIZE)
    return [chi(ours - theirs, whole, 9), chi(apart, scaled, 8), *each, float(strength)]


def chi(apart: Floats, covariance: Floats, freedom: int) -> float:
    """Root mean square of a difference in units of its covariance."""
    inverse = np.linalg.pinv(covariance, rcond=1e-10, hermitian=True)
    return math.sqrt(float(apart @ inverse @ apart) / freedom)


def main() -> None:
    """Print both tables."""
    for line in repeats():
        print(line, flush=True)
    print()
    for line in windows():
        print(line, flush=True)


if __name__ == "__main__":
    main()
