"""corf and Sionna RT against the clock, at equal error, on one machine in one run.

    .venv/bin/python tools/compare_speed.py            # after the installation that tools/check_sionna.py describes

corf: `corf bench radio scenes/lobby147.toml`, all positions, with its own standard errors; with spectra of either kind, and for received powers
alone, of the paths that both return, at several errors. Sionna RT: evenly spaced positions of the same trajectory, several seeds at several numbers of rays; its
error's law is measured, and the rays (and with them the time) that reach the same error follow from it. Both with the same number of threads; seconds on the wall and CPU seconds of all threads (which neighbours on a busy
machine disturb less). Then cost against triangles, depth and receivers. Report, CSV and pictures under results/.
"""

import argparse
import datetime
import json
import shutil
import sys
import tempfile
from pathlib import Path

from sionna_live import environment
from sionna_live.environment import say

ROOT = environment.ROOT
# corf's errors come from as many positions as Sionna RT's.
ERRORS = ("--replicas", 8, "--error-positions", 21)
# Spectra as the 8×8 array sees them.
BARTLETT = ("--spectrum", "bartlett", "--directions", 100_000, *ERRORS)
# Received powers alone, of paths that end with a scattering, as nearly all of Sionna RT's that scatter do; …
POWERS = ("--powers", "--after", 0, "--photons", 1_000_000, *ERRORS)
# … with so many directions, the error falling.
POWERS_DIRECTIONS = (60_000, 120_000, 240_000)
# Pixels within this of the spectrum's peak count, as in `corf bench radio`.
RANGE_DB = 30.0


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", nargs="?", default=str(ROOT / "scenes/lobby147.toml"), help="dataset file (default: lobby147)")
    parser.add_argument("--positions", type=int, default=21, help="positions Sionna RT traces in one call")
    parser.add_argument(
        "--our-positions", type=int, help="positions corf traces (default: all); fewer are scaled up, and the report says so"
    )
    parser.add_argument("--samples", default="125000,500000,2000000,8000000", help="rays of Sionna RT, comma-separated")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--depth", type=int, default=3)
    parser.add_argument("--pixels-at", type=int, default=3, help="positions at which the error of pixels of 1° lobes is measured")
    parser.add_argument("--no-scaling", action="store_true", help="no plots of cost against triangles, depth and receivers")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--corf", help="the corf binary (default: cargo builds it)")
    parser.add_argument("--out", help="folder of the report")
    return parser.parse_args()


def main():
    args = arguments()
    machine = environment.prepare(args.threads)
    if not machine["on_cpu"]:
        environment.refuse("Sionna RT would run on the GPU here and corf on the processor\n  help: hide it with CUDA_VISIBLE_DEVICES=")
    import numpy as np

    from sionna_live import meshes, corf_runner, speed_report, sionna_runner

    out = Path(args.out or ROOT / f"results/{datetime.date.today().isoformat()}-sionna-speed")
    out.mkdir(parents=True, exist_ok=True)
    corf = corf_runner.Corf(args.corf, args.threads)
    dataset = Path(args.dataset).resolve()
    config = read_toml(dataset)
    scene, positions = dataset.parent / config["scene"], config["keyframes"]
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        radio = corf.export(scene, scratch / "scene", positions)
        library = sionna_runner.Theirs(scratch / "scene")
        tx = np.float32(radio["transmitter"]["position_m"])
        everywhere = np.float32([pose["position_m"] for pose in radio["poses"]])
        chosen = np.linspace(0, positions, args.positions, endpoint=False).astype(int)
        result = {"machine": machine, "positions": positions, "traced": chosen.tolist()}
        result["theirs"] = measure_theirs(args, library, tx, everywhere[chosen], [radio["poses"][i] for i in chosen])
        keep(out, result)
        say("corf bench radio")
        fewer = ("--positions", args.our_positions) if args.our_positions else ()
        result["ours"] = measure_ours(corf, dataset, *fewer, *ERRORS)
        keep(out, result)
        say("corf bench radio, Bartlett spectra")
        result["bartlett"] = measure_ours(corf, dataset, *fewer, *BARTLETT)
        keep(out, result)
        say("corf bench radio, powers alone")
        result["powers"] = []
        for directions in POWERS_DIRECTIONS:
            result["powers"].append(measure_ours(corf, dataset, *fewer, *POWERS, "--directions", directions))
            keep(out, result)
        if not args.no_scaling:
            mesh = meshes.Meshes(scratch / "scene", radio)
            result["scaling"] = scaling(args, corf, dataset, scene, radio, mesh, library, tx, everywhere, scratch)
    keep(out, result)
    speed_report.write(out, args, result)
    say(str(out / "README.md"))
    return 0


def keep(out, result):
    """What has been measured so far: a run of half an hour that fails late loses nothing."""
    text = json.dumps(result, indent=1, default=float) + "\n"
    (out / "results.json.part").write_text(text)
    (out / "results.json.part").replace(out / "results.json")


def read_toml(path):
    import tomllib

    return tomllib.loads(Path(path).read_text())


def measure_theirs(args, library, tx, receivers, poses):
    """Runs at every number of rays: time, and the spread over seeds of totals and of spectrum pixels: lobes at some positions, Bartlett at all."""
    import numpy as np

    from sionna_live import speed, spectrum
    from sionna_live.compare import direction

    counts = [int(float(n)) for n in args.samples.split(",")]
    say("Sionna RT: compiling")
    speed.theirs_totals(library, tx, receivers, args.depth, counts[0], 1000)
    near = ((2 * np.arange(args.pixels_at) + 1) * len(receivers) // (2 * args.pixels_at)).astype(int)
    frame = frame_directions()
    runs, pixels, bartlett = [], {}, {}
    for samples in counts:
        maps = {int(r): [] for r in near}
        array_maps = [[] for _ in receivers]
        for seed in range(1, args.seeds + 1):
            say(f"Sionna RT: {samples} rays, seed {seed} of {args.seeds}")
            run = speed.theirs_totals(library, tx, receivers, args.depth, samples, seed)
            s = run.pop("arrivals")
            power = run.pop("power")
            for r, pose in enumerate(poses):
                valid = s["valid"][r, 0]
                theta, phi = (s[k][r, 0][valid].astype(float) for k in ("theta_r", "phi_r"))
                directions, powers = direction(theta, phi).T, power[r][valid]
                turn = np.asarray(pose["world_from_array"])
                array_maps[r].append(spectrum.bartlett(spectrum.covariance(directions, powers, turn), frame))
                if r in maps:
                    maps[r].append(speed.lobes(directions, powers, frame @ turn.T, 1.0))
            runs.append({"samples": samples, "seed": seed, **{k: np.asarray(v).tolist() for k, v in run.items()}})
        pixels[samples] = pixel_errors([np.array(m) for m in maps.values()])
        bartlett[samples] = pixel_errors([np.array(m) for m in array_maps])
    return {"runs": runs, "pixels": pixels, "bartlett": bartlett}


def frame_directions(count=600):
    """Directions in the array's frame spread over a 90° pinhole image of 3:2."""
    import numpy as np

    columns = int(round((count * 1.5) ** 0.5))
    rows = count // columns
    y, z = np.meshgrid(np.linspace(0.98, -0.98, columns), np.linspace(0.65, -0.65, rows))
    d = np.stack([np.ones_like(y), y, z], -1).reshape(-1, 3)
    return d / np.linalg.norm(d, axis=1)[:, None]


def pixel_errors(positions):
    """Standard deviation of a run, dB, over the pixels within reach of their map's peak, all positions together."""
    import numpy as np

    errors = []
    for maps in positions:
        mean = maps.mean(0)
        within = mean >= mean.max() * 10 ** (-RANGE_DB / 10)
        errors.append(10 / np.log(10) * maps.std(0, ddof=1)[within] / mean[within])
    errors = np.concatenate(errors)
    median, p99, worst = np.percentile(errors, (50, 99, 100)).tolist()
    return {"pixels": len(errors), "median_db": median, "p99_db": p99, "worst_db": worst}


def measure_ours(corf, dataset, *options):
    from sionna_live import speed

    report, taken = speed.run_bench(corf, dataset, *options)
    return {"report": report, **taken}


def scaling(args, corf, dataset, scene, radio, mesh, library, tx, everywhere, scratch):
    """Seconds against triangles, depth and receivers, for both."""
    import numpy as np

    from sionna_live import meshes, speed, sionna_runner

    rays = 500_000
    few = everywhere[np.linspace(0, len(everywhere), 7, endpoint=False).astype(int)]
    parts = [(s["object"], s["material"], c) for s, c in zip(mesh.shapes, mesh.corners)]
    total = sum(len(c) for _, _, c in parts)
    rows = []

    def line(what, x, mine, yours):
        spent = mine["report"]["seconds"]["total"]
        theirs_s = (
            {"sionna_s": yours["wall_s"], "sionna_cpu_s": yours["cpu_s"]} if yours else {"sionna_s": None, "sionna_cpu_s": None}
        )
        return {"against": what, "x": x, "corf_s": spent["wall_s"], "corf_cpu_s": spent["cpu_s"], **theirs_s}

    def record(what, x, mine, library, receivers, depth):
        # Its kernels are compiled, and its memory taken, by number of rays.
        speed.theirs_totals(library, tx, receivers, depth, rays, 1)
        yours = speed.theirs_totals(library, tx, receivers, depth, rays, 2)
        rows.append(line(what, x, mine, yours))

    for count in (5_000, 20_000, total, 350_000, 1_000_000):
        say(f"scaling: {count} triangles")
        variant = parts if count == total else (meshes.fewer if count < total else meshes.more)(parts, count)
        folder = scratch / f"triangles-{count}"
        toml, data = meshes.write_scene(folder, variant, radio, scene, len(few))
        mine = measure_ours(corf, data, "--positions", len(few), "--replicas", 0)
        corf.export(toml, folder / "sionna", 0)
        record("triangles", sum(len(c) for _, _, c in variant), mine, sionna_runner.Theirs(folder / "sionna"), few, args.depth)
        shutil.rmtree(folder)
    for depth in range(1, 6):
        say(f"scaling: depth {depth}")
        record(
            "depth",
            depth,
            measure_ours(corf, dataset, "--positions", len(few), "--depth", depth, "--replicas", 0),
            library,
            few,
            depth,
        )
    for receivers in (1, 7, 21, 49, 147):
        say(f"scaling: {receivers} receivers")
        places = everywhere[np.linspace(0, len(everywhere), receivers, endpoint=False).astype(int)]
        mine = measure_ours(corf, dataset, "--positions", receivers, "--replicas", 0)
        if receivers <= 49:
            record("receivers", receivers, mine, library, places, args.depth)
        else:
            rows.append(line("receivers", receivers, mine, None))
    return {"rays": rays, "rows": rows}


if __name__ == "__main__":
    sys.exit(main())
