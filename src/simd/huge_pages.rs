//! Large vectors on huge pages.

use super::fill::fill;

/// A vector with capacity for `capacity` items, on huge pages if the system grants them: large arrays that are filled
/// once then cost a page fault per 2 MiB instead of one per 4 KiB.
pub(crate) fn huge_vec<T>(capacity: usize) -> Vec<T> {
    let mut items = Vec::with_capacity(capacity);
    advise_huge_pages(&mut items);
    items
}

/// `count` copies of an item, on huge pages if the system grants them.
pub(crate) fn huge_vec_of<T: Clone>(item: T, count: usize) -> Vec<T> {
    let mut items = huge_vec(count);
    items.resize(count, item);
    items
}

/// Requests huge pages for the untouched memory of a vector; a hint.
#[cfg(target_os = "linux")]
fn advise_huge_pages<T>(items: &mut Vec<T>) {
    const PAGE: usize = 4096;
    const HUGE_PAGE: usize = 2 << 20;
    const MADV_HUGEPAGE: i32 = 14;
    unsafe extern "C" {
        fn madvise(address: *mut core::ffi::c_void, length: usize, advice: i32) -> i32;
    }
    let bytes = items.capacity() * size_of::<T>();
    if bytes < HUGE_PAGE {
        return;
    }
    let begin = items.as_mut_ptr().cast::<u8>();
    let skip = begin.align_offset(PAGE);
    // SAFETY: the range lies within the vector's own allocation, begins on a page, and `MADV_HUGEPAGE` changes
    // only how it is mapped, never what it holds; a refusal is harmless and ignored.
    unsafe { madvise(begin.wrapping_add(skip).cast(), bytes - skip, MADV_HUGEPAGE) };
}

/// On other systems there is no such request.
#[cfg(not(target_os = "linux"))]
fn advise_huge_pages<T>(_: &mut Vec<T>) {}

/// Concatenates vectors.
pub(crate) fn concat<T: Copy + Send + Sync>(parts: &[Vec<T>]) -> Vec<T> {
    let mut total = 0;
    let ends: Vec<usize> = parts.iter().map(|part| (total += part.len(), total).1).collect();
    let mut all = huge_vec(total);
    fill(&mut all, total, |i| {
        let part = ends.partition_point(|&end| end <= i);
        let begin = if part > 0 { ends[part - 1] } else { 0 };
        parts[part][i - begin]
    });
    all
}
