"""A keyframe data set on disk (`corf-dataset/2`, docs/dataset-format.md)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from ._files import read_exr, read_json, read_png, within, within_if_there
from ._program import CorfError, existing
from ._values import Value

SCHEMA = "corf-dataset/2"
TRAJECTORY_SCHEMA = "corf-trajectory/1"
QUANTITIES = ("power_per_steradian", "beam_power", "capon_power", "unknown")


class Dataset(Sequence["Keyframe"]):
    """The keyframes of a folder that `corf dataset generate` or `corf dataset import` wrote, in the order of the trajectory.

    ``dataset[i]`` is keyframe `i` (from 0, negative from the end), ``dataset[a:b]`` a list of keyframes, ``dataset["00017"]`` the one of that name. Files
    are read when an array is asked for. Hashes are not checked; `corf dataset validate` does that.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens the folder; raises CorfError where it is no finished data set of this version."""
        self.path: Path = existing(path, "dataset.json", "give the folder of a finished data set (corf dataset generate, corf dataset import)")
        document = read_json(within(self.path, "dataset.json"))
        schema = document.at("schema").text()
        if schema != SCHEMA:
            raise CorfError(f"{self.path} is a data set of version {schema}, and this package reads {SCHEMA}")
        header = document.at("header")
        self.header: dict[str, Any] = header.table()
        """`header` of dataset.json: cameras, carrier, transmitter, receiver, materials, configuration."""
        self.conventions: dict[str, Any] = document.at("conventions").table()
        """What every number means, in words: topic, question, answer."""
        self._name = header.at("name").text()
        self._quantity = header.at("quantity").text(of=QUANTITIES)
        carrier = header.get("frequency_hz")
        self._frequency_hz = None if carrier is None else carrier.number(above=0)
        modalities = header.get("modalities")
        self._has = (True, True) if modalities is None else (modalities.at("light").flag(), modalities.at("radio").flag())
        transmitter = header.get("transmitter")
        self._transmitter_m = None if transmitter is None else transmitter.at("position_m").numbers(3)
        self._intrinsics, self._size = _camera(header.at("optical_camera"))
        self._rf_intrinsics, self._rf_size = _camera(header.at("rf_camera"))
        trajectory = read_json(within(self.path, "trajectory.json"))
        schema = trajectory.at("schema").text()
        if schema != TRAJECTORY_SCHEMA:
            raise trajectory.fault(f"is a trajectory of version {schema}, and this package reads {TRAJECTORY_SCHEMA}")
        frames = trajectory.at("keyframes").items()
        stated = document.get("keyframes")
        if stated is not None and stated.count() != len(frames):
            raise trajectory.fault(f"has {len(frames)} keyframes where dataset.json says {stated.raw}")
        split = document.at("split")
        self.train: list[int] = _indices(split.at("train"), len(frames))
        """Indices of the keyframes to train with."""
        self.test: list[int] = _indices(split.at("test"), len(frames))
        """Indices of the keyframes that are held out."""
        self.held_out_segment: list[int] = _indices(split.at("held_out_segment"), len(frames))
        """Indices of the contiguous segment of the other protocol."""
        tests = frozenset(self.test)
        if tests & set(self.train):
            raise split.fault(f"keyframe {min(tests & set(self.train))} is trained with and held out")
        range_db = document.get("db_range")
        self.db_range: tuple[float, float] | None = None
        """Lower and upper end of the decibel range of all spectra, dB; None without spectra."""
        if range_db is not None:
            self.db_range = range_db.range_db()
        # The range that an import was told.
        imported = header.get("imported")
        stated = None if imported is None else imported.get("db_range")
        if stated is not None and stated.range_db() != self.db_range:
            raise stated.fault("is another range than that of the data set")
        if (self.db_range is not None) != self.has_radio:
            raise document.fault("db_range and header.modalities do not agree on whether there are spectra")
        self._keyframes = [Keyframe(self, frame, i, i in tests) for i, frame in enumerate(frames)]
        self._by_name = {keyframe.name: keyframe for keyframe in self._keyframes}

    @property
    def name(self) -> str:
        """Name of the data set."""
        return self._name

    @property
    def names(self) -> list[str]:
        """Names of the keyframes: "00001" for index 0."""
        return [keyframe.name for keyframe in self._keyframes]

    @property
    def has_light(self) -> bool:
        """Whether there are images."""
        return self._has[0]

    @property
    def has_radio(self) -> bool:
        """Whether there are spectra."""
        return self._has[1]

    @property
    def frequency_hz(self) -> float | None:
        """Carrier, Hz; None where it is not known."""
        return self._frequency_hz

    @property
    def quantity(self) -> str:
        """Physical quantity of a spectrum's values: power_per_steradian (1/sr), beam_power (1), capon_power (1), or unknown."""
        return self._quantity

    @property
    def transmitter_m(self) -> npt.NDArray[np.float64] | None:
        """Position of the transmitter, (3,), world, metres; None where it is not known."""
        return self._transmitter_m

    @property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix K of the images, (3, 3), pixels; the point (0, 0) is the outer corner of the top left pixel."""
        return self._intrinsics

    @property
    def rf_intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix K of the spectra, (3, 3), pixels; position and axes are those of the optical camera."""
        return self._rf_intrinsics

    def __len__(self) -> int:
        return len(self._keyframes)

    def __iter__(self) -> Iterator[Keyframe]:
        return iter(self._keyframes)

    @overload
    def __getitem__(self, key: int) -> Keyframe: ...
    @overload
    def __getitem__(self, key: str) -> Keyframe: ...
    @overload
    def __getitem__(self, key: slice) -> list[Keyframe]: ...
    def __getitem__(self, key: int | str | slice) -> Keyframe | list[Keyframe]:
        if isinstance(key, str):
            if key not in self._by_name:
                called = f"they are called {self.names[0]} to {self.names[-1]}" if self.names else "it has none"
                raise KeyError(f"{self.path} has no keyframe {key}; {called}")
            return self._by_name[key]
        return self._keyframes[key]

    def __repr__(self) -> str:
        return f"Dataset({str(self.path)!r}: {len(self)} keyframes, {len(self.test)} held out)"


class Keyframe:
    """One keyframe: arrays are read from the data set's files when they are asked for the first time, and kept."""

    def __init__(self, dataset: Dataset, frame: Value, position: int, is_test: bool) -> None:
        self._dataset = dataset
        self.index: int = frame.at("index").count()
        """Index, from 0 along the trajectory."""
        if self.index != position:
            raise frame.fault(f"its index is {self.index}, and indices count 0, 1, 2, … without gaps or repetition")
        self.name: str = frame.at("file").text()
        """File stem: "00001" for index 0."""
        if self.name != f"{position + 1:05}":
            raise frame.fault(f"its file is {self.name!r}, and that of index {position} is called {position + 1:05}")
        self.time_s: float = frame.at("time_s").number()
        """Time, seconds."""
        self.world_from_camera: npt.NDArray[np.float64] = frame.at("world_from_camera").pose()
        """Pose, (4, 4): homogeneous camera coordinates (OpenCV axes) to world coordinates, metres."""
        self.is_test: bool = is_test
        """Whether it is held out by the interleaved split."""

    @property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix of the image, (3, 3), pixels."""
        return self._dataset.intrinsics

    @property
    def rf_intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix of the spectrum, (3, 3), pixels."""
        return self._dataset.rf_intrinsics

    @property
    def transmitter_m(self) -> npt.NDArray[np.float64] | None:
        """Position of the transmitter, (3,), world, metres; None where it is not known."""
        return self._dataset.transmitter_m

    @cached_property
    def image(self) -> npt.NDArray[np.uint8]:
        """Image, (H, W, 3), sRGB of 8 bits. Raises CorfError where the data set has none."""
        self._need(self._dataset.has_light, "images")
        return read_png(self._file("optical/images", "png"), self._dataset._size)

    @cached_property
    def depth_m(self) -> npt.NDArray[np.float32] | None:
        """z-depth along the optical axis, (H, W), metres; 0 where nothing was hit. Ground truth. None where the data set has none."""
        depth = self._optional("optical/depth", "Z", np.float32)
        if depth is not None and not (depth >= 0).all():
            raise CorfError(f"{self._file('optical/depth', 'exr')} has a depth that is negative or no number")
        return depth

    @cached_property
    def mask(self) -> npt.NDArray[np.bool_] | None:
        """Whether a pixel of the image counts, (H, W); what does not is neither learnt from nor compared. None where all count."""
        path = within_if_there(self._dataset.path, f"optical/masks/{self.name}_mask.png")
        return None if path is None else (read_png(path, self._dataset._size) > 0).max(axis=2)

    @cached_property
    def surface(self) -> npt.NDArray[np.uint32] | None:
        """Index into ``dataset.header["objects"]`` of what a pixel shows, (H, W); 4294967295 where nothing was hit. None where there is none."""
        return self._optional("optical/surfaces", "id", np.uint32)

    @cached_property
    def spectrum_linear(self) -> npt.NDArray[np.float32]:
        """Angular spectrum, (H_rf, W_rf), linear, in the unit of ``dataset.quantity``; 0 is an empty bin. Raises CorfError where there is none."""
        self._need(self._dataset.has_radio, "spectra")
        path = self._file("rf/spectra", "exr")
        spectrum = _of_kind(read_exr(path, "Y", self._dataset._rf_size), np.float32, path)
        if not (np.isfinite(spectrum) & (spectrum >= 0)).all():
            raise CorfError(f"{path} has a value that is no power: a spectrum is finite and at least 0")
        return spectrum

    @cached_property
    def spectrum_db(self) -> npt.NDArray[np.float32]:
        """10·log10 of the spectrum, (H_rf, W_rf), dB; empty bins hold the lower end of ``dataset.db_range``, other values are not clipped."""
        linear = self.spectrum_linear.astype(np.float64)
        range_db = self._dataset.db_range
        floor = -np.inf if range_db is None else range_db[0]
        return np.where(linear > 0, 10 * np.log10(np.where(linear > 0, linear, 1)), floor).astype(np.float32)

    @cached_property
    def jet(self) -> npt.NDArray[np.uint8]:
        """The spectrum in Jet colours over the decibel range, (H_rf, W_rf, 3), 8 bits: a picture, not for numbers."""
        self._need(self._dataset.has_radio, "spectra")
        return read_png(self._file("rf/images", "png"), self._dataset._rf_size)

    def _file(self, folder: str, ending: str) -> Path:
        return within(self._dataset.path, f"{folder}/{self.name}.{ending}")

    def _need(self, there: bool, what: str) -> None:
        if not there:
            raise CorfError(f"{self._dataset.path} has no {what}")

    def _optional(self, folder: str, channel: str, kind: type[Any]) -> npt.NDArray[Any] | None:
        path = within_if_there(self._dataset.path, f"{folder}/{self.name}.exr")
        return None if path is None else _of_kind(read_exr(path, channel, self._dataset._size), kind, path)

    def __repr__(self) -> str:
        return f"Keyframe({self.name}{', held out' if self.is_test else ''})"


def _of_kind(pixels: npt.NDArray[Any], kind: type[Any], path: Path) -> npt.NDArray[Any]:
    """Pixels as floats, or as the unsigned integers that they are; one does not become the other."""
    wanted = np.dtype(kind).kind
    if pixels.dtype.kind != wanted:
        raise CorfError(f"{path} holds {pixels.dtype} where {np.dtype(kind)} belongs")
    return pixels.astype(kind, copy=False)


def _indices(values: Value, count: int) -> list[int]:
    """Indices under `count`, none twice."""
    indices = [value.count(below=count) for value in values.items()]
    if len(set(indices)) != len(indices):
        raise values.fault("names a keyframe twice")
    return indices


def _camera(camera: Value) -> tuple[npt.NDArray[np.float64], tuple[int, int]]:
    """Camera matrix, and columns and rows."""
    fx, fy = (camera.at(key).number(above=0) for key in ("fx", "fy"))
    cx, cy = (camera.at(key).number() for key in ("cx", "cy"))
    width, height = camera.at("width"), camera.at("height")
    size = (width.count(), height.count())
    if 0 in size:
        raise camera.fault(f"{size[0]}x{size[1]} pixels are no camera")
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64), size
