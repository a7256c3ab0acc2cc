//! Choosing the regions of a scene that get a temporal split, and its kind.
//!
//! Boxes over the whole shutter are tight for static primitives and for coherent motion, and wide where neighbours move
//! apart. So a static building, a walking crowd and a shattering object want different trees, and they get them: a
//! subtree of the draft for the whole shutter may be replaced by a time node over several hierarchies
//! that share their leaf blocks, or over several separate trees.
//!
//! A greedy decision at one node cannot see the gain of splits further down, and building all alternatives would take
//! many times as long as the build itself. So there are two steps. The first one makes a map: a small sample of each of some
//! hundred treelets ([`super::treelets`]) shows how much smaller its boxes would be if they were made for slices of the
//! shutter. If they are hardly smaller, the treelet needs no split. *Regions* are the subtrees with
//! the greatest total gain, each with enough gain of its own and of similar treelets. The second step builds, for each
//! region, alternatives over samples and compares their expected times ([`super::trials`]). If every split of a region with
//! dissimilar halves is rejected, its halves are tried separately: slow stars around a fast core would hide the core.
//! Neighbours with the same decision are joined into one region, so a homogeneous scene gets one tree with one split.

use super::draft::Draft;
use super::drafting::DraftParams;
use super::treelets::{Treelet, treelets};
use super::trials::{Trial, decide};
use crate::bvh::BinaryNode;
use crate::params::Division;
use crate::primitive::PrimitiveSet;
use crate::progress::Progress;
use crate::simd::LANES;
use crate::tuning::slices::{FEW, LEVELS, MAX_AREA_OF_HALVES, MIN_GAIN, MIN_SIMILARITY, NEARLY_ALL};
use crate::tuning::wide::BYTES_PER_REFERENCE;

/// A subtree of a draft that gets a temporal split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Region {
    /// Its binary node.
    pub node: u32,
    pub division: Division,
    /// Expected cost of a ray in it, with this split.
    pub cost: f32,
    /// The same with what it costs that the tree becomes larger.
    pub time: f32,
}

/// Separate trees never take more bytes than this: three quarters of the range of its references.
const MOST_BYTES: f64 = 1.5 * (1u64 << 30) as f64;

/// The regions of a draft for the whole shutter, in the order of their nodes; none lies below another. A region has more references
/// than a leaf block, unless it is the whole draft: where trees are written, its node is told from those of leaf blocks by its
/// size. `treelet` is the least size of a treelet. Each trial takes a share of what is left of `progress`; once that is cancelled,
/// regions are missing.
pub(crate) fn regions<S: PrimitiveSet>(
    set: &S,
    draft: &Draft,
    params: &DraftParams,
    treelet: usize,
    progress: &Progress,
) -> Vec<Region> {
    let forced =
        |division| vec![Region { node: 0, division, cost: draft.collapse.total(), time: draft.collapse.total() }];
    match params.wide.division {
        Division::Automatic => {}
        Division::Whole => return vec![],
        division => return forced(division),
    }
    // Each slice would have a block of its own, and rays a time node more to pass.
    if draft.collapse.is_leaf(0) {
        return vec![];
    }
    let mut found = Vec::new();
    let treelets = treelets(set, draft, treelet);
    let least = MIN_GAIN * Sum::of(&treelets).cost;
    find(draft, 0, &treelets, least, &mut found);
    let most = allowed_growth(draft, &found, params);
    let decided_within = |most: f32, node: u32| {
        let Trial { division, cost, time } = decide(set, draft, node, most, params, progress)?;
        let undivided = draft.collapse.cost(node);
        Some(Region { node, division, cost: cost * undivided, time: time * undivided })
    };
    let decide = |node| decided_within(most, node);
    let mut decided = Vec::new();
    for candidate in found {
        divided(draft, candidate, least, &decide, &mut decided);
    }
    let mut regions = joined(&draft.binary, 0, decided);
    // What comes and goes at different times gains differently everywhere; and of many regions of their own the nodes above gain
    // nothing.
    if !set.always_active()
        && regions.len() > 1
        && let all = (Candidate { node: 0, treelets: &treelets })
        && let Some(whole) = decided_within(allowed_growth(draft, &[all], params), 0)
        && whole.time < time_with(draft, &regions)
    {
        return vec![whole];
    }
    if let Some(&region) = regions.iter().find(|region| is_nearly_all(draft, region.node)) {
        let around = draft.collapse.total() - draft.collapse.cost(region.node);
        return vec![Region { node: 0, cost: region.cost + around, time: region.time + around, ..region }];
    }
    let in_a_block = |node: u32| draft.binary[node as usize].count as usize <= LANES;
    regions.retain(|region| region.node == 0 || !in_a_block(region.node));
    regions
}

/// Expected cost of a ray with some regions, with what it costs that they become larger.
fn time_with(draft: &Draft, regions: &[Region]) -> f32 {
    let saved = regions.iter().map(|region| draft.collapse.cost(region.node) - region.time).sum::<f32>();
    draft.collapse.total() - saved
}

/// Appends the regions of a candidate: itself or, if it is rejected and its halves are dissimilar, those of both halves.
fn divided(
    draft: &Draft,
    Candidate { node, treelets }: Candidate<'_>,
    least: f32,
    decide: &impl Fn(u32) -> Option<Region>,
    regions: &mut Vec<Region>,
) {
    if let Some(region) = decide(node) {
        regions.push(region);
    } else if treelets.len() > 1 && dissimilar(means(draft, node, treelets, LEVELS)) {
        let (right, low, high) = sides(draft, node, treelets);
        let mut found = Vec::new();
        find(draft, node + 1, low, least, &mut found);
        find(draft, right, high, least, &mut found);
        for candidate in found {
            divided(draft, candidate, least, decide, regions);
        }
    }
}

/// A subtree that may gain from a split, and its treelets.
#[derive(Clone, Copy)]
struct Candidate<'a> {
    node: u32,
    treelets: &'a [Treelet],
}

/// Sums over treelets, weighted by their costs.
#[derive(Clone, Copy, Default)]
struct Sum {
    cost: f32,
    in_slices: f32,
}

impl Sum {
    fn of(treelets: &[Treelet]) -> Sum {
        let mut sum = Sum::default();
        for treelet in treelets {
            sum.cost += treelet.cost;
            sum.in_slices += treelet.cost * treelet.in_slices;
        }
        sum
    }

    /// An estimate of the gain of splitting all of it.
    fn gain(self) -> f32 {
        MAX_AREA_OF_HALVES * self.cost - self.in_slices
    }

    fn mean(self) -> f32 {
        if self.cost > 0.0 { self.in_slices / self.cost } else { 1.0 }
    }
}

/// The right child of a node, and the treelets of both sides.
fn sides<'a>(draft: &Draft, x: u32, treelets: &'a [Treelet]) -> (u32, &'a [Treelet], &'a [Treelet]) {
    let right = x + draft.binary[x as usize].right;
    let (low, high) = treelets.split_at(treelets.partition_point(|p| p.node < right));
    (right, low, high)
}

/// Appends the subtrees of `x`, which consists of `treelets`, that gain most from a split, each at least `least`; returns
/// their total gain.
fn find<'a>(draft: &Draft, x: u32, treelets: &'a [Treelet], least: f32, found: &mut Vec<Candidate<'a>>) -> f32 {
    if treelets.iter().all(|p| p.in_slices >= MAX_AREA_OF_HALVES) {
        return 0.0;
    }
    let own = Sum::of(treelets).gain() - least;
    let before = found.len();
    let separately = match treelets.len() {
        1 => 0.0,
        _ => {
            let (right, low, high) = sides(draft, x, treelets);
            find(draft, x + 1, low, least, found) + find(draft, right, high, least, found)
        }
    };
    if own <= separately.max(0.0) {
        return separately;
    }
    found.truncate(before);
    add_candidates(draft, x, treelets, found);
    own
}

/// Appends a subtree that is to be split; if its halves are dissimilar, each half separately.
fn add_candidates<'a>(draft: &Draft, x: u32, treelets: &'a [Treelet], found: &mut Vec<Candidate<'a>>) {
    if treelets.len() > 1 && dissimilar(means(draft, x, treelets, 1)) {
        let (right, low, high) = sides(draft, x, treelets);
        add_candidates(draft, x + 1, low, found);
        add_candidates(draft, right, high, found);
        return;
    }
    found.push(Candidate { node: x, treelets });
}

/// The least and the greatest mean of the subtrees `levels` levels below a node. Below the first level a subtree of few
/// treelets is not divided further, since a mean over so few is noisy.
fn means(draft: &Draft, x: u32, treelets: &[Treelet], levels: usize) -> [f32; 2] {
    if levels == 0 || treelets.len() < 2 {
        return [Sum::of(treelets).mean(); 2];
    }
    let (right, low, high) = sides(draft, x, treelets);
    let below =
        |x: u32, treelets: &[Treelet]| means(draft, x, treelets, if treelets.len() < FEW { 0 } else { levels - 1 });
    let (low, high) = (below(x + 1, low), below(right, high));
    [low[0].min(high[0]), low[1].max(high[1])]
}

/// Whether halves gain so differently from a split that they are separate regions.
fn dissimilar([least, greatest]: [f32; 2]) -> bool {
    1.0 - greatest < MIN_SIMILARITY * (1.0 - least)
}

/// The factor by which the budget allows regions to grow if the rest has its usual size, the same for all of them.
fn allowed_growth(draft: &Draft, regions: &[Candidate<'_>], params: &DraftParams) -> f32 {
    let bytes = |references: f64| references * f64::from(BYTES_PER_REFERENCE);
    let all = draft.references.len() as f64;
    let divided = regions.iter().map(|of| f64::from(draft.binary[of.node as usize].count)).sum::<f64>();
    let budget = (f64::from(params.wide.bytes_per_primitive) * draft.primitives as f64).min(MOST_BYTES);
    ((budget - bytes(all)) / bytes(divided).max(1.0) + 1.0) as f32
}

/// Joins regions below `x` that are the two halves of a node and have the same split.
fn joined(binary: &[BinaryNode], x: u32, mut regions: Vec<Region>) -> Vec<Region> {
    if regions.len() < 2 {
        return regions;
    }
    let right = x + binary[x as usize].right;
    let high = regions.split_off(regions.partition_point(|r| r.node < right));
    let (mut low, high) = (joined(binary, x + 1, regions), joined(binary, right, high));
    match (&low[..], &high[..]) {
        (&[l], &[h]) if l.node == x + 1 && h.node == right && l.division == h.division => {
            vec![Region { node: x, cost: l.cost + h.cost, time: l.time + h.time, ..l }]
        }
        _ => {
            low.extend(high);
            low
        }
    }
}

/// Whether a node has nearly all references, as figures on a floor do: then a node above the time node, for the few others, would
/// cost rays more than it saves.
fn is_nearly_all(draft: &Draft, x: u32) -> bool {
    draft.binary[0].count as f32 <= NEARLY_ALL * draft.binary[x as usize].count as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::WideParams;
    use crate::primitive::TriangleMesh;
    use crate::scene;
    use crate::tuning::slices::LEAST_TREELET;
    use glam::{Quat, Vec3};

    /// A scene's regions, and for each mesh the share of its triangles that lie in them.
    fn regions_of(scene: &scene::Scene) -> (Vec<Region>, Vec<f64>) {
        let params = DraftParams::new(WideParams::default());
        let (set, draft) = Draft::of_scene(scene);
        let regions = regions(&set, &draft, &params, LEAST_TREELET, &Progress::new(None));
        for pair in regions.windows(2) {
            let (a, b) = (&draft.binary[pair[0].node as usize], &draft.binary[pair[1].node as usize]);
            assert!(pair[0].node < pair[1].node && a.first + a.count <= b.first);
        }
        let mut inside = vec![0.0; scene.meshes.len()];
        for id in regions.iter().flat_map(|region| draft.primitives_below(region.node)) {
            let mut mesh = 0;
            let mut at = id as usize;
            while at >= scene.meshes[mesh].len() {
                at -= scene.meshes[mesh].len();
                mesh += 1;
            }
            inside[mesh] += 1.0 / scene.meshes[mesh].len() as f64;
        }
        (regions, inside)
    }

    #[test]
    fn only_incoherent_motion_gets_a_temporal_split() {
        let scene = scene::mixed(60_000);
        let (regions, inside) = regions_of(&scene);
        assert!(!regions.is_empty() && regions.len() <= 8, "{regions:?}");
        assert!(regions.iter().all(|r| matches!(r.division, Division::SeparateTrees(2..))), "{regions:?}");
        let (tornado, others) = inside.split_last().unwrap();
        // Some of the debris flies close to the columns and the rock, and treelets are hundreds of triangles.
        let (columns, rock) = (others[0], others[others.len() - 1]);
        assert!(*tornado > 0.75 && columns < 0.05 && rock < 0.2, "{inside:?}");
    }

    #[test]
    fn a_homogeneous_scene_is_one_region_or_none() {
        for still_or_alike in [scene::hall(30_000), scene::coherent(30_000), scene::camera(20_000)] {
            assert_eq!(regions_of(&still_or_alike).0, []);
        }
        let (regions, _) = regions_of(&scene::tornado(20_000));
        assert!(matches!(regions[..], [Region { node: 0, division: Division::SeparateTrees(4..), .. }]), "{regions:?}");
    }

    #[test]
    fn the_few_primitives_around_a_region_are_divided_with_it() {
        let (mut scene, mut floor) = (scene::tornado(20_000), scene::Shape::default());
        floor.block(Vec3::new(-20.0, -9.0, -20.0), Vec3::new(20.0, -8.0, 20.0));
        scene.meshes.push(floor.fixed());
        let (regions, inside) = regions_of(&scene);
        assert!(matches!(regions[..], [Region { node: 0, .. }]), "{regions:?}");
        assert!(inside.iter().all(|&share| share > 0.999), "{inside:?}");
    }

    /// A floor that is thousands of times as wide meets nearly all rays from everywhere, but rays of a picture are aimed at what
    /// moves.
    #[test]
    fn what_moves_on_a_wide_floor_is_divided_as_if_it_were_alone() {
        let alone = regions_of(&scene::tornado(20_000)).0;
        for half in [20.0, 3e3, 3e5] {
            let (mut scene, mut floor) = (scene::tornado(20_000), scene::Shape::default());
            floor.block(Vec3::new(-half, -9.0, -half), Vec3::new(half, -8.0, half));
            scene.meshes.push(floor.fixed());
            let (regions, inside) = regions_of(&scene);
            assert_eq!(regions.len(), alone.len(), "{half}: {regions:?}");
            assert_eq!(regions[0].division, alone[0].division, "{half}: {regions:?}");
            assert!(inside[0] > 0.999, "{half}: {inside:?}");
        }
    }

    #[test]
    fn parts_of_a_rejected_region_are_tried_if_they_are_dissimilar() {
        let (set, draft) = Draft::of_scene(&scene::tornado(60_000));
        let mut treelets = treelets(&set, &draft, LEAST_TREELET);
        let (right, low, high) = sides(&draft, 0, &treelets);
        let middles = [sides(&draft, 1, low).0, sides(&draft, right, high).0];
        assert!(low.len() >= FEW && high.len() >= FEW);
        // Both halves are alike, and half of each would gain much.
        for treelet in &mut treelets {
            let fast = treelet.node < middles[0] || (right..middles[1]).contains(&treelet.node);
            treelet.in_slices = if fast { 0.4 } else { 0.95 };
        }
        assert!(!dissimilar(means(&draft, 0, &treelets, 1)));
        let refuses_whole = |node: u32| {
            let region = Region { node, division: Division::SharedLeaves(2), cost: 0.0, time: 0.0 };
            (node != 0).then_some(region)
        };
        let divided = |treelets: &[Treelet]| {
            let mut regions = Vec::new();
            let least = MIN_GAIN * Sum::of(treelets).cost;
            divided(&draft, Candidate { node: 0, treelets }, least, &refuses_whole, &mut regions);
            regions.iter().map(|region| region.node).collect::<Vec<_>>()
        };
        assert_eq!(divided(&treelets), [2, right + 1]);
        for treelet in &mut treelets {
            treelet.in_slices = 0.6;
        }
        assert_eq!(divided(&treelets), []);
    }

    /// Blades that turn twice, over a static floor.
    fn fan(keys: usize) -> scene::Scene {
        let (mut scene, mut floor) = (scene::tornado(1), scene::Shape::default());
        floor.block(Vec3::new(-2.0, -2.0, -2.0), Vec3::new(2.0, -1.9, 2.0));
        let at = |key: usize| {
            let turned = Quat::from_rotation_z(2.0 * core::f32::consts::TAU * key as f32 / (keys - 1) as f32);
            let corner = |i: usize| {
                let (blade, i) = (i / 1800, i % 1800);
                let (triangle, corner) = (i / 3, i % 3);
                let along = 0.2 + (triangle / 4) as f32 / 180.0 + if corner == 1 { 0.01 } else { 0.0 };
                let across = (triangle % 4) as f32 * 0.05 + if corner == 2 { 0.05 } else { 0.0 };
                turned * (Quat::from_rotation_z(blade as f32 * 1.25) * Vec3::new(along, across, across))
            };
            (0..9000).map(corner).collect::<Vec<_>>()
        };
        let blades = TriangleMesh::new((0..3000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), {
            (0..keys).map(at).collect::<Vec<_>>()
        });
        scene.meshes = vec![floor.fixed(), blades];
        scene
    }

    #[test]
    fn two_turns_are_divided_though_halves_of_the_shutter_gain_nothing() {
        let (regions, inside) = regions_of(&fan(33));
        let many = |r: &Region| matches!(r.division, Division::SharedLeaves(8..) | Division::SeparateTrees(8..));
        assert!(!regions.is_empty() && regions.iter().all(many), "{regions:?}");
        assert!(inside[1] > 0.99, "{inside:?}");
    }

    #[test]
    fn halves_are_separate_regions_if_one_gains_much_less_than_the_other() {
        assert!(!dissimilar([0.07, 0.3]) && !dissimilar([0.6, 0.7]) && !dissimilar([1.0, 1.0]));
        assert!(dissimilar([0.4, 0.95]) && dissimilar([0.7, 0.85]));
    }
}
