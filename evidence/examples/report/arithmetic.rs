//! What arithmetic loses: distances and barycentrics of rays against moving triangles, and distances of neighbours, beside
//! exact ones, over how far the scene is from the origin and how long triangles are.

use crate::fronts::short;
use crate::page::{Axis, Item, Plot, Section, Series, Style};
use crate::run::Run;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{BuildParams, PointArrays, PointParams, PointTree, Precision, Ray, RayTree, TriangleMesh};
use mbkd_evidence::oracle::{ExactDistance, ExactRay, Given, Moving, meet_triangle, ulp32};
use mbkd_evidence::simple_kernels::{Met, moller_trumbore, moller_trumbore_f64, watertight};
use mbkd_scenes::Random;
use std::error::Error;
use std::ops::ControlFlow;

/// How far scenes are from the origin, in their sizes.
const OFFSETS: [f64; 8] = [0.1, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6];
/// How much longer than wide triangles are.
const ASPECTS: [f64; 7] = [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6];
/// Triangles of a scene.
const TRIANGLES: usize = 64;
/// Points of a set.
const POINTS: usize = 300;
/// Errors below this are drawn as it, in ulp or in units of 2^-24.
const FLOOR: f64 = 0.05;
/// Shares of wrong verdicts below this likewise.
const FLOOR_OF_SHARES: f64 = 1e-5;

/// The tests that are compared; the first is the library's.
const KERNELS: [&str; 4] =
    ["mbkd (f64 inside)", "Möller–Trumbore in f32", "watertight (Woop et al.) in f32", "Möller–Trumbore in f64"];

/// The section: triangles over offset and aspect, neighbours over offset.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let rays = run.pick(2000, 20_000);
    run.begin("arithmetic", 3);
    let mut items = vec![Item::Text(format!(
        "Answers compared with exact ones, which rational arithmetic computes from the same f32 input without \
         rounding. Triangles move; vertices, origins and directions are f32. Each point of a curve stands for {rays} \
         rays, half of them aimed at the inside of a triangle, half at its edges. The other tests interpolate vertices \
         as (1 − t)·a + t·b in the precision of their name. One ulp is the spacing of f32 at the exact answer; curves \
         show the 99th percentile of the error. A verdict is hit or miss for the triangle at which the ray was aimed; \
         for a ray aimed at an edge, the last bit of the input may decide it."
    ))];
    run.step("rays over offset");
    items.extend(rays_over("offset", "distance of the scene from the origin, in its sizes", &OFFSETS, rays, run.seed)?);
    run.step("rays over aspect");
    items.extend(rays_over("aspect", "length of triangles over their width", &ASPECTS, rays, run.seed + 1)?);
    run.step("neighbours over offset");
    items.push(neighbors(run.pick(300, 3000), run.seed + 2)?);
    Ok(Section { id: "arithmetic", title: "7. Accuracy of arithmetic", items })
}

/// Errors of one test.
#[derive(Default)]
struct Errors {
    t: Vec<f64>,
    weights: Vec<f64>,
    wrong: usize,
}

/// Three plots over one property of scenes.
fn rays_over(name: &str, label: &str, values: &[f64], rays: usize, seed: u64) -> Result<Vec<Item>, Box<dyn Error>> {
    let mut rows = Vec::new();
    for &value in values {
        let (offset, aspect) = if name == "offset" { (value, 1.0) } else { (0.0, value) };
        rows.push((value, compare(offset, aspect, rays, seed)?));
    }
    let plot = |kind: &str, title: String, y: &str, floor: f64, of: &dyn Fn(&Errors) -> f64| {
        let series = |(i, kernel): (usize, &&str)| Series {
            label: kernel.to_string(),
            points: rows.iter().map(|(value, errors)| (*value, of(&errors[i]).max(floor))).collect(),
            style: Style::LineAndPoints,
            ours: i == 0,
        };
        Item::Plot(Plot {
            name: format!("{name}-{kind}"),
            title,
            caption: format!("Values below {floor} are drawn at {floor}."),
            x: Axis { label: label.into(), log: true },
            y: Axis { label: y.into(), log: true },
            series: KERNELS.iter().enumerate().map(series).collect(),
        })
    };
    let mut items = vec![
        plot("t", format!("Distance t over {name}"), "error of t, ulp (99 %)", FLOOR, &|e| quantile(&e.t)),
        plot("weights", format!("Barycentrics over {name}"), "error of u and v, units of 2^-24 (99 %)", FLOOR, &|e| {
            quantile(&e.weights)
        }),
        plot(
            "verdicts",
            format!("Hit or miss over {name}, half of the rays at edges"),
            "share of wrong verdicts",
            FLOOR_OF_SHARES,
            &|e| e.wrong as f64 / rays as f64,
        ),
    ];
    let worst = rows.iter().map(|(_, errors)| quantile(&errors[0].t)).fold(0.0, f64::max);
    let wrong: usize = rows.iter().map(|(_, errors)| errors[0].wrong).sum();
    items.push(Item::Claim {
        text: format!(
            "Over {name}: 99 % of our distances are within 4 ulp of the exact ones (largest 99th percentile {}), and \
             none of our verdicts is wrong ({wrong} of {}).",
            short(worst),
            rays * rows.len()
        ),
        holds: worst <= 4.0 && wrong == 0,
    });
    Ok(items)
}

/// What 99 % of the errors stay within; 0 of none.
fn quantile(errors: &[f64]) -> f64 {
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((sorted.len() * 99 / 100).min(sorted.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// Moving triangles in the cube around a place, by key.
fn triangles(center: DVec3, aspect: f64, random: &mut Random) -> [Vec<Vec3>; 2] {
    let mut keys = [Vec::new(), Vec::new()];
    for _ in 0..TRIANGLES {
        let at = random.dvec();
        let (long, wide) = (random.dvec() * 0.4, random.dvec() * (0.4 / aspect));
        let way = random.dvec() * 0.3;
        for (key, passed) in keys.iter_mut().zip([0.0, 1.0]) {
            let corner = |corner: DVec3| (center + at + corner + way * passed).as_vec3();
            key.extend([DVec3::ZERO, long, wide].map(corner));
        }
    }
    keys
}

/// The errors of all tests.
fn compare(offset: f64, aspect: f64, rays: usize, seed: u64) -> Result<[Errors; 4], Box<dyn Error>> {
    let mut random = Random(seed);
    // Not along a diagonal, where coordinates would be rounded alike.
    let center = DVec3::new(1.0, -0.7, 0.4) * offset;
    let keys = triangles(center, aspect, &mut random);
    let indices = (0..TRIANGLES as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(indices, keys.to_vec());
    let tree = RayTree::build(&[mesh], &BuildParams::default())?;
    let mut errors: [Errors; 4] = Default::default();
    for _ in 0..rays {
        let (triangle, time) = (random.below(TRIANGLES), random.unit_f64() as f32);
        let ends = [0, 1, 2].map(|corner| [0, 1].map(|key: usize| keys[key][3 * triangle + corner]));
        let exact = ends.map(|[a, b]| Moving::new(time, 2, Given::F32, |key| [a, b][key].as_dvec3()));
        let ray = aimed(&exact, time, &mut random);
        let meeting = meet_triangle(&ExactRay::new(&ray, Given::F32), [&exact[0], &exact[1], &exact[2]]);
        let (origin, dir) = (ray.origin.as_vec3(), ray.dir);
        let corners = ends.map(|[a, b]| a * (1.0 - time) + b * time);
        let wide = ends.map(|[a, b]| a.as_dvec3() * (1.0 - f64::from(time)) + b.as_dvec3() * f64::from(time));
        let answers = [
            ours(&tree, &ray, triangle as u32),
            moller_trumbore(corners, origin, dir),
            watertight(corners, origin, dir),
            moller_trumbore_f64(wide, ray.origin, dir.as_dvec3()),
        ];
        for (answer, errors) in answers.into_iter().zip(&mut errors) {
            errors.wrong += usize::from(answer.is_some() != meeting.hit);
            let (Some((t, u, v)), true, Some(exact_t), Some(weights)) =
                (answer, meeting.hit, &meeting.t, &meeting.weights)
            else {
                continue;
            };
            if t.is_finite() && u.is_finite() && v.is_finite() {
                errors.t.push(exact_t.error_of(t).abs() / ulp32(exact_t.to_f64()));
                let off = weights[0].error_of(u).abs().max(weights[1].error_of(v).abs());
                errors.weights.push(off * f64::from(1u32 << 24));
            }
        }
    }
    Ok(errors)
}

/// A ray at the inside of a triangle, or at its edge.
fn aimed(corners: &[Moving; 3], time: f32, random: &mut Random) -> Ray {
    let [a, b, c] = [&corners[0], &corners[1], &corners[2]].map(|corner| corner.near);
    let (u, v) = (random.unit_f64(), random.unit_f64());
    let target = match random.below(2) {
        0 => a + (b - a) * u,
        _ if u + v < 1.0 => a + (b - a) * u + (c - a) * v,
        _ => a + (b - a) * (1.0 - u) + (c - a) * (1.0 - v),
    };
    let origin = (target + random.dvec() * 3.0).as_vec3().as_dvec3();
    Ray::new(origin, (target - origin).as_vec3()).at_time(time)
}

/// What the library says about a ray and one of the triangles.
fn ours(tree: &RayTree, ray: &Ray, triangle: u32) -> Option<Met> {
    let mut met = None;
    let _ = tree.all_hits(ray, |hit| {
        if hit.primitive == triangle {
            met = Some((hit.t, hit.u, hit.v));
        }
        ControlFlow::Continue(())
    });
    met
}

/// Errors of the distance to the nearest of moving points, in f32 and in f64, over offset.
fn neighbors(count: usize, seed: u64) -> Result<Item, Box<dyn Error>> {
    let labels = [
        ("mbkd, f64 points", true),
        ("mbkd, f32 points, beside the f32 positions", true),
        ("mbkd, f32 points, beside the f64 positions that were meant", false),
        ("mbkd, f64 points rounded to f32 relative to their middle", false),
    ];
    let mut series: Vec<Series> = labels
        .map(|(label, ours)| Series { label: label.into(), points: Vec::new(), style: Style::LineAndPoints, ours })
        .into();
    for offset in OFFSETS {
        for (series, errors) in series.iter_mut().zip(nearest_errors(offset, count, seed)?) {
            series.points.push((offset, quantile(&errors).max(FLOOR)));
        }
    }
    Ok(Item::Plot(Plot {
        name: "neighbours".into(),
        title: "Squared distance of the nearest neighbour over offset".into(),
        caption: format!(
            "{POINTS} moving points, {count} queries for each point of a curve. Rounding positions to f32 costs \
             accuracy in proportion to their distance from the origin, whatever the search does afterwards. Values \
             below {FLOOR} are drawn at {FLOOR}."
        ),
        x: Axis { label: "distance of the set from the origin, in its sizes".into(), log: true },
        y: Axis { label: "error of the squared distance, ulp (99 %)".into(), log: true },
        series,
    }))
}

/// Errors in ulp of the four ways of [`neighbors`].
fn nearest_errors(offset: f64, count: usize, seed: u64) -> Result<[Vec<f64>; 4], Box<dyn Error>> {
    let mut random = Random(seed);
    let center = DVec3::new(1.0, -0.7, 0.4) * offset;
    let open: Vec<DVec3> = (0..POINTS).map(|_| center + random.dvec()).collect();
    let close: Vec<DVec3> = open.iter().map(|p| *p + random.dvec() * 0.1).collect();
    let single = |key: &[DVec3]| key.iter().map(|p| p.as_vec3()).collect::<Vec<Vec3>>();
    let (open32, close32) = (single(&open), single(&close));
    let given32 = [&open32, &close32].map(|key| key.iter().map(|p| p.as_dvec3()).collect::<Vec<DVec3>>());
    let params = PointParams::default();
    let rounding = PointParams { precision: Precision::Single, ..params.clone() };
    let keys: [&[DVec3]; 2] = [&open, &close];
    let wide = PointArrays { keys: &keys, active: &[], ids: &[] };
    let (in_f64, rounded) = (PointTree::build(&wide, &params)?, PointTree::build(&wide, &rounding)?);
    let keys: [&[Vec3]; 2] = [&open32, &close32];
    let in_f32 = PointTree::build(&PointArrays { keys: &keys, active: &[], ids: &[] }, &params)?;
    let mut errors: [Vec<f64>; 4] = Default::default();
    for _ in 0..count {
        let time = random.unit_f64() as f32;
        let i = random.below(POINTS);
        let query = open[i].lerp(close[i], f64::from(time)) + random.dvec() * 0.05;
        let query32 = query.as_vec3();
        let meant = least([&open, &close], query, Given::F64, time);
        let given = least([&given32[0], &given32[1]], query32.as_dvec3(), Given::F32, time);
        let found = [
            (in_f64.nearest(query, time), &meant),
            (in_f32.nearest(query32, time), &given),
            (in_f32.nearest(query32, time), &meant),
            (rounded.nearest(query, time), &meant),
        ];
        for ((found, exact), errors) in found.into_iter().zip(&mut errors) {
            let found = found.ok_or("nothing was found among points that exist")?;
            errors.push(exact.error_of(found.distance_squared).abs() / ulp32(exact.near));
        }
    }
    Ok(errors)
}

/// The exact distance of the nearest point.
fn least(keys: [&[DVec3]; 2], query: DVec3, given: Given, time: f32) -> ExactDistance {
    // Those that are nearest in f64; the nearest is among them.
    let about = |i: &usize| keys[0][*i].lerp(keys[1][*i], f64::from(time)).distance_squared(query);
    let mut order: Vec<usize> = (0..POINTS).collect();
    order.sort_by(|a, b| about(a).total_cmp(&about(b)));
    let exact = |&i: &usize| ExactDistance::new(query, given, &Moving::new(time, 2, given, |key| keys[key][i]));
    let mut nearest = exact(&order[0]);
    for i in &order[1..4] {
        let other = exact(i);
        if other.squared < nearest.squared {
            nearest = other;
        }
    }
    nearest
}
