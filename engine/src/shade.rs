//! Light: Blinn–Phong (Blinn, *Models of light reflection for computer synthesized pictures*, 1977), for
//! volume kernels a step per splat, for surfaces deferred to the pixel.

use crate::camera::{Camera, Projection};
use crate::cloud::Material;
use crate::scene::{Light, Scene};
use crate::simd::*;
use glam::{DVec3, Vec3};

/// A light in camera space.
#[derive(Clone, Copy, Debug)]
enum Source {
    Towards(Vec3, Vec3),
    At(Vec3, Vec3),
}

/// A scene's lights in camera space.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lights {
    ambient: Vec3,
    sources: Vec<Source>,
    parallel_rays: bool,
}

/// How a material answers a scene's lights.
#[derive(Clone, Debug)]
pub(crate) struct Shader<'a> {
    material: Material,
    /// What the base colour is multiplied by wherever a point is: its emission and ambient light.
    everywhere: Vec3,
    lights: &'a Lights,
}

/// A highlight: its coefficient and exponent, and what makes the normal's length 1.
struct Highlight<F> {
    specular: F,
    exponent: F,
    per_length: F,
}

/// The mean of max(n·l, 0) over normals on the viewer's side whose mean, as axes, has this length, along a cosine with l; `facing` is
/// the cosine between l and the eye.
///
/// It is half the sum of the means of |n·l| and of n·l. Normals spread evenly around their mean have a mean square across it of
/// s = (1 − E cos²)/2, with E cos² = 1 − 2(1 − R) + 4(1 − R)²/3: right to first order for alike ones, and for axes from everywhere, where R
/// is ½. The mean of |n·l| is the root of the mean square, less by up to 13 %.
#[inline(always)]
fn mean_cosine<S: Simd, F: Floats<S>>(simd: S, length: F, cosine: F, facing: F) -> F {
    let (zero, half, one) = (F::simd_from(simd, 0.0), F::simd_from(simd, 0.5), F::simd_from(simd, 1.0));
    let lost = one - length.max(half).min(one);
    let across = lost * lost.mul_add(F::simd_from(simd, -2.0 / 3.0), one);
    let square = (cosine * cosine).mul_add(across.mul_add(F::simd_from(simd, -3.0), one), across);
    let either = across.mul_add(F::simd_from(simd, -0.402), one) * square.max(zero).sqrt();
    let signed = lost.mul_add(F::simd_from(simd, -2.0), one) * cosine + lost * facing;
    length.simd_gt(zero).select(((either + signed) * 0.5).max(zero), zero)
}

impl Lights {
    pub(crate) fn new(scene: &Scene, camera: &Camera) -> Self {
        let world_to_camera = camera.pose().world_to_camera;
        let mut ambient = Vec3::ZERO;
        let mut sources = Vec::new();
        for light in &scene.lights {
            match *light {
                Light::Ambient { color } => ambient += Vec3::from(color),
                Light::Directional { towards, color } => {
                    let towards = (world_to_camera.matrix3 * towards).normalize_or_zero();
                    sources.push(Source::Towards(towards.as_vec3(), color.into()));
                }
                Light::Point { position, color } => {
                    let position = world_to_camera.transform_point3(position);
                    sources.push(Source::At(position.as_vec3(), color.into()));
                }
            }
        }
        if scene.lights.is_empty() {
            ambient = Vec3::ONE;
            sources.push(Source::Towards((-DVec3::Z).as_vec3(), Vec3::ONE));
        }
        let parallel_rays = camera.projection() == Projection::Orthographic;
        Self { ambient, sources, parallel_rays }
    }

    /// On a material.
    pub(crate) fn on(&self, material: Material) -> Shader<'_> {
        Shader { material, everywhere: material.emission + self.ambient * material.ambient, lights: self }
    }
}

impl Shader<'_> {
    /// As [`Self::shade`], for a point that has no sides: the normal is turned to the viewer. The mean of several normals, shorter
    /// than 1, returns less light, in a wider highlight.
    pub(crate) fn shade_two_sided(&self, base: [f32; 3], normal: Vec3, position: Vec3) -> [f32; 3] {
        let faces_away = normal.dot(self.to_eye(position)) < 0.0;
        self.shade(base, if faces_away { -normal } else { normal }, position)
    }

    fn to_eye(&self, position: Vec3) -> Vec3 {
        if self.lights.parallel_rays { -Vec3::Z } else { (-position).normalize_or_zero() }
    }

    /// The colour sent to the camera by a point with a base colour and a normal, of length 1 or less, on the side that is
    /// seen. A point without a normal (zero), deep inside a uniform region, returns ambient light alone.
    fn shade(&self, base: [f32; 3], normal: Vec3, position: Vec3) -> [f32; 3] {
        let diffuse = self.material.diffuse;
        let Highlight { specular, exponent, per_length } = self.highlight_of_mean(normal.length());
        let base = Vec3::from(base);
        let to_eye = self.to_eye(position);
        let mut light = self.everywhere;
        let mut mirrored = Vec3::ZERO;
        for source in &self.lights.sources {
            let (towards, color) = match *source {
                Source::Towards(direction, color) => (direction, color),
                Source::At(place, color) => ((place - position).normalize_or_zero(), color),
            };
            let length = normal.length();
            let cosine = if length < 1.0 {
                dispatch!(Level::Baseline, simd => {
                    let [length, cosine, facing] =
                        [length, per_length * normal.dot(towards), to_eye.dot(towards)].map(|x| splat(simd, x));
                    mean_cosine(simd, length, cosine, facing).reduce_max()
                })
            } else {
                normal.dot(towards)
            };
            if cosine > 0.0 {
                light += color * (diffuse * cosine);
                let half = (towards + to_eye).normalize_or_zero();
                let cosine = (per_length * normal.dot(half)).max(0.0);
                mirrored += color * (specular * cosine.powf(exponent));
            }
        }
        (base * light + mirrored).to_array()
    }

    /// The highlight where the mean of unit normals is this long: as wide as it and the normals are.
    ///
    /// Toksvig, *Mipmapping Normal Maps*, 2005.
    fn highlight_of_mean(&self, length: f32) -> Highlight<f32> {
        let Material { specular, exponent, .. } = self.material;
        let length = length.min(1.0);
        if length == 0.0 {
            return Highlight { specular, exponent, per_length: 0.0 };
        }
        let wider = exponent * length / (length + exponent * (1.0 - length));
        Highlight {
            specular: specular * (1.0 + wider) / (1.0 + exponent),
            exponent: wider,
            per_length: 1.0 / length,
        }
    }

    /// The highlight of unit normals.
    #[inline(always)]
    fn highlight<S: Simd, F: Floats<S>>(&self, simd: S) -> Highlight<F> {
        let Material { specular, exponent, .. } = self.material;
        let [specular, exponent, per_length] = splat3(simd, [specular, exponent, 1.0]);
        Highlight { specular, exponent, per_length }
    }

    /// As [`Self::highlight_of_mean`], for many normals.
    #[inline(always)]
    fn highlight_of_means<S: Simd, F: Floats<S>>(&self, simd: S, normal: [F; 3]) -> Highlight<F> {
        let Material { specular, exponent, .. } = self.material;
        let one = F::simd_from(simd, 1.0);
        let length = dot(normal, normal).max(F::simd_from(simd, 1e-30)).sqrt().min(one);
        let wider = length * exponent / (one - length).mul_add(F::simd_from(simd, exponent), length);
        Highlight {
            specular: (wider + 1.0) * (specular / (1.0 + exponent)),
            exponent: wider,
            per_length: one / length,
        }
    }

    /// As [`Self::shade_two_sided`], for eight points; `are_means` says whether normals may be shorter than 1.
    #[inline(always)]
    pub(crate) fn shade_wide_two_sided<S: Simd>(
        &self,
        simd: S,
        base: V3<S>,
        (normal, are_means): (V3<S>, bool),
        position: V3<S>,
    ) -> V3<S> {
        if !self.is_lit() {
            return [0, 1, 2].each(
                #[inline(always)]
                |i| base[i] * self.everywhere[i],
            );
        }
        let cosine = dot(normal, self.to_eye_wide(simd, position));
        let turned = cosine.simd_lt(splat(simd, 0.0));
        let seen = normal.each(
            #[inline(always)]
            |n| turned.select(-n, n),
        );
        if are_means {
            let highlight = self.highlight_of_means(simd, normal);
            self.shade_with::<S, V<S>, true>(simd, base, (seen, highlight), position)
        } else {
            self.shade_with::<S, V<S>, false>(simd, base, (seen, self.highlight(simd)), position)
        }
    }

    /// Whether lights that come from somewhere matter.
    #[inline(always)]
    fn is_lit(&self) -> bool {
        self.material.diffuse > 0.0 || self.material.specular > 0.0
    }

    #[inline(always)]
    fn to_eye_wide<S: Simd, F: Floats<S>>(&self, simd: S, position: [F; 3]) -> [F; 3] {
        if self.lights.parallel_rays {
            splat3(simd, [0.0, 0.0, -1.0])
        } else {
            normalize_or_zero(
                simd,
                position.each(
                    #[inline(always)]
                    |x| -x,
                ),
            )
        }
    }

    /// As [`Self::shade`], for many points.
    #[inline(always)]
    pub(crate) fn shade_wide<S: Simd, F: Floats<S>>(
        &self,
        simd: S,
        base: [F; 3],
        normal: [F; 3],
        position: [F; 3],
    ) -> [F; 3] {
        let highlight = self.highlight_of_means(simd, normal);
        self.shade_with::<S, F, true>(simd, base, (normal, highlight), position)
    }

    /// Normals are shorter than 1 if they are `MEANS`.
    #[inline(always)]
    fn shade_with<S: Simd, F: Floats<S>, const MEANS: bool>(
        &self,
        simd: S,
        base: [F; 3],
        (normal, own): ([F; 3], Highlight<F>),
        position: [F; 3],
    ) -> [F; 3] {
        let diffuse = self.material.diffuse;
        let mut light = splat3(simd, self.everywhere.to_array());
        let mut highlight = splat3(simd, [0.0; 3]);
        if self.is_lit() {
            let to_eye = self.to_eye_wide(simd, position);
            for source in &self.lights.sources {
                let (towards, color) = match *source {
                    Source::Towards(direction, color) => (splat3(simd, direction.to_array()), color),
                    Source::At(place, color) => {
                        let place: [F; 3] = splat3(simd, place.to_array());
                        let towards = [0, 1, 2].each(
                            #[inline(always)]
                            |i| place[i] - position[i],
                        );
                        (normalize_or_zero(simd, towards), color)
                    }
                };
                let zero = F::simd_from(simd, 0.0);
                let cosine = if MEANS {
                    let length = dot(normal, normal).sqrt();
                    let cosine = dot(normal, towards) * own.per_length;
                    mean_cosine(simd, length, cosine, dot(towards, to_eye))
                } else {
                    dot(normal, towards).max(zero)
                };
                let half = normalize_or_zero(
                    simd,
                    [0, 1, 2].each(
                        #[inline(always)]
                        |i| towards[i] + to_eye[i],
                    ),
                );
                let mirrored = (dot(normal, half) * own.per_length).max(zero);
                let mirrored = if self.material.exponent == 0.0 {
                    F::simd_from(simd, 1.0)
                } else {
                    pow_positive(simd, mirrored, own.exponent)
                };
                let mirrored = cosine.simd_gt(zero).select(mirrored * own.specular, zero);
                for (channel, color) in color.to_array().into_iter().enumerate() {
                    light[channel] = cosine.mul_add(F::simd_from(simd, color * diffuse), light[channel]);
                    highlight[channel] = mirrored.mul_add(F::simd_from(simd, color), highlight[channel]);
                }
            }
        }
        [0, 1, 2].each(
            #[inline(always)]
            |i| base[i].mul_add(light[i], highlight[i]),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;

    #[test]
    fn eight_points_are_shaded_as_one_is() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, -5.0), DVec3::ZERO, DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 0.5, [64; 2]).unwrap();
        let lights = vec![
            Light::Ambient { color: [0.2, 0.1, 0.3] },
            Light::Directional { towards: DVec3::new(1.0, 2.0, -3.0), color: [0.5, 0.6, 0.7] },
            Light::Point { position: DVec3::new(-2.0, 1.0, -4.0), color: [0.9, 0.5, 0.1] },
        ];
        for lights in [Vec::new(), lights] {
            for material in [
                Material::default(),
                Material::UNLIT,
                Material { exponent: 0.0, emission: 0.4, ..Material::default() },
            ] {
                let scene = Scene { clouds: Vec::new(), lights: lights.clone() };
                let of_scene = Lights::new(&scene, &camera);
                let shader = of_scene.on(material);
                let normals: [Vec3; 8] = std::array::from_fn(|i| {
                    let i = i as f32;
                    if i == 0.0 { Vec3::ZERO } else { Vec3::new(i.sin(), i.cos(), 1.0 - i / 3.0).normalize() }
                });
                let positions: [Vec3; 8] =
                    std::array::from_fn(|i| Vec3::new(i as f32 - 4.0, 0.5 * i as f32, 6.0));
                let means = std::array::from_fn(|i| normals[i] * (1.0 - 0.13 * i as f32));
                let cases = [(normals, false), (normals, true), (means, true)];
                let base = [0.3, 0.6, 0.9];
                let lanes = |v: [Vec3; 8]| [0, 1, 2].map(|axis| v.map(|v| v[axis]));
                let levels = || Level::ALL.into_iter().filter(|level| level.is_available());
                for (level, (normals, are_means)) in
                    levels().flat_map(|level| cases.map(|case| (level, case)))
                {
                    let found: [[f32; 8]; 3] = dispatch!(level, simd => {
                        let read = |v: [Vec3; 8]| lanes(v).map(|lanes| V::simd_from(simd, lanes));
                        let base = splat3(simd, base);
                        shader.shade_wide_two_sided(simd, base, (read(normals), are_means), read(positions)).map(|v| v.into())
                    });
                    for lane in 0..8 {
                        let expected = shader.shade_two_sided(base, normals[lane], positions[lane]);
                        for channel in 0..3 {
                            // A power of 20 raises the rounding of cosines by as much.
                            let error = (found[channel][lane] - expected[channel]).abs();
                            assert!(error < 2e-5, "{level:?}, point {lane}: off by {error}");
                        }
                    }
                }
            }
        }
    }
}
