"""Makes the pictures of the documents anew: docs/pictures, and pictures.json there, which says of each what it shows.

    cargo build --release
    python -m venv .venv && .venv/bin/pip install pillow
    .venv/bin/python tools/pictures.py target/release/corf [--only NAME ...]       (needs Chromium; a few minutes on two cores)

Every picture is what a command made, or a page of it as a browser draws it. pictures.json keeps the hash of the files that decide what is seen (scenes,
the viewer's page): test_tools.py fails where one of them has changed and the picture has not.
"""

import argparse
import base64
import hashlib
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from check_view import Browser

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "docs/pictures"
LOBBY = ["scenes/lobby.toml", "scenes/lobby.glb"]
MINI = [*LOBBY, "scenes/lobby-mini.toml"]
ROOM = ["scenes/room.toml", "scenes/room.obj", "scenes/room.mtl", "scenes/room-mini.toml"]
VIEWER = "crates/bench/src/viewer/assets"
# Widest that a picture is in the documents, pixels.
WIDTH = 1000


def opened(file):
    """A picture's pixels."""
    from PIL import Image

    return Image.open(file).convert("RGB")


class Maker:
    """Runs the command in a scratch folder; what several pictures need is made once."""

    def __init__(self, corf, scratch):
        self.corf, self.scratch, self.made = Path(corf).resolve(), Path(scratch), {}

    def run(self, *arguments):
        """The command, from the root of the repository."""
        done = subprocess.run([str(self.corf), *map(str, arguments)], cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            sys.exit(f"corf {' '.join(map(str, arguments))}: exit code {done.returncode}\n{done.stderr}")

    def once(self, name, *arguments):
        """The folder that a command writes with --out."""
        folder = self.scratch / name
        if name not in self.made:
            self.run(*arguments, "--out", folder)
            self.made[name] = folder
        return folder

    def room(self):
        """A data set of the plain room at small size."""
        small = ["--set", "optical.width=192", "--set", "optical.height=108"]
        return self.once("room", "dataset", "generate", "scenes/room-mini.toml", "--device", "cpu", *small)

    def demo(self):
        """The folder of the demo."""
        return self.once("demo", "demo", "--device", "cpu")

    def photograph(self, page, size, ready):
        """A page as a browser without a screen draws it, once an expression in it is true."""
        program = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)
        if program is None:
            sys.exit("no Chromium on PATH\n  help: apt install chromium")
        browser = Browser(program)
        try:
            browser.open(page.resolve().as_uri())
            browser.ask("Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False)
            end = time.monotonic() + Browser.PATIENCE_S
            while not browser.evaluate(f"document.readyState === 'complete' && ({ready})"):
                if time.monotonic() > end:
                    sys.exit(f"{page} was not ready within {Browser.PATIENCE_S} s")
                time.sleep(0.2)
            # What was asked for last is drawn in a frame or two.
            time.sleep(2)
            shot = self.scratch / "shot.png"
            shot.write_bytes(base64.b64decode(browser.ask("Page.captureScreenshot", format="png")["data"]))
        finally:
            browser.quit()
        return opened(shot)


def view(maker):
    wide = ["optical.width=1200", "optical.height=675", "way=[0.3, 0.31]", "rf.diffuse=false", "optical.effort=2"]
    sets = [part for key in wide for part in ("--set", key)]
    folder = maker.once("view", "dataset", "generate", "scenes/lobby147.toml", "--keyframes", 1, "--device", "cpu", *sets)
    return opened(next((folder / "optical/images").glob("*.png")))


def scene_new(maker):
    file = maker.scratch / "new" / "room.toml"
    file.parent.mkdir()
    maker.run("scene", "new", "scenes/lobby.glb", "--out", file)
    return opened(file.with_name("room-preview.png"))


def spectrum(maker):
    folder = maker.once("spectra", "spectrum", "scenes/lobby.toml", "--rx", "7,4,1.6", "--kind", "mpc,bartlett")
    return folder / "mpc.svg"


def coverage(maker):
    folder = maker.once("map", "coverage", "scenes/lobby.toml", "--height", 1.6)
    return opened(next(folder.glob("*.png")))


def evaluated(maker):
    run = maker.once(
        "run", "reconstruct", maker.demo() / "dataset", "--device", "cpu", "--evaluate-every", 5, "--protocol", "validation"
    )
    return run


def keyframe(maker):
    figure = maker.scratch / "keyframe.svg"
    maker.run("evaluate", evaluated(maker), "--figure", figure)
    return figure


def quality(maker):
    return evaluated(maker) / "quality.svg"


def held_out(maker):
    """The first picture of the README: a keyframe at four times the pixels of lobby-mini, with less grain."""
    sets = ["optical.width=384", "optical.height=216", "optical.effort=2"]
    dataset = maker.once("large", "dataset", "generate", "scenes/lobby-mini.toml", *(part for key in sets for part in ("--set", key)))
    run = maker.once("large-run", "reconstruct", dataset, "--method", "corf-gs-quality", "--device", "cpu")
    figure = maker.scratch / "held-out.svg"
    maker.run("evaluate", run, "--figure", figure)
    width, height = (math.ceil(float(re.search(rf'<svg[^>]* {side}="([0-9.]+)"', figure.read_text())[1])) for side in ("width", "height"))
    return maker.photograph(figure, (width, height), "true")


def latency(maker):
    live, run = maker.scratch / "live", maker.scratch / "live-run"
    dataset = maker.room()
    follow = [str(maker.corf), "reconstruct", "--follow", str(live), "--out", str(run), "--device", "cpu"]
    with subprocess.Popen(follow, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as reconstruction:
        try:
            maker.run("dataset", "play", dataset, "--to", live, "--rate", 3)
            said = reconstruction.communicate()[1]
        finally:
            reconstruction.kill()
    if reconstruction.returncode != 0:
        sys.exit(f"{' '.join(follow)}: exit code {reconstruction.returncode}\n{said}")
    return run / "latency.svg"


def uncertainty(maker):
    """Intervals fitted on validation keyframes, at a test keyframe."""
    dataset = maker.demo() / "dataset"
    calibration, figure = maker.scratch / "calibration.json", maker.scratch / "uncertainty.svg"
    fitted, judged = (maker.once(f"run-{p}", "reconstruct", dataset, "--device", "cpu", "--protocol", p) for p in ("validation", "test"))
    maker.run("uncertainty", "fit", fitted, "--device", "cpu", "--out", calibration)
    maker.run("uncertainty", "check", judged, "--device", "cpu", "--calibration", calibration, "--figure", figure)
    return figure


def viewer(maker):
    return maker.photograph(maker.demo() / "viewer.html", (1400, 800), "document.getElementById('message')?.textContent === ''")


def report(maker):
    return maker.photograph(maker.demo() / "report.html", (1100, 1400), "true")


# Picture: how it is made, and which files decide what it shows.
PICTURES = {
    "view.jpg": (view, LOBBY),
    "scene-new.jpg": (scene_new, ["scenes/lobby.glb"]),
    "spectrum.svg": (spectrum, LOBBY),
    "coverage.jpg": (coverage, LOBBY),
    "keyframe.svg": (keyframe, MINI),
    "quality.svg": (quality, MINI),
    "held-out.jpg": (held_out, MINI),
    "latency.svg": (latency, ROOM),
    "uncertainty.svg": (uncertainty, MINI),
    "viewer.jpg": (viewer, [*MINI, VIEWER]),
    "report.jpg": (report, [*MINI, "scenes/demo.toml"]),
}


def digest(names):
    """SHA-256 of some files of the repository, of folders all files in the order of their names."""
    total = hashlib.sha256()
    for name in names:
        path = ROOT / name
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            total.update(file.read_bytes())
    return total.hexdigest()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("corf", help="the program")
    parser.add_argument("--only", nargs="+", choices=PICTURES, default=list(PICTURES), help="which pictures (default: all)")
    args = parser.parse_args()
    OUT.mkdir(exist_ok=True)
    index = OUT / "pictures.json"
    entries = json.loads(index.read_text()) if index.exists() else {}
    with tempfile.TemporaryDirectory() as scratch:
        maker = Maker(args.corf, scratch)
        for name in args.only:
            make, shows = PICTURES[name]
            made = make(maker)
            if isinstance(made, Path):
                shutil.copyfile(made, OUT / name)
            else:
                made.thumbnail((WIDTH, 4 * WIDTH))
                made.save(OUT / name, quality=85, optimize=True)
            entries[name] = {"shows": shows, "sha256": digest(shows)}
            print(f"{name}: {(OUT / name).stat().st_size // 1024} KiB", flush=True)
    index.write_text(json.dumps({name: entries[name] for name in PICTURES if name in entries}, indent=1) + "\n")


if __name__ == "__main__":
    main()
