"""Two renderers' images of one thing: ratio of means, and PSNR without either one's noise."""

from dataclasses import dataclass

import numpy as np

# Where corf's developer rolls highlights off.
KNEE = 0.6
# Exposed radiance from which a pixel looks into a lamp.
WHITE = 1.0
# What agreement means.
MAX_MEAN_DEVIATION = 0.01
MIN_PSNR_DB = 38.0


def develop(radiance, exposure_ev):
    """corf's 8-bit picture of linear radiance, as whole numbers in float64: linear to the knee, an exponential shoulder, sRGB."""
    x = np.maximum(radiance, 0) * 2.0**exposure_ev
    y = np.where(x <= KNEE, x, KNEE + (1 - KNEE) * (1 - np.exp(-(np.maximum(x, KNEE) - KNEE) / (1 - KNEE))))
    encoded = np.where(y <= 0.0031308, 12.92 * y, 1.055 * np.maximum(y, 1e-12) ** (1 / 2.4) - 0.055)
    return np.floor(np.clip(encoded, 0, 1) * 255 + 0.5)


def exposure(radiance):
    """EV that brings the geometric mean to a middle grey of 0.24, as corf meters."""
    luminance = radiance @ np.array([0.2126, 0.7152, 0.0722])
    return round(float(np.log2(0.24 / np.exp(np.mean(np.log(np.maximum(luminance, 1e-4)))))), 2)


@dataclass
class Agreement:
    """How two sides compare; each side is two independent halves."""

    ratio: float
    ratio_error: float
    psnr_db: float
    view_ratios: list
    view_psnrs_db: list

    @property
    def passes(self):
        return abs(self.ratio - 1) <= MAX_MEAN_DEVIATION and self.psnr_db >= MIN_PSNR_DB

    def as_json(self):
        return {**self.__dict__, "passes": bool(self.passes)}


def psnr(first, second):
    """PSNR of `mean(d₁·d₂)`, the product of two independent differences of 8-bit pictures: noise has no expectation in it. What is less
    than its own standard error is told as that."""
    product = first * second
    error = product.std() / np.sqrt(product.size)
    return float(10 * np.log10(255**2 / max(product.mean(), error, 1e-9)))


def agreement(ours, theirs, exposure_ev):
    """`ours`, `theirs`: two halves each, (2, views, height, width, 3) of linear radiance."""
    a, b = np.stack(ours), np.stack(theirs)
    # Lamps that are looked at would drown the rest of a mean. A half's pixels are chosen by the other half, so that no firefly decides
    # whether it counts.
    dark = ((a + b).mean(axis=-1) / 2 * 2.0**exposure_ev < WHITE)[::-1, ..., None]
    mean = lambda x, where: (x * where).sum(axis=(1, 2, 3, 4)) / where.sum(axis=(1, 2, 3, 4))
    (a1, a2), (b1, b2) = mean(a, dark), mean(b, dark)
    ratio = (a1 + a2) / (b1 + b2)
    spread = [abs(x - y) / (x + y) for x, y in ((a1, a2), (b1, b2))]
    d = [develop(a[k], exposure_ev) - develop(b[k], exposure_ev) for k in (0, 1)]
    views = range(a.shape[1])
    return Agreement(
        float(ratio),
        float(np.hypot(*spread)),
        psnr(d[0], d[1]),
        [float(mean(a[:, [v]], dark[:, [v]]).sum() / mean(b[:, [v]], dark[:, [v]]).sum()) for v in views],
        [psnr(d[0][v], d[1][v]) for v in views],
    )


def against_joint(image, joint, exposure_ev):
    """PSNR of one image, its own noise included, against the joint converged one of two halves, without that one's noise."""
    c, (first, second) = develop(image, exposure_ev), (develop(half, exposure_ev) for half in joint)
    return float(10 * np.log10(255**2 / max(((c - first) * (c - second)).mean(), 1e-9)))
