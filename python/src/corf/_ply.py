"""The Gaussians of a coupled PLY file (docs/reconstruction.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ._files import regular
from ._program import CorfError


def read_columns(path: Path) -> dict[str, npt.NDArray[np.float32]]:
    """The float columns of a binary little-endian PLY with one element, by name, each (N,)."""
    try:
        data = regular(path).read_bytes()
    except (OSError, MemoryError) as error:
        raise CorfError(f"{path} cannot be read: {error}") from error
    end = data.find(b"end_header\n")
    lines = data[: max(end, 0)].decode("latin-1").splitlines()
    words = [line.split() for line in lines if not line.startswith("comment")]
    if end < 0 or words[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]] or len(words) < 3 or words[2][:2] != ["element", "vertex"]:
        raise CorfError(f"{path} is no binary PLY of Gaussians\n  help: give a run folder as corf reconstruct leaves it")
    names = [w[2] for w in words[3:] if w[:2] == ["property", "float"] and len(w) == 3]
    rows, body = "".join(words[2][2:]), data[end + len(b"end_header\n") :]
    count = int(rows) if rows.isascii() and rows.isdigit() and len(rows) < 16 else -1
    if count < 0 or len(names) != len(words) - 3 or len(body) != 4 * count * len(names):
        raise CorfError(f"{path}: header and data disagree\n  help: the file is truncated or of another program; write or copy it again")
    if len(set(names)) != len(names):
        raise CorfError(f"{path}: a property is there twice\n  help: give a run folder as corf reconstruct leaves it")
    table = np.frombuffer(body, dtype="<f4").reshape(count, len(names))
    return {name: table[:, k] for k, name in enumerate(names)}


def harmonics(columns: dict[str, npt.NDArray[np.float32]], prefix: str) -> npt.NDArray[np.float32]:
    """Coefficients, (N, K, C), of columns f_dc_* and f_rest_* (channel-major) that begin with `prefix`."""
    channels, rest = (sum(1 for name in columns if name.startswith(prefix + stem)) for stem in ("f_dc_", "f_rest_"))
    if channels == 0 or rest % channels != 0:
        raise KeyError(f"{prefix}f_dc_* for each channel, or {prefix}f_rest_* for all of them")
    dc = np.stack([columns[f"{prefix}f_dc_{c}"] for c in range(channels)], axis=-1)[:, None, :]
    if rest == 0:
        return dc
    higher = np.stack([columns[f"{prefix}f_rest_{i}"] for i in range(rest)], axis=-1)
    return np.concatenate([dc, higher.reshape(len(dc), channels, rest // channels).transpose(0, 2, 1)], axis=1)
