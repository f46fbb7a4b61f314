"""Channels of `corf paths`, read by DeepMIMO. Used by check_formats.py."""

import contextlib
import io
import json

from format_rules import insist

POWER_TOLERANCE_DB = 0.01
DELAY_TOLERANCE_S = 1e-12
ANGLE_TOLERANCE_DEG = 1e-4
# Of the sum of the paths' amplitudes: phases are float32 degrees.
CHANNEL_TOLERANCE = 1e-5
# A vertex of a path lies on a triangle of the scene; both are float32.
SURFACE_TOLERANCE_M = 1e-3
# Speeds of some metres a second; angles are float32 degrees.
DOPPLER_TOLERANCE_HZ = 1e-2
SPEED_OF_LIGHT = 299792458.0
# The x part of a receiver's velocity has the wrong sign in DeepMIMO 4.0.5, which negates all spherical coordinates of a direction.
TX_VELOCITY, RX_VELOCITY = (3.0, -2.0, 1.0), (0.0, 2.0, -1.0)
# DeepMIMO's digits of Sionna's flags.
DIGITS = {1: 1, 2: 3, 4: 4, 8: 2}


def links(file):
    """The links of `corf paths --format json`, one or several."""
    read = json.loads(file.read_text())
    return read.get("links", [read])


def controls(truth):
    """What is off, and links that are off by it: twice what is allowed."""
    import copy

    def changed(change):
        off = copy.deepcopy(truth)
        change(next(link["paths"] for link in off if link["paths"])[0])
        return off

    def louder(path):
        path["a"] = [10 ** (2 * POWER_TOLERANCE_DB / 20) * part for part in path["a"]]

    def later(path):
        path["tau"] += 2 * DELAY_TOLERANCE_S

    def turned(path):
        path["phi_r"] += 2 * ANGLE_TOLERANCE_DEG * 3.14159 / 180

    return [("0.02 dB", changed(louder)), ("2 ps", changed(later)), ("0.0002 degrees", changed(turned))]


def distance_to_triangles(point, corners):
    """The least distance of a point to any of (N, 3, 3) triangles, metres."""
    import numpy as np

    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, point - a
    normal = np.cross(ab, ac)
    square = (normal**2).sum(1)
    keep = square > 0
    a, ab, ac, ap, normal, square = (v[keep] for v in (a, ab, ac, ap, normal, square))
    v = (np.cross(ap, ac) * normal).sum(1) / square
    w = (np.cross(ab, ap) * normal).sum(1) / square
    # Barycentric coordinates brought into the triangle: exact inside, and never too small outside.
    v, w = v.clip(0, 1), w.clip(0, 1)
    over = np.maximum(v + w, 1)
    near = a + (v / over)[:, None] * ab + (w / over)[:, None] * ac
    return np.sqrt(((point - near) ** 2).sum(1)).min()


def check_deepmimo(folder, truth):
    """A scenario as `deepmimo.load` gives it, and what `compute_channels` makes of it, against the paths of the same links."""
    import deepmimo
    import numpy as np

    most = max(len(link["paths"]) for link in truth)
    deepmimo.config.set("scenarios_folder", str(folder.resolve().parent))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        loaded = deepmimo.load(folder.name, max_paths=most)
        deepmimo.summary(folder.name)
        # Names are read in small letters, and with them absolute paths.
        capitals = deepmimo.load(folder.name.upper(), max_paths=most)
    insist(type(capitals) is type(loaded), "a name in capitals is another scenario")
    transmitters = list(loaded.datasets) if isinstance(loaded, deepmimo.MacroDataset) else [loaded]
    insist(len(truth) % len(transmitters) == 0, f"{len(truth)} links of {len(transmitters)} transmitters")
    worst = {"dB": 0.0, "s": 0.0, "deg": 0.0, "of the amplitudes": 0.0, "m": 0.0, "Hz": 0.0}
    for tx, data in enumerate(transmitters):
        users = truth[tx :: len(transmitters)]
        insist(data.n_ue == len(users), f"{data.n_ue} users instead of {len(users)}")
        check_paths(data, users, worst)
        check_response(deepmimo, data, users, worst)
        check_taps(deepmimo, data, users, worst)
        check_scene(data, users, worst)
        check_motion(data, users, worst)
    limits = (POWER_TOLERANCE_DB, DELAY_TOLERANCE_S, ANGLE_TOLERANCE_DEG, CHANNEL_TOLERANCE, SURFACE_TOLERANCE_M, DOPPLER_TOLERANCE_HZ)
    for (unit, value), limit in zip(worst.items(), limits):
        insist(value < limit, f"{value:.3g} {unit} off, where {limit} is allowed")
    print(f"        {len(truth)} links, {most} paths at most: " + ", ".join(f"{v:.1e} {u}" for u, v in worst.items()))


def in_order(paths):
    """The line of sight, then by falling power."""
    return sorted(paths, key=lambda p: (bool(p["interactions"]), -(p["a"][0] ** 2 + p["a"][1] ** 2)))


def check_paths(data, users, worst):
    import numpy as np

    for user, link in enumerate(users):
        paths = in_order(link["paths"])
        insist(data.num_paths[user] == len(paths), f"user {user} has {data.num_paths[user]} paths instead of {len(paths)}")
        insist(np.allclose(data.rx_pos[user], link["rx"], atol=1e-5), f"user {user} is elsewhere")
        insist(np.allclose(np.ravel(data.tx_pos), link["tx"], atol=1e-5), "the transmitter is elsewhere")
        direct = any(not p["interactions"] for p in paths)
        insist(data.los[user] == (int(direct) if paths else -1), f"user {user}: line of sight {data.los[user]}")
        for i, path in enumerate(paths):
            power = path["a"][0] ** 2 + path["a"][1] ** 2
            worst["dB"] = max(worst["dB"], abs(float(data.power[user, i]) - 10 * np.log10(power)))
            worst["s"] = max(worst["s"], abs(float(data.delay[user, i]) - path["tau"]))
            for name, angle in (("aoa_az", "phi_r"), ("aoa_el", "theta_r"), ("aod_az", "phi_t"), ("aod_el", "theta_t")):
                off = float(data[name][user, i]) - np.degrees(path[angle])
                worst["deg"] = max(worst["deg"], abs((off + 180) % 360 - 180))
            digits = int("".join(str(DIGITS[flag]) for flag in path["interactions"]) or 0)
            insist(data.inter[user, i] == digits, f"path {i} of user {user} does {data.inter[user, i]} instead of {digits}")


def check_response(deepmimo, data, users, worst):
    """Between single elements: at the carrier the coherent sum, and over a band that at every subcarrier."""
    import numpy as np

    one = {"shape": np.array([1, 1])}
    for bandwidth, count in ((1e3, 1), (400e6, 64)):
        parameters = deepmimo.ChannelParameters(bs_antenna=dict(one), ue_antenna=dict(one), freq_domain=True)
        parameters.ofdm.bandwidth, parameters.ofdm.subcarriers = bandwidth, count
        parameters.ofdm.selected_subcarriers = np.arange(count)
        parameters.num_paths = data.power.shape[1]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            channel = data.compute_channels(parameters)
        for user, link in enumerate(users):
            a = np.array([complex(*p["a"]) for p in link["paths"]])
            tau = np.array([p["tau"] for p in link["paths"]])
            frequencies = link["frequency_hz"] + bandwidth / count * np.arange(count)
            ours = (a * np.exp(-2j * np.pi * frequencies[:, None] * tau)).sum(1)
            theirs = channel[user, 0, 0] * np.sqrt(count)
            scale = np.abs(a).sum() or 1.0
            worst["of the amplitudes"] = max(worst["of the amplitudes"], np.abs(ours - theirs).max() / scale)
            gain = link.get("channel", {}).get("path_gain_coherent_db")
            if count == 1 and gain is not None:
                worst["dB"] = max(worst["dB"], abs(20 * np.log10(abs(theirs[0])) - gain))
    with contextlib.redirect_stdout(io.StringIO()):
        loss = data.compute_pathloss()
    for user, link in enumerate(users):
        gain = link.get("channel", {}).get("path_gain_coherent_db")
        if gain is not None:
            worst["dB"] = max(worst["dB"], abs(float(loss[user]) + gain))


def check_taps(deepmimo, data, users, worst):
    """In time, a coefficient a path: what the response over a band is divided by, its taps are not."""
    import numpy as np

    one = {"shape": np.array([1, 1])}
    parameters = deepmimo.ChannelParameters(bs_antenna=dict(one), ue_antenna=dict(one), freq_domain=False)
    parameters.ofdm.subcarriers, parameters.ofdm.selected_subcarriers = 512, np.arange(512)
    parameters.num_paths = data.power.shape[1]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        channel = data.compute_channels(parameters)
    for user, link in enumerate(users):
        ours = np.sort([abs(complex(*p["a"])) for p in link["paths"]])
        theirs = np.sort(np.abs(channel[user, 0, 0][: len(ours)]))
        if len(ours):
            worst["of the amplitudes"] = max(worst["of the amplitudes"], np.abs(ours - theirs).max() / ours.sum())


def check_scene(data, users, worst):
    """Where paths are reflected or pass through, there is a triangle of the scene; the carrier is the links'."""
    import numpy as np

    insist(data.rt_params["frequency"] == users[0]["frequency_hz"], "another carrier")
    corners = np.concatenate([[face.vertices for face in thing.faces] for thing in data.scene.objects]).astype(float)
    numbers = {face.material_idx for thing in data.scene.objects for face in thing.faces}
    insist(numbers == set(range(len(data.materials))), f"materials {numbers} of {len(data.materials)}")
    for user, link in enumerate(users):
        for i, path in enumerate(in_order(link["paths"])[:8]):
            for k, vertex in enumerate(path["vertices"]):
                worst["m"] = max(worst["m"], np.abs(data.inter_pos[user, i, k].astype(float) - vertex).max())
                worst["m"] = max(worst["m"], distance_to_triangles(data.inter_pos[user, i, k].astype(float), corners))


def check_motion(data, users, worst):
    """Doppler shifts of ends that move, which need one terrain; and whatever a path meets belongs to an object that is there."""
    import numpy as np

    terrain = [thing for thing in data.scene.objects if thing.label == "terrain"]
    insist(len(terrain) == 1, f"{len(terrain)} objects are terrain")
    insist([thing.object_id for thing in data.scene.objects] == list(range(len(data.scene.objects))), "ids are no places in the list")
    data.tx_vel, data.rx_vel = np.array(TX_VELOCITY), np.array(RX_VELOCITY)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        shifts, owners = np.asarray(data.doppler), np.asarray(data.inter_obj)
    triangles = [np.array([face.vertices for face in thing.faces], float) for thing in data.scene.objects]
    ground = terrain[0].bounding_box.z_max

    def towards(theta, phi):
        return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])

    for user, link in enumerate(users):
        for i, path in enumerate(in_order(link["paths"])):
            departing, arriving = towards(path["theta_t"], path["phi_t"]), towards(path["theta_r"], path["phi_r"])
            shift = link["frequency_hz"] / SPEED_OF_LIGHT * (departing @ TX_VELOCITY + arriving @ RX_VELOCITY)
            worst["Hz"] = max(worst["Hz"], abs(float(shifts[user, i]) - shift))
            for k, vertex in enumerate(path["vertices"]):
                owner = owners[user, i, k]
                insist(0 <= owner < len(triangles), f"path {i} of user {user} meets object {owner}")
                # Within a millimetre of the terrain's height all is the terrain's.
                if abs(vertex[2] - ground) > SURFACE_TOLERANCE_M:
                    off = distance_to_triangles(np.array(vertex), triangles[int(owner)])
                    insist(off < SURFACE_TOLERANCE_M, f"path {i} of user {user} is {off} m from object {owner}")
