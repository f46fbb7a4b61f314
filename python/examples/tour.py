"""A tour of the package: a small room traced, read, reconstructed and looked at, with everything that is said checked.

    pip install ./python && cargo build --release
    CORF_BIN=target/release/corf python python/examples/tour.py

It takes less than a minute on two cores and leaves nothing behind.
"""

import tempfile
from pathlib import Path

import numpy as np

import corf

ROOT = Path(__file__).resolve().parents[2]
SPEED_OF_LIGHT = 299_792_458.0


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Peak signal-to-noise ratio of two 8-bit images, dB."""
    return float(10 * np.log10(255.0**2 / np.mean((a.astype(float) - b.astype(float)) ** 2)))


def in_camera(keyframe: corf.Keyframe, points_m: np.ndarray) -> np.ndarray:
    """World points, (n, 3), in a keyframe's camera axes: x right, y down, z forward."""
    pose = keyframe.world_from_camera
    return (points_m - pose[:3, 3]) @ pose[:3, :3]


def main(folder: Path) -> None:
    # 1. Sixteen keyframes of a plain room, in light and at 60 GHz.
    corf.run("dataset", "generate", ROOT / "scenes/room-tiny.toml", "--keyframes", 16, "--out", folder / "data")
    dataset = corf.Dataset(folder / "data")
    train, test = [k for k in dataset if not k.is_test], [k for k in dataset if k.is_test]
    print(f"{dataset.name}: {len(train)} keyframes to train with, {len(test)} held out, {dataset.frequency_hz / 1e9:g} GHz")
    assert (len(train), len(test)) == (14, 2)

    # 2. What a keyframe holds.
    keyframe = dataset[1]
    print(f"keyframe {keyframe.name}: image {keyframe.image.shape}, spectrum {keyframe.spectrum_linear.shape}, quantity {dataset.quantity}")
    assert keyframe.image.shape == (54, 96, 3) and keyframe.image.dtype == np.uint8
    assert keyframe.spectrum_linear.shape == (32, 48) and keyframe.spectrum_linear.dtype == np.float32
    assert np.allclose(keyframe.world_from_camera[:3, :3] @ keyframe.world_from_camera[:3, :3].T, np.eye(3))

    # 3. Depth and poses fit: points that one keyframe sees lie, seen from the next one, where that sees something as far away.
    other, depth = dataset[2], keyframe.depth_m
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(keyframe.intrinsics).T
    world = (rays * depth[..., None]).reshape(-1, 3) @ keyframe.world_from_camera[:3, :3].T + keyframe.world_from_camera[:3, 3]
    local = in_camera(other, world)
    at = local @ other.intrinsics.T
    pixel = np.floor(at[:, :2] / at[:, 2:]).astype(int)
    shown = (local[:, 2] > 0) & (pixel >= 0).all(1) & (pixel < (96, 54)).all(1)
    seen = other.depth_m[pixel[shown, 1], pixel[shown, 0]]
    error = np.median(np.abs(seen / local[shown, 2] - 1))
    print(f"{shown.sum()} points are in both views, their depths agree within {error:.2%} (median)")
    assert shown.sum() > 500 and error < 0.02

    # 4. Paths from the transmitter to where that keyframe was taken: the direct one comes in a straight line, at the speed of light.
    place = keyframe.world_from_camera[:3, 3]
    paths = corf.paths(ROOT / "scenes/room.toml", None, place, depth=2)
    direct = paths.types.index("")
    towards = dataset.transmitter_m - place
    print(f"{len(paths)} paths; the direct one is {paths.length_m[direct]:.2f} m long and arrives after {1e9 * paths.delay_s[direct]:.2f} ns")
    assert np.isclose(paths.length_m[direct], np.linalg.norm(towards))
    assert np.isclose(paths.delay_s[direct], np.linalg.norm(towards) / SPEED_OF_LIGHT)
    zenith, azimuth = paths.aoa_zenith_rad[direct], paths.aoa_azimuth_rad[direct]
    arrival = np.array([np.sin(zenith) * np.cos(azimuth), np.sin(zenith) * np.sin(azimuth), np.cos(zenith)])
    assert np.allclose(arrival, towards / np.linalg.norm(towards))

    # Many receivers are one call, in which the scene is made ready once; a table of the same links has the same numbers.
    places = np.array([k.world_from_camera[:3, 3] for k in dataset])
    many = corf.links(ROOT / "scenes/room.toml", None, places, depth=2)
    np.save(folder / "places.npy", places)
    corf.run("paths", ROOT / "scenes/room.toml", "--rx-file", folder / "places.npy", "--depth", 2, "--out", folder / "links.npz")
    table = np.load(folder / "links.npz")
    print(f"{len(many)} links, {min(link.rssi_dbm for link in many):.1f} to {max(link.rssi_dbm for link in many):.1f} dBm for 30 dBm sent")
    assert np.allclose(table["path_gain_db"], [link.path_gain_db for link in many], rtol=0, atol=1e-12)
    assert np.array_equal(table["rssi_dbm"], [link.rssi_dbm for link in many]) and np.allclose(table["rssi_dbm"], table["path_gain_db"] + 30)
    assert np.array_equal(np.stack([table[f"rx_{axis}_m"] for axis in "xyz"], axis=1), places)
    assert np.isclose(many[1].path_gain_db, paths.path_gain_db) and np.isclose(paths.path_gain_db, 10 * np.log10(np.sum(np.abs(paths.a) ** 2)))

    # 5. A keyframe whose spectrum can see the transmitter has its peak there.
    peaks = []
    for k in dataset:
        local = in_camera(k, dataset.transmitter_m)
        at = (k.rf_intrinsics @ local)[:2] / local[2]
        if local[2] > 0 and (at > 1).all() and (at < (47, 31)).all():
            row, column = np.unravel_index(k.spectrum_linear.argmax(), k.spectrum_linear.shape)
            peaks.append(np.hypot(column + 0.5 - at[0], row + 0.5 - at[1]))
    print(f"{len(peaks)} spectra see the transmitter; their peaks are {np.median(peaks):.2f} pixels from it (median)")
    assert len(peaks) > 0 and np.median(peaks) < 1.5

    # 6. A field of both, from the training keyframes.
    corf.run("reconstruct", folder / "data", "--out", folder / "run", "--set", "iterations_per_keyframe=40", "--device", "cpu")
    field = corf.Field(folder / "run")
    gaussians = field.gaussians()
    print(f"{field.method}: {len(gaussians)} Gaussians, harmonics of {gaussians.sh.shape[1]} functions in light and {gaussians.rf_sh.shape[1]} in radio")
    assert len(gaussians) == field.info["gaussians"] and gaussians.sh.shape[2] == 3
    assert all(np.isfinite(a).all() for a in (gaussians.position_m, gaussians.scale_m, gaussians.sh, gaussians.rf_sh))

    # 7. It shows what it was not shown, the held-out keyframes, better than the nearest of those that it was trained with does.
    views = field.render([k.world_from_camera for k in test], device="cpu")
    nearest = [min(train, key=lambda t: np.linalg.norm(t.world_from_camera[:3, 3] - k.world_from_camera[:3, 3])) for k in test]
    for what, ours, lookup in (
        ("images", [psnr(v.image, k.image) for k, v in zip(test, views)], [psnr(n.image, k.image) for k, n in zip(test, nearest)]),
        ("Jet spectra", [psnr(v.jet, k.jet) for k, v in zip(test, views)], [psnr(n.jet, k.jet) for k, n in zip(test, nearest)]),
    ):
        print(f"held-out {what}: PSNR {np.mean(ours):.1f} dB, of the nearest keyframes {np.mean(lookup):.1f} dB")
        assert np.mean(ours) > np.mean(lookup)
    assert all(v.spectrum_db.shape == k.spectrum_db.shape and v.depth_m.shape == k.depth_m.shape for k, v in zip(test, views))
    asked = field.query([k.world_from_camera for k in test], device="cpu")
    print(f"aggregates: {np.round(asked.rssi_dbm, 1)} dBm, best beams {asked.best_beam}, {100 * asked.outage_share:.0f} % in outage")
    assert len(asked) == len(test) and (0 <= asked.best_beam).all() and np.isfinite(asked.rate_bps_hz).all()

    # 8. The program's own metrics are those of the arrays.
    means = field.evaluate(device="cpu")["means"]
    own = np.mean([psnr(v.image, k.image) for k, v in zip(test, views)])
    print(f"PSNR of images {own:.3f} dB here, {means['psnr_opt']:.3f} dB by corf evaluate")
    assert abs(own - means["psnr_opt"]) < 0.01

    # 9. And out of it again, for a viewer.
    said = field.export(folder / "room.spz", to="spz")
    print(f"{said['gaussians']} Gaussians in {(folder / 'room.spz').stat().st_size} bytes of .spz")
    assert said["gaussians"] == len(gaussians)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        main(Path(scratch))
