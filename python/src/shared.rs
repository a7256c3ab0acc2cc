//! A tree that the queries of several threads share, and that a refit or rebuild replaces.

use crate::arrays::value_error;
use crate::threads::pool;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, TryLockError};

/// A tree that may be replaced while others still query it.
///
/// A query takes the tree as it is when it begins, and keeps it to its end. The lock is held only for that, and while the tree is
/// replaced: never by a thread that waits for the GIL.
pub struct Shared<T>(Mutex<Arc<T>>);

impl<T: Send + Sync> Shared<T> {
    pub fn new(tree: T) -> Shared<T> {
        Shared(Mutex::new(Arc::new(tree)))
    }

    /// The tree as it is now, which does not change while it is held. Waits for a change that is going on, so threads of a pool,
    /// for which that may wait, must not call this.
    pub fn get(&self, py: Python<'_>) -> PyResult<Arc<T>> {
        match self.0.try_lock() {
            Ok(tree) => Ok(tree.clone()),
            Err(TryLockError::Poisoned(error)) => Err(value_error(error)),
            Err(TryLockError::WouldBlock) => py.detach(|| Ok(self.0.lock().map_err(value_error)?.clone())),
        }
    }

    /// Another owner of the same tree. The first of the two that changes it copies it.
    pub fn copy(&self, py: Python<'_>) -> PyResult<Shared<T>> {
        Ok(Shared(Mutex::new(self.get(py)?)))
    }

    /// Changes the tree in a pool, without the GIL. `change` must replace it, or leave it to [`Arc::make_mut`] to copy it where
    /// others hold it.
    pub fn change<R: Send>(
        &self,
        py: Python<'_>,
        workers: isize,
        change: impl FnOnce(&mut Arc<T>) -> R + Send,
    ) -> PyResult<R> {
        let pool = pool(workers)?;
        py.detach(|| {
            let mut locked = self.0.lock().map_err(value_error)?;
            let tree = &mut *locked;
            Ok(pool.install(|| change(tree)))
        })
    }
}
