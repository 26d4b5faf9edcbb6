"""The version of this library, as in ``pyproject.toml``."""

from typing import Final

VERSION: Final = "0.1.0"
"""Kept here because ``importlib.metadata``, which has it too, takes longer to load than a fit."""
