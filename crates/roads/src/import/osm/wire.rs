//! Messages in the wire format of protocol buffers. Every length is checked against the bytes that
//! are left, so no input can cause a panic.

/// Problem of a number out of the range of valid extracts.
pub(super) const OUT_OF_RANGE: &str = "numbers out of their range";

/// Value of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    Number(u64),
    Bytes(&'a [u8]),
    /// A number of four or eight bytes, which extracts do not use.
    Fixed,
}

impl<'a> Value<'a> {
    pub(super) fn bytes(self) -> Result<&'a [u8], String> {
        match self {
            Self::Bytes(bytes) => Ok(bytes),
            _ => Err(String::from("a number, expected bytes")),
        }
    }

    pub(super) fn number(self) -> Result<u64, String> {
        match self {
            Self::Number(number) => Ok(number),
            _ => Err(String::from("bytes, expected a number")),
        }
    }

    /// Number stored with its sign in the lowest bit (zigzag).
    pub(super) fn signed(self) -> Result<i64, String> {
        self.number().map(signed)
    }

    /// Adds the numbers of a repeated field, packed or not.
    pub(super) fn add_to(self, numbers: &mut Vec<u64>) -> Result<(), String> {
        match self {
            Self::Bytes(mut rest) => {
                while !rest.is_empty() {
                    numbers.push(varint(&mut rest)?);
                }
                Ok(())
            }
            Self::Number(number) => {
                numbers.push(number);
                Ok(())
            }
            Self::Fixed => Err(String::from(OUT_OF_RANGE)),
        }
    }
}

/// Decodes a number whose sign is in its lowest bit: 0, −1, 1, −2, …
fn signed(number: u64) -> i64 {
    // The lowest bit becomes a mask of all bits. The result is number / 2 if the bit is 0, and the
    // complement, −(number + 1) / 2, if it is 1.
    (number >> 1).cast_signed() ^ -(number & 1).cast_signed()
}

/// Running sums of zigzag differences.
pub(super) fn sums(differences: &[u64]) -> impl Iterator<Item = Result<i64, String>> {
    let mut sum = 0_i64;
    differences.iter().map(move |&difference| {
        sum = sum.checked_add(signed(difference)).ok_or(OUT_OF_RANGE)?;
        Ok(sum)
    })
}

/// Calls `take` with the number and value of each field of a message.
pub(super) fn each_field<'a>(
    message: &'a [u8],
    mut take: impl FnMut(u64, Value<'a>) -> Result<(), String>,
) -> Result<(), String> {
    let mut rest = message;
    while !rest.is_empty() {
        let key = varint(&mut rest)?;
        // The lower three bits of a key are the wire type, the others the number of the field.
        let value = match key & 7 {
            0 => Value::Number(varint(&mut rest)?),
            2 => {
                let length = varint(&mut rest)?;
                Value::Bytes(split(&mut rest, length)?)
            }
            kind @ (1 | 5) => {
                split(&mut rest, if kind == 1 { 8 } else { 4 })?;
                Value::Fixed
            }
            _ => return Err(String::from("a field of unknown type")),
        };
        take(key >> 3, value)?;
    }
    Ok(())
}

/// Takes `length` bytes from the front.
fn split<'a>(rest: &mut &'a [u8], length: u64) -> Result<&'a [u8], String> {
    let parts = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length));
    let (bytes, after) = parts
        .ok_or_else(|| format!("a field of {length} bytes, but only {} are left", rest.len()))?;
    *rest = after;
    Ok(bytes)
}

/// Takes a number from the front: seven bits per byte, lowest first, with the highest bit set if
/// more follow.
fn varint(rest: &mut &[u8]) -> Result<u64, String> {
    // Nine bytes hold 63 bits; the tenth may only hold the 64th.
    let length = rest.iter().take(10).position(|byte| byte & 0x80 == 0);
    let (bytes, after) = match length {
        Some(9) if rest[9] > 1 => return Err(String::from(OUT_OF_RANGE)),
        Some(last) => rest.split_at(last + 1),
        None if rest.len() < 10 => return Err(String::from("a truncated number")),
        None => return Err(String::from(OUT_OF_RANGE)),
    };
    *rest = after;
    let seven = |byte: &u8| u64::from(byte & 0x7f);
    Ok(bytes.iter().rev().fold(0, |number, byte| number << 7 | seven(byte)))
}

#[cfg(test)]
mod tests {
    use super::{Value, each_field, signed, sums, varint};

    fn fields(message: &[u8]) -> Result<Vec<(u64, Value<'_>)>, String> {
        let mut fields = Vec::new();
        each_field(message, |number, value| {
            fields.push((number, value));
            Ok(())
        })?;
        Ok(fields)
    }

    #[test]
    fn numbers() {
        let most = [255, 255, 255, 255, 255, 255, 255, 255, 255, 1];
        for (bytes, number) in
            [(&[0][..], 0), (&[127], 127), (&[128, 1], 128), (&[128, 128, 0], 0), (&most, u64::MAX)]
        {
            let mut rest = bytes;
            assert_eq!((varint(&mut rest), rest), (Ok(number), &[][..]));
        }
        let mut beyond = most;
        beyond[9] = 2;
        for bytes in [&[][..], &[128], &[255; 9], &[255; 10], &[128; 11], &beyond] {
            assert!(varint(&mut &*bytes).is_err(), "{bytes:?}");
        }
        let signs = [0, 1, 2, 3, u64::MAX - 1, u64::MAX].map(signed);
        assert_eq!(signs, [0, -1, 1, -2, i64::MAX, i64::MIN]);
        let added: Result<Vec<i64>, _> = sums(&[4, 1, 6]).collect();
        assert_eq!(added.unwrap(), [2, 1, 4]);
        assert!(sums(&[u64::MAX - 1, 2]).last().unwrap().is_err());
    }

    #[test]
    fn messages() {
        assert_eq!(fields(&[]), Ok(vec![]));
        let message = [8, 150, 1, 18, 2, 7, 8, 29, 1, 2, 3, 4, 33, 1, 2, 3, 4, 5, 6, 7, 8];
        let found = fields(&message).unwrap();
        let expected = [
            (1, Value::Number(150)),
            (2, Value::Bytes(&[7, 8])),
            (3, Value::Fixed),
            (4, Value::Fixed),
        ];
        assert_eq!(found, expected);
        for message in [&[8][..], &[18, 3, 7, 8], &[29, 1], &[33, 1], &[11], &[12], &[14], &[15]] {
            assert!(fields(message).is_err(), "{message:?}");
        }
        let huge = [18, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1];
        assert_eq!(
            fields(&huge).unwrap_err(),
            "a field of 18446744073709551615 bytes, but only 0 are left"
        );
        let mut numbers = Vec::new();
        for value in [Value::Bytes(&[1, 128, 1]), Value::Number(5), Value::Bytes(&[])] {
            value.add_to(&mut numbers).unwrap();
        }
        assert_eq!(numbers, [1, 128, 5]);
        assert!(Value::Bytes(&[128]).add_to(&mut numbers).is_err());
    }
}
