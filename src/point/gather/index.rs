//! The index of a photon map: the trees over photon positions, and the data that the tests of a query need.
//!
//! Photons with a time stamp are in a tree over space and time, the others in a [`PointTree`]: those that exist for a
//! while, and those that move with their surface, which are active in it for as long as a window can reach them. Each
//! photon has a *slot*: its index in the order of the first tree, or, after all photons of that one, its index among the
//! others. Photon data are stored by slot, so that photons that are near in space and time are near in memory.

use super::error::GatherError;
use super::params::GatherParams;
use super::photon::{Photon, PhotonTime};
use super::query::check_position;
use super::span_order::{Item, Queries};
use super::stamped::{StampedBlock, StampedTree};
use crate::geometry::{Aabb, KeyTime, TimeInterval};
use crate::point::error::PointError;
use crate::point::params::PointParams;
use crate::point::tree::PointTree;
use crate::primitive::PointSet;
use crate::progress::Progress;
use crate::simd::SimdLevel;
use glam::{DVec3, Vec3};

/// Photons without their flux.
#[derive(Clone)]
pub(super) struct Index {
    pub(super) stamped: StampedTree,
    /// Photons that exist for a while or move with their surface.
    pub(super) others: Option<PointTree>,
    unstamped: Vec<UnstampedPhoton>,
    normals: Vec<Vec3>,
    /// The caller's index of each photon.
    pub(super) ids: Vec<u32>,
    /// Whether some photons move with their surface.
    pub(super) carried: bool,
    /// The widest window for photons that move with their surface; infinite if there are none.
    pub(super) most_window: f32,
    pub(super) simd: SimdLevel,
}

/// A photon that exists for a while or moves with its surface.
#[derive(Clone, Copy)]
struct UnstampedPhoton {
    /// Where it is when the shutter opens and closes.
    ends: [Vec3; 2],
    time_weight: TimeWeight,
}

/// How a photon is weighted in time.
#[derive(Clone, Copy)]
pub(super) enum TimeWeight {
    /// By the difference to its stamp.
    Stamp(f32),
    /// Uniformly: by 1 / duration.
    Even(f32),
}

/// The approximate fractions of a build that are reading the photons, and writing normals and fluxes in the order of the trees.
const READING: f64 = 0.1;
const FINISHING: f64 = 0.1;

/// The unstamped photons as a set of points.
struct UnstampedPhotons<'a> {
    unstamped: &'a [UnstampedPhoton],
    active: &'a [TimeInterval],
    first: u32,
}

impl PointSet for UnstampedPhotons<'_> {
    const WIDE: bool = false;
    fn len(&self) -> usize {
        self.unstamped.len()
    }
    fn keys(&self) -> usize {
        2
    }
    fn position(&self, point: usize, key: usize) -> DVec3 {
        self.unstamped[point].ends[key].as_dvec3()
    }
    fn active(&self, point: usize) -> TimeInterval {
        self.active[point]
    }
    fn id(&self, point: usize) -> u32 {
        self.first + point as u32
    }
}

impl Index {
    /// Builds the trees.
    pub(super) fn build<F>(
        photons: &[Photon<F>],
        params: &GatherParams,
        progress: &Progress,
    ) -> Result<Index, GatherError> {
        params.validate()?;
        if photons.len() >= u32::MAX as usize {
            return Err(GatherError::TooMany { found: photons.len() });
        }
        let (mut items, mut carried) = (Vec::new(), false);
        let (mut unstamped, mut active, mut unstamped_ids) = (Vec::new(), Vec::new(), Vec::new());
        for (number, photon) in photons.iter().enumerate() {
            check(photon).map_err(|error| error.at(number))?;
            let at = photon.position;
            let other = match photon.time {
                PhotonTime::At(time) => {
                    items.push(Item { at: [at.x, at.y, at.z, time, 0.0], index: number as u32 });
                    continue;
                }
                PhotonTime::During(interval) => {
                    active.push(interval);
                    // Intervals may be so short that 1 / duration overflows in f32.
                    let even = 1.0 / interval.duration().max(f32::MIN_POSITIVE);
                    UnstampedPhoton { ends: [at; 2], time_weight: TimeWeight::Even(even) }
                }
                PhotonTime::Carried { time, velocity } => {
                    carried = true;
                    // A little longer than the window; the exact test comes with the query.
                    let reach = params.window + 1e-6 * (1.0 + params.window);
                    active.push(TimeInterval::half_open(time - reach, time + reach).unwrap_or(TimeInterval::FULL));
                    UnstampedPhoton { ends: ends(at, time, velocity), time_weight: TimeWeight::Stamp(time) }
                }
            };
            unstamped.push(other);
            unstamped_ids.push(number as u32);
        }
        progress.finished(READING);
        let first = items.len() as u32;
        let queries = Queries { window: params.window.min(1.0), neighbors: Some(params.neighbors as f32) };
        let of_stamped =
            progress.subtask((1.0 - READING - FINISHING) * items.len() as f64 / photons.len().max(1) as f64);
        let stamped =
            StampedTree::build(&mut items, &queries, &of_stamped, |block: &mut StampedBlock, lane, item, slot| {
                let [x, y, z, time, _] = item.at;
                block.set(lane, Vec3::new(x, y, z), time, slot);
            });
        drop(of_stamped);
        let ids: Vec<u32> = items.iter().map(|item| item.index).chain(unstamped_ids).collect();
        let others = if unstamped.is_empty() {
            None
        } else {
            let structure = PointParams { structure: params.structure, simd: params.simd, ..PointParams::default() };
            let photons = UnstampedPhotons { unstamped: &unstamped, active: &active, first };
            match PointTree::build_reporting(&photons, &structure, &progress.rest(1.0 - FINISHING)) {
                Err(PointError::Cancelled) => return Err(GatherError::Cancelled),
                tree => Some(tree.expect("photons and parameters have been checked")),
            }
        };
        Ok(Index {
            stamped,
            others,
            unstamped,
            normals: ids.iter().map(|&id| photons[id as usize].normal).collect(),
            ids,
            carried,
            most_window: if carried { params.window } else { f32::INFINITY },
            simd: params.simd,
        })
    }

    /// The photon at a slot, unless it is in the tree of stamps.
    #[inline(always)]
    fn unstamped(&self, slot: u32) -> Option<&UnstampedPhoton> {
        (slot as usize).checked_sub(self.stamped.count).map(|number| &self.unstamped[number])
    }

    /// How the photon at a slot is weighted in time.
    #[inline(always)]
    pub(super) fn time_weight(&self, slot: u32) -> TimeWeight {
        self.unstamped(slot).map_or_else(|| TimeWeight::Stamp(self.stamped.stamp(slot)), |photon| photon.time_weight)
    }

    /// Whether a window reaches the time of the photon at a slot. The search of the tree of stamps has tested that
    /// already, and photons that exist for a while do not depend on it.
    #[inline(always)]
    pub(super) fn in_window(&self, slot: u32, time: f32, window: f32) -> bool {
        match self.unstamped(slot).map(|photon| photon.time_weight) {
            Some(TimeWeight::Stamp(stamp)) => (stamp - time).abs() <= window,
            _ => true,
        }
    }

    /// The position of the photon at a slot, at a time.
    pub(super) fn position(&self, slot: u32, at: KeyTime) -> Vec3 {
        match self.unstamped(slot) {
            None => self.stamped.position(slot),
            Some(UnstampedPhoton { ends: [open, close], .. }) => at.position(*open, *close),
        }
    }

    /// The normal of the photon at a slot.
    #[inline(always)]
    pub(super) fn normal(&self, slot: u32) -> Vec3 {
        self.normals[slot as usize]
    }

    /// A box around all photons where queries see them; `None` if there are none.
    pub(super) fn bounds(&self) -> Option<Aabb> {
        let [min, max] = self.stamped.span().map(|[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()));
        let of_stamped = (self.stamped.count > 0).then_some(Aabb { min, max });
        let of_others = self.others.as_ref().and_then(PointTree::bounds);
        of_stamped.into_iter().chain(of_others).reduce(Aabb::union)
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.stamped.bytes()
            + self.others.as_ref().map_or(0, |tree| tree.statistics().bytes())
            + self.unstamped.capacity() * size_of::<UnstampedPhoton>()
            + self.normals.capacity() * size_of::<Vec3>()
            + self.ids.capacity() * size_of::<u32>()
    }
}

/// Checks the numbers of a photon.
fn check<F>(photon: &Photon<F>) -> Result<(), GatherError> {
    if !photon.normal.is_finite() {
        return Err(GatherError::PhotonNormal);
    }
    match photon.time {
        PhotonTime::At(time) => check_position(photon.position, time),
        PhotonTime::During(_) => check_position(photon.position, 0.0),
        PhotonTime::Carried { time, velocity } => {
            check_position(photon.position, time)?;
            ends(photon.position, time, velocity).into_iter().try_for_each(|end| check_position(end, time))
        }
    }
}

/// Where a photon is when the shutter opens and closes, that is at a place at a time.
fn ends(at: Vec3, time: f32, velocity: Vec3) -> [Vec3; 2] {
    [at - velocity * time, at + velocity * (1.0 - time)]
}
