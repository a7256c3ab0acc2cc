//! Numbers in buffers, with every bound checked: strides, sparse replacements, normalized integers.

use super::super::FormatError;
use gltf::Accessor;
use gltf::accessor::DataType;
use gltf::buffer::View;
use std::cell::Cell;

/// Reads accessors, with a limit on the total, so that a small file cannot request all memory.
pub struct Data {
    /// The bytes of each buffer.
    pub buffers: Vec<Vec<u8>>,
    /// Numbers that may still be read.
    left: Cell<usize>,
}

/// The greatest total number of numbers in all accessors of a file.
const MOST_NUMBERS: usize = 1 << 28;

impl Data {
    /// A reader of these buffers.
    pub fn new(buffers: Vec<Vec<u8>>) -> Data {
        Data { buffers, left: Cell::new(MOST_NUMBERS) }
    }

    /// The elements of an accessor as rows of `N` floats; normalized integers become fractions.
    pub fn floats<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[f32; N]>, FormatError> {
        let normalized = accessor.normalized();
        let kind = accessor.data_type();
        if kind != DataType::F32 && !normalized {
            return Err(wrong(accessor, "should hold floats or normalized integers"));
        }
        let number = move |bytes: &[u8]| match kind {
            DataType::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            DataType::I8 => (f32::from(bytes[0] as i8) / 127.0).max(-1.0),
            DataType::U8 => f32::from(bytes[0]) / 255.0,
            DataType::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])) / 32767.0).max(-1.0),
            DataType::U16 => f32::from(u16::from_le_bytes([bytes[0], bytes[1]])) / 65535.0,
            DataType::U32 => (f64::from(unsigned(kind, bytes)) / f64::from(u32::MAX)) as f32,
        };
        self.rows(accessor, 0.0, number)
    }

    /// The elements of an accessor as rows of `N` whole numbers.
    pub fn integers<const N: usize>(&self, accessor: &Accessor) -> Result<Vec<[u32; N]>, FormatError> {
        let kind = accessor.data_type();
        if !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) {
            return Err(wrong(accessor, "should hold unsigned integers"));
        }
        self.rows(accessor, 0, move |bytes: &[u8]| unsigned(kind, bytes))
    }

    /// Rows of N components, 0 where there is no view, then the sparse replacements.
    fn rows<T: Copy, const N: usize>(
        &self,
        accessor: &Accessor,
        zero: T,
        number: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<[T; N]>, FormatError> {
        let components = accessor.dimensions().multiplicity();
        if components != N {
            return Err(wrong(accessor, &format!("has {components} components where {N} are needed")));
        }
        let (count, size) = (accessor.count(), accessor.data_type().size());
        let left = self.left.get().checked_sub(count.saturating_mul(N));
        self.left.set(left.ok_or_else(|| wrong(accessor, "the file asks for too much memory"))?);
        let row = |bytes: &[u8]| -> [T; N] { std::array::from_fn(|i| number(&bytes[i * size..(i + 1) * size])) };

        let mut rows = match accessor.view() {
            Some(view) => {
                let elements = self.elements(&view, accessor.offset(), count, size * N);
                elements.map_err(|what| wrong(accessor, &what))?.map(row).collect()
            }
            None => vec![[zero; N]; count],
        };
        if let Some(sparse) = accessor.sparse() {
            let fail = |what: String| wrong(accessor, &format!("sparse: {what}"));
            let (indices, values) = (sparse.indices(), sparse.values());
            let kind = match indices.index_type() {
                gltf::accessor::sparse::IndexType::U8 => DataType::U8,
                gltf::accessor::sparse::IndexType::U16 => DataType::U16,
                gltf::accessor::sparse::IndexType::U32 => DataType::U32,
            };
            let at = self.elements(&indices.view(), indices.offset(), sparse.count(), kind.size()).map_err(fail)?;
            let new = self.elements(&values.view(), values.offset(), sparse.count(), size * N).map_err(fail)?;
            for (at, new) in at.zip(new) {
                let at = unsigned(kind, at) as usize;
                let what = || fail(format!("replaces element {at} of {count}"));
                *rows.get_mut(at).ok_or_else(what)? = row(new);
            }
        }
        Ok(rows)
    }

    /// The bytes of `count` elements of `size` bytes each.
    fn elements(
        &self,
        view: &View,
        offset: usize,
        count: usize,
        size: usize,
    ) -> Result<impl Iterator<Item = &[u8]> + use<'_>, String> {
        let bytes = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            return Err(format!("elements of {size} bytes lie {stride} apart"));
        }
        let end = match count.checked_sub(1) {
            None => Some(offset),
            Some(steps) => {
                steps.checked_mul(stride).and_then(|x| x.checked_add(size)).and_then(|x| x.checked_add(offset))
            }
        };
        match end.filter(|&end| end <= bytes.len()) {
            Some(_) => Ok((0..count).map(move |i| &bytes[offset + i * stride..][..size])),
            None => Err(format!("needs more bytes than the {} of buffer view {}", bytes.len(), view.index())),
        }
    }

    /// The bytes of a view.
    pub fn view(&self, view: &View) -> Result<&[u8], String> {
        let buffer = self.buffers.get(view.buffer().index()).ok_or("names a buffer that is not there")?;
        let end = view.offset().checked_add(view.length());
        end.and_then(|end| buffer.get(view.offset()..end))
            .ok_or_else(|| format!("buffer view {} reaches beyond its buffer of {} bytes", view.index(), buffer.len()))
    }
}

fn unsigned(kind: DataType, bytes: &[u8]) -> u32 {
    match kind.size() {
        1 => bytes[0].into(),
        2 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
        _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
    }
}

fn wrong(accessor: &Accessor, what: &str) -> FormatError {
    FormatError::new(format!("accessor {}", accessor.index()), what)
}
