//! Thin stand-ins for library parts that are on their way; deleted when they are merged.
#![allow(dead_code, reason = "stand-ins")]

pub(crate) mod reference {
    use oblate::engine::{Camera, Frame, RenderError, RenderSettings, Scene};
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum ReferenceKind {
        R1,
        R2 { samples: u32 },
    }
    pub(crate) fn reference(
        scene: &Scene,
        camera: &Camera,
        settings: &RenderSettings,
        _kind: ReferenceKind,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Frame, RenderError> {
        progress(1);
        oblate::engine::render(scene, camera, settings, &())
    }
}

pub(crate) mod metrics {
    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Pixels<'a> {
        pub(crate) width: usize,
        pub(crate) height: usize,
        pub(crate) channels: usize,
        pub(crate) values: &'a [f32],
    }
    pub(crate) struct Metrics {
        pub(crate) psnr_db: f64,
        pub(crate) ssim: f64,
        pub(crate) max_error: f64,
        pub(crate) p999_error: f64,
        pub(crate) mean_error: f64,
    }
    pub(crate) fn compare(a: Pixels<'_>, b: Pixels<'_>) -> anyhow::Result<Metrics> {
        let errors: Vec<f64> = a.values.iter().zip(b.values).map(|(a, b)| f64::from((a - b).abs())).collect();
        let max_error = errors.iter().copied().fold(0.0, f64::max);
        let mse = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
        Ok(Metrics {
            psnr_db: -10.0 * mse.log10(),
            ssim: f64::NAN,
            max_error,
            p999_error: f64::NAN,
            mean_error: f64::NAN,
        })
    }
}

pub(crate) mod importers {
    use glam::DVec3;
    use oblate::surfels::Mesh;
    use oblate::volumes::Volume;
    use std::path::{Path, PathBuf};
    pub(crate) enum Opened {
        Mesh(Mesh),
        Volume(Volume),
    }
    pub(crate) enum Endian {
        Little,
        Big,
    }
    pub(crate) enum SampleType {
        U8,
        U16,
        I16,
        F32,
    }
    pub(crate) struct RawLayout {
        pub(crate) dims: [usize; 3],
        pub(crate) sample_type: SampleType,
        pub(crate) endian: Endian,
    }
    pub(crate) struct OpenOptions {
        pub(crate) raw: Option<RawLayout>,
        pub(crate) spacing: Option<DVec3>,
        pub(crate) texture: Option<PathBuf>,
    }
    pub(crate) fn open(_path: impl AsRef<Path>, _options: &OpenOptions) -> anyhow::Result<Opened> {
        anyhow::bail!("files are not read yet")
    }
}

pub(crate) fn view_spacing(camera: &oblate::engine::Camera, [low, high]: [glam::DVec3; 2]) -> f64 {
    let z = camera.pose().world_to_camera.transform_point3((low + high) / 2.0).z;
    camera.pixel_width_at(z.max(1e-9))
}
