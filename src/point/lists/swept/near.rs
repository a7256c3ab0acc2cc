//! Who passes the points of a block near enough to be looked at in f64.
//!
//! As for lists at a time: the points that can come near any of a block's are gathered one behind the other, and each of
//! the block's points is compared with these, sixteen at a time.

use super::encounter::{Four, Question, Visitor, WIDE};
use super::flights::{Block, Partner, Partners, squared_up};
use crate::point::lists::gather::Picks;
use crate::point::over_interval::Flight;
use crate::point::snapshot::{rows, squared};
use crate::simd::{LANES, Lanes, Simd, lanes_at};

/// Points that can come near any of a block, in rows.
#[derive(Default)]
struct Rows {
    first: [Vec<f32>; 3],
    passing: [Vec<f32>; 3],
    bound: Vec<f32>,
    known: Vec<f32>,
    /// Number of the partner and lane in it.
    place: Vec<u32>,
}

/// Memory for the encounters of a block.
#[derive(Default)]
pub(super) struct Near {
    picks: Picks,
    rows: Rows,
    /// Places of those that pass a point.
    hits: Vec<u32>,
    others: Vec<Four>,
}

/// Vectors of gathered points up to which all points of a block share them. Where there are more, the block has points
/// that go far, and each gathers for itself.
const SHARED: usize = 160;

/// Lane numbers.
const LANE: Lanes<u32> = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

impl Near {
    /// Tells a visitor all encounters of the points of a block.
    #[inline(always)]
    pub(super) fn visit<S: Simd, V: Visitor>(
        &mut self,
        s: S,
        (block, partners): (&Block, &Partners),
        question: &Question,
        visitor: &mut V,
    ) {
        if question.known {
            self.visit_all::<S, V, true>(s, (block, partners), question, visitor);
        } else {
            self.visit_all::<S, V, false>(s, (block, partners), question, visitor);
        }
    }

    #[inline(always)]
    fn visit_all<S: Simd, V: Visitor, const KNOWN: bool>(
        &mut self,
        s: S,
        (block, partners): (&Block, &Partners),
        question: &Question,
        visitor: &mut V,
    ) {
        let shared = self.gather::<S, KNOWN>(s, partners, (block.lo, block.hi), question);
        for lane in 0..LANES {
            let Some(own) = block.points.flight(lane) else { continue };
            visitor.begin(&own);
            let [from, way] = [&block.first, &block.passing].map(|rows| rows.each_ref().map(|row| row[lane]));
            let mut vectors = shared;
            if shared > SHARED {
                let to: [f32; 3] = core::array::from_fn(|axis| from[axis] + way[axis]);
                let lo = core::array::from_fn(|axis| if from[axis] < to[axis] { from[axis] } else { to[axis] });
                let hi = core::array::from_fn(|axis| if from[axis] > to[axis] { from[axis] } else { to[axis] });
                vectors = self.gather::<S, KNOWN>(s, partners, (lo, hi), question);
            }
            // What is looked at from a later time on is not where it was at the first.
            let pass_over = KNOWN && own.life.contains(question.first_time);
            let hits = self.passing::<S, KNOWN>(s, (from, way), pass_over, vectors);
            self.look_at(s, partners, &own, hits, question, visitor);
        }
    }

    /// Gathers the points whose ways come near a box; the number of vectors that they fill.
    #[inline(always)]
    fn gather<S: Simd, const KNOWN: bool>(
        &mut self,
        s: S,
        partners: &Partners,
        (lo, hi): ([f32; 3], [f32; 3]),
        question: &Question,
    ) -> usize {
        let picks = self.picks.near(s, &partners.boxes, (lo, hi), squared_up(question.radius));
        self.rows.make_room((picks.len() + 1) * LANES);
        let Rows { first: [to_x, to_y, to_z], passing: [to_u, to_v, to_w], bound: to_bound, known: to_known, place } =
            &mut self.rows;
        let lo = [s.splat(lo[0]), s.splat(lo[1]), s.splat(lo[2])];
        let hi = [s.splat(hi[0]), s.splat(hi[1]), s.splat(hi[2])];
        let time = s.splat(question.first_time);
        let mut end = 0;
        for &pick in picks {
            let Partner { block, bound, known } = &partners.blocks[pick as usize];
            let ([x, y, z], [u, v, w]) = (rows(s, &block.first), rows(s, &block.passing));
            let (a, b, c) = (gap(s, x, u, lo[0], hi[0]), gap(s, y, v, lo[1], hi[1]), gap(s, z, w, lo[2], hi[2]));
            let near = s.le(squared::<S>(a, b, c), s.splat(*bound));
            write(s, to_x, end, s.compress(x, near));
            write(s, to_y, end, s.compress(y, near));
            write(s, to_z, end, s.compress(z, near));
            write(s, to_u, end, s.compress(u, near));
            write(s, to_v, end, s.compress(v, near));
            write(s, to_w, end, s.compress(w, near));
            write(s, to_bound, end, s.splat(*bound));
            if KNOWN {
                let points = &block.points;
                let there = s.le(s.load(&points.begin), time) & s.lt(time, s.load(&points.end));
                let known = s.select(there, s.splat(*known), s.splat(-1.0));
                write(s, to_known, end, s.compress(known, near));
            }
            let to: &mut Lanes<u32> = (&mut place[end..end + LANES]).try_into().expect("sixteen");
            let places = s.add_u(s.load_u(&LANE), s.splat_u(pick * LANES as u32));
            s.store_u(s.compress_u(places, near), to);
            end += near.count_ones() as usize;
        }
        to_x[end..end + LANES].fill(f32::INFINITY);
        end.div_ceil(LANES)
    }

    /// Finds which of the points gathered come as near as their bounds to one that goes from a place by a way, all but
    /// known ones; their number.
    #[inline(always)]
    fn passing<S: Simd, const KNOWN: bool>(
        &mut self,
        s: S,
        (from, way): ([f32; 3], [f32; 3]),
        pass_over: bool,
        vectors: usize,
    ) -> usize {
        let Rows { first: [xs, ys, zs], passing: [us, vs, ws], bound, known, place } = &self.rows;
        if self.hits.len() < (vectors + 1) * LANES {
            self.hits.resize((2 * vectors + 1) * LANES, 0);
        }
        let from = [s.splat(from[0]), s.splat(from[1]), s.splat(from[2])];
        let way = [s.splat(way[0]), s.splat(way[1]), s.splat(way[2])];
        let (zero, one, least) = (s.splat(0.0), s.splat(1.0), s.splat(f32::MIN_POSITIVE));
        let nothing_known = if pass_over { 0 } else { u16::MAX };
        let (hits, mut end) = (&mut self.hits[..], 0);
        for at in (0..vectors * LANES).step_by(LANES) {
            let x = s.load(lanes_at(xs, at)) - from[0];
            let y = s.load(lanes_at(ys, at)) - from[1];
            let z = s.load(lanes_at(zs, at)) - from[2];
            // The other way round, so that the nearest approach is at `d·w / w·w`.
            let u = way[0] - s.load(lanes_at(us, at));
            let v = way[1] - s.load(lanes_at(vs, at));
            let w = way[2] - s.load(lanes_at(ws, at));
            let speed = s.max(dot(s, [u, v, w], [u, v, w]), least);
            let time = s.max(s.min(dot(s, [x, y, z], [u, v, w]) / speed, one), zero);
            let (a, b, c) = (x - u * time, y - v * time, z - w * time);
            let mut near = s.le(dot(s, [a, b, c], [a, b, c]), s.load(lanes_at(bound, at)));
            if KNOWN {
                let listed = s.le(squared::<S>(x, y, z), s.load(lanes_at(known, at)));
                near &= !listed | nothing_known;
            }
            let to: &mut Lanes<u32> = (&mut hits[end..end + LANES]).try_into().expect("sixteen");
            s.store_u(s.compress_u(s.load_u(lanes_at(place, at)), near), to);
            end += near.count_ones() as usize;
        }
        end
    }

    /// Looks at hits in f64.
    #[inline(always)]
    fn look_at<S: Simd, V: Visitor>(
        &mut self,
        s: S,
        partners: &Partners,
        own: &Flight,
        hits: usize,
        question: &Question,
        visitor: &mut V,
    ) {
        if self.others.len() * WIDE <= hits {
            self.others.resize(2 * hits / WIDE + 2, Four::everlasting());
        }
        let (hits, others) = (&self.hits[..hits], &mut self.others[..]);
        let mut next = 0;
        for (window, end) in &partners.windows {
            let mut count = 0;
            while let Some(&place) = hits.get(next)
                && (place as usize) < end * LANES
            {
                next += 1;
                let points = &partners.blocks[place as usize / LANES].block.points;
                let lane = place as usize % LANES;
                others[count / WIDE].set(count % WIDE, (points, lane), question.mortal);
                // Itself is written over by the next.
                count += usize::from(points.id[lane] != own.id);
            }
            window.encounters(s, own, (others, count), question, visitor);
        }
    }
}

impl Rows {
    fn make_room(&mut self, length: usize) {
        if self.place.len() < length {
            let Rows { first, passing, bound, known, place } = self;
            for row in first.iter_mut().chain(passing).chain([bound, known]) {
                row.resize(2 * length, 0.0);
            }
            place.resize(2 * length, 0);
        }
    }
}

/// How far ways are from `[lo, hi]` along an axis.
#[inline(always)]
fn gap<S: Simd>(s: S, from: S::F, way: S::F, lo: S::F, hi: S::F) -> S::F {
    let to = from + way;
    s.max_with_zero(s.min(from, to) - hi, lo - s.max(from, to))
}

/// For culling only.
#[inline(always)]
fn dot<S: Simd>(s: S, [x, y, z]: [S::F; 3], [u, v, w]: [S::F; 3]) -> S::F {
    s.mul_add(z, w, s.mul_add(y, v, x * u))
}

#[inline(always)]
fn write<S: Simd>(s: S, row: &mut [f32], at: usize, x: S::F) {
    let to: &mut Lanes<f32> = (&mut row[at..at + LANES]).try_into().expect("sixteen");
    s.store(x, to);
}
