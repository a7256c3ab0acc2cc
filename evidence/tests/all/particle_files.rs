//! Real particles and lidar points, where `MBKD_DATA` names a directory that has them; without it the
//! same checks run on a small made-up set in the same format.

#[path = "../../examples/neighbors_of_files/formats.rs"]
mod formats;

use crate::support::{Cloud, Random};
use formats::Table;
use mbkd::glam::Vec3;
use mbkd::{PointArrays, PointParams, PointStructure, PointTree, TimeInterval};
use std::path::Path;

struct Set(Table);

impl Set {
    fn columns(&self, frame: usize, names: [&str; 3]) -> Option<Vec<Vec3>> {
        let at: Vec<usize> = names.iter().filter_map(|n| self.0.names.iter().position(|m| m == n)).collect();
        let [x, y, z] = at[..] else { return None };
        Some(self.0.frames[frame].iter().map(|row| Vec3::new(row[x], row[y], row[z])).collect())
    }

    /// Points with velocities fly on from the first frame; points with times live for a moment; points
    /// of several frames move from one to the next.
    fn cloud(&self) -> Cloud {
        let first = self.columns(0, ["x", "y", "z"]).expect("positions");
        let full = vec![TimeInterval::FULL; first.len()];
        if let Some(t) = self.0.names.iter().position(|n| n == "t") {
            let last = self.0.frames[0].iter().map(|row| row[t]).fold(f32::MIN_POSITIVE, f32::max);
            let interval = |row: &Vec<f32>| {
                let begin = (row[t] / last).clamp(0.0, 0.95);
                TimeInterval::new(begin, begin + 0.05).expect("within the shutter")
            };
            return Cloud { active: self.0.frames[0].iter().map(interval).collect(), keys: vec![first] };
        }
        if self.0.frames.len() > 1 {
            let keys = (0..self.0.frames.len()).filter_map(|f| self.columns(f, ["x", "y", "z"])).collect();
            return Cloud { keys, active: full };
        }
        let velocity = self.columns(0, ["vx", "vy", "vz"]).unwrap_or(vec![Vec3::ZERO; first.len()]);
        let later = first.iter().zip(&velocity).map(|(p, v)| *p + *v * 0.04).collect();
        Cloud { keys: vec![first, later], active: full }
    }
}

fn check(name: &str, cloud: &Cloud) {
    let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
    let set = PointArrays { keys: &keys, active: &cloud.active, ids: &[] };
    for structure in [PointStructure::Automatic, PointStructure::Linear, PointStructure::Kd] {
        let tree = PointTree::build(&set, &PointParams { structure, ..PointParams::default() }).unwrap();
        println!("{name}: {} points\n{}", cloud.len(), tree.statistics());
        let mut rng = Random(17);
        for _ in 0..25 {
            let time = rng.unit();
            let q = cloud.at(rng.below(cloud.len()), time);
            let all = cloud.sorted(q, time);
            assert_eq!(tree.nearest(q, time), all.first().copied(), "{name}, {structure:?}, time {time}");
            for k in [8, 60] {
                assert_eq!(tree.nearest_n(q, time, k), &all[..k.min(all.len())], "{name}, {structure:?}, time {time}");
            }
            let radius = all.get(40).map_or(1.0, |n| n.distance());
            let inside = all.partition_point(|n| n.distance_squared <= radius * radius);
            assert_eq!(tree.query(q, time).radius(radius).collect_sorted(), &all[..inside], "{name}, time {time}");
        }
    }
}

/// A file in the format above.
fn written(names: &[&str], frames: &[Vec<Vec<f32>>]) -> Vec<u8> {
    let mut bytes = b"PSET0001".to_vec();
    for n in [frames[0].len(), frames.len(), names.len()] {
        bytes.extend((n as u32).to_le_bytes());
    }
    for name in names {
        let mut field = [0; 16];
        field[..name.len()].copy_from_slice(name.as_bytes());
        bytes.extend(field);
    }
    for value in frames.iter().flatten().flatten() {
        bytes.extend(value.to_le_bytes());
    }
    bytes
}

#[test]
fn made_up_sets_in_the_same_format() {
    let mut rng = Random(1);
    let mut rows =
        |columns: usize| (0..3000).map(|_| (0..columns).map(|_| rng.unit()).collect()).collect::<Vec<Vec<f32>>>();
    for (names, frames) in [
        (&["x", "y", "z", "vx", "vy", "vz"][..], vec![rows(6)]),
        (&["x", "y", "z", "t"], vec![rows(4)]),
        (&["x", "y", "z"], vec![rows(3), rows(3)]),
    ] {
        let bytes = written(names, &frames);
        check(&names.concat(), &Set(Table::pset(&bytes).unwrap()).cloud());
        assert!(Table::pset(&bytes[..bytes.len() - 1]).is_err() && Table::pset(&bytes[..15]).is_err());
    }
}

#[test]
fn real_sets_where_there_are_any() {
    let Some(data) = std::env::var_os("MBKD_DATA") else {
        println!("MBKD_DATA is not set: nothing to read");
        return;
    };
    let mut read = 0;
    for folder in ["particles", "scans"] {
        let Ok(entries) = Path::new(&data).join(folder).read_dir() else { continue };
        for path in entries.flatten().map(|e| e.path()) {
            let Some(table) = Table::open(&path).unwrap_or_else(|e| panic!("{e}")) else { continue };
            let set = Set(table);
            check(&path.file_name().unwrap().to_string_lossy(), &set.cloud());
            read += 1;
        }
    }
    assert!(read > 0, "MBKD_DATA has no files in particles or scans that can be read");
}

/// Positions and velocities in BGEO (plain and compressed) and VTK are those that were written, and files that
/// end too early are errors.
#[test]
fn particle_files_give_what_was_written() {
    let rows: Vec<[f32; 6]> = (0..5).map(|i| std::array::from_fn(|c| (i * 6 + c) as f32 * 0.5 - 3.0)).collect();
    let be = |values: &[f32]| values.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<u8>>();
    let mut bgeo = b"BgeoV".to_vec();
    bgeo.extend([5u32, 5, 0, 0, 0, 2, 0, 0, 0].iter().flat_map(|n| n.to_be_bytes()));
    bgeo.extend(b"\0\x02id\0\x01\0\0\0\x01\0\0\0\0\0\x08velocity\0\x03\0\0\0\x05");
    bgeo.extend([0; 12]);
    for row in &rows {
        bgeo.extend(be(&[row[0], row[1], row[2], 1.0, 77.0, row[3], row[4], row[5]]));
    }
    let mut packed = Vec::new();
    let mut encoder = flate2::read::GzEncoder::new(&bgeo[..], flate2::Compression::fast());
    std::io::Read::read_to_end(&mut encoder, &mut packed).unwrap();
    let mut vtk =
        b"# vtk DataFile Version 4.1\nparticles\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n".to_vec();
    rows.iter().for_each(|row| vtk.extend(be(&row[..3])));
    vtk.extend(b"\nPOINT_DATA 5\nFIELD FieldData 1\nvelocity 3 5 float\n");
    rows.iter().for_each(|row| vtk.extend(be(&row[3..])));
    for table in [Table::bgeo(&bgeo), Table::bgeo(&packed), Table::vtk(&vtk)] {
        let table = table.unwrap();
        assert_eq!(table.names, ["x", "y", "z", "vx", "vy", "vz"]);
        assert_eq!(table.frames, [rows.iter().map(|r| r.to_vec()).collect::<Vec<_>>()]);
    }
    for end in 0..bgeo.len() {
        assert!(Table::bgeo(&bgeo[..end]).is_err(), "BGEO of {end} bytes");
    }
    // Up to the end of the points it may be a file without fields; beyond, no velocities means a broken file.
    let points = vtk.windows(10).position(|w| w == b"POINT_DATA").unwrap();
    for end in 0..vtk.len() {
        let short = Table::vtk(&vtk[..end]);
        assert!(short.is_err() || (points - 1..=points).contains(&end), "VTK of {end} bytes");
    }
}
