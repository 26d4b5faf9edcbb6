"""Words in sentences about other sensors: disturbances, aiding sensors, other magnetometers.

As in `flinders.findings.words`, each word is made only from values of its finding.

>>> noisy_share(0.021, 0.08), amount(1.7)
('2 to 8%', 'more than 100%')
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from flinders.core.axes import Axes
from flinders.core.compensation import range_warning as beyond_range
from flinders.core.disturbance import Disturbance, is_column, kind_and_motor, kind_of
from flinders.errors import figures
from flinders.findings.words import spans

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Row = Sequence[Any]


# ------------------------------------------------------------------------------------------------------- disturbances


def alike(collinear: Sequence[str]) -> str:
    """Names of disturbances whose values rose and fell together."""
    return ", ".join(collinear)


def noisy(noisy_names: Sequence[str]) -> str:
    """Names of disturbances whose log columns are noisy."""
    return ", ".join(noisy_names)


def noisy_what(noisy_names: Sequence[str]) -> str:
    """Words for the effect of noise in a log column."""
    if len(noisy_names) == 1:
        return "its measurement is noisy, and its effect was found"
    return "their measurements are noisy, and their effects were found"


def noisy_share(least_attenuation: float, most_attenuation: float) -> str:
    """Relative error by which the effects of noisy disturbances are too small."""
    least, most = f"{least_attenuation:.0%}", f"{most_attenuation:.0%}"
    return most if least == most else f"{100.0 * least_attenuation:.0f} to {most}"


def noisy_remedy(noisy_names: Sequence[str]) -> str:
    """Advice on a better log column for a noisy disturbance."""
    return f"a smoother {noisy_names[0]}" if len(noisy_names) == 1 else "them smoother"


def range_unit(name: str) -> str:
    """Unit of a disturbance, as a suffix of its numbers."""
    return kind_of(name).unit


def disturbance(
    name: str,
    per_unit: Sequence[float],
    reference: float,
    lowest: float,
    highest: float,
    lag_s: float,
    gain_per_unit: float,
    states: Sequence[str],
) -> str:
    """Words for an offset that follows a disturbance, with the offset's numbers."""
    numbers = (reference, lowest, highest, lag_s, gain_per_unit)
    return str(Disturbance(name, per_unit, *numbers, tuple(states)))  # type: ignore[arg-type]


def _disturbance_of_range(
    name: str, reference: float, lowest: float, highest: float, states: Sequence[str] = ()
) -> Disturbance:
    """A disturbance of which only the name and the range are known."""
    return Disturbance(name, (0.0, 0.0, 0.0), reference, lowest, highest, states=tuple(states))  # type: ignore[arg-type]


def at_end(name: str, reference: float, lowest: float, highest: float, states: Sequence[str]) -> str:
    """Words for the far end of the recorded range, or for the second state."""
    ranged = _disturbance_of_range(name, reference, lowest, highest, states)
    return f"{'while' if states else 'at'} {ranged.text_of(ranged.extreme_value)}"


def explains(
    name: str,
    unit: str,
    explained: float,
    explained_sigma: float,
    explained_share: float,
    explained_share_sigma: float,
) -> str:
    """Share of the residuals that a log column explains, with its uncertainty; empty for standard disturbances.

    >>> explains("wheel_rpm", "µT", 2.14, 0.012, 0.934, 0.0052)
    '; the column explains 93.40 ± 0.52% of the scatter, or 2.140 ± 0.012 µT rms'
    """
    if not is_column(name) or math.isnan(explained):
        return ""
    share = uncertain(100.0 * explained_share, 100.0 * explained_share_sigma)
    return f"; the column explains {share}% of the scatter, or {uncertain(explained, explained_sigma)} {unit} rms"


def uncertain(value: float, sigma: float) -> str:
    """A number and its standard deviation, both to the second digit of the latter.

    >>> uncertain(2.1437, 0.0123), uncertain(63.2, 4.1), uncertain(63.2, 14.0)
    ('2.144 ± 0.012', '63.2 ± 4.1', '63 ± 14')
    """
    places = max(1 - math.floor(math.log10(sigma)), 0) if sigma > 0.0 else 3
    return f"{value:.{places}f} ± {sigma:.{places}f}"


def highest_amount(name: str, highest: float) -> str:
    """Largest recorded value of a disturbance, with its unit."""
    return f"{highest:.3g}{kind_of(name).unit}"


def reference_amount(name: str, reference: float) -> str:
    """Value of a disturbance for which the offset of the calibration holds, with its unit."""
    return f"{reference:.3g}{kind_of(name).unit}"


def running(runs_along: float) -> str:
    """Remark that the other motors ran too."""
    return ", with the other motors running as in the recording" if runs_along else ""


def without(noise_uncompensated: float, noise: float) -> str:
    """Residual that readings would have if no disturbance were modelled, in words."""
    if math.isnan(noise_uncompensated):
        return ""
    return f"; without this correction, residuals are {figures(noise_uncompensated)} instead of {figures(noise)}"


def other_column(name: str) -> str:
    """Advice on a better log column than a throttle."""
    is_throttle = kind_and_motor(name)[0] == "throttle"
    return "record the current instead, to which the field is proportional, or " if is_throttle else ""


def out_of_range(name: str, lowest: float, highest: float) -> str:
    """Words for the fault of a disturbance whose values are out of range."""
    kind, far = kind_of(name), max(lowest, highest, key=abs)
    if not kind.plausible[0] <= far <= kind.plausible[1]:
        return (
            f"values of {name} go up to {far:.3g}{kind.unit}: the column is in another unit than {kind.per}. Convert "
            "the column; otherwise exported values are wrong by the ratio of the units"
        )
    return (
        f"{name} was recorded from {lowest:.3g} to "
        f"{highest:.3g}{kind.unit}: a drawn current is negative in this recording, but positive for autopilots. Change "
        "the sign of the column"
    )


def beyond_words(name: str, lowest: float, highest: float, beyond: float) -> str:
    """Remark that a disturbance exceeded the range that it had in the calibration."""
    return beyond_range(_disturbance_of_range(name, 0.0, lowest, highest), beyond)


# ----------------------------------------------------------------------------------------------------- aiding sensors


def as_what(rate_unit: str, axes: str) -> str:
    """Words for a better interpretation of a gyro: another unit, other axes, or the opposite sign."""
    if not rate_unit:
        return "with the other sign"
    return f"as {rate_unit}{f' with axes {axes}' if axes else ''}"


def amount(scale_error: float) -> str:
    """Error of a scale, in words; that of a failed fit only as "more than 100%"."""
    return f"{scale_error:.0%}" if scale_error <= 1.0 else "more than 100%"


def why_disagree(aid: str) -> str:
    """Reason why an aiding sensor contradicts a gyro."""
    if aid == "dip":
        return "the vertical leans, as an accelerometer does in steady turns"
    return "the attitude lags, or is that of another body"


def why_astray(aid: str) -> str:
    """Reason why a vertical or an attitude contradicts the readings."""
    if aid == "dip":
        return "the body was accelerated all the time, or the accelerometer is on another body"
    return "its quaternions turn from world to body or have w last, its times are wrong, or it is another body's"


def what_is_empty(aid: str) -> str:
    """Quantity that an aiding sensor needs and that the readings lack."""
    if aid == "rate":
        return "a rate and an ascending time"
    return "an acceleration" if aid == "dip" else "an attitude"


def instrument(aid: str) -> str:
    """Name of the instrument behind an aiding sensor."""
    return "gyro" if aid == "rate" else "accelerometer"


def how_it_sits(aid: str, axes: str, seat: str) -> str:
    """Words for the orientation of an instrument relative to the magnetometer.

    `seat` names the kind of result; an unknown name is treated as ``clear``.
    """
    what, other = instrument(aid), instrument("dip" if aid == "rate" else "rate")
    if seat == "mirrored":
        return (
            f"as a mirror image, {axes}, of the magnetometer's axes; the {what} was not used. One axis has the wrong "
            "sign: correct the sign where that axis is recorded"
        )
    if seat == "contradicted":
        return (
            f"with the magnetometer's axes mapped by {axes}, but the {other} does not; the {what} was not used. The "
            f"{what} is oriented differently from the magnetometer and the {other}: rotate the columns of the {what}"
        )
    if seat == "unclear":
        return (
            f"with the magnetometer's axes rotated, such as by {axes}; the {what} was not used. The motion does not "
            f"determine the rotation: rotate the columns of the {what} into the magnetometer's axes"
        )
    if seat == "half-turned":
        mended = Axes.of(axes).opposite
        return (
            f"with the magnetometer's axes mapped by {axes}, or by {mended}, which changes the sign of "
            f"{mended.mirrored_axis}. The sign of the dip decides between the two: give the place of the recording. "
            f"The correction maps readings by {axes}"
        )
    return (
        f"with the magnetometer's axes mapped by {axes}: the two are oriented differently, and the correction rotates "
        f"readings into the axes of the {what}"
    )


SITE_FAULTS: Final = {
    "reversed": "the vertical seems to be upside down (level and at rest, an accelerometer reads −g on z)",
    "turned": (
        "the vertical is upside down (level and at rest, an accelerometer reads −g on z), or an axis of the "
        "magnetometer has the wrong sign"
    ),
    "elsewhere": "check place and date, and whether iron was near",
}
"""Possible faults if the dip differs from that of the site, by name."""


def site_check(site_fault: str) -> str:
    """Checks to make if the dip differs from that of the site."""
    return SITE_FAULTS[site_fault]


# ----------------------------------------------------------------------------------------------- several magnetometers


def when(deviation_spans: Sequence[Row], deviation_count: float) -> str:
    """Times at which a sensor deviates from the others."""
    return spans(deviation_spans, deviation_count)


def why_deviates(is_by_length: float) -> str:
    """Evidence that a sensor deviates from the others."""
    return "the length of its readings changes" if is_by_length else "the others agree"


def does_not_rest(is_alone: float) -> str:
    """Remark that the calibration does not use the stretches in which a sensor deviates."""
    return "" if is_alone else ". These readings are not used in the calibration"


def disagreement(apart_deg: float, apart_share: float, deviation_spans: Sequence[Row], deviation_count: float) -> str:
    """Words for the difference between two sensors, and the share of the time; all the time if the share is NaN."""
    if math.isnan(apart_share):
        return f"averaged over a second, the two still differ by {figures(apart_deg)}° of heading all the time (1 σ)"
    return (
        f"magnetometers differ by up to {figures(apart_deg)}° of heading, for {apart_share:.0%} of the time "
        f"({spans(deviation_spans, deviation_count)})"
    )


def each_alone(apart_share: float) -> str:
    """Consequence for the calibration if two sensors disagree all the time."""
    if not math.isnan(apart_share):
        return ""
    return ". Each sensor is fitted by itself: check whether one is loose or its clock is wrong, or add a third sensor"


def who_is_mirrored(left_handed: Sequence[str]) -> str:
    """Names of the sensors that are most likely left-handed; empty if it may be either of two."""
    if not left_handed:
        return "One of the two is not right-handed: check which, and map its axes"
    return f"Most likely {' and '.join(left_handed)} is not right-handed, as the others agree: map its axes"


def in_the_vehicle(is_in_body: float) -> str:
    """Remark for the case that the mounting in the vehicle is unknown."""
    return "" if is_in_body else "; their mounting in the vehicle is not known"


def behind(delay_s: float) -> str:
    """Words for the sign of a clock's delay."""
    return "behind" if delay_s > 0 else "ahead of"


def why_alone(together_deg: float, alone_deg: float) -> str:
    """Reason why a sensor is not fitted together with the others."""
    if not together_deg and not alone_deg:
        return (
            "the readings do not determine the rotation between the magnetometers, and each magnetometer "
            "is fitted by itself: turn the body about all its axes"
        )
    return (
        f"the worst heading error of this sensor is {figures(alone_deg)}° fitted by itself, and "
        f"{figures(together_deg)}° fitted with the others. It is therefore fitted by itself, in its own axes: check "
        "the other sensors and their clocks"
    )


def shots(shot_numbers: Sequence[float]) -> str:
    """Shots of a survey by their numbers."""
    return f"shot {', '.join(f'{number:.0f}' for number in shot_numbers)}"


SENSOR_WORDS: Final[dict[str, Callable[..., str]]] = {
    word.__name__: word
    for word in (
        *(alike, noisy, noisy_what, noisy_share, noisy_remedy, range_unit, disturbance, at_end, highest_amount),
        *(
            reference_amount,
            running,
            explains,
            without,
            other_column,
            out_of_range,
            beyond_words,
            as_what,
            amount,
            why_disagree,
        ),
        *(why_astray, what_is_empty, instrument, how_it_sits, site_check, when, why_deviates, does_not_rest),
        *(disagreement, each_alone, who_is_mirrored, in_the_vehicle, behind, why_alone, shots),
    )
}
"""Words about other sensors, by their names in sentences."""
