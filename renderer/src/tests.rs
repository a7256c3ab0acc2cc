//! Whole pictures whose light can be computed by hand, and reproducibility: a seed determines the file.

use crate::animation::Animation;
use crate::film::{Film, Region, in_units, save_linear};
use crate::lamps::Lamps;
use crate::materials::{Finish, Surface, Texture};
use crate::options::Options;
use crate::parts::{Part, Whole, merge};
use crate::render::{Job, SQUARE, render};
use crate::run;
use crate::sky::Sky;
use crate::stage::{Stage, Things};
use crate::staging::{Source, scene_of};
use crate::world::World;
use clap::Parser;
use indicatif::ProgressBar;
use mbkd::glam::{Vec2, Vec3};
use mbkd::{BuildParams, KdParams, Policy, TriangleMesh};
use mbkd_scenes::{Camera, View};
use std::f32::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

fn exposed(stage: &Stage, policy: Policy, job: &Job) -> Film {
    let world = World::build(&stage.things, &BuildParams { policy }).unwrap();
    render(&world, stage, job, &AtomicBool::new(false), &ProgressBar::hidden()).0
}

fn job(width: usize, height: usize, samples: u32) -> Job {
    Job { seed: 3, ..Job::new(width, height, samples) }
}

/// A white surround of radiance 1, without a sun.
fn furnace() -> Sky {
    let one = Vec3::ONE;
    Sky { zenith: one, horizon: one, below: one, sun: Vec3::ZERO, ..Sky::studio(Vec3::Y) }
}

fn square(keys: &[Vec3]) -> TriangleMesh {
    let corners =
        |at: &Vec3| [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| *at + Vec3::new(x, y, 0.0));
    TriangleMesh::new(vec![[0, 1, 2], [0, 2, 3]], keys.iter().map(|at| corners(at).into()).collect::<Vec<Vec<Vec3>>>())
}

fn stage(mesh: TriangleMesh, color: f32, sky: Sky, camera: Camera) -> Stage {
    let things = Things::meshes(vec![mesh], vec![Surface::plain(Vec3::splat(color))]);
    Stage { name: "test".into(), things, camera, aperture: 0.0, focus: None, sky }
}

fn front() -> Camera {
    Camera::fixed(View::new(Vec3::new(0.0, 0.0, 10.0), Vec3::ZERO, 0.2))
}

#[test]
fn in_a_white_furnace_a_surface_shows_its_reflectance() {
    // A square that sees only the surround reflects exactly its colour, for any number of bounces.
    let stage = stage(square(&[Vec3::ZERO]), 0.3, furnace(), front());
    for bounces in [0, 1, 5] {
        let film = exposed(&stage, Policy::default(), &Job { bounces, ..job(8, 8, 4) });
        assert!(film.linear().iter().all(|c| (c.x - 0.3).abs() < 1e-5), "{bounces} bounces");
    }
}

#[test]
fn the_sun_shines_by_the_cosine() {
    let direction = Vec3::new(0.6, 0.0, 0.8);
    let sky = Sky {
        sun: Vec3::ONE,
        sun_radius: 0.0,
        zenith: Vec3::ZERO,
        horizon: Vec3::ZERO,
        below: Vec3::ZERO,
        ..Sky::studio(direction)
    };
    let film = exposed(&stage(square(&[Vec3::ZERO]), 0.5, sky, front()), Policy::default(), &job(4, 4, 2));
    assert!(film.linear().iter().all(|c| (c.x - 0.4).abs() < 1e-5));
}

#[test]
fn blur_is_the_share_of_time_that_a_pixel_is_covered() {
    // A black square, two wide, moves from -2 to 2: a pixel at x sees it for half of the shutter at most, and
    // stratified times match the share to within one sample.
    let moving = square(&[Vec3::new(-2.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0)]);
    let stage =
        stage(moving, 0.0, furnace(), Camera { keys: vec![View::new(Vec3::new(0.0, 0.0, 1e3), Vec3::ZERO, 0.004)] });
    let (width, samples) = (48, 64);
    for policy in [Policy::default(), Policy::Kd(KdParams::paper()), Policy::Kd(KdParams::classic())] {
        let film = exposed(&stage, policy, &Job { bounces: 0, ..job(width, 16, samples) });
        // The square is half as high as the picture: rows 4 to 11.
        for (i, c) in film.linear().into_iter().enumerate().skip(4 * width).take(8 * width) {
            let x = ((i % width) as f32 + 0.5) / width as f32 * 12.0 - 6.0;
            // Covered while |x - (4t - 2)| < 1.
            let covered = ((x + 3.0) / 4.0).clamp(0.0, 1.0) - ((x + 1.0) / 4.0).clamp(0.0, 1.0);
            assert!((1.0 - c.x - covered).abs() < 0.07, "{policy:?}, pixel {i} at {x}: {} for {}", 1.0 - c.x, covered);
        }
    }
}

#[test]
fn a_moving_camera_blurs_a_static_scene_like_moving_objects() {
    let view = |x: f32| View::new(Vec3::new(x, 0.0, 1e3), Vec3::new(x, 0.0, 0.0), 0.004);
    let still = stage(square(&[Vec3::ZERO]), 0.0, furnace(), Camera { keys: vec![view(2.0), view(-2.0)] });
    let moving = square(&[Vec3::new(-2.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0)]);
    let moving = stage(moving, 0.0, furnace(), Camera { keys: vec![view(0.0)] });
    let (a, b) =
        (exposed(&still, Policy::default(), &job(32, 8, 32)), exposed(&moving, Policy::default(), &job(32, 8, 32)));
    let apart = a.linear().iter().zip(b.linear()).map(|(a, b)| (a.x - b.x).abs()).fold(0.0, f32::max);
    // Equal except for rays that graze an edge.
    assert!(apart < 0.04, "{apart}");
}

#[test]
fn a_lens_is_sharp_in_focus_and_nowhere_else() {
    let near_edge = |focus: f32| {
        let mut stage =
            stage(square(&[Vec3::ZERO]), 0.0, furnace(), Camera::fixed(View::new(Vec3::Z * 10.0, Vec3::ZERO, 0.4)));
        (stage.aperture, stage.focus) = (0.5, Some(focus));
        let film = exposed(&stage, Policy::default(), &job(32, 32, 32)).linear();
        // Pixels that are neither black nor white.
        film.iter().filter(|c| c.x > 0.02 && c.x < 0.98).count()
    };
    let (sharp, blurred) = (near_edge(10.0), near_edge(5.0));
    assert!(sharp < 80 && blurred > 3 * sharp, "{sharp} and {blurred}");
}

#[test]
fn a_seed_gives_the_same_file_on_any_number_of_threads() {
    let stage = scene_of("hall", Some(12_000)).unwrap();
    let job = job(40, 24, 6);
    let bytes = |threads: usize, job: &Job, policy: Policy| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| exposed(&stage, policy, job).developed(1.0).pixels)
    };
    let one = bytes(1, &job, Policy::default());
    assert_eq!(bytes(3, &job, Policy::default()), one);
    assert_eq!(bytes(2, &job, Policy::Kd(KdParams::paper())), one, "policies give equal answers");
    assert_ne!(bytes(2, &Job { seed: 4, ..job }, Policy::default()), one);
}

#[test]
fn merged_parts_are_the_picture_bit_for_bit() {
    let stage = scene_of("tornado", Some(3000)).unwrap();
    let whole = Job { bounces: 2, ..job(37, 22, 7) };
    let single = exposed(&stage, Policy::default(), &whole);
    let region = |x, y, width, height| Region { x, y, width, height };
    let part = |taken, region| {
        let job = Job { taken, region, ..whole };
        Part::new(&job, exposed(&stage, Policy::default(), &job), 1.5, "tornado".into())
    };
    let all = whole.region;
    let (left, right) = (region(0, 0, 17, 22), region(17, 0, 20, 22));
    let parts = [part((3, 7), all), part((0, 1), all), part((1, 3), left), part((1, 2), right), part((2, 3), right)];
    let folder = std::env::temp_dir().join(format!("mbkd_parts_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut read = Vec::new();
    for (number, part) in parts.iter().enumerate() {
        let path = folder.join(format!("{number}.exr"));
        part.save(&path).unwrap();
        assert_eq!(Part::open(&path).unwrap(), *part);
        read.push((number.to_string(), Part::open(&path).unwrap()));
    }
    let (merged, about) = merge(&read).unwrap();
    assert_eq!((merged.clone(), about.exposure), (single.clone(), 1.5));
    for kind in ["exr", "pfm"] {
        save_linear(&single, &folder.join("single").with_extension(kind)).unwrap();
        save_linear(&merged, &folder.join("merged").with_extension(kind)).unwrap();
        let bytes = |name: &str| std::fs::read(folder.join(name).with_extension(kind)).unwrap();
        assert_eq!(bytes("single"), bytes("merged"));
    }
    assert!(Part::open(&folder.join("single.exr")).unwrap_err().contains("whole picture"));
    assert_eq!(merged.developed(1.5).pixels, single.developed(1.5).pixels);

    // Missing parts, duplicates and parts of another picture are errors.
    let error = |parts: &[(String, Part)]| merge(parts).unwrap_err();
    assert!(error(&read[..4]).contains("440 pixels, the first in column 17 and row 0"), "{}", error(&read[..4]));
    assert!(error(&[&read[..], &read[3..4]].concat()).contains("3 and 3 have the same samples"));
    read[2].1.whole.about = "hall".into();
    assert!(error(&read).contains("0 and 2 are not parts of the same picture"));
    assert!(error(&[]).contains("no parts"));
    // A hundred gigabytes of sums.
    let large = Part { whole: Whole { size: [1 << 16; 2], ..about }, region: region(9, 9, 20, 1), ..parts[0].clone() };
    assert!(error(&[("large".into(), large)]).contains("they have 20 pixels together, and the picture 4294967296"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_commands_of_a_farm_make_the_files_of_one_machine() {
    let folder = std::env::temp_dir().join(format!("mbkd_farm_{}", std::process::id()));
    let [one, farm] = ["one", "farm"].map(|name| folder.join(name));
    [&one, &farm].into_iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
    let obey = |words: &[String]| {
        let options = Options::try_parse_from(words).unwrap();
        run(&options, || Ok(Arc::default())).unwrap();
    };
    let words = |line: &str, outputs: &[PathBuf]| -> Vec<String> {
        let outputs = outputs.iter().flat_map(|path| ["-o".to_string(), path.display().to_string()]);
        line.split(' ').map(str::to_string).chain(outputs).collect()
    };
    // Any worker may execute the lines, in any order; a merge comes last.
    let work_off = |line: Vec<String>, parts: u32| {
        let options = Options::try_parse_from(&line).unwrap();
        let lines = crate::farm::commands(&options, parts, line);
        let (last, first) = lines.split_last().unwrap();
        for line in first.iter().rev().chain([last]) {
            obey(&line.split(' ').map(|word| word.trim_matches('\'').to_string()).collect::<Vec<_>>());
        }
        lines.len()
    };
    let compare = |names: &[&str]| {
        for name in names {
            let [a, b] = [&one, &farm].map(|folder| std::fs::read(folder.join(name)).unwrap());
            assert!(a == b && a.len() > 100, "{name} differs");
        }
    };
    let picture = "motion_blur --scene tornado --triangles 800 --width 26 --height 15 --spp 7 --bounces 2 --seed 9";
    let files = |folder: &Path| ["picture.exr", "picture.png"].map(|name| folder.join(name));
    obey(&words(picture, &files(&one)));
    assert_eq!(work_off(words(picture, &files(&farm)), 3), 4);
    compare(&["picture.exr", "picture.png"]);

    let sequence = "motion_blur --scene tornado --triangles 800 --width 26 --height 15 --spp 2 --frames 3";
    obey(&words(sequence, &[one.join("f.png")]));
    assert_eq!(work_off(words(sequence, &[farm.join("f.png")]), 4), 3);
    compare(&["f_000.png", "f_001.png", "f_002.png"]);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The radiance of a square that fills the picture, seen from the front.
fn shown(surface: Surface, sky: Sky, bounces: u32) -> Vec3 {
    let mut stage = stage(square(&[Vec3::ZERO]), 0.0, sky, front());
    stage.things.surfaces = vec![surface];
    let film = exposed(&stage, Policy::default(), &Job { bounces, ..job(8, 8, 64) });
    film.linear().iter().sum::<Vec3>() / 64.0
}

#[test]
fn in_a_white_furnace_metals_show_their_colour_and_gloss_little_more() {
    let color = Vec3::new(0.9, 0.5, 0.1);
    let of = |color: Vec3, metallic: f32, roughness: f32| {
        let finish = Some(Finish { metallic, roughness, texture: None });
        shown(Surface { finish, ..Surface::plain(color) }, furnace(), 1)
    };
    let metal = of(color, 1.0, 0.2);
    assert!((metal - color).abs().max_element() < 0.01, "{metal}");
    // Light between mirrors is compensated: one reflection alone would show 1 - ln 2.
    let rough = of(Vec3::ONE, 1.0, 1.0);
    assert!((rough - Vec3::ONE).abs().max_element() < 0.01, "{rough}");
    let coated = of(color, 0.0, 0.2);
    let expected = Vec3::splat(0.04) + color * 0.96;
    assert!((coated - expected).abs().max_element() < 0.02, "{coated} and {expected}");
}

/// A floor before a wall of metal, both in the sun, with the floor filling the picture.
fn floor_by_metal(roughness: f32) -> Stage {
    let quad = |corners: [Vec3; 4]| TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], corners.into());
    let floor = quad([(-9.0, -9.0), (-9.0, 9.0), (9.0, 9.0), (9.0, -9.0)].map(|(x, z)| Vec3::new(x, 0.0, z)));
    let wall = quad([(-9.0, 0.0), (9.0, 0.0), (9.0, 9.0), (-9.0, 9.0)].map(|(x, y)| Vec3::new(x, y, 0.0)));
    let metal =
        Surface { finish: Some(Finish { metallic: 1.0, roughness, texture: None }), ..Surface::plain(Vec3::ONE) };
    let things = Things::meshes(vec![floor, wall], vec![Surface::plain(Vec3::splat(0.5)), metal]);
    let camera = Camera::fixed(View::new(Vec3::new(0.0, 6.0, 8.0), Vec3::new(0.0, 0.0, 3.0), 0.4));
    let sky = Sky::studio(Vec3::new(0.2, 0.6, 0.7));
    Stage { name: "test".into(), things, camera, aperture: 0.0, focus: None, sky }
}

#[test]
fn smooth_metals_reflect_soft_light_without_specks() {
    let stage = floor_by_metal(0.2);
    let of = |caustics: bool, bounces: u32, samples: u32| {
        exposed(&stage, Policy::default(), &Job { caustics, bounces, ..job(12, 12, samples) }).linear()
    };
    let mean = |film: &[Vec3]| film.iter().sum::<Vec3>() / film.len() as f32;
    let noise = |film: &[Vec3], true_film: &[Vec3]| {
        (film.iter().zip(true_film).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>() / film.len() as f32).sqrt()
    };
    let [sharp, soft] = [true, false].map(|caustics| (of(caustics, 1, 16), of(caustics, 1, 4096)));
    let [before, now] = [noise(&sharp.0, &sharp.1), noise(&soft.0, &soft.1)];
    let [bright, spread] = [mean(&sharp.1), mean(&soft.1)];
    assert!(2.0 * now < before, "{before} and {now}");
    assert!((spread - bright).abs().max_element() < 0.1 * bright.x, "{bright} and {spread}");
}

#[test]
fn surfaces_seen_directly_or_in_mirrors_stay_sharp() {
    // The wall fills the picture; it mirrors the floor, which has no mirrors.
    let mut stage = floor_by_metal(0.2);
    stage.camera = Camera::fixed(View::new(Vec3::new(0.0, 4.0, 8.0), Vec3::new(0.0, 4.0, 0.0), 0.4));
    let of = |caustics: bool, bounces: u32| {
        exposed(&stage, Policy::default(), &Job { caustics, bounces, ..job(16, 16, 8) }).linear()
    };
    assert_eq!(of(true, 1), of(false, 1));
    // A floor as smooth as the wall: mirrors in mirrors.
    stage.things.surfaces[0] = stage.things.surfaces[1].clone();
    let of =
        |caustics: bool| exposed(&stage, Policy::default(), &Job { caustics, bounces: 4, ..job(16, 16, 8) }).linear();
    assert_eq!(of(true), of(false));
}

#[test]
fn emitters_are_visible_and_light_other_surfaces() {
    let dark = Sky { zenith: Vec3::ZERO, horizon: Vec3::ZERO, below: Vec3::ZERO, sun: Vec3::ZERO, ..furnace() };
    let glow = Vec3::new(3.0, 2.0, 0.5);
    let lamp = Surface { emission: glow, ..Surface::plain(Vec3::ZERO) };
    assert!((shown(lamp.clone(), dark, 0) - glow).abs().max_element() < 1e-4);
    // A lamp behind the camera that covers a large part of the view of a square before it.
    let mut stage = stage(square(&[Vec3::ZERO]), 0.0, dark, front());
    let far = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Vec3::new(40.0 * x, 40.0 * y, 20.0));
    stage.things.meshes.push(TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], far.into()));
    stage.things.surfaces = vec![Surface::plain(Vec3::splat(0.5)), lamp];
    let lit = |bounces: u32| {
        let film = exposed(&stage, Policy::default(), &Job { bounces, ..job(8, 8, 64) });
        film.linear().iter().sum::<Vec3>() / 64.0
    };
    assert_eq!(lit(0), Vec3::ZERO);
    // The share of the cosine-weighted hemisphere that a square of half width a at distance d covers (form factor).
    let (a, d) = (40.0f64, 20.0f64);
    let root = (a * a + d * d).sqrt();
    let share = 4.0 * a / root * (a / root).atan() / std::f64::consts::PI;
    let found = lit(1);
    assert!((found - glow * (0.5 * share as f32)).abs().max_element() < 0.03, "{found}, {share}");
}

/// A square that fills the picture, lit by lamps alone.
fn lit_by(floor: Surface, lamps: Vec<(TriangleMesh, Surface)>) -> Stage {
    let dark = Sky { zenith: Vec3::ZERO, horizon: Vec3::ZERO, below: Vec3::ZERO, sun: Vec3::ZERO, ..furnace() };
    let mut stage = stage(square(&[Vec3::ZERO]), 0.0, dark, front());
    stage.things.surfaces = vec![floor];
    for (mesh, surface) in lamps {
        stage.things.meshes.push(mesh);
        stage.things.surfaces.push(surface);
    }
    stage
}

/// A picture with shadow rays to lamps, or with paths alone.
fn lit(stage: &Stage, looks: bool, bounces: u32, samples: u32) -> Vec<Vec3> {
    let mut world = World::build(&stage.things, &BuildParams::default()).unwrap();
    assert!(!world.lamps.is_empty());
    if !looks {
        world.lamps = Lamps::default();
    }
    let job = Job { bounces, ..job(8, 8, samples) };
    render(&world, stage, &job, &AtomicBool::new(false), &ProgressBar::hidden()).0.linear()
}

#[test]
fn lamps_light_as_much_as_paths_find_with_less_noise() {
    let white = || Surface::plain(Vec3::splat(0.8));
    let shining =
        |light: f32| Surface { emission: Vec3::new(1.0, 0.7, 0.4) * light, ..Surface::plain(Vec3::splat(0.2)) };
    let metal = Surface { finish: Some(Finish { metallic: 0.6, roughness: 0.5, texture: None }), ..white() };
    let pixels = vec![[255, 255, 255], [0, 0, 0], [200, 40, 90], [0, 0, 0]];
    let painted = Surface {
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        emission_texture: Some(Arc::new(Texture { width: 2, height: 2, pixels })),
        ..shining(50.0)
    };
    // A square of this half width that stands beside the floor or passes over it.
    let lamp = |half: f32, keys: &[Vec3]| {
        let corners = |at: &Vec3| {
            [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(y, z)| *at + Vec3::new(-0.3 * z, y, z))
        };
        let keys = keys.iter().map(|at| corners(at).into()).collect::<Vec<Vec<Vec3>>>();
        TriangleMesh::new(vec![[0, 1, 2], [0, 2, 3]], keys)
    };
    let aside = Vec3::new(3.0, 0.5, 2.0);
    // The lamps, the bounces, and the least factor by which noise decreases (mean square, 16 samples).
    let cases = [
        ("small", lit_by(white(), vec![(lamp(0.2, &[aside]), shining(50.0))]), 1, 1000.0),
        (
            "moving",
            lit_by(white(), vec![(lamp(0.2, &[Vec3::new(3.0, 3.0, 1.0), Vec3::new(2.0, -3.0, 3.0)]), shining(50.0))]),
            1,
            1000.0,
        ),
        ("painted", lit_by(white(), vec![(lamp(0.4, &[aside]), painted)]), 1, 50.0),
        ("on metal", lit_by(metal, vec![(lamp(0.3, &[aside]), shining(20.0))]), 1, 1000.0),
        (
            "three, and walls",
            lit_by(
                white(),
                vec![
                    (lamp(0.2, &[aside]), shining(50.0)),
                    (lamp(0.05, &[Vec3::new(-2.0, 1.0, 1.0)]), shining(300.0)),
                    (lamp(1.0, &[Vec3::new(0.0, 4.0, 1.0)]), shining(1.0)),
                    (lamp(2.0, &[Vec3::new(-4.0, 0.0, 2.0)]), white()),
                ],
            ),
            3,
            100.0,
        ),
        ("large", lit_by(white(), vec![(lamp(4.0, &[Vec3::new(2.5, 0.0, 4.0)]), shining(1.0))]), 1, 4.0),
    ];
    for (name, stage, bounces, less) in cases {
        let of = |looks: bool, samples: u32| lit(&stage, looks, bounces, samples);
        const MANY: u32 = 1 << 14;
        let (paths, both) = ((of(false, 16), of(false, MANY)), (of(true, 16), of(true, MANY / 16)));
        let mean = |film: &[Vec3]| film.iter().sum::<Vec3>() / film.len() as f32;
        let error = |film: &[Vec3]| {
            film.iter().zip(&both.1).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>() / film.len() as f32
        };
        let [before, now] = [error(&paths.0), error(&both.0)];
        // Four standard deviations of the mean by paths alone, over 64 pixels and as many samples.
        let near = 4.0 * (before * 16.0 / (64.0 * MANY as f32)).sqrt();
        assert!((mean(&paths.1) - mean(&both.1)).length() < near, "{name}: {} and {}", mean(&paths.1), mean(&both.1));
        assert!(now * less < before, "{name}: {before:e} and {now:e}");
    }
}

#[test]
fn a_small_lamp_lights_by_cosines_and_distance() {
    let (half, light) = (0.02f32, 1e4);
    let corners = [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(y, z)| Vec3::new(3.0, y, 2.0 + z));
    let mesh = TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], corners.into());
    let lamp = Surface { emission: Vec3::splat(light), ..Surface::plain(Vec3::ZERO) };
    let film = lit(&lit_by(Surface::plain(Vec3::splat(0.8)), vec![(mesh, lamp)]), true, 1, 16);
    for (i, found) in film.into_iter().enumerate() {
        let at = |i: usize| (i as f32 + 0.5) / 4.0 - 1.0;
        let way = Vec3::new(3.0, 0.0, 2.0) - Vec3::new(at(i % 8), -at(i / 8), 0.0);
        let square = way.length_squared();
        let expected = 0.8 / PI * light * 4.0 * half * half * way.z * way.x / (square * square);
        assert!((found.x / expected - 1.0).abs() < 0.02, "pixel {i}: {found} and {expected}");
    }
}

#[test]
fn a_room_with_emitting_walls_has_little_noise() {
    // Paths alone would find the same light everywhere; shadow rays to lamps must not add noise.
    let wall = |corners: [[f32; 3]; 4]| {
        let mesh = TriangleMesh::fixed(vec![[0, 1, 2], [0, 2, 3]], corners.map(Vec3::from).into());
        (mesh, Surface { emission: Vec3::ONE, ..Surface::plain(Vec3::ZERO) })
    };
    let (a, b) = (-12.0, 12.0);
    let walls = vec![
        wall([[a, a, -1.0], [a, b, -1.0], [a, b, b], [a, a, b]]),
        wall([[b, a, -1.0], [b, b, -1.0], [b, b, b], [b, a, b]]),
        wall([[a, a, -1.0], [b, a, -1.0], [b, a, b], [a, a, b]]),
        wall([[a, b, -1.0], [b, b, -1.0], [b, b, b], [a, b, b]]),
        wall([[a, a, b], [b, a, b], [b, b, b], [a, b, b]]),
    ];
    let film = lit(&lit_by(Surface::plain(Vec3::splat(0.5)), walls), true, 1, 64);
    let error = film.iter().map(|c| (c.x - 0.5) * (c.x - 0.5)).sum::<f32>() / film.len() as f32;
    assert!(error.sqrt() < 0.01, "{}", error.sqrt());
}

#[test]
fn an_interrupted_first_pass_leaves_a_coarse_picture() {
    // The film after an interrupt of the first pass, once every square has its first pixel.
    let stage = scene_of("hall", Some(3000)).unwrap();
    let full = exposed(&stage, Policy::default(), &job(22, 13, 1));
    let mut coarse = full.clone();
    let square = |pixel: usize| (pixel / 22 - pixel / 22 % SQUARE) * 22 + pixel % 22 - pixel % 22 % SQUARE;
    for pixel in (0..22 * 13).filter(|&pixel| square(pixel) != pixel) {
        (coarse.sums[pixel], coarse.samples[pixel]) = ([0; 3], 0);
    }
    assert_eq!(coarse.fill_squares(SQUARE), 0);
    let (full, coarse) = (full.linear(), coarse.linear());
    assert!((0..22 * 13).all(|pixel| coarse[pixel] == full[square(pixel)]));
    assert_eq!(Film::new(5, 5).fill_squares(SQUARE), 25, "nothing to show");
}

#[test]
fn an_interrupt_keeps_the_samples_taken() {
    let stage = stage(square(&[Vec3::ZERO]), 0.3, furnace(), front());
    let world = World::build(&stage.things, &BuildParams::default()).unwrap();
    let stop = AtomicBool::new(true);
    let (film, cost) = render(&world, &stage, &job(20, 20, 8), &stop, &ProgressBar::hidden());
    assert!(cost.rays == 0 && film.samples.iter().all(|&n| n == 0));
    // A film with only some of its samples is as bright as a complete one.
    let mut film = exposed(&stage, Policy::default(), &job(20, 20, 4));
    film.sums[7] = in_units(Vec3::splat(0.6));
    film.samples[7] = 2;
    assert!(film.linear().iter().all(|c| (c.x - 0.3).abs() < 1e-5));
}

#[test]
fn files_contain_the_rendered_picture() {
    let stage = scene_of("hand", Some(2000)).unwrap();
    let film = exposed(&stage, Policy::default(), &job(12, 7, 2));
    let folder = std::env::temp_dir().join(format!("mbkd_motion_blur_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let picture = film.developed(1.0);
    picture.save(&folder.join("a.png")).unwrap();
    let texture = crate::readers::decode(&std::fs::read(folder.join("a.png")).unwrap()).unwrap();
    assert_eq!(texture.pixels, picture.pixels);
    save_linear(&film, &folder.join("a.exr")).unwrap();
    let exr = exr::prelude::read_first_flat_layer_from_file(folder.join("a.exr")).unwrap().layer_data;
    let names: Vec<String> = exr.channel_data.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!((names.concat(), exr.size.0, exr.size.1), ("BGR".into(), 12, 7));
    for (channel, color) in exr.channel_data.list.iter().zip([2, 1, 0]) {
        let values = channel.sample_data.values_as_f32();
        assert!(values.eq(film.linear().iter().map(|pixel| pixel[color])));
    }
    save_linear(&film, &folder.join("a.pfm")).unwrap();
    let pfm = std::fs::read(folder.join("a.pfm")).unwrap();
    let (header, body) = pfm.split_at(b"PF\n12 7\n-1.0\n".len());
    assert_eq!(header, b"PF\n12 7\n-1.0\n");
    // Rows from the bottom: the file's first pixel is the first of the last row.
    assert_eq!(body.len(), 12 * 7 * 12);
    assert_eq!(body[..4], film.linear()[12 * 6].x.to_le_bytes());
    let mut animation = Animation::begin(folder.join("a.gif"), 0.1);
    (0..3).for_each(|_| animation.add(&picture).unwrap());
    animation.end().unwrap();
    let mut frames = gif::Decoder::new(std::fs::File::open(folder.join("a.gif")).unwrap()).unwrap();
    let mut count = 0;
    while let Some(frame) = frames.read_next_frame().unwrap() {
        assert_eq!((frame.width, frame.height, frame.delay), (12, 7, 10));
        count += 1;
    }
    assert_eq!(count, 3);
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(picture.save(&folder.join("gone.png")).unwrap_err().contains("gone.png"));
}

#[test]
fn noise_of_the_hall_is_a_fifth_of_that_of_an_additive_recurrence() {
    // The runner's legs, floor and columns, at the default settings. Half the squared difference of two independent
    // pictures is the mean squared error of one; relative: divided by the square of the pixel plus a small constant.
    let options = Options::parse_from(["motion_blur", "--tile", "520,300,160,90"]);
    let stage = Source::open(&options).unwrap().stage(&options, 0, 1).unwrap();
    let [a, b] = [0, 1].map(|seed| {
        let film = exposed(&stage, Policy::default(), &Job { seed, ..crate::job(&options) }).filtered().linear();
        film.iter().flat_map(|c| c.to_array()).map(f64::from).collect::<Vec<f64>>()
    });
    let (mut error, mut relative) = (0.0, 0.0);
    for (a, b) in a.iter().zip(&b) {
        let (square, mean) = (0.5 * (a - b) * (a - b), 0.5 * (a + b));
        error += square / 43_200.0;
        relative += square / (mean * mean + 0.01) / 43_200.0;
    }
    println!("mean squared error {error:.2e}, relative {relative:.2e}");
    // The errors of 32 samples of an additive recurrence per pixel.
    assert!(5.0 * error < 9.51e-4 && 5.0 * relative < 8.77e-3, "{error:e} and {relative:e}");
}

#[test]
fn every_scene_renders() {
    for name in mbkd_scenes::CATALOGUE.iter().map(|recipe| recipe.name).chain(["flake"]) {
        let stage = scene_of(name, Some(3000)).unwrap();
        let film = exposed(&stage, Policy::default(), &job(24, 16, 2)).linear();
        let (mean, fine) = (film.iter().sum::<Vec3>() / film.len() as f32, film.iter().all(|c| c.is_finite()));
        let spread = film.iter().map(|c| (*c - mean).length()).fold(0.0, f32::max);
        assert!(fine && mean.min_element() > 0.0 && spread > 0.05, "{name}: mean {mean}, spread {spread}");
    }
}
