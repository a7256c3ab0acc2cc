//! Closest points on moving triangles: the answers of trees, compared with the exact ones.

use super::DOUBT;
use super::crossings::Crossings;
use super::rays::SceneUnderTest;
use super::special_time;
use super::tally::OrderTally;
use crate::oracle::{ExactNearest, Given, ulp32};
use mbkd::glam::DVec3;
use mbkd::{ClosestPoint, ClosestPointQuery, RayTree};
use mbkd_scenes::Random;

/// Compares trees of a scene with the exact answers to `count` queries, a third of them with a greatest distance.
/// `tamper` may change the answers of a tree before they are checked.
pub fn compare_closest_points(
    scene: &SceneUnderTest,
    trees: &[RayTree],
    count: usize,
    random: &mut Random,
    tamper: impl Fn(&mut Option<ClosestPoint>),
) -> Vec<OrderTally> {
    let mut tallies = vec![OrderTally::default(); trees.len()];
    let given = match scene.given() {
        Given::F32 => Given::F32,
        _ => Given::F64,
    };
    let crossings = scene.crossings(trees, random);
    for _ in 0..count {
        let (time, point) = place(scene, crossings.as_ref(), random);
        let exact = |mesh: usize, triangle: usize| {
            let [a, b, c] = scene.corners(mesh, triangle, time);
            ExactNearest::new(point, given, [&a, &b, &c])
        };
        let all: Vec<_> = (0..scene.meshes.len())
            .flat_map(|mesh| (0..scene.meshes[mesh].len()).map(move |triangle| (mesh, triangle)))
            .map(|(mesh, triangle)| ((mesh as u32, triangle as u32), exact(mesh, triangle)))
            .collect();
        let Some((_, least)) = all.iter().min_by(|a, b| a.1.squared.cmp(&b.1.squared)) else { continue };
        let unit = |of: &ExactNearest| of.doubt + ulp32(of.near) / 2.0;
        let most = match random.below(3) {
            0 => (least.near * (0.5 + random.unit_f64())) as f32,
            _ => f32::INFINITY,
        };
        for (tree, tally) in trees.iter().zip(&mut tallies) {
            let mut found = tree.closest_point(&ClosestPointQuery::new(point, time).within(most));
            tamper(&mut found);
            tally.queries += 1;
            let Some(found) = found else {
                tally.wrong_count += usize::from(f64::from(most) - least.near > DOUBT * unit(least));
                continue;
            };
            let name = (found.mesh, found.primitive);
            let Some((_, reported)) = all.iter().find(|(of, _)| *of == name) else {
                tally.wrong_count += 1;
                continue;
            };
            tally.wrong_count += usize::from(least.near - f64::from(most) > DOUBT * unit(least));
            tally.distance.add(reported.error_of(found.distance), reported.near, reported.doubt);
            let farther = (reported.near - least.near) / (unit(reported) + unit(least));
            tally.worst_order = tally.worst_order.max(farther);
            tally.wrong_order += usize::from(farther > DOUBT);
            // The returned point has the returned distance.
            let off = (found.point.distance(point) - f64::from(found.distance)).abs();
            let rounding = unit(reported) + scene.given().doubt(found.point).length();
            tally.broken_promises += usize::from(off > DOUBT * rounding);
        }
    }
    tallies
}

/// A time and a position: a corner, near a triangle, or anywhere.
fn place(scene: &SceneUnderTest, crossings: Option<&Crossings>, random: &mut Random) -> (f32, DVec3) {
    let case = scene.case();
    let (time, triangle) = match crossings {
        Some(crossings) => crossings.beside(random),
        None => (special_time(random, case.keys), random.below(scene.meshes[0].len())),
    };
    let [a, b, c] = scene.corners(0, triangle, time).map(|corner| corner.near);
    let weight = random.unit_f64();
    let away = match random.below(4) {
        0 => 0.0,
        1 => 1e-3,
        _ => 2.0,
    };
    let on = match random.below(3) {
        0 => a,
        1 => a + (b - a) * weight,
        _ => a + ((b - a) + (c - a)) * (0.5 * weight),
    };
    let at = on + random.dvec() * (away * case.scale);
    (time, if case.wide { at } else { at.as_vec3().as_dvec3() })
}
