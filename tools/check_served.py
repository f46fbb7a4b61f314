"""The viewer's page as `corf view` serves it, in headless Chromium: what it loads, under its policy, and what stays shut without the token.

    python3 tools/check_served.py runs/a --corf target/release/corf [--picture page.png]

Serves the run or data set, opens the printed address as a person would, and insists that the page comes up and loads all that it shows, that no
policy is violated and no script fails, that buttons and dialogs work, that the browser keeps the token for the address without it, and that
another browser, which does not know it, is told what to do.

Nothing but Python and a Chromium is needed. Exit code 0: everything is as it should be; 1: something is not; 2: bad input.
"""

import argparse
import base64
import json
import shutil
import subprocess
import time
from pathlib import Path

from check_view import BROWSERS, Browser
from ending import end_with

# What the browser says of a page that is not as it should be.
TOLD = ("Log.entryAdded", "Runtime.exceptionThrown")
# Nobody serves it, and a browser asks for it of its own accord.
ICON = "/favicon.ico"


class Visitor(Browser):
    """A browser that may reach this machine alone, and remembers what went wrong in its pages."""

    RULES = "MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"

    def __init__(self, program):
        self.told = []
        super().__init__(program)

    def heard(self, answer):
        if answer.get("method") in TOLD:
            self.told.append(answer["params"])

    def visit(self, url):
        """Opens a page and waits until something is to be seen of it."""
        self.open("about:blank")
        for domain in ("Log", "Runtime", "Page"):
            self.ask(f"{domain}.enable")
        self.ask("Page.navigate", url=url)
        end = time.monotonic() + self.PATIENCE_S
        while self.evaluate("document.readyState === 'complete' && location.href !== 'about:blank'") is not True:
            if time.monotonic() > end:
                raise ValueError("the page does not load")
            time.sleep(0.1)

    def wait(self, expression):
        """Whether an expression comes true."""
        end = time.monotonic() + 60
        while time.monotonic() < end:
            if self.evaluate(expression) is True:
                return True
            time.sleep(0.1)
        return False

    def wrong(self):
        """What went wrong since the last time."""
        self.evaluate("0")
        said, self.told = [json.dumps(params) for params in self.told], []
        return [text for text in said if ICON not in text]


def check(program, url, picture):
    """What there is to say of an address: name, whether it is as it should be, and why not."""
    visitor = Visitor(program)
    try:
        visitor.ask("Browser.getVersion")
        visitor.visit(url)
        drawn = visitor.wait("!document.body.dataset.error && document.querySelectorAll('#panel figure').length > 0 && document.getElementById('message').textContent === ''")
        yield "the page comes up", drawn, visitor.evaluate("document.body.dataset.error || document.getElementById('message').textContent")
        yield "its stage is drawn on", visitor.wait("document.getElementById('picture').width > 100"), None
        for button, is_open in (("help", True), (None, False)):
            visitor.evaluate(f"document.getElementById('{button}').click()" if button else "document.querySelector('dialog[open] form button').click()")
            yield f"its help is {'opened' if is_open else 'closed'}", visitor.evaluate("document.querySelector('dialog[open]') !== null") is is_open, None
        wrong = visitor.wrong()
        yield "nothing is refused to it and no script fails", not wrong, wrong
        if picture:
            # Lines are drawn a frame later.
            time.sleep(2)
            picture.write_bytes(base64.b64decode(visitor.ask("Page.captureScreenshot")["data"]))
        visitor.visit(url.split("?")[0])
        yield "the browser keeps the token", visitor.wait("document.querySelectorAll('#panel figure').length > 0"), None
        yield "… where no script reads it", visitor.evaluate("document.cookie") == "", visitor.evaluate("document.cookie")
        wrong = visitor.wrong()
        yield "nothing is refused to it then", not wrong, wrong
    finally:
        visitor.quit()
    stranger = Visitor(program)
    try:
        stranger.visit(url.split("?")[0])
        said = stranger.evaluate("document.body.textContent") or ""
        yield "another browser is told what to do", "whole address that corf has printed" in said, said
    finally:
        stranger.quit()


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("folder", type=Path, help="run or data set")
    arguments.add_argument("--corf", default="target/release/corf", help="the program")
    arguments.add_argument("--picture", type=Path, help="keep a picture of the page, a PNG")
    arguments.add_argument("--browser", default=next((b for b in BROWSERS if shutil.which(b)), None), help="Chromium")
    given = arguments.parse_args()
    if not given.browser:
        raise ValueError("no Chromium was found; name one with --browser")
    served = subprocess.Popen([given.corf, "view", str(given.folder), "--json"], stdout=subprocess.PIPE, text=True)
    try:
        said = ""
        while not said.rstrip().endswith("}"):
            line = served.stdout.readline()
            if not line:
                raise ValueError("corf view serves nothing")
            said += line
        failures = 0
        for name, good, why in check(given.browser, json.loads(said)["url"], given.picture):
            failures += not good
            print(f"{name:<50} {'ok' if good else f'NOT AS IT SHOULD BE: {why}'}", flush=True)
    finally:
        served.terminate()
        served.wait()
    return 1 if failures else 0


if __name__ == "__main__":
    end_with(main)
