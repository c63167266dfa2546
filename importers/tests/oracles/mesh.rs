//! Meshes against what other readers say of them.

use crate::agreement::Agreement;
use glam::DVec3;
use oblate_surfels::Mesh;
use serde::Deserialize;

#[derive(Deserialize)]
pub(crate) struct Facts {
    /// Positions in the file, if triangles share them there.
    vertices: Option<usize>,
    /// Where corners have more than a position: how many of them are different.
    corners: Option<usize>,
    triangles: usize,
    bounds: [[f64; 3]; 2],
    area: f64,
    area_centroid: [f64; 3],
    /// Above 0 where triangles are counter-clockwise seen from outside.
    signed_volume: f64,
    spot_triangles: Vec<SpotTriangle>,
    #[serde(default)]
    textures: Vec<Image>,
}

#[derive(Deserialize)]
struct SpotTriangle {
    index: usize,
    corners: [[f64; 3]; 3],
}

#[derive(Deserialize)]
struct Image {
    width: usize,
    height: usize,
    /// Of the encoded channels, from 0 to 255.
    mean: [f64; 3],
}

pub(crate) fn compare(agreement: &mut Agreement, mesh: &Mesh, facts: &Facts) {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for primitive in &mesh.primitives {
        let first = positions.len();
        let place = |p: &glam::Vec3| primitive.primitive_to_mesh.transform_point3(p.as_dvec3());
        positions.extend(primitive.positions.iter().map(place));
        triangles.extend(primitive.triangles.iter().map(|t| t.map(|corner| first + corner as usize)));
    }
    if let Some(count) = facts.corners.or(facts.vertices) {
        agreement.same("vertices", positions.len(), count);
    }
    agreement.same("triangles", triangles.len(), facts.triangles);
    if triangles.len() != facts.triangles {
        return;
    }
    let corners: Vec<[DVec3; 3]> = triangles.iter().map(|t| t.map(|corner| positions[corner])).collect();

    let used = || corners.iter().flatten().copied();
    let low = used().fold(DVec3::INFINITY, DVec3::min);
    let high = used().fold(DVec3::NEG_INFINITY, DVec3::max);
    let size = (high - low).length().max(high.length()).max(low.length());
    // Positions are single precision here and there; others' text may be rounded to it in another way, and matrices of
    // nodes are single precision, three products and sums.
    let rounding = 4.0 * f64::from(f32::EPSILON) * size;
    agreement.near("lower bound", &low.to_array(), &facts.bounds[0], rounding);
    agreement.near("upper bound", &high.to_array(), &facts.bounds[1], rounding);
    for spot in &facts.spot_triangles {
        let found = corners[spot.index].map(|p| p.to_array()).concat();
        agreement.near(&format!("triangle {}", spot.index), &found, &spot.corners.concat(), rounding);
    }

    let middle = (low + high) / 2.0;
    let (mut area, mut moment, mut volume) = (0.0, DVec3::ZERO, 0.0);
    for [a, b, c] in &corners {
        let share = (b - a).cross(c - a).length() / 2.0;
        area += share;
        moment += share * (a + b + c) / 3.0;
        volume += (a - middle).dot((b - middle).cross(c - middle)) / 6.0;
    }
    // A shift of all corners by the rounding moves each by no more, and an area by its edges' lengths times that; edges are
    // no longer than the mesh, and errors of many triangles add up in the worst case only.
    let relative = 64.0 * f64::from(f32::EPSILON);
    agreement.near("area", &[area], &[facts.area], relative * facts.area);
    agreement.near(
        "centroid of the area",
        &(moment / area).to_array(),
        &facts.area_centroid,
        relative * size,
    );
    agreement.near("signed volume", &[volume], &[facts.signed_volume], relative * facts.area * size);

    for (image, primitive) in facts.textures.iter().zip(&mesh.primitives) {
        let Some(texture) = &primitive.material.texture else {
            agreement.problem("has no texture");
            continue;
        };
        agreement.same("size of the texture", [texture.width, texture.height], [image.width, image.height]);
        let mean = [0, 1, 2].map(|channel| {
            let sum: u64 = texture.texels.iter().map(|texel| u64::from(texel[channel])).sum();
            sum as f64 / texture.texels.len() as f64
        });
        // Decoders of JPEG may differ by a step in a texel, from case to case up or down.
        agreement.near("mean of the texture", &mean, &image.mean, 0.5);
    }
}
