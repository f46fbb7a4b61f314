"""Digests of what the program computes, so that code can be moved and shown to compute the same.

    python3 tools/digests.py --corf target/release/corf > before.txt     # … move code, build …
    python3 tools/digests.py --corf target/release/corf | diff before.txt -

Paths of the lobby (with transmission, diffraction and diffuse power) in every format, spectra of all kinds, a coverage map, a small data set of
lobby-mini's room with both modalities and one of beams, a short reconstruction by every method with what it keeps on disk, the table of their plan, every
export of scenes, data sets and fields, an import, and the viewer's pages. What depends on the clock, the machine or the folder is left out.
Needs nothing but Python and a built `corf`; some three minutes on two cores. Digests hold on one machine with one version of the compiler.
Where the ray tracer was changed on purpose, every data set and all that is made of it differ; `--data-corf BEFORE` has the build of before make the data
sets, so that what else has changed is seen.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
# Keys of JSON files that say when, where or how fast, not what.
# Points of a curve are taken where the clock says, by methods that work in steps.
VOLATILE = {"seconds", "curve", "peak_memory_bytes", "peak_device_memory_bytes", "provenance", "device", "latency", "elapsed_s", "threads", "dataset", "dataset_hash", "keyframes_per_s"}
# A row's settings are those of a quick run that still goes through every part of the method: growth, density control, both stages.
ONLINE = "iterations_per_keyframe = 30"
OFFLINE = """optical_steps = 160
rf_steps = 60
density = { from = 40, every = 20, reset_every = 90, until = 140 }"""
RAYS = """rays = 64
samples = 8
width = 16
frequencies = 4
iterations = 40"""
DEFORMED = """random_points = 600
width = 16
layers = 3
skip = 1
iterations = 60
density = { from = 10, every = 10, reset_every = 35, until = 50, prune_fraction = 5.0 }"""
METHODS = {
    "corf-gs": "",
    "corf-gs-paper": ONLINE,
    "corf-gs-fast": "",
    "corf-gs-live": "",
    "corf-gs-quality": ONLINE + "\nfine_tune_epochs = 3",
    "corf-gs-uniform": ONLINE,
    "corf-gs-frozen": ONLINE,
    "corf-gs-rf-tuned": ONLINE,
    "corf-array": "light.iterations_per_keyframe = 30",
    "rf-3dgs": OFFLINE,
    "rf-3dgs-corrected": OFFLINE,
    "rf-3dgs-fresh-moments": OFFLINE,
    "rf-3dgs-floor": OFFLINE,
    "nerf2": RAYS,
    "nerf2-corrected": RAYS,
    "wrf-gs-plus": DEFORMED,
    "wrf-gs-plus-corrected": DEFORMED,
    "nearest": "",
    "inverse-distance": "",
}
# What a run leaves that says when or how fast, line by line, and not what.
LOGS = {"log.jsonl", "report.html", "table.md", "table.csv", "table.tex"}


def settled(value):
    """The value without what changes from run to run."""
    if isinstance(value, dict):
        return {k: settled(v) for k, v in value.items() if k not in VOLATILE and not k.endswith("_s")}
    if isinstance(value, list):
        return [settled(v) for v in value]
    return value


def digest(path):
    data = path.read_bytes()
    if path.suffix == ".json":
        data = json.dumps(settled(json.loads(data)), sort_keys=True).encode()
    return hashlib.sha256(data).hexdigest()[:16]


class Digests:
    def __init__(self, corf, data_corf, scratch):
        self.corf, self.data_corf, self.scratch = corf, data_corf, scratch

    def run(self, *arguments, corf=None):
        done = subprocess.run([corf or self.corf, *map(str, arguments)], capture_output=True, text=True, cwd=REPOSITORY)
        if done.returncode not in (0, 1):
            raise SystemExit(f"corf {' '.join(map(str, arguments))} ended with {done.returncode}:\n{done.stderr}")
        return done.stdout

    def every_method_has_a_row(self):
        text = self.run("reconstruct", "--help")
        known = set(re.findall(r"^\s+- ([a-z0-9-]+):", text[text.index("--method <") : text.index("--set <")], re.M))
        if known != set(METHODS):
            raise SystemExit(f"METHODS of tools/digests.py and those of the program differ by {', '.join(sorted(known ^ set(METHODS)))}")

    def say(self, what, path):
        print(f"{digest(path)}  {what}", flush=True)

    def folder(self, what, folder):
        files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in LOGS)
        if not files:
            raise SystemExit(f"{what}: {folder} holds no file")
        for file in files:
            self.say(f"{what}: {file.relative_to(folder)}", file)

    def paths(self):
        links = ["paths", "scenes/lobby.toml", "--rx", "7,4,1.6", "--rx", "3.2,6.1,1.4"]
        out = self.scratch / "paths.json"
        for name, extra in [("depth 3", []), ("diffraction", ["--diffraction", "--depth", "2"])]:
            self.run(*links, "--out", out, *extra)
            self.say(f"paths of the lobby, {name}", out)
        for form, ending in [("sionna", ".json"), ("npz", ".npz"), ("deepmimo", "")]:
            out = self.scratch / f"paths-{form}{ending}"
            self.run("paths", "scenes/room.toml", "--rx", "2,2,1.6", "--depth", "2", "--format", form, "--out", out)
            if out.is_dir():
                self.folder(f"paths of the room, {form}", out)
            else:
                self.say(f"paths of the room, {form}", out)
        out = self.scratch / "diffuse.json"
        out.write_text(self.run("diffuse", "scenes/lobby.toml", "--rx", "7,4,1.6", "--json"))
        self.say("diffuse power of the lobby", out)

    def spectra(self):
        out = self.scratch / "spectra"
        kinds = "mpc,bartlett,bartlett-coherent,mvdr"
        self.run("spectrum", "scenes/lobby.toml", "--rx", "7,4,1.6", "--kind", kinds, "--out", out)
        self.folder("spectrum", out)

    def coverage(self):
        out = self.scratch / "coverage"
        self.run("coverage", "scenes/room.toml", "--height", "1.6", "--cell", "0.5", "--out", out)
        self.folder("coverage", out)

    def scene_exports(self):
        for form in ["sionna", "mitsuba"]:
            out = self.scratch / f"scene-{form}"
            self.run("scene", "export", "scenes/room.toml", "--to", form, "--poses", "2", "--out", out)
            self.folder(f"scene export to {form}", out)

    def dataset(self, name, scene, edits, extra=""):
        """A data set by a configuration of `scenes/` with replacements, and lines at its end."""
        text = (REPOSITORY / f"scenes/{name}.toml").read_text()
        text = text.replace(f'"{scene}.toml"', json.dumps(str(REPOSITORY / f"scenes/{scene}.toml")))
        for before, after in edits:
            if before not in text:
                raise SystemExit(f"scenes/{name}.toml has no {before}")
            text = text.replace(before, after)
        config = self.scratch / f"{name}-small.toml"
        config.write_text(f"{text}\n{extra}\n")
        out = self.scratch / f"{name}-small"
        self.run("dataset", "generate", config, "--out", out, corf=self.data_corf)
        for file in ["optical/images/00003.png", "optical/depth/00003.exr", "rf/images/00003.png", "rf/spectra/00003.exr", "trajectory.json"]:
            self.say(f"{name}: {file}", out / file)
        # A SHA-256 of every file is among this one's keys.
        files = json.dumps(json.loads((out / "dataset.json").read_text())["files"], sort_keys=True)
        print(f"{hashlib.sha256(files.encode()).hexdigest()[:16]}  {name}: all its files", flush=True)
        return out

    def comparison(self, name, dataset, rows):
        """Every row reconstructs, is measured, and keeps its model; returns the comparison's folder."""
        plan = self.scratch / f"{name}.toml"
        body = "".join(
            f'[[row]]\nlabel = "{m}"\nmethod = "{m}"\nkeep_model = true\n' + (f"[row.config]\n{c}\n" if c else "") for m, c in rows.items()
        )
        plan.write_text(f'name = "{name}"\ndataset = {json.dumps(str(dataset))}\nsegment = true\nseeds = [1]\n{body}')
        out = self.scratch / name
        self.run("bench", "run", plan, "--device", "cpu", "--out", out)
        self.folder(name, out)
        return out

    def exports(self, dataset, run):
        for form in ["numpy", "nerfstudio", "rf-3dgs"]:
            out = self.scratch / f"dataset-{form}"
            self.run("dataset", "export", dataset, "--to", form, "--out", out)
            self.folder(f"dataset export to {form}", out)
        for form in ["ply", "splat", "spz", "sog-ready-ply"]:
            for field in ["optical", "rf"]:
                out = self.scratch / f"{field}.{form}"
                self.run("field", "export", run, "--to", form, "--field", field, "--out", out)
                self.say(f"field export of {field} to {form}", out)
        views = self.scratch / "views"
        self.run("render", run, "--poses", dataset / "trajectory.json", "--device", "cpu", "--out", views)
        self.folder("render", views)
        for name, folder in [("field", run), ("dataset", dataset)]:
            page = self.scratch / f"{name}.html"
            self.run("view", folder, "--device", "cpu", "--export", page)
            self.say(f"the viewer's page of a {name}", page)

    def imported(self, dataset):
        out = self.scratch / "imported"
        spectra = ["--rf", dataset / "rf/spectra", "--rf-camera", "90", "--rf-quantity", "power-per-steradian", "--frequency-hz", "60e9"]
        self.run("dataset", "import", dataset / "optical", "--from", "colmap", *spectra, "--depth", dataset / "optical/depth", "--out", out)
        self.folder("dataset import", out)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--corf", default=os.path.join(os.environ.get("CARGO_TARGET_DIR", "target"), "release/corf"))
    parser.add_argument("--data-corf", help="the build that makes the data sets (default: that of --corf)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        digests = Digests(os.path.abspath(args.corf), os.path.abspath(args.data_corf or args.corf), Path(scratch))
        digests.every_method_has_a_row()
        digests.paths()
        digests.spectra()
        digests.coverage()
        digests.scene_exports()
        lobby = digests.dataset("lobby-mini", "lobby", [("keyframes = 40", "keyframes = 12")])
        comparison = digests.comparison("methods", lobby, METHODS)
        run = next(p.parent for p in sorted(comparison.rglob("run.json")) if json.loads(p.read_text())["method"] == "corf-gs")
        digests.exports(lobby, run)
        digests.imported(lobby)
        beams = digests.dataset("room-tiny", "room", [("keyframes = 24", "keyframes = 8")], 'spectrum = "bartlett"')
        digests.comparison("beams", beams, {"corf-array": METHODS["corf-array"]})


if __name__ == "__main__":
    main()
