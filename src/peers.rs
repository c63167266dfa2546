//! What other programs took for the program's own scenes: times, and pictures to hold against the references.

use crate::picture::Picture;
use anyhow::{Context, Result, ensure};
use oblate::chart::scenes::{Peer, Subject};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A file of them.
pub(crate) struct Peers {
    path: PathBuf,
    peers: Vec<Listed>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: u32,
    /// Where it was measured; for people.
    #[serde(rename = "machine")]
    _machine: String,
    peers: Vec<Listed>,
}

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    /// A scene of the program's own.
    scene: String,
    /// The program and its version.
    name: String,
    median_ms: f64,
    spread_ms: [f64; 2],
    /// What it drew, 8 bits a channel, beside this file.
    picture: PathBuf,
}

impl Peers {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let name = || path.display().to_string();
        let file: File =
            serde_json::from_slice(&std::fs::read(path).with_context(name)?).with_context(name)?;
        ensure!(file.format == 1, "{}: its format is {}; 1 is read", name(), file.format);
        for peer in &file.peers {
            let times = [peer.spread_ms[0], peer.median_ms, peer.spread_ms[1]];
            ensure!(
                times[0] > 0.0 && times.is_sorted() && times[2].is_finite(),
                "{}: {}: times are {times:?}; they must be above 0 and ascend from the quickest to the slowest",
                name(),
                peer.name
            );
        }
        Ok(Self { path: path.to_owned(), peers: file.peers })
    }

    /// Those that drew a subject, with their pictures.
    pub(crate) fn of(&self, subject: &Subject) -> Result<Vec<Peer>> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let of_it = self.peers.iter().filter(|peer| peer.scene == subject.name);
        let peer = |listed: &Listed| {
            let path = folder.join(&listed.picture);
            let picture = Picture::read(&path)?;
            let [width, height] = subject.camera.size().map(|side| side as usize);
            ensure!(
                [picture.width, picture.height] == [width, height],
                "{}: it is {}×{}; {} is drawn with {width}×{height}",
                path.display(),
                picture.width,
                picture.height,
                subject.name
            );
            Ok(Peer {
                name: listed.name.clone(),
                median_ms: listed.median_ms,
                spread_ms: listed.spread_ms,
                display: picture.values.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect(),
            })
        };
        of_it.map(peer).collect()
    }
}
