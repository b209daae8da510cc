//! How often memory is asked for, and how much of it is held. The counters count for
//! each thread by itself, so that tests may run beside each other.

mod memory;
mod operators;
mod pruned;
mod scratch;
mod streams;

/// How often this thread asks for memory meanwhile.
fn allocations(work: impl FnOnce()) -> usize {
    allocation_counter::measure(work).count_total.try_into().unwrap()
}

/// The most bytes that this thread holds meanwhile beyond those held before.
fn peak<R>(work: impl FnOnce() -> R) -> usize {
    let held = allocation_counter::measure(|| drop(std::hint::black_box(work()))).bytes_max;
    held.try_into().unwrap()
}

#[test]
fn the_counters_count() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![0_u8; 64]))), 1);
    assert_eq!(allocations(|| std::hint::black_box(vec![0_u8; 64]).reserve_exact(1)), 2);
    assert_eq!(peak(|| vec![0_u8; 4096]), 4096);
}
