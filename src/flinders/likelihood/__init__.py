"""Observation terms of the likelihood: each gives residuals and their Jacobian as normal equations.

A calibration is the most probable set of parameters

    θ = (b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃)

where raw = b + S u + noise, u is a unit vector and S symmetric: S = F W⁻¹, all nine in the unit of
the readings. Each term adds a 9 × 9 matrix Σ JᵀJ and a vector Σ Jᵀr to `NormalEquations`; terms
know nothing of each other, and the solver knows nothing of what they observe.

- `magnitude`: every corrected reading has the same length (always)
- `prior`: soft iron is mild unless the readings say otherwise

Where there is more than a magnetometer, `parameters` holds what else is found, `observations` the residuals of all
readings that share a direction of the field, `solver` the steps of Levenberg and Marquardt, and `robust` the weights
that large residuals lose. The problems of `solver` are
`joint`, a magnetometer with aiding sensors, `sensors`, several magnetometers on one body, and that of
`flinders.estimators.disturbance_problem`, where the magnitude alone tells what disturbances add. Terms:

- `gyro`: the field stands still while the body turns
- `dip`: its angle to the vertical is the same at every attitude (accelerometer, or an attitude without its yaw)
- `attitude`: it stands still in the world
- `site_field`: its strength and dip are known
"""
