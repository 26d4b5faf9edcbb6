"""Separate calibration of each magnetometer of a log or table.

>>> from flinders import simulate
>>> recordings = {name: simulate.tumble(seed=seed).samples for name, seed in (("top", 1), ("left", 2))}
>>> recordings["dead"] = recordings["top"][:3]
>>> outcomes = fit_each(recordings)
>>> outcomes["top"].verdict, outcomes["left"].calibration.sensor, outcomes["dead"].code
('good', 'left', 'too-few-samples')
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, TypeAlias

from flinders.core.keywords import check_keywords
from flinders.errors import FitError, InputError, TooFewSamples
from flinders.fitting.filtering import fit_filtered
from flinders.heading.smoothing import Filter
from flinders.likelihood.site_field import recorded_site
from flinders.readers import Log, open_log
from flinders.workflows.recordings import with_left_out

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from flinders.core.samples import Recording
    from flinders.errors import FlindersError
    from flinders.fitting.result import Fit

    Outcome: TypeAlias = Fit | FlindersError


@check_keywords()
def fit_each(
    source: Mapping[str, Recording] | Log | str | os.PathLike[str], *, by: Filter | str | None = None, **options: Any
) -> dict[str, Outcome]:
    """Calibrate each magnetometer of a log or table separately.

    `flinders.fit_multi` calibrates the magnetometers of one body together, which needs readings at the same times.

    Parameters
    ----------
    source : path, Log, or mapping of str to Recording
        A log or table with several magnetometers, as `flinders.open_log` reads it; or recordings by the names of their
        sensors.
    by : Filter or str, optional
        A filter for the readings, such as ``"median:5"``; a finding states its effect.
    **options
        Parameters of `flinders.fit`, except `sensor`. By default the site is that in the log.

    Returns
    -------
    dict of str to Fit or FlindersError
        By the name of each sensor, in order: the fit, or the error if the sensor cannot be read or fitted. `Refused`
        contains a fit that cannot be trusted.

    Raises
    ------
    InputError
        For a log that cannot be read at all.
    UsageError
        For unknown parameters of `flinders.fit`.
    """
    log = open_log(source) if isinstance(source, str | os.PathLike) else source
    recordings = {one.name: one for one in log.instruments} if isinstance(log, Log) else log
    if isinstance(log, Log) and "site" not in options and (stated := recorded_site(log)):
        options["site"] = stated[0]
    return dict(fits_of(recordings, by=Filter.of(by) if isinstance(by, str) else by, **options))


def fits_of(
    recordings: Mapping[str, Recording],
    *,
    by: Filter | None = None,
    notice: Callable[[str], object] = str,
    **options: Any,
) -> Iterator[tuple[str, Outcome]]:
    """Yield the name of each sensor with its fit or error; parameters are those of `fit_each`.

    `notice` is called with a line of advice if only the unfiltered readings give a calibration; by default the advice
    is ignored.
    """
    for name, recording in recordings.items():
        try:
            outcome: Outcome = fit_filtered([recording], by, notice=notice, **{**options, "sensor": name})
        except TooFewSamples as error:
            outcome = with_left_out(error, [recording])
        except (FitError, InputError) as refusal:
            outcome = refusal
        yield name, outcome
