//! Format of products of families.

use super::stored;
use crate::emission::Family;

stored! {
    [A: Family, B: Family] Product<A, B> in emission: [A, B], |product| {
        first: A = product.first(),
        second: B = product.second(),
    } => Self::new(first, second);
}
