"""A calibration that keeps itself ages, weighs and claims as formulas in NumPy say, to a billionth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests import numpy_online as oracle
from tests.worlds import walked_days

from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import level_error
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.native.layouts import Records

AGREED = 1e-9
STEP = np.array([3.0, -4.0, 2.0])


def lived(*, disturbed: bool = False) -> Records:
    """A record of some hours, of which evidence is left; or of one that something contradicts."""
    time, field, begins, _ = walked_days(1, days=0.4, walk=0.3)
    record, row = engine().make_online(), 0
    engine().online_expect_walk(record, 0.2, 0.5)
    last = len(time)
    if disturbed:
        field[time >= begins[-1]] += STEP
        last = int(np.searchsorted(time, begins[-1] + 8.0))
    while row < last:
        row += engine().online_add(record, field[row:last], time[row:last])[0]
    return record


def without_reading(record: Records) -> float:
    """Let the body stand still for some seconds, so that no reading waits to be kept; the time then."""
    now = float(record["now"])
    engine().online_add(record, record["last"][np.newaxis], np.array([now + 3.0]))
    assert record["averaged"] == 0
    return now + 3.0


def alone(record: Records) -> tuple[np.ndarray, np.ndarray]:
    """The offset that the evidence shows alone, and its covariance, by a fit and the formula for few readings."""
    kept, size = int(record["kept"]), oracle.radius(record["known"])
    expected = np.concatenate([record["known"][:3], record["latest"][3:]])
    free = record["latest_covariance"].reshape(9, 9).copy()
    free[3:, 3:] += record["place"] ** 2 * np.outer(expected[3:], expected[3:])
    free[:3], free[:, :3] = 0.0, 0.0
    free[:3, :3] = (oracle.constant("OPEN_OFFSET_SIGMA") * size) ** 2 * np.eye(3)
    prior = np.linalg.inv(free)
    field = record["field"].reshape(-1, 3)[:kept]
    known: dict[str, Any] = {"is_informed": 1, "expected": expected, "information": prior.ravel()}
    options = {"dip_deg": float(record["dip_deg"]), "statistics": 0, "rests": 0, "level": 0}
    found = engine().fit(field, time=record["time"][:kept], **options, **known)
    few = engine().widening_by_few(float(found["used"]) - 9.0)
    factor = max(few * max(float(record["noise"] / found["noise"]), 1.0) ** 2, 1.0)
    inverse = np.linalg.inv(found["covariance"].reshape(9, 9))
    covariance = np.linalg.inv(prior + (inverse - prior) / factor)
    at = expected + covariance @ inverse @ (np.concatenate([found["centre"], found["shape"]]) - expected) / factor
    return at[:3], covariance[:3, :3]


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """Equal to a billionth of the largest."""
    npt.assert_allclose(found, expected, rtol=0.0, atol=AGREED * float(np.abs(expected).max()))


def test_a_block_that_ends_is_weighed_and_kept_open() -> None:
    record = lived()
    now = without_reading(record)
    before = record.copy()
    assert before["kept"] > 48
    assert before["latest_at"] > before["known_at"]
    engine().online_add(record, before["last"][np.newaxis], np.array([now + 300.0]))
    assert record["kept"] == 0
    offset, covariance = alone(before)
    seconds = float(before["latest_at"] - before["known_at"])
    known = before["known_covariance"].reshape(9, 9)
    rates = oracle.weighed_rates(before, offset - before["known"][:3], covariance + known[:3, :3], seconds)
    close(record["rates"], rates)
    weighed = before.copy()
    weighed["rates"] = record["rates"]
    prior = oracle.aged(weighed, before["known"], seconds, known)
    latest = before["latest_covariance"].reshape(9, 9)
    expected = oracle.kept_open(prior, oracle.constant("PLACE_VARIANCE_SHARE"), latest)
    expected[:3, :3] += oracle.unseen_moves(weighed, 300.0) * np.eye(3)
    close(record["known_covariance"].reshape(9, 9), expected)
    npt.assert_array_equal(record["known"], before["latest"])


@pytest.mark.parametrize("disturbed", [False, True])
def test_what_is_claimed_at_a_time_follows_from_the_record(*, disturbed: bool) -> None:
    record = lived(disturbed=disturbed)
    assert (record["state"] == 2) == disturbed
    record["moved"], record["moved_at"] = STEP, record["now"] - 200.0
    record["moves"], record["moves_square"] = 2.0, 50.0
    for seconds in (0.0, 59.0, 3600.0, 1e6):
        time = float(record["now"]) + seconds
        claim, expected = engine().online_claim(record, time), oracle.claimed(record, time)
        close(claim["covariance"].reshape(9, 9), expected)
        error = level_error(Ellipsoid.of_parameters(record["in_force"].copy()), expected, dip_deg=60.0)
        assert claim["worst_deg"] == pytest.approx(error.worst, rel=AGREED)
        assert claim["walk"] == pytest.approx(
            np.sqrt(record["rates"] @ oracle.rates() ** 2) * oracle.radius(record["latest"]), rel=AGREED
        )


@pytest.mark.parametrize(("walk", "log_sigma"), [(0.01, 0.1), (0.2, 0.7), (5.0, 0.3)])
def test_a_walk_that_is_known_makes_rates_probable(walk: float, log_sigma: float) -> None:
    record = engine().make_online()
    engine().online_expect_walk(record, walk, log_sigma)
    engine().online_activate(record, [1, 2, 3, 49, 50, 51, 0, 0, 0], np.eye(9), noise=0.3, time=0.0)
    close(record["probable_rates"], oracle.expected_rates(50.0, walk, log_sigma))
    npt.assert_array_equal(record["rates"], record["probable_rates"])
    for wrong in ((0.0, 1.0), (1.0, 0.0), (np.nan, 1.0), (np.inf, 1.0)):
        with pytest.raises(ValueError, match="option"):
            engine().online_expect_walk(record, *wrong)
