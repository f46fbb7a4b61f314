//! The two precisions of the processor's arithmetic: `f32` for work, `f64` so that gradients can be held against finite differences.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A floating-point number, `f32` or `f64`.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The nearest number of this precision.
    fn of(value: f64) -> Self;

    /// The same number in double precision.
    fn to_f64(self) -> f64;

    /// eˣ.
    fn exp(self) -> Self;

    /// ln x.
    fn ln(self) -> Self;

    /// |x|.
    fn abs(self) -> Self;

    /// √x.
    fn sqrt(self) -> Self;

    /// (sin x, cos x).
    fn sin_cos(self) -> (Self, Self);

    /// `out = a·b + keep·out` of an `m × k` and a `k × n` matrix, sizes m, k, n; strides are of rows and columns, values.
    ///
    /// # Safety
    /// All elements that sizes and strides reach must lie in memory that is valid for reading (and, of `out`, for writing by nobody else).
    unsafe fn gemm(
        sizes: [usize; 3],
        a: (*const Self, [isize; 2]),
        b: (*const Self, [isize; 2]),
        keep: Self,
        out: (*mut Self, [isize; 2]),
    );
}

macro_rules! real {
    ($type:ty, $gemm:path) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            fn of(value: f64) -> Self {
                value as Self
            }

            fn to_f64(self) -> f64 {
                f64::from(self)
            }

            fn exp(self) -> Self {
                self.exp()
            }

            fn ln(self) -> Self {
                self.ln()
            }

            fn abs(self) -> Self {
                self.abs()
            }

            fn sqrt(self) -> Self {
                self.sqrt()
            }

            fn sin_cos(self) -> (Self, Self) {
                self.sin_cos()
            }

            unsafe fn gemm(
                [m, k, n]: [usize; 3],
                a: (*const Self, [isize; 2]),
                b: (*const Self, [isize; 2]),
                keep: Self,
                out: (*mut Self, [isize; 2]),
            ) {
                let ((a, [ar, ac]), (b, [br, bc]), (out, [or, oc])) = (a, b, out);
                // SAFETY: the caller's promise is what the crate asks for.
                unsafe { $gemm(m, k, n, 1.0, a, ar, ac, b, br, bc, keep, out, or, oc) }
            }
        }
    };
}

real!(f32, matrixmultiply::sgemm);
real!(f64, matrixmultiply::dgemm);
