//! Types of covariances, and the layout of their entries.

/// Form of the covariances of a Gaussian family.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CovarianceType {
    /// One variance for all components, for each state.
    Spherical,
    /// One variance for each component and state.
    Diagonal,
    /// A symmetric matrix for each state.
    Full,
    /// One symmetric matrix shared by all states; in a mixture, by all parts of a state.
    Tied,
}

impl CovarianceType {
    /// Number of stored values of a covariance in d dimensions.
    pub(crate) fn values(self, d: usize) -> usize {
        match self {
            Self::Spherical => 1,
            Self::Diagonal => d,
            Self::Full | Self::Tied => d * d,
        }
    }

    /// Number of free parameters of a covariance in d dimensions.
    pub(crate) fn free(self, d: usize) -> usize {
        match self {
            Self::Full | Self::Tied => d * (d + 1) / 2,
            other => other.values(d),
        }
    }

    pub(super) fn shape(self) -> Shape {
        match self {
            Self::Spherical | Self::Diagonal => Shape::Diagonal,
            Self::Full | Self::Tied => Shape::Triangular,
        }
    }

    /// Name of a covariance's value in error messages.
    pub(super) fn name(self) -> &'static str {
        if self.shape() == Shape::Diagonal { "variance" } else { "covariance" }
    }
}

/// Entries of a matrix that are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Diagonal,
    Triangular,
}

impl Shape {
    /// Number of entries in d dimensions.
    #[inline(always)]
    pub(crate) fn entries(self, d: usize) -> usize {
        match self {
            Self::Diagonal => d,
            Self::Triangular => d * (d + 1) / 2,
        }
    }

    /// Position of an entry; for a diagonal shape i = j is assumed.
    pub(crate) fn entry(self, i: usize, j: usize) -> usize {
        match self {
            Self::Diagonal => i,
            Self::Triangular => packed(i, j),
        }
    }
}

/// Position of an entry of a symmetric matrix in its lower triangle, packed row after row.
#[inline(always)]
pub(super) fn packed(i: usize, j: usize) -> usize {
    // Rows before this one hold 1 + 2 + … + row entries.
    let (row, column) = if i >= j { (i, j) } else { (j, i) };
    row * (row + 1) / 2 + column
}
