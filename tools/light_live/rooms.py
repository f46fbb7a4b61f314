"""What is compared: the lobby, and small rooms made here, each about one thing."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .environment import ROOT
from .gltf import Gltf

# Sides of a small room, metres. The trajectory below stands, at its beginning and halfway, in opposite corners and looks across.
ROOM_M = (5.0, 4.0, 2.8)
SCENE = """[scene]
file = "{mesh}"
[transmitter]
position_m = [2.5, 2.0, 2.3]
[trajectory]
waypoints_m = [[0.9, 0.7], [1.3, 1.02], [4.5, 2.9], [4.4, 3.58], [4.1, 3.3], [3.7, 2.98], [0.5, 1.1], [0.6, 0.42]]
height_m = 1.55
height_amplitude_m = 0.0
pitch_amplitude_deg = 0.0
yaw_amplitude_deg = 0.0
speed_m_per_s = 0.5
"""
RADIO = '[radio_materials."{name}"]\nid = "plasterboard"\nitu = "plasterboard"\nthickness_m = 0.013\nscattering_coefficient = 0.3\n'


@dataclass(frozen=True)
class Room:
    """A scene and the views of it: `views` evenly spaced poses of its trajectory."""

    name: str
    about: str
    scene: Path
    views: int
    size: tuple
    max_bounces: int = 64

    def dataset(self, path, samples, seed, spelling, radio):
        """Writes a dataset configuration of the views; returns its path."""
        width, height = self.size
        path.write_text(
            f'name = "{self.name}"\nscene = "{self.scene.resolve()}"\nkeyframes = {self.views}\nseed = {seed}\n'
            f"[optical]\nwidth = {width}\nheight = {height}\nhorizontal_fov_deg = 90.0\nsamples_per_pixel = {samples}\n"
            f"max_bounces = {self.max_bounces}\nexposure_ev = 0.0\nwrite_linear = true\n{spelling}\n{radio}"
        )
        return path


def lobby(views, size):
    """Poses 0, 49, 98 of lobby147 with three views: its 147 poses are evenly spaced as well."""
    return Room("lobby", "88 000 triangles, 70 materials, panes, screens, lamps", ROOT / "scenes/lobby.toml", views, size)


def _shell(gltf, walls, floor):
    """Six faces whose fronts look inwards."""
    x, y, z = ROOM_M
    gltf.quad("floor", (0, 0, 0), (x, 0, 0), (0, y, 0), floor, (4, 3))
    gltf.quad("ceiling", (0, 0, z), (0, y, 0), (x, 0, 0), walls)
    gltf.quad("south", (0, 0, 0), (0, 0, z), (x, 0, 0), walls)
    gltf.quad("north", (0, y, 0), (x, 0, 0), (0, 0, z), walls)
    gltf.quad("west", (0, 0, 0), (0, y, 0), (0, 0, z), walls)
    gltf.quad("east", (x, 0, 0), (0, 0, z), (0, y, 0), walls)


def _emits(strength):
    return {
        "emissiveFactor": [1, 0.92, 0.8],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}},
    }


def _lamp(gltf, material, low=(2.0, 1.5), high=(3.0, 2.5), z=2.7):
    """A rectangle that looks down."""
    gltf.quad("lamp", (low[0], low[1], z), (0, high[1] - low[1], 0), (high[0] - low[0], 0, 0), material)


def metal(gltf, brighter, without_lamp):
    """Rough metals of three roughnesses, one of them curved."""
    dim = lambda *c: tuple(min(1.0, v * brighter) for v in c)
    walls = gltf.material("walls", dim(0.7, 0.7, 0.68), roughness=0.9)
    floor = gltf.material("floor", dim(0.4, 0.35, 0.3), roughness=0.35)
    copper = gltf.material("copper", dim(0.95, 0.64, 0.54), metallic=1.0, roughness=0.3)
    steel = gltf.material("steel", dim(0.6, 0.6, 0.6), metallic=1.0, roughness=0.5)
    brass = gltf.material("brass", dim(0.9, 0.75, 0.4), metallic=1.0, roughness=0.2)
    paint = gltf.material("paint", dim(0.05, 0.1, 0.5), roughness=0.25)
    lamp = gltf.material("lamp", (0.5,) * 3, double_sided=False, **_emits(12))
    _shell(gltf, walls, floor)
    gltf.sphere("ball", (3.0, 2.2, 0.8), 0.6, copper)
    gltf.sphere("small ball", (1.6, 2.6, 0.4), 0.35, paint)
    gltf.box("cabinet", (4.4, 0.1, 0.0), (4.9, 3.4, 1.6), steel)
    gltf.box("chest", (1.0, 3.4, 0.0), (2.4, 3.9, 1.0), brass)
    if not without_lamp:
        _lamp(gltf, lamp)


def glass(gltf, brighter, without_lamp):
    """A tinted pane across the room, the lamp behind it, and a pane that lies."""
    dim = lambda *c: tuple(min(1.0, v * brighter) for v in c)
    walls = gltf.material("walls", dim(0.65, 0.62, 0.6), roughness=0.8)
    floor = gltf.material("floor", dim(0.5, 0.5, 0.55), roughness=0.5)
    clear = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}
    pane = gltf.material("pane", (0.8, 0.95, 0.85), roughness=0.0, **clear)
    table = gltf.material(
        "table",
        (0.9, 0.9, 0.95),
        roughness=0.0,
        extensions={"KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_ior": {"ior": 1.9}},
    )
    crate = gltf.material("crate", dim(0.6, 0.3, 0.1), roughness=0.7)
    lamp = gltf.material("lamp", (0.5,) * 3, double_sided=False, **_emits(15))
    _shell(gltf, walls, floor)
    gltf.quad("pane", (2.9, 0.0, 0.0), (0, 4.0, 0), (0, 0, 2.8), pane)
    gltf.quad("table", (0.9, 1.4, 0.7), (1.2, 0, 0), (0, 1.2, 0), table)
    gltf.box("crate", (1.2, 1.6, 0.0), (1.7, 2.1, 0.5), crate)
    gltf.box("far crate", (3.6, 1.6, 0.0), (4.3, 2.3, 0.9), crate)
    if not without_lamp:
        _lamp(gltf, lamp, (3.4, 1.2), (4.4, 2.8))


def _bricks():
    """A base colour, its normals and its roughness and metallic, 64 texels a side."""
    y, x = np.mgrid[0:64, 0:64]
    course = y // 16
    joint = (y % 16 < 2) | ((x + 16 * (course % 2)) % 32 < 2)
    rng = np.random.default_rng(7)
    grain = rng.integers(-18, 19, (64, 64, 1))
    color = np.where(joint[..., None], [176, 172, 160], [150, 84, 62]) + grain
    slope = np.zeros((64, 64, 3))
    slope[..., 0] = np.where(
        (x + 16 * (course % 2)) % 32 == 2, -0.5, np.where((x + 16 * (course % 2)) % 32 == 31, 0.5, 0.0)
    )
    slope[..., 1] = np.where(y % 16 == 2, 0.5, np.where(y % 16 == 15, -0.5, 0.0))
    slope[..., 2] = 1.0
    normal = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    data = np.zeros((64, 64, 3))
    data[..., 1], data[..., 2] = np.where(joint, 230, 110), np.where(joint, 0, 40)
    return color.clip(0, 255).astype(np.uint8), np.round(normal * 127.5 + 127.5).astype(np.uint8), data.astype(np.uint8)


def _leaf():
    """A checker of colours with round holes."""
    y, x = np.mgrid[0:64, 0:64]
    alpha = np.where(((x % 32 - 16) ** 2 + (y % 32 - 16) ** 2) < 80, 0, 255)
    color = np.where(((x // 16 + y // 16) % 2)[..., None], [40, 150, 60], [200, 190, 60])
    return np.concatenate([color, alpha[..., None]], axis=-1).astype(np.uint8)


def _sign():
    """What a screen shows: four colours of its own and a dark edge, so that no flip looks like another."""
    image = np.zeros((32, 48, 3), np.uint8)
    image[2:16, 2:24], image[2:16, 24:46], image[16:30, 2:24], image[16:30, 24:46] = (
        (250, 60, 40),
        (60, 220, 80),
        (70, 90, 250),
        (245, 240, 220),
    )
    return image


def lamps(gltf, brighter, without_lamp):
    """Textures, a normal map, a cut-out, a textured screen, an area lamp, a shade that shines on both sides and a point light."""
    dim = lambda *c: tuple(min(1.0, v * brighter) for v in c)
    color, normal, data = _bricks()
    scaled = {"scale": [1.6, 1.2], "offset": [0.1, 0.3]}
    walls = gltf.material(
        "bricks",
        dim(0.9, 0.9, 0.9),
        roughness=0.9,
        metallic=1.0,
        base_texture=gltf.texture(color, scaled),
        data_texture=gltf.texture(data, scaled),
        normalTexture={**gltf.texture(normal, scaled), "scale": 0.8},
    )
    floor = gltf.material("floor", dim(0.6, 0.58, 0.5), roughness=0.4, normalTexture=gltf.texture(normal))
    leaf = gltf.material(
        "leaf", dim(1.0, 1.0, 1.0), roughness=0.6, base_texture=gltf.texture(_leaf()), alphaMode="MASK", alphaCutoff=0.5
    )
    veil = gltf.material("veil", dim(0.7, 0.5, 0.6), alpha=0.4, roughness=0.8, alphaMode="BLEND")
    lamp = gltf.material("lamp", (0.5,) * 3, double_sided=False, **_emits(9))
    shade = gltf.material("shade", (0.6, 0.55, 0.5), **_emits(1.2))
    screen = gltf.material(
        "screen",
        (0.03,) * 3,
        roughness=0.3,
        double_sided=False,
        emissiveTexture=gltf.texture(_sign()),
        emissiveFactor=[1, 1, 1],
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 3.0}},
    )
    _shell(gltf, walls, floor)
    _lamp(gltf, lamp)
    gltf.quad("leaf", (3.3, 1.2, 0.2), (0.0, 1.4, 0), (0, 0, 1.6), leaf, (2, 2))
    gltf.quad("veil", (1.6, 2.2, 0.0), (0.9, 0.6, 0), (0, 0, 1.5), veil)
    gltf.quad("screen", (4.9, 3.2, 0.8), (0, -1.5, 0), (0, 0, 1.0), screen)
    gltf.quad("shade", (2.2, 0.7, 1.1), (0.35, 0.25, 0), (0, 0, 0.4), shade)
    if not without_lamp:
        gltf.point_light("bulb", (1.6, 3.4, 2.2), 2.5, (1.0, 0.8, 0.6))


SMALL = {"metal": metal, "glass": glass, "lamps": lamps}


def small(name, folder, views, size, brighter=1.0, without_lamp=False):
    """Makes a small room in `folder`, its surfaces brighter by a factor or one of its lamps left out."""
    gltf = Gltf()
    SMALL[name](gltf, brighter, without_lamp)
    folder.mkdir(parents=True, exist_ok=True)
    gltf.write(folder / "room.gltf")
    text = SCENE.format(mesh="room.gltf") + "".join(RADIO.format(name=m["name"]) for m in gltf.materials)
    (folder / "room.toml").write_text(text)
    about = SMALL[name].__doc__.strip().rstrip(".")
    return Room(name, about, folder / "room.toml", views, size)


def with_views(room, **changes):
    """A room seen otherwise."""
    return replace(room, **changes)
