"""A folder of `corf dataset publish`, read by mlcroissant and by Hugging Face's datasets. Used by check_formats.py.

- mlcroissant finds neither an error nor a warning in croissant.json, and its records are the data set's keyframes: pose, split, image, and the spectrum of the NumPy archive.
- datasets.load_dataset opens the folder without a network; splits, rows and values are the data set's.
- Every hash in croissant.json is its file's; dataset/ holds the data set's files with the hashes that dataset.json lists.
- The head of README.md and CITATION.cff are YAML with what was said on the command line.
"""

import hashlib
import json
import os
import tempfile

from format_rules import insist


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def wanted(dataset, numpy_folder, shift=0):
    """What every keyframe is: of the data set's own files, and of NumPy's archive for the spectrum; `shift` takes another's pose, for the control."""
    import numpy as np
    from PIL import Image

    header = json.loads((dataset / "dataset.json").read_text())
    keyframes = json.loads((dataset / "trajectory.json").read_text())["keyframes"]
    every, truth = header["header"]["split"]["test_every"], []
    for index, keyframe in enumerate(keyframes):
        name = keyframe["file"]
        in_split = [split for split in ("train", "test") if index in header["split"][split]]
        row = {
            "index": index,
            "file": name,
            "time_s": keyframe["time_s"],
            "split": in_split[0] if in_split else "unused",
            "in_held_out_segment": index in header["split"]["held_out_segment"],
            "is_validation": every > 2 and in_split == ["train"] and index % every == every // 2,
            "world_from_camera": np.array(keyframes[(index + shift) % len(keyframes)]["world_from_camera"]),
        }
        for column, file in (("image", f"optical/images/{name}.png"), ("spectrum_image", f"rf/images/{name}.png")):
            if file in header["files"]:
                row[column] = np.asarray(Image.open(dataset / file).convert("RGB"))
        archive = np.load(numpy_folder / f"{name}.npz")
        if "spectrum" in archive:
            row["spectrum"] = archive["spectrum"]
        truth.append(row)
    return truth


def same(read, row, who):
    import numpy as np

    insist(set(read) == set(row), f"{who}: columns {sorted(read)} instead of {sorted(row)}")
    for column, value in row.items():
        found = read[column].decode() if isinstance(read[column], bytes) else read[column]
        if isinstance(value, np.ndarray):
            found = np.asarray(found, dtype=value.dtype)
            equal = found.shape == value.shape and (found == value).all()
        else:
            equal = found == value
        insist(equal, f"{who}: keyframe {row['file']} has another {column}")


def check_croissant(folder, truth):
    """By mlcroissant: no word against it, and all records."""
    import mlcroissant
    from absl import logging

    logging.set_verbosity(logging.ERROR)
    metadata = mlcroissant.Dataset(str(folder / "croissant.json"))
    issues = metadata.metadata.ctx.issues
    insist(not issues.errors and not issues.warnings, f"mlcroissant: {sorted(issues.errors)} {sorted(issues.warnings)}")
    records = [{name.split("/")[1]: value for name, value in record.items()} for record in metadata.records("keyframes")]
    records.sort(key=lambda record: record["index"])
    insist(len(records) == len(truth), f"{len(records)} records instead of {len(truth)}")
    for record, row in zip(records, truth):
        same(record, row, "mlcroissant")
    stated = json.loads((folder / "croissant.json").read_text())
    fields = ("dataLimitations", "dataBiases", "personalSensitiveInformation", "dataUseCases", "dataSocialImpact", "hasSyntheticData")
    missing = [name for name in fields if stated.get(f"rai:{name}") in (None, "")]
    insist(not missing and stated.get("prov:wasDerivedFrom") and stated.get("prov:wasGeneratedBy"), f"the minimal RAI fields lack {missing}")
    print(f"        {len(records)} records by mlcroissant")


def check_hashes(folder, dataset):
    files = [f for f in json.loads((folder / "croissant.json").read_text())["distribution"] if f["@type"] == "cr:FileObject"]
    shards = {f"data/{path.name}" for path in (folder / "data").iterdir()}
    insist(shards <= {f["contentUrl"] for f in files}, "a shard has no hash")
    for file in files:
        path = folder / file["contentUrl"]
        insist(sha256(path) == file["sha256"] and file["contentSize"] == f"{path.stat().st_size} B", f"{file['contentUrl']} has another hash")
    listed = json.loads((dataset / "dataset.json").read_text())["files"]
    there = {str(path.relative_to(folder / "dataset")) for path in (folder / "dataset").rglob("*") if path.is_file()}
    insist(there == set(listed) | {"dataset.json"}, "dataset/ has other files")
    for name, record in listed.items():
        insist(sha256(folder / "dataset" / name) == record["sha256"], f"dataset/{name} has another hash")
    insist(sha256(folder / "dataset/dataset.json") == sha256(dataset / "dataset.json"), "another dataset.json")
    print(f"        {len(files)} hashes of croissant.json, {len(listed)} of dataset.json")


def check_huggingface(folder, truth):
    """By datasets, without a network and without what it read before."""
    for name in ("HF_HUB_OFFLINE", "HF_DATASETS_OFFLINE", "HF_HUB_DISABLE_TELEMETRY"):
        os.environ[name] = "1"
    with tempfile.TemporaryDirectory() as cache:
        os.environ["HF_HOME"] = cache
        import datasets

        datasets.disable_progress_bars()
        read = datasets.load_dataset(str(folder.resolve()), cache_dir=f"{cache}/datasets")
        splits = {row["split"] for row in truth}
        insist(set(read) == splits, f"splits {sorted(read)} instead of {sorted(splits)}")
        for split in splits:
            rows = [row for row in truth if row["split"] == split]
            insist(len(read[split]) == len(rows), f"{len(read[split])} rows of {split} instead of {len(rows)}")
            for record, row in zip(read[split], rows):
                same(record, row, "datasets")
        print("        " + ", ".join(f"{len(read[split])} rows of {split}" for split in sorted(splits)) + " by datasets")


def check_papers(folder, said):
    import yaml

    head = yaml.safe_load((folder / "README.md").read_text().split("---\n")[1])
    insist(head["license"] == said["licence"] and head["pretty_name"] == said["title"], f"the card's head says {head}")
    cited = yaml.safe_load((folder / "CITATION.cff").read_text())
    insist(cited["type"] == "dataset" and cited["title"] == said["title"], f"CITATION.cff says {cited}")
    insist(cited["authors"] == said["authors"] and str(cited["date-released"]) == said["date"], f"CITATION.cff says {cited}")
    insist((folder / "LICENSE").is_file() and (folder / "contact-sheet.png").is_file(), "LICENSE or contact-sheet.png is missing")
