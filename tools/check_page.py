"""The viewer's page in a person's hands: what fingers do is what the mouse does, and how long a depth order takes. In headless Chromium.

    corf view runs/a --export a.html
    python3 tools/check_page.py a.html [--sort 200000] [--controls]

Touches and mouse are sent through the DevTools protocol, as a screen and a mouse would send them, and the view that they leave is compared: one finger
beside a drag, two fingers beside a Shift-drag, a pinch beside the distance that it must leave, a tap beside a click.

`--sort N` orders N Gaussians, drawn evenly in a room of 14 x 15 x 3 m, as seen from within, with the page's own sorter, and prints the milliseconds.
`--controls` breaks what fingers do and insists that it is noticed.

Nothing but Python and a Chromium is needed. Exit code 0: everything is as it should be; 1: something is not; 2: bad input.
"""

import argparse
import json
import math
import shutil
import tempfile
import time
from pathlib import Path

from check_view import BROWSERS, Browser, changed
from ending import end_with

# Hands are given the page's own objects.
START = "await new App(await source.json('scene'), source, asked).start();"
EXPOSED = "await (window.app = new App(await source.json('scene'), source, asked)).start();"
# Fingers are told of one after the other: the first one's way is a small pinch, which the second takes back, and a pan in between is of that size.
TOLERANCE_TWO = 0.05
SORTS = 41

SORT = """(() => {
  const n = %d, position = new Float32Array(3 * n), size = [14, 15, 3], sort = makeSorter(position), times = [];
  let state = 1;
  const random = () => (state = (1103515245 * state + 12345) %% 2147483648) / 2147483648;
  for (let i = 0; i < 3 * n; i++) position[i] = size[i %% 3] * random();
  let order, row, right = true;
  for (let k = 0; k < %d; k++) {
    const yaw = 2 * Math.PI * random(), [x, y] = [Math.cos(yaw), Math.sin(yaw)];
    row = [x, y, 0, -(x * 7 + y * 7.5)];
    const start = performance.now();
    order = sort(row, 0.01);
    times.push(performance.now() - start);
    const depth = (i) => Math.fround(row[0] * position[3 * i] + row[1] * position[3 * i + 1] + row[2] * position[3 * i + 2] + row[3]);
    for (let i = 1; i < order.length; i++) right = right && depth(order[i - 1]) >= depth(order[i]);
  }
  times.sort((a, b) => a - b);
  return { right, drawn: order.length, median: times[times.length >> 1], worst: times[times.length - 1] };
})()"""

# The middle of the pyramid of another keyframe, on the stage, where a tap and a click would both choose it.
PYRAMID = """(() => {
  const { view, overlay, views } = app, axes = axesOf(view), { page, place } = views[0];
  for (let i = 0; i < overlay.eyes.length; i++) {
    if (i === app.chosen) continue;
    const p = toCamera(axes, view.eye, overlay.eyes[i]);
    if (p[2] < 0.5) continue;
    const [u, v] = [page.fx * p[0] / p[2] + page.cx, page.fy * p[1] / p[2] + page.cy];
    if (u < 20 || v < 60 || u > place.width - 20 || v > place.height - 60) continue;
    const hit = overlay.hit(axes, view.eye, page, u, v);
    if (hit >= 0 && hit !== app.chosen) return [u + place.x, v + place.y, hit];
  }
  return null;
})()"""


class Hands:
    """Mouse and fingers on an open page."""

    def __init__(self, browser, page):
        self.browser = browser
        self.target = browser.open(page.resolve().as_uri() + "#keyframe=1&mode=optical&panel=0")
        browser.ask("Emulation.setDeviceMetricsOverride", width=640, height=480, deviceScaleFactor=1, mobile=False)
        browser.ask("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        end = time.monotonic() + Browser.PATIENCE_S
        while browser.evaluate("window.app?.controls?.distance && app.views?.length ? 1 : 0") != 1:
            error = browser.evaluate("document.body?.dataset.error")
            if error or time.monotonic() > end:
                raise ValueError(f"the page does not come up: {error}")
            time.sleep(0.1)
        # The page is laid out anew for this screen.
        while self.value("[innerWidth, app.at('lines').width]") != [640, 640]:
            time.sleep(0.1)
        box = self.value("(({ left, top, width, height }) => ({ left, top, width, height }))(app.at('lines').getBoundingClientRect())")
        self.left, self.top = box["left"], box["top"]
        self.middle = box["width"] / 2, box["height"] / 2

    def value(self, expression):
        text = self.browser.evaluate(f"JSON.stringify({expression})")
        return None if text is None else json.loads(text)

    def close(self):
        self.browser.close(self.target)

    def home(self):
        """Back to the first keyframe, with a distance of two metres."""
        self.browser.evaluate("app.choose(0); app.controls.distance = 2")

    def view(self):
        """Eye, yaw, pitch and the distance of what is turned around, once all that was sent has come: moves are told frame by frame."""
        frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        self.browser.ask("Runtime.evaluate", expression=frames, awaitPromise=True)
        return self.value("[...app.view.eye, app.view.yaw, app.view.pitch, app.controls.distance]")

    def mouse(self, way, modifiers=0):
        """A drag along places of the stage."""
        for i, (x, y) in enumerate(way):
            kind = "mousePressed" if i == 0 else "mouseMoved"
            self.browser.ask("Input.dispatchMouseEvent", type=kind, x=self.left + x, y=self.top + y, button="left", buttons=1, clickCount=1, modifiers=modifiers)
        x, y = way[-1]
        self.browser.ask("Input.dispatchMouseEvent", type="mouseReleased", x=self.left + x, y=self.top + y, button="left", clickCount=1, modifiers=modifiers)

    def touch(self, kind, *places, first=0):
        """An event of fingers that are numbered from `first` on; one that is lifted is the one named."""
        points = [{"x": self.left + x, "y": self.top + y, "id": first + i} for i, (x, y) in enumerate(places)]
        self.browser.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def fingers(self, *ways):
        """Fingers along places of the stage, all at once."""
        for i, places in enumerate(zip(*ways)):
            self.touch("touchStart" if i == 0 else "touchMove", *places)
        self.touch("touchEnd")


def way(start, step, count):
    """Places from a start on, even steps apart."""
    return [(start[0] + step[0] * k, start[1] + step[1] * k) for k in range(count + 1)]


def moved(a, b):
    """The greatest difference of two views."""
    return max(abs(x - y) for x, y in zip(a, b))


def one_finger(hands, around):
    """How far a finger's view is from the mouse's after the same drag."""
    hands.browser.evaluate(f"app.controls.around = {json.dumps(around)}")
    path, views = way(hands.middle, (11, 4), 9), []
    for drag in (hands.mouse, hands.fingers):
        hands.home()
        before = hands.view()
        drag(path)
        views.append(hands.view())
        if moved(before, views[-1]) < 0.05:
            return math.inf
    hands.browser.evaluate("app.controls.around = true")
    return moved(*views)


def two_fingers(hands):
    """How far two fingers side by side are from a Shift-drag, as a share of its way."""
    x, y = hands.middle
    hands.home()
    before = hands.view()
    hands.mouse(way((x, y), (8, 5), 10), modifiers=8)
    shifted = hands.view()
    hands.home()
    hands.fingers(way((x - 60, y), (8, 5), 10), way((x + 60, y), (8, 5), 10))
    return moved(hands.view(), shifted) / max(1e-9, moved(before, shifted))


def pinch(hands, ratio):
    """How far the distance is from what a pinch must leave, as a share of it; infinite where the head was turned or the way is not straight ahead."""
    x, y = hands.middle
    hands.home()
    before = hands.view()
    steps, first = 10, 60
    spread = [first * ratio ** (k / steps) for k in range(steps + 1)]
    hands.fingers([(x - s, y) for s in spread], [(x + s, y) for s in spread])
    after = hands.view()
    ahead = before[5] - after[5]
    forward = [math.cos(before[4]) * math.cos(before[3]), math.cos(before[4]) * math.sin(before[3]), math.sin(before[4])]
    straight = max(abs(after[k] - before[k] - forward[k] * ahead) for k in range(3))
    if moved(before[3:5], after[3:5]) > 1e-9 or straight > TOLERANCE_TWO * abs(ahead):
        return math.inf
    return abs(after[5] - before[5] / ratio) / before[5]


def lifted(hands):
    """How far the view goes when one of two fingers leaves and the other goes on by one pixel; infinite where that turns nothing."""
    x, y = hands.middle
    hands.home()
    hands.touch("touchStart", (x - 80, y), (x + 80, y))
    for k in range(1, 6):
        hands.touch("touchMove", (x - 80, y + 4 * k), (x + 80, y + 4 * k))
    before = hands.view()
    hands.touch("touchEnd", (x + 80, y + 20), first=1)
    hands.touch("touchMove", (x - 79, y + 20))
    after = hands.view()
    hands.touch("touchEnd")
    return moved(before, after) or math.inf


def tap(hands):
    """Whether a tap on a pyramid, by a finger that is not quite still, chooses its keyframe; none where no pyramid is in sight."""
    for back in (0, 2, 4, 6):
        hands.home()
        hands.browser.evaluate(f"app.controls.distance = 2; app.controls.dolly(-Math.log(1 + {back} / 2))")
        time.sleep(0.3)
        place = hands.value(PYRAMID)
        if place:
            u, v, index = place
            hands.fingers([(u, v), (u + 4, v + 4)])
            return hands.value("app.chosen") == index
    return None


def level(hands):
    """Whether a tap on the radio view says what arrives from there; none where there is no radio view."""
    if "rf" not in hands.value("app.modes"):
        return None
    hands.home()
    hands.browser.evaluate("document.querySelector('[data-mode=rf]').click()")
    time.sleep(1)
    x, y = hands.middle
    hands.fingers([(x + 90, y + 70)])
    text = hands.value("app.at('cursor').textContent")
    hands.browser.evaluate("document.querySelector('[data-mode=optical]').click()")
    return "dB from azimuth" in text


def check(browser, page):
    """What there is to say of a page: name, words, whether it is as it should be."""
    hands = Hands(browser, page)
    try:
        for name, around in [("one finger beside the mouse, turning around", True), ("one finger beside the mouse, looking", False)]:
            value = one_finger(hands, around)
            yield name, f"{value:.1e} m or rad apart", value < 1e-6
        value = two_fingers(hands)
        yield "two fingers beside a Shift-drag", f"{100 * value:.2f} % of the way apart", value < TOLERANCE_TWO
        for ratio in (2.0, 0.5):
            value = pinch(hands, ratio)
            yield f"a pinch by {ratio}", f"{100 * value:.2f} % of the distance off", value < TOLERANCE_TWO
        value = lifted(hands)
        # A pixel turns by 0.006 rad around what is two metres ahead.
        yield "one of two fingers is lifted, the other moves", f"{value:.3f} m or rad for a pixel", value < 0.02
        for name, value in [("a tap on a pyramid", tap(hands)), ("a tap on the radio view", level(hands))]:
            if value is not None:
                yield name, "answered" if value else "NOT answered", value
    finally:
        hands.close()


def exposed(page, folder):
    """The page with its objects in reach."""
    text = page.read_text()
    if text.count(START) != 1:
        raise ValueError(f"{page} is no page of corf view --export of this version")
    copy = folder / "page.html"
    copy.write_text(text.replace(START, EXPOSED))
    return copy


# What makes fingers do other things than they should.
BROKEN = [
    ("no pinch", "if (before > 0) this.dolly", "if (before < 0) this.dolly"),
    ("a pan of each finger's own", "const share = 1 / this.pointers.size", "const share = 1"),
    ("fingers without grace", "const TAP_PX = 14", "const TAP_PX = 2"),
]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("page", type=Path, help="page of corf view --export")
    arguments.add_argument("--sort", type=int, metavar="N", help="measure the depth order of N Gaussians as well")
    arguments.add_argument("--controls", action="store_true", help="check as well that broken pages are noticed")
    arguments.add_argument("--browser", default=next((b for b in BROWSERS if shutil.which(b)), None), help="Chromium")
    given = arguments.parse_args()
    if not given.browser:
        raise ValueError("no Chromium was found; name one with --browser")
    failures = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        page, browser = exposed(given.page, folder), Browser(given.browser)
        try:
            for name, words, good in check(browser, page):
                failures += not good
                print(f"{name:<50} {words:<36} {'ok' if good else 'NOT AS IT SHOULD BE'}", flush=True)
            for name, copy in changed(page, folder, BROKEN) if given.controls else []:
                noticed = not all(good for _, _, good in check(browser, copy))
                failures += not noticed
                print(f"control: {name:<41} {'noticed' if noticed else 'not noticed':<36} {'ok' if noticed else 'NOT AS IT SHOULD BE'}", flush=True)
            if given.sort:
                failures += not sort(browser, page, given.sort)
        finally:
            browser.quit()
    return 1 if failures else 0


def sort(browser, page, count):
    """Prints what the page's sorter needs; whether it sorts."""
    target = browser.open(page.resolve().as_uri() + "#bare=1")
    while browser.evaluate("typeof makeSorter") != "function":
        time.sleep(0.1)
    value = browser.evaluate(SORT % (count, SORTS))
    browser.close(target)
    words = f"{value['median']:.1f} ms, at worst {value['worst']:.1f} ms ({value['drawn']} of {count} in front, {SORTS} views)"
    print(f"{f'depth order of {count} Gaussians':<50} {words:<36} {'ok' if value['right'] else 'NOT IN ORDER'}", flush=True)
    return value["right"]


if __name__ == "__main__":
    end_with(main)
