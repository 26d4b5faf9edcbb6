"""The gate for foreign arrays: what it lets through, and what it says of the rest."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from tests.sentences import assert_raises

from flinders import Samples
from flinders.arrays import check_vectors
from flinders.errors import ArrayError

pandas = pytest.importorskip("pandas")

ROWS = np.arange(12.0).reshape(4, 3)


def with_entry(entry: object) -> Any:  # noqa: ANN401 - an array of objects
    array = ROWS.astype(object)
    array[1, 2] = entry
    return array


@pytest.mark.parametrize(
    "values",
    [
        ROWS.T,
        ROWS.ravel(),
        ROWS[:, :2],
        [[1, 2, 3], [1, 2]],
        ROWS.astype(str),
        with_entry("12.5"),
        with_entry(None),
        with_entry(Decimal("1.5")),
        with_entry(2**70),
        pandas.Series(list(ROWS)),
        [{"mx": 1.0}] * 4,
        ROWS.astype(complex),
        ROWS.astype("datetime64[s]"),
    ],
)
def test_what_is_no_array_of_triples_is_told_with_the_way_out(values: Any) -> None:  # noqa: ANN401
    with assert_raises(ArrayError):
        check_vectors(values)


def test_masked_values_and_nan_are_left_out_and_counted_as_rows() -> None:
    masked = np.ma.masked_array(ROWS, mask=ROWS == 5.0)
    samples = Samples.of(masked)
    assert len(samples) == 3
    assert [(entry.rows, entry.lines) for entry in samples.skipped] == [(1, (2,))]
    with assert_raises(ArrayError):
        check_vectors(masked)


def test_integers_of_any_width_and_booleans_are_numbers() -> None:
    for kind in (np.int8, np.uint64, bool, np.float32):
        assert check_vectors(ROWS.astype(kind)).dtype == np.float64
