//! A compute kernel: WGSL in, a pipeline and its bindings out.

use super::context::Context;
use crate::{Error, Result};
use rayon::prelude::*;

/// One entry point with its bind group layout, read off the shader's own declarations.
pub(crate) struct Kernel {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Whether binding 0 is a uniform with a dynamic offset.
    has_uniform: bool,
    bindings: usize,
}

/// A kernel bound to its buffers: pipeline and bind group.
#[derive(Clone)]
pub(crate) struct Bound {
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
        // SAFETY: every loop of the shaders ends, and every index is below the size its buffer was made with; the tests run them
        // at odd sizes on poisoned memory.
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

    /// [`Self::new`] of several, at once: drivers take tenths of a second for one.
    pub fn all<const N: usize>(context: &Context, sources: [(&'static str, String); N]) -> Result<[Self; N]> {
        let kernels: Result<Vec<_>> = sources.par_iter().map(|(label, source)| Self::new(context, label, source)).collect();
        kernels?.try_into().map_err(|_| Error::invalid("gpu", "a kernel was lost", "this is a defect of the device"))
    }

    /// Binds buffers in the order of the shader's declarations; a uniform is `uniform` bytes long from its dynamic offset.
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
pub(crate) const ROW: u32 = 32768;
/// Bytes from one set of indirect arguments to the next.
pub(crate) const ARGS_STRIDE: u64 = 16;
