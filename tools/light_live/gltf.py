"""A tiny glTF writer: meshes in a z-up world, metallic-roughness materials, PNG textures, punctual lights."""

import base64
import io
import json

import numpy as np
from PIL import Image

FLOAT, UINT = 5126, 5125


def data_uri(mime, data):
    return f"data:{mime};base64,{base64.b64encode(data).decode()}"


class Gltf:
    """A document that is written as one self-contained `.gltf`."""

    def __init__(self):
        self.buffer = bytearray()
        self.views, self.accessors, self.meshes, self.nodes = [], [], [], []
        self.materials, self.textures, self.images, self.lights = [], [], [], []

    def _accessor(self, array, component, kind):
        data = np.ascontiguousarray(array).tobytes()
        self.views.append({"buffer": 0, "byteOffset": len(self.buffer), "byteLength": len(data)})
        self.buffer += data
        entry = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(array), "type": kind}
        if kind == "VEC3":
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def texture(self, pixels, transform=None):
        """A texture of an 8-bit image (height, width, 3 or 4); returns what a material names it by."""
        packed = io.BytesIO()
        Image.fromarray(pixels).save(packed, "png")
        self.images.append({"uri": data_uri("image/png", packed.getvalue())})
        self.textures.append({"source": len(self.images) - 1})
        info = {"index": len(self.textures) - 1}
        if transform:
            info["extensions"] = {"KHR_texture_transform": transform}
        return info

    def material(self, name, base=(0.8, 0.8, 0.8), alpha=1.0, metallic=0.0, roughness=0.9, double_sided=True, **more):
        """A material; `more` is merged into it (`normalTexture`, `emissiveFactor`, `extensions`, …), `base_texture` and
        `data_texture` are its base colour's and its metallic-roughness's."""
        pbr = {"baseColorFactor": [*base, alpha], "metallicFactor": metallic, "roughnessFactor": roughness}
        for key, name_there in (("base_texture", "baseColorTexture"), ("data_texture", "metallicRoughnessTexture")):
            if key in more:
                pbr[name_there] = more.pop(key)
        self.materials.append({"name": name, "pbrMetallicRoughness": pbr, "doubleSided": double_sided, **more})
        return len(self.materials) - 1

    def mesh(self, name, positions, normals, uvs, triangles, material):
        """A mesh of world positions in metres, z up."""
        to_y_up = lambda v: np.float32(v)[:, [0, 2, 1]] * np.float32([1, 1, -1])
        attributes = {
            "POSITION": self._accessor(to_y_up(positions), FLOAT, "VEC3"),
            "NORMAL": self._accessor(to_y_up(normals), FLOAT, "VEC3"),
            "TEXCOORD_0": self._accessor(np.float32(uvs), FLOAT, "VEC2"),
        }
        indices = self._accessor(np.uint32(triangles).reshape(-1), UINT, "SCALAR")
        self.meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
        self.nodes.append({"name": name, "mesh": len(self.meshes) - 1})

    def quad(self, name, corner, along_u, along_v, material, repeats=(1.0, 1.0)):
        """A rectangle whose front is on the side of `along_u × along_v`; v of its texture runs against `along_v`."""
        corner, a, b = (np.float64(x) for x in (corner, along_u, along_v))
        normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        u, v = repeats
        self.mesh(
            name,
            np.array([corner, corner + a, corner + a + b, corner + b]),
            np.array([normal] * 4),
            np.array([[0, v], [u, v], [u, 0], [0, 0]]),
            [[0, 1, 2], [0, 2, 3]],
            material,
        )

    def box(self, name, low, high, material):
        """A closed box."""
        (x, y, z), (w, d, h) = low, np.subtract(high, low)
        faces = [
            ((x, y, z), (0, d, 0), (w, 0, 0)),
            ((x, y, z + h), (w, 0, 0), (0, d, 0)),
            ((x, y, z), (w, 0, 0), (0, 0, h)),
            ((x, y + d, z), (0, 0, h), (w, 0, 0)),
            ((x, y, z), (0, 0, h), (0, d, 0)),
            ((x + w, y, z), (0, d, 0), (0, 0, h)),
        ]
        for k, (corner, a, b) in enumerate(faces):
            self.quad(f"{name} {k}", corner, a, b, material)

    def sphere(self, name, centre, radius, material, rings=48):
        """A sphere of latitude rings with smooth normals."""
        theta, phi = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)
        t, p = np.meshgrid(theta, phi, indexing="ij")
        normals = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1).reshape(-1, 3)
        uvs = np.stack([p / (2 * np.pi), t / np.pi], axis=-1).reshape(-1, 2)
        row = 2 * rings + 1
        i, j = (a.reshape(-1) for a in np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij"))
        a, b, c, d = i * row + j, (i + 1) * row + j, (i + 1) * row + j + 1, i * row + j + 1
        triangles = np.concatenate([np.stack([a, b, c], 1)[i < rings - 1], np.stack([a, c, d], 1)[i > 0]])
        self.mesh(name, np.float64(centre) + radius * normals, normals, uvs, triangles, material)

    def point_light(self, name, position, intensity_cd, color=(1.0, 1.0, 1.0)):
        """A point light."""
        self.lights.append({"type": "point", "name": name, "color": list(color), "intensity": intensity_cd})
        x, y, z = position
        place = {"translation": [x, z, -y], "extensions": {"KHR_lights_punctual": {"light": len(self.lights) - 1}}}
        self.nodes.append({"name": name, **place})

    def write(self, path):
        """Writes the file."""
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.nodes)))}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.buffer), "uri": data_uri("application/octet-stream", bytes(self.buffer))}],
        }
        used = {key for m in self.materials for key in m.get("extensions", {})}
        if self.textures:
            document |= {"textures": self.textures, "images": self.images}
            used |= {"KHR_texture_transform"}
        if self.lights:
            document["extensions"] = {"KHR_lights_punctual": {"lights": self.lights}}
            used |= {"KHR_lights_punctual"}
        if used:
            document["extensionsUsed"] = sorted(used)
        path.write_text(json.dumps(document))
