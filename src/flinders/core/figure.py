"""A drawing as a value: a notebook shows it, and it can be saved.

>>> drawn = Figure('<svg xmlns="http://www.w3.org/2000/svg" width="20" height="10"></svg>', "a box")
>>> drawn, drawn._repr_svg_()[:4]
(Figure(a box: a notebook shows it, save("a-box.svg") writes it), '<svg')
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from flinders.core.files import write_text
from flinders.errors import UsageError


@dataclass(frozen=True, slots=True, repr=False)
class Figure:
    """A drawing in SVG, light or dark as its reader's screen is; no further package is needed."""

    svg: str  #: a file of its own
    name: str  #: what it shows

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write it as a file, ``.svg``.

        Raises
        ------
        UsageError
            For another kind of file.
        OutputExists
            Where there is a file already, unless `force`.
        OutputError
            Where it cannot be written.
        """
        if not os.fspath(path).lower().endswith(".svg"):
            raise UsageError(
                f"{os.fspath(path)} is no SVG: save a figure as .svg, or draw into axes of matplotlib, and save those",
                hint={"ax": None},
            )
        write_text(self.svg, path, force=force)

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f'Figure({self.name}: a notebook shows it, save("{self.name.replace(" ", "-")}.svg") writes it)'
