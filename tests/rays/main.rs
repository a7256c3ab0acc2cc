//! Rays against brute force: properties, scenes, bad input, metamorphic relations, counted work.

mod accuracy;
mod active;
mod bad_input;
mod batches;
mod brute_force;
mod closest_point;
mod common;
mod golden;
mod hairball;
mod hidden_instances;
mod instances;
mod keys;
mod lazy;
mod metamorphic;
mod mixed;
mod own_shapes;
mod precise;
mod progress;
mod refit;
mod refit_moved;
mod scenes;
mod secondary_rays;
mod spheres;
mod visitors;
mod watertight;
