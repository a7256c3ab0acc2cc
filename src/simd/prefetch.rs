//! Prefetching.

/// Prefetches the cache lines of an item that will be read soon; a hint without any other effect.
#[inline(always)]
pub(crate) fn prefetch<T: ?Sized>(item: &T) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..size_of_val(item).div_ceil(64) {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let at = core::ptr::from_ref(item).cast::<i8>().wrapping_add(64 * line);
        // SAFETY: every x86-64 CPU has the instruction; it reads nothing that a program could see and
        // ignores addresses that are not mapped.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at) };
    }
    #[cfg(target_arch = "aarch64")]
    for line in 0..size_of_val(item).div_ceil(64) {
        let at = core::ptr::from_ref(item).cast::<u8>().wrapping_add(64 * line);
        // SAFETY: the instruction is a hint: it changes no register or memory and ignores addresses that are not mapped.
        unsafe { core::arch::asm!("prfm pldl1keep, [{0}]", in(reg) at, options(nostack, preserves_flags, readonly)) };
    }
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    let _ = item;
}
