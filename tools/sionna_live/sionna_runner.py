"""Sionna RT's side: the exported scene, its path solver, and the chains it is told."""

import hashlib
import json
import pickle
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import sionna.rt as rt
from sionna.rt.path_solvers.field_calculator import FieldCalculator
from sionna.rt.path_solvers.image_method import ImageMethod
from sionna.rt.path_solvers.paths_buffer import PathsBuffer
from sionna.rt.path_solvers.sample_data import SampleData
from sionna.rt.utils import WedgeGeometry

# Changes when what is remembered changes.
CACHE_VERSION = "1"
LETTER = {0: "", 1: "S", 2: "D", 4: "R", 8: "X"}
FLAG = {letter: flag for flag, letter in LETTER.items()}


def hash_of_folder(folder):
    """Of everything in an exported scene but its receivers."""
    radio = {k: v for k, v in json.loads((folder / "radio.json").read_text()).items() if k != "poses"}
    digest = hashlib.sha256(json.dumps(radio, sort_keys=True).encode())
    for file in sorted([folder / "scene.xml", *folder.glob("meshes/*.ply")]):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def diffuse_cap(samples, receivers):
    """Room for paths: the lobby's receivers see a sixteenth of the rays. `Theirs.solve` refuses a full buffer."""
    return max(int(samples) * len(receivers) // 6, 100_000)


def ends_scattering(interactions):
    """Whether the last interaction of every path is a scattering: interactions (depth, …), 0 for none."""
    last = np.zeros(interactions.shape[1:], dtype=interactions.dtype)
    for at_depth in interactions:
        last = np.where(at_depth != 0, at_depth, last)
    return last == FLAG["D"]


class Theirs:
    """A folder of `corf scene export --to sionna`, loaded, with one isotropic or other element at each end."""

    def __init__(self, folder, cache=None):
        folder = Path(folder)
        self.cache = Path(cache) if cache else None
        self.scene_hash = hash_of_folder(folder)
        self.radio = json.loads((folder / "radio.json").read_text())
        self.scene = rt.load_scene(str(folder / "scene.xml"), merge_shapes=False)
        self.scene.frequency = self.radio["frequency_hz"]
        for name, material in self.radio["materials"].items():
            lobe = {"directive": rt.DirectivePattern, "backscatter": rt.BackscatteringPattern}.get(material["scattering_pattern"])
            if lobe:
                names = {"alpha_r": "alpha_r", "alpha_i": "alpha_i", "lambda": "lambda_"}
                exponents = {theirs: material[ours] for ours, theirs in names.items() if material.get(ours) is not None}
                self.scene.radio_materials[name].scattering_pattern = lobe(**exponents)
        for end, antenna in (("tx_array", self.radio["transmitter"]), ("rx_array", self.radio["receiver"])):
            array = rt.PlanarArray(num_rows=1, num_cols=1, pattern=antenna["pattern"], polarization=antenna["polarization"])
            setattr(self.scene, end, array)
        by_id = {shape["id"]: index for index, shape in enumerate(self.radio["shapes"])}
        # The library's numbers of shapes, which differ between processes, and ours.
        self.shape_of = {int(o.object_id): by_id[name] for name, o in self.scene.objects.items()}
        self.number_of = {shape: number for number, shape in self.shape_of.items()}
        self.object_of = {number: self.radio["shapes"][shape]["object"] for number, shape in self.shape_of.items()}
        self.solver = rt.PathSolver()
        self.devices = []

    def remembered(self, compute, what):
        """The result of an earlier run on the same scene with the same arguments, where a cache is kept."""
        if self.cache is None:
            return compute()
        key = hashlib.sha256(f"{CACHE_VERSION} {self.scene_hash} {what}".encode()).hexdigest()
        path = self.cache / f"{key[:24]}.pickle"
        if path.exists():
            return pickle.loads(path.read_bytes())
        result = compute()
        self.cache.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".tmp")
        unfinished.write_bytes(pickle.dumps(result))
        unfinished.replace(path)
        return result

    def place(self, transmitters, receivers):
        """Puts the ends of the links where they are wanted."""
        for name in self.devices:
            self.scene.remove(name)
        orientation = mi.Point3f(*self.radio["transmitter"]["orientation_rad"])
        ends = [
            rt.Transmitter(f"tx{i}", position=mi.Point3f(*map(float, p)), orientation=orientation)
            for i, p in enumerate(transmitters)
        ]
        ends += [rt.Receiver(f"rx{i}", position=mi.Point3f(*map(float, p))) for i, p in enumerate(receivers)]
        self.devices = [end.name for end in ends]
        for end in ends:
            self.scene.add(end)

    def solve(self, transmitters, receivers, **options):
        """One call of the path solver; arrays by receiver, transmitter and path (and depth first)."""
        self.place(transmitters, receivers)
        found = self.solver(self.scene, **options)
        n, m = len(receivers), len(transmitters)
        array = lambda x, *lead: np.array(x).reshape(*lead, n, m, -1)
        valid = array(found.valid)
        if options["max_num_paths_per_src"] <= valid.sum() / m:
            raise RuntimeError("the path cap was reached: paths are lost; raise max_num_paths_per_src")
        depth = options["max_depth"]
        return {
            "valid": valid,
            "a": array(found.a[0]) + 1j * array(found.a[1]),
            "tau": array(found.tau),
            **{key: array(getattr(found, key)) for key in ("theta_r", "phi_r", "theta_t", "phi_t")},
            "interactions": array(found.interactions, depth),
            "objects": array(found.objects, depth),
            "primitives": array(found.primitives, depth),
            "vertices": np.moveaxis(np.array(found.vertices).reshape(depth, n, m, -1, 3), 0, -2),
        }

    def specular(self, transmitters, receivers, depth, samples, seed, cap=10_000_000, diffraction=False):
        """Specular and transmitted paths, and diffracted ones where asked, as lists `[receiver][transmitter]` of dictionaries like corf's."""
        ends = (np.array(transmitters).tobytes(), np.array(receivers).tobytes())
        what = ("diffracted" if diffraction else "specular", *ends, depth, int(samples), seed, int(cap))

        def compute():
            s = self.solve(
                transmitters,
                receivers,
                max_depth=depth,
                samples_per_src=int(samples),
                max_num_paths_per_src=int(cap),
                diffuse_reflection=False,
                diffraction=diffraction,
                seed=seed,
            )
            return [[self._paths(s, r, t) for t in range(len(transmitters))] for r in range(len(receivers))]

        return self.remembered(compute, what)

    def _paths(self, s, r, t):
        paths = []
        for i in np.flatnonzero(s["valid"][r, t]):
            types = "".join(LETTER[int(k)] for k in s["interactions"][:, r, t, i])
            k = len(types)
            paths.append(
                {
                    "types": types,
                    "vertices": s["vertices"][r, t, i, :k].astype(float),
                    "a": complex(s["a"][r, t, i]),
                    "tau": float(s["tau"][r, t, i]),
                    **{key: float(s[key][r, t, i]) for key in ("theta_r", "phi_r", "theta_t", "phi_t")},
                    "objects": [self.object_of[int(o)] for o in s["objects"][:k, r, t, i]],
                    "triangles": [
                        (self.shape_of[int(o)], int(p)) for o, p in zip(s["objects"][:k, r, t, i], s["primitives"][:k, r, t, i])
                    ],
                }
            )
        return paths

    def solve_scattered(self, tx, receivers, depth, samples, seed):
        """`solve` from one transmitter with diffuse reflection."""
        return self.solve(
            [tx],
            receivers,
            max_depth=depth,
            samples_per_src=int(samples),
            max_num_paths_per_src=diffuse_cap(samples, receivers),
            diffuse_reflection=True,
            seed=seed,
        )

    def diffuse(self, tx, receivers, depth, samples, seed):
        """As `scattered`, from the cache where there is one."""
        what = ("diffuse", np.array(tx).tobytes(), np.array(receivers).tobytes(), depth, int(samples), seed)
        return self.remembered(lambda: self.scattered(tx, receivers, depth, samples, seed), what)

    def scattered(self, tx, receivers, depth, samples, seed):
        """One run with diffuse reflection; per receiver: power by (types, object of the last scattering), and the arrivals of the diffuse
        paths that end with a scattering: directions (n, 3) and powers (n)."""
        s = self.solve_scattered(tx, receivers, depth, samples, seed)
        results = []
        for r in range(len(receivers)):
            valid = s["valid"][r, 0]
            kinds = s["interactions"][:, r, 0][:, valid].astype(np.int64)
            power = np.abs(s["a"][r, 0][valid].astype(np.complex128)) ** 2
            objects = s["objects"][:, r, 0][:, valid].astype(np.int64)
            is_diffuse = kinds == FLAG["D"]
            # The last scattering, as an index into the depth; −1 without one.
            index = np.arange(depth)[:, None]
            last_scattering = np.where(is_diffuse, index, -1).max(0)
            scatters = last_scattering >= 0
            scatterer = np.where(scatters, np.take_along_axis(objects, np.maximum(last_scattering, 0)[None], 0)[0], -1)
            code = (kinds * (16**index)).sum(0)
            powers = {}
            for key in np.unique(np.stack([code[scatters], scatterer[scatters]]), axis=1).T:
                chosen = (code == key[0]) & (scatterer == key[1])
                types = "".join(LETTER[(int(key[0]) >> (4 * k)) & 15] for k in range(depth))
                object_name = self.object_of[int(key[1])]
                powers[types, object_name] = powers.get((types, object_name), 0.0) + float(power[chosen].sum())
            ends = ends_scattering(kinds)
            theta, phi = s["theta_r"][r, 0][valid][ends].astype(float), s["phi_r"][r, 0][valid][ends].astype(float)
            directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], 1)
            results.append({"powers": powers, "directions": directions, "power": power[ends], "paths": int(valid.sum())})
        return results

    def told(self, tx, receivers, chains, depth):
        """Hands chains of faces to the library's own image method and field computation, past its search for them: `chains` are
        (receiver index, types, vertices, [(shape, triangle)]). Returns per chain its coefficient, or None where it is refused.
        """
        if not chains:
            return []
        self.place([tx], receivers)
        count = len(chains)
        source, target = mi.Point3f(*map(float, tx)), np.array(receivers, dtype=np.float32).T
        targets = mi.Point3f(*[mi.Float(np.ascontiguousarray(c)) for c in target])
        sources = mi.Point3f(mi.Float(source.x), mi.Float(source.y), mi.Float(source.z))
        samples = SampleData(1, count, depth, diffraction=False)
        buffer = PathsBuffer(count, depth, False)
        wedges = WedgeGeometry.build_with_size(count)
        for d in range(1, depth + 1):
            has = [len(c[1]) >= d for c in chains]
            pick = lambda f, other: [f(c) if h else other for c, h in zip(chains, has)]
            shapes = dr.reinterpret_array(mi.ShapePtr, mi.UInt(pick(lambda c: self.number_of[c[3][d - 1][0]], 0)))
            vertex = np.array(pick(lambda c: c[2][d - 1], np.zeros(3)), dtype=np.float32).T
            samples.insert(
                mi.UInt(d),
                mi.UInt(pick(lambda c: FLAG[c[1][d - 1]], 0)),
                shapes,
                mi.UInt(pick(lambda c: c[3][d - 1][1], 0)),
                wedges,
                mi.Point3f(*[mi.Float(np.ascontiguousarray(c)) for c in vertex]),
                mi.Float([1.0] * count),
                mi.Bool([True] * count),
            )
        ends = np.array([receivers[c[0]] for c in chains], dtype=float)
        first = np.array([c[2][0] for c in chains]) - np.array(tx, dtype=float)
        last = np.array([c[2][-1] for c in chains]) - ends
        unit = lambda v: mi.Vector3f(
            *[mi.Float(np.ascontiguousarray(c, dtype=np.float32)) for c in (v / np.linalg.norm(v, axis=1)[:, None]).T]
        )
        buffer.add_paths(
            mi.UInt([len(c[1]) for c in chains]),
            dr.arange(mi.UInt, count),
            samples,
            mi.Bool([False] * count),
            mi.UInt([c[0] for c in chains]),
            unit(first),
            unit(last),
            mi.Bool([True] * count),
        )
        buffer = ImageMethod()(
            scene=self.scene.mi_scene,
            paths=buffer,
            diffraction=False,
            diffraction_lit_region=True,
            src_positions=sources,
            tgt_positions=targets,
        )
        patterns = self.scene.tx_array.antenna_pattern.patterns, self.scene.rx_array.antenna_pattern.patterns
        turned = mi.Point3f(*[mi.Float([float(a)]) for a in self.radio["transmitter"]["orientation_rad"]])
        level = mi.Point3f(*[mi.Float([0.0] * len(receivers))] * 3)
        buffer = FieldCalculator()(
            wavelength=self.scene.wavelength,
            paths=buffer,
            samples_per_src=1,
            diffraction=False,
            src_positions=sources,
            tgt_positions=targets,
            src_orientations=turned,
            tgt_orientations=level,
            src_antenna_patterns=patterns[0],
            tgt_antenna_patterns=patterns[1],
        )
        valid, a = np.array(buffer.valid), buffer.a[0][0]
        return [complex(x, y) if v else None for v, x, y in zip(valid, np.array(a.real), np.array(a.imag))]
