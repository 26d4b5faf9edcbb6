"""Makes the pictures of the page and of the report in README and docs: ``python -m docs.screenshots [NAME…]``.

``python -m docs.screenshots --states FOLDER [STATE…]`` makes one of each state, at each size and in both themes,
to be looked at after a change.

Each is taken of the real program in a real browser, from a simulated sensor of a stated seed played back, so that the
same pictures come out each time but for what a clock or a font changes. They go to ``docs/images``.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from benchmarks.stage import Program, Site, chromium

import flinders
from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Callable

    from playwright.sync_api import Browser, Page, ViewportSize

    from flinders.arrays import Floats

IMAGES: Final = Path(__file__).resolve().parent / "images"
NOTEBOOK: Final = "notebook-"
"""Start of the names of figures that a notebook shows."""
LARGEST: Final = 250_000
"""Largest size of a picture, bytes."""
DESK: Final[ViewportSize] = {"width": 1280, "height": 800}
PHONE: Final = {"width": 390, "height": 844}
WAIT_MS: Final = 30_000
SETTLED: Final = (
    "flinders.store.state.source.link === 'ended' && flinders.store.view !== null && flinders.store.points.count > 0 "
    "&& flinders.store.state.used + flinders.store.state.rejected + flinders.store.state.excluded_readings "
    "=== flinders.store.state.readings"
)

TURNED: Final = "flinders.store.state.seconds > 18 && flinders.store.view.guidance.direction"


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture: its readings, the settings of the browser, and the keys to press before.

    Attributes
    ----------
    name : str
        Name of the file.
    readings : str
        ``good`` or ``wrong``: see `log`; ``collecting`` is the simulated sensor while it is turned.
    scheme : str
    options : dict
        Of the browser.
    keys : tuple of str
        Keys to press once the page is complete.
    """

    name: str
    readings: str
    scheme: str = "dark"
    options: dict[str, Any] = field(default_factory=lambda: {"viewport": DESK})
    keys: tuple[str, ...] = ()


ON_PHONE: Final[dict[str, Any]] = {
    "viewport": PHONE, "device_scale_factor": 2, "is_mobile": True, "has_touch": True
}  # fmt: skip
SHOTS: Final = (
    Shot("live-collecting-dark", "collecting"),
    Shot("live-good-dark", "good"),
    Shot("live-good-light", "good", "light"),
    Shot("live-clouds-light", "good", "light", keys=("2",)),
    Shot("live-wrong-dark", "wrong"),
    Shot("live-finish-dark", "good", keys=("f",)),
    Shot("live-phone-dark", "collecting", options=ON_PHONE),
    Shot("live-phone-light", "good", "light", options=ON_PHONE),
)
REPORTS: Final = {
    "report-light": ("light", 1300), "report-dark": ("dark", 1300), "fleet-light": ("light", 1320),
    "drift-dark": ("dark", 1320), "watch-light": ("light", 1310), "watch-dark": ("dark", 1310),
}  # fmt: skip
"""Pictures of reports: colour scheme and height in pixels of each."""
STANDALONE: Final = ("page-start-light", "page-columns-light")
"""Pictures of the page that needs no program: its first view, and the choice of columns."""
STATION: Final = ("station-fail-dark", "station-fail-light", "station-testing-dark")
"""Pictures of the page of a station: while a unit is turned, and with one that fails."""
UNITS: Final = 300
"""Number of units of the fleet; a tenth of them has a fault."""


def log(readings: str, folder: Path) -> Path:
    """Write a table of 50 readings a second: a tumble, one in a field that changes, a sensor at rest, or no sensor."""
    tumble = simulate.tumble(seed=11, n=3000, noise=0.4).samples
    count = {"good": 3000, "wrong": 2200, "still": 800, "garbage": 2000}[readings]
    rows: Floats = np.column_stack([0.02 * np.arange(count), tumble.field[:count], _acceleration(tumble, count)])
    if readings == "wrong":
        rows[1400:, 1:4] += (14.0, -9.0, 6.0)  # somebody puts a phone down beside it
    rng = np.random.default_rng(1)
    if readings == "still":
        rows[:, 1:4] = rows[0, 1:4] + rng.normal(scale=0.4, size=(count, 3))
    if readings == "garbage":
        rows[:, 1:4] = rng.uniform(-500, 500, size=(count, 3))
    path = folder / f"{readings}.csv"
    header = "t_s,mx_uT,my_uT,mz_uT,ax_g,ay_g,az_g"
    np.savetxt(path, rows, fmt="%.4f", delimiter=",", header=header, comments="")
    return path


def _acceleration(tumble: Any, count: int) -> Floats:  # noqa: ANN401 - samples
    acceleration: Floats = tumble.acceleration[:count] / 9.80665
    return acceleration


def until(page: Page, expression: str) -> None:
    """Wait until an expression of the page is true."""
    for _ in range(WAIT_MS // 50):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise TimeoutError(f"{expression}: {page.evaluate('JSON.stringify(flinders.store.state)')}")


def shoot(browser: Browser, shot: Shot, folder: Path) -> Path:
    """Take a picture of the page."""
    place = folder / shot.name
    place.mkdir()
    is_live = shot.readings == "collecting"
    played = (
        ("--simulate", "--speed", "2") if is_live else ("--replay", str(log(shot.readings, place)), "--speed", "50")
    )
    with Program(place, *played) as program:
        options: dict[str, Any] = {"color_scheme": shot.scheme, **shot.options}
        context = browser.new_context(reduced_motion="reduce", **options)
        page = context.new_page()
        page.goto(program.address)
        until(page, f"Boolean(window.flinders?.store.hello) && {TURNED if is_live else SETTLED}")
        page.evaluate("document.querySelectorAll('#notices button').forEach(button => button.click())")
        for key in shot.keys:
            page.keyboard.press(key)
        if "f" in shot.keys:
            until(page, "document.querySelector('#preview').textContent.length > 20")
        page.wait_for_timeout(1500)  # until animations have ended
        path = _saved(page, shot.name)
        context.close()
    return path


@dataclass(frozen=True, slots=True)
class State:
    """A state of the page: its source of readings, the condition that it is reached, and the keys to press then."""

    readings: str = ""  # an argument of `log`
    ready: str = SETTLED
    keys: tuple[str, ...] = ()
    source: tuple[str, ...] = ("--udp", "48123")  # options of the source if there are no readings


STATES: Final = {
    "empty": State(ready="flinders.store.state.phase === 'waiting'"),
    "still": State("still", "flinders.store.state.readings > 400"),
    "collecting": State(ready="flinders.store.state.seconds > 6", source=("--simulate", "--speed", "0.5")),
    "button": State("wrong", f"{SETTLED} && document.querySelector('#remedies button') !== null"),
    "wrong": State("garbage", "flinders.store.state.phase === 'wrong'"),
    "good": State("good"),
    "finish": State("good", keys=("f",)),
    "finished": State("good", keys=("f", "Escape")),
}
SIZES: Final[dict[str, dict[str, Any]]] = {
    "1440": {"viewport": {"width": 1440, "height": 900}},
    "1280": {"viewport": {"width": 1280, "height": 720}},
    "phone": ON_PHONE,
    "sideways": {**ON_PHONE, "viewport": {"width": 844, "height": 390}},
    "zoomed": {"viewport": {"width": 640, "height": 360}, "device_scale_factor": 2},
}


def states(browser: Browser, out: Path, names: list[str]) -> None:
    """Take each state at each size, in both themes."""
    out.mkdir(parents=True, exist_ok=True)
    for name in names or STATES:
        state = STATES[name]
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            replay = ("--replay", str(log(state.readings, place)), "--speed", "50") if state.readings else state.source
            with Program(place, *replay) as program:
                for size, scheme in product(SIZES, ("dark", "light")):
                    _take(browser, program, state, out / f"{name}-{size}-{scheme}.png", (SIZES[size], scheme))
        print(out / f"{name}-*.png", flush=True)


def _take(browser: Browser, program: Program, state: State, path: Path, how: tuple[dict[str, Any], str]) -> None:
    options: dict[str, Any] = {"color_scheme": how[1], **how[0]}
    context = browser.new_context(reduced_motion="reduce", **options)
    page = context.new_page()
    page.goto(program.address)
    until(page, f"Boolean(window.flinders?.store.hello) && {state.ready}")
    for key in state.keys:
        page.keyboard.press(key)
    page.wait_for_timeout(1500)
    page.screenshot(path=path)
    context.close()


def station(browser: Browser, name: str, folder: Path) -> Path:
    """Take a picture of the page of a station."""
    place = folder / name
    place.mkdir()
    (place / "line.toml").write_text("[limits]\noffset = [-60, 60]\n", encoding="utf-8")
    is_testing, scheme = "testing" in name, name.rpartition("-")[2]
    asked = ("line.toml", "--simulate", "--speed", "2" if is_testing else "30", "--operator", "Ada", "--name", "3")
    with Program(place, *asked, command="station") as program:
        options: dict[str, Any] = {"color_scheme": scheme, "viewport": DESK}
        context = browser.new_context(reduced_motion="reduce", **options)
        page = context.new_page()
        page.goto(program.address)
        until(page, "Boolean(window.flinders?.station())")
        page.keyboard.type("K000017")
        page.keyboard.press("Enter")
        until(page, f"flinders.station().phase === '{'testing' if is_testing else 'result'}'")
        page.wait_for_timeout(4000 if is_testing else 500)
        path = _saved(page, name)
        context.close()
    return path


def standalone(browser: Browser, name: str, folder: Path) -> Path:
    """Take a picture of the page without a program: at its start, or when it asks for the columns of a log."""
    from flinders.apps.live.standalone import package

    package.write(folder / name)
    with Site(folder / name) as site:
        context = browser.new_context(color_scheme="light", viewport=DESK, service_workers="block")
        page = context.new_page()
        page.goto(site.address)
        until(page, "Boolean(window.flinders?.store.hello) && !document.querySelector('#start').hidden")
        if name == "page-columns-light":
            page.locator("#log-file").set_input_files({"name": "log.csv", "mimeType": "", "buffer": _six().encode()})
            page.locator("#columns-x").select_option("3")
        path = _saved(page, name)
        context.close()
    return path


def _six() -> str:
    """Six columns without names: acceleration, then the magnetometer."""
    tumble = simulate.tumble(seed=11, n=200).samples
    rows = np.column_stack([_acceleration(tumble, 200), tumble.field])
    return "\n".join(",".join(f"{value:.2f}" for value in row) for row in rows)


def report(browser: Browser, name: str, folder: Path) -> Path:
    """Take a picture of a report."""
    place = folder / name
    place.mkdir()
    path = place / "report.html"
    kind = name.partition("-")[0]
    words = {"report": _calibrate, "fleet": _fleet, "drift": _drift, "watch": _watch}[kind](place)
    option = "--page" if kind == "watch" else "--report"
    subprocess.run([sys.executable, "-m", "flinders", *words, option, str(path)], check=False, capture_output=True)
    scheme, height = REPORTS[name]
    options: dict[str, Any] = {"color_scheme": scheme, "viewport": {"width": 1100, "height": height}}
    context = browser.new_context(reduced_motion="reduce", **options)
    page = context.new_page()
    page.goto(path.as_uri())
    page.wait_for_timeout(2500)
    found = _saved(page, name)
    context.close()
    return found


def _calibrate(folder: Path) -> list[str]:
    return ["calibrate", str(log("good", folder))]


def _fleet(folder: Path) -> list[str]:
    """Simulate three batches of hardware, one of them with many faulty units; return the command's arguments."""
    import pyarrow
    from pyarrow import parquet

    from flinders.apps.fleet.simulate import unit

    made = [unit(place, bad=0.3 if place % 3 == 2 else 0.03).samples for place in range(UNITS)]
    rows = np.repeat(np.arange(UNITS), [len(each) for each in made])
    readings: Floats = np.concatenate([each.field for each in made])
    table = {
        "unit": [f"SN{place:04d}" for place in rows.tolist()],
        "batch": [f"rev {'ABC'[place % 3]}" for place in rows.tolist()],
        **{f"mag_{axis}_uT": readings[:, column] for column, axis in enumerate("xyz")},
    }
    parquet.write_table(pyarrow.table(table), folder / "line.parquet")
    return ["fleet", str(folder / "line.parquet"), "--output", str(folder / "calibrations.parquet")]


def _drift(folder: Path) -> list[str]:
    """Simulate a fleet over two years in which batteries are moved; return the command's arguments."""
    from benchmarks.drift import Fleet, simulated
    from pyarrow import parquet

    rows, _ = simulated(Fleet(units=UNITS, step_deg=3.0), np.random.default_rng(4))
    parquet.write_table(rows.to_arrow(), folder / "calibrations.parquet")
    return ["drift", str(folder / "calibrations.parquet")]


def _watch(folder: Path) -> list[str]:
    """Simulate a week of a boat; return the command's arguments for online calibration."""
    week = str(folder / "week.csv")
    subprocess.run([sys.executable, "-m", "flinders", "simulate", "boat", "-o", week], check=True, capture_output=True)
    return ["watch", "--replay", week]


def notebook(kind: str) -> Path:
    """Save a figure that a notebook shows, light and dark in one file."""
    path = IMAGES / f"{NOTEBOOK}{kind}.svg"
    flinders.fit(simulate.tumble(seed=1).samples).plot(kind).save(path, force=True)
    return path


def _saved(page: Page, name: str) -> Path:
    """Save a picture of the page, in fewer colours if it would be larger than `LARGEST`.

    Raises
    ------
    ValueError
        If the picture is too large even so.
    """
    from PIL import Image

    IMAGES.mkdir(exist_ok=True)
    path = IMAGES / f"{name}.png"
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        fewer = picture.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=4, dither=Image.Dither.NONE)
        fewer.save(path, optimize=True)  # other methods change the colours of what is small, such as the legend
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size:,} bytes: need at most {LARGEST:,}")
    return path


def main() -> None:
    """Take the named pictures, or all."""
    asked = sys.argv[1:]
    if asked[:1] == ["--states"]:
        with chromium() as browser:
            states(browser, Path(asked[1]), asked[2:])
        return
    figures = {f"{NOTEBOOK}{kind}": kind for kind in ("sphere", "strength")}
    pages: dict[str, Callable[[Browser, Path], Path]] = {shot.name: partial(_shot, shot) for shot in SHOTS}
    for made, group in ((report, REPORTS), (standalone, STANDALONE), (station, STATION)):
        pages |= {name: partial(_named, made, name) for name in group}
    names = [*pages, *figures]
    unknown = [name for name in asked if name not in names]
    if unknown:
        sys.exit(f"there is no picture {', '.join(unknown)}: there are {', '.join(names)}")
    wanted = asked or names
    for name in figures.keys() & set(wanted):
        _tell(notebook(figures[name]))
    if not pages.keys() & set(wanted):
        return
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        for name in wanted:
            if name in pages:
                _tell(pages[name](browser, Path(folder)))


def _shot(shot: Shot, browser: Browser, folder: Path) -> Path:
    return shoot(browser, shot, folder)


def _named(made: Callable[[Browser, str, Path], Path], name: str, browser: Browser, folder: Path) -> Path:
    return made(browser, name, folder)


def _tell(path: Path) -> None:
    print(f"{path.relative_to(IMAGES.parent.parent)}  {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
