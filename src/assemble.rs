//! Meshes, volumes and trained splats to a scene of splats and the view that shows it.

use crate::content::{Body, Item, placed_mesh, placed_volume};
use crate::description::{CameraOptions, Look};
use crate::detail::levels_pay;
use crate::draw::Drawing;
use crate::finish::{Paint, cutting, kept, reached};
use crate::framing::{View, farthest, outline};
use crate::points::{Placed, placed_settings};
use crate::progress::Console;
use crate::volume_looks::{Field, volume_clouds};
use anyhow::{Context, Result, ensure};
use glam::{DAffine3, DMat3, DVec3};
use oblate::engine::{Camera, Cloud, HalfSpace, Light, Scene};
use oblate::surfels::{
    Density, Mesh, SamplerSettings, point_surfels, sample, sample_seen, seen_count, shown_spacing,
    view_spacing,
};
use rayon::prelude::*;

/// Surfels of all meshes together, where their number follows the view: in all and for each pixel of the
/// picture. The nearest place sets the density of the whole, and beyond some surfels a pixel nobody sees more.
const MOST_SURFELS: f64 = 4e6;
const MOST_SURFELS_A_PIXEL: f64 = 16.0;

/// Pixels that count where the picture has fewer. A wall that comes near the eye takes up to 50,000 surfels in each octave of depths,
/// however few pixels there are: fewer would be too wide for their depths.
const LEAST_PIXELS: f64 = 65_536.0;

/// Surfels of a mesh that may be asked for: about 8 GiB.
const MOST_ASKED: usize = 100_000_000;

/// Clouds that a scene can hold, and splats that its ids can name.
const MOST_CLOUDS: usize = u16::MAX as usize;
const MOST_SPLATS: usize = u32::MAX as usize - 1;

/// A scene ready to be drawn.
pub(crate) struct Assembled {
    pub(crate) scene: Scene,
    pub(crate) camera: Camera,
    pub(crate) view: View,
    /// Of each cloud: what it is of, and which of that thing's places it stands in.
    pub(crate) origins: Vec<(String, usize)>,
}

/// A cloud in the world at one of its places, and the moves that take it to each of them.
struct Standing {
    name: String,
    cloud: Cloud,
    /// The numbers of its places.
    places: Vec<usize>,
    moves: Vec<DAffine3>,
    /// What of the world it is left in; planes that miss it are among them.
    kept: Vec<HalfSpace>,
}

impl Standing {
    /// In all of its places.
    fn new((name, cloud): (&str, Cloud), moves: &[DAffine3], kept: &[HalfSpace]) -> Self {
        let places = (0..moves.len()).collect();
        Self { name: name.to_owned(), cloud, places, moves: moves.to_vec(), kept: kept.to_vec() }
    }

    /// What is left of it: where nothing is cut itself, else what of it stands in each place.
    fn cut(mut self) -> Result<Vec<Self>> {
        let in_world: Vec<DAffine3> = self.moves.iter().map(|to| *to * self.cloud.cloud_to_world()).collect();
        self.kept = cutting(self.kept, || reached(&self.cloud), &in_world);
        if self.kept.is_empty() {
            return Ok(vec![self]);
        }
        let in_place = |(number, to): (usize, &DAffine3)| {
            let cloud = self.cloud.clone().transformed(*to).clipped(&self.kept)?;
            let (name, places) = (self.name.clone(), vec![self.places[number]]);
            Ok(Self { name, cloud, places, moves: vec![DAffine3::IDENTITY], kept: Vec::new() })
        };
        self.moves.iter().enumerate().map(in_place).collect()
    }
}

/// Turns items into splats. Volumes and what is splats already come first: they don't depend on the view, the
/// view is framed on what they show, and the number of surfels of a mesh follows the view. What stands in many places
/// is made into splats once.
pub(crate) fn assemble(
    items: Vec<Item>,
    camera: &CameraOptions,
    lights: Vec<Light>,
    drawing: &Drawing,
    console: Console,
) -> Result<Assembled> {
    let places: usize = items.iter().map(|item| item.places.len()).sum();
    ensure!(
        places <= MOST_CLOUDS,
        "the scene has {places} instances; at most {MOST_CLOUDS} clouds can be drawn"
    );
    // A volume's axes are named in its file; what is up in others is custom.
    let first =
        items.iter().find(|item| matches!(item.body, Body::Volume(_) | Body::Irregular(_))).or(items.first());
    let up = first.map_or(DVec3::Y, |item| item.up);
    let mut point_settings = placed_settings(&items, up_of_things(camera, up))?.into_iter();
    let (mut standing, mut meshes) = (Vec::new(), Vec::new());
    for Item { name, body, places, look, .. } in items {
        let moves = moves_from(&places, 0);
        let kept = kept(&look);
        let stand = |cloud| Standing::new((&name, cloud), &moves, &kept);
        match body {
            Body::Mesh(mesh) => {
                let kept = cutting(kept, || mesh.bounds(), &places);
                meshes.push(StandingMesh { name, mesh, places, look, kept });
            }
            Body::Splats { cloud, .. } => standing.push(stand(cloud.transformed(places[0]))),
            Body::Points(points) => {
                let _task = console.task(format!("surfels of {name}"));
                let in_places = point_settings.next().unwrap_or_default();
                for Placed { settings, places: own, .. } in in_places {
                    let cloud = point_surfels(&points, &settings).with_context(|| name.clone())?;
                    let to: Vec<DAffine3> = own.iter().map(|place| places[*place]).collect();
                    let (cloud, moves) = (cloud.transformed(to[0]), moves_from(&to, 0));
                    standing.push(Standing { places: own, moves, ..stand(cloud) });
                }
            }
            Body::Volume(volume) => {
                let volume = placed_volume(volume, places[0])?;
                let field = Field::Regular(&volume);
                standing.extend(shown_of(field, (&name, &look, places[0]), console)?.into_iter().map(stand));
            }
            Body::Irregular(volume) => {
                let volume = volume.placed(places[0]).with_context(|| name.clone())?;
                let field = Field::Irregular(&volume);
                standing.extend(shown_of(field, (&name, &look, places[0]), console)?.into_iter().map(stand));
            }
        }
    }

    let view = framed(camera, (&standing, &meshes), up, drawing.size)?;
    let camera = view.camera(drawing.size)?;
    let [width, height] = drawing.size.map(f64::from);
    let most = MOST_SURFELS.min(MOST_SURFELS_A_PIXEL * (width * height).max(LEAST_PIXELS));
    let sampled: Vec<_> = meshes.into_iter().map(|mesh| mesh.at_the_nearest(&camera)).collect();
    // Those that want less than others leave them what there is; one alone may have all.
    let wanted: Vec<f64> = match &sampled[..] {
        [_] => vec![1.0],
        several => several.iter().map(|(mesh, moves)| mesh.wanted(&camera, moves)).collect(),
    };
    let for_each = most / wanted.iter().sum::<f64>().max(1.0);
    // Of the ids that are left each place takes as many as another.
    let taken: usize = standing.iter().map(|own| own.cloud.len().saturating_mul(own.moves.len())).sum();
    let ids = MOST_SPLATS.saturating_sub(taken)
        / sampled.iter().map(|(_, moves)| moves.len()).sum::<usize>().max(1);
    for ((mesh, moves), wanted) in sampled.into_iter().zip(wanted) {
        let is_whole = mesh.is_whole(&moves);
        let StandingMesh { name, mesh, look, kept, .. } = mesh;
        let _task = console.task(format!("surfels of {name}"));
        let share = (wanted * for_each) as usize;
        let clouds =
            surfels(&mesh, &look, (&camera, is_whole), share.min(ids)).with_context(|| name.clone())?;
        let stand = |cloud| Standing::new((&name, cloud), &moves, &kept);
        standing.extend(clouds.into_iter().map(stand));
    }

    let (mut clouds, mut origins) = (Vec::with_capacity(places), Vec::with_capacity(places));
    let shown = standing.iter().filter(|standing| !standing.cloud.is_empty());
    let mut names: Vec<String> = shown.map(|standing| standing.name.clone()).collect();
    names.dedup();
    let cut = standing.into_iter().map(Standing::cut).collect::<Result<Vec<_>>>()?;
    for name in names {
        let mut left = cut.iter().flatten().filter(|standing| standing.name == name);
        if left.all(|standing| standing.cloud.is_empty()) {
            console.say(format_args!("{name}: the planes leave nothing of it"));
        }
    }
    for Standing { name, mut cloud, places, moves, .. } in cut.into_iter().flatten() {
        if levels_pay(&cloud, &moves, &camera, drawing) {
            let _task = console.task(format!("levels of detail of {name}"));
            cloud = cloud.with_levels_for(drawing.settings.tolerance);
        }
        clouds.extend(moves.iter().map(|to| cloud.clone().transformed(*to)));
        origins.extend(places.into_iter().map(|place| (name.clone(), place)));
    }
    Ok(Assembled { scene: Scene { clouds, lights }, camera, view, origins })
}

/// The cosine of how near to what is up by custom a map is looked at along it.
const MAP: f64 = 0.99;

/// What is up in the world: what the viewer says is, but for maps, where that is up in the picture alone.
fn up_of_things(camera: &CameraOptions, custom: DVec3) -> DVec3 {
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(|v| v.map(DVec3::from));
    let is_map = eye
        .zip(target)
        .is_some_and(|(eye, target)| (target - eye).normalize_or_zero().dot(custom).abs() > MAP);
    up.filter(|_| !is_map).unwrap_or(custom)
}

/// The splats of a volume at a place; says of what there are none.
fn shown_of(
    field: Field<'_>,
    (name, look, place): (&str, &Look, DAffine3),
    console: Console,
) -> Result<Vec<Cloud>> {
    let _task = console.task(format!("splats of {name}"));
    let paint = Paint::read(look, (place, field.values().frame().space), console)?;
    let shown = volume_clouds(field, look, paint.as_ref()).with_context(|| name.to_owned())?;
    let range = || {
        let values = field.values();
        let [nx, ny, nz] = values.dims();
        let range =
            values.value_range().map_or("no finite value".into(), |[a, b]| format!("values {a} to {b}"));
        let is_flat = look.iso.is_some() && nx.min(ny).min(nz) == 1;
        if is_flat {
            format!("{range}; {nx}×{ny}×{nz} samples have no cells for a surface to go through")
        } else {
            range
        }
    };
    if shown.iter().all(Cloud::is_empty) {
        console.say(format_args!("{name}: nothing in it is visible ({})", range()));
    } else {
        // Surfaces come first.
        let surfaces = look.iso.iter().flatten().zip(&shown);
        for (value, _) in surfaces.filter(|(_, surface)| surface.is_empty()) {
            console.say(format_args!("{name}: there is no surface at {value} ({})", range()));
        }
    }
    Ok(shown)
}

/// What takes a thing from one of its places to each of them; exactly nothing to that one.
fn moves_from(places: &[DAffine3], base: usize) -> Vec<DAffine3> {
    let back = places[base].inverse();
    let to = |(number, place): (usize, &DAffine3)| {
        if number == base { DAffine3::IDENTITY } else { *place * back }
    };
    places.iter().enumerate().map(to).collect()
}

/// A mesh in its own space, and where it stands.
struct StandingMesh {
    name: String,
    mesh: Mesh,
    places: Vec<DAffine3>,
    look: Look,
    /// What of the world it is left in; nothing where that is all of it.
    kept: Vec<HalfSpace>,
}

impl StandingMesh {
    /// The mesh where its surfels must be the densest, of the places that the picture shows if there are any, and the moves
    /// to all of them.
    fn at_the_nearest(self, camera: &Camera) -> (Self, Vec<DAffine3>) {
        let base = self.nearest(camera);
        let moves = moves_from(&self.places, base);
        let mesh = placed_mesh(self.mesh, self.places[base]);
        (Self { mesh, ..self }, moves)
    }

    /// Whether surfels are of all sides: what is cut open shows its backs, and other places show other sides.
    fn is_whole(&self, moves: &[DAffine3]) -> bool {
        moves.len() > 1 || !self.kept.is_empty()
    }

    /// How many surfels it takes, if that follows the view.
    fn wanted(&self, camera: &Camera, moves: &[DAffine3]) -> f64 {
        let count = if is_asked(&self.look) {
            0.0
        } else if self.is_whole(moves) {
            let spacing = view_spacing(camera, self.mesh.bounds().unwrap_or_default());
            self.mesh.area() / (spacing * spacing)
        } else {
            seen_count(&self.mesh, camera)
        };
        if count.is_finite() { count } else { 0.0 }
    }

    fn nearest(&self, camera: &Camera) -> usize {
        let Some([low, high]) = self.mesh.bounds().filter(|_| self.places.len() > 1) else { return 0 };
        let corners = |place: &DAffine3| {
            let corner = |i: usize| {
                let side = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
                place.transform_point3(DVec3::new(side(0), side(1), side(2)))
            };
            let first = [corner(0); 2];
            (1..8).map(corner).fold(first, |[low, high], p| [low.min(p), high.max(p)])
        };
        // Spacings in the mesh's own space.
        let finest = |spacing: &dyn Fn([DVec3; 2]) -> Option<f64>| {
            let own =
                |place: &DAffine3| Some(spacing(corners(place))? / place.matrix3.determinant().abs().cbrt());
            let spacings = self.places.iter().enumerate().filter_map(|(i, place)| Some((i, own(place)?)));
            spacings.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(i, _)| i)
        };
        finest(&|bounds| shown_spacing(camera, bounds))
            .or_else(|| finest(&|bounds| Some(view_spacing(camera, bounds))))
            .unwrap_or(0)
    }
}

/// The view that shows everything, but for what the viewer says. Of what stands in many places, the outline stands for all.
fn framed(
    camera: &CameraOptions,
    (standing, meshes): (&[Standing], &[StandingMesh]),
    up: DVec3,
    size: [u32; 2],
) -> Result<View> {
    fn of_cloud(cloud: &Cloud) -> impl ParallelIterator<Item = DVec3> {
        let to_world = cloud.cloud_to_world();
        let centers = (0..cloud.len()).into_par_iter().with_min_len(POINTS_A_TASK);
        centers.map(move |i| to_world.transform_point3(cloud.center(i).as_dvec3()))
    }
    fn of_mesh(mesh: &Mesh, place: DAffine3) -> impl ParallelIterator<Item = DVec3> {
        mesh.primitives.par_iter().flat_map(move |part| {
            let to_world = place * part.primitive_to_mesh;
            let positions = part.positions.par_iter().with_min_len(POINTS_A_TASK);
            positions.map(move |p| to_world.transform_point3(p.as_dvec3()))
        })
    }
    // Of what stands in one place all counts.
    let (copied, single): (Vec<_>, Vec<_>) = standing.iter().partition(|own| own.moves.len() > 1);
    let (copied_meshes, single_meshes): (Vec<_>, Vec<_>) =
        meshes.iter().partition(|own| own.places.len() > 1);
    let of_clouds =
        copied.into_iter().map(|own| (outline(of_cloud(&own.cloud)), extent(&own.cloud), &own.moves));
    let of_meshes = copied_meshes
        .into_iter()
        .map(|own| (outline(of_mesh(&own.mesh, DAffine3::IDENTITY)), 0.0, &own.places));
    let outlines: Vec<(Vec<DVec3>, f64, &Vec<DAffine3>)> = of_clouds.chain(of_meshes).collect();
    let singles: Vec<(&Cloud, f64)> = single.iter().map(|own| (&own.cloud, extent(&own.cloud))).collect();
    let reach = |directions: &[DVec3]| {
        let copies = outlines.iter().map(|(outline, extent, places)| {
            let points =
                places.par_iter().flat_map_iter(|place| outline.iter().map(|p| place.transform_point3(*p)));
            let largest = places.iter().map(|place| longest(place.matrix3)).fold(0.0, f64::max);
            (farthest(points, directions), extent * largest)
        });
        let clouds = singles.iter().map(|&(cloud, extent)| (farthest(of_cloud(cloud), directions), extent));
        let meshes =
            single_meshes.iter().map(|own| (farthest(of_mesh(&own.mesh, own.places[0]), directions), 0.0));
        let mut reach = vec![[f64::NEG_INFINITY; 2]; directions.len()];
        for (ends, extent) in clouds.chain(meshes).chain(copies) {
            for ((reach, (along, _)), direction) in reach.iter_mut().zip(ends).zip(directions) {
                *reach = [reach[0].max(along), reach[1].max(along + extent * direction.length())];
            }
        }
        reach
    };
    View::complete(camera, &reach, up, size)
}

/// How far the splats of a cloud reach about their centres, in the world: two standard deviations, in the median. A few large
/// ones, as trained splats have for the sky, don't count.
fn extent(cloud: &Cloud) -> f64 {
    let to_world = cloud.cloud_to_world().matrix3;
    let of = |index: usize| 2.0 * longest(to_world * cloud.factor(index).as_dmat3());
    let mut extents: Vec<f64> = (0..cloud.len()).step_by(cloud.len() / LOOKED_AT + 1).map(of).collect();
    let middle = extents.len() / 2;
    if extents.is_empty() { 0.0 } else { *extents.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Splats that tell how large those of a cloud are.
const LOOKED_AT: usize = 1000;

/// The longest axis.
fn longest(matrix: DMat3) -> f64 {
    matrix.x_axis.length().max(matrix.y_axis.length()).max(matrix.z_axis.length())
}

/// The least number of points that a thread looks at in one go.
const POINTS_A_TASK: usize = 4096;

/// As many surfels as asked for; else one a pixel, at most `most`, and where a mesh needn't be whole none of what the picture
/// doesn't show.
fn surfels(mesh: &Mesh, look: &Look, (camera, is_whole): (&Camera, bool), most: usize) -> Result<Vec<Cloud>> {
    if is_asked(look) {
        return Ok(vec![asked_surfels(mesh, look)?]);
    }
    let settings = SamplerSettings { max_surfels: most.max(1), ..SamplerSettings::default() };
    if !is_whole {
        return Ok(sample_seen(mesh, camera, &settings)?);
    }
    let spacing = view_spacing(camera, mesh.bounds().unwrap_or_default());
    Ok(vec![sample(mesh, Density::Spacing(spacing), &settings)?])
}

/// Whether it is said how many surfels there are.
fn is_asked(look: &Look) -> bool {
    look.surfels.is_some() || look.surfel_spacing.is_some()
}

/// As many surfels as asked for.
pub(crate) fn asked_surfels(mesh: &Mesh, look: &Look) -> Result<Cloud> {
    let (density, asked) = match (look.surfels, look.surfel_spacing) {
        (None, Some(spacing)) => (Density::Spacing(spacing), mesh.area() / (spacing * spacing)),
        (count, _) => (Density::Count(count.unwrap_or(1)), count.unwrap_or(1) as f64),
    };
    ensure!(asked <= MOST_ASKED as f64, "{asked:.0} surfels are asked for; at most {MOST_ASKED} are made");
    Ok(sample(mesh, density, &SamplerSettings { max_surfels: MOST_ASKED, ..SamplerSettings::default() })?)
}
