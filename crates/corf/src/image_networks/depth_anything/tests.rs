//! The whole network against what the official code gives, for small random weights; and what is said about files that are not its.

use super::*;
use crate::config::DepthPriorKind;
use crate::files::tensors::Tensors;
use crate::reference_data::shared;

const FOLDER: &str = "weights/depth_anything_tiny";

fn network(path: &Path) -> Result<DepthNetwork> {
    DepthNetwork::read(path, &DepthConfig { prior: DepthPriorKind::DepthAnything, ..DepthConfig::default() })
}

/// An input of the golden file, channels last.
fn golden_input(golden: &Tensors, name: &str) -> Map {
    let shape @ [_, _, height, width] = golden.shape(name).unwrap();
    let values = golden.values(name, &shape).unwrap();
    let pixels = (0..height * width).flat_map(|i| (0..3).map(move |c| (i, c))).map(|(i, c)| values[c * height * width + i]);
    Map { height, width, channels: 3, values: pixels.collect() }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn both_kinds_of_names_give_what_the_official_code_gives() {
    let Some(folder) = shared(FOLDER) else { return };
    let golden = Tensors::read(&folder.join("golden.safetensors"), "").unwrap();
    for file in ["model.safetensors", "model_orig_names.safetensors"] {
        let network = network(&folder.join(file)).unwrap();
        for size in ["56x56", "42x70"] {
            let found = network.forward(&golden_input(&golden, &format!("x_{size}")));
            let name = format!("yorig_{size}");
            let shape @ [_, height, width] = golden.shape(&name).unwrap();
            let official = golden.values(&name, &shape).unwrap();
            assert_eq!((found.height, found.width, found.channels), (height, width, 1));
            let error = found.values.iter().zip(&official).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            eprintln!("{file}, {size}: largest error {error:.2e}");
            assert!(error < 1e-4, "{file}, {size}: {error}");
        }
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn the_same_bytes_come_of_any_number_of_threads() {
    let Some(folder) = shared(FOLDER) else { return };
    let network = network(&folder.join("model.safetensors")).unwrap();
    let image = Raster::from_fn(96, 54, |x, y| [(x * 2) as u8, (y * 4) as u8, ((x * y) % 256) as u8]);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| network.estimate(&image).unwrap())
    };
    let one = on(1);
    // 518 on the shorter side is more than the image has.
    assert_eq!((one.grid().width(), one.grid().height()), (96, 54));
    for threads in [2, 5] {
        assert_eq!(on(threads), one);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn images_are_seen_at_the_published_size_or_the_one_asked_for() {
    let Some(folder) = shared(FOLDER) else { return };
    let network = |input_px: usize, imagenet_normalisation: bool| {
        let config = DepthConfig { input_px, imagenet_normalisation, ..DepthConfig::default() };
        DepthNetwork::read(&folder.join("model.safetensors"), &config).unwrap()
    };
    assert_eq!(network(518, true).input_size((1600, 900)).unwrap(), [518, 924]);
    assert_eq!(network(518, true).input_size((480, 640)).unwrap(), [686, 518]);
    assert_eq!(network(50, true).input_size((20, 10)).unwrap(), [56, 112]);
    let error = network(518, true).input_size((100_000, 10)).unwrap_err().to_string();
    assert!(error.contains("depth.input_px"), "{error}");
    // An even colour stays one through the cubic kernel.
    let grey = Raster::filled(20, 10, [51, 102, 204]);
    let seen = |normalised: bool| network(28, normalised).show(&grey).unwrap();
    assert!(seen(false).values.chunks(3).all(|p| p.iter().zip([0.2, 0.4, 0.8]).all(|(a, b)| (a - b).abs() < 1e-6)));
    let expected = [(0.2 - 0.485) / 0.229, (0.4 - 0.456) / 0.224, (0.8 - 0.406) / 0.225];
    assert!(seen(true).values.chunks(3).all(|p| p.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-5)));
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_file_that_cannot_be_used_is_told_what_it_lacks() {
    let Some(folder) = shared(FOLDER) else { return };
    let own = tempfile::tempdir().unwrap();
    let whole = std::fs::read(folder.join("model.safetensors")).unwrap();
    let place = |file: &str| own.path().join(file);
    let refused = |file: &str, bytes: &[u8], word: &str| {
        std::fs::write(place(file), bytes).unwrap();
        let error = network(&place(file)).unwrap_err().to_string();
        assert!(error.contains(file) && error.contains(word) && error.contains("help"), "{word}: {error}");
    };
    // Its heads cannot be told from its shapes.
    refused("bare.safetensors", &whole, "config.json");
    let config = std::fs::read_to_string(folder.join("config.json")).unwrap();
    std::fs::write(place("config.json"), &config).unwrap();
    std::fs::write(place("good.safetensors"), &whole).unwrap();
    assert!(network(&place("good.safetensors")).is_ok());
    for cut in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        refused("cut.safetensors", &whole[..cut], "not a readable safetensors file");
    }
    refused("text.safetensors", b"not tensors at all", "not a readable safetensors file");
    // Names of equal length keep the header's.
    let swapped = |from: &str, to: &str| {
        let mut bytes = whole.clone();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    refused(
        "foreign.safetensors",
        &swapped("backbone.embeddings.cls_token", "backbone.embeddings.cls_taken"),
        "pretrained.cls_token",
    );
    let missing = "neck.fusion_stage.layers.2.residual_layer1.convolution2.bias";
    refused("lacking.safetensors", &swapped(missing, &missing.replace("bias", "bios")), missing);
    let block = "backbone.encoder.layer.1.mlp.fc1.weight";
    refused("blockless.safetensors", &swapped(block, &block.replace("fc1", "fc9")), block);
    std::fs::write(place("config.json"), config.replace("\"relative\"", "\"metric\"")).unwrap();
    refused("metric.safetensors", &whole, "metric");
    assert!(network(&place("absent.safetensors")).unwrap_err().to_string().contains("absent.safetensors"));
}
