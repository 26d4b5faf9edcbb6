"""Algorithms of other projects, written again from their sources and papers, for comparison with Flinders.

They are not meant for users. Each returns the ellipsoid of a recording, without an uncertainty:

>>> from flinders import simulate
>>> samples = simulate.tumble(seed=1, motion="swayed", n=1500).samples
>>> for name, emulation in EMULATIONS.items():
...     print(f"{name:12} {emulation(samples).centre.round()}")
ladder       [-79.  82. -10.]
forgetting   [-70.  69.  -4.]
sar-ls       [-76.  76.  -2.]
sar-kf       [-76.  76.  -4.]
px4-observer [-77.  74.  -0.]
magyc-ls     [-75.  75.  -1.]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from benchmarks.emulations.forgetting import forgetting
from benchmarks.emulations.ladder import ladder
from benchmarks.emulations.magyc_ls import magyc_ls
from benchmarks.emulations.px4_observer import px4_observer
from benchmarks.emulations.sar_kf import sar_kf
from benchmarks.emulations.sar_ls import sar_ls

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flinders import Samples
    from flinders.geometry.ellipsoid import Ellipsoid

EMULATIONS: Final[Mapping[str, Callable[[Samples], Ellipsoid]]] = {
    "ladder": ladder,
    "forgetting": forgetting,
    "sar-ls": sar_ls,
    "sar-kf": sar_kf,
    "px4-observer": px4_observer,
    "magyc-ls": magyc_ls,
}
"""Emulations by the names of the methods."""
