//! Packets of sixteen rays, as Embree takes them.

use super::{EmbreeRay, INVALID_ID};
use mbkd::{Hit, Ray};
use std::ffi::c_uint;
use std::mem::{offset_of, size_of};

/// Rays of one packet query.
pub const PACKET: usize = 16;

/// `RTCRayHit16`: sixteen rays, each field an array.
#[derive(Clone)]
#[repr(C, align(64))]
pub struct Packet {
    origin: [[f32; PACKET]; 3],
    tnear: [f32; PACKET],
    dir: [[f32; PACKET]; 3],
    time: [f32; PACKET],
    pub(super) tfar: [f32; PACKET],
    mask: [c_uint; PACKET],
    id: [c_uint; PACKET],
    flags: [c_uint; PACKET],
    normal: [[f32; PACKET]; 3],
    u: [f32; PACKET],
    v: [f32; PACKET],
    primitive: [c_uint; PACKET],
    geometry: [c_uint; PACKET],
    instance: [c_uint; PACKET],
    instance_primitive: [c_uint; PACKET],
}

impl Packet {
    /// Up to sixteen rays; unused lanes have an empty range.
    pub fn new(rays: &[Ray]) -> Packet {
        let ray = |i: usize| rays.get(i).map(EmbreeRay::from);
        let field = |get: &dyn Fn(EmbreeRay) -> f32, none: f32| std::array::from_fn(|i| ray(i).map_or(none, get));
        Packet {
            origin: std::array::from_fn(|axis| field(&|r| r.origin[axis], 0.0)),
            tnear: field(&|r| r.tnear, 1.0),
            dir: std::array::from_fn(|axis| field(&|r| r.dir[axis], 1.0)),
            time: field(&|r| r.time, 0.0),
            tfar: field(&|r| r.tfar, -1.0),
            mask: [c_uint::MAX; PACKET],
            id: [0; PACKET],
            flags: [0; PACKET],
            normal: [[0.0; PACKET]; 3],
            u: [0.0; PACKET],
            v: [0.0; PACKET],
            primitive: [INVALID_ID; PACKET],
            geometry: [INVALID_ID; PACKET],
            instance: [INVALID_ID; PACKET],
            instance_primitive: [INVALID_ID; PACKET],
        }
    }

    pub(super) fn hit(&self, i: usize) -> Option<Hit> {
        (self.geometry[i] != INVALID_ID).then(|| Hit {
            t: self.tfar[i],
            u: self.u[i],
            v: self.v[i],
            mesh: self.geometry[i],
            primitive: self.primitive[i],
        })
    }
}

const _: () = {
    assert!(size_of::<Packet>() == 21 * 64 && align_of::<Packet>() == 64);
    assert!(offset_of!(Packet, tfar) == 512 && offset_of!(Packet, geometry) == 1152);
};
