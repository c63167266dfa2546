//! One ray through a block's splats.

use super::integral::{Fragment, March, NormalDistribution, OPAQUE, STEPS_PER_SIGMA};
use super::layers::{Layer, Sample, layers, segments};
use super::shading::Spot;
use super::splats::{Kernel, Setup, Splat, Surfel};
use super::stochastic::Chance;
use super::view::Ray;
use crate::frame::LEAST_VISIBLE;
use glam::DVec3;

/// What was seen so far along a ray; everything is premultiplied.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    pub(super) color: DVec3,
    /// Depths times their contributions.
    pub(super) z: f64,
    pub(super) transmittance: f64,
    /// z at which the transmittance has fallen to a half; infinity before it has.
    pub(super) median_z: f64,
}

impl Path {
    pub(super) fn new() -> Self {
        Self { color: DVec3::ZERO, z: 0.0, transmittance: 1.0, median_z: f64::INFINITY }
    }

    /// Puts something flat behind all that is there.
    fn over(&mut self, alpha: f64, color: DVec3, z: f64) {
        let contribution = self.transmittance * alpha;
        self.color += contribution * color;
        self.z += contribution * z;
        self.transmittance *= 1.0 - alpha;
        if self.transmittance <= 0.5 && self.median_z == f64::INFINITY {
            self.median_z = z;
        }
    }
}

/// The first surface of a ray.
#[derive(Clone, Copy)]
pub(super) struct FirstSurface {
    pub(super) z: f64,
    pub(super) id: u32,
    /// In camera space, any length.
    pub(super) normal: DVec3,
}

/// Whether a layer is a surface.
fn shows(layer: &Layer) -> bool {
    layer.alpha >= f64::from(LEAST_VISIBLE)
}

/// The splats that rays of one block can meet, and room to work in.
pub(super) struct Tracer<'s, 'a> {
    setup: &'s Setup<'a>,
    normal: &'s NormalDistribution,
    surfels: Vec<Surfel<'a>>,
    /// Those that are spread along rays.
    kernels: Vec<Kernel>,
    /// Those that are composited at their centres, from near to far.
    whole: Vec<Kernel>,
    /// Of these, those that the ray meets.
    met: Vec<Whole>,
    samples: Vec<Sample<'a>>,
    fragments: Vec<Fragment>,
}

/// A kernel that is composited whole between two surfaces, at the z where a ray is as far away as its centre.
#[derive(Clone, Copy)]
pub(super) struct Whole {
    pub(super) fragment: Fragment,
    pub(super) at: f64,
    pub(super) id: u32,
}

impl Whole {
    pub(super) fn of(kernel: &Kernel, ray: &Ray) -> Option<Self> {
        let at = kernel.distance / ray.direction.length();
        Some(Self { fragment: kernel.fragment(ray)?, at, id: kernel.id })
    }

    /// Its optical depth between two depths.
    pub(super) fn between(&self, normal: &NormalDistribution, [from, to]: [f64; 2]) -> f64 {
        let Fragment { z, sigma, optical_depth, .. } = self.fragment;
        (normal.at((to - z) / sigma) - normal.at((from - z) / sigma)).max(0.0) * optical_depth
    }
}

impl<'s, 'a> Tracer<'s, 'a> {
    pub(super) fn new(
        setup: &'s Setup<'a>,
        normal: &'s NormalDistribution,
        splats: impl Iterator<Item = Splat<'a>>,
    ) -> Self {
        let (mut surfels, mut kernels, mut whole) = (Vec::new(), Vec::new(), Vec::new());
        for splat in splats {
            match splat {
                Splat::Surfel(surfel) => surfels.push(surfel),
                Splat::Kernel(kernel) if kernel.is_whole => whole.push(kernel),
                Splat::Kernel(kernel) => kernels.push(kernel),
            }
        }
        whole.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.id.cmp(&b.id)));
        let (met, samples, fragments) = Default::default();
        Self { setup, normal, surfels, kernels, whole, met, samples, fragments }
    }

    /// What is seen along a ray, and its first surface.
    pub(super) fn trace(&mut self, ray: &Ray) -> (Path, Option<FirstSurface>) {
        let near = self.setup.view.near;
        self.fragments.clear();
        self.fragments.extend(self.kernels.iter().filter_map(|k| k.fragment(ray)));
        self.take_samples(ray);
        self.met.clear();
        self.met.extend(self.whole.iter().filter_map(|kernel| Whole::of(kernel, ray)));
        let mut path = Path::new();
        let mut march = March::new(self.normal, &mut self.fragments, near, STEPS_PER_SIGMA);
        let mut first = None;
        for ([from, to], layer) in segments(layers(&mut self.samples), near) {
            for kernel in &self.met {
                let alpha = -(-kernel.between(self.normal, [from, to])).exp_m1();
                if alpha > 0.0 {
                    march.advance(kernel.at.max(from).min(to), &mut path);
                    path.over(alpha, kernel.fragment.color, kernel.fragment.z.max(from).min(to));
                }
            }
            march.advance(to, &mut path);
            let Some(layer) = layer else { break };
            if first.is_none() && shows(&layer) {
                first = Some(FirstSurface { z: layer.z, id: layer.id, normal: layer.normal });
            }
            path.over(layer.alpha, shaded(self.setup, &layer, ray), layer.z);
            if path.transmittance <= OPAQUE {
                break;
            }
        }
        (path, first)
    }

    /// All that a ray may hit, and where the layers are.
    pub(super) fn chances(&mut self, ray: &Ray) -> (Vec<Chance>, Vec<f64>) {
        self.take_samples(ray);
        let (setup, near) = (self.setup, self.setup.view.near);
        let spread = self.kernels.iter().filter_map(|kernel| kernel.fragment(ray));
        let mut chances: Vec<Chance> = spread.map(|fragment| Chance::of_kernel(&fragment, near)).collect();
        self.met.clear();
        self.met.extend(self.whole.iter().filter_map(|kernel| Whole::of(kernel, ray)));
        let mut cuts = Vec::new();
        for (ends, layer) in segments(layers(&mut self.samples), near) {
            let segment = cuts.len();
            chances.extend(self.met.iter().filter_map(|kernel| {
                let optical_depth = kernel.between(self.normal, ends);
                let chance = Chance::at((segment, kernel.at), optical_depth, kernel.fragment.color);
                (optical_depth > 0.0).then_some(chance)
            }));
            let Some(layer) = layer else { break };
            let optical_depth = -(-layer.alpha).ln_1p();
            chances.push(Chance::at((segment, f64::INFINITY), optical_depth, shaded(setup, &layer, ray)));
            cuts.push(layer.z);
        }
        (chances, cuts)
    }

    /// The first surface of a ray.
    pub(super) fn first_surface(&mut self, ray: &Ray) -> Option<FirstSurface> {
        self.take_samples(ray);
        let layer = layers(&mut self.samples).find(shows)?;
        Some(FirstSurface { z: layer.z, id: layer.id, normal: layer.normal })
    }

    fn take_samples(&mut self, ray: &Ray) {
        let near = self.setup.view.near;
        self.samples.clear();
        self.samples.extend(self.surfels.iter().filter_map(|s| s.sample(ray, near)));
    }
}

fn shaded(setup: &Setup<'_>, layer: &Layer<'_>, ray: &Ray) -> DVec3 {
    if !setup.settings.shade {
        return layer.color;
    }
    let spot = Spot { point: ray.at(layer.z), normal: layer.normal, seen_along: ray.direction };
    setup.lighting.shade(layer.color, layer.material, &spot)
}
