//! How the processor rounds. Other libraries in the process may make it drop numbers below the normal range on their
//! threads, and threads inherit that; gic's results are to be the same everywhere.

/// Sets rounding to nearest and keeps small numbers, on this thread and those that it starts.
pub(crate) fn set_usual() {
    #[cfg(target_arch = "x86_64")]
    {
        /// All exceptions masked, round to nearest, neither flush-to-zero nor denormals-are-zero.
        const USUAL: u32 = 0x1f80;
        // SAFETY: the register is loaded with its value at the start of a program.
        unsafe { core::arch::asm!("ldmxcsr [{}]", in(reg) &USUAL, options(nostack, readonly)) };
    }
    #[cfg(target_arch = "aarch64")]
    // SAFETY: as above; all bits clear are its value at the start of a program.
    unsafe {
        core::arch::asm!("msr fpcr, {}", in(reg) 0u64, options(nostack, nomem));
    }
}
