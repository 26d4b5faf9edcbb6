"""Tables in memory as their libraries hand them out, with and without pyarrow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Sequence

pyarrow = pytest.importorskip("pyarrow")


class Streamed:
    """A table of any library that hands out a stream of Arrow."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.table = pyarrow.table(columns)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.table.__arrow_c_stream__(requested_schema)


class Column:
    """A column as polars has it: a type without a kind, and its values as NumPy or as a list."""

    dtype = "Float64"

    def __init__(self, values: Sequence[object]) -> None:
        self.values = values

    def to_numpy(self) -> Any:  # noqa: ANN401 - an array
        return np.array(self.values)

    def to_list(self) -> list[object]:
        return list(self.values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:  # noqa: ANN401
        return self.to_numpy().astype(dtype)


class PolarsLike(Streamed):
    """A frame as polars has it, which also hands out its columns one by one."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self.columns, self._by_name = list(columns), columns

    def get_column(self, name: str) -> Column:
        return Column(self._by_name[name])


def of_polars(columns: dict[str, Any]) -> Any:  # noqa: ANN401 - a frame
    return pytest.importorskip("polars").DataFrame(columns)


def refuse(package: str) -> None:
    raise ImportError(package)
