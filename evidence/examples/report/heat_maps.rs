//! Section 2: where each structure works hard, as in the paper's Figures 4 and 5.

use crate::cast::{exact, scene};
use crate::page::{Item, Picture, Section, Table};
use crate::run::Run;
use mbkd::Counters;
use mbkd_evidence::peers::Peer;
use mbkd_scenes::Random;
use rayon::prelude::*;
use std::error::Error;

/// Pixels between two maps.
const GAP: usize = 8;
/// Height of the strip that shows the scale.
const STRIP: usize = 14;
/// Maps end at this share of all pixels: what lies above shows as the end of the scale.
const END: f64 = 0.995;

/// Mean counts of one structure, pixel by pixel.
struct Map {
    steps: Vec<f32>,
    tests: Vec<f32>,
}

/// Makes the section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let scenes = ["camera", "hall", "hairball", "hand"];
    let cast = exact();
    run.begin("heat-maps", scenes.len());
    let (side, samples) = run.pick((96, 4), (144, 16));
    let names: Vec<&str> = cast.iter().map(|member| member.name).collect();
    let mut items = vec![Item::Text(format!(
        "Every pixel shows the mean over {samples} camera rays at random times. Upper row: traversal steps (inner \
         nodes and leaves). Lower row: triangle tests. From left to right: {}. All maps of a row share one scale, from \
         black for zero to pale yellow for the value in the caption, which {:.1} % of all pixels exceed. A step of the \
         wide tree tests sixteen boxes; a step of the other structures tests one plane or two boxes.",
        names.join(", "),
        100.0 * (1.0 - END)
    ))];
    let mut rows = Vec::new();
    for name in scenes {
        run.step(name);
        let scene = scene(name, run.pick(6_000, 60_000))?;
        let mut maps = Vec::new();
        for member in &cast {
            let peer = Peer::build(&member.structure, &scene.meshes)?;
            let map = count(&peer, &scene.camera, side, samples, run.seed);
            let figures = |values: &[f32]| {
                let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64;
                let most = values.iter().fold(0.0f32, |most, v| v.max(most));
                [format!("{mean:.1}"), format!("{:.1}", end(values)), format!("{most:.0}")]
            };
            let cells = [figures(&map.steps), figures(&map.tests)].concat();
            rows.push([vec![name.to_string(), member.name.to_string()], cells].concat());
            maps.push(map);
        }
        items.push(Item::Picture(draw(name, &maps, side)?));
    }
    let columns = ["scene", "structure", "steps, mean", "99.5 %", "most", "tests, mean", "99.5 %", "most"];
    items.push(Item::Table(Table {
        name: "counts".into(),
        caption: "Steps and tests per pixel.".into(),
        columns: columns.map(String::from).to_vec(),
        rows,
    }));
    Ok(Section { id: "heat-maps", title: "2. Where the work is: the paper's Figures 4 and 5", items })
}

/// Counts what the camera rays of all pixels do.
fn count(peer: &Peer, camera: &mbkd_scenes::Camera, side: usize, samples: usize, seed: u64) -> Map {
    let pixel = |at: usize| {
        let mut random = Random(seed ^ (at as u64) << 20);
        let mut counters = Counters::default();
        for _ in 0..samples {
            let mut unit = || random.unit_f64() as f32;
            let (x, y) = ((at % side) as f32 + unit(), (at / side) as f32 + unit());
            peer.closest_hit_observed(&camera.ray(x / side as f32, y / side as f32, 1.0, unit()), &mut counters);
        }
        let mean = |n: u64| n as f32 / samples as f32;
        (mean(counters.steps()), mean(counters.primitive_tests))
    };
    let (steps, tests) = (0..side * side).into_par_iter().map(pixel).unzip();
    Map { steps, tests }
}

/// The value below which are [`END`] of all.
fn end(values: &[f32]) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted[((sorted.len() - 1) as f64 * END) as usize].max(1.0)
}

/// Two rows of maps, each above the strip of its scale.
fn draw(scene: &str, maps: &[Map], side: usize) -> Result<Picture, Box<dyn Error>> {
    let width = maps.len() * (side + GAP) - GAP;
    let row = side + GAP / 2 + STRIP;
    let height = 2 * row + GAP;
    let mut pixels = vec![[255u8; 3]; width * height];
    let mut ends = Vec::new();
    for (i, of) in [|map: &Map| map.steps.clone(), |map: &Map| map.tests.clone()].into_iter().enumerate() {
        let values: Vec<Vec<f32>> = maps.iter().map(of).collect();
        let top = end(&values.concat());
        ends.push(top);
        let y0 = i * (row + GAP);
        for (k, map) in values.iter().enumerate() {
            for (at, value) in map.iter().enumerate() {
                let (x, y) = (k * (side + GAP) + at % side, y0 + at / side);
                pixels[y * width + x] = mbkd_scenes::heat(value / top);
            }
        }
        for y in y0 + side + GAP / 2..y0 + row {
            for x in 0..width {
                pixels[y * width + x] = mbkd_scenes::heat(x as f32 / width as f32);
            }
        }
    }
    let caption = format!("{scene}: steps up to {:.0} (above), tests up to {:.0} (below)", ends[0], ends[1]);
    Ok(Picture { name: scene.into(), caption, png: png(width, height, &pixels.concat())? })
}

fn png(width: usize, height: usize, pixels: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(bytes)
}
