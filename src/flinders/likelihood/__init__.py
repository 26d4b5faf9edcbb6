"""Observation terms of the likelihood; each term gives residuals and their Jacobian as normal equations.

A calibration is the most probable set of parameters

    θ = (b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃)

where raw = b + S u + noise, u is a unit vector and S symmetric: S = F W⁻¹, all nine in the unit of
the readings. Each term adds a 9 × 9 matrix Σ JᵀJ and a vector Σ Jᵀr to `NormalEquations`; terms
are independent of each other, and the solver is independent of the terms.

- `magnitude`: every corrected reading has the same length (always)
- `prior`: soft iron is small unless the readings contradict

With other sensors, `parameters` holds the additional parameters, `observations` the residuals of readings that share a
direction of the field, `solver` the Levenberg–Marquardt iteration, and `robust` the weights of large residuals. The
problems of `solver` are `joint` for a magnetometer with aiding sensors, `sensors` for several magnetometers on one
body, and `flinders.estimators.disturbance_problem`, which estimates disturbances from the magnitude alone. Terms:

- `gyro`: the field is constant in the world while the body turns
- `dip`: the angle between field and vertical is the same at every attitude (accelerometer, or attitude without yaw)
- `attitude`: the field has a constant direction in the world
- `site_field`: strength and dip of the field are known
"""
