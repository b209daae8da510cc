//! Standard errors of learned parameters by the grouped jackknife (Tukey 1958; Efron and Stein
//! 1981): learning again without each group of sequences.
//!
//! For G groups and a number v, with v_g learned without group g and m the mean of the v_g, the
//! variance is (G − 1) / G · Σ (v_g − m)².

use super::standard_errors::StandardErrors;
use wayfix::Hmm;
use wayfix::Sequence;
use wayfix::inference::LearnError;
use wayfix::inference::LearningOptions;
use wayfix::internal::parallel;
use wayfix::likelihood::LearnLikelihood;
use wayfix::transition::LearnTransition;

impl StandardErrors {
    /// Returns standard errors, by the jackknife (Tukey 1958; Efron and Stein 1981), of numbers
    /// that `read` takes from a model, which was learned from these sequences.
    ///
    /// The model is learned again, starting from itself, without each of `groups` groups of
    /// sequences (sequence s is in group s modulo `groups`). The errors measure the spread of the
    /// results: for G groups, the root of (G − 1) / G times the sum of squares about their mean.
    ///
    /// With one group for each sequence and many sequences, this estimates the same as the sandwich
    /// of derivatives (White 1982), so that it also holds for models that are not true. But the
    /// sequences must be independent of each other, and the parameters not at a bound. A single
    /// long sequence may be cut into pieces that are much longer than a state lasts. Learn to a
    /// small tolerance: differences that unfinished learning leaves count as errors.
    ///
    /// Runs in parallel with the feature `rayon`. The cost is that of learning G times from a good
    /// start. For one sequence, or a few, see [`from_likelihood`](Self::from_likelihood).
    ///
    /// ```
    /// use wayfix::inference::LearningOptions;
    /// use wayfix_learn::StandardErrors;
    /// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// # use wayfix::{Belief, DenseTransition, Fixed, Hmm, Prior, TableLikelihood};
    /// # let prior = Prior::AtFirstObservation(Belief::uniform(2)?);
    /// # let camera = TableLikelihood::from_rows(&[[0.9, 0.1], [0.2, 0.8]])?;
    /// # let truth = Hmm::new(prior, DenseTransition::from_rows(&[[0.9, 0.3], [0.1, 0.7]])?, Fixed(camera))?;
    /// # let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// # let sequences: Vec<Vec<usize>> = (0..60).map(|_| truth.simulate(30, &mut rng).observations().to_vec()).collect();
    /// let options = LearningOptions::default().with_tolerance(1e-6).with_keep_prior(true);
    /// let learned = truth.learn(&sequences, &options)?.into_model();
    /// let stay = |hmm: &Hmm<_, _>| -> Vec<f64> {
    ///     let a: &DenseTransition = hmm.transition();
    ///     vec![a.get(0, 0), a.get(1, 1)]
    /// };
    /// let errors = StandardErrors::from_jackknife(&learned, &sequences, 20, &options, stay)?;
    /// for (value, error) in errors.values().iter().zip(errors.errors()) {
    ///     println!("{value:.3} ± {error:.3}");
    /// }
    /// # assert!((errors.values()[0] - 0.9).abs() < 3.0 * errors.errors()[0]);
    /// # assert!((errors.values()[1] - 0.7).abs() < 3.0 * errors.errors()[1]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`LearnError::Groups`] for fewer than two groups, or fewer sequences than groups;
    /// [`LearnError::Sequence`] for a sequence that the model rules out or that is not valid; and
    /// the first error of learning.
    pub fn from_jackknife<A, B, S>(
        hmm: &Hmm<A, B>,
        sequences: &[S],
        groups: usize,
        learning: &LearningOptions,
        read: impl Fn(&Hmm<A, B>) -> Vec<f64> + Sync,
    ) -> Result<Self, LearnError>
    where
        A: LearnTransition,
        B: LearnLikelihood,
        Hmm<A, B>: Clone + Sync,
        S: Sequence<A::Control, B::Observation> + Sync,
    {
        if groups < 2 || sequences.len() < groups {
            return Err(LearnError::Groups { groups, sequences: sequences.len() });
        }
        let all: Vec<(usize, &S)> = sequences.iter().enumerate().collect();
        // A sequence that learning would leave out would still count as part of its group.
        if let Some(error) = hmm.expectations_of(&all).1.into_iter().next() {
            return Err(error.into());
        }
        // Groups are interleaved, so that all of them share any trend along the list.
        let without = |group: usize, (): &mut ()| {
            let all = sequences.iter().enumerate();
            let others: Vec<&S> = all.filter(|(s, _)| s % groups != group).map(|s| s.1).collect();
            hmm.learn(&others, learning).map(|learned| read(learned.model()))
        };
        let results = parallel::map((0..groups).collect(), without);
        let results = results.into_iter().collect::<Result<Vec<Vec<f64>>, LearnError>>()?;
        let count = groups as f64;
        let values = read(hmm);
        let spread = |number: usize| -> Vec<f64> {
            let found = || results.iter().filter_map(|values| values.get(number));
            // About the mean of the results, not the values of this model, so that the bias of
            // learning, which is common to all, does not count. The sum of squares of this vector
            // is the variance, its product with another the covariance.
            let mean = found().sum::<f64>() / count;
            found().map(|v| (v - mean) * ((count - 1.0) / count).sqrt()).collect()
        };
        let spread = (0..values.len()).map(spread).collect();
        Ok(Self::new(values, spread, 0))
    }
}
