"""Where Mitsuba's compiler is, which versions run, and on what machine. Import this before anything of Mitsuba."""

import os
import platform
import re
import subprocess
from importlib import metadata
from pathlib import Path

from sionna_live.environment import ROOT, find_llvm, refuse, say

__all__ = ["PINNED", "ROOT", "prepare", "refuse", "say"]

PINNED = dict(
    line.split("==")
    for line in (ROOT / "tools/requirements-mitsuba.txt").read_text().split()
    if re.fullmatch(r"[\w.-]+==[\d.]+", line)
)


def prepare(threads):
    """Checks versions, points Dr.Jit at its compiler, limits its threads; returns what a report says about the machine."""
    for package in ("mitsuba", "drjit"):
        try:
            version = metadata.version(package)
        except metadata.PackageNotFoundError:
            version = "absent"
        if version != PINNED[package]:
            refuse(f"{package} is {version}, not {PINNED[package]}\n  help: pip install -r tools/requirements-mitsuba.txt")
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit
    import mitsuba

    mitsuba.set_variant("llvm_ad_rgb")
    # Radiance above 1 in a texture is no mistake.
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    drjit.set_thread_count(threads)
    git = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    cpu = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text()) if Path("/proc/cpuinfo").exists() else None
    return {
        "mitsuba": PINNED["mitsuba"],
        "variant": mitsuba.variant(),
        "llvm": Path(os.environ["DRJIT_LIBLLVM_PATH"]).name,
        "corf": git.stdout.strip() or "unknown",
        "cpu": cpu.group(1) if cpu else platform.processor(),
        "threads": threads,
    }
