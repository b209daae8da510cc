//! Ceilings of the machine: the best rates of memory, loads and arithmetic.
//!
//! Nothing here calls the loops of the library. The rate of memory is that of the fastest of
//! three loops over as many bytes as a case works on: comparing two halves, which reads, and
//! copying one to the other, both by the system's C library with the widest available
//! instructions, and the triad a = b + s c (McCalpin 1995), which the compiler vectorises for
//! the target that it builds for.

use std::hint::black_box;
use std::iter::zip;
use std::time::{Duration, Instant};

/// Number of turns that makes the beginning and the end of a loop negligible.
const MANY: usize = 10_000;

/// Seconds per call: the median of nine measurements, each over as many calls as fill 10 ms.
pub(crate) fn seconds(mut work: impl FnMut()) -> f64 {
    let mut times = |count: usize| {
        let start = Instant::now();
        (0..count).for_each(|_| work());
        start.elapsed()
    };
    times(1); // warms up
    let count = 10_000_000 / (times(1).as_nanos() as usize).clamp(1, 10_000_000);
    let mut timed: [Duration; 9] = std::array::from_fn(|_| times(count));
    timed.sort();
    timed[4].as_secs_f64() / count as f64
}

/// Bytes per second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bandwidth {
    pub(crate) compare: f64,
    pub(crate) copy: f64,
    pub(crate) triad: f64,
}

impl Bandwidth {
    /// Measures a working set of this many bytes, divided among this many threads.
    pub(crate) fn of(bytes: usize, threads: usize) -> Self {
        let each = (bytes / threads).max(1536);
        let of_halves = |work: fn(&mut [u8], &[u8])| {
            let half = vec![1_u8; each / 2];
            rate(2 * half.len(), vec![(half.clone(), half); threads], |(a, b)| work(a, b))
        };
        let third = vec![1.0; each / 24];
        let thirds = vec![(third.clone(), third.clone(), third); threads];
        Self {
            compare: of_halves(|a, b| {
                black_box(black_box(&*a) == black_box(b));
            }),
            copy: of_halves(|a, b| black_box(a).copy_from_slice(black_box(b))),
            triad: rate(each / 24 * 24, thirds, |(a, b, c)| {
                for (a, (b, c)) in zip(black_box(a), zip(black_box(b), black_box(c))) {
                    *a = *b + 3.0 * *c;
                }
            }),
        }
    }

    pub(crate) fn best(self) -> f64 {
        self.compare.max(self.copy).max(self.triad)
    }
}

/// Bytes per second when each thread works on its part.
fn rate<P: Send>(bytes: usize, mut parts: Vec<P>, work: impl Fn(&mut P) + Sync) -> f64 {
    let work = &work;
    let moved = (bytes * parts.len()) as f64;
    let seconds = if let [part] = &mut parts[..] {
        seconds(|| work(part))
    } else {
        seconds(|| {
            std::thread::scope(|scope| {
                parts.iter_mut().for_each(|part| {
                    scope.spawn(move || work(part));
                });
            });
        })
    };
    moved / seconds
}

/// Seconds to load the numbers at these indices below n.
pub(crate) fn gathers(n: usize, indices: &[u32]) -> f64 {
    let x = vec![1.0; n];
    let (eights, rest) = indices.as_chunks::<8>();
    seconds(|| {
        let (x, mut sums) = (black_box(&x[..]), [0.0; 8]);
        for indices in black_box(eights) {
            zip(&mut sums, indices).for_each(|(sum, i)| *sum += x[*i as usize]);
        }
        zip(&mut sums, rest).for_each(|(sum, i)| *sum += x[*i as usize]);
        black_box(sums);
    })
}

/// Seconds to load one of n numbers at random.
pub(crate) fn random_gather(n: usize) -> f64 {
    let next = |index: &u32| Some(index.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let random = std::iter::successors(Some(1_u32), next);
    let indices: Vec<u32> = random.map(|index| (index >> 4) % n as u32).take(n.max(MANY)).collect();
    gathers(n, &indices) / indices.len() as f64
}

/// Ceilings that do not depend on a case.
pub(crate) struct Machine {
    /// Seconds of an operation that waits for the one before.
    pub(crate) multiplication: f64,
    pub(crate) addition: f64,
    /// Additions and multiplications per second; infinite if unknown.
    pub(crate) peak: f64,
}

impl Machine {
    pub(crate) fn measured() -> Self {
        let a = black_box(0.999_999);
        Self { multiplication: link(|x| x * a), addition: link(|x| x + a), peak: peak() }
    }
}

/// Seconds of a link of a chain.
fn link(next: impl Fn(f64) -> f64) -> f64 {
    let seconds = seconds(|| {
        black_box((0..MANY).fold(black_box(1.0), |x, _| next(x)));
    });
    seconds / MANY as f64
}

/// Additions and multiplications per second, by a sufficiently large product of faer's, which
/// fuses them.
fn peak() -> f64 {
    #[cfg(feature = "faer")]
    {
        use faer::linalg::matmul::matmul;
        use faer::{Accum, Mat, Par};
        const N: usize = 512;
        let a = Mat::<f64>::from_fn(N, N, |i, j| 1.0 / (1 + i + j) as f64);
        let mut out = a.clone();
        let seconds =
            seconds(|| matmul(&mut out, Accum::Replace, black_box(&a), &a, 1.0, Par::Seq));
        black_box(&out);
        (2 * N * N * N) as f64 / seconds
    }
    #[cfg(not(feature = "faer"))]
    f64::INFINITY
}

/// Seconds to allocate results of this number and size, to write and to free them.
pub(crate) fn fresh(count: usize, bytes: usize) -> f64 {
    seconds(|| {
        let results: Vec<Vec<f64>> = (0..count)
            .map(|_| {
                let mut result = vec![0.0; bytes / 8];
                black_box(&mut result).fill(1.0);
                result
            })
            .collect();
        black_box(&results);
    })
}
