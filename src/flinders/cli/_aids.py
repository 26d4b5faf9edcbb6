"""What was recorded beside the magnetometer, on the command line: ``--with rate,dip``, and at which site."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from flinders.cli._site import site_of
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.core.geomag import SiteField


def taken(words: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split what stands after ``--with`` into aids and into the rest, which are disturbances.

    Raises
    ------
    UsageError
        Where ``auto`` stands beside other aids, or nothing stands there.

    Examples
    --------
    >>> taken(["rate,dip", "current"])
    (('rate', 'dip'), ('current',))
    """
    from flinders.fitting.aid_selection import AIDS, AUTO

    words = list(words)
    names = [name.strip() for word in words for name in word.split(",") if name.strip()]
    if words and not names:
        raise UsageError("--with names nothing: say what else was recorded, such as --with rate,dip, or --with auto")
    aiding = tuple(dict.fromkeys(name for name in names if name in AIDS or name == AUTO))
    if AUTO in aiding and len(aiding) > 1:
        raise UsageError(f"--with {','.join(aiding)}: auto takes what the recording contains, name nothing beside it")
    return aiding, tuple(name for name in names if name not in aiding)


def add(
    options: dict[str, Any],
    words: Iterable[str],
    place: str | None,
    date: str | None,
    gain_sigma: float | None = None,
    gyro_scale: float | None = None,
    acceleration_bias: float | None = None,
) -> tuple[str, ...]:
    """Put aids and site among the options of a fit, and give back what else stood after ``--with``.

    The dip is that of the site, unless ``--dip`` was given; axes that were typed are those of the vehicle, z down.

    Raises
    ------
    UsageError
        For a site without a date or beyond what the model holds, for what goes with a site where there is none, and
        for what goes with a gyro or an accelerometer that does not count.
    """
    aiding, rest = taken(words)
    if aiding:
        options["aiding"] = "auto" if aiding == ("auto",) else aiding
    if gyro_scale is not None:
        if not {"rate", "auto"} & set(aiding):
            raise UsageError("--gyro-scale goes with --with rate or auto: leave it out, or name the gyro")
        options["gyro_scale"] = gyro_scale
    if acceleration_bias is not None:
        if not {"dip", "auto"} & set(aiding):
            raise UsageError(
                "--accelerometer-bias goes with --with dip or auto: leave it out, or name the accelerometer"
            )
        options["acceleration_bias"] = acceleration_bias
    if place is None:
        if date is not None:
            raise UsageError("--date goes with --at: give both, or neither")
        if gain_sigma is not None:
            raise UsageError("--gain-sigma goes with --at: without the strength of a site no gain is looked at")
        return rest
    import click

    from flinders.likelihood.site_field import Site

    site = Site.of(_field_of(place, date))
    context = click.get_current_context(silent=True)

    def is_typed(name: str) -> bool:
        typed = click.core.ParameterSource.COMMANDLINE
        return context is not None and context.get_parameter_source(name) is typed

    site = replace(site, z_down=is_typed("axes"))
    options["site"] = site if gain_sigma is None else replace(site, gain_sigma=gain_sigma)
    if not is_typed("dip_deg"):
        options["dip_deg"] = site.inclination_deg
    return rest


def _field_of(place: str, date: str | None) -> SiteField:
    """The field of a site on a day.

    Raises
    ------
    UsageError
        For no place, no day, or one without a model.
    """
    if date is None:
        raise UsageError(
            "the field changes with the years: give the day of the recording with --at, such as --date 2026-11-21, "
            "or leave --at out"
        )
    return site_of(place, date)


def told(fit: Any) -> str:  # noqa: ANN401 - a Fit
    """What each aid and each disturbance changed, a line each; nothing where there were none.

    >>> from types import SimpleNamespace
    >>> from flinders.fitting.aiding import AidingSensor, Aiding
    >>> each = AidingSensor("rate", True, 0.4, 2.0, 0.5), AidingSensor("dip", False, words="claims no less: 0.60° with
    it, 0.50° without")
    >>> print(told(SimpleNamespace(aiding=Aiding(each))))
    rate changed the heading by 0.40°: worst error 2.00° without it, 0.50° with it
    dip was left out: claims no less: 0.60° with it, 0.50° without
    """
    lines = []
    for aid in () if fit.aiding is None else fit.aiding.each:
        claims = aid.words or f"worst error {aid.before_deg:.2f}° without it, {aid.after_deg:.2f}° with it"
        lines.append(
            f"{aid.name} changed the heading by {aid.changed_deg:.2f}°: {claims}"
            if aid.kept
            else f"{aid.name} was left out: {aid.words}"
        )
    if (
        fit.aiding is not None
        and fit.aiding.acceleration_bias is not None
        and fit.aiding.acceleration_bias_sigma is not None
    ):
        x, y, z = (f"{value:.3f}" for value in fit.aiding.acceleration_bias_sigma)
        lines.append(
            f"{biased(fit.aiding.acceleration_bias)} (1 σ: {x}, {y}, {z}); the calibration file keeps it, and flinders "
            "heading uses it"
        )
    return "\n".join(lines)


def biased(bias: Iterable[float]) -> str:
    """What an accelerometer reads too much, in words.

    >>> biased([0.1784, -0.3, 0.0])
    'the accelerometer reads 0.178, −0.300 and 0.000 m/s² too much along x, y and z'
    """
    x, y, z = (f"{round(value, 3) + 0.0:.3f}".replace("-", "−") for value in bias)
    return f"the accelerometer reads {x}, {y} and {z} m/s² too much along x, y and z"
