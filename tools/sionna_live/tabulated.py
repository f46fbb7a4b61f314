"""One antenna pattern as a table: corf's file of it, and the same as a pattern of Sionna RT's, interpolated by the same rule."""

import numpy as np


class Table:
    """Gain in decibels every `step_deg` degrees of tilt (from the horizon up) and pan (from boresight to the left): gain_db[tilt, pan]."""

    def __init__(self, step_deg, gain_db):
        self.step_deg, self.gain_db = step_deg, np.asarray(gain_db, dtype=float)
        rows, columns = self.gain_db.shape
        if (rows - 1) * step_deg != 180 or columns * step_deg != 360:
            raise ValueError(f"{rows} tilts and {columns} pans every {step_deg} degrees are no sphere")

    @classmethod
    def lopsided(cls, step_deg=5):
        """A beam to the left and above boresight, with a ripple: it equals no mirror image of itself, and its mean gain is below 1."""
        tilt, pan = np.meshgrid(np.arange(-90, 91, step_deg), np.arange(-180, 180, step_deg), indexing="ij")
        t, p = np.radians(tilt), np.radians(pan)
        towards = np.cos(t) * np.cos(p) * 0.85 + np.cos(t) * np.sin(p) * 0.45 + np.sin(t) * 0.27
        return cls(step_deg, 8.0 * towards - 5.0 + 1.5 * np.sin(3 * p + 0.4) * np.cos(t) + np.sin(4 * t))

    def mirrored(self):
        """Left and right exchanged."""
        columns = self.gain_db.shape[1]
        return Table(self.step_deg, self.gain_db[:, -np.arange(columns) % columns])

    def write(self, path):
        """As corf reads it."""
        rows, columns = self.gain_db.shape
        lines = ["tilt_deg,pan_deg,gain_db"]
        for i in range(rows):
            lines += [f"{i * self.step_deg - 90},{j * self.step_deg - 180},{float(self.gain_db[i, j])!r}" for j in range(columns)]
        path.write_text("\n".join(lines) + "\n")

    def register(self, name):
        """Makes it a pattern of Sionna RT's under this name."""
        import drjit as dr
        import mitsuba as mi
        from sionna.rt.antenna_pattern import PolarizedAntennaPattern, register_antenna_pattern

        rows, columns = self.gain_db.shape
        samples = mi.Float(np.ascontiguousarray(self.gain_db.ravel(), dtype=np.float32))

        def vertical(theta, phi):
            y = dr.clip((180 - theta * (180 / np.pi)) / self.step_deg, 0, rows - 1)
            x = (phi * (180 / np.pi) + 180) / self.step_deg
            # Azimuths come beyond a turn as well.
            x -= dr.floor(x / columns) * columns
            i = dr.minimum(mi.UInt(y), rows - 2)
            j = dr.minimum(mi.UInt(x), columns - 1)
            a, b = y - mi.Float(i), x - mi.Float(j)
            k = dr.select(j + 1 >= columns, mi.UInt(0), j + 1)
            at = lambda i, j: dr.gather(mi.Float, samples, i * columns + j)
            row = lambda i: at(i, j) * (1 - b) + at(i, k) * b
            level_db = row(i) * (1 - a) + row(i + 1) * a
            return mi.Complex2f(dr.power(10.0, level_db / 20.0), 0)

        def factory(*, polarization, polarization_model="tr38901_2"):
            return PolarizedAntennaPattern(v_pattern=vertical, polarization=polarization, polarization_model=polarization_model)

        register_antenna_pattern(name, factory)


def pairs(ours, theirs, within_m=2e-3):
    """Paths of the same interactions at the same places: (pairs, ours alone, theirs alone), of one link."""
    left, found = list(theirs), []
    alone = []
    for path in ours:
        fits = [
            other
            for other in left
            if other["types"] == path["types"] and (not path["types"] or np.abs(other["vertices"] - path["vertices"]).max() < within_m)
        ]
        if not fits:
            alone.append(path)
            continue
        best = min(fits, key=lambda other: np.abs(other["vertices"] - path["vertices"]).sum() if path["types"] else 0.0)
        # A path that the library repeats is taken once.
        left = [other for other in left if all(other is not fit for fit in fits)]
        found.append((path, best))
    return found, alone, left
