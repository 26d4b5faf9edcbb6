"""One tree of errors: what was found, what is needed, what to do.

::

    FlindersError                    code              exit code
    ├── UsageError                   usage             2    an option or argument cannot be used
    │   ├── UnknownParameter         unknown-parameter 2    a keyword that a function does not have
    │   ├── UnitError                unit              2    an unknown unit, or units that contradict each other
    │   └── AxesError                axes              2    an axes mapping that is not a signed permutation
    ├── InputError                   input             5    what was given cannot be read
    │   ├── ArrayError               array             5    an array of the wrong shape or with gaps
    │   ├── UnreadableInput          unreadable        5    a file that cannot be opened or decoded
    │   ├── NoMagnetometer           no-magnetometer   5    a readable file without a magnetometer in it
    │   ├── NoAccelerometer          no-accelerometer  5    one without an accelerometer, where headings need it
    │   ├── NoOnboardCalibration     no-onboard        5    a log that tells of no calibration in force
    │   ├── ForeignAxes              foreign-axes      5    accelerometer and magnetometer with unlike axes
    │   ├── MissingExtra             missing-extra     5    a format whose optional package is not installed
    │   ├── LinkError                link              5    a sensor or vehicle that is not there or is gone
    │   ├── LostWorker               lost-worker       5    a file of a fleet that ends the workers which read it
    │   ├── NoUnit                   no-unit           5    readings of a fleet that name no unit
    │   └── DocumentError            document          5    a calibration file that is not one
    ├── FitError                     fit               4    no calibration can be given from this recording
    │   ├── TooFewSamples            too-few-samples   4
    │   ├── StuckAxis                stuck-axis        4    an axis that never changes
    │   ├── NotTurned                not-turned        4    a still sensor, and readings that follow a disturbance
    │   ├── FollowsAttitude          follows-attitude  4    a column that is a function of the direction of the field
    │   ├── Unmoved                  unmoved           4    a sensor that was hardly turned
    │   ├── OutOfScale               out-of-scale      4    numbers that no magnetometer reads
    │   ├── NotAnEllipsoid           not-an-ellipsoid  4    the quadric through the readings is open
    │   ├── MissingPose              missing-pose      4    still poses that do not tell an accelerometer's errors
    │   ├── Undetermined             undetermined      4    readings that leave parameters open, without a prior
    │   ├── NeedsSamples             needs-samples     4    sums were given where the method needs the readings
    │   ├── NeedsRecording           needs-recording   4    a calibration file was given, which keeps no readings
    │   └── Refused                  refused           4    a fit exists, its verdict is "refused"
    │       └── NotMerged            not-merged        4    calibrations that contradict each other
    ├── NotExportable                not-exportable    4    values that the target cannot hold
    ├── NotSent                      not-sent          4    a vehicle that must not be given these values now
    ├── PluginError                  plugin           70    an installed package that adds to Flinders is broken
    ├── NoEngine                     no-engine        70    the engine is not compiled here, and cannot be
    └── OutputError                  output            6    the result cannot be written
        ├── OutputExists             output-exists     6    a file is there already
        └── NotConfirmed             not-confirmed     6    sent, and the other end did not confirm it

Every error has a stable `code`, the `exit_code` with which the command line ends, a `message`, and as `evidence` the
numbers that the message states, by name.

>>> error = TooFewSamples(found=5, needed=10, method="likelihood")
>>> error.code, error.exit_code, error.evidence["found"]
('too-few-samples', 4, 5)
>>> print(error)
5 usable readings, 'likelihood' needs at least 10: record for longer while turning the sensor through all directions

A message names no argument. The arguments that mend an error are its `hint`, values by keyword, which each interface
spells: Python in the text of the error, the command line as options.

>>> error = OutputExists("log.csv")
>>> error.message, error.hint
('log.csv exists: give another name, or overwrite it', {'force': True})
>>> print(error)
log.csv exists: give another name, or overwrite it (force=True)

Messages of all modules write counts, numbers and shares with `counted`, `figures` and `percent`. What other packages
raise becomes one of these errors in `flinders.foreign_errors`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Hint: TypeAlias = Mapping[str, object]
"""Arguments that carry out a remedy: values by keyword of the Python interface, None for any value. The value of a
method's name is a mapping of its arguments."""

Spelling: TypeAlias = "Callable[[Hint], str]"
"""How an interface spells a hint, such as `in_python`."""


def counted(number: float, noun: str) -> str:
    """Write how many there are of something.

    >>> counted(1, "reading"), counted(24483, "usable reading")
    ('1 reading', '24,483 usable readings')
    """
    return f"{number:,.0f} {noun}{'s' * (round(number) != 1)}"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Ask whether a word was meant for one of those that are known; nothing where none is like it.

    >>> did_you_mean("micropythn", ["arduino", "micropython"]), did_you_mean("zzz", ["arduino"])
    (" (did you mean 'micropython'?)", '')
    """
    from difflib import get_close_matches

    by_folded = {name.casefold(): name for name in known}
    like = get_close_matches(word.strip().casefold(), by_folded, n=1)
    return f" (did you mean {by_folded[like[0]]!r}?)" if like else ""


def figures(value: float, digits: int = 2) -> str:
    """Write a number to so many significant digits or to the point, with an exponent only where it needs one.

    >>> figures(0.0321), figures(2.0), figures(324.7), figures(49.3, 4), figures(31072.3, 4), figures(3.2e9)
    ('0.032', '2.0', '325', '49.30', '31,072', '3.2e+09')
    """
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return f"{value:,.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def percent(count: float, total: float) -> str:
    """Write a share to a tenth of a per cent; 100 and 0 are all and none, and nothing else.

    >>> percent(3, 4), percent(2500, 2501), percent(1, 5000), percent(7, 7), percent(0, 0)
    ('75.0%', '> 99.9%', '< 0.1%', '100.0%', '0.0%')
    """
    written = f"{count / total if total else 0.0:.1%}"
    if written == "100.0%" and count < total:
        return "> 99.9%"
    return "< 0.1%" if written == "0.0%" and count else written


def in_python(hint: Hint) -> str:
    """Spell a hint as arguments of Python.

    >>> in_python({"force": True, "columns": "4,5,6", "unit": None, "at": {"current": 0.0}})
    "force=True, columns='4,5,6', unit=, at(current=0.0)"
    """
    return ", ".join(_argument(keyword, value) for keyword, value in hint.items())


def _argument(keyword: str, value: object) -> str:
    if isinstance(value, Mapping):
        return f"{keyword}({in_python(value)})"
    return f"{keyword}={'' if value is None else repr(value)}"


def with_hint(sentence: str, spelled: str) -> str:
    """Add a spelled hint to a sentence; an empty one adds nothing.

    >>> with_hint("name the unit", "--unit, --scale"), with_hint("name the unit", "")
    ('name the unit (--unit, --scale)', 'name the unit')
    """
    return f"{sentence} ({spelled})" if spelled else sentence


class FlindersError(Exception):
    """The root of the tree: catching it catches all that this package raises on purpose.

    `message` says what was found and what is needed, `hint` has the arguments that mend it, and `evidence` the numbers
    of the message by name.
    """

    code: ClassVar[str] = "flinders"
    exit_code: ClassVar[int] = 70

    def __init__(self, message: str = "", *, hint: Hint | None = None, **evidence: object) -> None:
        self.message, self.hint, self.evidence = message, dict(hint or {}), dict(evidence)
        super().__init__(message)

    def __str__(self) -> str:
        """The message, with the hint as Python spells it."""
        return with_hint(self.message, in_python(self.hint))


class UsageError(FlindersError):
    """An option or argument that cannot be used."""

    code, exit_code = "usage", 2


class UnknownParameter(UsageError, TypeError):
    """A keyword that a function does not have; also a `TypeError`, as Python's own answer is."""

    code = "unknown-parameter"


class UnitError(UsageError):
    """A unit that is not known, or units that contradict each other."""

    code = "unit"


class AxesError(UsageError):
    """An axes mapping that is not a signed permutation of x, y and z."""

    code = "axes"


class InputError(FlindersError):
    """Something that was given cannot be read."""

    code, exit_code = "input", 5


class ArrayError(InputError, ValueError):
    """An array of the wrong shape, of the wrong kind, or with values that are not finite."""

    code = "array"


class UnreadableInput(InputError):
    """A file that cannot be opened, decoded or made sense of."""

    code = "unreadable"


class NoMagnetometer(InputError):
    """A readable recording in which no magnetometer was recognised."""

    code = "no-magnetometer"


class NoAccelerometer(InputError):
    """A readable recording in which no accelerometer was recognised, and tilt cannot be removed without one."""

    code = "no-accelerometer"


class NoOnboardCalibration(InputError):
    """A log that tells of no calibration in force, where that is to be judged or taken."""

    code = "no-onboard"


class MissingExtra(InputError):
    """A format that needs a `package` that is not installed; `extra` is what to install for it."""

    code = "missing-extra"

    def __init__(self, package: str, extra: str, what: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(
            f"{what} needs {package}, which is not installed: pip install 'flinders[{extra}]' "
            f"(in a checkout: uv sync --inexact --extra {extra})",
            package=package,
            extra=extra,
        )


class LinkError(InputError):
    """A port, sensor or vehicle that is not there, does not answer, or has gone away."""

    code = "link"


class DocumentError(InputError):
    """A calibration file that cannot be understood."""

    code = "document"


class FitError(FlindersError):
    """No calibration can be given from this recording; `evidence` holds the numbers that say why."""

    code, exit_code = "fit", 4


class TooFewSamples(FitError):
    """Fewer usable readings (`found`) than the method has unknowns (`needed`); `skipped` says what was left out.

    Where readings repeat each other, `found` of `among` are different. How the sensor should have been turned is `how`,
    here and below.
    """

    code = "too-few-samples"

    def __init__(
        self,
        *,
        found: int,
        needed: int,
        method: str,
        among: int = 0,
        skipped: Iterable[object] = (),
        how: str = "through all directions",
    ) -> None:
        self.found, self.needed, self.method, self.among, self.how = found, needed, method, among, how
        different, usable = (counted(found, f"{kind} reading") for kind in ("different", "usable"))
        readings = f"{different} among {among:,}" if among else usable
        self.skipped = tuple(map(str, skipped))
        besides = f" besides {' and '.join(self.skipped)}" if self.skipped else ""
        check = "check what was left out, and " if self.skipped else ""
        super().__init__(
            f"{readings}{besides}, {method!r} needs at least {needed:,}: "
            f"{check}record for longer while turning the sensor {how}",
            found=found,
            needed=needed,
            method=method,
            skipped=self.skipped,
        )


class StuckAxis(FitError):
    """Axes that have the same value in every reading (`axes`: their names; `values`: what they read)."""

    code = "stuck-axis"

    def __init__(self, axes: tuple[str, ...], values: tuple[float, ...], how: str = "") -> None:
        self.axes, self.values = axes, values
        named = ", ".join(f"{axis} = {value:g}" for axis, value in zip(axes, values, strict=True))
        level = ". The method 'level' fits x and y of a level turn alone" if axes == ("z",) and not how else ""
        super().__init__(
            f"never changes in this recording: {named}. "
            f"Check the wiring and the columns, and turn the sensor {how or 'about all three of its axes'}{level}",
            axes=axes,
            values=values,
        )


def _rounded_up(angle: float) -> str:
    """Write an angle as the next larger one of a single digit below 1°, of whole degrees above.

    >>> _rounded_up(0.0), _rounded_up(0.011), _rounded_up(0.31), _rounded_up(3.0), _rounded_up(12.2)
    ('0.01', '0.02', '0.4', '3', '13')
    """
    step = 10.0 ** min(math.floor(math.log10(max(angle, 0.01))), 0)
    return f"{max(math.ceil(angle / step - 1e-6), 1) * step:.2g}"


class Unmoved(FitError):
    """All readings lie within a small angle (`angle_deg`) of one direction: the sensor was hardly turned.

    What the angle is measured from, see `flinders.diagnostics.unmoved`.
    """

    code = "unmoved"
    SAID: ClassVar[str] = "all readings lie within {angle}° of one direction: turn the sensor {how}"
    EVERY_WAY: ClassVar[str] = "through all directions"

    def __init__(self, angle_deg: float, how: str = EVERY_WAY) -> None:
        self.angle_deg = angle_deg
        super().__init__(self.SAID.format(angle=_rounded_up(angle_deg), how=how), angle_deg=angle_deg)


class NotTurned(FitError):
    """The sensor was still, and a disturbance explains its readings (`left`: residual of an axis, in their unit)."""

    code = "not-turned"

    def __init__(self, left: float, disturbances: str) -> None:
        self.left, self.disturbances = left, disturbances
        super().__init__(
            f"the sensor was not turned: its readings follow {disturbances} and hardly anything else ({figures(left)} "
            "of their unit is left, 1 σ). That tells what the disturbance does, and no offset or matrix: turn the "
            "sensor while recording, or give the calibration that it belongs to",
            hint={"previous": None},
            left=left,
            disturbances=disturbances,
        )


class FollowsAttitude(FitError):
    """A column follows the direction of the field (`share` of it), and cannot be told from soft iron."""

    code = "follows-attitude"

    def __init__(self, column: str, share: float) -> None:
        self.column, self.share = column, share
        super().__init__(
            f"column {column} follows the attitude ({share:.0%} of it is a function of the direction of the field): "
            "what it does cannot be told from soft iron. Change it in each attitude, not in step with the turning, and "
            "record again; or leave the column out",
            column=column,
            share=share,
        )


class OutOfScale(FitError):
    """Readings as large or as small (`size`) as no magnetometer gives them."""

    code = "out-of-scale"
    NOTHING: ClassVar[float] = 1e-300

    def __init__(self, size: float) -> None:
        self.size = size
        readings = f"readings of up to {size:.2g} are" if size > self.NOTHING else "readings that are all zero are"
        super().__init__(
            f"{readings} not those of a magnetometer: check which columns are read, and the unit", size=size
        )


class NotAnEllipsoid(FitError):
    """The quadric that fits best is open (`eigenvalues` of its quadratic form, largest scaled to one, where known)."""

    code = "not-an-ellipsoid"

    def __init__(self, eigenvalues: tuple[float, ...] = (), method: str = "") -> None:
        self.eigenvalues = eigenvalues
        values = ", ".join(f"{value:.3g}" for value in eigenvalues)
        shape = f" (eigenvalues {values}; all must be positive)" if values else ""
        instead = "" if method == "sphere" else ", or fit a sphere (method 'sphere')"
        super().__init__(
            f"the surface that fits these readings best is not closed{shape}: "
            f"they cover too few directions. Turn the sensor upside down and onto each of its sides{instead}",
            eigenvalues=eigenvalues,
            method=method,
        )


class Undetermined(FitError):
    """Readings say nothing of `unseen` of the nine parameters, and no prior holds them."""

    code = "undetermined"

    def __init__(self, unseen: int) -> None:
        self.unseen = unseen
        super().__init__(
            f"the readings leave {unseen} of nine parameters open, as rings of readings do: turn the sensor about "
            "more of its axes, or let the prior hold what was not seen",
            unseen=unseen,
        )


class MissingPose(FitError):
    """Still poses leave offsets or gains of an accelerometer open; evidence `side`: the side to turn up next."""

    code = "missing-pose"


class NeedsSamples(FitError):
    """A method that looks at each reading was given their sums alone."""

    code = "needs-samples"

    def __init__(self, method: str) -> None:
        super().__init__(
            f"{method!r} looks at each reading and was given a Summary: "
            "give it the readings, or use a method that needs only their sums, such as 'consistent'",
            method=method,
        )


class NeedsRecording(FitError):
    """A fit that was loaded from a file was asked for something of its readings, which a file does not keep."""

    code = "needs-recording"

    def __init__(self, what: str) -> None:
        super().__init__(
            f"the calibration file keeps no readings, and {what} are needed: give the recording too, as "
            "flinders report CALIBRATION RECORDING does, or fit it again",
            what=what,
        )


class NotExportable(FlindersError):
    """Values (`beyond`: their names) that the target's registers cannot hold; `evidence` holds what would be lost."""

    code, exit_code = "not-exportable", 4

    def __init__(self, message: str, *, beyond: Iterable[str], hint: Hint | None = None, **evidence: object) -> None:
        self.beyond = tuple(beyond)
        super().__init__(message, hint=hint, beyond=self.beyond, **evidence)


class NotSent(FlindersError):
    """A vehicle that must not be given these values as it is: armed, or with another compass than is meant."""

    code, exit_code = "not-sent", 4


class PluginError(FlindersError):
    """An installed package registers readers or targets that cannot be used."""

    code = "plugin"

    def __init__(self, package: str, problem: str) -> None:
        self.package, self.problem = package, problem
        super().__init__(
            f"the plugin {package}: {problem}; update it, or uninstall it", package=package, problem=problem
        )


class NoEngine(FlindersError):
    """The engine is not compiled for this machine, and cannot be: the message says what to install."""

    code = "no-engine"


class OutputError(FlindersError):
    """A result that cannot be written where it was asked for."""

    code, exit_code = "output", 6


class OutputExists(OutputError):
    """A file that would have been overwritten."""

    code = "output-exists"

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        super().__init__(
            f"{path} exists: give another name, or overwrite it", hint={"force": True}, path=os.fspath(path)
        )


class NotConfirmed(OutputError):
    """Values were sent and not confirmed; the message says what the other end holds now."""

    code = "not-confirmed"


def fault_words(error: Exception) -> str:
    """Say that the fault is ours, where the program goes on.

    >>> fault_words(KeyError("mag"))
    "internal error (KeyError: 'mag'): a fault in Flinders; please report it with the recording"
    """
    return f"internal error ({type(error).__name__}: {error}): a fault in Flinders; please report it with the recording"
