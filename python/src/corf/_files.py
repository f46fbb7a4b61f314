"""EXR, PNG and JSON files as arrays and values, with the path in every error."""

from __future__ import annotations

import json
import os
import stat
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ._program import CorfError
from ._values import Value

# More than any file of JSON that corf writes, and less than memory.
_MOST_JSON_BYTES = 1 << 30


def regular(path: Path) -> Path:
    """The path of a regular file; raises CorfError for a folder, a pipe, a device or nothing."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError) as error:
        raise CorfError(f"{path} cannot be read: {error}") from error
    if not stat.S_ISREG(mode):
        raise CorfError(f"{path} is {'a folder' if stat.S_ISDIR(mode) else 'a pipe, socket or device'}\n  help: give a regular file")
    return path


def within(folder: Path, name: str) -> Path:
    """The regular file `name` of a folder; raises CorfError where it, or a link in its place, leads out of the folder."""
    path = folder / name
    try:
        leads_out = not path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:
        raise CorfError(f"{path} cannot be read: {error}") from error
    if leads_out:
        raise CorfError(f"{path} leads out of its folder\n  help: copy the file into {folder}")
    return regular(path)


def within_if_there(folder: Path, name: str) -> Path | None:
    """As :func:`within`; None where there is no such file."""
    try:
        there = os.path.lexists(folder / name)
    except (OSError, ValueError) as error:
        raise CorfError(f"{folder / name} cannot be read: {error}") from error
    return within(folder, name) if there else None


def read_json(path: Path) -> Value:
    """A JSON file."""
    try:
        if os.stat(regular(path)).st_size > _MOST_JSON_BYTES:
            raise CorfError(f"{path} has more than {_MOST_JSON_BYTES} bytes\n  help: corf writes no such file; restore it")
        return Value(json.loads(path.read_text(encoding="utf-8")), str(path))
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        raise CorfError(f"{path} cannot be read: {error}") from error


def parsed(text: str, what: str) -> Value:
    """JSON that the program printed."""
    try:
        return Value(json.loads(text), what)
    except (ValueError, RecursionError) as error:
        raise CorfError(f"{what} printed no JSON: {error}\n  help: check that CORF_BIN is the corf program of this version") from error


def read_exr(path: Path, channel: str, size: tuple[int, int] | None = None) -> npt.NDArray[Any]:
    """One channel of an EXR file, (rows, columns), of the file's own type; `size` is the columns and rows that it must have."""
    import OpenEXR  # type: ignore[import-not-found, import-untyped, unused-ignore]

    regular(path)
    try:
        # The header first: it may declare more than memory holds.
        if size is not None:
            with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
                low, high = file.header()["dataWindow"]
                _check_size(path, (int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1), size)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            if channel not in channels:
                raise CorfError(f"{path} has no channel {channel}, but {', '.join(sorted(channels))}")
            pixels = np.array(channels[channel].pixels)
    except CorfError:
        raise
    except Exception as error:  # The library raises RuntimeError and others.
        raise CorfError(f"{path} cannot be read: {error}") from error
    if pixels.ndim != 2:
        raise CorfError(f"{path}: channel {channel} has the shape {pixels.shape}")
    if size is not None:
        _check_size(path, (pixels.shape[1], pixels.shape[0]), size)
    return pixels


def read_png(path: Path, size: tuple[int, int] | None = None) -> npt.NDArray[np.uint8]:
    """An RGB image, (rows, columns, 3); `size` is the columns and rows that it must have."""
    from PIL import Image

    regular(path)
    try:
        with warnings.catch_warnings():
            # An image that is larger than its camera is refused below, by its size.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if size is not None:
                    _check_size(path, image.size, size)
                if _bits(path) > 8 or image.mode not in _MODES:
                    raise CorfError(f"{path} has more than 8 bits a sample, or colours that are neither grey nor RGB\n  help: write an RGB image of 8 bits")
                return np.array(image.convert("RGB"), dtype=np.uint8)
    except CorfError:
        raise
    except Exception as error:  # The library raises OSError, SyntaxError, ValueError, DecompressionBombError, struct.error and others.
        raise CorfError(f"{path} cannot be read: {error}") from error


# What Pillow calls images of 8 bits that become RGB without a loss but for their transparency.
_MODES = ("1", "L", "LA", "P", "RGB", "RGBA")


def _bits(path: Path) -> int:
    """Bits of a sample of a PNG, which the library may reduce or clamp without a word; of another file, 8."""
    with open(path, "rb") as file:
        head = file.read(25)
    return head[24] if len(head) == 25 and head.startswith(b"\x89PNG\r\n\x1a\n") else 8


def _check_size(path: Path, found: tuple[int, int], wanted: tuple[int, int]) -> None:
    if found != wanted:
        raise CorfError(
            f"{path} is {found[0]}x{found[1]} pixels where the camera has {wanted[0]}x{wanted[1]}\n  help: restore the file that belongs to the data set"
        )
