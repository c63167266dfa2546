//! What is done to splats once they are made: painted by another volume, cut by planes.

use crate::content::{differing, open, placed_volume};
use crate::description::{FileOptions, Look};
use crate::progress::Console;
use crate::transfer;
use anyhow::{Context, Result, bail};
use glam::{DAffine3, DVec3};
use oblate::engine::{Cloud, HalfSpace};
use oblate::importers::Content;
use oblate::volumes::{Space, TransferFunction, Volume, painted};
use rayon::prelude::*;

/// Another volume and the colours of its values.
pub(crate) struct Paint {
    field: Volume,
    transfer: TransferFunction,
}

impl Paint {
    /// Reads the volume that a look names, if it names one, and stands it where `place` takes what it colours, which
    /// is in `space`.
    pub(crate) fn read(
        look: &Look,
        (place, space): (DAffine3, Option<Space>),
        console: Console,
    ) -> Result<Option<Self>> {
        let Some(path) = &look.color_by else { return Ok(None) };
        let name = path.display().to_string();
        let (opened, _) = open(path, &FileOptions::default(), console)?;
        for note in &opened.notes {
            console.say(format_args!("{name}: {note}"));
        }
        let Content::Volume(field) = opened.content else { bail!("{name}: it is no volume to colour by") };
        if let Some(told) = differing(&[("what is coloured", space), (name.as_str(), field.frame().space)]) {
            console.say(told);
        }
        let transfer = transfer::resolve(look.color_transfer.as_ref(), &field).context(name)?;
        Ok(Some(Self { field: placed_volume(field, place)?, transfer }))
    }

    pub(crate) fn apply(&self, cloud: &Cloud) -> Result<Cloud> {
        Ok(painted(cloud, &self.field, &self.transfer)?)
    }
}

/// What a look leaves of the world; nothing where it leaves all of it.
pub(crate) fn kept(look: &Look) -> Vec<HalfSpace> {
    let corners = look.clip_box.iter().flat_map(|corners| HalfSpace::of_box(corners.0.map(DVec3::from)));
    let planes = look.clip_plane.iter().flatten().map(|plane| {
        let [x, y, z, offset] = plane.0;
        HalfSpace { normal: DVec3::new(x, y, z), offset }
    });
    corners.chain(planes).collect()
}

/// The planes that cut a thing, which has these bounds, in at least one of its places.
pub(crate) fn cutting(
    kept: Vec<HalfSpace>,
    bounds: impl FnOnce() -> Option<[DVec3; 2]>,
    places: &[DAffine3],
) -> Vec<HalfSpace> {
    if kept.is_empty() {
        return kept;
    }
    let Some([low, high]) = bounds() else { return Vec::new() };
    let holds = |plane: &HalfSpace, place: &DAffine3| {
        let normal = place.matrix3.transpose() * plane.normal;
        let outermost = DVec3::select(normal.cmpgt(DVec3::ZERO), low, high);
        normal.dot(outermost) + plane.normal.dot(place.translation) >= plane.offset
    };
    kept.into_iter().filter(|plane| !places.iter().all(|place| holds(plane, place))).collect()
}

/// Bounds in a cloud's space of what planes cut of it; `None` for an empty cloud.
pub(crate) fn reached(cloud: &Cloud) -> Option<[DVec3; 2]> {
    let of = |index: usize| {
        let center = cloud.center(index).as_dvec3();
        let rows = cloud.factor(index).as_dmat3().transpose();
        let about =
            HalfSpace::REACH * DVec3::from([rows.x_axis, rows.y_axis, rows.z_axis].map(DVec3::length));
        [center - about, center + about]
    };
    let both = |[a, b]: [DVec3; 2], [c, d]: [DVec3; 2]| [a.min(c), b.max(d)];
    (0..cloud.len()).into_par_iter().with_min_len(1 << 12).map(of).reduce_with(both)
}
