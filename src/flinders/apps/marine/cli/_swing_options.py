"""Options of ``flinders swing``: a table, a recording or a boat's log, the rule, and outputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from flinders.apps.marine.standards import STANDARDS
from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.apps.marine.standards import Standard

STANDARD, BOAT = "Standard", "Log of a boat"
"""Headings of two groups of options: for a swing by a rule, and for a log of NMEA or Signal K."""


class StandardOptions(program.Group):
    """Options: the rule of a swing, its limit, and the error of the compass base."""

    name: str | None = program.member(
        "--standard", type=click.Choice(list(STANDARDS), case_sensitive=False), metavar="NAME",
        help=f"Rule for compasses: {', '.join(STANDARDS)}. Without a file: print its checklist.",
    )  # fmt: skip
    limit_deg: float | None = program.member(
        "--limit", heading=STANDARD, type=program.angle, metavar="DEG",
        help="Largest deviation allowed [default: that of the rule, if its text was available].",
    )  # fmt: skip
    base_error_deg: float = program.member(
        "--base-error", heading=STANDARD, type=program.number_within(0, 45, "degrees from 0 to 45", zero=True),
        default=0.0, show_default=True, metavar="DEG",
        help="Common error of all known headings, 1 σ, such as that of the compass base.",
    )  # fmt: skip
    compensate: bool = program.flag(
        "--compensate", "Find the corrections on N, E, S and W, for a TABLE with a reading on each.", heading=STANDARD
    )
    before: str | None = program.member(
        "--before",
        heading=STANDARD,
        metavar="TABLE",
        help="Readings on N, E, S and W before the compass was compensated.",
    )
    certificate: str | None = program.member(
        "--certificate", what="the certificate", heading=STANDARD, metavar="FILE",
        help="Also write a certificate with fields to sign, as .html, or .pdf by a browser that is installed.",
    )  # fmt: skip
    subject: str = program.member(
        "--subject", heading=STANDARD, default="", metavar="TEXT", help="Vehicle and compass, for the certificate."
    )

    @property
    def rule(self) -> Standard | None:
        """The rule that the option names; None without one."""
        return None if self.name is None else STANDARDS[self.name]

    @property
    def limit(self) -> float | None:
        """The typed limit, else that of the rule."""
        return self.limit_deg if self.limit_deg is not None or self.rule is None else self.rule.limit_deg

    def check(self) -> str:
        """Refuse options that conflict; return the browser that prints a PDF certificate, or an empty text."""
        from flinders.report.pdf import browser

        if self.certificate is None:
            if self.subject:
                raise UsageError("--subject is for a certificate: give --certificate FILE too")
            return ""
        ending = Path(self.certificate).suffix.lower()
        if ending not in {".html", ".pdf"}:
            raise UsageError(f"--certificate {self.certificate}: name a file that ends with .html or .pdf")
        return browser() if ending == ".pdf" else ""

    def facts(self) -> dict[str, str]:
        """Typed facts for the certificate."""
        base = f"{self.base_error_deg:g}° (1 σ), in every uncertainty" if self.base_error_deg else ""
        facts = {"Vehicle and compass": self.subject, "Error of the base": base}
        return {name: words for name, words in facts.items() if words}


class BoatOptions(program.Group, heading=BOAT):
    """Options: reference for the compass in a boat's log."""

    reference: Literal["auto", "heading", "course"] = program.member(
        "--reference", type=click.Choice(["auto", "heading", "course"]), default="auto", show_default=True,
        help="Reference for the compass: the true heading of another instrument, or the course over ground.",
    )  # fmt: skip
    min_speed: float = program.member(
        "--min-speed", type=program.positive, default=2.0, show_default=True, metavar="M/S",
        help="Smallest speed over ground of a leg whose course is used.",
    )  # fmt: skip
    crab_deg: float = program.member(
        "--crab", type=program.number_within(0, 45, "degrees from 0 to 45", zero=True), default=1.0, show_default=True,
        metavar="DEG", help="Difference of course and heading by leeway, 1 σ.",
    )  # fmt: skip


class KnownHeadings(program.Group):
    """Options: known headings, their uncertainty, and rests of a recording."""

    headings: str | None = program.member(
        "--headings", heading=program.RECORDING, metavar="DEG,DEG,...", keywords=("headings_deg",),
        help="Known headings of the stationary intervals in LOG, in their order: magnetic, or true with --at.",
    )  # fmt: skip
    sigma_deg: float | None = program.member(
        "--sigma", heading=program.METHOD, type=program.angle, metavar="DEG",
        help="Uncertainty of a known heading and its reading, 1 σ [default: from the residuals].",
    )  # fmt: skip
    stationary_s: float = program.member(
        "--stationary", heading=program.RECORDING, type=program.positive, default=2.0, show_default=True, metavar="S",
        help="Shortest stationary interval in LOG, in s (without a clock: 50 readings; log of a boat: 20 s).",
    )  # fmt: skip

    @property
    def headings_deg(self) -> list[float] | None:
        """The known headings as numbers."""
        from flinders.apps.marine.swing_table import refuse_beyond_circle

        if self.headings is None:
            return None
        known = program.numbers_of(self.headings)
        if not known:
            raise UsageError(f"--headings {self.headings!r}: need degrees, such as 0,45,90,135,180,225,270,315")
        refuse_beyond_circle(known, (f"number {place} of --headings" for place in range(1, len(known) + 1)))
        return known

    @property
    def typed_stationary_s(self) -> float | None:
        """The typed shortest interval in s; None for the default of a recording or a boat."""
        return self.stationary_s if program.is_typed("stationary_s") else None


class SwingOptions(program.Group):
    """Options: a table, or a calibration and a recording; outputs of the curve."""

    inputs: tuple[str, ...] = program.argument("TABLE | [CALIBRATION] LOG", nargs=-1, required=False)
    output: str | None = option.output(
        "the card", "Also write the card, as comma-separated text; - for standard output.", heading=program.OUTPUT
    )
    svg: str | None = program.member(
        "--svg", what="the curve", heading=program.OUTPUT, metavar="FILE", help="Also draw the curve, as SVG."
    )
    sentences: str | None = program.member(
        "--hdg", what="the sentences", heading=program.OUTPUT, metavar="FILE",
        help="Also write the card as sentences HDG of NMEA 0183.",
    )  # fmt: skip
    step_deg: float = program.member(
        "--step", heading=program.OUTPUT, type=program.number_within(0, 90, "degrees above 0, up to 90"),
        default=15.0, show_default=True, metavar="DEG", help="Step of the card; by default that of --standard.",
    )  # fmt: skip
    force: bool = option.force()
    standard: StandardOptions = program.group(StandardOptions)
    boat: BoatOptions = program.group(BoatOptions)
    known: KnownHeadings = program.group(KnownHeadings)
    place: option.Place = program.group(option.Place)
    accelerometer: option.Accelerometer = program.group(option.Accelerometer)
    reading: option.ColumnsOptions = program.group(option.ColumnsOptions)
    target_deg: float = option.target("Largest error of a turn by 180°, and largest 1 σ of the curve.")
    as_json: bool = option.as_json()

    @property
    def card_step_deg(self) -> float:
        """The typed step of the card in degrees, else that of the rule."""
        rule = self.standard.rule
        return self.step_deg if rule is None or program.is_typed("step_deg") else rule.step_deg

    def curve_arguments(self) -> dict[str, Any]:
        """Arguments of `flinders.swing` for the curve."""
        return {
            "sigma_deg": self.known.sigma_deg, "min_speed": self.boat.min_speed, "crab_deg": self.boat.crab_deg,
            "target_deg": self.target_deg, "rule": self.standard.rule, "limit_deg": self.standard.limit_deg,
            "base_error_deg": self.standard.base_error_deg,
        }  # fmt: skip

    def refuse_without_headings(self) -> None:
        """Refuse options that need known headings if there are none."""
        if self.known.headings is not None:
            return
        if self.place.place is not None:
            raise UsageError("--at converts known headings from true to magnetic: give --headings too, or leave it out")
        rule = self.standard
        if any((self.output, self.svg, self.sentences, rule.certificate, rule.limit, rule.before)):
            raise UsageError(
                "without known headings there is no curve: give --headings, or leave -o, --svg, --hdg, --certificate, "
                "--before and the limit out"
            )

    def refuse_of_recording(self) -> None:
        """Refuse, for a table, the options of a recording or of a boat's log."""
        _refuse(self._of_magnetometer() | {"--stationary": program.is_typed("stationary_s")}, "a recording")
        self.refuse_of_boat()

    def refuse_of_magnetometer(self) -> None:
        """Refuse, for a boat's log, the options of a magnetometer's recording."""
        _refuse(self._of_magnetometer() | {"--sigma": self.known.sigma_deg}, "other files than the log of a boat")

    def refuse_of_boat(self) -> None:
        """Refuse, for other inputs, the options of a boat's log."""
        names = {"reference": "--reference", "min_speed": "--min-speed", "crab_deg": "--crab"}
        _refuse({names[name]: program.is_typed(name) for name in names}, "the log of a boat")

    def _of_magnetometer(self) -> dict[str, object]:
        """Values of the options that are only for a recording, by the spelling of each option."""
        return {
            "--headings": self.known.headings, "--level": self.accelerometer.is_level,
            "--acceleration": self.accelerometer.acceleration, "--columns": self.reading.columns,
        }  # fmt: skip


def _refuse(values: Mapping[str, object], what: str) -> None:
    """Refuse options that have a value; `what` names the input that the options are for."""
    for name, value in values.items():
        if value not in (None, False):
            raise UsageError(f"{name} is for {what}: leave it out")
