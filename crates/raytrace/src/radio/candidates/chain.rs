//! A sequence of mirrors, and the image of the transmitter behind its last one.

use crate::radio::MAX_INTERACTIONS;
use crate::radio::geometry::Geometry;
use glam::DVec3;

/// The faces of a specular path in TX → RX order, with the transmitter's image behind the last one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    faces: [u32; MAX_INTERACTIONS],
    length: u8,
    /// The transmitter mirrored in every face in turn.
    pub image: DVec3,
}

impl Chain {
    /// The faces, TX → RX.
    pub fn faces(&self) -> &[u32] {
        &self.faces[..self.length as usize]
    }

    /// The line of sight: no face at all.
    pub fn line_of_sight(tx: DVec3) -> Self {
        Self { faces: [u32::MAX; MAX_INTERACTIONS], length: 0, image: tx }
    }

    /// Image sources by face: the transmitter mirrored in all faces before that one. Entries behind the last face have no meaning.
    pub fn images(&self, geometry: &Geometry<'_>, tx: DVec3) -> [DVec3; MAX_INTERACTIONS] {
        let faces = self.faces();
        let mut images = [tx; MAX_INTERACTIONS];
        for i in 1..faces.len() {
            images[i] = geometry.faces[faces[i - 1] as usize].mirror(images[i - 1]);
        }
        images
    }

    /// Sorting key, equal for equal chains from one transmitter only: the number of faces, and the faces.
    pub(in crate::radio) fn sort_key(&self) -> (u8, [u32; MAX_INTERACTIONS]) {
        (self.length, self.faces)
    }

    /// The chain with one more face.
    pub fn pushed(&self, face: u32, geometry: &Geometry<'_>) -> Self {
        let mut next = *self;
        next.faces[self.length as usize] = face;
        next.length += 1;
        next.image = geometry.faces[face as usize].mirror(self.image);
        next
    }
}

/// Whether a face lies in the plane of the last bounce: nothing bounces off a plane twice in a row.
pub fn repeats(geometry: &Geometry<'_>, chain: &Chain, face: u32) -> bool {
    let Some(&last) = chain.faces().last() else { return false };
    last == face || geometry.faces[last as usize].shares_plane(&geometry.faces[face as usize])
}
