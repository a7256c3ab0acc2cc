//! The same neighbour lists by other methods, on one thread: kiddo and a plain grid of cells. All times include the
//! build, and all methods write the same contiguous rows.

use kiddo::SquaredEuclidean;
use mbkd::glam::{IVec3, Vec3};
use mbkd::{NeighborLists, PointParams, PointTree};
use std::time::{Duration, Instant};

/// Times of one comparison.
#[derive(Clone, Copy)]
pub struct Look {
    pub ours: Duration,
    pub kiddo: Duration,
    pub grid: Duration,
}

/// Makes the lists with each of the three methods; an error if they differ in length.
pub fn look(at: &[Vec3], radius: f32, lists: &mut NeighborLists) -> Result<Look, String> {
    let begin = Instant::now();
    let tree = PointTree::build(at, &PointParams::default()).map_err(|e| e.to_string())?;
    tree.neighbor_lists(0.0, radius).run(lists).map_err(|e| e.to_string())?;
    let ours = begin.elapsed();
    let (mut offsets, mut ids) = (Vec::with_capacity(at.len() + 1), Vec::with_capacity(lists.neighbors()));

    let begin = Instant::now();
    let points: Vec<[f32; 3]> = at.iter().map(|p| p.to_array()).collect();
    let tree = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&points).map_err(|e| format!("{e:?}"))?;
    for (i, p) in points.iter().enumerate() {
        offsets.push(ids.len());
        let found = tree.query(p).within::<SquaredEuclidean<f32>>(radius * radius).unsorted().execute();
        ids.extend(found.iter().map(|n| n.item).filter(|&id| id as usize != i));
    }
    let kiddo = begin.elapsed();
    let by_kiddo = ids.len();

    offsets.clear();
    ids.clear();
    let begin = Instant::now();
    cells(at, radius, &mut offsets, &mut ids);
    let grid = begin.elapsed();
    let counts = [lists.neighbors(), by_kiddo, ids.len()];
    // Rounding may add or drop a pair at exactly the radius.
    if counts.iter().any(|&count| count.abs_diff(counts[0]) > counts[0] / 10_000) {
        return Err(format!("neighbours differ: {counts:?} by mbkd, kiddo and the grid"));
    }
    Ok(Look { ours, kiddo, grid })
}

/// A grid whose cells are as wide as the radius, sorted by counting: each particle searches 27 cells.
fn cells(at: &[Vec3], radius: f32, offsets: &mut Vec<usize>, ids: &mut Vec<u32>) {
    let low = at.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
    let high = at.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
    let cell = |p: Vec3| ((p - low) / radius).as_ivec3();
    let size = cell(high) + 1;
    let number = |c: IVec3| ((c.z * size.y + c.y) * size.x + c.x) as usize;
    let mut begins = vec![0u32; (size.x * size.y * size.z) as usize + 1];
    at.iter().for_each(|p| begins[number(cell(*p)) + 1] += 1);
    (1..begins.len()).for_each(|i| begins[i] += begins[i - 1]);
    let (mut next, mut sorted) = (begins.clone(), vec![(Vec3::ZERO, 0); at.len()]);
    for (id, p) in at.iter().enumerate() {
        let place = &mut next[number(cell(*p))];
        sorted[*place as usize] = (*p, id as u32);
        *place += 1;
    }
    for (id, p) in at.iter().enumerate() {
        offsets.push(ids.len());
        let middle = cell(*p);
        let (first, last) = ((middle - 1).max(IVec3::ZERO), (middle + 1).min(size - 1));
        for z in first.z..=last.z {
            for y in first.y..=last.y {
                // Cells of a row are contiguous.
                let row = [first.x, last.x].map(|x| number(IVec3::new(x, y, z)));
                for (q, other) in &sorted[begins[row[0]] as usize..begins[row[1] + 1] as usize] {
                    if (*q - *p).length_squared() <= radius * radius && *other != id as u32 {
                        ids.push(*other);
                    }
                }
            }
        }
    }
}
