//! Logarithms, sums, memory, and parts for several threads.

use super::{ZERO_SCORE, everywhere};
use crate::layout::{Arrangement, Sliced};
use crate::limits::LIFT;
use crate::simd::{PART, Splits, in_turn, run_in_parts};
use crate::vector::{Aligned, LARGE, LINE, in_large_pages};
use crate::*;

#[test]
fn log2_is_right_and_adds_one_for_a_doubling() {
    assert_eq!(log2(0.0), ZERO_SCORE);
    assert!([-1.0, f64::NAN, f64::INFINITY].iter().all(|&x| log2(x).is_nan()));
    let is_on_grid = |x: f64| (x * (1_u64 << 45) as f64).fract() == 0.0;
    assert!((1..20_000).all(|i| is_on_grid(on_grid(f64::from(i) * -0.013_7))));
    let fixed = [1.0, 0.75, 0.1, 1.0 / 3.0, 1.999_999, 1e-300, 5e-324, f64::MAX];
    let many = (1..3000).map(|i| f64::from(i) * 0.000_7);
    for x in fixed.into_iter().chain(many) {
        // The grid is 2.8e-14 wide.
        assert!((log2(x) - x.log2()).abs() <= 1.5e-14 + x.log2().abs() * 1e-15, "{x}");
        for halvings in 1..60 {
            let halved = x * 0.5_f64.powi(halvings);
            if halved.is_normal() {
                assert_eq!(log2(halved), log2(x) - f64::from(halvings), "{halved}");
            }
        }
        let all = everywhere(|| {
            let mut values = vec![x, 0.0, 1.0, 5e-324, x, x, x, x, x];
            log2_in_place(&mut values);
            values
        });
        assert_eq!(all[..4], [log2(x), ZERO_SCORE, 0.0, -1074.0]);
        assert!(all[4..].iter().all(|log| *log == log2(x)));
    }
}

#[test]
fn sums_and_memory_of_every_length() {
    for n in 0..40_usize {
        let x: Vec<f64> = (1..=n).map(|i| i as f64).collect();
        assert_eq!(sum(&x), (n * (n + 1) / 2) as f64);
        assert_eq!(dot(&x, &vec![2.0; n]), (n * (n + 1)) as f64);
        let mut aligned = Aligned::new(n, 2.0);
        aligned.copy_from_slice(&x);
        let copy = aligned.clone();
        assert_eq!(copy[..], x);
        assert!([&aligned, &copy].iter().all(|v| v.as_ptr().addr() % LINE == 0));
    }
    for count in [0, 1, 1000, LARGE / 8, 3 * LARGE / 8 + 5] {
        let mut vec = in_large_pages(vec![1.5; count]);
        assert_eq!(vec, vec![1.5; count]);
        vec.push(2.5);
        assert_eq!(vec.iter().sum::<f64>(), 1.5 * count as f64 + 2.5);
    }
}

/// Neither a multiple of eight nor of parts; neighbours, some distant entries, a few long lines.
#[test]
fn parts_give_the_result_of_all_lines_at_once() {
    const N: usize = 4 * PART + 1003;
    let values =
        |factor: f64| -> Vec<f64> { (1..=N).map(|i| (i as f64 * factor).fract()).collect() };
    let (x, b) = (values(0.618_033_988_7), values(0.414_213_562_3));
    let line = |i: usize| {
        let far = i.is_multiple_of(5).then_some((i * 7919) % N);
        let many = (0..if i.is_multiple_of(1009) { 40 } else { 0 }).map(|k| (i + 50 * k) % N);
        let near = [i, (i + 1) % N];
        let mut line: Vec<u32> =
            near.into_iter().chain(far).chain(many).map(|j| j as u32).collect();
        line.sort_unstable();
        line.dedup();
        let values = line.iter().map(|j| f64::from(j % 13) + 1.0).collect();
        (line, values)
    };
    let lines: Vec<(Vec<u32>, Vec<f64>)> = (0..N).map(line).collect();
    // By arrangement, as `Sliced::new` chooses one: both must give the bits of the other, in parts.
    let [grouped, matrix] = [Arrangement::Groups, Arrangement::Slices].map(|arrangement| {
        Sliced::arranged(arrangement, N, |i| (&lines[i].0[..], &lines[i].1[..]))
    });
    let mut outs = [vec![f64::NAN; N], vec![f64::NAN; N], vec![f64::NAN; N], vec![f64::NAN; N]];
    let [parts, whole, turn, groups] = outs.each_mut();
    let step = |matrix, out| {
        let (prediction, likelihoods) = (SparseRows::all(matrix, &x), &b[..]);
        ForwardRows { prediction, lift: LIFT, likelihoods, watch: Watch::Products, out }
    };
    let sums = [
        run_in_parts(step(&matrix, parts)),
        run(step(&matrix, whole)),
        in_turn(step(&matrix, turn)),
        run_in_parts(step(&grouped, groups)),
    ];
    let [parts, whole, turn, groups] = outs;
    let (parts, whole) = ((parts, sums[0]), (whole, sums[1]));
    assert_eq!((&turn, sums[2]), (&parts.0, sums[0])); // threads do not change a bit
    assert_eq!((&groups, sums[3]), (&parts.0, sums[0])); // nor do groups
    assert_eq!(parts.0, whole.0);
    assert!((parts.1.products - whole.1.products).abs() <= 1e-12 * whole.1.products);
    assert_eq!(ForwardSums { products: parts.1.products, ..whole.1 }, parts.1);
    for (i, (indices, values)) in lines.iter().enumerate().step_by(7) {
        let sum: f64 = indices.iter().zip(values).map(|(&j, a)| a * x[j as usize]).sum();
        assert!((sum * b[i] - parts.0[i]).abs() <= 1e-13 * sum);
    }
    for tiny in [None, Some(0), Some(PART - 1), Some(PART), Some(N - 1)] {
        let mut x = vec![0.5; N];
        tiny.into_iter().for_each(|at| x[at] = 1e-280);
        let kernel = Normalize::<false> { x: &mut x, out: &mut [], sum: 0.5 };
        assert_eq!(kernel.lines(), N);
        assert_eq!(run_in_parts(kernel), tiny.is_some());
        assert_eq!(x[N - 1], if tiny == Some(N - 1) { 2e-280 } else { 1.0 });
    }
}
