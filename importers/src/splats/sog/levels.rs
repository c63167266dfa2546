//! `lod-meta.json`: which parts of which scenes make a level of detail.

use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Deserialize)]
pub(super) struct Levels {
    version: Option<u32>,
    #[serde(rename = "lodLevels")]
    pub(super) count: u32,
    /// A scene that belongs to all levels.
    pub(super) environment: Option<String>,
    pub(super) filenames: Vec<String>,
    tree: Node,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<Node>,
    /// By level.
    #[serde(default)]
    lods: BTreeMap<u32, Part>,
}

/// Consecutive splats of a file.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Part {
    pub(super) file: usize,
    pub(super) offset: usize,
    pub(super) count: usize,
}

impl Levels {
    /// The parts of a level, by file and place in it.
    pub(super) fn parts(&self, level: u32) -> Result<Vec<Part>, String> {
        if let Some(version @ (0 | 2..)) = self.version {
            return Err(format!("a set of levels of version {version}; version 1 is read"));
        }
        if level >= self.count {
            let count = self.count;
            return Err(format!("there is no level {level}: there are {count}, of which 0 is the finest"));
        }
        let mut parts = Vec::new();
        let coarsest = self.tree.collect(level, &mut parts);
        if let Some(beyond) = coarsest.filter(|coarsest| *coarsest >= self.count) {
            return Err(format!("a node has a level {beyond}; there are {}", self.count));
        }
        parts.retain(|part| part.count > 0);
        parts.sort_unstable();
        if let Some(part) = parts.iter().find(|part| part.file >= self.filenames.len()) {
            return Err(format!("a node names file {}; there are {}", part.file, self.filenames.len()));
        }
        let overlap =
            |pair: &&[Part]| pair[0].file == pair[1].file && pair[1].offset - pair[0].offset < pair[0].count;
        if let Some(pair) = parts.windows(2).find(overlap) {
            let Part { file, offset, .. } = pair[1];
            return Err(format!("two nodes of level {level} have splat {offset} of file {file}"));
        }
        Ok(parts)
    }
}

impl Node {
    /// Collects the parts of a level; tells the coarsest level that there is.
    fn collect(&self, level: u32, parts: &mut Vec<Part>) -> Option<u32> {
        parts.extend(self.lods.get(&level));
        let below = self.children.iter().filter_map(|child| child.collect(level, parts)).max();
        below.max(self.lods.keys().next_back().copied())
    }
}
