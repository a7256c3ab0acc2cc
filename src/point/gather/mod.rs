//! Gathering photons at a time: density estimates over photons that have a time of their own.
//!
//! A photon map answers how much light arrives at a place *at a time*: photons are weighed by their distance in space
//! and by how far their own time is from the query's ([`PhotonMap`]). The other way round, for progressive photon
//! mapping, visible points wait for photons ([`VisiblePoints`]).
//!
//! Data flows `photon` (input) → `span_order` (who is whose neighbour in space and time) → `span_tree` (boxes) →
//! `span_view`, `stamped` (the tree as the searches of this crate see it) → `index` and `search` (finding) → `map` (summing).
//! docs/gather.md says when to use which form.
//!
//! Sources: M. Cammarano and H. W. Jensen, "Time Dependent Photon Mapping" (2002); T. Hachisuka, S. Ogaki and H. W.
//! Jensen, "Progressive Photon Mapping" (2008); T. Hachisuka and H. W. Jensen, "Stochastic Progressive Photon Mapping"
//! (2009).

mod error;
mod index;
mod kernel;
mod map;
mod params;
mod photon;
mod query;
mod scratch;
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
pub use photon::{Flux, Photon, PhotonTime};
pub use query::GatherQuery;
pub use scratch::GatherScratch;
pub use visible::{VisiblePoint, VisiblePoints};
