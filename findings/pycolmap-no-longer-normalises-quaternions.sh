#!/usr/bin/env bash
# Guess: a quaternion in images.txt stands for a rotation whatever its length, as it does for SciPy and did for pycolmap: one that is written by hand or rounded to two digits is brought to
#   unit length on reading, or else refused.
# Behaviour: pycolmap 3.10 brings it to unit length. Since 3.11 it stays as it is and its matrix is made by the formula for unit quaternions, which gives neither a rotation nor a
#   scaled one (determinant 5 for a quarter turn written as 1 1 0 0). A camera 10 m from the origin is off by 0.12 m with 0.71 0.71 0 0 and by 7.1 m with 1 1 0 0;
#   `projection_center()` and `-R^T t` then name different places, and the pose does not take its own centre to zero. Nothing is raised or logged.
# Versions: pycolmap 3.10.0 and 4.2.1, numpy 1.26.4 (PyPI; the old ones need Python 3.12 or older). 3.11.1, 3.12.6, 3.13.0 and 4.0.2 behave as 4.2.1.
# Source: ReadImagesText in src/colmap/scene/reconstruction_io_text.cc fills in the four numbers and nothing more. The format of images.txt:
#   https://colmap.github.io/format.html
# Output seen: 3.10.0: 0.71 0.71 0 0: determinant 1.0000, centre 0.00 -10.00 0.00; 1 1 0 0: determinant 1.0000, centre 0.00 -10.00 0.00
#   4.2.1: 0.71 0.71 0 0: determinant 1.0165, centre 0.00 -9.92 -0.08; 1 1 0 0: determinant 5.0000, centre 0.00 -5.00 -5.00
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
for version in 3.10.0 4.2.1; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install --quiet --disable-pip-version-check pycolmap==$version numpy==1.26.4
  "$folder/$version/bin/python" - "$folder" <<'PY'
import pathlib
import sys

import numpy as np
import pycolmap

model = pathlib.Path(sys.argv[1]) / "model"
model.mkdir(exist_ok=True)
(model / "cameras.txt").write_text("1 PINHOLE 100 80 90 90 50 40\n")
(model / "points3D.txt").write_text("")
new = pycolmap.__version__ != "3.10.0"


def camera(quaternion):
    """What a quarter turn about x, 10 m in front of the world's origin, is read as."""
    (model / "images.txt").write_text(f"1 {quaternion} 0 0 10 1 image.png\n\n")
    reconstruction = pycolmap.Reconstruction()
    reconstruction.read_text(str(model))
    image = reconstruction.images[1]
    pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
    return pose.rotation.matrix(), image.projection_center() + 0.0, pose


said = []
for quaternion in ("0.71 0.71 0 0", "1 1 0 0"):
    matrix, centre, pose = camera(quaternion)
    determinant = np.linalg.det(matrix)
    said.append(f"{quaternion}: determinant {determinant:.4f}, centre " + " ".join(f"{value + 0.0:.2f}" for value in np.round(centre, 9) + 0.0))
    off, by_transpose, seen = np.linalg.norm(centre - [0, -10, 0]), np.linalg.norm(centre + matrix.T @ [0, 0, 10]), np.linalg.norm(pose * centre)
    assert (abs(determinant - 1) > 0.01) == new and (off > 0.1) == new and (by_transpose > 0.1) == new and (seen > 0.1) == new
print(f"{pycolmap.__version__}: " + "; ".join(said))
# The same turn at unit length is read alike by all versions.
assert np.linalg.norm(camera("0.70710678118654752 0.70710678118654752 0 0")[1] - [0, -10, 0]) < 1e-9
if new:
    assert np.isclose(np.linalg.det(matrix), 5) and np.allclose(centre, [0, -5, -5])
PY
done
