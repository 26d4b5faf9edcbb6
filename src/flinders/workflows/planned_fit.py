"""Expected fit of a planned recording: its claim and verdict, before anything is recorded.

The information in a recording depends on its directions and on the size of the noise, and hardly on the random numbers
of one recording. The planned motion is therefore simulated for several sensors with usual iron, and the engine fits and
judges each simulated recording like a real one. Prior, widening, findings and verdict are those of `flinders.fit`. In
some recordings white noise happens to look correlated, and the claims are two to four times as large. The expected
claim is therefore the lower quartile; `ExpectedFit.high_error_deg` is the 88 % quantile.

`ExpectedFit.information_error_deg` is the information bound (Cramér–Rao) of the same readings: the error that noise and
prior leave if residuals are independent. The claim is larger if the motion does not cover all directions.

>>> from flinders.simulate.turn_sequence import PoseTurn
>>> level = expected_fit([PoseTurn()], RecordingSettings(seconds=12.0, noise=0.5, sway_deg=0.1))
>>> level.fit.verdict, round(level.fit.claim.heading_error_deg.worst, 1), level.fit.evidence.method
('limited', 0.1, 'level')
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.errors import FitError
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.simulate.motions import RATE_HZ
from flinders.simulate.recording import ACCELERATION_NOISE, RATE_NOISE, Imu, tumble
from flinders.simulate.turn_sequence import sequence_motion
from flinders.verdicts import MEANINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.fitting.result import Fit
    from flinders.likelihood.site_field import Site
    from flinders.simulate.recording import Simulated
    from flinders.simulate.turn_sequence import PoseTurn

DRAWS: Final = 17
"""Number of simulated recordings of a plan. The fifth of their fits, in order, is the lower quartile."""

AIDED_DRAWS: Final = 5
"""Number of simulated recordings with aiding sensors, whose fits take longer."""

TYPICAL, HIGH = 0.25, 0.88
"""Quantiles of the claims: the expected one, and a high one that some recordings reach by chance."""

MAX_READINGS: Final = 4_000
"""Largest number of readings of a simulated recording; more readings are averaged to this number."""

MAX_AIDED_READINGS: Final = 600
"""Largest number of readings of a simulated recording with aiding sensors."""

GOOD_RANK, REACHED_RANK, LEVEL_RANK, MISSED_RANK, REFUSED_RANK = 3, 2, 1, 0, -1
"""Grades of a result, from a good verdict to a refusal.

They are: a good verdict; headings within the target at every tilt of the body; headings within the target while the
body is level; headings outside the target; refused."""

FIELD_STRENGTH: Final = 50.0
"""Field strength in µT that is assumed if the place is unknown."""


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """Duration, noise, rate and site of a planned recording, and the aiding sensors of its fit."""

    seconds: float
    noise: float  #: µT, 1 σ of each axis and reading
    sway_deg: float  #: rms lean of the body away from the attitudes of the plan, in degrees
    rate_hz: float = RATE_HZ  #: readings per second
    site: Site | None = None  #: field at the place
    target_deg: float = 1.0  #: largest acceptable heading error in degrees
    aiding: tuple[str, ...] = ()  #: aiding sensors, with their names in `flinders.fit`

    @property
    def averaged(self) -> int:
        """Number of readings that are averaged to one reading of the simulation."""
        most = MAX_AIDED_READINGS if self.aiding else MAX_READINGS
        return max(1, math.ceil(self.seconds * self.rate_hz / most))


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedFit:
    """Expected fit: the lower quartile of the fits of simulated recordings, ordered by verdict and then by error."""

    fit: Fit
    simulated: Simulated  #: the recording of that fit, with its truth
    high_error_deg: float  #: worst heading error, 1 σ, that 88 % of the fits do not exceed; infinite if unknown

    @property
    def information_error_deg(self) -> float:
        """Information bound of the level heading error, rms over headings, 1 σ in degrees; NaN if unknown."""
        error = self.fit.claim.textbook_heading_error_deg
        return math.nan if error is None else error.rms

    @property
    def is_upside_down(self) -> bool:
        """Whether the fit assumes that the sensor is mounted upside down, and states another dip."""
        return self.fit.claim.known_dip_deg * self.simulated.dip_deg < 0.0

    @property
    def unused_aids(self) -> list[str]:
        """Aiding sensors that the fit does not use."""
        aiding = self.fit.evidence.aiding
        return [] if aiding is None else [sensor.name for sensor in aiding.sensors if not sensor.is_used]

    @property
    def limits(self) -> list[str]:
        """Codes of the findings that limit the fit, or refuse it."""
        return [finding.code for finding in self.fit.findings if finding.severity != "note"]

    def rank(self, tilt_deg: float) -> int:
        """Grade of the result for a body that is tilted by up to `tilt_deg`, from `REFUSED_RANK` to `GOOD_RANK`."""
        claim = self.fit.claim
        if self.fit.verdict == "refused":
            return REFUSED_RANK
        if self.fit.verdict == "good":
            return GOOD_RANK
        if not claim.heading_error_deg.worst <= claim.target_deg:
            return MISSED_RANK
        return REACHED_RANK if claim.attitude_limit_deg >= tilt_deg else LEVEL_RANK

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        claim = self.fit.claim
        return {
            "verdict": self.fit.verdict,  # of the fit to expect
            "heading_error_deg": claim.heading_error_deg.as_dict(),  # of a level vehicle, 1 σ: rms and worst heading
            "heading_bound_deg": claim.heading_bound_deg,  # that a level heading stays within with 95 %
            "high_error_deg": self.high_error_deg,  # worst heading error that 88 % of such recordings claim at most
            "information_error_deg": self.information_error_deg,  # rms by the information bound of noise and prior
            "attitude_limit_deg": claim.attitude_limit_deg,  # tilt up to which headings are within the target
            "per_degree_of_tilt": claim.per_degree_of_tilt,  # degrees of heading that a degree of tilt adds
            "findings": self.limits,  # codes of the findings that limit it
        }


def expected_fit(
    sequence: Sequence[PoseTurn], recording: RecordingSettings, *, draws: int | None = None
) -> ExpectedFit | None:
    """Simulate and fit a planned recording; None if most of the simulated recordings give no fit.

    Parameters
    ----------
    draws : int, optional
        Number of simulated recordings; by default `DRAWS` or `AIDED_DRAWS`.
    """
    count = draws or (AIDED_DRAWS if recording.aiding else DRAWS)
    simulated = [simulate_plan(sequence, recording, seed) for seed in range(count)]
    pairs = [(result, one) for one in simulated if (result := fit_planned(one, recording)) is not None]
    if 2 * len(pairs) <= count:
        return None
    verdicts = list(MEANINGS)
    pairs.sort(key=lambda pair: (verdicts.index(pair[0].verdict), pair[0].claim.heading_error_deg.worst))
    result, one = pairs[round(TYPICAL * (count - 1))]
    claimed = sorted(each.claim.heading_error_deg.worst for each, _ in pairs)
    place = round(HIGH * (count - 1))
    return ExpectedFit(result, one, claimed[place] if place < len(claimed) else math.inf)


def simulate_plan(sequence: Sequence[PoseTurn], recording: RecordingSettings, seed: int) -> Simulated:
    """Simulate one planned recording of a sensor with usual iron."""
    site, averaged = recording.site, recording.averaged
    known = None if site is None else site.strength
    less = 1.0 / math.sqrt(averaged)
    return tumble(
        seed,
        motion=sequence_motion(sequence, sway_deg=recording.sway_deg),
        n=max(1, round(recording.seconds * recording.rate_hz / averaged)),
        rate_hz=recording.rate_hz / averaged,
        noise=recording.noise * less,
        field_strength=FIELD_STRENGTH if known is None else known,
        dip_deg=dip_of(site),
        imu=Imu(gyro_noise=RATE_NOISE * less, acceleration_noise=ACCELERATION_NOISE * less),
    )


def fit_planned(simulated: Simulated, recording: RecordingSettings) -> Fit | None:
    """Fit a simulated recording like a real one, with the planned aiding sensors; None if there is no fit."""
    samples = simulated.samples
    samples = replace(
        samples,
        acceleration=samples.acceleration if "dip" in recording.aiding else None,
        rate=samples.rate if "rate" in recording.aiding else None,
    )
    try:
        return fit(samples, site=recording.site, target_deg=recording.target_deg, aiding=recording.aiding)
    except Refused as refused:
        return refused.fit
    except FitError:
        return None


def dip_of(site: Site | None) -> float:
    """Dip at a site in degrees; the usual assumption if the site or its dip is unknown."""
    return ASSUMED_DIP_DEG if site is None or site.inclination_deg is None else site.inclination_deg
