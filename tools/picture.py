"""The README's picture: one held-out keyframe of a `corf demo` folder, observed, predicted, and the error.

    python tools/picture.py DEMO_FOLDER KEYFRAME OUT.png      (needs numpy, pillow, matplotlib, OpenEXR)
"""

import json
import sys
from pathlib import Path

import matplotlib
import numpy as np
import OpenEXR
from matplotlib.font_manager import findfont
from PIL import Image, ImageDraw, ImageFont

WIDTH, GAP, CAPTION = 420, 8, 22
ERROR_OPTICAL, ERROR_DB = 0.25, 20.0


def db_range(node):
    """The dataset's one dB range, wherever dataset.json keeps it."""
    if isinstance(node, dict):
        if "min_db" in node and "max_db" in node:
            return node["min_db"], node["max_db"]
        for child in node.values():
            found = db_range(child)
            if found:
                return found
    return None


def colour(name, values):
    return (matplotlib.colormaps[name](np.clip(values, 0, 1))[..., :3] * 255).astype("uint8")


def main(demo, keyframe, out):
    demo, stem = Path(demo), f"{int(keyframe):05d}"
    low, high = db_range(json.loads((demo / "dataset/dataset.json").read_text()))
    predictions = demo / "predictions/corf-gs"
    observed = np.array(Image.open(demo / f"dataset/optical/images/{stem}.png").convert("RGB"))
    predicted = np.array(Image.open(predictions / f"{stem}-optical.jpg").convert("RGB"))
    with OpenEXR.File(str(demo / f"dataset/rf/spectra/{stem}.exr")) as exr:
        power = np.array(next(iter(exr.channels().values())).pixels)
    truth = np.clip((10 * np.log10(np.maximum(power, 1e-30)) - low) / (high - low), 0, 1)
    scalar = np.array(Image.open(predictions / f"{stem}-spectrum.png").convert("L")) / 255.0
    error = np.abs(observed.astype(float) - predicted).mean(-1) / 255 / ERROR_OPTICAL
    error_db = 0.5 + 0.5 * (scalar - truth) * (high - low) / ERROR_DB
    rows = [
        [(observed, "image, observed"), (predicted, "predicted"), (colour("inferno", error), "mean absolute error (0 to 25 %)")],
        [
            (colour("jet", truth), "angular power spectrum at 60 GHz, observed"),
            (colour("jet", scalar), "predicted"),
            (colour("bwr", error_db), "predicted − observed (±20 dB)"),
        ],
    ]
    heights = [WIDTH * row[0][0].shape[0] // row[0][0].shape[1] for row in rows]
    sheet = Image.new("RGB", (3 * WIDTH + 2 * GAP + 86, sum(heights) + 2 * CAPTION + GAP), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.truetype(findfont("DejaVu Sans"), 13)
    y = 0
    for row, height in zip(rows, heights):
        for column, (pixels, caption) in enumerate(row):
            x = column * (WIDTH + GAP)
            sheet.paste(Image.fromarray(pixels).resize((WIDTH, height), Image.NEAREST), (x, y))
            draw.text((x, y + height + 3), caption, fill=(60, 70, 85), font=font)
        y += height + CAPTION
    x, y, height = 3 * WIDTH + 2 * GAP + 10, heights[0] + CAPTION, heights[1]
    sheet.paste(Image.fromarray(colour("jet", np.linspace(1, 0, height))[:, None, :].repeat(14, 1)), (x, y))
    for i in range(5):
        draw.text((x + 18, y + (height - 14) * i // 4), f"{high - (high - low) * i / 4:.0f} dB", fill=(60, 70, 85), font=font)
    sheet.save(out)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
