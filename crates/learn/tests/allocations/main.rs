//! How often memory is asked for. The counters count for each thread by itself, so that tests may
//! run beside each other.

mod emission;
mod operators;

/// How often this thread asks for memory meanwhile.
fn allocations(work: impl FnOnce()) -> usize {
    allocation_counter::measure(work).count_total.try_into().unwrap()
}

#[test]
fn the_counters_count() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![0_u8; 64]))), 1);
    assert_eq!(allocations(|| std::hint::black_box(vec![0_u8; 64]).reserve_exact(1)), 2);
}
