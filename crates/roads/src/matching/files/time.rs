//! Times of points, as numbers or as dates and times.

use std::ops::RangeInclusive;

/// Valid times of files, in words.
pub(super) const TIMES: &str = "seconds, or a date and time as 2024-05-01T12:00:00Z";

/// Parses a time in seconds: a number, or a date and time in RFC 3339 as seconds since 1970.
///
/// As in files in the wild, a space may stand for the T and a comma for the point, and seconds may
/// be missing; without an offset, the time is UTC. A leap second is read as the first second of the
/// next minute. Digits beyond the 18th of a fraction are ignored: a double cannot hold them.
pub(super) fn seconds_of(text: &str) -> Option<f64> {
    text.parse().ok().or_else(|| date_and_time(&mut Rest(text.as_bytes())))
}

fn date_and_time(rest: &mut Rest<'_>) -> Option<f64> {
    let year = rest.digits(4, 0..=9999)?;
    rest.one_of(b"-")?;
    let month = rest.digits(2, 1..=12)?;
    rest.one_of(b"-")?;
    let day = rest.digits(2, 1..=days_of(year, month))?;
    rest.one_of(b"Tt ")?;
    let hour = rest.digits(2, 0..=23)?;
    rest.one_of(b":")?;
    let minute = rest.digits(2, 0..=59)?;
    let (mut second, mut fraction) = (0, 0.0);
    if rest.one_of(b":").is_some() {
        second = rest.digits(2, 0..=60)?;
        if rest.one_of(b".,").is_some() {
            fraction = rest.fraction()?;
        }
    }
    let ahead = rest.offset()?;
    // In integers, so only the fraction is rounded.
    let minutes = ((day_number(year, month, day) * 24 + hour) * 60) + minute - ahead;
    rest.0.is_empty().then(|| (minutes * 60 + second) as f64 + fraction)
}

/// Text left to read.
struct Rest<'a>(&'a [u8]);

impl Rest<'_> {
    /// Reads the next character if it is one of those given.
    fn one_of(&mut self, characters: &[u8]) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        characters.contains(first).then(|| {
            self.0 = rest;
            *first
        })
    }

    fn digit(&mut self) -> Option<i64> {
        self.one_of(b"0123456789").map(|digit| i64::from(digit - b'0'))
    }

    /// Reads a number of exactly `count` digits.
    fn digits(&mut self, count: usize, range: RangeInclusive<i64>) -> Option<i64> {
        let number = (0..count).try_fold(0, |number, _| Some(10 * number + self.digit()?))?;
        range.contains(&number).then_some(number)
    }

    /// Reads the digits after the decimal point.
    fn fraction(&mut self) -> Option<f64> {
        let (mut number, mut unit) = (self.digit()?, 10_i64);
        while let Some(digit) = self.digit() {
            // Digits beyond the 18th are read but ignored, so neither integer overflows.
            if unit < 1_000_000_000_000_000_000 {
                (number, unit) = (10 * number + digit, 10 * unit);
            }
        }
        Some(number as f64 / unit as f64)
    }

    /// Reads the minutes by which local time is ahead of UTC.
    fn offset(&mut self) -> Option<i64> {
        if self.0.is_empty() || self.one_of(b"Zz").is_some() {
            return Some(0);
        }
        let sign = if self.one_of(b"+-")? == b'-' { -1 } else { 1 };
        let hours = self.digits(2, 0..=23)?;
        let colon = self.one_of(b":").is_some();
        let minutes = if colon || !self.0.is_empty() { self.digits(2, 0..=59)? } else { 0 };
        Some(sign * (60 * hours + minutes))
    }
}

fn days_of(year: i64, month: i64) -> i64 {
    match month {
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Days since 1970-01-01 in the Gregorian calendar. Years are counted from March, so that a leap
/// day is the last day of its year.
fn day_number(year: i64, month: i64, day: i64) -> i64 {
    let year = if month < 3 { year - 1 } else { year };
    // Months since March. (153 m + 2) / 5 is the number of days before the m-th: five months from
    // March have 31 + 30 + 31 + 30 + 31 = 153 days, and the pattern repeats.
    let months = (month + 9) % 12;
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leap_days + (153 * months + 2) / 5 + day - 719_469
}

#[cfg(test)]
mod tests {
    use super::seconds_of;

    #[test]
    fn numbers_and_dates() {
        for (text, seconds) in [
            ("12.5", 12.5),
            ("-1e3", -1000.0),
            ("1970-01-01T00:00:00Z", 0.0),
            ("1969-12-31T23:59:59.25Z", -0.75),
            ("2000-02-29T00:00:00Z", 951_782_400.0),
            ("2024-05-01T12:00:00Z", 1_714_564_800.0),
            ("2024-05-01t12:00:00z", 1_714_564_800.0),
            ("2024-05-01 12:00:00", 1_714_564_800.0),
            ("2024-05-01 12:00", 1_714_564_800.0),
            ("2024-05-01T12:00Z", 1_714_564_800.0),
            ("2024-05-01T14:00:00+02:00", 1_714_564_800.0),
            ("2024-05-01T14:00:00+0200", 1_714_564_800.0),
            ("2024-05-01T14:00:00+02", 1_714_564_800.0),
            ("2024-05-01T06:30:00-05:30", 1_714_564_800.0),
            ("2024-05-01T12:00:00.125Z", 1_714_564_800.125),
            ("2024-05-01T12:00:00,5+00:00", 1_714_564_800.5),
            ("2024-05-01T12:00:00.50000000000000000000000000000", 1_714_564_800.5),
            ("2016-12-31T23:59:60Z", 1_483_228_800.0),
            ("2024-12-31T23:59:59Z", 1_735_689_599.0),
            ("0000-01-01T00:00:00Z", -62_167_219_200.0),
            ("9999-12-31T23:59:59Z", 253_402_300_799.0),
        ] {
            assert_eq!(seconds_of(text), Some(seconds), "{text}");
        }
    }

    #[test]
    fn neither() {
        for text in [
            "",
            "noon",
            "2024-05-01",
            "2024-05-01T",
            "2024-05-01T12",
            "2024-13-01T12:00:00Z",
            "2024-00-01T12:00:00Z",
            "2023-02-29T12:00:00Z",
            "1900-02-29T12:00:00Z",
            "2024-05-00T12:00:00Z",
            "2024-05-01T24:00:00Z",
            "2024-05-01T12:60:00Z",
            "2024-05-01T12:00:61Z",
            "2024-05-01T12:00:00.Z",
            "2024-05-01T12:00:00Zulu",
            "2024-05-01T12:00:00+2",
            "2024-05-01T12:00:00+02:",
            "2024-05-01T12:00:00+24:00",
            "2024-05-01  12:00:00",
            "24-05-01T12:00:00Z",
            "+2024-05-01T12:00:00Z",
            "2024-05-01T12:00:00Ä",
            "01/05/2024 12:00",
        ] {
            assert_eq!(seconds_of(text), None, "{text}");
        }
    }

    /// Day numbers are consecutive over four centuries.
    #[test]
    fn every_day() {
        let mut before = None;
        for year in 1900..2301 {
            for month in 1..13 {
                for day in 1..=super::days_of(year, month) {
                    let number = super::day_number(year, month, day);
                    assert!(before.is_none_or(|before| number == before + 1));
                    before = Some(number);
                }
            }
        }
    }
}
