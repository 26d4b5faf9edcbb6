"""A swing from the log of a boat: legs in a current, turns with a lag; NMEA 0183, NMEA 2000, Signal K."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.boats import DECLINATION, TRUTH, Boat, circles, nmea0183_of, nmea2000_of, octagon, signalk_of
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders.apps.marine import nmea0183, nmea2000, signalk
from flinders.apps.marine.compass_log import read_compass_log
from flinders.apps.marine.deviation import Deviation, fit
from flinders.apps.marine.legs import LoggedSwing, legs, turn_readings
from flinders.errors import FitError, NoMagnetometer, UnreadableInput
from flinders.geometry.angles import wrap_180

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats


def curve_of(swing: LoggedSwing) -> Deviation:
    """As the command fits it."""
    return fit(swing.compass_deg, swing.deviation_deg, sigma_deg=swing.sigma_deg).widen(swing.common_covariance)


def scores(curve: Deviation) -> Floats:
    """What each coefficient is off by, in its own standard deviations."""
    assert curve.sigmas_deg is not None
    off: Floats = (curve.coefficients_deg - TRUTH) / curve.sigmas_deg
    return off


def test_courses_in_a_current_give_the_deviation_as_claimed(trials: Choose) -> None:
    """Current of 0.5 m/s to any side at 3 m/s, leeway of 1°: each coefficient is off as claimed."""
    claim, found = trials(200, 20), []
    for seed in claim.seeds:
        rng = np.random.default_rng(seed)
        current, leeway = (complex(*rng.normal(0.0, size, 2)) for size in (0.35, 1.0))
        boat = Boat.sail(octagon(), rng, current=current, leeway=leeway)
        swing = legs(boat.time, boat.compass, boat.course, boat.speed, is_course=True)
        assert len(swing.compass_deg) >= 6  # on one or two the current is too strong
        found.append(scores(curve_of(swing)))
    rms = np.sqrt(np.mean(np.square(found)))
    assert 1.0 - 0.3 * claim.widening < rms < 1.0 + 0.3 * claim.widening


def test_headings_of_a_second_instrument_give_the_deviation_as_claimed(trials: Choose) -> None:
    claim, found = trials(200, 20), []
    for seed in claim.seeds:
        rng = np.random.default_rng(seed)
        boat = Boat.sail(octagon(), rng)
        swing = legs(boat.time, boat.compass, boat.heading, boat.speed, is_course=False)
        found.append(scores(curve_of(swing)))
    rms = np.sqrt(np.mean(np.square(found)))
    assert 1.0 - 0.3 * claim.widening < rms < 1.0 + 0.3 * claim.widening


@pytest.mark.parametrize("is_both", [True, False])
def test_turns_with_a_lag_give_the_deviation_as_claimed(is_both: bool, trials: Choose) -> None:
    """Turned both ways the lag comes out; turned one way it is an uncertainty of A, of rate times a second."""
    claim, found, sigmas = trials(200, 20), [], []
    for seed in claim.seeds:
        rng = np.random.default_rng(seed)
        boat = Boat.sail(circles(is_both=is_both), rng, step=0.5, lag=float(abs(rng.normal(0.0, 1.0))))
        curve = curve_of(turn_readings(boat.time, boat.compass, boat.heading))
        found.append(scores(curve))
        assert curve.sigmas_deg is not None
        sigmas.append(curve.sigmas_deg[0])
    rms = np.sqrt(np.mean(np.square(found)))
    assert 1.0 - 0.4 * claim.widening < rms < 1.0 + 0.3 * claim.widening
    assert np.mean(sigmas) == pytest.approx(0.02 if is_both else 1.5, rel=0.5)


def test_a_current_that_is_left_in_would_be_taken_for_iron() -> None:
    rng = np.random.default_rng(3)
    boat = Boat.sail(octagon(), rng, current=0.5 + 0.3j)
    swing = legs(boat.time, boat.compass, boat.course, boat.speed, is_course=True)
    assert swing.current is not None
    assert abs(swing.current - (0.5 + 0.3j)) < 0.1
    raw = legs(boat.time, boat.compass, boat.course, boat.speed, is_course=False)
    assert np.abs(fit(raw.compass_deg, raw.deviation_deg).coefficients_deg - TRUTH)[1:3].max() > 5.0


def test_few_or_slow_legs_are_refused() -> None:
    boat = Boat.sail(octagon(), np.random.default_rng(4))
    with assert_raises(FitError, found=4, needed=5):
        legs(boat.time[:300], boat.compass[:300], boat.course[:300], boat.speed[:300], is_course=True)
    with assert_raises(FitError, found=0, needed=5):
        legs(boat.time, boat.compass, boat.course, boat.speed, is_course=True, slowest=9.0)
    with assert_raises(FitError, found=3, needed=5):
        turn_readings(boat.time[:10], boat.compass[:10], boat.heading[:10])


# files


FORMATS = {
    "NMEA 0183": nmea0183_of,
    "NMEA 0183, stamped": lambda boat: nmea0183_of(boat, is_stamped=True),
    "candump -l": nmea2000_of,
    "candump": lambda boat: nmea2000_of(boat, is_log=False),
    "Signal K": signalk_of,
}


@pytest.fixture(scope="module")
def boat() -> Boat:
    return Boat.sail(octagon(40), np.random.default_rng(11), current=0.4 - 0.2j)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("reference", daily(["heading", "course"]))
def test_every_format_gives_the_same_curve(
    name: str, reference: str, boat: Boat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("boat.log").write_text("\r\n".join(FORMATS[name](boat)), encoding="utf-8")
    ended = flinders_("swing", "boat.log", "--reference", reference, "--json", "--target", "5")
    assert ended.code == 0, ended.err
    told = ended.json["deviation"]
    off = np.array(list(told["coefficients_deg"].values())) - TRUTH
    assert (np.abs(off) < 4.0 * np.array(list(told["sigma_deg"].values())) + 0.1).all()
    assert len(ended.json["logged"]["compass_deg"]) == 8
    assert (ended.json["logged"]["current_m_s"] is None) == (reference == "heading")
    assert ended.json["site"]["declination_deg"] == pytest.approx(DECLINATION, abs=0.01)


def test_the_page_of_a_boat_says_what_was_taken_out(
    boat: Boat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("boat.nmea").write_text("\n".join(nmea0183_of(boat)), encoding="utf-8")
    ended = flinders_("swing", "boat.nmea", "--reference", "course", "--standard", "solas", "--limit", "8")
    said = " ".join(ended.out.split())
    assert_sentences(said, about="current of 0.4")
    assert_sentences(said, about="0 ± 1°")
    assert "WITHIN" in said
    assert_sentences(ended.err)
    turned = Boat.sail(circles(), np.random.default_rng(1), step=0.5, lag=0.7)
    Path("turn.nmea").write_text("\n".join(nmea0183_of(turned)), encoding="utf-8")
    assert "the compass lags by 0." in flinders_("swing", "turn.nmea", "--target", "2").out


def test_a_true_heading_that_was_calculated_from_the_compass_is_no_reference(boat: Boat, tmp_path: Path) -> None:
    copied = Boat(boat.time, boat.compass, boat.compass, boat.course, boat.speed)
    path = tmp_path / "boat.nmea"
    path.write_text("\n".join(nmea0183_of(copied)), encoding="utf-8")
    assert read_compass_log(path).is_course
    assert not read_compass_log(path, "heading").is_course


def test_a_frame_of_canboat_is_read_as_there() -> None:
    """The first heading of canboat's samples/candumpSample3.txt, and its rapid course and position."""
    lines = [
        "(1502984866.421964) slcan0 09F112CC#FF725AFF7FFF7FFD",
        "(1502984866.473256) slcan0 09F8022B#FF00000001000000",
        "(1502984866.429139) slcan0 09F8012B#F12B6B1B8E5E36FF",
    ]
    found = [(message.kind, round(message.value, 4)) for message in nmea2000.messages(lines)]
    assert found == [
        ("compass", 132.6626), ("course", 0.0), ("speed", 0.01), ("latitude", 46.0008), ("longitude", -1.3214),
    ]  # fmt: skip


def test_a_card_is_written_as_sentences_that_are_read(
    boat: Boat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("boat.nmea").write_text("\n".join(nmea0183_of(boat)), encoding="utf-8")
    flinders_("swing", "boat.nmea", "--hdg", "card.nmea", "--step", "30")
    lines = Path("card.nmea").read_text(encoding="utf-8").splitlines()
    clocks = ["$GPGGA,100000,,,,", *lines, "$GPGGA,100100,,,,"]
    assert [message.value for message in nmea0183.messages(clocks)] == [30.0 * place for place in range(12)]
    assert lines[0].split(",")[4:5] == [f"{DECLINATION:.1f}"]


def test_what_is_not_sound_is_left_out() -> None:
    wrong = "$HCHDG,98.3,0.0,E,12.6,W*00"
    void = "$GPRMC,100001,V,,,,,10.0,84.4,010626,,"
    clocks = ["$GPGGA,235959,4730.0,N,00918.0,E", "$HCHDM,10,M", "$GPGGA,000001,4730.0,N,00918.0,E"]
    assert [message.kind for message in nmea0183.messages([clocks[0], wrong, void, clocks[2]])].count("compass") == 0
    times = [message.time for message in nmea0183.messages(clocks)]
    assert times[-1] - times[0] == pytest.approx(2.0)
    assert not list(signalk.messages(["no", "[1]", '{"updates": 3}', '{"updates":[{"timestamp":"x","values":[]}]}']))
    none = "(1.0) can0 09F112CC#FFFFFFFF7FFF7FFD"
    assert not list(nmea2000.messages([none]))


@pytest.mark.parametrize("name", FORMATS)
def test_a_broken_log_is_read_or_refused(name: str, boat: Boat, tmp_path: Path) -> None:
    """Characters exchanged, lines cut and doubled: nothing but a curve or a refusal comes of it."""
    rng, path = np.random.default_rng(9), tmp_path / "boat.log"
    lines = list(FORMATS[name](boat))[:300]
    letters = list('0123456789.,;*$#AEFNSWX[]{}"-')
    for _ in range(12):
        text = list("\n".join(lines[place] for place in sorted(rng.integers(0, len(lines), 200))))
        for place in rng.integers(0, len(text), 400):
            text[place] = str(rng.choice(letters))
        path.write_text("".join(text), encoding="utf-8")
        try:
            log = read_compass_log(path)
        except UnreadableInput:
            continue
        assert np.isfinite(log.compass_deg).all()


UNFIT = {
    "headings alone": "$HCHDM,10,M\n$HCHDM,11,M\n",
    "frames without a clock": "can0  09F112CC   [8]  FF 72 5A FF 7F FF 7F FD\n" * 9,
    "a compass alone": "".join(f"(1{n}.0) can0 09F112CC#FF725AFF7FFF7FFD\n" for n in range(10)),
    "no compass": "".join(f"(1{n}.0) can0 09F8022B#FFFC000001000000\n" for n in range(10)),
    "a table": "compass,magnetic\n1,2\n",
}  # fmt: skip


@pytest.mark.parametrize("name", UNFIT)
def test_logs_without_what_is_needed_say_so(name: str, tmp_path: Path) -> None:
    text = UNFIT[name]
    path = tmp_path / "boat.log"
    path.write_text(text, encoding="utf-8")
    with assert_raises(UnreadableInput):
        read_compass_log(path)


def test_options_that_do_not_go_with_a_boat_are_refused(
    boat: Boat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("boat.log").write_text("\n".join(nmea2000_of(boat)), encoding="utf-8")
    Path("swing.csv").write_text("compass,deviation\n0,1\n90,1\n", encoding="utf-8")
    assert_sentences(flinders_("swing", "boat.log", "--level").said)
    assert_sentences(flinders_("swing", "swing.csv", "--crab", "2").said)
    named = Path("boat.log").read_text(encoding="utf-8").replace("09F80123", "09F80F23")
    Path("nowhere.log").write_text(named, encoding="utf-8")
    assert_sentences(flinders_("swing", "nowhere.log").said)


def test_folded_courses_cross_north_without_a_jump() -> None:
    rng = np.random.default_rng(5)
    boat = Boat.sail(octagon() - 3.0, rng)
    swing = legs(boat.time, boat.compass, boat.course, boat.speed, is_course=True)
    npt.assert_array_less(np.abs(wrap_180(swing.deviation_deg)), 12.0)


def test_a_log_without_readings_is_named_where_readings_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "boat.nmea"
    path.write_text("$IIHDM,10.0,M*13\n$IIVTG,12.0,T,13.0,M,4.6,N,9.4,K,A*3A\n" * 5, encoding="utf-8")
    with assert_raises(NoMagnetometer):
        flinders.read(path)
