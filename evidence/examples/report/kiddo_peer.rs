//! kiddo as those use it who have moving points: it knows none, so they choose what to give up.

use kiddo::SquaredEuclidean;
use kiddo::leaf_strategy::FlatVec;
use kiddo::stem_strategy::Eytzinger;
use mbkd::MovingPoint;
use mbkd::glam::Vec3;
use mbkd_evidence::point_sets::{Query, place};
use std::error::Error;
use std::hint::black_box;
use std::num::NonZero;
use std::time::Instant;

type Arena = kiddo::ImmutableKdTree<f32, 3>;
type Flat = kiddo::KdTree<f32, u32, Eytzinger, FlatVec<f32, u32, 3, 32>, 3, 32>;

/// Which of two kinds of leaves kiddo is built with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Leaves {
    /// Its default.
    Arena,
    /// Columns of points one behind the other.
    Flat,
}

/// A kiddo tree over points that stand still.
pub enum KiddoTree {
    /// Arena leaves.
    Arena(Arena),
    /// Flat leaves.
    Flat(Flat),
}

impl KiddoTree {
    /// The tree of these points; their ids are their indices.
    pub fn build(points: &[[f32; 3]], leaves: Leaves) -> Result<KiddoTree, Box<dyn Error>> {
        let failed = |e: &dyn std::fmt::Debug| format!("kiddo could not be built: {e:?}");
        Ok(match leaves {
            Leaves::Arena => KiddoTree::Arena(Arena::new_from_slice(points).map_err(|e| failed(&e))?),
            Leaves::Flat => KiddoTree::Flat(Flat::new_from_slice(points).map_err(|e| failed(&e))?),
        })
    }

    /// Calls `each` with id and squared distance of the `k` nearest, nearest first.
    pub fn nearest(&self, at: Vec3, k: usize, mut each: impl FnMut(u32, f32)) {
        let (at, k) = (at.to_array(), NonZero::new(k).unwrap_or(NonZero::<usize>::MIN));
        match self {
            KiddoTree::Arena(tree) => {
                let found = tree.query(&at).nearest_n::<SquaredEuclidean<f32>>(k).execute();
                found.iter().for_each(|n| each(n.item, n.distance));
            }
            KiddoTree::Flat(tree) => {
                let found = tree.query(&at).nearest_n::<SquaredEuclidean<f32>>(k).execute();
                found.iter().for_each(|n| each(n.item, n.distance));
            }
        }
    }

    /// Calls `each` with id and squared distance of all within a radius.
    pub fn within(&self, at: Vec3, radius: f32, mut each: impl FnMut(u32, f32)) {
        let (at, square) = (at.to_array(), radius * radius);
        match self {
            KiddoTree::Arena(tree) => {
                let query = tree.query(&at).within::<SquaredEuclidean<f32>>(square).unsorted();
                query.visit(|n| each(n.item, n.distance));
            }
            KiddoTree::Flat(tree) => {
                let query = tree.query(&at).within::<SquaredEuclidean<f32>>(square).unsorted();
                query.visit(|n| each(n.item, n.distance));
            }
        }
    }

    /// The kind of leaves with which searches among these points are faster.
    pub fn faster_leaves(points: &[[f32; 3]], queries: &[Query], k: usize) -> Result<Leaves, Box<dyn Error>> {
        let trees = [KiddoTree::build(points, Leaves::Arena)?, KiddoTree::build(points, Leaves::Flat)?];
        let mut best = [f64::INFINITY; 2];
        for _ in 0..5 {
            for (tree, best) in trees.iter().zip(&mut best) {
                let start = Instant::now();
                queries.iter().for_each(|(at, _)| tree.nearest(*at, k, |id, _| _ = black_box(id)));
                *best = best.min(start.elapsed().as_secs_f64());
            }
        }
        Ok(if best[1] < best[0] { Leaves::Flat } else { Leaves::Arena })
    }
}

/// A tree for each of so many times; a query is answered from the nearest of them.
pub struct Snapshots {
    /// Each with the ids of its points where not all exist.
    trees: Vec<(KiddoTree, Vec<u32>)>,
}

impl Snapshots {
    /// Trees in the middles of `times` equal parts of the shutter.
    pub fn build(points: &[MovingPoint], times: usize, leaves: Leaves) -> Result<Snapshots, Box<dyn Error>> {
        let tree = |i: usize| -> Result<(KiddoTree, Vec<u32>), Box<dyn Error>> {
            let time = (i as f32 + 0.5) / times as f32;
            let ids: Vec<u32> =
                (0..points.len() as u32).filter(|&i| points[i as usize].active.contains(time)).collect();
            let places: Vec<[f32; 3]> = ids.iter().map(|&i| place(&points[i as usize], time).to_array()).collect();
            // Where all exist, ids are indices.
            let ids = if ids.len() == points.len() { Vec::new() } else { ids };
            Ok((KiddoTree::build(&places, leaves)?, ids))
        };
        Ok(Snapshots { trees: (0..times).map(tree).collect::<Result<_, _>>()? })
    }

    /// The ids of the `k` nearest of the points where they are in the nearest of the times.
    pub fn nearest(&self, (at, time): Query, k: usize, found: &mut Vec<u32>) {
        let last = self.trees.len() - 1;
        let (tree, ids) = &self.trees[((time * self.trees.len() as f32) as usize).min(last)];
        found.clear();
        tree.nearest(at, k, |i, _| found.push(ids.get(i as usize).copied().unwrap_or(i)));
    }
}

/// One tree over the points where they are at mid-shutter, searched within a radius grown by the farthest that any point
/// can be from there; what is found is looked at where it is at the query's time. Exact.
pub struct Inflated<'a> {
    points: &'a [MovingPoint],
    tree: KiddoTree,
    /// How far the farthest point moves during the shutter.
    farthest: f32,
    /// Squared distances at the query's time, and ids.
    near: Vec<(f32, u32)>,
}

impl<'a> Inflated<'a> {
    /// The tree of the places at mid-shutter.
    pub fn build(points: &'a [MovingPoint], leaves: Leaves) -> Result<Inflated<'a>, Box<dyn Error>> {
        let places: Vec<[f32; 3]> = points.iter().map(|p| place(p, 0.5).to_array()).collect();
        let farthest = points.iter().map(|p| p.open.distance(p.close)).fold(0.0, f32::max);
        Ok(Inflated { points, tree: KiddoTree::build(&places, leaves)?, farthest, near: Vec::new() })
    }

    /// The ids of the `k` nearest at the query's time.
    pub fn nearest(&mut self, (at, time): Query, k: usize, found: &mut Vec<u32>) {
        let Inflated { points, tree, farthest, near } = self;
        // A little more, for the rounding of positions.
        let off = *farthest * (time - 0.5).abs() * 1.0001 + 1e-6;
        let keep = |near: &mut Vec<(f32, u32)>, id: u32| {
            let point = &points[id as usize];
            if point.active.contains(time) {
                near.push((place(point, time).distance_squared(at), id));
            }
        };
        // First the nearest at mid-shutter, more of them until k exist at the time: they bound the k-th distance.
        let mut wanted = k;
        loop {
            let mut reached = 0.0;
            near.clear();
            tree.nearest(at, wanted, |id, square| {
                reached = square;
                keep(near, id);
            });
            if near.len() >= k || wanted >= points.len() {
                let rim = least(near, k);
                let radius = rim.sqrt() + off;
                // What was not looked at is farther than the last one that was.
                if near.len() >= k && radius * radius > reached {
                    near.clear();
                    tree.within(at, radius, |id, _| keep(near, id));
                    least(near, k);
                }
                break;
            }
            wanted *= 4;
        }
        found.clear();
        found.extend(near.iter().map(|n| n.1));
    }
}

/// Leaves the `k` nearest of what was found, in order, and returns the last one's squared distance.
fn least(near: &mut Vec<(f32, u32)>, k: usize) -> f32 {
    let order = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if near.len() > k {
        near.select_nth_unstable_by(k - 1, order);
        near.truncate(k);
    }
    near.sort_unstable_by(order);
    near.last().map_or(0.0, |n| n.0)
}
