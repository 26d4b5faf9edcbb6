"""Options of ``flinders swing``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from flinders.cli import _options as option
from flinders.errors import UsageError
from flinders.heading.standards import STANDARDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flinders.heading.standards import Standard

STANDARD, BOAT = "Standard", "Log of a boat"
"""Headings of the options of a swing by a rule, and of one from a log of NMEA or Signal K."""


class StandardOptions(option.Group):
    """The rule by which a compass is swung, its limit, and the base on which it stood."""

    name: str | None = option.member(
        "--standard", type=click.Choice(list(STANDARDS), case_sensitive=False), metavar="NAME",
        help=f"Rule for compasses: {', '.join(STANDARDS)}. Without a file: print its checklist.",
    )  # fmt: skip
    limit_deg: float | None = option.member(
        "--limit", heading=STANDARD, type=option.angle, metavar="DEG",
        help="Largest deviation allowed [default: that of the rule, where its text was seen].",
    )  # fmt: skip
    base_error_deg: float = option.member(
        "--base-error", heading=STANDARD, type=option.within(0, 45, "degrees from 0 to 45", zero=True), default=0.0,
        show_default=True, metavar="DEG",
        help="What all known headings may be off by together, 1 σ: that of the compass base.",
    )  # fmt: skip
    compensate: bool = option.flag(
        "--compensate", "Say what to turn on N, E, S and W, of a TABLE with a reading on each.", heading=STANDARD
    )
    before: str | None = option.member(
        "--before",
        heading=STANDARD,
        metavar="TABLE",
        help="Readings on N, E, S and W before the compass was compensated.",
    )
    certificate: str | None = option.member(
        "--certificate", what="the certificate", heading=STANDARD, metavar="FILE",
        help="Also write a certificate with fields to sign, as .html, or .pdf by a browser that is installed.",
    )  # fmt: skip
    subject: str = option.member(
        "--subject", heading=STANDARD, default="", metavar="TEXT", help="Vehicle and compass, for the certificate."
    )

    @property
    def rule(self) -> Standard | None:
        """The rule that was named."""
        return None if self.name is None else STANDARDS[self.name]

    @property
    def limit(self) -> float | None:
        """The limit that was typed, else that of the rule."""
        return self.limit_deg if self.limit_deg is not None or self.rule is None else self.rule.limit_deg

    def check(self) -> str:
        """Refuse what does not go together; find the browser that prints the certificate, if it is to be a PDF."""
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
        """What was typed that a certificate tells."""
        base = f"{self.base_error_deg:g}° (1 σ), in every uncertainty" if self.base_error_deg else ""
        facts = {"Vehicle and compass": self.subject, "Error of the base": base}
        return {name: words for name, words in facts.items() if words}


class BoatOptions(option.Group, heading=BOAT):
    """What the compass of a boat's log is held against."""

    reference: Literal["auto", "heading", "course"] = option.member(
        "--reference", type=click.Choice(["auto", "heading", "course"]), default="auto", show_default=True,
        help="Hold the compass against the true heading of another instrument, or the course over ground.",
    )  # fmt: skip
    slowest: float = option.member(
        "--min-speed", type=option.positive, default=2.0, show_default=True, metavar="M/S",
        help="Slowest leg over ground of which a course is used.",
    )  # fmt: skip
    crab_deg: float = option.member(
        "--crab", type=option.within(0, 45, "degrees from 0 to 45", zero=True), default=1.0, show_default=True,
        metavar="DEG", help="What leeway turns the course from the heading, 1 σ.",
    )  # fmt: skip


class KnownHeadings(option.Group):
    """Known headings, how well they are known, and how they are found in a recording."""

    headings: str | None = option.member(
        "--headings", heading=option.RECORDING, metavar="DEG,DEG,...",
        help="Known headings of the stationary intervals in LOG, in their order: magnetic, or true with --at.",
    )  # fmt: skip
    sigma_deg: float | None = option.member(
        "--sigma", heading=option.METHOD, type=option.angle, metavar="DEG",
        help="How well a heading was known and read, 1 σ [default: from the residuals].",
    )  # fmt: skip
    stationary_s: float = option.member(
        "--stationary", heading=option.RECORDING, type=option.positive, default=2.0, show_default=True, metavar="S",
        help="Shortest stationary interval in LOG, in seconds; 50 readings where it has no clock; of a boat 20 s.",
    )  # fmt: skip


class SwingOptions(option.Group):
    """A table, or a calibration and a recording; and what is written of the curve."""

    inputs: tuple[str, ...] = option.argument("TABLE | [CALIBRATION] LOG", nargs=-1, required=False)
    output: str | None = option.output(
        "the card", "Also write the card, as comma-separated text; - for standard output.", heading=option.OUTPUT
    )
    svg: str | None = option.member(
        "--svg", what="the curve", heading=option.OUTPUT, metavar="FILE", help="Also draw the curve, as SVG."
    )
    sentences: str | None = option.member(
        "--hdg", what="the sentences", heading=option.OUTPUT, metavar="FILE",
        help="Also write the card as sentences HDG of NMEA 0183.",
    )  # fmt: skip
    step_deg: float = option.member(
        "--step", heading=option.OUTPUT, type=option.within(0, 90, "degrees above 0, up to 90"),
        default=15.0, show_default=True, metavar="DEG", help="Step of the card; by default that of --standard.",
    )  # fmt: skip
    force: bool = option.force()
    standard: StandardOptions = option.group(StandardOptions)
    boat: BoatOptions = option.group(BoatOptions)
    known: KnownHeadings = option.group(KnownHeadings)
    place: option.Place = option.group(option.Place)
    accelerometer: option.Accelerometer = option.group(option.Accelerometer)
    reading: option.ColumnsOptions = option.group(option.ColumnsOptions)
    target_deg: float = option.target("What a turn by 180° may miss, and 1 σ of the curve may be.")
    as_json: bool = option.as_json()

    @property
    def card_step_deg(self) -> float:
        """The step that was typed, else that of the rule."""
        rule = self.standard.rule
        return self.step_deg if rule is None or option.is_typed("step_deg") else rule.step_deg

    def refuse_of_recording(self) -> None:
        """Refuse options that a table has no use for."""
        _refuse(self._of_magnetometer() | {"--stationary": option.is_typed("stationary_s")}, "a recording")
        self.refuse_of_boat()

    def refuse_of_magnetometer(self) -> None:
        """Refuse options that the log of a boat has no use for."""
        _refuse(self._of_magnetometer() | {"--sigma": self.known.sigma_deg}, "other files than the log of a boat")

    def refuse_of_boat(self) -> None:
        """Refuse options of a boat's log where there is none."""
        names = {"reference": "--reference", "slowest": "--min-speed", "crab_deg": "--crab"}
        _refuse({names[name]: option.is_typed(name) for name in names}, "the log of a boat")

    def _of_magnetometer(self) -> dict[str, object]:
        """Values of the options of a recording, by their spelling."""
        return {
            "--headings": self.known.headings, "--level": self.accelerometer.is_level,
            "--acceleration": self.accelerometer.acceleration, "--columns": self.reading.columns,
        }  # fmt: skip


def _refuse(values: Mapping[str, object], what: str) -> None:
    """Refuse options that are for something else."""
    for name, value in values.items():
        if value not in (None, False):
            raise UsageError(f"{name} is for {what}: leave it out")
