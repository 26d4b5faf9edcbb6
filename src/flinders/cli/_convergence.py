"""``--convergence``: how the estimate converges, as a drawing or a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flinders.cli._output import say
from flinders.cli.methods import SITE
from flinders.errors import FitError, UsageError

if TYPE_CHECKING:
    from flinders.core.samples import Recording
    from flinders.estimators import Convergence

KINDS: Final = (".svg", ".csv")

OF_THE_FIT: Final = ("method", "target_deg", "alignment_sigma_deg", "disturbances", "sensor")
"""Options of `flinders.fit` that no method asks for."""


def refuse(path: str, method: str) -> None:
    """Find what cannot work before anything is read.

    Raises
    ------
    UsageError
        For a method that cannot be watched, or a file that is neither a drawing nor a table.
    """
    from flinders.estimators import METHODS
    from flinders.estimators.reference.trace import Watched

    watched = [name for name, kind in METHODS.items() if issubclass(kind, Watched)]
    if method not in watched:
        raise UsageError(
            f"--convergence goes with --method {' or '.join(watched)}: {method} looks at all readings at once, and "
            "there is nothing to watch"
        )
    if Path(path).suffix.lower() not in KINDS:
        raise UsageError(f"--convergence {path}: need a name that ends in {' (drawing) or '.join(KINDS)} (table)")


def write(path: str, recording: Recording, options: dict[str, Any], *, force: bool) -> None:
    """Follow the method through a recording, and write the trace; also where the fit is refused.

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    from flinders.core.files import write_text
    from flinders.report.drawings import Trace, convergence_drawing, convergence_table

    steps = _watched(recording, options)
    if steps is None or steps.last is None:
        say(f"{path} was not written: {options['method']} had nothing at any step")
        return
    trace = Trace(
        steps,
        options["method"],
        unit=recording.unit.inside,
        dip_deg=options["dip_deg"],
        target_deg=options["target_deg"],
    )
    is_drawing = Path(path).suffix.lower() == KINDS[0]
    write_text(convergence_drawing(trace) if is_drawing else convergence_table(trace), path, force=force)
    say(f"convergence written to {path}")


def _watched(recording: Recording, options: dict[str, Any]) -> Convergence | None:
    """The estimates of the method, with its options, step by step; None where there are none."""
    from flinders.estimators import Readings, within_range
    from flinders.estimators.reference.trace import Watched
    from flinders.fitting.calibrate import estimator_of

    site = {name: options[name] for name in SITE}
    own = {name: value for name, value in options.items() if name not in {*SITE, *OF_THE_FIT}}
    estimator = estimator_of(options["method"], own, site)
    try:
        return estimator.converge(within_range(Readings.of(recording))) if isinstance(estimator, Watched) else None
    except FitError:
        return None
