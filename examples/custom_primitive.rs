//! A custom primitive: flat moving discs, in one tree with a sphere.
//!
//! `cargo run --release --example custom_primitive`

use mbkd::glam::{DVec3, Vec3};
use mbkd::{
    Aabb, BuildParams, ClosestPointQuery, Intersection, LinearBounds, MovingSphere, Primitive, Ray, RayTree, Shape,
    SurfacePoint, TimeInterval, check_primitive,
};

/// A flat disc whose centre moves on a straight line.
struct Disc {
    centre: [DVec3; 2],
    normal: DVec3,
    radius: f64,
}

impl Disc {
    fn centre(&self, time: f32) -> DVec3 {
        self.centre[0].lerp(self.centre[1], f64::from(time))
    }
}

impl Primitive for Disc {
    /// Boxes at both ends of the interval: bounds are interpolated linearly in between, and the disc moves linearly too.
    fn bounds(&self, over: TimeInterval) -> LinearBounds {
        // Half the extent of the disc along each axis.
        let reach = self.radius * (DVec3::ONE - self.normal * self.normal).max(DVec3::ZERO).map(f64::sqrt);
        let at = |time: f32| {
            let centre = self.centre(time);
            // Padded by more than the rounding errors of `intersect` below.
            Aabb { min: centre - reach, max: centre + reach }.pad(1e-6)
        };
        LinearBounds { begin: at(over.begin()), end: at(over.end()) }
    }

    fn intersect(&self, ray: &Ray) -> Option<Intersection> {
        let (centre, dir) = (self.centre(ray.time), ray.dir.as_dvec3());
        let t = ((centre - ray.origin).dot(self.normal) / dir.dot(self.normal)) as f32;
        let from_centre = ray.point(t) - centre;
        let hit = from_centre.length() <= self.radius && ray.t_min <= t && t <= ray.t_max;
        hit.then(|| Intersection { t, u: (from_centre.length() / self.radius) as f32, v: 0.0 })
    }

    fn surface_normal(&self, _ray: &Ray, _hit: Intersection) -> Option<DVec3> {
        Some(self.normal)
    }

    fn closest_point(&self, point: DVec3, time: f32) -> Option<SurfacePoint> {
        let centre = self.centre(time);
        let flat = (point - centre) - self.normal * (point - centre).dot(self.normal);
        let inside = flat.clamp_length_max(self.radius);
        Some(SurfacePoint { point: centre + inside, u: (inside.length() / self.radius) as f32, v: 0.0 })
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let disc = |i: u32| {
        let turn = 0.7 * f64::from(i);
        let from = DVec3::new(turn.sin(), turn.cos(), 0.01 * f64::from(i)) * 2.0;
        Disc { centre: [from, from * 1.2], normal: DVec3::new(turn.cos(), 0.3, 1.0).normalize(), radius: 0.2 }
    };
    // Random tests of the implementation, for example for hits outside the bounds.
    check_primitive(&disc(7), 1000)?;

    // The discs and a ball in one tree.
    let ball = MovingSphere::new(vec![(DVec3::ZERO, 0.5), (DVec3::ZERO, 1.5)]);
    let mut shapes: Vec<Shape> = (0..5000).map(|i| Shape::custom(disc(i))).collect();
    shapes.push(ball.into());
    let tree = RayTree::of_scene(&[], shapes, &BuildParams::default())?;

    let ray = Ray::new(Vec3::new(30.0, 0.1, 0.2), Vec3::NEG_X);
    for time in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let what = |shape: u32| if shape == 5000 { "the ball".to_string() } else { format!("disc {shape}") };
        match tree.closest_hit(&ray.at_time(time)) {
            Some(hit) => {
                let normal = tree.surface_normal(&ray.at_time(time), &hit);
                println!("time {time}: the ray hits {} after {:.4}, normal {normal:.3}", what(hit.primitive), hit.t);
            }
            None => println!("time {time}: the ray hits nothing"),
        }
        let query = ClosestPointQuery::new(DVec3::new(0.0, 0.0, 40.0), time);
        if let Some(near) = tree.closest_point(&query) {
            println!("          nearest to {} is {}, {:.4} away", query.point, what(near.primitive), near.distance);
        }
    }
    Ok(())
}
