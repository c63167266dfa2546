//! How splats were trained, as comments of a header tell it.

use super::header::Header;
use crate::Note;
use oblate_engine::OpacityFilter;

/// What comments say, the last one of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mode {
    /// What opacities were trained with.
    pub(crate) filter: Option<OpacityFilter>,
    /// Whether splats have no third half-axis.
    pub(crate) flat: Option<bool>,
}

impl Mode {
    /// What the comments say, and where they contradict one another.
    pub(crate) fn said(header: &Header) -> (Self, Option<Note>) {
        let mut all = Self::default();
        let mut contradiction = None;
        for (line, comment) in &header.comments {
            let Some(one) = Self::of_comment(comment) else { continue };
            let both_differ = differ(all.filter, one.filter) || differ(all.flat, one.flat);
            if both_differ {
                contradiction = Some(Note::Assumed(format!(
                    "comments contradict one another on how the splats were trained; {comment:?} in line {line} is \
                     the last one and counts"
                )));
            }
            all = Self { filter: one.filter.or(all.filter), flat: one.flat.or(all.flat) };
        }
        (all, contradiction)
    }

    fn of_comment(comment: &str) -> Option<Self> {
        use OpacityFilter::{Classic, Compensated};
        let comment = comment.to_ascii_lowercase();
        let words: Vec<&str> = comment.split_whitespace().collect();
        let (filter, flat) = match words[..] {
            ["splatrendermode:", "default"] => (Classic, Some(false)),
            ["splatrendermode:", "mip"] => (Compensated, Some(false)),
            ["splatrendermode:", "2dgs"] => (Classic, Some(true)),
            ["antialiased", "0"] => (Classic, None),
            ["antialiased", "1"] => (Compensated, None),
            _ => return None,
        };
        Some(Self { filter: Some(filter), flat })
    }
}

fn differ<T: PartialEq>(one: Option<T>, other: Option<T>) -> bool {
    one.is_some() && other.is_some() && one != other
}
