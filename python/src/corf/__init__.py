"""Data sets, fields and propagation paths of corf as NumPy arrays.

Reading needs nothing but this package. Rendering, tracing and evaluating call the `corf` program, which the environment variable ``CORF_BIN`` names or
the ``PATH`` holds.

World frame: right-handed, z up, metres. Camera frame: OpenCV (x right, y down, z forward). Matrices called ``world_from_camera`` take homogeneous
camera coordinates to world coordinates. Angles are radians, powers are relative to 1 W transmitted.
"""

from ._dataset import Dataset, Keyframe
from ._field import Aggregates, Field, Gaussians, Rendering
from ._paths import Paths, links, paths
from ._program import CorfError, program, run

__all__ = ["Aggregates", "CorfError", "Dataset", "Field", "Gaussians", "Keyframe", "Paths", "Rendering", "links", "paths", "program", "run"]
