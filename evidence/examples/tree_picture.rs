//! Draws how the wide tree looks where things stand still, move alike, and part company: slices through the boxes of
//! real trees at three times of the shutter.
//!
//! `cargo run --release --example tree_picture -- docs/tree.png`

use clap::Parser;
use mbkd::glam::{DVec3, IVec2, Vec2, Vec3};
use mbkd::{BuildParams, Division, Hit, Keys, RayTree, TriangleMesh, WideParams};
use mbkd_renderer::film::Picture;
use mbkd_renderer::font;
use mbkd_scenes as scene;
use mbkd_scenes::Random;
use std::path::PathBuf;

#[derive(Parser)]
#[command(about = "Draws slices through the boxes of real trees at three times of the shutter")]
struct Args {
    /// The picture to write, a PNG.
    #[arg(default_value = "tree.png")]
    output: PathBuf,
}

const TRIANGLES: usize = 3000;
/// Side of a panel in pixels, the gap around it, and half the side in scene units.
const PANEL: usize = 230;
const GAP: usize = 10;
const REACH: f32 = 2.4;
const TIMES: [f32; 3] = [0.0, 0.5, 1.0];
/// Boxes of the first level of nodes, of the next, and of leaf blocks.
const COLORS: [[u8; 3]; 3] = [[190, 30, 45], [230, 140, 20], [70, 120, 190]];
/// What remains of the background under one leaf box.
const SHADE: f32 = 0.93;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = Args::parse().output;
    let whole = BuildParams::wide(WideParams { division: Division::Whole, ..WideParams::default() });
    let columns = [
        ("still", still(), BuildParams::default()),
        ("moving alike", flying(), BuildParams::default()),
        ("parting, one hierarchy", bursting(), whole),
        ("parting, as chosen", bursting(), BuildParams::default()),
    ];
    let (step, top) = (PANEL + GAP, 30);
    let width = 60 + columns.len() * step;
    let mut picture = Picture::filled(width, top + TIMES.len() * step, [255; 3]);
    for (i, (title, mesh, params)) in columns.into_iter().enumerate() {
        let tree = RayTree::build(&[mesh], &params)?;
        let statistics = tree.statistics();
        println!("{title}: {} nodes, {} blocks, {} bytes", statistics.nodes, statistics.leaves, statistics.bytes);
        font::write(&mut picture, title, 60 + i * step, 10, 1, [0; 3]);
        for (row, time) in TIMES.into_iter().enumerate() {
            picture.paste(&panel(&tree, time), 60 + i * step, top + row * step);
        }
    }
    for (row, time) in TIMES.into_iter().enumerate() {
        font::write(&mut picture, &format!("t = {time}"), 8, top + row * step + PANEL / 2, 1, [0; 3]);
    }
    picture.save(&path)?;
    println!("wrote {}", path.display());
    Ok(())
}

/// The slice z = 0 of a tree and its triangles at one time.
fn panel(tree: &RayTree, time: f32) -> Picture {
    let mut boxes = Vec::new();
    tree.boxes(time, |b| boxes.extend((b.bounds.min.z <= 0.0 && b.bounds.max.z >= 0.0).then_some(b)));
    let kind = |b: &mbkd::TreeBox| if b.leaf { 2 } else { (b.level as usize - 1).min(1) };
    // Large boxes above small ones.
    boxes.sort_by_key(|b| core::cmp::Reverse((kind(b), b.level)));
    let mut shade = vec![1.0f32; PANEL * PANEL];
    for b in boxes.iter().filter(|b| b.leaf) {
        let (low, high) = corners(b);
        for y in low.y.max(0)..=high.y.min(PANEL as i32 - 1) {
            for x in low.x.max(0)..=high.x.min(PANEL as i32 - 1) {
                shade[y as usize * PANEL + x as usize] *= SHADE;
            }
        }
    }
    let mut picture = Picture::filled(PANEL, PANEL, [255; 3]);
    for (pixel, shade) in picture.pixels.iter_mut().zip(shade) {
        *pixel = [(250.0 * shade) as u8, (251.0 * shade.powf(0.8)) as u8, (252.0 * shade.powf(0.5)) as u8];
    }
    for b in &boxes {
        let ((low, high), color) = (corners(b), COLORS[kind(b)]);
        for (from, to) in [
            (low, IVec2::new(high.x, low.y)),
            (low, IVec2::new(low.x, high.y)),
            (high, IVec2::new(high.x, low.y)),
            (high, IVec2::new(low.x, high.y)),
        ] {
            line(&mut picture, from.as_vec2(), to.as_vec2(), color);
        }
    }
    for primitive in 0..tree.statistics().primitives as u32 {
        let corners = tree.vertices(&Hit { t: 0.0, u: 0.0, v: 0.0, mesh: 0, primitive }, time);
        let cuts: Vec<Vec2> = (0..3).filter_map(|i| cut(corners[i], corners[(i + 1) % 3])).collect();
        if let [from, to] = cuts[..] {
            line(&mut picture, from, to, [0; 3]);
        }
    }
    picture
}

/// A place of the slice in pixels.
fn pixel(p: DVec3) -> Vec2 {
    let scale = PANEL as f32 / (2.0 * REACH);
    Vec2::new((p.x as f32 + REACH) * scale, (REACH - p.y as f32) * scale)
}

fn corners(b: &mbkd::TreeBox) -> (IVec2, IVec2) {
    let (a, c) = (pixel(b.bounds.min).as_ivec2(), pixel(b.bounds.max).as_ivec2());
    (a.min(c), a.max(c))
}

/// Where an edge meets the slice.
fn cut(a: DVec3, b: DVec3) -> Option<Vec2> {
    ((a.z < 0.0) != (b.z < 0.0)).then(|| pixel(a.lerp(b, a.z / (a.z - b.z))))
}

fn line(picture: &mut Picture, from: Vec2, to: Vec2, color: [u8; 3]) {
    let steps = (to - from).abs().max_element().ceil().max(1.0) as usize;
    for i in 0..=steps {
        let p = from.lerp(to, i as f32 / steps as f32).round().as_ivec2();
        if p.cmpge(IVec2::ZERO).all() && p.cmplt(IVec2::splat(PANEL as i32)).all() {
            picture.pixels[p.y as usize * PANEL + p.x as usize] = color;
        }
    }
}

/// The positions of the rock at the begin, and its triangles.
fn rock() -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let mesh = scene::coherent(TRIANGLES).meshes.swap_remove(0);
    let Keys::F32(mut keys) = mesh.keys else { unreachable!("scenes are in single precision") };
    (mesh.indices, keys.swap_remove(0))
}

fn still() -> TriangleMesh {
    let (indices, rock) = rock();
    TriangleMesh::fixed(indices, rock)
}

/// The rock on its way to the upper right, turning a little.
fn flying() -> TriangleMesh {
    let (indices, rock) = rock();
    let way = Vec3::new(0.7, 0.55, 0.0);
    let turned = |p: Vec3| Vec3::new(p.x - 0.3 * p.y, p.y + 0.3 * p.x, p.z);
    let keys: Vec<Vec<Vec3>> =
        vec![rock.iter().map(|p| p - way).collect(), rock.iter().map(|&p| turned(p) + way).collect()];
    TriangleMesh::new(indices, keys)
}

/// The rock as it bursts: each triangle flies its own way, on the whole outward.
fn bursting() -> TriangleMesh {
    let (indices, rock) = rock();
    let mut random = Random(7);
    let mut keys = vec![Vec::new(), Vec::new()];
    for triangle in &indices {
        let corners = triangle.map(|i| rock[i as usize]);
        let outward = (corners[0] + corners[1] + corners[2]).normalize();
        let aside = Vec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5);
        let way = outward * (0.3 * random.unit()) + aside * 1.8;
        keys[0].extend(corners);
        keys[1].extend(corners.map(|p| p + way));
    }
    TriangleMesh::new((0..indices.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), keys)
}
