"""The viewer's page draws what `corf render` draws: both fields, at keyframes' own poses and cameras, in headless Chromium.

    python3 tools/check_view.py runs/a --corf target/release/corf [--dataset data/mini] [--keyframes 1,17] [--controls]

Exports the run's page, opens it with the network shut off (`#keyframe=N&mode=optical|rf&bare=1`, where the page puts its canvas into an attribute), and
compares the canvas with the images that `corf render` writes for the same poses, in 8 bits. What differs is rounding: harmonics in half precision, blending
in half-precision frame buffers from far to near instead of single precision from near to far.

`--controls` breaks what the comparison rests on and insists that it notices: opacity that does not make up for the pixel filter, colours of the lowest
harmonic alone, the picture of the keyframe beside.

Nothing but Python and a Chromium is needed. Exit code 0: everything agrees; 1: something does not; 2: bad input.
"""

import argparse
import base64
import fcntl
import json
import math
import os
import shutil
import struct
import subprocess
import tempfile
import time
import zlib
from pathlib import Path

from ending import end_with

# A root mean square error of one 8-bit step; the controls lie below 31 dB.
LEAST_DB = 48.13
FIELDS = {"optical": "images", "rf": "jet"}
BROWSERS = ["chromium", "chromium-browser", "google-chrome", "chrome"]


def decode_png(data):
    """Width, height and RGB bytes of a PNG of 8 bits, RGB or RGBA, not interlaced."""
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError("this is no PNG")
    at, body, header = 8, b"", None
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, chunk = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", chunk)
        elif kind == b"IDAT":
            body += chunk
        at += 12 + length
    width, height, depth, colour, _, _, interlaced = header
    channels = {2: 3, 6: 4}.get(colour)
    if depth != 8 or channels is None or interlaced:
        raise ValueError(f"a PNG of {depth} bits and colour type {colour} is not read here")
    raw, stride = zlib.decompress(body), width * channels
    above, rows = bytearray(stride), []
    for y in range(height):
        filtered, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for x in range(stride):
            left = line[x - channels] if x >= channels else 0
            corner = above[x - channels] if x >= channels else 0
            line[x] = (line[x] + predicted(filtered, left, above[x], corner)) & 255
        rows.append(line)
        above = line
    pixels = b"".join(bytes(row) for row in rows)
    if channels == 4:
        pixels = bytes(v for i, v in enumerate(pixels) if i % 4 != 3)
    return width, height, pixels


def predicted(kind, left, above, corner):
    """What a PNG's filter adds to a byte."""
    if kind == 4:
        guess = left + above - corner
        distances = abs(guess - left), abs(guess - above), abs(guess - corner)
        return (left, above, corner)[distances.index(min(distances))]
    return (0, left, above, (left + above) // 2)[kind]


def psnr(a, b):
    """Peak signal-to-noise ratio of two pictures of 8 bits, dB."""
    if a[:2] != b[:2]:
        raise ValueError(f"{a[0]}x{a[1]} pixels beside {b[0]}x{b[1]}")
    error = sum((x - y) ** 2 for x, y in zip(a[2], b[2])) / len(a[2])
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


class Browser:
    """A headless Chromium without a network, spoken to through a pipe (the DevTools protocol: JSON with a null byte behind)."""

    PATIENCE_S = 300
    # Which names lead anywhere.
    RULES = "MAP * ~NOTFOUND"

    def __init__(self, program):
        self.profile = tempfile.TemporaryDirectory()
        flags = ["--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        flags += ["--remote-debugging-pipe", f"--host-resolver-rules={self.RULES}", f"--user-data-dir={self.profile.name}", "about:blank"]
        (theirs, self.to), (self.out, answers) = os.pipe(), os.pipe()
        # Its end of the pipe is file descriptors 3 and 4; the first two calls keep them from being overwritten by each other.
        high = [os.dup(theirs), os.dup(answers)]
        spare = [fcntl.fcntl(fd, fcntl.F_DUPFD, 20) for fd in high]

        def connect():
            os.dup2(spare[0], 3)
            os.dup2(spare[1], 4)

        quiet = subprocess.DEVNULL
        self.process = subprocess.Popen([program, *flags], stdout=quiet, stderr=quiet, pass_fds=(3, 4), preexec_fn=connect)
        for fd in [theirs, answers, *high, *spare]:
            os.close(fd)
        self.rest, self.number, self.session = b"", 0, None

    def ask(self, method, **parameters):
        """The result of a command."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                part = os.read(self.out, 1 << 20)
                if not part:
                    raise ValueError("the browser has ended")
                self.rest += part
            text, self.rest = self.rest.split(b"\0", 1)
            answer = json.loads(text)
            self.heard(answer)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise ValueError(f"{method}: {answer['error']['message']}")
                return answer["result"]

    def heard(self, answer):
        """Takes note of what the browser says, asked or not."""

    def open(self, url):
        """A fresh page."""
        self.session = None
        target = self.ask("Target.createTarget", url=url)["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return target

    def evaluate(self, expression):
        """The value of an expression in the page."""
        return self.ask("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def close(self, target):
        self.session = None
        self.ask("Target.closeTarget", targetId=target)

    def picture(self, page, fragment):
        """The canvas of a page that was opened with a fragment."""
        target = self.open(f"{page.resolve().as_uri()}#{fragment}")
        end = time.monotonic() + self.PATIENCE_S
        while time.monotonic() < end:
            error, capture = self.evaluate("[document.body?.dataset.error, document.body?.dataset.capture]") or (None, None)
            if error:
                raise ValueError(f"the page says: {error}")
            if capture:
                self.close(target)
                return decode_png(base64.b64decode(capture.partition(",")[2]))
            time.sleep(0.2)
        raise ValueError(f"the page drew nothing within {self.PATIENCE_S} s")

    def quit(self):
        self.process.terminate()
        self.process.wait()
        os.close(self.to)
        os.close(self.out)
        self.profile.cleanup()


def changed(page, folder, changes):
    """Copies of a page, each with one thing replaced: names with the copies. A change is its name, the text before and the text after."""
    text = page.read_text()
    for name, before, after in changes:
        if text.count(before) != 1:
            raise ValueError(f"the page does not hold {before} once")
        copy = folder / f"{name.replace(' ', '-').replace(chr(39), '')}.html"
        copy.write_text(text.replace(before, after))
        yield name, copy


# What makes a page draw otherwise than corf does.
BROKEN = [
    ("uncompensated", '"compensated":true', '"compensated":false'),
    ("lowest harmonic alone", "k < coefficients;", "k < 1;"),
]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("run", type=Path, help="run folder of a method that leaves Gaussians")
    arguments.add_argument("--corf", default="target/release/corf", help="the program")
    arguments.add_argument("--dataset", help="the run's data set, if it has moved")
    arguments.add_argument("--keyframes", default="", help="numbers from 1, with commas between (default: the first and one in the middle)")
    arguments.add_argument("--least-db", type=float, default=LEAST_DB, help="least PSNR that is agreement")
    arguments.add_argument("--browser", default=next((b for b in BROWSERS if shutil.which(b)), None), help="Chromium")
    arguments.add_argument("--out", type=Path, help="keep the page and the renderings in this folder")
    arguments.add_argument("--controls", action="store_true", help="check as well that broken pages are noticed")
    given = arguments.parse_args()
    if not given.browser:
        raise ValueError("no Chromium was found; name one with --browser")
    info = json.loads((given.run / "run.json").read_text())
    dataset = Path(given.dataset or info["dataset"])
    poses = json.loads((dataset / "trajectory.json").read_text())["keyframes"]
    numbers = [int(n) for n in given.keyframes.split(",") if n] or [1, len(poses) // 2]
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        page, views, chosen = folder / "view.html", folder / "views", folder / "poses.json"
        elsewhere = ["--dataset", str(dataset)] if given.dataset else []
        subprocess.run([given.corf, "view", str(given.run), "--export", str(page), *elsewhere], check=True)
        # One pose more than asked for: the keyframe beside the first is the picture that must not match.
        beside = numbers[0] + 1 if numbers[0] < len(poses) else numbers[0] - 1
        chosen.write_text(json.dumps([poses[n - 1]["world_from_camera"] for n in [*numbers, beside]]))
        subprocess.run([given.corf, "render", str(given.run), "--poses", str(chosen), "--out", str(views), *elsewhere], check=True)
        browser = Browser(given.browser)
        try:
            failures = compare(browser, given, page, views, numbers, folder)
        finally:
            browser.quit()
    return 1 if failures else 0


def compare(browser, given, page, views, numbers, folder):
    """Prints every comparison; the number of those that do not come out."""
    failures = 0

    def tell(what, value, good):
        nonlocal failures
        failures += not good
        print(f"{what:<58} {value:6.2f} dB  {'ok' if good else 'NOT AS IT SHOULD BE'}", flush=True)

    def rendering(place, field):
        path = views / FIELDS[field] / f"{place + 1:05d}.png"
        return decode_png(path.read_bytes()) if path.exists() else None

    compared = 0
    for field in FIELDS:
        for place, number in enumerate(numbers):
            truth = rendering(place, field)
            if truth is None:
                continue
            drawn = browser.picture(page, f"keyframe={number}&mode={field}&bare=1")
            value = psnr(drawn, truth)
            tell(f"keyframe {number}, {field}, {truth[0]}x{truth[1]}", value, value >= given.least_db)
            compared += 1
            if given.controls and place == 0:
                other = psnr(drawn, rendering(len(numbers), field))
                tell(f"control: {field}, beside the keyframe next to it", other, other < given.least_db)
    if not compared:
        raise ValueError("corf render wrote no picture to compare with")
    for name, copy in changed(page, folder, BROKEN) if given.controls else []:
        worst = min(
            psnr(browser.picture(copy, f"keyframe={numbers[0]}&mode={field}&bare=1"), rendering(0, field))
            for field in FIELDS
            if rendering(0, field)
        )
        tell(f"control: {name}", worst, worst < given.least_db)
    return failures


if __name__ == "__main__":
    end_with(main)
