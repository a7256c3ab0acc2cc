//! How much light comes along a ray: the sun with a soft shadow, the sky, and what surfaces pass on.
//!
//! A path goes from surface to surface in directions drawn as these reflect light, always at the time of its camera ray,
//! so shadows and reflected light of what moves blur as it does. At each surface one ray looks for the sun, and another for
//! one of the surfaces that shine themselves, if there are any; paths that hit those find them too ([`crate::lamps`]). After the last bounce a ray looks whether the sky is free: with no
//! bounces at all that is ambient occlusion.
//!
//! Light that a smooth metal throws on a wall is found by few paths, each of them bright: specks. A path that was spread wide is
//! therefore shown mirrors that lean as far (path-space regularization: Kaplanyan and Dachsbacher, 2013; done to materials as in
//! pbrt-v4). Such light is softer than it should be; what the eye sees directly, or in mirrors, is as it was.

use crate::lamps::weight;
use crate::sampling::Sampler;
use crate::stage::Stage;
use crate::world::{Point, World};
use mbkd::glam::Vec3;
use mbkd::{Observer, Ray};
use std::f32::consts::PI;

/// How far mirrors lean at least that a path meets after a diffuse surface.
const SOFTEST: f32 = 0.3;

/// How far paths are followed.
#[derive(Clone, Copy, Debug)]
pub struct Paths {
    /// Bounces after the first surface.
    pub bounces: u32,
    /// Whether mirrors are as sharp to a path that was spread as to one that was not.
    pub caustics: bool,
}

/// The light along a camera ray, and how many rays it took.
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
    // How likely the direction was that brought the path here, where a ray might have looked for a lamp instead.
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
        // Paths that end here find no lamps, and neither does a ray.
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

/// A ray to a lamp, and the light from there to the eye if nothing is in its way; none where the lamp that was drawn lights nothing.
fn from_lamp(world: &World, point: &Point, to_eye: Vec3, time: f32, sampler: &mut Sampler) -> Option<(Ray, Vec3)> {
    let (sight, ray, emission) = world.towards_lamp(point, time, sampler)?;
    let cosine = sight.dir.dot(point.normal);
    if !(cosine > 0.0 && sight.density > 0.0) || emission == Vec3::ZERO {
        return None;
    }
    let part = weight(sight.density, point.density(to_eye, sight.dir));
    Some((ray, point.reflects(to_eye, sight.dir) * emission * (part * cosine / (PI * sight.density))))
}

/// The ray through a place of the picture (0 to 1 from left and top), from a point of the lens.
pub fn camera_ray(stage: &Stage, x: f32, y: f32, aspect: f32, time: f32, sampler: &mut Sampler) -> Ray {
    let pinhole = stage.camera.ray(x, y, aspect, time);
    if stage.aperture <= 0.0 {
        return pinhole;
    }
    let view = stage.camera.view(time);
    let [right, up, _] = view.axes(aspect);
    let lens = sampler.disk() * stage.aperture;
    let shift = right.normalize_or_zero() * lens.x + up.normalize_or_zero() * lens.y;
    // The pinhole ray goes one unit forward per unit of t, so `focus` is where it is sharp.
    let focus = stage.focus.unwrap_or((view.target - view.position).length());
    Ray::new(pinhole.origin + shift.as_dvec3(), pinhole.dir - shift / focus.max(1e-6)).at_time(time)
}
