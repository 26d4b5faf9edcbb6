"""The command line: it parses the arguments, calls the library and prints. Results go to stdout, notices to stderr.

NumPy and the modules of commands are imported only when a command runs, so that --help is fast.
"""

from __future__ import annotations

import sys

try:
    import click

    from flinders.cli._commands import ROWS, Commands
    from flinders.cli._program import EXIT_CODES, Program, show_versions, use_language
    from flinders.core.language import LANGUAGES

    main = Program(
        name="flinders",
        help="Calibrate a three-axis magnetometer, with the heading error to expect.",
        epilog="\b\nExample:\n"
        "  flinders calibrate tumble.csv -o calibration.json\n"
        "  flinders apply calibration.json raw.csv -o corrected.csv\n"
        "  flinders check calibration.json tomorrow.csv\n"
        "\n\b\nExit codes:\n" + "\n".join(f"  {code:>3}  {meaning}" for code, meaning in EXIT_CODES.items()),
        context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
        commands=Commands(ROWS, table="COMMANDS"),  # type: ignore[arg-type]  # click only reads them
    )
    main = click.option(
        "--version",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=show_versions,
        help="Show the version, and those of Python, NumPy, the engine and optional packages.",
    )(main)
    main = click.option(
        "--language",
        type=click.Choice(LANGUAGES),
        envvar="FLINDERS_LANGUAGE",
        expose_value=False,
        callback=use_language,
        help="Language of calibrations, checks and plans, or FLINDERS_LANGUAGE. JSON, files and codes stay English.",
    )(main)
except (KeyboardInterrupt, RuntimeError) as error:  # an exception in a class body has the interrupt as its cause
    if not isinstance(error.__cause__ or error, KeyboardInterrupt):
        raise
    sys.exit(130)  # the exit code of `Program`, which is not imported yet
