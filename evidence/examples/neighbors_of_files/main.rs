//! Neighbours in particle and lidar files: reads them, lets what has velocities fly on for a step and what
//! has time stamps live for a moment, and asks for the neighbours of every point at a time of its own.
//!
//! `cargo run --release --example neighbors_of_files -- FILES` (BGEO, legacy VTK or `.pset`); without files,
//! those in `particles` and `scans` of the directory that `MBKD_DATA` names.

mod formats;

use clap::Parser;
use formats::Table;
use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborBuffer, PointParams, PointTree, TimeInterval};
use std::path::PathBuf;
use std::time::Instant;

#[derive(Parser)]
#[command(about = "Builds trees from particle and lidar files and finds the neighbours of every point")]
struct Args {
    /// BGEO (version 5), legacy binary VTK or .pset files; those in `particles` and `scans` of MBKD_DATA if none.
    files: Vec<PathBuf>,
}

/// The points of a table; `step` is how long what has velocities flies.
fn points(table: &Table, step: f32) -> Result<Vec<MovingPoint>, Box<dyn std::error::Error>> {
    let column = |name: &str| table.names.iter().position(|n| n == name);
    let columns = |names: [&str; 3]| Some([column(names[0])?, column(names[1])?, column(names[2])?]);
    let place = columns(["x", "y", "z"]).ok_or("no columns x, y, z")?;
    let vector = |row: &[f32], of: [usize; 3]| Vec3::from_array(of.map(|c| row[c]));
    let first = table.frames.first().ok_or("no frames")?;
    if let Some(time) = column("t") {
        let last = first.iter().map(|row| row[time]).fold(f32::MIN_POSITIVE, f32::max);
        let moment = |row: &Vec<f32>| {
            let begin = (row[time] / last).clamp(0.0, 0.95);
            Ok(MovingPoint::fixed(vector(row, place)).with_active(TimeInterval::new(begin, begin + 0.05)?))
        };
        return first.iter().map(moment).collect();
    }
    let way = columns(["vx", "vy", "vz"]);
    let later = table.frames.get(1);
    let point = |(i, row): (usize, &Vec<f32>)| {
        let at = vector(row, place);
        match (later, way) {
            (Some(later), _) => MovingPoint::new(at, vector(&later[i], place)),
            (None, Some(way)) => MovingPoint::new(at, at + vector(row, way) * step),
            (None, None) => MovingPoint::fixed(at),
        }
    };
    Ok(first.iter().enumerate().map(point).collect())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut files = Args::parse().files;
    if files.is_empty() {
        let Some(data) = std::env::var_os("MBKD_DATA") else {
            return Err("give some files, or set MBKD_DATA".into());
        };
        for folder in ["particles", "scans"] {
            let Ok(entries) = PathBuf::from(&data).join(folder).read_dir() else { continue };
            files.extend(entries.flatten().map(|entry| entry.path()));
        }
        files.sort();
    }
    for file in files {
        let Some(table) = Table::open(&file)? else { continue };
        let points = points(&table, 0.04)?;
        let tree = PointTree::build(&points, &PointParams::default())?;
        println!("{}: {} points\n{}", file.display(), tree.len(), tree.statistics());
        let mut buffer = NeighborBuffer::new();
        let (mut distance, mut queries) = (0.0, 0);
        let begin = Instant::now();
        for (i, point) in points.iter().enumerate() {
            let time = 0.5 * (point.active.begin() + point.active.end());
            let at = point.open.lerp(point.close, time);
            let found = tree.query(at, time).filter(|id| id != i as u32).nearest_n_into(8, &mut buffer);
            if let Some(last) = found.last() {
                distance += f64::from(last.distance());
                queries += 1;
            }
        }
        let each = begin.elapsed().as_secs_f64() / points.len().max(1) as f64;
        let mean = distance / f64::from(queries.max(1));
        println!("8 nearest others of every point: {:.0} ns each, within {mean:.4} on average\n", each * 1e9);
    }
    Ok(())
}
