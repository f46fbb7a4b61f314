"""Mitsuba's side: an exported folder, loaded as it is or with the reflection model that corf documents, and rendered."""

import time
import xml.etree.ElementTree as ET
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from . import bsdf

# What Mitsuba looks through in shadow rays, which its plain path integrator does not.
SEEN_THROUGH = {"thindielectric", "mask"}
# Paths that are followed at once; a render is made of as many passes as that takes. Each pass is recorded anew, which a GPU would wait for.
MAX_WAVEFRONT = {"llvm": 2**23, "cuda": 2**27}


def coupled(element):
    """The element of an exported material with corf's own reflection in place of `principled`; others as they are."""
    kind = element.get("type")
    if kind == "mask":
        inner = element.find("bsdf")
        element.remove(inner)
        element.append(coupled(inner))
        return element
    if kind != "twosided":
        return element
    inner, extra = element.find("bsdf"), []
    if inner.get("type") == "normalmap":
        extra = [child for child in inner if child.get("name") == "normalmap"]
        inner = inner.find("bsdf")
    if inner.get("type") != "principled":
        return element
    surface = ET.Element("bsdf", {"type": bsdf.NAME})
    for child in [*inner, *extra]:
        if child.tag == "float" and child.get("name") == "eta":
            child = ET.Element("float", {"name": "ior", "value": child.get("value")})
        elif child.get("name") == "specular":
            child = ET.Element("float", {"name": "ior", "value": "1"})
        surface.append(child)
    return surface


class Theirs:
    """A folder of `corf scene export --to mitsuba`."""

    def __init__(self, folder, max_bounces, reflection):
        """`reflection`: `coupled` (corf's documented formulas) or `standard` (the exported plugins)."""
        tree = ET.parse(Path(folder) / "scene.xml")
        root = tree.getroot()
        if reflection == "coupled":
            for i, child in enumerate(list(root)):
                if child.tag == "bsdf":
                    name = child.get("id")
                    del child.attrib["id"]
                    changed = coupled(child)
                    changed.set("id", name)
                    root[i] = changed
        glass = any(child.get("type") in SEEN_THROUGH for child in root.iter("bsdf"))
        integrator = root.find("integrator")
        integrator.set("type", "volpath" if glass else "path")
        for value in integrator.iter("integer"):
            # Mitsuba counts the emitter's edge of a path as well.
            value.set("value", str(max_bounces + 1))
        ET.SubElement(integrator, "integer", {"name": "rr_depth", "value": "5"})
        path = Path(folder) / f"scene_{reflection}.xml"
        tree.write(path)
        self.scene = mi.load_file(str(path))
        self.integrator = self.scene.integrator()
        self.views = len(self.scene.sensors())

    def render(self, view, samples, seed):
        """Linear radiance of a view, (height, width, 3) float64, and the seconds it took."""
        sensor = self.scene.sensors()[view]
        width, height = sensor.film().size()
        each = max(1, min(samples, MAX_WAVEFRONT[mi.variant().split("_")[0]] // (width * height)))
        passes = -(-samples // each)
        begin = time.perf_counter()
        total = np.zeros((height, width, 3))
        for k in range(passes):
            image = mi.render(self.scene, sensor=view, integrator=self.integrator, spp=each, seed=seed * 1_000_003 + k)
            dr.eval(image)
            total += np.array(image, dtype=np.float64)[..., :3]
        return total / passes, time.perf_counter() - begin
