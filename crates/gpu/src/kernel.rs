//! A compute kernel: WGSL in, a pipeline and its bindings out.

use crate::context::Context;
use corf_scene::{Error, Result};

/// One entry point with its bind group layout, read off the shader's own declarations.
pub struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Whether binding 0 is a uniform with a dynamic offset.
    has_uniform: bool,
    bindings: usize,
}

/// A kernel bound to its buffers: pipeline and bind group.
#[derive(Clone)]
pub struct Bound {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    has_uniform: bool,
}

/// The kinds of `@group(0)` bindings in order of their numbers.
fn declared(source: &str) -> Vec<wgpu::BufferBindingType> {
    let kind = |line: &str| {
        if line.contains("var<uniform>") {
            wgpu::BufferBindingType::Uniform
        } else {
            wgpu::BufferBindingType::Storage { read_only: !line.contains("read_write") }
        }
    };
    source.lines().filter(|l| l.starts_with("@group(0)")).map(kind).collect()
}

impl Kernel {
    /// Compiles `main` of a shader whose bindings are declared one a line, in order from 0, a uniform only at 0 (with a dynamic offset).
    ///
    /// Nothing is checked while it runs: every loop must end, and every index be below the size of what it reads or writes.
    ///
    /// # Errors
    /// The compiler's, which would be a defect of the shader.
    pub fn new(context: &Context, label: &'static str, source: &str) -> Result<Self> {
        let kinds = declared(source);
        let entries: Vec<_> = kinds
            .iter()
            .enumerate()
            .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
                binding: binding as u32,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: *ty,
                    has_dynamic_offset: *ty == wgpu::BufferBindingType::Uniform,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let device = &context.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(label), source: wgpu::ShaderSource::Wgsl(source.into()) };
        // SAFETY: this crate's users keep to what the function's documentation asks for; their tests run the kernels at odd sizes on
        // poisoned memory.
        let module = unsafe { device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked()) };
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        context.check(&format!("compiling {label}"))?;
        let has_uniform = kinds.first() == Some(&wgpu::BufferBindingType::Uniform);
        Ok(Self { label, pipeline, layout, has_uniform, bindings: kinds.len() })
    }

    /// [`Self::new`] of several, each on a thread of its own, for drivers take tenths of a second for one. The threads are not those of the pool, which
    /// may be busy with other work meanwhile.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn all<const N: usize>(context: &Context, sources: [(&'static str, String); N]) -> Result<[Self; N]> {
        let lost = || Error::invalid("gpu", "a kernel was lost", "this is a defect of the device");
        let kernels: Result<Vec<Self>> = std::thread::scope(|scope| {
            let threads: Vec<_> =
                sources.iter().map(|(label, source)| scope.spawn(move || Self::new(context, label, source))).collect();
            threads.into_iter().map(|thread| thread.join().map_err(|_| lost())?).collect()
        });
        kernels?.try_into().map_err(|_| lost())
    }

    /// Binds buffers in the order of the shader's declarations; a uniform is `uniform` bytes long from its dynamic offset.
    ///
    /// # Errors
    /// Another number of buffers than the shader declares.
    pub fn bind(&self, context: &Context, uniform: u64, buffers: &[&wgpu::Buffer]) -> Result<Bound> {
        if buffers.len() != self.bindings {
            let what = format!("{} buffers for the {} bindings of {}", buffers.len(), self.bindings, self.label);
            return Err(Error::invalid("gpu", what, "this is a defect of the device"));
        }
        let entries: Vec<_> = buffers
            .iter()
            .enumerate()
            .map(|(binding, buffer)| {
                let size = (binding == 0 && self.has_uniform).then(|| std::num::NonZeroU64::new(uniform)).flatten();
                let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size });
                wgpu::BindGroupEntry { binding: binding as u32, resource }
            })
            .collect();
        let group = context.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.label),
            layout: &self.layout,
            entries: &entries,
        });
        Ok(Bound { pipeline: self.pipeline.clone(), group, has_uniform: self.has_uniform })
    }
}

impl Bound {
    fn set(&self, pass: &mut wgpu::ComputePass<'_>, offset: u32) {
        pass.set_pipeline(&self.pipeline);
        let offsets = [offset];
        pass.set_bind_group(0, &self.group, if self.has_uniform { &offsets } else { &[] });
    }

    /// Runs `groups` workgroups with the uniform at `offset`, in rows of at most [`ROW`]; kernels take `id.y · ROW + id.x` as their number.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, offset: u32, groups: u32) {
        self.set(pass, offset);
        pass.dispatch_workgroups(groups.min(ROW), groups.div_ceil(ROW), 1);
    }

    /// Runs the kernel as [`Self::run`] does, with the number of workgroups from a buffer (indirect dispatch).
    pub fn run_indirect(&self, pass: &mut wgpu::ComputePass<'_>, offset: u32, args: &wgpu::Buffer, slot: u64) {
        self.set(pass, offset);
        pass.dispatch_workgroups_indirect(args, slot * ARGS_STRIDE);
    }
}

/// Workgroups per row of a dispatch.
pub const ROW: u32 = 32768;
/// Bytes from one set of indirect arguments to the next.
pub const ARGS_STRIDE: u64 = 16;
/// Bytes from one set of constants to the next in a uniform that kernels read at dynamic offsets: a multiple of what any adapter asks for.
pub const UNIFORM_STRIDE: u64 = 256;

/// WGSL of `group_number(id)`: the number of a workgroup in a dispatch that is folded into rows of [`ROW`].
pub const GROUP_NUMBER: &str = include_str!("shaders/group_number.wgsl");
/// WGSL of `sin_cos(x)`: sine and cosine that are right, and equal, on every adapter.
pub const SIN_COS: &str = include_str!("shaders/sin_cos.wgsl");

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::testing::{OPTIONS, context};

    #[test]
    fn bindings_are_read_off_a_shaders_declarations() {
        let source = "@group(0) @binding(0) var<uniform> c: vec4<u32>;\n\
            @group(0) @binding(1) var<storage> a: array<f32>;\n@group(0) @binding(2) var<storage, read_write> b: array<f32>;\n";
        let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
        assert_eq!(declared(source), [wgpu::BufferBindingType::Uniform, storage(true), storage(false)]);
    }

    /// More workgroups than a row has, each with a number of its own; sines against those of f64; a uniform at its second place.
    #[test]
    #[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
    fn a_kernel_computes_what_its_shader_says() {
        const GROUPS: u32 = 2 * ROW + 5;
        /// Numbers of some units in the last place near 1, at arguments that are exact.
        const TOLERANCE: f64 = 3e-7;
        let Some(context) = context(&OPTIONS) else { return };
        let source = format!(
            "@group(0) @binding(0) var<uniform> scale: vec4<f32>;\n\
             @group(0) @binding(1) var<storage, read_write> out: array<vec2<f32>>;\n{GROUP_NUMBER}{SIN_COS}\
             @compute @workgroup_size(1)\nfn main(@builtin(workgroup_id) id: vec3<u32>) {{\n\
             let i = group_number(id);\nif (i < {GROUPS}u) {{ out[i] = sin_cos(f32(i) * scale.x); }}\n}}\n"
        );
        let [kernel] = Kernel::all(&context, [("test", source)]).unwrap();
        let uniform = context.buffer("constants", 2 * UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM).unwrap();
        context.fill(&uniform, UNIFORM_STRIDE, &[1.0_f32 / 64.0, 0.0, 0.0, 0.0]);
        let out = context.storage("numbers", u64::from(GROUPS) * 8).unwrap();
        let bound = kernel.bind(&context, 16, &[&uniform, &out]).unwrap();
        let mut encoder = context.encoder();
        bound.run(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()), UNIFORM_STRIDE as u32, GROUPS);
        context.submit(encoder);
        let read = context.read::<f32>("a test", &[(&out, 2 * GROUPS as usize)]).unwrap();
        for (i, pair) in read[0].chunks_exact(2).enumerate() {
            let (sin, cos) = (i as f64 / 64.0).sin_cos();
            let error = (f64::from(pair[0]) - sin).abs().max((f64::from(pair[1]) - cos).abs());
            assert!(error < TOLERANCE, "{i}: {pair:?} for {sin} {cos}");
        }
        assert!(kernel.bind(&context, 16, &[&out]).is_err(), "a buffer is missing");
    }

    #[test]
    #[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
    fn a_shader_that_is_none_is_an_error_and_the_device_works_on() {
        let Some(context) = context(&OPTIONS) else { return };
        let text = Kernel::new(&context, "nonsense", "fn main() { return 1; }").err().unwrap().to_string();
        assert!(text.contains("compiling nonsense"), "{text}");
        context.check("going on").unwrap();
    }
}
