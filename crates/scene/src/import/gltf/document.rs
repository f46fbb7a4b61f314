//! A glTF file's JSON and buffers: checked against the format's rules, and read only from where the file may.

use crate::contained::{self, Reach};
use crate::{Error, Result, io};
use base64::Engine as _;
use serde_json::Value;
use std::path::Path;

/// Extensions that are read as a whole, or in part with a note of what is left.
pub(super) const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_transform",
];

/// Extensions that store the same thing in another way: not read, and harmless wherever the file has the plain data as well.
pub(super) const WITH_FALLBACK: &[&str] = &[
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "MSFT_texture_dds",
];

/// A file whose every reference leads somewhere.
pub(super) struct Source<'a> {
    /// The file, to resolve and name what it refers to.
    pub path: &'a Path,
    /// The file's name in messages.
    pub name: String,
    pub document: gltf::Document,
    /// The glTF JSON as it stands in the file, with the properties and extensions that the reader does not know.
    pub raw: Value,
    /// `None` where a compressed buffer's plain data was left out of the file.
    buffers: Vec<Option<Vec<u8>>>,
    reach: Reach,
}

impl<'a> Source<'a> {
    /// Reads a `.glb` or `.gltf` file's bytes and the buffers they name.
    pub(super) fn read(bytes: &[u8], path: &'a Path, reach: Reach) -> Result<Self> {
        let name = path.display().to_string();
        let damaged = |e: String| {
            Error::invalid(
                &name,
                format!("not readable as glTF: {e}"),
                "the file is damaged, cut short or no glTF 2.0; export the model again",
            )
        };
        let (json, mut blob) = if bytes.starts_with(b"glTF") {
            let glb = gltf::binary::Glb::from_slice(bytes).map_err(|e| damaged(e.to_string()))?;
            (glb.json, glb.bin.map(std::borrow::Cow::into_owned))
        } else {
            // A byte order mark is against the rules, and readers may skip it.
            (std::borrow::Cow::Borrowed(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)), None)
        };
        let root: gltf::json::Root = serde_json::from_slice(&json).map_err(|e| damaged(e.to_string()))?;
        let raw: Value = serde_json::from_slice(&json).map_err(|e| damaged(e.to_string()))?;
        check(&root, &name)?;
        let document = gltf::Document::from_json_without_validation(root);
        let mut source = Self { path, name, document, raw, buffers: Vec::new(), reach };
        let buffers = source.document.buffers().map(|b| source.buffer(&b, &mut blob)).collect::<Result<_>>()?;
        source.buffers = buffers;
        Ok(source)
    }

    /// A buffer's bytes, at least as many as it declares.
    fn buffer(&self, buffer: &gltf::Buffer<'_>, blob: &mut Option<Vec<u8>>) -> Result<Option<Vec<u8>>> {
        let place = format!("{}: buffers[{}]", self.name, buffer.index());
        let bytes = match buffer.source() {
            gltf::buffer::Source::Uri(uri) => self.uri(uri, &place)?,
            gltf::buffer::Source::Bin => {
                let of_buffer = &self.raw["buffers"][buffer.index()];
                match blob.take_if(|_| buffer.index() == 0) {
                    Some(bytes) => bytes,
                    None if compression(of_buffer).is_some() => return Ok(None),
                    None => {
                        return Err(Error::invalid(
                            &place,
                            "it names no file, and the file has no binary chunk for it",
                            "the file is cut short; export it again",
                        ));
                    }
                }
            }
        };
        if bytes.len() < buffer.length() {
            return Err(Error::invalid(
                place,
                format!("has {} bytes where the file declares {}", bytes.len(), buffer.length()),
                "the file is damaged or cut short; export the model again",
            ));
        }
        Ok(Some(bytes))
    }

    /// An accessor by its number, as extensions give it.
    pub(super) fn accessor(&self, index: &Value, place: &str) -> Result<gltf::Accessor<'_>> {
        let number = index.as_u64().and_then(|i| usize::try_from(i).ok());
        number.and_then(|i| self.document.accessors().nth(i)).ok_or_else(|| {
            Error::invalid(place, format!("accessor {index} of {}", self.document.accessors().len()), "export the model again")
        })
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&self, view: &gltf::buffer::View<'_>, place: &str) -> Result<&[u8]> {
        let index = view.buffer().index();
        let Some(Some(buffer)) = self.buffers.get(index) else {
            let of_view = compression(&self.raw["bufferViews"][view.index()]);
            let extension = of_view.or_else(|| compression(&self.raw["buffers"][index])).unwrap_or("EXT_meshopt_compression");
            return Err(Error::invalid(
                place,
                format!("buffer view {} is compressed by {extension}, and the file has no plain data for it", view.index()),
                "export without this compression, or with its fallback buffer",
            ));
        };
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| buffer.get(view.offset()..end)).ok_or_else(|| {
            Error::invalid(
                place,
                format!("buffer view {} ends outside buffer {index}", view.index()),
                "the file is damaged or cut short; export the model again",
            )
        })
    }

    /// The bytes behind a URI: a base64 data URI, or a file in the glTF file's folder.
    pub(super) fn uri(&self, uri: &str, place: &str) -> Result<Vec<u8>> {
        if let Some(data) = uri.strip_prefix("data:") {
            let Some((_, base64)) = data.split_once(";base64,") else {
                return Err(Error::invalid(place, "a data URI that is not base64", "embed data as data:...;base64,..."));
            };
            return base64::engine::general_purpose::STANDARD
                .decode(base64)
                .map_err(|e| Error::invalid(place, format!("its data URI is no base64: {e}"), "export the model again"));
        }
        if uri.contains("://") {
            return Err(Error::invalid(
                place,
                format!("refers to {uri}"),
                "download the file and refer to it by a relative path",
            ));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let path = contained::resolve(folder, &contained::percent_decoded(uri), self.reach, place, contained::MESH_HELP)?;
        io::read(&path).map_err(|e| {
            Error::invalid(
                place,
                format!("cannot read {}: {e}", path.display()),
                "put the file beside the .gltf, or export as .glb",
            )
        })
    }
}

/// The mesh compression of a buffer or a buffer view, by name.
fn compression(of: &Value) -> Option<&str> {
    let extensions = of.get("extensions")?.as_object()?;
    extensions.keys().map(String::as_str).find(|name| name.ends_with("_meshopt_compression"))
}

/// Checks a file by the rules of glTF 2.0: every index is in range, every enumeration is known, every required extension is supported.
fn check(root: &gltf::json::Root, file: &str) -> Result<()> {
    use gltf::json::validation::{Error as Fault, Validate};
    if root.asset.version.split('.').next() != Some("2") {
        return Err(Error::invalid(
            format!("{file}: asset.version"),
            format!("is \"{}\", and this reads glTF 2", root.asset.version),
            "export the model as glTF 2.0",
        ));
    }
    let known = |name: &&String| READ.contains(&name.as_str()) || WITH_FALLBACK.contains(&name.as_str());
    if let Some(name) = root.extensions_required.iter().find(|name| !known(name)) {
        return Err(Error::invalid(
            format!("{file}: extensionsRequired"),
            format!("it requires {name}, which this does not read"),
            format!("export the model without {name}; where it is right without, take the name out of extensionsRequired"),
        ));
    }
    let broken = |what: String| Err(Error::invalid(file, format!("not readable as glTF: {what}"), "export the model again"));
    // The validator looks accessors up before it has checked that they exist, so this comes first.
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (k, p) in mesh.primitives.iter().enumerate() {
            if let Some(a) = p.attributes.values().chain(&p.indices).find(|a| a.value() >= root.accessors.len()) {
                return broken(format!("meshes[{i}].primitives[{k}] uses accessor {} of {}", a.value(), root.accessors.len()));
            }
        }
    }
    let mut faults = Vec::new();
    root.validate(root, gltf::json::Path::new, &mut |path, fault| faults.push((path().to_string(), fault)));
    faults.retain(|(path, fault)| match fault {
        // Positions without bounds are against the rules and harmless: nothing here reads the bounds. An accessor without data is one
        // whose data is compressed: whoever needs it says so.
        Fault::Missing => !(path.ends_with(".min") || path.ends_with(".max") || path.ends_with(".bufferView")),
        Fault::Unsupported => false,
        _ => true,
    });
    match faults.first() {
        None => Ok(()),
        Some((path, fault)) => broken(format!("{path}: {fault} ({} faults in all)", faults.len())),
    }
}
