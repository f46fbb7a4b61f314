//! LPIPS against the official program's values, and against its formula in f64 with weights by chance; and what is said about files that are not its.

use super::*;
use crate::image_networks::{Layer, MaxPool, Window};
use crate::reference_data::shared;
use corf_scene::Rng;
use corf_scene::io::read_png;
use std::path::PathBuf;

/// Folder with the weights of VGG-16, as tools/fetch_weights.py writes it.
const WEIGHTS_VARIABLE: &str = "CORF_LPIPS_WEIGHTS";
/// The official program's sums are in f32, as these are, in another order.
const TOLERANCE: f64 = 2e-6;
/// Of a layer's share: the GPU takes features by their length in f32, the processor in f64, and sums come in another order.
#[cfg(feature = "gpu")]
const GPU_TOLERANCE: f64 = 1e-5;
/// Pairs of images with known distances.
const PAIRS: [[&str; 2]; 3] = [["ex_ref", "ex_p0"], ["ex_ref", "ex_p1"], ["jet_a", "jet_b"]];

/// File of weights in the folder that the environment names, relative to the workspace, whose tests run in the folders of their crates.
fn fetched(backbone: Backbone) -> Option<PathBuf> {
    let folder = std::env::var_os(WEIGHTS_VARIABLE)?;
    Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder).join(backbone.file()))
}

fn image(name: &str) -> Option<Raster<[u8; 3]>> {
    Some(read_png(&shared(&format!("goldens/{name}.png"))?).unwrap())
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn distances_are_the_official_programs() {
    let Some(file) = shared("goldens/metrics.json") else { return };
    let goldens: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    for backbone in [Backbone::Alex, Backbone::Squeeze] {
        let Some(path) = shared(&format!("weights/lpips/{}", backbone.file())) else { return };
        let lpips = Lpips::read(&path, backbone).unwrap();
        for [first, second] in PAIRS {
            let (a, b) = (image(first).unwrap(), image(second).unwrap());
            let known = |key: &str| &goldens[format!("{first}|{second}")][format!("lpips_{}_{key}", backbone.name())];
            for (input, key) in [(LpipsInput::Signed, "pm1"), (LpipsInput::Unit, "01_input_3dgs_convention")] {
                let (found, known) = (lpips.distance(&a, &b, input), known(key).as_f64().unwrap());
                assert!((found - known).abs() < TOLERANCE, "{backbone:?} {first} {second} {input:?}: {found} {known}");
            }
            let layers = lpips.layers(&a, &b, LpipsInput::Signed);
            let known: Vec<f64> = known("pm1_layers").as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            assert_eq!(layers.len(), known.len());
            assert!(layers.iter().zip(&known).all(|(a, b)| (a - b).abs() < TOLERANCE), "{backbone:?} {layers:?} {known:?}");
        }
    }
}

/// VGG-16, whose weights are fetched. The official program gives 0.569 and 0.422 for the first two pairs (quoted in lpips-tensorflow's example); all
/// digits are of an implementation of its own in f64 (numpy), which meets the official values of the other backbones to 1e-6.
#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn distances_by_vgg_are_known() {
    let Some(path) = fetched(Backbone::Vgg) else {
        eprintln!("skipped: {WEIGHTS_VARIABLE} names no folder of tools/fetch_weights.py");
        return;
    };
    let lpips = Lpips::read(&path, Backbone::Vgg).unwrap();
    let known = [
        ([0.060838559, 0.070203968, 0.075811864, 0.186467063, 0.175291364], 0.569181575),
        ([0.073909727, 0.084017343, 0.064278855, 0.086217369, 0.113240965], 0.405095966),
        ([0.027075265, 0.042559576, 0.024754882, 0.018703894, 0.013342364], 0.108327450),
    ];
    for ([first, second], (layers, unit)) in PAIRS.into_iter().zip(known) {
        let (Some(a), Some(b)) = (image(first), image(second)) else { return };
        let found = lpips.layers(&a, &b, LpipsInput::Signed);
        let found_unit = lpips.distance(&a, &b, LpipsInput::Unit);
        println!("{first} {second}: {} {found_unit}, layers {found:?}", found.iter().sum::<f64>());
        assert!(found.iter().zip(layers).all(|(a, b)| (a - b).abs() < TOLERANCE), "{found:?} {layers:?}");
        assert!((found_unit - unit).abs() < TOLERANCE, "{found_unit} {unit}");
    }
}

fn noise(seed: u64, count: usize, scale: f64) -> Vec<f32> {
    let mut rng = Rng::keyed(seed, 1, 0);
    (0..count).map(|_| (scale * rng.normal()) as f32).collect()
}

fn layer(seed: u64, inputs: usize, outputs: usize) -> Layer {
    let scale = (inputs as f64).powf(-0.5);
    Layer { inputs, outputs, weights: noise(seed, inputs * outputs, scale), bias: noise(seed + 100, outputs, 0.1) }
}

fn photograph(seed: u64, width: usize, height: usize) -> Raster<[u8; 3]> {
    let mut rng = Rng::keyed(seed, 2, 0);
    Raster::from_fn(width, height, |x, y| {
        [(9 * x) as u8, (7 * y) as u8, 0].map(|v: u8| v.wrapping_add((64.0 * rng.uniform()) as u8))
    })
}

/// A small network with every kind of step. Channels come in fours, as in all backbones.
fn small() -> Lpips {
    let positive = |seed, count| Step::Comparison(noise(seed, count, 1.0).iter().map(|v| v.abs()).collect());
    let steps = vec![
        Step::Convolution(layer(1, 3 * 25, 8), Window { side: 5, stride: 2, border: 1 }),
        positive(2, 8),
        Step::Pool(MaxPool { side: 3, stride: 2, beyond: true }),
        Step::Fire(Box::new([layer(3, 8, 4), layer(4, 4, 8), layer(5, 4 * 9, 12)])),
        positive(6, 20),
        Step::Pool(MaxPool { side: 2, stride: 2, beyond: false }),
        Step::Convolution(layer(7, 20 * 9, 132), Window::three(1)),
        positive(8, 132),
    ];
    Lpips { backbone: Backbone::Alex, steps, sha256: String::new() }
}

/// A map as rows of pixels of channels, f64.
type Exact = Vec<Vec<Vec<f64>>>;

/// A rectified convolution by its definition.
fn convolved(map: &Exact, layer: &Layer, window: Window) -> Exact {
    let (height, width, channels) = (map.len(), map[0].len(), map[0][0].len());
    let Window { side, stride, border } = window;
    let value = |y: usize, x: usize, o: usize| {
        let mut sum = f64::from(layer.bias[o]);
        for (j, i) in (0..side).flat_map(|j| (0..side).map(move |i| (j, i))) {
            let (v, u) = ((stride * y + j).wrapping_sub(border), (stride * x + i).wrapping_sub(border));
            if v < height && u < width {
                let weights = &layer.weights[layer.inputs * o + (j * side + i) * channels..];
                sum += map[v][u].iter().zip(weights).map(|(m, w)| m * f64::from(*w)).sum::<f64>();
            }
        }
        sum.max(0.0)
    };
    let [rows, columns] = [height, width].map(|n| (n + 2 * border - side) / stride + 1);
    (0..rows).map(|y| (0..columns).map(|x| (0..layer.outputs).map(|o| value(y, x, o)).collect()).collect()).collect()
}

fn pooled(map: &Exact, pool: MaxPool) -> Exact {
    let (height, width) = (map.len(), map[0].len());
    let places = |n: usize| {
        let steps = (n - pool.side) as f64 / pool.stride as f64;
        1 + (if pool.beyond { steps.ceil() } else { steps.floor() }) as usize
    };
    let value = |y: usize, x: usize, c: usize| {
        let inside = (0..height).filter(|v| (pool.stride * y..pool.stride * y + pool.side).contains(v));
        let pixels = inside.flat_map(|v| (0..width).map(move |u| (v, u)));
        let covered = pixels.filter(|(_, u)| (pool.stride * x..pool.stride * x + pool.side).contains(u));
        covered.map(|(v, u)| map[v][u][c]).fold(f64::NEG_INFINITY, f64::max)
    };
    let channels = map[0][0].len();
    (0..places(height)).map(|y| (0..places(width)).map(|x| (0..channels).map(|c| value(y, x, c)).collect()).collect()).collect()
}

/// The layers' shares by the formula, in f64.
fn exact_layers(lpips: &Lpips, images: [&Raster<[u8; 3]>; 2], input: LpipsInput) -> Vec<f64> {
    let shown = |image: &Raster<[u8; 3]>| -> Exact {
        let [shift, scale] = [[-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]];
        let x = |v: u8| if input == LpipsInput::Signed { f64::from(v) / 127.5 - 1.0 } else { f64::from(v) / 255.0 };
        let pixel = |p: [u8; 3]| (0..3).map(|c| (x(p[c]) - shift[c]) / scale[c]).collect();
        (0..image.height()).map(|v| (0..image.width()).map(|u| pixel(image[(u, v)])).collect()).collect()
    };
    let mut maps = images.map(shown);
    let mut shares = vec![];
    for step in &lpips.steps {
        maps = maps.map(|map| match step {
            Step::Convolution(layer, window) => convolved(&map, layer, *window),
            Step::Fire(layers) => {
                let one = Window { side: 1, stride: 1, border: 0 };
                let few = convolved(&map, &layers[0], one);
                let sides =
                    [convolved(&few, &layers[1], one), convolved(&few, &layers[2], Window { side: 3, stride: 1, border: 1 })];
                let [left, right] = sides;
                let join = |(a, b): (Vec<Vec<f64>>, Vec<Vec<f64>>)| a.into_iter().zip(b).map(|(a, b)| [a, b].concat()).collect();
                left.into_iter().zip(right).map(join).collect()
            }
            Step::Pool(pool) => pooled(&map, *pool),
            Step::Comparison(_) => map,
        });
        if let Step::Comparison(weights) = step {
            let unit = |f: &[f64]| -> Vec<f64> {
                let length = f.iter().map(|v| v * v).sum::<f64>().sqrt() + 1e-10;
                f.iter().map(|v| v / length).collect()
            };
            let pixels: Vec<_> = maps[0].iter().flatten().zip(maps[1].iter().flatten()).collect();
            let of = |(a, b): &(&Vec<f64>, &Vec<f64>)| -> f64 {
                unit(a).iter().zip(unit(b)).zip(weights).map(|((a, b), w)| f64::from(*w) * (a - b).powi(2)).sum()
            };
            shares.push(pixels.iter().map(of).sum::<f64>() / pixels.len() as f64);
        }
    }
    shares
}

#[test]
fn weights_by_chance_give_what_the_formula_gives() {
    let lpips = small();
    // Odd and even sizes, more pixels than a block; one as small as can be.
    for (width, height) in [(41, 37), (60, 44), (lpips.least_px(), lpips.least_px() + 1)] {
        let (a, b) = (photograph(1, width, height), photograph(2, width, height));
        for input in [LpipsInput::Signed, LpipsInput::Unit] {
            let (found, exact) = (lpips.layers(&a, &b, input), exact_layers(&lpips, [&a, &b], input));
            assert_eq!(found.len(), 3);
            assert!(exact.iter().all(|v| *v > 1e-3), "they see a difference: {exact:?}");
            assert!(found.iter().zip(&exact).all(|(a, b)| (a / b - 1.0).abs() < 1e-5), "{found:?} {exact:?}");
        }
    }
}

/// A network with every kind of step, more places and channels than a workgroup has and fewer, on memory that holds no numbers before; and the real one.
#[cfg(feature = "gpu")]
#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_gpu_finds_what_the_processor_finds() {
    let Some(context) = corf_gpu::testing::context(&corf_gpu::testing::OPTIONS) else { return };
    let context = std::sync::Arc::new(context);
    let compare = |lpips: &Lpips, [width, height]: [usize; 2]| {
        let on_gpu = LpipsOnGpu::new(&context, lpips).unwrap();
        let (a, b) = (photograph(1, width, height), photograph(2, width, height));
        for input in [LpipsInput::Signed, LpipsInput::Unit] {
            let (found, known) = (on_gpu.layers(&a, &b, input).unwrap(), lpips.layers(&a, &b, input));
            assert_eq!(found.len(), known.len());
            assert!(
                found.iter().zip(&known).all(|(a, b)| (a / b - 1.0).abs() < GPU_TOLERANCE),
                "{width}x{height}: {found:?} {known:?}"
            );
            assert_eq!(on_gpu.layers(&a, &b, input).unwrap(), found, "the same bytes each time");
            assert_eq!(on_gpu.distance(&a, &a, input).unwrap(), 0.0);
        }
    };
    let lpips = small();
    for size in [[41, 37], [160, 130], [lpips.least_px(), lpips.least_px() + 1]] {
        compare(&lpips, size);
    }
    for backbone in [Backbone::Alex, Backbone::Squeeze] {
        let Some(path) = shared(&format!("weights/lpips/{}", backbone.file())) else { return };
        compare(&Lpips::read(&path, backbone).unwrap(), [97, 64]);
    }
    match fetched(Backbone::Vgg) {
        Some(path) => compare(&Lpips::read(&path, Backbone::Vgg).unwrap(), [49, 40]),
        None => eprintln!("skipped VGG-16: {WEIGHTS_VARIABLE} names no folder of tools/fetch_weights.py"),
    }
}

#[test]
fn a_distance_is_one() {
    let lpips = small();
    let (a, b) = (photograph(3, 50, 40), photograph(4, 50, 40));
    for input in [LpipsInput::Signed, LpipsInput::Unit] {
        assert_eq!(lpips.distance(&a, &a, input), 0.0);
        assert_eq!(lpips.distance(&a, &b, input), lpips.distance(&b, &a, input));
        assert!(lpips.distance(&a, &b, input) > 0.01);
    }
    assert_ne!(lpips.distance(&a, &b, LpipsInput::Signed), lpips.distance(&a, &b, LpipsInput::Unit));
    // Features that are all 0 have no length to be divided by.
    let dead = Lpips {
        steps: vec![
            Step::Convolution(Layer { inputs: 27, outputs: 2, weights: vec![0.0; 54], bias: vec![0.0; 2] }, Window::three(1)),
            Step::Comparison(vec![1.0; 2]),
        ],
        ..small()
    };
    assert_eq!(dead.distance(&a, &b, LpipsInput::Signed), 0.0);
}

#[test]
fn the_same_bytes_come_of_any_number_of_threads() {
    let lpips = small();
    let (a, b) = (photograph(5, 96, 54), photograph(6, 96, 54));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| lpips.layers(&a, &b, LpipsInput::Signed))
    };
    let one = on(1);
    for threads in [2, 5] {
        assert_eq!(on(threads), one);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn files_that_are_not_the_weights_are_refused() {
    let Some(path) = shared("weights/lpips/lpips_alex.safetensors") else { return };
    let whole = std::fs::read(path).unwrap();
    let own = tempfile::tempdir().unwrap();
    let file = own.path().join("given.safetensors");
    let refused = |bytes: &[u8], backbone: Backbone, word: &str| {
        std::fs::write(&file, bytes).unwrap();
        let error = Lpips::read(&file, backbone).unwrap_err().to_string();
        assert!(
            error.contains("given.safetensors") && error.contains(word) && error.contains("fetch_weights.py"),
            "{word}: {error}"
        );
    };
    std::fs::write(&file, &whole).unwrap();
    let lpips = Lpips::read(&file, Backbone::Alex).unwrap();
    assert_eq!(lpips.sha256(), corf_scene::io::sha256_hex(&whole));
    assert_eq!(lpips.least_px(), 31);
    refused(&whole[..whole.len() - 1], Backbone::Alex, "cut short");
    refused(b"no tensors", Backbone::Alex, "not a readable safetensors file");
    refused(&whole, Backbone::Squeeze, "features.0.weight");
    // Of equal length, so that all offsets stay.
    let changed = |from: &str, to: &str| {
        let mut bytes = whole.clone();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    refused(&changed("[64,3,11,11]", "[64,11,3,11]"), Backbone::Alex, "has shape [64, 11, 3, 11]");
    refused(&changed("[64,3,11,11]", "[64,3,11,12]"), Backbone::Alex, "invalid shape");
    refused(&changed("lin4.weight", "lin5.weight"), Backbone::Alex, "`lin4.weight` is missing");
    let last_is = |value: f32| {
        let mut bytes = whole.clone();
        let at = bytes.len() - 4;
        bytes[at..].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    refused(&last_is(f32::NAN), Backbone::Alex, "NaN");
    refused(&last_is(1000.0), Backbone::Alex, "other weights");
    assert!(Lpips::read(&own.path().join("absent"), Backbone::Alex).unwrap_err().to_string().contains("absent"));
}
