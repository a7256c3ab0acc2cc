//! Neighbours against comparing all points: every structure and instruction set, properties, the interface.

#[cfg(feature = "rayon")]
mod api;
mod approximate;
mod bounds;
mod double;
#[cfg(feature = "rayon")]
mod double_lists;
#[path = "../support/encounter.rs"]
mod encounter;
mod exact;
mod far_away;
mod fickle;
mod gather;
#[path = "../support/gather_case.rs"]
mod gather_case;
mod gather_periodic;
mod gather_theory;
#[cfg(feature = "rayon")]
mod list_case;
#[cfg(feature = "rayon")]
mod lists;
mod lists_scattered;
#[cfg(feature = "rayon")]
mod lists_skin;
#[cfg(feature = "rayon")]
mod lists_skin_periodic;
#[cfg(feature = "rayon")]
mod lists_skin_radii;
#[cfg(feature = "rayon")]
mod lists_swept;
#[cfg(feature = "rayon")]
mod lists_swept_among;
#[cfg(feature = "rayon")]
mod lists_swept_periodic;
mod outliers;
#[cfg(feature = "rayon")]
mod paddings;
#[cfg(feature = "rayon")]
mod periodic;
mod periodic_approach;
mod periodic_queries;
#[cfg(feature = "rayon")]
mod progress;
mod property;
/// Included as source: see `scene` in the tests of rays.
#[allow(dead_code)]
#[path = "../../scenes/src/random.rs"]
mod random;
mod rebuilds;
mod set;
#[cfg(feature = "rayon")]
mod skin_case;
mod support;
mod visitors;
