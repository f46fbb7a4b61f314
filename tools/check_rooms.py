"""References made with Sionna RT for small rooms that the published ones do not have, and `corf check sionna` on them.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-sionna.txt
    .venv/bin/python tools/check_rooms.py --out results/YYYY-MM-DD-rooms

Every room is traced by Sionna RT to depth 4 (specular and transmitted) and depth 2 (with diffraction, and scattered); float64 coefficients are
those of the third opinion (`sionna_live/float64_reference.py`) on the triangles that Sionna RT names, of diffracted paths Sionna RT's own. The files have
the schemas of the published ones and stay in the output folder. `corf`'s paths, deeper still, are also compared with those of an enumeration that
tries every chain of mirrors and every edge (`sionna_live/enumeration.py`). Exit code 0: every path is found, and no other but such as have a leg
under a centimetre, which Sionna RT drops, or as it computes alike once it is told their faces (its search keeps one chain of those that share a
hash), or, diffracted, as the enumeration has; coefficients within 1e-6, diffracted ones within 1e-4, or 2e-2 with mirrors and slabs (`BY_EDGE_A`);
scattered powers within tolerance; the enumerated sets are the same. 1: not so. Bartlett maps are left out: where no direct light arrives, the noise
of Sionna RT's mean is above what is allowed of them.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from sionna_live import environment
from sionna_live.environment import say

SHORTEST_LEG_M = 0.01
SEED = 42
SCATTERED_DEPTH = 2
ALPHA_R = 4
# |Δa|/|a| of diffracted paths: Sionna RT's single precision; and with mirrors or slabs, which it meets on the way to a point a millimetre
# beside the edge, so that short legs turn.
AT_EDGE_A = 1e-4
BY_EDGE_A = 2e-2


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", help="names (default: all)")
    parser.add_argument("--depth", type=int, default=4, help="interactions of specular and transmitted paths")
    parser.add_argument("--samples", type=float, default=1e7, help="rays of Sionna RT for specular and transmitted paths")
    parser.add_argument("--diffracted-depth", type=int, default=2, help="interactions of paths that may diffract")
    parser.add_argument("--diffracted-samples", type=float, default=1e7, help="rays of Sionna RT for them")
    parser.add_argument("--enumerated-depth", type=int, default=4, help="interactions of enumerated paths; one fewer of those by an edge")
    parser.add_argument("--diffuse-samples", type=float, default=2e6, help="rays of a seed for scattered power")
    parser.add_argument("--diffuse-seeds", type=int, default=12)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--corf", help="the corf binary (default: cargo builds it)")
    parser.add_argument("--out", required=True, help="folder of the references and the table")
    args = parser.parse_args()
    if args.diffuse_seeds < 2:
        parser.error("--diffuse-seeds must be 2 or more: one sampling says nothing of its error")
    return args


def main():
    args = arguments()
    machine = environment.prepare(args.threads)
    from sionna_live import enumeration, meshes, corf_runner, rooms, sionna_runner

    corf, out = corf_runner.Corf(args.corf, args.threads), Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    known = rooms.rooms()
    for name in args.rooms:
        if name not in known:
            environment.refuse(f"there is no room `{name}`\n  help: choose from {', '.join(known)}")
    rows, enumerated, passed = [], [], True
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        lobby = environment.ROOT / "scenes/lobby.toml"
        radio = {"materials": by_radio_id(corf.export(lobby, scratch / "lobby", 1)["materials"])}
        for name in args.rooms or known:
            room, folder = known[name], scratch / name
            scene, _ = meshes.write_scene(folder, room.parts, radio, lobby, 1)
            exported = corf.export(scene, folder / "scene", 1)
            library, mesh = sionna_runner.Theirs(folder / "scene"), meshes.Meshes(folder / "scene", exported)
            say(f"{name}: Sionna RT, specular and transmitted")
            specular = specular_reference(name, room, library, mesh, args)
            say(f"{name}: Sionna RT, diffracted")
            diffracted = diffracted_reference(name, room, library, mesh, args)
            say(f"{name}: Sionna RT, scattered")
            scattered = scattered_reference(name, room, library, mesh, args)
            whole = enumeration.Enumeration(mesh, library.radio)
            told = lambda: labels_told(corf, scene, room, library, mesh, args.depth)
            by_edges = lambda: labels_enumerated(room, whole, args.diffracted_depth)
            kinds = (("specular", specular, told), ("diffracted", diffracted, by_edges), ("scattered", scattered, told))
            for kind, reference, accepts in kinds:
                file = out / f"{name}-{kind}.json"
                file.write_text(json.dumps(reference))
                say(f"{name}: corf check sionna, {kind}")
                right, found = judge(corf, file, kind, accepts)
                passed &= right
                rows += found
            say(f"{name}: all chains enumerated")
            right, found = compare_enumerated(name, corf, scene, room, whole, args.enumerated_depth)
            passed &= right
            enumerated += found
    lines = [
        f"# Small rooms against Sionna RT: {'agree' if passed else 'DIFFER'}",
        "",
        f"Sionna RT {machine['sionna-rt']}, corf {machine['corf']}; `python tools/check_rooms.py --out FOLDER`.",
        "",
        "| room | configuration, receiver | agree | missing | ours alone, a leg under 1 cm | ours alone, computed alike when told, or enumerated | | faults |",
        "|---|---|---:|---:|---:|---:|---|---|",
        *rows,
        "",
        "Every chain of mirrors, and of mirrors and one edge, tried one by one in double precision (`sionna_live/enumeration.py`):",
        "",
        "| room, receiver | interactions | paths in both | enumeration alone | `corf` alone | largest distance of a vertex |",
        "|---|---|---:|---:|---:|---:|",
        *enumerated,
    ]
    (out / "README.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    sys.exit(0 if passed else 1)


def by_radio_id(materials):
    """One of the lobby's materials for each set of radio properties, all with one scattering pattern, under the set's name."""
    chosen = {}
    for _, material in sorted(materials.items()):
        one_lobe = {**material, "scattering_pattern": "directive", "alpha_r": ALPHA_R}
        chosen.setdefault(material["radio_id"], one_lobe)
    return chosen


def header(schema, name, room, library, mesh):
    """What both schemas begin with."""
    from sionna_live.float64_reference import VACUUM_PERMITTIVITY_F_PER_M as EPSILON_0
    import numpy as np

    omega = 2 * np.pi * library.radio["frequency_hz"]
    material = lambda m: {
        "eps_r": m["relative_permittivity"],
        "sigma": m["conductivity_s_per_m"],
        "eps_im": m["conductivity_s_per_m"] / (omega * EPSILON_0),
        "thickness": m["thickness_m"],
        "S": m["scattering_coefficient"],
        "Kx": m["xpd_coefficient"],
        "pattern": m["scattering_pattern"],
        "alpha_r": m["alpha_r"],
    }
    objects = [
        {"name": shape["object"], "material": shape["material"], "triangles": corners.tolist()}
        for shape, corners in zip(mesh.shapes, mesh.corners)
    ]
    return {
        "schema": schema,
        "scene": name,
        "frequency_hz": library.radio["frequency_hz"],
        "antennas": {"pattern": "iso", "polarization": "V", "orientation": [0, 0, 0]},
        "materials": {id: material(m) for id, m in library.radio["materials"].items()},
        "objects": objects,
        "tx": list(room.tx),
        "rx": [list(rx) for rx in room.receivers],
    }


def specular_reference(name, room, library, mesh, args):
    """A `corf-sionna-ref/1` file: Sionna RT's paths, evaluated in float64 on the triangles it names."""
    found = library.specular([room.tx], room.receivers, args.depth, args.samples, SEED)
    return path_reference(name, room, library, mesh, args.depth, args.samples, [lists[0] for lists in found])


def diffracted_reference(name, room, library, mesh, args):
    """The same of paths that may diffract once, whose coefficients stay Sionna RT's own: the third opinion knows no edges. Paths of k
    interactions come from a call of depth k: in a deeper one the distance behind the edge counts a leg more than once."""
    depth, found = args.diffracted_depth, [[] for _ in room.receivers]
    for k in range(1, depth + 1):
        of_k = lambda path: len(path["types"]) == k if "X" in path["types"] else k == depth
        lists = library.specular([room.tx], room.receivers, k, args.diffracted_samples, SEED, diffraction=True)
        found = [kept + [p for p in of_rx[0] if of_k(p)] for kept, of_rx in zip(found, lists)]
    return path_reference(name, room, library, mesh, depth, args.diffracted_samples, found, diffraction=True)


def float32(room):
    """The transmitter and the receivers as every side has them."""
    import numpy as np

    return [np.float32(points).astype(float) for points in (room.tx, room.receivers)]


def labels_enumerated(room, whole, depth):
    """By receiver, how `corf check sionna` calls the diffracted paths there are: Sionna RT's search loses some edges to rounding, where the
    receiver does not see the face that is lit."""
    tx, receivers = float32(room)
    return [{label(types, objects) for types, objects, _ in whole.by_edges(tx, rx, depth)} for rx in receivers]


def compare_enumerated(name, corf, scene, room, whole, depth):
    """Whether `corf paths` has the paths that are enumerated and no other, and rows of the table."""
    from sionna_live import enumeration

    tx, receivers = float32(room)
    edge_depth = depth - 1
    plain = corf.paths(scene, tx, receivers, depth)
    by_edge = [[p for p in paths if "X" in p["types"]] for paths in corf.paths(scene, tx, receivers, edge_depth, "--diffraction")]
    rows, passed = [], True
    for index, rx in enumerate(receivers):
        for what, paths, expected in (
            (f"up to {depth}", plain[index], whole.by_mirrors(tx, rx, depth)),
            (f"up to {edge_depth}, one of them an edge", by_edge[index], whole.by_edges(tx, rx, edge_depth)),
        ):
            both, ours, theirs, apart_m = enumeration.compare(paths, expected)
            passed &= not ours and not theirs
            rows.append(f"| {name}, rx {index} | {what} | {both} | {len(theirs)} | {len(ours)} | {apart_m:.1e} m |")
    return passed, rows


def label(types, objects):
    """How `corf check sionna` calls a path."""
    return f"{types} [{', '.join(objects)}]"


def path_reference(name, room, library, mesh, depth, samples, found, **options):
    """A `corf-sionna-ref/1` file of Sionna RT's paths by receiver."""
    tx, receivers = float32(room)
    results = [
        {"rx_index": index, "paths": [recorded(path, tx, receivers[index], library, mesh) for path in paths]}
        for index, paths in enumerate(found)
    ]
    call = {"max_depth": depth, "samples_per_src": int(samples), "refraction": True, "seed": SEED, **options}
    configs = [{"name": f"depth {depth}", "args": call, "rx_results": results}]
    return {**header("corf-sionna-ref/1", name, room, library, mesh), "configs": configs}


def recorded(path, tx, rx, library, mesh):
    """A path as a reference has it: in float64 on the triangles that are named. Where it diffracts, the point on the edge and the coefficient
    are Sionna RT's; mirrors it meets a millimetre off, on the way to a point beside the edge, so that theirs are computed here."""
    import numpy as np
    from sionna_live import float64_reference

    types, a = path["types"], path["a"]
    planes = [mesh.plane(*triangle) for triangle in path["triangles"]]
    if "X" in types:
        at = types.index("X")
        point = path["vertices"][at]
        before = float64_reference.exact_corners(types[:at], planes[:at], tx, point)
        after = float64_reference.exact_corners(types[at + 1 :], planes[at + 1 :], point, rx)
        corners = np.vstack([before, point, after])
    else:
        materials = [library.radio["materials"][mesh.shapes[shape]["material"]] for shape, _ in path["triangles"]]
        corners = float64_reference.exact_corners(types, planes, tx, rx)
        a = float64_reference.coefficient(types, corners, [n for n, _ in planes], materials, tx, rx, library.radio["frequency_hz"])
    return {
        "types": types,
        "objects": path["objects"],
        "vertices": corners.tolist(),
        "length_m": float(np.linalg.norm(np.diff(np.vstack([tx, *corners, rx]), axis=0), axis=1).sum()),
        "a_f64": [a.real, a.imag],
        "a_sionna": [path["a"].real, path["a"].imag],
    }


def scattered_reference(name, room, library, mesh, args):
    """A `corf-sionna-diffuse-ref/1` file of powers by type alone."""
    import numpy as np

    runs = [
        library.diffuse(room.tx, room.receivers, SCATTERED_DEPTH, args.diffuse_samples, seed + 1)
        for seed in range(args.diffuse_seeds)
    ]
    results = []
    for index in range(len(room.receivers)):
        by_type = [{} for _ in runs]
        for sums, run in zip(by_type, runs):
            for (types, _), power in run[index]["powers"].items():
                sums[types] = sums.get(types, 0.0) + power
        estimate = lambda types: np.array([sums.get(types, 0.0) for sums in by_type])
        powers = {
            types: {"mean": estimate(types).mean(), "sem": estimate(types).std(ddof=1) / len(runs) ** 0.5}
            for types in sorted(set().union(*by_type))
        }
        results.append(
            {"rx_index": index, "power_by_type": powers, "D_power_by_object": {}, "bartlett_noncoherent_db": []}
        )
    call = {"max_depth": SCATTERED_DEPTH, "refraction": True, "diffuse_reflection": True, "seeds": len(runs)}
    case = {"name": "directive", "pattern": "directive", "alpha_r": ALPHA_R, "args": call, "rx_results": results}
    array = {"az_deg": [], "el_deg": [], "rx_yaw_rad": [0.0] * len(room.receivers)}
    return {**header("corf-sionna-diffuse-ref/1", name, room, library, mesh), "array": array, "cases": [case]}


def labels_told(corf, scene, room, library, mesh, depth):
    """By receiver, how `corf check sionna` calls those of our paths that Sionna RT computes alike when it is told their faces."""
    import numpy as np
    from sionna_live import compare

    tx, receivers = np.float32(room.tx), np.float32(room.receivers)
    lists, labels = corf.paths(scene, tx, receivers, depth), []
    for index, paths in enumerate(lists):
        paths = [path for path in paths if path["types"]]
        places = [[mesh.triangles_at(name, v)[0] for name, v in zip(p["objects"], p["vertices"])] for p in paths]
        chains = [(index, p["types"], p["vertices"], place) for p, place in zip(paths, places)]
        alike = lambda p, a: a is not None and abs(a - p["a"]) <= compare.MAX_RELATIVE_A * abs(p["a"])
        computed = zip(paths, library.told(tx, receivers, chains, depth))
        labels.append({label(p["types"], p["objects"]) for p, a in computed if alike(p, a)})
    return labels


def beside_the_edge(fault):
    """Whether a fault is of a diffracted path's coefficient, which is compared with Sionna RT's own, and no larger than that is wrong by."""
    off = re.fullmatch(r"([SR]*X[SR]*) \[.*\]: \|da\|/\|a\| is off by ([-\d.e]+), .*", fault)
    return off is not None and float(off.group(2)) <= (AT_EDGE_A if off.group(1) == "X" else BY_EDGE_A)


def judge(corf, file, kind, accepts):
    """Whether `corf check sionna` agrees, sub-centimetre legs, maps and what Sionna RT accepts in another way aside, and a row of the table
    for every receiver."""
    call = [str(corf.binary), "check", "sionna", str(file), "--json", "--threads", str(corf.threads)]
    done = subprocess.run(call, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        environment.refuse(f"{' '.join(call)}\n{done.stderr.strip()}")
    [report], accepted, rows, passed = json.loads(done.stdout), None, [], True
    for index, comparison in enumerate(report["comparisons"]):
        short = [p for p in comparison["extra"] if float(p.rsplit(" ", 2)[1]) < SHORTEST_LEG_M]
        others = [p for p in comparison["extra"] if p not in short]
        if others:
            accepted = accepted or accepts()
            others = [p for p in others if p.split("]")[0] + "]" in accepted[index]]
        excused = lambda f: "Bartlett map" in f or beside_the_edge(f) or any(f.endswith(p) for p in short + others)
        faults = [fault for fault in comparison["faults"] if not excused(fault)]
        passed &= not faults
        if kind != "scattered":
            worst = f"\\|Δa\\|/\\|a\\| {comparison['max_relative_a']:.1e}"
            said = [f"{comparison['matched']} paths", len(comparison["missing"]), len(short), len(others), worst]
        else:
            numbers = [q for q in comparison["quantities"] if "map" not in q["name"]]
            off = max(abs(q["found"] - q["expected"]) / q["tolerance"] for q in numbers)
            total = next(q for q in numbers if "ends in a scattering" in q["name"])
            agree = sum(abs(q["found"] - q["expected"]) <= q["tolerance"] for q in numbers)
            worst = f"total {total['found'] / total['expected'] - 1:+.2%}; the worst is {off:.2f} of its tolerance off"
            said = [f"{agree} of {len(numbers)} powers", "", "", "", worst]
        rows.append(f"| {report_name(file)} | {comparison['name']} | " + " | ".join(map(str, said)) + f" | {'; '.join(faults)} |")
    return passed, rows


def report_name(file):
    return file.stem.replace("-", ", ")


if __name__ == "__main__":
    main()
