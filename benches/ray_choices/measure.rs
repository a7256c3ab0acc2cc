//! Trees and their times: two trees answer the same rays in alternation.

use mbkd::{BuildError, BuildParams, Counters, Hit, RayTree, TriangleMesh};
use mbkd_evidence::scene_rays::{Kind, Rays};
use mbkd_evidence::timing::{median, timed};
use std::fmt;
use std::hint::black_box;

/// The columns of all tables: each kind of ray, as single rays and as a batch.
pub const COLUMNS: &str = "camera | bounce | occlusion | camera, batch | bounce, batch | occlusion, batch";
const KINDS: [Kind; 3] = [Kind::Primary, Kind::Bounce, Kind::Ao];

/// A tree and its build time.
pub struct Built {
    pub tree: RayTree,
    pub seconds: f64,
}

impl Built {
    pub fn new(meshes: &[TriangleMesh], params: &BuildParams) -> Result<Built, BuildError> {
        let (tree, seconds) = timed(|| RayTree::build(meshes, params));
        Ok(Built { tree: tree?, seconds })
    }

    /// Bytes of the tree per triangle.
    pub fn bytes_per(&self, triangles: usize) -> f64 {
        self.tree.statistics().bytes as f64 / triangles as f64
    }

    /// Steps and tests of all rays, as single queries.
    pub fn work(&self, rays: &Rays) -> [Counters; 3] {
        KINDS.map(|kind| {
            let mut counters = Counters::default();
            for ray in rays.of(kind) {
                match kind {
                    Kind::Ao => _ = self.tree.any_hit_observed(ray, &mut counters),
                    _ => _ = self.tree.closest_hit_observed(ray, &mut counters),
                }
            }
            counters
        })
    }

    /// Seconds for all rays of a kind.
    fn seconds(&self, rays: &Rays, kind: Kind, batch: bool, answers: &mut Answers) -> f64 {
        let rays = rays.of(kind);
        let ((), seconds) = timed(|| match (batch, kind) {
            (true, Kind::Ao) => self.tree.any_hits(rays, &mut answers.any),
            (true, _) => self.tree.closest_hits(rays, &mut answers.closest),
            (false, Kind::Ao) => {
                answers.any.clear();
                answers.any.extend(rays.iter().map(|ray| self.tree.any_hit(ray)));
            }
            (false, _) => {
                answers.closest.clear();
                answers.closest.extend(rays.iter().map(|ray| self.tree.closest_hit(ray)));
            }
        });
        black_box(answers);
        seconds
    }
}

/// Buffers for answers, reused from round to round: the allocation of fresh memory would be timed as well.
#[derive(Default)]
struct Answers {
    closest: Vec<Option<Hit>>,
    any: Vec<bool>,
}

/// A figure for each column.
#[derive(Clone, Copy)]
pub struct Row(pub [f64; 6]);

impl Row {
    /// The cell-wise maximum.
    pub fn max(self, other: Row) -> Row {
        Row(std::array::from_fn(|i| self.0[i].max(other.0[i])))
    }

    /// The speed of `a` relative to `b`: medians of `runs` alternating rounds, after an untimed one.
    pub fn speed(a: &Built, b: &Built, rays: &Rays, runs: u32) -> Row {
        let mut answers = Answers::default();
        Row(std::array::from_fn(|i| {
            let mut time = |built: &Built| built.seconds(rays, KINDS[i % 3], i >= 3, &mut answers);
            time(a);
            time(b);
            median((0..runs).map(|run| {
                // The second tree may find less of itself in the caches, or more of the rays: the order alternates.
                let (a, b) = if run % 2 == 0 {
                    (time(a), time(b))
                } else {
                    let b = time(b);
                    (time(a), b)
                };
                b / a
            }))
        }))
    }

    /// The speed of batches relative to single rays.
    pub fn batches(built: &Built, rays: &Rays, runs: u32) -> Row {
        let mut answers = Answers::default();
        let mut row = Row([f64::NAN; 6]);
        for (i, kind) in KINDS.into_iter().enumerate() {
            let mut time = |batch: bool| built.seconds(rays, kind, batch, &mut answers);
            time(false);
            time(true);
            row.0[3 + i] = median((0..runs).map(|_| time(false) / time(true)));
        }
        row
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cells = self.0.map(|x| if x.is_nan() { "-".into() } else { format!("{x:.2}") });
        f.write_str(&cells.join(" | "))
    }
}
