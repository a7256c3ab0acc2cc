//! The lists of the points of a block, from the candidates of its group.

use super::candidates::{BoxRows, Candidates, Selection, Within};
use super::columns::Columns;
use super::coordinate::Coordinate;
use super::gathered_points::{GatheredPoints, GatheredRows};
use super::group::{Group, Member};
use super::list_request::Listing;
use super::list_writer::{ListWriter, write_requested};
use super::radii::{Radii, squared_radii, squared_radius};
use crate::point::layout::view::{rows, squared};
use crate::simd::{Kernel, LANES, Lanes, Mask, Simd, lanes_at_mut};
use core::marker::PhantomData;

/// Memory for the lists of a block.
#[derive(Clone, Debug, Default)]
pub(super) struct RowBuilder {
    boxes: BoxRows,
    selected: Selection,
    points: GatheredPoints,
    /// Hits among each vector of candidates of a point.
    hits: Vec<Mask>,
}

/// What was gathered for a member of a group.
#[derive(Clone, Copy)]
struct Gathered {
    /// How many vectors.
    vectors: usize,
    /// Where in them the points of the member itself begin, and which of its lanes they are.
    own: (usize, Mask),
    images: NearestImages,
}

/// Which images of the points that were gathered are nearest to points of the member.
#[derive(Clone, Copy, PartialEq)]
enum NearestImages {
    /// Those that are given.
    Given,
    /// For all of them the same, to which there are shifts.
    Shifted,
    /// Not the same for all.
    Several,
}

/// Which points within the radius of a point its list excludes, as constants: at most the point itself, whose id no other point
/// has; another set does not contain it.
const OWN: u8 = 0;
/// Those with the same id.
const SAME_ID: u8 = 1;
/// Those without a greater id: each pair is listed once.
const NOT_GREATER: u8 = 2;

/// Room for `count` masks.
///
/// One loop computes which points are near, and another writes them. The address of each write depends on the hits before
/// it, and loads that follow a write wait until its address is known.
#[inline(always)]
fn room_for(hits: &mut Vec<Mask>, count: usize) -> &mut [Mask] {
    if hits.len() < count {
        hits.resize(2 * count, 0);
    }
    &mut hits[..count]
}

/// A point of a block. (Mapping the rows instead copies them all first, and each read waits for that.)
#[inline(always)]
fn point_of<C: Copy>([x, y, z]: &[Lanes<C>; 3], lane: usize) -> [C; 3] {
    [x[lane], y[lane], z[lane]]
}

/// A member of a group whose lists are made, and what they are made from.
#[derive(Clone, Copy)]
struct MemberRequest<'a> {
    listing: &'a Listing<'a>,
    group: &'a Group,
    /// The number of the member.
    number: usize,
    candidates: &'a Candidates,
}

impl<'a> MemberRequest<'a> {
    #[inline(always)]
    fn member(&self) -> &'a Member {
        &self.group.members[self.number]
    }

    /// How near boxes have to be to the member.
    #[inline(always)]
    fn within(&self) -> Within<'a> {
        Within::Radius(&self.listing.radii, self.member().radius, self.group.margin)
    }
}

/// Appends the lists of the points of a group, whose positions are numbers of type `C`.
pub(super) struct GroupLists<'a, C> {
    pub(super) builder: &'a mut RowBuilder,
    pub(super) listing: &'a Listing<'a>,
    pub(super) group: &'a Group,
    pub(super) candidates: &'a Candidates,
    pub(super) lists: &'a mut ListWriter,
    pub(super) coordinate: PhantomData<C>,
}

impl<C: Coordinate> Kernel for GroupLists<'_, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let GroupLists { builder, listing, group, candidates, lists, .. } = self;
        for (number, member) in group.members.iter().enumerate() {
            if !lists.want_any(&member.points.id) {
                continue;
            }
            let of = MemberRequest { listing, group, number, candidates };
            if candidates.wrapped {
                s.call(WrappedMember::<C> { builder, of, lists, coordinate: PhantomData });
            } else {
                builder.member::<S, C, false>(s, of, lists);
            }
        }
    }
}

/// Appends the lists of a member of a group for which other images count than those that are given. (A function of its own, so that
/// lists without any are compiled as if there were none.)
struct WrappedMember<'a, C> {
    builder: &'a mut RowBuilder,
    of: MemberRequest<'a>,
    lists: &'a mut ListWriter,
    coordinate: PhantomData<C>,
}

impl<C: Coordinate> Kernel for WrappedMember<'_, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        self.builder.member::<S, C, true>(s, self.of, self.lists);
    }
}

impl RowBuilder {
    pub(super) fn bytes(&self) -> usize {
        self.boxes.bytes() + self.selected.bytes() + self.points.bytes() + size_of::<Mask>() * self.hits.capacity()
    }

    /// Appends the lists of a member of a group; unless `PERIODIC`, all images are those that are given.
    #[inline(always)]
    fn member<S: Simd, C: Coordinate, const PERIODIC: bool>(
        &mut self,
        s: S,
        of: MemberRequest<'_>,
        lists: &mut ListWriter,
    ) {
        let Listing { radii, once, other_set, distinct, .. } = *of.listing;
        let equal = matches!(radii, Radii::Equal(_));
        let wrapped = (PERIODIC || !equal) && self.select_boxes::<S, PERIODIC>(s, of);
        if !equal {
            return if once {
                self.list_one_by_one::<S, C, PERIODIC, true>(s, of, wrapped, lists)
            } else {
                self.list_one_by_one::<S, C, PERIODIC, false>(s, of, wrapped, lists)
            };
        }
        let gathered = self.gather_points::<S, C, PERIODIC>(s, of);
        match (once, other_set || distinct) {
            (true, _) => self.list_without::<S, C, NOT_GREATER, PERIODIC>(s, of, gathered, lists),
            (false, true) => self.list_without::<S, C, OWN, PERIODIC>(s, of, gathered, lists),
            (false, false) => self.list_without::<S, C, SAME_ID, PERIODIC>(s, of, gathered, lists),
        }
    }

    /// Selects the candidates that have an image near a member; their boxes hold for every point of it. Returns whether any of them
    /// is nearest in another image than the one it is given in.
    ///
    /// The images nearest to the whole group do not decide that: a member is much smaller, so that far fewer boxes are nearest in
    /// several.
    #[inline(always)]
    fn select_boxes<S: Simd, const PERIODIC: bool>(&mut self, s: S, of: MemberRequest<'_>) -> bool {
        let (MemberRequest { listing, candidates, .. }, member, within) = (of, of.member(), of.within());
        self.boxes.clear();
        let mut wrapped = 0;
        for i in 0..candidates.boxes.vectors() {
            let (mut boxes, valid) = candidates.boxes.vector(s, i);
            if !PERIODIC || !candidates.is_any_wrapped(i) {
                let near = boxes.near(s, member.lo, member.hi, within) & valid;
                if near != 0 {
                    self.boxes.push(s, &boxes, near);
                }
                continue;
            }
            let moved = listing.periodic_box.wrap(s, (boxes.lo, boxes.hi), (member.lo, member.hi));
            (boxes.lo, boxes.hi) = (moved.lo, moved.hi);
            let near = boxes.near(s, member.lo, member.hi, within) & valid;
            if near != 0 {
                wrapped |= near & moved.wrapped;
                (boxes.lo, boxes.hi) = moved.widened(s);
                self.boxes.push(s, &boxes, near);
            }
        }
        wrapped != 0
    }

    /// Gathers the points that are near the box of a member, in rows, where all points of the member have the same radius.
    /// They are about as many as each of its points would test by itself, and they lie one behind the other. If `PERIODIC`, the
    /// candidates are those of [`RowBuilder::select_boxes`].
    #[inline(always)]
    fn gather_points<S: Simd, C: Coordinate, const PERIODIC: bool>(&mut self, s: S, of: MemberRequest<'_>) -> Gathered {
        let (MemberRequest { listing, group, candidates, .. }, member) = (of, of.member());
        let selected = if PERIODIC {
            self.boxes.candidates()
        } else {
            self.selected.near(s, &candidates.boxes, (member.lo, member.hi), of.within())
        };
        let room = (selected.len() + 1) * LANES;
        let short = |row: &Vec<C>| row.len() < room;
        if self.points.id.len() < room || C::gathered(&self.points).at.iter().any(short) {
            C::gathered_mut(&mut self.points).at.iter_mut().for_each(|row| row.resize(2 * room, C::INFINITY));
            self.points.id.resize(2 * room, 0);
        }
        let lo = [s.splat(member.lo[0]), s.splat(member.lo[1]), s.splat(member.lo[2])];
        let hi = [s.splat(member.hi[0]), s.splat(member.hi[1]), s.splat(member.hi[2])];
        let bound = group.margin.squared(s, s.splat(member.radius));
        let hits = room_for(&mut self.hits, selected.len());
        let mut images = NearestImages::Given;
        if PERIODIC {
            images = near_images(s, listing, member, (candidates, selected), (lo, hi, bound), hits);
        } else {
            for (hits, &index) in hits.iter_mut().zip(selected) {
                *hits = s.le(gap_squared(s, &candidates.blocks[index as usize].at, lo, hi), bound);
            }
        }
        let mut to_id = core::mem::take(&mut self.points.id);
        let [to_x, to_y, to_z] = &mut C::gathered_mut(&mut self.points).at;
        // Slices, whose ends stay in registers.
        let (to_x, to_y, to_z, ids) = (&mut to_x[..], &mut to_y[..], &mut to_z[..], &mut to_id[..]);
        let (mut end, mut own) = (0, (usize::MAX, 0));
        for (&near, &index) in hits.iter().zip(selected) {
            let id = &candidates.blocks[index as usize].id;
            own = if id[0] == member.points.id[0] { (end, near) } else { own };
            let [x, y, z] = C::of_block(candidates, index as usize);
            C::store_compressed(s, x, near, lanes_at_mut(to_x, end));
            C::store_compressed(s, y, near, lanes_at_mut(to_y, end));
            C::store_compressed(s, z, near, lanes_at_mut(to_z, end));
            s.store_compressed_u(s.load_u(id), near, lanes_at_mut(ids, end));
            end += near.count_ones() as usize;
        }
        to_x[end..end + LANES].fill(C::INFINITY);
        self.points.id = to_id;
        if PERIODIC && images == NearestImages::Shifted {
            let to = &mut C::gathered_mut(&mut self.points).shift;
            gather_shifts::<S, C>(s, listing, member, (candidates, selected), hits, to);
        }
        Gathered { vectors: end.div_ceil(LANES), own, images }
    }

    /// Lists from the points that were gathered, without those that are excluded.
    #[inline(always)]
    fn list_without<S: Simd, C: Coordinate, const EXCLUDED: u8, const PERIODIC: bool>(
        &mut self,
        s: S,
        of: MemberRequest<'_>,
        gathered: Gathered,
        lists: &mut ListWriter,
    ) {
        if !PERIODIC && !of.listing.distances && !of.listing.displacements {
            self.list_gathered::<S, C, EXCLUDED, true, PERIODIC>(s, of, gathered, lists);
        } else {
            self.list_gathered::<S, C, EXCLUDED, false, PERIODIC>(s, of, gathered, lists);
        }
    }

    /// The same; with `PLAIN` only ids. Unless `PERIODIC`, images are those that are given.
    #[inline(always)]
    fn list_gathered<S: Simd, C: Coordinate, const EXCLUDED: u8, const PLAIN: bool, const PERIODIC: bool>(
        &mut self,
        s: S,
        of: MemberRequest<'_>,
        Gathered { vectors, own: (own_begin, own_lanes), images }: Gathered,
        lists: &mut ListWriter,
    ) {
        let (listing, member, own_rows) = (of.listing, of.member(), C::of_member(of.group, of.number));
        let GatheredRows { at: [from_x, from_y, from_z], shift: [shift_x, shift_y, shift_z] } =
            C::gathered(&self.points);
        // As many vectors as there are, so that nothing is checked for each of them.
        let (from_x, from_y) = (&from_x.as_chunks().0[..vectors], &from_y.as_chunks().0[..vectors]);
        let (from_z, from_id) = (&from_z.as_chunks().0[..vectors], &self.points.id.as_chunks().0[..vectors]);
        let shifts = if PERIODIC && images == NearestImages::Shifted { vectors } else { 0 };
        let (shift_x, shift_y) = (&shift_x.as_chunks().0[..shifts], &shift_y.as_chunks().0[..shifts]);
        let shift_z = &shift_z.as_chunks().0[..shifts];
        let bound = s.splat(squared_radius(member.radius));
        let hits = room_for(&mut self.hits, vectors);
        for lane in 0..LANES {
            if member.points.at[0][lane] == f32::INFINITY {
                continue;
            }
            let point = point_of(own_rows, lane);
            let (id, begin) = (member.points.id[lane], lists.rows.end());
            lists.reserve(vectors * LANES, listing);
            let own = s.splat_u(id);
            for (from, hits) in hits.iter_mut().enumerate() {
                let rows = [&from_x[from], &from_y[from], &from_z[from]];
                let squared = if !PERIODIC || images == NearestImages::Given {
                    C::squared(s, rows, point)
                } else if shifts > 0 {
                    C::seen_shifted(s, rows, [&shift_x[from], &shift_y[from], &shift_z[from]], point).squared
                } else {
                    C::seen::<S, true>(s, rows, point, &listing.periodic_box).squared
                };
                let near = s.le(squared, bound);
                *hits = match EXCLUDED {
                    SAME_ID => near & !s.eq_u(own, s.load_u(&from_id[from])),
                    NOT_GREATER => near & s.lt_u(own, s.load_u(&from_id[from])),
                    _ => near,
                };
            }
            if EXCLUDED == OWN && !listing.other_set {
                // The points of the block itself are all near, so they lie where it begins, one behind the other.
                let index = own_begin.wrapping_add((own_lanes & ((1 << lane) - 1)).count_ones() as usize);
                if let Some(hits) = hits.get_mut(index / LANES) {
                    *hits &= !(1 << (index % LANES));
                }
            }
            // Apart from the lists, the end stays in a register.
            let Columns { ids: listed, floats, .. } = &mut lists.rows.data;
            let (listed, mut end) = (&mut listed[..], begin);
            for (from, &hits) in hits.iter().enumerate() {
                s.store_compressed_u(s.load_u(&from_id[from]), hits, lanes_at_mut(listed, end));
                if !PLAIN && (!PERIODIC || listing.distances || listing.displacements) {
                    let rows = [&from_x[from], &from_y[from], &from_z[from]];
                    let seen = if !PERIODIC || images == NearestImages::Given {
                        C::seen::<S, false>(s, rows, point, &listing.periodic_box)
                    } else if shifts > 0 {
                        C::seen_shifted(s, rows, [&shift_x[from], &shift_y[from], &shift_z[from]], point)
                    } else {
                        C::seen::<S, true>(s, rows, point, &listing.periodic_box)
                    };
                    write_requested(s, listing, floats, end, seen, hits);
                }
                end += hits.count_ones() as usize;
            }
            lists.end_list(id, begin, end, listing);
        }
    }

    /// Lists of points that have radii of their own: each is compared with the candidates near it. If `PERIODIC` and `wrapped`,
    /// other images count than those that are given.
    #[inline(always)]
    fn list_one_by_one<S: Simd, C: Coordinate, const PERIODIC: bool, const ONCE: bool>(
        &mut self,
        s: S,
        of: MemberRequest<'_>,
        wrapped: bool,
        lists: &mut ListWriter,
    ) {
        let MemberRequest { listing, group, number, candidates } = of;
        let (points, own_rows) = (&of.member().points, C::of_member(group, number));
        let joint = listing.radii.others().is_some();
        for lane in 0..LANES {
            let at = point_of(&points.at, lane);
            if at[0] == f32::INFINITY {
                continue;
            }
            let id = points.id[lane];
            let radius = listing.radii.of(id);
            let within = Within::Radius(&listing.radii, radius, group.margin);
            let selected = self.selected.near(s, &self.boxes, (at, at), within);
            let begin = lists.rows.end();
            lists.reserve(selected.len() * LANES, listing);
            let point = point_of(own_rows, lane);
            let own = s.splat_u(if listing.other_set && !ONCE { u32::MAX } else { id });
            let radius = s.splat(radius);
            let bound = squared_radii(s, radius);
            // Apart from the lists, the end stays in a register.
            let Columns { ids: listed, floats, .. } = &mut lists.rows.data;
            let (listed, mut end) = (&mut listed[..], begin);
            for &index in selected {
                let rows = C::of_block(candidates, index as usize).each_ref();
                let seen = if PERIODIC && wrapped {
                    C::seen::<S, true>(s, rows, point, &listing.periodic_box)
                } else {
                    C::seen::<S, false>(s, rows, point, &listing.periodic_box)
                };
                let bound = if joint {
                    let others = s.load(&candidates.radii[index as usize]);
                    squared_radii(s, listing.radii.joint(s, radius, others))
                } else {
                    bound
                };
                let ids = s.load_u(&candidates.blocks[index as usize].id);
                let others = if ONCE { s.lt_u(own, ids) } else { !s.eq_u(own, ids) };
                let hits = s.le(seen.squared, bound) & others;
                s.store_compressed_u(ids, hits, lanes_at_mut(listed, end));
                write_requested(s, listing, floats, end, seen, hits);
                end += hits.count_ones() as usize;
            }
            lists.end_list(id, begin, end, listing);
        }
    }
}

/// The squared distances of sixteen points from a box.
#[inline(always)]
fn gap_squared<S: Simd>(s: S, at: &[Lanes<f32>; 3], lo: [S::F; 3], hi: [S::F; 3]) -> S::F {
    let [x, y, z] = rows(s, at);
    let gap_x = x - s.min(s.max(x, lo[0]), hi[0]);
    let gap_y = y - s.min(s.max(y, lo[1]), hi[1]);
    let gap_z = z - s.min(s.max(z, lo[2]), hi[2]);
    squared::<S>(gap_x, gap_y, gap_z)
}

/// Finds, among the points of selected candidates, those with an image near a member: which lanes, and which images.
#[inline(always)]
fn near_images<S: Simd>(
    s: S,
    listing: &Listing,
    member: &Member,
    (candidates, selected): (&Candidates, &[u32]),
    (lo, hi, bound): ([S::F; 3], [S::F; 3], S::F),
    hits: &mut [Mask],
) -> NearestImages {
    let (to, periodic_box) = ((member.lo, member.hi), &listing.periodic_box);
    let (mut shifted, mut uncertain) = (0, 0);
    for (hits, &index) in hits.iter_mut().zip(selected) {
        let at = &candidates.blocks[index as usize].at;
        if !candidates.is_wrapped(index as usize) {
            *hits = s.le(gap_squared(s, at, lo, hi), bound);
            continue;
        }
        let [x, y, z] = rows(s, at);
        let exists = s.lt(x, s.splat(f32::INFINITY));
        let x = periodic_box.image(s, x, 0, to);
        let y = periodic_box.image(s, y, 1, to);
        let z = periodic_box.image(s, z, 2, to);
        *hits = s.le(squared::<S>(x.gap, y.gap, z.gap), bound) & exists;
        shifted |= *hits & !(x.given & y.given & z.given);
        uncertain |= *hits & !(x.certain & y.certain & z.certain);
    }
    match (uncertain, shifted) {
        (0, 0) => NearestImages::Given,
        (0, _) => NearestImages::Shifted,
        _ => NearestImages::Several,
    }
}

/// Gathers the shifts to the images that are nearest to a member, for each of the `hits` among the selected candidates.
#[inline(always)]
fn gather_shifts<S: Simd, C: Coordinate>(
    s: S,
    listing: &Listing,
    member: &Member,
    (candidates, selected): (&Candidates, &[u32]),
    hits: &[Mask],
    to: &mut [Vec<C>; 3],
) {
    let room = (selected.len() + 1) * LANES;
    for (axis, to) in to.iter_mut().enumerate() {
        if to.len() < room {
            to.resize(2 * room, C::INFINITY);
        }
        let (to, mut end) = (&mut to[..], 0);
        for (&near, &index) in hits.iter().zip(selected) {
            let at = s.load(&candidates.blocks[index as usize].at[axis]);
            let periods = listing.periodic_box.periods_to(s, at, axis, (member.lo, member.hi));
            C::store_shifts(s, periods, &listing.periodic_box, axis, near, lanes_at_mut(to, end));
            end += near.count_ones() as usize;
        }
    }
}
