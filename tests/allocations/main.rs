//! Numbers of allocations, and peaks of memory. Each thread has its own counters, so that tests
//! may run side by side.

mod memory;
mod operators;
mod pruned;
mod scratch;
mod streams;

/// Number of allocations of this thread during a call.
fn allocations(work: impl FnOnce()) -> usize {
    allocation_counter::measure(work).count_total.try_into().unwrap()
}

/// Peak of this thread's memory during a call, beyond what it held before, in bytes.
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
