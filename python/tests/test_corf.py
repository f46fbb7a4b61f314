"""Tests of the package by itself: `python -m unittest discover --start-directory python/tests`. The program is not needed; python/examples/tour.py runs it."""

import json
import os
import stat
import struct
import sys
import tempfile
import textwrap
import unittest
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
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
    (folder / "trajectory.json").write_text(json.dumps({"schema": "corf-trajectory/1", "keyframes": frames}))
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


class Malformed(Folder):
    """Whatever is wrong with a file is a CorfError that names it, and no file outside of the data set is read."""

    def changed(self, name: str, change: Callable[[Any], Any]) -> str:
        """Writes a sound data set with one JSON file changed, reads all of it and returns the error's text."""
        write_dataset(self.folder)
        document = json.loads((self.folder / name).read_text())
        replaced = change(document)
        (self.folder / name).write_text(json.dumps(document if replaced is None else replaced))
        return self.said()

    def said(self) -> str:
        with self.assertRaises(corf.CorfError) as caught:
            for keyframe in corf.Dataset(self.folder):
                keyframe.image, keyframe.depth_m, keyframe.mask, keyframe.surface, keyframe.spectrum_db
        return str(caught.exception)

    def test_documents_are_checked_key_by_key(self) -> None:
        def put(path: str, value: Any) -> Callable[[Any], None]:
            *way, last = path.split(".")

            def change(document: Any) -> None:
                for key in way:
                    document = document[int(key) if key.isdigit() else key]
                document[int(last) if last.isdigit() else last] = value

            return change

        def drop(path: str) -> Callable[[Any], None]:
            *way, last = path.split(".")

            def change(document: Any) -> None:
                for key in way:
                    document = document[int(key) if key.isdigit() else key]
                del document[last]

            return change

        for change, word in [
            (lambda d: [], "a list is no table"),
            (drop("schema"), "schema"),
            (put("schema", 2), "schema: 2 is no text"),
            (drop("header"), "header"),
            (put("header", "x"), "header: 'x' is no table"),
            (drop("header.quantity"), "header: has no quantity"),
            (put("header.frequency_hz", -1), "header.frequency_hz: -1 is not above 0"),
            (put("header.frequency_hz", float("nan")), "header.frequency_hz: nan is not finite"),
            (put("header.frequency_hz", 10**400), "header.frequency_hz: a number of many digits"),
            (put("header.transmitter", {"position_m": [1, 2]}), "header.transmitter.position_m: has 2 entries"),
            (put("header.transmitter", [1, 2, 3]), "header.transmitter"),
            (put("header.optical_camera.fx", "4"), "header.optical_camera.fx: '4' is no number"),
            (put("header.optical_camera.fy", 0), "header.optical_camera.fy"),
            (drop("header.rf_camera.width"), "header.rf_camera: has no width"),
            (put("header.rf_camera.height", 2.5), "header.rf_camera.height"),
            (put("header.modalities", {"light": 1, "radio": True}), "header.modalities.light"),
            (put("header.modalities", {"light": True, "radio": False}), "do not agree"),
            (put("split.train", [0, 9]), "split.train[1]: 9 is not under 3"),
            (put("split.train", [1, 1]), "split.train: names a keyframe twice"),
            (put("split.test", [1]), "trained with and held out"),
            (put("split", None), "split"),
            (put("db_range", {"min_db": 0}), "db_range: has no max_db"),
            (put("db_range.min_db", 0), "db_range: 0.0 to -60.0 dB"),
            (put("keyframes", 4), "has 3 keyframes"),
            (put("header.quantity", "volts"), "header.quantity: 'volts' is none of power_per_steradian"),
            (put("db_range.min_db", -1e300), "db_range.min_db: -1e+300 dB is no level"),
            (put("header.imported", {"db_range": {"min_db": 0, "max_db": -3}}), "header.imported.db_range: 0.0 to -3.0 dB"),
            (put("header.imported", {"db_range": {"min_db": -110, "max_db": -60}}), "header.imported.db_range: is another range"),
        ]:
            self.assertIn(word, self.changed("dataset.json", change))
        inf = [[float("inf"), *POSE[0][1:]], *POSE[1:]]
        for change, word in [
            (lambda d: 3, "3 is no table"),
            (drop("keyframes"), "trajectory.json: has no keyframes"),
            (drop("schema"), "trajectory.json: has no schema"),
            (put("schema", "corf-trajectory/9"), "trajectory of version corf-trajectory/9"),
            (put("keyframes.2.world_from_camera.0", [0.0, 0.0, 1.0, 1e300]), "the position is [1e+300, 3, 1.5]"),
            (put("keyframes", {"0": 1}), "keyframes: a table is no list"),
            (put("keyframes.1", 7), "keyframes[1]: 7 is no table"),
            (drop("keyframes.1.index"), "keyframes[1]: has no index"),
            (put("keyframes.1.index", 0), "keyframes[1]: its index is 0"),
            (put("keyframes.1.index", "1"), "keyframes[1].index"),
            (put("keyframes.1.file", "../../x"), "keyframes[1]: its file is '../../x'"),
            (put("keyframes.1.file", "/etc/passwd"), "keyframes[1]"),
            (put("keyframes.1.file", "00001"), "keyframes[1]"),
            (put("keyframes.1.time_s", None), "keyframes[1]: has no time_s"),
            (put("keyframes.2.world_from_camera", inf), "keyframes[2].world_from_camera[0][0]: inf is not finite"),
            (put("keyframes.2.world_from_camera", [[1, 0], [0, 1]]), "keyframes[2].world_from_camera: has 2 entries where 4 belong"),
            (put("keyframes.2.world_from_camera", POSE[:3]), "keyframes[2].world_from_camera: has 3 entries"),
            (put("keyframes.2.world_from_camera", [POSE[0], POSE[1][:3], *POSE[2:]]), "keyframes[2].world_from_camera[1]"),
            (put("keyframes.2.world_from_camera.0", [0.0, 0.0, 2.0, 2.0]), "no rotation"),
            (put("keyframes.2.world_from_camera.0", [0.0, 0.0, -1.0, 2.0]), "no rotation"),
            (put("keyframes.2.world_from_camera.3", [0, 0, 0, 2]), "last row"),
        ]:
            self.assertIn(word, self.changed("trajectory.json", change))

    def test_text_that_is_no_json_is_named(self) -> None:
        for name in ("dataset.json", "trajectory.json"):
            for data in (b"", b"{", b"\xff\xfe", b"[" * 100_000, b"1" * 5000):
                write_dataset(self.folder)
                (self.folder / name).write_bytes(data)
                self.assertIn(name, self.said())

    def test_pictures_are_whole_and_of_the_cameras_size(self) -> None:
        def chunk(kind: bytes, data: bytes) -> bytes:
            return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

        def png(width: int, height: int, data: bytes) -> bytes:
            head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            return b"\x89PNG\r\n\x1a\n" + head + data

        sound = chunk(b"IDAT", zlib.compress(bytes(39))) + chunk(b"IEND", b"")
        for name in ("optical/images/00002.png", "optical/masks/00002_mask.png"):
            for data in (b"", png(4, 3, b""), png(4, 3, chunk(b"IDAT", b"no deflate")), png(4, 3, b"\0\0\0\7IDAT"), png(40_000, 40_000, sound), png(5, 3, sound)):
                write_dataset(self.folder)
                (self.folder / name).parent.mkdir(exist_ok=True)
                (self.folder / name).write_bytes(data)
                self.assertIn(name, self.said())
                (self.folder / name).unlink()
        # Sixteen bits would be clamped, or lose half of themselves.
        wide = struct.pack(">IIBBBBB", 4, 3, 16, 2, 0, 0, 0)
        colour = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", wide) + chunk(b"IDAT", zlib.compress(bytes(3 * 25))) + chunk(b"IEND", b"")
        for data in (np.full((3, 4), 4000, dtype=np.uint16), colour):
            write_dataset(self.folder)
            if isinstance(data, bytes):
                (self.folder / "optical/images/00002.png").write_bytes(data)
            else:
                write_png(self.folder / "optical/images/00002.png", data)
            self.assertIn("00002.png has more than 8 bits", self.said())
        write_dataset(self.folder)
        write_png(self.folder / "optical/images/00001.png", np.zeros((3, 5, 3), dtype=np.uint8))
        self.assertIn("is 5x3 pixels where the camera has 4x3", self.said())
        for folder, channel, values in [
            ("rf/spectra", "Y", np.zeros((3, 2), dtype=np.float32)),
            ("rf/spectra", "Y", np.full((2, 2), np.nan, dtype=np.float32)),
            ("rf/spectra", "Y", np.full((2, 2), -1, dtype=np.float32)),
            ("rf/spectra", "Y", np.ones((2, 2), dtype=np.uint32)),
            ("rf/spectra", "Z", np.ones((2, 2), dtype=np.float32)),
            ("optical/depth", "Z", np.ones((2, 2), dtype=np.float32)),
            ("optical/depth", "Z", np.full((3, 4), -1, dtype=np.float32)),
            ("optical/surfaces", "id", np.ones((3, 4), dtype=np.float32)),
        ]:
            write_dataset(self.folder)
            write_exr(self.folder / folder / "00003.exr", channel, values)
            self.assertIn(f"{folder}/00003.exr", self.said())
            (self.folder / folder / "00003.exr").unlink()

    def test_nothing_outside_of_the_folder_and_no_pipe_is_read(self) -> None:
        with tempfile.TemporaryDirectory() as outside:
            write_png(Path(outside) / "x.png", np.zeros((3, 4, 3), dtype=np.uint8))
            for name in ("optical/images/00001.png", "rf/spectra/00001.exr", "optical/depth/00001.exr", "trajectory.json", "dataset.json"):
                write_dataset(self.folder)
                path = self.folder / name
                path.rename(Path(outside) / path.name)
                path.symlink_to(Path(outside) / path.name)
                self.assertIn("leads out of its folder", self.said())
                path.unlink()
            write_dataset(self.folder)
            (self.folder / "rf/spectra").rename(Path(outside) / "spectra")
            (self.folder / "rf/spectra").symlink_to(Path(outside) / "spectra")
            self.assertIn("leads out of its folder", self.said())
            (self.folder / "rf/spectra").unlink()
        for name in ("optical/images/00001.png", "rf/spectra/00001.exr"):
            write_dataset(self.folder)
            (self.folder / name).unlink()
            os.mkfifo(self.folder / name)
            self.assertIn("pipe, socket or device", self.said())
            (self.folder / name).unlink()
        # A link within the data set is its own file.
        write_dataset(self.folder)
        (self.folder / "optical/images/00001.png").unlink()
        (self.folder / "optical/images/00001.png").symlink_to("00002.png")
        np.testing.assert_array_equal(corf.Dataset(self.folder)[0].image, corf.Dataset(self.folder)[1].image)

    def test_given_inputs(self) -> None:
        given = Path(os.environ.get("CORF_SHARED", Path(__file__).parents[2] / "../shared")) / "faults3/python"
        if not given.is_dir():
            self.skipTest(f"{given} is not there")
        for case in sorted(given.iterdir()):
            if case.is_dir():
                write_dataset(self.folder)
                for file in case.iterdir():
                    (self.folder / file.name).write_bytes(file.read_bytes())
                with self.assertRaises(corf.CorfError, msg=case.name) as caught:
                    corf.Dataset(self.folder)
                self.assertIn(".json", str(caught.exception))

    def test_runs_are_checked(self) -> None:
        for text, word in [("[]", "no table"), ("{}", "has no method"), ('{"method": 3, "dataset": "d"}', "method"), ('{"method": "corf-gs"}', "has no dataset"), ("{", "run.json")]:
            (self.folder / "run.json").write_text(text)
            with self.assertRaisesRegex(corf.CorfError, word):
                corf.Field(self.folder)
        with self.assertRaises(corf.CorfError):
            corf.Dataset("a\0b")
        with self.assertRaises(corf.CorfError):
            corf.Dataset("x" * 5000)
        (self.folder / "run.json").write_text('{"method": "corf-gs", "dataset": "d"}')
        field = corf.Field(self.folder)
        mirrored = np.array(POSE) * np.array([[-1.0], [1], [1], [1]])
        for poses in ([POSE, POSE[:3]], "poses", [[POSE, "x"]], mirrored, 2 * np.array(POSE)):
            self.assertRaises(corf.CorfError, field.render, poses)
        head = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n{}end_header\n"
        x = "property float x\n"
        for data in (
            head.format("", x),
            head.format("-1", x),
            head.format("1e9", x),
            head.format("9" * 30, x),
            head.format("0", x),
            head.format("0", "property float\n"),
            head.format("0", x + x),
            "",
        ):
            (self.folder / "coupled.ply").write_text(data)
            with self.assertRaisesRegex(corf.CorfError, "coupled.ply"):
                field.gaussians()
        (self.folder / "coupled.ply").unlink()
        os.mkfifo(self.folder / "coupled.ply")
        with self.assertRaisesRegex(corf.CorfError, "pipe"):
            field.gaussians()


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
        self.stand_in('print("{}")')
        self.assertRaisesRegex(corf.CorfError, "corf paths: has no paths", corf.paths, "s", None, (1, 2, 3))
        self.stand_in('print("no JSON")')
        self.assertRaisesRegex(corf.CorfError, "printed no JSON", corf.paths, "s", None, (1, 2, 3))
        for bad in (lambda: corf.paths("s", None, ("a", 1, 2)), lambda: corf.paths("s", None, (1, 2)), lambda: corf.paths("s", None, (1, 2, 3), format="npz")):
            self.assertRaises(corf.CorfError, bad)

    def test_the_gain_of_a_link_is_what_the_program_says_of_it(self) -> None:
        link = {"frequency_hz": 6e10, "tx": [0, 0, 1], "rx": [1, 0, 1], "paths": []}
        for channel, expected in (({"path_gain_db": -70.5, "rssi_dbm": -40.5}, (-70.5, -40.5)), ({"path_gain_db": None, "rssi_dbm": None}, (None, None))):
            self.stand_in(f"print(json.dumps({dict(link, channel=channel)!r}))")
            found = corf.paths("s", None, (1, 0, 1))
            self.assertEqual((found.path_gain_db, found.rssi_dbm), expected)
        self.stand_in(f"print(json.dumps({link!r}))")
        with self.assertRaisesRegex(corf.CorfError, "has no channel"):
            corf.paths("s", None, (1, 0, 1)).rssi_dbm

    def test_many_receivers_are_one_run_of_the_program(self) -> None:
        self.stand_in(
            """
            import numpy
            [file] = [word.split("=", 1)[1] for word in words if word.startswith("--rx-file=")]
            assert not any(word.startswith("--rx=") for word in words)
            link = {"frequency_hz": 6e10, "tx": [0, 0, 1], "paths": []}
            print(json.dumps({"links": [dict(link, rx=rx) for rx in numpy.load(file).tolist()]}))
            """
        )
        points = np.random.default_rng(3).uniform(-5, 5, (5000, 3))
        for given in (points, points.tolist(), [tuple(point) for point in points]):
            found = corf.links("s", None, given)
            np.testing.assert_array_equal([link.rx_m for link in found], points)
        self.assertRaisesRegex(corf.CorfError, "no point", corf.links, "s", None, [(1, 2, 3), (1, 2, float("nan"))])
        # A file of the caller's own stays, and points beside it are words.
        self.stand_in("print(json.dumps({'links': [], 'words': words}))")
        with mock.patch("corf._paths.parsed", wraps=corf._paths.parsed) as said:
            corf.links("s", [(0, 0, 1)], [(1, 2, 3), (4, 5, 6)], rx_file="mine.csv")
        expected = ["--tx=0.0,0.0,1.0", "--rx=1.0,2.0,3.0", "--rx=4.0,5.0,6.0", "--rx-file=mine.csv"]
        self.assertEqual(json.loads(said.call_args.args[0])["words"][2:], expected)

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
        far = np.array(POSE)
        far[0, 3] = 1e300
        for bad in (np.eye(3), np.full((4, 4), np.nan), far):
            self.assertRaises(corf.CorfError, field.render, bad)
        for bad in (np.array(POSE) + 1j, [np.array(POSE), np.array(POSE, dtype=complex)]):
            with self.assertRaisesRegex(corf.CorfError, "no real numbers.*complex"):
                field.render(bad)


    def test_aggregates_are_arrays_and_what_is_not_there_is_nan(self) -> None:
        self.stand_in(
            """
            import numpy
            out, poses = (pathlib.Path(words[words.index(flag) + 1]) for flag in ("--out", "--poses"))
            n = len(json.loads(poses.read_text()))
            names = ["path_gain_db", "rssi_dbm", "peak_azimuth_deg", "peak_elevation_deg", "peak_db", "best_beam_gain_db",
                     "azimuth_spread_deg", "zenith_spread_deg", "rate_bps_hz"]
            table = {name: numpy.full(n, -90.0) for name in names}
            table |= {"x_m": numpy.arange(n) * 1.0, "y_m": numpy.ones(n), "z_m": numpy.ones(n) * 2}
            table |= {"best_beam": numpy.array([27.0, numpy.nan][:n]), "outage": numpy.array([0.0, 1.0][:n])}
            assert words[words.index("--target-rate") + 1] == "3.5" and "--anywhere" in words
            numpy.savez(out, **table)
            """
        )
        (self.folder / "run.json").write_text(json.dumps({"method": "corf-gs", "dataset": "d"}))
        field = corf.Field(self.folder)
        found = field.query(np.array([POSE, POSE]), target_rate_bps_hz=3.5, anywhere=True)
        np.testing.assert_array_equal(found.position_m, [[0, 1, 2], [1, 1, 2]])
        self.assertEqual((found.best_beam.tolist(), found.outage.tolist(), found.outage_share), ([27, -1], [False, True], 0.5))
        np.testing.assert_allclose(found.peak_azimuth_rad, [-np.pi / 2] * 2)
        none = field.query([])
        self.assertEqual((len(none), none.position_m.shape, np.isnan(none.outage_share)), (0, (0, 3), True))
        self.assertRaises(corf.CorfError, field.query, np.eye(3))


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
