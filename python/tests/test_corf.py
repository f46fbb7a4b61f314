"""Tests of the package by itself: `python -m unittest discover --start-directory python/tests`. The program is not needed; python/examples/tour.py runs it."""

import json
import os
import stat
import struct
import sys
import tempfile
import textwrap
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import OpenEXR
from PIL import Image

import corf

POSE = [[0.0, 0.0, 1.0, 2.0], [-1.0, 0.0, 0.0, 3.0], [0.0, -1.0, 0.0, 1.5], [0.0, 0.0, 0.0, 1.0]]


def write_exr(path: Path, channel: str, values: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {channel: values}) as file:
        file.write(str(path))


def write_png(path: Path, values: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(values).save(path)


def write_dataset(folder: Path, radio: bool = True, depth: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three keyframes of 4 x 3 pixels and spectra of 2 x 2, as docs/dataset-format.md lays them out; returns what is in the second."""
    rng = np.random.default_rng(1)
    camera = {"width": 4, "height": 3, "fx": 2.0, "fy": 2.5, "cx": 2.0, "cy": 1.5}
    header = {
        "name": "made by hand",
        "optical_camera": camera,
        "rf_camera": {**camera, "width": 2, "height": 2, "cx": 1.0, "cy": 1.0},
        "frequency_hz": 60e9,
        "quantity": "power_per_steradian",
        "transmitter": {"position_m": [1.0, 2.0, 3.0]},
    }
    if not radio:
        header["modalities"] = {"light": True, "radio": False}
    split = {"train": [1, 2], "test": [0], "held_out_segment": [1]}
    document = {"schema": "corf-dataset/2", "header": header, "conventions": {"frames": {}}, "split": split}
    document["db_range"] = {"min_db": -120.0, "max_db": -60.0} if radio else None
    (folder / "dataset.json").write_text(json.dumps(document))
    frames = [{"index": i, "file": f"{i + 1:05}", "time_s": 0.5 * i, "world_from_camera": POSE} for i in range(3)]
    (folder / "trajectory.json").write_text(json.dumps({"keyframes": frames}))
    for i in range(3):
        image = rng.integers(0, 256, (3, 4, 3), dtype=np.uint8)
        z = rng.uniform(1, 9, (3, 4)).astype(np.float32)
        spectrum = np.array([[0.0, 1e-9], [1e-13, 2e-7]], dtype=np.float32) * np.float32(i + 1)
        write_png(folder / f"optical/images/{i + 1:05}.png", image)
        if depth:
            write_exr(folder / f"optical/depth/{i + 1:05}.exr", "Z", z)
        if radio:
            write_exr(folder / f"rf/spectra/{i + 1:05}.exr", "Y", spectrum)
        if i == 1:
            second = (image, z, spectrum)
    return second


class Folder(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)


class Dataset(Folder):
    def test_keyframes_are_what_is_on_disk(self) -> None:
        image, z, spectrum = write_dataset(self.folder)
        dataset = corf.Dataset(self.folder)
        self.assertEqual((len(dataset), dataset.names, dataset.train, dataset.test), (3, ["00001", "00002", "00003"], [1, 2], [0]))
        keyframe = dataset[1]
        np.testing.assert_array_equal(keyframe.image, image)
        np.testing.assert_array_equal(keyframe.depth_m, z)
        np.testing.assert_array_equal(keyframe.spectrum_linear, spectrum)
        self.assertEqual([a.dtype for a in (keyframe.image, keyframe.depth_m, keyframe.spectrum_linear)], [np.uint8, np.float32, np.float32])
        np.testing.assert_allclose(keyframe.spectrum_db, [[-120, 10 * np.log10(2e-9)], [10 * np.log10(2e-13), 10 * np.log10(4e-7)]], rtol=1e-6)
        np.testing.assert_array_equal(keyframe.world_from_camera, POSE)
        self.assertEqual(keyframe.world_from_camera.dtype, np.float64)
        np.testing.assert_array_equal(keyframe.intrinsics, [[2, 0, 2], [0, 2.5, 1.5], [0, 0, 1]])
        np.testing.assert_array_equal(keyframe.transmitter_m, [1, 2, 3])
        self.assertEqual((keyframe.time_s, keyframe.is_test, dataset[0].is_test), (0.5, False, True))
        self.assertIsNone(keyframe.surface)
        self.assertIsNone(keyframe.mask)

    def test_a_mask_says_which_pixels_count(self) -> None:
        write_dataset(self.folder)
        write_png(self.folder / "optical/masks/00002_mask.png", np.array([[255, 0, 255, 255], [0, 0, 1, 255], [255] * 4], dtype=np.uint8))
        dataset = corf.Dataset(self.folder)
        np.testing.assert_array_equal(dataset[1].mask, [[True, False, True, True], [False, False, True, True], [True] * 4])
        self.assertIsNone(dataset[0].mask)

    def test_it_is_a_sequence(self) -> None:
        write_dataset(self.folder)
        dataset = corf.Dataset(self.folder)
        self.assertEqual([k.name for k in dataset], dataset.names)
        self.assertEqual([k.index for k in dataset[1:]], [1, 2])
        self.assertEqual((dataset[-1].name, dataset["00003"].index), ("00003", 2))
        self.assertRaises(IndexError, lambda: dataset[3])
        with self.assertRaisesRegex(KeyError, "00001 to 00003"):
            dataset["00004"]

    def test_what_is_missing_is_none_or_an_error(self) -> None:
        write_dataset(self.folder, radio=False, depth=False)
        dataset = corf.Dataset(self.folder)
        self.assertIsNone(dataset.db_range)
        self.assertIsNone(dataset[0].depth_m)
        self.assertEqual((dataset.has_light, dataset.has_radio), (True, False))
        with self.assertRaisesRegex(corf.CorfError, "has no spectra"):
            dataset[0].spectrum_db

    def test_other_folders_and_damage_are_refused(self) -> None:
        with self.assertRaisesRegex(corf.CorfError, "holds no dataset.json"):
            corf.Dataset(self.folder)
        with self.assertRaisesRegex(corf.CorfError, "is not there"):
            corf.Dataset(self.folder / "elsewhere")
        write_dataset(self.folder)
        (self.folder / "rf/spectra/00001.exr").write_bytes(b"no picture")
        (self.folder / "optical/images/00001.png").write_bytes(b"no picture")
        keyframe = corf.Dataset(self.folder)[0]
        for read in (lambda: keyframe.spectrum_linear, lambda: keyframe.image):
            with self.assertRaisesRegex(corf.CorfError, "00001.* cannot be read"):
                read()
        text = (self.folder / "dataset.json").read_text()
        (self.folder / "dataset.json").write_text(text.replace("corf-dataset/2", "corf-dataset/9"))
        with self.assertRaisesRegex(corf.CorfError, "corf-dataset/9"):
            corf.Dataset(self.folder)


class Program(Folder):
    """The package with a program that says what a test wants."""

    def stand_in(self, body: str) -> None:
        path = self.folder / "corf"
        path.write_text(f"#!{sys.executable}\nimport json, pathlib, sys\nwords = sys.argv[1:]\n" + textwrap.dedent(body))
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        patch = mock.patch.dict(os.environ, {"CORF_BIN": str(path)})
        patch.start()
        self.addCleanup(patch.stop)

    def test_a_missing_program_says_how_to_get_it(self) -> None:
        with mock.patch.dict(os.environ, {"CORF_BIN": "", "PATH": str(self.folder)}):
            with self.assertRaisesRegex(corf.CorfError, "cargo install --path crates/bench"):
                corf.program()
        with mock.patch.dict(os.environ, {"CORF_BIN": str(self.folder / "none")}):
            with self.assertRaisesRegex(corf.CorfError, "CORF_BIN=.*none"):
                corf.program()

    def test_the_programs_error_is_the_exceptions_message(self) -> None:
        self.stand_in('print("tracing 3 of 4", file=sys.stderr)\nprint("error: x.toml: no such key\\n  help: remove it", file=sys.stderr)\nsys.exit(2)')
        with self.assertRaises(corf.CorfError) as caught:
            corf.run("paths", "x.toml")
        self.assertEqual((str(caught.exception), caught.exception.exit_code), ("x.toml: no such key\n  help: remove it", 2))

    def test_options_become_flags_and_json_becomes_arrays(self) -> None:
        self.stand_in(
            """
            path = {"types": "R", "objects": ["Wall"], "vertices": [[1.0, 2.0, 3.0]], "a": [0.3, -0.4], "tau": 1e-8, "length_m": 3.0,
                    "theta_r": 1.1, "phi_r": 0.1, "theta_t": 1.2, "phi_t": 0.2}
            direct = dict(path, types="", objects=[], vertices=[], a=[1.0, 0.0], tau=0.0)
            print(json.dumps({"frequency_hz": 6e10, "tx": [0, 0, 1], "rx": [1, 0, 1], "paths": [direct, path], "words": words}))
            """
        )
        found = corf.paths("room.toml", (0, 0, -1), [1.5, 0, 1e-9], depth=2, diffraction=True, diffuse=False, rx_array="8x8", transmitter=["a", "b"])
        words = ["paths", "room.toml", "--tx=0.0,0.0,-1.0", "--rx=1.5,0.0,1e-09", "--depth=2", "--diffraction", "--rx-array=8x8", "--transmitter=a", "--transmitter=b"]
        self.assertEqual(found.document["words"], words)
        self.assertEqual((len(found), found.types, found.objects), (2, ["", "R"], [[], ["Wall"]]))
        self.assertEqual([v.shape for v in found.vertices_m], [(0, 3), (1, 3)])
        np.testing.assert_allclose(found.gain_db, [0, 20 * np.log10(0.5)])
        # A hundredth of a microsecond is 600 periods of 60 GHz, and half a period of 50 MHz.
        np.testing.assert_allclose(found.h(), 1.3 - 0.4j, atol=1e-6)
        np.testing.assert_allclose(found.h(np.array([0.0, 5e7])), [1.3 - 0.4j, 0.7 + 0.4j], atol=1e-6)
        for bad in (lambda: corf.paths("s", None, (1, 2)), lambda: corf.paths("s", None, (1, 2, 3), format="npz")):
            self.assertRaises(corf.CorfError, bad)

    def test_renderings_come_back_by_pose(self) -> None:
        self.stand_in(
            """
            out, poses = (pathlib.Path(words[words.index(flag) + 1]) for flag in ("--out", "--poses"))
            from PIL import Image
            (out / "images").mkdir(parents=True)
            for i, pose in enumerate(json.loads(poses.read_text())):
                Image.new("RGB", (4, 3), (int(pose[0][3]), i, 0)).save(out / f"images/{i + 1:05}.png")
            """
        )
        (self.folder / "run.json").write_text(json.dumps({"method": "corf-gs", "dataset": "d"}))
        field = corf.Field(self.folder)
        one = field.render(np.array(POSE))
        assert one.image is not None
        self.assertEqual((one.image.shape, tuple(one.image[0, 0]), one.jet), ((3, 4, 3), (2, 0, 0), None))
        moved = np.array(POSE)
        moved[0, 3] = 7
        several = field.render([np.array(POSE), moved])
        self.assertEqual([tuple(r.image[0, 0]) for r in several], [(2, 0, 0), (7, 1, 0)])
        self.assertEqual(field.render([]), [])
        for bad in (np.eye(3), np.full((4, 4), np.nan)):
            self.assertRaises(corf.CorfError, field.render, bad)


class Gaussians(Folder):
    def write(self, channels: int) -> dict[str, np.ndarray]:
        names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(9)), "opacity"]
        names += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)] + ["rf_opacity", *(f"rf_f_dc_{i}" for i in range(channels))]
        table = np.random.default_rng(2).normal(size=(5, len(names))).astype(np.float32)
        comments = "comment SplatRenderMode: mip\ncomment Vertical axis: 0 0 1\n"
        head = f"ply\nformat binary_little_endian 1.0\n{comments}element vertex 5\n" + "".join(f"property float {n}\n" for n in names) + "end_header\n"
        (self.folder / "coupled.ply").write_bytes(head.encode() + struct.pack(f"<{table.size}f", *table.ravel()))
        (self.folder / "run.json").write_text(json.dumps({"method": "corf-gs", "dataset": "d"}))
        return {n: table[:, k] for k, n in enumerate(names)}

    def test_columns_become_arrays_in_units(self) -> None:
        columns = self.write(1)
        g = corf.Field(self.folder).gaussians()
        self.assertEqual((len(g), g.sh.shape, g.rf_sh.shape), (5, (5, 4, 3), (5, 1, 1)))
        np.testing.assert_array_equal(g.position_m[:, 2], columns["z"])
        np.testing.assert_allclose(g.scale_m[:, 1], np.exp(columns["scale_1"]), rtol=1e-6)
        np.testing.assert_allclose(g.opacity, 1 / (1 + np.exp(-columns["opacity"])), rtol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(g.rotation_wxyz, axis=1), 1, rtol=1e-6)
        # Channel-major: the second coefficient of the green channel is f_rest_3.
        np.testing.assert_array_equal(g.sh[:, 1, 1], columns["f_rest_3"])
        np.testing.assert_array_equal(g.rf_sh[:, 0, 0], columns["rf_f_dc_0"])

    def test_a_truncated_file_and_a_run_without_gaussians_are_refused(self) -> None:
        self.write(3)
        field = corf.Field(self.folder)
        path = self.folder / "coupled.ply"
        path.write_bytes(path.read_bytes()[:-4])
        with self.assertRaisesRegex(corf.CorfError, "coupled.ply: header and data disagree"):
            field.gaussians()
        path.unlink()
        with self.assertRaisesRegex(corf.CorfError, "keeps no Gaussians"):
            field.gaussians()
        with self.assertRaisesRegex(corf.CorfError, "holds no run.json"):
            corf.Field(self.folder / "..")


if __name__ == "__main__":
    unittest.main()
