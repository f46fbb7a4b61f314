"""corf's side: the command, run as a user runs it."""

import json
import tempfile
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

from sionna_live.command import Command

# How a configuration asks for unbiased paths.
UNBIASED = 'method = "path"'
# The radio half of a dataset, as little of it as there can be.
LITTLE_RADIO = """[rf]
width = 8
height = 8
max_interactions = 1
transmission = false
diffuse = false
directions = 100
photons = 1000
rays = 2000
"""


class Corf(Command):
    """The `corf` command."""

    def export(self, room, folder):
        """`corf scene export --to mitsuba` of a room's views; returns the command's summary."""
        with tempfile.TemporaryDirectory() as scratch:
            config = room.dataset(Path(scratch) / "views.toml", 1, 0, UNBIASED, LITTLE_RADIO)
            out = self.run("--json", "scene", "export", room.scene, "--to", "mitsuba", "--out", folder, "--poses", config)
        return json.loads(out)

    def render(self, room, samples, seed):
        """Linear radiance of all views, (views, height, width, 3) float64, and the seconds of the whole command."""
        with tempfile.TemporaryDirectory() as scratch:
            scratch = Path(scratch)
            config = room.dataset(scratch / "views.toml", samples, seed, UNBIASED, LITTLE_RADIO)
            begin = time.perf_counter()
            self.run("dataset", "generate", config, "--out", scratch / "views")
            seconds = time.perf_counter() - begin
            files = sorted((scratch / "views/optical/linear").glob("*.exr"))
            images = [
                np.array(mi.Bitmap(str(f)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32), dtype=np.float64)
                for f in files
            ]
        return np.stack(images), seconds
