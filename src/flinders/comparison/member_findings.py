"""Findings on one of several magnetometers by comparison with the others: its axes, its clock and its readings.

>>> from flinders.comparison.members import Agreement, Member, MultiFit
>>> from flinders.errors import FitError
>>> silent = Member("aft", FitError("no readings"), FitError("no readings"), copy_of="bow")
>>> add_member_findings(MultiFit((silent,), "bow", Agreement(0, 0.0), is_joint=False), 0, 1.0).findings[0].code
'copied-sensor'
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.findings import Finding, certain_finding, findings_in, link_causes
from flinders.fitting.result import Fit, Refused, fit_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.comparison.agreement import Disagreement
    from flinders.comparison.members import Member, MultiFit

DECADE_WIDTH: Final = 0.25
"""Width in decades of the range about a power of ten in which the ratio of two sensors' readings shows another unit."""


def add_member_findings(together: MultiFit, place: int, target_deg: float) -> Member:
    """Add to a member, and to its fit, the findings from the comparison with the other members."""
    member = together.members[place]
    findings = link_causes(_findings(together, place, target_deg))
    judged = fit_of(member.fit)
    if judged is None:
        return replace(member, findings=findings)
    judgement = replace(judged.judgement, findings=link_causes((*judged.findings, *findings)))
    judged = replace(judged, judgement=judgement)
    return replace(member, fit=Refused(judged) if judged.verdict == "refused" else judged, findings=findings)


def _findings(together: MultiFit, place: int, target_deg: float) -> Iterator[Finding]:
    """Findings on a member other than those of its own fit."""
    member, reference = together.members[place], together.reference
    if member.copy_of:
        yield certain_finding({"is_copy": 1.0, "other": member.copy_of}, "copied-sensor")
        return
    if together.agreement.apart_deg:
        yield _constant_disagreement(together.agreement.apart_deg, target_deg)
        return
    if member.is_kept:
        yield _better_alone(member)
    elif not together.is_joint:
        yield certain_finding({"is_alone": 1.0, "together_deg": 0.0, "alone_deg": 0.0}, "not-together")
        return
    yield from _axes_findings(together, member)
    yield from _clock_findings(member, reference)
    others = [other.scatter_deg for other in together.members if other is not member and not other.copy_of]
    numbers = {"scatter_deg": member.scatter_deg, "best_other_deg": min(others, default=math.inf)}
    yield from findings_in({**numbers, "target_deg": target_deg}, "sensor-deviates-throughout")
    yield from _disagreement_findings(together, place, target_deg)


def _constant_disagreement(apart_deg: float, target_deg: float) -> Finding:
    """Finding that two sensors disagree all the time."""
    numbers = {"apart_deg": apart_deg, "target_deg": target_deg, "apart_share": math.nan}
    return certain_finding({**numbers, **_stretch_values(())}, "disagree")


def _better_alone(member: Member) -> Finding:
    """Finding that a sensor is better calibrated alone than with the others."""
    worst = cast("Fit", fit_of(member.alone)).heading_error_deg.worst
    return certain_finding({"is_alone": 1.0, "together_deg": member.joint_deg, "alone_deg": worst}, "not-together")


def _left_handed(together: MultiFit) -> list[str]:
    """Names of the sensors that are probably left-handed: the smaller group, if both kinds exist."""
    turned = [member for member in together.members if member.rotation is not None and not member.copy_of]
    mirrored = sum(member.is_mirrored for member in turned)
    rest = len(turned) - mirrored
    if mirrored == rest:
        return []
    return [member.name for member in turned if member.is_mirrored == (mirrored < rest)]


def _axes_findings(together: MultiFit, member: Member) -> Iterator[Finding]:
    """Findings on the axes and the unit of a member."""
    reference = together.reference
    if member.rotation is None or member.rotation_sigma_deg is None or member.name == reference:
        return
    named = {"reference": reference, "axes": str(member.axes)}
    if member.is_mirrored:
        yield certain_finding({**named, "handedness": -1.0, "left_handed": _left_handed(together)}, "mirrored-sensor")
    turned = {
        "is_turned": 1.0,
        "rotation_sigma_deg": float(member.rotation_sigma_deg.max()),
        "misalignment_deg": member.misalignment_deg,
        "is_in_body": together.in_body,
    }
    yield certain_finding({**named, **turned}, "turned-to")
    decades = round(math.log10(member.length_ratio))
    if decades and abs(math.log10(member.length_ratio) - decades) < DECADE_WIDTH * 0.5:
        numbers = {"is_decades_off": 1.0, "times_as_long": member.length_ratio, "decade": 10.0**decades}
        yield certain_finding({**numbers, "reference": reference}, "unlike-units")


def _clock_findings(member: Member, reference: str) -> Iterator[Finding]:
    """Finding that a member has another clock."""
    if member.delay_s:
        numbers = {
            "is_delayed": 1.0,
            "delay_s": member.delay_s,
            "delay_ms": 1e3 * abs(member.delay_s),
            "delay_sigma_ms": 1e3 * member.delay_sigma_s,
        }
        yield certain_finding({**numbers, "reference": reference}, "clock-differs")


def _disagreement_findings(together: MultiFit, place: int, target_deg: float) -> Iterator[Finding]:
    """Findings on times at which a member deviates from the others, or may be the deviating one of two."""
    runs = [run for run in together.agreement.disagreements if run.sensor == place]
    if runs:
        numbers = {
            "departs_share": _share(runs, together),
            "departs_deg": max(run.heading_deg for run in runs),
            "target_deg": target_deg,
        }
        told = {"is_by_length": all(run.is_by_length for run in runs), "is_alone": together.members[place].is_kept}
        yield certain_finding({**numbers, **told, **_stretch_values(runs)}, "sensor-deviates")
    unsettled = [run for run in together.agreement.disagreements if run.sensor is None]
    if unsettled and (len(together.members) == 2 or together.members[place].name == together.reference):
        worst, share = max(run.heading_deg for run in unsettled), _share(unsettled, together)
        numbers = {"apart_deg": worst, "target_deg": target_deg, "apart_share": share}
        yield certain_finding({**numbers, **_stretch_values(unsettled)}, "disagree")


def _share(runs: Sequence[Disagreement], together: MultiFit) -> float:
    """Share of all readings within some stretches."""
    return sum(run.last - run.first + 1 for run in runs) / max(together.agreement.instants, 1)


def _stretch_values(runs: Sequence[Disagreement]) -> dict[str, Any]:
    """Values of a finding: the three stretches with the largest heading error, in time order, and the count of all."""
    chosen = sorted(runs, key=lambda run: -run.heading_deg)[:3]
    listed = sorted(chosen, key=lambda run: run.start_s)
    spans = [(run.first + 1, run.last + 1, run.start_s, run.end_s) for run in listed]
    return {"deviation_spans": spans, "deviation_count": len(runs)}
