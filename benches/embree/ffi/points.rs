//! Embree's point queries: it visits the triangles whose boxes are within a radius, nearer ones first, and calls back for each of
//! them. The callback computes the distance and shrinks the radius.

use super::{EmbreeScene, Handle, INVALID_ID};
use std::ffi::{c_uint, c_void};
use std::mem::{offset_of, size_of};
use std::ptr::from_mut;

/// `RTCPointQuery`.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub struct PointQuery {
    pub point: [f32; 3],
    pub time: f32,
    pub radius: f32,
}

/// `RTCPointQueryContext` with one instance level and no instances. Version 4.3 and later have the instanced primitive in front of
/// the number of instances, so that number is either of the last two words.
#[repr(C, align(16))]
pub(super) struct PointContext {
    matrices: [[f32; 16]; 2],
    instance: c_uint,
    zeros: [c_uint; 2],
}

/// `RTCPointQueryFunctionArguments`.
#[repr(C, align(16))]
pub(super) struct Arguments {
    query: *mut PointQuery,
    user: *mut c_void,
    primitive: c_uint,
    geometry: c_uint,
    context: *mut PointContext,
    scale: f32,
}

const _: () = {
    assert!(size_of::<PointQuery>() == 32 && offset_of!(PointQuery, radius) == 16);
    assert!(size_of::<PointContext>() == 144 && offset_of!(PointContext, zeros) == 132);
    assert!(offset_of!(Arguments, primitive) == 16 && offset_of!(Arguments, scale) == 32);
};

pub(super) type Callback = unsafe extern "C" fn(*mut Arguments) -> bool;
pub(super) type PointQueryFunction =
    unsafe extern "C" fn(Handle, *mut PointQuery, *mut PointContext, Option<Callback>, *mut c_void) -> bool;

/// The callback, with an `F` behind the user's pointer.
unsafe extern "C" fn visit<F: FnMut(&PointQuery, u32, u32) -> Option<f32>>(arguments: *mut Arguments) -> bool {
    // SAFETY: Embree passes the arguments of the header, with the pointers that `EmbreeScene::visit_near` gave it: its query and an
    // `F`, both alive through the query and used by nothing else meanwhile.
    let (query, near, primitive, geometry) = unsafe {
        let arguments = &*arguments;
        (&mut *arguments.query, &mut *arguments.user.cast::<F>(), arguments.primitive, arguments.geometry)
    };
    let nearer = near(query, geometry, primitive);
    if let Some(radius) = nearer {
        query.radius = radius;
    }
    nearer.is_some()
}

impl EmbreeScene<'_> {
    /// `rtcPointQuery`: `near` gets the query, the geometry and the primitive, and returns the new radius if that is smaller.
    #[inline]
    pub fn visit_near<F: FnMut(&PointQuery, u32, u32) -> Option<f32>>(&self, query: &PointQuery, mut near: F) {
        let mut query = *query;
        let mut context = PointContext { matrices: [[0.0; 16]; 2], instance: INVALID_ID, zeros: [0; 2] };
        let user = from_mut(&mut near).cast();
        // SAFETY: a committed scene, and structures laid out as the header says, alive through the call; `visit` is called with
        // `user`, which is an `F`.
        unsafe {
            (self.device.embree.functions.point_query)(self.handle, &mut query, &mut context, Some(visit::<F>), user);
        }
    }
}
