//! Generators from rates: P = I + Q / Λ, by columns, with Λ = 1.25 times the largest exit rate.

use super::GeneratorTransition;
use wayfix::ReorderStates;
use wayfix::SparseTransition;
use wayfix::TransitionError;
use wayfix::error::Parameter;
use wayfix::internal::Compressed;
use wayfix::internal::check_count;

/// Λ over the largest exit rate. With 1, a diagonal entry of P could be 0, and beliefs could
/// alternate without ever settling; the larger it is, the more products a step takes.
pub(super) const MARGIN: f64 = 1.25;

impl GeneratorTransition {
    /// Creates an operator from triplets (to, from, rate) of the moves between different states, in
    /// any order. Rates of 0 are skipped. O(n + moves).
    ///
    /// ```
    /// use wayfix_learn::GeneratorTransition;
    ///
    /// let error = GeneratorTransition::from_triplets(2, [(1, 0, 3.0), (0, 0, -3.0)]).unwrap_err();
    /// assert!(error.to_string().starts_with("the rate from state 0 to itself is -3, expected none"));
    /// ```
    ///
    /// # Errors
    ///
    /// [`TransitionError`] for no states, an index out of range, a rate that is NaN, negative or
    /// infinite, or below 2.2e-308 of the largest exit rate, a rate above 0 from a state to itself
    /// or given twice, an exit rate that overflows, or more than 2^31 − 1 states or 2^32 − 1 moves.
    pub fn from_triplets(
        states: usize,
        triplets: impl IntoIterator<Item = (usize, usize, f64)>,
    ) -> Result<Self, TransitionError> {
        let triplets: Vec<_> = triplets.into_iter().collect();
        let own =
            triplets.iter().find(|&&(to, from, rate)| to == from && from < states && rate != 0.0);
        if let Some(&(state, _, rate)) = own {
            let what = format!("the rate from state {state} to itself");
            let expected = "none: the rates to other states say when a state is left";
            return Err(Parameter::new(what, rate, expected).into());
        }
        // P also has a diagonal entry for each state, so that their number counts, too.
        let wrong = |(to, from, value)| TransitionError::Rate { to, from, value };
        let entries = SparseTransition::above_zero(states, triplets, wrong)?;
        check_count("moves", entries.len().saturating_add(states))?;
        let rows = Compressed::new(states, entries.iter().copied()).transposed();
        for to in 0..states {
            if let Some(twice) = rows.indices(to).windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(TransitionError::Duplicate { to, from: twice[0] as usize });
            }
        }
        Self::from_columns(rows.transposed())
    }

    /// Builds the operator from rates by the state that is left.
    fn from_columns(rates: Compressed) -> Result<Self, TransitionError> {
        let states = rates.lines();
        let exit = |from: usize| rates.line(from).map(|entry| entry.1).sum::<f64>();
        let exits: Vec<f64> = (0..states).map(exit).collect();
        if let Some(state) = exits.iter().position(|exit| *exit * MARGIN > f64::MAX) {
            let what = format!("the sum of the rates out of state {state}");
            return Err(Parameter::new(what, exits[state], "at most 1.4e308").into());
        }
        let uniform_rate = exits.iter().copied().fold(0.0, f64::max) * MARGIN;
        let mut entries = Vec::with_capacity(rates.entries() + states);
        for (from, exit) in exits.iter().enumerate() {
            for (to, rate) in rates.line(from) {
                // A legal move must stay possible, with all its digits.
                let p = rate / uniform_rate;
                if p < f64::MIN_POSITIVE {
                    let what = format!("the rate from state {from} to state {to}");
                    let expected =
                        "at least 2.2e-308 of 1.25 times the largest sum of rates out of a state";
                    return Err(Parameter::new(what, rate, expected).into());
                }
                entries.push((to, from, p));
            }
            // 1 − exit / Λ, at least 1 − 1 / 1.25 = 0.2, so that little cancels.
            let stay = if uniform_rate > 0.0 { (uniform_rate - exit) / uniform_rate } else { 1.0 };
            entries.push((from, from, stay));
        }
        let chain = SparseTransition::from_triplets(states, entries)?;
        // A sum of m products has a relative error of up to m / 2 epsilons, in either direction.
        let lines = [chain.rows(), chain.columns()];
        let longest = lines.iter().flat_map(|lines| lines.starts().windows(2));
        let longest = longest.map(|ends| ends[1] - ends[0]).max().unwrap_or(0);
        let rounding = (4.0 + 0.5 * f64::from(longest)) * f64::EPSILON;
        Ok(Self { rates, exits, uniform_rate, chain, rounding })
    }
}

impl ReorderStates for GeneratorTransition {
    fn reordered(&self, order: &[usize]) -> Self {
        let new = wayfix::internal::positions(order);
        let entry =
            |(to, from, rate): (usize, usize, f64)| (new[from] as u32, new[to] as u32, rate);
        let entries: Vec<_> = self.triplets().map(entry).collect();
        let rates = Compressed::new(order.len(), entries.iter().copied());
        let chain = self.chain.reordered(order);
        let exits = order.iter().map(|&old| self.exits[old]).collect();
        let rates = rates.transposed().transposed();
        Self { rates, exits, chain, ..*self }
    }
}
