"""The time that Mitsuba 3 takes for images as near to converged as corf's, at the same views of the same scene.

    corf bench light scenes/lobby147.toml --device gpu --alone --views 3        (PSNR, and seconds a view)
    corf scene export scenes/lobby.toml --to mitsuba --out FOLDER --poses 3
    python -m venv .venv && .venv/bin/pip install -r tools/requirements-mitsuba.txt       (and apt install libllvm19 for --variant llvm)
    .venv/bin/python tools/compare_mitsuba.py FOLDER --variant cuda --psnr-db 40.4 --seconds 1.0

Mitsuba's path integrator has no bias, so that half the mean squared difference of two renderings with different seeds is what one of them is off by; it
falls as one over the number of samples, which two numbers of samples show. Pictures are compared as corf develops them: 8 bits, its tone curve, its
metering. Neither reading the scene nor compiling counts. Prints, a view a line, the samples and seconds that --psnr-db takes, and how many times
--seconds that is; --out writes the same as JSON.
"""

import argparse
import json
import sys
from pathlib import Path

from light_live import environment
from light_live.environment import say


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="what `corf scene export --to mitsuba` wrote")
    parser.add_argument("--variant", choices=("llvm", "cuda"), default="llvm", help="processor or GPU (default: llvm)")
    parser.add_argument("--psnr-db", type=float, required=True, help="PSNR of corf's images against converged ones, dB")
    parser.add_argument("--seconds", type=float, required=True, help="seconds that corf took for a view of that PSNR")
    parser.add_argument("--samples", type=int, default=256, help="paths a pixel of a rendering, a multiple of 4 (default: 256)")
    parser.add_argument("--max-bounces", type=int, default=64, help="scattering events of a path")
    parser.add_argument("--reflection", choices=("standard", "coupled"), default="standard", help="the exported plugins, or corf's own formulas")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, help="JSON file of the numbers")
    args = parser.parse_args()
    if args.samples < 4 or args.samples % 4 or args.seconds <= 0:
        parser.error("--samples is a positive multiple of 4, --seconds positive")
    if not (args.folder / "scene.xml").exists():
        parser.error(f"{args.folder} holds no scene.xml: make it with `corf scene export --to mitsuba --poses 3`")
    return args


def noise(scene, view, samples, exposure_ev):
    """PSNR of one rendering against the converged image, dB; one rendering's seconds; the exposure that pictures were developed with, EV."""
    import numpy as np
    from light_live import compare

    (first, seconds), (second, more) = (scene.render(view, samples, seed) for seed in (2 * samples + 1, 2 * samples + 2))
    if exposure_ev is None:
        exposure_ev = compare.exposure((first + second) / 2)
    difference = compare.develop(first, exposure_ev) - compare.develop(second, exposure_ev)
    return 10 * np.log10(255**2 / (np.mean(difference**2) / 2)), (seconds + more) / 2, exposure_ev


def main():
    args = arguments()
    machine = environment.prepare(args.threads, f"{args.variant}_ad_rgb")
    from light_live import mitsuba_runner

    scene = mitsuba_runner.Theirs(args.folder, args.max_bounces, args.reflection)
    views = []
    for view in range(scene.views):
        # The first images compile kernels.
        noise(scene, view, 4, 0.0)
        psnr_db, seconds, exposure_ev = noise(scene, view, args.samples, None)
        fewer_db, _, _ = noise(scene, view, args.samples // 4, exposure_ev)
        samples = args.samples * 10 ** ((args.psnr_db - psnr_db) / 10)
        needed = seconds * samples / args.samples
        views.append(
            {
                "view": view,
                "samples": args.samples,
                "psnr_db": psnr_db,
                "psnr_db_of_a_quarter": fewer_db,
                "seconds": seconds,
                "samples_needed": samples,
                "seconds_needed": needed,
                "times_corf": needed / args.seconds,
            }
        )
        say(
            f"view {view}: {args.samples} samples a pixel are {psnr_db:.2f} dB in {seconds:.2f} s (a quarter of them {fewer_db:.2f} dB); "
            f"{args.psnr_db} dB take {samples:.0f} samples, {needed:.2f} s, {needed / args.seconds:.1f} times {args.seconds} s"
        )
    record = {"schema": "corf-mitsuba-time/1", "machine": machine, "arguments": vars(args) | {"folder": args.folder.name, "out": None}, "views": views}
    text = json.dumps(record, indent=1)
    if args.out:
        args.out.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    sys.exit(main())
