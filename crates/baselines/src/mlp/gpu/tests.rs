//! Networks on a GPU against the same in double precision on the processor.

#![allow(clippy::unwrap_used)]

use super::*;
use corf_gpu::AdapterOptions;
use corf_gpu::testing::{OPTIONS, context};
use corf_scene::Rng;

/// Parts of weight gradients: five, one more than are added up at once and short.
const ROWS: usize = 4 * 1024 + 90;

/// Every tile and activation, a skip, branches, widths that are no multiples of four.
fn network() -> (Network, [LayerInput; 2]) {
    network_of([Activation::Relu, Activation::LeakyRelu])
}

fn network_of([first, second]: [Activation; 2]) -> (Network, [LayerInput; 2]) {
    let mut n = Network::new(&[63, 5]);
    let a = n.add(&[LayerInput::Input(0)], 130, first);
    let b = n.add(&[LayerInput::Input(0), a], 135, second);
    let c = n.add(&[b], 24, Activation::Sigmoid);
    let first = n.add(&[b, c], 2, Activation::Identity);
    let d = n.add(&[c, LayerInput::Input(1)], 67, Activation::Identity);
    let second = n.add(&[d], 9, Activation::Identity);
    (n, [first, second])
}

fn drawn(count: usize, seed: u64) -> Vec<f32> {
    let mut rng = Rng::keyed(seed, 0, 0);
    (0..count).map(|_| rng.normal() as f32).collect()
}

/// Rows of numbers, filled up with zeros.
fn filled_up(values: &[f32], width: usize) -> Vec<f32> {
    let row = |row: &[f32]| row.iter().copied().chain(std::iter::repeat(0.0)).take(LANES * vectors(width)).collect::<Vec<_>>();
    values.chunks_exact(width).flat_map(row).collect()
}

fn widened(values: &[f32]) -> Vec<f64> {
    values.iter().map(|v| f64::from(*v)).collect()
}

/// Largest difference as a share of the largest number.
fn error(found: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let error = found.iter().zip(expected).fold(0.0, |m: f64, (a, b)| {
        let difference = (f64::from(*a) - b).abs();
        assert!(difference.is_finite(), "{a} {b}");
        m.max(difference)
    });
    error / largest
}

struct Passed {
    values: [Vec<f32>; 2],
    gradient: Vec<f32>,
    after: Trained<f32>,
}

const RATE: f64 = 1e-2;

/// Forward, backward twice over the same rows, a step.
fn on_gpu(
    context: &Context,
    (network, names): &(Network, [LayerInput; 2]),
    parameters: &[f32],
    inputs: &[Vec<f32>],
    heads: &[Vec<f32>; 2],
) -> Passed {
    let mut gpu = GpuNetwork::new(context, network, parameters, Adam::with_decay(1e-3), ROWS).unwrap();
    for ((buffer, values), width) in gpu.inputs.iter().zip(inputs).zip(network.inputs()) {
        context.fill(buffer, 0, &filled_up(values, *width));
    }
    for (head, values) in names.iter().zip(heads) {
        context.fill(gpu.head_gradient(*head), 0, &filled_up(values, network.width(*head)));
    }
    gpu.begin_step(context, RATE);
    let mut encoder = context.encoder();
    gpu.clear_gradient(&mut encoder);
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        gpu.forward(&mut pass);
        gpu.backward(&mut pass);
        gpu.forward(&mut pass);
        gpu.backward(&mut pass);
        gpu.adam(&mut pass);
    }
    context.submit(encoder);
    let values = names.map(|head| {
        let (width, vectors) = (network.width(head), vectors(network.width(head)));
        let read = context.read::<f32>("test", &[(gpu.values(head), LANES * vectors * ROWS)]).unwrap();
        read[0].chunks_exact(LANES * vectors).flat_map(|row| row[..width].to_vec()).collect()
    });
    Passed { values, gradient: gpu.gradient(context).unwrap(), after: gpu.state(context).unwrap() }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn passes_and_steps_are_those_of_the_processor() {
    let Some(context) = context(&OPTIONS) else { return };
    // A number is a sum of at most some 4000 products whose roundings (6e-8) mostly cancel.
    passes_and_steps_are_exact_to(&context, &network(), 1.0, 5e-6);
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn half_precision_is_as_exact_as_its_numbers() {
    let Some(context) = context(&AdapterOptions { half: true, ..OPTIONS }) else { return };
    if !context.matrix_units {
        println!("skipped: no matrix units");
        return;
    }
    // Factors have 11 bits (5e-4 is half the last one), and pass through three layers. Gradients of the second size are below f16's smallest number.
    // Without kinks: a rounding that moves one row in a thousand over a kink moves a sum over rows, whose parts mostly cancel, by √(1/1000).
    let smooth = network_of([Activation::Identity; 2]);
    for size in [1.0, 1e-10] {
        passes_and_steps_are_exact_to(&context, &smooth, size, 3e-3);
    }
}

/// Everything against double precision, with gradients of that size.
fn passes_and_steps_are_exact_to(context: &Context, shape: &(Network, [LayerInput; 2]), size: f32, tolerance: f64) {
    let (network, names) = shape;
    let parameters: Vec<f32> = network.initial(3);
    let inputs: Vec<Vec<f32>> = network.inputs().iter().enumerate().map(|(i, w)| drawn(w * ROWS, i as u64)).collect();
    let heads = names.map(|h| {
        let drawn = drawn(network.width(h) * ROWS, 10 + network.width(h) as u64);
        drawn.into_iter().map(|v| size * v).collect::<Vec<_>>()
    });
    let gpu = on_gpu(context, shape, &parameters, &inputs, &heads);

    let exact: Vec<Vec<f64>> = inputs.iter().map(|i| widened(i)).collect();
    let exact: Vec<&[f64]> = exact.iter().map(Vec::as_slice).collect();
    let wide = widened(&parameters);
    let tape = network.forward(&wide, &exact, ROWS);
    let mut gradient = vec![0.0; network.parameters()];
    for _ in 0..2 {
        network.backward(&wide, &exact, &tape, names.iter().copied().zip(heads.iter().map(|h| widened(h))), &mut gradient);
    }
    for (head, values) in names.iter().zip(&gpu.values) {
        let e = error(values, tape.of(*head));
        assert!(e < tolerance, "{head:?}: {e:e}");
    }
    for (l, layer) in network.layers().iter().enumerate() {
        for (name, range) in [("weights", layer.weights()), ("biases", layer.bias())] {
            let e = error(&gpu.gradient[range.clone()], &gradient[range]);
            assert!(e < tolerance, "{name} of layer {l}: {e:e}");
        }
    }
    let mut trained = Trained::new(wide);
    // With the GPU's gradient: a first step is its sign, whatever its size.
    Adam::with_decay(1e-3).step(&mut trained, &widened(&gpu.gradient), RATE);
    assert_eq!(gpu.after.steps, 1);
    assert!(error(&gpu.after.parameters, &trained.parameters) < 1e-6);
    for (found, expected) in gpu.after.moments.iter().zip(&trained.moments) {
        assert!(error(found, expected) < 1e-6);
    }

    let again = on_gpu(context, shape, &parameters, &inputs, &heads);
    assert!(again.gradient == gpu.gradient && again.after == gpu.after, "the same bytes each time");
}

/// Matrix units are rare where tests run: that their kernels are well-formed is checked without.
#[test]
fn kernels_in_half_precision_are_valid() {
    use wgpu::naga::{front::wgsl, valid};
    for product in Product::ALL {
        for tile in Tile::large(gemm::Arithmetic::Half) {
            let source = gemm::source(product, tile);
            let module = wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
            let mut validator = valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::all());
            validator.validate(&module).unwrap_or_else(|e| panic!("{}: {}", product.name(), e.emit_to_string(&source)));
        }
    }
}

#[test]
#[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
fn a_restored_network_is_the_one_that_was_read() {
    let Some(context) = context(&OPTIONS) else { return };
    let (network, _) = network();
    let count = network.parameters();
    let state = Trained { parameters: drawn(count, 1), moments: [drawn(count, 2), drawn(count, 3)], steps: 7 };
    let mut gpu = GpuNetwork::new(&context, &network, &drawn(count, 4), Adam::with_decay(0.0), 8).unwrap();
    gpu.restore(&context, &state).unwrap();
    assert!(gpu.state(&context).unwrap() == state);
}

#[test]
fn what_the_kernels_are_not_written_for_is_refused() {
    let mut head = Network::new(&[4]);
    head.add(&[LayerInput::Input(0)], 4, Activation::Relu);
    let mut inside = Network::new(&[4]);
    let x = inside.add(&[LayerInput::Input(0)], 5, Activation::Sigmoid);
    inside.add(&[x], 4, Activation::Identity);
    for network in [head, inside] {
        assert!(check(&network).unwrap_err().to_string().contains("multiples of 4"));
    }
    check(&network().0).unwrap();
}
