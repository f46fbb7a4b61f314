#!/usr/bin/env bash
# Guess: what lies beyond a range of SPZ is brought to the nearest end or refused, as colours and sizes are brought there: a splat too far away ends at the border, an opaque one
#   stays a little under opaque. The header holds the number of fraction bits, so that a writer picks it by the extent of the scene.
# Behaviour: the writers always take 12 fraction bits, and positions beyond 2048 units wrap around without a warning: 2049 becomes -2047 and 10000 becomes 1808. A room in millimetres
#   is folded onto itself, and so is one in metres of a map's grid. An opacity over 0.998 comes back as a logit of infinity and one under 0.002 as minus infinity, in a PLY
#   file that training may go on from. Sizes stop at 45 um (e^-10 m), as guessed.
# Versions: gaussforge 0.6.0, plyfile 1.1.5, numpy 2.4.6 (PyPI), spz-js 1.2.5 (npm). @playcanvas/splat-transform 3.7.0 wraps alike but ends opacities at ±13.8.
# Source: packGaussians in dist/spz-loader.js of spz-js (https://www.npmjs.com/package/spz-js): three bytes of the rounded position times 4096, and the inverse sigmoid of byte/255;
#   gaussforge (https://github.com/3dgscloud/GaussForge) is compiled; its writer is seen here only by what it writes.
# Output seen, for both writers (read back by gaussforge):
#   x: 1000 -> 1000, 2047 -> 2047, 2049 -> -2047, 10000 -> 1808, 500000 -> 288; logit of opacity: 8 -> inf, -8 -> -inf, 2 -> 2.0; log of size: -12 -> -10.0
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check gaussforge==0.6.0 plyfile==1.1.5 numpy==2.4.6
npm install --silent --no-audit --no-fund --ignore-scripts spz-js@1.2.5 >npm.log
cat >write.mjs <<'JS'
import fs from "node:fs";
import { loadPly, serializeSpz } from "spz-js";
const splats = await loadPly(new Blob([fs.readFileSync("in.ply")]).stream());
fs.writeFileSync("spz-js.spz", Buffer.from(await serializeSpz(splats)));
JS
cat >splats.py <<'PY'
far, opacities, sizes = [1000, 2047, 2049, 10000, 500000], [8, -8, 2, 0, 0], [-12, -3, -3, -3, -3]
PY
venv/bin/python - <<'PY'
import numpy as np
import plyfile

from splats import far, opacities, sizes

names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
splats = np.zeros(len(far), [(name, "f4") for name in names])
splats["x"], splats["opacity"], splats["scale_0"], splats["rot_0"] = far, opacities, sizes, 1
plyfile.PlyData([plyfile.PlyElement.describe(splats, "vertex")]).write("in.ply")
PY
node write.mjs
venv/bin/python - <<'PY'
import io
import pathlib

import gaussforge
import numpy as np
import plyfile

from splats import far, opacities, sizes

tool = gaussforge.GaussForge()
written = {"gaussforge": tool.convert(pathlib.Path("in.ply").read_bytes(), "ply", "spz")["data"], "spz-js": pathlib.Path("spz-js.spz").read_bytes()}
for writer, data in written.items():
    back = plyfile.PlyData.read(io.BytesIO(tool.convert(bytes(data), "spz", "ply")["data"]))["vertex"].data
    said = ["x: " + ", ".join(f"{a} -> {b:.0f}" for a, b in zip(far, back["x"]))]
    said += ["logit of opacity: " + ", ".join(f"{a} -> {b:.1f}" for a, b in zip(opacities[:3], back["opacity"])), f"log of size: {sizes[0]} -> {back['scale_0'][0]:.1f}"]
    print(f"{writer}: " + "; ".join(said))
    assert np.abs(back["x"] - [(x + 2048) % 4096 - 2048 for x in far]).max() < 1e-3
    assert back["opacity"][0] == np.inf and back["opacity"][1] == -np.inf and abs(back["opacity"][2] - 2) < 0.05
    assert abs(back["scale_0"][0] + 10) < 1e-3
PY
