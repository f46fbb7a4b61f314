#!/usr/bin/env bash
# Guess: "Jet" with 256 entries is one table, so that a value painted by OpenCV's COLORMAP_JET and looked up in matplotlib's `jet` comes back to within the
#   rounding of 8 bits, as the two ends of both tables suggest (they are equal there).
# Behaviour: 197 of 256 entries differ, by up to 34 levels of a channel. Read back by the nearest colour of the other's table, a value is off by up to 9 of 255 steps:
#   2.5 dB of a spectrum painted over 70 dB, where 0.14 dB (half a step) is expected. Ends and middle agree, so that a look at the colour bar shows nothing.
# Versions: opencv-python-headless 5.0.0.93, matplotlib 3.10.7, numpy 2.4.6 (PyPI).
# Source: the breakpoints of matplotlib's `jet` (lib/matplotlib/_cm.py, _jet_data: red from 0.35 to 0.66, blue from 0.34 to 0.65) beside the table of OpenCV's
#   COLORMAP_JET (modules/imgproc/src/colormap.cpp), which follows Octave's jet with breakpoints at eighths.
# Output seen: entries that differ: 197 of 256; largest difference: 34 levels; largest error read back: 9 steps = 2.47 dB of 70
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 matplotlib==3.10.7 numpy==2.4.6
"$folder/venv/bin/python" - <<'PY'
import cv2
import matplotlib
import numpy as np

steps = np.array(range(256))
opencv = cv2.applyColorMap(steps.astype(np.uint8)[:, None], cv2.COLORMAP_JET)[:, 0, ::-1].astype(int)
other = np.round(matplotlib.colormaps["jet"](steps)[:, :3] * 255).astype(int)
difference = np.abs(opencv - other)
back = np.array([((other - colour) ** 2).sum(1).argmin() for colour in opencv])
error = np.abs(back - steps).max()
print(f"entries that differ: {(difference > 0).any(1).sum()} of 256; largest difference: {difference.max()} levels; "
      f"largest error read back: {error} steps = {error / 255 * 70:.2f} dB of 70")
assert (opencv[[0, -1]] == other[[0, -1]]).all()
assert (difference > 0).any(1).sum() == 197 and difference.max() == 34 and error == 9
PY
