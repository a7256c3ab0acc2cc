//! Which points of a set are static.

use super::source::Source;

/// The static points of a set, and the others.
pub(in crate::point) struct Partition {
    len: usize,
    /// Whether each point is static; empty if all are known to be.
    is_static: Vec<bool>,
    pub(in crate::point) static_count: usize,
}

impl Partition {
    pub(in crate::point) fn of(source: &Source) -> Partition {
        let len = source.len;
        if source.all_static() {
            return Partition { len, is_static: Vec::new(), static_count: len };
        }
        let is_static = source.static_points();
        let static_count = is_static.iter().filter(|&&is_static| is_static).count();
        Partition { len, is_static, static_count }
    }

    fn is_static(&self, point: usize) -> bool {
        self.is_static.get(point).is_none_or(|&is_static| is_static)
    }

    /// The static points, ascending.
    pub(in crate::point) fn static_points(&self) -> impl Iterator<Item = usize> {
        (0..self.len).filter(|&point| self.is_static(point))
    }

    /// Why the static points have a layer of their own.
    pub(in crate::point) fn why(&self) -> String {
        format!("{} of {} points are static", self.static_count, self.len)
    }

    /// All other points, ascending.
    pub(in crate::point) fn moving_points(&self) -> Vec<u32> {
        (0..self.len as u32).filter(|&point| !self.is_static(point as usize)).collect()
    }
}
