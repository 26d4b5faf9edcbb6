"""Clocks of readings that come for months: one time, which never goes back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as some
from tests.sentences import assert_sentences
from tests.trials import examples

from flinders.apps.service.clocks import MAX_CLOCK_DIFFERENCE_S, MachineClock, RecordedClock


class Machine:
    """A machine whose clocks are set by hand."""

    def __init__(self) -> None:
        self.wall, self.steady = 1.7e9, 100.0

    def clock(self, since: float | None = None) -> MachineClock:
        return MachineClock(since, wall=lambda: self.wall, steady=lambda: self.steady)

    def wait(self, seconds: float) -> None:
        self.wall += seconds
        self.steady += seconds


def test_steps_are_those_of_the_sensor() -> None:
    machine = Machine()
    clock = machine.clock()
    first = clock.of(np.array([5.0, 5.02, 5.04]))
    machine.wait(0.9)
    second = clock.of(np.array([5.06, 5.08]))
    np.testing.assert_allclose(np.diff([*first, *second]), 0.02, atol=1e-6)
    assert clock.remarks() == []


def test_a_board_that_starts_again_goes_on_by_this_machine() -> None:
    machine = Machine()
    clock = machine.clock()
    clock.of(np.array([1000.0]))
    machine.wait(60.0)
    np.testing.assert_allclose(clock.of(np.array([0.1, 0.2])), [1.7e9 + 59.9, 1.7e9 + 60.0])


def test_a_machine_that_is_set_back_is_not_followed_and_one_that_is_set_forward_is() -> None:
    machine = Machine()
    clock = machine.clock()
    machine.wall -= 3600.0
    assert clock.now == 1.7e9
    assert clock.now == 1.7e9
    assert_sentences(clock.remarks())
    machine.wall += 7200.0
    assert clock.now == 1.7e9 + 3600.0
    assert_sentences(clock.remarks())


def test_a_machine_without_a_battery_goes_on_from_the_state() -> None:
    machine = Machine()
    clock = machine.clock(since=1.7e9 + 86400.0)
    assert_sentences(clock.remarks())
    assert clock.now == 1.7e9 + 86400.0
    machine.wall += 172800.0
    assert clock.now == 1.7e9 + 172800.0


@given(
    some.lists(
        some.tuples(some.floats(-1e6, 1e6), some.floats(0.0, 100.0), some.floats(-1e5, 1e5)), min_size=1, max_size=30
    )
)
@examples(100)
def test_the_time_of_a_machine_never_goes_back(steps: list[tuple[float, float, float]]) -> None:
    machine = Machine()
    clock, last = machine.clock(), -np.inf
    for own, waited, set_by in steps:
        machine.wait(waited)
        machine.wall += set_by
        times = clock.of(own + np.array([0.0, 0.02, -0.5, 0.1]))
        assert times[0] >= last
        assert (np.diff(times) >= 0.0).all()
        assert times[-1] <= clock.now + MAX_CLOCK_DIFFERENCE_S
        last = times[-1]


def test_recorded_times_stay_unless_their_clock_was_reset() -> None:
    clock = RecordedClock()
    np.testing.assert_allclose(clock.of(np.array([10.0, 10.5, 10.4])), [10.0, 10.5, 10.4])  # one came late
    np.testing.assert_allclose(clock.of(np.array([0.0, 0.5, 500.0])), [10.4, 10.9, 510.4])
    assert len(clock.remarks()) == 1
    assert clock.remarks() == []


def test_a_state_is_gone_on_with_by_times_without_a_date_only() -> None:
    assert RecordedClock(since=1.7e9).of(np.array([0.0, 1.0])).tolist() == [1.7e9, 1.7e9 + 1.0]
    assert RecordedClock(since=1.7e9).of(np.array([1.6e9])).tolist() == [1.6e9]
