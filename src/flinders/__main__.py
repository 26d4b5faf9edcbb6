"""The command line, as ``python -m flinders``."""

from flinders.cli import main

if __name__ == "__main__":
    main(prog_name="flinders")
