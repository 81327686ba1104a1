//! Asking for memory ahead of its use.

/// Bytes of a cache line.
const CACHE_LINE_BYTES: usize = 64;

/// Asks for a value to be brought into the first-level cache, where the machine can be asked; nothing else changes.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = core::ptr::from_ref(value).cast::<i8>();
        for offset in (0..size_of::<T>()).step_by(CACHE_LINE_BYTES) {
            // SAFETY: a prefetch reads nothing that the program can see, and the addresses lie within the value.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.add(offset)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (value, CACHE_LINE_BYTES);
}
