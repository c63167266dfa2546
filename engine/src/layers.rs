//! Stage `layers`: the surface samples of a tile to cuts, at most four a pixel.
//!
//! A sample spans the depths from where it is seen to where its plane passes the pixel; a layer takes a pixel's
//! samples whose span comes within ε + 3σ_z of its first one's. Spans that meet are one surface: that is the
//! A-buffer test of Zwicker, Pfister, van Baar, Gross, *Surface splatting*, 2001. Without the plane a tilted
//! surface whose surfels are smaller than the pixel's filter would fall apart into layers.
//!
//! Peeling layer by layer over the whole tile needs no sort: one pass finds each pixel's first sample, one
//! adds what belongs to it and keeps the rest.

use crate::bin::TILE;
use crate::cloud::Cloud;
use crate::columns::Kind;
use crate::composite::Cut;
use crate::footprint::Records;
use crate::raster::Sample;
use glam::Vec3;

/// Layers a pixel; the last takes whatever is left.
pub(crate) const MAX_LAYERS: usize = 4;

/// The cuts of a tile's pixels, near to far.
pub(crate) struct Cuts {
    counts: Vec<u8>,
    cuts: Vec<Cut>,
}

impl Cuts {
    pub(crate) fn new() -> Self {
        Self { counts: vec![0; TILE * TILE], cuts: vec![Cut::default(); TILE * TILE * MAX_LAYERS] }
    }

    /// The cuts of a pixel.
    pub(crate) fn of(&self, pixel: usize) -> &[Cut] {
        &self.cuts[pixel * MAX_LAYERS..][..self.counts[pixel] as usize]
    }

    fn push(&mut self, pixel: usize, cut: Cut) {
        self.cuts[pixel * MAX_LAYERS + self.counts[pixel] as usize] = cut;
        self.counts[pixel] += 1;
    }
}

/// Sums over the samples of one layer.
#[derive(Clone, Copy, Default)]
struct Layer {
    first: Option<First>,
    weight: f32,
    opacity: f32,
    depth: f32,
    color: Vec3,
    /// Of the splats that show their front, and of those that show their back.
    sides: [Side; 2],
}

/// Normals of one side. The two sides of a thin sheet would cancel, so they are never added.
#[derive(Clone, Copy, Default)]
struct Side {
    weight: f32,
    normal: Vec3,
}

/// The sample that opens a layer.
#[derive(Clone, Copy)]
struct First {
    depth: f32,
    /// The far end of its span.
    farthest: f32,
    id: u32,
    record: u32,
}

/// How far one sees into a pixel past its layers so far.
///
/// Coverage is a share of the pixel's area. A layer covers what is left bare first, and only then what is
/// covered already: the parts of one surface that fall into two layers, at a crease or along a silhouette, lie
/// beside each other. Were they independent, every such pixel would let the background through.
#[derive(Clone, Copy)]
struct SeenThrough {
    /// Share of the pixel that no layer covers.
    bare: f32,
    /// What the covered share lets through, as a share of the pixel.
    covered: f32,
}

impl SeenThrough {
    const NOTHING_YET: Self = Self { bare: 1.0, covered: 0.0 };

    fn transmittance(self) -> f32 {
        self.bare + self.covered
    }

    /// Puts a layer behind, and returns the opacity with which it is composited.
    fn cover(&mut self, coverage: f32, opacity: f32) -> f32 {
        let before = self.transmittance();
        let beside = coverage.min(self.bare);
        let behind = if self.bare < 1.0 { (coverage - beside) / (1.0 - self.bare) } else { 0.0 };
        self.covered = self.covered * (1.0 - opacity * behind) + beside * (1.0 - opacity);
        self.bare -= beside;
        if before > 0.0 { 1.0 - self.transmittance() / before } else { 1.0 }
    }
}

/// Turns samples into cuts. Behind a transmittance of `spent` nothing is kept.
pub(crate) struct LayerBuilder<'a> {
    records: &'a Records,
    depth_tolerances: Vec<f32>,
    spent: f32,
}

impl<'a> LayerBuilder<'a> {
    pub(crate) fn new(clouds: &[Cloud], records: &'a Records, spent: f32) -> Self {
        let depth_tolerances = clouds
            .iter()
            .map(|cloud| match &cloud.columns().kind {
                // A scaled cloud scales its radii; the cube root is exact for uniform scales.
                Kind::Surface(surface) => {
                    let scale = cloud.cloud_to_world().matrix3.determinant().abs().cbrt();
                    surface.depth_tolerance * scale as f32
                }
                _ => 0.0,
            })
            .collect();
        Self { records, depth_tolerances, spent }
    }

    /// Consumes the samples, which come in the tile's order, and fills `cuts`.
    pub(crate) fn build(&self, samples: &mut Vec<Sample>, cuts: &mut Cuts) {
        cuts.counts.fill(0);
        let mut seen_through = [SeenThrough::NOTHING_YET; TILE * TILE];
        let mut layers = [Layer::default(); TILE * TILE];
        for number in 0..MAX_LAYERS {
            if samples.is_empty() {
                return;
            }
            layers.fill(Layer::default());
            for sample in samples.iter() {
                self.open(sample, &mut layers[sample.pixel as usize]);
            }
            let last = number + 1 == MAX_LAYERS;
            samples.retain(|sample| !self.add(sample, &mut layers[sample.pixel as usize], last));
            for (pixel, layer) in layers.iter().enumerate() {
                if let Some(mut cut) = self.close(layer, last, &mut seen_through[pixel]) {
                    // Means of spans that overlap need not be in order; cuts are.
                    let nearer = cuts.of(pixel).last().map_or(cut.depth, |cut| cut.depth);
                    cut.depth = cut.depth.max(nearer);
                    cuts.push(pixel, cut);
                }
            }
            samples.retain(|sample| seen_through[sample.pixel as usize].transmittance() > self.spent);
        }
    }

    fn open(&self, sample: &Sample, layer: &mut Layer) {
        let id = self.records.records[sample.record as usize].id;
        let nearer = layer.first.is_none_or(|first| (sample.depth, id) < (first.depth, first.id));
        if nearer {
            let farthest = sample.farthest();
            layer.first = Some(First { depth: sample.depth, farthest, id, record: sample.record });
        }
    }

    /// Adds a sample if it belongs to the layer, and says whether it did.
    fn add(&self, sample: &Sample, layer: &mut Layer, last: bool) -> bool {
        let Some(first) = layer.first else { return false };
        let tolerance = self.depth_tolerances[self.records.records[first.record as usize].cloud as usize];
        if !last && sample.nearest() > first.farthest + tolerance + 3.0 * sample.sigma_z {
            return false;
        }
        let record = &self.records.records[sample.record as usize];
        let surface = &self.records.surface_samples[sample.record as usize];
        layer.weight += sample.weight;
        layer.opacity += sample.weight * surface.opacity;
        layer.depth += sample.weight * (sample.depth - first.depth);
        let side = &mut layer.sides[usize::from(sample.faces_away)];
        side.weight += sample.weight;
        side.normal += Vec3::from(surface.normal) * sample.weight;
        layer.color += Vec3::from(record.color) * sample.weight;
        true
    }

    fn close(&self, layer: &Layer, last: bool, seen_through: &mut SeenThrough) -> Option<Cut> {
        let first = layer.first?;
        let [front, back] = layer.sides;
        // On the side that is seen.
        let normal = if front.weight >= back.weight { front.normal } else { -back.normal };
        let opacity = layer.opacity / layer.weight;
        // The last layer may be several sheets, one behind the other.
        let sheets = if last { layer.weight.max(1.0) } else { 1.0 };
        let opacity = if opacity < 1.0 { 1.0 - (1.0 - opacity).powf(sheets) } else { 1.0 };
        Some(Cut {
            depth: first.depth + layer.depth / layer.weight,
            alpha: seen_through.cover(layer.weight.min(1.0), opacity),
            color: (layer.color / layer.weight).to_array(),
            normal: normal.normalize_or_zero().to_array(),
            id: first.id,
            cloud: self.records.records[first.record as usize].cloud,
        })
    }
}
