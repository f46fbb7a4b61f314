"""Where Mitsuba's compiler is, which versions run, and on what machine. Import this before anything of Mitsuba."""

import os
from pathlib import Path

from sionna_live.environment import ROOT, check_versions, find_llvm, machine, refuse, say

__all__ = ["ROOT", "prepare", "refuse", "say"]


def prepare(threads, variant="llvm_ad_rgb"):
    """Checks versions, points Dr.Jit at its compiler, limits its threads; returns what a report says about the machine."""
    versions = check_versions(("mitsuba", "drjit"), "requirements-mitsuba.txt")
    on_processor = variant.startswith("llvm")
    if on_processor:
        os.environ["DRJIT_LIBLLVM_PATH"] = find_llvm()
    import drjit
    import mitsuba

    mitsuba.set_variant(variant)
    # Radiance above 1 in a texture is no mistake.
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    drjit.set_thread_count(threads)
    return {
        "mitsuba": versions["mitsuba"],
        "variant": mitsuba.variant(),
        "llvm": Path(os.environ["DRJIT_LIBLLVM_PATH"]).name if on_processor else None,
        **machine(),
        "threads": threads,
    }
