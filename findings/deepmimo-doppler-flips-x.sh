#!/usr/bin/env bash
# Guess: DeepMIMO's Doppler of a moving receiver is v·u/λ (u from the receiver to where the wave comes from): a receiver that walks towards its transmitter sees a higher frequency, on
#   whichever axis it walks, and to move the transmitter with v or the receiver with −v is the same. Its code says that it follows Sionna.
# Behaviour: for receivers the x part has the wrong sign: (−v_x u_x + v_y u_y + v_z u_z)/λ. y, z and a moving transmitter are right, so that a check along y passes; a walk
#   slantwise, here of 10 m/s straight to the transmitter, comes out as −462 Hz instead of 2001 Hz at 60 GHz. The channels over time are made from these shifts.
# Versions: deepmimo 4.0.5, numpy 2.2.6, scipy 1.17.1, matplotlib 3.11.2 (PyPI).
# Source: Dataset._compute_doppler in deepmimo/datasets/dataset.py turns the direction of arrival by negating all of (radius, zenith, azimuth) ahead of
#   spherical_to_cartesian (deepmimo/utils/geometry.py), which gives (u_x, −u_y, −u_z) and not −u. Repository: https://github.com/DeepMIMO/DeepMIMO
# Output seen: a receiver along x: -1570.0 Hz (physics: 1570.0); y: 1177.5 Hz (physics: 1177.5); z: 392.5 Hz (physics: 392.5)
#   the transmitter along x: -1570.0 Hz (physics: -1570.0); y: -1177.5 Hz (physics: -1177.5); z: -392.5 Hz (physics: -392.5)
#   a receiver straight to the transmitter: -461.9 Hz (physics: 2001.4)
set -euo pipefail
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check deepmimo==4.0.5 numpy==2.2.6 scipy==1.17.1 matplotlib==3.11.2
cd "$folder"
venv/bin/python - <<'PY'
import json
import pathlib

import numpy as np

SPEED_OF_LIGHT, FREQUENCY = 299792458.0, 60e9
transmitter, receiver = np.array([4.0, 3.0, 2.0]), np.array([0.0, 0.0, 1.0])
distance = np.linalg.norm(transmitter - receiver)
towards = (transmitter - receiver) / distance


def angles(unit):
    return np.degrees(np.arctan2(unit[1], unit[0])), np.degrees(np.arccos(unit[2]))


# A scenario in DeepMIMO's own format: one transmitter, one receiver, the line of sight between them over a floor.
(aoa_az, aoa_el), (aod_az, aod_el) = angles(towards), angles(-towards)
of_paths = {"aoa_az": aoa_az, "aoa_el": aoa_el, "aod_az": aod_az, "aod_el": aod_el, "delay": distance / SPEED_OF_LIGHT, "power": -80.0, "phase": 0.0, "inter": 0.0}
arrays = {name: np.full((1, 1), value) for name, value in of_paths.items()}
arrays |= {"inter_pos": np.full((1, 1, 1, 3), np.nan), "rx_pos": receiver[None], "tx_pos": transmitter[None]}
scenario = pathlib.Path("deepmimo_scenarios/hall")
scenario.mkdir(parents=True)
for name, values in arrays.items():
    np.savez(scenario / f"{name}_t000_tx000_r001.npz", **{name: values.astype(np.float32)})
np.savez(scenario / "vertices.npz", vertices=np.array([[x, y, z] for x in (0, 10) for y in (0, 5) for z in (-1, 0)], np.float32))
floor = {"id": 0, "name": "floor", "label": "terrain", "face_vertex_idxs": [[0, 2, 6, 4]], "face_material_idxs": [0]}
(scenario / "objects.json").write_text(json.dumps([floor]))
one = {"num_points": 1, "num_active_points": 1, "num_ant": 1, "dual_pol": False, "ant_rel_positions": [[0, 0, 0]], "array_orientation": [0, 0, 0]}
sets = {f"txrx_set_{i}": one | {"id": i, "id_orig": i, "name": name, "is_tx": i == 0, "is_rx": i == 1} for i, name in enumerate(("transmitter", "receiver"))}
scene = {"num_scenes": 1, "n_objects": 1, "n_vertices": 8, "n_faces": 1, "representation": "hull"}
parameters = {"version": "4.0.5", "txrx_sets": sets, "rt_params": {"frequency": FREQUENCY}, "materials": {}, "scene": scene}
(scenario / "params.json").write_text(json.dumps(parameters))

import deepmimo

dataset = deepmimo.load("hall")


def shift(who, velocity):
    dataset.rx_vel, dataset.tx_vel = np.zeros(3), np.zeros(3)
    setattr(dataset, who, np.asarray(velocity))
    return float(dataset.doppler[0, 0])


def physics(who, velocity, seconds=1e-6):
    """How fast the distance shrinks, in wavelengths."""
    moved = np.asarray(velocity) * seconds * (1 if who == "rx_vel" else -1)
    return (distance - np.linalg.norm(transmitter - receiver - moved)) / seconds * FREQUENCY / SPEED_OF_LIGHT


def said(who, velocity):
    return f"{shift(who, velocity):.1f} Hz (physics: {physics(who, velocity):.1f})"


for what, who in (("a receiver", "rx_vel"), ("the transmitter", "tx_vel")):
    print(f"{what} along " + "; ".join(f"{axis}: {said(who, 10 * unit)}" for axis, unit in zip("xyz", np.eye(3))))
print(f"a receiver straight to the transmitter: {said('rx_vel', 10 * towards)}")
for unit, sign in zip(np.eye(3), (-1, 1, 1)):
    assert np.isclose(shift("rx_vel", 10 * unit), sign * physics("rx_vel", 10 * unit), rtol=1e-3)
    assert np.isclose(shift("tx_vel", 10 * unit), physics("tx_vel", 10 * unit), rtol=1e-3)
assert shift("rx_vel", 10 * towards) < 0 < physics("rx_vel", 10 * towards)
PY
