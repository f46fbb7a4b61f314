"""A reconstructed field: the run folder of `corf reconstruct`."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from ._files import parsed, read_exr, read_json, read_png, within, within_if_there
from ._ply import harmonics, read_columns
from ._program import Argument, CorfError, existing, run
from ._values import pose_fault, real

Pose = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Gaussians:
    """N coupled Gaussians: one geometry, an opacity and a colour per modality.

    Colour towards a unit direction d (from the camera to the Gaussian, world axes) is ``max(0, 0.5 + Σ_k sh[:, k] · Y_k(d))``.
    Opacity and colour of a modality that the field was not trained on are those that Gaussians are born with, and mean nothing.
    """

    position_m: npt.NDArray[np.float32]
    """Means, (N, 3), world, metres."""
    scale_m: npt.NDArray[np.float32]
    """Standard deviations along the axes of the rotation, (N, 3), metres."""
    rotation_wxyz: npt.NDArray[np.float32]
    """Unit quaternions (w, x, y, z), (N, 4)."""
    opacity: npt.NDArray[np.float32]
    """Opacity in light, (N,), 0 to 1."""
    sh: npt.NDArray[np.float32]
    """Spherical-harmonic coefficients of the colour in light, (N, K, 3), sRGB-encoded."""
    rf_opacity: npt.NDArray[np.float32]
    """Opacity at the carrier, (N,), 0 to 1."""
    rf_sh: npt.NDArray[np.float32]
    """Coefficients of the radio colour, (N, K_rf, C): three channels (Jet) or one (level from 0 to 1 over the decibel range)."""

    def __len__(self) -> int:
        return len(self.position_m)


@dataclass(frozen=True)
class Rendering:
    """Image and spectrum that a field predicts at a pose. What the field or its data set has not is None."""

    world_from_camera: Pose
    """The pose, (4, 4): OpenCV camera axes to world, metres."""
    image: npt.NDArray[np.uint8] | None
    """Image, (H, W, 3), sRGB of 8 bits."""
    depth_m: npt.NDArray[np.float32] | None
    """z-depth of the image's pixels, (H, W), metres; 0 where nothing is."""
    spectrum_linear: npt.NDArray[np.float32] | None
    """Spectrum, (H_rf, W_rf), linear, in the data set's unit; 0 at the lower end of the data set's decibel range."""
    spectrum_db: npt.NDArray[np.float32] | None
    """Spectrum, (H_rf, W_rf), dB, within the data set's decibel range."""
    jet: npt.NDArray[np.uint8] | None
    """Spectrum in Jet colours, (H_rf, W_rf, 3), 8 bits."""


@dataclass(frozen=True)
class Aggregates:
    """What a radio field says at N poses in a few numbers each. NaN is what is not there: a column that the kind of spectra does not say (the program's
    documentation has which and why), or a place where nothing arrives."""

    position_m: npt.NDArray[np.float64]
    """Positions of the poses, (N, 3), world, metres."""
    path_gain_db: npt.NDArray[np.float64]
    """Power that arrives from the directions of the frame, relative to that transmitted, (N,), dB."""
    rssi_dbm: npt.NDArray[np.float64]
    """The same for the transmit power, (N,), dBm."""
    peak_azimuth_rad: npt.NDArray[np.float64]
    """Azimuth of the strongest direction in the array's frame, (N,), positive to the left of straight ahead."""
    peak_elevation_rad: npt.NDArray[np.float64]
    """Its elevation, (N,), positive up."""
    peak_db: npt.NDArray[np.float64]
    """Its level, (N,), dB in the unit of the spectra."""
    best_beam: npt.NDArray[np.int64]
    """Best beam of the codebook, 8p + q, (N,); -1 where there is none."""
    best_beam_gain_db: npt.NDArray[np.float64]
    """Its power relative to that transmitted, (N,), dB."""
    azimuth_spread_rad: npt.NDArray[np.float64]
    """Circular azimuth spread of arrival, (N,)."""
    zenith_spread_rad: npt.NDArray[np.float64]
    """Circular zenith spread of arrival, (N,)."""
    rate_bps_hz: npt.NDArray[np.float64]
    """Spectral efficiency behind the best beam, (N,), bit/s/Hz."""
    outage: npt.NDArray[np.bool_]
    """Whether that is below the target, (N,); False where there are no beams."""

    def __len__(self) -> int:
        return len(self.position_m)

    @property
    def outage_share(self) -> float:
        """Share of the poses that are in outage; NaN of none."""
        return float(np.mean(self.outage)) if len(self) else float("nan")


class Field:
    """A finished run of `corf reconstruct`, of any method."""

    def __init__(self, path: str | os.PathLike[str], dataset: str | os.PathLike[str] | None = None) -> None:
        """Opens a run folder; `dataset` is where its data set is now, if it has moved. Raises CorfError where the run is not finished."""
        self.path: Path = existing(path, "run.json", "give the --out folder of a finished corf reconstruct")
        info = read_json(within(self.path, "run.json"))
        self.info: dict[str, Any] = info.table()
        """`run.json`: method, configuration, seed, data set, time."""
        self._method = info.at("method").text()
        self._own_dataset = info.at("dataset").text()
        self._dataset = dataset

    @property
    def method(self) -> str:
        """Method that made it."""
        return self._method

    @property
    def dataset_path(self) -> Path:
        """Folder of its data set."""
        return Path(self._dataset if self._dataset is not None else self._own_dataset)

    @overload
    def render(self, poses: Pose, *, device: str = ..., verify: bool = ...) -> Rendering: ...
    @overload
    def render(self, poses: Sequence[Pose], *, device: str = ..., verify: bool = ...) -> list[Rendering]: ...
    def render(self, poses: Pose | Sequence[Pose], *, device: str = "auto", verify: bool = False) -> Rendering | list[Rendering]:
        """Renders one pose (an array (4, 4)) or several (a sequence of them, or an array (n, 4, 4)), at the data set's resolutions.

        `device` is auto, cpu, gpu or gpu:N; `verify` has the data set's files checked against their hashes first.

        Raises CorfError for a pose that is no rigid transform, and for what the program refuses.
        """
        array, several = _poses(poses)
        if array.size == 0:
            return []
        with tempfile.TemporaryDirectory() as scratch:
            file, out = Path(scratch) / "poses.json", Path(scratch) / "out"
            file.write_text(json.dumps(several.tolist()))
            run("render", self.path, "--poses", file, "--out", out, "--device", device, *self._dataset_flags(verify))
            made = [_read(out, i, pose.copy()) for i, pose in enumerate(several)]
        return made[0] if array.ndim == 2 else made

    def query(
        self,
        poses: Pose | Sequence[Pose],
        *,
        target_rate_bps_hz: float = 1.0,
        tx_power_dbm: float = 20.0,
        anywhere: bool = False,
        device: str = "auto",
        verify: bool = False,
    ) -> Aggregates:
        """Power, strongest direction, best beam, spread and outage at one pose (4, 4) or many (n, 4, 4) (`corf query`).

        A rate below `target_rate_bps_hz` is outage, with `tx_power_dbm` sent. Poses outside of the room are refused unless `anywhere`.

        Raises CorfError for a pose that is no rigid transform, and for what the program refuses.
        """
        _, several = _poses(poses)
        with tempfile.TemporaryDirectory() as scratch:
            file, out = Path(scratch) / "poses.json", Path(scratch) / "answers.npz"
            file.write_text(json.dumps(several.tolist()))
            flags: list[Argument] = ["--anywhere"] if anywhere else []
            flags += ["--target-rate", target_rate_bps_hz, "--tx-power", tx_power_dbm, "--device", device]
            if len(several):
                run("query", self.path, "--poses", file, "--out", out, *flags, *self._dataset_flags(verify))
                with np.load(out) as answers:
                    columns = {name: np.asarray(answers[name], dtype=np.float64) for name in answers.files}
            else:
                columns = {}
        nothing: npt.NDArray[np.float64] = np.empty(0)

        def of(name: str) -> npt.NDArray[np.float64]:
            return columns[name] if columns else nothing

        return Aggregates(
            position_m=np.stack([of("x_m"), of("y_m"), of("z_m")], axis=1),
            path_gain_db=of("path_gain_db"),
            rssi_dbm=of("rssi_dbm"),
            peak_azimuth_rad=np.radians(of("peak_azimuth_deg")),
            peak_elevation_rad=np.radians(of("peak_elevation_deg")),
            peak_db=of("peak_db"),
            best_beam=np.where(np.isnan(of("best_beam")), -1, of("best_beam")).astype(np.int64),
            best_beam_gain_db=of("best_beam_gain_db"),
            azimuth_spread_rad=np.radians(of("azimuth_spread_deg")),
            zenith_spread_rad=np.radians(of("zenith_spread_deg")),
            rate_bps_hz=of("rate_bps_hz"),
            outage=of("outage") == 1.0,
        )

    def gaussians(self) -> Gaussians:
        """The Gaussians of the field. Raises CorfError where the method has none."""
        path = within_if_there(self.path, "coupled.ply")
        if path is None:
            raise CorfError(f"{self.path}: {self.method} keeps no Gaussians in coupled.ply\n  help: open a run of corf-gs or rf-3dgs")
        columns = read_columns(path)

        def stacked(*names: str) -> npt.NDArray[np.float32]:
            return np.stack([columns[name] for name in names], axis=1)

        try:
            rotation = stacked("rot_0", "rot_1", "rot_2", "rot_3")
            faulty = [name for name, column in columns.items() if not np.isfinite(column).all()]
            if faulty:
                raise CorfError(f"{path}: property {faulty[0]} has a value that is not finite\n  help: write the field again")
            if not np.linalg.norm(rotation, axis=1).all():
                raise CorfError(f"{path}: a rotation (rot_0 to rot_3) is zero\n  help: write the field again")
            return Gaussians(
                position_m=stacked("x", "y", "z"),
                scale_m=np.exp(stacked("scale_0", "scale_1", "scale_2")),
                rotation_wxyz=rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
                opacity=_sigmoid(columns["opacity"]),
                sh=harmonics(columns, ""),
                rf_opacity=_sigmoid(columns["rf_opacity"]),
                rf_sh=harmonics(columns, "rf_"),
            )
        except KeyError as error:
            raise CorfError(f"{path} is no coupled field: it has no property {error}") from error

    def evaluate(self, *, device: str = "auto", verify: bool = False) -> dict[str, Any]:
        """Scores the field on its held-out keyframes; writes `metrics.json` into the run folder and returns it. ``["means"]`` has the metrics."""
        return parsed(run("evaluate", self.path, "--json", "--device", device, *self._dataset_flags(verify)), "corf evaluate").table()

    def export(self, out: str | os.PathLike[str], *, to: str, field: str = "optical", pad_sh: int | None = None) -> dict[str, Any]:
        """Writes one modality ("optical", "rf") as "ply", "splat", "spz" or "sog-ready-ply" (`corf field export`); returns what the program says of it."""
        padding: list[Argument] = [] if pad_sh is None else ["--pad-sh", pad_sh]
        said = run("field", "export", self.path, "--to", to, "--field", field, "--out", out, "--json", *padding)
        return parsed(said, "corf field export").table()

    def _dataset_flags(self, verify: bool) -> list[Argument]:
        flags: list[Argument] = [] if self._dataset is None else ["--dataset", self._dataset]
        return flags if verify else [*flags, "--no-verify"]

    def __repr__(self) -> str:
        return f"Field({str(self.path)!r}: {self.method})"


def _poses(poses: Pose | Sequence[Pose]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Poses as they were given, and as (n, 4, 4); each is a rigid transform."""
    array = real(poses, "the poses are")
    if array.size == 0:
        return array, np.empty((0, 4, 4))
    if array.shape[-2:] != (4, 4) or array.ndim not in (2, 3):
        raise CorfError(f"a pose has the shape (4, 4), and this has {array.shape}\n  help: give world_from_camera, one or several")
    several = array.reshape(-1, 4, 4)
    for i, pose in enumerate(several):
        fault = pose_fault(pose)
        if fault is not None:
            raise CorfError(f"pose {i}: {fault}\n  help: give world_from_camera, rotation and metres")
    return array, several


def _sigmoid(logit: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    with np.errstate(over="ignore"):
        return (1 / (1 + np.exp(-logit.astype(np.float64)))).astype(np.float32)


def _read(out: Path, index: int, pose: Pose) -> Rendering:
    """View `index` of a folder that `corf render` wrote."""

    def picture(folder: str) -> npt.NDArray[np.uint8] | None:
        file = out / folder / f"{index + 1:05}.png"
        return read_png(file) if file.exists() else None

    def values(folder: str) -> npt.NDArray[np.float32] | None:
        file = out / folder / f"{index + 1:05}.exr"
        return read_exr(file, "Y") if file.exists() else None

    return Rendering(pose, picture("images"), values("depth"), values("linear"), values("db"), picture("jet"))
