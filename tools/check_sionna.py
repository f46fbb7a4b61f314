"""corf against Sionna RT, live: the same scene traced by both, compared path by path, object by object and map by map.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-sionna.txt
    .venv/bin/python tools/check_sionna.py                    # report under results/YYYY-MM-DD-sionna-check

Exports the scene with `corf scene export`, traces it with `corf paths` and `corf diffuse` and with Sionna RT at receivers along the scene's
trajectory, and writes a Markdown report: six minutes where Sionna RT finds a GPU beside 16 cores, half an hour on two cores. Exit code 0:
everything agrees and every negative control fails as it must; 1: not so; 2: bad input.
"""

import argparse
import datetime
import json
import sys
import tempfile
import time
from pathlib import Path

from sionna_live import environment
from sionna_live.environment import say

ROOT = environment.ROOT
# Negative controls: changes that the comparison must notice.
GLASS_CONTROL = 1.02
SCATTERING_CONTROL = 1.05


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scene", nargs="?", default=str(ROOT / "scenes/lobby.toml"), help="scene file with a trajectory (default: the lobby)"
    )
    parser.add_argument("--receivers", type=int, default=6, help="evenly spaced poses of the trajectory")
    parser.add_argument("--depth", type=int, default=3)
    parser.add_argument("--specular-samples", type=float, default=4e6, help="rays of a run of Sionna RT for specular paths")
    parser.add_argument("--specular-runs", type=int, default=3)
    parser.add_argument("--diffuse-samples", type=float, default=4e6, help="rays of a seed of Sionna RT for diffuse paths")
    parser.add_argument("--diffuse-seeds", type=int, default=64)
    parser.add_argument("--rays", type=int, help="rays of corf's search (default: the command's own)")
    parser.add_argument("--directions", type=int, default=250_000, help="directions in which corf gathers")
    parser.add_argument("--replicas", type=int, default=4, help="independent samplings of corf's diffuse field")
    parser.add_argument(
        "--mirror-sr",
        type=float,
        default=0.002,
        help="mirrors that fill this much of the transmitter's view light surfaces by their exact image in what is compared, sr",
    )
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--corf", help="the corf binary (default: cargo builds it)")
    parser.add_argument("--cache", help="folder in which Sionna RT's results are kept for the next run on the same scene")
    parser.add_argument("--out", help="folder of the report")
    parser.add_argument("--no-diffuse", action="store_true", help="specular and transmitted paths only")
    args = parser.parse_args()
    if not args.no_diffuse and min(args.replicas, args.diffuse_seeds) < 2:
        parser.error("--replicas and --diffuse-seeds must be 2 or more: one sampling says nothing of its error")
    return args


def main():
    args = arguments()
    if not Path(args.scene).exists():
        environment.refuse(f"{args.scene} does not exist\n  help: give a scene file (.toml) with a [trajectory]")
    machine = environment.prepare(args.threads)
    import numpy as np

    from sionna_live import dataset, diffuse, meshes, corf_runner, report, specular, spectrum, sionna_runner

    out = Path(args.out or ROOT / f"results/{datetime.date.today().isoformat()}-sionna-check")
    out.mkdir(parents=True, exist_ok=True)
    corf = corf_runner.Corf(args.corf, args.threads)
    rays = ("--rays", args.rays) if args.rays else ()
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        say("exporting the scene")
        radio = corf.export(args.scene, scratch / "scene", args.receivers)
        mesh, library = meshes.Meshes(scratch / "scene", radio), sionna_runner.Theirs(scratch / "scene", args.cache)
        # Both sides start from the same float32 numbers.
        tx = np.float32(radio["transmitter"]["position_m"])
        receivers = np.float32([pose["position_m"] for pose in radio["poses"]])

        say("corf: specular and transmitted paths")
        paths = corf.paths(args.scene, tx, receivers, args.depth, *rays)
        runs = []
        for seed in range(1, args.specular_runs + 1):
            say(f"Sionna RT: specular and transmitted paths, run {seed} of {args.specular_runs}")
            runs.append(library.specular([tx], receivers, args.depth, args.specular_samples, seed))
        links = specular.links(paths, runs, tx, receivers, mesh, radio)
        specular.tell(links, library, tx, receivers, mesh, args.depth)

        say("negative controls: glass, a removed path")
        glassy = meshes.with_materials(
            args.scene,
            scratch / "glass.toml",
            {k: m for k, m in radio["materials"].items() if m["radio_id"] == "glass"},
            lambda m: {**m, "relative_permittivity": m["relative_permittivity"] * GLASS_CONTROL},
        )
        controls = [
            control(
                f"glass ε_r × {GLASS_CONTROL}",
                specular.links(corf.paths(glassy, tx, receivers, args.depth, *rays), runs, tx, receivers, mesh, radio),
                links,
            ),
            control("one path of ours removed", [without_strongest_reflection(link, tx, mesh, radio) for link in links], links),
        ]

        scattered = None
        if not args.no_diffuse:
            options = ("--directions", args.directions, "--replicas", args.replicas)
            exact = (*options, "--mirror-sr", args.mirror_sr)
            by_depth = {}
            for depth in range(1, args.depth + 1):
                say(f"corf: diffuse field, depth {depth}")
                arrivals = ("--arrivals", scratch / "arrivals") if depth == args.depth else ()
                by_depth[depth], _ = corf.diffuse(args.scene, tx, receivers, depth, *exact, *arrivals)
            say("corf: diffuse field, all mirrors by photons")
            by_photons, _ = corf.diffuse(args.scene, tx, receivers, args.depth, *options)
            seeds = []
            for seed in range(1, args.diffuse_seeds + 1):
                say(f"Sionna RT: diffuse, seed {seed} of {args.diffuse_seeds}")
                seeds.append(library.diffuse(tx, receivers, args.depth, args.diffuse_samples, seed))
            say("negative control: scattering")
            rougher = meshes.with_materials(
                args.scene,
                scratch / "rough.toml",
                radio["materials"],
                lambda m: {**m, "scattering_coefficient": m["scattering_coefficient"] * SCATTERING_CONTROL},
            )
            rough, _ = corf.diffuse(rougher, tx, receivers, args.depth, *options)
            scattered = scattering(diffuse, by_depth, seeds, rough, len(receivers))
            scattered["photons"] = [diffuse.own(by_photons, by_depth[args.depth], r) for r in range(len(receivers))]
            controls.append(scattered.pop("control"))
            say("spectra")
            scattered["spectra"] = spectra(spectrum, links, seeds, scratch / "arrivals", radio["poses"])
            say("corf: a data set's spectra")
            maps, towards = dataset.generate(corf, args.scene, scratch / "dataset", receivers, args.depth, args.directions)
            samplings = [one["samplings"] for one in scattered["spectra"]]
            scattered["dataset"] = [dataset.beside(one, towards, many) for one, many in zip(maps, samplings)]
            controls.append(mirrored(report, scattered["dataset"]))

        result = report.write(out, args, machine, radio, mesh, tx, receivers, links, runs, controls, scattered)
    say(f"{out / 'README.md'}: {'passed' if result else 'failed'}")
    return 0 if result else 1


def control(name, changed, links):
    """A control is in order when the comparison fails under it at a receiver where it passes without."""
    noticed = [
        link.index for link, other in zip(links, changed) if not other.passed() and (other.faulty_pairs() or other.missing)
    ]
    worst = max((pair["relative_a"] for link in changed for pair, _ in link.faulty_pairs()), default=0.0)
    pairs = sum(len(link.faulty_pairs()) for link in changed) - sum(len(link.faulty_pairs()) for link in links)
    missing = sum(len(link.missing) for link in changed) - sum(len(link.missing) for link in links)
    return {
        "name": name,
        "fails": bool(pairs > 0 or missing > 0),
        "what": f"{pairs} more pairs out of tolerance (worst |Δa|/|a| {worst:.2f}), {missing} more paths missing, at receivers {noticed}",
    }


def mirrored(report, maps):
    """The control of a data set's conventions."""
    beyond = [report.map_difference({**m, "ours": m["ours"][:, ::-1]})[1] for m in maps]
    return {
        "name": "a data set's spectra mirrored left to right",
        "fails": min(beyond) > report.MAX_MAP_DB,
        "what": f"{min(beyond):.1f} to {max(beyond):.1f} dB beyond the errors",
    }


def without_strongest_reflection(link, tx, mesh, radio):
    from sionna_live.specular import Link

    reflected = [p for p in link.ours if p["types"]]
    drop = max(reflected, key=lambda p: abs(p["a"]), default=None)
    changed = Link(link.index, link.rx, [p for p in link.ours if p is not drop], link.kept, link.repeats, link.off_the_mirror)
    changed.judge(tx)
    changed.ask_referee(tx, mesh, radio)
    return changed


def scattering(diffuse, by_depth, seeds, rough, receivers):
    """All diffuse comparisons, and the control of the scattering coefficient."""
    deepest = by_depth[max(by_depth)]
    totals = [diffuse.total(deepest, seeds, r) for r in range(receivers)]
    changed = [diffuse.total(rough, seeds, r) for r in range(receivers)]
    agrees = diffuse.within_total
    # Where the totals do not agree to begin with, the control tells nothing.
    broken = [r for r, row in enumerate(changed) if agrees(totals[r]) and not agrees(row)]
    return {
        "totals": totals,
        "objects": [diffuse.by_object(deepest, seeds, r) for r in range(receivers)],
        "interactions": [diffuse.by_interactions(by_depth, seeds, r) for r in range(receivers)],
        "lacking": [diffuse.lacking(deepest, seeds, r) for r in range(receivers)],
        "types": [types_of(diffuse, seeds, r) for r in range(receivers)],
        "control": {
            "name": f"scattering coefficients × {SCATTERING_CONTROL}",
            "fails": len(broken) > 0,
            "what": f"total no longer within {diffuse.MAX_TOTAL_DB} dB at receivers {broken}; "
            + ", ".join(f"{row['difference_db']:+.2f}" for row in changed)
            + " dB",
        },
    }


def types_of(diffuse, seeds, r):
    """The library's power by type."""
    names = sorted({types for run in seeds for (types, _) in run[r]["powers"]}, key=lambda t: (len(t), t))
    return {types: diffuse.theirs_of(seeds, r, lambda t, _: t == types) for types in names}


def spectra(spectrum, links, seeds, folder, poses):
    """Bartlett maps of both sides, of what both have (paths that end in a scattering, and specular ones), and ours of everything, with
    the covariances it is of, by sampling."""
    import numpy as np

    from sionna_live.compare import direction

    standard_error = lambda maps: np.std(maps, 0, ddof=1) / np.sqrt(len(maps))
    maps = []
    for link, pose in zip(links, poses):
        turn = pose["world_from_array"]
        of = lambda paths: spectrum.covariance(
            np.array([direction(p["theta_r"], p["phi_r"]) for p in paths]).reshape(-1, 3),
            np.array([abs(p["a"]) ** 2 for p in paths]),
            turn,
        )
        samplings = [np.load(file) for file in sorted(Path(folder).glob(f"{link.index:05d}-*.npy"))]
        scattered = lambda rows: spectrum.covariance(rows[:, :3], rows[:, 3], turn)
        told = [{**e["path"], "a": e["told"]} for e in link.ours_only if e["told"] is not None]
        seen = [spectrum.covariance(run[link.index]["directions"], run[link.index]["power"], turn) for run in seeds]
        mine = [spectrum.bartlett(of(link.ours) + scattered(rows[rows[:, 5] == 0])) for rows in samplings]
        yours = [spectrum.bartlett(of(link.kept + told) + one) for one in seen]
        everything = [of(link.ours) + scattered(rows) for rows in samplings]
        maps.append(
            {
                "ours": np.mean(mine, 0),
                "ours_error": standard_error(mine),
                "theirs": np.mean(yours, 0),
                "theirs_error": standard_error(yours),
                "everything": np.mean([spectrum.bartlett(one) for one in everything], 0),
                "samplings": everything,
            }
        )
    return maps


if __name__ == "__main__":
    sys.exit(main())
