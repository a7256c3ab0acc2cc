//! Embree's filter functions: it calls back for each hit that it finds, and goes on as if those that are rejected did not exist.

use super::{EmbreeRay, EmbreeScene, Handle, Mesh, RtcHit};
use mbkd::Hit;
use std::ffi::{c_int, c_uint, c_void};
use std::mem::{offset_of, size_of};
use std::ptr::from_ref;

/// `RTCFilterFunctionNArguments`; for single rays there is one ray and one hit, laid out as `RTCRay` and `RTCHit`.
#[repr(C)]
pub(super) struct Arguments {
    valid: *mut c_int,
    user: *const c_void,
    context: *const c_void,
    ray: *const EmbreeRay,
    hit: *const RtcHit,
    count: c_uint,
}

const _: () = assert!(size_of::<Arguments>() == 48 && offset_of!(Arguments, count) == 40);

pub(super) type Callback = unsafe extern "C" fn(*const Arguments);
pub(super) type FilterFunction = unsafe extern "C" fn(Handle, Callback);

/// The callback, with an `F` behind the geometry's pointer.
unsafe extern "C" fn filter<F: Fn(&Hit) -> bool>(arguments: *const Arguments) {
    // SAFETY: Embree passes the arguments of the header, and the pointer that `attach_filtered` gave it: an `F` that outlives the
    // scene. The fields of the hit that are read precede those in which the versions differ.
    unsafe {
        let Arguments { valid, user, ray, hit, .. } = *arguments;
        let hit = Hit { t: (*ray).tfar, u: (*hit).u, v: (*hit).v, mesh: (*hit).geometry, primitive: (*hit).primitive };
        if !(*user.cast::<F>())(&hit) {
            *valid = 0;
        }
    }
}

impl<'d> EmbreeScene<'d> {
    /// As [`EmbreeScene::attach`], with a filter of the hits of single rays.
    pub fn attach_filtered<F: Fn(&Hit) -> bool>(&self, id: u32, mesh: &Mesh<'_>, accept: &'d F) -> Result<(), String> {
        let f = &self.device.embree.functions;
        self.attach_with(id, mesh, |geometry| {
            // SAFETY: a live geometry; `accept` outlives the scene, and `filter` is called with it.
            unsafe {
                (f.set_user_data)(geometry, from_ref(accept).cast());
                (f.set_intersect_filter)(geometry, filter::<F>);
                (f.set_occluded_filter)(geometry, filter::<F>);
            }
        })
    }
}
