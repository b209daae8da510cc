//! The one loop that computes all distances. Every reference has a sum of its own and a fixed order
//! of terms, so results are the same to the bit on all machines.

use super::{Distance, ObservationError, ReferenceDescriptors};

/// Number of references stored side by side. Each has a sum of its own, so the compiler can use
/// registers of any width, with the same result to the bit.
pub(super) const GROUP: usize = 32;

/// Number of terms of a partial sum: the error grows with PART + d / PART, not with d.
const PART: usize = 32;

/// Scale factor of a descriptor: 1 / |x| for the cosine, else 1. Errors name it as `which` number
/// `index`.
pub(super) fn scale(
    distance: Distance,
    x: &[f32],
    which: &'static str,
    index: usize,
) -> Result<f64, ObservationError> {
    if let Some(element) = x.iter().position(|x| !x.is_finite()) {
        return Err(ObservationError::Element { which, index, element, value: x[element] });
    }
    match distance {
        Distance::Euclidean => Ok(1.0),
        Distance::Cosine => {
            // In doubles, squares of 32-bit numbers neither overflow nor underflow.
            let squares: f64 = x.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
            if squares == 0.0 {
                return Err(ObservationError::Zero { which, index });
            }
            Ok(1.0 / squares.sqrt())
        }
    }
}

/// Scales an element. References and queries are scaled alike, so that a copy has distance 0.
#[inline]
pub(super) fn scaled(x: f32, scale: f64) -> f32 {
    (f64::from(x) * scale) as f32
}

/// A block of queries against all references, which are read once.
pub(super) struct Pass<'a> {
    pub(super) references: &'a ReferenceDescriptors,
    /// Index of the first query, for errors.
    pub(super) first: usize,
    pub(super) queries: &'a [f32],
    /// Scale factor of each query.
    pub(super) scales: &'a [f64],
    /// A row of distances for each query.
    pub(super) out: &'a mut [f32],
}

impl Pass<'_> {
    /// Runs the loop with the widest registers. faer compiles a closure anew for each width, picks
    /// the one for this machine, and leaves the registers clean. A closure that did not consume its
    /// captures would be called instead, not compiled anew.
    #[cfg(feature = "faer")]
    pub(super) fn run(self) -> Result<(), ObservationError> {
        use faer::traits::ComplexField;
        <f32 as ComplexField>::Arch::default().dispatch(
            #[inline(always)]
            move || self.distances(),
        )
    }

    #[cfg(not(feature = "faer"))]
    pub(super) fn run(self) -> Result<(), ObservationError> {
        self.distances()
    }

    #[expect(clippy::inline_always, reason = "a loop that is called is not compiled anew")]
    #[inline(always)]
    fn distances(self) -> Result<(), ObservationError> {
        let &ReferenceDescriptors { dimension, count, distance, ref groups } = self.references;
        // Terms that underflow lose up to `MIN_POSITIVE` each; from this sum upwards, that is less
        // than what rounding loses.
        let least = dimension as f32 * f32::MIN_POSITIVE;
        for (start, rows) in (0..count).step_by(GROUP).zip(groups.chunks_exact(dimension)) {
            let members = GROUP.min(count - start);
            let queries = self.queries.chunks_exact(dimension).zip(self.scales);
            let outs = self.out.chunks_exact_mut(count);
            for (query, ((x, &scale), out)) in (self.first..).zip(queries.zip(outs)) {
                let squares = squares(x, scale, rows);
                let mut distances = match distance {
                    Distance::Cosine => squares.map(|square| 0.5 * square),
                    Distance::Euclidean => squares.map(f32::sqrt),
                };
                // Padding and infinities are out of range too; a fold without an early exit
                // vectorises.
                let in_range = |square: f32| (least..=f32::MAX).contains(&square);
                if distance == Distance::Euclidean
                    && !squares.iter().fold(true, |all, &square| all & in_range(square))
                {
                    for member in (0..members).filter(|&member| !in_range(squares[member])) {
                        distances[member] = in_doubles(x, rows, member).map_err(|distance| {
                            let reference = start + member;
                            ObservationError::TooFar { query, reference, distance }
                        })?;
                    }
                }
                out[start..start + members].copy_from_slice(&distances[..members]);
            }
        }
        Ok(())
    }
}

/// |x − r|² for each reference of a group.
#[expect(clippy::inline_always, reason = "a loop that is called is not compiled anew")]
#[inline(always)]
fn squares(x: &[f32], scale: f64, rows: &[[f32; GROUP]]) -> [f32; GROUP] {
    let mut total = [0.0; GROUP];
    // Pairwise in two levels: short partial sums of PART terms, then the sum of these.
    for (x, rows) in x.chunks(PART).zip(rows.chunks(PART)) {
        let mut part = [0.0; PART];
        part.iter_mut().zip(x).for_each(|(part, &x)| *part = scaled(x, scale));
        let mut sum = [0.0; GROUP];
        for (x, row) in part.iter().zip(rows) {
            for l in 0..GROUP {
                let difference = row[l] - x;
                sum[l] += difference * difference;
            }
        }
        for l in 0..GROUP {
            total[l] += sum[l];
        }
    }
    total
}

/// x − r| in doubles, where its square is too large or too small for 32 bits. The error is the
/// distance itself, if that is too large.
#[cold]
#[inline(never)]
fn in_doubles(x: &[f32], rows: &[[f32; GROUP]], member: usize) -> Result<f32, f64> {
    let differences = x.iter().zip(rows).map(|(&x, row)| f64::from(row[member]) - f64::from(x));
    let distance = differences.fold(0.0, |sum, difference| sum + difference * difference).sqrt();
    let rounded = distance as f32;
    if rounded.is_finite() { Ok(rounded) } else { Err(distance) }
}
