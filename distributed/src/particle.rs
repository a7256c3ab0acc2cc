//! Particles as ranks hold and send them.

use bytemuck::{Pod, Zeroable};
use mbkd::PointSet;
use mbkd::glam::{DVec3, Vec3};

/// A particle on a straight way during a step.
///
/// ```
/// use mbkd_distributed::Particle;
/// let p = Particle { id: 7, open: [0.0; 3], close: [1.0, 0.0, 0.0] };
/// assert_eq!(Particle::fixed(7, [0.0; 3]).close, p.open);
/// ```
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Particle {
    /// Its number among the particles of all ranks. Numbers may have gaps; that none occurs twice is not checked, and
    /// answers then name both particles alike.
    pub id: u64,
    /// Position when the step begins, at time 0.
    pub open: [f32; 3],
    /// Position when the step ends, at time 1.
    pub close: [f32; 3],
}

impl Particle {
    /// A particle that stays where it is.
    pub fn fixed(id: u64, at: [f32; 3]) -> Particle {
        Particle { id, open: at, close: at }
    }
}

/// Particles as the set of points that trees are built of; a point's id is its index.
pub(crate) struct Points<'a>(pub(crate) &'a [Particle]);

impl PointSet for Points<'_> {
    const WIDE: bool = false;
    fn len(&self) -> usize {
        self.0.len()
    }
    fn keys(&self) -> usize {
        2
    }
    fn position(&self, point: usize, key: usize) -> DVec3 {
        let particle = &self.0[point];
        Vec3::from_array(if key == 0 { particle.open } else { particle.close }).as_dvec3()
    }
}
