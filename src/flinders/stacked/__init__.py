"""Many units at once: the plain course of `flinders.fit`, in whole arrays.

A fleet is thousands of short recordings, and a fit of one is a hundred calls of small functions whose overhead
outweighs their arithmetic. Here each step is done for all units of a stack together. A unit for which any decision is
not the plain one, be it outliers, a level turn, a direction that nothing was seen of, or a distortion that belongs to
directions, leaves the stack and goes through `flinders.fit` by itself. So both give the same numbers, to a billionth.

==============  ============================================================================================
module          what it does for all units
==============  ============================================================================================
`stack`         `Stack`: readings side by side
`sums`          the 35 moments
`surfaces`      ellipsoids, and one pass through the readings near them
`consistent`    the consistent fit from sums
`support`       directions that are seen, and what noise pretends
`likelihood`    start, steps, bias, covariance
`places`        cells of raw space and of the sphere: what spreads readings out, coverage
`hung`          correlation of residuals in time, what creeps, what belongs to directions, what changed
`outliers`        whether residuals ask for a robust fit
`judge`         health, heading errors, findings
`lane`          all of that, one after the other
`columns`       `fit_stack`: the lane, and `flinders.fit` for those that left it
==============  ============================================================================================

The functions ask an array which library it belongs to, and keep to the array API standard (2024.12).
"""

from __future__ import annotations

from flinders.stacked.columns import BatchColumns as BatchColumns
from flinders.stacked.columns import fit_stack as fit_stack
from flinders.stacked.stack import Lined as Lined
from flinders.stacked.stack import Stack as Stack
