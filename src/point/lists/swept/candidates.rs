//! Candidates: the blocks of points that a group can come near during a window of time.

use super::candidate_points::CandidatePoints;
use super::coordinate::SweptCoordinate;
use super::criteria::Criteria;
use super::group::{RelativePaths, SLACK, SweptGroup, early, phases};
use super::window::Window;
use crate::point::layout::over_interval::{BlockTree, active_lanes, greater};
use crate::point::lists::candidates::{BoxRows, BoxVector};
use crate::point::lists::radii::{Radii, squared_up};
use crate::simd::{Kernel, LANES, Lanes, Simd};

/// What the radius of a pair is wider for squares that underflow: the nearest approach is not found where the square of a
/// displacement is below the least normal f32, and is missed by up to the displacement then.
const UNDERFLOW: f64 = 1e-18;

/// What f64 rounds of positions, in units of the coordinates at keys, which may be much greater: see [`super`].
const OF_KEYS: f64 = 1.0 / (1u64 << 42) as f64;

/// A block whose points may come near those of a group.
pub(super) struct CandidateBlock {
    pub(super) paths: RelativePaths,
    /// Squared distance up to which the test in f32 leaves a pair to that in f64, if all pairs have the same radius.
    bound: f32,
    /// The greatest radius of its points, where these count, and what is added to radii.
    reach: f32,
    slack: f64,
    /// Squared distance at the first time up to which a pair is excluded; negative for none.
    pub(super) excluded_within: Lanes<f32>,
}

impl CandidateBlock {
    /// The squared distance up to which the test in f32 leaves a pair to that in f64, if the point of the group has at most this
    /// radius.
    #[inline(always)]
    pub(super) fn bound(&self, criteria: &Criteria<'_>, own: f32) -> f32 {
        match criteria.radii {
            Radii::Equal(_) => self.bound,
            _ => squared_up(criteria.longest(own, self.reach) + self.slack),
        }
    }
}

/// What the points have behind each lane of each node of a tree; nothing without nodes.
#[derive(Clone, Copy)]
pub(super) struct Behind<'a> {
    /// No radius is greater, where the radii of others count.
    pub(super) reach: &'a [Lanes<f32>],
    /// No [`SweptCoordinate::excess`] is greater.
    pub(super) excess: &'a [Lanes<f32>],
}

impl Behind<'_> {
    /// Behind one node.
    #[inline(always)]
    fn node(&self, node: usize) -> (&Lanes<f32>, &Lanes<f32>) {
        const NOTHING: &Lanes<f32> = &[0.0; LANES];
        (self.reach.get(node).unwrap_or(NOTHING), self.excess.get(node).unwrap_or(NOTHING))
    }
}

/// All blocks whose points may come near those of a group.
#[derive(Default)]
pub(super) struct SweptCandidates<C> {
    pub(super) boxes: BoxRows,
    pub(super) blocks: Vec<CandidateBlock>,
    /// The points of the blocks, sixteen of each.
    pub(super) others: CandidatePoints<C>,
    /// The windows during which blocks are compared, each with the number of blocks up to its last.
    pub(super) windows: Vec<(Window, usize)>,
    open: Vec<(usize, usize)>,
}

impl<C: SweptCoordinate> SweptCandidates<C> {
    pub(super) fn clear(&mut self) {
        self.boxes.clear();
        self.blocks.clear();
        self.others.clear();
        self.windows.clear();
    }
}

/// Adds the blocks of a tree, and of its images, that a group can come within a radius of during a window. Stops with `false` once
/// there are more blocks than `most`.
pub(super) struct AddCandidates<'a, T: BlockTree> {
    pub(super) candidates: &'a mut SweptCandidates<T::Coordinate>,
    pub(super) tree: &'a T,
    pub(super) group: &'a SweptGroup<T::Coordinate>,
    pub(super) window: Window,
    pub(super) behind: Behind<'a>,
    pub(super) criteria: &'a Criteria<'a>,
    pub(super) most: usize,
}

impl<C: SweptCoordinate, T: BlockTree<Coordinate = C>> Kernel for AddCandidates<'_, T> {
    type Output = bool;
    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) -> bool {
        let AddCandidates { tree, group, window, behind, criteria, .. } = self;
        let mut reached = [0..=0, 0..=0, 0..=0];
        if criteria.images.any() {
            let (root, excess) = behind.node(tree.shape().root().1);
            let (lo, hi) = group.swept_root(s, tree, excess);
            let within = criteria.longest(criteria.own, root.iter().fold(0.0, |most, &radius| f32::max(most, radius)));
            for (axis, reached) in reached.iter_mut().enumerate() {
                let own = [group.lo[axis], group.hi[axis]];
                *reached = criteria.images.reached(axis, own, [lo[axis], hi[axis]], within);
            }
        }
        let [xs, ys, zs] = reached;
        for x in xs {
            for y in ys.clone() {
                for z in zs.clone() {
                    let window = window.at_image(criteria.images.shift([x, y, z]));
                    if !self.add_image(s, window) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

impl<C: SweptCoordinate, T: BlockTree<Coordinate = C>> AddCandidates<'_, T> {
    /// Adds those of the window's image.
    #[inline(always)]
    fn add_image<S: Simd>(&mut self, s: S, window: Window) -> bool {
        let AddCandidates { tree, group, behind, criteria, most, .. } = *self;
        let candidates = &mut *self.candidates;
        let phases = phases(tree, group.times);
        let frame = group.frame.of_image(window.shift);
        let within = criteria.within(criteria.own);
        let early = greater(group.early, early(tree, phases, group.times[0]));
        candidates.open.clear();
        candidates.open.push(tree.shape().root());
        while let Some((level, node)) = candidates.open.pop() {
            let (reach, excess) = behind.node(node);
            let (mut boxes, magnitude) = group.swept(s, tree, &frame, phases, (node, excess));
            boxes.reach = s.load(reach);
            let mut near = boxes.near(s, group.lo, group.hi, within) & active_lanes(tree, node, group.times);
            let (first, stride) = tree.shape().children(level, node);
            if level > 0 {
                while near != 0 {
                    candidates.open.push((level - 1, first + near.trailing_zeros() as usize));
                    near &= near - 1;
                }
                continue;
            }
            for part in 0..stride {
                let mut number = [0; LANES];
                for lane in (0..LANES).filter(|lane| near >> lane & 1 != 0) {
                    number[lane] = candidates.blocks.len() as u32;
                    let points = tree.rows(first + lane * stride + part);
                    let paths = RelativePaths::new(&points, phases, &frame);
                    let mut slack = SLACK * magnitude[lane];
                    // A box beside one that is far away is coarse, and points of it may be much nearer than one of their block.
                    if slack > criteria.longest(criteria.own, reach[lane]) {
                        slack = slack.min(SLACK * paths.magnitude() + OF_KEYS * points.magnitude());
                    }
                    let slack = slack + group.slack + f64::from(excess[lane]);
                    let bound = squared_up(criteria.longest(0.0, 0.0) + slack + UNDERFLOW);
                    // The radius has been lowered by more than f32 adds here, rounding of its square included:
                    // see `Sweep::for_certificate`.
                    let moved = 6.0 * (magnitude[lane] + group.magnitude) * early;
                    let excluded_within = criteria
                        .excluded_within
                        .map_or(-1.0, |within| squared(C::excluded_within(within, slack, moved)));
                    let exists =
                        |i: usize| points.begin[i] <= criteria.first_time && criteria.first_time < points.end[i];
                    let excluded_within = core::array::from_fn(|i| if exists(i) { excluded_within } else { -1.0 });
                    candidates.others.push(&points, criteria.has_active_intervals);
                    let (reach, wider) = (reach[lane], slack + UNDERFLOW);
                    candidates.blocks.push(CandidateBlock { paths, bound, reach, slack: wider, excluded_within });
                }
                candidates.boxes.push(s, &BoxVector { candidate: s.load_u(&number), ..boxes }, near);
            }
            if candidates.blocks.len() > most {
                return false;
            }
        }
        candidates.windows.push((window, candidates.blocks.len()));
        true
    }
}

/// The square of a distance as a finite f32; negative where it is.
fn squared(distance: f64) -> f32 {
    if distance < 0.0 { -1.0 } else { (distance * distance).min(f32::MAX.into()) as f32 }
}
