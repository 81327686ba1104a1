//! [`Vector`] for a machine's vector of f32, most of it from one intrinsic each.

#[cfg(target_arch = "x86_64")]
use crate::vector::Vector;

/// Implements [`Vector`] for a vector of f32: the operations that are one intrinsic by its name, then the others.
///
/// SAFETY of the expansion: an intrinsic needs the instructions named in `features`, and a value of the type exists
/// only below [`dispatch`](crate::dispatch), which has checked for them. Pointers: as the trait's methods ask of their
/// callers.
macro_rules! f32_vector {
    (
        $vector:ty, lanes: $lanes:literal, mask: $mask:ty, features: $features:literal,
        of: $of:ident, load: $load:ident, store: $store:ident,
        unary: { $($unary:ident = $unary_op:expr),* $(,)? },
        binary: { $($binary:ident = $binary_op:expr),* $(,)? },
        compare: { $($compare:ident = $compare_op:expr),* $(,)? },
        others: { $($others:tt)* }
    ) => {
        impl Vector for $vector {
            type Scalar = f32;
            type Mask = $mask;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn of(value: f32) -> Self {
                // SAFETY: only code below `dispatch` comes here, which has checked for the instructions.
                unsafe { $of(value) }
            }
            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
                unsafe { $load(from) }
            }
            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
                unsafe { $store(to, self) }
            }
            $(
                #[inline(always)]
                fn $unary(self) -> Self {
                    // SAFETY: a value of this type exists only where the machine has the instructions.
                    unsafe { $unary_op(self) }
                }
            )*
            $(
                #[inline(always)]
                fn $binary(self, b: Self) -> Self {
                    // SAFETY: a value of this type exists only where the machine has the instructions.
                    unsafe { $binary_op(self, b) }
                }
            )*
            $(
                #[inline(always)]
                fn $compare(self, b: Self) -> $mask {
                    // SAFETY: a value of this type exists only where the machine has the instructions.
                    unsafe { $compare_op(self, b) }
                }
            )*
            #[inline(always)]
            fn exp(self) -> Self {
                crate::polynomial::exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                crate::polynomial::ln(self)
            }
            #[inline(always)]
            fn recip(self) -> Self {
                Self::of(1.0).div(self)
            }
            #[inline(always)]
            fn outlined<C: $crate::Call>(call: C) -> C::Output {
                #[inline(never)]
                #[target_feature(enable = $features)]
                fn outlined<C: $crate::Call>(call: C) -> C::Output {
                    call.run()
                }
                // SAFETY: only code below `dispatch` comes here, which has checked for the instructions.
                unsafe { outlined(call) }
            }
            $($others)*
        }
    };
}
pub(crate) use f32_vector;

/// `1 / sqrt(x)` from an estimate y of it, by one Newton step: `y (3/2 - x y^2 / 2)`.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn refined_rsqrt<V: Vector<Scalar = f32>>(x: V, estimate: V) -> V {
    let half = x.mul(V::of(-0.5)).mul(estimate);
    estimate.mul(half.mul_add(estimate, V::of(1.5)))
}
