//! Words of a buffer of the GPU, written as WGSL lays its structs out.

use glam::{Vec2, Vec3};

/// A buffer's words.
#[derive(Default)]
pub(super) struct Words(pub Vec<u32>);

impl Words {
    pub fn u(&mut self, value: u32) -> &mut Self {
        self.0.push(value);
        self
    }

    pub fn f(&mut self, value: f32) -> &mut Self {
        self.u(value.to_bits())
    }

    pub fn v2(&mut self, value: Vec2) -> &mut Self {
        self.f(value.x).f(value.y)
    }

    /// Three words; what follows takes the fourth.
    pub fn v3(&mut self, value: Vec3) -> &mut Self {
        self.f(value.x).f(value.y).f(value.z)
    }

    /// A 64-bit integer, low word first.
    pub fn u64(&mut self, value: u64) -> &mut Self {
        self.u(value as u32).u((value >> 32) as u32)
    }
}
