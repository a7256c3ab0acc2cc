//! Sixteen lanes with run-time dispatch, and the aligned memory they read.
//!
//! A query kernel is written once, generic over [`Simd`], as plain straight-line code. On x86-64, [`dispatch()`] compiles
//! it three times (SSE2, AVX2, AVX-512) and runs the widest version that the CPU has, so a default build reaches AVX-512
//! without compiler flags. (A build for CPUs with more than SSE2, by `-C target-cpu`, compiles nothing narrower than they have.) On
//! AArch64 it is compiled once, for NEON. Other architectures run the plain lanes of `portable`, against which all instruction sets
//! are tested. The picture to have in mind: a token `s` of type `S: Simd` is the proof that the CPU has the instructions, and every
//! vector is made from it.
//!
//! All lane operations except [`Simd::mul_add`], [`Simd::negated_mul_add`] and [`Simd::mul_add_one`] give the same bits on
//! every instruction set; answers are computed with those. These three fuse where the hardware does and are for culling
//! only, which has to be conservative but not reproducible.
//!
//! This module holds the only `unsafe` code of the crate.
#![allow(unsafe_code)]

mod arena;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
#[cfg(target_arch = "x86_64")]
mod doubles;
mod fill;
mod greatest;
mod huge_pages;
mod instructions;
mod lanes;
#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(target_arch = "aarch64")]
mod neon_doubles;
mod network;
mod operators;
mod points;
mod portable;
mod prefetch;
#[cfg(target_arch = "x86_64")]
mod sse2;
mod stack;
mod transpose;
mod vector;

pub(crate) use arena::Arena;
pub use dispatch::SimdLevel;
pub(crate) use dispatch::{dispatch, dispatch_or};
pub(crate) use fill::fill;
pub(crate) use greatest::greatest_of_each;
pub(crate) use huge_pages::{concat, huge_vec, huge_vec_of};
pub(crate) use instructions::{Kernel, Simd};
pub(crate) use lanes::{
    LANES, Lanes, Mask, Rows, as_coordinates, as_floats, first_lanes, lanes_at, lanes_at_mut, lanes_of,
};
pub(crate) use network::merge_lanes;
pub(crate) use points::{Item, MovingPointBlock, PointBlock, WordBlock};
pub(crate) use portable::Portable;
pub(crate) use prefetch::prefetch;
pub(crate) use stack::{Stack, StackMemory};
pub(crate) use transpose::transpose;
pub(crate) use vector::{THREE, cross, magnitude, vector, vector_lanes};

#[cfg(test)]
mod tests;
