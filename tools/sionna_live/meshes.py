"""The exported triangles, and changed copies of a scene that both sides can read."""

import re
from pathlib import Path

import numpy as np

# Surfaces this close are in one place.
ON_SURFACE_M = 1e-5


def read_ply(path):
    """Vertices (float32) and triangles of a binary PLY of `corf scene export`."""
    data = Path(path).read_bytes()
    begin = data.index(b"end_header\n") + 11
    words = data[:begin].decode().split()
    vertices, faces = (int(words[words.index(what) + 1]) for what in ("vertex", "face"))
    positions = np.frombuffer(data, "<f4", 3 * vertices, begin).reshape(-1, 3)
    table = np.frombuffer(data, np.dtype([("n", "u1"), ("i", "<u4", 3)]), faces, begin + 12 * vertices)
    return positions, table["i"]


class Meshes:
    """Triangle corners (float64) by exported shape, and which triangle a point lies on."""

    def __init__(self, folder, radio):
        self.shapes = radio["shapes"]
        self.corners = []
        for shape in self.shapes:
            positions, triangles = read_ply(Path(folder) / shape["file"])
            self.corners.append(positions.astype(float)[triangles])
        self.of_object = {}
        for index, shape in enumerate(self.shapes):
            self.of_object.setdefault(shape["object"], []).append(index)
        self.triangles_of_object = {o: sum(len(self.corners[i]) for i in indices) for o, indices in self.of_object.items()}

    def triangles_at(self, object_name, point):
        """(shape index, triangle) for each of the object's materials that is at a point of its surface, the nearest first."""
        found = []
        for index in self.of_object[object_name]:
            distance = distance_to_triangles(point, self.corners[index])
            found.append((float(distance.min()), index, int(distance.argmin())))
        found.sort()
        return [(index, triangle) for distance, index, triangle in found if distance <= found[0][0] + ON_SURFACE_M]

    def plane(self, index, triangle):
        """(unit normal, a corner) of a triangle."""
        a, b, c = self.corners[index][triangle]
        normal = np.cross(b - a, c - a)
        return normal / np.linalg.norm(normal), a


def distance_to_triangles(point, corners):
    """An upper bound of the distances from a point to triangles (n, 3, 3) that is exact on and over them."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    unit = normal / area[:, None]
    height = ((point - a) * unit).sum(1)
    foot = point - height[:, None] * unit
    # How far the foot lies outside of each edge.
    outside = np.zeros(len(corners))
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        length = np.maximum(np.linalg.norm(edge, axis=1), 1e-300)
        outward = np.cross(edge, unit) / length[:, None]
        outside = np.maximum(outside, ((foot - p) * outward).sum(1))
    return np.hypot(height, np.maximum(outside, 0.0))


def with_materials(scene, target, materials, change):
    """Writes a copy of a scene file in which `change(material)` has altered the radio materials of radio.json; returns its path."""
    scene, target = Path(scene).resolve(), Path(target)
    text = scene.read_text()
    mesh = re.search(r'(?m)^\s*file\s*=\s*"([^"]+)"', text)
    text = text[: mesh.start()] + f'file = "{(scene.parent / mesh.group(1)).as_posix()}"' + text[mesh.end() :]
    text = re.split(r"(?m)^\[radio_materials\b", text)[0] if "[radio_materials" in text else text
    tables = []
    for material in materials.values():
        changed = change(dict(material))
        lobe = f'scattering_pattern = "{changed["scattering_pattern"]}"\n'
        lobe += "".join(f"{key} = {changed[key]}\n" for key in ("alpha_r", "alpha_i", "lambda") if changed.get(key) is not None)
        tables.append(
            f'[radio_materials."{changed["name"]}"]\nid = "{changed["radio_id"]}"\n'
            f"relative_permittivity = {changed['relative_permittivity']!r}\nconductivity_s_per_m = {changed['conductivity_s_per_m']!r}\n"
            f"thickness_m = {changed['thickness_m']!r}\nscattering_coefficient = {changed['scattering_coefficient']!r}\n"
            f"xpd = {changed['xpd_coefficient']!r}\n{lobe}"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text + "\n" + "\n".join(tables))
    return target


def fewer(parts, count):
    """The parts with the largest triangles, about `count` triangles in all."""
    size = lambda part: areas(part[2]).mean()
    kept, total = [], 0
    for part in sorted(parts, key=size, reverse=True):
        if total + len(part[2]) <= count:
            kept.append(part)
            total += len(part[2])
    return kept


def more(parts, count):
    """The same surfaces in about `count` triangles: the largest ones quartered, again and again."""
    total = sum(len(p[2]) for p in parts)
    while total < count:
        area = np.concatenate([areas(p[2]) for p in parts])
        quartered = min((count - total + 2) // 3, total)
        least = np.partition(area, total - quartered)[total - quartered]
        parts = [(o, m, quarter(c, areas(c) >= least)) for o, m, c in parts]
        total = sum(len(p[2]) for p in parts)
    return parts


def areas(corners):
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def quarter(corners, chosen):
    """Splits the chosen triangles into four at the middles of their sides (rounded to float32 like every corner)."""
    a, b, c = (corners[chosen][:, i] for i in range(3))
    ab, bc, ca = ((p + q) / 2 for p, q in ((a, b), (b, c), (c, a)))
    new = [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate([corners[~chosen], *new]).astype(np.float32).astype(float)


def write_scene(folder, parts, radio, scene, keyframes):
    """Writes parts (object, material id, corners) as OBJ with a scene file and a dataset file of the original's transmitter, trajectory and
    radio materials; returns the paths of the two."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    used = sorted({m for _, m, _ in parts})
    (folder / "scene.mtl").write_text("".join(f"newmtl {m}\nKd 0.5 0.5 0.5\n" for m in used))
    with open(folder / "scene.obj", "w") as file:
        file.write("mtllib scene.mtl\n")
        count = 0
        for index, (name, material, corners) in enumerate(parts):
            file.write(f"o part_{index}\nusemtl {material}\n")
            # Nine digits bring a float32 back exactly.
            np.savetxt(file, corners.reshape(-1, 3), fmt="v %.9g %.9g %.9g")
            np.savetxt(file, count + 1 + np.arange(3 * len(corners)).reshape(-1, 3), fmt="f %d %d %d")
            count += 3 * len(corners)
    renamed = {m: {**radio["materials"][m], "name": m} for m in used}
    toml = with_materials(scene, folder / "scene.toml", renamed, lambda m: m)
    text = toml.read_text()
    mesh = re.search(r'(?m)^\s*file\s*=\s*"([^"]+)"', text)
    toml.write_text(text[: mesh.start()] + 'file = "scene.obj"' + text[mesh.end() :])
    dataset = folder / "dataset.toml"
    dataset.write_text(dataset_text(keyframes))
    return toml, dataset


def dataset_text(keyframes, scene="scene.toml", rf="width = 300\nheight = 200\ndirections = 400000\n"):
    """A dataset file with the smallest of images, at lobby147's radio size unless told."""
    return (
        f'name = "check"\nscene = "{scene}"\nkeyframes = {keyframes}\n[optical]\nwidth = 16\nheight = 9\n[rf]\n{rf}'
        "[split]\ntest_every = 8\n"
    )
