//! Thin stand-in for a library part that is on its way; deleted when it is merged.

pub(crate) fn view_spacing(camera: &oblate::engine::Camera, [low, high]: [glam::DVec3; 2]) -> f64 {
    let z = camera.pose().world_to_camera.transform_point3((low + high) / 2.0).z;
    camera.pixel_width_at(z.max(1e-9))
}
