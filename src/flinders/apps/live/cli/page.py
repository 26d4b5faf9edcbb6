"""``flinders page``: the live page as static files."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json, say


class Page(program.Group):
    """Options of the command."""

    folder: str = program.member("-o", "--output", required=True, metavar="DIR", help="Folder to create for the page.")
    force: bool = option.force("Write into a folder with other files, and overwrite files of the same names.")
    as_json: bool = option.as_json()


@program.command_of(
    "page",
    Page,
    common=("folder", "force", "as_json"),
    epilog="""\b
Example:
  flinders page -o calibrate
  python -m http.server --directory calibrate
""",
)
def command(options: Page) -> None:
    """Write a folder of static files that calibrates a magnetometer in a browser, from any web server and offline.

    The page reads a board on a serial port (Chrome, Edge), a log that is dropped or pasted, the sensor of a phone, or a
    simulated one. It gives the verdict, the exports and the calibration file of the live page, and sends no data. Serve
    it by https or from this machine: browsers give serial ports to no other pages.
    """
    from flinders.apps.live.standalone import package

    files = package.write(options.folder, force=options.force)
    if options.as_json:
        print_json({"folder": options.folder, "version": package.VERSION, "files": list(map(str, files))})
        return
    size = sum(path.stat().st_size for path in files)
    say(f"{len(files)} files in {options.folder}, {size / 1e6:.1f} MB: put them on any web server")
