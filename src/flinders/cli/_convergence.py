"""``--convergence``: how the estimate settles, as a drawing or a table beside the calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flinders.cli._talk import say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.samples import Recording

KINDS: Final = (".svg", ".csv")


def refuse(path: str | None, method: str) -> None:
    """Find what cannot work before anything is read.

    Raises
    ------
    UsageError
        For a method that cannot be watched, or a file that is neither a drawing nor a table.
    """
    from flinders.estimators import METHODS

    if path is None:
        return
    watched = [name for name, kind in METHODS.items() if hasattr(kind, "converge")]
    if method not in watched:
        raise UsageError(
            f"--convergence goes with --method {' or '.join(watched)}: {method} looks at all readings at once, and "
            "there is nothing to watch"
        )
    if Path(path).suffix.lower() not in KINDS:
        raise UsageError(f"--convergence {path}: need a name that ends in {' (drawing) or '.join(KINDS)} (table)")


def write(path: str | None, recording: Recording, options: dict[str, Any], *, force: bool) -> None:
    """Follow the method through a recording, and write what was seen.

    Raises
    ------
    FitError
        As the method.
    OutputError
        Where it cannot be written.
    """
    import dataclasses

    from flinders.estimators import METHODS, Readings, within_range
    from flinders.files import write_text
    from flinders.report.convergence import Settling, drawing, table

    if path is None:
        return
    method: Any = METHODS[options["method"]]
    known = [field.name for field in dataclasses.fields(method)]
    estimator = method(**{name: value for name, value in options.items() if name in known})
    steps = estimator.converge(within_range(Readings.of(recording)))
    settling = Settling(
        steps,
        options["method"],
        unit=recording.unit.inside,
        dip_deg=options["dip_deg"],
        target_deg=options["target_deg"],
    )
    is_drawing = Path(path).suffix.lower() == KINDS[0]
    write_text(drawing(settling) if is_drawing else table(settling), path, force=force)
    say(f"convergence written to {path}")
