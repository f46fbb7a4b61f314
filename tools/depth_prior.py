"""A folder of depth maps for `depth.prior = "folder"`, by any network: one NNNNN.npy of inverse depth for every image of a dataset.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-depth.txt
    .venv/bin/python tools/depth_prior.py DATASET OUT --model depth-anything/Depth-Anything-V2-Small-hf
    corf reconstruct DATASET --out RUN --set 'depth.prior="folder"' --set 'depth.folder="OUT"'

Maps are float32, one number a pixel at any resolution, larger where nearer, 0 where unknown. Scale and offset do not matter: corf aligns every map
to what it triangulates. Three sources:

  --model NAME          a depth-estimation model of the transformers library (a name of its hub, or a folder on disk)
  --function FILE:NAME  your own function: an image (rows × columns × 3, uint8, sRGB) in, a map of two axes out
  --from-depth          the dataset's own depth, to try the way without a network. This is GROUND TRUTH: results made with it must say so, and corf
                        cannot know it. Needs numpy alone.

With --gives depth the model's or function's maps are depths, and are inverted here.
"""

import argparse
import importlib.util
import json
import os
import struct
import sys
import zlib
from pathlib import Path


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="folder of a keyframe dataset, with dataset.json")
    parser.add_argument("out", type=Path, help="folder for the maps; made if it is not there, and maps that are there are made again")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--model", metavar="NAME", help="model for the transformers library's depth-estimation pipeline")
    source.add_argument("--function", metavar="FILE:NAME", help="function NAME of the Python file FILE")
    source.add_argument("--from-depth", action="store_true", help="the dataset's own depth: ground truth")
    parser.add_argument("--gives", choices=["inverse", "depth"], default="inverse", help="what the model or function gives (default: inverse)")
    parser.add_argument("--device", default="cpu", help="where the model runs, as torch names it: cpu, cuda, cuda:1 (default: cpu)")
    return parser.parse_args()


def fail(message):
    sys.exit(f"error: {message}")


def needed(module):
    """Imports what only some of the sources need."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        fail(f"{error}\n  help: pip install -r tools/requirements-depth.txt")


def model(name, device):
    """A function of one image by the transformers library."""
    pipeline = needed("transformers").pipeline("depth-estimation", model=name, device=device)
    image = needed("PIL.Image")
    return lambda pixels: pipeline(image.fromarray(pixels))["predicted_depth"].squeeze().float().cpu().numpy()


def function(spec):
    """A function out of a file."""
    path, _, name = spec.rpartition(":")
    if not Path(path).is_file():
        fail(f"{spec}: there is no file {path}\n  help: give FILE.py:NAME")
    module = importlib.util.module_from_spec(found := importlib.util.spec_from_file_location("user_function", path))
    found.loader.exec_module(module)
    if not hasattr(module, name):
        fail(f"{path} has no function {name}")
    return getattr(module, name)


def read_depth(path, np):
    """The one float32 channel of an EXR as corf writes it: scan lines, ZIP or not compressed (openexr.com, "OpenEXR File Layout")."""
    data = path.read_bytes()
    if data[:4] != b"\x76\x2f\x31\x01":
        fail(f"{path} is no EXR")
    at, attributes = 8, {}
    while data[at]:
        name, kind, rest = data[at:].split(b"\0", 2)
        start = at + len(name) + len(kind) + 6
        (size,) = struct.unpack_from("<i", data, start - 4)
        attributes[name.decode()] = data[start : start + size]
        at = start + size
    at += 1
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    channel, _, rest = attributes["channels"].partition(b"\0")
    lines = {0: 1, 2: 1, 3: 16}.get(attributes["compression"][0])
    if struct.unpack_from("<i", rest)[0] != 2 or rest[16:] != b"\0" or lines is None:
        fail(f"{path}: only one float32 channel, ZIP-compressed or not, is read (the first is {channel.decode()})")
    blocks = -(-height // lines)
    rows = np.empty((height, width), np.float32)
    for offset in struct.unpack_from(f"<{blocks}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        block, count = data[offset + 8 : offset + 8 + size], min(lines, height - (y - top))
        if size < 4 * width * count:
            # Differences of bytes, the even ones before the odd ones.
            delta = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.int64)
            delta[1:] -= 128
            mixed = (np.cumsum(delta) & 255).astype(np.uint8)
            plain = np.empty_like(mixed)
            half = (len(mixed) + 1) // 2
            plain[0::2], plain[1::2] = mixed[:half], mixed[half:]
            block = plain.tobytes()
        rows[y - top : y - top + count] = np.frombuffer(block, "<f4").reshape(count, width)
    return rows


def inverted(depth, np):
    """1/depth, 0 where there is none."""
    known = np.isfinite(depth) & (depth > 0)
    return np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0).astype(np.float32)


def main():
    options = arguments()
    np = needed("numpy")
    if not (options.dataset / "dataset.json").is_file():
        fail(f"{options.dataset} has no dataset.json\n  help: give the folder of a finished dataset")
    listed = json.loads((options.dataset / "dataset.json").read_text(encoding="utf-8"))["files"]
    kind = ("optical/depth/", ".exr") if options.from_depth else ("optical/images/", ".png")
    files = sorted(name for name in listed if name.startswith(kind[0]) and name.endswith(kind[1]))
    if not files:
        fail(f"{options.dataset}: dataset.json lists no {kind[0]}*{kind[1]}")
    if options.from_depth:
        print("These maps are the dataset's own depth: GROUND TRUTH. Say so wherever a result made with them is shown.")

        def estimate(path):
            return inverted(read_depth(path, np), np)

    else:
        image = needed("PIL.Image")
        network = model(options.model, options.device) if options.model else function(options.function)

        def estimate(path):
            found = np.asarray(network(np.asarray(image.open(path).convert("RGB"))), np.float32)
            if found.ndim != 2:
                fail(f"{path}: the map has {found.ndim} axes, not rows and columns")
            return inverted(found, np) if options.gives == "depth" else found

    options.out.mkdir(parents=True, exist_ok=True)
    for count, name in enumerate(files, 1):
        target = options.out / f"{Path(name).stem}.npy"
        partial = target.with_suffix(".npy.tmp")
        with open(partial, "wb") as file:
            np.save(file, np.ascontiguousarray(estimate(options.dataset / name)))
        os.replace(partial, target)
        print(f"\r{count} of {len(files)}: {target}", end="", flush=True)
    print()


if __name__ == "__main__":
    main()
