//! R1's picture by chance: nothing is sorted, nothing is accumulated along a ray.
//!
//! Light that meets a medium of optical depth τ goes on for an optical depth that is distributed as e^{−t}. So in
//! each sample every kernel stops the ray by itself, or lets it pass; a surface layer stops it with probability α.
//! What is nearest of all that would stop it is seen. The mean over samples is the picture that the
//! emission–absorption equation has. The idea, for polygons: Enderton, Sintorn, Shirley, Luebke, *Stochastic
//! Transparency*, 2010.
//!
//! Most kernels let most rays pass. So they are laid end to end, each as long as its optical depth, in any order, and
//! along that line collisions are drawn with density 1: the first within a kernel is that kernel's, and the next one
//! is looked for behind its end. What happens in one is independent of the others, as collisions have no memory.

use super::integral::Fragment;
use super::random::Random;
use super::splats::Setup;
use super::trace::Tracer;
use super::{Picture, decode};
use crate::camera::Camera;
use crate::scene::{Blend, RenderSettings, Scene};
use crate::validate::{SceneError, check};
use glam::{DVec2, DVec3};

/// The most samples a pixel: a standard error of 1e-4.
const MOST_SAMPLES: u32 = 1 << 24;

/// The optical depth of an opaque layer: one ray in 1e17 passes.
const MOST_OPAQUE: f64 = 40.0;

/// Samples that standard errors have on top, half at either end of what a channel may be: z² with z = 3.
const ADDED_SAMPLES: f64 = 9.0;

/// A picture of `width * height` pixels, rows from top to bottom, and how far it may be off.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear Rec. 709, premultiplied, and alpha: means over the samples of each pixel, the background behind.
    pub color: Vec<[f64; 4]>,
    /// Standard errors of these means. They are those of means over the samples and nine more, half of them at either
    /// end of what a channel may be along the ray (Agresti, Coull, *Approximate is Better than "Exact" for Interval
    /// Estimation of Binomial Proportions*, 1998), so that they are above 0 wherever samples could differ, also where
    /// none happened to. From a thousand samples on, whatever α is, it is off by more than three of them with a
    /// probability of at most 0.51 %, and by more than six with one of at most 1e-5. Under [`Blend::Display`] they
    /// are bounds, to first order.
    pub standard_error: Vec<[f64; 4]>,
}

/// Estimates the picture of [`ReferenceKind::R1`](super::ReferenceKind::R1) from random samples of the rays through
/// the pixels' centres.
///
/// In a sample every kernel has its first collision at an optical depth t along it of density e^{−t}: where t is
/// below its τ behind the near plane, at the z that has τΦ((z − z₀)/σ_z) = τΦ((near − z₀)/σ_z) + t. Each surface
/// layer, made by R1's rule, is hit with probability α. The nearest hit is what is seen. `Opacity` kernels are
/// defined by the order of their centres: between two layers a hit is as far away as its kernel's centre.
///
/// Uses all of rayon's current threads; the result is the same for any number of them. It changes with `seed` alone.
/// Time goes with samples times optical depth along a ray. Beyond an optical depth of 1e10 the faintest kernels
/// beside it are lost.
///
/// # Errors
/// Those of [`reference`](super::reference()), and when the number of samples is not from 1 to 2²⁴.
pub fn stochastic(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
    samples_a_pixel: u32,
    seed: u64,
) -> Result<Estimate, SceneError> {
    settings.validate()?;
    scene.validate()?;
    let range = (1..=MOST_SAMPLES).contains(&samples_a_pixel);
    check("number of samples", f64::from(samples_a_pixel), range, "it must be from 1 to 16777216 a pixel")?;
    let setup = Setup::new(scene, camera, settings, settings.low_pass);
    let background = setup.background().to_array();
    let picture = Picture::new(&setup, 0.0);
    let [width, height] = camera.size().map(|side| side as usize);
    let estimate = |tracer: &mut Tracer<'_, '_>, pixel: [usize; 2]| {
        let center = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5;
        let line = Line::new(tracer.chances(&setup.view.ray(center)));
        let mut sums = Sums::new(&line.chances, background);
        let mut random = Random::of_pixel(pixel, seed);
        for _ in 0..samples_a_pixel {
            sums.add(line.sample(&mut random));
        }
        finish(settings.blend, sums.statistics())
    };
    let (color, standard_error) = picture.pixels([width, height], &estimate, &|_| {}).into_iter().unzip();
    Ok(Estimate { width, height, color, standard_error })
}

/// Something that stops a ray, or not.
pub(super) struct Chance {
    /// −ln(1 − α).
    optical_depth: f64,
    place: Place,
    color: DVec3,
}

/// Where a ray is stopped.
enum Place {
    At(Distance),
    /// Along a kernel, of which shares lie before the near plane and behind it.
    Along {
        z: f64,
        sigma: f64,
        shares: [f64; 2],
    },
}

/// How far a ray comes: the number of layers before, and the z, which may lie beyond the next of these.
type Distance = (usize, f64);

impl Chance {
    /// Of a kernel behind `near`.
    pub(super) fn of_kernel(fragment: &Fragment, near: f64) -> Self {
        let Fragment { z, sigma, optical_depth, color } = *fragment;
        let shares = [near - z, z - near].map(|ahead| normal_cdf(ahead / sigma));
        Self { optical_depth: shares[1] * optical_depth, place: Place::Along { z, sigma, shares }, color }
    }

    /// Of what lies at a distance.
    pub(super) fn at(distance: Distance, optical_depth: f64, color: DVec3) -> Self {
        Self { optical_depth: optical_depth.min(MOST_OPAQUE), place: Place::At(distance), color }
    }
}

impl Place {
    /// How far a ray comes, between layers at these z, that is stopped at a share of the optical depth.
    fn distance(&self, share: f64, cuts: &[f64]) -> Distance {
        match *self {
            Self::At(distance) => distance,
            Self::Along { z, sigma, shares: [before, behind] } => {
                let passed = before + share * behind;
                let quantile = normal_quantile(passed.clamp(f64::MIN_POSITIVE, 1.0 - 0.5 * f64::EPSILON));
                let z = z + sigma * quantile;
                (cuts.partition_point(|cut| *cut <= z), z)
            }
        }
    }
}

/// Chances end to end, each as long as its optical depth.
struct Line {
    chances: Vec<Chance>,
    ends: Vec<f64>,
    /// Where layers are.
    cuts: Vec<f64>,
}

impl Line {
    fn new((chances, cuts): (Vec<Chance>, Vec<f64>)) -> Self {
        let lay = |end: &mut f64, chance: &Chance| {
            *end += chance.optical_depth;
            Some(*end)
        };
        let ends = chances.iter().scan(0.0, lay).collect();
        Self { chances, ends, cuts }
    }

    /// Draws once: the colour of what is hit, if anything is.
    fn sample(&self, random: &mut Random) -> Option<DVec3> {
        let (mut at, mut nearest, mut seen) = (0.0, (usize::MAX, f64::INFINITY), None);
        loop {
            at -= (-random.uniform()).ln_1p();
            let number = self.ends.partition_point(|end| *end <= at);
            let Some(Chance { optical_depth, place, color }) = self.chances.get(number) else { return seen };
            let end = self.ends[number];
            let distance = place.distance(1.0 - (end - at) / optical_depth, &self.cuts);
            if distance < nearest {
                (nearest, seen) = (distance, Some(*color));
            }
            at = end;
        }
    }
}

/// What the samples of a pixel add up to; channels are counted from the background's.
struct Sums {
    background: [f64; 4],
    /// Smallest and largest value that a channel may have.
    ends: [[f64; 2]; 4],
    count: f64,
    values: [f64; 4],
    squares: [f64; 4],
}

impl Sums {
    fn new(chances: &[Chance], background: [f64; 4]) -> Self {
        let zero = [0.0; 4];
        let mut sums = Self { background, ends: [[0.0; 2]; 4], count: 0.0, values: zero, squares: zero };
        for chance in chances.iter().filter(|chance| chance.optical_depth > 0.0) {
            let seen = sums.seen(chance.color);
            for ([low, high], value) in sums.ends.iter_mut().zip(seen) {
                (*low, *high) = (low.min(value), high.max(value));
            }
        }
        sums
    }

    fn seen(&self, color: DVec3) -> [f64; 4] {
        let seen = color.extend(1.0).to_array();
        std::array::from_fn(|i| seen[i] - self.background[i])
    }

    fn add(&mut self, hit: Option<DVec3>) {
        self.count += 1.0;
        if let Some(color) = hit {
            for (channel, value) in self.seen(color).into_iter().enumerate() {
                self.values[channel] += value;
                self.squares[channel] += value * value;
            }
        }
    }

    /// Means and their standard errors.
    fn statistics(&self) -> [[f64; 4]; 2] {
        let count = self.count + ADDED_SAMPLES;
        let error = |i: usize| {
            let [low, high] = self.ends[i];
            let mean = (self.values[i] + 0.5 * ADDED_SAMPLES * (low + high)) / count;
            let square = (self.squares[i] + 0.5 * ADDED_SAMPLES * (low * low + high * high)) / count;
            ((square - mean * mean).max(0.0) / count).sqrt()
        };
        [
            std::array::from_fn(|i| self.background[i] + self.values[i] / self.count),
            std::array::from_fn(error),
        ]
    }
}

/// Means and standard errors out of the space of blending. A colour C·g(C/A)/C is not linear there: to first order
/// it is off by g′ times what C is, and by g − (C/A)g′ times what A is.
fn finish(blend: Blend, [mean, error]: [[f64; 4]; 2]) -> ([f64; 4], [f64; 4]) {
    let color = decode(blend, mean);
    let alpha = mean[3];
    if blend == Blend::Linear || alpha <= 0.0 {
        return (color, error);
    }
    let of_channel = |i: usize| {
        let display = mean[i] / alpha;
        let slope = if display <= 0.040_45 {
            1.0 / 12.92
        } else {
            2.4 / 1.055 * ((display + 0.055) / 1.055).powf(1.4)
        };
        slope * error[i] + (color[i] / alpha - display * slope).abs() * error[3]
    };
    (color, [of_channel(0), of_channel(1), of_channel(2), error[3]])
}

/// Φ(x).
fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2)
}

/// Φ⁻¹, to a relative 2e-7: PPND7 of Wichura, *Algorithm AS 241: The Percentage Points of the Normal Distribution*,
/// 1988.
fn normal_quantile(p: f64) -> f64 {
    let horner = |coefficients: [f64; 4], x: f64| coefficients.into_iter().fold(0.0, |sum, c| sum * x + c);
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        let above = horner([59.109_374_72, 159.291_132_02, 50.434_271_938, 3.387_132_717_9], r);
        let below = horner([67.187_563_6, 78.757_757_664, 17.895_169_469, 1.0], r);
        return q * above / below;
    }
    let r = (-p.min(1.0 - p).ln()).sqrt();
    let size = if r <= 5.0 {
        let r = r - 1.6;
        horner([0.170_238_211_03, 1.306_728_481_6, 2.756_815_39, 1.423_437_277_7], r)
            / horner([0.0, 0.120_211_329_75, 0.737_001_642_5, 1.0], r)
    } else {
        let r = r - 5.0;
        horner([0.017_337_203_997, 0.428_682_943_37, 3.081_226_386, 6.657_905_115], r)
            / horner([0.0, 0.012_258_202_635, 0.241_978_942_25, 1.0], r)
    };
    size.copysign(q)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        for i in -3700..=3700 {
            // Above 5σ the argument itself is rounded to more than that.
            let x = f64::from(i) / 100.0;
            if x < 5.0 {
                let found = normal_quantile(normal_cdf(x));
                assert!((found - x).abs() <= 2e-7 * x.abs().max(1.0), "{found} is not {x}");
            }
        }
    }

    /// Binomial probabilities of being off by more than three and six standard errors.
    fn tails(count: u32, probability: f64) -> [f64; 2] {
        let n = f64::from(count);
        let hit = Chance::at((0, 1.0), -(-probability).ln_1p(), DVec3::ZERO);
        let mut sums = Sums { count: n, ..Sums::new(&[hit], [0.0; 4]) };
        let (mut tails, mut weight) = ([0.0; 2], (n * (-probability).ln_1p()).exp());
        for k in 0..=count {
            (sums.values[3], sums.squares[3]) = (f64::from(k), f64::from(k));
            let [mean, error] = sums.statistics().map(|channels| channels[3]);
            for (tail, errors) in tails.iter_mut().zip([3.0, 6.0]) {
                *tail += if (mean - probability).abs() > errors * error { weight } else { 0.0 };
            }
            weight *= (n - f64::from(k)) / (f64::from(k) + 1.0) * probability / (1.0 - probability);
        }
        tails
    }

    #[test]
    fn standard_errors_hold_at_every_probability() {
        for count in [1000, 4096] {
            // Expected hits from 0.01 to a hundred: beyond that a normal distribution is near.
            for i in -40..=40 {
                let hits = 10f64.powf(f64::from(i) / 20.0);
                let [three, six] = tails(count, hits / f64::from(count));
                assert!(three < 5.1e-3 && six < 1e-5, "{hits} of {count}: {three} {six}");
            }
        }
        // At even odds a thousand samples are nearly normal, of which 0.27 % lies beyond three: steps between counts
        // are 0.06 of a standard error, the density there 0.0044.
        let [three, _] = tails(1000, 0.5);
        assert!((three - 0.0027).abs() < 0.0006, "{three}");
    }

    #[test]
    fn a_ray_is_stopped_as_far_as_its_medium_says() {
        let kernel = Fragment { z: 7.0, sigma: 0.5, optical_depth: 4.0, color: DVec3::ONE };
        let z_at = |chance: &Chance, share: f64| chance.place.distance(share, &[]).1;
        let chance = Chance::of_kernel(&kernel, f64::NEG_INFINITY);
        assert!((chance.optical_depth - 4.0).abs() < 1e-12);
        // Φ(−2) of it is passed two σ before its middle.
        assert!((z_at(&chance, 0.022_750_131_948) - 6.0).abs() < 1e-6);
        // Of the half that is behind its middle a half is passed at Φ⁻¹(¾), and nothing before.
        let chance = Chance::of_kernel(&kernel, 7.0);
        assert!((chance.optical_depth - 2.0).abs() < 1e-12);
        assert!((z_at(&chance, 0.0) - 7.0).abs() < 1e-9);
        assert!((z_at(&chance, 0.5) - 7.337_244_875).abs() < 1e-6);
        // Layers tell its parts apart.
        assert_eq!([0.1, 0.5, 0.9].map(|share| chance.place.distance(share, &[7.2, 7.4]).0), [0, 1, 2]);
        // What is whole is stopped where it is.
        let chance = Chance::at((2, 3.0), 4.0, DVec3::ONE);
        assert_eq!(chance.place.distance(0.3, &[7.2]), (2, 3.0));
    }

    #[test]
    fn each_chance_is_taken_as_often_as_it_says() {
        // Far ones first. The second is hit unless the first is in its way, the third never: the last is opaque.
        let [a, b, c] = [0.5, 0.25, 1.0];
        let color = |number: usize| DVec3::AXES[number];
        let layer = |(alpha, z, i): (f64, f64, usize)| Chance::at((0, z), -(-alpha).ln_1p(), color(i));
        let layers = [(c, 2.5, 2), (0.9, 3.0, 0), (b, 2.0, 1), (a, 1.0, 0)];
        let line = Line::new((layers.map(layer).into(), Vec::new()));
        let (mut random, mut sum, count) = (Random::new(5), DVec3::ZERO, 100_000);
        for _ in 0..count {
            sum += line.sample(&mut random).unwrap_or(DVec3::NAN);
        }
        let expected = DVec3::new(a, (1.0 - a) * b, (1.0 - a) * (1.0 - b));
        // Four standard errors of at most ½/√n.
        let error = (sum / f64::from(count) - expected).abs().max_element();
        assert!(error < 2.0 / f64::from(count).sqrt(), "{error}");
    }
}
