//! Real particles and lidar points, where `MBKD_DATA` names a directory that has them; without it the
//! same checks run on a small made-up set in the same format.
//!
//! Format: "PSET0001", u32 points, u32 frames, u32 columns, 16 bytes of name per column, f32 rows.

mod neighbor_support;

use mbkd::glam::Vec3;
use mbkd::{PointArrays, PointParams, PointStructure, PointTree, TimeInterval};
use neighbor_support::{Cloud, Rng};
use std::path::Path;

struct Set {
    names: Vec<String>,
    frames: Vec<Vec<Vec<f32>>>,
}

impl Set {
    /// Reads a file; an error names what is wrong with it.
    fn read(bytes: &[u8]) -> Result<Set, String> {
        let u32_at = |at: usize| {
            let four = bytes.get(at..at + 4).ok_or(format!("file ends at byte {}", bytes.len()))?;
            Ok::<usize, String>(u32::from_le_bytes(four.try_into().expect("four bytes")) as usize)
        };
        if bytes.get(..8) != Some(b"PSET0001".as_slice()) {
            return Err("not a point set".into());
        }
        let (points, frames, columns) = (u32_at(8)?, u32_at(12)?, u32_at(16)?);
        let begin = 20 + 16 * columns;
        let values = points.checked_mul(frames).and_then(|n| n.checked_mul(columns)).ok_or("too large")?;
        if bytes.len() != begin + 4 * values {
            return Err(format!("{} bytes where {} belong", bytes.len(), begin + 4 * values));
        }
        let name = |c: usize| {
            let name = &bytes[20 + 16 * c..36 + 16 * c];
            String::from_utf8_lossy(name).trim_end_matches('\0').to_string()
        };
        let mut values = bytes[begin..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().expect("four bytes")));
        let mut row = || (0..columns).map(|_| values.next().expect("counted")).collect::<Vec<f32>>();
        let frames = (0..frames).map(|_| (0..points).map(|_| row()).collect()).collect();
        Ok(Set { names: (0..columns).map(name).collect(), frames })
    }

    fn columns(&self, frame: usize, names: [&str; 3]) -> Option<Vec<Vec3>> {
        let at: Vec<usize> = names.iter().filter_map(|n| self.names.iter().position(|m| m == n)).collect();
        let [x, y, z] = at[..] else { return None };
        Some(self.frames[frame].iter().map(|row| Vec3::new(row[x], row[y], row[z])).collect())
    }

    /// Points with velocities fly on from the first frame; points with times live for a moment; points
    /// of several frames move from one to the next.
    fn cloud(&self) -> Cloud {
        let first = self.columns(0, ["x", "y", "z"]).expect("positions");
        let full = vec![TimeInterval::FULL; first.len()];
        if let Some(t) = self.names.iter().position(|n| n == "t") {
            let last = self.frames[0].iter().map(|row| row[t]).fold(f32::MIN_POSITIVE, f32::max);
            let life = |row: &Vec<f32>| {
                let begin = (row[t] / last).clamp(0.0, 0.95);
                TimeInterval::new(begin, begin + 0.05).expect("within the shutter")
            };
            return Cloud { alive: self.frames[0].iter().map(life).collect(), keys: vec![first] };
        }
        if self.frames.len() > 1 {
            let keys = (0..self.frames.len()).filter_map(|f| self.columns(f, ["x", "y", "z"])).collect();
            return Cloud { keys, alive: full };
        }
        let velocity = self.columns(0, ["vx", "vy", "vz"]).unwrap_or(vec![Vec3::ZERO; first.len()]);
        let later = first.iter().zip(&velocity).map(|(p, v)| *p + *v * 0.04).collect();
        Cloud { keys: vec![first, later], alive: full }
    }
}

fn check(name: &str, cloud: &Cloud) {
    let keys: Vec<&[Vec3]> = cloud.keys.iter().map(Vec::as_slice).collect();
    let set = PointArrays { keys: &keys, alive: &cloud.alive, ids: &[] };
    for structure in [PointStructure::Automatic, PointStructure::Linear, PointStructure::Mbkd] {
        let tree = PointTree::build(&set, &PointParams { structure, ..PointParams::default() }).unwrap();
        println!("{name}: {} points\n{}", cloud.len(), tree.stats());
        let mut rng = Rng(17);
        for _ in 0..25 {
            let time = rng.unit();
            let q = cloud.at(rng.bits() as usize % cloud.len(), time);
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
    let mut rng = Rng(1);
    let mut rows =
        |columns: usize| (0..3000).map(|_| (0..columns).map(|_| rng.unit()).collect()).collect::<Vec<Vec<f32>>>();
    for (names, frames) in [
        (&["x", "y", "z", "vx", "vy", "vz"][..], vec![rows(6)]),
        (&["x", "y", "z", "t"], vec![rows(4)]),
        (&["x", "y", "z"], vec![rows(3), rows(3)]),
    ] {
        let bytes = written(names, &frames);
        check(&names.concat(), &Set::read(&bytes).unwrap().cloud());
        assert!(Set::read(&bytes[..bytes.len() - 1]).is_err() && Set::read(&bytes[..15]).is_err());
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
        for path in entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "pset")) {
            let set = Set::read(&std::fs::read(&path).unwrap()).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            check(&path.file_name().unwrap().to_string_lossy(), &set.cloud());
            read += 1;
        }
    }
    assert!(read > 0, "MBKD_DATA has no particles/*.pset or scans/*.pset");
}
