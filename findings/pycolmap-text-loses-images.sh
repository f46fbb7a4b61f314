#!/usr/bin/env bash
# Guess: COLMAP's images.txt has two lines an image, the second empty where it has no points. A file whose last, empty line is gone (editors and formatters strip blank lines at the
#   end) still says everything, so that a reader takes all images or refuses the file. And a name may hold a space, as file names do.
# Behaviour: the last image is dropped without a word, so that a capture trains on one picture less. A name is cut at its first space, so that the picture is looked for under
#   another name. Neither raises or logs anything.
# Versions: pycolmap 4.2.1 (PyPI).
# Source: the text reader of reconstructions (src/colmap/scene/reconstruction_io_text.cc): the loop ends where the line of points cannot be read, before the image is added; fields
#   of the first line are split at spaces.
# Output seen: whole: 3 images; without the last empty line: 2 images; a name with a space: left
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pycolmap==4.2.1
"$folder/venv/bin/python" - "$folder" <<'PY'
import pathlib
import sys

import pycolmap

model = pathlib.Path(sys.argv[1]) / "model"
model.mkdir()
(model / "cameras.txt").write_text("1 PINHOLE 100 80 90 90 50 40\n")
(model / "points3D.txt").write_text("")
whole = "".join(f"{i} 1 0 0 0 {i} 0 0 1 image{i}.png\n\n" for i in (1, 2, 3))


def names(text):
    (model / "images.txt").write_text(text)
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(model))
    return sorted(image.name for image in reconstruction.images.values())


stripped = names(whole.rstrip("\n") + "\n")
spaced = names(whole.replace("image2.png", "left camera/2.png"))
print(f"whole: {len(names(whole))} images; without the last empty line: {len(stripped)} images; a name with a space: {spaced[-1]}")
assert len(names(whole)) == 3 and stripped == ["image1.png", "image2.png"] and spaced == ["image1.png", "image3.png", "left"]
PY
