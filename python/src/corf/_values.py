"""Values of JSON, with the file and the key in every error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._program import CorfError

_HELP = "restore the file, or let corf write it again"

# Levels of spectra lie within so many dB of 0, as in the program.
_MOST_LEVEL_DB = 300.0


class Value:
    """A value of a JSON document: what it is asked to be, it is, or CorfError says where it is not."""

    def __init__(self, raw: Any, place: str, key: str = "") -> None:
        self.raw = raw
        self.place = place
        self.key = key

    def fault(self, what: str) -> CorfError:
        """An error about this value."""
        return CorfError(f"{self.place}{f': {self.key}' if self.key else ''}: {what}\n  help: {_HELP}")

    def table(self) -> dict[str, Any]:
        """A table."""
        if not isinstance(self.raw, dict):
            raise self.fault(f"{_short(self.raw)} is no table")
        return self.raw

    def at(self, key: str) -> Value:
        """The value of a key that must be there."""
        found = self.get(key)
        if found is None:
            raise self.fault(f"has no {key}")
        return found

    def get(self, key: str) -> Value | None:
        """The value of a key; None where it is missing or null."""
        raw = self.table().get(key)
        return None if raw is None else Value(raw, self.place, f"{self.key}.{key}" if self.key else key)

    def items(self) -> list[Value]:
        """The values of a list."""
        if not isinstance(self.raw, list):
            raise self.fault(f"{_short(self.raw)} is no list")
        return [Value(raw, self.place, f"{self.key}[{i}]") for i, raw in enumerate(self.raw)]

    def text(self, of: Sequence[str] | None = None) -> str:
        """A text, one of these."""
        if not isinstance(self.raw, str):
            raise self.fault(f"{_short(self.raw)} is no text")
        if of is not None and self.raw not in of:
            raise self.fault(f"{_short(self.raw)} is none of {', '.join(of)}")
        return self.raw

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.raw, bool):
            raise self.fault(f"{_short(self.raw)} is neither true nor false")
        return self.raw

    def number(self, above: float = -math.inf) -> float:
        """A finite number above a bound."""
        if isinstance(self.raw, bool) or not isinstance(self.raw, (int, float)):
            raise self.fault(f"{_short(self.raw)} is no number")
        try:
            value = float(self.raw)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value) or value <= above:
            raise self.fault(f"{_short(self.raw)} is {'not finite' if not math.isfinite(value) else f'not above {above:g}'}")
        return value

    def range_db(self) -> tuple[float, float]:
        """Lower and upper end of a range, dB."""
        ends = self.at("min_db"), self.at("max_db")
        low, high = (end.number() for end in ends)
        for end, level in zip(ends, (low, high)):
            if abs(level) > _MOST_LEVEL_DB:
                raise end.fault(f"{level:g} dB is no level: they lie within {_MOST_LEVEL_DB:g} dB of 0")
        if not low < high:
            raise self.fault(f"{low} to {high} dB is no range")
        return low, high

    def count(self, below: int | None = None) -> int:
        """A whole number from 0, under a bound."""
        if isinstance(self.raw, bool) or not isinstance(self.raw, int) or self.raw < 0:
            raise self.fault(f"{_short(self.raw)} is no whole number from 0")
        if below is not None and self.raw >= below:
            raise self.fault(f"{_short(self.raw)} is not under {below}")
        return self.raw

    def numbers(self, *shape: int) -> npt.NDArray[np.float64]:
        """Finite numbers of a shape, as nested lists have them; -1 is any length."""
        if not shape:
            return np.array(self.number())
        each = self.items()
        if shape[0] not in (-1, len(each)):
            raise self.fault(f"has {len(each)} entries where {shape[0]} belong")
        if not each:
            return np.zeros([0, *(max(n, 0) for n in shape[1:])])
        return np.stack([value.numbers(*shape[1:]) for value in each])

    def pose(self) -> npt.NDArray[np.float64]:
        """A rigid transform, (4, 4)."""
        matrix = self.numbers(4, 4)
        fault = pose_fault(matrix)
        if fault is not None:
            raise self.fault(fault)
        return matrix


# The farthest that anything stands from the origin along an axis, metres, as in the program.
_MOST_COORDINATE_M = 1e6
# Rotations that corf writes are right to all digits of double precision.
_ROTATION_TOLERANCE = 1e-3


def pose_fault(matrix: npt.NDArray[np.float64]) -> str | None:
    """What keeps a (4, 4) matrix from being a rigid transform; None where nothing does."""
    if not np.isfinite(matrix).all():
        return "the pose has a number that is not finite"
    if not np.array_equal(matrix[3], [0, 0, 0, 1]):
        return "the last row of the pose is not 0 0 0 1"
    rotation = matrix[:3, :3]
    if np.abs(rotation).max() > 2 or np.abs(rotation.T @ rotation - np.eye(3)).max() > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        return "the 3x3 block of the pose is no rotation"
    if np.abs(matrix[:3, 3]).max() > _MOST_COORDINATE_M:
        x, y, z = matrix[:3, 3]
        return f"the position is [{x:g}, {y:g}, {z:g}], and coordinates are in metres, at most {_MOST_COORDINATE_M:g} from the origin"
    return None


def real(values: Any, what: str) -> npt.NDArray[np.float64]:
    """Real numbers of any shape; raises CorfError for what is none, complex numbers among them."""
    try:
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise TypeError("they are complex")
        return array.astype(np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise CorfError(f"{what} no real numbers of one shape: {error}") from error


def _short(raw: Any) -> str:
    if isinstance(raw, dict):
        return "a table"
    if isinstance(raw, list):
        return "a list"
    if isinstance(raw, int) and not -(10**40) < raw < 10**40:
        return "a number of many digits"
    text = repr(raw)
    return text if len(text) <= 40 else text[:37] + "..."
