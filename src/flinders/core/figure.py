"""A figure in SVG that a notebook shows and that can be saved.

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
    """A figure in SVG, light or dark by the setting of the viewer; needs no other package."""

    svg: str  #: content of the SVG file
    name: str  #: subject of the figure

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the figure to an ``.svg`` file.

        Raises
        ------
        UsageError
            For another kind of file.
        OutputExists
            If the file exists, unless `force`.
        OutputError
            If the file cannot be written.
        """
        if not os.fspath(path).lower().endswith(".svg"):
            raise UsageError(
                f"{os.fspath(path)} is not an .svg file: give a name that ends in .svg, or draw into axes of "
                "matplotlib, and save those",
                hint={"ax": None},
            )
        write_text(self.svg, path, force=force)

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f'Figure({self.name}: a notebook shows it, save("{self.name.replace(" ", "-")}.svg") writes it)'
