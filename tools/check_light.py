"""corf's light tracer against Mitsuba 3, live: the same scenes rendered by both, compared in linear radiance and as pictures.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-mitsuba.txt      # and apt install libllvm19
    cargo build --release -p corf-bench
    .venv/bin/python tools/check_light.py --corf target/release/corf --out results/YYYY-MM-DD-light-check --controls

Exports each scene with `corf scene export --to mitsuba`, renders its views with corf's unbiased path tracer and with Mitsuba's path
integrator, and writes a Markdown report with pictures. Mitsuba renders twice: with a plugin that implements corf's documented reflection
formulas anew (this is what must agree) and with the plugins the export names (for information). Exit code 0: everything agrees and, with
`--controls`, every control fails as it must; 1: not so; 2: bad input.
"""

import argparse
import datetime
import json
import sys
import tempfile
from pathlib import Path

from light_live import environment
from light_live.environment import say

ROOT = environment.ROOT
SCENES = ("metal", "glass", "lamps", "lobby")
BRIGHTER = 1.05
# Scenes that are wrong on corf's side alone: what is wrong, in which small room, and how it is made.
CONTROLS = (
    (f"albedo × {BRIGHTER}", "metal", {"brighter": BRIGHTER}),
    ("a lamp removed", "lamps", {"without_lamp": True}),
)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--corf", help="the corf binary (default: cargo builds it)")
    parser.add_argument("--out", help="folder of the report")
    parser.add_argument(
        "--json", action="store_true", help="write the numbers to standard output as JSON instead of a table"
    )
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES, help="which scenes (default: all)")
    parser.add_argument("--samples", type=int, default=1024, help="paths a pixel of each half of each side, small rooms")
    parser.add_argument("--lobby-samples", type=int, default=512, help="the same, in the lobby")
    parser.add_argument("--views", type=int, default=2, help="views of a small room")
    parser.add_argument("--lobby-views", type=int, default=3, help="evenly spaced poses of the lobby's trajectory")
    parser.add_argument("--max-bounces", type=int, default=64, help="scattering events of a path, the same on both sides")
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="wall time for each side of the equal-time comparison (0: none)"
    )
    parser.add_argument("--controls", action="store_true", help="also make sure that a wrong scene fails")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    if min(args.samples, args.lobby_samples, args.views, args.lobby_views, args.max_bounces, args.threads) < 1:
        parser.error("samples, views, bounces and threads must be 1 or more")
    needed = {name for _, name, _ in CONTROLS}
    if args.controls and not needed <= set(args.scenes):
        parser.error(f"--controls needs {' and '.join(sorted(needed))} among --scenes")
    return args


def rooms_of(args, scratch):
    from light_live import rooms

    for name in args.scenes:
        if name == "lobby":
            yield (
                rooms.with_views(rooms.lobby(args.lobby_views, (240, 135)), max_bounces=args.max_bounces),
                args.lobby_samples,
            )
        else:
            room = rooms.small(name, scratch / name, args.views, (160, 120))
            yield rooms.with_views(room, max_bounces=args.max_bounces), args.samples


class Side:
    """Mitsuba's views of one scene."""

    def __init__(self, folder, room, reflection):
        from light_live import mitsuba_runner

        self.scene = mitsuba_runner.Theirs(folder, room.max_bounces, reflection)

    def render(self, samples, seed):
        import numpy as np

        rendered = [self.scene.render(view, samples, 17 * seed + view) for view in range(self.scene.views)]
        return np.stack([image for image, _ in rendered]), sum(seconds for _, seconds in rendered)


def compare_room(args, corf, room, samples, scratch, out):
    import numpy as np
    from light_live import compare, pictures

    folder = scratch / f"{room.name}-mitsuba"
    summary = corf.export(room, folder)
    say(f"{room.name}: {summary['triangles']} triangles, {summary['shapes']} shapes, {summary['emitters']} emitters")
    ours, our_seconds = zip(*(corf.render(room, samples, seed) for seed in (1, 2)))
    say(f"{room.name}: corf {sum(our_seconds):.0f} s")
    documented = Side(folder, room, "coupled")
    # The first image compiles its kernel.
    documented.render(1, 9)
    theirs, their_seconds = zip(*(documented.render(samples, seed) for seed in (1, 2)))
    say(f"{room.name}: Mitsuba {sum(their_seconds):.0f} s")
    plain, _ = zip(*(Side(folder, room, "standard").render(samples // 4 or 1, seed) for seed in (1, 2)))
    exposure_ev = compare.exposure(np.mean(ours, axis=0))
    result = {
        "scene": room.name,
        "about": room.about,
        "size": list(room.size),
        "views": room.views,
        "samples": samples,
        "max_bounces": room.max_bounces,
        "exposure_ev": exposure_ev,
        "integrator": documented.scene.integrator.class_name(),
        "export": {k: v for k, v in summary.items() if k != "folder"},
        "documented": compare.agreement(ours, theirs, exposure_ev).as_json(),
        "plain": compare.agreement(ours, plain, exposure_ev).as_json(),
    }
    pictures.side_by_side(out / f"{room.name}.png", *(np.mean(x, axis=0) for x in (ours, theirs, plain)), exposure_ev)
    if args.seconds > 0:
        result["equal_time"] = equal_time(
            args, corf, room, documented, ours, theirs, exposure_ev, samples, our_seconds, their_seconds
        )
    return result, theirs


def equal_time(args, corf, room, documented, ours, theirs, exposure_ev, samples, our_seconds, their_seconds):
    """PSNR of both at one wall time against the mean of both sides' converged images. Reading the scene, building what is looked up and
    compiling are left out on both sides: corf's by a run of one sample a pixel, Mitsuba's by having rendered before."""
    import numpy as np
    from light_live import compare

    _, start = corf.render(room, 1, 5)
    joint = [(a + b) / 2 for a, b in zip(ours, theirs)]
    rate = (np.mean(our_seconds) - start) / samples
    count = max(1, round(args.seconds / rate))
    image, seconds = corf.render(room, count, 11)
    entry = {"corf": [count, seconds - start, compare.against_joint(image, joint, exposure_ev)]}
    count = max(1, round(args.seconds / (np.mean(their_seconds) / samples)))
    image, seconds = documented.render(count, 13)
    entry["mitsuba"] = [count, seconds, compare.against_joint(image, joint, exposure_ev)]
    say(f"{room.name}: equal time {entry}")
    return entry


def controls(args, corf, scratch, known, samples):
    """corf with a wrong scene against Mitsuba with the right one; `known` are Mitsuba's images and the exposure by room."""
    from light_live import compare, rooms

    for what, name, change in CONTROLS:
        theirs, exposure_ev = known[name]
        room = rooms.small(name, scratch / f"control-{'-'.join(change)}", args.views, (160, 120), **change)
        room = rooms.with_views(room, max_bounces=args.max_bounces)
        ours = [corf.render(room, samples, seed)[0] for seed in (1, 2)]
        yield {"control": f"{name}, {what}", **compare.agreement(ours, theirs, exposure_ev).as_json()}
        say(f"control: {name}, {what}")


def main():
    args = arguments()
    machine = environment.prepare(args.threads)
    from light_live import corf_runner, report

    corf = corf_runner.Corf(args.corf, args.threads)
    out = Path(args.out or ROOT / f"results/{datetime.date.today().isoformat()}-light-check")
    out.mkdir(parents=True, exist_ok=True)
    results, failing = [], []
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        known = {}
        for room, samples in rooms_of(args, scratch):
            result, theirs = compare_room(args, corf, room, samples, scratch, out)
            results.append(result)
            known[room.name] = (theirs, result["exposure_ev"])
        if args.controls:
            failing = list(controls(args, corf, scratch, known, max(1, args.samples // 4)))
    agrees = all(r["documented"]["passes"] for r in results)
    noticed = not any(c["passes"] for c in failing)
    record = {
        "schema": "corf-light-check/1",
        "machine": machine,
        "agrees": agrees,
        "controls_fail": noticed if failing else None,
    }
    record |= {"scenes": results, "controls": failing}
    (out / "results.json").write_text(json.dumps(record, indent=1) + "\n")
    (out / "README.md").write_text(report.markdown(record))
    print(json.dumps(record, indent=1) if args.json else report.table(record))
    sys.exit(0 if agrees and noticed else 1)


if __name__ == "__main__":
    main()
