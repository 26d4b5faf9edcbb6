"""Proposal of unit and axes by the name of a chip, or by counts: their steps and the field strength that they give.

A name limits the candidates to the settings of one chip. Counts limit them to settings of any chip that give a
plausible strength of the earth's field and whose word length fits the readings. If several settings remain, all of them
are listed and none is chosen. A proposal is never applied.

>>> turned = np.random.default_rng(1).normal(size=(500, 3))
>>> readings = np.round(300 * turned / np.linalg.norm(turned, axis=1, keepdims=True))
>>> chip = find_chip("MPU-9250")
>>> proposal = propose_chip(ChipEvidence.of(readings, strength=300.0, chips=(chip,), named_by="the file"))
>>> proposal.reason
'the file names AK8963: 0.15 µT a count (16 bits) makes the field of 300 counts 45.0 µT'
>>> proposal.scale, proposal.advice
(0.15, "unit='counts', scale=0.15; axes='y,x,-z' for the axes of the accelerometer and gyro of an MPU-9250")
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.chips import SAME_AXES, Chip, ChipSetting, chips, find_chip
from flinders.core.units import COUNTS, PER_UNIT, WIDE_EARTH_FIELD_RANGE_UT
from flinders.errors import figures, python_arguments

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.arrays import Floats
    from flinders.errors import Spelling

MIN_READINGS: Final = 30
"""Smallest number of different readings for a common step; with fewer, a step may be a coincidence."""
SITE_SHARE: Final = 0.25
"""Largest relative difference between a strength and the field at a known place; iron on board makes a difference."""
RANGE_FACTOR: Final = 1.6
"""Largest ratio of a reading to the stated range; the 12-bit words of the HMC5883L reach 1.45 times its ±1.3 G."""
REGISTER_BITS: Final = 16
"""Word length in bits that is assumed if no source states one."""
MAX_OFFSET: Final = 12.0
"""Largest offset by iron, in field strengths; the largest in our recordings is 6.6."""
MAX_STEP_ERROR: Final = 0.05
"""Largest mean distance of readings from multiples of a step, in steps. Numbers without a step have 0.25."""
PRIMES: Final = (2, 3, 5, 7, 11, 13)
"""Factors by which the step of the readings may be larger than one count."""
MAX_LISTED: Final = 6
"""Largest number of steps in a sentence; the fields of a proposal have all of them."""
MAX_STRENGTHS: Final = 3
"""Largest number of strengths in a sentence; of more, only the smallest and the largest are stated."""
RIVALS: Final = ("HMC5883L", "QMC5883L")
"""Two chips of which one is often sold as the other; a proposal of only one of them says so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChipCandidate:
    """A setting of a chip that explains the readings."""

    chip: str  # name of the chip
    setting: str  # name of the setting
    lsb_ut: float  # µT: one count of the chip
    scale: float  # µT: one unit of the recorded numbers
    strength_ut: float | None  # µT: field strength; None if the coverage is too small
    is_usual: bool  # whether it is the setting after power-on, or that of common drivers


@dataclass(frozen=True, slots=True, kw_only=True)
class ChipProposal:
    """Chips that explain the readings, with a proposal for unit and axes."""

    chips: tuple[str, ...]  # names of the chips that remain; those of one maker follow each other
    named_by: str  # source of the chip's name, such as the name of the file; empty if only counts are used
    candidates: tuple[ChipCandidate, ...]  # settings that remain; empty if the recording states its unit
    unit: str  # proposed unit; empty for none
    scale: float | None  # proposed µT per count; None if no setting or several settings remain
    axes: str  # proposed mapping of the axes; empty if unknown
    reason: str  # reason of the proposal, in words
    advice: str  # proposed arguments or options; empty for none


@dataclass(frozen=True, slots=True, kw_only=True)
class ChipEvidence:
    """What is known about the chip behind some readings."""

    sample: Floats  # (N, 3) readings as recorded
    lowest: Floats  # (3,) smallest reading of each axis
    highest: Floats  # (3,) largest reading of each axis
    strength: float | None  # of the field, in the unit of the recorded numbers; None if the coverage is too small
    unit: str = COUNTS  # unit of the recording
    chips: tuple[Chip, ...] = ()  # chips that match a name
    named_by: str = ""  # source of that name
    site_ut: float | None = None  # µT: field at the place, if known
    is_mapped: bool = False  # whether axes were mapped already, by an autopilot or by the user

    @classmethod
    def of(
        cls,
        readings: Floats,
        *,
        strength: float | None,
        unit: str = COUNTS,
        chips: tuple[Chip, ...] = (),
        named_by: str = "",
        site_ut: float | None = None,
    ) -> Self:
        """Evidence with the ranges of (N, 3) readings."""
        return cls(
            sample=readings,
            lowest=readings.min(axis=0),
            highest=readings.max(axis=0),
            strength=strength,
            unit=unit,
            chips=chips,
            named_by=named_by,
            site_ut=site_ut,
        )

    @property
    def limits_ut(self) -> tuple[float, float]:
        """Lowest and highest plausible field strength in µT."""
        if self.site_ut is None:
            return WIDE_EARTH_FIELD_RANGE_UT
        return (1 - SITE_SHARE) * self.site_ut, (1 + SITE_SHARE) * self.site_ut


def propose_chip(evidence: ChipEvidence, spell: Spelling = python_arguments) -> ChipProposal | None:
    """Propose unit and axes; None if neither a name nor the readings give any."""
    if evidence.unit != COUNTS:
        return _propose_axes(evidence, spell) if evidence.chips else None
    step = whole_step(evidence.sample)
    if step is None:
        return _propose_by_fractions(evidence, spell)
    left = _find_candidates(evidence, step, evidence.chips or chips())
    if evidence.chips:
        return _propose_by_name(evidence, left, step, spell)
    return _propose_by_counts(evidence, left, step, spell) if left and evidence.strength is not None else None


def whole_step(readings: Floats) -> float | None:
    """Step between different values of (N, 3) whole numbers; None for fractions or for too few readings.

    >>> steps = np.random.default_rng(1).integers(-40, 40, (60, 3))
    >>> whole_step(steps * 1.0), whole_step(steps * 4.0), whole_step(steps * 0.5), whole_step(steps[:9] * 1.0)
    (1.0, 4.0, None, None)
    """
    if len(np.unique(readings, axis=0)) < MIN_READINGS or np.any(readings != np.round(readings)):
        return None
    step = int(np.gcd.reduce((readings - readings[0]).astype(np.int64), axis=None))
    return float(step) if step else None


def is_in_steps(readings: Floats, step: float) -> bool:
    """Whether (N, 3) readings are multiples of a step, and not of a larger one; the last digit may be rounded.

    >>> readings = np.round(np.random.default_rng(1).integers(-400, 400, (60, 3)) / 1090, 6)
    >>> is_in_steps(readings, 1 / 1090), is_in_steps(readings, 1 / 1370), is_in_steps(readings, 0.5 / 1090)
    (True, False, False)
    """
    return _are_multiples(readings, step) and not any(_are_multiples(readings, step * each) for each in PRIMES)


def _are_multiples(readings: Floats, step: float) -> bool:
    in_steps = readings / step
    return bool(np.mean(np.abs(in_steps - np.round(in_steps))) < MAX_STEP_ERROR)


def _find_candidates(evidence: ChipEvidence, step: float, of: Iterable[Chip]) -> tuple[ChipCandidate, ...]:
    """Settings of chips whose word length fits the readings, and whose field strength is plausible if it is known."""
    low, high = evidence.limits_ut
    left = []
    for chip in of:
        for setting in chip.settings:
            found = _make_candidate(evidence, step, chip, setting)
            if _holds_readings(evidence, step, chip, setting) and (
                found.strength_ut is None or low <= found.strength_ut <= high
            ):
                left.append(found)
    return tuple(left)


def _make_candidate(evidence: ChipEvidence, step: float, chip: Chip, setting: ChipSetting) -> ChipCandidate:
    """Candidate for a setting, with one count per step of the readings."""
    mean_ut = (2 * setting.lsb_ut + (setting.lsb_z_ut or setting.lsb_ut)) / 3
    return ChipCandidate(
        chip=chip.name,
        setting=setting.name,
        lsb_ut=setting.lsb_ut,
        scale=setting.lsb_ut / step,
        strength_ut=None if evidence.strength is None else evidence.strength / step * mean_ut,
        is_usual=_is_usual(chip, setting),
    )


def _is_usual(chip: Chip, setting: ChipSetting) -> bool:
    """Whether a setting is the one after power-on, or that of common drivers."""
    return setting.is_usual or setting is chip.settings[0]


def _holds_readings(evidence: ChipEvidence, step: float, chip: Chip, setting: ChipSetting) -> bool:
    """Whether the word length of a setting fits the readings, and iron can explain the offset of the readings."""
    low, high = evidence.lowest / step - setting.zero, evidence.highest / step - setting.zero
    word = 2.0 ** ((chip.bits or REGISTER_BITS) - 1)
    if setting.range_ut is not None:
        word = min(word, RANGE_FACTOR * setting.range_ut / setting.lsb_ut)
    offset = 0.0 if evidence.strength is None else float(np.max(np.abs(low + high))) / 2
    reach = max(float(np.max(np.abs(low))), float(np.max(np.abs(high))))
    return reach <= word and offset <= MAX_OFFSET * (evidence.strength or 0.0) / step


def _propose_by_name(
    evidence: ChipEvidence, left: Sequence[ChipCandidate], step: float, spell: Spelling
) -> ChipProposal:
    """Proposal by the settings that remain of a named chip."""
    names = " or ".join(chip.name for chip in evidence.chips)
    strength, scale = evidence.strength, _common_scale(left)
    if strength is None:
        usual = ", ".join(_setting_words(each) for each in left if each.is_usual)
        reason = f"{evidence.named_by} names {names}; the coverage is too small to determine its setting"
        reason += f" (usual: {usual})" if usual else ""
        scale = None
    elif not left:
        every = [_make_candidate(evidence, step, chip, setting) for chip in evidence.chips for setting in chip.settings]
        reason = (
            f"{evidence.named_by} names {names}, but none of its settings fits: they make the field of "
            f"{figures(strength, 3)} counts {_strength_words(every)}"
        )
    else:
        fitting = ", ".join(_setting_words(each) for each in left)
        reason = (
            f"{evidence.named_by} names {names}: {fitting} {'makes' if len(left) == 1 else 'make'} "
            f"the field of {figures(strength, 3)} counts {_strength_words(left)}"
        )
    return _make_proposal(evidence, left, scale=scale, reason=reason, spell=spell)


def _propose_by_counts(
    evidence: ChipEvidence, left: Sequence[ChipCandidate], step: float, spell: Spelling
) -> ChipProposal:
    """Proposal by the chips whose counts give a plausible field strength."""
    low, high = evidence.limits_ut
    shown = [each for each in left if each.is_usual] or left
    groups = groupby(sorted(shown, key=lambda each: each.lsb_ut), key=lambda each: each.lsb_ut)
    listed = [f"{lsb:.3g} ({', '.join(dict.fromkeys(each.chip for each in same))})" for lsb, same in groups]
    beyond = f" and {len(listed) - MAX_LISTED} more" if len(listed) > MAX_LISTED else ""
    reason = (
        f"steps of {step:g} and a field of {figures(evidence.strength or 0.0, 3)} counts fit a field of {low:.3g} to "
        f"{high:.3g} µT, {'as the earth has' if evidence.site_ut is None else 'as this place has'}, if a count is "
        f"{', '.join(listed[:MAX_LISTED])}{beyond} µT{_rival_words(evidence, left, step)}"
    )
    return _make_proposal(evidence, left, scale=_common_scale(left), reason=reason, spell=spell)


def _rival_words(evidence: ChipEvidence, left: Sequence[ChipCandidate], step: float) -> str:
    """Words for why a chip that is sold as a candidate is not a candidate itself; empty without such a chip."""
    names = {each.chip for each in left}
    missing = [name for name in RIVALS if name not in names]
    if len(missing) != 1:
        return ""
    chip = find_chip(missing[0])
    made = [_make_candidate(evidence, step, chip, setting) for setting in chip.settings]
    low, high = evidence.limits_ut
    if any(low <= (each.strength_ut or 0.0) <= high for each in made):
        return ""
    places = "no place on earth" if evidence.site_ut is None else "this place never"
    return f"; {chip.name} would make it {_strength_words(made)}, which {places} has"


def _propose_by_fractions(evidence: ChipEvidence, spell: Spelling) -> ChipProposal | None:
    """Proposal of a unit in which the step of fractions is one count of a chip, and the strength is plausible."""
    if evidence.strength is None or len(evidence.sample) < MIN_READINGS:
        return None
    low, high = evidence.limits_ut
    units = [unit for unit, factor in PER_UNIT.items() if low <= evidence.strength * factor <= high]
    steps = [
        (setting.lsb_ut / PER_UNIT[unit], unit, chip, setting)
        for unit in units
        for chip in evidence.chips or chips()
        for setting in chip.settings
        if not _is_of_one_digit(setting.lsb_ut / PER_UNIT[unit])
        and is_in_steps(evidence.sample, setting.lsb_ut / PER_UNIT[unit])
    ]
    if not steps:
        return None
    widest = max(step for step, *_ in steps)
    found = [(unit, chip, setting) for step, unit, chip, setting in steps if np.isclose(step, widest, rtol=1e-4)]
    unit = found[0][0]
    left = [
        ChipCandidate(
            chip=chip.name,
            setting=setting.name,
            lsb_ut=setting.lsb_ut,
            scale=PER_UNIT[unit],
            strength_ut=evidence.strength * PER_UNIT[unit],
            is_usual=_is_usual(chip, setting),
        )
        for _, chip, setting in found
    ]
    names = ", ".join(f"{each.chip} ({each.setting})" for each in left)
    reason = (
        f"steps of {widest:.3g} are one count of {names} in {unit}, and in {unit} the field is "
        f"{figures(evidence.strength * PER_UNIT[unit], 3)} µT"
    )
    return _make_proposal(evidence, left, unit=unit, scale=None, reason=reason, spell=spell)


def _is_of_one_digit(step: float) -> bool:
    """Whether a step is 1, 2 or 5 in one decimal place: numbers with few digits from any chip have such steps."""
    digit = step / 10.0 ** np.floor(np.log10(step) + 1e-9)
    return bool(np.any(np.isclose(digit, (1.0, 2.0, 5.0), rtol=1e-4)))


def _propose_axes(evidence: ChipEvidence, spell: Spelling) -> ChipProposal:
    """Proposal of axes for a named chip, if the unit of the readings is known."""
    names = " or ".join(chip.name for chip in evidence.chips)
    reason = f"{evidence.named_by} names {names}; the readings are in {evidence.unit} already"
    return _make_proposal(evidence, (), unit="", scale=None, reason=reason, spell=spell)


def _make_proposal(
    evidence: ChipEvidence,
    left: Sequence[ChipCandidate],
    *,
    unit: str = COUNTS,
    scale: float | None,
    reason: str,
    spell: Spelling,
) -> ChipProposal:
    """Make a proposal, with its advice."""
    names = tuple(dict.fromkeys(each.chip for each in left)) or tuple(chip.name for chip in evidence.chips)
    mapped = find_chip(names[0]) if len(names) == 1 and not evidence.is_mapped else None
    rounded = None if scale is None else float(f"{scale:.6g}")
    proposal = ChipProposal(
        chips=names,
        named_by=evidence.named_by if evidence.chips else "",
        candidates=tuple(left),
        unit=unit if unit != COUNTS or scale is not None else "",
        scale=rounded,
        axes="" if mapped is None or mapped.axes == SAME_AXES else mapped.axes,
        reason=reason,
        advice="",
    )
    advice = (_unit_advice(proposal, spell), _axes_advice(proposal.axes, mapped, spell))
    return replace(proposal, advice="; ".join(filter(None, advice)))


def _unit_advice(proposal: ChipProposal, spell: Spelling) -> str:
    """Advice on the unit: the scale, or each of several scales, or to name the chip."""
    if proposal.unit:
        return spell({"unit": proposal.unit, **({} if proposal.scale is None else {"scale": proposal.scale})})
    if not proposal.candidates:
        return ""
    if not proposal.named_by:
        return f"{spell({'chip': None})} with the name of the chip, for the µT of a count"
    scales = {f"{each.scale:.6g}": each.setting for each in proposal.candidates}
    written = [f"{scale} ({setting})" for scale, setting in scales.items()]
    return f"{spell({'scale': None})} with the µT of a count: {' or '.join(written)}"


def _axes_advice(axes: str, chip: Chip | None, spell: Spelling) -> str:
    """Advice on the mapping of axes, with the axes that result; empty without a mapping."""
    return "" if chip is None or not axes else f"{spell({'axes': axes})} for {chip.axes_are}"


def _common_scale(left: Sequence[ChipCandidate]) -> float | None:
    """µT per count if all candidates have the same; None otherwise."""
    scales = {each.scale for each in left}
    return scales.pop() if len(scales) == 1 else None


def _setting_words(candidate: ChipCandidate) -> str:
    setting = "" if candidate.setting == "fixed" else f" ({candidate.setting})"
    return f"{candidate.lsb_ut:.3g} µT a count{setting}"


def _strength_words(candidates: Sequence[ChipCandidate]) -> str:
    """Words for the field strengths of the settings: one, a few, or their range."""
    made = sorted(
        {figures(each.strength_ut or 0.0, 3): each.strength_ut or 0.0 for each in candidates}.items(),
        key=lambda each: each[1],
    )
    words = [each for each, _ in made]
    if len(words) > MAX_STRENGTHS:
        return f"{words[0]} to {words[-1]} µT"
    *first, last = words
    return f"{', '.join(first)} or {last} µT" if first else f"{last} µT"
