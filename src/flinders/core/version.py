"""The version of this library, as in ``pyproject.toml``."""

from typing import Final

VERSION: Final = "0.1.0"
"""Version of the library; it is written here because reading it by ``importlib.metadata`` takes longer than a fit."""
