//! Comparing the answers of both sides, and explaining the differences.
//!
//! A difference is explained when rounding in the triangle test decides it: the two hits are at the same distance (a
//! shared edge, or coincident triangles), or the ray passes the triangle that one side missed within rounding of an
//! edge, as measured in f64 by the referee. Any other difference counts as unexplained, and is a bug on one side.

use mbkd::{Hit, Ray, TriangleMesh};
use mbkd_evidence::triangles::{corners, pass};

/// Allowance for rounding, in units of f32's relative precision: translations, shears and keys of both sides.
const ULPS: f64 = 64.0;

/// Counts over the rays of one kind.
#[derive(Clone, Copy, Default)]
pub struct Agreement {
    pub rays: usize,
    /// The same triangle, or none on both sides.
    pub same: usize,
    /// Largest distance between hits on the same triangle, relative to the scene's size.
    pub largest_gap: f64,
    /// Another triangle at the same distance.
    pub ties: usize,
    /// Ours hits a triangle within rounding of its edge that Embree misses, or the other way round.
    pub edge_only_ours: usize,
    pub edge_only_theirs: usize,
    /// All other differences.
    pub unexplained: usize,
}

/// The referee: the meshes, and the scene's size, which scales rounding errors.
pub struct Referee<'m> {
    pub meshes: &'m [TriangleMesh],
    pub size: f64,
}

impl Referee<'_> {
    /// Compares the closest hits of both sides.
    pub fn closest(&self, answers: impl Iterator<Item = (Ray, Option<Hit>, Option<Hit>)>) -> Agreement {
        let mut agreement = Agreement::default();
        for (ray, ours, theirs) in answers {
            agreement.rays += 1;
            let same_triangle = match (ours, theirs) {
                (None, None) => true,
                (Some(a), Some(b)) => (a.mesh, a.primitive) == (b.mesh, b.primitive),
                _ => false,
            };
            if same_triangle {
                agreement.same += 1;
                if let (Some(a), Some(b)) = (ours, theirs) {
                    let gap = f64::from((a.t - b.t).abs() * ray.dir.length()) / self.size;
                    agreement.largest_gap = agreement.largest_gap.max(gap);
                }
            } else {
                self.explain(&ray, ours, theirs, &mut agreement);
            }
        }
        agreement
    }

    /// Classifies a difference: the nearer hit is the one that the other side should have found too.
    fn explain(&self, ray: &Ray, ours: Option<Hit>, theirs: Option<Hit>, agreement: &mut Agreement) {
        let distance = |hit: Option<Hit>| hit.map_or(f64::INFINITY, |h| f64::from(h.t));
        let (a, b) = (distance(ours), distance(theirs));
        let Some(nearer) = (if a <= b { ours } else { theirs }) else { return };
        let reach = self.rounding(ray);
        let corners = corners(self.meshes, nearer.mesh, nearer.primitive, ray.time);
        let passage = pass(ray, corners);
        // Oblique planes magnify rounding along the ray; the comparison of t allows for that.
        let same_distance = (a - b).abs() * f64::from(ray.dir.length()) <= 16.0 * reach;
        let end = (passage.t - f64::from(ray.t_min)).abs().min((passage.t - f64::from(ray.t_max)).abs());
        let counter = if same_distance {
            &mut agreement.ties
        } else if passage.margin.abs() <= reach || end <= 16.0 * reach {
            if a < b { &mut agreement.edge_only_ours } else { &mut agreement.edge_only_theirs }
        } else {
            &mut agreement.unexplained
        };
        *counter += 1;
    }

    /// How far, in space, rounding may displace the ray from the triangle.
    fn rounding(&self, ray: &Ray) -> f64 {
        ULPS * f64::from(f32::EPSILON) * 0.5 * (self.size + ray.origin.abs().max_element())
    }
}
