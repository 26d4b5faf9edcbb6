"""The method that made the references of real recordings gives their digits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.readers.test_real_recordings import REFERENCES

import flinders
from flinders.apps.classic.recipes.li import Li
from flinders.estimators import Readings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.mark.parametrize("name", sorted(REFERENCES))
def test_the_method_of_the_reference_gives_its_digits(name: str, recordings: Callable[[str], Path]) -> None:
    offset, _, allowed = REFERENCES[name]
    found = Li(k=4.0).estimate(Readings.of(flinders.read(recordings(name)))).ellipsoid
    assert float(np.linalg.norm(found.centre - offset)) / found.radius < allowed
