"""``flinders swing``: the deviation of a compass, from a table, a recording or a boat's log; and the half-turn test."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flinders.apps.marine.cli._swing_options import BOAT, STANDARD, SwingOptions
from flinders.cli import _program as program
from flinders.cli._inputs import read_and_left_out, refuse_calibration, site_of
from flinders.cli._output import progress, say
from flinders.cli._program import EXITS, GOOD
from flinders.cli._spelling import in_options
from flinders.cli._stream import open_log
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.apps.marine.compass_log import CompassLog
    from flinders.apps.marine.swing_recording import SwingRecording
    from flinders.apps.marine.swing_table import SwingTable
    from flinders.apps.marine.swing_words import SwingAccount
    from flinders.core.geomag import SiteField


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
  0  the curve is good, and turns by 180° change the heading by 180° within the target
  3  the curve is limited, is beyond the limit of a rule, or is too uncertain for that rule;
     or a turn by 180° changes the heading by another angle, beyond the target
  4  without known headings: there is no turn by 180°, or it changes the heading by another angle, beyond the target
""",
)
def command(options: SwingOptions) -> int:
    """Find the deviation of a compass: its coefficients A to E with their uncertainty, and the deviation card.

    TABLE has one heading a line, in degrees, under a header: compass and magnetic, compass and true (with --at),
    or compass and deviation; a column sigma is used if there is one.

    LOG is a recording in which the sensor rests on one heading after another, with the CALIBRATION that corrects it, or
    alone to use the readings as they are. --headings gives the known headings. Without it, only the half-turn test is
    made: a turn of the sensor by 180° has to change its heading by 180°.

    LOG may also be the log of a boat, NMEA 0183, NMEA 2000 by candump, or Signal K. Then straight legs all round are
    compared with the true heading of another instrument or the course over ground.
    """
    from flinders.apps.marine.compass_swing import swing
    from flinders.apps.marine.swing_pages import of_swing
    from flinders.apps.marine.swing_words import SwingAccount

    outputs = options.checked_outputs(options.standard.before)
    browser = options.standard.check()
    if not options.inputs:
        return _checklist(options)
    if options.standard.compensate:
        return _compensate(options)
    opened, arguments = _read_inputs(options)
    if options.standard.before is not None:
        before, _ = _table(options.standard.before, options)
        arguments["before"] = before
    found = swing(opened, **arguments, **options.curve_arguments())
    account = SwingAccount(found, options.card_step_deg, in_options)
    _write(account, options, browser)
    outputs.print(lambda: found.as_dict(in_options), lambda: of_swing(account))
    if not options.as_json:
        outputs.say_written()
    return EXITS[found.verdict]


def _read_inputs(options: SwingOptions) -> tuple[SwingTable | CompassLog | SwingRecording, dict[str, Any]]:
    """Read the given files, with notices about their contents; return the input of the swing and its arguments."""
    from flinders.apps.marine.compass_swing import kind_of

    *calibration, path = options.inputs
    if len(calibration) > 1:
        raise UsageError(f"{len(options.inputs)} files were given: need a table, or a calibration and a recording")
    kind = "recording" if calibration else kind_of(path)
    if kind == "boat":
        return _boat(path, options)
    if kind == "recording":
        options.refuse_of_boat()
        return _recording(calibration[0] if calibration else None, path, options)
    options.refuse_of_recording()
    table, site = _table(path, options)
    return table, {"site": site}


def _table(path: str, options: SwingOptions) -> tuple[SwingTable, SiteField | None]:
    """Read a table; for true headings, also the field at the place of the swing."""
    from flinders.apps.marine.swing_table import read_swing

    refuse_calibration(path, "give the recording of a swing after it")
    place = options.place
    place.check()
    table = read_swing(path)
    say(str(table))
    if table.is_true and place.place is None:
        raise UsageError(f"{path} has true headings: give the place by --at LAT,LON and the day by --date")
    if not table.is_true and place.place is not None:
        raise UsageError(f"{path} has no true headings: leave --at out, or name the column of true headings 'true'")
    return table, None if place.place is None else site_of(place.place, place.date, model=place.model)


def _boat(path: str, options: SwingOptions) -> tuple[CompassLog, dict[str, Any]]:
    """Read the log of a boat, and the field at the typed place or that of the log."""
    from flinders.apps.marine.compass_log import read_compass_log

    options.refuse_of_magnetometer()
    log = read_compass_log(path, options.boat.reference)
    say(str(log))
    place = options.place
    place.check()
    where = place.place or (None if log.place is None else "{:.4f},{:.4f}".format(*log.place))
    day = place.date or (None if log.day is None else f"{log.day}")
    if where is None or day is None:
        missing = "position" if where is None else "date"
        raise UsageError(f"{log.source} has no {missing}: give the place by --at LAT,LON and the day by --date")
    return log, {"site": site_of(where, day, model=place.model), "stationary_s": options.known.typed_stationary_s}


def _recording(calibration: str | None, path: str, options: SwingOptions) -> tuple[SwingRecording, dict[str, Any]]:
    """Read a recording, and find its rests."""
    from flinders.apps.marine.swing_recording import SwingRecording

    headings_deg = options.known.headings_deg
    options.refuse_without_headings()
    with progress("swinging") as bar:
        stream = open_log(
            "swing",
            calibration,
            path,
            place=options.place,
            accelerometer=options.accelerometer,
            progress=bar,
            **options.reading.as_dict(),
        )
        stationary_s = options.known.typed_stationary_s
        recording = SwingRecording.of(stream, is_calibrated=calibration is not None, stationary_s=stationary_s)
    say(f"{stream}; {read_and_left_out(stream.voyage.readings, getattr(stream.recording, 'skipped', ()))}")
    if recording.is_calibrated and not stream.corrector.is_plausible:
        say("! these readings do not suit the calibration: see flinders check")
    return recording, {"site": stream.site, "headings_deg": headings_deg}


def _checklist(options: SwingOptions) -> int:
    """Print the checklist of a rule."""
    from flinders.apps.marine.swing_pages import of_checklist

    rule = options.standard.rule
    if rule is None:
        raise UsageError("Missing argument: give a table or a recording, or --standard NAME for its checklist")
    options.outputs.print(rule.as_dict, lambda: of_checklist(rule))
    return GOOD


def _compensate(options: SwingOptions) -> int:
    """Print the corrections on the cardinal headings."""
    from flinders.apps.marine.compass_swing import compensate
    from flinders.apps.marine.swing_pages import of_compensation

    if len(options.inputs) != 1 or any(file.path for file in options.outputs.files):
        raise UsageError("--compensate takes one TABLE and writes no file: swing again afterwards, for the card")
    options.refuse_of_recording()
    table, site = _table(options.inputs[0], options)
    compensation = compensate(table, site=site)
    options.outputs.print(compensation.as_dict, lambda: of_compensation(compensation))
    return GOOD


def _write(account: SwingAccount, options: SwingOptions, browser: str) -> None:
    """Write card, curve and certificate."""
    from flinders.apps.marine.certificate import certificate
    from flinders.apps.marine.drawing import swing_drawing
    from flinders.apps.marine.swing_pages import card, sentences
    from flinders.report.pdf import print_pdf

    swing, outputs, path = account.swing, options.outputs, options.standard.certificate
    if swing.deviation is None:
        return
    outputs.write(card(swing.deviation, account.step_deg), options.output)
    outputs.write(swing_drawing(swing.deviation), options.svg)
    declination_deg = None if swing.site is None else swing.site.declination_deg
    outputs.write(sentences(swing.deviation, account.step_deg, declination_deg), options.sentences)
    if path is not None:
        text = certificate(account, options.standard.facts())
        outputs.write(print_pdf(text, browser) if browser else text, path)
