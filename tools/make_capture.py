"""A COLMAP capture that another program made: Mitsuba 3 renders a room of boxes, pycolmap writes the model. Nothing of corf takes part.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-capture.txt
    .venv/bin/python tools/make_capture.py capture
    corf dataset import capture --from colmap --up=… --scale … --out data/capture      (the line that the script prints)

The room is 5 x 4 x 2.7 m, with checkers on its walls, a table, a shelf, a box and a ball. A hand-held camera goes once round it. Images have numbers with gaps and
words for names, as photographs do, and the world that the model is written in is turned, moved, and in units of its own. Points lie on the surfaces that
this script put there; each has a track of the images that see it, 0.3 px off as a feature detector's.
"""

import argparse
import math
from pathlib import Path

SIZE, FOCAL_PX = (320, 240), 240.0
# The same room for everyone.
SEED = 7
POINTS = 6000
FEATURE_ERROR_PX = 0.3
METRES_PER_UNIT = 0.62
ROOM = (5.0, 4.0, 2.7)
# Name: smallest and largest corner, two colours of the checkers, checkers a metre.
BOXES = {
    "table": ((1.8, 1.5, 0.0), (3.2, 2.4, 0.75), (0.55, 0.35, 0.2), (0.8, 0.6, 0.4), 6),
    "shelf": ((0.0, 2.9, 0.0), (0.4, 4.0, 1.9), (0.2, 0.35, 0.55), (0.75, 0.75, 0.7), 4),
    "crate": ((4.2, 0.2, 0.0), (4.8, 0.9, 0.6), (0.7, 0.2, 0.15), (0.95, 0.8, 0.3), 8),
}
BALL = ((2.5, 1.95, 0.95), 0.2)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="new folder for the capture")
    parser.add_argument("--images", type=int, default=32, help="number of images (default 32)")
    parser.add_argument("--samples", type=int, default=64, help="light paths a pixel (default 64)")
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"{args.out} exists")
    if not 4 <= args.images <= 999:
        parser.error("--images is from 4 to 999")
    return args


def rectangles():
    """All flat surfaces: name, corner, two edges, two colours, checkers a metre. The edges' cross product points to where it is seen from."""
    import numpy as np

    def box(low, high, inwards):
        (x0, y0, z0), (x1, y1, z1) = low, high
        dx, dy, dz = (np.array(v, float) for v in ((x1 - x0, 0, 0), (0, y1 - y0, 0), (0, 0, z1 - z0)))
        low, high = np.array(low, float), np.array(high, float)
        faces = [(low, dy, dx), (low, dx, dz), (low, dz, dy), (high, -dx, -dy), (high, -dz, -dx), (high, -dy, -dz)]
        return [(corner, b, a) if inwards else (corner, a, b) for corner, a, b in faces]

    names = ("floor", "front", "left", "ceiling", "back", "right")
    walls = {
        "floor": ((0.45, 0.42, 0.4), (0.6, 0.58, 0.55), 2),
        "ceiling": ((0.85, 0.85, 0.85), (0.75, 0.75, 0.75), 1),
        "front": ((0.75, 0.7, 0.6), (0.55, 0.6, 0.5), 3),
        "back": ((0.6, 0.7, 0.75), (0.75, 0.75, 0.65), 3),
        "left": ((0.75, 0.6, 0.6), (0.6, 0.55, 0.7), 3),
        "right": ((0.6, 0.75, 0.65), (0.8, 0.75, 0.6), 3),
    }
    found = [(n, *face, *walls[n]) for n, face in zip(names, box((0, 0, 0), ROOM, inwards=True))]
    for name, (low, high, *colours) in BOXES.items():
        found += [(f"{name}-{i}", *face, *colours) for i, face in enumerate(box(low, high, inwards=False))]
    return found


def scene(mi):
    """The room for Mitsuba."""
    import numpy as np

    parts = {"type": "scene", "integrator": {"type": "path", "max_depth": 4}}
    for name, corner, a, b, dark, light, per_metre in rectangles():
        # Mitsuba's rectangle reaches from -1 to 1 in its own x and y.
        normal = np.cross(a, b)
        to_world = np.eye(4)
        to_world[:3, 0], to_world[:3, 1], to_world[:3, 2] = a / 2, b / 2, normal / np.linalg.norm(normal)
        to_world[:3, 3] = corner + (a + b) / 2
        # Two checkers of one colour make a period of its texture coordinates.
        periods = [0.5 * per_metre * float(np.linalg.norm(v)) for v in (a, b)]
        checkers = {
            "type": "checkerboard",
            "color0": {"type": "rgb", "value": list(dark)},
            "color1": {"type": "rgb", "value": list(light)},
            "to_uv": mi.ScalarTransform4f().scale([periods[0], periods[1], 1.0]),
        }
        material = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": checkers}}
        parts[name] = {"type": "rectangle", "to_world": mi.ScalarTransform4f(to_world), "bsdf": material}
    parts["ball"] = {
        "type": "sphere",
        "center": list(BALL[0]),
        "radius": BALL[1],
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.75, 0.3, 0.35]}},
    }
    for i, x in enumerate((1.4, 3.6)):
        # Looking down, a hand under the ceiling.
        at = mi.ScalarTransform4f().translate([x, 2.0, ROOM[2] - 0.05]).rotate([1, 0, 0], 180).scale([0.5, 0.6, 1.0])
        parts[f"lamp-{i}"] = {"type": "rectangle", "to_world": at, "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [6.0, 5.8, 5.4]}}}
    return mi.load_dict(parts)


def poses(count):
    """world_from_camera in OpenCV axes, once round the room and outwards and inwards as a hand goes."""
    import numpy as np

    found = []
    for i in range(count):
        turn = 2 * math.pi * i / count
        position = np.array([2.5 + 1.55 * math.cos(turn), 2.0 + 1.25 * math.sin(turn), 1.5 + 0.12 * math.sin(3 * turn)])
        # Past the table in the middle to the wall behind it, now left, now right.
        side = 0.45 * math.sin(2 * turn)
        target = np.array([2.5 - 1.6 * math.cos(turn + side), 2.0 - 1.4 * math.sin(turn + side), 0.95 + 0.2 * math.cos(2 * turn)])
        forward = (target - position) / np.linalg.norm(target - position)
        roll = math.radians(4) * math.sin(5 * turn)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        right, down = math.cos(roll) * right + math.sin(roll) * down, math.cos(roll) * down - math.sin(roll) * right
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, down, forward, position
        found.append(pose)
    return found


def render(mi, room, pose, samples, seed):
    """An 8-bit sRGB image."""
    import numpy as np

    # Mitsuba's cameras look along +z with x to the left and y up.
    to_world = pose @ np.diag([-1.0, -1.0, 1.0, 1.0])
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": math.degrees(2 * math.atan(0.5 * SIZE[0] / FOCAL_PX)),
            "fov_axis": "x",
            "near_clip": 0.01,
            "to_world": mi.ScalarTransform4f(to_world),
            "film": {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "rfilter": {"type": "box"}},
            "sampler": {"type": "multijitter", "sample_count": samples},
        }
    )
    picture = mi.render(room, sensor=sensor, spp=samples, seed=seed)
    return np.array(mi.Bitmap(picture).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True))


def surface_points(rng):
    """Points on the surfaces, as many on each as its share of the area."""
    import numpy as np

    flat = [r for r in rectangles() if not r[0].endswith("-0") or r[0].split("-")[0] not in BOXES]
    areas = np.array([np.linalg.norm(np.cross(a, b)) for _, _, a, b, *_ in flat])
    which = rng.choice(len(flat), size=POINTS, p=areas / areas.sum())
    u, v = rng.random((2, POINTS))
    return np.array([flat[k][1] + s * flat[k][2] + t * flat[k][3] for k, s, t in zip(which, u, v)])


def hidden(mi, room, origin, points):
    """Which points have something before them."""
    import numpy as np

    blocked = []
    for point in points:
        way = point - origin
        distance = float(np.linalg.norm(way))
        ray = mi.Ray3f(mi.Point3f(*map(float, origin)), mi.Vector3f(*map(float, way / distance)))
        ray.maxt = distance - 1e-3
        blocked.append(bool(room.ray_test(ray)))
    return np.array(blocked, dtype=bool)


def names(count, rng):
    """Numbers that rise with gaps, and a word behind some, as photographs come."""
    numbers = 140 + rng.integers(1, 9, size=count).cumsum()
    words = ["", "", "_HDR", "-edited", " (2)"]
    return [f"IMG_{number}{words[rng.integers(len(words))]}.png" for number in numbers]


def main():
    args = arguments()
    import mitsuba as mi
    import numpy as np
    import pycolmap
    from PIL import Image

    mi.set_variant("scalar_rgb")
    rng = np.random.default_rng(SEED)
    room, views = scene(mi), poses(args.images)
    (args.out / "images").mkdir(parents=True)
    (args.out / "sparse/0").mkdir(parents=True)

    # The world of the model: a turn about an odd axis, other units, and an origin elsewhere.
    axis = np.array([0.31, -0.82, 0.48])
    turn = pycolmap.Rotation3d(axis / np.linalg.norm(axis) * 2.1).matrix()
    offset = np.array([12.5, -7.25, 3.0])
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model="SIMPLE_PINHOLE", width=SIZE[0], height=SIZE[1], params=[FOCAL_PX, SIZE[0] / 2, SIZE[1] / 2], camera_id=1)
    model.add_camera_with_trivial_rig(camera)
    points, tracks, colours = surface_points(rng), [[] for _ in range(POINTS)], np.zeros((POINTS, 3))
    for index, (pose, name) in enumerate(zip(views, names(args.images, rng))):
        picture = render(mi, room, pose, args.samples, seed=index)
        Image.fromarray(picture).save(args.out / "images" / name)
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = FOCAL_PX * local[:, :2] / local[:, 2:] + np.array(SIZE) / 2
        inside = np.flatnonzero((local[:, 2] > 0.1) & (at >= 0).all(1) & (at < SIZE).all(1))
        seen = inside[~hidden(mi, room, pose[:3, 3], points[inside])]
        places = at[seen] + rng.normal(0, FEATURE_ERROR_PX, (len(seen), 2))
        for k, point in enumerate(seen):
            tracks[point].append((index + 1, k))
            colours[point] += picture[int(at[point, 1]), int(at[point, 0])]
        rotation = turn @ pose[:3, :3]
        position = turn @ pose[:3, 3] / METRES_PER_UNIT + offset
        cam_from_world = pycolmap.Rigid3d(np.column_stack([rotation.T, -rotation.T @ position]))
        image = pycolmap.Image(name=name, keypoints=places, camera_id=1, image_id=index + 1)
        model.add_image_with_trivial_frame(image, cam_from_world)
        print(f"{index + 1} of {args.images}: {name}, {len(seen)} points", flush=True)
    kept = 0
    for point, track, colour in zip(points, tracks, colours):
        # What one image alone sees cannot be triangulated.
        if len(track) >= 2:
            elements = [pycolmap.TrackElement(image, k) for image, k in track]
            model.add_point3D(turn @ point / METRES_PER_UNIT + offset, pycolmap.Track(elements), (colour / len(track)).astype(np.uint8))
            kept += 1
    model.write_binary(str(args.out / "sparse/0"))
    up = ",".join(f"{v:.9f}" for v in turn[:, 2])
    print(f"{args.images} images, {kept} points. Read it with\n\n    corf dataset import {args.out} --from colmap --up={up} --scale {METRES_PER_UNIT} --out DATASET")


if __name__ == "__main__":
    main()
