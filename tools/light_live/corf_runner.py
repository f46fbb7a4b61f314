"""corf's side: the command, run as a user runs it."""

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path

import mitsuba as mi
import numpy as np

from .environment import ROOT, refuse

# How a configuration asks for unbiased paths.
UNBIASED = 'method = "path"'
# The radio half of a dataset, as little of it as there can be.
LITTLE_RADIO = """[rf]
width = 8
height = 8
max_reflections = 1
transmission = false
diffuse = false
directions = 100
photons = 1000
rays = 2000
"""


class Corf:
    """The `corf` command."""

    def __init__(self, binary=None, threads=2):
        if binary is None:
            subprocess.run(["cargo", "build", "--release", "--quiet", "-p", "corf-bench"], cwd=ROOT, check=True)
            binary = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/corf"
        self.binary, self.threads = Path(binary).resolve(), threads
        if not self.binary.exists():
            refuse(f"{self.binary} does not exist\n  help: build it with cargo build --release, or give --corf PATH")

    def run(self, *arguments):
        """Runs the command; returns standard output."""
        call = [str(self.binary), *map(str, arguments), "--threads", str(self.threads)]
        done = subprocess.run(call, capture_output=True, text=True)
        if done.returncode != 0:
            refuse(f"{' '.join(call)}\n{done.stderr.strip()}")
        return done.stdout

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
