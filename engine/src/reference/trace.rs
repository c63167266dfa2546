//! One ray through a block's splats.

use super::integral::{Fragment, March, NormalDistribution, OPAQUE, STEPS_PER_SIGMA};
use super::layers::{Layer, Sample, layers};
use super::shading::Spot;
use super::splats::{Kernel, Setup, Splat, Surfel};
use super::stochastic::Chance;
use super::view::Ray;
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

/// The splats that rays of one block can meet, and room to work in.
pub(super) struct Tracer<'s, 'a> {
    setup: &'s Setup<'a>,
    normal: &'s NormalDistribution,
    surfels: Vec<Surfel<'a>>,
    kernels: Vec<Kernel>,
    samples: Vec<Sample<'a>>,
    fragments: Vec<Fragment>,
}

impl<'s, 'a> Tracer<'s, 'a> {
    pub(super) fn new(
        setup: &'s Setup<'a>,
        normal: &'s NormalDistribution,
        splats: impl Iterator<Item = Splat<'a>>,
    ) -> Self {
        let (mut surfels, mut kernels) = (Vec::new(), Vec::new());
        for splat in splats {
            match splat {
                Splat::Surfel(surfel) => surfels.push(surfel),
                Splat::Kernel(kernel) => kernels.push(kernel),
            }
        }
        if setup.by_centers {
            kernels.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.id.cmp(&b.id)));
        }
        Self { setup, normal, surfels, kernels, samples: Vec::new(), fragments: Vec::new() }
    }

    /// What is seen along a ray, and its first surface.
    pub(super) fn trace(&mut self, ray: &Ray) -> (Path, Option<FirstSurface>) {
        let near = self.setup.view.near;
        self.fragments.clear();
        self.fragments.extend(self.kernels.iter().filter_map(|k| k.fragment(ray)));
        self.take_samples(ray);
        // Whole kernels are in the order of their centres, and stay.
        let whole = if self.setup.by_centers { std::mem::take(&mut self.fragments) } else { Vec::new() };
        let mut path = Path::new();
        let mut march = March::new(self.normal, &mut self.fragments, near, STEPS_PER_SIGMA);
        let (mut first, mut from) = (None, near);
        for layer in layers(&mut self.samples) {
            first.get_or_insert(FirstSurface { z: layer.z, id: layer.id, normal: layer.normal });
            march.advance(layer.z, &mut path);
            add_whole(self.normal, &whole, [from, layer.z], &mut path);
            from = layer.z;
            path.over(layer.alpha, shaded(self.setup, &layer, ray), layer.z);
            if path.transmittance <= OPAQUE {
                break;
            }
        }
        march.advance(f64::INFINITY, &mut path);
        add_whole(self.normal, &whole, [from, f64::INFINITY], &mut path);
        (path, first)
    }

    /// All that a ray may hit.
    pub(super) fn chances(&mut self, ray: &Ray) -> Vec<Chance> {
        self.take_samples(ray);
        let (setup, near) = (self.setup, self.setup.view.near);
        let kernels = || self.kernels.iter().filter_map(|kernel| Some((kernel, kernel.fragment(ray)?)));
        let layers = layers(&mut self.samples).map(|layer| {
            let color = shaded(setup, &layer, ray);
            (layer.z, layer.alpha, color)
        });
        let mut chances = Vec::new();
        if !setup.by_centers {
            chances.extend(kernels().map(|(_, fragment)| Chance::of_kernel(&fragment, near)));
            chances.extend(layers.map(|(z, alpha, color)| Chance::of_layer(alpha, (0, z), color)));
            return chances;
        }
        // Between two layers nothing but the order of centres counts.
        let (mut from, mut segment) = (near, 0);
        for (z, alpha, color) in layers.chain([(f64::INFINITY, 0.0, DVec3::ZERO)]) {
            chances.extend(kernels().map(|(kernel, fragment)| {
                Chance::of_share(&fragment, [from, z], (segment, kernel.distance))
            }));
            chances.push(Chance::of_layer(alpha, (segment, f64::INFINITY), color));
            (from, segment) = (z, segment + 1);
        }
        chances
    }

    /// The first surface of a ray.
    pub(super) fn first_surface(&mut self, ray: &Ray) -> Option<FirstSurface> {
        self.take_samples(ray);
        let layer = layers(&mut self.samples).next()?;
        Some(FirstSurface { z: layer.z, id: layer.id, normal: layer.normal })
    }

    fn take_samples(&mut self, ray: &Ray) {
        let near = self.setup.view.near;
        self.samples.clear();
        self.samples.extend(self.surfels.iter().filter_map(|s| s.sample(ray, near)));
    }
}

/// Adds what lies between two depths of kernels that are composited whole there, one after the other.
fn add_whole(normal: &NormalDistribution, whole: &[Fragment], [from, to]: [f64; 2], path: &mut Path) {
    for f in whole {
        let share = normal.at((to - f.z) / f.sigma) - normal.at((from - f.z) / f.sigma);
        path.over(-(-share.max(0.0) * f.optical_depth).exp_m1(), f.color, f.z.max(from).min(to));
    }
}

fn shaded(setup: &Setup<'_>, layer: &Layer<'_>, ray: &Ray) -> DVec3 {
    if !setup.settings.shade {
        return layer.color;
    }
    let spot = Spot { point: ray.at(layer.z), normal: layer.normal, seen_along: ray.direction };
    setup.lighting.shade(layer.color, layer.material, &spot)
}
