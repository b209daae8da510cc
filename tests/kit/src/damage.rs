//! Damaged files.

use proptest::prelude::*;

/// Damage to a text: at some position, a character is removed or replaced, or a number is replaced.
#[derive(Debug, Clone)]
pub enum Damage {
    Remove(usize),
    Put(usize, char),
    Number(usize, &'static str),
}

pub fn damage() -> impl Strategy<Value = Damage> {
    let characters = proptest::sample::select("0123456789.-e[]{},:\"n".chars().collect::<Vec<_>>());
    let numbers = proptest::sample::select(vec![
        "-1",
        "0",
        "2",
        "0.1",
        "-0.0",
        "1e308",
        "1e999",
        "null",
        "NaN",
        "4294967295",
        "\"1\"",
        "9007199254740993",
        "18446744073709551615",
        "-9223372036854775808",
        "[]",
        "5e-324",
    ]);
    prop_oneof![
        1 => any::<usize>().prop_map(Damage::Remove),
        1 => (any::<usize>(), characters).prop_map(|(at, c)| Damage::Put(at, c)),
        4 => (any::<usize>(), numbers).prop_map(|(at, number)| Damage::Number(at, number)),
    ]
}

impl Damage {
    pub fn of(&self, text: &str) -> String {
        let numeric = |c: char| c.is_ascii_digit() || "+-.eE".contains(c);
        match self {
            Self::Remove(at) => {
                let at = at % text.len();
                [&text[..at], &text[at + 1..]].concat()
            }
            Self::Put(at, c) => {
                let at = at % text.len();
                [&text[..at], &c.to_string(), &text[at + 1..]].concat()
            }
            Self::Number(at, number) => {
                let starts: Vec<usize> = text
                    .char_indices()
                    .filter(|(at, c)| {
                        (c.is_ascii_digit() || *c == '-') && "[,:".contains(&text[at - 1..*at])
                    })
                    .map(|start| start.0)
                    .collect();
                // A text without a number stays as it is.
                let Some(at) = at.checked_rem(starts.len()) else { return text.to_owned() };
                let start = starts[at];
                let rest = text[start..].trim_start_matches(numeric);
                [&text[..start], number, rest].concat()
            }
        }
    }
}
