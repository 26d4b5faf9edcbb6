"""``flinders plan``: which motion, how long, and the heading error to expect, before anything is recorded."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._program import EXITS
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import FieldModel
    from flinders.likelihood.site_field import Site
    from flinders.workflows.planning import Plan

BODIES: Final = {
    "hand": "a sensor or a board in the hand: any attitude",
    "drone": "a multicopter held in both hands: tilted by up to 45°",
    "boat": "a boat that steers circles in calm water: level",
    "robot": "a wheeled robot that turns on a level floor: level",
    "wrist": "a watch on the wrist of a person who turns: tilted by up to 90°",
}
"""Copy of the names in `flinders.simulate.bodies.BODIES`, so that help needs no NumPy; a test compares the two."""


class PlanOptions(program.Group):
    """A body, its sensor, the place, and the files to write."""

    body: str = program.member(
        "--body", default="hand", show_default=True, metavar="NAME", help="Body that carries the sensor; see below."
    )
    noise: str = program.member(
        "--noise", required=True, metavar="VALUE",
        help="Noise of a reading, 1 σ of each axis, with its unit: 0.5uT, 5mG; or the name of a chip.",
    )  # fmt: skip
    rate_hz: float = program.member(
        "--rate", type=program.positive, default=50.0, show_default=True, metavar="HZ", help="Readings a second."
    )
    seconds: float | None = program.member(
        "--seconds", type=program.positive, metavar="S", help="How long to record [default: as long as it takes]."
    )
    tilt_deg: float | None = program.member(
        "--tilt", type=program.number_within(0, 180, "degrees from 0 to 180", zero=True), metavar="DEG",
        help="How far the body can be tilted [default: the body's usual].",
    )  # fmt: skip
    aiding: tuple[str, ...] = program.member(
        "--with", multiple=True, metavar="NAME,…", keywords=("aiding",), heading=program.AIDING,
        help="Aiding sensors that the fit will use: dip (an accelerometer), rate (a gyro).",
    )  # fmt: skip
    place: str | None = program.member(
        "--at", heading=program.SITE, metavar="LAT,LON[,ALT]", keywords=("site",),
        help="Place of the recording, for dip and strength: degrees, north and east positive, and metres.",
    )  # fmt: skip
    date: str | None = program.member(
        "--date", heading=program.SITE, metavar="DAY", help="Day of the recording, with --at [default: today]."
    )
    model: FieldModel | None = option.field_model()
    target_deg: float = option.target()
    drawing: str | None = program.member(
        "-o", "--output", what="the drawing", metavar="FILE.svg",
        help="Also draw the path on the sphere of directions, as SVG; - for standard output.",
    )  # fmt: skip
    report: str | None = program.member(
        "--report", what="the report", heading=program.OUTPUT, metavar="FILE.html",
        help="Also write a page with the path and the error to expect.",
    )  # fmt: skip
    force: bool = option.force()
    as_json: bool = option.as_json()

    def site(self) -> Site | None:
        """Field at the place of ``--at`` on the given day or today. Its axes are the vehicle's, with z down."""
        from flinders.cli._inputs import site_of
        from flinders.likelihood.site_field import Site

        if self.place is None:
            return None
        return Site.of(site_of(self.place, self.date or "today", model=self.model), z_down=True)

    def check(self) -> None:
        """Refuse a day or a field model without a place, and output files with an unknown suffix."""
        if self.place is None and (self.date is not None or self.model is not None):
            raise UsageError("--date and --field-model are for the field at a place: give --at LAT,LON too")
        if self.drawing not in (None, "-") and Path(str(self.drawing)).suffix.lower() != ".svg":
            raise UsageError(f"--output {self.drawing}: a plan is drawn as SVG, name a file that ends with .svg")
        if self.report is not None and Path(self.report).suffix.lower() not in {".html", ".htm"}:
            raise UsageError(f"--report {self.report}: name a file that ends with .html")

    def commands(self, plan: Plan) -> list[str]:
        """Commands that record and calibrate as planned."""
        name = f"{plan.body.name}.csv"
        fit = ["flinders", "calibrate", name, "-o", "calibration.json"]
        if self.place is not None:
            fit += ["--axes", "x,y,z", f"--at={self.place}", "--date", self.date or "today"]
        if plan.recording.aiding:
            fit += ["--with", ",".join(plan.recording.aiding)]
        if program.is_typed("target_deg"):
            fit += ["--target", f"{self.target_deg:g}"]
        return [f"flinders record --serial --seconds {plan.seconds:.0f} -o {name}", shlex.join(fit)]


@program.command_of(
    "plan",
    PlanOptions,
    common=("body", "noise", "target_deg", "drawing", "as_json"),
    headings={"Motion": ("rate_hz", "seconds", "tilt_deg")},
    epilog="\b\nBodies:\n"
    + "\n".join(f"  {name:<8}{words}" for name, words in BODIES.items())
    + """\n\n\b
Example:
  flinders plan --body drone --noise 0.5uT --at 47.6,-122.3 --target 1
  flinders plan --body boat --noise 5mG --seconds 240 -o plan.svg
  flinders plan --noise 0.3uT --with dip,rate --report plan.html

\b
Exit codes: those of the verdict to expect, as of `flinders calibrate`.
""",
)
def command(options: PlanOptions) -> int:
    """Plan a recording: which motion, how long, and the heading error to expect.

    The planned motion is simulated, and the simulated recording is fitted and judged like a real one; the verdict on
    the real recording can be compared with the plan. The table also shows how much would be gained by twice the time,
    more tilt, an accelerometer or a gyro.
    """
    from flinders.report.plan_drawing import drawing_of, page_of
    from flinders.report.plan_pages import of_plan
    from flinders.workflows.planning import plan

    options.check()
    outputs = options.checked_outputs()
    planned = plan(
        options.body,
        noise=options.noise,
        site=options.site(),
        target_deg=options.target_deg,
        rate_hz=options.rate_hz,
        seconds=options.seconds,
        tilt_deg=options.tilt_deg,
        aiding=options.aiding,
    )
    commands = options.commands(planned)
    if options.drawing is not None:
        outputs.write(drawing_of(planned), options.drawing)
    if options.report is not None:
        outputs.write(page_of(planned, commands), options.report)
    outputs.print(planned.as_dict, lambda: of_plan(planned, commands))
    outputs.say_written()
    return EXITS[planned.expected.fit.verdict]
