#!/usr/bin/env bash
# Guess: a reader that keeps the 16 bits of a grey PNG keeps them in colour or with alpha too, so that imageio, scikit-image and matplotlib give a depth map or a heat map the same
#   numbers in each. And Pillow's `convert("RGB")` of 16-bit grey scales to 8 bits, or takes the high byte, as its own reading of a colour file does.
# Behaviour: all three read PNG by Pillow, which has a mode of 16 bits for grey alone: colour, and grey with alpha, arrive cut to the high byte, as uint8 (imageio, scikit-image) or in steps
#   of 1/255 (matplotlib), with no warning. OpenCV with IMREAD_UNCHANGED keeps all. And `convert` of the grey file clips: all from 255 on is white (a depth in millimetres
#   from 0.26 m on), where the same levels read from a colour file are their high bytes.
# Versions: pillow 13.0.0, imageio 2.38.1, scikit-image 0.26.0, matplotlib 3.11.2, opencv-python-headless 5.0.0.93, pypng 0.20220715.0, numpy 2.4.6 (PyPI).
# Source: the table _MODES in src/PIL/PngImagePlugin.py (https://github.com/python-pillow/Pillow) gives mode I;16 to 16 bits of colour type 0, but RGB or RGBA, of 8 bits, to types 2, 4 and 6.
# Output seen (levels of the first channel, matplotlib's times 65535):
#   written: 0 200 255 1000 32767 65535
#   grey: imageio, scikit-image, matplotlib, OpenCV: 0 200 255 1000 32767 65535; Pillow's RGB: 0 200 255 255 255 255
#   colour: imageio, scikit-image: 0 0 0 3 127 255; matplotlib: 0 0 0 771 32639 65535; OpenCV: 0 200 255 1000 32767 65535; Pillow's RGB: 0 0 0 3 127 255
#   grey with alpha: imageio, scikit-image: 0 0 0 3 127 255; matplotlib: 0 0 0 771 32639 65535; OpenCV: 0 200 255 1000 32767 65535; Pillow's RGB: 0 0 0 3 127 255
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pillow==13.0.0 imageio==2.38.1 scikit-image==0.26.0 matplotlib==3.11.2 \
  opencv-python-headless==5.0.0.93 pypng==0.20220715.0 numpy==2.4.6
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys

import cv2
import imageio.v3
import matplotlib.image
import numpy as np
import PIL.Image
import png
import skimage.io

written = [0, 200, 255, 1000, 32767, 65535]
cut = [level >> 8 for level in written]
opaque = [65535] * len(written)
kinds = {
    "grey": ({"greyscale": True}, [written]),
    "colour": ({"greyscale": False}, [written] * 3),
    "grey with alpha": ({"greyscale": True, "alpha": True}, [written, opaque]),
}
print("written:", *written)
for kind, (how, channels) in kinds.items():
    path = f"{sys.argv[1]}/{kind}.png"
    with open(path, "wb") as file:
        png.Writer(len(written), 1, bitdepth=16, **how).write(file, [np.stack(channels, 1).ravel().tolist()])

    def first(picture):
        return np.asarray(picture).reshape(len(written), -1)[:, 0].tolist()

    seen = {
        "imageio": first(imageio.v3.imread(path)),
        "scikit-image": first(skimage.io.imread(path)),
        "matplotlib": np.round(np.array(first(matplotlib.image.imread(path))) * 65535).astype(int).tolist(),
        "OpenCV": first(cv2.imread(path, cv2.IMREAD_UNCHANGED)),
        "Pillow's RGB": first(PIL.Image.open(path).convert("RGB")),
    }
    print(f"{kind}: " + "; ".join(f"{reader}: {' '.join(map(str, levels))}" for reader, levels in seen.items()))
    grey = kind == "grey"
    assert seen["OpenCV"] == written
    assert seen["imageio"] == seen["scikit-image"] == (written if grey else cut)
    assert seen["matplotlib"] == (written if grey else [level * 257 for level in cut])
    assert seen["Pillow's RGB"] == ([min(level, 255) for level in written] if grey else cut)
PY
