"""The `corf` command, for the checks of radio and of light."""

import os
import subprocess
from pathlib import Path

from .environment import ROOT, refuse


class Command:
    """A built `corf`, run with so many threads."""

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
