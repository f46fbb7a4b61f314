"""What the checks of formats share: a failure with words, and a pinhole's projection."""


class Failed(Exception):
    """Something does not agree."""


def insist(holds, what):
    if not holds:
        raise Failed(what)


def project(camera, world_from_camera, points):
    """Image positions of points in OpenCV axes, and their depths."""
    import numpy as np

    local = (points - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera["fx"] * local[:, 0] / local[:, 2] + camera["cx"]
        v = camera["fy"] * local[:, 1] / local[:, 2] + camera["cy"]
    return np.stack([u, v], axis=1), local[:, 2]
