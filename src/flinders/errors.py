"""One tree of errors: what was found, what is needed, what to do.

::

    FlindersError                    code              exit code
    ├── UsageError                   usage             2    an option or argument cannot be used
    │   ├── UnknownParameter         unknown-parameter 2    a keyword that a function does not have
    │   ├── UnitError                unit              2    an unknown unit, or units that contradict each other
    │   └── AxesError                axes              2    an axes mapping that is not a signed permutation
    ├── InputError                   input             5    input that cannot be read
    │   ├── ArrayError               array             5    an array of the wrong shape or with gaps
    │   ├── UnreadableInput          unreadable        5    a file that cannot be opened or decoded
    │   ├── NoMagnetometer           no-magnetometer   5    a readable file without a magnetometer in it
    │   ├── NoAccelerometer          no-accelerometer  5    a file without an accelerometer, which headings need
    │   ├── NoOnboardCalibration     no-onboard        5    a log that does not contain the onboard calibration
    │   ├── ForeignAxes              foreign-axes      5    accelerometer and magnetometer with different axes
    │   ├── MissingExtra             missing-extra     5    a format whose optional package is not installed
    │   ├── LinkError                link              5    a sensor or vehicle that is not connected
    │   ├── LostWorker               lost-worker       5    a file of a fleet that crashes the workers which read it
    │   ├── NoUnit                   no-unit           5    readings of a fleet that name no unit
    │   └── DocumentError            document          5    a file that is not a valid calibration file
    ├── FitError                     fit               4    no calibration can be given from this recording
    │   ├── TooFewSamples            too-few-samples   4
    │   ├── StuckAxis                stuck-axis        4    an axis that never changes
    │   ├── NotTurned                not-turned        4    a still sensor whose readings follow a disturbance
    │   ├── FollowsAttitude          follows-attitude  4    a column that is a function of the direction of the field
    │   ├── Unmoved                  unmoved           4    a sensor that was hardly turned
    │   ├── OutOfScale               out-of-scale      4    readings outside the range of any magnetometer
    │   ├── NotAnEllipsoid           not-an-ellipsoid  4    the quadric through the readings is open
    │   ├── MissingPose              missing-pose      4    still poses that do not determine an accelerometer's errors
    │   ├── Undetermined             undetermined      4    readings that leave parameters open, without a prior
    │   ├── NeedsSamples             needs-samples     4    sums were given where the method needs the readings
    │   ├── NeedsRecording           needs-recording   4    a calibration file was given, which keeps no readings
    │   └── Refused                  refused           4    a fit exists, its verdict is "refused"
    │       └── NotMerged            not-merged        4    calibrations that contradict each other
    ├── NotExportable                not-exportable    4    values that the target cannot hold
    ├── NotSent                      not-sent          4    a vehicle that must not receive these values now
    ├── PluginError                  plugin           70    an installed package that adds to Flinders is broken
    ├── NoEngine                     no-engine        70    the engine is not compiled here, and cannot be
    └── OutputError                  output            6    the result cannot be written
        ├── OutputExists             output-exists     6    the file exists already
        └── NotConfirmed             not-confirmed     6    sent values that the receiver did not confirm

Every error has a stable `code`, the `exit_code` of the command line, a `message`, and as `evidence` the numbers in the
message, by name.

>>> error = TooFewSamples(found=5, needed=10, method="likelihood")
>>> error.code, error.exit_code, error.evidence["found"]
('too-few-samples', 4, 5)
>>> print(error)
5 usable readings, 'likelihood' needs at least 10: record for longer while turning the sensor through all directions

A message contains no names of arguments. The arguments that avoid an error are its `hint`, values by keyword, which
each interface writes in its own form: Python as keywords, the command line as options.

>>> error = OutputExists("log.csv")
>>> error.message, error.hint
('log.csv exists: give another name, or overwrite it', {'force': True})
>>> print(error)
log.csv exists: give another name, or overwrite it (force=True)

Messages of all modules write counts, numbers and fractions with `count_text`, `figures` and `percent`.
`flinders.foreign_errors` converts exceptions of other packages to these errors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

Hint: TypeAlias = Mapping[str, object]
"""Arguments of a remedy: values by keyword of the Python interface, None for any value.

The value of a method's name is a mapping of its arguments."""

Spelling: TypeAlias = "Callable[[Hint], str]"
"""Function that writes a hint in the form of an interface, such as `python_arguments`."""


def count_text(number: float, noun: str) -> str:
    """Write a count with its noun.

    >>> count_text(1, "reading"), count_text(24483, "usable reading")
    ('1 reading', '24,483 usable readings')
    """
    return f"{number:,.0f} {noun}{'s' * (round(number) != 1)}"


def did_you_mean(word: str, known: Iterable[str], *, by_other: Mapping[str, str] | None = None) -> str:
    """Question with the known word that is most similar to a mistyped one; empty if none is similar.

    `by_other` has known words by other words with the same meaning, in any case, which precede similar words.

    >>> did_you_mean("micropythn", ["arduino", "micropython"]), did_you_mean("zzz", ["arduino"])
    (" (did you mean 'micropython'?)", '')
    >>> did_you_mean("magneto", ["li", "axes"], by_other={"Magneto": "li"})
    " (did you mean 'li'?)"
    """
    from difflib import get_close_matches

    folded = word.strip().casefold()
    meant = {other.casefold(): name for other, name in (by_other or {}).items()}.get(folded)
    if meant is None:
        by_folded = {name.casefold(): name for name in known}
        meant = next((by_folded[like] for like in get_close_matches(folded, by_folded, n=1)), None)
    return "" if meant is None else f" (did you mean {meant!r}?)"


def figures(value: float, digits: int = 2) -> str:
    """Write a number to `digits` significant digits, or as an integer if it has more, with an exponent only if needed.

    >>> figures(0.0321), figures(2.0), figures(324.7), figures(49.3, 4), figures(31072.3, 4), figures(3.2e9)
    ('0.032', '2.0', '325', '49.30', '31,072', '3.2e+09')
    """
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    return f"{value:,.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def percent(count: float, total: float) -> str:
    """Write a fraction to a tenth of a per cent; 100 % and 0 % stand for exactly all and none.

    >>> percent(3, 4), percent(2500, 2501), percent(1, 5000), percent(7, 7), percent(0, 0)
    ('75.0%', '> 99.9%', '< 0.1%', '100.0%', '0.0%')
    """
    written = f"{count / total if total else 0.0:.1%}"
    if written == "100.0%" and count < total:
        return "> 99.9%"
    return "< 0.1%" if written == "0.0%" and count else written


def python_arguments(hint: Hint) -> str:
    """Write a hint as arguments of Python.

    >>> python_arguments({"force": True, "columns": "4,5,6", "unit": None, "at": {"current": 0.0}})
    "force=True, columns='4,5,6', unit=, at(current=0.0)"
    """
    return ", ".join(_argument(keyword, value) for keyword, value in hint.items())


def _argument(keyword: str, value: object) -> str:
    if isinstance(value, Mapping):
        return f"{keyword}({python_arguments(value)})"
    return f"{keyword}={'' if value is None else repr(value)}"


def append_hint(sentence: str, spelled: str) -> str:
    """Append a written hint, if any, to a sentence.

    >>> append_hint("name the unit", "--unit, --scale"), append_hint("name the unit", "")
    ('name the unit (--unit, --scale)', 'name the unit')
    """
    return f"{sentence} ({spelled})" if spelled else sentence


class FlindersError(Exception):
    """Base of all errors that this package raises on purpose.

    `message` states the problem and the need, `hint` has the arguments that avoid the error, and `evidence` the numbers
    of the message by name.
    """

    code: ClassVar[str] = "flinders"
    exit_code: ClassVar[int] = 70

    def __init__(self, message: str = "", *, hint: Hint | None = None, **evidence: object) -> None:
        self.message, self.hint, self.evidence = message, dict(hint or {}), dict(evidence)
        super().__init__(message)

    def __str__(self) -> str:
        """The message, with the hint as Python spells it."""
        return append_hint(self.message, python_arguments(self.hint))


class UsageError(FlindersError):
    """An option or argument that cannot be used."""

    code, exit_code = "usage", 2


class UnknownParameter(UsageError, TypeError):
    """A keyword that a function does not have; also a `TypeError`, as Python itself raises."""

    code = "unknown-parameter"


class UnitError(UsageError):
    """A unit that is not known, or units that contradict each other."""

    code = "unit"


class AxesError(UsageError):
    """An axes mapping that is not a signed permutation of x, y and z."""

    code = "axes"


class InputError(FlindersError):
    """Input that cannot be read."""

    code, exit_code = "input", 5


class ArrayError(InputError, ValueError):
    """An array of the wrong shape, of the wrong kind, or with values that are not finite."""

    code = "array"


class UnreadableInput(InputError):
    """A file that cannot be opened, decoded or interpreted."""

    code = "unreadable"


class NoMagnetometer(InputError):
    """A readable recording in which no magnetometer was recognised."""

    code = "no-magnetometer"


class NoAccelerometer(InputError):
    """A readable recording in which no accelerometer was recognised, which the tilt correction needs."""

    code = "no-accelerometer"


class NoOnboardCalibration(InputError):
    """A log that does not contain the onboard calibration, which the operation needs."""

    code = "no-onboard"


class MissingExtra(InputError):
    """A format that needs a `package` which is not installed; ``pip install flinders[extra]`` installs `packages`.

    >>> print(MissingExtra("serialx", "serial", "a serial port", ["serialx"]))
    a serial port needs serialx, which is not installed: pip install serialx (with uv: uv pip install serialx)
    """

    code = "missing-extra"

    def __init__(self, package: str, extra: str, what: str, packages: Sequence[str]) -> None:
        self.package, self.extra = package, extra
        install = f"pip install {' '.join(packages)}"
        super().__init__(
            f"{what} needs {package}, which is not installed: {install} (with uv: uv {install})",
            package=package,
            extra=extra,
        )


class LinkError(InputError):
    """A port, sensor or vehicle that does not exist, does not answer, or was disconnected."""

    code = "link"


class DocumentError(InputError):
    """A calibration file that cannot be parsed."""

    code = "document"


class FitError(FlindersError):
    """A recording that gives no calibration; `evidence` holds the numbers of the reason."""

    code, exit_code = "fit", 4


class TooFewSamples(FitError):
    """Fewer usable readings (`found`) than the method needs (`needed`); `skipped` lists the rows that were skipped.

    If readings repeat, `found` of `among` readings are different. `how` is the motion to record, here and below.
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
        different, usable = (count_text(found, f"{kind} reading") for kind in ("different", "usable"))
        readings = f"{different} among {among:,}" if among else usable
        self.skipped = tuple(map(str, skipped))
        besides = f" besides {' and '.join(self.skipped)}" if self.skipped else ""
        check = "check the rows that were left out, and " if self.skipped else ""
        super().__init__(
            f"{readings}{besides}, {method!r} needs at least {needed:,}: "
            f"{check}record for longer while turning the sensor {how}",
            found=found,
            needed=needed,
            method=method,
            skipped=self.skipped,
        )


class StuckAxis(FitError):
    """Axes that have the same value in every reading (`axes`: names of the axes; `values`: the constant values)."""

    code = "stuck-axis"

    def __init__(self, axes: tuple[str, ...], values: tuple[float, ...], how: str = "") -> None:
        self.axes, self.values = axes, values
        named = ", ".join(f"{axis} = {value:g}" for axis, value in zip(axes, values, strict=True))
        level = ". The method 'level' fits x and y of a level turn alone" if axes == ("z",) and not how else ""
        super().__init__(
            f"axes that never change in this recording: {named}. "
            f"Check the wiring and the columns, and turn the sensor {how or 'about all three of its axes'}{level}",
            axes=axes,
            values=values,
        )


def _round_up(angle: float) -> str:
    """Write an angle rounded up: to one digit below 1°, to whole degrees above.

    >>> _round_up(0.0), _round_up(0.011), _round_up(0.31), _round_up(3.0), _round_up(12.2)
    ('0.01', '0.02', '0.4', '3', '13')
    """
    step = 10.0 ** min(math.floor(math.log10(max(angle, 0.01))), 0)
    return f"{max(math.ceil(angle / step - 1e-6), 1) * step:.2g}"


class Unmoved(FitError):
    """All readings are within a small angle of one direction (`angle_deg`, degrees): the sensor was hardly turned.

    `flinders.diagnostics.unmoved` computes the angle.
    """

    code = "unmoved"
    MESSAGE: ClassVar[str] = "all readings lie within {angle}° of one direction: turn the sensor {how}"
    ALL_DIRECTIONS: ClassVar[str] = "through all directions"

    def __init__(self, angle_deg: float, how: str = ALL_DIRECTIONS) -> None:
        self.angle_deg = angle_deg
        super().__init__(self.MESSAGE.format(angle=_round_up(angle_deg), how=how), angle_deg=angle_deg)


class NotTurned(FitError):
    """A still sensor whose readings follow a disturbance.

    `left` is the rms residual of an axis after the disturbance is removed, in the unit of the readings.
    """

    code = "not-turned"

    def __init__(self, left: float, disturbances: str) -> None:
        self.left, self.disturbances = left, disturbances
        super().__init__(
            f"the sensor was not turned: its readings follow {disturbances} and hardly anything else (residuals of "
            f"{figures(left)} in the unit of the readings, 1 σ). Such a recording determines the effect of the "
            "disturbance, but no offset or matrix: turn the sensor while recording, or give the calibration of this "
            "sensor",
            hint={"previous": None},
            left=left,
            disturbances=disturbances,
        )


class FollowsAttitude(FitError):
    """A column that depends on the field's direction, like soft iron (`share`: explained part of its variance)."""

    code = "follows-attitude"

    def __init__(self, column: str, share: float) -> None:
        self.column, self.share = column, share
        super().__init__(
            f"column {column} follows the attitude ({share:.0%} of it is a function of the direction of the field): "
            f"its effect cannot be distinguished from soft iron. Record again and change {column} in each attitude, "
            "independently of the turning; or leave the column out",
            column=column,
            share=share,
        )


class OutOfScale(FitError):
    """Readings outside the range of any magnetometer (`size`: largest absolute value)."""

    code = "out-of-scale"
    MIN_SIZE: ClassVar[float] = 1e-300

    def __init__(self, size: float) -> None:
        self.size = size
        readings = f"readings of up to {size:.2g} are" if size > self.MIN_SIZE else "readings that are all zero are"
        super().__init__(f"{readings} not those of a magnetometer: check the columns and the unit", size=size)


class NotAnEllipsoid(FitError):
    """The quadric that fits the readings best is not an ellipsoid.

    `eigenvalues` are those of its quadratic form, relative to the largest; empty if they are not known.
    """

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
    """Readings that leave some of the nine parameters undetermined, without a prior (`unseen`: number of these)."""

    code = "undetermined"

    def __init__(self, unseen: int) -> None:
        self.unseen = unseen
        super().__init__(
            f"the readings do not determine {unseen} of nine parameters, as with turns about one axis: turn the sensor "
            "about more of its axes, or use the prior for these parameters",
            unseen=unseen,
        )


class MissingPose(FitError):
    """Still poses that do not determine all offsets and gains of an accelerometer.

    `side` in the evidence is the side to turn up in the next pose.
    """

    code = "missing-pose"


class NeedsSamples(FitError):
    """A method that needs each reading was given only their sums."""

    code = "needs-samples"

    def __init__(self, method: str) -> None:
        super().__init__(
            f"{method!r} needs each reading and was given a Summary: "
            "give the readings, or use a method that needs only their sums, such as 'consistent'",
            method=method,
        )


class NeedsRecording(FitError):
    """An operation on a fit from a file needs its readings, which the file does not contain."""

    code = "needs-recording"

    def __init__(self, what: str) -> None:
        super().__init__(
            f"the calibration file contains no readings, and {what} are needed: give the recording too, as in "
            "flinders report CALIBRATION RECORDING, or fit it again",
            what=what,
        )


class NotExportable(FlindersError):
    """Values that a target cannot represent (`beyond`: their names); `evidence` holds the parts that would be lost."""

    code, exit_code = "not-exportable", 4

    def __init__(self, message: str, *, beyond: Iterable[str], hint: Hint | None = None, **evidence: object) -> None:
        self.beyond = tuple(beyond)
        super().__init__(message, hint=hint, beyond=self.beyond, **evidence)


class NotSent(FlindersError):
    """A vehicle that must not receive these values now: it is armed, or has another compass."""

    code, exit_code = "not-sent", 4


class PluginError(FlindersError):
    """An installed package that registers readers or targets which cannot be used."""

    code = "plugin"

    def __init__(self, package: str, problem: str) -> None:
        self.package, self.problem = package, problem
        super().__init__(
            f"the plugin {package}: {problem}; update it, or uninstall it", package=package, problem=problem
        )


class NoEngine(FlindersError):
    """The engine is not compiled for this machine and cannot be compiled; the message says what to install."""

    code = "no-engine"


class OutputError(FlindersError):
    """A result that cannot be written to the given place."""

    code, exit_code = "output", 6


class OutputExists(OutputError):
    """A file that exists and would be overwritten."""

    code = "output-exists"

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        super().__init__(
            f"{path} exists: give another name, or overwrite it", hint={"force": True}, path=os.fspath(path)
        )


class NotConfirmed(OutputError):
    """Values that were sent and not confirmed; the message states the values that the receiver has now."""

    code = "not-confirmed"


def bug_message(error: Exception) -> str:
    """Message about a bug in Flinders after which the program continues.

    >>> bug_message(KeyError("mag"))
    "internal error (KeyError: 'mag'): a fault in Flinders; please report it with the recording"
    """
    return f"internal error ({type(error).__name__}: {error}): a fault in Flinders; please report it with the recording"
