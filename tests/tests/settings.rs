//! Settings mean something: every key that `corf config --explain METHOD` lists changes the field when it is changed, or is refused as one without
//! effect, or stands in [`WITHOUT_EFFECT_HERE`] with its reason. One key at a time, on data sets of a plain room.

use crate::common::*;
use corf_bench::device::Backend;
use corf_bench::methods::interface::TrainingSet;
use corf_bench::methods::{merge, registry};
use corf_bench::split::{Protocol, Split};
use corf_scene::Raster;
use corf_scene::dataset::Dataset;
use corf_scene::io::{encode_png16, write_atomic};
use rayon::prelude::*;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Keys that change no byte in these runs, each with the reason; of the table `light` of `corf-array` as well.
const WITHOUT_EFFECT_HERE: &[(&str, &str)] = &[
    ("raster.tile_px", "speed on a GPU; by its definition nothing that is computed depends on it"),
    ("raster.keyframe_memory_mb", "a memory budget of the GPU; nothing that is computed depends on it"),
    ("depth.matched_on", "beside a GPU alone; where the processor trains it matches in any case"),
    ("keyframe_budget_ms", "a time, which is refused beside the number of steps that these runs have"),
    ("half_precision", "matrix units of a GPU; the processor computes in f32 always"),
    ("depth.weights", "needs the weights of a network, which are not part of the repository"),
    ("depth.input_px", "of that network"),
    ("depth.imagenet_normalisation", "of that network"),
];

/// Other values than the default, of keys where one more or twice as much would say nothing, or would be out of range.
const VALUES: &[(&str, &str)] = &[
    ("least_probability", "0.5"),
    ("keyframe_budget_ms", "5.0"),
    ("fine_tune_s", "1.0"),
    ("power", "4"),
    ("overlapped_iterations", "2"),
    ("pyramid_levels", "1"),
    ("rf_pyramid_levels", "1"),
    ("visits_per_level", "1"),
    ("finest_share", "0.2"),
    ("latest_probability", "1.0"),
    ("scale_clamp", "[4.0, 0.02]"),
    ("initial_opacity", "[0.3, 0.2, 0.5]"),
    ("replace_at_samples", "1"),
    ("prune_opacity", "0.6"),
    ("prune_age_keyframes", "1"),
    ("prune_image_fraction", "0.02"),
    ("scale_baselines", "1"),
    ("bootstrap_keyframes", "2"),
    ("optical_sh_degree", "2"),
    ("rf_sh_degree", "1"),
    ("sh_degree", "1"),
    ("depth.prior", "\"exact\""),
    ("depth.prior", "\"none\""),
    ("depth.near_m", "1.5"),
    ("depth.far_m", "3.0"),
    ("depth.neighbours", "1"),
    ("depth.corners", "1"),
    ("depth.sweep_candidates", "12"),
    ("depth.match_candidates", "4"),
    ("depth.match_range", "0.02"),
    ("depth.corrected_range", "0.01"),
    ("depth.min_segment_px", "60.0"),
    ("depth.cost_ratio", "3.0"),
    ("depth.min_zncc", "0.8"),
    ("depth.matched_on", "\"processor\""),
    ("beta1", "0.8"),
    ("beta2", "0.9"),
    ("epsilon", "1e-2"),
    ("ssim_weight", "0.6"),
    ("position_decay", "0.1"),
    ("depth_weight_decay", "0.5"),
    ("anchor_spacing_m", "2.0"),
    ("metres_per_radian", "50.0"),
    ("width", "16"),
    ("raster.tile_px", "[8, 8]"),
    ("rates.position", "[1e-2, 1e-3]"),
    ("rates.network", "[1e-2, 1e-3]"),
    ("clone_fraction", "10.0"),
    ("split_into", "3"),
    ("density.prune_opacity", "0.0101"),
    ("prune_fraction", "0.02"),
    ("reset_opacity", "0.3"),
    ("gradient", "1.0"),
    ("skip", "0"),
    ("least_rate", "0.1"),
    ("weight_decay", "0.5"),
    ("damping", "3.0"),
    ("clip", "0.1"),
    ("rate", "0.1"),
    ("visibility", "0.1"),
    ("rays", "2"),
    ("ray_range_db", "5.0"),
    ("votes", "0.1"),
    ("ray_width_deg", "8.0"),
    ("keyframes", "2"),
    ("near_m", "1.0"),
    ("extent_m", "3.2"),
    ("density.from", "25"),
    ("density.until", "9"),
    ("position_steps", "10"),
    ("network_steps", "10"),
];

/// Settings that make runs short, and that let keys count which count late in a long run.
const GAUSSIANS: &str = "iterations_per_keyframe = 6\noptimizer.position_decay = 0.3\n";
const FAST: &str = "iterations_per_keyframe = 6\noverlapped_iterations = 6\n";
const ARRAY: &str = "iterations_per_keyframe = 3\nlight.iterations_per_keyframe = 6\nlight.optimizer.position_decay = 0.3\n";
const RF_3DGS: &str = "optical_steps = 60\nrf_steps = 8\ndegree_interval = 10\nrates.position_steps = 50\n\
                       density = { from = 5, until = 50, every = 10, reset_every = 20, gradient = 1e-7 }\n";
const NERF2: &str =
    "iterations = 4\nrays = 16\nsamples = 4\nlayers = 3\nwidth = 8\nskip = 1\nfrequencies = 2\ncosine_steps = 6\n";
const WRF: &str = "iterations = 16\nrandom_points = 300\nrandom_extent = 1.0\nlayers = 3\nwidth = 8\nskip = 1\nposition_frequencies = 2\nreceiver_frequencies = 2\n\
                   receiver_width = 8\nreceiver_features = 4\nextent_m = 16.0\n\
                   density = { from = 3, until = 14, every = 4, reset_every = 8, gradient = 1e-9 }\n";

/// Data sets of lobes and of an array's beams.
const LOBES: usize = 0;
const BEAMS: usize = 1;

/// Where keys are tried.
struct Context {
    method: &'static str,
    /// Settings over the defaults, TOML.
    base: String,
    data_set: usize,
}

/// Keys of a method that are tried.
#[derive(Clone, Copy)]
enum Keys {
    All,
    /// Those whose default is another than in this method of the same family, whose field must be another where none is.
    UnlikeIn(&'static str),
    /// Those of a table.
    Of(&'static str),
}

/// Keys of the first context's method; what is refused there is tried in the next, and must have an effect in one of several.
struct Trial {
    keys: Keys,
    contexts: Vec<Context>,
}

/// What came of a change.
#[derive(Clone, Debug, PartialEq)]
enum Outcome {
    Changed,
    Same,
    /// In these words.
    Refused(String),
}

/// Everything that a field shows and, of Gaussians, all that they are: what is only written down of the settings does not count.
fn field(context: &Context, overrides: &toml::Table, data_set: &Dataset) -> Result<Vec<u8>, String> {
    let reported = |e: anyhow::Error| format!("{e:#}");
    let split = Split::of(data_set, Protocol::TEST).map_err(reported)?;
    let training = TrainingSet::new(data_set, &split);
    let mut method = registry::create(context.method, overrides, &Backend::Cpu).map_err(reported)?;
    registry::check_data_set(method.as_mut(), overrides, &training).map_err(reported)?;
    let mut predictor = method.reconstruct(&training, 1, &mut |_| Ok(())).map_err(reported)?;
    let mut bytes = Vec::new();
    for &index in &split.held_out {
        let shown = predictor.render(&data_set.poses()[index].world_from_camera).map_err(reported)?;
        let floats = |raster: &Raster<f32>| raster.pixels().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        bytes.extend(shown.image.iter().flat_map(|image| image.pixels().iter().flatten().flat_map(|v| v.to_le_bytes())));
        bytes.extend(shown.radio.iter().flat_map(|radio| floats(&radio.scalar)));
        bytes.extend(shown.depth_m.iter().flat_map(floats));
    }
    let folder = tempfile::tempdir().unwrap();
    predictor.save(folder.path()).map_err(reported)?;
    let mut files: Vec<PathBuf> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "ply"));
    files.sort();
    files.iter().for_each(|path| bytes.extend(fs::read(path).unwrap()));
    Ok(bytes)
}

/// The base of a context with one key more.
fn with(base: &str, key: &str, value: &str) -> toml::Table {
    let mut table: toml::Table = base.parse().unwrap();
    let change: toml::Table = format!("{key} = {value}").parse().unwrap_or_else(|e| panic!("{key} = {value}: {e}"));
    merge(&mut table, change);
    table
}

/// The value at a dotted key.
fn at<'t>(table: &'t toml::Table, key: &str) -> Option<&'t toml::Value> {
    match key.split_once('.') {
        Some((outer, rest)) => at(table.get(outer)?.as_table()?, rest),
        None => table.get(key),
    }
}

/// Another value for a key than the one that it has in a context, as TOML: one of [`VALUES`], else one that its type and its value suggest.
fn other_value(key: &Value, context: &Context, special: &[(String, String)]) -> String {
    let name = key["key"].as_str().unwrap();
    // What is the default on one of the data sets is none on the other.
    match (name, context.data_set) {
        ("surface", data_set) => return if data_set == LOBES { "\"points\"" } else { "\"splats\"" }.to_owned(),
        ("refine_sources", data_set) => return (data_set != LOBES).to_string(),
        _ => {}
    }
    let given = at(&context.base.parse().unwrap(), name).map(|v| serde_json::to_value(v).unwrap());
    let now = given.as_ref().unwrap_or(&key["default"]);
    let known = VALUES.iter().map(|(k, v)| (*k, *v)).chain(special.iter().map(|(k, v)| (k.as_str(), v.as_str())));
    // Keys of one name may be a number in one method and a list in another.
    let matches = |k: &str, v: &str| {
        (name == k || name.strip_suffix(k).is_some_and(|outer| outer.ends_with('.')))
            && (now.is_null() || now.is_array() == v.starts_with('['))
            && now.to_string().as_str() != v
    };
    if let Some((_, value)) = known.filter(|(k, v)| matches(k, v)).max_by_key(|(k, _)| k.len()) {
        return value.to_owned();
    }
    let choices: Vec<&str> = key["choices"].as_array().unwrap().iter().map(|c| c[0].as_str().unwrap()).collect();
    match now {
        Value::Bool(on) => (!on).to_string(),
        Value::Number(n) if n.is_u64() => (n.as_u64().unwrap() + 1).to_string(),
        Value::Number(n) => format!("{:?}", if n.as_f64() == Some(0.0) { 0.3 } else { 2.0 * n.as_f64().unwrap() }),
        Value::Array(list) => format!("{:?}", list.iter().map(|v| 2.0 * v.as_f64().unwrap()).collect::<Vec<_>>()),
        now if !choices.is_empty() => {
            format!("{:?}", choices.iter().find(|choice| now.as_str() != Some(choice)).unwrap())
        }
        other => panic!("{name}: what else than {other} could it be? Give it a value in VALUES"),
    }
}

/// The keys of a method that can be set, tables themselves aside.
fn explained(method: &str) -> Vec<Value> {
    let list: Value = serde_json::from_str(&corf_ok(&["config", "--explain", method, "--json"])).unwrap();
    list.as_array().unwrap().iter().filter(|key| key["kind"] != "table").cloned().collect()
}

/// The keys of a trial.
fn keys(trial: &Trial) -> Vec<Value> {
    let mut keys = explained(trial.contexts[0].method);
    match trial.keys {
        Keys::All => {}
        Keys::UnlikeIn(method) => {
            let others = explained(method);
            keys.retain(|key| !others.iter().any(|other| other["key"] == key["key"] && other["default"] == key["default"]));
        }
        Keys::Of(table) => keys.retain(|key| key["key"].as_str().unwrap().starts_with(table)),
    }
    keys
}

/// A tiny data set of the plain room.
fn room(folder: &Path, name: &str, spectrum: &str) -> PathBuf {
    let scene = root().join("scenes/room.toml").canonicalize().unwrap();
    let config = folder.join(format!("{name}.toml"));
    let body = format!(
        "name = {name:?}\nscene = {scene:?}\nkeyframes = 16\nseed = 1\n[optical]\nwidth = 128\nheight = 72\nmethod = \"path\"\nsamples_per_pixel = 8\n\
         max_bounces = 4\n[rf]\nwidth = 72\nheight = 45\nspectrum = {spectrum:?}\nmax_interactions = 2\ndirections = 93000\n\
         photons = 20000\npatch_size_m = 0.4\n[split]\ntest_every = 4\n"
    );
    fs::write(&config, body).unwrap();
    let out = folder.join(name);
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
    out
}

/// What is tried: all keys of a method, or those whose defaults set it apart from another; of other depth priors all that is of depth. (`measured` is
/// `exact` on this data set, and matches where a keyframe brings no depth.)
fn trials(depth_maps: &Path, gaussians: &Path, on_geometry: &str) -> Vec<Trial> {
    let of = |method, base: &str, data_set| Context { method, base: base.to_owned(), data_set };
    let prior = |prior: &str| of("corf-gs", &format!("{GAUSSIANS}depth.prior = {prior:?}\n"), LOBES);
    let maps = format!("{GAUSSIANS}depth = {{ prior = \"folder\", folder = {depth_maps:?}, folder_kind = \"depth-metric\" }}\n");
    // Those of the optical stage have no effect here.
    let begun = "optical_steps = 60\nrf_steps = 8\n".to_owned();
    let no_response = format!("{ARRAY}array_response = false\n");
    let random = format!("{RF_3DGS}initial_points = \"random\"\nrandom_points = 200\nrandom_extent = 0.5\n");
    let trial = |keys, contexts| Trial { keys, contexts };
    let all = |method, base: &str, data_set| trial(Keys::All, vec![of(method, base, data_set)]);
    let unlike = |method, base: &str, other| trial(Keys::UnlikeIn(other), vec![of(method, base, LOBES)]);
    vec![
        trial(
            Keys::All,
            vec![
                of("corf-gs", GAUSSIANS, LOBES),
                of("corf-gs-uniform", GAUSSIANS, LOBES),
                of("corf-gs-frozen", GAUSSIANS, LOBES),
                of("corf-gs", &maps, LOBES),
                of("corf-gs", on_geometry, LOBES),
            ],
        ),
        trial(Keys::Of("depth."), vec![prior("exact")]),
        trial(Keys::Of("depth."), vec![prior("none")]),
        trial(Keys::Of("depth."), vec![of("corf-gs", &maps, LOBES)]),
        unlike("corf-gs-paper", GAUSSIANS, "corf-gs"),
        unlike("corf-gs-fast", FAST, "corf-gs"),
        unlike("corf-gs-live", GAUSSIANS, "corf-gs"),
        unlike("corf-gs-quality", &format!("{GAUSSIANS}fine_tune_epochs = 2\n"), "corf-gs"),
        all("corf-gs-uniform", GAUSSIANS, LOBES),
        all("corf-gs-frozen", GAUSSIANS, LOBES),
        all("corf-gs-rf-tuned", GAUSSIANS, LOBES),
        trial(
            Keys::All,
            vec![of("corf-array", ARRAY, BEAMS), of("corf-array", &no_response, BEAMS), of("corf-array", ARRAY, LOBES)],
        ),
        all("corf-array", ARRAY, LOBES),
        trial(Keys::All, vec![of("rf-3dgs", RF_3DGS, LOBES), of("rf-3dgs", &random, LOBES), of("rf-3dgs", &begun, LOBES)]),
        trial(Keys::Of("rates."), vec![of("rf-3dgs", &format!("{begun}initial_gaussians = {gaussians:?}\n"), LOBES)]),
        all("rf-3dgs-corrected", RF_3DGS, LOBES),
        unlike("rf-3dgs-fresh-moments", RF_3DGS, "rf-3dgs"),
        unlike("rf-3dgs-floor", RF_3DGS, "rf-3dgs"),
        all("nerf2", NERF2, LOBES),
        unlike("nerf2-corrected", NERF2, "nerf2"),
        all("wrf-gs-plus", WRF, LOBES),
        all("wrf-gs-plus-corrected", WRF, LOBES),
        all("nearest", "", LOBES),
        all("inverse-distance", "", LOBES),
    ]
}

/// Whether a refusal names the key and says that it has no effect, or what to do instead.
fn is_honest(said: &str, key: &str) -> bool {
    let advice = ["leave it out", "leave them out", "leave the key out"];
    said.contains(key) && (said.contains("has no effect") || advice.iter().any(|words| said.contains(words)))
}

#[test]
fn every_key_of_every_method_changes_the_field_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let places = [room(folder.path(), "lobes", "mpc"), room(folder.path(), "beams", "bartlett")];
    let data_sets = places.each_ref().map(|place| Dataset::open(place).unwrap());
    // Maps in whole millimetres, and others that say something else.
    let [maps, other_maps] = ["maps", "other-maps"].map(|name| folder.path().join(name));
    for index in 0..data_sets[0].len() {
        let depth = data_sets[0].keyframe(index).unwrap().light.unwrap().depth_m.unwrap();
        for (place, scale) in [(&maps, 1000.0), (&other_maps, 700.0)] {
            let whole = depth.map(|z| if z.is_finite() { (scale * z).round() as u16 } else { 0 });
            write_atomic(place.join(format!("{:05}.png", index + 1)), &encode_png16(&whole).unwrap()).unwrap();
        }
    }
    let begun = folder.path().join("begun");
    corf_ok(&["reconstruct", text(&places[0]), "--out", text(&begun), "--seed", "3", "--set", "iterations_per_keyframe=6"]);
    let gaussians = begun.join("coupled.ply");
    // What --geometry writes down of that run.
    let anew = folder.path().join("anew");
    let few = ["--set", "geometry.epochs=2"];
    corf_ok(&[&["reconstruct", text(&places[0]), "--out", text(&anew), "--geometry", text(&begun)][..], &few].concat());
    let written: Value = serde_json::from_slice(&fs::read(anew.join("run.json")).unwrap()).unwrap();
    let geometry = toml::Table::try_from(serde_json::json!({ "geometry": written["overrides"]["geometry"] })).unwrap();
    let on_geometry = toml::to_string(&geometry).unwrap();
    let quoted = |path: &Path| format!("{:?}", text(path));
    let special = [
        ("depth.folder".to_owned(), quoted(&other_maps)),
        ("depth.weights".to_owned(), quoted(&folder.path().join("no.safetensors"))),
        ("initial_gaussians".to_owned(), quoted(&gaussians)),
        ("oracle_scene".to_owned(), quoted(&root().join("scenes/room.toml").canonicalize().unwrap())),
    ];
    let (mut faults, mut tried, mut excused) = (Vec::new(), BTreeSet::new(), BTreeSet::new());
    for trial in trials(&maps, &gaussians, &on_geometry) {
        let Trial { contexts, .. } = &trial;
        let method = contexts[0].method;
        tried.insert(method);
        let plain = |c: &Context| field(c, &c.base.parse().unwrap(), &data_sets[c.data_set]);
        let unchanged: Result<Vec<Vec<u8>>, String> = contexts.iter().map(plain).collect();
        let unchanged = match unchanged {
            Ok(unchanged) => unchanged,
            Err(error) => {
                faults.push(format!("{method}, {:?}: {error}", contexts[0].base));
                continue;
            }
        };
        let outcomes_of = |key: &Value| {
            let name = key["key"].as_str().unwrap();
            let mut outcomes = Vec::new();
            for (context, unchanged) in contexts.iter().zip(&unchanged) {
                let value = other_value(key, context, &special);
                let outcome = match field(context, &with(&context.base, name, &value), &data_sets[context.data_set]) {
                    Ok(bytes) if bytes == *unchanged => Outcome::Same,
                    Ok(_) => Outcome::Changed,
                    Err(said) => Outcome::Refused(said),
                };
                outcomes.push((value, outcome));
                if !matches!(outcomes.last(), Some((_, Outcome::Refused(_)))) {
                    break;
                }
            }
            outcomes
        };
        let keys = keys(&trial);
        if let (Keys::UnlikeIn(other), [context, ..], true) = (trial.keys, &contexts[..], keys.is_empty()) {
            // What sets them apart is decided by the name.
            let twin = Context { method: other, base: context.base.clone(), ..*context };
            if plain(&twin).as_ref() == Ok(&unchanged[0]) {
                faults.push(format!("{method} and {other} are one method"));
            }
        }
        let found: Vec<Vec<(String, Outcome)>> = keys.par_iter().map(outcomes_of).collect();
        for (key, outcomes) in keys.iter().zip(found) {
            let name = key["key"].as_str().unwrap();
            let here = name.strip_prefix("light.").unwrap_or(name);
            let is_excused = WITHOUT_EFFECT_HERE.iter().any(|(listed, _)| *listed == here);
            let is_fine = match &outcomes.last().unwrap().1 {
                Outcome::Changed => !is_excused,
                Outcome::Same => is_excused,
                // Where other contexts are there to show that it can have an effect, one of them must; of light corf-gs has shown it.
                Outcome::Refused(_) => is_excused || contexts.len() == 1 || name.starts_with("light."),
            };
            let is_honest = outcomes.iter().all(|(_, outcome)| match outcome {
                Outcome::Refused(said) => is_excused || is_honest(said, here),
                _ => true,
            });
            if is_excused {
                excused.insert(here.to_owned());
            }
            if !(is_fine && is_honest) {
                faults.push(format!("{method} {name}, {:?}: {outcomes:?}", contexts[0].base));
            }
        }
    }
    assert!(faults.is_empty(), "{} keys:\n{}", faults.len(), faults.join("\n"));
    let all: BTreeSet<&str> = registry::all().map(|variant| variant.id).collect();
    assert_eq!(tried, all, "every method is tried");
    let listed: BTreeSet<String> = WITHOUT_EFFECT_HERE.iter().map(|(key, _)| (*key).to_owned()).collect();
    assert_eq!(excused, listed, "every exception is a key");
}
