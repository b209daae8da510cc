//! Parts of files as error messages quote them.

use std::borrow::Cow;

/// Most characters of a field that an error message quotes.
const LONGEST: usize = 60;

/// Returns a field, cut to the length that error messages quote.
pub(crate) fn excerpt(field: &str) -> Cow<'_, str> {
    shortened(field, LONGEST)
}

/// Returns a text, cut to so many characters.
pub(crate) fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        Some((end, _)) => Cow::Owned(format!("{}…", &text[..end])),
        None => Cow::Borrowed(text),
    }
}
