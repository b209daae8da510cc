//! The filter over a whole sequence: each belief, and how well each observation was
//! predicted.

use super::chain::{Chain, LEAST, Matrix, none_between_0_and};
use super::diagonals::{Diagonals, Factors, Sensed, one_by_one};
use super::ends::start;
use super::segments::{self, Segments, Source, eight};
use super::{columns, control_of, filled_up, room, with_constant, without_room};
use crate::hmm::Hmm;
use crate::inference::LogSum;
use crate::inference::filtering::FilteredSequence;
use crate::inference::posteriors::Posteriors;
use crate::kernels::lockstep::{Abreast, scatter};
use crate::kernels::segments_filter::{self, Filter};
use crate::kernels::{Eight, LANES, in_large_pages};
use crate::likelihood::Likelihood;
use crate::sequence::Sequence;
use crate::transition::Transition;

/// Up to so many states to go through segments is faster.
const MOST_IN_SEGMENTS: usize = 4;
/// How many steps are gathered at a time where there are no segments.
const GATHERED: usize = 128;

/// [`Hmm::forward`], or `None` where it takes the general routine.
pub(in super::super) fn filter<A, B, S>(hmm: &Hmm<A, B>, sequence: &S) -> Option<FilteredSequence>
where
    A: Transition,
    B: Likelihood,
    S: Sequence<A::Control, B::Observation> + ?Sized,
{
    let steps = sequence.steps();
    if !segments::enough(steps) {
        return None; // what a stream gives, to the bit
    }
    let control = control_of(hmm, steps)?;
    let matrix = columns::of(hmm.transition(), control)?;
    let prior = hmm.prior().belief().as_slice();
    let moves = hmm.prior().moves_at(1);
    let mut out = Out {
        values: in_large_pages(vec![0.0; room(prior.len()) * (steps + 1)]),
        logs: vec![0.0; steps],
    };
    let mut sum = LogSum::default();
    dispatch(&matrix, prior, moves, &mut Sensed::new(hmm, sequence), &mut out, &mut sum)?;
    without_room(&mut out.values, prior.len());
    let posteriors = Posteriors::from_values(hmm.states(), out.values);
    Some(FilteredSequence::new(posteriors, out.logs, sum.value()))
}

/// Results.
struct Out {
    values: Vec<f64>,
    logs: Vec<f64>,
}

fn dispatch(
    matrix: &[f64],
    prior: &[f64],
    moves: bool,
    diagonals: &mut dyn Diagonals,
    out: &mut Out,
    sum: &mut LogSum,
) -> Option<()> {
    with_constant!(prior.len(), N => run::<N>(matrix, prior, moves, diagonals, out, sum))
}

fn run<const N: usize>(
    matrix: &[f64],
    prior: &[f64],
    moves: bool,
    diagonals: &mut dyn Diagonals,
    out: &mut Out,
    sum: &mut LogSum,
) -> Option<()> {
    let matrix = Matrix::<N>::new(matrix, prior.len())?;
    let prior: [f64; N] = filled_up(prior, 0.0)?;
    let mut chain = Chain::new(prior)?;
    let (rows, logs) = (out.values.as_chunks_mut::<N>().0, &mut out.logs[..]);
    rows[0] = prior;
    let (mut done, mut factors) = (0, Factors::default());
    if !moves {
        chain = start(chain, diagonals, &mut factors)?;
        logs[0] = log_of(&chain, &factors);
        rows[1] = normalized(&chain.values).1;
        done = 1;
    }
    if const { N <= MOST_IN_SEGMENTS } {
        let place = (&mut rows[1..], &mut *logs);
        done = in_segments(&matrix, &mut chain, done, diagonals, &mut factors, place)?;
    }
    sum.add(log_of(&chain, &factors));
    let mut x = normalized(&chain.values).1;
    let mut gathered = [[0.0; N]; GATHERED];
    while done < logs.len() {
        let count = GATHERED.min(logs.len() - done);
        let (gathered, logs) = (&mut gathered[..count], &mut logs[done..done + count]);
        one_by_one(diagonals, done + 1, gathered, logs)?;
        matrix.unlooked([gathered, &[]])?;
        for ((b, row), log) in gathered.iter().zip(&mut rows[done + 1..]).zip(logs) {
            let (total, belief) = normalized(&matrix.ahead(b, &x));
            (x, *row) = (belief, belief);
            if total == 0.0 || !none_between_0_and(LEAST, &x) {
                return None;
            }
            *log += total.ln();
            sum.add(*log);
        }
        done += count;
    }
    Some(())
}

/// ln Σ x_i, with what was taken out.
fn log_of<const N: usize>(chain: &Chain<N>, factors: &Factors) -> f64 {
    let mut log = LogSum::default();
    log.add(chain.values.iter().sum::<f64>().ln());
    factors.add_to(&mut log, chain.exponent);
    log.value()
}

/// The sum, and what sums to one.
#[inline]
fn normalized<const N: usize>(x: &[f64; N]) -> (f64, [f64; N]) {
    let total: f64 = x.iter().sum();
    let factor = 1.0 / total;
    let mut out = *x;
    out.iter_mut().for_each(|x| *x *= factor);
    (total, out)
}

/// Through segment after segment, and from its start through each. Gives how many
/// steps are done.
fn in_segments<const N: usize>(
    matrix: &Matrix<N>,
    chain: &mut Chain<N>,
    mut done: usize,
    diagonals: &mut dyn Diagonals,
    factors: &mut Factors,
    (rows, logs): (&mut [[f64; N]], &mut [f64]),
) -> Option<usize> {
    let mut source = Source::new(diagonals);
    let (mut likelihoods, mut beliefs, mut normalisers) = (Vec::new(), Vec::new(), Vec::new());
    let mut totals = Vec::new();
    while let Some(length) = segments::length(logs.len() - done) {
        likelihoods.resize(length, [Abreast::default(); N]);
        beliefs.resize(length, [Abreast::default(); N]);
        normalisers.resize(length, Abreast::default());
        totals.resize(LANES * length, 0.0);
        let (logs, rows) =
            (&mut logs[done..done + LANES * length], &mut rows[done..done + LANES * length]);
        let unlooked = source.gather_one_by_one(matrix, done + 1, &mut likelihoods, logs)?;
        let starts: [Eight; N] = Segments::new(matrix, &likelihoods, unlooked)?.ahead(chain)?;
        let work = Filter {
            model: matrix.few(unlooked),
            starts: &starts,
            likelihoods: &likelihoods,
            out: &mut beliefs,
            normalisers: &mut normalisers,
        };
        segments_filter::filter(work).then_some(())?;
        scatter(beliefs.as_flattened(), eight(rows.as_flattened_mut()));
        logs.iter().filter(|log| **log != 0.0).for_each(|log| factors.add_log(*log));
        scatter(&normalisers, eight(&mut totals));
        logs.iter_mut().zip(&totals).for_each(|(log, total)| *log += total.ln());
        done += LANES * length;
    }
    Some(done)
}
