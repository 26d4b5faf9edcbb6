"""The page without a server in a real browser: bytes on the wire, first paint, memory, and duration of a fit.

    python -m benchmarks.page [--minutes 10] [--speed 20]

*wire*: files that a first visit needs, compressed by gzip; the 3-D view loads later, and is counted separately.
*paint*: first contentful paint of five visits by a browser without a cache, from a web server on this machine.
*worker*: time from 3,000 readings to fit, verdict and view, thirty times, while the sensor is paused; for the fit alone
see ``python -m benchmarks.page_verdict``.
*memory*: some minutes of 50 readings a second from the simulated sensor, at a multiple of real time; heap of the page
after garbage collection, after a tenth of the time and at the end.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

from benchmarks.stage import Site, chromium
from flinders.apps.live.standalone import package

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WIRE_LIMIT: Final = 250_000
PAINT_LIMIT_MS: Final = 1000.0
WORKER_LIMIT_MS: Final = 100.0
GROWTH_LIMIT_MB: Final = 5.0
RATE_HZ: Final = 50.0
VISITS: Final = 5
FITS: Final = 30
READINGS: Final = 3000
STARTING_MS: Final = 60_000
PAINT: Final = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
FIT: Final = """async (count) => {
    const { session, fitter } = flinders.connection;
    const task = session.task(Infinity);
    const first = ({ field, time, numbers }) => ({
        field: field.slice(0, 3 * count), time: time.slice(0, count), numbers: numbers.slice(0, count),
    });
    const part = { ...task, ...first(task) };
    const took = [];
    for (let turn = 0; turn < FITS; turn++) took.push((await fitter.fit(part)).seconds);
    return took;
}""".replace("FITS", str(FITS))


def wire() -> dict[str, int]:
    """Compressed bytes of each file of a first visit, and of the 3-D view."""
    return {name: len(gzip.compress(content)) for name, content in package.contents().items() if "LICENSE" not in name}


def paint_ms(browser: Browser, site: Site) -> float:
    """First contentful paint of a visit with an empty cache, ms."""
    context = browser.new_context(service_workers="block")
    page = context.new_page()
    page.goto(site.address)
    until(page, PAINT)
    painted = float(page.evaluate(PAINT))
    context.close()
    return painted


def until(page: Page, expression: str) -> None:
    """Wait until an expression of the page is true."""
    for _ in range(STARTING_MS // 50):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise TimeoutError(f"still false: {expression}")


def heap_mb(page: Page) -> float:
    """Heap of the page after garbage collection, with its buffers, MB."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    usage = session.send("Runtime.getHeapUsage")
    session.detach()
    return float((usage["usedSize"] + usage.get("backingStorageSize", 0)) / 1e6)


def simulated(browser: Browser, site: Site, speed: float) -> Page:
    """Open a page that plays the simulated sensor at a multiple of real time."""
    page = browser.new_context(service_workers="block", viewport={"width": 1280, "height": 800}).new_page()
    page.goto(f"{site.address}?speed={speed:g}")
    until(page, "window.flinders?.store.hello")
    page.locator("#use-simulation").click()
    return page


def main() -> None:
    """Measure, print, and compare with the limits."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--minutes", type=float, default=10.0)
    arguments.add_argument("--speed", type=float, default=20.0)
    given = arguments.parse_args()
    sizes = wire()
    scene = sizes.pop(package.SCENE, 0)
    for name, size in sorted(sizes.items(), key=lambda each: -each[1]):
        print(f"  {name:<28}{size:>9,} bytes")
    report("wire, without 3-D", sum(sizes.values()), WIRE_LIMIT, "bytes")
    print(f"  {'wire, 3-D':<28}{scene:>9,} bytes")
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        package.write(folder)
        with Site(Path(folder)) as site:
            paints = [paint_ms(browser, site) for _ in range(VISITS)]
            report(f"first paint, {min(paints):.0f} to {max(paints):.0f}", median(paints), PAINT_LIMIT_MS, "ms")
            measure(simulated(browser, site, given.speed), 60.0 * RATE_HZ * given.minutes)


def measure(page: Page, readings: float) -> None:
    """Measure fits and memory of a page with a running sensor."""
    until(page, f"flinders.store.state.readings > {READINGS}")
    page.locator("#pause").click()
    until(page, "!flinders.connection.session.isFitting")
    took = [1000.0 * each for each in page.evaluate(FIT, READINGS)]
    words = f"worker: {READINGS:,} readings, {min(took):.1f} to {max(took):.1f}"
    report(words, median(took), WORKER_LIMIT_MS, "ms")
    page.locator("#pause").click()
    until(page, f"flinders.store.state.readings > {max(0.1 * readings, READINGS)}")
    begun = heap_mb(page)
    until(page, f"flinders.store.state.readings >= {readings}")
    page.locator("#pause").click()
    ended = heap_mb(page)
    state = page.evaluate("flinders.store.state")
    words = f"{state['readings']:,} readings, {state['phase']}: heap {begun:.1f} to {ended:.1f} MB, growth"
    report(words, ended - begun, GROWTH_LIMIT_MB, "MB")


def report(what: str, value: float, limit: float, unit: str) -> None:
    """Print a figure with its limit."""
    mark = "ok" if value <= limit else "TOO MUCH"
    print(f"{what:<60}{value:>10,.1f} {unit} (limit {limit:,.0f}): {mark}")


if __name__ == "__main__":
    main()
