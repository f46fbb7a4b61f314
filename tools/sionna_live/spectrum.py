"""The noncoherent Bartlett spectrum of an 8×8 half-wavelength array, the rear half-space gated, for any set of arrivals."""

import numpy as np

ROWS = COLUMNS = 8
AZIMUTH_DEG = np.arange(-90, 91, 3.0)
ELEVATION_DEG = np.arange(-60, 61, 3.0)
# Arrivals a block condenses.
BLOCK = 20_000


def elements():
    """Positions in wavelengths in the array's y–z plane: element i = column·8 + row."""
    column, row = np.divmod(np.arange(ROWS * COLUMNS), ROWS)
    return np.stack([(column - 3.5) / 2, -(row - 3.5) / 2], 1)


def grid():
    """Unit directions of the array frame (boresight +x), elevation by azimuth."""
    elevation, azimuth = np.meshgrid(np.radians(ELEVATION_DEG), np.radians(AZIMUTH_DEG), indexing="ij")
    return np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)


def covariance(directions, powers, world_from_array):
    """Σ p v vᴴ over arrivals from world directions (towards the last interaction), v_m = exp(j2π p_m·u).

    Its elements depend on the differences of element positions alone, so 15×15 sums over arrivals hold it.
    """
    u = directions @ np.asarray(world_from_array)
    front = u[:, 0] > 0
    y, z, powers = u[front, 1], u[front, 2], powers[front]
    lags = np.arange(-7, 8)
    sums = np.zeros((15, 15), dtype=complex)
    for begin in range(0, len(powers), BLOCK):
        block = slice(begin, begin + BLOCK)
        # Half-wavelength steps; columns run towards +y, rows towards −z.
        by_column = np.exp(1j * np.pi * lags[:, None] * y[block])
        by_row = np.exp(-1j * np.pi * lags[:, None] * z[block])
        sums += (by_column * powers[block]) @ by_row.T
    column, row = np.divmod(np.arange(ROWS * COLUMNS), ROWS)
    return sums[column[:, None] - column + 7, row[:, None] - row + 7]


def bartlett(covariances, towards=None):
    """P(u) = wᴴ R w / N², linear, at directions of the array frame (…, 3): the grid unless told."""
    w = np.exp(2j * np.pi * (grid() if towards is None else towards)[..., 1:] @ elements().T)
    return np.einsum("...i,ij,...j->...", w.conj(), covariances, w, optimize=True).real / (ROWS * COLUMNS) ** 2
