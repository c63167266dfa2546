//! A cloud's splats as the footprint stage reads them: eight at a time, each number in a row of its own.

mod colors;
mod harmonics;
mod repeated;

use crate::closed::Closed;
use crate::cloud::{Material, OpacityFilter, Shapes, Splats, Strength, Surface};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

pub(crate) use colors::Colors;
pub(crate) use harmonics::PackedHarmonics;
pub(crate) use repeated::Repeated;

/// Splats of a block.
pub(crate) const LANES: usize = 8;

/// Consecutive splats that one of the next level of detail stands for: two families a block.
pub(crate) const CHILDREN: usize = 4;

/// The least number of blocks that a thread makes at a time.
pub(crate) const BLOCKS_A_TASK: usize = 256;

/// One number of each splat of a block.
pub(crate) type Lanes = [f32; LANES];

/// `N` numbers of each splat; splat i is lane i % [`LANES`] of block i / [`LANES`]. The last block is filled up
/// with its last splat. Where all splats are alike there is one block, which stands for all.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Column<const N: usize>(Vec<[Lanes; N]>);

impl<const N: usize> Column<N> {
    /// The column of what `row` makes of the values, which are freed.
    pub(crate) fn new<T: Sync>(values: Vec<T>, row: impl Fn(&T) -> [f32; N] + Sync) -> Self {
        Self::new_of(&values, row)
    }

    /// As [`Self::new`]; the values stay.
    fn new_of<T: Sync>(values: &[T], row: impl Fn(&T) -> [f32; N] + Sync) -> Self {
        if let Some(first) = values.first().map(&row)
            && values.get(LANES).is_some_and(|value| row(value) == first)
            && values.par_iter().with_min_len(BLOCKS_A_TASK * LANES).all(|value| row(value) == first)
        {
            return Self::alike(values.len(), first);
        }
        Self(blocks(values, row))
    }

    /// The column of `len` splats with the same numbers.
    pub(crate) fn alike(len: usize, numbers: [f32; N]) -> Self {
        Self(vec![numbers.map(|number| [number; LANES]); len.min(1)])
    }

    /// Whether one block stands for all.
    fn is_alike(&self) -> bool {
        matches!(&self.0[..], [] | [_]) && self.0.iter().flatten().all(|row| *row == [row[0]; LANES])
    }

    /// Whether it has one row for all of its splats, of which there are some.
    fn is_one(&self) -> bool {
        !self.0.is_empty() && self.is_alike()
    }

    /// The column of finished blocks.
    pub(crate) fn of_blocks(mut blocks: Vec<[Lanes; N]>) -> Self {
        if let [first, second, ..] = &blocks[..] {
            let one = first.map(|row| [row[0]; LANES]);
            if *second == one && blocks.par_iter().with_min_len(BLOCKS_A_TASK).all(|block| *block == one) {
                blocks = vec![one];
            }
        }
        Self(blocks)
    }

    /// Its blocks: one, perhaps, that stands for all.
    pub(crate) fn into_blocks(self) -> Vec<[Lanes; N]> {
        self.0
    }

    /// Puts the splats of each run of `run`, a multiple of [`LANES`], in another order: splat i of a run becomes what its splat
    /// `order[i]` was.
    fn reorder(&mut self, order: &[u32], run: usize) {
        reorder(&mut self.0, order, run);
    }

    /// The numbers of splats 8 · block up to 8 · block + 7.
    #[inline(always)]
    pub(crate) fn block(&self, block: usize) -> &[Lanes; N] {
        &self.0[block.min(self.0.len() - 1)]
    }

    /// Memory of the numbers.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.0[..])
    }

    /// The largest of all numbers, at least 0.
    fn largest(&self) -> f32 {
        let of_block = |block: &[Lanes; N]| block.iter().flatten().copied().fold(0.0, f32::max);
        self.0.par_iter().with_min_len(BLOCKS_A_TASK).map(of_block).reduce(|| 0.0, f32::max)
    }

    /// The numbers of one splat.
    pub(crate) fn row(&self, index: usize) -> [f32; N] {
        let block = self.block(index / LANES);
        std::array::from_fn(|i| block[i][index % LANES])
    }
}

/// Blocks of what `row` makes of values.
fn blocks<T: Sync, V: Copy + Send, const N: usize>(
    values: &[T],
    row: impl Fn(&T) -> [V; N] + Sync,
) -> Vec<[[V; LANES]; N]> {
    let block = |values: &[T]| {
        let rows: [_; LANES] = std::array::from_fn(|lane| row(&values[lane.min(values.len() - 1)]));
        std::array::from_fn(|i| rows.map(|row| row[i]))
    };
    values.par_chunks(LANES).with_min_len(BLOCKS_A_TASK).map(block).collect()
}

/// See [`Column::reorder`].
fn reorder<V: Copy + Send + Sync, const N: usize>(blocks: &mut [[[V; LANES]; N]], order: &[u32], run: usize) {
    if blocks.len() < order.len().div_ceil(LANES) {
        return;
    }
    blocks.par_chunks_mut(run / LANES).zip(order.par_chunks(run)).for_each(|(blocks, order)| {
        let before = blocks.to_vec();
        for (places, order) in blocks.iter_mut().zip(order.chunks(LANES)) {
            for lane in 0..LANES {
                let from = order[lane.min(order.len() - 1)] as usize;
                for (place, before) in places.iter_mut().zip(&before[from / LANES]) {
                    place[lane] = before[from % LANES];
                }
            }
        }
    });
}

/// Covariance factors, by columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Factors {
    Shared(Mat3),
    Each {
        /// The first two columns.
        flat: Column<6>,
        /// The third: of flat surfels nothing.
        through: Column<3>,
    },
}

impl Factors {
    /// Whether all splats have one.
    pub(crate) fn are_alike(&self) -> bool {
        match self {
            Self::Shared(_) => true,
            Self::Each { flat, through } => flat.is_alike() && through.is_alike(),
        }
    }
}

/// What the strengths of a cloud mean.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Masses.
    Extinction,
    /// Peak opacities; see [`Strength::Opacity`].
    Opacity { filter: OpacityFilter, least: f32 },
    /// Areas.
    Surface(SurfaceKind),
}

/// What the splats of a surface share; see [`Surface`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SurfaceKind {
    pub(crate) depth_tolerance: f32,
    pub(crate) coverage_floor: f32,
    pub(crate) closed: Closed,
    /// σ₁σ₂ of merged surfels over the areas that they stand for: how their cells overlap. ∞ where the floor says all: of a cloud's own, and
    /// of translucent ones.
    pub(crate) overlap: f32,
}

impl SurfaceKind {
    /// Of surfels that stand for no others.
    pub(crate) fn of_samples(depth_tolerance: f32, coverage_floor: f32, closed: Closed) -> Self {
        Self { depth_tolerance, coverage_floor, closed, overlap: f32::INFINITY }
    }
}

/// The checked arrays of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Columns {
    pub(crate) len: usize,
    pub(crate) centers: Column<3>,
    pub(crate) factors: Factors,
    pub(crate) kind: Kind,
    /// Masses, peak opacities or areas.
    pub(crate) strengths: Repeated<1>,
    /// Opacities of a surface; `None` is opaque.
    pub(crate) opacities: Option<Column<1>>,
    pub(crate) colors: Colors,
    pub(crate) harmonics: Option<PackedHarmonics>,
    pub(crate) normals: Option<Column<3>>,
    /// Of surfels that stand for others, see `levels::Orientation`. They stay in their order.
    pub(crate) orientations: Option<Column<9>>,
    /// Of the same how fine what they stand for is, from 0 to 1: the root of the mean σ₁σ₂ of the cloud's own surfels over theirs.
    pub(crate) grains: Option<Column<1>>,
    /// Of kernels that stand for others and that no filter dims, the sum of what the opacities of the cloud's own that each stands for are above
    /// their least.
    pub(crate) opacities_of_own: Option<Column<1>>,
    pub(crate) material: Material,
}

impl Default for Columns {
    /// Nothing.
    fn default() -> Self {
        Self {
            len: 0,
            centers: Column::default(),
            factors: Factors::Shared(Mat3::ZERO),
            kind: Kind::Extinction,
            strengths: Repeated::default(),
            opacities: None,
            colors: Colors::default(),
            harmonics: None,
            normals: None,
            orientations: None,
            grains: None,
            opacities_of_own: None,
            material: Material::default(),
        }
    }
}

impl Columns {
    /// The columns of checked arrays; each array is freed when its column is made.
    pub(crate) fn new(splats: Splats) -> Self {
        let single = |values| Column::new(values, |v| [*v]);
        let len = splats.centers.len();
        let (kind, strengths, opacities) = match splats.strength {
            Strength::Extinction { masses } => (Kind::Extinction, masses, None),
            Strength::Opacity { peaks, filter, least } => (Kind::Opacity { filter, least }, peaks, None),
            Strength::Surface(Surface { areas, opacities, depth_tolerance, coverage_floor, closed }) => {
                let shared = SurfaceKind::of_samples(depth_tolerance, coverage_floor, closed);
                (Kind::Surface(shared), areas, opacities.map(single))
            }
        };
        Self {
            len,
            centers: Column::new(splats.centers, Vec3::to_array),
            factors: match splats.shapes {
                Shapes::Shared(factor) => Factors::Shared(factor),
                Shapes::Each(factors) => {
                    let through = Column::new_of(&factors, |factor| factor.z_axis.to_array());
                    let flat = |factor: &Mat3| {
                        let [[a, b, c], [d, e, f]] =
                            [factor.x_axis, factor.y_axis].map(|axis| axis.to_array());
                        [a, b, c, d, e, f]
                    };
                    Factors::Each { flat: Column::new(factors, flat), through }
                }
            },
            kind,
            strengths: Repeated::new(strengths, |v| [*v]),
            opacities,
            colors: Colors::new(Repeated::new(splats.colors, |color| *color)),
            harmonics: splats.harmonics.map(PackedHarmonics::new),
            normals: splats.normals.map(|normals| Column::new(normals, Vec3::to_array)),
            orientations: None,
            grains: None,
            opacities_of_own: None,
            material: splats.material,
        }
    }

    /// Puts the splats of each run of `run`, a multiple of [`LANES`], in another order: splat i of a run becomes what its splat
    /// `order[i]` was. Takes no more memory than a run does for each thread.
    pub(crate) fn reorder(&mut self, order: &[u32], run: usize) {
        self.centers.reorder(order, run);
        if let Factors::Each { flat, through } = &mut self.factors {
            flat.reorder(order, run);
            through.reorder(order, run);
        }
        self.strengths.reorder(order, run);
        self.opacities.iter_mut().for_each(|opacities| opacities.reorder(order, run));
        self.colors.reorder(order, run);
        self.harmonics.iter_mut().for_each(|harmonics| harmonics.reorder(order, run));
        self.normals.iter_mut().for_each(|normals| normals.reorder(order, run));
    }

    /// The median over kernels of √(3/tr Σ⁻¹); of flat ones of √(tr Σ/3). `None` of surfaces, and without any.
    pub(crate) fn median_sigma(&self) -> Option<f32> {
        if matches!(self.kind, Kind::Surface(_)) || self.len == 0 {
            return None;
        }
        let sigma = |factor: Mat3| {
            let [x, y, z] = [factor.x_axis, factor.y_axis, factor.z_axis];
            let squares =
                |a: Vec3, b: Vec3, c: Vec3| a.length_squared() + b.length_squared() + c.length_squared();
            // F⁻¹ is the cofactors over the determinant.
            let sigma =
                factor.determinant().abs() * (3.0 / squares(x.cross(y), y.cross(z), z.cross(x))).sqrt();
            if sigma > 0.0 && sigma.is_finite() { sigma } else { (squares(x, y, z) / 3.0).sqrt() }
        };
        let Factors::Each { .. } = &self.factors else { return Some(sigma(self.factor(0))) };
        let mut values: Vec<f32> =
            (0..self.len).into_par_iter().map(|index| sigma(self.factor(index))).collect();
        let middle = values.len() / 2;
        Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// Memory of all columns.
    pub(crate) fn bytes(&self) -> usize {
        let Self {
            len: _,
            kind: _,
            material: _,
            centers,
            factors,
            strengths,
            opacities,
            colors,
            harmonics,
            normals,
            orientations,
            grains,
            opacities_of_own,
        } = self;
        let factors = match factors {
            Factors::Shared(_) => 0,
            Factors::Each { flat, through } => flat.bytes() + through.bytes(),
        };
        factors
            + centers.bytes()
            + strengths.bytes()
            + opacities.as_ref().map_or(0, Column::bytes)
            + colors.bytes()
            + harmonics.as_ref().map_or(0, PackedHarmonics::bytes)
            + normals.as_ref().map_or(0, Column::bytes)
            + orientations.as_ref().map_or(0, Column::bytes)
            + [grains, opacities_of_own].into_iter().flatten().map(Column::bytes).sum::<usize>()
    }

    pub(crate) fn center(&self, index: usize) -> Vec3 {
        self.centers.row(index).into()
    }

    pub(crate) fn factor(&self, index: usize) -> Mat3 {
        match &self.factors {
            Factors::Shared(factor) => *factor,
            Factors::Each { flat, through } => {
                let [a, b, c, d, e, f] = flat.row(index);
                Mat3::from_cols(Vec3::new(a, b, c), Vec3::new(d, e, f), through.row(index).into())
            }
        }
    }

    pub(crate) fn strength(&self, index: usize) -> f32 {
        self.strengths.row(index)[0]
    }

    /// Opacity of a surface.
    pub(crate) fn opacity(&self, index: usize) -> f32 {
        self.opacities.as_ref().map_or(1.0, |opacities| opacities.row(index)[0])
    }

    pub(crate) fn color(&self, index: usize) -> [f32; 3] {
        self.colors.row(index)
    }

    pub(crate) fn normal(&self, index: usize) -> Vec3 {
        self.normals.as_ref().map_or(Vec3::ZERO, |normals| normals.row(index).into())
    }

    /// The arrays as they were given; coefficients of harmonics as they were rounded.
    pub(crate) fn splats(&self) -> Splats {
        let singles = |column: &Column<1>| (0..self.len).map(|i| column.row(i)[0]).collect();
        let strengths = (0..self.len).map(|i| self.strength(i)).collect();
        Splats {
            centers: (0..self.len).map(|i| self.center(i)).collect(),
            shapes: match &self.factors {
                Factors::Shared(factor) => Shapes::Shared(*factor),
                Factors::Each { .. } => Shapes::Each((0..self.len).map(|i| self.factor(i)).collect()),
            },
            strength: match self.kind {
                Kind::Extinction => Strength::Extinction { masses: strengths },
                Kind::Opacity { filter, least } => Strength::Opacity { peaks: strengths, filter, least },
                Kind::Surface(SurfaceKind { depth_tolerance, coverage_floor, ref closed, .. }) => {
                    Strength::Surface(Surface {
                        areas: strengths,
                        opacities: self.opacities.as_ref().map(singles),
                        depth_tolerance,
                        coverage_floor,
                        closed: closed.clone(),
                    })
                }
            },
            colors: (0..self.len).map(|i| self.color(i)).collect(),
            harmonics: self.harmonics.as_ref().map(|harmonics| harmonics.unpacked(self.len)),
            normals: self.normals.as_ref().map(|_| (0..self.len).map(|i| self.normal(i)).collect()),
            material: self.material,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Harmonics;

    #[test]
    fn what_goes_in_comes_out() {
        for count in [0, 1, 8, 13, 2 * BLOCKS_A_TASK * LANES + 3] {
            let number = |i: usize| i as f32;
            let splats = Splats {
                centers: (0..count).map(|i| Vec3::new(number(i), 1.0, -number(i))).collect(),
                shapes: Shapes::Each((0..count).map(|i| Mat3::IDENTITY * number(i)).collect()),
                strength: Strength::Opacity {
                    peaks: (0..count).map(|i| number(i) / 16.0).collect(),
                    filter: [OpacityFilter::Classic, OpacityFilter::Compensated][count % 2],
                    least: 0.0,
                },
                colors: (0..count).map(|i| [number(i), 0.5, 0.25]).collect(),
                harmonics: Some(Harmonics {
                    degree: 2,
                    coefficients: (0..count * 8).map(|i| [number(i) - 3.0, 1.0, -number(i)]).collect(),
                }),
                normals: None,
                material: Material::default(),
            };
            let back = Columns::new(splats.clone()).splats();
            let (before, after) = (splats.harmonics.as_ref().unwrap(), back.harmonics.as_ref().unwrap());
            let largest = number(count * 8);
            for (a, b) in before.coefficients.iter().flatten().zip(after.coefficients.iter().flatten()) {
                assert!((a - b).abs() <= largest * 1.6e-5, "{a} came back as {b}");
            }
            assert_eq!(Splats { harmonics: None, ..back }, Splats { harmonics: None, ..splats });
        }
    }
}
