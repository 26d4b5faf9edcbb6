"""Targets with any numbers: a calibration is written within what is said of it, or refused with a message."""

from __future__ import annotations

import contextlib
import math
import struct

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tests.trials import examples

from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.units import Unit
from flinders.errors import FlindersError, NotExportable
from flinders.targets import ExportOptions, motioncal, read_back, registry
from flinders.targets._comments import BLOCK, MARKUP, plain_ascii
from flinders.targets._numbers import nearest_diagonal
from flinders.targets._target import MOUNTING_KINDS
from flinders.targets.motioncal import symmetric_root

entries = st.floats(-0.2, 0.2)
single = st.floats(allow_nan=False, allow_infinity=False, width=32)


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Any that a compass would have, with any mapping of axes, in counts of a known scale."""
    lower = np.array(draw(st.lists(entries, min_size=9, max_size=9))).reshape(3, 3)
    matrix = np.diag(draw(st.lists(st.floats(0.9, 1.3), min_size=3, max_size=3))) + (lower + lower.T) / 2
    offset = np.array(draw(st.lists(st.floats(-90, 90), min_size=3, max_size=3)))
    order, signs = draw(st.permutations("xyz")), draw(st.lists(st.sampled_from(["", "-"]), min_size=3, max_size=3))
    axes = Axes.of(",".join(sign + name for sign, name in zip(signs, order, strict=True)))
    assume(np.linalg.eigvalsh(matrix).min() > 0.3)
    return Calibration(matrix, offset, draw(st.floats(20, 70)), raw=Unit.of("counts", 0.1), axes=axes)


@examples(30)
@given(calibrations())
def test_with_soft_iron_left_out_or_not_what_is_written_is_as_far_off_as_is_said(found: Calibration) -> None:
    for row in (row for row in registry().values() if row.keeps not in MOUNTING_KINDS):
        checked = row.render(found, asked=ExportOptions(lossy=True)).fields["checked"]
        if checked["heading_deg"] > 1.0:
            assert row.keeps in {"diagonal", "offset"}
            with pytest.raises(NotExportable) as refused:
                row.render(found)
            assert refused.value.evidence["heading_deg"] == checked["heading_deg"]
        else:
            assert row.render(found).fields["checked"] == checked


@given(
    diagonal=st.lists(st.integers(-300, 300), min_size=3, max_size=3),
    beside=st.lists(st.floats(-0.3, 0.3), min_size=9, max_size=9),
    offset=st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3),
    strength=st.integers(-300, 300),
    unit=st.sampled_from(["uT", "counts"]),
    lossy=st.booleans(),
)
def test_any_calibration_is_written_or_refused_with_a_message(
    diagonal: list[int], beside: list[float], offset: list[float], strength: int, unit: str, *, lossy: bool
) -> None:
    with np.errstate(all="ignore"):
        scale = np.diag([10.0**exponent for exponent in diagonal])
        try:
            matrix = scale @ (np.eye(3) + np.reshape(beside, (3, 3)))
            found = Calibration(matrix, np.array(offset), 10.0**strength, rotation="composed", raw=Unit.of(unit))
        except FlindersError:
            return
    for row in registry().values():
        try:
            export = row.render(found, asked=ExportOptions(lossy=lossy))
        except FlindersError:
            continue
        told = export.fields["checked"]
        assert lossy or told["heading_deg"] <= 2.1


@given(st.lists(single, min_size=10, max_size=10))
def test_any_packet_is_read_back_to_the_bit(values: list[float]) -> None:
    body = motioncal.SIGNATURE + struct.pack("<16f", *[0.0] * 6, *values)
    data = body + motioncal.crc16(body).to_bytes(2, "little")
    assert motioncal.MotionCalPacket.decode(data).encode() == data


@given(st.binary(max_size=60))
def test_a_message_with_its_crc_behind_it_has_the_crc_0(message: bytes) -> None:
    assert motioncal.crc16(message + motioncal.crc16(message).to_bytes(2, "little")) == 0


@pytest.mark.parametrize("target", [None, *(row.name for row in registry().values() if row.reader)])
@given(
    content=st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
)
def test_any_bytes_are_read_or_refused_with_a_message(target: str | None, content: bytes) -> None:
    with contextlib.suppress(FlindersError):
        read_back(content, "file", target=target)


@given(st.lists(st.text(max_size=80), max_size=3))
def test_no_remark_ends_its_comment(remarks: list[str]) -> None:
    for comment in (BLOCK, MARKUP):
        lines = comment.lines(remarks)
        text = "\n".join(lines[1:-1])
        assert comment.closing.strip() not in text
        assert comment.opening not in text
        assert text.isascii()
        assert "\r" not in text
    assert all(plain_ascii(remark).isprintable() for remark in remarks)


@given(calibrations())
def test_a_symmetric_root_has_the_same_lengths_and_a_diagonal_is_itself(found: Calibration) -> None:
    turned = np.linalg.qr(found.matrix + np.eye(3))[0] @ found.matrix
    root = symmetric_root(turned)
    npt.assert_allclose(root @ root, turned.T @ turned, atol=1e-12)
    npt.assert_allclose(nearest_diagonal(np.diag(np.diag(found.matrix))), np.diag(found.matrix))
    assert math.isfinite(float(nearest_diagonal(found.matrix).sum()))
