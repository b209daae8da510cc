//! A sequence from both ends at once: the forward recursion goes through one
//! stretch while the backward one goes through another. A step of either is
//! mostly waiting for the last one; so a processor works on one while it waits
//! for the other. Nothing is computed twice.
//!
//! Two threads, one for each, would wait as long, and were no faster.

use super::chain::{Chain, Matrix, UNLOOKED};
use crate::kernels::{self, Kernel, Lanes};

/// A stretch of steps: their likelihoods, and a place for each.
pub(super) struct Stretch<'a, const N: usize, P> {
    pub(super) diagonals: &'a [[f64; N]],
    pub(super) places: &'a mut [P],
}

impl<const N: usize, P> Stretch<'_, N, P> {
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
pub(super) fn ahead<const N: usize, P>(
    matrix: &Matrix<N>,
    chain: &mut Chain<N>,
    stretch: Stretch<'_, N, P>,
    unlooked: usize,
    put: impl Fn(&mut P, &[f64; N]),
) -> Option<()> {
    let Stretch { diagonals, places } = stretch;
    for (diagonals, places) in diagonals.chunks(unlooked).zip(places.chunks_mut(unlooked)) {
        for (b, place) in diagonals.iter().zip(places) {
            chain.values = matrix.ahead(b, &chain.values);
            put(place, &chain.values);
        }
        chain.look()?;
    }
    Some(())
}

/// Goes backward through a stretch, from its end: puts each step, then takes
/// it.
#[inline(always)]
pub(super) fn back<const N: usize, P>(
    matrix: &Matrix<N>,
    chain: &mut Chain<N>,
    stretch: Stretch<'_, N, P>,
    unlooked: usize,
    put: impl Fn(&mut P, &[f64; N]),
) -> Option<()> {
    let Stretch { diagonals, places } = stretch;
    for (diagonals, places) in diagonals.rchunks(unlooked).zip(places.rchunks_mut(unlooked)) {
        for (b, place) in diagonals.iter().zip(places).rev() {
            put(place, &chain.values);
            chain.values = matrix.back(b, &chain.values);
        }
        chain.look()?;
    }
    Some(())
}

/// Both, step by step in turn, with the widest instructions there are.
pub(super) fn both<const N: usize, P>(
    matrix: &Matrix<N>,
    chains: &mut [Chain<N>; 2],
    first: Stretch<'_, N, P>,
    second: Stretch<'_, N, P>,
    put: impl Fn(&mut P, &[f64; N]) + Copy,
) -> Option<()> {
    kernels::run(Both { matrix, chains, first, second, put })
}

struct Both<'a, const N: usize, P, F> {
    matrix: &'a Matrix<N>,
    chains: &'a mut [Chain<N>; 2],
    first: Stretch<'a, N, P>,
    second: Stretch<'a, N, P>,
    put: F,
}

impl<const N: usize, P, F: Fn(&mut P, &[f64; N]) + Copy> Kernel for Both<'_, N, P, F> {
    type Output = Option<()>;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> Option<()> {
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
                put(&mut other_places[l], &backwards.values);
                forwards.values = matrix.ahead(&b[k], &forwards.values);
                backwards.values = matrix.back(&c[l], &backwards.values);
                put(&mut places[k], &forwards.values);
            }
            forwards.look()?;
            backwards.look()?;
        }
        (*forward, *backward) = (forwards, backwards);
        ahead(matrix, forward, first_rest, unlooked, put)?;
        back(matrix, backward, second_rest, unlooked, put)
    }
}
