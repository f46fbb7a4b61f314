"""corf's side: the command, run as a user runs it."""

import json
import time
from pathlib import Path

import numpy as np

from .command import Command


def point(position):
    """A float32 position as the command takes it, exactly."""
    return ",".join(repr(float(c)) for c in position)


class Corf(Command):
    """The `corf` command."""

    def export(self, scene, folder, poses):
        """`corf scene export --to sionna`; returns radio.json."""
        self.run("scene", "export", scene, "--to", "sionna", "--out", folder, "--poses", poses)
        return json.loads((Path(folder) / "radio.json").read_text())

    def paths(self, scene, tx, receivers, depth, *options):
        """`corf paths` at every receiver: lists of paths, vertices as arrays, `a` as complex numbers."""
        places = [word for rx in receivers for word in ("--rx", point(rx))]
        found = json.loads(self.run("paths", scene, "--tx", point(tx), *places, "--depth", depth, *options))
        lists = [link["paths"] for link in found.get("links", [found])]
        for path in (path for paths in lists for path in paths):
            path["a"] = complex(*path["a"])
            path["vertices"] = np.array(path["vertices"], dtype=float).reshape(-1, 3)
        return lists

    def diffuse(self, scene, tx, receivers, depth, *options):
        """`corf diffuse` at all receivers: its report, and the seconds it took."""
        begin = time.perf_counter()
        places = [word for rx in receivers for word in ("--rx", point(rx))]
        text = self.run("diffuse", scene, "--tx", point(tx), *places, "--depth", depth, *options)
        return json.loads(text), time.perf_counter() - begin
