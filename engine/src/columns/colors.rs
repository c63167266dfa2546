//! Base colours, linear and as displays take them.

use super::repeated::{Repeated, Rows};
use super::{Column, LANES, Lanes};
use crate::color::linear_to_srgb;

/// Linear colours. Where they are few they are kept display-encoded, too; others are encoded when they are drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Colors {
    linear: Repeated<3>,
    encoded: Encoded,
}

/// Colours as displays take them.
#[derive(Clone, Debug, Default, PartialEq)]
enum Encoded {
    #[default]
    Unknown,
    /// One that all splats have.
    One([Lanes; 3]),
    /// A row for each of the linear ones, with its number.
    Few(Box<Rows<3>>),
}

impl Colors {
    pub(crate) fn new(linear: Repeated<3>) -> Self {
        let encoded = match (&linear, linear.one()) {
            (_, Some(color)) => Encoded::One(color.map(|channel| [linear_to_srgb(channel); LANES])),
            (Repeated::Few { rows, .. }, _) => {
                Encoded::Few(Box::new(rows.map(|color| color.map(linear_to_srgb))))
            }
            _ => Encoded::Unknown,
        };
        Self { linear, encoded }
    }

    /// The linear colours, where each splat has its own.
    pub(crate) fn into_each(self) -> Column<3> {
        self.linear.into_each()
    }

    /// As [`Column::reorder`].
    pub(super) fn reorder(&mut self, order: &[u32], run: usize) {
        self.linear.reorder(order, run);
    }

    /// Linear colours: see [`Repeated::block`].
    #[inline(always)]
    pub(crate) fn block<'a>(&'a self, block: usize, room: &'a mut [Lanes; 3]) -> &'a [Lanes; 3] {
        self.linear.block(block, room)
    }

    /// Those of a block display-encoded, if they are there.
    #[inline(always)]
    pub(crate) fn encoded(&self, block: usize) -> Option<[Lanes; 3]> {
        match &self.encoded {
            Encoded::Unknown => None,
            Encoded::One(color) => Some(*color),
            Encoded::Few(rows) => self.linear.block_of(rows, block),
        }
    }

    /// Memory of the colours.
    pub(crate) fn bytes(&self) -> usize {
        let encoded = if let Encoded::Few(rows) = &self.encoded { size_of_val(&**rows) } else { 0 };
        self.linear.bytes() + encoded
    }

    /// The linear colour of one splat.
    pub(crate) fn row(&self, index: usize) -> [f32; 3] {
        self.linear.row(index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_encoded_where_they_are_few() {
        let colors = |count: usize| {
            let values = (0..5000).map(|i| (i * 7 % count) as f32 / 300.0);
            Colors::new(Repeated::new(values.collect(), |x| [*x, 1.0 - x, 2.0 * x]))
        };
        for (count, is_encoded) in [(1, true), (200, true), (299, false)] {
            let mut colors = colors(count);
            let turned: Vec<u32> =
                (0..5000).map(|i| if i < 4096 { 4095 - i } else { 903 - (i - 4096) }).collect();
            colors.reorder(&turned, 4096);
            for block in [0, 77, 624] {
                let linear = *colors.block(block, &mut Default::default());
                let encoded = is_encoded.then(|| linear.map(|row| row.map(linear_to_srgb)));
                assert_eq!(colors.encoded(block), encoded, "{count} colours, block {block}");
            }
        }
        assert_eq!(Colors::default().encoded(0), None);
    }
}
