"""Side by side: corf, Mitsuba with corf's reflection model, their difference, Mitsuba's own model."""

import numpy as np
from PIL import Image, ImageDraw

from .compare import develop

# Differences are shown this much larger, around grey.
GAIN = 8
CAPTION_PX = 14
GAP_PX = 4


def side_by_side(path, ours, theirs, standard, exposure_ev):
    """One row per view; the arrays are (views, height, width, 3) of linear radiance."""
    views, height, width, _ = ours.shape
    titles = ("corf", "Mitsuba, corf's formulas", f"difference x{GAIN}", "Mitsuba, own plugins")
    size = (4 * width + 3 * GAP_PX, CAPTION_PX + views * (height + GAP_PX) - GAP_PX)
    sheet = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(sheet)
    for k, title in enumerate(titles):
        draw.text((k * (width + GAP_PX) + 2, 1), title, fill="black")
    for v in range(views):
        a, b, c = (develop(x[v], exposure_ev) for x in (ours, theirs, standard))
        for k, image in enumerate((a, b, (a - b) * GAIN + 128, c)):
            tile = Image.fromarray(np.clip(image, 0, 255).astype(np.uint8))
            sheet.paste(tile, (k * (width + GAP_PX), CAPTION_PX + v * (height + GAP_PX)))
    # 256 colours: noise would make the file four times as large.
    sheet.quantize(256).save(path, optimize=True)
