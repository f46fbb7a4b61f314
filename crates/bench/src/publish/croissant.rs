//! Croissant 1.1 metadata (<https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html>), with the Responsible-AI fields that venues ask for.
//!
//! The shards stand in it twice: as files with their hashes, and as the set of files that records come from. The set names no container: what
//! `mlcroissant` finds in one it unpacks, and does not read.

use super::{Author, Publication, Published};
use serde_json::{Map, Value, json};

/// Encoding of the shards, as `mlcroissant` names it.
const PARQUET: &str = "application/x-parquet";

/// Kinds of rasters in `dataset/`: folder, what it holds.
const RASTERS: [(&str, &str); 7] = [
    ("optical/depth", "z-depth along the optical axis, metres; 0 where there is none"),
    ("optical/surfaces", "index into header.objects of dataset.json"),
    ("optical/linear", "linear radiance before exposure, Rec. 709 primaries"),
    ("optical/albedo", "reflectance of what a pixel sees first"),
    ("optical/normals", "mean shading normal, world frame"),
    ("rf/spectra", "the spectrum, linear power"),
    ("rf/sphere", "the spectrum over the whole sphere, equirectangular"),
];

impl Publication<'_> {
    /// The metadata, with the files that it names.
    pub(super) fn croissant(&self, files: &[Published]) -> Value {
        let (statement, answers) = (&self.statement, self.answers());
        let mut all = Map::new();
        let mut put = |key: &str, value: Value| {
            if !value.is_null() {
                all.insert(key.to_owned(), value);
            }
        };
        put("@context", context());
        put("@type", json!("sc:Dataset"));
        put("conformsTo", json!(["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"]));
        put("name", json!(statement.title));
        put("description", json!(self.description()));
        put("license", json!(statement.licence.url));
        put("creator", json!(statement.authors.iter().map(creator).collect::<Vec<_>>()));
        put("url", json!(statement.url));
        put("datePublished", json!(statement.date));
        put("version", json!(statement.version));
        put("citeAs", json!(self.bibtex()));
        put("keywords", json!(self.tags()));
        put("isLiveDataset", json!(false));
        put("rai:dataCollection", json!(answers.collection));
        put(
            "rai:dataCollectionType",
            json!(if answers.synthetic == Some(true) { "Software Collection" } else { "Direct measurement" }),
        );
        put("rai:personalSensitiveInformation", json!(answers.sensitive));
        put("rai:dataLimitations", json!(answers.limitations));
        put("rai:dataBiases", json!(answers.biases));
        put("rai:dataUseCases", json!(answers.uses));
        put("rai:dataSocialImpact", json!(answers.impact));
        put("rai:hasSyntheticData", json!(answers.synthetic));
        put("prov:wasDerivedFrom", json!(self.sources()));
        put("prov:wasGeneratedBy", json!(answers.collection));
        put("distribution", json!(self.distribution(files)));
        put("recordSet", json!([self.record_set()]));
        Value::Object(all)
    }

    /// What it was made from.
    fn sources(&self) -> String {
        let header = self.dataset.header();
        match &header.imported {
            Some(imported) => {
                format!("a capture in the form {}, whose files and their SHA-256 dataset/dataset.json lists", imported.format)
            }
            None => match &header.scene_sha256 {
                Some(hash) => format!("the scene file in header.scene of dataset/dataset.json, its mesh with SHA-256 {hash}"),
                None => "the scene in header.scene of dataset/dataset.json".to_owned(),
            },
        }
    }

    fn distribution(&self, files: &[Published]) -> Vec<Value> {
        let encoding = |path: &str| match path.rsplit('.').next() {
            Some("parquet") => PARQUET,
            Some("json") => "application/json",
            Some("png") => "image/png",
            _ => "text/plain",
        };
        let object = |file: &Published| {
            json!({
                "@type": "cr:FileObject", "@id": file.path, "name": file.path, "contentUrl": file.path, "contentSize": format!("{} B", file.bytes),
                "encodingFormat": encoding(&file.path), "sha256": file.sha256,
            })
        };
        let set = |id: &str, includes: &str, encoding: &str, description: &str| {
            json!({
                "@type": "cr:FileSet", "@id": id, "name": id, "description": description, "includes": includes, "encodingFormat": encoding,
            })
        };
        let mut all: Vec<Value> = files.iter().map(object).collect();
        all.push(set("shards", "data/*.parquet", PARQUET, "Keyframes by split, a row each."));
        for (folder, what) in RASTERS {
            if self.dataset.listed_files().any(|(path, ..)| path.starts_with(&format!("{folder}/"))) {
                let what = format!("Float rasters by keyframe: {what}. dataset/dataset.json lists their SHA-256.");
                all.push(set(folder, &format!("dataset/{folder}/*.exr"), "image/x-exr", &what));
            }
        }
        all
    }

    fn record_set(&self) -> Value {
        let field = |name: &str, kind: &str, description: &str, shape: Option<[usize; 2]>| {
            let mut source = json!({ "fileSet": { "@id": "shards" }, "extract": { "column": name } });
            if kind == "sc:ImageObject" {
                source["transform"] = json!({ "jsonPath": "bytes" });
            }
            let mut field = json!({
                "@type": "cr:Field", "@id": format!("keyframes/{name}"), "name": name, "description": description, "dataType": kind,
                "source": source,
            });
            if let Some([rows, columns]) = shape {
                (field["isArray"], field["arrayShape"]) = (json!(true), json!(format!("{rows},{columns}")));
            }
            field
        };
        let mut fields = vec![
            field("index", "sc:Integer", "Index along the trajectory, from 0.", None),
            field("file", "sc:Text", "Stem of the keyframe's files in dataset/.", None),
            field("time_s", "sc:Float", "Seconds along the trajectory.", None),
            field("split", "sc:Text", "train, test, or unused.", None),
            field("is_validation", "sc:Boolean", "Whether constants may be chosen on this training keyframe.", None),
            field(
                "in_held_out_segment",
                "sc:Boolean",
                "Whether it lies in the contiguous segment that the second protocol holds out.",
                None,
            ),
            field(
                "world_from_camera",
                "sc:Float",
                "Pose by rows: OpenCV camera axes (x right, y down, z forward) to a right-handed world, z up, metres.",
                Some([4, 4]),
            ),
        ];
        let has = self.dataset.modalities();
        if has.light {
            fields.push(field("image", "sc:ImageObject", "sRGB image.", None));
        }
        if has.radio {
            let camera = self.dataset.radio_camera();
            let what = format!("Angular power spectrum by rows, linear power in {}; 0 is an empty bin.", self.unit());
            fields.push(field("spectrum", "sc:Float", &what, Some([camera.height, camera.width])));
            let what = self.dataset.db_range().map(|range| {
                format!("The spectrum in Jet colours, from {} dB (blue) to {} dB (red).", range.min_db, range.max_db)
            });
            fields.push(field("spectrum_image", "sc:ImageObject", &what.unwrap_or_default(), None));
        }
        json!({
            "@type": "cr:RecordSet", "@id": "keyframes", "name": "keyframes", "key": { "@id": "keyframes/index" },
            "description": "A record a keyframe.", "field": fields,
        })
    }
}

fn creator(author: &Author) -> Value {
    match author {
        Author::Person { family, given } => {
            json!({ "@type": "sc:Person", "name": author.name(), "givenName": given, "familyName": family })
        }
        Author::Entity(name) => json!({ "@type": "sc:Organization", "name": name }),
    }
}

/// The JSON-LD context of Croissant 1.1, and the vocabularies of Responsible AI and provenance.
fn context() -> Value {
    let mut context = json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "data": { "@id": "cr:data", "@type": "@json" },
        "dataType": { "@id": "cr:dataType", "@type": "@vocab" },
        "dct": "http://purl.org/dc/terms/",
        "conformsTo": "dct:conformsTo",
        "description": { "@container": "@language" },
        "examples": { "@id": "cr:examples", "@type": "@json" },
        "name": { "@container": "@language" },
        "prov": "http://www.w3.org/ns/prov#",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "sc": "https://schema.org/",
    });
    for term in [
        "arrayShape",
        "citeAs",
        "column",
        "containedIn",
        "equivalentProperty",
        "extract",
        "field",
        "fileObject",
        "fileProperty",
        "fileSet",
        "format",
        "includes",
        "isArray",
        "isLiveDataset",
        "jsonPath",
        "key",
        "md5",
        "parentField",
        "path",
        "recordSet",
        "references",
        "regex",
        "repeated",
        "replace",
        "samplingRate",
        "separator",
        "source",
        "subField",
        "transform",
    ] {
        context[term] = json!(format!("cr:{term}"));
    }
    context
}
