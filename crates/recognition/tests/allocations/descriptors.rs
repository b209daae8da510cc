//! Distances that are written to memory of the caller allocate nothing.

use wayfix_recognition::observation::{Distance, ReferenceDescriptors};

use crate::allocations;
use wayfix_test_kit::noise;

#[test]
fn distances_into_memory_allocate_nothing() {
    let references = ReferenceDescriptors::new(600, noise(600 * 50, 1), Distance::Cosine).unwrap();
    let (queries, mut out) = (noise(600 * 20, 2), vec![0.0; 20 * 50]);
    let one = allocations(|| {
        references.distances_all_into(&queries[..600], &mut out[..50]).unwrap();
    });
    let many = allocations(|| references.distances_all_into(&queries, &mut out).unwrap());
    assert_eq!((one, many), (0, 0));
    assert!(allocations(|| drop(references.distances(&queries[..600]).unwrap())) > 0);
}
