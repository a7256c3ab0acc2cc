//! Single rays and their hits, as Embree takes and returns them.

use super::INVALID_ID;
use mbkd::{Hit, Ray};
use std::ffi::c_uint;
use std::mem::{offset_of, size_of};

/// `RTCRay`.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub struct EmbreeRay {
    pub origin: [f32; 3],
    pub tnear: f32,
    pub dir: [f32; 3],
    pub time: f32,
    pub tfar: f32,
    mask: c_uint,
    id: c_uint,
    flags: c_uint,
}

impl From<&Ray> for EmbreeRay {
    fn from(ray: &Ray) -> EmbreeRay {
        EmbreeRay {
            origin: ray.origin.as_vec3().to_array(),
            tnear: ray.t_min,
            dir: ray.dir.to_array(),
            time: ray.time,
            tfar: ray.t_max,
            mask: c_uint::MAX,
            id: 0,
            flags: 0,
        }
    }
}

impl EmbreeRay {
    /// A ray that sees the geometries whose masks share a bit with this one.
    pub fn masked(ray: &Ray, mask: u32) -> EmbreeRay {
        EmbreeRay { mask, ..EmbreeRay::from(ray) }
    }
}

/// `RTCHit` with one instance level, and room for the instanced primitive that 4.3 and later write behind it.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub(super) struct RtcHit {
    normal: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub primitive: c_uint,
    pub geometry: c_uint,
    instance: c_uint,
    instance_primitive: c_uint,
}

impl RtcHit {
    pub const NONE: RtcHit = RtcHit {
        normal: [0.0; 3],
        u: 0.0,
        v: 0.0,
        primitive: INVALID_ID,
        geometry: INVALID_ID,
        instance: INVALID_ID,
        instance_primitive: INVALID_ID,
    };
}

/// `RTCRayHit`.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub(super) struct RtcRayHit {
    pub ray: EmbreeRay,
    pub hit: RtcHit,
}

impl RtcRayHit {
    #[inline(always)]
    pub fn answer(&self) -> Option<Hit> {
        (self.hit.geometry != INVALID_ID).then_some(Hit {
            t: self.ray.tfar,
            u: self.hit.u,
            v: self.hit.v,
            mesh: self.hit.geometry,
            primitive: self.hit.primitive,
        })
    }
}

const _: () = {
    assert!(size_of::<EmbreeRay>() == 48 && offset_of!(EmbreeRay, tfar) == 32);
    assert!(offset_of!(RtcHit, primitive) == 20 && offset_of!(RtcHit, instance_primitive) == 32);
    assert!(offset_of!(RtcRayHit, hit) == 48 && align_of::<RtcRayHit>() == 16);
};
