//! What the measurements rest on: the oracle, the structures of others, accuracy, counted work, files.

mod ablations;
mod accuracy;
mod kiddo;
mod oracle;
mod particle_files;
mod peers;
mod point_structures;
mod ray_structures;
#[path = "../../../tests/points/support.rs"]
mod support;

// The support file expects it here.
use mbkd_scenes as random;
