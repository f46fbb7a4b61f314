"""Fields as corf writes them, read by the programs that they are written for, with numbers that must come out.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-formats.txt
    npm install --prefix .npm @playcanvas/splat-transform@2.7.1
    .venv/bin/python tools/check_fields.py runs/a --corf target/release/corf --splat-transform .npm/node_modules/@playcanvas/splat-transform/bin/cli.mjs

`corf field export` writes both modalities in every format. Then

- plyfile reads every PLY: the columns are INRIA's in INRIA's order, the numbers those of the run's own files bit by bit; padded to degree 3 there are the
  45 columns `f_rest_*` that RF-3DGS's loader counts, and those the field has not are 0;
- splat-transform (PlayCanvas, with Niantic's own reader of .spz) reads every file and writes a PLY, in which plyfile finds the run's positions, sizes,
  opacities, covariances and colours again, turned as `file_from_world` says and within the format's steps. Colours are compared towards random directions by
  this file's own spherical harmonics, so that a wrong turn of the harmonics would show;
- splat-transform makes a .sog of the `sog-ready-ply` and reads it back, which keeps every Gaussian and its place;
- of `coupled.ply` it keeps no column of radio in .spz, .sog and .compressed.ply, as docs/export.md says.

Exit code 0: everything agrees; 1: something does not; 2: bad input.
"""

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
from pathlib import Path

# Single precision, of numbers of order 1.
ROUNDING = 2e-5
# Half a step of each: 8 bits of opacity and colour; of a quaternion in .splat 1/128, whose zero readers take for 127.5 or 128; of .spz 1/4096 m, 1/16 of ln(m), 10 bits of a component of a quaternion.
SPLAT = {"position": ROUNDING, "scale": ROUNDING, "opacity": 0.51 / 255, "turn_deg": 1.6, "colour": 0.51 / 255}
SPZ = {"position": 0.51 / 4096, "scale": 0.51 / 16, "opacity": 0.51 / 255, "turn_deg": 0.3, "colour": None}
EXACT = {"position": ROUNDING, "scale": ROUNDING, "opacity": ROUNDING, "turn_deg": 0.1, "colour": ROUNDING}
# Half a step of a degree-0 coefficient of .spz in colour, and of each of K − 1 others.
SPZ_DC, SPZ_REST = 0.282095 * 0.51 / (255 * 0.15), 0.51 / 128


class Failed(Exception):
    """Something does not agree."""


def insist(holds, what):
    if not holds:
        raise Failed(what)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run of corf-gs or rf-3dgs")
    parser.add_argument("--corf", required=True, help="the corf program")
    parser.add_argument("--splat-transform", type=Path, help="bin/cli.mjs of @playcanvas/splat-transform; without it only plyfile reads")
    args = parser.parse_args()
    if not (args.run / "run.json").is_file():
        parser.error(f"{args.run} holds no run.json")
    if args.splat_transform and not args.splat_transform.is_file():
        parser.error(f"{args.splat_transform} is not there")
    return args


def read_ply(path):
    """The columns of a PLY by plyfile, in its order, and its comments."""
    from plyfile import PlyData

    file = PlyData.read(str(path))
    vertices = file["vertex"]
    return {p.name: vertices[p.name] for p in vertices.properties}, [str(c) for c in file.comments]


def stacked(columns, names):
    import numpy as np

    return np.stack([columns[name].astype(np.float64) for name in names], axis=1)


def harmonics(columns):
    """(N, K, 3) of columns whose channels come one behind the other; one channel is grey."""
    import numpy as np

    channels = sum(name.startswith("f_dc_") for name in columns)
    rest = sum(name.startswith("f_rest_") for name in columns) // channels
    dc = stacked(columns, [f"f_dc_{c}" for c in range(channels)])[:, None]
    parts = [dc]
    if rest:
        flat = stacked(columns, [f"f_rest_{i}" for i in range(rest * channels)])
        parts.append(flat.reshape(len(dc), channels, rest).transpose(0, 2, 1))
    sh = np.concatenate(parts, axis=1)
    return np.repeat(sh, 3, axis=2) if channels == 1 else sh


def basis(d):
    """Real spherical harmonics of degrees 0 to 3 with the signs of the splatting literature, (n, 16), from the textbook's associated Legendre functions."""
    import numpy as np

    x, y, z = d.T
    azimuth, s = np.arctan2(y, x), np.hypot(x, y)
    # P_l^m with the phase (−1)^m.
    legendre = {
        (0, 0): 1 + 0 * z, (1, 0): z, (1, 1): -s, (2, 0): (3 * z**2 - 1) / 2, (2, 1): -3 * z * s, (2, 2): 3 * s**2,
        (3, 0): (5 * z**3 - 3 * z) / 2, (3, 1): -1.5 * (5 * z**2 - 1) * s, (3, 2): 15 * z * s**2, (3, 3): -15 * s**3,
    }
    out = []
    for l in range(4):
        for m in range(-l, l + 1):
            k = abs(m)
            norm = np.sqrt((2 * l + 1) / (4 * np.pi) / np.prod(np.arange(l - k + 1, l + k + 1, dtype=float)))
            turn = 1 if m == 0 else np.sqrt(2) * (np.cos(k * azimuth) if m > 0 else np.sin(k * azimuth))
            out.append(norm * legendre[l, k] * turn)
    return np.stack(out, axis=1)


def colours(sh, directions):
    """0.5 + Σ sh·Y, (n directions, N, 3), not clipped."""
    import numpy as np

    return 0.5 + np.einsum("dk,nkc->dnc", basis(directions)[:, : sh.shape[1]], sh)


def matrices(quaternions):
    import numpy as np

    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def check_columns(path, own, degree):
    """INRIA's columns in their order with the run's numbers, bit by bit where the run's own file has them."""
    import numpy as np

    columns, comments = read_ply(path)
    rest = 3 * ((degree + 1) ** 2 - 1)
    expected = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(rest)), "opacity"]
    expected += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]
    insist(list(columns) == expected, f"{path.name} has the columns {list(columns)}")
    for name in ("x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"):
        insist(np.array_equal(columns[name], own[name]), f"{path.name}: {name} is not the run's")
    have, wanted = harmonics(columns), harmonics(own)
    insist(np.array_equal(have[:, : wanted.shape[1]], wanted), f"{path.name}: other harmonics")
    insist(not have[:, wanted.shape[1] :].any(), f"{path.name}: padded with something")
    insist(f"SH degree: {degree}" in comments and "Vertical axis: 0 0 1" in comments, f"{path.name} says {comments}")


def compare(name, columns, own, turn, tolerance, degree):
    """A PLY that another program wrote, against the run's, turned."""
    import numpy as np

    axes, quaternion, scales = ["x", "y", "z"], [f"rot_{i}" for i in range(4)], [f"scale_{i}" for i in range(3)]
    insist(len(columns["x"]) == len(own["x"]), f"{name}: {len(columns['x'])} Gaussians of {len(own['x'])}")

    def near(what, a, b, most):
        worst = float(np.abs(a - b).max())
        insist(worst <= most, f"{name}: {what} off by {worst:.3g}, more than {most:.3g}")
        return worst

    worst = {"position": near("positions", stacked(columns, axes), stacked(own, axes) @ turn.T, tolerance["position"])}
    worst["ln scale"] = near("ln scales", stacked(columns, scales), stacked(own, scales), tolerance["scale"])
    opacity = lambda c: 1 / (1 + np.exp(-c["opacity"].astype(np.float64)))
    worst["opacity"] = near("opacities", opacity(columns), opacity(own), tolerance["opacity"])
    # An axis of an ellipsoid has no sign: a change of handedness turns them around.
    ours, theirs = turn @ matrices(stacked(own, quaternion)), matrices(stacked(columns, quaternion))
    angle = np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(ours + theirs, axis=1)) / 2))
    worst["axes, °"] = near("axes", angle, np.zeros_like(angle), tolerance["turn_deg"])
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(16, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    theirs, ours = harmonics(columns), harmonics(own)[:, : (degree + 1) ** 2]
    insist(theirs.shape[1] >= ours.shape[1], f"{name}: harmonics of {theirs.shape[1]} functions where {ours.shape[1]} are expected")
    most = tolerance["colour"] or SPZ_DC + SPZ_REST * float(np.abs(basis(directions)[:, 1 : ours.shape[1]]).sum(axis=1).max(initial=0))
    a, b = colours(theirs, directions @ turn.T), colours(ours, directions)
    if degree == 0:
        b = b.clip(0, 1)
    # What a format clips, and says so, is left out: coefficients beyond its range.
    inside = (np.abs(ours[:, 0]) < 3.3).all(1) & (np.abs(ours[:, 1:]) < 0.99).all((1, 2)) if tolerance is SPZ else np.ones(len(ours), bool)
    insist(inside.mean() > 0.5, f"{name}: most colours are beyond the format's range")
    worst["colour"] = near("colours", a[:, inside], b[:, inside], most)
    print("        " + ", ".join(f"{k} {v:.2g}" for k, v in worst.items()) + f"; colours of {inside.mean():.1%}")


class Checker:
    def __init__(self, args, folder):
        self.args, self.folder, self.results = args, folder, []

    def export(self, form, field, *more):
        out = self.folder / f"{field}{''.join(map(str, more))}.{'ply' if 'ply' in form else form}"
        if form == "sog-ready-ply":
            out = out.with_name("sog-" + out.name)
        command = [self.args.corf, "field", "export", self.args.run, "--to", form, "--field", field, "--out", out, "--json", *more]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
        insist(done.returncode == 0, done.stderr)
        return out, json.loads(done.stdout)

    def through(self, source, *stops):
        """What splat-transform makes of a file, as PLY columns and comments."""
        for stop in stops:
            target = self.folder / f"{source.name}-to.{stop}"
            done = subprocess.run(["node", str(self.args.splat_transform), "-w", "-g", "cpu", str(source), str(target)], capture_output=True, text=True)
            insist(done.returncode == 0 and target.is_file(), f"splat-transform cannot make {target.name}: {done.stderr or done.stdout}")
            source = target
        return read_ply(source)

    def check(self, name, test):
        try:
            test()
            print(f"ok      {name}")
            self.results.append(True)
        except Failed as failure:
            print(f"FAILED  {name}: {failure}")
            self.results.append(False)

    def field(self, field):
        import numpy as np

        own, _ = read_ply(self.args.run / f"{field}.ply")
        degree = int(round(np.sqrt(harmonics(own).shape[1]))) - 1
        turn_of = lambda said: np.array(said["file_from_world"])
        self.check(f"{field}: ply by plyfile", lambda: check_columns(self.export("ply", field)[0], own, degree))
        self.check(f"{field}: ply padded to 45 f_rest by plyfile", lambda: check_columns(self.export("ply", field, "--pad-sh", "3")[0], own, 3))
        if not self.args.splat_transform:
            print(f"skipped {field}: splat-transform is not named")
            return

        def by_splat_transform(form, tolerance, degree):
            out, said = self.export(form, field)
            columns, comments = self.through(out, "ply")
            # Its PLYs are those of y-down files: .spz, which has y up, is turned half around x.
            turn = np.diag([1.0, -1.0, -1.0]) @ turn_of(said) if form == "spz" else turn_of(said)
            compare(f"{form} by splat-transform", columns, own, turn, tolerance, degree)
            if form == "spz":
                header = gzip.decompress(out.read_bytes())[:16]
                insist(header[:4] == b"NGSP" and header[14] == int(said["antialiased"]), "the header's flag is not the run's filter")

        for form, tolerance, of in (("ply", EXACT, degree), ("sog-ready-ply", EXACT, degree), ("splat", SPLAT, 0), ("spz", SPZ, degree)):
            self.check(f"{field}: {form} by splat-transform", lambda: by_splat_transform(form, tolerance, of))
        self.check(f"{field}: sog", lambda: self.sog(field, own))

    def sog(self, field, own):
        import numpy as np

        out, said = self.export("sog-ready-ply", field)
        columns, _ = self.through(out, "sog", "ply")
        insist(len(columns["x"]) == len(own["x"]), f"{len(columns['x'])} Gaussians of {len(own['x'])}")
        # .sog sorts Gaussians along a curve: their places are compared axis by axis, sorted. Positions have 16 bits of ln(1 + |x|).
        ours = stacked(own, "xyz") @ np.array(said["file_from_world"]).T
        theirs = stacked(columns, "xyz")
        worst = float(np.abs(np.sort(ours, axis=0) - np.sort(theirs, axis=0)).max())
        insist(worst < 5e-3, f"positions are off by {worst} m")
        print(f"        position {worst:.2g} m")

    def coupled(self):
        """Radio's half of coupled.ply: what the program's documents say that these formats lose, they lose."""
        source = self.args.run / "coupled.ply"
        own, _ = read_ply(source)
        of_radio = [name for name in own if name.startswith("rf_")]
        insist(of_radio, "coupled.ply has no columns of radio")
        for form in ("spz", "sog", "compressed.ply"):
            columns, _ = self.through(source, form, "ply")
            left = [name for name in columns if name.startswith("rf_")]
            insist(len(columns["x"]) == len(own["x"]) and not left, f".{form} keeps {left}: docs/export.md says otherwise")
        print(f"        {len(of_radio)} columns of radio, none of them in .spz, .sog and .compressed.ply")


def main():
    args = arguments()
    with tempfile.TemporaryDirectory() as folder:
        checker = Checker(args, Path(folder))
        for field in ("optical", "rf"):
            if (args.run / f"{field}.ply").is_file():
                checker.field(field)
        if args.splat_transform and (args.run / "coupled.ply").is_file():
            checker.check("coupled.ply: radio's half is lost by splat-transform", checker.coupled)
    if not checker.results:
        print(f"{args.run} has no model")
    return 0 if checker.results and all(checker.results) else 1


if __name__ == "__main__":
    sys.exit(main())
