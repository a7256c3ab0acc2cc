//! Path tracing: the light along a ray from the sun with a soft shadow, the sky, and surfaces.
//!
//! A path goes from surface to surface in directions sampled by their reflectance, always at the time of its camera
//! ray, so shadows and reflections of moving objects blur as well. At each surface one shadow ray samples the sun, and
//! another one of the emitting surfaces, if there are any; paths that hit those contribute too ([`crate::lamps`]).
//! After the last bounce a ray tests whether the sky is visible: without any bounces that is ambient occlusion.
//!
//! Light that a smooth metal reflects onto a wall is found by few paths, each of them bright, which leaves specks. To a
//! path that was spread wide, mirrors therefore appear as rough as its spread (path-space regularization: Kaplanyan and
//! Dachsbacher, 2013; applied to materials as in pbrt-v4). Such light is softer than it should be; surfaces seen
//! directly, or in mirrors, are unchanged.

use crate::lamps::weight;
use crate::sampling::Sampler;
use crate::stage::Stage;
use crate::world::{Point, World};
use mbkd::glam::Vec3;
use mbkd::{Observer, Ray};
use std::f32::consts::PI;

/// The least tilt of mirrors for a path after a diffuse surface.
const SOFTEST: f32 = 0.3;

/// The limits of paths.
#[derive(Clone, Copy, Debug)]
pub struct Paths {
    /// Bounces after the first surface.
    pub bounces: u32,
    /// Whether mirrors stay sharp for a path that was spread.
    pub caustics: bool,
}

/// The light along a camera ray, and the number of rays traced.
pub fn radiance(
    world: &World,
    stage: &Stage,
    mut ray: Ray,
    paths: Paths,
    sampler: &mut Sampler,
    observer: &mut impl Observer,
) -> (Vec3, u32) {
    let (mut light, mut share, mut rays) = (Vec3::ZERO, Vec3::ONE, 0);
    let mut spread = 0.0f32;
    // The density of the direction that brought the path here, if a shadow ray might have sampled a lamp there.
    let mut drawn = None;
    for bounce in 0..=paths.bounces {
        rays += 1;
        let Some(hit) = world.closest(&ray, observer) else {
            return (light + share * stage.sky.radiance(ray.dir), rays);
        };
        let point = world.point(&ray, &hit).leaning(spread);
        let to_eye = -ray.dir.normalize_or_zero();
        if point.emission != Vec3::ZERO {
            let part = drawn.map_or(1.0, |density| weight(density, world.lamp_density(&ray, &hit)));
            light += share * point.emission * part;
        }
        let from_here = |dir: Vec3| Ray::new(point.position, dir).at_time(ray.time);

        let to_sun = stage.sky.towards_sun(sampler);
        let cosine = to_sun.dot(point.normal);
        if cosine > 0.0 {
            rays += 1;
            if !world.any(&from_here(to_sun), observer) {
                light += share * point.reflects(to_eye, to_sun) * stage.sky.sun * cosine;
            }
        }
        // Paths that end here find no lamps, so no shadow ray is traced either.
        let looks = bounce < paths.bounces && !world.lamps.is_empty();
        if looks && let Some((to_lamp, found)) = from_lamp(world, &point, to_eye, ray.time, sampler) {
            rays += 1;
            if !world.any(&to_lamp, observer) {
                light += share * found;
            }
        }
        let Some(scattered) = point.scatter(to_eye, sampler) else { break };
        share *= scattered.share;
        if !paths.caustics {
            spread = spread.max(scattered.spread.min(SOFTEST));
        }
        drawn = looks.then(|| point.density(to_eye, scattered.dir));
        let onward = from_here(scattered.dir);
        if bounce == paths.bounces {
            rays += 1;
            if !world.any(&onward, observer) {
                light += share * stage.sky.radiance(onward.dir);
            }
        }
        ray = onward;
    }
    (light, rays)
}

/// A shadow ray to a lamp, and the light from there to the eye if it is unoccluded; `None` if the sampled lamp does not
/// light the point.
fn from_lamp(world: &World, point: &Point, to_eye: Vec3, time: f32, sampler: &mut Sampler) -> Option<(Ray, Vec3)> {
    let (sight, ray, emission) = world.towards_lamp(point, time, sampler)?;
    let cosine = sight.dir.dot(point.normal);
    if !(cosine > 0.0 && sight.density > 0.0) || emission == Vec3::ZERO {
        return None;
    }
    let part = weight(sight.density, point.density(to_eye, sight.dir));
    Some((ray, point.reflects(to_eye, sight.dir) * emission * (part * cosine / (PI * sight.density))))
}

/// The ray through a point of the picture (0 to 1 from left and top), from a point of the lens.
pub fn camera_ray(stage: &Stage, x: f32, y: f32, aspect: f32, time: f32, sampler: &mut Sampler) -> Ray {
    let pinhole = stage.camera.ray(x, y, aspect, time);
    if stage.aperture <= 0.0 {
        return pinhole;
    }
    let view = stage.camera.view(time);
    let [right, up, _] = view.axes(aspect);
    let lens = sampler.disk() * stage.aperture;
    let shift = right.normalize_or_zero() * lens.x + up.normalize_or_zero() * lens.y;
    // The pinhole ray advances one unit forward per unit of t, so `focus` is where it is sharp.
    let focus = stage.focus.unwrap_or((view.target - view.position).length());
    Ray::new(pinhole.origin + shift.as_dvec3(), pinhole.dir - shift / focus.max(1e-6)).at_time(time)
}
