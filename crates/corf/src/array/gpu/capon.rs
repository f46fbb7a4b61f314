//! Capon's spectra: between tables of waves or pixels and what is made of them stand matrices of the array's elements ([`super::super::capon`]).

use super::job::Job;
use super::shape::{Shape, TABLES};
use crate::Result;
use corf_gpu::{Bound, Context, Kernel};

/// Compiled kernels that make tables of forms of the inverse covariance from tables of waves.
pub(super) struct Inversion {
    covariance: Kernel,
    invert: Kernel,
    form: Kernel,
}

impl Inversion {
    /// None for another sensor than Capon's.
    pub fn new(context: &Context, shape: Shape) -> Result<Option<Self>> {
        if !shape.is_capon() {
            return Ok(None);
        }
        let sources = [
            ("covariances", shape.covariance()),
            ("invert covariances", shape.invert(context.limits.max_compute_workgroup_storage_size as usize)),
            ("forms of inverses", shape.form_of_inverses()),
        ];
        let [covariance, invert, form] = Kernel::all(context, sources)?;
        Ok(Some(Self { covariance, invert, form }))
    }

    /// To be run between the sums of tables and the spectrum.
    pub fn bind(&self, context: &Context, jobs: &wgpu::Buffer, buffers: [&wgpu::Buffer; 3]) -> Result<BoundInversion> {
        let [tables, matrices, totals] = buffers;
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, size_of::<Job>() as u64, buffers);
        Ok(BoundInversion {
            covariance: bind(&self.covariance, &[jobs, tables, matrices, totals])?,
            invert: bind(&self.invert, &[jobs, matrices])?,
            form: bind(&self.form, &[jobs, matrices, tables])?,
        })
    }
}

/// An [`Inversion`] bound to its buffers.
pub(super) struct BoundInversion {
    covariance: Bound,
    invert: Bound,
    form: Bound,
}

impl BoundInversion {
    /// Of so many receivers.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, at: u32, shape: Shape, receivers: usize) {
        self.covariance.run(pass, at, (receivers * shape.squared()).div_ceil(64) as u32);
        self.invert.run(pass, at, receivers as u32);
        self.form.run(pass, at, (receivers * 4 * shape.entries()).div_ceil(64) as u32);
    }
}

/// Compiled kernels that make tables of what pulls at waves from tables of pixels.
pub(super) struct Adjoint {
    matrix: Kernel,
    around: Kernel,
    form: Kernel,
}

impl Adjoint {
    /// None for another sensor than Capon's.
    pub fn new(context: &Context, shape: Shape) -> Result<Option<Self>> {
        if !shape.is_capon() {
            return Ok(None);
        }
        let sources = [
            ("matrices of pixels", shape.matrices_of_pixels()),
            ("matrices between inverses", shape.around()),
            ("forms of pulls", shape.form_of_pulls()),
        ];
        let [matrix, around, form] = Kernel::all(context, sources)?;
        Ok(Some(Self { matrix, around, form }))
    }

    /// To be run between the sums of tables and the pulls.
    pub fn bind(
        &self,
        context: &Context,
        shape: Shape,
        jobs: &wgpu::Buffer,
        buffers: [&wgpu::Buffer; 2],
    ) -> Result<BoundAdjoint> {
        let [tables, inverse] = buffers;
        let bytes = (4 * TABLES * shape.squared()) as u64;
        let matrices = context.storage("matrices of pixels", bytes)?;
        let products = context.storage("products with an inverse", bytes)?;
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, size_of::<Job>() as u64, buffers);
        Ok(BoundAdjoint {
            matrix: bind(&self.matrix, &[jobs, tables, &matrices])?,
            around: [
                bind(&self.around, &[jobs, inverse, &matrices, &products])?,
                bind(&self.around, &[jobs, inverse, &products, &matrices])?,
            ],
            form: bind(&self.form, &[jobs, &matrices, tables])?,
        })
    }
}

/// An [`Adjoint`] bound to its buffers.
pub(super) struct BoundAdjoint {
    matrix: Bound,
    around: [Bound; 2],
    form: Bound,
}

impl BoundAdjoint {
    /// Of both losses.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, at: u32, shape: Shape) {
        let groups = (TABLES * shape.squared()).div_ceil(64) as u32;
        self.matrix.run(pass, at, groups);
        self.around.iter().for_each(|product| product.run(pass, at, groups));
        self.form.run(pass, at, (TABLES * 4 * shape.entries()).div_ceil(64) as u32);
    }
}
