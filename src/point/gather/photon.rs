//! Photons as callers give them: position, normal, flux and time.

use crate::geometry::TimeInterval;
use core::ops::{Add, Mul};
use glam::{Vec3, Vec4};

/// The flux of photons: light in any number of channels. `Default` is no light.
///
/// Implemented for `f32`, [`Vec3`] and [`Vec4`]; for spectra of your own implement the sum, the product with a weight,
/// and the check.
pub trait Flux: Copy + Send + Sync + Default + Add<Output = Self> + Mul<f32, Output = Self> {
    /// Whether every channel is finite.
    fn is_finite(&self) -> bool;
}

impl Flux for f32 {
    fn is_finite(&self) -> bool {
        f32::is_finite(*self)
    }
}

impl Flux for Vec3 {
    fn is_finite(&self) -> bool {
        Vec3::is_finite(*self)
    }
}

impl Flux for Vec4 {
    fn is_finite(&self) -> bool {
        Vec4::is_finite(*self)
    }
}

/// The time of a photon, and whether it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhotonTime {
    /// It arrived at this time and stays where it arrived. A gather weights it by the difference of the times.
    At(f32),
    /// It represents light that arrives uniformly during this interval. A gather at a time in it counts the photon with
    /// the weight 1 / duration (at most 2^126), whatever the gather's window is.
    During(TimeInterval),
    /// It arrived at `time` on a moving surface: at another time t it is at `position + velocity * (t - time)`. A
    /// gather weights it like [`PhotonTime::At`].
    Carried {
        /// The time of its arrival.
        time: f32,
        /// Velocity in units of space per shutter.
        velocity: Vec3,
    },
}

/// A photon on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photon<F> {
    /// Where it arrived.
    pub position: Vec3,
    /// Unit normal of the surface there. (One that is not of unit length scales the cosine of the cutoff.)
    pub normal: Vec3,
    /// The light that it carries: energy over the whole shutter.
    pub flux: F,
    /// Its time.
    pub time: PhotonTime,
}

impl<F> Photon<F> {
    /// A photon with a time stamp.
    pub fn at_time(position: Vec3, normal: Vec3, flux: F, time: f32) -> Photon<F> {
        Photon { position, normal, flux, time: PhotonTime::At(time) }
    }
}
