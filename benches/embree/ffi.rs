//! Embree, loaded at run time: versions 3.13 and 4.x behind one safe interface.
//!
//! The picture to have in mind: a [`Device`] is one configuration of the library (its own settings, its own memory
//! count), an [`EmbreeScene`] a committed tree that answers rays. Function names and structures are those of Embree's
//! public headers (`rtcore_ray.h`, `rtcore_common.h`, `rtcore_geometry.h`, `rtcore_scene.h`, 3.13.5 and 4.4); sizes and
//! offsets are asserted at compile time. The two versions differ only in how a query takes its context: version 3
//! requires one, version 4 has optional arguments.
//!
//! All calls into Embree are in this module, and with them all `unsafe` code of the program.
#![allow(unsafe_code)]

mod filters;
mod packet;
mod points;
mod single;
mod user;

use glam::Vec3;
use libloading::Library;
use mbkd::{Hit, Pose, Transform, glam};
use std::borrow::Cow;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::mem::{offset_of, size_of};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicIsize, Ordering};

pub use packet::{PACKET, Packet};
pub use points::PointQuery;
pub use single::EmbreeRay;
use single::{RtcHit, RtcRayHit};
pub use user::UserShapes;

const INVALID_ID: c_uint = c_uint::MAX;
const GEOMETRY_TYPE_TRIANGLE: c_int = 0;
const GEOMETRY_TYPE_SPHERE_POINT: c_int = 50;
const GEOMETRY_TYPE_USER: c_int = 120;
const GEOMETRY_TYPE_INSTANCE: c_int = 121;
const BUFFER_TYPE_INDEX: c_int = 0;
const BUFFER_TYPE_VERTEX: c_int = 1;
const FORMAT_UINT3: c_int = 0x5003;
const FORMAT_FLOAT3: c_int = 0x9003;
const FORMAT_FLOAT4: c_int = 0x9004;
const FORMAT_FLOAT3X4_COLUMN_MAJOR: c_int = 0x9234;
const SCENE_FLAG_ROBUST: c_int = 1 << 2;
const DEVICE_PROPERTY_VERSION: c_int = 0;

/// `RTCBuildQuality`. High means spatial splits, for static scenes only.
#[derive(Clone, Copy)]
pub enum Quality {
    Medium = 1,
    High = 2,
}

const _: () = {
    assert!(size_of::<Vec3>() == 12);
    assert!(size_of::<Context3>() == 24 && offset_of!(Context3, instance) == 16);
};

/// `RTCIntersectContext` of Embree 3 with one instance level.
#[repr(C)]
struct Context3 {
    flags: c_int,
    filter: *const c_void,
    instance: c_uint,
}

impl Context3 {
    #[inline(always)]
    fn new() -> Context3 {
        Context3 { flags: 0, filter: null(), instance: INVALID_ID }
    }
}

/// `RTCQuaternionDecomposition`.
#[repr(C, align(16))]
struct Decomposition {
    scale: [f32; 3],
    skew: [f32; 3],
    shift: [f32; 3],
    /// The real part first.
    quaternion: [f32; 4],
    translation: [f32; 3],
}

impl From<&Pose> for Decomposition {
    fn from(pose: &Pose) -> Decomposition {
        let [i, j, k, r] = pose.rotation.as_quat().to_array();
        Decomposition {
            scale: pose.scale.as_vec3().to_array(),
            skew: [0.0; 3],
            shift: [0.0; 3],
            quaternion: [r, i, j, k],
            translation: pose.translation.as_vec3().to_array(),
        }
    }
}

type Handle = *mut c_void;
type MemoryMonitor = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;

/// The queries, whose arguments changed between the versions.
#[derive(Clone, Copy)]
enum Queries {
    V3 {
        intersect1: unsafe extern "C" fn(Handle, *mut Context3, *mut RtcRayHit),
        occluded1: unsafe extern "C" fn(Handle, *mut Context3, *mut EmbreeRay),
        intersect16: unsafe extern "C" fn(*const c_int, Handle, *mut Context3, *mut Packet),
        occluded16: unsafe extern "C" fn(*const c_int, Handle, *mut Context3, *mut Packet),
    },
    V4 {
        intersect1: unsafe extern "C" fn(Handle, *mut RtcRayHit, *const c_void),
        occluded1: unsafe extern "C" fn(Handle, *mut EmbreeRay, *const c_void),
        intersect16: unsafe extern "C" fn(*const c_int, Handle, *mut Packet, *const c_void),
        occluded16: unsafe extern "C" fn(*const c_int, Handle, *mut Packet, *const c_void),
    },
}

/// The functions that both versions share.
#[derive(Clone, Copy)]
struct Functions {
    new_device: unsafe extern "C" fn(*const c_char) -> Handle,
    release_device: unsafe extern "C" fn(Handle),
    device_property: unsafe extern "C" fn(Handle, c_int) -> isize,
    device_error: unsafe extern "C" fn(Handle) -> c_int,
    set_memory_monitor: unsafe extern "C" fn(Handle, MemoryMonitor, *mut c_void),
    new_geometry: unsafe extern "C" fn(Handle, c_int) -> Handle,
    set_user_data: unsafe extern "C" fn(Handle, *const c_void),
    set_intersect_filter: filters::FilterFunction,
    set_occluded_filter: filters::FilterFunction,
    set_time_steps: unsafe extern "C" fn(Handle, c_uint),
    set_new_buffer: unsafe extern "C" fn(Handle, c_int, c_uint, c_int, usize, usize) -> *mut c_void,
    set_mask: unsafe extern "C" fn(Handle, c_uint),
    set_user_count: unsafe extern "C" fn(Handle, c_uint),
    set_bounds_function: unsafe extern "C" fn(Handle, user::BoundsFunction, *mut c_void),
    set_intersect_function: unsafe extern "C" fn(Handle, user::HitFunction),
    set_occluded_function: unsafe extern "C" fn(Handle, user::HitFunction),
    commit_geometry: unsafe extern "C" fn(Handle),
    release_geometry: unsafe extern "C" fn(Handle),
    new_scene: unsafe extern "C" fn(Handle) -> Handle,
    set_scene_flags: unsafe extern "C" fn(Handle, c_int),
    set_scene_build_quality: unsafe extern "C" fn(Handle, c_int),
    attach_geometry_by_id: unsafe extern "C" fn(Handle, Handle, c_uint),
    get_geometry: unsafe extern "C" fn(Handle, c_uint) -> Handle,
    set_instanced_scene: unsafe extern "C" fn(Handle, Handle),
    set_transform: unsafe extern "C" fn(Handle, c_uint, c_int, *const c_void),
    set_transform_quaternion: unsafe extern "C" fn(Handle, c_uint, *const Decomposition),
    commit_scene: unsafe extern "C" fn(Handle),
    point_query: points::PointQueryFunction,
    release_scene: unsafe extern "C" fn(Handle),
}

/// The loaded library.
pub struct Embree {
    functions: Functions,
    queries: Queries,
    /// The file that was loaded.
    pub file: String,
}

impl Embree {
    /// Loads `path`, or the first version found under the usual names (4 before 3).
    pub fn load(path: Option<&str>) -> Result<Embree, String> {
        let usual = [
            "libembree4.so.4",
            "libembree3.so.3",
            "libembree4.dylib",
            "libembree3.dylib",
            "embree4.dll",
            "embree3.dll",
        ];
        let names = path.map_or(usual.to_vec(), |p| vec![p]);
        let mut why = String::new();
        for name in names {
            // SAFETY: loading runs the library's initializers; the user names the file or has it installed.
            match unsafe { Library::new(name) } {
                // Never unloaded: threads of its own may still run in its code when the last device is gone.
                Ok(library) => return Embree::with(Box::leak(Box::new(library)), name),
                Err(error) => why = error.to_string(),
            }
        }
        Err(why)
    }

    fn with(l: &'static Library, name: &str) -> Result<Embree, String> {
        /// The symbol as a function of the type expected at the place of use.
        ///
        /// # Safety
        /// `T` is the function's type in Embree's header.
        unsafe fn symbol<T: Copy>(library: &Library, name: &str) -> Result<T, String> {
            // SAFETY: the caller vouches for the type.
            unsafe { library.get::<T>(name.as_bytes()) }.map(|s| *s).map_err(|e| e.to_string())
        }
        // SAFETY: every field's type is that of the header's declaration; the library stays loaded.
        let functions = unsafe {
            Functions {
                new_device: symbol(l, "rtcNewDevice")?,
                release_device: symbol(l, "rtcReleaseDevice")?,
                device_property: symbol(l, "rtcGetDeviceProperty")?,
                device_error: symbol(l, "rtcGetDeviceError")?,
                set_memory_monitor: symbol(l, "rtcSetDeviceMemoryMonitorFunction")?,
                new_geometry: symbol(l, "rtcNewGeometry")?,
                set_user_data: symbol(l, "rtcSetGeometryUserData")?,
                set_intersect_filter: symbol(l, "rtcSetGeometryIntersectFilterFunction")?,
                set_occluded_filter: symbol(l, "rtcSetGeometryOccludedFilterFunction")?,
                set_time_steps: symbol(l, "rtcSetGeometryTimeStepCount")?,
                set_new_buffer: symbol(l, "rtcSetNewGeometryBuffer")?,
                set_mask: symbol(l, "rtcSetGeometryMask")?,
                set_user_count: symbol(l, "rtcSetGeometryUserPrimitiveCount")?,
                set_bounds_function: symbol(l, "rtcSetGeometryBoundsFunction")?,
                set_intersect_function: symbol(l, "rtcSetGeometryIntersectFunction")?,
                set_occluded_function: symbol(l, "rtcSetGeometryOccludedFunction")?,
                commit_geometry: symbol(l, "rtcCommitGeometry")?,
                release_geometry: symbol(l, "rtcReleaseGeometry")?,
                new_scene: symbol(l, "rtcNewScene")?,
                set_scene_flags: symbol(l, "rtcSetSceneFlags")?,
                set_scene_build_quality: symbol(l, "rtcSetSceneBuildQuality")?,
                attach_geometry_by_id: symbol(l, "rtcAttachGeometryByID")?,
                get_geometry: symbol(l, "rtcGetGeometry")?,
                set_instanced_scene: symbol(l, "rtcSetGeometryInstancedScene")?,
                set_transform: symbol(l, "rtcSetGeometryTransform")?,
                set_transform_quaternion: symbol(l, "rtcSetGeometryTransformQuaternion")?,
                commit_scene: symbol(l, "rtcCommitScene")?,
                point_query: symbol(l, "rtcPointQuery")?,
                release_scene: symbol(l, "rtcReleaseScene")?,
            }
        };
        // SAFETY: a device with default settings, queried for the version and released.
        let version = unsafe {
            let device = (functions.new_device)(null());
            if device.is_null() {
                return Err(format!("{name}: no device (error {})", (functions.device_error)(null_mut())));
            }
            let version = (functions.device_property)(device, DEVICE_PROPERTY_VERSION);
            (functions.release_device)(device);
            version
        };
        // SAFETY: types as in the header of that major version.
        let queries = unsafe {
            match version / 10_000 {
                3 => Queries::V3 {
                    intersect1: symbol(l, "rtcIntersect1")?,
                    occluded1: symbol(l, "rtcOccluded1")?,
                    intersect16: symbol(l, "rtcIntersect16")?,
                    occluded16: symbol(l, "rtcOccluded16")?,
                },
                4 => Queries::V4 {
                    intersect1: symbol(l, "rtcIntersect1")?,
                    occluded1: symbol(l, "rtcOccluded1")?,
                    intersect16: symbol(l, "rtcIntersect16")?,
                    occluded16: symbol(l, "rtcOccluded16")?,
                },
                _ => return Err(format!("{name}: version {version} is neither 3.x nor 4.x")),
            }
        };
        let file = format!("{name} ({}.{}.{})", version / 10_000, version / 100 % 100, version % 100);
        Ok(Embree { functions, queries, file })
    }

    /// A device with Embree's configuration string, for example `"threads=1,isa=avx2"`.
    pub fn device(&self, config: &str) -> Result<Device<'_>, String> {
        let text = CString::new(config).map_err(|e| e.to_string())?;
        // SAFETY: a NUL-terminated string that outlives the call.
        let handle = unsafe { (self.functions.new_device)(text.as_ptr()) };
        if handle.is_null() {
            return Err(format!("Embree refuses the configuration {config:?}"));
        }
        let memory = Box::new(AtomicIsize::new(0));
        let count = std::ptr::from_ref(&*memory).cast_mut().cast();
        // SAFETY: the count lives in a box that the device owns and outlives the handle (see `Drop`).
        unsafe { (self.functions.set_memory_monitor)(handle, count_bytes, count) };
        Ok(Device { embree: self, handle, memory })
    }
}

/// Embree's memory monitor: adds allocated or freed bytes to the counter behind `count`.
unsafe extern "C" fn count_bytes(count: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `count` is the device's atomic, alive while the device is; atomics may be shared by threads.
    unsafe { &*count.cast::<AtomicIsize>() }.fetch_add(bytes, Ordering::Relaxed);
    true
}

/// One configuration of the library.
pub struct Device<'e> {
    embree: &'e Embree,
    handle: Handle,
    memory: Box<AtomicIsize>,
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: made by rtcNewDevice, released once; scenes borrow the device, so none is left.
        unsafe { (self.embree.functions.release_device)(self.handle) };
    }
}

/// Indices, and positions at each time step.
pub struct Mesh<'a> {
    pub indices: &'a [[u32; 3]],
    pub steps: Vec<Cow<'a, [Vec3]>>,
}

impl Device<'_> {
    /// Bytes that the device holds now: buffers and trees.
    pub fn bytes(&self) -> usize {
        self.memory.load(Ordering::Relaxed).max(0) as usize
    }

    fn check(&self, what: &str) -> Result<(), String> {
        // SAFETY: a live device.
        match unsafe { (self.embree.functions.device_error)(self.handle) } {
            0 => Ok(()),
            code => Err(format!("Embree's error {code} while {what}")),
        }
    }

    /// An empty scene.
    pub fn scene(&self, robust: bool, quality: Quality) -> Result<EmbreeScene<'_>, String> {
        let f = &self.embree.functions;
        // SAFETY: a live device; the scene is released by its `Drop`.
        let scene = unsafe { EmbreeScene { device: self, handle: (f.new_scene)(self.handle) } };
        // SAFETY: the scene of the line above.
        unsafe { (f.set_scene_flags)(scene.handle, if robust { SCENE_FLAG_ROBUST } else { 0 }) };
        // SAFETY: the same scene; every value of `Quality` is one of the header's.
        unsafe { (f.set_scene_build_quality)(scene.handle, quality as c_int) };
        self.check("making a scene")?;
        Ok(scene)
    }
}

/// Copies `items` into a new buffer of the geometry.
///
/// # Safety
/// The geometry is alive, and `T` is plain data laid out as the format says.
unsafe fn fill<T: Copy>(
    f: &Functions,
    geometry: Handle,
    (kind, slot, format): (c_int, c_uint, c_int),
    items: &[T],
) -> Result<(), String> {
    // SAFETY: the library returns room for `items.len()` items of this stride (and pads it), or null.
    unsafe {
        let to = (f.set_new_buffer)(geometry, kind, slot, format, size_of::<T>(), items.len());
        if to.is_null() && !items.is_empty() {
            return Err("Embree gave no buffer".to_string());
        }
        std::ptr::copy_nonoverlapping(items.as_ptr().cast::<u8>(), to.cast::<u8>(), size_of_val(items));
    }
    Ok(())
}

/// A scene; answers rays once it is committed.
pub struct EmbreeScene<'d> {
    device: &'d Device<'d>,
    handle: Handle,
}

impl Drop for EmbreeScene<'_> {
    fn drop(&mut self) {
        // SAFETY: made by rtcNewScene, released once.
        unsafe { (self.device.embree.functions.release_scene)(self.handle) };
    }
}

impl EmbreeScene<'_> {
    /// Copies a mesh into buffers of Embree's own and adds it with this geometry id.
    pub fn attach(&self, id: u32, mesh: &Mesh<'_>) -> Result<(), String> {
        self.attach_with(id, mesh, |_| ())
    }

    /// The same, with something done to the geometry before it is committed.
    fn attach_with(&self, id: u32, mesh: &Mesh<'_>, prepare: impl FnOnce(Handle)) -> Result<(), String> {
        let f = &self.device.embree.functions;
        // SAFETY: live handles; all buffers are filled before the geometry is committed; the scene keeps its own
        // reference to the geometry.
        unsafe {
            let geometry = (f.new_geometry)(self.device.handle, GEOMETRY_TYPE_TRIANGLE);
            (f.set_time_steps)(geometry, mesh.steps.len() as c_uint);
            fill(f, geometry, (BUFFER_TYPE_INDEX, 0, FORMAT_UINT3), mesh.indices)?;
            for (slot, step) in mesh.steps.iter().enumerate() {
                fill(f, geometry, (BUFFER_TYPE_VERTEX, slot as c_uint, FORMAT_FLOAT3), step)?;
            }
            prepare(geometry);
            (f.commit_geometry)(geometry);
            (f.attach_geometry_by_id)(self.handle, geometry, id);
            (f.release_geometry)(geometry);
        }
        self.device.check("taking a mesh")
    }

    /// Copies spheres, centers and radii at each time step, and adds them with this geometry id.
    pub fn attach_spheres(&self, id: u32, steps: &[Vec<[f32; 4]>]) -> Result<(), String> {
        let f = &self.device.embree.functions;
        // SAFETY: as in `attach`.
        unsafe {
            let geometry = (f.new_geometry)(self.device.handle, GEOMETRY_TYPE_SPHERE_POINT);
            (f.set_time_steps)(geometry, steps.len() as c_uint);
            for (slot, step) in steps.iter().enumerate() {
                fill(f, geometry, (BUFFER_TYPE_VERTEX, slot as c_uint, FORMAT_FLOAT4), step)?;
            }
            (f.commit_geometry)(geometry);
            (f.attach_geometry_by_id)(self.handle, geometry, id);
            (f.release_geometry)(geometry);
        }
        self.device.check("taking spheres")
    }

    /// Adds an instance of a committed scene with this geometry id. A hit then has the id of the geometry in the placed
    /// scene.
    pub fn attach_instance(&self, id: u32, of: &EmbreeScene<'_>, keys: &Transform) -> Result<(), String> {
        let f = &self.device.embree.functions;
        // SAFETY: live handles; matrices and decompositions are copied by the calls; the scene keeps its own reference to
        // the geometry, and that to the scene that it places.
        unsafe {
            let geometry = (f.new_geometry)(self.device.handle, GEOMETRY_TYPE_INSTANCE);
            (f.set_instanced_scene)(geometry, of.handle);
            match keys {
                Transform::Matrices(keys) => {
                    (f.set_time_steps)(geometry, keys.len() as c_uint);
                    for (key, matrix) in keys.iter().enumerate() {
                        let columns = matrix.to_cols_array().map(|x| x as f32);
                        let format = FORMAT_FLOAT3X4_COLUMN_MAJOR;
                        (f.set_transform)(geometry, key as c_uint, format, columns.as_ptr().cast());
                    }
                }
                Transform::Poses(keys) => {
                    (f.set_time_steps)(geometry, keys.len() as c_uint);
                    for (key, pose) in keys.iter().enumerate() {
                        (f.set_transform_quaternion)(geometry, key as c_uint, &Decomposition::from(pose));
                    }
                }
            }
            (f.commit_geometry)(geometry);
            (f.attach_geometry_by_id)(self.handle, geometry, id);
            (f.release_geometry)(geometry);
        }
        self.device.check("placing a scene")
    }

    /// Sets the mask of a geometry of this scene. To be called before the scene is committed.
    pub fn set_mask(&self, id: u32, mask: u32) -> Result<(), String> {
        let f = &self.device.embree.functions;
        // SAFETY: a live scene, and a geometry that is attached to it.
        unsafe {
            let geometry = (f.get_geometry)(self.handle, id);
            (f.set_mask)(geometry, mask);
            (f.commit_geometry)(geometry);
        }
        self.device.check("setting a mask")
    }

    /// Builds the tree.
    pub fn commit(&self) -> Result<(), String> {
        // SAFETY: a live scene.
        unsafe { (self.device.embree.functions.commit_scene)(self.handle) };
        self.device.check("building")
    }

    /// `rtcIntersect1`.
    #[inline]
    pub fn closest_hit(&self, ray: &EmbreeRay) -> Option<Hit> {
        let mut it = RtcRayHit { ray: *ray, hit: RtcHit::NONE };
        // SAFETY: a committed scene, and structures laid out as the header says, alive through the call.
        unsafe {
            match self.device.embree.queries {
                Queries::V3 { intersect1, .. } => intersect1(self.handle, &mut Context3::new(), &mut it),
                Queries::V4 { intersect1, .. } => intersect1(self.handle, &mut it, null()),
            }
        }
        it.answer()
    }

    /// `rtcOccluded1`.
    #[inline]
    pub fn any_hit(&self, ray: &EmbreeRay) -> bool {
        let mut it = *ray;
        // SAFETY: as in `closest_hit`.
        unsafe {
            match self.device.embree.queries {
                Queries::V3 { occluded1, .. } => occluded1(self.handle, &mut Context3::new(), &mut it),
                Queries::V4 { occluded1, .. } => occluded1(self.handle, &mut it, null()),
            }
        }
        it.tfar == f32::NEG_INFINITY
    }

    /// `rtcIntersect16`; `sink` gets the rays' answers in order.
    #[inline]
    pub fn closest_hit_16(&self, packet: &Packet, mut sink: impl FnMut(Option<Hit>)) {
        let mut it = packet.clone();
        // SAFETY: as in `closest_hit`; all lanes are valid rays or empty ones.
        unsafe {
            match self.device.embree.queries {
                Queries::V3 { intersect16, .. } => {
                    intersect16(VALID.0.as_ptr(), self.handle, &mut Context3::new(), &mut it);
                }
                Queries::V4 { intersect16, .. } => intersect16(VALID.0.as_ptr(), self.handle, &mut it, null()),
            }
        }
        (0..PACKET).for_each(|i| sink(it.hit(i)));
    }

    /// `rtcOccluded16`; `sink` gets the rays' answers in order.
    #[inline]
    pub fn any_hit_16(&self, packet: &Packet, mut sink: impl FnMut(bool)) {
        let mut it = packet.clone();
        // SAFETY: a packet begins with its rays, so it serves as RTCRay16; otherwise as in `closest_hit_16`.
        unsafe {
            match self.device.embree.queries {
                Queries::V3 { occluded16, .. } => {
                    occluded16(VALID.0.as_ptr(), self.handle, &mut Context3::new(), &mut it);
                }
                Queries::V4 { occluded16, .. } => occluded16(VALID.0.as_ptr(), self.handle, &mut it, null()),
            }
        }
        (0..PACKET).for_each(|i| sink(it.tfar[i] == f32::NEG_INFINITY));
    }
}

/// All lanes of a packet.
#[repr(align(64))]
struct Valid([c_int; PACKET]);
static VALID: Valid = Valid([-1; PACKET]);
