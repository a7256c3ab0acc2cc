//! Several frames of an animation with one tree: a turning wheel above a floor that blinks, lit by a lamp that camera rays
//! do not see. The tree is refitted to each frame, and built again when that makes rays slow.
//!
//! `cargo run --release --example next_frame`

use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, MovingSphere, Ray, RayTree, TimeInterval, TriangleMesh};

/// Which rays see a thing: those of the camera, and those that look for the lamp.
const CAMERA: u32 = 0b01;
const SHADOW: u32 = 0b10;

const LAMP: DVec3 = DVec3::new(1.0, 1.0, 6.0);
const BLADES: usize = 20;

/// The meshes of a frame. Topology and masks stay the same from frame to frame, and so do the keys, of which the wheel keeps all:
/// if it stopped turning and only rose, one of its three keys would be redundant, and a tree that drops it could not be refitted.
fn meshes(frame: usize) -> Result<[TriangleMesh; 2], mbkd::IntervalError> {
    // One key: at rest. It exists in the second half of each shutter only.
    let floor = vec![Vec3::new(-9.0, -9.0, 0.0), Vec3::new(9.0, -9.0, 0.0), Vec3::new(0.0, 9.0, 0.0)];
    let floor = TriangleMesh::fixed(vec![[0, 1, 2]], floor).with_active(TimeInterval::new(0.5, 1.0)?);
    // Three keys: a quarter of a turn while the shutter is open.
    let wheel = |key: usize| {
        let turn = std::f32::consts::FRAC_PI_2 * (frame as f32 + key as f32 / 2.0);
        (0..3 * BLADES).map(move |corner| {
            let (blade, corner) = (corner / 3, corner % 3);
            let angle = turn + (blade as f32 + [0.0, 0.0, 0.5][corner]) * 0.3;
            let out = if corner == 0 { 0.2 } else { 1.5 };
            Vec3::new(out * angle.cos(), out * angle.sin(), 2.0 + 0.01 * frame as f32)
        })
    };
    let triangles = (0..BLADES as u32).map(|blade| [3 * blade, 3 * blade + 1, 3 * blade + 2]).collect();
    let wheel = TriangleMesh::new(triangles, (0..3).map(|key| wheel(key).collect()).collect::<Vec<Vec<Vec3>>>());
    Ok([floor, wheel.keep_keys()])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let lamp = || vec![MovingSphere::fixed(LAMP, 0.1).with_mask(SHADOW)];
    let params = BuildParams::default();
    let mut tree = RayTree::of_scene(&meshes(0)?, lamp(), &params)?;
    println!("{}", tree.statistics());

    for frame in 0..4 {
        if frame > 0 {
            let refit = tree.refit_with_shapes(&meshes(frame)?, lamp())?;
            println!("frame {frame}: a ray costs {:.2} times what it cost when the tree was built", refit.cost);
            if refit.is_worn() {
                tree = RayTree::of_scene(&meshes(frame)?, lamp(), &params)?;
            }
        }
        // Rays from above, each at its own time of the shutter.
        let camera = (0..10_000).map(|i| {
            let (x, y) = ((i % 100) as f32 / 25.0 - 1.98, (i / 100) as f32 / 25.0 - 1.98);
            Ray::new(Vec3::new(x, y, 9.0), Vec3::NEG_Z).at_time((i * 61 % 100) as f32 / 100.0)
        });
        let camera: Vec<Ray> = camera.collect();
        let mut hits = Vec::new();
        tree.closest_hits_masked(&camera, CAMERA, &mut hits);

        // From each hit to the lamp. The ray ends before the lamp, which would be in its way otherwise.
        let seen: Vec<_> = camera.iter().zip(&hits).filter_map(|(ray, hit)| Some((ray, hit.as_ref()?))).collect();
        let to_lamp = |(ray, hit): &(&Ray, &mbkd::Hit)| {
            let surface = tree.interaction(ray, hit);
            let before = 1.0 - 0.2 / surface.point().distance(LAMP) as f32;
            surface.secondary_ray((LAMP - surface.point()).as_vec3()).between(0.0, before)
        };
        let shadow_rays: Vec<Ray> = seen.iter().map(to_lamp).collect();
        let mut shadows = Vec::new();
        tree.any_hits_masked(&shadow_rays, SHADOW, &mut shadows);
        let of_mesh = |mesh: u32| seen.iter().filter(|(_, hit)| hit.mesh == mesh).count();
        println!(
            "frame {frame}: of {} rays {} see the floor, {} the wheel; {} of these points are in shadow",
            camera.len(),
            of_mesh(0),
            of_mesh(1),
            shadows.iter().filter(|&&dark| dark).count()
        );
    }
    Ok(())
}
