"""``flinders calibrate --sensor all``: each magnetometer of a log or table, on its own or in one joint fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.cli._inputs import columns_in, provenance, say_read, saying_what_was_read
from flinders.cli._output import Outputs, error_words, print_result, progress, say
from flinders.cli._program import EXITS
from flinders.cli._spelling import in_options
from flinders.errors import FitError, FlindersError, InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from flinders.comparison.members import Together
    from flinders.core.samples import Recording
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter
    from flinders.likelihood.site_field import Site
    from flinders.readers import Log
    from flinders.workflows.onboard import OnboardCheck
    from flinders.workflows.sensors import Outcome

PLACE: Final = "{sensor}"
"""What stands for the number of the magnetometer in the name of a file."""

OF_JOINT_FITS: Final = ("target_deg", "aiding", "site")
"""Options of `flinders.fit_multi` that are those of `flinders.fit`."""


@dataclass(frozen=True, slots=True)
class MultiSensor:
    """A log or table of several magnetometers, how they are fitted, and where their calibrations go."""

    path: str
    output: str | None  # {sensor} stands for the number of the magnetometer
    force: bool
    as_json: bool
    is_joint: bool  # all are fitted jointly
    reference: str | None  # the one into whose axes the others are then turned
    by: Filter | None
    told_by: Callable[[Log], Site | None]  # the site that the log states
    site_with: Callable[[Site], Site | None]  # that site with the numbers that were typed

    def calibrate(self, reading: dict[str, Any], options: dict[str, Any]) -> int:
        """Calibrate each magnetometer, or all of them jointly, and print a table of the results."""
        from flinders.estimators.data import CountedRecording
        from flinders.readers import open_log

        self._refuse(options)
        multi: Together | None = None
        with progress("reading") as watch:
            log = open_log(self.path, progress=watch, **reading)
            _refuse_chosen(log, reading)
            columns = columns_in(options.get("disturbances", ()))
            parts = {each.name: CountedRecording(each.with_auxiliary(columns)) for each in log.instruments}
            paths = [named_for(self.output, number) for number in range(1, len(parts) + 1)]
            Outputs.of(*(("the calibration", each) for each in paths), force=self.force).check([self.path])
            if (site := self.told_by(log)) is not None:
                options = {**options, "site": self.site_with(site)}
            if self.is_joint:
                multi = self._fitted_jointly(log, parts, options)
            made = self._each(parts, options) if multi is None else ((one.name, one.fit) for one in multi.members)
            outcomes = list(self._saved(made, parts.values(), paths))  # each at once: the next may be interrupted
        onboard = _judged_onboard(outcomes, parts)
        unread = [outcome for _, outcome in outcomes if isinstance(outcome, InputError)]
        if len(unread) == len(outcomes):
            raise unread[0]
        print_result(
            lambda: _as_dict(outcomes, paths, multi, onboard),
            lambda: _page(outcomes, multi, options["target_deg"], onboard),
            as_json=self.as_json,
        )
        written = [path for path, (_, outcome) in zip(paths, outcomes, strict=True) if path and not _is_error(outcome)]
        names = ", ".join(written)
        say(f"written to {names}" if names else "nothing was written: name files with -o compass-{sensor}.json")
        return max(_exit_code(outcome) for _, outcome in outcomes)

    def _refuse(self, options: Mapping[str, Any]) -> None:
        """Refuse options that go with one magnetometer."""
        if self.output == "-":
            raise UsageError(
                "several calibrations do not go to standard output: name files, such as -o compass-{sensor}.json"
            )
        method, site = options["method"], options["site"]
        of_one_fit = {
            "--method": method.name != "auto",
            "--robust": getattr(method, "robust", False),
            "--with current, throttle or temperature": bool(options.get("disturbances")),
            "--alignment-sigma": site is not None and site.alignment_sigma_deg is not None,
            "--at without --with": site is not None and site.evidence is not None and not options.get("aiding"),
            "--filter": self.by is not None,
            "--prior none": getattr(method, "prior", 1.0) is None,
        }
        for option, is_given in of_one_fit.items():
            if self.is_joint and is_given:
                raise UsageError(f"{option} is for one magnetometer by itself: leave it out with --joint")

    def _fitted_jointly(self, log: Log, parts: dict[str, CountedRecording], options: dict[str, Any]) -> Together:
        """Fit all magnetometers of a log jointly."""
        from flinders.comparison.multi_sensor import fit_multi

        chosen = None if self.reference is None else log.sensor(self.reference).name
        if len(parts) < 2:
            raise UsageError(f"{log.source} has one magnetometer: leave --joint out")
        asked = {name: options[name] for name in OF_JOINT_FITS if name in options}
        with saying_what_was_read(list(parts.values())):
            return fit_multi(parts, reference=chosen, prior=options["method"].prior, **asked)

    def _each(self, parts: Mapping[str, CountedRecording], options: dict[str, Any]) -> Iterator[tuple[str, Outcome]]:
        """Fit one magnetometer after the other, and say what was read of each."""
        from flinders.workflows.sensors import fits_of

        for name, outcome in fits_of(parts, by=self.by, notice=say, **options):
            say_read(parts[name])
            yield name, outcome

    def _saved(
        self, outcomes: Iterator[tuple[str, Outcome]], parts: Iterable[CountedRecording], paths: Sequence[str | None]
    ) -> Iterator[tuple[str, Outcome]]:
        """Write the calibrations that were not refused."""
        for (name, outcome), part, path in zip(outcomes, parts, paths, strict=True):
            if path and not _is_error(outcome):
                cast("Fit", outcome).save(path, force=self.force, provenance=provenance([part]))
            yield name, outcome


def _is_error(outcome: Outcome) -> bool:
    return isinstance(outcome, FlindersError)


def _judged_onboard(outcomes: Sequence[tuple[str, Outcome]], parts: Mapping[str, Recording]) -> dict[str, OnboardCheck]:
    """What was on board of each magnetometer that was fitted, by its name, where the log tells it."""
    from flinders.workflows.onboard import judge_onboard

    found = {}
    for name, outcome in outcomes:
        if not isinstance(outcome, FlindersError) and (judged := judge_onboard(parts[name], outcome)) is not None:
            found[name] = judged
    return found


def _refuse_chosen(log: Log, reading: dict[str, Any]) -> None:
    """Refuse what says already which magnetometer it is."""
    if reading["columns"] is not None:
        raise UsageError("--sensor all takes each magnetometer, --columns says which one it is: leave one of them out")
    if reading["topic"] is not None and not log.is_table:
        raise UsageError("--sensor all takes each magnetometer, --topic says which one it is: leave one of them out")
    if log.is_table and len(log.instruments) == 1:
        raise UsageError(f"{log.source} has one magnetometer: leave --sensor all out")


def _page(
    outcomes: Sequence[tuple[str, Outcome]],
    multi: Together | None,
    target_deg: float,
    onboard: Mapping[str, OnboardCheck],
) -> RenderableType:
    """What a terminal shows."""
    from flinders.report.fit_pages import of_sensors, of_several

    if multi is not None:
        return of_several(multi, target_deg, in_options)
    rows = [
        (name, FitError(outcome.message) if isinstance(outcome, InputError) else outcome) for name, outcome in outcomes
    ]
    return of_sensors(cast("list[tuple[str, Fit | FitError]]", rows), target_deg, onboard)


def _as_dict(
    outcomes: Sequence[tuple[str, Outcome]],
    paths: Sequence[str | None],
    multi: Together | None,
    onboard: Mapping[str, OnboardCheck],
) -> dict[str, Any]:
    """JSON-ready: a list of fits, each with what was on board and what a joint fit says of it."""
    rows = [_row(*outcome, path) for outcome, path in zip(outcomes, paths, strict=True)]
    for row in rows:
        if judged := onboard.get(row["sensor"]):
            row["onboard"] = judged.as_dict()
    if multi is None:
        return {"sensors": rows}
    joint = [{**row, "joint": member.as_dict()} for row, member in zip(rows, multi.members, strict=True)]
    return {**multi.as_dict(), "sensors": joint}


def _row(name: str, outcome: Outcome, path: str | None) -> dict[str, Any]:
    """JSON-ready: the fit as ``calibrate --json`` has it, and of which magnetometer it is."""
    from flinders.fitting.fit_json import json_of

    if not isinstance(outcome, FlindersError):
        return {"sensor": name, "written": path, **json_of(outcome)}
    fit = getattr(outcome, "fit", None)
    error = {"code": outcome.code, "message": error_words(outcome), "evidence": outcome.evidence}
    return {"sensor": name, "written": None, "verdict": "refused", **(json_of(fit) if fit else {}), "error": error}


def named_for(output: str | None, number: int) -> str | None:
    """The file of one magnetometer: its number in place of ``{sensor}``, or before the ending.

    >>> named_for("compass-{sensor}.json", 2), named_for("out/calibration.json", 2)
    ('compass-2.json', 'out/calibration-2.json')
    """
    if output is None:
        return None
    if PLACE in output:
        return output.replace(PLACE, str(number))
    path = Path(output)
    return str(path.with_name(f"{path.stem}-{number}{path.suffix}"))


def _exit_code(outcome: Outcome) -> int:
    """How it ends for one magnetometer."""
    return outcome.exit_code if isinstance(outcome, FlindersError) else EXITS[outcome.verdict]
