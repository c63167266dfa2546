//! Classification: which samples a transfer function shows, and what they look like.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use oblate_engine::{Shapes, Splats, Strength};

use crate::brick::{BrickRange, MORTON, SIDE};
use crate::field::{Sample, differences};
use crate::kernels::{Flattening, KERNEL_SIGMA, KernelSettings};
use crate::transfer::{GradientRamp, Optical, TransferFunction};
use crate::volume::{Volume, Voxels};

/// The kernels of a volume under a transfer function; `bricks` are all that hold a finite value.
pub(crate) fn splats(
    volume: &Volume,
    bricks: &[BrickRange],
    transfer: &TransferFunction,
    settings: &KernelSettings,
) -> Splats {
    let lookup = Lookup::new(volume, bricks, transfer);
    match volume.voxels() {
        Voxels::U8(v) => Classification::new(volume, v, bricks, &lookup).splats(settings),
        Voxels::U16(v) => Classification::new(volume, v, bricks, &lookup).splats(settings),
        Voxels::I16(v) => Classification::new(volume, v, bricks, &lookup).splats(settings),
        Voxels::F32(v) => Classification::new(volume, v, bricks, &lookup).splats(settings),
    }
}

/// A transfer function, and a table of it where values are integers.
struct Lookup<'a> {
    transfer: &'a TransferFunction,
    /// The function at the integers from `first` to the largest value; empty for floating point.
    table: Vec<Optical>,
    first: f32,
}

impl<'a> Lookup<'a> {
    fn new(volume: &Volume, bricks: &[BrickRange], transfer: &'a TransferFunction) -> Self {
        let first = bricks.iter().fold(f32::INFINITY, |low, brick| low.min(brick.range[0]));
        let last = bricks.iter().fold(f32::NEG_INFINITY, |high, brick| high.max(brick.range[1]));
        let integers = !matches!(volume.voxels(), Voxels::F32(_)) && first <= last;
        let count = if integers { (last - first) as u32 + 1 } else { 0 };
        let table = (0..count).into_par_iter().map(|offset| transfer.at(first + offset as f32)).collect();
        Self { transfer, table, first }
    }

    #[inline]
    fn entry(&self, value: f32) -> &Optical {
        &self.table[(value - self.first) as u32 as usize]
    }

    #[inline]
    fn extinction(&self, value: f32) -> f32 {
        if self.table.is_empty() { self.transfer.extinction(value) } else { self.entry(value).extinction }
    }

    #[inline]
    fn color(&self, value: f32) -> [f32; 3] {
        if self.table.is_empty() { self.transfer.color(value) } else { self.entry(value).color }
    }
}

/// A move and a linear map about the place moved to.
struct Press {
    offset: DVec3,
    linear: DMat3,
}

/// Bits of a row of [`Shown`].
const ROW: usize = u64::BITS as usize;

/// Which samples of a brick show, in Morton order.
type Shown = [u64; MORTON.len() / ROW];

/// Samples under a transfer function.
struct Classification<'a, T> {
    volume: &'a Volume,
    samples: &'a [T],
    bricks: &'a [BrickRange],
    lookup: &'a Lookup<'a>,
    /// From a brick's first sample to each of its samples.
    offsets: [usize; MORTON.len()],
    gradients_to_world: DMat3,
    voxel_volume: f64,
}

impl<'a, T: Sample> Classification<'a, T> {
    fn new(volume: &'a Volume, samples: &'a [T], bricks: &'a [BrickRange], lookup: &'a Lookup<'a>) -> Self {
        let offsets = MORTON.map(|local| volume.place(local.map(usize::from)));
        let (gradients_to_world, voxel_volume) = (volume.gradients_to_world(), volume.voxel_volume());
        Self { volume, samples, bricks, lookup, offsets, gradients_to_world, voxel_volume }
    }

    /// One array after the other: samples are read again for each, but nothing is held that the cloud does not
    /// need.
    fn splats(&self, settings: &KernelSettings) -> Splats {
        let shown: Vec<Shown> =
            (0..self.bricks.len()).into_par_iter().map(|brick| self.shown(brick)).collect();
        let steps = self.volume.steps();
        let place = |index: [usize; 3]| steps * DVec3::from(index.map(|i| i as f64));
        let round = steps * KERNEL_SIGMA;
        let (centers, shapes) = match settings.flattening {
            None => (self.each(&shown, |i| place(i).as_vec3()), Shapes::Shared(round.as_mat3())),
            Some(flattening) => {
                let pressed = |index| {
                    let press = self.press(&flattening, index);
                    ((place(index) + press.offset).as_vec3(), (press.linear * round).as_mat3())
                };
                let (centers, factors) = self.each(&shown, pressed).into_par_iter().unzip();
                (centers, Shapes::Each(factors))
            }
        };
        Splats {
            centers,
            shapes,
            strength: Strength::Extinction { masses: self.each(&shown, |index| self.mass(index)) },
            colors: self.each(&shown, |index| self.lookup.color(self.value(index))),
            harmonics: None,
            normals: Some(self.each(&shown, |index| self.normal(index))),
            material: settings.material,
        }
    }

    /// A value of each sample that shows, by its indices in the grid.
    fn each<V: Copy + Default + Send + Sync>(
        &self,
        shown: &[Shown],
        value: impl Fn([usize; 3]) -> V + Sync,
    ) -> Vec<V> {
        let count = |shown: &Shown| shown.iter().map(|row| row.count_ones() as usize).sum::<usize>();
        let all = shown.iter().map(count).sum();
        let mut values: Vec<V> = rayon::iter::repeat_n(V::default(), all).collect();
        let mut rest = &mut values[..];
        let of_brick = |shown: &Shown| rest.split_off_mut(..count(shown)).unwrap_or_default();
        let of_bricks: Vec<&mut [V]> = shown.iter().map(of_brick).collect();
        of_bricks.into_par_iter().zip(self.bricks).zip(shown).for_each(|((values, brick), shown)| {
            let mut places = values.iter_mut();
            for (row, locals) in shown.iter().zip(MORTON.chunks_exact(ROW)) {
                let mut row = *row;
                while row != 0 {
                    let local = locals[row.trailing_zeros() as usize];
                    row &= row - 1;
                    let index = [0, 1, 2].map(|axis| brick.base[axis] + usize::from(local[axis]));
                    *places.next().expect("as many places as bits") = value(index);
                }
            }
        });
        values
    }

    /// What takes a sample's kernel, seen from its place, towards the surface.
    fn press(&self, flattening: &Flattening, index: [usize; 3]) -> Press {
        let stays = Press { offset: DVec3::ZERO, linear: DMat3::IDENTITY };
        let differences = differences(self.samples, self.volume.dims(), index);
        let above = f64::from(flattening.value) - f64::from(self.value(index));
        let gradient = self.gradients_to_world * differences;
        let squared = gradient.length_squared();
        let steep = squared > 0.0 && squared >= f64::from(flattening.least_gradient).powi(2);
        if !(steep && above.abs() <= 0.5 * differences.length()) {
            return stays;
        }
        // Along the gradient, to the place where the value would be the surface's, but for 1 / ratio of everything.
        let pressed = 1.0 - 1.0 / f64::from(flattening.ratio);
        let scaled = gradient * (pressed / squared);
        let outer = DMat3::from_cols(scaled * gradient.x, scaled * gradient.y, scaled * gradient.z);
        Press { offset: scaled * above, linear: DMat3::IDENTITY - outer }
    }

    /// Which of a brick's samples show.
    fn shown(&self, brick: usize) -> Shown {
        let BrickRange { base, range } = self.bricks[brick];
        let mut shown = Shown::default();
        if !self.lookup.transfer.shows_within(range) {
            return shown;
        }
        let (dims, first) = (self.volume.dims(), self.volume.place(base));
        let whole = (0..3).all(|axis| base[axis] + SIDE <= dims[axis]);
        let index = |local: [u8; 3]| [0, 1, 2].map(|axis| base[axis] + usize::from(local[axis]));
        for (number, (offset, local)) in self.offsets.iter().zip(MORTON).enumerate() {
            let in_grid = whole || index(local).iter().zip(dims).all(|(i, length)| *i < length);
            let is_shown = in_grid
                && self.lookup.extinction(self.samples[first + offset].into()) > 0.0
                && self.ramp_factor(|| index(local)) > 0.0;
            shown[number / ROW] |= u64::from(is_shown) << (number % ROW);
        }
        shown
    }

    #[inline]
    fn value(&self, index: [usize; 3]) -> f32 {
        self.samples[self.volume.place(index)].into()
    }

    #[inline]
    fn mass(&self, index: [usize; 3]) -> f32 {
        let extinction = f64::from(self.lookup.extinction(self.value(index)));
        (extinction * f64::from(self.ramp_factor(|| index)) * self.voxel_volume) as f32
    }

    #[inline]
    fn ramp_factor(&self, index: impl Fn() -> [usize; 3]) -> f32 {
        self.lookup.transfer.gradient().map_or(1.0, |ramp| self.factor_under(ramp, index()))
    }

    // Apart, so that functions without a ramp, which most are, stay short.
    #[inline(never)]
    fn factor_under(&self, ramp: GradientRamp, index: [usize; 3]) -> f32 {
        ramp.factor(self.gradient(index).length() as f32)
    }

    #[inline]
    fn gradient(&self, index: [usize; 3]) -> DVec3 {
        self.gradients_to_world * differences(self.samples, self.volume.dims(), index)
    }

    /// Downhill; zero where the gradient is.
    #[inline]
    fn normal(&self, index: [usize; 3]) -> Vec3 {
        let gradient = self.gradient(index);
        let squared = gradient.length_squared();
        // Known before the root is, unlike what `normalize_or_zero` looks at.
        let scale = if squared > 0.0 { -squared.sqrt().recip() } else { 0.0 };
        (gradient * scale).as_vec3()
    }
}
