//! Starts of tables of symbols: a symbol is a [`Multinomial`] observation of one trial, with a
//! component for each symbol.

use rand::Rng;

use super::start::of_kinds;
use super::{Multinomial, Rows};
use wayfix::DenseTransition;
use wayfix::Hmm;
use wayfix::InferenceError;
use wayfix::Sequence;
use wayfix::inference::{LearnError, SequenceError};
use wayfix::{Likelihood, Scratch, TableLikelihood};

/// Returns models of symbols to start learning from, of the same kinds as
/// [`starts`](super::starts), which see one component for each symbol: 1 for the symbol of the step
/// and 0 for the others.
///
/// The table is a placeholder: it decides the numbers of states and symbols, and what it rules out
/// stays impossible. It counts as one more observation of each state, so that symbols that are
/// never seen do not become impossible. There may be fewer symbols than states.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// use wayfix_learn::table_starts;
/// use wayfix::inference::LearningOptions;
/// use wayfix::{Hmm, TableLikelihood};
///
/// let seen: Vec<usize> = (0..120).map(|k| k / 30 % 2 + k % 2).collect();
/// let table = TableLikelihood::from_rows(&[[1.0 / 3.0; 3]; 2])?;
/// let starts = table_starts(&table, &[&seen], 5, &mut ChaCha8Rng::seed_from_u64(1))?;
/// let learned = Hmm::learn_best(&starts, &[&seen], &LearningOptions::default(), |_, _| ())?;
/// assert!(learned.log_likelihood() > -100.0); // that of one state is -124.8
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
///
/// [`LearnError::Sequence`] with sequence and step for a symbol that the table does not have;
/// [`LearnError::Likelihood`] if there are no observations.
///
/// # Complexity
///
/// That of [`starts`](super::starts), with a number for each symbol of the table at each step.
pub fn table_starts<S, R>(
    table: &TableLikelihood,
    sequences: &[S],
    count: usize,
    rng: &mut R,
) -> Result<Vec<Hmm<DenseTransition, TableLikelihood>>, LearnError>
where
    S: Sequence<(), usize>,
    R: Rng + ?Sized,
{
    let (n, m) = (Likelihood::states(table), table.symbols());
    let mut scratch = Scratch::default();
    let mut values = Vec::with_capacity(sequences.len());
    for (at, sequence) in sequences.iter().enumerate() {
        let mut all = vec![0.0; sequence.steps() * m];
        for (step, row) in (1..).zip(all.chunks_exact_mut(m)) {
            let symbol = sequence.observation(step);
            if let Err(source) = table.diagonal(symbol, &mut scratch) {
                let source = InferenceError::likelihood(step, source);
                return Err(SequenceError { sequence: at, source }.into());
            }
            row[*symbol] = 1.0;
        }
        values.push(all);
    }
    let rows: Result<Vec<Rows<'_>>, _> = values.iter().map(|all| Rows::new(all, m)).collect();
    let rows = rows.map_err(LearnError::likelihood)?;
    let placeholder = table.to_rows();
    let family = Multinomial::new(&placeholder).map_err(LearnError::likelihood)?;
    let steps = rows.iter().map(Rows::steps).sum::<usize>() as f64;
    let own = |start: Hmm<DenseTransition, Multinomial>| {
        let (prior, transition, family) = start.into_parts();
        // The weighted mean of the cluster's shares, for the T / n steps that a state has on
        // average, and of the table, for one step.
        let mut learned = family.probabilities();
        for (p, first) in learned.iter_mut().flatten().zip(placeholder.iter().flatten()) {
            *p = (steps / n as f64 * *p + first) / (steps / n as f64 + 1.0);
        }
        let table = TableLikelihood::from_rows(&learned).map_err(LearnError::likelihood)?;
        Ok(Hmm::new(prior, transition, table)?)
    };
    of_kinds(&family, &rows, count, rng)?.into_iter().map(own).collect()
}
