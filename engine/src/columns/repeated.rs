//! Numbers that many splats have in common.

use super::{BLOCKS_A_TASK, Column, LANES, Lanes, blocks, reorder};
use foldhash::fast::FixedState;
use rayon::prelude::*;
use std::collections::HashMap;

/// As [`Column`], of numbers that may be the same for many splats.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Repeated<const N: usize> {
    Each(Column<N>),
    /// Which of a few rows each splat has, as in a volume of bytes.
    Few {
        rows: Box<Rows<N>>,
        numbers: Vec<[[u8; LANES]; 1]>,
    },
}

/// As many rows as a byte can number.
const MOST: usize = 1 << u8::BITS;

/// As many rows; those without a number are not used.
pub(super) type Rows<const N: usize> = [[f32; N]; MOST];

/// As many splats have few rows, at least: with fewer a table is no gain.
const WORTH_A_TABLE: usize = 16 * MOST;

/// Rows by their [`bits`], and the number of each.
type Table = HashMap<u128, u8, FixedState>;

impl<const N: usize> Default for Repeated<N> {
    fn default() -> Self {
        Self::Each(Column::default())
    }
}

impl<const N: usize> Repeated<N> {
    /// The column, if there is one.
    pub(crate) fn into_each(self) -> Column<N> {
        match self {
            Self::Each(column) => column,
            Self::Few { .. } => Column::default(),
        }
    }

    /// As [`Column::new`].
    pub(crate) fn new<T: Sync>(values: Vec<T>, row: impl Fn(&T) -> [f32; N] + Sync) -> Self {
        let Some(table) = table(&values, |value| bits(row(value))) else {
            return Self::Each(Column::new(values, row));
        };
        if table.len() == 1 {
            return Self::Each(Column::alike(values.len(), row(&values[0])));
        }
        let mut rows = Box::new([[0.0; N]; MOST]);
        for (bits, number) in &table {
            rows[usize::from(*number)] = std::array::from_fn(|i| f32::from_bits((bits >> (32 * i)) as u32));
        }
        Self::Few { rows, numbers: blocks(&values, |value| [table[&bits(row(value))]]) }
    }

    /// As [`Column::reorder`].
    pub(super) fn reorder(&mut self, order: &[u32], run: usize) {
        match self {
            Self::Each(column) => column.reorder(order, run),
            Self::Few { numbers, .. } => reorder(numbers, order, run),
        }
    }

    /// As [`Column::block`]; there is room for what must be made.
    #[inline(always)]
    pub(crate) fn block<'a>(&'a self, block: usize, room: &'a mut [Lanes; N]) -> &'a [Lanes; N] {
        match self {
            Self::Each(column) => column.block(block),
            Self::Few { rows, numbers } => {
                *room = numbered(rows, numbers[block][0]);
                room
            }
        }
    }

    /// The row that all splats have, if there is one.
    pub(super) fn one(&self) -> Option<[f32; N]> {
        matches!(self, Self::Each(column) if column.is_one()).then(|| self.row(0))
    }

    /// The largest of all numbers, at least 0.
    pub(crate) fn largest(&self) -> f32 {
        match self {
            Self::Each(column) => column.largest(),
            // Rows without a number are 0.
            Self::Few { rows, .. } => rows.iter().flatten().copied().fold(0.0, f32::max),
        }
    }

    /// Those of a block from other rows that have the same numbers.
    #[inline(always)]
    pub(super) fn block_of(&self, rows: &Rows<N>, block: usize) -> Option<[Lanes; N]> {
        if let Self::Few { numbers, .. } = self { Some(numbered(rows, numbers[block][0])) } else { None }
    }

    /// Memory of the numbers.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Each(column) => column.bytes(),
            Self::Few { rows, numbers } => size_of_val(&**rows) + size_of_val(&numbers[..]),
        }
    }

    /// The numbers of one splat.
    pub(crate) fn row(&self, index: usize) -> [f32; N] {
        match self {
            Self::Each(column) => column.row(index),
            Self::Few { rows, numbers } => rows[usize::from(numbers[index / LANES][0][index % LANES])],
        }
    }
}

/// Rows by their numbers.
#[inline(always)]
fn numbered<const N: usize>(rows: &Rows<N>, numbers: [u8; LANES]) -> [Lanes; N] {
    let mut found = [[0.0; LANES]; N];
    for (lane, number) in numbers.into_iter().enumerate() {
        for (found, own) in found.iter_mut().zip(rows[usize::from(number)]) {
            found[lane] = own;
        }
    }
    found
}

/// The bits of a row of up to four numbers.
fn bits<const N: usize>(row: [f32; N]) -> u128 {
    const { assert!(N <= 4) };
    row.iter().rev().fold(0, |bits, number| bits << 32 | u128::from(number.to_bits()))
}

/// The different rows of values, where there are few.
fn table<T: Sync>(values: &[T], bits: impl Fn(&T) -> u128 + Sync) -> Option<Table> {
    let distinct = |values: &[T]| {
        let (mut found, mut last) = (Table::default(), None);
        for own in values.iter().map(&bits) {
            if last.replace(own) != Some(own) && found.insert(own, 0).is_none() && found.len() > MOST {
                return None;
            }
        }
        Some(found)
    };
    // Most often the first ones tell.
    distinct(values.get(..WORTH_A_TABLE)?)?;
    let union = |mut a: Table, b: Table| {
        a.extend(b);
        (a.len() <= MOST).then_some(a)
    };
    let parts = values.par_chunks(BLOCKS_A_TASK * LANES).map(distinct);
    let mut table = parts.try_reduce(Table::default, union)?;
    let mut rows: Vec<_> = table.iter_mut().collect();
    rows.sort_unstable_by_key(|(bits, _)| **bits);
    for (number, (_, own)) in (0..=u8::MAX).zip(rows) {
        *own = number;
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_out_as_they_went_in() {
        for (count, different) in [
            (9, 3),
            (WORTH_A_TABLE, 1),
            (WORTH_A_TABLE + 3, 2),
            (5 * WORTH_A_TABLE + 1, MOST),
            (5 * WORTH_A_TABLE, MOST + 1),
        ] {
            // The last of the different rows comes late, and one of two zeros is negative.
            let number =
                |i: usize| if i == count - 1 { different - 1 } else { i * 7 % (different - 1).max(1) };
            let row = |i: usize| if number(i) == 0 { [-0.0, 0.0] } else { [number(i) as f32, 0.5] };
            let mut column = Repeated::new((0..count).collect(), |i| row(*i));
            let is_table = count >= WORTH_A_TABLE && (2..=MOST).contains(&different);
            assert_eq!(matches!(column, Repeated::Few { .. }), is_table, "{count} splats, {different} rows");
            let as_given = |column: &Repeated<2>, expected: &dyn Fn(usize) -> [f32; 2]| {
                for i in 0..count {
                    let mut room = Default::default();
                    let block = column.block(i / LANES, &mut room).map(|lanes| lanes[i % LANES]);
                    assert_eq!(bits(block), bits(expected(i)), "{count} splats, {different} rows: {i}");
                    assert_eq!(bits(column.row(i)), bits(expected(i)));
                }
            };
            as_given(&column, &row);
            let run = 2 * LANES;
            let turned = |i: usize| (i % run) ^ usize::from((i ^ 1) < count);
            let order: Vec<u32> = (0..count).map(|i| turned(i) as u32).collect();
            column.reorder(&order, run);
            as_given(&column, &|i| row(i - i % run + turned(i)));
        }
    }
}
