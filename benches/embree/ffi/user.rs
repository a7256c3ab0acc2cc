//! Embree's user geometry: the caller's shapes, with callbacks for their bounds and their hits.

use super::{EmbreeRay, EmbreeScene, GEOMETRY_TYPE_USER, RtcRayHit};
use glam::Vec3;
use mbkd::glam;
use std::ffi::{c_int, c_uint, c_void};
use std::mem::{offset_of, size_of};
use std::ptr::from_ref;

/// Shapes and their functions.
pub struct UserShapes<T, B, H> {
    pub shapes: Vec<T>,
    pub time_steps: u32,
    /// The least and the greatest corner of a shape's box at a time step.
    pub bounds: B,
    /// Where a ray first hits a shape within its range.
    pub hit: H,
}

/// `RTCBounds`.
#[repr(C, align(16))]
struct Bounds {
    min: [f32; 4],
    max: [f32; 4],
}

/// `RTCBoundsFunctionArguments`.
#[repr(C)]
pub(super) struct BoundsArguments {
    user: *mut c_void,
    primitive: c_uint,
    time_step: c_uint,
    bounds: *mut Bounds,
}

/// `RTCIntersectFunctionNArguments` and `RTCOccludedFunctionNArguments`, which has a ray without a hit.
#[repr(C)]
pub(super) struct HitArguments {
    valid: *mut c_int,
    user: *mut c_void,
    primitive: c_uint,
    context: *mut c_void,
    ray: *mut c_void,
    count: c_uint,
    geometry: c_uint,
}

const _: () = {
    assert!(size_of::<Bounds>() == 32 && offset_of!(BoundsArguments, bounds) == 16);
    assert!(offset_of!(HitArguments, ray) == 32 && offset_of!(HitArguments, geometry) == 44);
};

pub(super) type BoundsFunction = unsafe extern "C" fn(*const BoundsArguments);
pub(super) type HitFunction = unsafe extern "C" fn(*const HitArguments);

unsafe extern "C" fn bounds<T, B: Fn(&T, u32) -> [Vec3; 2], H>(arguments: *const BoundsArguments) {
    // SAFETY: Embree passes the arguments of the header, with the `UserShapes` of `attach_user`, which outlive the scene, one of
    // its primitives, and a place for the result.
    unsafe {
        let arguments = &*arguments;
        let user = &*arguments.user.cast::<UserShapes<T, B, H>>();
        let corners = (user.bounds)(&user.shapes[arguments.primitive as usize], arguments.time_step);
        let [min, max] = corners.map(|corner| corner.extend(0.0).to_array());
        *arguments.bounds = Bounds { min, max };
    }
}

unsafe extern "C" fn intersect<T, B, H: Fn(&T, &EmbreeRay) -> Option<f32>>(arguments: *const HitArguments) {
    // SAFETY: as in `bounds`; single rays only, so there is one RTCRayHit.
    unsafe {
        let arguments = &*arguments;
        let user = &*arguments.user.cast::<UserShapes<T, B, H>>();
        let it = &mut *arguments.ray.cast::<RtcRayHit>();
        if *arguments.valid != 0
            && let Some(t) = (user.hit)(&user.shapes[arguments.primitive as usize], &it.ray)
        {
            it.ray.tfar = t;
            (it.hit.u, it.hit.v) = (0.0, 0.0);
            (it.hit.geometry, it.hit.primitive) = (arguments.geometry, arguments.primitive);
        }
    }
}

unsafe extern "C" fn occluded<T, B, H: Fn(&T, &EmbreeRay) -> Option<f32>>(arguments: *const HitArguments) {
    // SAFETY: as in `intersect`, with one RTCRay.
    unsafe {
        let arguments = &*arguments;
        let user = &*arguments.user.cast::<UserShapes<T, B, H>>();
        let ray = &mut *arguments.ray.cast::<EmbreeRay>();
        if *arguments.valid != 0 && (user.hit)(&user.shapes[arguments.primitive as usize], ray).is_some() {
            ray.tfar = f32::NEG_INFINITY;
        }
    }
}

impl<'d> EmbreeScene<'d> {
    /// Adds shapes with this geometry id.
    pub fn attach_user<T, B, H>(&self, id: u32, user: &'d UserShapes<T, B, H>) -> Result<(), String>
    where
        B: Fn(&T, u32) -> [Vec3; 2],
        H: Fn(&T, &EmbreeRay) -> Option<f32>,
    {
        let f = &self.device.embree.functions;
        // SAFETY: live handles; the shapes outlive the scene, and the callbacks are called with them; the scene keeps its own
        // reference to the geometry.
        unsafe {
            let geometry = (f.new_geometry)(self.device.handle, GEOMETRY_TYPE_USER);
            (f.set_time_steps)(geometry, user.time_steps);
            (f.set_user_count)(geometry, user.shapes.len() as c_uint);
            (f.set_user_data)(geometry, from_ref(user).cast());
            (f.set_bounds_function)(geometry, bounds::<T, B, H>, std::ptr::null_mut());
            (f.set_intersect_function)(geometry, intersect::<T, B, H>);
            (f.set_occluded_function)(geometry, occluded::<T, B, H>);
            (f.commit_geometry)(geometry);
            (f.attach_geometry_by_id)(self.handle, geometry, id);
            (f.release_geometry)(geometry);
        }
        self.device.check("taking shapes")
    }
}
