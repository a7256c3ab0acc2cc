//! Detecting the instruction sets of the CPU, and running a kernel on one of them.

#[cfg(target_arch = "x86_64")]
use super::avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512;
use super::instructions::Kernel;
#[cfg(target_arch = "aarch64")]
use super::neon as baseline;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
use super::portable as baseline;
#[cfg(target_arch = "x86_64")]
use super::sse2 as baseline;

/// An instruction set of this CPU, for choosing the code path of queries.
///
/// Values exist only for instruction sets that the CPU has. Answers do not depend on the choice; it is there for tests
/// and measurements.
///
/// ```
/// use mbkd::SimdLevel;
/// let best = SimdLevel::best();
/// assert!(SimdLevel::available().contains(&best));
/// println!("queries run on {best}");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub struct SimdLevel(Isa);

#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
enum Isa {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// The narrowest instruction set that is compiled.
#[cfg(target_arch = "x86_64")]
const BASELINE: Isa = if avx512::EVERYWHERE {
    Isa::Avx512
} else if avx2::EVERYWHERE {
    Isa::Avx2
} else {
    Isa::Baseline
};
#[cfg(not(target_arch = "x86_64"))]
const BASELINE: Isa = Isa::Baseline;

impl SimdLevel {
    /// The narrowest level that is compiled: SSE2 on x86-64, NEON on AArch64, plain code elsewhere. Where the crate is compiled for
    /// CPUs with AVX2 or AVX-512 (`-C target-cpu`), it is that, and nothing narrower is compiled.
    pub const BASELINE: SimdLevel = SimdLevel(BASELINE);

    /// All levels of this CPU, narrowest first; the first is always [`SimdLevel::BASELINE`].
    pub fn available() -> Vec<SimdLevel> {
        #[allow(unused_mut)]
        let mut levels = vec![SimdLevel::BASELINE];
        #[cfg(target_arch = "x86_64")]
        {
            if avx2::detected() && !avx2::EVERYWHERE {
                levels.push(SimdLevel(Isa::Avx2));
            }
            if avx512::detected() && !avx512::EVERYWHERE {
                levels.push(SimdLevel(Isa::Avx512));
            }
        }
        levels
    }

    /// The widest level of this CPU.
    pub fn best() -> SimdLevel {
        #[cfg(target_arch = "x86_64")]
        {
            if avx512::detected() {
                return SimdLevel(Isa::Avx512);
            }
            if avx2::detected() {
                return SimdLevel(Isa::Avx2);
            }
        }
        SimdLevel::BASELINE
    }

    /// `"sse2"`, `"avx2"` or `"avx512"` on x86-64, `"neon"` on AArch64, `"portable"` on other architectures.
    pub fn name(self) -> &'static str {
        match self.0 {
            Isa::Baseline if cfg!(target_arch = "x86_64") => "sse2",
            Isa::Baseline if cfg!(target_arch = "aarch64") => "neon",
            Isa::Baseline => "portable",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => "avx512",
        }
    }
}

impl Default for SimdLevel {
    fn default() -> Self {
        SimdLevel::best()
    }
}

impl core::fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

/// Runs a kernel compiled for `level`. What is narrower than [`SimdLevel::BASELINE`] is never reached, and so not compiled.
#[inline(always)]
pub(crate) fn dispatch<K: Kernel>(level: SimdLevel, kernel: K) -> K::Output {
    above_baseline(level, kernel, baseline::run)
}

/// Runs a kernel that is not compiled for SSE2, where `otherwise` answers by other code: few CPUs have nothing better,
/// and code compiled for it is larger than for any other level.
#[inline(always)]
pub(crate) fn dispatch_or<K: Kernel>(level: SimdLevel, kernel: K, otherwise: impl FnOnce(K) -> K::Output) -> K::Output {
    // Not a test of the level before `dispatch`, which would name the kernel for SSE2, and what is named is compiled.
    #[cfg(target_arch = "x86_64")]
    return above_baseline(level, kernel, otherwise);
    #[cfg(not(target_arch = "x86_64"))]
    {
        let _ = otherwise;
        dispatch(level, kernel)
    }
}

/// Runs a kernel compiled for `level`, if that is AVX2 or AVX-512.
#[inline(always)]
fn above_baseline<K: Kernel>(level: SimdLevel, kernel: K, otherwise: impl FnOnce(K) -> K::Output) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if avx512::EVERYWHERE || level.0 == Isa::Avx512 {
            // SAFETY: a `SimdLevel` of AVX-512 is only made after detection found it on this CPU, unless all code needs it.
            return unsafe { avx512::run(kernel) };
        }
        if avx2::EVERYWHERE || level.0 == Isa::Avx2 {
            // SAFETY: a `SimdLevel` of AVX2 is only made after detection found it on this CPU, unless all code needs it.
            return unsafe { avx2::run(kernel) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = level;
    otherwise(kernel)
}
