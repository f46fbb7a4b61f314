"""Every path of a small room, by trying all: no search that could miss one, and nothing shared with either tracer.

A path is a chain of mirrors, or one of mirrors, an edge and mirrors again, and lies where its length is stationary; what else its legs meet
they go through. All in double precision on the exported triangles.
"""

from itertools import product

import numpy as np

from . import float64_reference
from .meshes import distance_to_triangles

# Triangles of an object are one face where their normals and planes differ by less than this (unit normals, metres).
ONE_PLANE = 1e-5
# A point this close to a plane is neither in front of it nor behind, metres.
IN_PLANE_M = 1e-5
# A point lies on a face within this, metres: corners in single precision are not quite in one plane.
ON_FACE_M = 1e-6
# A leg that comes from a plane or ends in it does not go through it: rounding, metres.
ROUNDING_M = 1e-9
# Vertices of one path.
SAME_VERTEX_M = 1e-5
# A slab that passes on less of an amplitude, met straight on, is opaque (−300 dB).
OPAQUE = 1e-15


class Face:
    """A plane of an object with its triangles."""

    def __init__(self, shape, normal, point, triangles):
        self.object, self.material = shape["object"], shape["material"]
        self.normal, self.point, self.triangles = normal, point, triangles

    def height(self, p):
        return float(np.dot(p - self.point, self.normal))

    def holds(self, p):
        return distance_to_triangles(p, self.triangles).min() <= ON_FACE_M


class Edge:
    """Where two faces of an object meet, the open space around them wider than a half space."""

    def __init__(self, ends, faces, outward):
        self.ends, self.faces, self.outward = ends, faces, outward
        self.object = faces[0].object
        self.along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])

    def in_the_open(self, p):
        return any(np.dot(p - self.ends[0], n) > IN_PLANE_M for n in self.outward)

    def stationary(self, p, q):
        """Where the way from p over the edge to q is shortest once unfolded; nothing beside the edge."""
        (u, rho), (v, sigma) = (self.cylindrical(x) for x in (p, q))
        if rho <= 0 or sigma <= 0:
            return None
        at = (u * sigma + v * rho) / (rho + sigma)
        inside = 0 < at < np.linalg.norm(self.ends[1] - self.ends[0])
        return self.ends[0] + at * self.along if inside else None

    def cylindrical(self, p):
        u = np.dot(p - self.ends[0], self.along)
        return u, np.linalg.norm(p - self.ends[0] - u * self.along)


class Enumeration:
    """The paths of a room, given its exported triangles and radio.json."""

    def __init__(self, meshes, radio):
        self.faces = [face for shape, corners in zip(meshes.shapes, meshes.corners) for face in faces(shape, corners)]
        self.edges = edges(self.faces)
        self.opaque = {id for id, m in radio["materials"].items() if is_opaque(m, radio["frequency_hz"])}

    def by_mirrors(self, tx, rx, depth):
        """(types, objects, corners) of every path with up to `depth` mirrors and slabs."""
        chains = (chain for k in range(depth + 1) for chain in self.images(tx, k))
        found = (self.mirrored(tx, rx, image, chain, depth) for image, chain in chains)
        return [path for path in found if path is not None]

    def by_edges(self, tx, rx, depth):
        """(types, objects, corners) of every path with up to `depth` interactions of which one is at an edge."""
        before, after = ([list(self.images(end, k)) for k in range(depth)] for end in (tx, rx))
        splits = [(i, j) for i in range(depth) for j in range(depth - i)]
        found = (
            self.diffracted(tx, rx, first, edge, second, depth)
            for i, j in splits
            for first, second, edge in product(before[i], after[j], self.edges)
        )
        return [path for path in found if path is not None]

    def images(self, point, count):
        """(image, faces with the image before each) of every chain of so many mirrors."""
        if count == 0:
            yield point, []
            return
        for image, chain in self.images(point, count - 1):
            for face in self.faces:
                if abs(face.height(image)) > IN_PLANE_M and (not chain or face is not chain[-1][0]):
                    yield image - 2 * face.height(image) * face.normal, [*chain, (face, image)]

    def corners(self, chain, image, end):
        """Where the way by a chain with this image to `end` is mirrored, in the chain's order; nothing where it misses a face."""
        corner, corners = end, []
        for face, before in reversed(chain):
            here, there = face.height(corner), face.height(image)
            if here * there >= 0:
                return None
            corner = corner + (image - corner) * (here / (here - there))
            if not face.holds(corner):
                return None
            corners.append(corner)
            image = before
        return corners[::-1]

    def mirrored(self, tx, rx, image, chain, depth):
        corners = self.corners(chain, image, rx)
        return None if corners is None else self.with_slabs(tx, rx, mirrors(chain), corners, depth)

    def diffracted(self, tx, rx, before, edge, after, depth):
        if not all(edge.in_the_open(image) for image, _ in (before, after)):
            return None
        at = edge.stationary(before[0], after[0])
        # A mirror does not show an edge of its own.
        if at is None or any(chain and abs(chain[-1][0].height(at)) < IN_PLANE_M for _, chain in (before, after)):
            return None
        there, back = (self.corners(chain, image, at) for image, chain in (before, after))
        if there is None or back is None:
            return None
        turns = [*mirrors(before[1]), ("X", edge.object, edge.faces), *mirrors(after[1])[::-1]]
        return self.with_slabs(tx, rx, turns, [*there, at, *back[::-1]], depth)

    def with_slabs(self, tx, rx, turns, corners, depth):
        """The path with what its legs go through; nothing where that makes too many interactions or lets nothing pass."""
        points, types, objects, vertices = [tx, *corners, rx], "", [], []
        for i, (a, b) in enumerate(zip(points, points[1:])):
            at_ends = [face for turn in turns[max(i - 1, 0) : i + 1] for face in turn[2]]
            crossed = [c for c in (crossing(f, a, b) for f in self.faces if not any(f is g for g in at_ends)) if c]
            for _, face, vertex in sorted(crossed, key=lambda c: c[0]):
                if face.material in self.opaque:
                    return None
                types, objects, vertices = types + "R", [*objects, face.object], [*vertices, vertex]
            if i < len(turns):
                types, objects, vertices = types + turns[i][0], [*objects, turns[i][1]], [*vertices, corners[i]]
        return (types, objects, np.array(vertices).reshape(-1, 3)) if len(types) <= depth else None


def mirrors(chain):
    """(type, object, faces) of each."""
    return [("S", face.object, (face,)) for face, _ in chain]


def crossing(face, a, b):
    """(where along, the face, the point) if the leg goes through it."""
    here, there = face.height(a), face.height(b)
    if here * there >= 0 or min(abs(here), abs(there)) < ROUNDING_M:
        return None
    t = here / (here - there)
    point = a + (b - a) * t
    return (t, face, point) if face.holds(point) else None


def faces(shape, corners):
    """A shape's triangles by plane."""
    grouped = []
    for triangle in corners:
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        normal = normal / np.linalg.norm(normal)
        for face in grouped:
            sign = np.sign(np.dot(normal, face.normal))
            if np.linalg.norm(normal - sign * face.normal) < ONE_PLANE and abs(face.height(triangle[0])) < ONE_PLANE:
                face.triangles = np.concatenate([face.triangles, triangle[None]])
                break
        else:
            grouped.append(Face(shape, normal, triangle[0], triangle[None]))
    return grouped


def edges(faces):
    """Edges of two faces whose open side is wider than a half space."""
    owners = {}
    for face in faces:
        for triangle in face.triangles:
            for i in range(3):
                ends = tuple(sorted(map(tuple, (triangle[i], triangle[(i + 1) % 3]))))
                owners.setdefault((face.object, ends), []).append((face, triangle[(i + 2) % 3]))
    found = []
    for (_, ends), own in owners.items():
        if len(own) != 2 or own[0][0] is own[1][0]:
            continue
        (f, far_of_f), (g, far_of_g) = own
        # Away from the other face: the open space.
        outward = [-np.sign(face.height(far)) * face.normal for face, far in ((f, far_of_g), (g, far_of_f))]
        found.append(Edge(np.array(ends), (f, g), outward))
    return found


def is_opaque(material, frequency_hz):
    eta, wavelength = float64_reference.permittivity(material, frequency_hz), float64_reference.SPEED_OF_LIGHT / frequency_hz
    return max(abs(t) for t in float64_reference.slab(1.0, eta, material["thickness_m"], wavelength)[2:]) < OPAQUE


def compare(ours, enumerated):
    """(number in both, ours alone, enumerated alone, largest distance of vertices of the former in metres): paths are the same where their
    types and objects are and all vertices within `SAME_VERTEX_M`."""
    left, alone, apart_m = list(enumerated), [], 0.0
    for path in ours:
        alike = [other for other in left if other[0] == path["types"] and other[1] == path["objects"]]
        distances = [np.linalg.norm(other[2] - path["vertices"], axis=1).max(initial=0.0) for other in alike]
        nearest = int(np.argmin(distances)) if alike else None
        if nearest is None or distances[nearest] > SAME_VERTEX_M:
            alone.append(path)
        else:
            apart_m = max(apart_m, distances[nearest])
            left = [other for other in left if other is not alike[nearest]]
    return len(enumerated) - len(left), alone, left, apart_m
