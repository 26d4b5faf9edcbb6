"""``flinders calibrate --sensor all``: fit each magnetometer of a log or table, separately or jointly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.cli._inputs import columns_in, provenance, report_readings, say_read
from flinders.cli._output import Outputs, error_words, print_result, progress, say
from flinders.cli._program import EXITS
from flinders.cli._spelling import in_options
from flinders.errors import FitError, FlindersError, InputError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from flinders.comparison.members import MultiFit
    from flinders.core.samples import Recording
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter
    from flinders.likelihood.site_field import Site
    from flinders.readers import Log
    from flinders.workflows.onboard import OnboardCheck
    from flinders.workflows.sensors import Outcome

SENSOR_PLACEHOLDER: Final = "{sensor}"
"""Placeholder for the number of the magnetometer in a file name."""

JOINT_FIT_OPTIONS: Final = ("target_deg", "aiding", "site")
"""Options that `flinders.fit_multi` shares with `flinders.fit`."""


@dataclass(frozen=True, slots=True)
class MultiSensor:
    """Calibrate several magnetometers of one log or table, separately or jointly."""

    path: str
    output: str | None  # may contain {sensor}, which the number of the magnetometer replaces
    force: bool
    as_json: bool
    is_joint: bool  # all are fitted jointly
    reference: str | None  # magnetometer whose axes the others are rotated into after a joint fit
    by: Filter | None
    told_by: Callable[[Log], Site | None]  # returns the site stated in the log
    site_with: Callable[[Site], Site | None]  # returns a site with the typed numbers in it

    def calibrate(self, reading: dict[str, Any], options: dict[str, Any]) -> int:
        """Calibrate each magnetometer, or all of them jointly, and print a table of the results."""
        from flinders.estimators.data import CountedRecording
        from flinders.readers import open_log

        self._refuse(options)
        multi: MultiFit | None = None
        with progress("reading") as watch:
            log = open_log(self.path, progress=watch, **reading)
            _refuse_chosen(log, reading)
            columns = columns_in(options.get("disturbances", ()))
            parts = {each.name: CountedRecording(each.with_auxiliary(columns)) for each in log.instruments}
            paths = [path_for_sensor(self.output, number) for number in range(1, len(parts) + 1)]
            Outputs.of(*(("the calibration", each) for each in paths), force=self.force).check([self.path])
            if (site := self.told_by(log)) is not None:
                options = {**options, "site": self.site_with(site)}
            if self.is_joint:
                multi = self._fit_jointly(log, parts, options)
            made = self._fit_each(parts, options) if multi is None else ((one.name, one.fit) for one in multi.members)
            outcomes = list(self._save_each(made, parts.values(), paths))  # written one by one, in case of an interrupt
        onboard = _judge_onboard(outcomes, parts)
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
        """Refuse options that make sense only for a single magnetometer."""
        if self.output == "-":
            raise UsageError(
                "several calibrations cannot go to standard output: name files, such as -o compass-{sensor}.json"
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
                raise UsageError(f"{option} is for a single magnetometer: leave it out with --joint")

    def _fit_jointly(self, log: Log, parts: dict[str, CountedRecording], options: dict[str, Any]) -> MultiFit:
        """Fit all magnetometers of a log jointly."""
        from flinders.comparison.multi_sensor import fit_multi

        chosen = None if self.reference is None else log.sensor(self.reference).name
        if len(parts) < 2:
            raise UsageError(f"{log.source} has one magnetometer: leave --joint out")
        asked = {name: options[name] for name in JOINT_FIT_OPTIONS if name in options}
        with report_readings(list(parts.values())):
            return fit_multi(parts, reference=chosen, prior=options["method"].prior, **asked)

    def _fit_each(
        self, parts: Mapping[str, CountedRecording], options: dict[str, Any]
    ) -> Iterator[tuple[str, Outcome]]:
        """Fit the magnetometers one by one, and print the number of readings of each."""
        from flinders.workflows.sensors import fits_of

        for name, outcome in fits_of(parts, by=self.by, notice=say, **options):
            say_read(parts[name])
            yield name, outcome

    def _save_each(
        self, outcomes: Iterator[tuple[str, Outcome]], parts: Iterable[CountedRecording], paths: Sequence[str | None]
    ) -> Iterator[tuple[str, Outcome]]:
        """Write each accepted calibration as soon as it is made, and yield all outcomes."""
        for (name, outcome), part, path in zip(outcomes, parts, paths, strict=True):
            if path and not _is_error(outcome):
                cast("Fit", outcome).save(path, force=self.force, provenance=provenance([part]))
            yield name, outcome


def _is_error(outcome: Outcome) -> bool:
    return isinstance(outcome, FlindersError)


def _judge_onboard(outcomes: Sequence[tuple[str, Outcome]], parts: Mapping[str, Recording]) -> dict[str, OnboardCheck]:
    """Checks of the onboard calibrations that the log contains, by the name of the fitted magnetometer."""
    from flinders.workflows.onboard import judge_onboard

    found = {}
    for name, outcome in outcomes:
        if not isinstance(outcome, FlindersError) and (judged := judge_onboard(parts[name], outcome)) is not None:
            found[name] = judged
    return found


def _refuse_chosen(log: Log, reading: dict[str, Any]) -> None:
    """Refuse options that choose a magnetometer, and files that contain only one."""
    if reading["columns"] is not None:
        raise UsageError("--sensor all takes each magnetometer, --columns chooses one: leave one of them out")
    if reading["topic"] is not None and not log.is_table:
        raise UsageError("--sensor all takes each magnetometer, --topic chooses one: leave one of them out")
    if log.is_table and len(log.instruments) == 1:
        raise UsageError(f"{log.source} has one magnetometer: leave --sensor all out")


def _page(
    outcomes: Sequence[tuple[str, Outcome]],
    multi: MultiFit | None,
    target_deg: float,
    onboard: Mapping[str, OnboardCheck],
) -> RenderableType:
    """Page of the results for a terminal."""
    from flinders.report.fit_pages import page_of_joint_fit, page_of_sensors

    if multi is not None:
        return page_of_joint_fit(multi, target_deg, in_options)
    rows = [
        (name, FitError(outcome.message) if isinstance(outcome, InputError) else outcome) for name, outcome in outcomes
    ]
    return page_of_sensors(cast("list[tuple[str, Fit | FitError]]", rows), target_deg, onboard)


def _as_dict(
    outcomes: Sequence[tuple[str, Outcome]],
    paths: Sequence[str | None],
    multi: MultiFit | None,
    onboard: Mapping[str, OnboardCheck],
) -> dict[str, Any]:
    """JSON-ready: a list of fits with the checks of their onboard calibrations, and the results of a joint fit."""
    rows = [_row(*outcome, path) for outcome, path in zip(outcomes, paths, strict=True)]
    for row in rows:
        if judged := onboard.get(row["sensor"]):
            row["onboard"] = judged.as_dict()
    if multi is None:
        return {"sensors": rows}
    joint = [{**row, "joint": member.as_dict()} for row, member in zip(rows, multi.members, strict=True)]
    return {**multi.as_dict(), "sensors": joint}


def _row(name: str, outcome: Outcome, path: str | None) -> dict[str, Any]:
    """JSON-ready: name of the magnetometer, its file, and the fields of ``calibrate --json``."""
    from flinders.fitting.fit_json import json_of

    if not isinstance(outcome, FlindersError):
        return {"sensor": name, "written": path, **json_of(outcome)}
    fit = getattr(outcome, "fit", None)
    error = {"code": outcome.code, "message": error_words(outcome), "evidence": outcome.evidence}
    return {"sensor": name, "written": None, "verdict": "refused", **(json_of(fit) if fit else {}), "error": error}


def path_for_sensor(output: str | None, number: int) -> str | None:
    """File for one magnetometer: its number replaces ``{sensor}``, or else precedes the suffix.

    >>> path_for_sensor("compass-{sensor}.json", 2), path_for_sensor("out/calibration.json", 2)
    ('compass-2.json', 'out/calibration-2.json')
    """
    if output is None:
        return None
    if SENSOR_PLACEHOLDER in output:
        return output.replace(SENSOR_PLACEHOLDER, str(number))
    path = Path(output)
    return str(path.with_name(f"{path.stem}-{number}{path.suffix}"))


def _exit_code(outcome: Outcome) -> int:
    """Exit code for the outcome of one magnetometer."""
    return outcome.exit_code if isinstance(outcome, FlindersError) else EXITS[outcome.verdict]
