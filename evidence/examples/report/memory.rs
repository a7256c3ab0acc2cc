//! Bytes that a structure holds, counted at the allocator.

use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// What `build` makes, and the bytes that it holds. One at a time: what other threads allocate meanwhile counts too.
pub fn weigh<T>(build: impl FnOnce() -> T) -> (T, usize) {
    let before = MEMORY.current_usage();
    let built = build();
    (built, MEMORY.current_usage().saturating_sub(before))
}
