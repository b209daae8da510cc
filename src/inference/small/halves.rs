//! A sequence from both ends at once: the forward recursion goes through one
//! stretch while the backward one goes through another. A step of either is
//! mostly waiting for the last one; so a processor works on one while it waits
//! for the other. Nothing is computed twice.
//!
//! Two threads, one for each, would wait as long, and were no faster.

use super::chain::{Chain, Matrix, UNLOOKED, times};
use crate::kernels::{self, Kernel, Lanes};

/// A stretch of steps: their likelihoods, and a place for each.
pub(super) struct Stretch<'a, const N: usize> {
    pub(super) diagonals: &'a [[f64; N]],
    pub(super) places: &'a mut [[f64; N]],
}

/// The vector that is stored for a step. Not a closure: the loops would be compiled again
/// for each.
#[derive(Debug, Clone, Copy)]
pub(super) enum Put {
    /// The vector of the recursion.
    Vector,
    /// The posterior, where the vector of the other recursion is.
    Posterior,
}

impl Put {
    #[inline(always)]
    fn put<const N: usize>(self, place: &mut [f64; N], x: &[f64; N]) {
        *place = match self {
            Self::Vector => *x,
            Self::Posterior => posterior(place, x),
        };
    }
}

/// x ∘ r, which sums to one.
#[inline(always)]
pub(super) fn posterior<const N: usize>(x: &[f64; N], r: &[f64; N]) -> [f64; N] {
    let mut product = times(x, r);
    let factor = 1.0 / product.iter().sum::<f64>();
    product.iter_mut().for_each(|p| *p *= factor);
    product
}

impl<const N: usize> Stretch<'_, N> {
    /// The first so many steps, and the others.
    #[inline(always)]
    fn split(self, at: usize) -> (Self, Self) {
        let (diagonals, other_diagonals) = self.diagonals.split_at(at);
        let (places, other_places) = self.places.split_at_mut(at);
        let other = Self { diagonals: other_diagonals, places: other_places };
        (Self { diagonals, places }, other)
    }
}

/// Goes forward through a stretch: takes each step, then puts it.
#[inline(always)]
pub(super) fn ahead<const N: usize>(
    matrix: &Matrix<N>,
    chain: &mut Chain<N>,
    stretch: Stretch<'_, N>,
    unlooked: usize,
    put: Put,
) -> Option<()> {
    let Stretch { diagonals, places } = stretch;
    for (diagonals, places) in diagonals.chunks(unlooked).zip(places.chunks_mut(unlooked)) {
        for (b, place) in diagonals.iter().zip(places) {
            chain.values = matrix.ahead(b, &chain.values);
            put.put(place, &chain.values);
        }
        chain.look()?;
    }
    Some(())
}

/// Goes backward through a stretch, from its end: puts each step, then takes
/// it.
#[inline(always)]
pub(super) fn back<const N: usize>(
    matrix: &Matrix<N>,
    chain: &mut Chain<N>,
    stretch: Stretch<'_, N>,
    unlooked: usize,
    put: Put,
) -> Option<()> {
    let Stretch { diagonals, places } = stretch;
    for (diagonals, places) in diagonals.rchunks(unlooked).zip(places.rchunks_mut(unlooked)) {
        for (b, place) in diagonals.iter().zip(places).rev() {
            put.put(place, &chain.values);
            chain.values = matrix.back(b, &chain.values);
        }
        chain.look()?;
    }
    Some(())
}

/// Vectors of fewer numbers gain nothing by wider instructions than those that are always
/// there.
const FEWEST_WIDE: usize = 4;

/// Both, step by step in turn, with the widest instructions there are.
#[inline(never)]
pub(super) fn both<const N: usize>(
    matrix: &Matrix<N>,
    chains: &mut [Chain<N>; 2],
    first: Stretch<'_, N>,
    second: Stretch<'_, N>,
    put: Put,
) -> Option<()> {
    let both = Both { matrix, chains, first, second, put };
    if const { N < FEWEST_WIDE } { both.go() } else { kernels::run(both) }
}

struct Both<'a, const N: usize> {
    matrix: &'a Matrix<N>,
    chains: &'a mut [Chain<N>; 2],
    first: Stretch<'a, N>,
    second: Stretch<'a, N>,
    put: Put,
}

impl<const N: usize> Kernel for Both<'_, N> {
    type Output = Option<()>;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> Option<()> {
        self.go()
    }
}

impl<const N: usize> Both<'_, N> {
    #[inline(always)]
    fn go(self) -> Option<()> {
        let Self { matrix, chains, first, second, put } = self;
        let [forward, backward] = chains;
        let unlooked = matrix.unlooked([first.diagonals, second.diagonals])?;
        let shared = first.diagonals.len().min(second.diagonals.len()) / UNLOOKED * UNLOOKED;
        let shared = if unlooked == UNLOOKED { shared } else { 0 };
        let (first, first_rest) = first.split(shared);
        let second_length = second.diagonals.len();
        let (second_rest, second) = second.split(second_length - shared);
        let firsts = first.diagonals.as_chunks::<UNLOOKED>().0.iter();
        let firsts = firsts.zip(first.places.as_chunks_mut::<UNLOOKED>().0);
        let seconds = second.diagonals.as_chunks::<UNLOOKED>().0.iter();
        let seconds = seconds.zip(second.places.as_chunks_mut::<UNLOOKED>().0).rev();
        // In registers, as far as there are enough.
        let (mut forwards, mut backwards) = (*forward, *backward);
        for ((b, places), (c, other_places)) in firsts.zip(seconds) {
            for k in 0..UNLOOKED {
                let l = UNLOOKED - 1 - k;
                put.put(&mut other_places[l], &backwards.values);
                forwards.values = matrix.ahead(&b[k], &forwards.values);
                backwards.values = matrix.back(&c[l], &backwards.values);
                put.put(&mut places[k], &forwards.values);
            }
            forwards.look()?;
            backwards.look()?;
        }
        (*forward, *backward) = (forwards, backwards);
        ahead(matrix, forward, first_rest, unlooked, put)?;
        back(matrix, backward, second_rest, unlooked, put)
    }
}
