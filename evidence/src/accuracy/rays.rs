//! Rays against moving triangles: the answers of trees, compared with the exact ones.

use super::DOUBT;
use super::cases::RayCase;
use super::crossings::{Crossings, crossings};
use super::special_time;
use super::tally::RayTally;
use crate::oracle::{ExactRay, Given, Meeting, Moving, clearly_missed, meet_triangle};
use core::ops::ControlFlow;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, Hit, KdParams, Ray, RayTree, TriangleMesh};
use mbkd_scenes::Random;

/// The compared policies, by name.
pub fn policies() -> Vec<(&'static str, BuildParams)> {
    vec![
        ("wide", BuildParams::default()),
        ("k-d", BuildParams::kd(KdParams::default())),
        ("classic", BuildParams::kd(KdParams::classic())),
    ]
}

/// The number of small triangles in a scene.
const TRIANGLES: usize = 80;

/// Triangles as given by the caller, and as the oracle reads them.
pub struct SceneUnderTest {
    /// The caller's meshes.
    pub meshes: Vec<TriangleMesh>,
    /// Positions by mesh, key and vertex.
    keys: Vec<Vec<Vec<DVec3>>>,
    given: Given,
    case: RayCase,
    center: DVec3,
}

impl SceneUnderTest {
    /// The scene of a case.
    pub fn new(case: &RayCase, seed: u64) -> SceneUnderTest {
        let mut random = Random(seed);
        let center = DVec3::splat(case.offset * case.scale);
        let mut soup = vec![Vec::new(); case.keys];
        for _ in 0..TRIANGLES {
            let at = random.dvec();
            let (long, wide) = (random.dvec() * 0.4, random.dvec() * (0.4 / case.aspect));
            let displacement = random.dvec() * case.speed;
            for (k, key) in soup.iter_mut().enumerate() {
                let passed = k as f64 / (case.keys.max(2) - 1) as f64;
                // Inner keys are off the straight line.
                let aside = if case.keys > 2 { random.dvec() * (0.1 * case.speed) } else { DVec3::ZERO };
                for corner in [DVec3::ZERO, long, wide] {
                    let own = random.dvec() * (0.05 * case.speed / case.aspect);
                    key.push(center + (at + corner + displacement * passed + aside + own) * case.scale);
                }
            }
        }
        let mut all = vec![soup];
        if let Some(half) = case.ground {
            let z = center.z - 1.5 * case.scale;
            let corner = |x: f64, y: f64| DVec3::new(center.x + x * half, center.y + y * half, z);
            all.push(vec![vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]]);
        }
        if let Some(away) = case.outlier {
            let at = center + DVec3::new(away, 0.3 * away, -0.7 * away) * case.scale;
            all.push(vec![vec![at, at + DVec3::X * case.scale, at + DVec3::Y * case.scale]]);
        }
        let mut meshes = Vec::new();
        for (m, keys) in all.iter_mut().enumerate() {
            let indices: Vec<[u32; 3]> = match (m, case.ground) {
                (1, Some(_)) => vec![[0, 1, 2], [0, 2, 3]],
                _ => (0..keys[0].len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            };
            if case.wide {
                let mesh = TriangleMesh::new(indices, keys.clone());
                meshes.push(if case.kept { mesh.precise() } else { mesh });
            } else {
                let given: Vec<Vec<Vec3>> = keys.iter().map(|key| key.iter().map(|p| p.as_vec3()).collect()).collect();
                *keys = given.iter().map(|key| key.iter().map(|p| p.as_dvec3()).collect()).collect();
                meshes.push(TriangleMesh::new(indices, given));
            }
        }
        let given = match (case.wide, case.kept) {
            (false, _) => Given::F32,
            (true, false) => Given::Around(center),
            (true, true) => Given::F64,
        };
        SceneUnderTest { meshes, keys: all, given, case: case.clone(), center }
    }

    /// The case.
    pub fn case(&self) -> &RayCase {
        &self.case
    }

    /// The precision in which vertices are given.
    pub(super) fn given(&self) -> Given {
        self.given
    }

    /// The exact corners of a triangle at a time.
    pub(super) fn corners(&self, mesh: usize, triangle: usize, time: f32) -> [Moving; 3] {
        let keys = &self.keys[mesh];
        let corner = |v: u32| Moving::new(time, keys.len(), self.given, |k| keys[k][v as usize]);
        self.meshes[mesh].indices[triangle].map(corner)
    }

    /// All vertices at a time in f64, rounded, with their doubts: accurate enough to exclude clear misses.
    fn vertices(&self, time: f32) -> Vec<Vec<(DVec3, DVec3)>> {
        let of_mesh = |keys: &Vec<Vec<DVec3>>| {
            let n = keys[0].len();
            (0..n)
                .map(|v| Moving::new(time, keys.len(), self.given, |k| keys[k][v]))
                .map(|m| (m.near, m.doubt))
                .collect()
        };
        self.keys.iter().map(of_mesh).collect()
    }

    /// When small triangles cross planes of the trees, if queries are to be at such times.
    pub(super) fn crossings(&self, trees: &[RayTree], random: &mut Random) -> Option<Crossings> {
        self.case.at_crossings.then(|| crossings(trees, TRIANGLES, random))
    }

    /// A time, and some rays at it.
    fn rays(&self, crossings: Option<&Crossings>, random: &mut Random, count: usize) -> (f32, Vec<Ray>) {
        let crossing = crossings.map(|crossings| crossings.beside(random));
        let time = crossing.map_or_else(|| special_time(random, self.case.keys), |(time, _)| time);
        let mut ray = || {
            let triangle = crossing.map_or_else(|| random.below(TRIANGLES), |(_, triangle)| triangle);
            self.ray(random, triangle, time)
        };
        let rays = (0..count).map(|_| ray()).collect();
        (time, rays)
    }

    /// A ray at the inside of a triangle, an edge, a corner, or anywhere.
    fn ray(&self, random: &mut Random, triangle: usize, time: f32) -> Ray {
        let case = &self.case;
        let [a, b, c] = self.corners(0, triangle, time).map(|m| m.near);
        let (u, v) = (random.unit_f64(), random.unit_f64());
        let target = match random.below(8) {
            0 => a,
            1 => a + (b - a) * u,
            2 => b + (c - b) * u,
            3 => self.center + random.dvec() * case.scale,
            _ if u + v < 1.0 => a + (b - a) * u + (c - a) * v,
            _ => a + (b - a) * (1.0 - u) + (c - a) * (1.0 - v),
        };
        let (origin, dir) = if case.away > 100.0 {
            // A direction of few bits, so that the ray reaches its target exactly from any distance.
            let dir = loop {
                let dir = (random.dvec() * 4.0).round();
                if dir != DVec3::ZERO {
                    break dir;
                }
            };
            (target - dir * (case.away * case.scale), dir)
        } else {
            let origin = target + random.dvec() * (case.away * case.scale);
            let origin = if case.wide { origin } else { origin.as_vec3().as_dvec3() };
            (origin, (target - origin) / case.scale)
        };
        let ray = Ray::new(origin, (dir * case.direction).as_vec3()).at_time(time);
        let reach = (target - origin).length() / ray.dir.as_dvec3().length();
        let near = reach as f32;
        match random.below(12) {
            0 => ray.between(near, f32::INFINITY),
            1 => ray.between(0.0, near),
            2 => ray.between(f32::from_bits(1), near * 2.0),
            3 => ray.between(-near, near * 0.99),
            _ => ray,
        }
    }

    /// The exact meetings of a ray with all triangles that it does not clearly miss.
    fn exact(&self, ray: &ExactRay, vertices: &[Vec<(DVec3, DVec3)>]) -> Vec<((u32, u32), Meeting)> {
        let mut all = Vec::new();
        for (m, mesh) in self.meshes.iter().enumerate() {
            for (t, indices) in mesh.indices.iter().enumerate() {
                if !clearly_missed(ray, indices.map(|v| vertices[m][v as usize]), 100.0 * DOUBT) {
                    all.push(((m as u32, t as u32), self.meeting(ray, m, t)));
                }
            }
        }
        all
    }

    fn meeting(&self, ray: &ExactRay, mesh: usize, triangle: usize) -> Meeting {
        let [a, b, c] = self.corners(mesh, triangle, ray.ray.time);
        meet_triangle(ray, [&a, &b, &c])
    }
}

/// All hits of a ray.
pub(super) fn all_hits(tree: &RayTree, ray: &Ray) -> Vec<Hit> {
    let mut hits = Vec::new();
    let _ = tree.all_hits(ray, |hit| {
        hits.push(hit);
        ControlFlow::Continue(())
    });
    hits
}

/// Checks that closest and any hit agree with all hits, and that all are in range.
pub(super) fn check_queries(tree: &RayTree, ray: &Ray, hits: &[Hit], tally: &mut RayTally) {
    let key = |h: &Hit| (h.t.to_bits(), h.mesh, h.primitive);
    let first = hits.iter().min_by(|a, b| a.t.total_cmp(&b.t).then(key(a).cmp(&key(b))));
    let closest = tree.closest_hit(ray);
    let agrees = closest.map(|h| key(&h)) == first.map(key) && tree.any_hit(ray) == first.is_some();
    tally.contradictions += usize::from(!agrees);
    let fine = |h: &&Hit| h.t.is_finite() && ray.t_min <= h.t && h.t <= ray.t_max;
    tally.outside_range += hits.iter().filter(|h| !fine(h)).count();
}

/// Compares trees of a scene with the exact answers to `count` rays. `tamper` may change the answers of a tree before
/// they are checked, to test that errors are noticed.
pub fn compare_rays(
    scene: &SceneUnderTest,
    trees: &[RayTree],
    count: usize,
    random: &mut Random,
    tamper: impl Fn(&mut Vec<Hit>),
) -> Vec<RayTally> {
    let mut tallies = vec![RayTally::default(); trees.len()];
    let origin = match scene.given {
        // Far origins have more bits than f32.
        Given::F32 if scene.case.away > 100.0 => Given::F64,
        given => given,
    };
    /// The number of rays at the same time.
    const TOGETHER: usize = 16;
    let crossings = scene.crossings(trees, random);
    for _ in 0..count.div_ceil(TOGETHER) {
        let (time, rays) = scene.rays(crossings.as_ref(), random, TOGETHER);
        let vertices = scene.vertices(time);
        for ray in rays {
            let exact_ray = ExactRay::new(&ray, origin);
            let exact = scene.exact(&exact_ray, &vertices);
            for (tree, tally) in trees.iter().zip(&mut tallies) {
                let mut hits = all_hits(tree, &ray);
                check_queries(tree, &ray, &hits, tally);
                tamper(&mut hits);
                compare(scene, &exact_ray, &exact, &hits, tally);
            }
        }
    }
    tallies
}

fn compare(
    scene: &SceneUnderTest,
    ray: &ExactRay,
    exact: &[((u32, u32), Meeting)],
    hits: &[Hit],
    tally: &mut RayTally,
) {
    tally.rays += 1;
    for (name, meeting) in exact {
        tally.hits += usize::from(meeting.hit);
        let hit = hits.iter().find(|h| (h.mesh, h.primitive) == *name);
        if meeting.hit != hit.is_some() {
            tally.worst_verdict = tally.worst_verdict.max(meeting.margin);
            if meeting.margin > DOUBT {
                tally.false_misses += usize::from(meeting.hit);
                tally.false_hits += usize::from(!meeting.hit);
            }
        }
        if let (Some(hit), Some(t), Some(weights)) = (hit, &meeting.t, &meeting.weights)
            && hit.t.is_finite()
        {
            tally.t.add(t.error_of(hit.t), t.to_f64(), meeting.t_doubt);
            for (given, (weight, doubt)) in [hit.u, hit.v].into_iter().zip(weights.iter().zip(meeting.weight_doubts)) {
                tally.weights.add(weight.error_of(given), weight.to_f64(), doubt);
            }
        }
    }
    for hit in hits {
        if !exact.iter().any(|(name, _)| *name == (hit.mesh, hit.primitive)) {
            let meeting = scene.meeting(ray, hit.mesh as usize, hit.primitive as usize);
            tally.false_hits += 1;
            tally.worst_verdict = tally.worst_verdict.max(meeting.margin);
        }
    }
    // The nearest reported hit must be as near as any certain one.
    let certain = exact.iter().filter(|(_, m)| m.hit && m.margin > DOUBT);
    let exact_first = certain.min_by(|a, b| a.1.t.cmp(&b.1.t));
    let first = hits.iter().min_by(|a, b| a.t.total_cmp(&b.t));
    if let (Some((name, nearest)), Some(first)) = (exact_first, first)
        && *name != (first.mesh, first.primitive)
        && let Some((_, reported)) = exact.iter().find(|(name, _)| *name == (first.mesh, first.primitive))
        && let (Some(a), Some(b)) = (&nearest.t, &reported.t)
    {
        let unit = |m: &Meeting, t: f64| m.t_doubt + crate::oracle::ulp32(t) / 2.0;
        let (near, far) = (a.to_f64(), b.to_f64());
        tally.wrong_closest += usize::from(far - near > DOUBT * (unit(nearest, near) + unit(reported, far)));
    }
}
