"""What ``flinders live`` says of itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.golden.sessions import session

if TYPE_CHECKING:
    import pytest
    from tests.golden.sessions import Golden


def test_help(golden: Golden, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    golden("cli/flinders-live-help.txt", session("flinders live --help"))
