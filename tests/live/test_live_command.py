"""``flinders live``: what it prints in the terminal."""

from __future__ import annotations

import io


def test_the_address_of_the_page_is_drawn_for_a_phone() -> None:
    """A QR code is square, two modules to a line, within a quiet zone of four."""
    from flinders.apps.live.cli.live import draw_address

    drawn = io.StringIO()
    draw_address("192.168.0.7:8410/?token=abcdefghijklmnopqrstuv", drawn)
    rows = drawn.getvalue().splitlines()
    assert {len(row) for row in rows} == {2 * len(rows) - 1}
    assert set(rows[0]) == {"█"}
    assert all(row[:4] in ("████", "▀▀▀▀") for row in rows)
