//! What is drawn: the files, options and the built-in scene that commands share.

use crate::check::{Uses, Wrong};
use crate::content::{Body, Item, differing, load};
use crate::description::{CameraOptions, Description, FileOptions, Look, PictureOptions, Source};
use crate::progress::Console;
use crate::{built_in, scene_file};
use anyhow::{Result, bail, ensure};
use clap::Args;
use oblate::engine::Blend;
use std::path::{Path, PathBuf};

/// A scene and how it is seen.
#[derive(Args)]
pub(crate) struct SceneArgs {
    /// A scene file (TOML), or meshes, volumes, points and splats; none: the built-in scene
    #[arg(value_name = "SCENE.toml | FILE")]
    pub(crate) files: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) picture: PictureOptions,
    #[command(flatten)]
    pub(crate) camera: CameraOptions,
    #[command(flatten)]
    pub(crate) look: Look,
    #[command(flatten)]
    pub(crate) file: FileOptions,
}

impl SceneArgs {
    /// Refuses numbers out of their range, and options for files where there is none.
    pub(crate) fn check(&self) -> Result<()> {
        let wrong = [self.picture.check(), self.camera.check(), self.look.check(), self.file.check()];
        wrong.into_iter().collect::<Result<(), Wrong>>().map_err(Wrong::option)?;
        ensure!(
            !self.files.is_empty() || self.file == FileOptions::default(),
            "--dims, --type, --endian, --spacing, --texture, --flow, --level and --max-memory are for files; none is given"
        );
        Ok(())
    }

    /// What the files, or the built-in scene, and the options over them describe.
    pub(crate) fn describe(&self) -> Result<Description> {
        let mut described =
            if self.files.is_empty() { built_in::description() } else { describe(&self.files)? };
        described.picture = self.picture.clone().over(described.picture);
        described.camera = self.camera.clone().over(described.camera);
        Ok(described)
    }

    /// The files that are named.
    pub(crate) fn reads<'a>(&'a self, described: &'a Description) -> Vec<&'a Path> {
        let of_source = |source: &'a Source| {
            std::iter::once(source.path.as_path()).chain(source.file.reads()).chain(source.look.reads())
        };
        let given = self.files.iter().map(PathBuf::as_path).chain(self.file.reads()).chain(self.look.reads());
        given.chain(described.sources.iter().flat_map(of_source)).collect()
    }

    /// Reads what is described. What the command line says of looks counts for each file.
    pub(crate) fn load(&self, described: &mut Description, console: Console) -> Result<Vec<Item>> {
        let (items, uses) = if self.files.is_empty() {
            (built_in::items(console)?, Uses { mesh: true, volume: true, ..Uses::default() })
        } else {
            load_all(std::mem::take(&mut described.sources), &self.file, console)?
        };
        let used = self.file.check_use(uses).and_then(|()| self.look.check_use(uses));
        used.map_err(|wrong| {
            let names: Vec<&str> = items.iter().map(|item| item.name.as_str()).collect();
            wrong.option().context(names.join(", "))
        })?;
        let over = |item: Item| Item { look: self.look.clone().over(item.look), ..item };
        Ok(items.into_iter().map(over).collect())
    }
}

/// A scene file's description, or one of the files as they are.
fn describe(files: &[PathBuf]) -> Result<Description> {
    let is_scene = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    match files.iter().find(|path| is_scene(path)) {
        Some(path) if files.len() > 1 => {
            bail!("{}: a scene file stands alone; list the other files in it", path.display())
        }
        Some(path) => {
            let description = scene_file::read(path)?;
            ensure!(
                !description.sources.is_empty(),
                "{}: it lists no [[mesh]], [[volume]], [[points]] or [[splats]]",
                path.display()
            );
            Ok(description)
        }
        None => Ok(Description {
            sources: files.iter().cloned().map(Source::new).collect(),
            ..Description::default()
        }),
    }
}

/// Everything to draw, and what options for files were of use for.
fn load_all(sources: Vec<Source>, file: &FileOptions, console: Console) -> Result<(Vec<Item>, Uses)> {
    let (mut items, mut uses) = (Vec::new(), Uses::default());
    for source in sources {
        let (item, of_item) = load(source, file, console)?;
        items.push(item);
        uses = uses | of_item;
    }
    // What a scene file turns against others may fit them.
    let volumes = items.iter().filter_map(|item| match &item.body {
        Body::Volume(volume) => Some((item.name.as_str(), volume.frame().space, item.places[0].matrix3)),
        _ => None,
    });
    let (spaces, mut turns): (Vec<_>, Vec<_>) =
        volumes.map(|(name, space, turn)| ((name, space), turn)).unzip();
    turns.dedup();
    if turns.len() == 1
        && let Some(told) = differing(&spaces)
    {
        console.say(told);
    }
    Ok((items, uses))
}

/// The space of blending where nothing is said: splats by themselves are blended where they were trained.
pub(crate) fn blend(items: &[Item], console: Console) -> Blend {
    let in_display = |item: &&Item| matches!(item.body, Body::Splats { blend: Blend::Display, .. });
    let trained = items.iter().filter(in_display).count();
    if trained == 0 {
        Blend::Linear
    } else if trained == items.len() {
        console.say("blended in display space, where these splats were trained");
        Blend::Display
    } else {
        console
            .say("blended in linear light, not in display space, where the splats among these were trained");
        Blend::Linear
    }
}
