//! Neighbour lists of all points, as compressed sparse rows.

use crate::arrays::{slice, value_error, zeros};
use crate::points::Points;
use crate::threads::on;
use mbkd::{ListError, ListQuery, NeighborLists, Radii};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Mutex;

/// Offsets, ids, the points of the rows, and on request distances and displacements `(m, 3)`.
type Columns<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i32>>,
    Option<Bound<'py, PyArray1<i32>>>,
    Option<Bound<'py, PyArray1<f32>>>,
    Option<Bound<'py, PyArray2<f32>>>,
);

/// The memory of the last lists, reused for the next ones: allocating it anew would take as much time as the lists.
static MEMORY: Mutex<Option<NeighborLists>> = Mutex::new(None);

/// Memory beyond this is released.
const MOST_KEPT: usize = 1 << 29;

/// How far neighbours may be: one radius for all, or one for each point, of two of which the larger or the sum may count. `others`
/// has those of another set.
pub fn radii_of<'a>(own: &'a [f32], others: Option<&'a [f32]>, larger: bool, summed: bool) -> Radii<'a> {
    match (own, others) {
        (own, Some(others)) if larger => Radii::Larger { own, others },
        (own, Some(others)) => Radii::Sum { own, others },
        (&[radius], None) => Radii::Equal(radius),
        (own, None) if larger => Radii::Larger { own, others: own },
        (own, None) if summed => Radii::Sum { own, others: own },
        (own, None) => Radii::Own(own),
    }
}

/// The radii of another set, as a slice. An error for a request among another set that needs its radii and has none.
pub fn radii_of_others<'a>(
    radii: &[f32],
    of_others: Option<&'a PyReadonlyArray1<'_, f32>>,
    among: bool,
    larger: bool,
    summed: bool,
) -> PyResult<Option<&'a [f32]>> {
    if among && of_others.is_none() && (summed || larger && radii.len() > 1) {
        let text = "the larger of two radii and their sum need those of both sets: give `r_among`, or one radius for all pairs";
        return Err(PyValueError::new_err(text));
    }
    of_others.map(slice).transpose()
}

/// The lists of all points at a time. `radii` has one element, or one for each point. In the second case, if `larger`, two points
/// are neighbours if they are within the larger of their radii, if `summed` within the sum; otherwise each point lists the points
/// within its own radius. The points of `among` have the radii `radii_among`, one for each. With `max_neighbors` a longer list is
/// an error.
#[pyfunction]
pub fn neighbor_lists<'py>(
    py: Python<'py>,
    points: &Points,
    time: f32,
    radii: PyReadonlyArray1<'py, f32>,
    larger: bool,
    summed: bool,
    among: Option<&Points>,
    radii_among: Option<PyReadonlyArray1<'py, f32>>,
    pairs_once: bool,
    distances: bool,
    displacements: bool,
    sorted: bool,
    by_id: bool,
    max_neighbors: Option<usize>,
    workers: isize,
) -> PyResult<Columns<'py>> {
    let radii = slice(&radii)?;
    let others = radii_of_others(radii, radii_among.as_ref(), among.is_some(), larger, summed)?;
    let (tree, among) = (points.tree.get(py)?, among.map(|among| among.tree.get(py)).transpose()?);
    let mut query = tree.neighbor_lists(time, radii_of(radii, others, larger, summed));
    query = with_options(query, [pairs_once, distances, displacements, sorted], max_neighbors);
    query = among.as_deref().map_or(query, |among| query.among(among));
    query = points.periods.map_or(query, |lengths| query.periodic(lengths));
    let mut lists = memory();
    on(py, workers, || query.run(&mut lists))?.map_err(list_error)?;
    hand_over(py, lists, by_id.then_some(tree.len()), workers)
}

/// The lists at a time with radii, as for [`neighbor_lists`], that are longer by a skin for each pair; and the time until which
/// they contain every pair within the radii themselves.
#[pyfunction]
pub fn neighbor_lists_with_skin<'py>(
    py: Python<'py>,
    points: &Points,
    time: f32,
    radii: PyReadonlyArray1<'py, f32>,
    larger: bool,
    summed: bool,
    skin: f32,
    until: f32,
    among: Option<&Points>,
    radii_among: Option<PyReadonlyArray1<'py, f32>>,
    pairs_once: bool,
    distances: bool,
    displacements: bool,
    sorted: bool,
    max_neighbors: Option<usize>,
    workers: isize,
) -> PyResult<(Columns<'py>, f32)> {
    let radii = slice(&radii)?;
    let others = radii_of_others(radii, radii_among.as_ref(), among.is_some(), larger, summed)?;
    // Of two radii that are added, each has half of the skin.
    let skin_of_each = if summed && (radii.len() > 1 || others.is_some()) { 0.5 * skin } else { skin };
    let with_skin = |radii: &[f32]| radii.iter().map(|radius| radius + skin_of_each).collect::<Vec<_>>();
    let (listed, others_listed) = (with_skin(radii), others.map(with_skin));
    let (tree, among) = (points.tree.get(py)?, among.map(|among| among.tree.get(py)).transpose()?);
    let mut query = tree.neighbor_lists(time, radii_of(&listed, others_listed.as_deref(), larger, summed));
    query = with_options(query, [pairs_once, distances, displacements, sorted], max_neighbors);
    query = among.as_deref().map_or(query, |among| query.among(among));
    query = points.periods.map_or(query, |lengths| query.periodic(lengths));
    let mut lists = memory();
    let made = on(py, workers, || {
        let valid_until = query.certified_until(radii_of(radii, others, larger, summed), until)?;
        query.run(&mut lists)?;
        Ok(valid_until)
    })?;
    let valid_until = made.map_err(list_error)?;
    Ok((hand_over(py, lists, Some(tree.len()), workers)?, valid_until))
}

/// The request with these options: each pair once, distances, displacements, sorted lists.
fn with_options<'a>(mut query: ListQuery<'a>, options: [bool; 4], max_neighbors: Option<usize>) -> ListQuery<'a> {
    let [pairs_once, distances, displacements, sorted] = options;
    query = if pairs_once { query.pairs_once() } else { query };
    query = if distances { query.with_distances() } else { query };
    query = if displacements { query.with_displacements() } else { query };
    query = if sorted { query.sorted() } else { query };
    max_neighbors.map_or(query, |most| query.max_neighbors(most))
}

/// The error in the words of the arguments here.
pub fn list_error(error: ListError) -> PyErr {
    match error {
        ListError::Origins => PyValueError::new_err(
            "the two trees have float64 positions that were rounded to float32 relative to different places; build both with \
             precision='float64', or from float32 positions",
        ),
        ListError::Double => PyValueError::new_err(
            "one of the two trees keeps positions in float64 and the other in float32; build both with the same precision",
        ),
        ListError::Period { axis } => PyValueError::new_err(format!(
            "boxsize of axis {axis} must be above zero, and neither denormal nor infinite in float32"
        )),
        error => value_error(error),
    }
}

/// The memory of the last lists, unless another thread uses it.
fn memory() -> NeighborLists {
    MEMORY.lock().ok().and_then(|mut kept| kept.take()).unwrap_or_default()
}

/// Copies lists into arrays of their size and keeps their memory. Row i belongs to point i, or the rows are in the order of
/// their computation.
fn hand_over(py: Python<'_>, lists: NeighborLists, points: Option<usize>, workers: isize) -> PyResult<Columns<'_>> {
    let rows: Vec<u32> = py.detach(|| match points {
        None => (0..lists.len() as u32).collect(),
        Some(points) => {
            let mut rows = vec![ABSENT; points];
            (0..).zip(lists.points()).for_each(|(row, &point)| rows[point as usize] = row);
            rows
        }
    });
    let from = lists.offsets();
    let length = |row: u32| if row == ABSENT { 0 } else { from[row as usize + 1] - from[row as usize] };
    let (offsets, end) = py.detach(|| {
        let (mut offsets, mut end) = (Vec::with_capacity(rows.len() + 1), 0);
        offsets.push(0);
        for &row in &rows {
            end += length(row);
            offsets.push(end as i64);
        }
        (offsets, end)
    });
    let order = Order { rows: &rows, from, to: &offsets };
    // Signed, as numpy and scipy count; no tree here has more than 2^31 points.
    let ids = filled(py, workers, &order, end, |at, to: &mut [i32]| {
        to.iter_mut().zip(&lists.ids()[at..]).for_each(|(to, &id)| *to = id as i32);
    })?;
    let (squares, ways) = (lists.distances_squared(), lists.displacements());
    let distances = (!squares.is_empty() || end == 0).then(|| {
        filled(py, workers, &order, squares.len(), |at, to: &mut [f32]| {
            to.iter_mut().zip(&squares[at..]).for_each(|(to, square)| *to = square.sqrt());
        })
    });
    let displacements = (!ways[0].is_empty() || end == 0).then(|| {
        let array: Bound<'_, PyArray2<f32>> = zeros(py, (end, 3))?;
        let mut all = array.try_readwrite().map_err(value_error)?;
        let all = all.as_slice_mut().map_err(value_error)?.as_chunks_mut().0;
        on(py, workers, || {
            order.fill(all, &|at, to: &mut [[f32; 3]]| {
                let there = ways.map(|column| &column[at..at + to.len()]);
                to.iter_mut().enumerate().for_each(|(i, to)| *to = there.map(|column| column[i]));
            });
        })?;
        Ok::<_, PyErr>(array)
    });
    let made_for = points.is_none().then(|| {
        let signed = || lists.points().iter().map(|&point| point as i32).collect::<Vec<_>>();
        py.detach(signed)
    });
    let columns = (
        offsets.into_pyarray(py),
        ids,
        made_for.map(|points| points.into_pyarray(py)),
        distances.transpose()?,
        displacements.transpose()?,
    );
    if lists.bytes() <= MOST_KEPT
        && let Ok(mut kept) = MEMORY.lock()
    {
        *kept = Some(lists);
    }
    Ok(columns)
}

/// An array that `copy` fills row by row.
fn filled<'py, T: Element + Send>(
    py: Python<'py>,
    workers: isize,
    order: &Order<'_>,
    length: usize,
    copy: impl Fn(usize, &mut [T]) + Sync,
) -> PyResult<Bound<'py, PyArray1<T>>> {
    let array: Bound<'_, PyArray1<T>> = zeros(py, (length,))?;
    let mut all = array.try_readwrite().map_err(value_error)?;
    let all = all.as_slice_mut().map_err(value_error)?;
    on(py, workers, || order.fill(all, &copy))?;
    Ok(array)
}

/// The row of a point that does not exist.
const ABSENT: u32 = u32::MAX;

/// The number of rows per task.
const SHARE: usize = 4096;

/// The source of each row.
#[derive(Clone, Copy)]
struct Order<'a> {
    /// By new row.
    rows: &'a [u32],
    from: &'a [usize],
    to: &'a [i64],
}

impl Order<'_> {
    /// Fills the elements of these rows, halves at the same time: `copy(at, to)` copies from there on.
    fn fill<T: Send>(self, to: &mut [T], copy: &(impl Fn(usize, &mut [T]) + Sync)) {
        if self.rows.len() > SHARE {
            let half = self.rows.len() / 2;
            let (left, right) = self.rows.split_at(half);
            let (to_left, to_right) = to.split_at_mut((self.to[half] - self.to[0]) as usize);
            rayon::join(
                || Order { rows: left, to: &self.to[..=half], ..self }.fill(to_left, copy),
                || Order { rows: right, to: &self.to[half..], ..self }.fill(to_right, copy),
            );
            return;
        }
        for (&row, ends) in self.rows.iter().zip(self.to.windows(2)) {
            if row != ABSENT {
                let [begin, end] = [ends[0], ends[1]].map(|end| (end - self.to[0]) as usize);
                copy(self.from[row as usize], &mut to[begin..end]);
            }
        }
    }
}
