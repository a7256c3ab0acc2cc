//! Meshes and spheres of the library from arrays.

use crate::arrays::{Places, Positions, interval_of, intervals, rows, slice};
use mbkd::glam::{DVec3, Vec3};
use mbkd::{Keys, MovingSphere, TimeInterval, TriangleMesh};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A mesh as arrays: positions (V, 3) at its keys, vertex indices (F, 3), active interval, mask, whether redundant keys are kept,
/// and whether float64 positions are.
pub type MeshArrays<'py> = (Vec<Bound<'py, PyAny>>, PyReadonlyArray2<'py, u32>, [f32; 2], u32, bool, bool);

/// Spheres as arrays: centers (n, 3) and radii (n,) at their keys, active intervals (n, 2), or none if all exist throughout, and
/// masks (n,), or none if every mask sees them.
pub type SphereArrays<'py> = (
    Vec<PyReadonlyArray2<'py, f64>>,
    Vec<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray2<'py, f32>>,
    Option<PyReadonlyArray1<'py, u32>>,
);

/// Makes meshes of the library.
pub fn meshes(arrays: &[MeshArrays<'_>]) -> PyResult<Vec<TriangleMesh>> {
    arrays.iter().enumerate().map(mesh).collect()
}

fn mesh((i, (keys, faces, active, mask, keep_keys, precise)): (usize, &MeshArrays<'_>)) -> PyResult<TriangleMesh> {
    let keys = keys.iter().map(Positions::of).collect::<PyResult<Vec<_>>>()?;
    let keys = keys.iter().map(Positions::places).collect::<PyResult<Vec<_>>>()?;
    let keys: Keys = match keys.first() {
        Some(Places::Double(_)) => {
            let wide = |key: &Places<'_>| (0..key.len()).map(|i| DVec3::from(key.wide(i))).collect();
            keys.iter().map(wide).collect::<Vec<Vec<DVec3>>>().into()
        }
        _ => {
            let single = |key: &Places<'_>| match key {
                Places::Single(rows) => Ok(rows.iter().map(|&p| Vec3::from(p)).collect()),
                Places::Double(_) => Err(PyValueError::new_err("all keys must have one precision")),
            };
            keys.iter().map(single).collect::<PyResult<Vec<Vec<Vec3>>>>()?.into()
        }
    };
    let active = interval_of(*active, "mesh", i)?;
    let mesh = TriangleMesh::new(rows(faces)?.to_vec(), keys).with_active(active).with_mask(*mask);
    let mesh = if *keep_keys { mesh.keep_keys() } else { mesh };
    Ok(if *precise { mesh.precise() } else { mesh })
}

/// Makes spheres of the library.
pub fn spheres((centers, radii, active, masks): &SphereArrays<'_>) -> PyResult<Vec<MovingSphere>> {
    let centers = centers.iter().map(rows).collect::<PyResult<Vec<_>>>()?;
    let radii = radii.iter().map(slice).collect::<PyResult<Vec<_>>>()?;
    let count = centers.first().map_or(0, |key| key.len());
    let active = active.as_ref().map(|active| intervals(slice(active)?.as_chunks().0, "sphere")).transpose()?;
    let masks = masks.as_ref().map(slice).transpose()?;
    let lengths = centers.iter().map(|key| key.len()).chain(radii.iter().map(|key| key.len()));
    let mut lengths = lengths.chain(active.iter().map(Vec::len)).chain(masks.iter().map(|masks| masks.len()));
    if centers.len() != radii.len() || lengths.any(|length| length != count) {
        let text = "spheres have centers, radii, active intervals and masks of different numbers";
        return Err(PyValueError::new_err(text));
    }
    let sphere = |i: usize| {
        let keys = centers.iter().zip(&radii).map(|(centers, radii)| (DVec3::from(centers[i]), radii[i])).collect();
        let active = active.as_ref().map_or(TimeInterval::FULL, |active| active[i]);
        let mask = masks.map_or(u32::MAX, |masks| masks[i]);
        MovingSphere::new(keys).with_active(active).with_mask(mask)
    };
    Ok((0..count).map(sphere).collect())
}
