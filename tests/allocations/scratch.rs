//! Scratch memory for a user's own operators.

use wayfix::transition::kit::with_scratch;

use crate::allocations;

/// Fills a buffer and others nested within it, and checks that each kept its values.
fn nested(depth: usize, count: usize) -> f64 {
    with_scratch(count, |own| {
        assert_eq!(own.len(), count);
        own.fill(depth as f64);
        let within = if depth > 0 { nested(depth - 1, count + 3) } else { 0.0 };
        assert!(own.iter().all(|&x| x == depth as f64), "another one has written into it");
        own.iter().sum::<f64>() + within
    })
}

#[test]
fn scratch_is_allocated_once_however_it_nests() {
    let expected: usize = (0..4).map(|depth| depth * (10 + 3 * (3 - depth))).sum();
    assert_eq!(nested(3, 10), expected as f64);
    let again = allocations(|| {
        for _ in 0..100 {
            assert_eq!(nested(3, 10), expected as f64);
            assert_eq!(with_scratch(5, |x| x.len()), 5);
        }
    });
    assert_eq!(again, 0);
    assert_eq!(with_scratch(0, |x| x.len()), 0);
}
