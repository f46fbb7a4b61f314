//! One function of a kernel by itself, for tests against the processor's.

use super::super::LightCache;
use super::lattices::Tile;
use super::scene::{constants, tree, upload};
use super::{GpuLight, shaders};
use corf_gpu::{Context, Kernel};
use corf_scene::Result;

impl GpuLight<'_> {
    /// Runs a WGSL function `item(i)` for every i below `count`: it reads `asked` and writes `found`, of which it has `words`
    /// words each.
    pub fn probe(&self, item: &str, asked: &[u32], count: usize, words: usize) -> Result<Vec<u32>> {
        let kernel = Kernel::new(&self.context, "probe", &shaders::probe(&constants(self.tracer, &tree(self.tracer)), item))?;
        let asked = upload(&self.context, "asked", asked)?;
        let found = self.context.storage("found", 4 * (count * words) as u64)?;
        let bound = self.bind(&kernel, &[&asked, &found])?;
        let mut commands = self.commands("probing");
        commands.over(&bound, &self.params, count as u32);
        commands.submit();
        Ok(self.context.read::<u32>("probing", &[(&found, count * words)])?.remove(0))
    }

    /// The device, to let it fail.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Words of the coarse lattice's points, solved here and by the processor.
    pub fn coarse_of_both(&self, cache: LightCache<'_>) -> Result<[Vec<u32>; 2]> {
        match &self.state().lattices {
            Some(lattices) => lattices.both_coarse(cache),
            None => Ok([Vec::new(), Vec::new()]),
        }
    }

    /// Tiles of a field, filled here and by the processor.
    pub fn tiles_of_both(&self, field: u32, most: usize) -> Result<Vec<[Tile; 2]>> {
        match &mut self.state().lattices {
            Some(lattices) => lattices.both(self, &self.params, field, most),
            None => Ok(Vec::new()),
        }
    }

    /// Number in the scene of a triangle of the tree's leaves.
    pub fn number_of(&self, place: u32) -> Option<u32> {
        self.scene.place_of.iter().position(|p| *p == place && place != u32::MAX).map(|i| i as u32)
    }
}
