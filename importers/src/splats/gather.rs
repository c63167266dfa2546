//! Records to splats, in parallel, each number in memory once.

use super::trained::{Reject, Trained};
use crate::file::File;
use crate::{Content, ImportError, Note, Opened, Place};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{Blend, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that are read at a time, where rows can be found without reading those before.
pub(crate) const ROWS: usize = 1 << 14;

/// How splats were trained.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Training {
    /// The highest degree of harmonics, from 0 to 3.
    pub(crate) degree: u8,
    pub(crate) filter: OpacityFilter,
    pub(crate) blend: Blend,
}

impl Training {
    /// Harmonics of a splat.
    pub(crate) fn per_splat(self) -> usize {
        (usize::from(self.degree) + 1).pow(2) - 1
    }

    /// Memory that a splat takes: centre, shape, opacity and colours.
    pub(crate) fn bytes_per_splat(self) -> u64 {
        (size_of::<Vec3>()
            + size_of::<Mat3>()
            + size_of::<f32>()
            + size_of::<[f32; 3]>() * (1 + self.per_splat())) as u64
    }
}

/// Where a reader puts records: splats of some consecutive rows.
pub(crate) struct Sink<'a> {
    next: usize,
    first_row: usize,
    centers: &'a mut [Vec3],
    factors: &'a mut [Mat3],
    peaks: &'a mut [f32],
    colors: &'a mut [[f32; 3]],
    harmonics: &'a mut [[f32; 3]],
    rejected: Vec<(usize, Reject)>,
}

impl Sink<'_> {
    /// Puts the next row's splat to its place, or notes why it is none; whether it is one.
    pub(crate) fn put(&mut self, record: &Trained) -> bool {
        let index = self.next;
        self.next += 1;
        let per_splat = self.harmonics.len() / self.centers.len();
        match record.activate(per_splat) {
            Err(reject) => {
                self.rejected.push((self.first_row + index, reject));
                false
            }
            Ok(splat) => {
                self.centers[index] = splat.center;
                self.factors[index] = splat.factor;
                self.peaks[index] = splat.peak;
                self.colors[index] = splat.color;
                self.harmonics[index * per_splat..][..per_splat]
                    .copy_from_slice(&record.harmonics[..per_splat]);
                true
            }
        }
    }
}

/// Makes splats, in Morton order, of `count` rows that `read` puts to sinks, parts of `rows` rows at the same time.
///
/// `count` must have been compared with the size of the file: memory for all is taken at once. `read` puts each row of
/// its range, in order.
pub(crate) fn gather(
    file: &File,
    (count, rows): (usize, usize),
    training: Training,
    read: impl Fn(Range<usize>, &mut Sink<'_>) -> Result<(), ImportError> + Sync,
) -> Result<Opened, ImportError> {
    let per_splat = training.per_splat();
    let mut centers = vec![Vec3::ZERO; count];
    let mut factors = vec![Mat3::ZERO; count];
    let mut peaks = vec![0.0; count];
    let mut colors = vec![[0.0; 3]; count];
    let mut coefficients = vec![[0.0; 3]; count * per_splat];

    let mut rest = &mut coefficients[..];
    let sinks: Vec<Sink<'_>> = (centers.chunks_mut(rows).zip(factors.chunks_mut(rows)))
        .zip(peaks.chunks_mut(rows).zip(colors.chunks_mut(rows)))
        .enumerate()
        .map(|(part, ((centers, factors), (peaks, colors)))| {
            let harmonics = rest.split_off_mut(..centers.len() * per_splat).unwrap_or_default();
            let first_row = part * rows;
            Sink { next: 0, first_row, centers, factors, peaks, colors, harmonics, rejected: Vec::new() }
        })
        .collect();
    let read = |mut sink: Sink<'_>| {
        let range = sink.first_row..sink.first_row + sink.centers.len();
        read(range, &mut sink)?;
        debug_assert_eq!(sink.next, sink.centers.len(), "a reader puts all its rows");
        Ok(sink.rejected)
    };
    let parts: Vec<Result<_, ImportError>> = sinks.into_par_iter().map(read).collect();
    // What is wrong first in the file is said, whoever came upon something first.
    let rejected = parts.into_iter().collect::<Result<Vec<_>, _>>()?.concat();
    let note = (!rejected.is_empty()).then(|| summary(count, &rejected));
    if rejected.len() == count {
        let why = note.map_or_else(|| "it has 0 rows".into(), |note| format!("left out are {note}"));
        let problem = format!("there are no splats in it, at least one is needed: {why}");
        return Err(file.malformed(Place::Whole, problem));
    }
    if !rejected.is_empty() {
        drop_rows(&mut centers, 1, &rejected);
        drop_rows(&mut factors, 1, &rejected);
        drop_rows(&mut peaks, 1, &rejected);
        drop_rows(&mut colors, 1, &rejected);
        drop_rows(&mut coefficients, per_splat, &rejected);
    }
    let harmonics = (training.degree > 0).then_some(Harmonics { degree: training.degree, coefficients });
    let splats = Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Opacity { peaks, filter: training.filter, least: Strength::LEAST_OF_TRAINED },
        colors,
        harmonics,
        normals: None,
        material: Material::UNLIT,
    };
    let content =
        Content::Splats { splats: splats.in_morton_order(), blend: training.blend, origin: DVec3::ZERO };
    Ok(Opened::noting(content, note.map(Note::LeftOut).into_iter().collect()))
}

/// How many rows were rejected, why, and the first of each kind.
fn summary(count: usize, rejected: &[(usize, Reject)]) -> String {
    let of_kind = |kind: Reject| {
        let mut rows = rejected.iter().filter(|(_, reject)| *reject == kind).map(|(row, _)| row);
        let first = rows.next()?;
        Some(format!("{} {} (the first is splat {first})", 1 + rows.count(), kind.reason()))
    };
    let kinds: Vec<String> = Reject::ALL.into_iter().filter_map(of_kind).collect();
    format!("{} of {count} splats: {}", rejected.len(), kinds.join(", "))
}

fn drop_rows<T>(values: &mut Vec<T>, per_row: usize, rejected: &[(usize, Reject)]) {
    if per_row == 0 {
        return;
    }
    let (mut index, mut next) = (0, rejected.iter().map(|(row, _)| *row).peekable());
    values.retain(|_| {
        let row = index / per_row;
        index += 1;
        while next.next_if(|rejected| *rejected < row).is_some() {}
        next.peek() != Some(&row)
    });
}
