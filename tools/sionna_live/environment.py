"""Where Sionna RT's compiler is, which versions run, and on what machine. Import this before anything of Sionna RT."""

import os
import platform
import re
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TRACERS = ("sionna-rt", "mitsuba", "drjit")
# Dr.Jit aborts with 15 and 16.
OLDEST_LLVM = 17
LIBRARY_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
    "/usr/local/lib",
    "/opt/homebrew/opt/llvm/lib",
)


def pins(requirements):
    """Versions by package of a file under tools/."""
    lines = (ROOT / "tools" / requirements).read_text().split()
    return dict(line.split("==") for line in lines if re.fullmatch(r"[\w.-]+==[\d.]+", line))


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


def check_versions(packages, requirements):
    """Refuses packages of other versions than a requirements file says; returns the versions by package."""
    pinned = pins(requirements)
    for package in packages:
        try:
            version = metadata.version(package)
        except metadata.PackageNotFoundError:
            version = "absent"
        if version != pinned[package]:
            refuse(f"{package} is {version}, not {pinned[package]}\n  help: pip install -r tools/{requirements}")
    return {package: pinned[package] for package in packages}


def machine():
    """The version of corf's sources, and the processor."""
    git = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    cpu = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text()) if Path("/proc/cpuinfo").exists() else None
    return {"corf": git.stdout.strip() or "unknown", "cpu": cpu.group(1) if cpu else platform.processor()}


def prepare(threads):
    """Checks versions, points Dr.Jit at its compiler, limits its threads; returns what a report says about the machine."""
    versions = check_versions(TRACERS, "requirements-sionna.txt")
    os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit
    import mitsuba
    import sionna.rt  # noqa: F401: chooses the variant, CUDA where there is a GPU

    drjit.set_thread_count(threads)
    on_cpu = mitsuba.variant().startswith("llvm")
    return {
        **versions,
        "llvm": Path(os.environ["DRJIT_LIBLLVM_PATH"]).name if on_cpu else mitsuba.variant(),
        "on_cpu": on_cpu,
        **machine(),
        "threads": threads,
    }
