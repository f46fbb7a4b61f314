"""Two path sets of one link: which are the same, how well they agree, and what the others are."""

import numpy as np

from . import float64_reference

SPEED_OF_LIGHT = 299_792_458.0
# Tolerances of the comparison with a float32 tracer.
MAX_LENGTH_M = 1e-5
MAX_ANGLE_RAD = 5e-5
MAX_VERTEX_M = 1e-3
MAX_RELATIVE_A = 2e-2
MAX_A_OF_STRONGEST = 1e-3
MAX_POWER_DB = 0.01
# Sionna RT drops a path with a segment shorter than this.
SHORTEST_SEGMENT_M = 1e-2
# The same path of two runs.
SAME_RUN_M = 2e-5
SAME_RUN_A = 1e-3
# Paths of one type this close are one path that was found through two planes.
REPEAT_M = 2e-3
# A vertex this far from where its own faces mirror the ray to is not a specular path.
MAX_MIRROR_ERROR_M = 1e-3


def power_db(paths):
    """Noncoherent power, dB relative to 1 W transmitted."""
    return 10 * np.log10(max(sum(abs(p["a"]) ** 2 for p in paths), 1e-30))


def points(path, tx, rx):
    """All corners of the path from transmitter to receiver."""
    return np.vstack([tx, *path["vertices"], rx]).astype(float)


def length(path, tx, rx):
    """Length along the corners, metres."""
    return float(np.linalg.norm(np.diff(points(path, tx, rx), axis=0), axis=1).sum())


def direction(theta, phi):
    """Unit vector of a zenith and an azimuth."""
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def angle_between(p, q, end):
    """Angle between two paths' directions at the transmitter (`t`) or the receiver (`r`), radians."""
    a, b = (direction(x[f"theta_{end}"], x[f"phi_{end}"]) for x in (p, q))
    return float(2 * np.arcsin(min(1.0, np.linalg.norm(a - b) / 2)))


def vertex_distance(p, q):
    """Largest distance between corresponding vertices, metres; infinite for different types."""
    if p["types"] != q["types"]:
        return np.inf
    return float(np.linalg.norm(p["vertices"] - q["vertices"], axis=1).max()) if len(p["types"]) else 0.0


def sort_out(runs, tx, rx, meshes):
    """The library's paths of several runs (its search keeps what its rays meet first, which differs between runs): each path once, then
    what it returned beside them: repeats of a path found through another plane, and paths that no mirror makes.

    The library takes the place of a face for hit when the image in the plane that was hit lies within 1 cm of the image in its own, so that
    it returns one path of a floor and a second of a mat 4 mm above it, both off the floor.
    """
    paths = [dict(p, mirror_error_m=mirror_error(p, tx, rx, meshes)) for run in runs for p in run]
    kept, repeats, off_the_mirror = [], [], []
    for path in sorted(paths, key=lambda p: p["mirror_error_m"]):
        if any(
            vertex_distance(path, q) < SAME_RUN_M and abs(path["a"] - q["a"]) <= SAME_RUN_A * abs(q["a"])
            for q in kept + repeats + off_the_mirror
        ):
            continue
        if path["mirror_error_m"] > MAX_MIRROR_ERROR_M:
            off_the_mirror.append(path)
        elif any(vertex_distance(path, q) < REPEAT_M for q in kept):
            repeats.append(path)
        else:
            kept.append(path)
    return kept, repeats, off_the_mirror


def mirror_error(path, tx, rx, meshes):
    """How far the vertices lie from the exact image construction through the planes of the path's own triangles, metres."""
    planes = [meshes.plane(*place) for place in path["triangles"]]
    exact = float64_reference.exact_corners(path["types"], planes, tx, rx)
    return float(np.nan_to_num(np.linalg.norm(exact - path["vertices"], axis=1), nan=np.inf).max(initial=0.0))


def match(ours, theirs, tx, rx):
    """Pairs of same paths with their differences, and the indices of those without a partner on either side."""
    candidates = []
    for i, p in enumerate(ours):
        for j, q in enumerate(theirs):
            distance = vertex_distance(p, q)
            if distance < MAX_VERTEX_M:
                # Where two of ours run through the same points, the coefficient says which of them is meant.
                relative = min(abs(p["a"] - q["a"]) / abs(p["a"]), 1.0)
                candidates.append((distance / MAX_VERTEX_M + relative, distance, i, j))
    left, right, pairs = set(range(len(ours))), set(range(len(theirs))), []
    strongest = max((abs(p["a"]) for p in ours), default=1.0)
    for _, distance, i, j in sorted(candidates):
        if i in left and j in right:
            left.discard(i)
            right.discard(j)
            p, q = ours[i], theirs[j]
            da = abs(p["a"] - q["a"])
            pairs.append(
                {
                    "ours": i,
                    "theirs": j,
                    "types": p["types"],
                    "gain_db": 20 * np.log10(abs(p["a"])),
                    "length_m": abs(p["length_m"] - SPEED_OF_LIGHT * q["tau"]),
                    "aoa_rad": angle_between(p, q, "r"),
                    "aod_rad": angle_between(p, q, "t"),
                    "vertex_m": distance,
                    "relative_a": da / abs(p["a"]),
                    "a_of_strongest": da / strongest,
                }
            )
    return pairs, sorted(left), sorted(right)


def over_limits(pair):
    """Which tolerances a pair breaks."""
    limits = {
        "length_m": MAX_LENGTH_M,
        "aoa_rad": MAX_ANGLE_RAD,
        "aod_rad": MAX_ANGLE_RAD,
        "vertex_m": MAX_VERTEX_M,
        "relative_a": MAX_RELATIVE_A,
        "a_of_strongest": MAX_A_OF_STRONGEST,
    }
    return [key for key, limit in limits.items() if not pair[key] <= limit]


def shortest_segment(path, tx, rx):
    """Shortest leg, metres."""
    return float(np.linalg.norm(np.diff(points(path, tx, rx), axis=0), axis=1).min())


def coincident(path, others):
    """Whether another path runs through the very same points: two surfaces in one place."""
    return any(q is not path and vertex_distance(path, q) < 1e-9 for q in others)
