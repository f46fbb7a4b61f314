"""EXR, PNG and JSON files as arrays and values, with the path in every error."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ._program import CorfError


def read_json(path: Path) -> Any:
    """A JSON file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CorfError(f"{path} cannot be read: {error}") from error


def read_exr(path: Path, channel: str) -> npt.NDArray[Any]:
    """One channel of an EXR file, (rows, columns), of the file's own type."""
    import OpenEXR  # type: ignore[import-not-found, import-untyped, unused-ignore]

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            if channel not in channels:
                raise CorfError(f"{path} has no channel {channel}, but {', '.join(sorted(channels))}")
            return np.array(channels[channel].pixels)
    except CorfError:
        raise
    except Exception as error:  # The library raises RuntimeError and others.
        raise CorfError(f"{path} cannot be read: {error}") from error


def read_png(path: Path) -> npt.NDArray[np.uint8]:
    """An RGB image, (rows, columns, 3)."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.array(image.convert("RGB"), dtype=np.uint8)
    except OSError as error:
        raise CorfError(f"{path} cannot be read: {error}") from error
