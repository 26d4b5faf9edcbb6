"""Quaternions of attitudes as SciPy's, which is used here only to compare with."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest

from flinders.geometry import quaternions

transform = pytest.importorskip("scipy.spatial.transform")
Rotation, Slerp = transform.Rotation, transform.Slerp


def test_turns_angles_matrices_and_the_way_between_are_those_of_scipy() -> None:
    rng = np.random.default_rng(1)
    theirs = Rotation.random(500, rng=rng)
    ours = np.roll(theirs.as_quat(), 1, axis=1)  # theirs are x, y, z, w
    vector = rng.normal(0, 40, (500, 3))
    npt.assert_allclose(quaternions.rotate_vectors(ours, vector), theirs.apply(vector), atol=1e-11)
    angles = rng.uniform(-3, 3, (500, 3))
    said = Rotation.from_euler("ZYX", angles[:, ::-1])
    npt.assert_allclose(
        quaternions.rotate_vectors(quaternions.from_angles(angles), vector), said.apply(vector), atol=1e-11
    )
    npt.assert_allclose(quaternions.from_matrix(theirs.as_matrix()), ours * np.sign(ours[:, :1]), atol=1e-12)
    npt.assert_allclose(
        quaternions.rotate_vectors(quaternions.product(ours, ours[::-1]), vector),
        (theirs * theirs[::-1]).apply(vector),
        atol=1e-11,
    )
    share = rng.uniform(0, 1, 499)
    between = quaternions.interpolate_attitudes(ours[:-1], ours[1:], share)
    wanted = Slerp(np.arange(500.0), theirs)(np.arange(499) + share)
    npt.assert_allclose(quaternions.rotate_vectors(between, vector[:499]), wanted.apply(vector[:499]), atol=1e-10)
