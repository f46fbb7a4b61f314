//! Products of matrices that lie in parts of arrays, by one thread.

use super::Real;

/// Part of an array seen as a matrix.
#[derive(Clone, Copy)]
pub struct Matrix<'a, T = f32> {
    /// The array, from the first number of the matrix on.
    pub values: &'a [T],
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Distance of one row from the next.
    pub row_stride: usize,
    /// Distance of one column from the next.
    pub column_stride: usize,
}

impl<'a, T> Matrix<'a, T> {
    /// Rows one behind the other, `stride` apart.
    pub fn by_rows(values: &'a [T], rows: usize, columns: usize, stride: usize) -> Self {
        Self { values, rows, columns, row_stride: stride, column_stride: 1 }
    }

    /// Rows become columns.
    pub fn transposed(self) -> Self {
        let (rows, columns) = (self.columns, self.rows);
        Self { rows, columns, row_stride: self.column_stride, column_stride: self.row_stride, ..self }
    }

    /// Length of the slice that the matrix spans, values.
    fn reach(&self) -> usize {
        match (self.rows, self.columns) {
            (0, _) | (_, 0) => 0,
            (r, c) => (r - 1) * self.row_stride + (c - 1) * self.column_stride + 1,
        }
    }

    fn strides(&self) -> [isize; 2] {
        [self.row_stride as isize, self.column_stride as isize]
    }
}

/// `out = a·b + keep·out`; rows of `out` are `stride` apart. The order of the sums depends on the sizes alone.
pub fn multiply<T: Real>(a: Matrix<'_, T>, b: Matrix<'_, T>, keep: T, out: &mut [T], stride: usize) {
    let written = Matrix::by_rows(&*out, a.rows, b.columns, stride);
    assert!(a.columns == b.rows && b.columns <= stride, "matrices that do not fit");
    assert!(a.reach() <= a.values.len() && b.reach() <= b.values.len() && written.reach() <= written.values.len());
    let strides = written.strides();
    // SAFETY: every matrix lies within its slice, as was just checked, and the one that is written is borrowed alone and has distinct entries.
    unsafe {
        T::gemm(
            [a.rows, a.columns, b.columns],
            (a.values.as_ptr(), a.strides()),
            (b.values.as_ptr(), b.strides()),
            keep,
            (out.as_mut_ptr(), strides),
        );
    }
}
