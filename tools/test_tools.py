"""Tests of the tools' own arithmetic: `python3 -m unittest discover --start-directory tools --pattern 'test_*.py'`. Nothing but Python is needed."""

import contextlib
import hashlib
import io
import itertools
import json
import math
import pickle
import re
import struct
import tempfile
import unittest
import zlib
from pathlib import Path

import book
import check_page
import check_qd
import check_view
import compare_devices
import compare_gsplat
import digests
import fetch_weights
import pictures
from format_rules import Failed


REPOSITORY = Path(__file__).resolve().parent.parent


class Index(unittest.TestCase):
    def test_every_tool_stands_in_the_index(self):
        index = (REPOSITORY / "tools/README.md").read_text()
        tools = [p.name for p in (REPOSITORY / "tools").iterdir() if p.suffix in {".py", ".sh", ".txt"} or (p.is_dir() and p.name[0] not in "._")]
        self.assertEqual([name for name in tools if f"`{name}" not in index and name != "__pycache__"], [])

    def test_a_pull_request_runs_the_steps_that_a_person_runs(self):
        script = (REPOSITORY / "tools/check.sh").read_text()
        steps = re.search(r"#   tools/check.sh.*: ([a-z ]+)\n", script).group(1).split()
        workflow = (REPOSITORY / ".github/workflows/ci.yml").read_text()
        self.assertEqual(sorted(re.search(r"step: \[(.*)\]", workflow).group(1).split(", ")), sorted(steps))

    def test_actions_stand_by_commit(self):
        for workflow in (REPOSITORY / ".github/workflows").iterdir():
            for use in re.findall(r"uses: (\S+)", workflow.read_text()):
                self.assertRegex(use, r"@[0-9a-f]{40}$", workflow.name)


class Pictures(unittest.TestCase):
    def test_each_is_there_small_shown_and_of_what_is_today(self):
        entries = json.loads((pictures.OUT / "pictures.json").read_text())
        self.assertEqual(list(entries), list(pictures.PICTURES))
        files = {file.name for file in pictures.OUT.iterdir()} - {"pictures.json"}
        self.assertEqual(files, set(pictures.PICTURES))
        documents = "".join(file.read_text() for file in [pictures.ROOT / "README.md", *(pictures.ROOT / "docs").glob("*.md")])
        for name, (_, shows) in pictures.PICTURES.items():
            with self.subTest(name):
                self.assertLess((pictures.OUT / name).stat().st_size, 400_000)
                self.assertIn(f"pictures/{name})", documents, "no document shows it")
                again = f"what it shows has changed: run tools/pictures.py target/release/corf --only {name}"
                self.assertEqual(entries[name], {"shows": shows, "sha256": pictures.digest(shows)}, again)


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


class CheckView(unittest.TestCase):
    WIDTH, CHANNELS = 5, 3

    def png(self, rows, kinds):
        """A PNG of rows of bytes, each filtered as its kind says."""
        filtered, above = b"", bytes(len(rows[0]))
        for row, kind in zip(rows, kinds):
            left = bytes(self.CHANNELS) + row
            corner = bytes(self.CHANNELS) + above
            values = [(v - check_view.predicted(kind, left[x], above[x], corner[x])) & 255 for x, v in enumerate(row)]
            filtered, above = filtered + bytes([kind, *values]), row
        chunks = [(b"IHDR", struct.pack(">IIBBBBB", self.WIDTH, len(rows), 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(filtered)), (b"IEND", b"")]
        return b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(c)) + k + c + bytes(4) for k, c in chunks)

    def test_pictures_are_read_whichever_way_they_are_filtered(self):
        rows = [bytes((37 * x * (y + 1) + 11 * y) % 256 for x in range(self.WIDTH * self.CHANNELS)) for y in range(6)]
        for kinds in itertools.product(range(5), repeat=2):
            decoded = check_view.decode_png(self.png(rows, (kinds * 3)[:6]))
            self.assertEqual(decoded, (self.WIDTH, 6, b"".join(rows)))

    def test_the_predictor_is_that_of_the_standard(self):
        self.assertEqual([check_view.predicted(k, 10, 20, 13) for k in range(5)], [0, 10, 20, 15, 20])
        self.assertEqual(check_view.predicted(4, 10, 20, 19), 10)
        self.assertEqual(check_view.predicted(4, 10, 10, 10), 10)

    def test_one_step_everywhere_is_48_db_and_sizes_must_agree(self):
        a, b = (2, 1, bytes([0, 10, 20, 30, 40, 50])), (2, 1, bytes([1, 11, 21, 31, 41, 51]))
        self.assertAlmostEqual(check_view.psnr(a, b), 48.1308, places=3)
        self.assertEqual(check_view.psnr(a, a), math.inf)
        with self.assertRaises(ValueError):
            check_view.psnr(a, (1, 2, a[2]))


class CheckPage(unittest.TestCase):
    ASSETS = Path(__file__).parent.parent / "crates/bench/src/viewer/assets"

    def test_ways_and_views_are_compared_by_their_greatest_difference(self):
        self.assertEqual(check_page.way((1, 2), (3, -1), 2), [(1, 2), (4, 1), (7, 0)])
        self.assertEqual(check_page.moved([0, 1, 5], [0.5, 1, 3]), 2)

    def test_the_page_holds_what_is_exposed_and_what_is_broken(self):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            page = folder / "a.html"
            page.write_text("".join(path.read_text() for path in sorted(self.ASSETS.glob("*.js"))))
            exposed = check_page.exposed(page, folder)
            self.assertIn("window.app", exposed.read_text())
            self.assertEqual(len({changed.read_text() for _, changed in check_page.changed(exposed, folder, check_page.BROKEN)}), 3)
            page.write_text("another page")
            with self.assertRaises(ValueError):
                check_page.exposed(page, folder)


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
def numpy_pickle(shape, values, kind=b"f4", order=b"<", fortran=False):
    """What pickle.dumps makes of a numpy array (protocol 2), written out, so that no numpy is needed."""
    data = struct.pack(f"<{len(values)}f", *values)
    text = lambda word: b"X" + struct.pack("<I", len(word)) + word
    numbers = lambda items: b"(" + b"".join(b"K" + bytes([n]) for n in items) + b"t"
    made = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n" + numbers([0]) + text(b"b") + b"tR"
    element = b"cnumpy\ndtype\n(" + text(kind) + b"K\x00K\x01tR(K\x03" + text(order) + b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    raw = b"B" + struct.pack("<I", len(data)) + data
    return b"\x80\x03" + made + b"(K\x01" + numbers(shape) + element + (b"\x88" if fortran else b"\x89") + raw + b"tb."


class FetchWeights(unittest.TestCase):
    def read(self, data):
        return fetch_weights.ArraysOnly(io.BytesIO(data)).load()

    def test_an_array_is_read_without_numpy(self):
        found = self.read(numpy_pickle([2, 3], [1.0, 2.0, 3.0, 4.0, 5.0, 6.5]))
        self.assertEqual(found.shape, (2, 3))
        self.assertEqual(list(fetch_weights.floats(found.data)), [1.0, 2.0, 3.0, 4.0, 5.0, 6.5])
        self.assertEqual(self.read(pickle.dumps({"a": [1, 2.5, "b", None]})), {"a": [1, 2.5, "b", None]})

    def test_whatever_a_pickle_could_call_is_refused(self):
        class Evil:
            def __reduce__(self):
                return (eval, ("1 + 1",))

        for data in (pickle.dumps(Evil()), pickle.dumps(Path("x")), b"cos\nsystem\n(X\x02\x00\x00\x00lstR.", b"cnumpy\nload\n."):
            with self.assertRaises(pickle.UnpicklingError):
                self.read(data)

    def test_other_arrays_are_refused(self):
        four = [1.0, 2.0, 3.0, 4.0]
        wrong = [numpy_pickle([4], four, kind=b"i4"), numpy_pickle([4], four, order=b">"), numpy_pickle([2, 2], four, fortran=True)]
        for data in [*wrong, numpy_pickle([3], four), numpy_pickle([2, 3], four)]:
            with self.assertRaises(pickle.UnpicklingError):
                self.read(data)

    def test_a_kernels_outputs_come_first(self):
        # The value at (row, column, input, output) says where it stands.
        rows, columns, inputs, outputs = 2, 3, 4, 5
        at = lambda r, c, i, o: float(1000 * r + 100 * c + 10 * i + o)
        values = [at(r, c, i, o) for r in range(rows) for c in range(columns) for i in range(inputs) for o in range(outputs)]
        turned = fetch_weights.outputs_first(fetch_weights.Array((rows, columns, inputs, outputs), struct.pack(f"<{len(values)}f", *values)))
        self.assertEqual(turned.shape, (outputs, inputs, rows, columns))
        expected = [at(r, c, i, o) for o in range(outputs) for i in range(inputs) for r in range(rows) for c in range(columns)]
        self.assertEqual(list(fetch_weights.floats(turned.data)), expected)

    def test_a_tree_of_parameters_becomes_named_tensors(self):
        kernel = lambda *shape: fetch_weights.Array(shape, bytes(4 * math.prod(shape)))
        tree = {"Trunk": {f"Conv_{k}": {"kernel": kernel(3, 3, 2, 4), "bias": fetch_weights.Array((4,), bytes(16))} for k in range(2)}}
        tree.update({f"NetLinLayer_{k}": {"Conv_0": {"kernel": kernel(1, 1, 4, 1)}} for k in range(fetch_weights.HEADS)})
        found = fetch_weights.tensors(tree, "Trunk", [0, 7])
        self.assertEqual({name: t.shape for name, t in found.items() if name.startswith("features")}, {
            "features.0.weight": (4, 2, 3, 3), "features.0.bias": (4,), "features.7.weight": (4, 2, 3, 3), "features.7.bias": (4,),
        })
        self.assertEqual({found[f"lin{k}.weight"].shape for k in range(fetch_weights.HEADS)}, {(4,)})

    def test_a_file_says_where_its_tensors_are(self):
        first, second = fetch_weights.Array((2,), b"abcdefgh"), fetch_weights.Array((1, 1), b"ijkl")
        data = fetch_weights.safetensors({"b": second, "a": first})
        (length,) = struct.unpack_from("<Q", data)
        header = json.loads(data[8 : 8 + length])
        self.assertEqual(length % 8, 0)
        self.assertEqual(header["b"], {"dtype": "F32", "shape": [1, 1], "data_offsets": [8, 12]})
        begin, end = header["a"]["data_offsets"]
        self.assertEqual(data[8 + length :][begin:end], b"abcdefgh")
        self.assertEqual(len(data), 8 + length + 12)

    def test_a_file_that_is_not_the_expected_one_is_not_written(self):
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            path = Path(folder) / "new" / "w.safetensors"
            with self.assertRaises(SystemExit):
                fetch_weights.write(path, b"data", "0" * 64)
            self.assertFalse(path.parent.exists())
            fetch_weights.write(path, b"data", hashlib.sha256(b"data").hexdigest())
            self.assertEqual([(p.name, p.read_bytes()) for p in path.parent.iterdir()], [("w.safetensors", b"data")])

    def test_squeezenets_tensors_keep_their_names(self):
        layers = ["features.0"] + [f"features.{n}.{part}" for n in fetch_weights.FIRES for part in ("squeeze", "expand1x1", "expand3x3")]
        trunk = {f"{layer}.{part}": fetch_weights.Array((1,), bytes(4)) for layer in layers for part in ("weight", "bias")}
        trunk["classifier.1.weight"] = fetch_weights.Array((1,), bytes(4))
        heads = {f"lin{k}.model.1.weight": fetch_weights.Array((1, 3, 1, 1), bytes(12)) for k in range(7)}
        found = fetch_weights.squeeze_tensors(trunk, heads)
        self.assertEqual(len(found), 2 * 25 + 7)
        self.assertEqual(found["lin6.weight"].shape, (3,))
        self.assertNotIn("classifier.1.weight", found)
        with self.assertRaises(KeyError):
            fetch_weights.squeeze_tensors({}, heads)


class CheckQd(unittest.TestCase):
    """The reader of Q-D files."""

    def steps(self, text):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        file = Path(folder.name) / "Tx0Rx1.txt"
        file.write_text(text)
        return check_qd.text_steps(file)

    def test_steps_have_seven_lines_or_none(self):
        seven = "\n".join(f"{row},{row}5" for row in range(7))
        read = self.steps(f"0\n2\n{seven}\n0\n")
        self.assertEqual(read, [[], [[float(row) for row in range(7)], [float(f"{row}5") for row in range(7)]], []])
        for broken in (f"2\n{seven}", "1\n1,2\n" + "1\n" * 6, "1\n1\n"):
            with self.assertRaises((Failed, ValueError)):
                self.steps(broken)

    def test_directions_are_from_the_pole(self):
        self.assertEqual(check_qd.direction(0, 0), (0.0, 0.0, 1.0))
        self.assertAlmostEqual(check_qd.direction(90, 270)[1], -1.0)
        with self.assertRaises(Failed):
            check_qd.direction(90, 360)


class Links(unittest.TestCase):
    """Of the book, in a repository of four files."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        files = {"README.md": "# Read", "docs/a.md": "# A", "scenes/room.toml": "[scene]", "results/day/README.md": "# Day\n[A](../../docs/a.md#part)"}
        for name, text in files.items():
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            (self.root / name).write_text(text)
        self.book = book.Book(self.root, "docs")

    def page(self, text):
        chapters = [{"source_path": place, "content": "", "sub_items": []} for place in ("../README.md", "a.md")]
        chapters[1]["content"] = text
        self.book.list([{"Chapter": chapter} for chapter in chapters])
        for file, chapter in self.book.pages.items():
            self.book.link(file, chapter)
        return chapters[1]["content"]

    def test_a_link_leads_to_the_page_of_its_file(self):
        self.assertEqual(self.page("[read](../README.md#part)"), "[read](index.md#part)")
        self.assertEqual(self.page("[room](../scenes/room.toml)"), "[room](scenes/room.toml.md)")
        self.assertEqual(self.page("[day](../results/day)"), "[day](results/day/index.md)")
        self.assertEqual(list(self.book.added), [book.PurePosixPath("scenes/room.toml"), book.PurePosixPath("results/day/README.md")])
        day = self.book.added[book.PurePosixPath("results/day/README.md")]
        self.book.link(book.PurePosixPath("results/day/README.md"), day)
        self.assertEqual((day["name"], day["content"]), ("Day (day)", "# Day\n[A](../../a.md#part)"))

    def test_what_is_no_link_of_the_repository_stays(self):
        for text in ("`[a](../b.md)`", "```\n[a](../b.md)\n```", "[a](https://example.org/b.md)", "[a](#part)"):
            self.assertEqual(self.page(text), text)

    def test_a_folder_without_a_page_is_named_and_what_is_not_there_is_refused(self):
        self.assertEqual(self.page("[all](../results)"), "all (`results`)")
        with self.assertRaises(SystemExit):
            self.page("[gone](gone.md)")

    def test_every_page_is_listed(self):
        summary = (REPOSITORY / "docs/SUMMARY.md").read_text()
        pages = [str(p.relative_to(REPOSITORY / "docs")) for p in (REPOSITORY / "docs").rglob("*.md") if p.name != "SUMMARY.md"]
        self.assertGreater(len(pages), 30)
        self.assertEqual([page for page in pages if f"({page})" not in summary], [])


if __name__ == "__main__":
    unittest.main()
