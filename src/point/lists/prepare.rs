//! What is computed before lists are made: the groups of leaves, how far points reach, and whether all is within bounds.

use super::error::{ListError, RadiusOf};
use super::list_request::ListRequest;
use super::periodic_box::MOST_PERIODS;
use super::reach::Reach;
use crate::point::layout::over_interval::bottom_nodes;
use crate::point::layout::view::CoordinateView;
use crate::point::search::layers::{LayerView, with_view};
use crate::point::tree::PointTree;
use crate::simd::{Kernel, LANES, Simd, dispatch};
use glam::Vec3;

/// A bottom node, whose sixteen leaves are a group: the index of the layer, and of the node in it.
pub(super) type BottomNode = (usize, usize);

/// What is prepared before lists are made.
#[derive(Clone, Debug, Default)]
pub(super) struct Prepared {
    pub(super) groups: Vec<BottomNode>,
    /// By layer of the listed set, where radii of the listed points count.
    pub(super) reaches: Vec<Reach>,
    /// The largest of these radii.
    pub(super) most_reach: f32,
}

impl Prepared {
    pub(super) fn bytes(&self) -> usize {
        let reaches: usize = self.reaches.iter().map(Reach::bytes).sum();
        self.groups.capacity() * size_of::<BottomNode>() + reaches
    }
}

/// Prepares a request: finds the groups, measures how far points reach, and validates coordinates and radii.
pub(super) fn prepare(request: &ListRequest<'_>, prepared: &mut Prepared) -> Result<(), ListError> {
    let (simd, time) = (request.tree.simd, request.time);
    prepared.groups.clear();
    prepared.most_reach = 0.0;
    // Positions in f64 are measured from here.
    let origin = request.tree.origin();
    for (number, layer) in request.tree.layers.iter().enumerate() {
        let nodes = bottom_nodes(layer.boxes_at(time), [time; 2]);
        prepared.groups.extend(nodes.into_iter().map(|node| (number, node)));
    }
    for layer in request.tree.layers.iter().chain(&request.others().layers) {
        let most = with_view!(layer.at(origin, time), view => dispatch(simd, Extent { view }));
        for (axis, length) in request.periods.iter().enumerate() {
            if length.is_some_and(|length| f64::from(most[axis]) > MOST_PERIODS * length) {
                return Err(ListError::FarFromPeriod { axis });
            }
        }
    }
    let mut measure = |tree: &PointTree, radii: &[f32], of: fn(u32) -> RadiusOf| {
        let count = tree.layers.len();
        prepared.reaches.resize(prepared.reaches.len().max(count), Reach::default());
        for (layer, reach) in tree.layers.iter().zip(&mut prepared.reaches) {
            reach.measure_at(layer, time, radii);
        }
        match prepared.reaches[..count].iter().filter_map(|reach| reach.missing).min() {
            Some(id) => Err(ListError::MissingRadius { of: of(id) }),
            None => Ok(()),
        }
    };
    let radii = &request.listing.radii;
    if let Some(own) = radii.own() {
        measure(request.tree, own, RadiusOf::Point)?;
    }
    if let Some(others) = radii.others() {
        measure(request.others(), others, RadiusOf::Listed)?;
        let reaches = &prepared.reaches[..request.others().layers.len()];
        prepared.most_reach = reaches.iter().fold(0.0, |most, reach| reach.most.max(most));
    }
    Ok(())
}

/// The largest magnitude of a coordinate along each axis.
struct Extent<V> {
    view: V,
}

impl<V: CoordinateView> Kernel for Extent<V> {
    type Output = [f32; 3];
    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> [f32; 3] {
        let target = self.view.target(s, Vec3::ZERO);
        let node = self.view.root().1;
        let present = self.view.present(s, &target, node);
        let (lo, hi) = self.view.faces(s, &target, node);
        let mut most = [0.0f32; 3];
        for axis in 0..3 {
            let (mut below, mut above) = ([0.0; LANES], [0.0; LANES]);
            s.store(lo[axis], &mut below);
            s.store(hi[axis], &mut above);
            for lane in (0..LANES).filter(|lane| present >> lane & 1 != 0) {
                most[axis] = most[axis].max(below[lane].abs()).max(above[lane].abs());
            }
        }
        most
    }
}
