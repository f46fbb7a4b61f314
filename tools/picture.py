"""The README's picture: one held-out keyframe of a `corf demo` folder, observed, predicted, and the error, each scale with a bar of its own.

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
# Of a bar: its own width, and that of its numbers.
BAR, NUMBERS = 14, 62
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
    levels = ("jet", [f"{high - (high - low) * i / 4:.0f} dB" for i in range(5)])
    errors = ("inferno", [f"{100 * ERROR_OPTICAL * (1 - i / 4):.3g} %" for i in range(5)])
    differences = ("bwr", [f"{ERROR_DB * (1 - i / 2):+.0f} dB".replace("+0", "0") for i in range(5)])
    # A picture, its caption, and the colour map and numbers of its bar; the two spectra share one.
    rows = [
        [
            (observed, "image, observed", None),
            (predicted, "predicted", None),
            (colour("inferno", error), "mean absolute error", errors),
        ],
        [
            (colour("jet", truth), "angular power spectrum at 60 GHz, observed", None),
            (colour("jet", scalar), "predicted", levels),
            (colour("bwr", error_db), "predicted − observed", differences),
        ],
    ]
    places = [0, WIDTH + GAP, 2 * (WIDTH + GAP) + GAP + BAR + NUMBERS]
    heights = [WIDTH * row[0][0].shape[0] // row[0][0].shape[1] for row in rows]
    sheet = Image.new("RGB", (places[2] + WIDTH + GAP + BAR + NUMBERS, sum(heights) + 2 * CAPTION + GAP), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.truetype(findfont("DejaVu Sans"), 13)
    ink = (60, 70, 85)
    y = 0
    for row, height in zip(rows, heights):
        for x, (pixels, caption, bar) in zip(places, row):
            sheet.paste(Image.fromarray(pixels).resize((WIDTH, height), Image.NEAREST), (x, y))
            draw.text((x, y + height + 3), caption, fill=ink, font=font)
            if bar:
                name, numbers = bar
                ramp = colour(name, np.linspace(1, 0, height))[:, None, :].repeat(BAR, 1)
                sheet.paste(Image.fromarray(ramp), (x + WIDTH + GAP, y))
                for i, number in enumerate(numbers):
                    draw.text((x + WIDTH + GAP + BAR + 4, y + (height - 15) * i // 4), number, fill=ink, font=font)
        y += height + CAPTION
    sheet.save(out)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
