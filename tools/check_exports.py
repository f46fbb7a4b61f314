"""Folders of `corf dataset export`, read as the programs that they are for read them. Used by check_formats.py."""

import json

from format_rules import insist, project

# Points are written to a micrometre: at 0.2 m and 1500 pixels of focal length, less than this.
PIXEL_TOLERANCE = 0.02
# Half of a millimetre, and the rounding of a float32 depth.
DEPTH_TOLERANCE_M = 5.1e-4
# Jet is compared in steps of an 8-bit channel; its slopes turn a rounding of the scalar into one step.
JET_STEPS = 1


def check_nerfstudio_export(folder, dataset, header, poses, shift_px=0.0):
    """transforms.json, its points and its depth by the rules of nerfstudio's dataparser: every observation of the data set's COLMAP model is found again.

    The rules: camera-to-world in OpenGL axes; a depth for every frame or for none, 16 bits of which a step is a millimetre; lists of all three splits; a
    PLY with `x y z` and colours, in the frame of the poses. `shift_px` moves the principal point, for the control.
    """
    import numpy as np
    import pycolmap
    from PIL import Image
    from plyfile import PlyData

    file = json.loads((folder / "transforms.json").read_text())
    camera = header["header"]["optical_camera"]
    read = {"fx": file["fl_x"], "fy": file["fl_y"], "cx": file["cx"], "cy": file["cy"]}
    insist(all(read[k] == camera[k] for k in read) and (file["w"], file["h"]) == (camera["width"], camera["height"]), "other intrinsics")
    insist("camera_model" not in file and file["orientation_override"] == "none", "the world would be turned")
    read["cx"] += shift_px
    frames = sorted(file["frames"], key=lambda f: f["file_path"])
    insist(len(frames) == len(poses), "not a frame for every keyframe")
    named = {f["file_path"] for f in frames}
    lists = {split: file[f"{split}_filenames"] for split in ("train", "val", "test")}
    insist(all(set(names) <= named for names in lists.values()), "a list names an image that is in no frame")
    insist([int(n[-9:-4]) - 1 for n in lists["train"]] == header["split"]["train"], "another split")
    depths = [f for f in frames if "depth_file_path" in f]
    insist(len(depths) in (0, len(frames)), "depth for some frames alone, which nerfstudio refuses")

    cloud = PlyData.read(str(folder / file["ply_file_path"]))["vertex"]
    points = np.stack([cloud[a] for a in "xyz"], axis=1)
    model = pycolmap.Reconstruction(str(dataset / "optical/sparse/0"))
    insist(len(points) == len(model.points3D), f"{len(points)} points instead of {len(model.points3D)}")
    worst_px, worst_m, count = 0.0, 0.0, 0
    for index, frame in enumerate(frames):
        insist(Image.open(folder / frame["file_path"]).size == (camera["width"], camera["height"]), f"{frame['file_path']} has another size")
        matrix = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        insist(np.array_equal(matrix, poses[index]), f"{frame['file_path']} has another pose")
        seen = [p for p in model.images[index + 1].points2D if p.has_point3D()]
        if not seen:
            continue
        # Points of the cloud are in the order of the model's numbers.
        at, depth = project(read, matrix, points[[p.point3D_id - 1 for p in seen]])
        wanted = np.array([p.xy for p in seen])
        worst_px = max(worst_px, np.abs(at - wanted).max())
        count += len(seen)
        if depths:
            with Image.open(folder / frame["depth_file_path"]) as picture:
                insist(picture.mode.startswith("I"), f"{frame['depth_file_path']} has not 16 bits")
                metres = 1e-3 * np.asarray(picture).astype(float)
            there = metres[wanted[:, 1].astype(int), wanted[:, 0].astype(int)]
            far = depth > 65.5
            insist((there[far] == 0).all(), "a depth beyond 65.535 m is no depth")
            worst_m = max([worst_m, *np.abs(there - depth)[~far]])
    insist(count > 0, "no point has a track")
    insist(worst_px < PIXEL_TOLERANCE, f"a point is {worst_px} px off its pixel")
    insist(worst_m < DEPTH_TOLERANCE_M, f"a depth is {worst_m} m off")
    with_depth = f", depth within {1e3 * worst_m:.2f} mm" if depths else ", no depth"
    print(f"        {count} observations of {len(points)} points within {worst_px:.1e} px{with_depth}")


def check_nerfstudio_reader(folder, poses):
    """nerfstudio's own dataparser with points and depth, told to leave the world as it is."""
    import numpy as np
    from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
    from plyfile import PlyData

    config = NerfstudioDataParserConfig(data=folder, center_method="none", auto_scale_poses=False, load_3D_points=True)
    outputs = config.setup().get_dataparser_outputs("train")
    cloud = PlyData.read(str(folder / "sparse_pc.ply"))["vertex"]
    points = np.stack([cloud[a] for a in "xyz"], axis=1)
    insist(np.allclose(outputs.metadata["points3D_xyz"].numpy(), points, atol=1e-4), "other points")
    depths = outputs.metadata["depth_filenames"]
    insist(depths is None or len(depths) == len(outputs.image_filenames), "not a depth for every image")


def jet(scalar):
    """Jet of a scalar, by the corners of its channels, as 8 bits."""
    import numpy as np

    corners = (
        ([0.35, 0.66, 0.89, 1.0], [0.0, 1.0, 1.0, 0.5]),
        ([0.125, 0.375, 0.64, 0.91], [0.0, 1.0, 1.0, 0.0]),
        ([0.0, 0.11, 0.34, 0.65], [0.5, 1.0, 1.0, 0.0]),
    )
    return np.round(255.0 * np.stack([np.interp(scalar, x, y) for x, y in corners], axis=-1))


def check_rf_3dgs_export(folder, header, poses, archives):
    """RF-3DGS's rules: one PINHOLE camera whose field of view all pictures have, pictures of both kinds under the model's names, two lists of stems.

    Every pixel of every spectrum is worked out anew from the archive's linear spectrum along the ray that the model's camera gives it.
    """
    import numpy as np
    import pycolmap
    from PIL import Image

    model = pycolmap.Reconstruction(str(folder / "sparse/0"))
    (own,) = model.cameras.values()
    insist(own.model == pycolmap.CameraModelId.PINHOLE, f"the camera is {own.model}")
    for name in ("train", "test"):
        stems = (folder / f"{name}_index.txt").read_text().split()
        insist(stems == [f"{i + 1:05}" for i in header["split"][name]], f"{name}_index.txt is not the split")
    low, high = header["db_range"]["min_db"], header["db_range"]["max_db"]
    worst = 0.0
    images = sorted(model.images.values(), key=lambda image: image.name)
    insist([image.name for image in images] == [f"{i + 1:05}.png" for i in range(len(poses))], "other names")
    for index, image in enumerate(images):
        insist(np.abs(image.cam_from_world().inverse().matrix() - poses[index][:3]).max() < 1e-9, f"{image.name} has another pose")
        insist(Image.open(folder / "images" / image.name).size == (own.width, own.height), f"images/{image.name} has another size")
        picture = np.asarray(Image.open(folder / "spectrum" / image.name).convert("RGB")).astype(float)
        height, width = picture.shape[:2]
        # A reader takes the field of view from the model and the size from the picture.
        fx, fy, cx, cy = own.params * np.array([width / own.width, height / own.height] * 2)
        x, y = np.meshgrid((np.arange(width) + 0.5 - cx) / fx, (np.arange(height) + 0.5 - cy) / fy)
        spectrum, k = archives[index]["spectrum"].astype(float), archives[index]["rf_intrinsics"]
        u = (k[0, 0] * x + k[0, 2] - 0.5).clip(0, spectrum.shape[1] - 1)
        v = (k[1, 1] * y + k[1, 2] - 0.5).clip(0, spectrum.shape[0] - 1)
        left, top = np.floor(u + 1e-9).astype(int), np.floor(v + 1e-9).astype(int)
        right, bottom = np.minimum(left + 1, spectrum.shape[1] - 1), np.minimum(top + 1, spectrum.shape[0] - 1)
        s, t = u - left, v - top
        upper = (1 - s) * spectrum[top, left] + s * spectrum[top, right]
        lower = (1 - s) * spectrum[bottom, left] + s * spectrum[bottom, right]
        power = (1 - t) * upper + t * lower
        with np.errstate(divide="ignore"):
            scalar = ((10 * np.log10(power) - low) / (high - low)).clip(0, 1)
        worst = max(worst, np.abs(jet(scalar) - picture).max())
    insist(worst <= JET_STEPS, f"a pixel of a spectrum is {worst} of 255 off its ray's power")
    print(f"        {len(images)} spectra within {worst:.0f} of 255 of what arrives along the model's rays")


def check_nerf2_export(folder, header, poses, shift=0):
    """NeRF²'s loader by its rules: a grey spectrum for every line of tx_pos.csv behind its header, rays of 1 to 360 and 1 to 90 degrees in the gateway's frame.

    A transmitter in front of the array shows where it is: the pixel whose ray is nearest to it has the level of free space, as the lobe falls off to that
    ray, or more, for reflections and scattering add to it; and the strongest pixel lies there. `shift` moves the columns, for the control.
    """
    import numpy as np
    from PIL import Image

    statement = json.loads((folder / "export.json").read_text())
    fields = (folder / "gateway_info.yml").read_text().split("position:")[1].split("orientation:")
    position, (x, y, z, w) = (np.array(json.loads(text.strip())) for text in fields)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    lines = (folder / "tx_pos.csv").read_text().split()
    insist(lines[0] == "x,y,z" and len(lines) == 1 + len(poses), f"{len(lines)} lines in tx_pos.csv")
    places = np.array([[float(v) for v in line.split(",")] for line in lines[1:]])
    insist(np.abs(places - np.array([pose[:3, 3] for pose in poses])).max() < 1e-9, "a transmitter is not where the platform was")
    for name in ("train", "test"):
        stems = (folder / f"{name}_index.txt").read_text().split()
        insist([int(stem) - 1 for stem in stems] == header["split"][name], f"{name}_index.txt is not the split")
    azimuth, elevation = np.meshgrid(np.radians(np.arange(1, 361)), np.radians(np.arange(1, 91)))
    rays = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)
    low, high = statement["db_range"]["min_db"], statement["db_range"]["max_db"]
    wavelength = 299_792_458.0 / statement["frequency_hz"]
    kappa = np.radians(statement["lobe_width_deg"]) ** -2
    in_front, near, misses = 0, 0, []
    for index, place in enumerate(places):
        picture = np.asarray(Image.open(folder / "spectrum" / f"{index + 1:05}.png"))
        insist(picture.shape == (90, 360) and picture.dtype == np.uint8, f"spectrum {index + 1} is {picture.shape} {picture.dtype}")
        picture = np.roll(picture, shift, axis=1)
        way = rotation.T @ (place - position)
        distance = np.linalg.norm(way)
        if way[2] < np.sin(np.radians(3)) * distance:
            continue
        in_front += 1
        angles = np.degrees(np.arccos((rays @ (way / distance)).clip(-1, 1)))
        at = np.unravel_index(angles.argmin(), angles.shape)
        near += angles[np.unravel_index(picture.argmax(), picture.shape)] < 2
        if statement["spectrum"] == "mpc":
            lobe = kappa / (2 * np.pi) * np.exp(-kappa * (1 - np.cos(np.radians(angles[at]))))
            free_db = 20 * np.log10(wavelength / (4 * np.pi * distance)) + 10 * np.log10(lobe)
            misses.append(low + (high - low) * picture[at] / 255 - free_db)
    insist(in_front > 0, "no transmitter is in front of the array")
    insist(near >= 0.9 * in_front, f"the strongest pixel is at the transmitter in {near} of {in_front} spectra")
    told = ""
    if misses:
        miss = float(np.median(misses))
        insist(abs(miss) < 0.5, f"the level at the transmitter is {miss:.2f} dB off free space")
        told = f", its level {miss:+.2f} dB from free space (median)"
    print(f"        the strongest pixel is at the transmitter in {near} of {in_front} spectra{told}")
