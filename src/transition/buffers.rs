//! A pool of scratch buffers for each thread, for products in two passes.
//!
//! Invariant: a buffer is either in the pool or lent to one caller. Calls nest, so the pool is a
//! stack: the same nesting of calls finds the same buffers, large enough from the last time.

use std::cell::RefCell;
use std::thread::LocalKey;

thread_local! {
    static NUMBERS: RefCell<Vec<Vec<f64>>> = const { RefCell::new(Vec::new()) };
    static INDICES: RefCell<Vec<Vec<u32>>> = const { RefCell::new(Vec::new()) };
}

/// Element type of a buffer: numbers, or states as 32-bit indices.
pub trait Pooled: Copy + Default + 'static {
    fn pool() -> &'static LocalKey<RefCell<Vec<Vec<Self>>>>;
}

impl Pooled for f64 {
    fn pool() -> &'static LocalKey<RefCell<Vec<Vec<f64>>>> {
        &NUMBERS
    }
}

impl Pooled for u32 {
    fn pool() -> &'static LocalKey<RefCell<Vec<Vec<u32>>>> {
        &INDICES
    }
}

/// Bytes of a cache line.
const LINE: usize = 64;

/// Lends a buffer of `count` values, with unspecified contents.
///
/// Buffers are kept for each thread, last in first out: the same calls, however
/// they nest, get the same buffers again, and allocate only the first time.
pub fn with<T: Pooled, R>(count: usize, work: impl FnOnce(&mut [T]) -> R) -> R {
    // Aligned to a cache line, so that no eight doubles lie in two lines. `room` more values are
    // always enough for that. `align_offset` may give up and return usize::MAX, hence the minimum.
    let room = LINE / size_of::<T>();
    let mut buffer: Vec<T> = take(count + room);
    let skipped = buffer.as_ptr().align_offset(LINE).min(room);
    // The pool is not borrowed during `work`, which may ask for buffers itself.
    let result = work(&mut buffer[skipped..skipped + count]);
    put_back(buffer);
    result
}

/// Lends a scratch buffer of `count` numbers, for user-defined operators that need memory
/// between two passes: [`Transition::apply`](crate::Transition::apply) takes `&self`, and one
/// model may serve many threads.
///
/// The initial contents are unspecified. Each thread keeps its buffers: the same calls, however
/// they nest, allocate only the first time. If `work` panics, its buffer is dropped.
///
/// ```
/// use wayfix::transition::WindowTransition;
/// use wayfix::transition::kit::with_scratch;
/// use wayfix::{Belief, Hmm, LikelihoodVector, Prior, Transition};
///
/// /// One operator after the other: first the vehicle moves, then it is shunted.
/// struct Then<A, B>(A, B);
///
/// impl<A: Transition<Control = ()>, B: Transition<Control = ()>> Transition for Then<A, B> {
///     type Control = ();
///     fn states(&self) -> usize {
///         self.0.states()
///     }
///     fn apply(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         with_scratch(x.len(), |moved| {
///             self.0.apply(&(), x, moved);
///             self.1.apply(&(), moved, out);
///         });
///     }
///     fn apply_transpose(&self, _: &(), x: &[f64], out: &mut [f64]) {
///         with_scratch(x.len(), |shunted| {
///             self.1.apply_transpose(&(), x, shunted);
///             self.0.apply_transpose(&(), shunted, out);
///         });
///     }
/// }
///
/// let by = |places| WindowTransition::closed(5, places, &[1.0]);
/// let prior = Prior::BeforeFirstTransition(Belief::certain(5, 0)?);
/// let hmm = Hmm::new(prior, Then(by(1)?, by(2)?), LikelihoodVector::linear(5))?;
/// assert_eq!(hmm.filter().forecast(1)?.mode(), 3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn with_scratch<R>(count: usize, work: impl FnOnce(&mut [f64]) -> R) -> R {
    with(count, work)
}

/// Takes a buffer from the pool. Kept out of [`with`] so that it is not compiled anew for each
/// closure.
#[inline(never)]
fn take<T: Pooled>(count: usize) -> Vec<T> {
    let mut buffer = T::pool().with_borrow_mut(Vec::pop).unwrap_or_default();
    // Writes only what the buffer is short of; the rest keeps its old contents.
    buffer.resize(count, T::default());
    buffer
}

#[inline(never)]
fn put_back<T: Pooled>(buffer: Vec<T>) {
    T::pool().with_borrow_mut(|pool| pool.push(buffer));
}

/// Makes the thread keep memory for two buffers, so that a first product does not allocate. The
/// memory is reserved, not written.
pub fn reserve_two(count: usize) {
    NUMBERS.with_borrow_mut(|pool| {
        if pool.len() < 2 {
            pool.resize_with(2, Vec::new);
        }
        // The last two buffers are the next to be lent. `reserve` counts from the length.
        let last = pool.len() - 2;
        for buffer in &mut pool[last..] {
            let whole = count + LINE / size_of::<f64>();
            buffer.reserve(whole.saturating_sub(buffer.len()));
        }
    });
}

/// Lends two buffers of the same size, as [`with`] does.
pub fn with_two<T: Pooled, R>(count: usize, work: impl FnOnce(&mut [T], &mut [T]) -> R) -> R {
    with(count, |first| with(count, |second| work(first, second)))
}

/// Lends an empty buffer that may grow, and keeps its memory, as [`with`] does.
pub fn with_growing<T: Pooled, R>(work: impl FnOnce(&mut Vec<T>) -> R) -> R {
    // Resizing to 0 clears the buffer, and keeps its capacity.
    let mut buffer = take(0);
    let result = work(&mut buffer);
    put_back(buffer);
    result
}
