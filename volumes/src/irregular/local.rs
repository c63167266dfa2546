//! What a sample knows of its neighbours: the steps to them and the field's gradient.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use oblate_engine::neighbors::{Found, Leaf, Tree};

use super::{Arrangement, IrregularVolume};

/// Neighbours that scattered samples look at: those within one step along each axis, if the samples were an even grid.
const NEIGHBORS: usize = 26;

/// Steps that span less than this share of the volume of their lengths span none: it is what rounding leaves.
const FLAT: f64 = 1e-9;

/// A sample and what is around it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    /// Its number among the samples.
    pub(super) number: usize,
    /// From it to its neighbours along three axes of its own, as columns: a sample stands for the volume that they span.
    pub(super) steps: DMat3,
    /// Of the field, in value per world unit.
    pub(super) gradient: DVec3,
}

/// The three columns' cross products: it takes vector areas along with what `m` takes places to, and is det · m⁻ᵀ without a division.
pub(super) fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// Whether three steps span a volume.
fn spans(steps: DMat3) -> bool {
    let lengths = steps.x_axis.length() * steps.y_axis.length() * steps.z_axis.length();
    steps.determinant().abs() > FLAT * lengths
}

impl IrregularVolume {
    fn is_there(&self, number: usize) -> bool {
        self.samples.voxels().get(number).is_finite()
    }

    /// The number of the sample so many steps along the axes from another, if the grid goes so far; of scattered ones it isn't known what is missing, and
    /// another has its own.
    pub(super) fn beside(&self, number: usize, steps: [isize; 3]) -> Option<usize> {
        let dims = self.samples.dims();
        let index = [number % dims[0], number / dims[0] % dims[1], number / (dims[0] * dims[1])];
        let along =
            |axis: usize| index[axis].checked_add_signed(steps[axis]).filter(|index| *index < dims[axis]);
        match (self.arrangement, along(0), along(1), along(2)) {
            (Arrangement::Scattered, ..) => Some(number),
            (_, Some(i), Some(j), Some(k)) => Some(self.samples.place([i, j, k])),
            _ => None,
        }
    }

    /// Steps of points and of values at a sample of a grid, per step of its indices: central differences inside, one-sided at borders and
    /// beside samples that are not there; zero where both neighbours are missing.
    pub(super) fn grid_steps(&self, index: [usize; 3]) -> (DMat3, DVec3) {
        let (dims, here) = (self.samples.dims(), self.samples.place(index));
        let (mut steps, mut rises) = (DMat3::ZERO, DVec3::ZERO);
        let mut stride = 1;
        for axis in 0..3 {
            let before = (index[axis] > 0).then(|| here - stride).filter(|n| self.is_there(*n));
            let after = (index[axis] + 1 < dims[axis]).then(|| here + stride).filter(|n| self.is_there(*n));
            let (from, to) = (before.unwrap_or(here), after.unwrap_or(here));
            let share = if before.is_some() && after.is_some() { 0.5 } else { 1.0 };
            let value = |number: usize| f64::from(self.samples.voxels().get(number));
            *steps.col_mut(axis) = (self.points[to] - self.points[from]) * share;
            rises[axis] = if from == to { 0.0 } else { (value(to) - value(from)) * share };
            stride *= dims[axis];
        }
        (steps, rises)
    }

    /// Sample `number` of a grid; `None` where it isn't there or spans no volume.
    fn on_grid(&self, number: usize) -> Option<Local> {
        let [nx, ny, _] = self.samples.dims();
        let (steps, rises) = self.grid_steps([number % nx, number / nx % ny, number / (nx * ny)]);
        let is_sample = self.is_there(number) && spans(steps);
        // Exact for linear fields, since points and values have the same neighbours.
        is_sample.then(|| Local { number, steps, gradient: cofactors(steps) * rises / steps.determinant() })
    }

    /// The volume that the samples of a grid stand for.
    pub(super) fn local_volumes(&self) -> f64 {
        let volume = |number| self.on_grid(number).map_or(0.0, |local| local.steps.determinant().abs());
        let parts = (0..self.points.len()).into_par_iter().map(volume);
        // One order of summing for any number of threads.
        parts.collect::<Vec<f64>>().into_iter().sum()
    }

    /// All samples that span a volume, in order.
    pub(super) fn locals(&self) -> Vec<Local> {
        match self.arrangement {
            Arrangement::Curvilinear => {
                (0..self.points.len()).into_par_iter().filter_map(|number| self.on_grid(number)).collect()
            }
            Arrangement::Scattered => self.among_neighbors(),
        }
    }

    /// Scattered samples with steps from their nearest neighbours: the second moments about the sample of points that fill a ball, R²/5 along
    /// each axis, have the ball's volume, of which each of the N points has a share; so V = (4π/3) 5^{3/2} √|C| / N.
    fn among_neighbors(&self) -> Vec<Local> {
        let middle = self.middle();
        let leaf = |number: usize| {
            let position = (self.points[number] - middle).as_vec3();
            self.is_there(number).then_some(Leaf { position, number: number as u32 })
        };
        let tree = Tree::new((0..self.points.len()).filter_map(leaf).collect());
        let local = |found: &mut Found, place: usize| {
            tree.nearest(place, NEIGHBORS, found);
            self.neighborhood(&tree, (place, found))
        };
        let mut locals: Vec<Local> =
            (0..tree.leaves.len()).into_par_iter().map_init(Found::new, local).flatten_iter().collect();
        locals.sort_unstable_by_key(|local| local.number);
        locals
    }

    fn neighborhood(&self, tree: &Tree, (place, found): (usize, &Found)) -> Option<Local> {
        let number = |place: usize| tree.leaves[place].number as usize;
        let own = number(place);
        let value = |number: usize| f64::from(self.samples.voxels().get(number));
        let (mut moments, mut rises) = (DMat3::ZERO, DVec3::ZERO);
        for &(_, other) in found {
            let other = number(other as usize);
            let step = self.points[other] - self.points[own];
            moments += DMat3::from_cols(step * step.x, step * step.y, step * step.z);
            rises += step * (value(other) - value(own));
        }
        let count = (found.len() + 1) as f64;
        let factor = cholesky(moments * count.recip())?;
        let determinant = factor.determinant();
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 5_f64.powf(1.5) * determinant / count;
        let steps = factor * (volume / determinant).cbrt();
        // Least squares.
        let gradient = moments.inverse() * rises;
        (spans(steps) && gradient.is_finite()).then_some(Local { number: own, steps, gradient })
    }
}

/// The lower triangle L with L Lᵀ = m, of a matrix that is positive definite.
fn cholesky(m: DMat3) -> Option<DMat3> {
    let a = m.x_axis.x.sqrt();
    let (b, c) = (m.x_axis.y / a, m.x_axis.z / a);
    let d = (m.y_axis.y - b * b).sqrt();
    let e = (m.y_axis.z - b * c) / d;
    let f = (m.z_axis.z - c * c - e * e).sqrt();
    let lower = DMat3::from_cols(DVec3::new(a, b, c), DVec3::new(0.0, d, e), DVec3::new(0.0, 0.0, f));
    (lower.is_finite() && a > 0.0 && d > 0.0 && f > 0.0).then_some(lower)
}

/// A direction of single precision down a gradient; zero where it is.
pub(super) fn downhill(gradient: DVec3) -> Vec3 {
    (-gradient).normalize_or_zero().as_vec3()
}
