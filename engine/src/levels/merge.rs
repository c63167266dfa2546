//! Four splats to one that stands for them.

use super::{Level, clusters, range_of};
use crate::cloud::{Shapes, Strength};
use crate::columns::{CHILDREN, Column, Columns};

/// The next coarser level: each splat stands for four consecutive ones of the level below, the last for those that are left.
pub(super) fn coarser(below: &Level) -> Level {
    // TODO(levels): moments instead of the first child.
    let splats = below.columns.splats();
    let pick = |i: usize| i * CHILDREN;
    let count = below.columns.len.div_ceil(CHILDREN);
    let each = |values: &Vec<f32>| (0..count).map(|i| values[pick(i)]).collect::<Vec<f32>>();
    let columns = Columns::new(crate::cloud::Splats {
        centers: (0..count).map(|i| splats.centers[pick(i)]).collect(),
        shapes: Shapes::Each((0..count).map(|i| splats.shapes.factor(pick(i))).collect()),
        strength: match &splats.strength {
            Strength::Extinction { masses } => Strength::Extinction { masses: each(masses) },
            Strength::Opacity { peaks, filter } => Strength::Opacity { peaks: each(peaks), filter: *filter },
            Strength::Surface(surface) => Strength::Surface(crate::cloud::Surface {
                areas: each(&surface.areas),
                opacities: surface.opacities.as_ref().map(each),
                ..*surface
            }),
        },
        colors: (0..count).map(|i| splats.colors[pick(i)]).collect(),
        harmonics: None,
        normals: splats.normals.as_ref().map(|n| (0..count).map(|i| n[pick(i)]).collect()),
        material: splats.material,
    });
    let needs: Vec<f32> = vec![f32::MAX; count];
    let mut clusters = clusters(&columns);
    for cluster in &mut clusters {
        cluster.needs = range_of(needs[cluster.splats.clone()].iter().copied());
    }
    let median_sigma = columns.median_sigma();
    Level { columns, clusters, median_sigma, needs: Some(Column::new(needs, |need| [*need])) }
}
