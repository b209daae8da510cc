//! What the sibling crates of this workspace share with the core. No promise of stability.

pub use crate::belief::SUM_TOLERANCE;
pub use crate::error::Number;
pub use crate::files::{FileError, excerpt, open, shortened, text_of};
#[cfg(feature = "csv")]
pub use crate::files::{Row, Text, each_row, unknown};
pub use crate::free_parameters::{ParameterScale, cholesky};
pub use crate::inference::engines::parallel;
pub use crate::inference::{LogSum, MOST_STEPS, Scale, TrellisForward, left_out};
pub use crate::likelihood::{product_of, shares};
pub use crate::map::{Label, Places, Search, balance, check_position, components, wrapped};
pub use crate::random::index;
pub use crate::reorder::positions;
#[cfg(feature = "serde")]
pub use crate::stored::{Version, refused};
pub use crate::transition::{Compressed, NoControl, buffers, log, refuse_evidence, validate_with};
