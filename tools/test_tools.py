"""Tests of the tools' own arithmetic: `python3 -m unittest discover --start-directory tools --pattern 'test_*.py'`. Nothing but Python is needed."""

import json
import tempfile
import unittest
from pathlib import Path

import compare_devices
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


if __name__ == "__main__":
    unittest.main()
