"""A third opinion in double precision, from the published formulas alone: exact corners of a chain, and its coefficient there.

Slab coefficients: ITU-R P.2040, single layer. Field along the path: reflection split into the parts across and in the plane of incidence.
Vertical polarisation at both ends: the field leaves along θ̂, and what arrives along θ̂ counts.
"""

from itertools import product

import numpy as np

SPEED_OF_LIGHT = 299_792_458.0
VACUUM_PERMITTIVITY_F_PER_M = 8.8541878128e-12


def exact_corners(types, planes, tx, rx):
    """Corners of the path through planes [(unit normal, point)]: image method from the transmitter, backtracked from the receiver."""
    image, images = np.array(tx, dtype=float), []
    for kind, (n, point) in zip(types, planes):
        if kind == "S":
            image = image - 2 * np.dot(image - point, n) * n
        images.append(image)
    corner, corners = np.array(rx, dtype=float), []
    for (n, point), image in reversed(list(zip(planes, images))):
        along = np.dot(image - corner, n)
        corner = corner + (image - corner) * (np.dot(point - corner, n) / along) if along != 0 else np.full(3, np.nan)
        corners.append(corner)
    return np.array(corners[::-1]).reshape(-1, 3)


def permittivity(material, frequency_hz):
    """Complex relative permittivity."""
    loss = material["conductivity_s_per_m"] / (2 * np.pi * frequency_hz * VACUUM_PERMITTIVITY_F_PER_M)
    return material["relative_permittivity"] - 1j * loss


def slab(cosine, eta, thickness_m, wavelength_m):
    """(R_TE, R_TM, T_TE, T_TM) of a slab."""
    root = np.sqrt(eta - 1 + cosine**2)
    te, tm = (cosine - root) / (cosine + root), (eta * cosine - root) / (eta * cosine + root)
    phase = np.exp(-2j * np.pi * thickness_m * root / wavelength_m)
    return tuple(r * (1 - phase**2) / (1 - r**2 * phase**2) for r in (te, tm)) + tuple(
        (1 - r**2) * phase / (1 - r**2 * phase**2) for r in (te, tm)
    )


def theta_hat(direction):
    azimuth = np.arctan2(direction[1], direction[0])
    across = np.hypot(direction[0], direction[1])
    return np.array([direction[2] * np.cos(azimuth), direction[2] * np.sin(azimuth), -across])


def coefficient(types, corners, normals, materials, tx, rx, frequency_hz):
    """The passband coefficient λ/(4πL) θ̂_RX·E of a path with isotropic V antennas, without its propagation phase."""
    wavelength = SPEED_OF_LIGHT / frequency_hz
    points = np.vstack([tx, *corners, rx]).astype(float)
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    directions = legs / lengths[:, None]
    field = theta_hat(directions[0]).astype(complex)
    for i, kind in enumerate(types):
        k, n, m = directions[i], normals[i], materials[i]
        eta = permittivity(m, frequency_hz)
        cosine = abs(np.dot(k, n))
        r_te, r_tm, t_te, t_tm = slab(cosine, eta, m["thickness_m"], wavelength)
        across = np.cross(k, n)
        # At normal incidence every direction across is as good.
        across = across if np.linalg.norm(across) > 1e-12 else np.cross(k, [0.3, 0.5, 0.8])
        across = across / np.linalg.norm(across)
        out = k - 2 * np.dot(k, n) * n if kind == "S" else k
        te, tm = np.dot(field, across), np.dot(field, np.cross(k, across))
        if kind == "S":
            shrink = np.sqrt(1 - m["scattering_coefficient"] ** 2)
            field = shrink * (r_te * te * across + r_tm * tm * np.cross(out, across))
        else:
            field = t_te * te * across + t_tm * tm * np.cross(k, across)
    return wavelength / (4 * np.pi * lengths.sum()) * np.dot(field, theta_hat(-directions[-1]))


def judge(path, tx, rx, meshes, radio):
    """How far a path of ours is from the third opinion: (vertices in metres, coefficient relative to its own magnitude, and the coefficients
    of every reading where surfaces of two materials are in one place)."""
    places = [meshes.triangles_at(name, vertex) for name, vertex in zip(path["objects"], path["vertices"])]
    best, readings = (np.inf, np.inf), []
    # Where surfaces of two materials are in one place, either may be meant.
    for chosen in product(*places):
        planes = [meshes.plane(*place) for place in chosen]
        materials = [radio["materials"][meshes.shapes[index]["material"]] for index, _ in chosen]
        corners = exact_corners(path["types"], planes, tx, rx)
        a = coefficient(path["types"], corners, [n for n, _ in planes], materials, tx, rx, radio["frequency_hz"])
        off = float(np.linalg.norm(corners - path["vertices"], axis=1).max(initial=0.0))
        readings.append(complex(a))
        best = min(best, (abs(a - path["a"]) / abs(path["a"]), off))
    return best[1], float(best[0]), readings
