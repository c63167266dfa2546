//! LZF, by which PCD files are compressed.
//!
//! A control byte below 32 is followed by one literal byte more than it says. Otherwise its three high bits (and, where those are 7, the next
//! byte) are 2 less than the length of a copy, its low bits and the byte that follows 1 less than how far back it begins.
//! Source: Lehmann, *LibLZF*, 2000.

/// A copy has at most 264 bytes and takes 3.
const MOST_EXPANSION: usize = 88;

/// Exactly `expected` bytes.
pub(super) fn unpack(compressed: &[u8], expected: usize) -> Result<Vec<u8>, String> {
    if expected / MOST_EXPANSION > compressed.len() {
        return Err(format!(
            "{} compressed bytes cannot hold the {expected} that are expected",
            compressed.len()
        ));
    }
    let mut bytes = Vec::with_capacity(expected);
    let mut rest = compressed;
    let ends = || "the compressed data end in the middle of a copy".to_owned();
    let room = |length: usize, bytes: &[u8]| {
        let more = || format!("decompressed to more than the {expected} bytes that are expected");
        if length <= expected - bytes.len() { Ok(()) } else { Err(more()) }
    };
    while let Some((&control, after)) = rest.split_first() {
        rest = after;
        let control = usize::from(control);
        if control < 32 {
            let (literals, after) = rest.split_at_checked(control + 1).ok_or_else(ends)?;
            room(literals.len(), &bytes)?;
            bytes.extend_from_slice(literals);
            rest = after;
        } else {
            let mut next = || {
                let (&byte, after) = rest.split_first().ok_or_else(ends)?;
                rest = after;
                Ok::<_, String>(usize::from(byte))
            };
            let length = 2 + match control >> 5 {
                7 => 7 + next()?,
                short => short,
            };
            let back = 1 + ((control & 31) << 8) + next()?;
            let from = bytes.len().checked_sub(back);
            let from =
                from.ok_or_else(|| format!("a copy begins {back} bytes back, after {} bytes", bytes.len()))?;
            room(length, &bytes)?;
            // Copies may overlap what they make.
            for at in from..from + length {
                bytes.push(bytes[at]);
            }
        }
    }
    match bytes.len() {
        found if found == expected => Ok(bytes),
        found => Err(format!("decompressed to {found} bytes; {expected} are expected")),
    }
}

#[cfg(test)]
mod tests {
    use super::unpack;

    #[test]
    fn literals_and_copies() {
        // "abc", then 5 bytes from 3 back, then 9 + 2 + 7 from 1 back.
        let packed = [2, b'a', b'b', b'c', 3 << 5, 2, 7 << 5, 9, 0];
        let expected = [&b"abcabcab"[..], &[b'b'; 18]].concat();
        assert_eq!(unpack(&packed, 26).unwrap(), expected);
        // The farthest back: 8192.
        let literals: Vec<u8> = (0..256).flat_map(|i| [vec![31], vec![i as u8; 32]].concat()).collect();
        let packed = [literals, vec![(1 << 5) | 31, 255]].concat();
        assert!(unpack(&packed, 8195).unwrap().ends_with(&[255, 0, 0, 0]));
    }

    #[test]
    fn what_is_broken() {
        let refuse = |packed: &[u8], expected, message: &str| {
            let found = unpack(packed, expected).unwrap_err();
            assert!(found.contains(message), "{found}");
        };
        refuse(&[2, b'a'], 3, "end in the middle");
        refuse(&[0, b'a', 7 << 5], 30, "end in the middle");
        refuse(&[0, b'a', 1 << 5, 1], 4, "begins 2 bytes back, after 1 bytes");
        refuse(&[0, b'a'], 2, "decompressed to 1 bytes; 2 are expected");
        refuse(&[1, b'a', b'a'], 1, "more than the 1 bytes");
        refuse(&[0, b'a', 7 << 5, 255, 0], 10, "more than the 10 bytes");
        refuse(&[0, b'a', 0, b'a'], 1, "more than the 1 bytes");
        refuse(&[0, b'a'], 1 << 40, "cannot hold");
    }
}
