"""What corf writes, read by the programs that it is written for, with numbers that must come out.

    python -m venv .venv && .venv/bin/pip install -r tools/requirements-formats.txt
    corf dataset export data/mini --to numpy --out npz
    .venv/bin/python tools/check_formats.py data/mini --run runs/a --numpy npz --controls

    corf dataset publish data/mini --out pub --licence cc-by-4.0 --title 'Room: "tiny"' --author 'Doe, Jane' --author 'The Lab' --date 2026-11-29 --url https://example.org/r
                                                                    # --publication pub, with --numpy
and, of further exports (`tools/check_formats.sh data/mini` makes and checks them all):

    corf dataset export data/mini --to nerfstudio --out ns           # --nerfstudio ns
    corf dataset export data/mini --to rf-3dgs --out rf3             # --rf-3dgs rf3, with --numpy
    corf dataset export data/mini --to nerf2 --scene scenes/lobby.toml --out nerf2         # --nerf2 nerf2
    corf paths scenes/room.toml --rx-trajectory 5 --out links.json
    corf paths scenes/room.toml --rx-trajectory 5 --format deepmimo --out room      # --deepmimo room --links links.json
    corf paths scenes/room.toml --rx-trajectory 5 --format qd --out qd              # --qd qd --links links.json

For every folder of a data set that other programs open (`optical/`, `rf/`):

- COLMAP's own reader (pycolmap) gives the cameras, poses and names of dataset.json and trajectory.json. Every point of the model is found again: a training
  image into which pycolmap projects it has the point's colour there, and in `optical/` at the centre of a pixel, for there it was taken. A wrong pose, wrong
  intrinsics, or pixel centres elsewhere would each break this.
- transforms.json, read by its rules (camera-to-world in OpenGL axes), projects all of these points to the same pixels.
- the lists of RF-3DGS are those of dataset.json.
- gsplat's parser (examples/datasets/colmap.py), by its rules: every image that trains has points with tracks, which its `load_depths` needs, and these are projected
  into the image; its split by every eighth image is the data set's where that is what the data set has.

`--numpy DIR`, as `corf dataset export --to numpy` writes it: images, peaks, poses and conventions are the data set's, and every point of the COLMAP model lies at the depth
that the archive has at its pixel.

Of a run: plyfile reads the models, whose columns are INRIA's, with as many rows as run.json says (tools/check_fields.py compares their numbers, and the other
formats of fields). nerfstudio's and nerfbaselines' own loaders are asked
where they are installed, and are named as skipped where they are not.

`--arrays FILE...`: safetensors opens the files of trained networks and fields (`nerf2`, `wrf-gs-plus`, `array` of a run) and checkpoints; their numbers are finite, and the checksum
that the metadata states is theirs.

`--nerfstudio`, `--rf-3dgs`, `--nerf2`: see check_exports.py; nerfstudio's dataparser is asked as well where it is installed. `--deepmimo`: deepmimo loads the scenario and computes
channels, which are those of the paths: see check_channels.py. `--qd`: Q-D files, as text or JSON, by a reader of their format: see check_qd.py. `--publication`: mlcroissant and datasets
open the folder: see check_publication.py. Scenes have checks of their own, each with the program that reads them: check_sionna.py (Sionna RT),
check_light.py (Mitsuba 3); models on gsplat's rasteriser: compare_gsplat.py.

Exit code 0: everything agrees; 1: something does not; 2: bad input.
"""

import argparse
import importlib.util
import json
import sys
import zlib
from pathlib import Path

from check_channels import check_deepmimo, controls, links
from check_exports import check_nerf2_export, check_nerfstudio_export, check_nerfstudio_reader, check_rf_3dgs_export
from check_publication import check_croissant, check_hashes, check_huggingface, check_papers, wanted
from check_qd import check_qd, qd_controls
from format_rules import Failed, insist, project

# Text files hold 17 digits; quaternions are normalised once more by readers.
POSE_TOLERANCE = 1e-9
# Points are written to a micrometre: at 0.2 m and 1500 pixels of focal length, less than this.
PIXEL_TOLERANCE = 0.02
# What the publication of tools/check_formats.sh says of itself.
SAID = {
    "licence": "cc-by-4.0",
    "title": 'Room: "tiny"',
    "authors": [{"family-names": "Doe", "given-names": "Jane"}, {"name": "The Lab"}],
    "date": "2026-11-29",
}
# Share of points that must be found again: two surfaces of one colour cannot be told apart, a wrong camera finds next to none.
LEAST_FOUND = 0.999


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, help="folder of a data set")
    parser.add_argument("--run", type=Path, help="folder of a run of a method that trains Gaussians")
    parser.add_argument("--numpy", type=Path, help="folder of corf dataset export --to numpy")
    parser.add_argument("--nerfstudio", type=Path, help="folder of corf dataset export --to nerfstudio")
    parser.add_argument("--rf-3dgs", type=Path, help="folder of corf dataset export --to rf-3dgs; needs --numpy")
    parser.add_argument("--nerf2", type=Path, help="folder of corf dataset export --to nerf2")
    parser.add_argument("--arrays", type=Path, nargs="+", default=[], help="files of trained networks and fields, and checkpoints")
    parser.add_argument("--publication", type=Path, help="folder of corf dataset publish with the words above; needs --numpy")
    parser.add_argument("--deepmimo", type=Path, help="folder of corf paths --format deepmimo; needs --links")
    parser.add_argument("--qd", type=Path, nargs="+", default=[], help="folders of corf paths --format qd or qd-json; need --links")
    parser.add_argument("--links", type=Path, help="the same links of corf paths --format json")
    parser.add_argument("--controls", action="store_true", help="also make sure that shifted cameras and channels fail")
    args = parser.parse_args()
    if args.rf_3dgs and not args.numpy:
        parser.error("--rf-3dgs is checked against the spectra of --numpy")
    if args.publication and not args.numpy:
        parser.error("--publication is checked against the spectra of --numpy")
    if bool(args.deepmimo or args.qd) != bool(args.links):
        parser.error("--deepmimo or --qd and --links belong together")
    if not (args.dataset / "dataset.json").is_file():
        parser.error(f"{args.dataset} holds no dataset.json")
    if args.numpy and not (args.numpy / "00001.npz").is_file():
        parser.error(f"{args.numpy} holds no 00001.npz")
    if args.run and not (args.run / "run.json").is_file():
        parser.error(f"{args.run} holds no run.json")
    return args


def truth(dataset):
    """Header, split and world_from_camera of every keyframe."""
    import numpy as np

    header = json.loads((dataset / "dataset.json").read_text())
    keyframes = json.loads((dataset / "trajectory.json").read_text())["keyframes"]
    return header, [np.array(k["world_from_camera"]) for k in keyframes]


def check_colmap(root, camera, poses, train, centred, shift_px=0.0):
    """pycolmap's cameras, poses, names and points; `shift_px` moves the principal point, for the control.

    Returns the points, and the share that is found in a picture (`centred`: at the centre of a pixel).
    """
    import numpy as np
    import pycolmap
    from PIL import Image

    model = pycolmap.Reconstruction(str(root / "sparse/0"))
    insist(len(model.cameras) == 1 and len(model.images) == len(poses), "not one camera and an image for every keyframe")
    (own,) = model.cameras.values()
    insist(own.model == pycolmap.CameraModelId.PINHOLE, f"the camera is {own.model}")
    insist((own.width, own.height) == (camera["width"], camera["height"]), "another size of images")
    wanted = [camera[key] for key in ("fx", "fy", "cx", "cy")]
    insist(np.allclose(own.params, wanted, rtol=1e-12), f"intrinsics {own.params} instead of {wanted}")
    images = sorted(model.images.values(), key=lambda image: image.name)
    points = np.array([point.xyz for point in model.points3D.values()])
    colours = np.array([point.color for point in model.points3D.values()])
    found = np.zeros(len(points), dtype=bool)
    for index, (image, pose) in enumerate(zip(images, poses)):
        insist(image.name == f"{index + 1:05}.png", f"image {index} is called {image.name}")
        rigid = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
        read = np.eye(4)
        read[:3] = rigid.inverse().matrix()
        insist(np.abs(read - pose).max() < POSE_TOLERANCE, f"{image.name} has another pose")
        if index not in train:
            continue
        at = own.img_from_cam(rigid * points) + np.array([shift_px, 0.0])
        # What is behind the camera has no image position.
        at = np.where(np.isfinite(at), at, -1.0).clip(-1.0, 1e6)
        pixel = np.floor(at).astype(int)
        shown = ((rigid * points)[:, 2] > 0) & (pixel >= 0).all(1) & (pixel[:, 0] < own.width) & (pixel[:, 1] < own.height)
        if centred:
            shown &= np.abs(at - pixel - 0.5).max(1) < PIXEL_TOLERANCE
        picture = np.asarray(Image.open(root / "images" / image.name).convert("RGB"))
        which = np.flatnonzero(shown)
        found[which] |= (picture[pixel[which, 1], pixel[which, 0]] == colours[which]).all(1)
    return points, found.mean()


def check_transforms(root, camera, poses, points):
    """transforms.json by its own rules."""
    import numpy as np

    file = json.loads((root / "transforms.json").read_text())
    insist(len(file["frames"]) == len(poses), "not a frame for every keyframe")
    read = {"fx": file["fl_x"], "fy": file["fl_y"], "cx": file["cx"], "cy": file["cy"]}
    for frame, pose in zip(file["frames"], poses):
        insist((root / frame["file_path"]).is_file(), f"{frame['file_path']} is not there")
        # OpenGL's y and z point against OpenCV's.
        matrix = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        (ours, depth), (theirs, _) = project(camera, pose, points), project(read, matrix, points)
        seen = depth > 0.1
        insist(np.allclose(ours[seen], theirs[seen], atol=1e-6), f"{frame['file_path']} projects points elsewhere")


def check_lists(root, split):
    for name in ("train", "test"):
        stems = (root / f"{name}_index.txt").read_text().split()
        insist(stems == [f"{i + 1:05}" for i in split[name]], f"{name}_index.txt is not the split")


def check_gsplat(root, camera, split):
    """What gsplat's parser and its `load_depths` make of the model."""
    import numpy as np
    import pycolmap

    model = pycolmap.Reconstruction(str(root / "sparse/0"))
    images = sorted(model.images.values(), key=lambda image: image.name)
    every = [i for i in range(len(images)) if i % 8]
    if split["test"] == [i for i in range(len(images)) if i % 8 == 0]:
        insist(every == split["train"], "another split")
    least = None
    for index in split["train"]:
        image = images[index]
        points = np.array([model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()])
        insist(len(points), f"{image.name} has no point with a track: load_depths raises KeyError")
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().inverse().matrix()
        at, depth = project(camera, pose, points)
        inside = (at >= 0).all(1) & (at[:, 0] < camera["width"]) & (at[:, 1] < camera["height"]) & (depth > 0)
        insist(inside.all(), f"{(~inside).sum()} points of {image.name} lie outside of it")
        least = min(least or len(points), len(points))
    print(f"        {least} points or more in each of {len(split['train'])} images")


def check_nerfstudio(root, camera, poses):
    """nerfstudio's dataparser, told to leave the world as it is."""
    import numpy as np
    from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig

    config = NerfstudioDataParserConfig(
        data=root, orientation_method="none", center_method="none", auto_scale_poses=False, load_3D_points=False
    )
    outputs = config.setup().get_dataparser_outputs("train")
    insist(abs(float(outputs.cameras.fx[0]) - camera["fx"]) < 1e-3, "another focal length")
    for name, matrix in zip(outputs.image_filenames, outputs.cameras.camera_to_worlds.numpy()):
        pose = poses[int(Path(name).stem) - 1]
        insist(np.abs(matrix @ np.diag([1.0, -1.0, -1.0, 1.0]) - pose[:3]).max() < 1e-4, f"{name} has another pose")


def check_nerfbaselines(root, camera, poses):
    import numpy as np
    from nerfbaselines.datasets import load_dataset

    data = load_dataset(str(root), split="train", features=frozenset({"points3D_xyz"}), load_features=False)
    for path, matrix in zip(data["image_paths"], data["cameras"].poses):
        insist(np.abs(matrix[:3] - poses[int(Path(path).stem) - 1][:3]).max() < 1e-5, f"{path} has another pose")
    insist(np.abs(data["cameras"].intrinsics[0, 0] - camera["fx"]) < 1e-3, "another focal length")


def check_models(run):
    """The Gaussians of a run, by plyfile."""
    import numpy as np
    from plyfile import PlyData

    count = json.loads((run / "run.json").read_text())["gaussians"]
    base = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"]
    base += [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]
    positions = []
    for name in ("optical", "rf", "coupled"):
        path = run / f"{name}.ply"
        if not path.is_file():
            continue
        vertices = PlyData.read(str(path))["vertex"]
        columns = [p.name for p in vertices.properties]
        insist(len(vertices.data) == count, f"{name}.ply has {len(vertices.data)} rows instead of {count}")
        insist(set(base) <= set(columns), f"{name}.ply lacks {sorted(set(base) - set(columns))}")
        insist(all(np.isfinite(vertices[c]).all() for c in columns), f"{name}.ply has a value that is not finite")
        rest = [c for c in columns if c.startswith("f_rest_")]
        insist(len(rest) in (0, 9, 24, 45), f"{name}.ply has {len(rest)} f_rest columns, of no degree")
        positions.append(np.stack([vertices[a] for a in "xyz"], axis=1))
    insist(positions, "the run has no model")
    insist(all((p == positions[0]).all() for p in positions), "the models' rows are in another order")


def check_numpy(folder, dataset, header, poses):
    """Archives of all keyframes, against the data set's own files and the points of its COLMAP model."""
    import numpy as np
    import pycolmap
    from PIL import Image

    archives = [dict(np.load(folder / f"{index + 1:05}.npz")) for index in range(len(poses))]
    for index, (archive, pose) in enumerate(zip(archives, poses)):
        name = f"{index + 1:05}"
        insist(np.array_equal(archive["world_from_camera"], pose), f"{name} has another pose")
        insist(json.loads(str(archive["conventions"])) == header["conventions"], f"{name} has other conventions")
        insist(bool(archive["is_test"]) == (index in header["split"]["test"]), f"{name} is on the other side of the split")
        if "image" in archive:
            picture = np.asarray(Image.open(dataset / "optical/images" / f"{name}.png").convert("RGB"))
            insist(np.array_equal(archive["image"], picture), f"{name} has another image")
        peak = header["rf_frames"]["peak_db"][index]
        if "spectrum" in archive and peak is not None:
            insist(abs(10 * np.log10(archive["spectrum"].max()) - peak) < 1e-3, f"{name} has another peak")
    if "depth_m" not in archives[0]:
        return
    model = pycolmap.Reconstruction(str(dataset / "optical/sparse/0"))
    compared = 0
    for point in model.points3D.values():
        for element in point.track.elements:
            archive = archives[element.image_id - 1]
            x, y = model.images[element.image_id].points2D[element.point2D_idx].xy
            local = np.linalg.inv(archive["world_from_camera"]) @ np.append(point.xyz, 1.0)
            at = archive["optical_intrinsics"] @ local[:3] / local[2]
            insist(abs(at[0] - x) < PIXEL_TOLERANCE and abs(at[1] - y) < PIXEL_TOLERANCE, f"a point is projected to {at} instead of {x}, {y}")
            insist(abs(archive["depth_m"][int(y), int(x)] - local[2]) < 1e-4, f"a point at {local[2]} m has another depth")
            compared += 1
    insist(compared > 0, "no point has a track")
    print(f"        {compared} observations at the depth of their pixel")


def check(name, test):
    try:
        test()
    except Failed as failure:
        print(f"FAILED  {name}: {failure}")
        return False
    print(f"ok      {name}")
    return True


def fails(test):
    """Insists that a test which must fail does."""
    try:
        test()
    except Failed:
        return
    raise Failed("it is not noticed")


def check_folders(args, header, poses):
    """Folders of exports, and of channels."""
    import numpy as np

    results = []
    if args.nerfstudio:

        def export(shift_px=0.0):
            check_nerfstudio_export(args.nerfstudio, args.dataset, header, poses, shift_px)

        results.append(check("nerfstudio's folder by its rules, points by plyfile", export))
        if args.controls:
            results.append(check("nerfstudio's folder: half a pixel off is noticed", lambda: fails(lambda: export(0.5))))
        if importlib.util.find_spec("nerfstudio") is None:
            print("skipped nerfstudio's own dataparser: nerfstudio is not installed")
        else:
            results.append(check("nerfstudio's own dataparser", lambda: check_nerfstudio_reader(args.nerfstudio, poses)))
    if args.rf_3dgs:

        def spectra(shift=0):
            archives = [dict(np.load(args.numpy / f"{index + 1:05}.npz")) for index in range(len(poses))]
            for archive in archives:
                archive["spectrum"] = np.roll(archive["spectrum"], shift, axis=1)
            check_rf_3dgs_export(args.rf_3dgs, header, poses, archives)

        results.append(check("RF-3DGS's folder by pycolmap", spectra))
        if args.controls:
            results.append(check("RF-3DGS's folder: a pixel off is noticed", lambda: fails(lambda: spectra(1))))
    if args.nerf2:
        results.append(check("NeRF²'s folder by its rules", lambda: check_nerf2_export(args.nerf2, header, poses)))
        if args.controls:
            shifted = lambda: check_nerf2_export(args.nerf2, header, poses, shift=5)
            results.append(check("NeRF²'s folder: five degrees off are noticed", lambda: fails(shifted)))
    if args.deepmimo:
        truth = links(args.links)
        results.append(check("DeepMIMO's scenario", lambda: check_deepmimo(args.deepmimo, truth)))
        if args.controls:
            for what, changed in controls(truth):
                results.append(check(f"DeepMIMO's scenario: {what} off is noticed", lambda: fails(lambda: check_deepmimo(args.deepmimo, changed))))
    for folder in args.qd:
        truth = links(args.links)
        results.append(check(f"{folder.name}: Q-D files by their format", lambda folder=folder: check_qd(folder, truth)))
        if args.controls:
            for what, changed in qd_controls(truth):
                results.append(check(f"{folder.name}: {what} off is noticed", lambda: fails(lambda: check_qd(folder, changed))))
    return results


def check_publication(args):
    folder, truth = args.publication, wanted(args.dataset, args.numpy)
    results = [
        check("publication by mlcroissant", lambda: check_croissant(folder, truth)),
        check("publication by Hugging Face's datasets", lambda: check_huggingface(folder, truth)),
        check("publication: hashes", lambda: check_hashes(folder, args.dataset)),
        check("publication: card and citation", lambda: check_papers(folder, SAID)),
    ]
    if args.controls:
        shifted = wanted(args.dataset, args.numpy, shift=1)
        results.append(check("publication: poses of other keyframes are noticed", lambda: fails(lambda: check_croissant(folder, shifted))))
        results.append(check("publication: the same by datasets", lambda: fails(lambda: check_huggingface(folder, shifted))))
        results.append(check("publication: another licence is noticed", lambda: fails(lambda: check_papers(folder, {**SAID, "licence": "odbl"}))))
    return results


def checksum(text, arrays):
    """CRC-32 of what the metadata says before its checksum, and of the arrays in the order of their names."""
    value = zlib.crc32(text[: text.rindex(',"crc32":')].encode())
    for name in sorted(arrays):
        value = zlib.crc32(arrays[name].tobytes(), value)
    return value


def check_arrays(path, controls):
    import numpy as np
    from safetensors import safe_open

    with safe_open(path, framework="numpy") as file:
        text = file.metadata()["corf"]
        arrays = {name: file.get_tensor(name) for name in file.keys()}
    about = json.loads(text)
    insist(about["format"].startswith("corf-") and isinstance(about["header"], dict), f"metadata of format {about['format']}")
    insist(sum(array.size for array in arrays.values()) > 0, "no numbers")
    insist(all(np.isfinite(array).all() for array in arrays.values()), "a number is not finite")
    insist(checksum(text, arrays) == about["crc32"], "the checksum is not that of the arrays")
    if controls:
        first = min(name for name, array in arrays.items() if array.size)
        changed = arrays[first].copy()
        changed.flat[0] = changed.flat[0] == 0
        insist(checksum(text, {**arrays, first: changed}) != about["crc32"], "another number has the same checksum")
    print(f"        {about['format']}: " + ", ".join(f"{name} {list(arrays[name].shape)}" for name in sorted(arrays)))


def main():
    args = arguments()
    header, poses = truth(args.dataset)
    split, results = header["split"], []
    train = set(split["train"])
    has = header["header"].get("modalities", {"light": True, "radio": True})
    for root, key, there in (("optical", "optical_camera", has["light"]), ("rf", "rf_camera", has["radio"])):
        if not there:
            print(f"skipped {root}: the data set has none")
            continue
        folder, camera, points = args.dataset / root, header["header"][key], []

        def colmap():
            read, share = check_colmap(folder, camera, poses, train, centred=root == "optical")
            points.append(read)
            print(f"        {len(read)} points, {100 * share:.2f} % on pixels of their colour")
            # Points that came with a capture lie where they like.
            insist(share >= LEAST_FOUND or "imported" in header["header"], f"{100 * share:.2f} % of the points are found")

        results.append(check(f"{root}: COLMAP model by pycolmap", colmap))
        if points:
            results.append(check(f"{root}: transforms.json", lambda: check_transforms(folder, camera, poses, points[0])))
        results.append(check(f"{root}: lists of RF-3DGS", lambda: check_lists(folder, split)))
        # Points that came with a capture without their tracks are in no image.
        if root == "optical" and "imported" not in header["header"]:
            results.append(check(f"{root}: gsplat's rules", lambda: check_gsplat(folder, camera, split)))
        for module, test in (("nerfstudio", check_nerfstudio), ("nerfbaselines", check_nerfbaselines)):
            if importlib.util.find_spec(module) is None:
                print(f"skipped {root}: {module} is not installed")
            else:
                results.append(check(f"{root}: {module}", lambda: test(folder, camera, poses)))
        if args.controls and root == "optical":
            _, share = check_colmap(folder, camera, poses, train, centred=True, shift_px=0.5)
            results.append(check(f"{root}: half a pixel off is noticed", lambda: insist(share < 0.5, f"{share} found")))
    if args.numpy:
        results.append(check("NumPy archives", lambda: check_numpy(args.numpy, args.dataset, header, poses)))
    if args.run:
        results.append(check("models by plyfile", lambda: check_models(args.run)))
    for path in args.arrays:
        results.append(check(f"{path.name} by safetensors", lambda path=path: check_arrays(path, args.controls)))
    results += check_folders(args, header, poses)
    if args.publication:
        results += check_publication(args)
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
