"""A keyframe data set on disk (`corf-dataset/2`, docs/dataset-format.md)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from ._files import read_exr, read_json, read_png
from ._program import CorfError, existing

SCHEMA = "corf-dataset/2"


class Dataset(Sequence["Keyframe"]):
    """The keyframes of a folder that `corf dataset generate` or `corf dataset import` wrote, in the order of the trajectory.

    ``dataset[i]`` is keyframe `i` (from 0, negative from the end), ``dataset[a:b]`` a list of keyframes, ``dataset["00017"]`` the one of that name. Files
    are read when an array is asked for. Hashes are not checked; `corf dataset validate` does that.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Opens the folder; raises CorfError where it is no finished data set of this version."""
        self.path: Path = existing(path, "dataset.json", "give the folder of a finished data set (corf dataset generate, corf dataset import)")
        document = read_json(self.path / "dataset.json")
        if document.get("schema") != SCHEMA:
            raise CorfError(f"{self.path} is a data set of version {document.get('schema')}, and this package reads {SCHEMA}")
        self.header: dict[str, Any] = document["header"]
        """`header` of dataset.json: cameras, carrier, transmitter, receiver, materials, configuration."""
        self.conventions: dict[str, Any] = document["conventions"]
        """What every number means, in words: topic, question, answer."""
        split = document["split"]
        self.train: list[int] = list(split["train"])
        """Indices of the keyframes to train with."""
        self.test: list[int] = list(split["test"])
        """Indices of the keyframes that are held out."""
        self.held_out_segment: list[int] = list(split["held_out_segment"])
        """Indices of the contiguous segment of the other protocol."""
        range_db = document.get("db_range")
        self.db_range: tuple[float, float] | None = None if range_db is None else (range_db["min_db"], range_db["max_db"])
        """Lower and upper end of the decibel range of all spectra, dB; None without spectra."""
        frames = read_json(self.path / "trajectory.json")["keyframes"]
        tests = frozenset(self.test)
        self._keyframes = [Keyframe(self, frame, frame["index"] in tests) for frame in frames]
        self._by_name = {keyframe.name: keyframe for keyframe in self._keyframes}

    @property
    def name(self) -> str:
        """Name of the data set."""
        return str(self.header["name"])

    @property
    def names(self) -> list[str]:
        """Names of the keyframes: "00001" for index 0."""
        return [keyframe.name for keyframe in self._keyframes]

    @property
    def has_light(self) -> bool:
        """Whether there are images."""
        return bool(self.header.get("modalities", {}).get("light", True))

    @property
    def has_radio(self) -> bool:
        """Whether there are spectra."""
        return bool(self.header.get("modalities", {}).get("radio", True))

    @property
    def frequency_hz(self) -> float | None:
        """Carrier, Hz; None where it is not known."""
        value = self.header.get("frequency_hz")
        return None if value is None else float(value)

    @property
    def quantity(self) -> str:
        """Physical quantity of a spectrum's values: power_per_steradian (1/sr), beam_power (1), capon_power (1), or unknown."""
        return str(self.header["quantity"])

    @cached_property
    def transmitter_m(self) -> npt.NDArray[np.float64] | None:
        """Position of the transmitter, (3,), world, metres; None where it is not known."""
        transmitter = self.header.get("transmitter")
        return None if transmitter is None else np.array(transmitter["position_m"], dtype=np.float64)

    @cached_property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix K of the images, (3, 3), pixels; the point (0, 0) is the outer corner of the top left pixel."""
        return _matrix(self.header["optical_camera"])

    @cached_property
    def rf_intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix K of the spectra, (3, 3), pixels; position and axes are those of the optical camera."""
        return _matrix(self.header["rf_camera"])

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
                raise KeyError(f"{self.path} has no keyframe {key}; they are called {self.names[0]} to {self.names[-1]}")
            return self._by_name[key]
        return self._keyframes[key]

    def __repr__(self) -> str:
        return f"Dataset({str(self.path)!r}: {len(self)} keyframes, {len(self.test)} held out)"


class Keyframe:
    """One keyframe: arrays are read from the data set's files when they are asked for the first time, and kept."""

    def __init__(self, dataset: Dataset, frame: dict[str, Any], is_test: bool) -> None:
        self._dataset = dataset
        self.index: int = frame["index"]
        """Index, from 0 along the trajectory."""
        self.name: str = frame["file"]
        """File stem: "00001" for index 0."""
        self.time_s: float = frame["time_s"]
        """Time, seconds."""
        self.world_from_camera: npt.NDArray[np.float64] = np.array(frame["world_from_camera"], dtype=np.float64)
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
        return read_png(self._file("optical/images", "png"))

    @cached_property
    def depth_m(self) -> npt.NDArray[np.float32] | None:
        """z-depth along the optical axis, (H, W), metres; 0 where nothing was hit. Ground truth. None where the data set has none."""
        return self._optional("optical/depth", "Z", np.float32)

    @cached_property
    def mask(self) -> npt.NDArray[np.bool_] | None:
        """Whether a pixel of the image counts, (H, W); what does not is neither learnt from nor compared. None where all count."""
        path = self._dataset.path / "optical/masks" / f"{self.name}_mask.png"
        return (read_png(path) > 0).max(axis=2) if path.exists() else None

    @cached_property
    def surface(self) -> npt.NDArray[np.uint32] | None:
        """Index into ``dataset.header["objects"]`` of what a pixel shows, (H, W); 4294967295 where nothing was hit. None where there is none."""
        return self._optional("optical/surfaces", "id", np.uint32)

    @cached_property
    def spectrum_linear(self) -> npt.NDArray[np.float32]:
        """Angular spectrum, (H_rf, W_rf), linear, in the unit of ``dataset.quantity``; 0 is an empty bin. Raises CorfError where there is none."""
        self._need(self._dataset.has_radio, "spectra")
        return read_exr(self._file("rf/spectra", "exr"), "Y").astype(np.float32, copy=False)

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
        return read_png(self._file("rf/images", "png"))

    def _file(self, folder: str, ending: str) -> Path:
        return self._dataset.path / folder / f"{self.name}.{ending}"

    def _need(self, there: bool, what: str) -> None:
        if not there:
            raise CorfError(f"{self._dataset.path} has no {what}")

    def _optional(self, folder: str, channel: str, kind: type[Any]) -> npt.NDArray[Any] | None:
        path = self._file(folder, "exr")
        return read_exr(path, channel).astype(kind, copy=False) if path.exists() else None

    def __repr__(self) -> str:
        return f"Keyframe({self.name}{', held out' if self.is_test else ''})"


def _matrix(camera: dict[str, float]) -> npt.NDArray[np.float64]:
    return np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], dtype=np.float64)
