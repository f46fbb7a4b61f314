"""Propagation paths between points (`corf paths`)."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from ._files import parsed
from ._program import Argument, CorfError, run
from ._values import Value, real

Point = Union[Sequence[float], npt.NDArray[np.float64]]
Points = Union[Sequence[Point], npt.NDArray[np.float64]]


@dataclass(frozen=True)
class Paths:
    """The P paths of one link, strongest interactions or not, in the program's order. Angles are of the world frame."""

    frequency_hz: float
    """Carrier, Hz."""
    tx_m: npt.NDArray[np.float64]
    """Transmitter, (3,), metres."""
    rx_m: npt.NDArray[np.float64]
    """Receiver, (3,), metres."""
    a: npt.NDArray[np.complex128]
    """Coefficients between the first ports, (P,), without the phase of propagation: h(f) = Σ a·exp(−j2πfτ)."""
    delay_s: npt.NDArray[np.float64]
    """Delay τ, (P,), seconds."""
    length_m: npt.NDArray[np.float64]
    """Length, (P,), metres."""
    aoa_zenith_rad: npt.NDArray[np.float64]
    """Zenith of arrival, (P,), of the direction from the receiver to the last interaction."""
    aoa_azimuth_rad: npt.NDArray[np.float64]
    """Azimuth of arrival, (P,)."""
    aod_zenith_rad: npt.NDArray[np.float64]
    """Zenith of departure, (P,), of the direction in which the path leaves the transmitter."""
    aod_azimuth_rad: npt.NDArray[np.float64]
    """Azimuth of departure, (P,)."""
    types: list[str]
    """Letters of the interactions of each path, from transmitter to receiver; "" is the direct ray."""
    objects: list[list[str]]
    """Names of the objects of its interactions."""
    vertices_m: list[npt.NDArray[np.float64]]
    """Positions of its interactions, each (interactions, 3), metres."""
    document: dict[str, Any]
    """All that the program said of the link: link statistics in ``["channel"]``, responses, channels between ports (docs/cli.md, `corf paths`)."""

    @property
    def gain_db(self) -> npt.NDArray[np.float64]:
        """Path gain 20·log10|a|, (P,), dB."""
        with np.errstate(divide="ignore"):
            gain: npt.NDArray[np.float64] = 20 * np.log10(np.abs(self.a))
        return gain

    @property
    def path_gain_db(self) -> float | None:
        """Gain of the link, dB: the powers of all paths added, 10·log10 Σ|a|², over the ports of both elements, scattered power among it where it was
        asked for (``diffuse=True``). None where nothing arrives. The number of the column of this name in the table of `corf paths --out LINKS.csv`."""
        return self._statistic("path_gain_db")

    @property
    def rssi_dbm(self) -> float | None:
        """Power that arrives for the transmit power stated, dBm: :attr:`path_gain_db` plus ``tx_power_dbm`` (30 dBm, which is 1 W, unless it was given).
        None where nothing arrives."""
        return self._statistic("rssi_dbm")

    def _statistic(self, key: str) -> float | None:
        value = Value(self.document, "corf paths").at("channel").get(key)
        return None if value is None else value.number()

    def h(self, offset_hz: float | npt.NDArray[np.float64] = 0.0) -> npt.NDArray[np.complex128]:
        """Channel between the first ports at the carrier plus `offset_hz` (any shape), of the same shape."""
        frequencies = self.frequency_hz + np.asarray(offset_hz, dtype=np.float64)
        phases = np.exp(-2j * np.pi * frequencies[..., None] * self.delay_s)
        total: npt.NDArray[np.complex128] = (phases * self.a).sum(axis=-1)
        return total

    def __len__(self) -> int:
        return len(self.a)


def paths(scene: str | os.PathLike[str], tx: Point | None, rx: Point, **options: Any) -> Paths:
    """Traces the paths from `tx` to `rx` (x, y, z, world, metres) in a scene file; without `tx` from the scene's own transmitter.

    `options` are the flags of `corf paths`: ``depth=2``, ``diffraction=True``, ``bandwidth=400e6``, ``rx_array="8x8"``; docs/cli.md has all.

    Raises CorfError for what the program refuses.
    """
    found = links(scene, None if tx is None else [tx], [rx], **options)
    if len(found) != 1:
        raise CorfError(f"{len(found)} links were traced where one was asked for\n  help: name one transmitter, or use corf.links")
    return found[0]


def links(scene: str | os.PathLike[str], tx: Points | None, rx: Points, **options: Any) -> list[Paths]:
    """The paths of every pair: receivers in their order, and for each the transmitters in theirs. `rx` and `tx` are sequences of points (x, y, z) or
    arrays (N, 3), world, metres. Otherwise as :func:`paths`.

    The scene is read and made ready once for all receivers: twenty cost little more than one, and one call is the way to ask for many.
    """
    for name in ("format", "out", "json", "tx", "rx"):
        if name in options:
            raise CorfError(f"{name} is no option of corf.paths\n  help: run the command with corf.run(\"paths\", …) instead")
    arguments: list[Argument] = ["paths", scene]
    arguments.extend(f"--tx={_point(point)}" for point in ([] if tx is None else tx))
    with tempfile.TemporaryDirectory() as scratch:
        if len(rx) > 1 and "rx_file" not in options:
            # A command line holds some thousands of points, a file any number.
            file = Path(scratch) / "receivers.npy"
            np.save(file, np.stack([_coordinates(point) for point in rx]))
            arguments.append(f"--rx-file={file}")
        else:
            arguments.extend(f"--rx={_point(point)}" for point in rx)
        for name, value in options.items():
            arguments.extend(_flag("--" + name.replace("_", "-"), value))
        document = parsed(run(*arguments), "corf paths")
    several = document.get("links")
    return [_link(link) for link in ([document] if several is None else several.items())]


def _coordinates(point: Point) -> npt.NDArray[np.float64]:
    values = real(point, f"{point!r} is no point: its coordinates are")
    if values.shape != (3,) or not np.isfinite(values).all():
        raise CorfError(f"{point!r} is no point\n  help: give x, y, z in metres")
    return values


def _point(point: Point) -> str:
    return ",".join(repr(float(v)) for v in _coordinates(point))


def _flag(flag: str, value: Any) -> list[str]:
    """A flag as words: alone where it is true, left out where it is false or None, repeated for a list."""
    if value is None or value is False:
        return []
    if value is True:
        return [flag]
    return [f"{flag}={v}" for v in (value if isinstance(value, (list, tuple)) else [value])]


def _link(link: Value) -> Paths:
    each = link.at("paths").items()

    def column(key: str) -> npt.NDArray[np.float64]:
        return np.array([p.at(key).number() for p in each], dtype=np.float64)

    return Paths(
        frequency_hz=link.at("frequency_hz").number(above=0),
        tx_m=link.at("tx").numbers(3),
        rx_m=link.at("rx").numbers(3),
        a=np.array([complex(*p.at("a").numbers(2)) for p in each], dtype=np.complex128),
        delay_s=column("tau"),
        length_m=column("length_m"),
        aoa_zenith_rad=column("theta_r"),
        aoa_azimuth_rad=column("phi_r"),
        aod_zenith_rad=column("theta_t"),
        aod_azimuth_rad=column("phi_t"),
        types=[p.at("types").text() for p in each],
        objects=[[name.text() for name in p.at("objects").items()] for p in each],
        vertices_m=[p.at("vertices").numbers(-1, 3) for p in each],
        document=link.table(),
    )
