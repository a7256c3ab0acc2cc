//! How much light comes along a ray: the sun with a soft shadow, the sky, and what surfaces pass on.
//!
//! A path goes from surface to surface in directions drawn as these reflect light, always at the time of its camera ray,
//! so shadows and reflected light of what moves blur as it does. At each surface one ray looks for the sun; surfaces that
//! shine themselves are found by the paths that hit them. After the last bounce a ray looks whether the sky is free: with no
//! bounces at all that is ambient occlusion.
//!
//! Light that a smooth metal throws on a wall is found by few paths, each of them bright: specks. A path that was spread wide is
//! therefore shown mirrors that lean as far (path-space regularization: Kaplanyan and Dachsbacher, 2013; done to materials as in
//! pbrt-v4). Such light is softer than it should be; what the eye sees directly, or in mirrors, is as it was.

use crate::sampling::Sampler;
use crate::stage::Stage;
use crate::world::World;
use mbkd::glam::Vec3;
use mbkd::{Observer, Ray};

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
    for bounce in 0..=paths.bounces {
        rays += 1;
        let Some(hit) = world.closest(&ray, observer) else {
            return (light + share * stage.sky.radiance(ray.dir), rays);
        };
        let point = world.point(&ray, &hit).leaning(spread);
        let to_eye = -ray.dir.normalize_or_zero();
        light += share * point.emission;
        let from_here = |dir: Vec3| Ray::new(point.position, dir).at_time(ray.time);

        let to_sun = stage.sky.towards_sun(sampler);
        let cosine = to_sun.dot(point.normal);
        if cosine > 0.0 {
            rays += 1;
            if !world.any(&from_here(to_sun), observer) {
                light += share * point.reflects(to_eye, to_sun) * stage.sky.sun * cosine;
            }
        }
        let Some(scattered) = point.scatter(to_eye, sampler) else { break };
        share *= scattered.share;
        if !paths.caustics {
            spread = spread.max(scattered.spread.min(SOFTEST));
        }
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
