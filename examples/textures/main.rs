//! Texture pictures of two papers, with numbers: `cargo run --release --example textures [FOLDER]`
//!
//! Textures lie on the ground and are seen in perspective, in the lower half of a picture magnified and in the upper one minified.
//! Every picture is compared with the texture itself, supersampled behind the same pixel filter, and with what the texels'
//! kernels make of it, supersampled too. Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*, 2001, figures 8 and 9;
//! Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, figure 5.

mod footprints;
mod kernels;
mod sheet;
mod texture;
mod view;

use kernels::{Kind, draw, elliptical, hybrid, one_sheet, unfiltered, uniform};
use oblate::engine::{Camera, Cloud, FootprintForm, Order, RenderSettings};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use texture::{SIGMA, Texels, Texture, rings, zebra};
use view::{Picture, ground, pixels, supersampled, view};

/// Pixels across and down.
const PICTURE: [u32; 2] = [320, 240];

/// Samples a pixel of the supersampled pictures: of textures with edges, and of what kernels make of them, which has none.
const SAMPLES: [usize; 2] = [256, 64];

/// A texture's texels, and what their pictures ought to be.
struct Subject<'a> {
    name: String,
    camera: Camera,
    texels: Texels,
    exact: &'a Picture,
    by_kernels: Picture,
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "textures".to_owned()));
    std::fs::create_dir_all(&folder)?;
    println!("{}", sheet::HEAD);
    filters(&folder)?;
    let exact = supersampled(&view(PICTURE)?, SAMPLES[0], rings);
    surface_kernels(&Subject::new(("rings", rings), &exact, [512, 512])?, &folder)?;
    points_and_kernels(&Subject::new(("rings", rings), &exact, [1024, 1024])?, &folder)
}

impl<'a> Subject<'a> {
    fn new(
        (name, texture): (&str, Texture),
        exact: &'a Picture,
        size: [usize; 2],
    ) -> Result<Self, Box<dyn Error>> {
        let camera = view(PICTURE)?;
        let texels = Texels::new(texture, size);
        Ok(Self {
            name: format!("{name}, {}×{}", size[0], size[1]),
            exact,
            by_kernels: supersampled(&camera, SAMPLES[1], |at| texels.by_kernels(at)),
            camera,
            texels,
        })
    }

    /// Draws a cloud and prints its numbers.
    fn draw(&self, name: &str, cloud: &Cloud, settings: &RenderSettings) -> Result<Picture, Box<dyn Error>> {
        self.measured(name, || Ok(draw(cloud, &self.camera, settings)?))
    }

    /// Prints the numbers of a picture and how long it took.
    fn measured(
        &self,
        name: &str,
        draw: impl FnOnce() -> Result<Picture, Box<dyn Error>>,
    ) -> Result<Picture, Box<dyn Error>> {
        let start = Instant::now();
        let picture = draw()?;
        let seconds = start.elapsed().as_secs_f64();
        println!("{}", sheet::row([&self.name, name], &picture, [self.exact, &self.by_kernels], seconds)?);
        Ok(picture)
    }

    /// A slab as thick as the finer distance of texels.
    fn slab(&self) -> Kind {
        Kind::Slab(SIGMA * self.texels.step().min_element())
    }
}

/// Figure 8 of 2001: kernels twice and four times as long as wide. Supersampled; uniform scaling; elliptical, both as surfels.
fn filters(folder: &Path) -> Result<(), Box<dyn Error>> {
    let exact = supersampled(&view(PICTURE)?, SAMPLES[0], zebra);
    let mut drawn = Vec::new();
    for rows in [512, 256] {
        let subject = Subject::new(("zebra", zebra), &exact, [1024, rows])?;
        let Subject { texels, camera, .. } = &subject;
        let (slab, surface) = (subject.slab(), Kind::Surface);
        subject.draw("uniform, slab", &uniform(texels, slab, camera)?, &unfiltered())?;
        let round = subject.draw("uniform, surfels", &uniform(texels, surface, camera)?, &unfiltered())?;
        subject.draw("EWA, slab", &elliptical(texels, slab)?, &one_sheet())?;
        let long = subject.draw("EWA, surfels", &elliptical(texels, surface)?, &one_sheet())?;
        if rows == 256 {
            let kernels = footprints::footprints(texels, camera)?;
            sheet::save(&folder.join("footprints.png"), &kernels.iter().collect::<Vec<_>>(), 4)?;
        }
        drawn.push([round, long]);
    }
    let panels: Vec<&Picture> = drawn.iter().flat_map(|[round, long]| [&exact, round, long]).collect();
    Ok(sheet::save(&folder.join("zebra.png"), &panels, 3)?)
}

/// Figure 9 of 2001: volume kernels and surface kernels. Above supersampled, surfels; below a slab as one sheet and as a volume.
fn surface_kernels(subject: &Subject, folder: &Path) -> Result<(), Box<dyn Error>> {
    let slab = elliptical(&subject.texels, subject.slab())?;
    let sheet = subject.draw("volume kernels, one sheet", &slab, &one_sheet())?;
    let as_volume = RenderSettings { order: Order::Auto, ..one_sheet() };
    let volume = subject.draw("volume kernels, slabs of 2σ", &slab, &as_volume)?;
    let surfels = elliptical(&subject.texels, Kind::Surface)?;
    let surface = subject.draw("surface kernels", &surfels, &one_sheet())?;
    Ok(sheet::save(&folder.join("surface_kernels.png"), &[subject.exact, &surface, &sheet, &volume], 2)?)
}

/// Figure 5 of 2003: points, points where texels are minified, kernels, texture mapping. Above points of a pixel, points and kernels;
/// below kernels alone, one bilinear look-up a pixel.
fn points_and_kernels(subject: &Subject, folder: &Path) -> Result<(), Box<dyn Error>> {
    let Subject { texels, camera, .. } = subject;
    let points = subject.draw("points of a pixel", &hybrid(texels, camera, f64::INFINITY)?, &one_sheet())?;
    let both = subject.draw("points where minified", &hybrid(texels, camera, 1.0)?, &one_sheet())?;
    let surfels = elliptical(texels, Kind::Surface)?;
    let all_points = RenderSettings { footprint: FootprintForm::Point, ..one_sheet() };
    subject.draw("points as wide as kernels", &surfels, &all_points)?;
    let kernels = subject.draw("kernels", &surfels, &one_sheet())?;
    let ground = ground(camera);
    let look_up = || Ok(pixels(camera, |pixel| texels.bilinear(ground(pixel))));
    let backward = subject.measured("bilinear look-up", look_up)?;
    let [round, affine, exact] = kernels::forms(&surfels, camera, &one_sheet())?;
    println!("\nOf the kernels in the last row but one {round} are points, {affine} affine, {exact} exact.");
    Ok(sheet::save(&folder.join("points.png"), &[&points, &both, &kernels, &backward], 2)?)
}
