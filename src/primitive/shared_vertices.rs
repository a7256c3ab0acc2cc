//! The distinct vertices of a few triangles.

use super::triangles::Triangles;
use crate::simd::{LANES, Lanes};

/// The distinct vertices of up to sixteen triangles, one per lane.
pub(crate) struct Shared {
    /// Their indices, and the stride between their keys.
    pub vertices: Lanes<u32>,
    pub strides: Lanes<u32>,
    pub count: usize,
    /// The vertices of each triangle, four bits each.
    pub corners: Lanes<u32>,
}

impl Shared {
    /// Returns `None` if there are too many, or as many as corners: then a leaf block has no shared vertices.
    pub fn of(set: &Triangles, ids: &[u32]) -> Option<Shared> {
        let (shared, triangles) = Shared::of_first(set, ids);
        (triangles == ids.len() && shared.count < 3 * triangles).then_some(shared)
    }

    /// The vertices of the first triangles, of as many as there are lanes for; and the number of these triangles.
    pub fn of_first(set: &Triangles, ids: &[u32]) -> (Shared, usize) {
        let mut shared = Shared { vertices: [0; LANES], strides: [0; LANES], count: 0, corners: [0; LANES] };
        // A bit set of hashed vertices seen so far (a Bloom filter), so that most new vertices need no search.
        let mut seen = 0u64;
        for (triangle, &id) in ids.iter().enumerate().take(LANES) {
            let stride = set.stride(id) as u32;
            let mut corners = 0;
            for (i, vertex) in set.vertices(id).into_iter().enumerate() {
                let bit = 1u64 << (vertex % 64);
                let known = match seen & bit {
                    0 => None,
                    _ => shared.vertices[..shared.count].iter().position(|&v| v == vertex),
                };
                seen |= bit;
                let place = match known {
                    Some(place) => place,
                    None if shared.count == LANES => return (shared, triangle),
                    None => {
                        shared.vertices[shared.count] = vertex;
                        shared.strides[shared.count] = stride;
                        shared.count += 1;
                        shared.count - 1
                    }
                };
                corners |= (place as u32) << (4 * i);
            }
            shared.corners[triangle] = corners;
        }
        (shared, ids.len().min(LANES))
    }
}
