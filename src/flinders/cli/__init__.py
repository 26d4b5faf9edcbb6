"""The command line: parse, call the library, print. Results on stdout, talk on stderr.

Nothing here imports NumPy until a command runs, so that help comes at once.
"""

from __future__ import annotations

import click

from flinders.cli import (
    apply,
    budget,
    calibrate,
    check,
    compare,
    compare_methods,
    demo,
    evaluate,
    export,
    heading,
    import_,
    info,
    live,
    merge,
    methods,
    plot,
    record,
    report,
    send,
    simulate,
    swing,
    targets,
    two_axis,
)
from flinders.cli._program import EXIT_CODES, Program

main = Program(
    name="flinders",
    help="Calibrate a three-axis magnetometer, and know what heading error to expect.",
    epilog="\b\nExample:\n"
    "  flinders calibrate tumble.csv -o calibration.json\n"
    "  flinders apply calibration.json raw.csv -o corrected.csv\n"
    "  flinders check calibration.json tomorrow.csv\n"
    "\n\b\nExit codes:\n" + "\n".join(f"  {code:>3}  {meaning}" for code, meaning in EXIT_CODES.items()),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    commands=[
        info.command,
        calibrate.command,
        apply.command,
        heading.command,
        swing.command,
        two_axis.command,
        check.command,
        compare.command,
        report.command,
        plot.command,
        merge.command,
        export.command,
        import_.command,
        targets.command,
        live.command,
        record.command,
        send.command,
        budget.command,
        simulate.command,
        evaluate.command,
        demo.command,
        methods.command,
        compare_methods.command,
    ],
)
main = click.version_option(package_name="flinders", message="flinders %(version)s")(main)
