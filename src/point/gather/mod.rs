//! Gathering photons at a time: density estimates over photons that have a time of their own.
//!
//! A photon map estimates how much light arrives at a position *at a time*: photons are weighted by their distance in space
//! and by the difference of their time to the query's ([`PhotonMap`]). The inverse, for progressive photon
//! mapping, finds the visible points that each photon contributes to ([`VisiblePoints`]).
//!
//! Data flows `photon` (input) → `span_order` (ordering in space and time) → `span_tree` (boxes) →
//! `span_view`, `stamped` (the views that the searches of this crate use) → `index` and `search` (finding) → `map`
//! (summing), in periodic boxes by way of `periodic`. docs/gather.md tells when to use which form.
//!
//! Sources: M. Cammarano and H. W. Jensen, "Time Dependent Photon Mapping" (2002); T. Hachisuka, S. Ogaki and H. W.
//! Jensen, "Progressive Photon Mapping" (2008); T. Hachisuka and H. W. Jensen, "Stochastic Progressive Photon Mapping"
//! (2009).

mod error;
mod index;
mod kernel;
mod map;
mod params;
mod periodic;
mod photon;
mod query;
mod search;
mod span_order;
mod span_tree;
mod span_view;
mod stamped;
mod visible;

pub use error::GatherError;
pub use kernel::Kernel;
pub use map::{Gathered, PhotonMap};
pub use params::GatherParams;
pub use periodic::PeriodicPhotons;
pub use photon::{Flux, Photon, PhotonTime};
pub use query::GatherQuery;
pub use visible::{VisiblePoint, VisiblePoints};
