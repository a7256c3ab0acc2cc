//! The points of a group of leaves, whose lists are made together.

use super::radii::{Margin, Radii, radius_of};
use crate::point::layout::view::{CoordinateView, DoubleRows, Target};
use crate::simd::{Kernel, LANES, Lanes, Simd};
use glam::Vec3;

/// Blocks of candidates for each point from which on scattered points are searched for one by one.
///
/// A point alone takes the time of gathering about a dozen blocks, and the points of a group are compared with what was gathered.
pub(super) const MOST_BLOCKS: usize = 4;

/// The points of a block at a time, in rows. In lanes without a point, the first coordinate is infinite.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct BlockPoints {
    pub(super) at: [Lanes<f32>; 3],
    pub(super) id: Lanes<u32>,
}

impl BlockPoints {
    pub(super) const NONE: BlockPoints = BlockPoints { at: [[f32::INFINITY; LANES]; 3], id: [u32::MAX; LANES] };

    /// The points of a block at the view's time.
    #[inline(always)]
    pub(super) fn of_block<S: Simd, V: CoordinateView>(
        s: S,
        view: &V,
        target: &Target<S>,
        block: usize,
    ) -> BlockPoints {
        let [x, y, z] = view.positions(s, target, block);
        let mut points = BlockPoints::NONE;
        let exists = s.lt(x, s.splat(f32::MAX));
        s.store(s.select(exists, x, s.splat(f32::INFINITY)), &mut points.at[0]);
        s.store(y, &mut points.at[1]);
        s.store(z, &mut points.at[2]);
        points.id = *view.ids(block);
        points
    }
}

/// A block of points whose lists are wanted, the box around them, and how far they reach.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    pub(super) points: BlockPoints,
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    /// The largest radius.
    pub(super) radius: f32,
}

/// The blocks below a bottom node.
#[derive(Clone, Debug, Default)]
pub(super) struct Group {
    pub(super) members: Vec<Member>,
    /// The positions of the members in f64, where those are rounded.
    pub(super) double: Vec<DoubleRows>,
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
    /// The largest radius.
    pub(super) radius: f32,
    /// By how much more boxes have to be searched.
    pub(super) margin: Margin,
}

/// Takes the points below a bottom node.
pub(super) struct TakeGroup<'a, V> {
    pub(super) view: V,
    pub(super) group: &'a mut Group,
    pub(super) node: usize,
    pub(super) radii: &'a Radii<'a>,
}

impl<V: CoordinateView> Kernel for TakeGroup<'_, V> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let TakeGroup { view, group, node, radii } = self;
        let target = view.target(s, Vec3::ZERO);
        group.members.clear();
        group.double.clear();
        (group.lo, group.hi, group.radius) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0.0);
        let mut lanes = view.present(s, &target, node);
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let first = view.first_block(node) + lane * view.leaf_blocks();
            for block in first..first + view.leaf_blocks() {
                let points = BlockPoints::of_block(s, &view, &target, block);
                if let Some(member) = Member::around(points, radii) {
                    for axis in 0..3 {
                        group.lo[axis] = group.lo[axis].min(member.lo[axis]);
                        group.hi[axis] = group.hi[axis].max(member.hi[axis]);
                    }
                    group.radius = group.radius.max(member.radius);
                    group.members.push(member);
                    group.double.extend(view.double_positions(s, block));
                }
            }
        }
        let size = (0..3).fold(0.0f32, |size, axis| size.max(group.lo[axis].abs()).max(group.hi[axis].abs()));
        group.margin = if group.double.is_empty() { Margin::NONE } else { Margin::of_rounding(size) };
    }
}

impl Group {
    pub(super) fn bytes(&self) -> usize {
        self.members.capacity() * size_of::<Member>() + self.double.capacity() * size_of::<DoubleRows>()
    }

    /// Whether the points are scattered: most of what is within reach of the box around them is within reach of none of them.
    /// `others` is the largest radius of points that are listed.
    ///
    /// The volume of the box, grown by the radius, is compared with that of the cubes around the points, twice over. Leaves of a
    /// set among itself are never searched so: they are as dense as what they are searched in.
    pub(super) fn is_scattered(&self, radii: &Radii, others: f32) -> bool {
        let (mut count, mut cubes) = (0, 0.0);
        for points in self.members.iter().map(|member| &member.points) {
            for lane in (0..LANES).filter(|&lane| points.at[0][lane] != f32::INFINITY) {
                let width = 2.0 * f64::from(radii.of_pair(radii.of(points.id[lane]), others));
                (count, cubes) = (count + 1, cubes + width.powi(3));
            }
        }
        let width = 2.0 * f64::from(radii.of_pair(self.radius, others));
        let side = |axis: usize| f64::from(self.hi[axis]) - f64::from(self.lo[axis]) + width;
        count > 1 && side(0) * side(1) * side(2) > 2.0 * cubes
    }

    /// Becomes a group of one point, of a member of another group; `false` where that has none in the lane.
    pub(super) fn take_one(&mut self, of: &Group, member: usize, lane: usize) -> bool {
        let Member { points, radius, .. } = of.members[member];
        let at = points.at.map(|row| row[lane]);
        if at[0] == f32::INFINITY {
            return false;
        }
        self.members.clear();
        self.double.clear();
        let mut alone = BlockPoints { id: points.id, ..BlockPoints::NONE };
        for (row, at) in alone.at.iter_mut().zip(at) {
            row[lane] = at;
        }
        self.members.push(Member { points: alone, lo: at, hi: at, radius });
        self.double.extend(of.double.get(member));
        (self.lo, self.hi, self.radius, self.margin) = (at, at, radius, of.margin);
        true
    }
}

impl Member {
    /// Nothing where no point exists.
    #[inline(always)]
    fn around(points: BlockPoints, radii: &Radii) -> Option<Member> {
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let mut radius = match radii {
            Radii::Equal(radius) => *radius,
            _ => 0.0,
        };
        let mut any = false;
        for lane in 0..LANES {
            let at = points.at.map(|row| row[lane]);
            if at[0] == f32::INFINITY {
                continue;
            }
            any = true;
            for axis in 0..3 {
                lo[axis] = if at[axis] < lo[axis] { at[axis] } else { lo[axis] };
                hi[axis] = if at[axis] > hi[axis] { at[axis] } else { hi[axis] };
            }
            if let Some(own) = radii.own() {
                radius = radius.max(radius_of(own, points.id[lane]));
            }
        }
        any.then_some(Member { points, lo, hi, radius })
    }
}
