"""Spectra as a data set has them, with all that sampling for spectra alone does (more directions where they matter, chance for what is weak,
outliers cut, sparse behind the array), beside maps formed here from arrivals that `corf diffuse` gathers all around alike."""

import json
from pathlib import Path

import mitsuba as mi
import numpy as np

from . import meshes, spectrum
from .environment import refuse

WIDTH, HEIGHT = 96, 64
# A data set's trajectory is in float64, receivers here are float32.
SAME_PLACE_M = 1e-5


def spectra(depth, directions):
    """`[rf]` of `bartlett` spectra."""
    return (
        f'width = {WIDTH}\nheight = {HEIGHT}\nspectrum = "bartlett"\nmax_interactions = {depth}\ndirections = {directions}\nphotons = 3000000\n'
    )


def generate(corf, scene, folder, receivers, depth, directions):
    """Has `corf` make the data set; returns its spectra, linear (height, width), and per pixel the direction in the array's frame."""
    folder = Path(folder)
    folder.mkdir(parents=True)
    described = meshes.dataset_text(len(receivers), Path(scene).resolve().as_posix(), spectra(depth, directions))
    (folder / "check.toml").write_text(described)
    data = folder / "data"
    corf.run("dataset", "generate", folder / "check.toml", "--out", data)
    keyframes = json.loads((data / "trajectory.json").read_text())["keyframes"]
    places = np.array([k["world_from_camera"] for k in keyframes])[:, :3, 3]
    if np.abs(places - receivers).max() > SAME_PLACE_M:
        refuse(f"the data set's keyframes are not at the exported poses: {places.tolist()}")
    camera = json.loads((data / "dataset.json").read_text())["header"]["rf_camera"]
    maps = [np.array(mi.Bitmap(str(data / "rf/spectra" / f"{k['file']}.exr"))).reshape(HEIGHT, WIDTH) for k in keyframes]
    return [m.astype(float) for m in maps], pixels(camera)


def pixels(camera):
    """Unit directions of pixel centres in the array's frame: x forward, y left, z up."""
    u, v = np.meshgrid(np.arange(camera["width"]) + 0.5, np.arange(camera["height"]) + 0.5)
    d = np.stack([np.ones_like(u), (camera["cx"] - u) / camera["fx"], (camera["cy"] - v) / camera["fy"]], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def beside(found, towards, samplings):
    """A data set's map beside those of samplings of the covariance, as `report.map_difference` takes them."""
    formed = np.array([spectrum.bartlett(c, towards) for c in samplings])
    return {
        "ours": found,
        "ours_error": np.zeros_like(found),
        "theirs": formed.mean(0),
        "theirs_error": formed.std(0, ddof=1) / len(formed) ** 0.5,
    }
