"""``flinders swing``: the deviation of a compass, from a table, a recording or a boat's log; and the half-turn test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.apps.marine.swing import (
    BOAT,
    STANDARD,
    Swing,
    SwingOptions,
    compensation_of,
    is_boat,
    is_raw,
    of_boat,
    of_log,
    of_table,
)
from flinders.cli import _program as program
from flinders.cli._program import GOOD
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.apps.marine.swing_words import SwingAccount


@program.command_of(
    "swing",
    SwingOptions,
    common=("output", "svg", "headings", "name", "target_deg", "as_json"),
    headings={STANDARD: (), BOAT: ()},
    epilog="""\b
Example:
  flinders swing swing.csv --svg curve.svg -o card.csv
  flinders swing calibration.json log.csv --headings 0,45,90,135,180,225,270,315
  flinders swing calibration.json log.csv
  flinders swing corrected.csv
  flinders swing boat.nmea --standard solas --limit 5
  flinders swing --standard ac43.13-1b
  flinders swing correction.csv --compensate
  flinders swing check.csv --standard ac43.13-1b --before correction.csv --certificate card.pdf

\b
Exit codes:
  0  good, and turns by 180° turn the heading by 180° to within the target
  3  a curve with limits, or beyond the limit of a rule or not known well enough to be within it, or with turns by
     180° that miss the target
  4  without known headings: a turn by 180° misses the target, or there is none
""",
)
def command(options: SwingOptions) -> int:
    """Find the deviation of a compass: its coefficients A to E with their uncertainty, and the deviation card.

    TABLE has one heading a line, in degrees, under a header: compass and magnetic, compass and true (with --at),
    or compass and deviation; a column sigma is used. Or give a LOG in which the sensor rests on one heading after
    another, with the CALIBRATION that corrects it, or alone where it is to be taken as it is: --headings names them;
    without it, the half-turn test alone is made, which needs no known heading: where the sensor was turned by 180°, so
    should its heading have been. LOG may be one of a boat, NMEA 0183, NMEA 2000 by candump, or Signal K: straight legs
    all round are held against the true heading of another instrument or the course over ground.
    """
    from flinders.apps.marine.swing_pages import of_swing

    outputs, target_deg = options.checked_outputs(options.standard.before), options.target_deg
    program = options.standard.check()
    if not options.inputs:
        return _checklist(options)
    if options.standard.compensate:
        return _compensate(options)
    swing = _swing(options).judged_by(options.standard, options.place)
    account = _account(swing, options)
    _write(account, options, program)
    outputs.print(lambda: swing.as_dict(target_deg), lambda: of_swing(account))
    if not options.as_json:
        outputs.say_written()
    return swing.exit_code(target_deg)


def _swing(options: SwingOptions) -> Swing:
    """Take the swing from the files that were given."""
    inputs = options.inputs
    if len(inputs) == 1 and is_boat(inputs[0]):
        return of_boat(inputs[0], options)
    if len(inputs) == 1 and is_raw(inputs[0]):
        options.refuse_of_boat()
        return of_log(None, inputs[0], options)
    if len(inputs) == 1:
        options.refuse_of_recording()
        return of_table(inputs[0], options.known.sigma_deg, options.place)
    if len(inputs) == 2:
        options.refuse_of_boat()
        return of_log(*inputs, options)
    raise UsageError(f"{len(inputs)} files were given: need a table, or a calibration and a recording")


def _checklist(options: SwingOptions) -> int:
    """Print how a swing by the rule is made."""
    from flinders.apps.marine.swing_pages import of_checklist

    rule = options.standard.rule
    if rule is None:
        raise UsageError("Missing argument: give a table or a recording, or --standard NAME for its checklist")
    options.outputs.print(rule.as_dict, lambda: of_checklist(rule))
    return GOOD


def _compensate(options: SwingOptions) -> int:
    """Say what to turn on the cardinal headings."""
    from flinders.apps.marine.swing_pages import of_compensation

    if len(options.inputs) != 1 or any(file.path for file in options.outputs.files):
        raise UsageError("--compensate takes one TABLE and writes no file: swing again afterwards, for the card")
    options.refuse_of_recording()
    compensation = compensation_of(options.inputs[0], options.place)
    options.outputs.print(compensation.as_dict, lambda: of_compensation(compensation))
    return GOOD


def _write(swing: SwingAccount, options: SwingOptions, program: str) -> None:
    """Write card, curve and certificate."""
    from flinders.apps.marine.certificate import certificate
    from flinders.apps.marine.drawing import swing_drawing
    from flinders.apps.marine.swing_pages import card, sentences
    from flinders.report.pdf import printed

    path, deviation, outputs = options.standard.certificate, swing.deviation, options.outputs
    if deviation is None:
        wanted = (options.output, options.svg, options.sentences, path, options.standard.limit, options.standard.before)
        if any(wanted):
            raise UsageError(
                "without known headings there is no curve: give --headings, or leave -o, --svg, --hdg, --certificate, "
                "--before and the limit out"
            )
        return
    outputs.write(card(deviation, options.card_step_deg), options.output)
    outputs.write(swing_drawing(deviation), options.svg)
    declination_deg = None if swing.site is None else swing.site.declination_deg
    outputs.write(sentences(deviation, options.card_step_deg, declination_deg), options.sentences)
    if path is not None:
        text = certificate(swing, options.standard.facts())
        outputs.write(printed(text, program) if program else text, path)


def _account(swing: Swing, options: SwingOptions) -> SwingAccount:
    """What the swing says of what was asked."""
    from flinders.apps.marine.swing_words import SwingAccount

    return SwingAccount(
        swing.deviation,
        site=swing.site,
        rests=swing.rests,
        halves=swing.halves,
        expected=swing.expected,
        logged=swing.logged,
        rule=options.standard.rule,
        conformity=swing.conformity,
        before=swing.before,
        target_deg=options.target_deg,
        step_deg=options.card_step_deg,
    )
