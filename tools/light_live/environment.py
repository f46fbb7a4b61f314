"""Where Mitsuba's compiler is, which versions run, and on what machine. Import this before anything of Mitsuba."""

import os
import platform
import re
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PINNED = dict(
    line.split("==")
    for line in (ROOT / "tools/requirements-mitsuba.txt").read_text().split()
    if re.fullmatch(r"[\w.-]+==[\d.]+", line)
)
# Dr.Jit aborts with 15 and 16.
OLDEST_LLVM = 17
LIBRARY_FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")


def refuse(message):
    """Ends the program as corf does on bad input."""
    print(f"error: {message}", file=sys.stderr)
    sys.exit(2)


def say(text):
    """A line of progress, with the time of day."""
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def find_llvm():
    """The newest LLVM shared library of version 17 or above; the user's own choice comes first."""
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return chosen
    found = []
    for folder in [*map(Path, LIBRARY_FOLDERS), *Path("/usr/lib").glob("llvm-*/lib")]:
        for file in folder.glob("libLLVM*"):
            version = re.fullmatch(r"libLLVM(?:-(\d+)[\d.]*)?\.(?:so|dylib)(?:\.(\d+)[\d.]*)?", file.name)
            major = version and (version.group(1) or version.group(2))
            if major and int(major) >= OLDEST_LLVM:
                found.append((int(major), str(file)))
    if not found:
        refuse(
            f"no shared library of LLVM {OLDEST_LLVM} or newer was found\n"
            "  help: apt install libllvm19 (or your system's package), or set DRJIT_LIBLLVM_PATH to libLLVM.so"
        )
    return max(found)[1]


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
