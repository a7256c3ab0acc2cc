//! The distinct vertices of a few triangles.

use crate::primitive::triangles::triangle_set::Triangles;
use crate::simd::{Kernel, LANES, Lanes, Simd, SimdLevel, dispatch, first_lanes};

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
        dispatch(SimdLevel::best(), Distinct { set, ids })
    }
}

struct Distinct<'a> {
    set: &'a Triangles,
    ids: &'a [u32],
}

impl Kernel for Distinct<'_> {
    type Output = (Shared, usize);

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> (Shared, usize) {
        let Distinct { set, ids } = self;
        let mut shared = Shared { vertices: [0; LANES], strides: [0; LANES], count: 0, corners: [0; LANES] };
        let (mut vertices, mut strides, mut triangles) = (s.splat_u(0), s.splat_u(0), 0);
        'all: for (corners, &id) in shared.corners.iter_mut().zip(ids) {
            let stride = s.splat_u(set.stride(id) as u32);
            let mut places = 0;
            for (i, vertex) in set.vertices(id).into_iter().enumerate() {
                let vertex = s.splat_u(vertex);
                let known = s.eq_u(vertices, vertex) & first_lanes(shared.count);
                let place = match known {
                    0 if shared.count == LANES => break 'all,
                    0 => {
                        let lane = 1 << shared.count;
                        (vertices, strides) = (s.select_u(lane, vertex, vertices), s.select_u(lane, stride, strides));
                        shared.count += 1;
                        shared.count as u32 - 1
                    }
                    _ => known.trailing_zeros(),
                };
                places |= place << (4 * i);
            }
            *corners = places;
            triangles += 1;
        }
        s.store_u(vertices, &mut shared.vertices);
        s.store_u(strides, &mut shared.strides);
        (shared, triangles)
    }
}
