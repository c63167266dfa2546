//! What the parts of a file may come to together.

use crate::file::File;
use crate::{ImportError, Place};
use ::gltf::json::{Accessor, Material, Node, mesh};
use std::cell::Cell;

/// Memory that is left for what a file unpacks to.
///
/// Parts of glTF may be far larger than the bytes that tell of them: images, compressed buffer views, meshes and
/// images that are used many times, elements of the JSON text.
pub(crate) struct Budget {
    limit: u64,
    left: Cell<u64>,
}

impl Budget {
    pub(crate) fn new(limit: u64) -> Self {
        Self { limit, left: Cell::new(limit) }
    }

    /// Takes `count` times `size` bytes, if they are left.
    pub(crate) fn take(
        &self,
        file: &File,
        place: impl FnOnce() -> Place,
        (count, size): (usize, usize),
    ) -> Result<(), ImportError> {
        let bytes = (count as u64).checked_mul(size as u64);
        match bytes.and_then(|bytes| self.left.get().checked_sub(bytes)) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => {
                let limit = self.limit;
                let problem = format!(
                    "with this the file unpacks to more than {limit} bytes, which is the limit that is set"
                );
                Err(file.malformed(place(), problem))
            }
        }
    }

    /// Takes what a JSON text comes to at most.
    pub(crate) fn take_json(&self, file: &File, json: &[u8]) -> Result<(), ImportError> {
        let of = |sign: u8| json.iter().filter(|byte| **byte == sign).count();
        let element = [size_of::<Node>(), size_of::<Material>(), size_of::<Accessor>()]
            .into_iter()
            .fold(size_of::<mesh::Primitive>(), usize::max);
        // Vectors that grow have up to twice their size.
        self.take(file, || Place::Part("JSON".into()), (of(b'{'), 2 * element))?;
        self.take(file, || Place::Part("JSON".into()), (of(b',') + of(b'['), 64))
    }
}
