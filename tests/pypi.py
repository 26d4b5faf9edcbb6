"""Programs of PyPI that only tests need, in a separate environment that uv keeps."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import NoReturn

FETCH_S: Final = 240.0


def python_with(package: str, missing: Callable[[str], NoReturn]) -> list[str]:
    """Command of a Python that has a package.

    Parameters
    ----------
    package : str
        Name and version, in the form for pip.
    missing : callable
        Called with the reason why the package is missing; it ends the test.
    """
    command, why = _environment(package)
    return command if command else missing(why)


@cache
def _environment(package: str) -> tuple[list[str], str]:
    """The command, or the reason why there is none."""
    uv = shutil.which("uv")
    if uv is None:
        return [], f"no uv to fetch {package}"
    command = [uv, "run", "--no-project", "--isolated", "--quiet", "--with", package, "python"]
    try:
        done = subprocess.run([*command, "-c", ""], capture_output=True, text=True, timeout=FETCH_S, check=False)
    except subprocess.TimeoutExpired:
        return [], f"uv did not fetch {package} within {FETCH_S:g} s"
    return ([], f"uv could not fetch {package}: {done.stderr.strip()[-300:]}") if done.returncode else (command, "")
