"""Digests of what the program computes, so that code can be moved and shown to compute the same.

    python3 tools/digests.py --corf target/release/corf > before.txt     # … move code, build …
    python3 tools/digests.py --corf target/release/corf | diff before.txt -

Paths of the lobby (with transmission, diffraction and diffuse power), spectra of all kinds, a coverage map, a small data set of lobby-mini's room with
both modalities, a reconstruction of each method on it, and the table of a plan. What depends on the clock, the machine or the folder is left out.
Needs nothing but Python and a built `corf`; a minute or two on two cores. Digests hold on one machine with one version of the compiler.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
# Keys of JSON files that say when, where or how fast, not what.
VOLATILE = {"seconds", "peak_memory_bytes", "provenance", "device", "latency", "elapsed_s", "threads", "dataset", "dataset_hash", "keyframes_per_s"}
METHODS = ["corf-gs", "corf-gs-paper", "corf-gs-frozen", "corf-gs-uniform", "inverse-distance"]


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
    def __init__(self, corf, scratch):
        self.corf, self.scratch = corf, scratch

    def run(self, *arguments):
        done = subprocess.run([self.corf, *map(str, arguments)], capture_output=True, text=True, cwd=REPOSITORY)
        if done.returncode not in (0, 1):
            raise SystemExit(f"corf {' '.join(map(str, arguments))} ended with {done.returncode}:\n{done.stderr}")
        return done.stdout

    def say(self, what, path):
        print(f"{digest(path)}  {what}", flush=True)

    def folder(self, what, folder, suffixes):
        files = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix in suffixes)
        if not files:
            raise SystemExit(f"{what}: {folder} holds none of {', '.join(suffixes)}")
        for file in files:
            self.say(f"{what}: {file.relative_to(folder)}", file)

    def paths(self):
        out = self.scratch / "paths.json"
        for name, extra in [("depth 3", []), ("diffraction", ["--diffraction", "--depth", "2"])]:
            self.run("paths", "scenes/lobby.toml", "--rx", "7,4,1.6", "--rx", "3.2,6.1,1.4", "--out", out, *extra)
            self.say(f"paths of the lobby, {name}", out)
        out = self.scratch / "diffuse.json"
        out.write_text(self.run("diffuse", "scenes/lobby.toml", "--rx", "7,4,1.6", "--json"))
        self.say("diffuse power of the lobby", out)

    def spectra(self):
        out = self.scratch / "spectra"
        kinds = "mpc,bartlett,bartlett-coherent,mvdr"
        self.run("spectrum", "scenes/lobby.toml", "--rx", "7,4,1.6", "--kind", kinds, "--out", out)
        self.folder("spectrum", out, {".exr", ".png"})

    def coverage(self):
        out = self.scratch / "coverage"
        self.run("coverage", "scenes/room.toml", "--height", "1.6", "--cell", "0.5", "--out", out)
        self.folder("coverage", out, {".exr", ".json"})

    def dataset(self):
        text = (REPOSITORY / "scenes/lobby-mini.toml").read_text()
        scene = json.dumps(str(REPOSITORY / "scenes/lobby.toml"))
        text = text.replace('"lobby.toml"', scene).replace("keyframes = 40", "keyframes = 12")
        config = self.scratch / "tiny.toml"
        config.write_text(text)
        out = self.scratch / "tiny"
        self.run("dataset", "generate", config, "--out", out)
        for name in ["optical/images/00003.png", "optical/depth/00003.exr", "rf/images/00003.png", "rf/spectra/00003.exr", "trajectory.json"]:
            self.say(f"dataset: {name}", out / name)
        # A SHA-256 of every file is among this one's keys.
        files = json.dumps(json.loads((out / "dataset.json").read_text())["files"], sort_keys=True)
        print(f"{hashlib.sha256(files.encode()).hexdigest()[:16]}  dataset: all its files")
        return out

    def reconstructions(self, dataset):
        plan = self.scratch / "plan.toml"
        rows = "".join(f'[[row]]\nlabel = "{m}"\nmethod = "{m}"\n' for m in METHODS)
        plan.write_text(f'name = "digests"\ndataset = {json.dumps(str(dataset))}\nsegment = true\nseeds = [1]\n{rows}')
        out = self.scratch / "bench"
        self.run("bench", "run", plan, "--device", "cpu", "--out", out)
        self.folder("plan", out, {".json", ".png"})
        run = self.scratch / "run"
        self.run("reconstruct", dataset, "--method", "corf-gs", "--seed", 1, "--device", "cpu", "--out", run)
        self.folder("reconstruct", run, {".ply"})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--corf", default=os.path.join(os.environ.get("CARGO_TARGET_DIR", "target"), "release/corf"))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        digests = Digests(os.path.abspath(args.corf), Path(scratch))
        digests.paths()
        digests.spectra()
        digests.coverage()
        digests.reconstructions(digests.dataset())


if __name__ == "__main__":
    main()
