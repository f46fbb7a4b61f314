//! The parsers, each behind one function of bytes.

use crate::capture;
use crate::files::{parts, put};
use anyhow::{Context, Result};
use corf_scene::config::{AntennaPattern, DatasetConfig, ElementGrid, SceneConfig, from_toml};
use corf_scene::dataset::Dataset;
use corf_scene::{Pinhole, import, io, npz};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// A parser.
pub struct Target {
    /// Its name, and that of its corpus's folder.
    pub name: &'static str,
    /// Reads bytes; files it needs go into the folder, which is its own and keeps them.
    pub read: fn(&[u8], &Path) -> Result<()>,
    /// Makes checksums right after bytes were changed, where a parser would see no further than to them.
    pub mend: fn(&mut [u8]),
}

/// All of them.
pub const TARGETS: [Target; 31] = [
    Target { name: "gltf", read: gltf, mend: keep },
    Target { name: "glb", read: gltf, mend: glb_lengths },
    Target { name: "obj", read: obj, mend: keep },
    Target { name: "png", read: image, mend: png_checksums },
    Target { name: "jpeg", read: image, mend: keep },
    Target { name: "exr", read: exr, mend: keep },
    Target { name: "npy", read: npy, mend: keep },
    Target { name: "ply", read: ply, mend: keep },
    Target { name: "scene-toml", read: scene_toml, mend: keep },
    Target { name: "dataset-toml", read: dataset_toml, mend: keep },
    Target { name: "plan-toml", read: plan, mend: keep },
    Target { name: "method-toml", read: method, mend: keep },
    Target { name: "dataset-json", read: dataset, mend: keep },
    Target { name: "paths-gzip", read: paths, mend: keep },
    Target { name: "sionna-json", read: sionna, mend: keep },
    Target { name: "record-json", read: record, mend: keep },
    Target { name: "records-archive", read: archive, mend: keep },
    Target { name: "predictions", read: predictions, mend: keep },
    Target { name: "field-json", read: field, mend: keep },
    Target { name: "receivers", read: receivers, mend: keep },
    Target { name: "view-request", read: view_request, mend: keep },
    Target { name: "colmap-text", read: capture::colmap_text, mend: keep },
    Target { name: "colmap-binary", read: capture::colmap_binary, mend: keep },
    Target { name: "transforms-json", read: capture::transforms, mend: keep },
    Target { name: "poses-json", read: poses, mend: keep },
    Target { name: "rf-3dgs-lists", read: capture::rf_3dgs_lists, mend: keep },
    Target { name: "spectrum-npy", read: capture::spectrum_npy, mend: keep },
    Target { name: "spectrum-png", read: capture::spectrum_png, mend: png_checksums },
    Target { name: "spectra-json", read: capture::spectra_json, mend: keep },
    Target { name: "fixed-array", read: capture::fixed_array, mend: keep },
    Target { name: "pattern-csv", read: pattern, mend: keep },
];

/// No parser: it fails in every way that is to be found, and shows that it is. It runs by name alone.
pub const SELF_CHECK: Target = Target { name: "self-check", read: fail, mend: keep };

/// Does what the input says: panics, aborts, takes two gibibytes, or overflows the stack.
fn fail(bytes: &[u8], _: &Path) -> Result<()> {
    fn deeper(n: u64) -> u64 {
        let here = std::hint::black_box([n; 64]);
        if n == u64::MAX { 0 } else { deeper(n + 1) + here[(n % 64) as usize] }
    }
    match bytes {
        b"panic" => panic!("as asked"),
        b"abort" => std::process::abort(),
        b"memory" => drop(std::hint::black_box(vec![1u8; 2 << 30])),
        b"stack" => drop(std::hint::black_box(deeper(0))),
        _ => {}
    }
    Ok(())
}

/// The corpus of a target, by file name.
///
/// # Errors
/// A folder or file that cannot be read, or a folder without files.
pub fn corpus(name: &str) -> Result<Vec<Vec<u8>>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(name);
    let entries = std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
    paths.sort();
    anyhow::ensure!(!paths.is_empty(), "{} is empty", folder.display());
    paths.iter().map(|p| std::fs::read(p).with_context(|| format!("cannot read {}", p.display()))).collect()
}

fn keep(_: &mut [u8]) {}

/// The length of a GLB in its header and of its first chunk, as far as that is within the file.
fn glb_lengths(bytes: &mut [u8]) {
    let length = bytes.len() as u32;
    if let Some(slot) = bytes.get_mut(8..12) {
        slot.copy_from_slice(&length.to_le_bytes());
    }
}

fn png_checksums(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let Some(end) = at.checked_add(8).and_then(|n| n.checked_add(length)).filter(|end| end + 4 <= bytes.len()) else {
            return;
        };
        let sum = crc32fast::hash(&bytes[at + 4..end]);
        bytes[end..end + 4].copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
}

/// An imported scene that is none is as bad as a panic: later stages index by it.
fn check(scene: &corf_scene::Scene) {
    let n = scene.positions.len();
    assert!(scene.normals.len() == n && scene.uvs.len() == n && (scene.colors.is_empty() || scene.colors.len() == n));
    assert!(scene.positions.iter().all(|p| p.is_finite()), "a position is not finite");
    for t in &scene.triangles {
        assert!(t.vertices.iter().all(|v| (*v as usize) < n), "a triangle leads to no vertex");
        assert!((t.material as usize) < scene.materials.len() && (t.object as usize) < scene.objects.len());
    }
    for m in &scene.materials {
        let o = &m.light;
        for t in [o.base_color_texture, o.metallic_roughness_texture, o.normal_texture, o.emissive_texture].into_iter().flatten()
        {
            assert!((t.texture as usize) < scene.textures.len(), "a material leads to no texture");
        }
    }
}

fn gltf(bytes: &[u8], folder: &Path) -> Result<()> {
    let _ = folder;
    check(&import::from_glb(bytes, "input.glb")?);
    Ok(())
}

fn obj(bytes: &[u8], folder: &Path) -> Result<()> {
    let [obj, mtl] = parts(bytes);
    put(folder, "room.mtl", mtl)?;
    let texture = folder.join("tex.png");
    if !texture.exists() {
        io::write_png(texture, &corf_scene::Raster::filled(2, 2, [9, 8, 7]))?;
    }
    check(&import::load(put(folder, "room.obj", obj)?)?);
    Ok(())
}

/// A pattern's settings and its file. A gain that is none is as bad as a panic: whole spectra are made of it.
fn pattern(bytes: &[u8], folder: &Path) -> Result<()> {
    let [settings, table] = parts(bytes);
    put(folder, "pattern.csv", table)?;
    let stated: AntennaPattern = serde_json::from_slice(settings)?;
    // Elements one by one are taken of a receiver alone.
    let of_array = ElementGrid { rows: 2, cols: 2, spacing_wavelengths: [0.5; 2] };
    let read = stated.read(folder, "input", None).or_else(|_| stated.read(folder, "input", Some(of_array)))?;
    for direction in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::Z, DVec3::NEG_Z, DVec3::new(0.6, -0.64, 0.48)] {
        let amplitude = read.amplitude(direction);
        assert!(amplitude.is_finite() && amplitude >= 0.0, "an amplitude of {amplitude} towards {direction}");
    }
    Ok(())
}

fn image(bytes: &[u8], folder: &Path) -> Result<()> {
    let rgba = io::decode_rgba(bytes, "input.png")?;
    let path = put(folder, "input.png", bytes)?;
    assert_eq!(io::image_size(&path)?, (rgba.width(), rgba.height()));
    let transparent = rgba.pixels().iter().any(|p| p[3] != u8::MAX);
    assert!(io::may_be_transparent(bytes) || !transparent, "transparent pixels that the header does not announce");
    assert_eq!(io::read_png_and_opacity(&path)?.1.is_some(), transparent);
    drop((io::read_mask(&path), io::read_png16(&path)));
    Ok(())
}

/// Poses that are not rigid are as bad as a panic.
fn poses(bytes: &[u8], folder: &Path) -> Result<()> {
    for pose in corf_bench::render::poses::PoseFile::read(&put(folder, "poses.json", bytes)?)?.as_they_are()? {
        let [x, y, z] = [pose.rotation.x_axis, pose.rotation.y_axis, pose.rotation.z_axis];
        let off = [x.length() - 1.0, y.length() - 1.0, z.length() - 1.0, x.dot(y), y.dot(z), z.dot(x)];
        assert!(pose.translation.is_finite() && off.iter().all(|v| v.abs() < 1e-9) && pose.rotation.determinant() > 0.0);
    }
    Ok(())
}

fn exr(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = put(folder, "input.exr", bytes)?;
    io::read_exr_f32(&path)
        .map(drop)
        .or_else(|_| io::read_exr_u32(&path).map(drop))
        .or_else(|_| io::read_exr_rgb(&path).map(drop))?;
    Ok(())
}

fn npy(bytes: &[u8], _: &Path) -> Result<()> {
    let npz::NpyNumbers { shape, values, .. } = npz::decode_npy(bytes, "input.npy")?;
    assert_eq!(shape.iter().product::<usize>(), values.len());
    Ok(())
}

fn ply(bytes: &[u8], folder: &Path) -> Result<()> {
    let path = put(folder, "input.ply", bytes)?;
    let coupled = corf::files::ply::read_coupled(&path).map(drop);
    // A field that goes on with a number that is none is as bad as a panic.
    if let Ok(field) = corf::files::ply::read_foreign(&path) {
        let g = &field.gaussians;
        let numbers = g.position.iter().flatten().chain(g.log_scale.iter().flatten()).chain(&g.appearance.opacity_logit);
        assert!(numbers.chain(&g.appearance.sh).all(|v| v.is_finite()), "a number is not finite");
    }
    coupled.or(corf::files::ply::read_single(&path).map(drop))?;
    Ok(())
}

fn utf8(bytes: &[u8]) -> Result<&str> {
    std::str::from_utf8(bytes).context("not text")
}

fn scene_toml(bytes: &[u8], _: &Path) -> Result<()> {
    let config: SceneConfig = from_toml(utf8(bytes)?, "input.toml")?;
    config.validate()?;
    Ok(())
}

fn dataset_toml(bytes: &[u8], _: &Path) -> Result<()> {
    let config: DatasetConfig = from_toml(utf8(bytes)?, "input.toml")?;
    config.validate()?;
    let _: [Pinhole; 2] = [config.light_camera(), config.radio_camera()];
    config.to_toml()?;
    Ok(())
}

fn plan(bytes: &[u8], _: &Path) -> Result<()> {
    let plan = corf_bench::experiment::plan::Plan::parse(utf8(bytes)?)?;
    plan.cells().take(1000).for_each(|cell| drop(cell.stem()));
    Ok(())
}

fn method(bytes: &[u8], _: &Path) -> Result<()> {
    let config: corf::config::ReconstructionConfig = toml::from_str(utf8(bytes)?)?;
    config.validate()?;
    Ok(())
}

fn dataset(bytes: &[u8], folder: &Path) -> Result<()> {
    let [header, trajectory] = parts(bytes);
    put(folder, "dataset.json", header)?;
    put(folder, "trajectory.json", trajectory)?;
    let dataset = Dataset::open(folder)?;
    let _ = (dataset.light_camera(), dataset.radio_camera(), dataset.train_indices().len());
    Ok(())
}

fn paths(bytes: &[u8], folder: &Path) -> Result<()> {
    io::read_gzip_text(put(folder, "paths.jsonl.gz", bytes)?)?;
    Ok(())
}

fn sionna(bytes: &[u8], folder: &Path) -> Result<()> {
    use corf_raytrace::sionna::Reference;
    match Reference::load(&put(folder, "reference.json", bytes)?)? {
        Reference::Specular(reference) => check(&reference.scene()?),
        Reference::Diffuse(reference) => {
            for case in reference.cases.iter().take(4) {
                check(&reference.scene(case)?);
            }
        }
    }
    Ok(())
}

fn record(bytes: &[u8], folder: &Path) -> Result<()> {
    tables(&[corf_bench::record::Record::read(&put(folder, "metrics.json", bytes)?)?])
}

/// Tables of records that were read; that one of them mixes what may not be mixed is as bad as a panic.
fn tables(records: &[corf_bench::record::Record]) -> Result<()> {
    let rows = corf_bench::table::rows(records);
    let finished = |row: &corf_bench::table::Row<'_>| {
        row.done.iter().map(|(seed, _)| *seed).collect::<std::collections::BTreeSet<_>>().len()
    };
    assert!(rows.iter().all(|row| finished(row) == row.done.len()), "a seed counts twice");
    let columns = corf_bench::table::columns(&["all"])?;
    drop((
        corf_bench::table::markdown(&rows, &columns),
        corf_bench::table::csv(records),
        corf_bench::table::latex(&rows, &columns),
    ));
    Ok(())
}

/// The parts of the input are members of one archive, each compressed; one that begins as gzip does stands as it is.
fn archive(bytes: &[u8], folder: &Path) -> Result<()> {
    let members: [&[u8]; 4] = parts(bytes);
    let mut packed = Vec::new();
    for member in members.iter().filter(|member| !member.is_empty()) {
        match member {
            [0x1f, 0x8b, ..] => packed.extend_from_slice(member),
            _ => packed.extend(io::gzip(member)?),
        }
    }
    put(folder, corf_bench::record::ARCHIVE, &packed)?;
    tables(&corf_bench::comparison::suite::records(folder)?)
}

/// A folder of predictions: what its maker states, an image and a spectrum, of a data set of two keyframes of which the first is held out.
fn predictions(bytes: &[u8], folder: &Path) -> Result<()> {
    use corf_bench::record::prediction_folder::{PredictionFolder, Tally};
    use corf_bench::split::{Protocol, Split};
    let [header, trajectory, statement, image, spectrum] = parts(bytes);
    let (data, predicted) = (folder.join("data"), folder.join("predicted"));
    for place in [data.clone(), predicted.join("images"), predicted.join("linear")] {
        std::fs::create_dir_all(place)?;
    }
    put(&data, "dataset.json", header)?;
    put(&data, "trajectory.json", trajectory)?;
    put(&predicted, "predictions.json", statement)?;
    put(&predicted.join("images"), "00001.png", image)?;
    put(&predicted.join("linear"), "00001.npy", spectrum)?;
    let dataset = Dataset::open(&data)?;
    let split = Split::of(&dataset, Protocol::TEST)?;
    let opened = PredictionFolder::open(&predicted, &dataset, &split)?;
    for &index in split.held_out.iter().take(2) {
        let read = opened.read(index, &dataset, &mut Tally::default())?;
        let finite = read.halves().spectrum.is_none_or(|s| s.scalar.pixels().iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(finite, "a predicted spectrum is not within its range");
    }
    Ok(())
}

fn field(bytes: &[u8], folder: &Path) -> Result<()> {
    let [json, model] = parts(bytes);
    put(folder, "field.json", json)?;
    put(folder, "coupled.ply", model)?;
    corf::field::Field::read(folder)?;
    Ok(())
}

fn receivers(bytes: &[u8], folder: &Path) -> Result<()> {
    let config: SceneConfig = from_toml("[scene]\nfile = \"room.glb\"\n[transmitter]\nposition_m = [0, 0, 0]\n", "scene.toml")?;
    let text = put(folder, "receivers.csv", bytes)?;
    corf_bench::radio_link::receivers(&config, &[], Some(&text), None)?;
    Ok(())
}

/// The token of the corpus's requests.
const TOKEN: [u8; 16] = *b"of the corpus...";

/// A request as the viewer's server sees it: method and target in the first line, then headers. What passes must know the token
/// and name the server.
fn view_request(bytes: &[u8], _: &Path) -> Result<()> {
    use corf_bench::viewer::guard::{Asked, Guard, Token};
    let mut lines = bytes.split(|byte| *byte == b'\n').map(|line| line.strip_suffix(b"\r").unwrap_or(line));
    let mut first = utf8(lines.next().unwrap_or_default())?.split(' ');
    let (method, target) = (first.next().unwrap_or_default(), first.next().unwrap_or_default());
    let headers: Vec<(&str, &[u8])> = lines
        .filter_map(|line| {
            let colon = line.iter().position(|byte| *byte == b':')?;
            Some((utf8(&line[..colon]).ok()?, line[colon + 1..].trim_ascii()))
        })
        .collect();
    let guard = Guard::new(8000, Token::of(TOKEN));
    let asked = Asked { method, target, headers: &headers };
    let passed = guard.check(&asked);
    let leads = corf_bench::viewer::leads_somewhere(target, 40);
    assert!(
        !leads || target == "/" || target.starts_with("/?") || target.starts_with("/data/"),
        "a target of no route leads somewhere"
    );
    match passed {
        Ok(()) => {
            let token = Token::of(TOKEN).to_string();
            let holds = |bytes: &[u8]| bytes.windows(token.len()).any(|w| w == token.as_bytes());
            let of =
                |name: &str| headers.iter().filter(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, v)| *v).collect::<Vec<_>>();
            assert!(matches!(method, "GET" | "HEAD") && target.starts_with('/'), "what is no reading passed");
            assert!(holds(target.as_bytes()) || of("cookie").into_iter().any(holds), "who does not know the token passed");
            let [host] = of("host")[..] else { panic!("a request of no name, or of several, passed") };
            let (name, port) = utf8(host)?.rsplit_once(':').context("no port")?;
            assert!(
                ["127.0.0.1", "localhost", "[::1]"].contains(&&*name.to_ascii_lowercase()) && port == "8000",
                "another host passed"
            );
            assert!(of("transfer-encoding").is_empty() && of("content-length").iter().all(|n| *n == b"0"), "a body passed");
            Ok(())
        }
        Err(refusal) => {
            assert!((400..500).contains(&refusal.status()) && !refusal.words(8000).is_empty());
            anyhow::bail!("{refusal:?}")
        }
    }
}
