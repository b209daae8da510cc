//! Choices made from bytes.

use arbitrary::Unstructured;

/// Draws from bytes. Once they are used up, each draw is the first choice.
#[derive(Debug)]
pub(crate) struct Draw<'a>(Unstructured<'a>);

impl<'a> Draw<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self(Unstructured::new(bytes))
    }

    /// A number below `n`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.0.int_in_range(0..=n - 1).unwrap_or(0)
    }

    /// True about once in `n` draws; false when the bytes are used up.
    pub(crate) fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == n - 1
    }

    pub(crate) fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }

    /// A value above 0 and below 1.
    pub(crate) fn unit(&mut self) -> f64 {
        (f64::from(self.0.int_in_range(0..=u16::MAX).unwrap_or(0)) + 0.5) / 65_536.0
    }

    /// A distribution in proportion to weights, as `weight` draws them.
    pub(crate) fn distribution(
        &mut self,
        n: usize,
        mut weight: impl FnMut(&mut Self) -> f64,
    ) -> Vec<f64> {
        let mut weights: Vec<f64> = (0..n).map(|_| weight(self)).collect();
        if weights.iter().sum::<f64>() < 1e-6 {
            // Avoids a division by a tiny sum.
            weights[self.below(n)] = 1.0;
        }
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|w| w / sum).collect()
    }
}
