"""All magnetometers of a log or table in one fit: ``calibrate --sensor all --together``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from flinders.cli._sources import Counted, provenance
from flinders.errors import FlindersError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.comparison.multi_sensor import Together
    from flinders.heading.smoothing import Filter
    from flinders.readers import Log

TAKEN: Final = ("target_deg", "dip_deg", "field_strength", "prior", "aiding", "site")
"""Options of `flinders.fit_multi`."""


def refuse(options: dict[str, Any], by: Filter | None) -> None:
    """Refuse options of a single fit that the joint one has not.

    Raises
    ------
    UsageError
        Naming the first of them.
    """
    given = {
        "--method": options["method"] != "auto",
        "--robust": bool(options.get("robust")),
        "--with current, throttle or temperature": bool(options.get("disturbances")),
        "--alignment-sigma": options.get("alignment_sigma_deg") is not None,
        "--at without --with": options.get("site") is not None and not options.get("aiding"),
        "--filter": by is not None,
        "--prior none": options.get("prior", 1.0) is None,
    }
    for option, is_given in given.items():
        if is_given:
            raise UsageError(f"{option} is for one magnetometer by itself: leave it out with --together")


def fitted(
    log: Log, paths: Sequence[str | None], reference: str | None, options: dict[str, Any], *, force: bool
) -> Together:
    """Fit all magnetometers of a log together, and write the calibration of each that is not refused.

    Raises
    ------
    UsageError
        For a reference that there is not, or a log with just one.
    """
    from flinders.comparison.multi_sensor import fit_multi

    chosen = None if reference is None else log.sensor(reference).name
    parts = {instrument.name: Counted(instrument) for instrument in log.instruments}
    if len(parts) < 2:
        raise UsageError(f"{log.source} has one magnetometer: leave --together out")
    asked = {name: options[name] for name in TAKEN if options.get(name) is not None}
    found = fit_multi(parts, reference=chosen, **asked)
    for member, part, path in zip(found.members, parts.values(), paths, strict=True):
        if path and not isinstance(member.fit, FlindersError):
            member.fit.save(path, force=force, provenance=provenance([part]))
    return found
