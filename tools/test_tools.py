"""Tests of the tools' own arithmetic: `python3 -m unittest discover --start-directory tools --pattern 'test_*.py'`. Nothing but Python is needed."""

import itertools
import json
import math
import struct
import tempfile
import unittest
from pathlib import Path

import compare_devices
import compare_gsplat
import digests


class Digests(unittest.TestCase):
    def test_what_depends_on_the_clock_is_left_out_at_any_depth(self):
        record = {"seconds": 1.0, "means": {"psnr_opt": 20.0}, "frames": [{"index": 3, "render_s": 0.1}], "device": "cpu"}
        self.assertEqual(digests.settled(record), {"means": {"psnr_opt": 20.0}, "frames": [{"index": 3}]})

    def test_two_runs_of_one_thing_have_one_digest_and_another_thing_has_another(self):
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{i}.json" for i in range(3)]
            for path, (seconds, value) in zip(paths, [(1.0, 20.0), (2.0, 20.0), (1.0, 20.1)]):
                path.write_text(json.dumps({"seconds": seconds, "value": value}))
            first, again, other = map(digests.digest, paths)
        self.assertEqual(first, again)
        self.assertNotEqual(first, other)


class CompareDevices(unittest.TestCase):
    def test_mean_and_deviation_are_those_of_a_sample(self):
        mean, deviation = compare_devices.mean_and_deviation([1.0, 2.0, 3.0, 4.0])
        self.assertEqual(mean, 2.5)
        self.assertAlmostEqual(deviation, (5.0 / 3.0) ** 0.5)


class CompareGsplat(unittest.TestCase):
    def test_points_are_read_as_corf_writes_them_and_damage_is_refused(self):
        names = "".join(f"property float {c}\n" for c in "xyz") + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex 2\n{names}end_header\n".encode()
        body = struct.pack("<3f3B", 1.0, -2.0, 0.5, 255, 0, 7) + struct.pack("<3f3B", 0.0, 0.25, 4.0, 1, 2, 3)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "points.ply"
            path.write_bytes(head + body)
            self.assertEqual(compare_gsplat.read_points(path), ([(1.0, -2.0, 0.5), (0.0, 0.25, 4.0)], [(255, 0, 7), (1, 2, 3)]))
            for damaged in [head + body[:-1], head.replace(b"float z", b"float w") + body, b"ply\n"]:
                path.write_bytes(damaged)
                self.assertRaises(ValueError, compare_gsplat.read_points, path)

    def test_training_keyframes_are_neither_held_out_nor_hidden(self):
        self.assertEqual(compare_gsplat.split_of(10, [0, 8], "test", 8), [1, 2, 3, 4, 5, 6, 7, 9])
        self.assertEqual(compare_gsplat.split_of(10, [4], "validation", 8), [1, 2, 3, 5, 6, 7, 9])
        self.assertEqual(compare_gsplat.split_of(6, [2, 3], "segment", 8), [0, 1, 4, 5])

    def test_geometry_of_the_cameras(self):
        self.assertAlmostEqual(compare_gsplat.extent_of([[0, 0, 0], [4, 0, 0], [2, 3, 0]]), 1.1 * 5**0.5)
        quarter = [[0.0, -1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 3.0], [0.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 1.0]]
        back = compare_gsplat.inverse(quarter)
        product = [[sum(back[r][k] * quarter[k][c] for k in range(4)) for c in range(4)] for r in range(4)]
        self.assertEqual(product, [[float(r == c) for c in range(4)] for r in range(4)])

    def test_every_epoch_has_every_view_once_and_the_seed_decides_the_order(self):
        drawn = list(itertools.islice(compare_gsplat.epochs(9, 3), 27))
        for first in (0, 9, 18):
            self.assertEqual(sorted(drawn[first : first + 9]), list(range(9)))
        self.assertEqual(drawn, list(itertools.islice(compare_gsplat.epochs(9, 3), 27)))
        self.assertNotEqual(drawn, list(itertools.islice(compare_gsplat.epochs(9, 4), 27)))

    def test_bands_and_psnr(self):
        self.assertEqual([compare_gsplat.degree_of(s) for s in (0, 999, 1000, 2500, 3000, 29999)], [0, 0, 1, 2, 3, 3])
        self.assertAlmostEqual(compare_gsplat.psnr(0.01), 20.0)
        self.assertEqual(compare_gsplat.psnr(0.0), 100.0)

    def test_the_report_ends_in_the_difference_of_the_means(self):
        lines, difference = compare_gsplat.report([0, 8], [30.0, 32.0], [29.0, 32.5])
        self.assertEqual(len(lines), 4)
        self.assertAlmostEqual(difference, 0.25)
        self.assertIn("+0.25", lines[-1])
        self.assertTrue(math.isfinite(difference))


if __name__ == "__main__":
    unittest.main()
