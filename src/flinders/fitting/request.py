"""Request for a fit by any method: site, target, prior and aiding sensors.

>>> request = Request.of(target_deg=2.0)
>>> request.target_deg, request.dip_deg, request.dip_assumed
(2.0, 60.0, True)
>>> estimator_of("auto", request).name
'auto'
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, cast

from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.errors import UsageError
from flinders.estimators import method_class
from flinders.estimators.auto import Auto
from flinders.estimators.base import SITE_OPTIONS
from flinders.heading.error_propagation import require_headings
from flinders.likelihood.prior import SOFT_IRON_SPREAD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.estimators import Estimator
    from flinders.fitting.aiding import Instruments
    from flinders.likelihood.site_field import Site


@dataclass(frozen=True, slots=True)
class Request:
    """Request for a fit by any method, from the parameters of `fit`."""

    target_deg: float = 1.0
    dip_deg: float = ASSUMED_DIP_DEG
    dip_assumed: bool = False
    field_strength: float | None = None  # length of corrected readings; None for the fitted radius
    alignment_sigma_deg: float | None = None
    site: Site | None = None  # the site reduced to values with an uncertainty, which are priors of the fit
    prior: float | None = SOFT_IRON_SPREAD
    instruments: Instruments | None = None

    @classmethod
    def of(cls, site: Site | None = None, **others: Any) -> Self:
        """Create a request with the dip, strength and mounting of a site; an unknown dip is assumed."""
        judged_deg, is_assumed = judged_dip(site)
        of_site: dict[str, Any] = {"dip_deg": judged_deg, "dip_assumed": is_assumed}
        if site is not None:
            of_site |= {"field_strength": site.fixed_length, "alignment_sigma_deg": site.alignment_sigma_deg}
            of_site["site"] = site.evidence
        return cls(**of_site, **others)

    def __post_init__(self) -> None:
        """Check the target."""
        if not self.target_deg > 0.0:
            raise UsageError(f"target is {self.target_deg:g}°: need a positive angle")

    @property
    def likelihood(self) -> Auto:
        """The estimator `Auto`, with whose claims those of other methods are compared."""
        return Auto(self.prior, dip_deg=self.dip_deg)


def judged_dip(site: Site | None) -> tuple[float, bool]:
    """Dip at which headings are judged, and whether it is assumed: that of the site, else 60°.

    >>> from flinders.likelihood.site_field import Site
    >>> judged_dip(Site(inclination_deg=-66.0)), judged_dip(None)
    ((-66.0, False), (60.0, True))
    """
    known = None if site is None else site.inclination_deg
    if known is not None:
        require_headings(known)
    return (ASSUMED_DIP_DEG, True) if known is None else (known, False)


def refuse_combinations(
    estimator: Estimator, request: Request, disturbances: Sequence[str], *, linearize: bool
) -> None:
    """Refuse aiding sensors and linearized axes with a method that cannot use them."""
    if request.instruments and not (isinstance(estimator, Auto) and not estimator.robust):
        raise UsageError("aiding sensors need the method auto with its prior: leave other methods and options out")
    if linearize and (request.instruments or disturbances or not isinstance(estimator, Auto)):
        raise UsageError(
            "linearized axes need the method auto: leave aiding sensors, disturbances and other methods out",
            hint={"linearize": True},
        )


def estimator_of(method: str | Estimator, request: Request) -> Estimator:
    """Estimator of a method by its name, or as given, with options from the site.

    Raises
    ------
    UsageError
        For an unknown name, an object that is no method, and a dip or strength other than that of the site.
    """
    given: Any = method_class(method)() if isinstance(method, str) else method
    if not hasattr(given, "estimate") or isinstance(given, type):
        raise UsageError(f"method is {method!r}: need a name, or a method of flinders.estimators with its options")
    options = getattr(given, "__dataclass_fields__", {})
    of_site = {name: getattr(request, name) for name in SITE_OPTIONS if name in options}
    for name, known in of_site.items():
        if (own := getattr(given, name)) not in (known, options[name].default):
            raise UsageError(
                f"{name} is given as {own:g} with the method {given.name}: give this value only with the site",
                hint={"site": None},
            )
    return cast("Estimator", replace(given, **of_site) if of_site else given)
