//! Materials of MTL files in terms of metallic-roughness, and their textures.

use super::ImportOptions;
use super::mtl_text::{self, MapArguments, MtlMaterial};
use super::notes::Notes;
use crate::model::{AlphaMode, Filter, LightMaterial, Texture, TextureRef, Wrap};
use crate::{Error, Raster, Result, contained, io};
use glam::{Affine2, Mat2, Vec2};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Alpha this close to 1 covers all.
const COVERS: f32 = 1.0 - 1e-6;

/// A material of a library, and where it stands.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// What the library says of it.
    pub material: MtlMaterial,
    /// The library's path, for messages.
    file: String,
    /// The library's folder.
    folder: PathBuf,
}

impl Entry {
    /// The material without its textures.
    pub(super) fn without_maps(&self) -> Self {
        let mut entry = self.clone();
        entry.material.maps.clear();
        entry
    }

    fn place(&self, keyword: &str) -> String {
        match self.material.lines.get(keyword) {
            Some(line) => format!("{}:{line}: material \"{}\"", self.file, self.material.name),
            None => format!("{}: material \"{}\"", self.file, self.material.name),
        }
    }
}

/// The file of this name, or the one whose name differs from it in capitals alone, as programs on other systems write it.
fn existing(path: PathBuf) -> PathBuf {
    if path.exists() {
        return path;
    }
    let (Some(folder), Some(name)) = (path.parent(), path.file_name().and_then(|n| n.to_str())) else { return path };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let Ok(entries) = std::fs::read_dir(folder) else { return path };
    let alike =
        entries.flatten().map(|e| e.file_name()).filter(|n| n.to_str().is_some_and(|n| n.to_lowercase() == name.to_lowercase()));
    match alike.min() {
        Some(name) => path.with_file_name(name),
        None => path,
    }
}

/// The materials of the library `name` that the OBJ beside `folder` asks for at `place`; `None` where there is no such file.
///
/// # Errors
/// A name that leads out of the folder, a file that is there and cannot be read, or a statement in it that cannot; the message names the line.
pub(super) fn library(
    folder: &Path,
    name: &str,
    import: &ImportOptions,
    place: &str,
    notes: &mut Notes,
) -> Result<Option<Vec<Entry>>> {
    let name = name.trim_matches('"').replace('\\', "/");
    let path = existing(folder.join(&name));
    let name = path.strip_prefix(folder).unwrap_or(Path::new(&name));
    let path = contained::resolve(folder, name, import.reach, place, contained::MESH_HELP)?;
    let bytes = match io::read(&path) {
        Ok(bytes) => bytes,
        Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e),
    };
    let file = path.display().to_string();
    let materials = mtl_text::read(&bytes, &file, notes)?;
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let entry = |material| Entry { material, file: file.clone(), folder: folder.clone() };
    Ok(Some(materials.into_iter().map(entry).collect()))
}

/// The textures of a scene, each file once for every use that differs.
pub(super) struct Textures<'a> {
    folder: &'a Path,
    import: &'a ImportOptions,
    known: BTreeMap<String, u32>,
    /// All so far, by index.
    pub all: Vec<Texture>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(folder: &'a Path, import: &'a ImportOptions) -> Self {
        Self { folder, import, known: BTreeMap::new(), all: Vec::new() }
    }

    /// Decodes a file beside the OBJ, or else beside the library.
    fn decode(&self, entry: &Entry, keyword: &str, name: &str) -> Result<Raster<[u8; 4]>> {
        let place = entry.place(keyword);
        let name = name.replace('\\', "/");
        let mut path = existing(self.folder.join(&name));
        if !path.exists() && existing(entry.folder.join(&name)).exists() {
            path = existing(entry.folder.join(&name));
        }
        let inside = path.strip_prefix(self.folder).unwrap_or(Path::new(&name)).to_path_buf();
        let path =
            contained::resolve(self.folder, &inside, self.import.reach, &format!("{place}: {keyword}"), contained::MESH_HELP)?;
        let bytes = io::read(&path).map_err(|e| {
            let help = "put the texture where the .mtl says, or remove the statement";
            Error::invalid(&place, format!("cannot read {keyword} {}: {e}", path.display()), help)
        })?;
        io::decode_rgba(&bytes, &path).map_err(|e| match e {
            Error::Invalid { place: image, what, help } => Error::invalid(format!("{place}: {keyword}: {image}"), what, help),
            other => other,
        })
    }

    fn add(
        &mut self,
        key: String,
        arguments: &MapArguments,
        texels: impl FnOnce(&Self) -> Result<Raster<[u8; 4]>>,
    ) -> Result<TextureRef> {
        let wrap = if arguments.clamp { Wrap::Clamp } else { Wrap::Repeat };
        let key = format!("{key}\n{wrap:?}");
        let texture = match self.known.get(&key) {
            Some(texture) => *texture,
            None => {
                let texels = texels(self)?;
                self.all.push(Texture { name: arguments.name.clone(), texels, wrap: [wrap; 2], filter: Filter::Linear });
                self.known.insert(key, self.all.len() as u32 - 1);
                self.all.len() as u32 - 1
            }
        };
        let ([su, sv], [ou, ov]) = (arguments.scale, arguments.offset);
        // MTL counts v upwards and the scene downwards: 1 − ((1 − v)·s + o).
        let uv_from_uv = Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(su, sv)), Vec2::new(ou, 1.0 - sv - ov));
        if !uv_from_uv.is_finite() {
            return Err(Error::invalid(
                &arguments.name,
                "its scale and offset leave float32",
                "repair the -s and -o of the .mtl file",
            ));
        }
        Ok(TextureRef { texture, uv_from_uv })
    }

    fn color(&mut self, entry: &Entry, keyword: &str, arguments: &MapArguments) -> Result<TextureRef> {
        self.add(arguments.name.clone(), arguments, |t| t.decode(entry, keyword, &arguments.name))
    }

    /// A base colour texture whose alpha is `map_d`'s scalar; white where there is no colour.
    fn covered(&mut self, entry: &Entry, color: Option<&MapArguments>, alpha: &MapArguments) -> Result<TextureRef> {
        let key = format!("{}\n{}\n{:?}", color.map_or("", |c| c.name.as_str()), alpha.name, alpha.channel);
        self.add(key, color.unwrap_or(alpha), |t| {
            let coverage = scalar(&t.decode(entry, "map_d", &alpha.name)?, alpha.channel);
            match color {
                None => Ok(coverage.map(|a| [255, 255, 255, *a])),
                Some(color) => joined(&t.decode(entry, "map_Kd", &color.name)?, &coverage).ok_or_else(|| {
                    let what = "map_Kd and map_d are of sizes that do not go together";
                    Error::invalid(entry.place("map_d"), what, "give both the same size")
                }),
            }
        })
    }
}

/// The scalar of every texel: the channel asked for, else alpha where the image has any, else luminance.
fn scalar(image: &Raster<[u8; 4]>, channel: Option<char>) -> Raster<u8> {
    let transparent = image.pixels().iter().any(|p| p[3] < 255);
    // Rec. 709, rounded; a grey keeps its value.
    let luminance =
        |p: &[u8; 4]| ((2126 * u32::from(p[0]) + 7152 * u32::from(p[1]) + 722 * u32::from(p[2]) + 5000) / 10_000) as u8;
    image.map(|p| match channel {
        Some('r') => p[0],
        Some('g') => p[1],
        Some('b') => p[2],
        Some('m') => p[3],
        Some('l') => luminance(p),
        _ if transparent => p[3],
        _ => luminance(p),
    })
}

/// Colour and coverage in one image, as large as the larger of the two; `None` where that is larger than an image may be.
fn joined(color: &Raster<[u8; 4]>, alpha: &Raster<u8>) -> Option<Raster<[u8; 4]>> {
    let (width, height) = (color.width().max(alpha.width()), color.height().max(alpha.height()));
    if (width as u64).saturating_mul(height as u64) > io::MAX_PIXELS {
        return None;
    }
    Some(Raster::from_fn(width, height, |x, y| {
        let [r, g, b, _] = color[(x * color.width() / width, y * color.height() / height)];
        [r, g, b, alpha[(x * alpha.width() / width, y * alpha.height() / height)]]
    }))
}

/// The arguments of a map, once what is not carried out of them is noted.
fn arguments<'e>(entry: &'e Entry, keyword: &'static str, notes: &mut Notes) -> Option<&'e MapArguments> {
    let map = entry.material.maps.get(keyword)?;
    for option in &map.unread {
        notes.warn(format!("`{option}` of {keyword} is not carried out"), entry.place(keyword));
    }
    Some(map)
}

/// MTL in terms of metallic-roughness: Kd (taken as linear) is the base colour, with Ks where `illum` says that the surface mirrors; Ns a Blinn–Phong exponent,
/// Ke emission, d (or 1 − Tr) times map_d coverage, Ni the index of refraction. `colored` says that its vertices have colours, which Kd multiplies.
pub(super) fn light(entry: &Entry, colored: bool, textures: &mut Textures<'_>, notes: &mut Notes) -> Result<LightMaterial> {
    let material = &entry.material;
    let color = |keyword: &str| material.colors.get(keyword).copied();
    let scalar = |keyword: &str| material.scalars.get(keyword).copied();
    let [map_kd, map_ke, map_d] = ["map_Kd", "map_Ke", "map_d"].map(|keyword| arguments(entry, keyword, notes));
    if let (Some(color), Some(alpha)) = (map_kd, map_d)
        && (color.scale, color.offset, color.clamp) != (alpha.scale, alpha.offset, alpha.clamp)
    {
        notes.warn("map_d is laid as map_Kd is; its own options are not carried out", entry.place("map_d"));
    }
    let base_color_texture = match (map_kd, map_d) {
        (color, Some(alpha)) => Some(textures.covered(entry, color, alpha)?),
        (Some(color), None) => Some(textures.color(entry, "map_Kd", color)?),
        (None, None) => None,
    };
    let emissive_texture = map_ke.map(|map| textures.color(entry, "map_Ke", map)).transpose()?;
    let default = LightMaterial::default();
    let textured = map_kd.is_some() || colored;
    // A textured material's Kd multiplies the texture; many exporters leave it black and mean the texture alone.
    let or_white = |factor: Option<[f32; 3]>, textured: bool, otherwise| match factor {
        Some([0.0, 0.0, 0.0]) | None if textured => [1.0; 3],
        Some(factor) => factor,
        None => otherwise,
    };
    let kd = or_white(color("Kd"), textured, default.base_color);
    // Models 3, 5 and 8 reflect: of base·(1 − metallic) diffuse and base·metallic mirrored, the first is Kd and the second Ks for greys.
    let model = scalar("illum").map(|v| v as u8);
    let mirrors = matches!(model, Some(3 | 5 | 8));
    let ks = if mirrors { color("Ks").unwrap_or([0.0; 3]) } else { [0.0; 3] };
    let largest = |c: [f32; 3]| c.into_iter().fold(0.0, f32::max);
    let kd = if mirrors && color("Kd") == Some([0.0; 3]) && !textured { [0.0; 3] } else { kd };
    let mirrored = if largest(ks) > 0.0 { largest(ks) / (largest(ks) + largest(kd)) } else { 0.0 };
    let glass = matches!(model, Some(6 | 7 | 9));
    let alpha = match (scalar("d"), scalar("Tr")) {
        (Some(d), Some(tr)) if (d + tr - 1.0).abs() > 1e-3 => {
            notes.warn(format!("d {d} and Tr {tr} contradict each other; d is taken"), entry.place("Tr"));
            d
        }
        (Some(d), _) => d,
        (None, Some(tr)) => 1.0 - tr,
        (None, None) => {
            if glass {
                notes.warn("illum says glass, and neither d nor Tr how much shines through: it is opaque", entry.place("illum"));
            }
            1.0
        }
    };
    if !(0.0..=1.0).contains(&alpha) {
        notes.warn("d is taken to the range of 0 to 1", entry.place("d"));
    }
    let alpha = alpha.clamp(0.0, 1.0);
    // Blinn–Phong exponent n ↔ microfacet width α: α² = 2/(n + 2); roughness = √α. A mirror without an exponent is a sharp one.
    let without_exponent = if mirrored > 0.0 { 0.0 } else { default.roughness };
    let roughness = scalar("Ns").map_or(without_exponent, |n| (2.0 / (n.max(0.0) + 2.0)).sqrt().sqrt());
    let light = LightMaterial {
        base_color: std::array::from_fn(|c| if mirrored > 0.0 { (kd[c] + ks[c]).min(1.0) } else { kd[c] }),
        base_color_texture,
        alpha,
        alpha_mode: if alpha < COVERS || map_d.is_some() { AlphaMode::Blend } else { AlphaMode::Opaque },
        metallic: scalar("Pm").map_or(mirrored, |m| m.clamp(0.0, 1.0)),
        roughness: scalar("Pr").map_or(roughness, |r| r.clamp(0.0, 1.0)),
        emissive: or_white(color("Ke"), map_ke.is_some(), [0.0; 3]),
        emissive_texture,
        ior: scalar("Ni").filter(|n| *n >= 1.0).unwrap_or(default.ior),
        ..default
    };
    let numbers = [light.roughness, light.metallic, light.ior];
    if numbers.iter().chain(&light.base_color).chain(&light.emissive).any(|v| !v.is_finite()) {
        return Err(Error::invalid(entry.place("newmtl"), "a value is not finite", "repair the .mtl file"));
    }
    Ok(light)
}
