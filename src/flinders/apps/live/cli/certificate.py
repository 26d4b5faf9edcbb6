"""``flinders certificate``: a calibration as a Digital Calibration Certificate."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load
from flinders.cli._output import print_json, say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit


class CertificateOptions(program.Group):
    """The calibration to certify, its plan and serial number, and the file to write."""

    calibration: str = program.argument("CALIBRATION")
    plan: str = program.member(
        "--plan", required=True, metavar="PLAN.toml", help="File of a station with a table [certificate]."
    )
    serial: str = program.member("--serial-number", required=True, metavar="NUMBER", help="Serial number of the unit.")
    identifier: str | None = program.member(
        "--identifier", metavar="NAME", help="Identifier of the certificate [default: serial number and date]."
    )
    output: str = option.output("the certificate", "Where to write.", required=True)
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "certificate",
    CertificateOptions,
    common=("plan", "serial", "identifier", "output", "force", "as_json"),
    epilog="""\b
Example:
  flinders certificate calibration.json --plan line-3.toml --serial-number A17 -o A17.xml
""",
)
def command(options: CertificateOptions) -> None:
    """Write a Digital Calibration Certificate (DCC, XML) of a calibration.

    The file of a station names laboratory, person and customer in its table [certificate]. It also has the pass limits
    for the certificate's statement of conformity.
    """
    options.checked_outputs(options.plan)
    from flinders.apps.live.station.certificate import CertifiedTest, certificate
    from flinders.apps.live.station.limits import misses
    from flinders.apps.live.station.plan import read_plan
    from flinders.core.files import write_text

    plan = read_plan(options.plan)
    if plan.certificate is None:
        needed = "laboratory, country, city, person and customer"
        raise UsageError(f"{options.plan} has no table [certificate]: write one with {needed}")
    fit = load("certificate", options.calibration)
    when = _calibration_time(fit)
    about = CertifiedTest(
        options.serial, options.identifier or f"{options.serial}/{when:%Y-%m-%d}", when, when,
        is_passed=not misses(fit, plan.limits),
    )  # fmt: skip
    write_text(certificate(fit, plan.certificate, about, plan.limits), options.output, force=options.force)
    if options.as_json:
        print_json({"path": options.output, "identifier": about.identifier, "is_passed": about.is_passed})
    say(f"{options.output}: certificate {about.identifier}, {'conforms' if about.is_passed else 'does not conform'}")


def _calibration_time(fit: Fit) -> datetime:
    """Time of a calibration; now if its file has none."""
    record = fit.provenance.record
    return datetime.now(UTC) if record is None else record.date
